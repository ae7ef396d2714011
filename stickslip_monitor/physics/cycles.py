# SPDX-License-Identifier: Apache-2.0
"""The exact cycles of the mass-spring-belt oscillator, and the exact end of sticking over the load.

Nothing is averaged and nothing smoothed. While the lining sticks it moves with the belt; it
breaks away at ``x_0 = (mu_s N - c V)/k`` and slips by

    m x'' + c x' + k x = N mu(V - x')

until ``x' = V`` again. There the set-valued law decides: it sticks while the belt can hold it,
``|k x + c V| <= mu_s N``, and overtakes the belt otherwise. Every stick-slip cycle passes through ``x_0``, so
there is one at most, and whether there is one takes one slip phase. The fold is where that slip phase only
grazes the belt. A lining that overtakes the belt closes where its round has a fixed point. A cycle about
steady sliding is a balance of energy over a turn, followed back in time, where an unstable cycle attracts;
its Floquet multiplier is ``exp`` of the integral of the flow's divergence.

Conventions of every function: inputs broadcast; a 0-d result comes back as a number; ``nan`` says
that there is no such cycle, and the kind says why. Speeds astern mirror speeds ahead.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray, flatten, mapped, restore
from stickslip_monitor.physics import averages_closed_form
from stickslip_monitor.physics.averages_by_quadrature import average_curve
from stickslip_monitor.physics.averaging import averages_of, fold_speed, sticking_end
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.contact import meets_belt
from stickslip_monitor.physics.folds import deciding_fold, exact_fold
from stickslip_monitor.physics.integrator import Drive, MotionState, Phase, integrate
from stickslip_monitor.physics.lubrication import at_points, gives_speed
from stickslip_monitor.physics.numerics import root_on_bracket
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    TURNED,
    Orbits,
    Route,
    SlipField,
    follow,
    slip_field,
)
from stickslip_monitor.physics.scalar_law import law_bounds


class CycleKind(IntEnum):
    """Kinds of cycle at a point; each member carries its sentence."""

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
    AT_FOLD = 8, 'The fold is within 1e-9 of this speed: whether the lining sticks is ill-posed.'
    TOO_UNSTABLE = (
        9,
        'There is an unstable cycle, but a turn multiplies what is off it by more than 1e12:'
        ' double precision does not resolve it.',
    )

    def __str__(self) -> str:
        return self.name.lower()


# Share of a speed within which rounding decides on which side of the fold it is: independent codes part
# there.
_AT_FOLD = 1e-9
# Error of a step of a cycle, relative to the speeds.
_ERROR = 1e-13
# The same of a cycle of which the amplitude alone is wanted: it errs by 1e-11 at most, for two thirds of the
# price.
_ERROR_OF_AMPLITUDE = 1e-11
# The same where the sign of a gain of energy is wanted, and the gain below which the sign takes steps of
# :data:`_ERROR`: 100,000 gains of scattered tables err by 2e-8 at most.
_ERROR_OF_SIGN, _UNSURE_GAIN = 1e-9, 1e-6
# Panels of amplitude in which a sign change of the energy gain is looked for.
_PANELS = 24


class FoundCycles(NamedTuple):
    """Cycles at points, in units of ``V/omega`` and ``1/omega``, each of shape (n,).

    Attributes:
        kind: Numbers of :class:`CycleKind`.
        crest: Highest displacement beyond breakaway; of a ``PURE_SLIP`` cycle it counts from another zero,
            which is that of the trough.
        trough: Lowest one.
        slipping: Time slipping.
        sticking: Time sticking.
        start: Displacement beyond breakaway at which the lining falls behind the belt; of a cycle that never
            reaches the belt's speed its amplitude.
        exponent: Logarithm of the Floquet multiplier; without meaning where it was not wanted.
    """

    kind: FloatArray
    crest: FloatArray
    trough: FloatArray
    slipping: FloatArray
    sticking: FloatArray
    start: FloatArray
    exponent: FloatArray

    @classmethod
    def none(cls, kind: IndexArray) -> FoundCycles:
        """Return rows without a cycle: numbers of :class:`CycleKind` as given, all else ``nan``."""
        return cls(kind.astype(float), *np.full((6, kind.size), np.nan))

    def put(self, rows: IndexArray, part: FoundCycles) -> None:
        """Overwrite the rows of these arrays, in place, with the cycles of ``part``."""
        for column, values in zip(self, part, strict=True):
            column[rows] = values


@dataclass(frozen=True, slots=True)
class Cycle:
    """Limit cycles; every array has the shape of the broadcast inputs, ``nan`` where there is no cycle.

    Attributes:
        amplitude: Half the peak-to-peak displacement [m].
        period: Duration [s].
        stick_fraction: Share of the period in which the lining sticks [-].
        multiplier: Floquet multiplier [-]: 0 with stick, which forgets every disturbance;
            above 1 for an unstable cycle.
        kind: A :class:`CycleKind`, or an array of their numbers.
    """

    amplitude: Any
    period: Any
    stick_fraction: Any
    multiplier: Any
    kind: Any
    _bearing: Bearing = field(repr=False)
    _points: tuple[FloatArray, FloatArray] = field(repr=False)
    _start: FloatArray = field(repr=False)
    _scale: Any = field(default=1.0, repr=False)

    def waveform(self, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return one period of the motion, with both its ends.

        A cycle through the belt's speed begins where the lining falls behind, a pure-slip one
        where it turns to follow the belt. Displacements are counted from the unloaded spring.

        Args:
            count: Number of instants, evenly spaced, >= 2.

        Returns:
            Time [s], displacement [m] and velocity [m/s], each of shape (..., count); ``nan`` unless the kind
            is ``STICK_SLIP``, ``OVERTAKING`` or ``PURE_SLIP``.
        """
        kind = np.ravel(self.kind)
        period = np.ravel(np.asarray(self.period, dtype=float))
        out = np.full((3, kind.size, count), np.nan)
        for i in np.flatnonzero(kind <= CycleKind.PURE_SLIP):
            speed, load = self._points[0][i], self._points[1][i]
            time = np.linspace(0.0, period[i], count)
            drive = Drive.constant(speed, load, float(period[i]))
            slips = kind[i] == CycleKind.PURE_SLIP
            start = _start_state(self._bearing, speed, load, self._start[i], slips)
            motion = integrate(self._bearing, drive, start, time, compiled=False)
            out[:, i] = time, motion.displacement, motion.velocity
        time, x, v = out.reshape(3, *np.shape(self.kind), count)
        scale = np.asarray(self._scale)[..., None]
        return time, scale * x, scale * v


