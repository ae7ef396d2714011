# SPDX-License-Identifier: Apache-2.0
"""The rule of the decision: from operating points to a rung of the alarm's ladder.

*Stick-slip runs* once a small disturbance has had the time to grow. Far below the sliding limit
its amplitude obeys ``d(ln A)/dt = g(V, N)``, the growth rate of the averaged equation, and it does
not shrink below what noise always brings; so the monitor integrates ``E' = g``, ``E >= 0``, and
predicts stick-slip from ``E = alarm.onset_growth`` on. It ends when the point has been where no
cycle exists for :data:`DECAY` times ``2 m/c``, net time, both ways.

Where vibration is *measured* (:mod:`.measured`) it takes over that memory: stick-slip runs where
vibration is seen and a cycle may exist, and ends where none is seen and it would not start by
itself; where it would, growth that is not seen counts half. Vibration where no cycle can be is a
rung of its own. A level that says nothing changes nothing.

The rungs are raised and cleared by integrating delays (:mod:`.latch`) whose increments no single
value can dominate (:mod:`.freshness`). A rung that keeps returning is held (:data:`HOLDS`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.monitor.assessment import OUTCOMES, Assessment, Assessments, Outcome
from stickslip_monitor.monitor.config import AlarmConfig, BearingConfig
from stickslip_monitor.monitor.freshness import Fresh, credit, credit_of_many, lasts
from stickslip_monitor.monitor.ladder import LADDER, Condition
from stickslip_monitor.monitor.latch import Latch, follow
from stickslip_monitor.monitor.measured import MEASURED, UNKNOWN, VIBRATING, Measured
from stickslip_monitor.monitor.measured import QUIET as NOT_VIBRATING
from stickslip_monitor.physics.averaging.boundaries import growth_rate
from stickslip_monitor.physics.oscillator import Bearing

_STICK_SLIP = OUTCOMES.index(Outcome.STICK_SLIP)
_NO_CONTACT = OUTCOMES.index(Outcome.NO_CONTACT)
_AT_REST = OUTCOMES.index(Outcome.AT_REST)

_STICK_RUNG = LADDER.index(Condition.STICK_SLIP)
_VIBRATION_RUNG = LADDER.index(Condition.VIBRATION)

E_FOLD = 2**32
"""Growth is counted in parts of this many to an e-fold."""
ONSET = 6.0
"""E-folds from the disturbance that is always there to the sliding limit, where it sticks."""
DECAY = 4.8
"""How long a cycle outlives the fold [2 m/c]."""
HOLDS = ((1,), (1, 60), (1, 60), (1, 60), (1, 6, 30), (1, 60))
"""Of each rung the off-delay when it is raised for the first, second and further time [off_delay].

With them no more than ten conditions are raised within sixty off-delays, whatever fluctuates.
"""
LEFT_BELOW = 0.5
"""Share of its threshold below which a probability no longer holds a condition."""
_MEMORY = 60
"""A rung raised again sooner than this after it was cleared keeps returning [off_delay]."""
_UNSEEN_SHARE = 0.5
"""The part of its growth that counts for a disturbance while quiet is measured."""


def decision_margin(point: Assessment | Assessments) -> Any:
    """The margin [-] by which alarms go: below 0 where a stick-slip cycle exists."""
    return point.stability_margin


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
        measured: What the measured vibration says; ``None`` where none is configured.
        unseen: For how long stick-slip has been predicted while no vibration was measured [s].
    """

    rung: int = 0
    sticking: bool = False
    asked: int = 0
    growth: float = 0.0
    clears: float | None = None
    raised: int = 0
    measured: Measured | None = None
    unseen: float = 0.0

    @property
    def condition(self) -> Condition:
        """What the alarm says."""
        return LADDER[self.rung]


QUIET = Standing()


def held_ns(config: AlarmConfig, rung: int, raised: int) -> int:
    """How long a rung must be gone to be cleared, when it was raised so often lately [ns]."""
    holds = HOLDS[rung]
    return config.off_delay_ns * holds[min(max(raised, 1), len(holds)) - 1]


