# SPDX-License-Identifier: Apache-2.0
"""The conditions of an alarm, and the switch with an integrating delay that raises and clears them.

An integrating delay counts up while a condition holds and down while it does not, so that one odd
sample in thirty delays a change by a thirtieth and no more (the continuous form of the
``n1``-of-``n`` delay timers of J. Xu and T. Chen, J. Process Control 23, 2013, 382-395).

The rule of the decision: from operating points in order of time to a rung of the alarm's ladder.

*Stick-slip runs* once a small disturbance has had the time to grow. Far below the sliding limit
its amplitude obeys ``d(ln A)/dt = g(V, N)``, the growth rate of the averaged equation, and it does
not shrink below what noise always brings; so the monitor integrates ``E' = g``, ``E >= 0``, and
predicts stick-slip from ``E = alarm.onset_growth`` on. It ends when the point has been where no
cycle exists for :data:`DECAY` times ``2 m/c``, net time, both ways.

The rungs are raised and cleared by integrating delays (:mod:`.alarm`) whose increments no single
value can dominate (:mod:`.freshness`). A rung that keeps returning is held (:data:`HOLDS`).

The condition of one bearing in time: the alarm's rung, and inputs that are lost and return.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, IntArray
from stickslip_monitor.monitor.assessment import OUTCOMES, Assessment, Outcome
from stickslip_monitor.monitor.config import AlarmConfig, BearingConfig
from stickslip_monitor.monitor.freshness import Fresh, credit, credits, lasts
from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.physics.averaging.boundaries import growth_rate
from stickslip_monitor.physics.oscillator import Bearing

# Points of a recording that are summed at once: at first, and at most.
_FEW, _MANY = 64, 65536


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


class Latch:
    """A two-state switch with an integrating delay.

    While a point asks for the other state, what passes since that point is added to a count; while
    it does not, it is taken off again, but never below 0. The state changes at the first point
    that asks for it with the count at :meth:`due` or above. The counts are whole numbers, so a
    recording summed in bulk gives exactly what its samples give one by one.

    Attributes:
        on: The state.
        count: How far the change of state has come, >= 0.
    """

    def __init__(self) -> None:
        self.on = False
        self.count = 0

    def due(self) -> int:
        """The count at which the state changes, >= 0."""
        raise NotImplementedError

    def steps(self, lo: int, hi: int) -> IntArray:
        """What each point from ``lo`` to before ``hi`` of a recording adds to the count."""
        raise NotImplementedError

    def restart(self) -> None:
        """The clock jumped: what has been counted is forgotten, the state stays."""
        self.count = 0

    def switch(self, time_ns: int) -> None:
        """Change the state at a time [ns]."""
        self.on = not self.on
        self.count = 0

    def take(self, step: int, asks: bool, time_ns: int) -> None:
        """Take a point: what has passed since the one before, and whether it asks for a change."""
        self.count = max(0, self.count + step)
        if asks and self.count >= self.due():
            self.switch(time_ns)


def follow(
    latch: Latch, asks: tuple[BoolArray, BoolArray], times: IntArray, starts: IntArray
) -> tuple[BoolArray, IntArray]:
    """Take all points of a recording at once, as :meth:`Latch.take` takes them one by one.

    Args:
        latch: The latch; its state goes on from where it is.
        asks: Whether each point asks for a change where the latch is off, and where it is on, each
            shape (n,).
        times: Time of each point, shape (n,) [ns].
        starts: The points before which the clock jumped, the first included, shape (m,).

    Returns:
        State and count after each point, each shape (n,).
    """
    on, count = np.zeros(times.size, bool), np.zeros(times.size, np.int64)
    for begin, end in pairwise([*starts.tolist(), times.size]):
        latch.restart()
        k, size = begin, _FEW
        while k < end:
            if latch.count == 0:
                # Nothing is added to an empty count before the next point that asks.
                until = _next(asks[latch.on], max(k - 1, begin), end)
                on[k:until] = latch.on
                k = max(k, until)
            high = min(end, k + size)
            taken = _take_many(latch, asks[latch.on], k, high, k == begin, on, count)
            if k + taken < high:
                latch.switch(int(times[k + taken]))
                on[k + taken] = latch.on
                k, size = k + taken + 1, _FEW
            else:
                k, size = high, min(4 * size, _MANY)
    return on, count


def _next(asks: BoolArray, begin: int, end: int) -> int:
    """The first point from ``begin`` on that asks; ``end`` without one."""
    place = begin + int(asks[begin:end].argmax())
    return place if asks[place] else end


def _take_many(
    latch: Latch, asks: BoolArray, lo: int, hi: int, first: bool, on: BoolArray, count: IntArray
) -> int:
    """Count over some points; return how many of them come before the next change of state."""
    if lo >= hi:
        return 0
    # What a point adds passes between it and the next.
    steps = latch.steps(lo - 1, hi - 1) if not first else np.append(0, latch.steps(lo, hi - 1))
    total = np.cumsum(steps)
    counted = total - np.minimum(np.minimum.accumulate(total), -latch.count)
    change = asks[lo:hi] & (counted >= latch.due())
    taken = int(change.argmax()) if change.any() else hi - lo
    on[lo : lo + taken], count[lo : lo + taken] = latch.on, counted[:taken]
    if taken:
        latch.count = int(counted[taken - 1])
    return taken


_STICK_SLIP = OUTCOMES.index(Outcome.STICK_SLIP)
_NO_CONTACT = OUTCOMES.index(Outcome.NO_CONTACT)
_AT_REST = OUTCOMES.index(Outcome.AT_REST)

_STICK_RUNG = LADDER.index(Condition.STICK_SLIP)

E_FOLD = 2**32
"""Growth is counted in parts of this many to an e-fold."""
ONSET = 6.0
"""E-folds from the disturbance that is always there to the sliding limit, where it sticks."""
DECAY = 4.8
"""How long a cycle outlives the fold [2 m/c]."""
HOLDS = (1, 6, 60)
"""The off-delay of a rung that is raised for the first, second and further time [off_delay]."""
_MEMORY = 60
"""A rung raised again sooner than this after it was cleared keeps returning [off_delay]."""
_CLEAR = 3
"""How much faster the hold of a predicted stick-slip passes clear of the caution band."""


def decision_margin(point: Assessment) -> Any:
    """The margin [-] by which alarms go: below 0 where a stick-slip cycle exists."""
    return point.fold_margin


@dataclass(frozen=True, slots=True)
class Standing:
    """What the alarm of a bearing rests on after an operating point.

    Attributes:
        rung: The rung of the ladder it stands on.
        sticking: Whether stick-slip is predicted to run.
        asked: The rung that the point by itself asks for.
        growth: How far a disturbance has grown while stick-slip is not predicted [e-folds].
        clears: In how many seconds the rung clears if the point stays where it is; ``None``
            while the point holds it.
        raised: How often this rung has been raised, each time soon after it was cleared.
        future: The speed that the trend of the last seconds leads to [m/s]; ``nan`` if unknown.
    """

    rung: int = 0
    sticking: bool = False
    asked: int = 0
    growth: float = 0.0
    clears: float | None = None
    raised: int = 0
    future: float = math.nan

    @property
    def condition(self) -> Condition:
        """What the alarm says."""
        return LADDER[self.rung]


QUIET = Standing()


def held_ns(config: AlarmConfig, raised: int) -> int:
    """How long a rung must be gone to be cleared, when it was raised so often lately [ns]."""
    return config.off_delay_ns * HOLDS[min(max(raised, 1), len(HOLDS)) - 1]


def _pace(rung: int, raised: int) -> int:
    """How much faster a raised rung's delay passes clear of the caution band."""
    return _CLEAR if rung >= _STICK_RUNG and raised > 1 else 1


