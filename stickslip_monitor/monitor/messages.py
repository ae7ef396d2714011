# SPDX-License-Identifier: Apache-2.0
"""Events and verdicts as what is published and written, the same live and offline.

The diagnostic status of a bearing: what the node publishes and what a checked bag is given.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import BELIEFS, Assessment
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.health import NOT_MONITORING, DiagnosticRecord
from stickslip_monitor.monitor.input_watch import InputState
from stickslip_monitor.monitor.ladder import Condition, Level, Measured, Unknown
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.signals import INPUTS, QUANTITIES, Input, Status
from stickslip_monitor.monitor.verdict import Event, Standing, Verdict

WARNING_SCHEMA = 'stickslip_monitor/warning/1'
BEARINGS_SCHEMA = 'stickslip_monitor/bearings/1'
POINT_NUMBERS = (
    'speed',
    'load',
    'hopf_speed',
    'fold_speed',
    'hopf_margin',
    'fold_margin',
    'exact_fold_speed',
    'exact_fold_margin',
    'growth_rate',
    'amplitude',
    'amplitude_exact',
    'amplitude_error',
    'threshold_amplitude',
    *BELIEFS,
)
"""The numbers of an operating point in every record, in SI units."""
VERDICT_NUMBERS = ('amplitude', 'amplitude_exact', 'hopf_margin', 'fold_margin')
"""The numbers of a verdict that have a topic of their own, by the topic's last part."""


