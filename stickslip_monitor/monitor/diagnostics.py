# SPDX-License-Identifier: Apache-2.0
"""The diagnostic status of a bearing: what the node publishes and what a checked bag is given."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.alarm import Condition, Level
from stickslip_monitor.monitor.assessment import Assessment
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.signals import QUANTITIES, Status
from stickslip_monitor.monitor.trend import Trend

WAITING = 'Waiting for the first speed and load.'


@dataclass(frozen=True, slots=True)
class State:
    """A bearing at an instant.

    Attributes:
        config: The bearing.
        condition: What the alarm says.
        text: What it says, for a person.
        assessment: The last assessment, of scalars; ``None`` before the first.
        sticking: Whether that one predicts stick-slip.
        lost: The inputs that are lost, with their ages [s].
        trend: When that prediction changes at the present rate; ``None`` if unknown.
        counts: Samples by quantity (speed, load) and :class:`Status`, shape (2, 6).
    """

    config: BearingConfig
    condition: Condition
    text: str
    assessment: Assessment | None
    sticking: bool
    trend: Trend | None
    lost: dict[str, float]
    counts: NDArray[np.int64]

    @property
    def waiting(self) -> bool:
        """Whether nothing is known yet: no operating point, nor that an input is lost."""
        return self.assessment is None and self.condition is not Condition.INPUT_STALE


@dataclass(frozen=True, slots=True)
class DiagnosticRecord:
    """The fields of a ``diagnostic_msgs/DiagnosticStatus``, without ROS."""

    level: Level
    name: str
    hardware_id: str
    message: str
    values: dict[str, str]


def state_of(bearing: BearingMonitor) -> State:
    """The state of a bearing that is monitored live."""
    verdict, trend = bearing.verdict, bearing.trend()
    return State(
        bearing.config,
        bearing.track.condition,
        bearing.text(trend),
        verdict.assessment if verdict else None,
        verdict.sticking if verdict else False,
        trend,
        bearing.lost(),
        bearing.gate.counts,
    )


def diagnostic_record(node: str, state: State) -> DiagnosticRecord:
    """The diagnostic status of a bearing, as the node of that name publishes it."""
    name = state.config.name
    return DiagnosticRecord(
        level=Level.WARN if state.waiting else state.condition.level,
        name=f'{node}: {name}',
        hardware_id=name,
        message=f'{name}: {WAITING}' if state.waiting else state.text,
        values={
            key: value if isinstance(value, str) else f'{value:.9g}'
            for key, value in diagnostic_values(state).items()
        },
    )


def diagnostic_values(state: State) -> dict[str, str | float]:
    """The key-value pairs of a bearing's diagnostic status: one number a key, unit in the key."""
    reason = 'waiting' if state.waiting else state.condition.value
    result: dict[str, str | float] = {'reason': reason}
    point = state.assessment
    if point is not None:
        rpm = state.config.bearing.speed.from_surface(point.speed, 'rpm')
        result |= {
            'regime': point.regime.value,
            'outcome': point.outcome.value,
            'stick-slip predicted': str(state.sticking).lower(),
            'speed [m/s]': point.speed,
            'shaft speed [rpm]': float(rpm),
            'load [N]': point.load,
            'hopf speed [m/s]': point.hopf_speed,
            'fold speed [m/s]': point.fold_speed,
            'hopf margin': point.hopf_margin,
            'fold margin': point.fold_margin,
            'growth rate [1/s]': point.growth_rate,
            'amplitude [m]': point.amplitude,
            'amplitude of the exact cycle [m]': point.amplitude_exact,
            'error of the amplitude': point.amplitude_error,
            'threshold amplitude [m]': point.threshold_amplitude,
            'time to boundary [s]': state.trend.seconds if state.trend else math.nan,
        }
    for name, age in state.lost.items():
        result[f'{name} age [s]'] = age
    for row, name in enumerate(QUANTITIES):
        for status in Status:
            label = status.name.lower().replace('_', ' ')
            result[f'{name} samples {label}'] = int(state.counts[row, status])
    return result
