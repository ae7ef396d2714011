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

import math
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor import jit
from stickslip_monitor.arrays import BoolArray, FloatArray, flatten, mapped, restore
from stickslip_monitor.physics import roots, scalar_law, slip, slip_step
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.folds import exact_fold
from stickslip_monitor.physics.integrator import Drive, MotionState, Phase, integrate
from stickslip_monitor.physics.many_cycles import (
    FoundCycles,
    amplitudes_together,
    cycles_together,
    may_vibrate,
    put_cycles,
    reach_belt,
    slides_steadily,
    why_no_cycles,
)
from stickslip_monitor.physics.orbits import slip_field


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
    AT_FOLD = 8, 'The fold is within 1e-9 of this speed: whether the lining sticks is ill-posed.'
    TOO_UNSTABLE = (
        9,
        'There is an unstable cycle, but a turn multiplies what is off it by more than 1e12:'
        ' double precision does not resolve it.',
    )

    def __str__(self) -> str:
        return self.name.lower()


# Points from which arrays cost less than one point after another: those cost 0.5 ms for a stable
# cycle and 13 ms for an unstable one, arrays 12 and 75 ms whatever they hold.
_MANY_STABLE, _MANY_UNSTABLE = 24, 8
# Modules that are compiled together.
_MODULES = (scalar_law, roots, slip_step, slip)
# Share of a speed within which rounding decides on which side of the fold it is: independent
# codes part there. And the logarithm of a multiplier that leaves four of sixteen digits in a turn.
_AT_FOLD, _UNSTABLE = 1e-9, math.log(1e12)
# Exponent beyond which a Floquet multiplier is as good as infinite.
_LARGEST = 700.0


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
    """

    amplitude: Any
    period: Any
    stick_fraction: Any
    multiplier: Any
    kind: Any
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
            where there is no cycle, or none that a motion stays on.
        """
        kind = np.ravel(self.kind)
        period = np.ravel(np.asarray(self.period, dtype=float))
        out = np.full((3, kind.size, count), np.nan)
        for i in np.flatnonzero(kind <= CycleKind.PURE_SLIP):
            speed, load = self._points[0][i], self._points[1][i]
            time = np.linspace(0.0, period[i], count)
            drive = Drive.constant(speed, load, float(period[i]))
            slips = kind[i] == CycleKind.PURE_SLIP
            start = _beginning(self._bearing, speed, load, self._start[i], slips)
            motion = integrate(self._bearing, drive, start, time, compiled=False)
            out[:, i] = time, motion.displacement, motion.velocity
        time, x, v = out.reshape(3, *np.shape(self.kind), count)
        return time, x, v


def _beginning(bearing: Bearing, speed: float, load: float, start: float, slips: bool) -> MotionState:
    """The state in which a cycle begins, from the place in :class:`.FoundCycles`."""
    field = slip_field(bearing, np.array([abs(speed)]), np.array([load]))
    place = float(field.force[0]) * scalar_law.highest_static(bearing.friction) - field.damping
    place += float(field.rest()[0]) - start if slips else start
    displacement = math.copysign(1.0, speed) * place * abs(speed) / bearing.natural_frequency
    phase = Phase(int(math.copysign(1.0, speed)))
    return MotionState(displacement, float(speed) if slips else 0.0, phase)


def _found(bearing: Bearing, speed: FloatArray, load: FloatArray, stable: bool) -> FoundCycles:
    """What is found at points, each shape (n,): one after another where there are few."""
    if speed.size >= (_MANY_STABLE if stable else _MANY_UNSTABLE):
        return cycles_together(bearing, speed, load, stable)
    wanted = slip.LARGEST_STABLE if stable else slip.SMALLEST_UNSTABLE
    found = _one_by_one(bearing, speed, load, wanted)
    rows = np.flatnonzero(stable & (found.kind == CycleKind.NONE))
    rows = rows[may_vibrate(bearing, speed[rows], load[rows])]
    put_cycles(found, rows, _one_by_one(bearing, speed[rows], load[rows], slip.BESIDE_STABLE))
    return found


def _one_by_one(bearing: Bearing, speed: FloatArray, load: FloatArray, wanted: float) -> FoundCycles:
    law, body = scalar_law.scalar_law(bearing.friction), _body(bearing)
    columns = np.full((7, speed.size), np.nan).tolist()
    slip.cycles_of_points(law.plain, body, speed.tolist(), load.tolist(), wanted, columns)
    return FoundCycles(*np.array(columns).reshape(7, -1))


