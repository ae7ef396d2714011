# SPDX-License-Identifier: Apache-2.0
"""The lining of one bearing, followed through a scene by the event-driven integrator.

Also here: its friction, whose parameters move in time, the episodes of stick-slip that follow from
its sticks, and its sampled amplitude.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes import telemetry
from stickslip_monitor.lab.scenes.profile import Profile
from stickslip_monitor.lab.scenes.telemetry import Shaft
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.friction import FrictionLaw, Tabulated
from stickslip_monitor.physics.motion.integrator import (
    FAST,
    Drive,
    Motion,
    MotionOutcome,
    MotionState,
    Phase,
    integrate,
)

FACTOR = 'factor'
# Of the parameters of all laws, those that a common factor multiplies.
_COEFFICIENTS = ('static', 'kinetic', 'viscous')
STEP = 1.0


def parameters_of(law: FrictionLaw) -> tuple[str, ...]:
    """What may move: the law's own numbers, and a factor on the whole coefficient."""
    # The protocol does not say that a law is a dataclass; those a configuration can name are.
    own = () if isinstance(law, Tabulated) else tuple(f.name for f in fields(law))  # type: ignore[arg-type]
    return (*own, FACTOR)


def with_parameters(law: FrictionLaw, values: dict[str, float]) -> FrictionLaw:
    """A law with some parameters replaced, and then multiplied by the factor."""
    own = {name: value for name, value in values.items() if name != FACTOR}
    # A dataclass, as above.
    changed: Any = replace(law, **own) if own else law  # type: ignore[type-var]
    factor = values.get(FACTOR, 1.0)
    if isinstance(changed, Tabulated):
        return Tabulated(changed.speed, [factor * value for value in changed.values])
    names = [f.name for f in fields(changed) if f.name in _COEFFICIENTS]
    scaled: FrictionLaw = replace(changed, **{n: factor * getattr(changed, n) for n in names})
    return scaled