class _Growth(Latch):
    """Whether stick-slip is predicted to run: off until grown, on until died out."""

    def __init__(self, bearing: Bearing, config: AlarmConfig) -> None:
        super().__init__()
        self.bearing, self.config = bearing, config
        time = 2.0 * bearing.mass / bearing.damping if bearing.damping > 0.0 else math.inf
        self.decay_ns = int(min(DECAY * time * 1e9, 2.0**62))
        self.points: Assessment | None = None
        self.fresh = Fresh(np.empty(0, np.int64), np.empty(0, np.int64))
        self.asks: tuple[BoolArray, BoolArray] = (np.empty(0, bool), np.empty(0, bool))

    def due(self) -> int:
        """The onset's growth, or the time to die out; without a memory both are 0."""
        onset = round(self.config.onset_growth * E_FOLD)
        return min(self.decay_ns, onset * self.decay_ns) if self.on else onset

    def step(self, rate: float, asked: bool, covered: int, rhythm: int) -> int:
        """What an interval adds, given the growth rate and what was asked at its point."""
        if self.on:
            own = credit(covered, rhythm, self.due())
            return own if asked else -own
        most = self._most(float(lasts(rhythm)))
        grown = round(min(max(rate, -most), most) * covered * (E_FOLD / 1e9))
        return max(grown, 0) if asked else min(grown, 0)

    def _most(self, length: Any) -> Any:
        """The largest rate [1/s] that counts: of one value half of what is due, no more."""
        return self.config.onset_growth * 0.5e9 / np.maximum(length, 1.0)

    def steps(self, lo: int, hi: int) -> IntArray:
        """:meth:`step` of many points."""
        covered, rhythm = self.fresh.covered[lo:hi], self.fresh.rhythm[lo:hi]
        asked = self.asks[self.on][lo:hi]
        if self.on:
            own = credits(covered, rhythm, self.due())
            return np.where(asked, own, -own)
        assert self.points is not None
        rate = growth_rate(self.bearing, self.points.speed[lo:hi], self.points.load[lo:hi])
        most = self._most(np.asarray(lasts(rhythm), float))
        grown = np.rint(np.clip(rate, -most, most) * covered * (E_FOLD / 1e9)).astype(np.int64)
        return np.where(asked, np.maximum(grown, 0), np.minimum(grown, 0))