def _decided(
    bearing: Bearing, speed: FloatArray, load: FloatArray, found: FoundCycles, stable: bool
) -> FloatArray:
    """The kinds of what is found, with those that double precision does not decide."""
    kind = found.kind.copy()
    kind[(kind == CycleKind.PURE_SLIP) & (found.exponent > _UNSTABLE)] = CycleKind.TOO_UNSTABLE
    rows = np.flatnonzero(why_no_cycles(bearing, speed, load) == CycleKind.STICK_SLIP)
    rows = rows[kind[rows] != CycleKind.UNRESOLVED]
    below, above = (
        _reaches_belt(bearing, speed[rows] * share, load[rows]) for share in (1.0 - _AT_FOLD, 1.0 + _AT_FOLD)
    )
    if not stable:  # something has to part stable sliding from stick-slip (Poincare and Bendixson)
        parts = rows[below & above & (kind[rows] == CycleKind.NONE)]
        steady = slides_steadily(slip_field(bearing, np.abs(speed[parts]), load[parts]))
        kind[parts[steady]] = CycleKind.TOO_UNSTABLE
    kind[rows[below != above]] = CycleKind.AT_FOLD
    return kind


def _reaches_belt(bearing: Bearing, speed: FloatArray, load: FloatArray) -> BoolArray:
    if speed.size >= _MANY_STABLE:
        return reach_belt(bearing, speed, load)
    law, body = scalar_law.scalar_law(bearing.friction), _body(bearing)
    points = zip(speed.tolist(), load.tolist(), strict=True)
    return np.array([slip.reaches_belt(law.plain, body, *point) for point in points], bool)


def _body(bearing: Bearing) -> slip.Oscillator:
    return slip.Oscillator(float(bearing.mass), float(bearing.damping), float(bearing.stiffness))


def _amplitudes(bearing: Bearing, speed: FloatArray, found: FoundCycles) -> FloatArray:
    amplitude: FloatArray = 0.5 * (found.crest - found.trough) * np.abs(speed)
    return amplitude / bearing.natural_frequency


def _cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike, stable: bool) -> Cycle:
    shape, (v, n) = flatten(speed, load)
    found = _found(bearing, v, n, stable)
    omega, period = bearing.natural_frequency, found.slipping + found.sticking
    kinds = restore(_decided(bearing, v, n, found, stable).astype(np.int8), shape)
    return Cycle(
        amplitude=restore(_amplitudes(bearing, v, found), shape),
        period=restore(period / omega, shape),
        stick_fraction=restore(found.sticking / period, shape),
        multiplier=restore(np.exp(np.minimum(found.exponent, _LARGEST)), shape),
        kind=kinds if shape else tuple(CycleKind)[kinds],
        _bearing=bearing,
        _points=(v, n),
        _start=found.start,
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
        may fall over some speeds only. Where the kind is ``AT_FOLD`` the numbers, or their
        absence, are those of the side on which rounding put the point.
    """
    return _cycle(bearing, speed, load, stable=True)


def exact_unstable_cycle(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Cycle:
    """The exact unstable cycle without stick, which bounds the basin of steady sliding.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        The smallest cycle about a stable steady sliding beyond which disturbances grow; ``nan``
        with its kind where there is none, or one that is ``TOO_UNSTABLE``.
    """
    return _cycle(bearing, speed, load, stable=False)


def exact_amplitude(bearing: Bearing, speed: ArrayLike, load: ArrayLike, many: bool = False) -> Any:
    """Amplitude of the exact stable cycle [m], that of :func:`exact_cycle`; ``nan`` without one.

    Of many points it is right to 1e-9, at half the price.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` [m/s].
        load: Load ``N`` [N]; broadcasts with ``speed``.
        many: Whether many more numbers follow, so that it pays to compile.
    """
    if isinstance(speed, float) and isinstance(load, float):
        law, body = scalar_law.scalar_law(bearing.friction), _body(bearing)
        loop: Any = slip.amplitude_of_cycle
        own: Any = law.plain
        if many and law.module and jit.has_compiler():
            own = law.compiled
            loop = jit.compiled('amplitude_of_cycle', *_MODULES, law=law.module, inline=False)
        amplitude = loop(own, body, speed, load, slip.LARGEST_STABLE)
        none = amplitude != amplitude
        if none and may_vibrate(bearing, np.array([speed]), np.array([load]))[0]:
            return loop(own, body, speed, load, slip.BESIDE_STABLE)
        return amplitude
    shape, (v, n) = flatten(speed, load)
    if v.size >= _MANY_STABLE:
        return restore(amplitudes_together(bearing, v, n), shape)
    return restore(_amplitudes(bearing, v, _found(bearing, v, n, stable=True)), shape)


def exact_fold_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """The exact fold [m/s], the end of sticking: the last speed at which the lining sticks.

    A vibration that never sticks may go on beyond it, up to about the averaged fold.

    Args:
        bearing: The bearing.
        load: Load ``N`` [N].

    Returns:
        ``nan`` where no speed has a stick-slip cycle, ``inf`` where every high speed has one.
    """

    def folds(n: FloatArray) -> FloatArray:
        out = np.full(n.size, np.nan)
        loaded = n > 0.0
        one = n.size == 1 and loaded[0]
        out[loaded] = _fold(bearing, float(n[0])) if one else exact_fold(bearing, n[loaded])
        return out

    return mapped(folds, load)


@lru_cache(maxsize=64)
def _fold(bearing: Bearing, load: float) -> float:
    """The exact fold; points one by one come at the load of the one before as a rule."""
    return float(exact_fold(bearing, np.array([load]))[0])
