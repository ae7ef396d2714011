# SPDX-License-Identifier: Apache-2.0
"""Events, verdicts and states of bearings and of the node, as published and written, live and offline."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import plural
from stickslip_monitor.monitor import record_fields
from stickslip_monitor.monitor.assessment import Assessment, Assessments
from stickslip_monitor.monitor.bearing_monitor import BearingMonitor
from stickslip_monitor.monitor.input_faults import InputState
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_state import NEVER
from stickslip_monitor.monitor.sample_types import INPUTS, Input, Status
from stickslip_monitor.monitor.severity import NOT_MONITORING, Condition, Severity, Unknown
from stickslip_monitor.monitor.statements import Event, Verdict, speed_order

WARNING_SCHEMA = 'stickslip_monitor/warning/3'
BEARINGS_SCHEMA = 'stickslip_monitor/bearings/4'
POINT_NUMBERS = tuple(item.name for item in record_fields.NUMBERS)
"""The numbers of an operating point in every record, in SI units."""
WITHOUT_CYCLE = {item.name: 0.0 for item in record_fields.NUMBERS if item.is_zero_without_cycle}
"""What topics and metrics say at a point where no cycle exists."""


def output_topics(bearings: Iterable[BearingConfig], node: str) -> dict[str, str]:
    """Return the output topics of a node, by its full name, with their message types, in order.

    Bearings with tolerances, a calibration or a level have more of them.
    """
    topics: dict[str, str] = {}
    for bearing in bearings:
        prefix = f'{node}/{bearing.name}'
        topics |= {f'{prefix}/{name}': record_fields.FLOAT64 for name in topic_numbers(bearing)}
        topics |= {f'{prefix}/{name}': record_fields.STRING for name in topic_words(bearing)}
    return topics | {
        f'{node}/warnings': record_fields.STRING,
        '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    }


def topic_numbers(bearing: BearingConfig) -> tuple[str, ...]:
    """Return the numbers that have a topic of their own, by the topic's last part; amplitudes come first."""
    rows = _with_topic(bearing, record_fields.FLOAT64)
    return tuple(sorted(rows, key=lambda name: name not in WITHOUT_CYCLE))


def topic_words(bearing: BearingConfig) -> tuple[str, ...]:
    """Return the words that have a topic of their own, by the topic's last part."""
    return tuple(_with_topic(bearing, record_fields.STRING))


def _with_topic(bearing: BearingConfig, kind: str) -> Iterator[str]:
    """Yield the names of the fields of a bearing that have a topic of that message type."""
    has = {
        '': True,
        record_fields.BELIEF: bearing.belief is not None,
        record_fields.LEVEL: bearing.level is not None,
        record_fields.WATER: bearing.water_temperature is not None,
    }
    return (item.name for item in record_fields.BEARING if item.topic == kind and has[item.needs])


def verdict_value(name: str, verdict: Verdict) -> float | str:
    """Return the value of a verdict's topic, by its last part: a word, or a :func:`topic_number`."""
    if name == 'measured':
        return str(verdict.measured)
    point = verdict.assessment
    return point.regime.value if name == 'regime' else float(topic_number(name, point))


def topic_number(name: str, points: Assessment | Assessments) -> FloatArray:
    """Return a number of points, of their shape, as its topic has it: 0 or ``nan`` where no cycle exists."""
    value = np.asarray(getattr(points, name))
    return np.where(np.isnan(value), WITHOUT_CYCLE.get(name, math.nan), value)


def finite_or_none(value: float) -> float | None:
    """Return a float for JSON, which has no infinity and no NaN: ``None`` for those."""
    return value if math.isfinite(value) else None


def point_record(point: Assessment | None) -> dict[str, Any]:
    """Return regime, outcome and numbers of one operating point, by the names of its record fields.

    All are ``None`` without a point; a number that is not finite is ``None``.
    """
    if point is None:
        return dict.fromkeys(item.name for item in record_fields.POINT)
    return {
        'regime': point.regime.value,
        'outcome': point.outcome.value,
        **{name: finite_or_none(float(getattr(point, name))) for name in POINT_NUMBERS},
    }


def event_record(event: Event) -> dict[str, Any]:
    """Return the record of one event as in docs/interfaces.md.

    ``measured`` is absent without a level, and before the first operating point.
    """
    then = event.standing
    measured = None if then.state.point == NEVER else then.measured
    return {
        'schema': WARNING_SCHEMA,
        'bearing': event.bearing,
        'time': event.time_ns,
        'from': event.before.value,
        'to': event.after.value,
        'severity': event.after.severity.name,
        'reason': event.after.value,
        'sticking': then.sticking,
        'growth': then.growth,
        'clears_in': then.clears_in,
        'raised': then.raised_lately,
        **({} if measured is None else {'measured': measured.value}),
        **point_record(then.assessment),
        'input_age': {name: finite_or_none(age) for name, age in event.lost.items()},
        'text': event.text,
    }