def _start_state(bearing: Bearing, speed: float, load: float, start: float, slips: bool) -> MotionState:
    """Return the state in SI units in which a cycle begins, on its side of the belt.

    Args:
        bearing: The bearing.
        speed: Surface speed, of either sign [m/s].
        load: Load > 0 [N].
        start: The cycle's :attr:`FoundCycles.start` [V/omega].
        slips: Whether the lining never reaches the belt's speed in the cycle.
    """
    field = slip_field(bearing, np.array([abs(speed)]), np.array([load]))
    place = float(field.force[0]) * law_bounds(bearing.friction).hold - field.damping
    place += float(field.steady_displacement()[0]) - start if slips else start
    displacement = math.copysign(1.0, speed) * place * abs(speed) / bearing.natural_frequency
    phase = Phase(int(math.copysign(1.0, speed)))
    return MotionState(displacement, float(speed) if slips else 0.0, phase)


def exact_cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Cycle:
    """Find the exact stable cycle: stick-slip or, without it, a vibration that never sticks.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V``, of either sign [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        The cycle of every point, ``nan`` with its kind where there is none. About a steady sliding
        that is unstable and leads to no stick-slip it is of kind ``PURE_SLIP``: a measured curve
        may fall over some speeds only. Where the kind is ``AT_FOLD`` the numbers, or their
        absence, are those of the side on which rounding put the point.

    >>> cycle = exact_cycle(bearing, bearing.speed.to_surface(20.0, 'rpm'), 1000.0)
    >>> print(cycle.kind, f'{1e3 * cycle.amplitude:.5f} mm')
    stick_slip 0.55676 mm
    """
    return _make_cycle(bearing, speed, load, stable=True)