class _Rung(Latch):
    """Whether a rung is raised.

    Args:
        config: The alarm.
        rung: Which rung of the ladder.
    """

    def __init__(self, config: AlarmConfig, rung: int) -> None:
        super().__init__()
        self.config = config
        self.rung = rung
        self.raised = 0
        self.history: list[int] | None = None
        self._cleared: int | None = None
        self.fresh = Fresh(np.empty(0, np.int64), np.empty(0, np.int64))
        self.asks: tuple[BoolArray, BoolArray] = (np.empty(0, bool), np.empty(0, bool))
        self.clear = np.empty(0, bool)

    def restart(self) -> None:
        """The clock jumped."""
        self.count = 0
        self._cleared = None

    def due(self) -> int:
        """The delay that runs [ns]."""
        if self.on:
            return held_ns(self.config, self.raised)
        # Growth is a delay of its own.
        return (
            0 if self.rung == _STICK_RUNG and self.config.onset_growth else self.config.on_delay_ns
        )

    def switch(self, time_ns: int) -> None:
        """Count how often it keeps returning."""
        super().switch(time_ns)
        if not self.on:
            self._cleared = time_ns
            return
        memory = _MEMORY * self.config.off_delay_ns
        again = self._cleared is not None and time_ns - self._cleared < memory
        self.raised = self.raised + 1 if again else 1
        if self.history is not None:
            self.history.append(self.raised)

    def pace(self) -> int:
        """How much faster the delay that runs passes clear of the caution band."""
        return _pace(self.rung, self.raised) if self.on else 1

    def step(self, asked: bool, clear: bool, covered: int, rhythm: int) -> int:
        """What an interval adds, given what was asked at its point, and whether it was clear."""
        own = credit(covered, rhythm, self.due())
        if clear:
            own *= self.pace()
        return own if asked else -own

    def steps(self, lo: int, hi: int) -> IntArray:
        """:meth:`step` of many points."""
        own = credits(self.fresh.covered[lo:hi], self.fresh.rhythm[lo:hi], self.due())
        pace = self.pace()
        if pace > 1:
            own = np.where(self.clear[lo:hi], own * pace, own)
        return np.where(self.asks[self.on][lo:hi], own, -own)


def _sliding(point: Assessment) -> Any:
    code = point.outcome_code
    return (code != _AT_REST) & (code != _NO_CONTACT)