class _Growth(Latch):
    """Whether stick-slip is predicted to run: off until grown, on until died out.

    Args:
        bearing: The bearing.
        config: The alarm.

    Attributes:
        points: Of a recording: the assessment of arrays, shape (n,).
        lean: Factor of what drives a disturbance: that of the belief's bearings which all but
            ``alarm.runs_probability`` of them are steadier than.
        share: The part of the growth that counts after the latest point; after each of a
            recording's, shape (n,), in ``shares``, ``None`` where it is all.
    """

    points: Assessments
    shares: FloatArray | None = None

    def __init__(self, bearing: Bearing, config: AlarmConfig) -> None:
        super().__init__(config)
        self.bearing = bearing
        self.lean = self.share = 1.0
        self._half_rate = bearing.damping / (2.0 * bearing.mass)
        time = 2.0 * bearing.mass / bearing.damping if bearing.damping > 0.0 else math.inf
        self.decay_ns = int(min(DECAY * time * 1e9, 2.0**62))

    def due(self) -> int:
        """The onset's growth, or the time to die out; without a memory both are 0."""
        onset = round(self.config.onset_growth * E_FOLD)
        return min(self.decay_ns, onset * self.decay_ns) if self.on else onset

    def step(self, rate: float, asked: bool, covered: int, rhythm: int) -> int:
        """What an interval adds, given the growth rate and what was asked at its point."""
        if not (asked or self.count):
            return 0  # nothing can be taken off
        if self.on:
            own = credit(covered, rhythm, self.due())
            return own if asked else -own
        most = self._most(max(float(lasts(rhythm)), 1.0))
        rate = self._leaning(rate)
        rate = min(max(rate, -most), most) * (self.share if asked else 1.0)
        grown = round(rate * covered * (E_FOLD / 1e9))
        return max(grown, 0) if asked else min(grown, 0)

    def _leaning(self, rate: Any) -> Any:
        """``(N mu' - c)/2 m`` with ``N mu'`` times :attr:`lean`."""
        if self.lean == 1.0:
            return rate
        return (rate + self._half_rate) * self.lean - self._half_rate

    def _most(self, length: Any) -> Any:
        """The largest rate [1/s] that counts: half of what is due while a value lasts [ns]."""
        return self.config.onset_growth * 0.5e9 / length

    def steps(self, lo: int, hi: int) -> IntArray:
        """:meth:`step` of many points."""
        covered, rhythm = self.fresh.covered[lo:hi], self.fresh.rhythm[lo:hi]
        asked = self.asks[self.on][lo:hi]
        if self.on:
            own = credit_of_many(covered, rhythm, self.due())
            return np.where(asked, own, -own)
        rate = growth_rate(self.bearing, self.points.speed[lo:hi], self.points.load[lo:hi])
        most = self._most(np.maximum(lasts(rhythm), 1.0))
        rate = self._leaning(rate)
        rate = np.clip(rate, -most, most)
        if self.shares is not None:
            rate = np.where(asked, rate * self.shares[lo:hi], rate)
        grown = np.rint(rate * covered * (E_FOLD / 1e9)).astype(np.int64)
        return np.where(asked, np.maximum(grown, 0), np.minimum(grown, 0))


class _Rung(Latch):
    """Whether a rung is raised.

    Args:
        config: The alarm.
        rung: Which rung of the ladder.

    Attributes:
        raised: How often it has been raised, each time soon after it was cleared.
        history: Of a recording: :attr:`raised` after each time it was.
    """

    def __init__(self, config: AlarmConfig, rung: int) -> None:
        super().__init__(config)
        self.rung = rung
        self.raised = 0
        self.history: list[int] | None = None
        self._cleared: int | None = None

    def restart(self) -> None:
        """The clock jumped."""
        self.count = 0
        self._cleared = None

    def due(self) -> int:
        """The delay that runs [ns]."""
        if self.on:
            return held_ns(self.config, self.rung, self.raised)
        if self.rung == _VIBRATION_RUNG or (self.rung == _STICK_RUNG and self.config.onset_growth):
            return 0  # growth is a delay of its own, and so is that of the level
        return self.config.on_delay_ns

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

    def step(self, asked: bool, covered: int, rhythm: int) -> int:
        """What an interval adds, given what was asked at its point."""
        own = credit(covered, rhythm, self.due())
        return own if asked else -own

    def steps(self, lo: int, hi: int) -> IntArray:
        """:meth:`step` of many points."""
        own = credit_of_many(self.fresh.covered[lo:hi], self.fresh.rhythm[lo:hi], self.due())
        return np.where(self.asks[self.on][lo:hi], own, -own)