def exact_unstable_cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Cycle:
    """Find the exact unstable cycle without stick, which bounds the basin of steady sliding.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V``, of either sign [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        The smallest cycle about a stable steady sliding beyond which disturbances grow; ``nan``
        with its kind where there is none, or one that is ``TOO_UNSTABLE``. Of a law that falls at once,
        such as Coulomb's, the swing that grazes the belt: of that kind, with an amplitude and no period.

    >>> cycle = exact_unstable_cycle(bearing, bearing.speed.to_surface(34.0, 'rpm'), 1000.0)
    >>> print(cycle.kind, f'{1e3 * cycle.amplitude:.5f} mm', cycle.multiplier > 1.0)
    pure_slip 0.59282 mm True
    """
    return _make_cycle(bearing, speed, load, stable=False)


@at_points(operator.mul)
def exact_amplitude(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Any:
    """Return the amplitude of the exact stable cycle [m]: that of :func:`exact_cycle` to 1e-10, for less.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V``, of either sign [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        Of the broadcast shape; ``nan`` where there is no cycle, or the steps ran out.

    >>> bearing = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
    >>> round(exact_amplitude(bearing, 0.1, 1000.0) * 1e3, 3)
    0.534
    """
    shape, (v, n) = flatten(speed, load)
    cycles = _find_cycles(bearing, v, n, stable=True, weigh=False)
    stroke = cycles.crest - cycles.trough
    return restore(0.5 * stroke * np.abs(v) / bearing.natural_frequency, shape)


@gives_speed
def exact_fold_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """Return the exact fold [m/s], the end of sticking: the last speed at which the lining sticks.

    A vibration that never sticks may go on beyond it, up to about the averaged fold.

    Args:
        bearing: The bearing.
        load: Load ``N`` [N].

    Returns:
        Shape of ``load``; ``nan`` where no speed has a stick-slip cycle or the load is not finite, ``inf``
        where every high speed has one.

    >>> float(bearing.speed.from_surface(exact_fold_speed(bearing, 1000.0), 'rpm').round(4))
    40.7179
    """

    def folds(n: FloatArray) -> FloatArray:
        """Return the folds at loads [N], shape (n,) [m/s]; ``nan`` without a load."""
        out = np.full(n.size, np.nan)
        loaded = n > 0.0
        one = n.size == 1 and loaded[0]
        out[loaded] = _exact_fold_at(bearing, float(n[0])) if one else exact_fold(bearing, n[loaded])
        return out

    return mapped(folds, load)


@gives_speed
def end_of_vibration(bearing: Bearing, load: ArrayLike) -> Any:
    """Return the fold that decides [m/s]: above this speed no vibration of the lining lasts.

    The exact fold or, where a vibration that never sticks lives on beyond it, the averaged one.

    Args:
        bearing: The bearing.
        load: Load ``N`` [N].

    Returns:
        Shape of ``load``; ``nan`` where no speed has a cycle or the load is not finite, ``inf`` where every
        high speed has one.

    >>> float(bearing.speed.from_surface(end_of_vibration(bearing, 1000.0), 'rpm').round(4))
    40.7179
    """

    def ends(n: FloatArray) -> FloatArray:
        """Return the ends of vibration at loads [N], shape (n,) [m/s]."""
        return deciding_fold(*(fold(bearing, n) for fold in (exact_fold_speed, fold_speed, sticking_end)))

    return mapped(ends, load)


@lru_cache(maxsize=64)
def _exact_fold_at(bearing: Bearing, load: float) -> float:
    """Return the :func:`.exact_fold` at one load > 0 [N]: ``nan`` for none, ``inf`` without an end; cached.

    Points that come one by one have, as a rule, the load of the one before.
    """
    return float(exact_fold(bearing, np.array([load]))[0])


@at_points(lambda cycle, scale: replace(cycle, amplitude=cycle.amplitude * scale, _scale=scale))
def _make_cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike, stable: bool) -> Cycle:
    """Return the stable cycles, or the smallest unstable ones.

    Args:
        bearing: The bearing.
        speed: Surface speed, of either sign [m/s].
        load: Load [N]; broadcasts with ``speed``.
        stable: Which of the two.

    Returns:
        ``nan`` with its kind where there is none; for scalar inputs numbers and a :class:`CycleKind`.
    """
    shape, (v, n) = flatten(speed, load)
    cycles = _find_cycles(bearing, v, n, stable)
    kinds = restore(_decide_kinds(bearing, v, n, cycles, stable).astype(np.int8), shape)
    omega, period = bearing.natural_frequency, cycles.slipping + cycles.sticking
    amplitude = 0.5 * (cycles.crest - cycles.trough) * np.abs(v) / omega
    return Cycle(
        amplitude=restore(amplitude, shape),
        period=restore(period / omega, shape),
        stick_fraction=restore(cycles.sticking / period, shape),
        multiplier=restore(np.exp(np.minimum(cycles.exponent, 700.0)), shape),  # within a float's range
        kind=kinds if shape else tuple(CycleKind)[kinds],
        _bearing=bearing,
        _points=(v, n),
        _start=cycles.start,
    )


