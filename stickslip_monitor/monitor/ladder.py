# SPDX-License-Identifier: Apache-2.0
"""The conditions of an alarm, and the condition of a bearing as its inputs come and go."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import NamedTuple

from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.signals import QUANTITIES


class Level(IntEnum):
    """Severity, with the values of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


class Condition(str, Enum):
    """What the alarm of a bearing says."""

    level: Level
    sentence: str

    def __new__(cls, name: str, level: Level, sentence: str) -> Condition:
        """Make a member from its name, level and sentence."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.level = level
        member.sentence = sentence
        return member

    NORMAL = 'normal', Level.OK, 'No stick-slip predicted.'
    VIBRATION = (
        'vibration',
        Level.WARN,
        'Vibration is measured where no stick-slip is possible: the model does not explain it.',
    )
    CAUTION = 'caution', Level.WARN, 'Close to the stick-slip region.'
    BISTABLE = (
        'bistable',
        Level.WARN,
        'Inside the bistable range: quiet now, but a disturbance can start stick-slip.',
    )
    STICK_SLIP = 'stick_slip', Level.ERROR, 'Stick-slip predicted.'
    AMPLITUDE = 'amplitude_limit', Level.ERROR, 'Stick-slip predicted above the amplitude limit.'
    INPUT_STALE = 'input_stale', Level.ERROR, 'An input is lost: nothing can be predicted.'

    def __str__(self) -> str:
        return str(self.value)


# Vibration that the model does not explain hides nothing that the model says.
LADDER = (
    Condition.NORMAL,
    Condition.VIBRATION,
    Condition.CAUTION,
    Condition.BISTABLE,
    Condition.STICK_SLIP,
    Condition.AMPLITUDE,
)


class LastSample(NamedTuple):
    """The last believed sample of an input: its stamp, and until when it counts [ns]."""

    time_ns: int
    until_ns: int


Inputs = Sequence[LastSample | None]


@dataclass(frozen=True, slots=True)
class ConditionChange:
    """One change of condition.

    Attributes:
        time_ns: When it fell due [ns].
        before: The condition before.
        after: The condition from then on.
        lost: The inputs that are lost, with their ages [s]; ``inf`` for one never received.
    """

    time_ns: int
    before: Condition
    after: Condition
    lost: dict[str, float] = field(default_factory=dict)


class AlarmTrack:
    """Condition of one bearing; the stamps of its inputs are arguments."""

    def __init__(self, config: BearingConfig) -> None:
        self.rung = 0
        self.start_ns: int | None = None
        self._seen_ns: int | None = None
        self.stale = False
        self.retune(config)

    def retune(self, config: BearingConfig) -> None:
        """Take over new timeouts; the state stays."""
        self.timeouts = (config.speed.timeout_ns, config.load.timeout_ns)

    @property
    def condition(self) -> Condition:
        """What the alarm says now."""
        return Condition.INPUT_STALE if self.stale else LADDER[self.rung]

    def restart(self, time_ns: int) -> None:
        """The clock jumped to a time: inputs are waited for from then on."""
        self.start_ns = time_ns
        self._seen_ns = None

    def excuse(self, held_ns: int) -> None:
        """The wait for the first samples begins so much later [ns]."""
        if self.start_ns is not None:
            self.start_ns += held_ns

    def _deadlines(self, inputs: Inputs) -> list[int]:
        """Until when each input counts; one not yet received counts from the start."""
        assert self.start_ns is not None
        return [
            self.start_ns + timeout if heard is None else heard.until_ns
            for heard, timeout in zip(inputs, self.timeouts, strict=True)
        ]

    def lost(self, time_ns: int, inputs: Inputs) -> dict[str, float]:
        """The inputs whose deadline has come, with their ages [s]."""
        if self.start_ns is None:
            return {}
        return {
            name: math.inf if heard is None else (time_ns - heard.time_ns) / 1e9
            for name, heard, deadline in zip(
                QUANTITIES, inputs, self._deadlines(inputs), strict=True
            )
            if time_ns >= deadline
        }

    def advance(self, time_ns: int, inputs: Inputs) -> list[ConditionChange]:
        """Let time pass: what fell due strictly before now happens, in its order."""
        if self.start_ns is None:
            self.start_ns = time_ns
        if self.stale:
            return []
        first = min(self._deadlines(inputs))
        seen, self._seen_ns = self._seen_ns, time_ns
        if first >= time_ns:
            return []
        # A timeout that was made shorter may have ended before the latest time seen.
        until = first if seen is None else max(first, seen)
        before = self.condition
        self.stale = True
        return [ConditionChange(until, before, Condition.INPUT_STALE, self.lost(until, inputs))]

    def apply(self, rung: int, time_ns: int) -> list[ConditionChange]:
        """Take the rung that the alarm stands on after an operating point."""
        before = self.condition
        self.rung, self.stale = rung, False
        return (
            [ConditionChange(time_ns, before, LADDER[rung])] if before is not LADDER[rung] else []
        )