def _ahead(point: Assessment, future: Any) -> Any:
    """Whether the speed that the trend leads to lies below the fold."""
    fold, astern = point.fold_speed, point.speed < 0.0
    below = (future < fold) & (astern ^ True) | (-future < fold) & astern
    return _sliding(point) & below


def _grown(point: Assessment) -> tuple[Any, Any]:
    """Where a disturbance grows, and where a cycle dies out."""
    inside = _sliding(point) & (decision_margin(point) < 0.0)
    return point.outcome_code == _STICK_SLIP, inside ^ True


def _asked(config: AlarmConfig, point: Assessment, future: Any, sticking: Any) -> list[Any]:
    """For each rung from caution up where it holds, and where it is clear of it.

    Args:
        config: The alarm.
        point: Assessment of scalars, or of arrays of shape (n,).
        future: The speed that the trend leads to [m/s]; ``nan`` if unknown.
        sticking: Whether stick-slip is predicted to run.
    """
    sliding, margin = _sliding(point), decision_margin(point)
    coming = _ahead(point, future) | sticking
    near = sliding & (margin < config.caution_margin)
    wide = sliding & (margin <= config.caution_margin + config.hysteresis)
    inside = (sliding & (margin < 0.0)) | sticking
    asked = [(near | coming, (wide | coming) ^ True), (inside, inside ^ True)]
    asked.append((sticking, sticking ^ True))
    if config.amplitude_limit < math.inf and np.any(sticking):
        amplitude, limit = point.amplitude, config.amplitude_limit
        small = amplitude < limit * (1.0 - config.hysteresis)
        asked.append((sticking & (amplitude > limit), (sticking ^ True) | small))
    else:
        never = sticking & (sticking ^ True)
        asked.append((never, never ^ True))
    return asked


class ConditionClassifier:
    """The memories between operating points and the alarm, for one bearing."""

    def __init__(self, bearing: Bearing, config: AlarmConfig) -> None:
        self.bearing = bearing
        self.growth = _Growth(bearing, config)
        self.levels = [_Rung(config, k) for k in range(1, len(LADDER))]
        self.config = config
        self._before: list[tuple[bool, bool]] = []
        self._point: Assessment | None = None

    @property
    def config(self) -> AlarmConfig:
        """The settings; new ones change no state."""
        return self._config

    @config.setter
    def config(self, config: AlarmConfig) -> None:
        self._config = config
        for latch in (self.growth, *self.levels):
            latch.config = config

    def restart(self) -> None:
        """The clock jumped: what waited on time starts anew."""
        self._before = []
        for latch in (self.growth, *self.levels):
            latch.restart()

    def take(
        self, point: Assessment, time_ns: int, future: float, covered: int, rhythm: int
    ) -> Standing:
        """Take an operating point.

        Args:
            point: Its assessment, of scalars.
            time_ns: Its time [ns].
            future: The speed that the trend leads to [m/s]; ``nan`` if unknown.
            covered: How much of the time since the point before that one counted [ns].
            rhythm: That one's rhythm [ns].
        """
        growth, before = self.growth, self._before
        asks = _grown(point)
        step = 0
        if before:
            asked = before[0][growth.on]
            rate = self._rate(asked)
            step = growth.step(rate, asked, covered, rhythm)
        growth.take(step, asks[growth.on], time_ns)
        now = [asks, *_asked(self.config, point, future, growth.on)]
        for k, level in enumerate(self.levels, 1):
            step = (
                level.step(before[k][level.on], before[1][True], covered, rhythm) if before else 0
            )
            level.take(step, now[k][level.on], time_ns)
        self._before, self._point = now, point
        return self._standing(future)

    def _standing(self, future: float) -> Standing:
        now, growth = self._before, self.growth
        rung = max((k for k, level in enumerate(self.levels, 1) if level.on), default=0)
        asked = max((k for k in range(1, len(now)) if now[k][False]), default=0)
        grown = 0.0 if growth.on else growth.count / E_FOLD
        if not rung:
            return Standing(0, growth.on, asked, grown, None, 0, future)
        level = self.levels[rung - 1]
        pace = level.pace() if now[1][True] else 1
        clears = (level.due() - level.count) * 1e-9 / pace if now[rung][True] else None
        return Standing(rung, growth.on, asked, grown, clears, level.raised, future)

    def _rate(self, asked: bool) -> float:
        """The growth rate at the point before; not needed where nothing can shrink."""
        if self.growth.on or self._point is None or not (asked or self.growth.count):
            return 0.0
        return self._point.growth_rate

    def follow(
        self,
        points: Assessment,
        times: IntArray,
        starts: IntArray,
        futures: NDArray[np.float64],
        fresh: Fresh,
    ) -> Course:
        """:meth:`take` of all points of a recording at once.

        Args:
            points: Assessment of arrays, shape (n,).
            times: Shape (n,) [ns].
            starts: The points before which the clock jumped, the first included, shape (m,).
            futures: The speeds that the trend leads to, shape (n,) [m/s].
            fresh: How long each point counts.
        """
        growth = self.growth
        growth.points, growth.fresh, growth.asks = points, fresh, _grown(points)
        sticking, grown = follow(growth, growth.asks, times, starts)
        asked = _asked(self.config, points, futures, sticking)
        rung = np.zeros(times.size, np.int8)
        levels = []
        for k, (level, asks) in enumerate(zip(self.levels, asked, strict=True), 1):
            level.fresh, level.asks, level.history = fresh, asks, []
            level.clear = asked[0][True]
            on, count = follow(level, asks, times, starts)
            rung[on] = k
            raises = np.flatnonzero(on & ~np.append(False, on[:-1]))
            levels.append(_LevelCourse(asks, count, raises, level.history))
        return Course(self.config, futures, rung, sticking, grown, levels)