def _decide_kinds(
    bearing: Bearing, speed: FloatArray, load: FloatArray, cycles: FoundCycles, stable: bool
) -> FloatArray:
    """Return the kinds of the cycles found, with those that double precision does not decide.

    These are ``TOO_UNSTABLE`` and ``AT_FOLD``. An unstable cycle that only rounding finds, beyond the end of
    every vibration, is taken out of ``cycles``, in place.

    Args:
        bearing: The bearing.
        speed: Surface speeds, of either sign, shape (n,) [m/s].
        load: Loads, shape (n,) [N].
        cycles: The cycles found there, changed in place.
        stable: Whether they are the stable ones; else the smallest unstable ones.
    """
    kind = cycles.kind.copy()
    # Such a multiplier leaves four of sixteen digits in a turn.
    kind[(kind == CycleKind.PURE_SLIP) & (cycles.exponent > math.log(1e12))] = CycleKind.TOO_UNSTABLE
    rows = np.flatnonzero(_no_cycle_kinds(bearing, speed, load) == CycleKind.STICK_SLIP)
    rows = rows[kind[rows] != CycleKind.UNRESOLVED]
    below, above = (
        meets_belt(bearing, np.abs(speed[rows]) * share, load[rows], _ERROR)
        for share in (1.0 - _AT_FOLD, 1.0 + _AT_FOLD)
    )
    if not stable:  # An unstable cycle parts stable sliding from a vibration (Poincare and Bendixson).
        parts = rows[below & above & (kind[rows] == CycleKind.NONE)]
        steady = _slides_steadily(slip_field(bearing, np.abs(speed[parts]), load[parts]))
        kind[parts[steady]] = CycleKind.TOO_UNSTABLE
        beyond = rows[~below & ~above & (kind[rows] == CycleKind.TOO_UNSTABLE)]
        beyond = beyond[~_may_vibrate(bearing, np.abs(speed[beyond]), load[beyond])]
        kind[beyond] = CycleKind.NONE
        cycles.put(beyond, FoundCycles.none(kind[beyond]))
    kind[rows[below != above]] = CycleKind.AT_FOLD
    return kind


