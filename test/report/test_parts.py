# SPDX-License-Identifier: Apache-2.0
"""The parts of a report: what is kept of very many events, and the parameters in force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from stickslip_monitor import assess
from stickslip_monitor.monitor.config import BEARING_PARAMETERS
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.verdict import Event
from stickslip_monitor.physics.belief import Belief, Tolerance
from stickslip_monitor.report.parts import MOST_EVENTS, event_rows, facts, parameter_groups, shares
from stickslip_monitor.report.summary import Course

DAY_NS = 86_400 * 10**9
START = 1_777_852_800 * 10**9  # a midnight


def event(number: int, after: Condition) -> Event:
    at = START + number * 10**9
    return Event('aft', at, Condition.NORMAL, after, None, False, {}, f'aft: no. {number}')


def test_of_very_many_events_the_severe_stay() -> None:
    count = MOST_EVENTS + 200
    events = [
        event(i, Condition.STICK_SLIP if i % 100 == 50 else Condition.CAUTION)
        for i in range(count)
    ]
    rows, note = event_rows(events)
    assert len(rows) == MOST_EVENTS
    assert [row.number for row in rows] == sorted(row.number for row in rows)
    severe = [row.number for row in rows if row.grade == 'alarm']
    assert severe == [i + 1 for i in range(count) if i % 100 == 50]
    assert '200 events of' in note
    assert event_rows(events[:3])[1] == ''


def test_a_date_stands_where_it_changes() -> None:
    rows, _ = event_rows([event(i, Condition.CAUTION) for i in (0, 5, 86_400)])
    assert [row.date for row in rows] == ['2026-05-04', '', '2026-05-05']
    assert rows[1].text == 'no. 5'


def test_shares_add_up(course: Callable[..., Course]) -> None:
    found = shares(course([60.0] * 10 + [35.0] * 10 + [20.0] * 20))
    assert [share.name for share in found] == ['stable', 'bistable', 'unstable']
    assert sum(share.percent for share in found) == pytest.approx(100.0)
    assert [share.percent for share in found] == pytest.approx([25.0, 25.0, 50.0])


def test_facts_of_a_quiet_bearing(course: Callable[..., Course]) -> None:
    found = {fact.name: fact for fact in facts(course([60.0] * 10))}
    assert found['stick-slip predicted'].value == 'never'
    assert 'greatest amplitude' not in found


def test_probabilities_are_a_fact_where_there_are_any(course: Callable[..., Course]) -> None:
    name = 'greatest probability of stick-slip'
    quiet = course([60.0, 40.723091, 60.0])
    assert name not in {fact.name for fact in facts(quiet)}
    # With the damping alone unknown, the fold and what is faster have at most 50 %.
    config = quiet.config
    belief = Belief.from_tolerance(config.bearing, Tolerance(damping=0.1))
    point = quiet.scan.assessment
    points = assess(config.bearing, point.speed, point.load, belief)
    believed = replace(quiet, scan=replace(quiet.scan, assessment=points))
    (fact,) = (fact for fact in facts(believed) if fact.name == name)
    assert fact.value == '50%'
    assert fact.note == 'that it starts by itself: at most 0%'


def test_defaults_are_told_from_what_was_given() -> None:
    given = {'bearings': ['aft'], 'aft.mass': 50.0, 'aft.friction.law': 'coulomb'}
    monitor, bearing = parameter_groups(given, ['aft'])
    assert monitor.rows[0].value == 'aft'
    rows = {row.name: row for row in bearing.rows}
    assert (rows['mass'].value, rows['mass'].unit, rows['mass'].given) == ('50', 'kg', True)
    assert (rows['alarm.amplitude_limit'].value, rows['alarm.amplitude_limit'].given) == (
        'none',
        False,
    )
    assert 'friction.decay' not in rows
    known = {row.name for row in BEARING_PARAMETERS}
    assert set(rows) <= known
