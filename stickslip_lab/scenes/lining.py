# SPDX-License-Identifier: Apache-2.0
"""Follows the lining of one bearing through a scene by the event-driven integrator.

Also here: its friction over time, the episodes of stick-slip that follow from its sticks, and the amplitude
of its sampled motion.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from stickslip_lab.scenes import telemetry
from stickslip_lab.scenes.settings import Profile
from stickslip_lab.scenes.telemetry import Shaft
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Tabulated
from stickslip_monitor.physics.integrator import (
    FAST,
    Drive,
    Motion,
    MotionOutcome,
    MotionState,
    Phase,
    integrate,
)

FACTOR = 'factor'
"""Name of the parameter that multiplies all coefficients of a law."""
# Of the parameters of all laws, those that a common factor multiplies.
_COEFFICIENTS = ('static', 'kinetic', 'viscous')
STEP = 1.0
"""Time for which drifting friction is held constant [s]."""


def drifting_parameters(law: FrictionLaw) -> tuple[str, ...]:
    """Return the names of a law's parameters that may drift: its own, and ``factor`` on its coefficients.

    A table has the factor only.
    """
    # The protocol does not say that a law is a dataclass; those a configuration can name are.
    record: Any = law
    names = () if isinstance(law, Tabulated) else tuple(f.name for f in fields(record))
    return (*names, FACTOR)


def replace_parameters(law: FrictionLaw, values: dict[str, float]) -> FrictionLaw:
    """Return a law with some parameters replaced and its coefficients scaled.

    Args:
        law: The law, which stays as it is.
        values: New values by name; ``factor`` multiplies all coefficients.

    Raises:
        PhysicsError: A value breaks a rule of the law.
        TypeError: The law has no such parameter.
    """
    replaced = {name: value for name, value in values.items() if name != FACTOR}
    changed: Any = law  # a dataclass, as above
    changed = replace(changed, **replaced) if replaced else law
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
    water: Profile | None = None  # temperature of the water [C]; None: as the bearing is configured

    @property
    def is_moving(self) -> bool:
        """Whether friction changes from step to step."""
        return bool(self.drifts) or self.water is not None

    def bearing_at(self, bearing: Bearing, time: float, *, scaled: bool = True) -> Bearing:
        """Return a bearing with the law and the water of a time; the bearing itself where nothing moves.

        Without lubrication the water does not count.

        Args:
            bearing: The bearing, with the law of the configuration.
            time: Time since the scene's start [s]; the start of its second counts.
            scaled: Whether the drift of the common ``factor`` counts.

        Raises:
            PhysicsError: The water moves, and the temperature at which friction was measured is not known.
        """
        law = self.at(time, scaled=scaled)
        bearing = bearing if law is bearing.friction else replace(bearing, friction=law)
        if self.water is None:
            return bearing
        return bearing.at_temperature(float(self.water.at(np.array([time // STEP * STEP]))[0]))

    def at(self, time: float, *, scaled: bool = True) -> FrictionLaw:
        """Return the law at a time; that of the configuration where nothing drifts.

        Args:
            time: Time since the scene's start [s]; the start of its second counts.
            scaled: Whether the drift of the common ``factor`` counts.

        Raises:
            PhysicsError: A drift breaks a rule of the law.
        """
        step = np.array([time // STEP * STEP])
        moved = {name: course for name, course in self.drifts.items() if scaled or name != FACTOR}
        values = {name: float(drift.at(step)[0]) for name, drift in moved.items()}
        return replace_parameters(self.law, values) if values else self.law

    def factor(self, time: FloatArray) -> FloatArray:
        """Return the common factor of the coefficients at times [s], of their shape; 1 without a drift."""
        drift = self.drifts.get(FACTOR)
        return np.ones_like(time) if drift is None else drift.at(time // STEP * STEP)


MIN_STICKS = 2
"""Sticks of an episode at least: one, after a knock or as the shaft breaks away, is no oscillation."""
TIME_DECIMALS, LENGTH_DECIMALS = 8, 12
"""Decimals of times [s] and of lengths [m] that are recorded: digits beyond them, as those of exponentials,
differ between processors, and recordings must not."""

Change = tuple[float, bool, bool]
"""A change of the lining or the shaft: its time [s]; whether it is one of the lining; and True where the
lining begins to stick or the shaft comes to rest, False where the lining slips or the shaft turns. At equal
times those of the shaft come first."""


class EpisodeEvent(NamedTuple):
    """The start or the end of an episode."""

    known_at: float  # when it could be known [s]
    name: str  # ``'first_stick'`` for the start, ``'last_stick'`` for the end
    time: float  # when it was [s]
    # Of an end 'sticks', their number, and 'sticking', their total time [s]; else empty.
    more: dict[str, float]


class Episodes:
    """Joins sticks to episodes; times must not fall from call to call.

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

    def take_changes(
        self, changes: Sequence[Change], end: float
    ) -> tuple[list[tuple[float, float]], list[EpisodeEvent]]:
        """Take the changes of a stretch in their order, and let time pass to its end; the state advances.

        Args:
            changes: The changes.
            end: End of the stretch [s].

        Returns:
            End and duration [s] of each stick that ended, also at rest, and the events of episodes.
        """
        ended: list[tuple[float, float]] = []
        events: list[EpisodeEvent] = []
        for time, is_stick, now in changes:
            if is_stick and now:
                self.since = time
                events += [] if self._resting else self.add_stick(time)
            elif is_stick:
                ended.append((time, time - (time if self.since is None else self.since)))
                self.since = None
                self.release(time)
            else:
                self._resting = now
                if now:
                    self.release(time)
        return ended, events + self.advance(end)

    def add_stick(self, time: float) -> list[EpisodeEvent]:
        """Count a stick that begins at a time [s], while the shaft turns; let time pass until then.

        Returns:
            The end of an episode that was over before, and the start of one that this stick, its second,
            makes; an empty list for neither.
        """
        events = self.advance(time)
        if self._sticks == 0:
            self._first = time
        elif self._sticks == MIN_STICKS - 1:
            events.append(EpisodeEvent(time, 'first_stick', self._first, {}))
        self._sticks += 1
        self._open = time
        return events

    def release(self, time: float) -> None:
        """End the stick that goes on, if any, at a time [s]: the lining slips, or the shaft comes to rest."""
        if self._open is not None:
            self._sticking += time - self._open
            self._last, self._open = time, None

    def advance(self, time: float) -> list[EpisodeEvent]:
        """Let time pass to ``time`` [s]; forget the sticks of an episode that is over by then.

        Returns:
            The end of that episode as a list of one; an empty list while it goes on, or where its sticks were
            too few for an episode.
        """
        if not self._sticks or self._open is not None or time <= self._last + self.gap:
            return []
        more: dict[str, float] = {'sticks': self._sticks, 'sticking': round(self._sticking, TIME_DECIMALS)}
        self._sticks, self._sticking = 0, 0.0
        if more['sticks'] < MIN_STICKS:
            return []
        return [EpisodeEvent(self._last + self.gap, 'last_stick', self._last, more)]