def _sliding(point: Assessment | Assessments) -> Any:
    code = point.outcome_code
    return (code != _AT_REST) & (code != _NO_CONTACT)


def _ahead(point: Assessment | Assessments, future: Any) -> Any:
    """Whether the speed that the trend leads to lies below the fold."""
    fold, astern = point.stability_limit, point.speed < 0.0
    return (future < fold) & (astern ^ True) | (-future < fold) & astern


def _inside(point: Assessment | Assessments, sliding: Any) -> Any:
    """Where a stick-slip cycle exists."""
    return sliding & (decision_margin(point) < 0.0)


def _grown(config: AlarmConfig, point: Assessment | Assessments) -> tuple[Any, Any]:
    """Where a disturbance grows, and where a cycle dies out.

    Where there are probabilities, those of one bearing of all that are believed in:
    ``alarm.runs_probability`` of them are less steady.
    """
    sliding = _sliding(point)
    if not point.has_belief:
        return point.outcome_code == _STICK_SLIP, _inside(point, sliding) ^ True
    limit = config.runs_probability
    held = _above(point, sliding, limit)[1]
    return sliding & (point.probability_will > limit), held ^ True


def near_fold(config: AlarmConfig, point: Assessment | Assessments) -> tuple[Any, Any]:
    """Where caution holds, and where it goes on.

    By the margin; by the probability that stick-slip can happen where there is one.
    """
    return _near_fold(config, point, _sliding(point))


def _near_fold(
    config: AlarmConfig, point: Assessment | Assessments, sliding: Any
) -> tuple[Any, Any]:
    if point.has_belief:
        return _above(point, sliding, config.caution_probability)
    margin, limit = decision_margin(point), config.caution_margin
    return sliding & (margin < limit), sliding & (margin <= limit + config.hysteresis)


def _inside_fold(
    config: AlarmConfig, point: Assessment | Assessments, sliding: Any
) -> tuple[Any, Any]:
    """The same of the bistable range."""
    if point.has_belief:
        return _above(point, sliding, config.can_probability)
    inside = _inside(point, sliding)
    return inside, inside


def _above(point: Assessment | Assessments, sliding: Any, limit: float) -> tuple[Any, Any]:
    can = point.probability_can
    return sliding & (can > limit), sliding & (can >= LEFT_BELOW * limit)


def _felt(close: tuple[Any, Any], measured: Any, starts: Any) -> tuple[Any, Any, Any]:
    """What measured vibration says of a point.

    Args:
        close: What :func:`near_fold` says of it, scalars or arrays of shape (n,).
        measured: What the level says, place in :data:`MEASURED`, of the same shape.
        starts: Whether a disturbance grows, of the same shape.

    Returns:
        Whether vibration is measured where a cycle may exist: one that begins, and one that goes
        on; and whether none is measured where none starts by itself.
    """
    near, wide = close
    seen = measured == VIBRATING
    quiet = (measured == NOT_VIBRATING) & (starts ^ True)
    return seen & near, seen & wide, quiet


def _with_measured(asks: tuple[Any, Any], felt: tuple[Any, Any, Any]) -> tuple[Any, Any]:
    """Where stick-slip begins and ends, given what is measured beside what is predicted."""
    (start, end), (seen, goes_on, quiet) = asks, felt
    return start | seen, (end & (goes_on ^ True)) | quiet


def _unexplained(close: tuple[Any, Any], measured: Any, sticking: Any) -> tuple[Any, Any]:
    """Where vibration is measured that can be no stick-slip, and where it is not."""
    near, wide = close
    other = (measured == VIBRATING) & (sticking ^ True)
    return other & (near ^ True), (other & (wide ^ True)) ^ True