def event_json(event: Event) -> str:
    """Return the record of one event as JSON text."""
    return json.dumps(event_record(event), allow_nan=False)


WAITING = 'Waiting for the first speed and load.'
UNRELIABLE = 'No verdict can be relied on.'


@dataclass(frozen=True)
class BearingState:
    """A bearing as it is published: to be read before it goes on."""

    bearing: BearingMonitor
    inputs: Mapping[str, InputState] = field(default_factory=dict)  # where somebody looks at them
    monitoring: bool = True  # somebody watches the bearing
    mixed: str = ''  # why its verdict rests on two sources, as :meth:`.InputWatch.mixed_text` says it

    @property
    def point(self) -> Assessment | None:
        """The last operating point; ``None`` before the first, and while the bearing is not watched."""
        return self.bearing.assessment if self.monitoring else None

    @property
    def faults(self) -> dict[str, str]:
        """Faults of the inputs, by quantity."""
        return {name: state.fault for name, state in self.inputs.items() if state.fault}

    @property
    def is_waiting(self) -> bool:
        """Whether there is no operating point yet, and no input is known to be lost."""
        bearing = self.bearing
        return bearing.verdict is None and bearing.condition is not Condition.INPUT_STALE

    @property
    def reason(self) -> str:
        """Word for the present condition, or for why there is none.

        That is ``not_monitoring``, ``waiting``, or ``unreliable`` in place of normal where sources are mixed.
        """
        if not self.monitoring:
            return 'not_monitoring'
        if self.is_waiting:
            return 'waiting'
        condition = self.bearing.condition
        return 'unreliable' if self.mixed and condition is Condition.NORMAL else condition.value

    @property
    def severity(self) -> Severity:
        """Severity of the condition, at least WARN where inputs are faulty or their sources mixed.

        WARN, too, while the bearing is not watched, or waits for its first point.
        """
        if not self.monitoring or self.is_waiting:
            return Severity.WARN
        doubtful = self.faults or self.mixed
        return max(self.bearing.condition.severity, Severity.WARN if doubtful else Severity.OK)

    @property
    def message(self) -> str:
        """Text for a person, from the bearing's name on: condition, mixed sources and faults of the inputs.

        A fault that the text names already is not repeated; while not monitoring only that is said.
        """
        name = self.bearing.config.name
        if not self.monitoring:
            return f'{name}: {NOT_MONITORING}'
        text = f'{name}: {WAITING}' if self.is_waiting else self.bearing.text()
        if self.mixed:
            text = f'{name}: {self.mixed} {UNRELIABLE} By the latest values: {text.removeprefix(f"{name}: ")}'
        more = [fault for fault in dict.fromkeys(self.faults.values()) if fault not in text]
        return ' '.join([text, *more])


def bearings_json(states: Iterable[BearingState], time_ns: int) -> str:
    """Return the records of some bearings as JSON text, with a stamp [ns]."""
    records = [bearing_record(state) for state in states]
    document = {'schema': BEARINGS_SCHEMA, 'time': time_ns, 'bearings': records}
    return json.dumps(document, allow_nan=False)


def bearing_record(state: BearingState) -> dict[str, Any]:
    """Return the record of a bearing as in docs/interfaces.md, which page, metrics and buses read.

    Numbers of the operating point are ``None`` without one, while the bearing is not watched, or where not
    finite.
    """
    bearing, point, monitoring = state.bearing, state.point, state.monitoring
    time_ns, lost = bearing.now_ns or 0, bearing.lost_ages()
    clears = None if point is None or lost else bearing.clears_in
    rpm = None if point is None else bearing.config.bearing.speed.from_surface(point.speed, 'rpm')
    given = speed_order(bearing) if monitoring and not lost else None
    measured = bearing.measured if monitoring else None
    unknown = bearing.unknown if monitoring else None
    has_water = bearing.config.water_temperature is not None or not math.isnan(bearing.state.water)
    return {
        'bearing': bearing.config.name,
        'time': time_ns,
        'severity': state.severity.name,
        'reason': state.reason,
        'text': state.message,
        'monitoring': monitoring,
        'sticking': None if point is None else bearing.sticking,
        'growth': finite_or_none(bearing.growth),
        'clears_in': clears,
        'held_until': None if clears is None else time_ns + round(clears * 1e9),
        'raised': bearing.raised_lately,
        'rpm': None if rpm is None else float(rpm),
        'order': None if given is None else given.kind.value,
        'speed_to_reach': None if given is None else given.rpm,
        **point_record(point),
        'measured': None if measured is None else measured.value,
        'unmeasured': '' if unknown is None else unknown.sentence,
        'unseen': bearing.unseen,
        'water_temperature': finite_or_none(bearing.state.water) if has_water else None,
        'viscosity_ratio': bearing.state.viscosity_ratio if has_water else None,
        'inputs': {name: _input_record(state, name) for name in bearing.config.inputs},
    }


