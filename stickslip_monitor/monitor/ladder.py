# SPDX-License-Identifier: Apache-2.0
"""The alarm: from the verdict on an operating point to a condition that is raised and cleared.

The conditions form a ladder. Each rung is raised when the operating point has been on it or above
for ``on_delay``, and cleared when it has been below for ``off_delay``; the alarm stands on the
highest rung raised. Time is an argument: a delay ends at its own instant, whenever the next
sample or tick comes to notice it.

From an assessment to a rung of the alarm's ladder: branch memory and deadbands.

In the bistable range the averaged model has two answers. Stick-slip that has started goes on until
the fold; a bearing that came down from above stays quiet until the Hopf speed. A monitor that
starts inside the range, with no history to go by, takes the bearing to be quiet.

The course of one bearing's alarm in time: the ladder, and inputs that are lost and return.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray
from stickslip_monitor.monitor.assessment import OUTCOMES, Assessment, Outcome
from stickslip_monitor.monitor.config import AlarmConfig, BearingConfig
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


LADDER = (
    Condition.NORMAL,
    Condition.CAUTION,
    Condition.BISTABLE,
    Condition.STICK_SLIP,
    Condition.AMPLITUDE,
)

_SETTLED: list[int | None] = [None] * len(LADDER)


@dataclass(frozen=True, slots=True)
class LevelChange:
    """A change of rung at an instant."""

    time_ns: int
    before: int
    after: int


class Alarm:
    """The ladder's state: the rung it stands on and how long each rung has disagreed with it."""

    def __init__(self, config: AlarmConfig) -> None:
        self.config = config
        self.rung = 0
        self._asked = 0
        self._seen_ns: int | None = None
        self._since = _SETTLED.copy()

    def restart(self) -> None:
        """Forget how long anything has lasted; the rung stays."""
        self._since = _SETTLED.copy()
        self._seen_ns = None

    def not_past(self, time_ns: int) -> int:
        """An instant that fell due, but never before the latest time seen.

        A delay or timeout that is made shorter while it runs may have ended by then.
        """
        return time_ns if self._seen_ns is None else max(time_ns, self._seen_ns)

    def step(self, rung: int, time_ns: int) -> list[LevelChange]:
        """Report the rung the operating point is on; return the changes up to and at that time."""
        steps = self._settle(time_ns, at_end=False)
        self._asked = rung
        for k in range(1, len(LADDER)):
            if (rung >= k) == (self.rung >= k):
                self._since[k] = None
            elif self._since[k] is None:
                self._since[k] = time_ns
        return steps + self._settle(time_ns, at_end=True)

    def advance(self, time_ns: int) -> list[LevelChange]:
        """Let time pass; return the changes that fell due before it."""
        return self._settle(time_ns, at_end=False)

    def _settle(self, time_ns: int, at_end: bool) -> list[LevelChange]:
        steps = []
        while (due := self._next_due()) is not None and (
            due < time_ns or (at_end and due == time_ns)
        ):
            steps.append(self._change(due))
        self._seen_ns = time_ns
        return steps

    def _due(self, k: int) -> int | None:
        since = self._since[k]
        if since is None:
            return None
        rising = self._asked >= k
        delay = self.config.on_delay_ns if rising else self.config.off_delay_ns
        return self.not_past(since + delay)

    def _next_due(self) -> int | None:
        if self._since == _SETTLED:
            return None
        dues = [due for k in range(1, len(LADDER)) if (due := self._due(k)) is not None]
        return min(dues, default=None)

    def _change(self, due: int) -> LevelChange:
        ripe = [k for k in range(1, len(LADDER)) if self._due(k) == due]
        before = self.rung
        self.rung = max(ripe) if self._asked >= max(ripe) else min(ripe) - 1
        for k in ripe:
            self._since[k] = None
        return LevelChange(due, before, self.rung)


_STICK_SLIP = OUTCOMES.index(Outcome.STICK_SLIP)
_BISTABLE = OUTCOMES.index(Outcome.BISTABLE)
_AT_REST = OUTCOMES.index(Outcome.AT_REST)
_CAUTION_RUNG, _BISTABLE_RUNG, _STICK_RUNG, _AMPLITUDE_RUNG = (
    LADDER.index(condition)
    for condition in (
        Condition.CAUTION,
        Condition.BISTABLE,
        Condition.STICK_SLIP,
        Condition.AMPLITUDE,
    )
)


def latched(on: Any, off: Any, before: bool) -> Any:
    """A latch over time: set where ``on``, else cleared where ``off``, else as it was.

    Args:
        on: Shape (n,) bool.
        off: Shape (n,) bool.
        before: The state before the first element.

    Returns:
        The state after each element, shape (n,) bool.
    """
    place = np.maximum.accumulate(np.where(on | off, np.arange(on.size), -1))
    return np.where(place >= 0, on[place], before)