PERIODS = 4
"""Natural periods in a window that an amplitude is taken from."""
PER_PERIOD = 16
"""Samples of the motion in each of them."""


class Samples:
    """The motion at the instants ``k / rate`` of a scene, from 0 to its end, in order.

    Args:
        rate: Rate of the instants [Hz].
        duration: Duration of the scene [s].
        period: Natural period [s]: the motion is then sampled in a window of :data:`PERIODS` of them up to
            each instant but the first; windows must not overlap. 0 for one sample at each instant.
    """

    def __init__(self, rate: float, duration: float, period: float = 0.0) -> None:
        self._rate, self._count = rate, telemetry.instant_count(rate, duration)
        steps = PERIODS * PER_PERIOD if period else 0
        self._before = np.arange(steps, -1, -1) * (period / PER_PERIOD)
        # A window before the scene's start is not there.
        self._next = 1 if period else 0
        self._asked = self._next * self._before.size
        self._kept = np.empty((4, 0))

    def take_next_times(self, end: float) -> FloatArray:
        """Return the next times to sample the motion at, up to and with ``end`` [s], shape (n,).

        The next call goes on after them: :meth:`add` must get the motion at them first.
        """
        size = self._before.size
        last = min(self._count, math.floor((end + self._before[0]) * self._rate) + 2)
        number, place = np.divmod(np.arange(self._asked, max(last * size, self._asked)), size)
        time = number / self._rate - self._before[place]
        time = time[: np.searchsorted(time, end, 'right')]
        self._asked += time.size
        return time

    def add(self, motion: FloatArray) -> None:
        """Store the motion at the times that :meth:`take_next_times` returned last.

        Args:
            motion: Rows as of :meth:`Lining.follow`, shape (4, n).
        """
        self._kept = np.concatenate([self._kept, motion], axis=1)

    def pop_due(self, end: float = math.inf) -> tuple[FloatArray, FloatArray]:
        """Remove and return the complete samples before ``end`` [s].

        Returns:
            Instants (m,) [s] and the motion at each, rows as of :meth:`Lining.follow`, shape
            (4, m, samples in a window); m may be 0.
        """
        size = self._before.size
        time = (self._next + np.arange(self._kept.shape[1] // size)) / self._rate
        time = time[: np.searchsorted(time, end, 'left')]
        taken, self._kept = np.split(self._kept, [time.size * size], axis=1)
        self._next += time.size
        return time, taken.reshape(4, time.size, size)


def half_peak_to_peak(x: FloatArray, v: FloatArray, step: float) -> FloatArray:
    """Return half of the largest less the smallest displacement of m sampled motions, shape (m,) [m].

    Between two samples a motion is interpolated by the cubic through their displacements and velocities; with
    sixteen samples in a period of a harmonic motion the error is 6e-5.

    Args:
        x: Displacements, shape (m, n) [m].
        v: Velocities, same shape [m/s].
        step: Time between samples [s].
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


class Lining:
    """The lining of one bearing; its state is kept from stretch to stretch.

    It starts in steady sliding, or unloaded if the shaft is at rest. The result does not
    depend on how a scene is divided into stretches: the drive is a sequence of linear pieces on a
    fixed grid, and only whole pieces are followed.

    Args:
        config: The bearing.
        shaft: Speed and load over time.
        course: Friction over time.
        deviation: Standard deviation >= 0 by which the load fluctuates on the grid [N].
        knocks: Rising times [s], each with the impulse that the lining then gets [N s].
        random: Stream for the fluctuation; it advances.
        duration: Duration of the scene [s].

    Attributes:
        rate: Rate of the grid [Hz].
    """

    def __init__(
        self,
        config: BearingConfig,
        shaft: Shaft,
        course: FrictionCourse,
        deviation: float,
        knocks: Sequence[tuple[float, float]],
        random: np.random.Generator,
        duration: float,
    ) -> None:
        self.config, self._shaft, self._course = config, shaft, course
        self._deviation, self._knocks, self._random = deviation, dict(knocks), random
        self._duration = duration
        cycles = config.bearing.natural_frequency / (2.0 * math.pi)
        # Four pieces of the drive in a natural period: a disturbance goes beyond the natural frequency.
        self.rate = math.ceil(max(telemetry.MIN_GRID_RATE, 4.0 * cycles))
        self._number = 0
        self._nodes = self._draw_drive(np.zeros(1))
        _, speed, load = self._nodes[:, 0].tolist()
        first = course.bearing_at(config.bearing, 0.0)
        place = float(first.equilibrium(speed, load)) if speed else 0.0
        self._state = MotionState(round(place, LENGTH_DECIMALS), speed)
        self._sticking = self._resting = False

    @property
    def reached(self) -> float:
        """Time up to which it was followed [s]."""
        return float(self._nodes[0, -1])

    def next_end(self, end: float) -> float:
        """Return the end [s] of the first piece of the drive that reaches ``end`` [s].

        It is never after the scene's end.
        """
        return min(math.ceil(end * self.rate) / self.rate, self._duration)

    def follow(self, end: float, times: FloatArray) -> tuple[FloatArray, list[Change]]:
        """Follow the lining to a later time; its state there is where the next call starts.

        The random stream of the load advances.

        Args:
            end: A time that :meth:`next_end` returned [s].
            times: Times to sample at, ascending, after the last end and up to this one, shape (n,) [s].

        Returns:
            Displacement, velocity and acceleration in SI units and whether it sticks (1 or 0), shape
            (4, n); and the changes of sticking and of rest, by time.

        Raises:
            SceneError: The integrator gave up.
        """
        nodes = self._extend_grid(end)
        sampled: list[FloatArray] = []
        sticks: list[Change] = []
        taken = 0
        for low, high in self._uniform_stretches(nodes):
            upto = int(np.searchsorted(times, nodes[0, high], 'right'))
            motion = self._integrate_motion(nodes[:, low : high + 1], times[taken:upto])
            columns = motion.displacement, motion.velocity, motion.acceleration, motion.sticking
            sampled.append(np.array(columns, float))
            sticks += self._take_stick_changes(motion)
            taken = upto
        return np.concatenate(sampled, axis=1), list(heapq.merge(self._take_rest_changes(nodes), sticks))

    def _draw_drive(self, time: FloatArray) -> FloatArray:
        """Return times, speeds and loads >= 0 in SI units, shape (3, n).

        The load's fluctuation is drawn at random: the random stream advances.
        """
        name = self.config.name
        load = self._shaft.load(name, time)
        if self._deviation:
            load = load + self._deviation * self._random.standard_normal(time.size)
        return np.stack([time, self._shaft.speed(name, time), np.maximum(load, 0.0)])

    def _extend_grid(self, end: float) -> FloatArray:
        """Extend the grid of the drive to ``end`` [s]; its last node is stored and begins the next one.

        The random stream of the load advances.

        Returns:
            Time, speed and load from the last end to this one, with a node at each knock, shape (3, n).
        """
        last = math.floor(end * self.rate)
        time = np.arange(self._number + 1, last + 1) / self.rate
        self._number = last
        if end > (time[-1] if time.size else self.reached):
            time = np.append(time, end)
        nodes = np.concatenate([self._nodes, self._draw_drive(time)], axis=1)
        self._nodes = nodes[:, -1:]
        for knock in self._knocks:
            if nodes[0, 0] < knock < nodes[0, -1] and knock not in nodes[0]:
                place = int(np.searchsorted(nodes[0], knock))
                row = [np.interp(knock, nodes[0], column) for column in nodes]
                nodes = np.insert(nodes, place, row, axis=1)
        return nodes

    def _uniform_stretches(self, nodes: FloatArray) -> Iterator[tuple[int, int]]:
        """Yield the stretches with one law and no knock inside, as first and last index of ``nodes``.

        Neighbours share a node; ``nodes`` is time, speed and load, shape (3, n). One begins at each knock, at
        each multiple of :data:`STEP` if friction moves and, with lubrication, at the first node of each tenth
        of a second.
        """
        time = nodes[0]
        inner = np.isin(time, list(self._knocks))
        if self._course.is_moving:
            inner |= time % STEP == 0.0
        if self.config.bearing.lubrication is not None:
            # Friction is that of the load at the begin of each tenth of a second: a wave takes 5 s.
            inner |= np.diff(time // 0.1, prepend=-1.0) != 0.0
        inner[[0, -1]] = False
        edges = [0, *np.flatnonzero(inner).tolist(), time.size - 1]
        return ((low, high) for low, high in pairwise(edges) if low < high)

    def _integrate_motion(self, nodes: FloatArray, times: FloatArray) -> Motion:
        """Integrate through a stretch with one law, after a knock at its start; store the last state.

        Args:
            nodes: Time, speed and load in SI units, shape (3, m).
            times: Times to sample at, shape (n,) [s].

        Returns:
            The complete motion, sampled at the times.

        Raises:
            SceneError: The integrator gave up.
        """
        start = float(nodes[0, 0])
        bearing = self._course.bearing_at(self.config.bearing, start)
        state = self._state
        if impulse := self._knocks.get(start):
            relative = state.relative_speed - impulse / bearing.mass
            state = MotionState(state.displacement, relative)
        motion = integrate(bearing, Drive.sampled(*nodes), state, times, accuracy=FAST)
        if motion.outcome is not MotionOutcome.COMPLETE:
            raise SceneError(
                f'lining_motion of {self.config.name}: after {motion.span[1]:g} s, {motion.outcome.value}'
            )
        self._state = motion.final
        return motion

    def _take_stick_changes(self, motion: Motion) -> list[Change]:
        """Return the changes between stick and slip in a stretch, by time; store whether it ends in a stick.

        Each is a :data:`Change` of the lining. A knock or a new law at its start may begin or end a stick.
        """
        changes = []
        starts = motion.start.phase is Phase.STICK
        if starts != self._sticking:
            changes.append((motion.span[0], True, starts))
        change = motion.transitions
        is_stick_change = (change.before == Phase.STICK) | (change.after == Phase.STICK)
        now = (change.after[is_stick_change] == Phase.STICK).tolist()
        changes += [
            (t, True, sticks) for t, sticks in zip(change.time[is_stick_change].tolist(), now, strict=True)
        ]
        self._sticking = motion.final.phase is Phase.STICK
        return changes

    def _take_rest_changes(self, nodes: FloatArray) -> list[Change]:
        """Return the changes between rest and turning at nodes, by time; store whether the last is at rest.

        Each is a :data:`Change` of the shaft. At rest the speed is below the configured deadband. ``nodes``
        is time, speed and load in SI units, shape (3, n).
        """
        resting = np.abs(nodes[1]) < max(self.config.speed.deadband, np.finfo(float).tiny)
        change = np.flatnonzero(resting != np.append(self._resting, resting[:-1]))
        self._resting = bool(resting[-1])
        return [(float(nodes[0, k]), False, bool(resting[k])) for k in change]
