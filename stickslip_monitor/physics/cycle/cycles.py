# SPDX-License-Identifier: Apache-2.0
"""The exact cycles of the mass-spring-belt oscillator, with its friction as the law says.

Nothing is averaged and nothing smoothed. While the lining sticks it moves with the belt; it
breaks away at ``x_0 = (mu_s N - c V)/k`` and slips by

    m x'' + c x' + k x = N mu(V - x')

until ``x' = V`` again. There the set-valued law decides: it sticks while the belt can hold it,
``|k x + c V| <= mu_s N``, and overtakes the belt otherwise. Every stick-slip cycle passes through
``x_0``, so there is one at most, and whether there is one takes one slip phase. The fold is where
that slip phase only grazes the belt. A pure-slip cycle is a fixed point of the return map on
``x' = 0``; its Floquet multiplier is ``exp`` of the integral of the flow's divergence.

Conventions of every function: inputs broadcast; a 0-d result comes back as a number; ``nan`` says
that there is no such cycle, and the kind says why. Speeds astern mirror speeds ahead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray, flatten, mapped, restore
from stickslip_monitor.physics.cycle import fold, stable, unstable, waveform
from stickslip_monitor.physics.oscillator import Bearing


class CycleKind(IntEnum):
    """What was found at a point; each member carries its sentence."""

    sentence: str

    def __new__(cls, number: int, sentence: str) -> CycleKind:
        """Make a member from its number and its sentence."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.sentence = sentence
        return member

    STICK_SLIP = 0, 'The lining sticks to the journal for a part of every cycle.'
    OVERTAKING = 1, 'The lining overtakes the journal in every cycle and never sticks to it.'
    PURE_SLIP = 2, 'The lining stays slower than the journal throughout the cycle.'
    NONE = 3, 'There is no such cycle at this speed and load.'
    AT_REST = 4, 'The shaft is at rest: nothing slides.'
    NO_CONTACT = 5, 'The bearing carries no load: there is no friction.'
    NOT_FINITE = 6, 'Speed or load is not a finite number.'
    UNRESOLVED = 7, 'The motion was not resolved within the allowed number of steps.'

    def __str__(self) -> str:
        return self.name.lower()


_Motion = Callable[[Bearing, float, float, float, FloatArray], tuple[FloatArray, FloatArray]]
_MOTIONS: dict[CycleKind, _Motion] = {CycleKind.PURE_SLIP: waveform.pure_slip}