def _asked(
    config: AlarmConfig, point: Assessment | Assessments, future: Any, sticking: Any
) -> list[Any]:
    """For each rung from caution up where it holds, and where it is clear of it.

    Args:
        config: The alarm.
        point: Assessment of scalars, or of arrays of shape (n,).
        future: The speed that the trend leads to [m/s]; ``nan`` if unknown.
        sticking: Whether stick-slip is predicted to run.
    """
    sliding = _sliding(point)
    coming = sliding & _ahead(point, future) | sticking
    near, wide = _near_fold(config, point, sliding)
    inside, held = _inside_fold(config, point, sliding)
    asked = [
        (near | coming, (wide | coming) ^ True),
        (inside | sticking, (held | sticking) ^ True),
    ]
    asked.append((sticking, sticking ^ True))
    runs = sticking if isinstance(sticking, bool) else sticking.any()
    if runs and config.amplitude_limit < math.inf:
        amplitude, limit = point.amplitude, config.amplitude_limit
        small = amplitude < limit * (1.0 - config.hysteresis)
        asked.append((sticking & (amplitude > limit), (sticking ^ True) | small))
    else:
        never = sticking & (sticking ^ True)
        asked.append((never, never ^ True))
    return asked


class ConditionClassifier:
    """The memories between operating points and the alarm, for one bearing.

    Args:
        config: The bearing.

    Attributes:
        level: What tells vibration from quiet; ``None`` where none is measured.
    """

    def __init__(self, config: BearingConfig) -> None:
        self.level = config.level
        self.growth = _Growth(config.bearing, config.alarm)
        rungs = [k for k in range(1, len(LADDER)) if self.level or k != _VIBRATION_RUNG]
        self.levels = [_Rung(config.alarm, k) for k in rungs]
        self.retune(config)
        self._before: list[tuple[bool, bool]] = []
        self._point: Assessment | None = None
        self._measured: Measured | None = None
        # Since when stick-slip has been predicted while none was measured [ns].
        self._unseen: tuple[int, int] | None = None

    def retune(self, config: BearingConfig) -> None:
        """Take over new settings, which change no state."""
        self.config = config.alarm
        for latch in (self.growth, *self.levels):
            latch.config = config.alarm
        belief = config.belief
        self.growth.lean = belief.lean(config.alarm.runs_probability) if belief else 1.0

    def restart(self) -> None:
        """The clock jumped: what waited on time starts anew."""
        self._before, self._unseen = [], None
        for latch in (self.growth, *self.levels):
            latch.restart()

    def take(
        self,
        point: Assessment,
        time_ns: int,
        future: float,
        covered: int,
        rhythm: int,
        measured: int = UNKNOWN,
    ) -> Standing:
        """Take an operating point.

        Args:
            point: Its assessment, of scalars.
            time_ns: Its time [ns].
            future: The speed that the trend leads to [m/s]; ``nan`` if unknown.
            covered: How much of the time since the point before that one counted [ns].
            rhythm: That one's rhythm [ns].
            measured: What the level says, place in :data:`MEASURED`.
        """
        steps = self._steps(covered, rhythm)
        growth, asks, forced = self.growth, _grown(self.config, point), False
        if self.level is not None:
            close = near_fold(self.config, point)
            felt = _felt(close, measured, asks[0])
            asks, forced = _with_measured(asks, felt), felt[0]
        growth.take(steps[0], asks[growth.on], time_ns, forced)
        now = [asks, *_asked(self.config, point, future, growth.on)]
        if self.level is not None:
            now.insert(1, self._other(close, measured, growth.on))
            self._see(measured, time_ns)
            growth.share = _UNSEEN_SHARE if measured == NOT_VIBRATING else 1.0
        for level, step, asked in zip(self.levels, steps[1:], now[1:], strict=True):
            if step or asked[level.on]:
                level.take(step, asked[level.on], time_ns)
        self._before, self._point = now, point
        return self._standing()

    def _other(self, close: tuple[Any, Any], measured: Any, sticking: Any) -> Any:
        """Whether there is vibration that is no stick-slip; a learned threshold cannot know."""
        assert self.level is not None
        known = measured if not self.level.learns else measured * 0
        return _unexplained(close, known, sticking)

    def _see(self, measured: int, time_ns: int) -> None:
        self._measured = MEASURED[measured]
        if not self.growth.on or measured != NOT_VIBRATING:
            self._unseen = None
        else:
            since = time_ns if self._unseen is None else self._unseen[0]
            self._unseen = since, time_ns

    def _steps(self, covered: int, rhythm: int) -> list[int]:
        """What has passed since the point before, for the growth and each rung."""
        before, growth = self._before, self.growth
        if not before:
            return [0] * (1 + len(self.levels))
        asked = before[0][growth.on]
        steps = [growth.step(self._rate(asked), asked, covered, rhythm)]
        for level, asks in zip(self.levels, before[1:], strict=True):
            asked = asks[level.on]
            # Of an empty count nothing can be taken off.
            steps.append(level.step(asked, covered, rhythm) if asked or level.count else 0)
        return steps

    def _standing(self) -> Standing:
        growth, rung, asked, top = self.growth, 0, 0, -1
        for k, level in enumerate(self.levels):
            if self._before[k + 1][False]:
                asked = level.rung
            if level.on and (level.rung <= _STICK_RUNG or rung == _STICK_RUNG):
                rung, top = level.rung, k
        grown = 0.0 if growth.on else growth.count / E_FOLD
        unseen = (self._unseen[1] - self._unseen[0]) * 1e-9 if self._unseen else 0.0
        measured = self._measured
        if not rung:
            return Standing(0, growth.on, asked, grown, None, 0, measured, unseen)
        level = self.levels[top]
        clears = (level.due() - level.count) * 1e-9 if self._before[top + 1][True] else None
        return Standing(rung, growth.on, asked, grown, clears, level.raised, measured, unseen)

    def _rate(self, asked: bool) -> float:
        """The growth rate at the point before; not needed where nothing can shrink."""
        if self.growth.on or self._point is None or not (asked or self.growth.count):
            return 0.0
        rate: float = self._point.growth_rate
        return rate

    def follow(
        self,
        points: Assessments,
        times: IntArray,
        starts: NDArray[np.intp],
        futures: NDArray[np.float64],
        fresh: Fresh,
        taken: int,
        measured: NDArray[np.int8] | None = None,
    ) -> Decisions:
        """:meth:`take` of many points of a recording at once.

        Args:
            points: Assessments, shape (n,).
            times: Shape (n,) [ns].
            starts: The points before which the clock jumped, a first one of all included, (m,).
            futures: The speeds that the trend leads to, shape (n,) [m/s].
            fresh: How long each point counts.
            taken: How many of the points were taken before: none, or the one before these.
            measured: What the level says, places in :data:`MEASURED`, shape (n,); ``None`` where
                none is configured.
        """
        growth = self.growth
        growth.points, growth.fresh, growth.asks = points, fresh, _grown(self.config, points)
        if measured is not None:
            close = near_fold(self.config, points)
            felt = _felt(close, measured, growth.asks[0])
            growth.asks, growth.forced = _with_measured(growth.asks, felt), felt[0]
            growth.shares = np.where(measured == NOT_VIBRATING, _UNSEEN_SHARE, 1.0)
        sticking, grown = follow(growth, times, starts, taken)
        asked = _asked(self.config, points, futures, sticking)
        if measured is not None:
            asked.insert(0, self._other(close, measured, sticking))
        rung = np.zeros(times.size, np.int8)
        levels = {}
        for level, asks in zip(self.levels, asked, strict=True):
            level.fresh, level.asks, level.history = fresh, asks, []
            before, was_on, k = level.raised, level.on, level.rung
            on, count = follow(level, times, starts, taken)
            rung[on if k <= _STICK_RUNG else on & (rung == _STICK_RUNG)] = k
            raises = np.flatnonzero(np.diff(on[taken:].astype(np.int8), prepend=was_on) > 0)
            history = [before, *level.history]
            levels[k] = _LevelDecisions(asks, count, raises + taken, history)
        unseen_ns = None
        if measured is not None:
            unseen_ns = self._see_many(measured, sticking, times, starts, taken)
        return Decisions(self.config, rung, sticking, grown, levels, measured, unseen_ns)

    def _see_many(
        self,
        measured: NDArray[np.int8],
        sticking: BoolArray,
        times: IntArray,
        starts: NDArray[np.intp],
        taken: int,
    ) -> IntArray:
        """For how long stick-slip has been predicted and none was measured, shape (n,) [ns]."""
        quiet = sticking & (measured == NOT_VIBRATING)
        begins = quiet & ~np.append(False, quiet)[:-1]
        begins[starts] = quiet[starts]
        place = np.maximum.accumulate(np.where(begins, np.arange(times.size), 0))
        since = times[place]
        if taken and self._unseen is not None:
            since = np.where(place == 0, self._unseen[0], since)
        lasting: IntArray = np.where(quiet, times - since, 0)
        if times.size:
            last = int(times[-1])
            self._unseen = (last - int(lasting[-1]), last) if quiet[-1] else None
        return lasting


