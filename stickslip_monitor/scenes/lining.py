# SPDX-License-Identifier: Apache-2.0
"""The lining of one bearing, followed through a scene by the event-driven integrator."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.friction import FrictionLaw
from stickslip_monitor.physics.oscillator import Bearing

from .friction_course import STEP, FrictionCourse
from .integrator import FAST, Drive, Motion, Outcome, Phase, State, integrate
from .shaft import Shaft
from .signals import FloatArray

# The drive is linear between instants of this rate [Hz]; it must carry the ripple of a
# propeller's blades, and a disturbance that reaches beyond the natural frequency.
_LEAST_RATE = 100.0
_PER_PERIOD = 4.0
# Of the place [m] where the lining starts: the last digits of an exponential differ between
# processors, and recordings must not.
_PLACES = 12


@dataclass(frozen=True, slots=True)
class Knock:
    """A blow on the lining: its time since the scene's start [s], and its impulse [N s]."""

    time: float
    impulse: float


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """How the lining moved over a stretch of time.

    Attributes:
        end: Where it ends [s].
        time: Times of the samples asked for, shape (n,) [s].
        displacement: Shape (n,) [m].
        velocity: Shape (n,) [m/s].
        acceleration: Shape (n,) [m/s^2].
        sticking: Whether it sticks, shape (n,).
        sticks: Times at which it began to stick (True) or ceased to (False), in order.
        rests: Times at which the shaft came to rest (True) or began to turn (False), in order.
    """

    end: float
    time: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    sticking: NDArray[np.bool_]
    sticks: list[tuple[float, bool]]
    rests: list[tuple[float, bool]]


class Lining:
    """The lining of one bearing; its state goes on from stretch to stretch.

    It starts as it would slide steadily, or unloaded where the shaft rests. The outcome does not
    depend on how a scene is cut into stretches: the drive is a sequence of linear pieces on a
    fixed grid, and only whole pieces are followed.

    Args:
        config: The bearing.
        shaft: Its speed and load.
        course: Its friction.
        deviation: Standard deviation of the load's fluctuation on the drive's grid, >= 0 [N].
        knocks: Blows, in order of time.
        random: The random stream of the fluctuation.
        duration: Duration of the scene [s].
    """

    def __init__(
        self,
        config: BearingConfig,
        shaft: Shaft,
        course: FrictionCourse,
        deviation: float,
        knocks: Sequence[Knock],
        random: np.random.Generator,
        duration: float,
    ) -> None:
        self.config, self._shaft, self._course = config, shaft, course
        self._deviation, self._knocks, self._random = deviation, knocks, random
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
        """Follow the lining on.

        Args:
            end: As :meth:`next_end` says [s].
            times: When to sample it, not falling, after the last end and up to this one [s].

        Raises:
            SceneError: The motion cannot be followed.
        """
        nodes = self._extend(end)
        motions: list[Motion] = []
        sticks: list[tuple[float, bool]] = []
        for low, high in self._stretches(nodes):
            taken = sum(motion.time.size for motion in motions)
            upto = int(np.searchsorted(times, nodes[0, high], 'right'))
            motion = self._integrate(nodes[:, low : high + 1], times[taken:upto])
            sticks += self._changes(motion)
            motions.append(motion)
        return Walk(
            end=end,
            time=times,
            displacement=_joined([m.displacement for m in motions]),
            velocity=_joined([m.velocity for m in motions]),
            acceleration=_joined([m.acceleration for m in motions]),
            sticking=_joined([m.sticking.astype(float) for m in motions]) > 0.0,
            sticks=sticks,
            rests=self._rests(nodes),
        )

    def _start(self) -> State:
        _, speed, load = self._nodes[:, 0].tolist()
        bearing = replace(self.config.bearing, friction=self._course.at(0.0))
        place = float(bearing.equilibrium(speed, load)) if speed else 0.0
        return State(round(place, _PLACES), speed)

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
            if nodes[0, 0] < knock.time < nodes[0, -1] and knock.time not in nodes[0]:
                place = int(np.searchsorted(nodes[0], knock.time))
                row = [np.interp(knock.time, nodes[0], column) for column in nodes]
                nodes = np.insert(nodes, place, row, axis=1)
        return nodes

    def _stretches(self, nodes: FloatArray) -> Iterator[tuple[int, int]]:
        """First and last node of each stretch with one law and without a knock inside."""
        time = nodes[0]
        inner = np.isin(time, [knock.time for knock in self._knocks])
        if self._course.drifts:
            inner |= time % STEP == 0.0
        inner[[0, -1]] = False
        edges = [0, *np.flatnonzero(inner).tolist(), time.size - 1]
        return ((low, high) for low, high in pairwise(edges) if low < high)

    def _integrate(self, nodes: FloatArray, times: FloatArray) -> Motion:
        start = float(nodes[0, 0])
        impulse = sum(knock.impulse for knock in self._knocks if knock.time == start)
        bearing = self._bearing(self._course.at(start))
        state = self._state
        if impulse:
            relative = state.relative_speed - impulse / bearing.mass
            state = State(state.displacement, relative)
        motion = integrate(bearing, Drive.sampled(*nodes), state, times, accuracy=FAST)
        if motion.outcome is not Outcome.COMPLETE:
            raise SceneError(
                f'lining_motion of {self.config.name}: after {motion.span[1]:g} s,'
                f' {motion.outcome.value}'
            )
        self._state = motion.final
        return motion

    def _bearing(self, law: FrictionLaw) -> Bearing:
        own = self.config.bearing
        return own if law is own.friction else replace(own, friction=law)

    def _changes(self, motion: Motion) -> list[tuple[float, bool]]:
        """Where sticking begins and ends, at knocks and changes of the law too."""
        found = []
        starts = motion.start.phase is Phase.STICK
        if starts != self._sticking:
            found.append((motion.span[0], starts))
        change = motion.transitions
        own = (change.before == Phase.STICK) | (change.after == Phase.STICK)
        now = (change.after[own] == Phase.STICK).tolist()
        found += zip(change.time[own].tolist(), now, strict=True)
        self._sticking = motion.final.phase is Phase.STICK
        return found

    def _rests(self, nodes: FloatArray) -> list[tuple[float, bool]]:
        resting = np.abs(nodes[1]) < max(self.config.speed.deadband, np.finfo(float).tiny)
        before = np.append(self._resting, resting[:-1])
        change = np.flatnonzero(resting != before)
        self._resting = bool(resting[-1])
        return list(zip(nodes[0, change].tolist(), resting[change].tolist(), strict=True))


def _joined(parts: list[FloatArray]) -> FloatArray:
    return np.concatenate([np.empty(0), *parts])