def output_topics(bearings: Iterable[BearingConfig], node: str) -> dict[str, str]:
    """The topics of a node of that full name, with their message types, in order.

    Args:
        bearings: The bearings; those with tolerances or a calibration have more topics.
        node: The node's full name, ``/stickslip_monitor`` say.
    """
    topics: dict[str, str] = {}
    for bearing in bearings:
        own = f'{node}/{bearing.name}'
        topics |= {f'{own}/{name}': 'std_msgs/msg/Float64' for name in topic_numbers(bearing)}
        topics |= {f'{own}/{name}': 'std_msgs/msg/String' for name in topic_words(bearing)}
    return topics | {
        f'{node}/warnings': 'std_msgs/msg/String',
        '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    }


def topic_numbers(bearing: BearingConfig) -> tuple[str, ...]:
    """The numbers that have a topic of their own, by the topic's last part."""
    return VERDICT_NUMBERS if bearing.belief is None else (*VERDICT_NUMBERS, *BELIEFS)


def topic_words(bearing: BearingConfig) -> tuple[str, ...]:
    """The words that have a topic of their own, by the topic's last part."""
    return ('regime',) if bearing.level is None else ('regime', 'measured')


def verdict_values(bearing: BearingConfig) -> dict[str, Callable[[Verdict], float | str]]:
    """What each topic of a bearing says of a verdict, by the topic's last part."""
    values = {name: _number_of(name) for name in topic_numbers(bearing)}
    return values | {name: _WORDS[name] for name in topic_words(bearing)}


def _number_of(name: str) -> Callable[[Verdict], float | str]:
    """A number, worked out only where somebody wants it; an amplitude is 0 without a cycle."""

    def read(verdict: Verdict) -> float:
        value = float(getattr(verdict.assessment, name))
        return 0.0 if math.isnan(value) and name.startswith('amplitude') else value

    return read


_WORDS: dict[str, Callable[[Verdict], float | str]] = {
    'regime': lambda verdict: str(verdict.assessment.regime.value),
    'measured': lambda verdict: str(verdict.standing.measured),
}


def number(value: float) -> float | None:
    """A float for JSON, which has no infinity and no NaN."""
    return value if math.isfinite(value) else None


def point_record(point: Assessment | None) -> dict[str, Any]:
    """Regime, outcome and numbers of an assessment of scalars; all ``None`` without one."""
    if point is None:
        return dict.fromkeys(('regime', 'outcome', *POINT_NUMBERS))
    return {
        'regime': point.regime.value,
        'outcome': point.outcome.value,
        **{name: number(getattr(point, name)) for name in POINT_NUMBERS},
    }


def event_record(event: Event) -> dict[str, Any]:
    """One event; the fields are documented in docs/interfaces.md."""
    return {
        'schema': WARNING_SCHEMA,
        'bearing': event.bearing,
        'time': event.time_ns,
        'from': event.before.value,
        'to': event.after.value,
        'level': event.after.level.name,
        'reason': event.after.value,
        'sticking': event.sticking,
        'growth': event.standing.growth,
        'clears_in': event.standing.clears,
        'raised': event.standing.raised,
        **({} if event.measured is None else {'measured': event.measured.value}),
        **point_record(event.assessment),
        'input_age': {name: number(age) for name, age in event.lost.items()},
        'text': event.text,
    }


def event_json(event: Event) -> str:
    """One event as the text of a message."""
    return json.dumps(event_record(event), allow_nan=False)


WAITING = 'Waiting for the first speed and load.'


@dataclass(frozen=True, slots=True)
class LevelState:
    """The measured vibration of a bearing at an instant.

    Attributes:
        measured: What it says.
        unknown: Why it says nothing; ``None`` where it does.
        counts: Values by :class:`Status`, shape (6,).
    """

    measured: Measured
    unknown: Unknown | None
    counts: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class BearingState:
    """A bearing at an instant.

    Attributes:
        config: The bearing.
        condition: What the alarm says.
        text: What it says, for a person.
        assessment: The last assessment, of scalars; ``None`` before the first.
        standing: What the alarm rests on.
        lost: The inputs that are lost, with their ages [s].
        counts: Samples by :class:`Input` and :class:`Status`, shape (3, 7).
        time_ns: When, on the clock of the samples [ns]; 0 before the first.
        inputs: Its inputs by quantity, where somebody looks at them.
        monitoring: Whether anybody watches the bearing.
        vibration: What is measured of it; ``None`` where none is configured.
    """

    config: BearingConfig
    condition: Condition
    text: str
    assessment: Assessment | None
    standing: Standing
    lost: dict[str, float]
    counts: NDArray[np.int64]
    time_ns: int = 0
    inputs: Mapping[str, InputState] = field(default_factory=dict)
    monitoring: bool = True
    vibration: LevelState | None = None

    @property
    def faults(self) -> dict[str, str]:
        """What is wrong with an input, by quantity; see :mod:`.input_faults`."""
        return {name: state.fault for name, state in self.inputs.items() if state.fault}

    @property
    def waiting(self) -> bool:
        """Whether nothing is known yet: no operating point, nor that an input is lost."""
        return self.assessment is None and self.condition is not Condition.INPUT_STALE

    @property
    def reason(self) -> str:
        """The condition, or why there is none."""
        if not self.monitoring:
            return 'not_monitoring'
        return 'waiting' if self.waiting else self.condition.value

    @property
    def level(self) -> Level:
        """How bad it is; nobody can say that all is well of a bearing that is not watched."""
        if not self.monitoring or self.waiting:
            return Level.WARN
        return max(self.condition.level, Level.WARN if self.faults else Level.OK)

    @property
    def message(self) -> str:
        """What there is to say, for a person."""
        name = self.config.name
        if not self.monitoring:
            return f'{name}: {NOT_MONITORING}'
        text = f'{name}: {WAITING}' if self.waiting else self.text
        return ' '.join([text, *dict.fromkeys(self.faults.values())])


def state_of(
    bearing: BearingMonitor,
    inputs: Mapping[str, InputState] | None = None,
    monitoring: bool = True,
) -> BearingState:
    """The state of a bearing that is, or was, monitored; see :class:`BearingState`."""
    verdict = bearing.verdict
    return BearingState(
        bearing.config,
        bearing.condition,
        bearing.text(),
        verdict.assessment if verdict else None,
        bearing.standing,
        bearing.lost(),
        bearing.counts,
        bearing.now_ns or 0,
        inputs or {},
        monitoring,
        _level_of(bearing),
    )


def _level_of(bearing: BearingMonitor) -> LevelState | None:
    if bearing.measured is None:
        return None
    return LevelState(bearing.measured, bearing.unknown, bearing.counts[Input.LEVEL])


def bearings_json(states: Iterable[BearingState], time_ns: int) -> str:
    """The records of some bearings as the text of a message."""
    records = [bearing_record(state) for state in states]
    document = {'schema': BEARINGS_SCHEMA, 'time': time_ns, 'bearings': records}
    return json.dumps(document, allow_nan=False)


def bearing_record(state: BearingState) -> dict[str, Any]:
    """A bearing as page, metrics and buses read it; the fields are in docs/interfaces.md."""
    standing, monitoring = state.standing, state.monitoring
    point = state.assessment if monitoring else None
    clears = standing.clears if point is not None else None
    level = state.vibration if monitoring else None
    return {
        'bearing': state.config.name,
        'time': state.time_ns,
        'level': state.level.name,
        'reason': state.reason,
        'text': state.message,
        'monitoring': monitoring,
        'sticking': None if point is None else standing.sticking,
        'growth': number(standing.growth),
        'clears_in': clears,
        'held_until': None if clears is None else state.time_ns + round(clears * 1e9),
        'raised': standing.raised,
        'rpm': None if point is None else _rpm(state.config, point),
        **point_record(point),
        'measured': None if level is None else level.measured.value,
        'unmeasured': level.unknown.sentence if level is not None and level.unknown else '',
        'unseen': standing.unseen,
        'inputs': {name: _input_record(state, place) for place, name in enumerate(_heard(state))},
    }


def _heard(state: BearingState) -> tuple[str, ...]:
    return QUANTITIES if state.vibration is None else INPUTS


def _input_record(state: BearingState, place: int) -> dict[str, Any]:
    name = INPUTS[place]
    known = state.inputs.get(name, InputState())
    if place < len(QUANTITIES):
        counts, lost = state.counts[place], name in state.lost
    else:
        assert state.vibration is not None
        counts, lost = state.vibration.counts, state.vibration.unknown is Unknown.LOST
    return {
        'lost': lost,
        'age': number(known.age),
        'rate': number(known.rate),
        'fault': known.fault,
        'counts': {each.name.lower(): int(counts[each]) for each in Status},
    }


def _rpm(config: BearingConfig, point: Assessment) -> float:
    return float(config.bearing.speed.from_surface(point.speed, 'rpm'))


def diagnostic_record(node: str, state: BearingState) -> DiagnosticRecord:
    """The diagnostic status of a bearing.

    Args:
        node: Full name of the node that publishes it, without the leading slash.
        state: The bearing.
    """
    name = state.config.name
    return DiagnosticRecord(
        level=state.level,
        name=f'{node}: {name}',
        hardware_id=hardware_id(node, name),
        message=state.message,
        values={
            key: value if isinstance(value, str) else f'{value:.9g}'
            for key, value in diagnostic_values(state).items()
        },
    )


def hardware_id(node: str, bearing: str) -> str:
    """A bearing's name in the namespace of its node: ``aft``, ``port/aft``."""
    space = node.rpartition('/')[0]
    return f'{space}/{bearing}' if space else bearing


def diagnostic_values(state: BearingState) -> dict[str, str | float]:
    """The key-value pairs of a bearing's diagnostic status: one number a key, unit in the key."""
    result: dict[str, str | float] = {'reason': state.reason}
    point = state.assessment if state.monitoring else None
    if point is not None:
        result |= {
            'regime': point.regime.value,
            'outcome': point.outcome.value,
            'stick-slip predicted': str(state.standing.sticking).lower(),
            'speed [m/s]': point.speed,
            'shaft speed [rpm]': _rpm(state.config, point),
            'load [N]': point.load,
            'hopf speed [m/s]': point.hopf_speed,
            'fold speed [m/s]': point.fold_speed,
            'hopf margin': point.hopf_margin,
            'fold margin': point.fold_margin,
            'growth rate [1/s]': point.growth_rate,
            'growth [e-folds]': state.standing.growth,
            'amplitude [m]': point.amplitude,
            'amplitude of the exact cycle [m]': point.amplitude_exact,
            'error of the amplitude': point.amplitude_error,
            'threshold amplitude [m]': point.threshold_amplitude,
            'clears in [s]': math.nan if state.standing.clears is None else state.standing.clears,
            'raised lately': state.standing.raised,
        }
        if point.has_belief:
            result |= {name.replace('_', ' '): getattr(point, name) for name in BELIEFS}
    for name, age in state.lost.items():
        result[f'{name} age [s]'] = age
    for name, text in state.faults.items():
        result[f'{name} fault'] = text
    result |= _level_values(state)
    counts = state.counts[: len(QUANTITIES)]
    result |= zip(_COUNTED, map(int, counts.flat), strict=True)
    if state.vibration is not None:
        result |= zip(_COUNTED_LEVELS, map(int, state.vibration.counts), strict=True)
    return result


_STATUSES = [status.name.lower().replace('_', ' ') for status in Status]
_COUNTED = [f'{name} samples {status}' for name in QUANTITIES for status in _STATUSES]
_COUNTED_LEVELS = [f'level samples {status}' for status in _STATUSES]


def _level_values(state: BearingState) -> dict[str, str | float]:
    level = state.vibration if state.monitoring else None
    if level is None:
        return {}
    return {
        'measured': level.measured.value,
        'measured unknown': '' if level.unknown is None else level.unknown.sentence,
        'predicted but not measured for [s]': state.standing.unseen,
    }
