# SPDX-License-Identifier: Apache-2.0
"""The parts of a report: figures, shares of time, the table of events, the configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from stickslip_monitor.drawing.palette import CONDITION_NAMES
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BEARING_PARAMETERS, NODE_PARAMETERS
from stickslip_monitor.monitor.ladder import Level
from stickslip_monitor.monitor.messages import number
from stickslip_monitor.monitor.parameter import REQUIRED, Parameter
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.offline.intervals import together
from stickslip_monitor.report import formatting
from stickslip_monitor.report.document import EventRow, Fact, ParameterGroup, ParameterRow, Share
from stickslip_monitor.report.summary import STICKING, Course, place

MOST_EVENTS = 400
_GRADES = {Level.OK: 'clear', Level.WARN: 'warning', Level.ERROR: 'alarm'}


def facts(course: Course) -> tuple[Fact, ...]:
    """The figures that matter most."""
    sticking = sum(spell.seconds for spell in together(course.spells, STICKING))
    found = [
        Fact(
            'stick-slip predicted',
            formatting.duration(sticking) if sticking else 'never',
            f'{formatting.share(sticking, course.span)} of the time' if sticking else '',
        )
    ]
    for name, title, shown in (
        ('fold_margin', 'least fold margin', formatting.margin),
        ('hopf_margin', 'least Hopf margin', formatting.margin),
        ('amplitude', 'greatest amplitude', formatting.millimetres),
    ):
        if name in course.worst:
            extreme = course.worst[name]
            note = f'{formatting.minute(extreme.time_ns)}, at {place(course, extreme)}'
            found.append(Fact(title, shown(extreme.value), note))
    point = course.scan.assessment
    if point.has_belief:
        can, will = (
            float(np.nanmax(p, initial=0.0))
            for p in (point.probability_can, point.probability_will)
        )
        note = f'that it starts by itself: at most {will:.0%}'
        found.append(Fact('greatest probability of stick-slip', f'{can:.0%}', note))
    return tuple(found)


def shares(course: Course) -> tuple[Share, ...]:
    """The time in each regime, without those that never were."""
    total = sum(course.seconds.values())
    return tuple(
        Share(
            regime.value,
            regime.value,
            formatting.duration(course.seconds[regime]),
            100.0 * course.seconds[regime] / total,
            formatting.share(course.seconds[regime], total),
        )
        for regime in Regime
        if course.seconds.get(regime, 0.0) > 0.0
    )


def event_rows(events: Sequence[Event]) -> tuple[tuple[EventRow, ...], str]:
    """The table of events and a note on those left out, the least severe first."""
    order = sorted(range(len(events)), key=lambda i: (-events[i].after.level, i))
    kept = sorted(order[:MOST_EVENTS])
    rows: list[EventRow] = []
    day = ''
    for i in kept:
        event = events[i]
        new_day = formatting.date(event.time_ns)
        rows.append(_event_row(i + 1, event, '' if new_day == day else new_day))
        day = new_day
    left = len(events) - len(kept)
    note = (
        f'{formatting.count(left, "event")} of {formatting.grouped(len(events))} are left out'
        ' here, those of the lower levels first; check --json has them all.'
        if left
        else ''
    )
    return tuple(rows), note


def _event_row(number: int, event: Event, date: str) -> EventRow:
    return EventRow(
        number=number,
        date=date,
        time=formatting.clock(event.time_ns),
        iso=formatting.iso(event.time_ns),
        before=CONDITION_NAMES[event.before],
        after=CONDITION_NAMES[event.after],
        grade=_GRADES[event.after.level],
        text=event.text.removeprefix(f'{event.bearing}: '),
    )


def parameter_groups(
    values: Mapping[str, Any], bearings: Iterable[str]
) -> tuple[ParameterGroup, ...]:
    """The parameters in force: those given, and the defaults of the others.

    Args:
        values: The parameters given, by full name.
        bearings: Names of the bearings.
    """
    groups = [ParameterGroup('Monitor', _rows(NODE_PARAMETERS, values, ''))]
    groups += [
        ParameterGroup(f'Bearing {name}', _rows(BEARING_PARAMETERS, values, f'{name}.'))
        for name in bearings
    ]
    return tuple(groups)


def _rows(
    table: Iterable[Parameter], values: Mapping[str, Any], prefix: str
) -> tuple[ParameterRow, ...]:
    rows = []
    for row in table:
        given = f'{prefix}{row.name}' in values
        value = values.get(f'{prefix}{row.name}', row.default)
        # A number that only another friction law takes has no default.
        if value is REQUIRED or value == () or value != value:
            continue
        rows.append(ParameterRow(row.name, _value(value), row.unit, given))
    return tuple(rows)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float | int):
        return f'{value:.12g}' if number(float(value)) is not None else 'none'
    if isinstance(value, str):
        return value or '\N{EM DASH}'
    return ', '.join(_value(item) for item in value)
