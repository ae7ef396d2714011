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

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
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

    def at(self, time: float, *, scaled: bool = True) -> FrictionLaw:
        """The law at a time since the scene's start [s], with or without its common factor."""
        step = np.array([time // STEP * STEP])
        moved = {name: own for name, own in self.drifts.items() if scaled or name != FACTOR}
        values = {name: float(drift.at(step)[0]) for name, drift in moved.items()}
        return with_parameters(self.law, values) if values else self.law

    def factor(self, time: FloatArray) -> FloatArray:
        """The common factor at some times [s], of their shape: as much as one on the load."""
        drift = self.drifts.get(FACTOR)
        return np.ones_like(time) if drift is None else drift.at(time // STEP * STEP)


# A single stick, after a knock or as the shaft breaks away, is no oscillation.
LEAST_STICKS = 2

Change = tuple[float, bool, bool]
"""When the lining began to stick (True) or ceased to (False), and, before those of the same time,
when the shaft came to rest (True) or began to turn (False): time [s], whether it is the lining's,
and which."""


@dataclass(frozen=True, slots=True)
class EpisodeEvent:
    """The start or the end of an episode."""

    name: str  # ``'first_stick'`` or ``'last_stick'``
    known: float  # when it could be known [s]
    time: float  # when it was [s]
    sticks: int  # stretches of sticking up to then
    sticking: float  # time of sticking in them [s]


def episodes_of(
    changes: Sequence[Change], gap: float, end: float
) -> tuple[list[tuple[float, float]], list[EpisodeEvent]]:
    """Ends and durations [s] of the sticks up to an end [s], and the events of their episodes.

    An episode is at least two sticks, each of which begins within ``gap`` [s] of the end of the
    one before. A stick counts from where it begins, while the shaft turns, to the release or to
    where the shaft comes to rest; one that begins at rest does not count.
    """
    ended: list[tuple[float, float]] = []
    counted: list[tuple[float, float]] = []
    since = begin = math.inf
    resting = False
    for time, is_stick, now in changes:
        if begin < math.inf and now is not is_stick:
            counted.append((begin, time))
            begin = math.inf
        if not is_stick:
            resting = now
        elif now:
            since, begin = time, math.inf if resting else time
        else:
            ended.append((time, max(time - since, 0.0)))
            since = math.inf
    ended += [(end, end - since)] if since < math.inf else []
    counted += [(begin, math.inf)] if begin < math.inf else []
    return ended, [event for one in _joined(counted, gap) for event in _told(one, gap, end)]


def _joined(
    sticks: Sequence[tuple[float, float]], gap: float
) -> Iterator[list[tuple[float, float]]]:
    """Sticks, with those that follow one another within the gap together."""
    edges = [k for k, (one, two) in enumerate(pairwise(sticks), 1) if two[0] > one[1] + gap]
    return (list(sticks[a:b]) for a, b in pairwise([0, *edges, len(sticks)]))


def _told(sticks: list[tuple[float, float]], gap: float, end: float) -> Iterator[EpisodeEvent]:
    if len(sticks) < LEAST_STICKS:
        return
    sticking = np.cumsum([last - first for first, last in sticks]).tolist()
    yield EpisodeEvent('first_stick', sticks[1][0], sticks[0][0], 1, sticking[0])
    last = sticks[-1][1]
    if end > last + gap:
        yield EpisodeEvent('last_stick', last + gap, last, len(sticks), sticking[-1])


PERIODS = 4
"""Natural periods in a window that an amplitude is taken from."""
PER_PERIOD = 16
"""Samples of the motion in each of them."""


def window_times(instants: FloatArray, period: float) -> FloatArray:
    """When to sample the motion in the windows before m instants [s], shape (m, samples) [s].

    Without a natural period [s] it is at the instants themselves.
    """
    steps = PERIODS * PER_PERIOD if period else 0
    return instants[:, None] - np.arange(steps, -1, -1) * (period / PER_PERIOD)


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
    """The lining of one bearing.

    It starts in steady sliding, or unloaded if the shaft is at rest. The drive is a sequence of
    linear pieces on a fixed grid.

    The load fluctuates on that grid with a standard deviation >= 0 [N], by its own random stream;
    knocks are times [s], rising, with impulses [N s].
    """

    def __init__(
        self, config: BearingConfig, shaft: Shaft, course: FrictionCourse, deviation: float,
        knocks: Sequence[tuple[float, float]], random: np.random.Generator,
    ) -> None:  # fmt: skip
        self.config, self._shaft, self._course = config, shaft, course
        self._deviation, self._knocks, self._random = deviation, dict(knocks), random
        cycles = config.bearing.natural_frequency / (2.0 * math.pi)
        self.rate = math.ceil(max(_LEAST_RATE, _PER_PERIOD * cycles))

    def follow(self, end: float, times: FloatArray) -> tuple[FloatArray, list[Change]]:
        """Follow the lining from the scene's start to an end [s].

        It is sampled at n times that do not fall, from the start to the end [s].

        Returns:
            Displacement, velocity and acceleration in SI units and whether it sticks, shape
            (4, n), and the changes in their order.
        """
        nodes = self._nodes(end)
        sampled: list[FloatArray] = []
        sticks: list[Change] = []
        taken, state = 0, self._start(nodes)
        for low, high in self._stretches(nodes):
            upto = int(np.searchsorted(times, nodes[0, high], 'right'))
            motion = self._integrate(nodes[:, low : high + 1], times[taken:upto], state)
            columns = motion.displacement, motion.velocity, motion.acceleration, motion.sticking
            sampled.append(np.array(columns, float))
            sticks += _changes(motion, bool(sticks) and sticks[-1][2])
            taken, state = upto, motion.final
        return np.concatenate(sampled, axis=1), list(heapq.merge(self._rests(nodes), sticks))

    def _start(self, nodes: FloatArray) -> MotionState:
        _, speed, load = nodes[:, 0].tolist()
        bearing = replace(self.config.bearing, friction=self._course.at(0.0))
        place = float(bearing.equilibrium(speed, load)) if speed else 0.0
        return MotionState(round(place, _PLACES), speed)

    def _nodes(self, end: float) -> FloatArray:
        """Time, speed, and load with its fluctuation, on the grid and at knocks, shape (3, n)."""
        name = self.config.name
        time = np.arange(math.floor(end * self.rate) + 1) / self.rate
        time = np.append(time, end) if end > time[-1] else time
        load = self._shaft.load(name, time)
        if self._deviation:
            load = load + self._deviation * self._random.standard_normal(time.size)
        nodes = np.stack([time, self._shaft.speed(name, time), np.maximum(load, 0.0)])
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

    def _integrate(self, nodes: FloatArray, times: FloatArray, state: MotionState) -> Motion:
        start = float(nodes[0, 0])
        law, own = self._course.at(start), self.config.bearing
        bearing = own if law is own.friction else replace(own, friction=law)
        if impulse := self._knocks.get(start):
            relative = state.relative_speed - impulse / bearing.mass
            state = MotionState(state.displacement, relative)
        motion = integrate(bearing, Drive.sampled(*nodes), state, times, accuracy=FAST)
        if motion.outcome is not MotionOutcome.COMPLETE:
            raise SceneError(
                f'lining_motion of {self.config.name}: after {motion.span[1]:g} s,'
                f' {motion.outcome.value}'
            )
        return motion

    def _rests(self, nodes: FloatArray) -> list[Change]:
        resting = np.abs(nodes[1]) < max(self.config.speed.deadband, np.finfo(float).tiny)
        change = np.flatnonzero(np.diff(resting, prepend=False))
        return [(float(nodes[0, k]), False, bool(resting[k])) for k in change]


def _changes(motion: Motion, sticks: bool) -> list[Change]:
    """Where sticking begins and ends, at knocks and changes of the law too."""
    starts = motion.start.phase is Phase.STICK
    found = [(motion.span[0], True, starts)] if starts != sticks else []
    change = motion.transitions
    own = (change.before == Phase.STICK) | (change.after == Phase.STICK)
    now = (change.after[own] == Phase.STICK).tolist()
    return found + [(t, True, to) for t, to in zip(change.time[own].tolist(), now, strict=True)]