@dataclass(frozen=True, slots=True)
class _LevelCourse:
    """One rung over a recording: what the points ask, its count, where it was raised, how often."""

    asks: tuple[BoolArray, BoolArray]
    count: IntArray
    raises: NDArray[np.intp]
    history: list[int]

    def raised(self, k: int) -> int:
        """How often it had lately been raised when it last was, at a point."""
        n = int(np.searchsorted(self.raises, k, 'right'))
        return self.history[n - 1] if n else 0


@dataclass(frozen=True, slots=True)
class Course:
    """What the alarm rests on after each point of a recording.

    Attributes:
        config: The alarm.
        futures: The speeds that the trend leads to, shape (n,) [m/s].
        rung: Shape (n,).
        sticking: Whether stick-slip is predicted to run, shape (n,).
        grown: Growth, or the time it has been dying out, as counted, shape (n,).
        levels: The rungs from caution up.
    """

    config: AlarmConfig
    futures: NDArray[np.float64]
    rung: NDArray[np.int8]
    sticking: BoolArray
    grown: IntArray
    levels: list[_LevelCourse]

    def at(self, k: int) -> Standing:
        """What the alarm rests on after point ``k``; :data:`QUIET` before the first."""
        if k < 0:
            return QUIET
        rung, sticking, future = int(self.rung[k]), bool(self.sticking[k]), float(self.futures[k])
        asked = max((j for j, lv in enumerate(self.levels, 1) if lv.asks[False][k]), default=0)
        grown = 0.0 if sticking else int(self.grown[k]) / E_FOLD
        if not rung:
            return Standing(0, sticking, asked, grown, None, 0, future)
        level = self.levels[rung - 1]
        raised = level.raised(k)
        left = held_ns(self.config, raised) - int(level.count[k])
        pace = _pace(rung, raised) if self.levels[0].asks[True][k] else 1
        clears = left * 1e-9 / pace if level.asks[True][k] else None
        return Standing(rung, sticking, asked, grown, clears, raised, future)


def warns(config: AlarmConfig, point: Assessment) -> bool:
    """Whether an operating point by itself, of scalars, asks for caution or worse."""
    return bool(_asked(config, point, math.nan, False)[0][False])


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
        seen, self._seen_ns = self._seen_ns, time_ns
        if not passed:
            return []
        # A timeout that was made shorter may have ended before the latest time seen.
        until = min(passed) if seen is None else max(min(passed), seen)
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