@dataclass(frozen=True, slots=True)
class _LevelDecisions:
    """One rung over a recording.

    Attributes:
        asks: What the points ask, each shape (n,).
        count: Shape (n,).
        raises: The points at which it was raised.
        history: How often it had lately been: before, and at each of these.
    """

    asks: tuple[BoolArray, BoolArray]
    count: IntArray
    raises: NDArray[np.intp]
    history: list[int]

    def raised(self, k: int) -> int:
        """How often it had lately been raised when it last was, at a point."""
        return self.history[int(np.searchsorted(self.raises, k, 'right'))]


@dataclass(frozen=True, slots=True)
class Decisions:
    """What the alarm rests on after each point of a recording.

    Attributes:
        config: The alarm.
        rung: Shape (n,).
        sticking: Whether stick-slip is predicted to run, shape (n,).
        grown: Growth, or the time it has been dying out, as counted, shape (n,).
        levels: The rungs from caution up.
        measured: What the level says, places in :data:`MEASURED`, shape (n,); ``None`` where
            none is configured.
        unseen_ns: For how long stick-slip has been predicted and not measured, shape (n,) [ns].
    """

    config: AlarmConfig
    rung: NDArray[np.int8]
    sticking: BoolArray
    grown: IntArray
    levels: dict[int, _LevelDecisions]
    measured: NDArray[np.int8] | None = None
    unseen_ns: IntArray | None = None

    def until(self, size: int) -> Decisions:
        """The first of the points."""
        rows = slice(size)
        return Decisions(
            self.config,
            self.rung[rows],
            self.sticking[rows],
            self.grown[rows],
            self.levels,
            None if self.measured is None else self.measured[rows],
            None if self.unseen_ns is None else self.unseen_ns[rows],
        )

    def at(self, k: int) -> Standing:
        """What the alarm rests on after point ``k``; :data:`QUIET` before the first."""
        if k < 0:
            return QUIET
        rung, sticking = int(self.rung[k]), bool(self.sticking[k])
        asked = max((j for j, lv in self.levels.items() if lv.asks[False][k]), default=0)
        grown = 0.0 if sticking else int(self.grown[k]) / E_FOLD
        measured, unseen = None, 0.0
        if self.measured is not None and self.unseen_ns is not None:
            measured, unseen = MEASURED[self.measured[k]], int(self.unseen_ns[k]) * 1e-9
        if not rung:
            return Standing(0, sticking, asked, grown, None, 0, measured, unseen)
        level = self.levels[rung]
        raised = level.raised(k)
        left = held_ns(self.config, rung, raised) - int(level.count[k])
        clears = left * 1e-9 if level.asks[True][k] else None
        return Standing(rung, sticking, asked, grown, clears, raised, measured, unseen)


def warns(config: AlarmConfig, point: Assessment) -> bool:
    """Whether an operating point by itself, of scalars, asks for caution or worse."""
    return bool(near_fold(config, point)[0])