def _no_cycle_kinds(bearing: Bearing, speed: FloatArray, load: FloatArray) -> IndexArray:
    """Return the kinds that say why no cycle can exist, ``STICK_SLIP`` where one can.

    Args:
        bearing: The bearing.
        speed: Surface speeds, any numbers, shape (n,) [m/s].
        load: Loads, any numbers, shape (n,) [N].

    Returns:
        Values of :class:`CycleKind`, shape (n,).
    """
    kind = np.full(speed.size, CycleKind.STICK_SLIP)
    momentum = np.sqrt(bearing.mass) * np.sqrt(bearing.stiffness)
    with np.errstate(all='ignore'):
        kind[~(load / np.abs(speed) < 1e150 * momentum)] = CycleKind.UNRESOLVED  # squares would overflow
        # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
        kind[~(load * law_bounds(bearing.friction).fall > bearing.damping)] = CycleKind.NONE
    kind[load <= 0.0] = CycleKind.NO_CONTACT
    kind[speed == 0.0] = CycleKind.AT_REST
    kind[~(np.isfinite(speed) & np.isfinite(load))] = CycleKind.NOT_FINITE
    return kind


def _find_cycles(
    bearing: Bearing, speed: FloatArray, load: FloatArray, stable: bool, weigh: bool = True
) -> FoundCycles:
    """Find the stable cycles, or the smallest unstable ones.

    Args:
        bearing: The bearing.
        speed: Surface speeds, any numbers, shape (n,) [m/s].
        load: Loads, any numbers, shape (n,) [N].
        stable: Whether the stable ones are wanted.
        weigh: Whether the multipliers are wanted; without them the ``exponent`` has no meaning, and the steps
            of cycles through the belt's speed are longer.

    Returns:
        Cycles of shape (n,); where there is none its kind says why, and all else is ``nan``.
    """
    cycles = FoundCycles.none(_no_cycle_kinds(bearing, speed, load))
    rows, size = np.flatnonzero(cycles.kind == CycleKind.STICK_SLIP), 16384
    for first in range(0, rows.size, size):  # in some 10 MB; 4,096 orbits at a time take a third longer
        part = rows[first : first + size]
        with np.errstate(all='ignore'):
            field = slip_field(bearing, np.abs(speed[part]), load[part])
            cycles.put(part, (_find_stable if stable else _find_unstable)(bearing, field, load[part], weigh))
    return cycles


def _find_stable(bearing: Bearing, field: SlipField, load: FloatArray, weigh: bool) -> FoundCycles:
    """Find the cycles that reach the belt's speed and, where there is none, the largest that stay slower.

    The kind is ``NONE`` where there is neither, ``UNRESOLVED`` where the steps ran out. ``field`` is that of
    the linings, ``load`` [N] of its shape; ``weigh`` as of :func:`_find_cycles`.
    """
    cycles = _find_through_belt(field, weigh)
    rest = np.flatnonzero(cycles.kind == CycleKind.NONE)
    undecided = ~_slides_steadily(field.take(rest))
    undecided |= _may_vibrate(bearing, field.speed[rest], load[rest])
    cycles.put(rest[undecided], _find_pure_slip(field.take(rest[undecided]), True, weigh))
    return cycles


def _find_unstable(bearing: Bearing, field: SlipField, load: FloatArray, weigh: bool) -> FoundCycles:
    """Find the smallest unstable cycles about a stable steady sliding.

    The kind is ``NONE`` where there is none, ``UNRESOLVED`` where the steps ran out. Arguments are as of
    :func:`_find_stable`.
    """
    rows = np.flatnonzero(_slides_steadily(field))
    cycles = FoundCycles.none(np.full(load.size, CycleKind.NONE))
    cycles.put(rows, _find_pure_slip(field.take(rows), False, weigh))
    if math.isinf(law_bounds(field.law).fall):
        rows = rows[cycles.kind[rows] == CycleKind.NONE]
        cycles.put(rows, _find_grazing(field.take(rows)))
    return cycles


def _find_grazing(field: SlipField) -> FoundCycles:
    """Return the unstable cycles of a law that falls at once: the orbits that graze the belt.

    They are what the cycles of a law that falls ever faster come to; their multiplier is infinite, and
    their period ``nan``. The kind is ``NONE`` where the orbit does not turn.
    """
    nothing = np.zeros(field.speed.size)
    orbit = follow(field, -field.offset, nothing, Route(2, _ERROR, -1.0))
    kind = np.where(orbit.end == TURNED, float(CycleKind.PURE_SLIP), float(CycleKind.NONE))
    (trough, crest), unknown = orbit.turns, nothing + np.nan
    return FoundCycles(kind, crest, trough, unknown, unknown, unknown, nothing + np.inf)