@dataclass(frozen=True, slots=True)
class Cycle:
    """Limit cycles; every array has the shape of the broadcast inputs.

    Attributes:
        amplitude: Half the peak-to-peak displacement [m].
        period: Duration [s].
        stick_fraction: Share of the period in which the lining sticks [-].
        multiplier: Floquet multiplier [-]: 0 with stick, which forgets every disturbance;
            above 1 for an unstable cycle.
        kind: :class:`CycleKind`, its numbers in an array.
        evaluations: How often the friction law was evaluated, at all nodes of a step together.
    """

    amplitude: Any
    period: Any
    stick_fraction: Any
    multiplier: Any
    kind: Any
    evaluations: Any
    _bearing: Bearing = field(repr=False)
    _points: tuple[FloatArray, FloatArray] = field(repr=False)
    _start: FloatArray = field(repr=False)

    def waveform(self, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One period of the motion, with both its ends.

        A cycle through the belt's speed begins where the lining falls behind, a pure-slip one
        where it turns to follow the belt. Displacements are counted from the unloaded spring.

        Args:
            count: Number of instants, evenly spaced, >= 2.

        Returns:
            Time [s], displacement [m] and velocity [m/s], each of shape (..., count); ``nan``
            where there is no cycle.
        """
        kind = np.ravel(self.kind)
        period = np.ravel(np.asarray(self.period, dtype=float))
        out = np.full((3, kind.size, count), np.nan)
        for i in np.flatnonzero(kind <= CycleKind.PURE_SLIP):
            speed, load = self._points[0][i], self._points[1][i]
            time = np.linspace(0.0, period[i], count)
            motion = _MOTIONS.get(tuple(CycleKind)[int(kind[i])], waveform.through_belt)
            x, v = motion(self._bearing, speed, load, self._start[i], time)
            out[:, i] = time, x, v
        time, x, v = out.reshape(3, *np.shape(self.kind), count)
        return time, x, v


def _kinds(speed: FloatArray, load: FloatArray) -> NDArray[np.int8]:
    """Why a point has no cycle; ``UNRESOLVED`` where it is to be computed."""
    kind = np.full(speed.size, CycleKind.UNRESOLVED, dtype=np.int8)
    kind[load <= 0.0] = CycleKind.NO_CONTACT
    kind[speed == 0.0] = CycleKind.AT_REST
    kind[~(np.isfinite(speed) & np.isfinite(load))] = CycleKind.NOT_FINITE
    return kind


@dataclass(frozen=True, slots=True)
class _Table:
    """The columns of a :class:`Cycle` while they are filled, each of shape (n,)."""

    bearing: Bearing
    shape: tuple[int, ...]
    speed: FloatArray
    load: FloatArray
    kind: NDArray[np.int8]
    amplitude: FloatArray
    period: FloatArray
    stick_fraction: FloatArray
    multiplier: FloatArray
    start: FloatArray
    evaluations: NDArray[np.intp]

    def cycle(self) -> Cycle:
        """The finished result, in the shape of the inputs."""
        kind = restore(self.kind, self.shape)
        return Cycle(
            amplitude=restore(self.amplitude, self.shape),
            period=restore(self.period, self.shape),
            stick_fraction=restore(self.stick_fraction, self.shape),
            multiplier=restore(self.multiplier, self.shape),
            kind=kind if self.shape else tuple(CycleKind)[int(kind)],
            evaluations=restore(self.evaluations, self.shape),
            _bearing=self.bearing,
            _points=(self.speed, self.load),
            _start=self.start,
        )


def _table(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> _Table:
    shape, (v, n) = flatten(speed, load)
    blank = np.full((5, v.size), np.nan)
    return _Table(
        bearing=bearing,
        shape=shape,
        speed=v,
        load=n,
        kind=_kinds(v, n),
        amplitude=blank[0],
        period=blank[1],
        stick_fraction=blank[2],
        multiplier=blank[3],
        start=blank[4],
        evaluations=np.zeros(v.size, dtype=np.intp),
    )


def exact_cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Cycle:
    """The exact stable cycle: stick-slip or, without it, a vibration that never sticks.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        The cycle of every point, ``nan`` with its kind where there is none. About a steady sliding
        that is unstable and leads to no stick-slip it is of kind ``PURE_SLIP``: a measured curve
        may fall over some speeds only. Many points in one call cost far less than one at a time.
    """
    table = _table(bearing, speed, load)
    usable = np.flatnonzero(table.kind == CycleKind.UNRESOLVED)
    speeds = np.abs(table.speed[usable])
    found = stable.stick_slip(bearing, speeds, table.load[usable])
    omega, period = bearing.natural_frequency, found.slip + found.stick
    sticks = np.where(found.start > 0.0, CycleKind.OVERTAKING, CycleKind.STICK_SLIP)
    absent = np.where(found.resolved, CycleKind.NONE, CycleKind.UNRESOLVED)
    table.kind[usable] = np.where(found.exists, sticks, absent)
    table.amplitude[usable] = 0.5 * (found.crest - found.trough) * (speeds / omega)
    table.period[usable] = period / omega
    table.stick_fraction[usable] = found.stick / period
    table.multiplier[usable] = found.multiplier
    table.start[usable] = found.start
    table.evaluations[usable] = found.evaluations
    _add_pure_slip(table, usable[table.kind[usable] == CycleKind.NONE], stable=True)
    return table.cycle()


def exact_unstable_cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Cycle:
    """The exact unstable cycle without stick, which bounds the basin of steady sliding.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        The smallest cycle about a stable steady sliding beyond which disturbances grow; ``nan``
        with its kind where there is none.
    """
    table = _table(bearing, speed, load)
    usable = np.flatnonzero(table.kind == CycleKind.UNRESOLVED)
    table.kind[usable] = CycleKind.NONE
    _add_pure_slip(table, usable, stable=False)
    return table.cycle()


def _add_pure_slip(table: _Table, rows: IndexArray, *, stable: bool) -> None:
    """Fill in the pure-slip cycles of some points without another."""
    if not rows.size:
        return
    speeds, omega = np.abs(table.speed[rows]), table.bearing.natural_frequency
    found = unstable.pure_slip(table.bearing, speeds, table.load[rows], stable=stable)
    table.evaluations[rows] += found.evaluations
    table.kind[rows[~found.resolved]] = CycleKind.UNRESOLVED
    rows, scale, there = rows[found.exists], speeds[found.exists] / omega, found.exists
    table.kind[rows] = CycleKind.PURE_SLIP
    table.amplitude[rows] = 0.5 * (found.trough + found.crest)[there] * scale
    table.period[rows] = found.period[there] / omega
    table.stick_fraction[rows] = 0.0
    table.multiplier[rows] = found.multiplier[there]
    table.start[rows] = found.trough[there]


def exact_fold_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """The exact fold [m/s]: the last speed at which a stick-slip cycle exists.

    Args:
        bearing: The bearing.
        load: Load ``N`` [N].

    Returns:
        ``nan`` where no speed has a stick-slip cycle, ``inf`` where every high speed has one.
    """

    def folds(n: FloatArray) -> FloatArray:
        out = np.full(n.size, np.nan)
        loaded = n > 0.0
        out[loaded] = fold.exact_fold(bearing, n[loaded])
        return out

    return mapped(folds, load)