@dataclass(slots=True)
class FrictionCourse:
    """The friction law of one bearing over time.

    It moves in steps of one second, each with the values at its start, so that the integrator has
    one law at a time; the steps are too small to affect the motion.
    """

    law: FrictionLaw  # the law of the configuration
    drifts: dict[str, Profile] = field(default_factory=dict)  # by parameter, how it moves

    def at(self, time: float) -> FrictionLaw:
        """The law at a time since the scene's start [s]."""
        step = np.array([time // STEP * STEP])
        values = {name: float(drift.at(step)[0]) for name, drift in self.drifts.items()}
        return with_parameters(self.law, values) if values else self.law


# A single stick, after a knock or as the shaft breaks away, is no oscillation.
LEAST_STICKS = 2


@dataclass(frozen=True, slots=True)
class EpisodeEvent:
    """The start or the end of an episode."""

    name: str  # ``'first_stick'`` or ``'last_stick'``
    known: float  # when it could be known [s]
    time: float  # when it was [s]
    sticks: int  # stretches of sticking up to then
    sticking: float  # time of sticking in them [s]


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """How the lining moved over a stretch of time."""

    end: float  # where it ends [s]
    time: FloatArray  # times of the samples asked for, shape (n,) [s]
    displacement: FloatArray  # shape (n,) [m]
    velocity: FloatArray  # shape (n,) [m/s]
    acceleration: FloatArray  # shape (n,) [m/s^2]
    sticking: BoolArray  # whether it sticks, shape (n,)
    # When it began to stick (True) or ceased to (False), and, before those of the same time,
    # when the shaft came to rest (True) or began to turn (False): time [s], whether it is the
    # lining's, and which.
    changes: list[tuple[float, bool, bool]]

    def at(self, own: IndexArray) -> Walk:
        """The same with some of the samples."""
        names = ('time', 'displacement', 'velocity', 'acceleration', 'sticking')
        return replace(self, **{name: getattr(self, name)[own] for name in names})


class Episodes:
    """Joins sticks to episodes; times must not fall.

    An episode is at least two sticks, each of which begins within ``gap`` [s] of the end of the
    one before. A stick counts from where it begins, while the shaft turns, to the release or to
    where the shaft comes to rest; one that begins at rest does not count.
    """

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self.since: float | None = None  # since when the lining sticks [s]; None: it does not
        self._resting = False
        self._first = self._last = 0.0
        self._sticks = 0
        self._sticking = 0.0
        self._open: float | None = None

    def see(self, walk: Walk) -> tuple[list[tuple[float, float]], list[EpisodeEvent]]:
        """Ends and durations [s] of the sticks that ended in a stretch, and its events."""
        ended: list[tuple[float, float]] = []
        events: list[EpisodeEvent] = []
        for time, is_stick, now in walk.changes:
            if is_stick and now:
                self.since = time
                events += [] if self._resting else self.stick(time)
            elif is_stick:
                ended.append((time, time - (time if self.since is None else self.since)))
                self.since = None
                self.release(time)
            else:
                self._resting = now
                if now:
                    self.release(time)
        return ended, events + self.passed(walk.end)

    def stick(self, time: float) -> list[EpisodeEvent]:
        """A stick begins while the shaft turns."""
        events = self.passed(time)
        if self._sticks == 0:
            self._first = time
        elif self._sticks == LEAST_STICKS - 1:
            events.append(EpisodeEvent('first_stick', time, self._first, 1, self._sticking))
        self._sticks += 1
        self._open = time
        return events

    def release(self, time: float) -> None:
        """The stick ends, or the shaft comes to rest while it lasts."""
        if self._open is not None:
            self._sticking += time - self._open
            self._last, self._open = time, None

    def passed(self, time: float) -> list[EpisodeEvent]:
        """Time passes."""
        if not self._sticks or self._open is not None or time <= self._last + self.gap:
            return []
        sticks, sticking = self._sticks, self._sticking
        self._sticks, self._sticking = 0, 0.0
        if sticks < LEAST_STICKS:
            return []
        known = self._last + self.gap
        return [EpisodeEvent('last_stick', known, self._last, sticks, sticking)]


PERIODS = 4
"""Natural periods in a window that an amplitude is taken from."""
_STEPS = 16 * PERIODS


class Instants:
    """The instants ``k / rate`` of a scene of some duration [s], handed out in order.

    Or the times ``before`` each of them, falling to 0, shape (n,) [s], where they do not overlap.
    """

    def __init__(self, rate: float, duration: float, before: FloatArray | None = None) -> None:
        self._rate = rate
        self._count = telemetry.count(rate, duration)
        self._before = np.zeros(1) if before is None else before
        # The times before the scene's start are not there.
        self.next = 0 if before is None else before.size

    def until(self, end: float) -> FloatArray:
        """The next instants, up to and with ``end`` [s]."""
        size = self._before.size
        last = min(self._count, math.floor((end + self._before[0]) * self._rate) + 2)
        number, place = np.divmod(np.arange(self.next, max(last * size, self.next)), size)
        time = number / self._rate - self._before[place]
        time = time[: np.searchsorted(time, end, 'right')]
        self.next += time.size
        return time


class AmplitudeWindows:
    """The amplitude of a motion in a short window before each instant ``k / rate``, ``k > 0``.

    Windows of :data:`PERIODS` must not overlap; period and duration are in s.
    """

    def __init__(self, rate: float, period: float, duration: float) -> None:
        self._rate, self._step = rate, PERIODS * period / _STEPS
        before = np.arange(_STEPS, -1, -1).astype(float) * self._step
        self.instants = Instants(rate, duration, before)
        self._kept = np.empty((2, 0))

    def amplitudes(
        self, displacement: FloatArray, velocity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Half the peak to peak of each window that is now complete, shape (m,) [m].

        Takes displacement and velocity at the instants handed out last, and gives the instants at
        the windows' ends [s] with the amplitudes.
        """
        kept = np.concatenate([self._kept, [displacement, velocity]], axis=1)
        begin = self.instants.next - kept.shape[1]
        whole = kept.shape[1] // (_STEPS + 1)
        cut = whole * (_STEPS + 1)
        self._kept = kept[:, cut:]
        x, v = kept[:, :cut].reshape(2, whole, _STEPS + 1)
        numbers = begin // (_STEPS + 1) + np.arange(whole)
        return numbers / self._rate, half_peak_to_peak(x, v, self._step)


def half_peak_to_peak(x: FloatArray, v: FloatArray, step: float) -> FloatArray:
    """Half of the largest less the smallest displacement of m sampled motions, shape (m,) [m].

    Between two samples, ``step`` [s] apart, a motion is interpolated by the cubic through their
    displacements ``x`` and velocities ``v``, shape (m, n); with sixteen samples in a period of a
    harmonic motion the error is 6e-5.
    """
    before, after = step * v[:, :-1], step * v[:, 1:]
    rise = np.diff(x, axis=1)
    turns = before * after < 0.0
    # The cubic's derivative is a s^2 + b s + c, with s from 0 to 1.
    a = 3.0 * (before + after - 2.0 * rise)
    b = 2.0 * (3.0 * rise - 2.0 * before - after)
    q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4.0 * a * before, 0.0)), b))
    with np.errstate(divide='ignore', invalid='ignore'):
        first, second = before / q, q / a
    s = np.where(turns, np.where((first >= 0.0) & (first <= 1.0), first, second), 0.0)
    turning = x[:, :-1] + s * (before + s * (b / 2.0 + s * a / 3.0))
    highest = np.maximum(x.max(axis=1), turning.max(axis=1))
    lowest = np.minimum(x.min(axis=1), turning.min(axis=1))
    amplitude: FloatArray = 0.5 * (highest - lowest)
    return amplitude


# The drive is linear between instants of this rate [Hz], which must resolve the ripple of a
# propeller's blades, and a disturbance beyond the natural frequency.
_LEAST_RATE = 100.0
_PER_PERIOD = 4.0
# Of the place [m] where the lining starts: the last digits of an exponential differ between
# processors, and recordings must not.
_PLACES = 12


class Lining:
    """The lining of one bearing; its state is kept from stretch to stretch.

    It starts in steady sliding, or unloaded if the shaft is at rest. The result does not
    depend on how a scene is divided into stretches: the drive is a sequence of linear pieces on a
    fixed grid, and only whole pieces are followed.

    The load fluctuates on that grid with a standard deviation >= 0 [N], by its own random stream;
    knocks are times [s], rising, with impulses [N s].
    """

    def __init__(
        self, config: BearingConfig, shaft: Shaft, course: FrictionCourse, deviation: float,
        knocks: Sequence[tuple[float, float]], random: np.random.Generator, duration: float,
    ) -> None:  # fmt: skip
        self.config, self._shaft, self._course = config, shaft, course
        self._deviation, self._knocks, self._random = deviation, dict(knocks), random
        self._duration = duration
        cycles = config.bearing.natural_frequency / (2.0 * math.pi)
        self.rate = math.ceil(max(_LEAST_RATE, _PER_PERIOD * cycles))
        self._number = 0
        self._nodes = self._drive_at(np.zeros(1))
        self._state = self._start()
        self._sticking = self._resting = False

    @property
    def reached(self) -> float:
        """How far it was followed [s]."""
        return float(self._nodes[0, -1])

    def next_end(self, end: float) -> float:
        """Where a stretch ends that must reach ``end``: at the end of a piece [s]."""
        return min(math.ceil(end * self.rate) / self.rate, self._duration)

    def follow(self, end: float, times: FloatArray) -> Walk:
        """Follow the lining to a later time, as :meth:`next_end` says [s].

        It is sampled at times that do not fall, after the last end and up to this one [s].
        """
        nodes = self._extend(end)
        motions: list[Motion] = []
        sticks: list[tuple[float, bool, bool]] = []
        for low, high in self._stretches(nodes):
            taken = sum(motion.time.size for motion in motions)
            upto = int(np.searchsorted(times, nodes[0, high], 'right'))
            motion = self._integrate(nodes[:, low : high + 1], times[taken:upto])
            sticks += self._changes(motion)
            motions.append(motion)
        sampled = {
            name: np.concatenate([getattr(motion, name) for motion in motions])
            for name in ('displacement', 'velocity', 'acceleration', 'sticking')
        }
        changes = list(heapq.merge(self._rests(nodes), sticks))
        return Walk(end, times, changes=changes, **sampled)

    def _start(self) -> MotionState:
        _, speed, load = self._nodes[:, 0].tolist()
        bearing = replace(self.config.bearing, friction=self._course.at(0.0))
        place = float(bearing.equilibrium(speed, load)) if speed else 0.0
        return MotionState(round(place, _PLACES), speed)

    def _drive_at(self, time: FloatArray) -> FloatArray:
        """Time, speed and load with its fluctuation, shape (3, n)."""
        name = self.config.name
        load = self._shaft.load(name, time)
        if self._deviation:
            load = load + self._deviation * self._random.standard_normal(time.size)
        return np.stack([time, self._shaft.speed(name, time), np.maximum(load, 0.0)])

    def _extend(self, end: float) -> FloatArray:
        """The grid's instants from the last end to this one, and those of knocks, (3, n)."""
        last = math.floor(end * self.rate)
        time = np.arange(self._number + 1, last + 1) / self.rate
        self._number = last
        if end > (time[-1] if time.size else self.reached):
            time = np.append(time, end)
        nodes = np.concatenate([self._nodes, self._drive_at(time)], axis=1)
        self._nodes = nodes[:, -1:]
        for knock in self._knocks:
            if nodes[0, 0] < knock < nodes[0, -1] and knock not in nodes[0]:
                place = int(np.searchsorted(nodes[0], knock))
                row = [np.interp(knock, nodes[0], column) for column in nodes]
                nodes = np.insert(nodes, place, row, axis=1)
        return nodes

    def _stretches(self, nodes: FloatArray) -> Iterator[tuple[int, int]]:
        """First and last node of each stretch with one law and without a knock inside."""
        time = nodes[0]
        inner = np.isin(time, list(self._knocks))
        if self._course.drifts:
            inner |= time % STEP == 0.0
        inner[[0, -1]] = False
        edges = [0, *np.flatnonzero(inner).tolist(), time.size - 1]
        return ((low, high) for low, high in pairwise(edges) if low < high)

    def _integrate(self, nodes: FloatArray, times: FloatArray) -> Motion:
        start = float(nodes[0, 0])
        law, own = self._course.at(start), self.config.bearing
        bearing = own if law is own.friction else replace(own, friction=law)
        state = self._state
        if impulse := self._knocks.get(start):
            relative = state.relative_speed - impulse / bearing.mass
            state = MotionState(state.displacement, relative)
        motion = integrate(bearing, Drive.sampled(*nodes), state, times, accuracy=FAST)
        if motion.outcome is not MotionOutcome.COMPLETE:
            raise SceneError(
                f'lining_motion of {self.config.name}: after {motion.span[1]:g} s,'
                f' {motion.outcome.value}'
            )
        self._state = motion.final
        return motion

    def _changes(self, motion: Motion) -> list[tuple[float, bool, bool]]:
        """Where sticking begins and ends, at knocks and changes of the law too."""
        found = []
        starts = motion.start.phase is Phase.STICK
        if starts != self._sticking:
            found.append((motion.span[0], True, starts))
        change = motion.transitions
        own = (change.before == Phase.STICK) | (change.after == Phase.STICK)
        now = (change.after[own] == Phase.STICK).tolist()
        found += [
            (t, True, sticks) for t, sticks in zip(change.time[own].tolist(), now, strict=True)
        ]
        self._sticking = motion.final.phase is Phase.STICK
        return found

    def _rests(self, nodes: FloatArray) -> list[tuple[float, bool, bool]]:
        resting = np.abs(nodes[1]) < max(self.config.speed.deadband, np.finfo(float).tiny)
        change = np.flatnonzero(resting != np.append(self._resting, resting[:-1]))
        self._resting = bool(resting[-1])
        return [(float(nodes[0, k]), False, bool(resting[k])) for k in change]