def _may_vibrate(bearing: Bearing, speed: FloatArray, load: FloatArray) -> BoolArray:
    """Return where a vibration that never sticks may go on beside stable sliding, shape (n,).

    Under averaging it does where ``rho(a; V)`` is above ``c/N`` at some amplitude and falls below
    it up to the sliding limit; of a law whose ``rho`` is highest there, as Stribeck's, nowhere. Averaging is
    right to a tenth up to ``eta`` = 20, so it is True where the highest ``rho`` is above ``0.9 c/N`` and
    ``rho`` is lower again at the limit, be it still above ``c/N``. False for laws with closed forms.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0, shape (n,) [m/s].
        load: Load, shape (n,) [N].
    """
    if averages_of(bearing.friction) is averages_closed_form:
        return np.zeros(speed.size, bool)
    peak, cusp = average_curve(bearing.friction).at(speed)
    return (load * peak > 0.9 * bearing.damping) & (cusp < (1.0 - 1e-4) * peak)


def _slides_steadily(field: SlipField) -> BoolArray:
    """Return where a small disturbance of steady sliding dies out, shape (n,)."""
    growth = -field.force * field.speed * np.asarray(field.law.slope(field.speed))
    return np.asarray(growth < field.damping)


def _stick_stroke(field: SlipField) -> FloatArray:
    """Return the distance from one stick limit to the other, negative, shape (n,) [V/omega]."""
    return -2.0 * field.force * law_bounds(field.law).hold


def _follow_rounds(
    field: SlipField, start: FloatArray, weigh: bool, error: float = _ERROR
) -> tuple[Orbits, FloatArray]:
    """Follow a slip phase behind the belt and, where the lining overtakes the belt, the one ahead of it.

    Args:
        field: What the linings slip in.
        start: Displacements beyond breakaway at which they fall behind the belt, shape (n,) [V/omega].
        weigh: Whether the multiplier is wanted.
        error: Error of a step, relative to the speeds.

    Returns:
        The orbits, ending as the lining falls behind the belt again, with the turns of the first phase; and
        the displacement at which it overtook the belt, ``nan`` where it did not, shape (n,).
    """
    one = follow(field, start, np.zeros(start.size), Route(3, error, contact=True, weigh=weigh))
    stroke, over = _stick_stroke(field), np.full(start.size, np.nan)
    rows = np.flatnonzero((one.end == LANDED) & (one.place < stroke))
    if rows.size:
        over[rows] = one.place[rows]
        # Ahead of the belt the motion is the mirror image about the middle of the stick limits.
        begin = stroke[rows] - one.place[rows]
        route = Route(0, error, contact=True, weigh=weigh)
        ahead = follow(replace(field.take(rows), drift=-1.0), begin, np.zeros(rows.size), route)
        one.end[rows], one.place[rows] = ahead.end, stroke[rows] - ahead.place
        one.time[rows] += ahead.time
        one.divergence[rows] += ahead.divergence
    return one, over