class ConditionClassifier:
    """The three memories between an assessment and the alarm, for one bearing."""

    def __init__(self, config: AlarmConfig) -> None:
        self.config = config
        self.sticking = False
        self._near = False
        self._over = False

    def rungs(self, point: Assessment) -> tuple[NDArray[np.int8], BoolArray]:
        """Rungs and stick-slip predictions of successive assessments; remembers the last.

        Args:
            point: Assessment of arrays, shape (n,) with n >= 1, in order of time.

        Returns:
            The rung of the alarm's ladder and whether stick-slip is predicted, each shape (n,).
        """
        code, margin = point.outcome_code, point.stability_margin
        resting = code == _AT_REST
        clear_margin = self.config.caution_margin + self.config.hysteresis

        unstable = code == _STICK_SLIP
        sticking = latched(unstable, ~unstable & (code != _BISTABLE), self.sticking)
        close = ~resting & (margin < self.config.caution_margin)
        near = latched(close, resting | (margin > clear_margin), self._near)
        over = self._oversized(point, sticking)

        self.sticking, self._near, self._over = bool(sticking[-1]), bool(near[-1]), bool(over[-1])
        rung = np.select(
            [sticking & over, sticking, code == _BISTABLE, near],
            [_AMPLITUDE_RUNG, _STICK_RUNG, _BISTABLE_RUNG, _CAUTION_RUNG],
            0,
        )
        return rung.astype(np.int8), sticking

    def _oversized(self, point: Assessment, sticking: BoolArray) -> BoolArray:
        limit = self.config.amplitude_limit
        if limit == math.inf or not sticking.any():
            return np.zeros_like(sticking)
        amplitude = point.amplitude
        small = amplitude < limit * (1.0 - self.config.hysteresis)
        over: BoolArray = latched(sticking & (amplitude > limit), ~sticking | small, self._over)
        return over

    def rung(self, point: Assessment) -> tuple[int, bool]:
        """:meth:`rungs` of an assessment of scalars."""
        config, code, margin = self.config, point.outcome_code, point.stability_margin
        if code == _STICK_SLIP:
            self.sticking = True
        elif code != _BISTABLE:
            self.sticking = False
        if code != _AT_REST and margin < config.caution_margin:
            self._near = True
        elif code == _AT_REST or margin > config.caution_margin + config.hysteresis:
            self._near = False
        if not self.sticking:
            self._over = False
            quiet = _CAUTION_RUNG if self._near else 0
            return (_BISTABLE_RUNG if code == _BISTABLE else quiet), False
        if config.amplitude_limit == math.inf:
            self._over = False
        elif point.amplitude > config.amplitude_limit:
            self._over = True
        elif point.amplitude < config.amplitude_limit * (1.0 - config.hysteresis):
            self._over = False
        return (_AMPLITUDE_RUNG if self._over else _STICK_RUNG), True


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
    """Alarm and staleness of one bearing; the stamps of its inputs are arguments."""

    def __init__(self, config: BearingConfig) -> None:
        self.alarm = Alarm(config.alarm)
        self.start_ns: int | None = None
        self.stale = False
        self.retune(config)

    def retune(self, config: BearingConfig) -> None:
        """Take over new delays and timeouts; the state stays."""
        self.alarm.config = config.alarm
        self.timeouts = (config.speed.timeout_ns, config.load.timeout_ns)

    @property
    def condition(self) -> Condition:
        """What the alarm says now."""
        return Condition.INPUT_STALE if self.stale else LADDER[self.alarm.rung]

    def restart(self, time_ns: int) -> None:
        """The clock jumped to a time: everything that was waiting on time starts anew."""
        self.start_ns = time_ns
        self.alarm.restart()

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
        passed = [deadline for deadline in self._deadlines(inputs) if deadline < time_ns]
        until = self.alarm.not_past(min(passed, default=time_ns))
        changes = _changes(self.alarm.advance(until))
        if passed:
            before = self.condition
            self.stale = True
            self.alarm.restart()
            lost = self.lost(until, inputs)
            changes.append(ConditionChange(until, before, Condition.INPUT_STALE, lost))
        return changes

    def apply(self, rung: int, time_ns: int) -> list[ConditionChange]:
        """Take the rung of an operating point measured now."""
        changes = []
        if self.stale:
            self.stale = False
            changes.append(ConditionChange(time_ns, Condition.INPUT_STALE, self.condition))
        return changes + _changes(self.alarm.step(rung, time_ns))


def _changes(steps: list[LevelChange]) -> list[ConditionChange]:
    return [
        ConditionChange(step.time_ns, LADDER[step.before], LADDER[step.after]) for step in steps
    ]