def _input_record(state: BearingState, name: str) -> dict[str, Any]:
    """Return the record of one input: whether it is lost, age [s], rate [Hz], fault and counts by status.

    Age and rate are ``None`` where they are not known, as without a graph; the fault is '' for none.
    """
    bearing, place = state.bearing, INPUTS.index(name)
    input_state, counts = state.inputs.get(name, InputState()), bearing.counts[place]
    return {
        'lost': _is_lost(bearing, place),
        'age': finite_or_none(input_state.age),
        'rate': finite_or_none(input_state.rate),
        'fault': input_state.fault,
        'counts': {status.name.lower(): int(counts[status]) for status in Status},
    }


def _is_lost(bearing: BearingMonitor, place: int) -> bool:
    """Return whether an input is lost; level and temperature only after their first value.

    ``place`` is the index of the input.
    """
    if place == Input.LEVEL:
        return bearing.unknown is Unknown.LOST
    if place == Input.WATER_TEMPERATURE:
        return bearing.is_lost(place) and bearing.state.came[place] != NEVER
    return INPUTS[place] in bearing.lost_ages()


def diagnostic_record(node: str, state: BearingState) -> DiagnosticRecord:
    """Return the diagnostic status of a bearing: its text, and values by key, each key with its unit.

    Only what is known and configured has a key; a number that is missing is nan. ``node`` is the full name
    of the node without the leading slash.
    """
    bearing, record = state.bearing, bearing_record(state)
    is_known = state.point is not None
    has = {
        '': is_known,
        record_fields.BELIEF: is_known and bearing.config.belief is not None,
        record_fields.LEVEL: record['measured'] is not None,
        record_fields.WATER: is_known and record['viscosity_ratio'] is not None,
    }
    values = {
        item.key: record[item.name]
        for item in record_fields.BEARING
        if item.key and (has[item.needs] or item.name == 'reason')
    }
    values |= {f'{name} age [s]': age for name, age in bearing.lost_ages().items()}
    values |= {f'{name} fault': text for name, text in state.faults.items()}
    for name, input_record in record['inputs'].items():
        values |= {
            f'{name} samples {key.replace("_", " ")}': count for key, count in input_record['counts'].items()
        }
    name, written = bearing.config.name, {key: _format_value(value) for key, value in values.items()}
    return DiagnosticRecord(
        state.severity, f'{node}: {name}', hardware_id(node, name), record['text'], written
    )


def _format_value(value: str | float | None) -> str:
    """Return a value of a diagnostic status as text: nine digits, true or false, nan for ``None``."""
    if isinstance(value, str):
        return value
    return str(value).lower() if isinstance(value, bool) else f'{math.nan if value is None else value:.9g}'


def hardware_id(node: str, bearing: str) -> str:
    """Return a bearing's name in the namespace of a node, as ``aft`` or ``port/aft``.

    ``node`` is its full name without the leading slash.
    """
    space = node.rpartition('/')[0]
    return f'{space}/{bearing}' if space else bearing


DOUBLE = 'Another node has the same full name: services and parameters reach either of them.'
CLOCKS = 'Several nodes publish /clock, so time jumps to and fro:'
LATELY_NS = 60 * SECOND_NS
"""For so long [ns] a failure, or the loss of a message, is what the node has to say."""
NODE_STATUS = 'the node'
"""Stands for the bearing in the name of the node's own status."""


@dataclass(frozen=True, slots=True)
class DiagnosticRecord:
    """The fields of a ``diagnostic_msgs/DiagnosticStatus``, without ROS."""

    level: Severity
    name: str
    hardware_id: str
    message: str
    values: dict[str, str]