def _find_through_belt(field: SlipField, weigh: bool) -> FoundCycles:
    """Find the stable cycles that reach the belt's speed: stick-slip and overtaking ones.

    Args:
        field: What the linings slip in, n of them.
        weigh: Whether the Floquet multiplier of an overtaking cycle is wanted; else steps are longer.

    Returns:
        Cycles of shape (n,): the kind is ``NONE`` where the slip phase does not return to the belt's
        speed, ``UNRESOLVED`` where its steps ran out or no round of an overtaking cycle closed. A stick-slip
        cycle has the exponent ``-inf``.
    """
    nothing, error = np.zeros(field.speed.size), _ERROR if weigh else _ERROR_OF_AMPLITUDE
    one, over = _follow_rounds(field, nothing, False, error)
    cycles = FoundCycles.none(np.where(one.end == EXHAUSTED, CycleKind.UNRESOLVED, CycleKind.NONE))
    landed = one.end == LANDED
    sticks = landed & ((one.place <= 0.0) | np.isnan(over))
    rows = np.flatnonzero(sticks)
    nothing, sticking = np.zeros(rows.size), np.maximum(-one.place[rows], 0.0)
    (crest, trough), time = one.turns[:, rows], one.time[rows]
    kind, endless = nothing + CycleKind.STICK_SLIP, nothing - np.inf
    cycles.put(rows, FoundCycles(kind, crest, trough, time, sticking, nothing, endless))
    rows = np.flatnonzero(landed & ~sticks)
    if rows.size:
        cycles.put(rows, _find_overtaking(field.take(rows), one.place[rows], weigh))
    return cycles


def _find_overtaking(field: SlipField, first: FloatArray, weigh: bool) -> FoundCycles:
    """Find the cycles that pass the belt's speed twice and never stick: fixed points of a round.

    Orbits do not cross, so the fixed point lies beyond ``first``.

    Args:
        field: What the linings slip in, n of them.
        first: Displacements > 0 at which the round that started at breakaway ended, shape (n,).
        weigh: Whether the Floquet multiplier is wanted; else the ``exponent`` has no meaning.

    Returns:
        Cycles of shape (n,); the kind is ``UNRESOLVED`` where no round closed.
    """

    def gain(start: FloatArray, rows: IndexArray) -> FloatArray:
        """Return by how much a round ends beyond the displacement at which it started [V/omega]."""
        return _follow_rounds(field.take(rows), start, False)[0].place - start

    rows, high, jump = np.arange(first.size), 2.0 * first, field.offset
    top = gain(high, rows)
    for _ in range(40):
        more = np.flatnonzero(top > 0.0)
        if not more.size:
            break
        high[more] *= 4.0
        top[more] = gain(high[more], more)
    start = root_on_bracket(gain, first, high, (gain(first, rows), top), (rows,))
    (one, over), stroke = _follow_rounds(field, start, weigh), _stick_stroke(field)
    # The flow jumps where friction reverses.
    jumps = (over - stroke - jump) / (over + jump)
    jumps *= (start + jump) / (start - stroke - jump)
    nothing = np.zeros(first.size)
    exponent = one.divergence + np.log(np.abs(jumps))
    kind, (crest, trough) = nothing + CycleKind.OVERTAKING, one.turns
    cycles = FoundCycles(kind, crest, trough, one.time, nothing, start, exponent)
    lost = np.flatnonzero((one.end != LANDED) | np.isnan(over))
    cycles.put(lost, FoundCycles.none(np.full(lost.size, CycleKind.UNRESOLVED)))
    return cycles


def _find_pure_slip(field: SlipField, stable: bool, weigh: bool) -> FoundCycles:
    """Find the cycles about steady sliding whose lining never reaches the belt's speed.

    Args:
        field: What the linings slip in, behind the belt.
        stable: Whether the largest stable one is wanted, else the smallest unstable one.
        weigh: Whether its Floquet multiplier is wanted; else the ``exponent`` is 0.

    Returns:
        Cycles of shape (n,), with crest and trough from steady sliding. The kind is ``NONE`` where there is
        none, ``UNRESOLVED`` where the steps ran out.
    """
    slip_cycles = FoundCycles.none(np.full(field.speed.size, CycleKind.NONE))
    # The amplitude of the orbit that grazes the belt, by going back in time from there.
    outer = follow(field, -field.offset, np.zeros(field.speed.size), Route(1, _ERROR, -1.0))
    slip_cycles.kind[outer.end == EXHAUSTED] = CycleKind.UNRESOLVED
    largest = field.steady_displacement() - outer.turns[0]
    rows = np.flatnonzero((outer.end == TURNED) & (largest > 0.0))
    if not rows.size:
        return slip_cycles
    around, largest = field.take(rows).about_steady_sliding(), largest[rows]

    def gain(a: FloatArray, which: IndexArray, error: float = _ERROR) -> FloatArray:
        """Return the relative gain of energy in a turn, > 0 outward; -1 where the orbit does not turn.

        ``a`` are amplitudes [V/omega], ``which`` the rows of ``around`` that they belong to, and ``error``
        that of a step.
        """
        turn = follow(around.take(which), -a, np.zeros(a.size), Route(2, error, -1.0))
        # An orbit that came from far outside has lost energy on the way.
        change = (1.0 + turn.place / a) * (1.0 - turn.place / a)
        change = np.where(turn.end == TURNED, change, -1.0)
        unsure = np.flatnonzero((np.abs(change) < _UNSURE_GAIN) | (turn.end == EXHAUSTED))
        if error > _ERROR and unsure.size:
            change[unsure] = gain(a[unsure], which[unsure])
        return change

    shares = np.append(1e-3 / _PANELS, np.arange(1, _PANELS + 1) / _PANELS)
    grid = largest[:, None] * shares
    # Panel by panel, the outermost first where the outermost change is wanted, until there is one.
    gains, changes = np.full(grid.shape, np.nan), np.zeros((rows.size, _PANELS), bool)
    columns, live = np.arange(_PANELS + 1)[:: -1 if stable else 1], np.arange(rows.size)
    for begin in range(0, _PANELS + 1, 5):  # five amplitudes at a time
        block = columns[begin : begin + 5]
        of_block = gain(grid[np.ix_(live, block)].ravel(), np.repeat(live, block.size), _ERROR_OF_SIGN)
        gains[np.ix_(live, block)] = of_block.reshape(live.size, block.size)
        part = gains[live]
        changes[live] = _find_sign_changes(part, stable)
        gains[live] = part
        live = live[~changes[live].any(axis=1)]
        if not live.size:
            break
    changed = np.flatnonzero(changes.any(axis=1))
    if not changed.size:
        return slip_cycles
    # The outermost change of a stable cycle, the innermost of an unstable one.
    first = np.argmax(changes[changed], axis=1)
    last = _PANELS - 1 - np.argmax(changes[changed, ::-1], axis=1)
    k = last if stable else first
    ends = gains[changed, k], gains[changed, k + 1]
    a = root_on_bracket(gain, grid[changed, k], grid[changed, k + 1], ends, (changed,))
    # The last round in the direction in time in which it attracts.
    nothing, direction = np.zeros(a.size), 1.0 if stable else -1.0
    turn = follow(around.take(changed), -a, nothing, Route(2, _ERROR, direction, weigh=weigh))
    kind = np.where(turn.end == TURNED, float(CycleKind.PURE_SLIP), float(CycleKind.UNRESOLVED))
    time, exponent = direction * turn.time, direction * turn.divergence
    cycles = FoundCycles(kind, turn.turns[0], -a, time, nothing, a, exponent)
    slip_cycles.put(rows[changed], cycles)
    return slip_cycles


def _find_sign_changes(gains: FloatArray, stable: bool) -> BoolArray:
    """Return the panels in which a gain of energy becomes a loss, or for unstable cycles a loss a gain.

    Args:
        gains: Gains at rising amplitudes, shape (n, m). Of unstable cycles a last one that is a loss or gain
            by rounding, after a loss, counts as a change and becomes 0, in place.
        stable: Whether stable cycles are looked for.

    Returns:
        Shape (n, m - 1).
    """
    wanted = 1.0 if stable else -1.0
    changes = (wanted * gains[:, :-1] > 0.0) & (wanted * gains[:, 1:] <= 0.0)
    if not stable:  # close to the fold of a stiff law the cycle is the grazing orbit itself
        grazes = (gains[:, -2] < 0.0) & (np.abs(gains[:, -1]) < 1e-13)
        changes[:, -1] |= grazes
        gains[grazes, -1] = 0.0
    return changes