@dataclass(slots=True)
class NodeHealth:
    """Health of the node itself."""

    monitoring: bool = False  # it is active
    failures: int = 0  # callbacks that failed and were survived
    last_failure: str = ''  # the text of the last of them, with its time
    failing: bool = False  # it was within the last minute
    lost: int = 0  # messages that are missing by the numbers of their publishers
    left_out: int = 0  # messages that came to nothing because the node was held up or busy
    losing: bool = False  # the last of these was within a minute
    double: bool = False  # another node has the same full name
    clocks: str = ''  # who publishes simulated time, where it is more than one
    delays: int = 0  # how often the node was held up
    longest_delay: float = 0.0  # for how long at most [s]
    state_file_fault: str = ''  # why the alarms are not kept
    state_file_damage: str = ''  # why the alarms of before are lost; until somebody acknowledges
    clip_fault: str = ''  # why the last event clip is lost
    calibration_faults: tuple[str, ...] = ()  # why calibrations are not used
    changed: dict[str, tuple[object, object]] = field(default_factory=dict)
    """What was changed over ROS and not acknowledged: value before and now, by parameter."""
    # Of failures and of losses: how many were seen, and when the last was new [ns].
    _seen: list[tuple[int, float]] = field(default_factory=lambda: [(0, -math.inf)] * 2)

    def update(self, steady_ns: int) -> bool:
        """Set ``failing`` and ``losing`` at a time of the steady clock [ns].

        Returns:
            Whether messages were lost or left out since the last call.
        """
        before, counts = self._seen, (self.failures, self.lost + self.left_out)
        self._seen = [
            (count, steady_ns if count > seen else at)
            for count, (seen, at) in zip(counts, before, strict=True)
        ]
        self.failing, self.losing = (count > 0 and steady_ns - at < LATELY_NS for count, at in self._seen)
        return counts[1] > before[1][0]

    def record_change(self, name: str, before: object, after: object) -> None:
        """Record a changed parameter in ``changed``; remove one that is back at its first value."""
        before = self.changed.pop(name, (before,))[0]
        if before != after:
            self.changed[name] = before, after

    @property
    def severity(self) -> Severity:
        """ERROR while something that was asked for is not done, WARN for what needs attention."""
        if self.failing or self.state_file_fault or self.clip_fault:
            return Severity.ERROR
        damaged = self.state_file_damage or self.calibration_faults
        doubtful = self.losing or self.double or self.clocks or self.changed
        return Severity.WARN if doubtful or damaged or not self.monitoring else Severity.OK

    @property
    def losses(self) -> str:
        """Numbers of messages lost on their way and of those left out, as a clause; '' without any."""
        parts = (
            f'{plural(self.lost, "message")} lost on the way to the node' if self.lost else '',
            f'{plural(self.left_out, "message")} left out while the node was too busy'
            if self.left_out
            else '',
        )
        return ', '.join(part for part in parts if part)

    @property
    def message(self) -> str:
        """Sentences for a person on what is wrong, the worst first; ``Monitoring.`` where nothing is."""
        failures = f'{plural(self.failures, "callback")} failed, last {self.last_failure}'
        sentences = [
            failures if self.failing else '',
            self.state_file_fault,
            self.clip_fault,
            *(f'{text}.' for text in (self.state_file_damage, *self.calibration_faults) if text),
            '' if self.monitoring else NOT_MONITORING,
            DOUBLE if self.double else '',
            self.clocks and f'{CLOCKS} {self.clocks}.',
            f'{self.losses}, some in the last minute.' if self.losing else '',
            f'Changed over ROS and not acknowledged: {self.changes}.' if self.changed else '',
        ]
        return ' '.join(text for text in sentences if text) or 'Monitoring.'

    @property
    def changes(self) -> str:
        """Changes made over ROS that are not acknowledged, as a clause; '' without any."""
        items = self.changed.items()
        return ', '.join(f'{name} from {before!r} to {now!r}' for name, (before, now) in items)


def health_record(node: str, health: NodeHealth) -> DiagnosticRecord:
    """Return the diagnostic status of a node; ``node`` is its full name without the leading slash."""
    return DiagnosticRecord(
        level=health.severity,
        name=f'{node}: {NODE_STATUS}',
        hardware_id=node,
        message=health.message,
        values={
            'state': 'active' if health.monitoring else 'inactive',
            'callbacks failed': str(health.failures),
            'last failure': health.last_failure or 'none',
            'messages lost on the way': str(health.lost),
            'messages left out': str(health.left_out),
            'times held up': str(health.delays),
            'longest time held up [s]': f'{health.longest_delay:.3g}',
            'parameters changed': health.changes or 'none',
            'state file': health.state_file_fault or health.state_file_damage or 'fine',
            'event clips': health.clip_fault or 'fine',
        },
    )
