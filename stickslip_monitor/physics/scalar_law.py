# SPDX-License-Identifier: Apache-2.0
"""Any friction law as plain functions of one speed, for motions that are followed point by point.

An exponential law with an exponent of 1 or 2 is followed by its formula, a table by its cubics, and any
other by polynomials in pieces that are fitted to it. The first four functions call those of an object, for
loops that run as they stand. In compiled loops they are replaced by those of the same name in the module of
the law's numbers (:func:`stickslip_monitor.jit.compiled`).
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.friction import (
    ALMOST_REST,
    Exponential,
    FrictionLaw,
    computes_as,
    speed_scales,
)
from stickslip_monitor.physics.friction_pieces import Pieces

# Degree of a fitted piece. By 7 the boundaries of a rational law take 2.7 times as many steps and a fourth
# longer, by 15 an eighth less steps and a tenth longer.
_DEGREE = 11
# Halvings of a piece at most: what a law does between neighbouring numbers is left as it is.
_MAX_HALVINGS = 60


def friction_drop(law: Any, origin: float, step: float) -> float:
    """Return the fall of friction ``mu(origin) - mu(origin + step)`` while sliding ahead [-].

    Args:
        law: :class:`LawFunctions`.
        origin: Sliding speed at which the step begins [m/s].
        step: Change of the sliding speed [m/s].

    >>> friction_drop(scalar_law(Tabulated([0.0, 1.0], [0.75, 0.25])).plain, 0.0, 1.0)
    0.5
    """
    return law.drop(origin, step)


def friction_slope(law: Any, speed: float) -> float:
    """Return the slope ``d mu / d|v|`` at a relative speed [s/m]; from the right at 0.

    Args:
        law: :class:`LawFunctions`.
        speed: Relative speed, of either sign [m/s].

    >>> friction_slope(scalar_law(Stribeck(0.5, 0.25, 10.0)).plain, 0.0)
    -2.5
    """
    return law.slope(speed)


def begin_series(
    law: Any, origin: float, slip: float, unit: float, work: MutableSequence[float]
) -> tuple[float, float, float]:
    """Begin the power series of a law's coefficient in the row of work of :mod:`.series`.

    Args:
        law: :class:`LawFunctions`.
        origin: Sliding speed from which the relative speed counts [m/s].
        slip: Relative speed at which the series begins, in units of speed.
        unit: The unit of the relative speed [m/s].
        work: Written: the law's rows.

    Returns:
        The least and the greatest sliding speed at which the series holds [m/s], ``-inf`` and ``inf`` for no
        bound; and the :func:`friction_drop` from the origin to where it begins [-].
    """
    bounds_and_drop: tuple[float, float, float] = law.begin(origin, slip, unit, work)
    return bounds_and_drop


def extend_series(law: Any, k: int, work: MutableSequence[float]) -> float:
    """Return the coefficient of a power of the time in the series of ``mu`` [-].

    Args:
        law: :class:`LawFunctions`.
        k: The power, > 0; called after :func:`begin_series`, for 1, 2, 3 ... in turn.
        work: The row of work with the relative speed up to that power; written: the law's rows.
    """
    return law.extend(k, work)


class LawBounds(NamedTuple):
    """Bounds of a law.

    Attributes:
        kinks: Ascending speeds at which the second derivative of ``mu`` jumps [m/s].
        hold: Largest coefficient that sticking can carry [-]: by Filippov's convex hull never less
            than that of slow sliding.
        top: ``mu`` of slow sliding [-].
        fall: Upper bound of ``-d mu / d|v|`` [s/m]; ``inf`` for a law that drops from rest to sliding.
        steepest: Upper bound of ``|d mu / d|v||`` while it slides [s/m].
    """

    kinks: tuple[float, ...]
    hold: float
    top: float
    fall: float
    steepest: float


@lru_cache(maxsize=64)
def law_bounds(law: FrictionLaw) -> LawBounds:
    """Return the bounds and kinks of a law; cached.

    Slopes are sought up to four times its last scale (:func:`.speed_scales`), beyond which no law may be
    steeper.

    >>> law_bounds(Stribeck(0.3, 0.1, 10.0)).hold
    0.3
    """
    kinks, top = tuple(getattr(law, 'kinks', ())), float(law.coefficient(ALMOST_REST))
    fall, rise = _largest_slope(law, -1.0), _largest_slope(law, 1.0)
    drops_from_rest = law.static > top * (1.0 + 1e-15)
    return LawBounds(kinks, max(law.static, top), top, math.inf if drops_from_rest else fall, max(fall, rise))


class LawFunctions:
    """A law's four functions, bound to its numbers as lists, which are faster than arrays one by one.

    Args:
        numbers: :class:`.Exponential` or :class:`.Pieces`, copied.
        module: The module with the functions of these numbers.

    Attributes:
        begin: As :func:`begin_series`.
        drop: As :func:`friction_drop`.
        extend: As :func:`extend_series`.
        slope: As :func:`friction_slope`.
    """

    __slots__ = ('begin', 'drop', 'extend', 'slope')

    def __init__(self, numbers: Any, module: ModuleType) -> None:
        values = type(numbers)(*(x.tolist() if isinstance(x, np.ndarray) else x for x in numbers))
        self.begin = partial(module.begin_series, values)
        self.drop = partial(module.friction_drop, values)
        self.extend = partial(module.extend_series, values)
        self.slope = partial(module.friction_slope, values)


@dataclass(frozen=True, slots=True, eq=False)
class ScalarLaw:
    """A friction law for plain and for compiled loops.

    Attributes:
        plain: For loops that run as they stand.
        compiled: For compiled loops: its numbers in arrays.
    """

    plain: LawFunctions
    compiled: Exponential | Pieces

    @property
    def module(self) -> ModuleType:
        """The module with the functions of its numbers, for compiling."""
        return import_module(type(self.compiled).__module__)

    @property
    def pieces(self) -> int:
        """Number of pieces; 0 for a law that is whole."""
        return len(self.compiled.begin) if isinstance(self.compiled, Pieces) else 0


@lru_cache(maxsize=64)
def scalar_law(law: FrictionLaw) -> ScalarLaw:
    """Return a friction law as plain functions of one speed, with its power series; cached.

    A law without numbers of its own is fitted, see :func:`fit_pieces`.

    >>> scalar_law(Tabulated([0.0, 0.1, 0.4], [0.30, 0.17, 0.11])).pieces
    3
    """
    numbers = _own_numbers(law)
    if numbers is None:
        numbers = fit_pieces(law)
    return ScalarLaw(LawFunctions(numbers, import_module(type(numbers).__module__)), numbers)


def _own_numbers(law: FrictionLaw) -> Exponential | Pieces | None:
    """Return the numbers that a law states of itself; ``None`` for one that has to be fitted.

    So has an exponential with an exponent other than 1 and 2, and a class that overrides what they describe.
    """
    kind = next((base for base in type(law).__mro__ if 'numbers' in vars(base)), None)
    numbers = getattr(law, 'numbers', None) if kind is not None and computes_as(law, kind) else None
    if isinstance(numbers, Exponential):
        return numbers if numbers.exponent in (1.0, 2.0) else None
    return numbers if isinstance(numbers, Pieces) else None


def fit_pieces(law: FrictionLaw) -> Pieces:
    """Fit pieces to a law's coefficient, to 1e-14 of the largest of a piece or of slow sliding.

    It is evaluated in arrays and fitted between Chebyshev points, and a piece that misses in between is
    halved until it does not. Where the law's own rounding does not allow that the error may be larger. Beyond
    4^20 times its last scale, or from where the coefficient is not finite on, the law goes on as a line.

    >>> fit_pieces(Stribeck(0.3, 0.1, 10.0)).degree
    11
    """

    def coefficient(v: FloatArray) -> FloatArray:
        """Return ``mu`` of sliding at speeds >= 0 [m/s], of their shape: that of slow sliding at 0."""
        return np.asarray(law.coefficient(np.maximum(v, ALMOST_REST)), float)

    breaks = np.array(speed_scales(law) or [1.0])
    edges = np.concatenate([[0.0], breaks, breaks[-1] * 4.0 ** np.arange(1, 21)])
    t = np.cos(np.pi * np.arange(_DEGREE, -1, -1) / _DEGREE)
    between = np.cos(np.pi * (np.arange(_DEGREE, 0, -1) - 0.5) / _DEGREE)
    # In two steps, so that rounding stays that of the values: Chebyshev's series first, then its powers.
    to_series = np.polynomial.chebyshev.chebvander(t, _DEGREE) / _DEGREE
    to_series[1:-1] *= 2.0
    to_series[:, [0, -1]] *= 0.5
    to_powers = np.zeros((_DEGREE + 1, _DEGREE + 1))
    for k in range(_DEGREE + 1):
        to_powers[k, : k + 1] = np.polynomial.chebyshev.cheb2poly(np.eye(k + 1)[k])
    check = np.vander(between, _DEGREE + 1, increasing=True).T
    with np.errstate(all='ignore'):
        edges = edges[np.cumsum(~np.isfinite(coefficient(edges))) == 0]
        top, allowed = float(coefficient(edges[:1])[0]), 1e-14
        low, high, fitted = edges[:-1], edges[1:], []
        for turn in range(_MAX_HALVINGS):
            base, width = 0.5 * (low + high), 0.5 * (high - low)
            values = coefficient(base[:, None] + width[:, None] * t)
            powers = (values @ to_series) @ to_powers
            miss = np.abs(powers @ check - coefficient(base[:, None] + width[:, None] * between)).max(axis=1)
            size = np.maximum(np.abs(values).max(axis=1), top)
            fits = (miss <= allowed * size) | (turn == _MAX_HALVINGS - 1)
            fitted.append(np.column_stack([low, base, width, powers])[fits])
            low, high, base = low[~fits], high[~fits], base[~fits]
            if not low.size:
                break
            low, high = np.concatenate([low, base]), np.concatenate([base, high])
            if low.size > 500:  # so many miss by the law's own rounding
                allowed *= 10.0
        last, slope = float(edges[-1]), float(np.asarray(law.slope(edges[-1])))
    line = np.zeros(_DEGREE + 4)
    line[:5] = last, last, 1.0, float(coefficient(edges[-1:])[0]), slope if math.isfinite(slope) else 0.0
    rows = np.concatenate([*fitted, line[None, :]])
    rows = rows[np.argsort(rows[:, 0])]
    begin, base, width = (np.ascontiguousarray(column) for column in rows[:, :3].T)
    powers = np.ascontiguousarray(rows[:, 3:])
    # The first piece's own value, so that a lining released from the belt feels no fall at once.
    return Pieces(begin, base, width, _DEGREE, float(np.polyval(powers[0, ::-1], -1.0)), powers.ravel())


# Places between two breakpoints of a law at which its slope is looked at, as shares of the way.
_SLOPE_SHARES = np.linspace(0.0, 1.0, 65)


def _slope_edges(law: FrictionLaw) -> FloatArray:
    """Return the speeds between which a law's slope is looked at [m/s], shape (n,); none without a scale."""
    breaks = speed_scales(law)
    return np.array([ALMOST_REST, *breaks, 4.0 * breaks[-1]] if breaks else [])


@lru_cache(maxsize=64)
def _slope_course(law: FrictionLaw) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rising speeds, and the least slope from each on and the largest up to each; cached.

    Returns:
        Speeds [m/s], and slopes [s/m], shape (n,) each, n > 0; the last slope is that of all higher speeds.
    """
    edges = _slope_edges(law)
    speed = np.append(0.0, (edges[:-1, None] + np.diff(edges)[:, None] * _SLOPE_SHARES).ravel())
    slope = np.asarray(law.slope(speed))
    return speed, np.minimum.accumulate(slope[::-1])[::-1], np.maximum.accumulate(slope)


def least_slopes_beyond(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Return the least slope of a law from each speed >= 0 [m/s] on, shape of ``speed`` [s/m]."""
    places, least_slope, _ = _slope_course(law)
    return least_slope[np.searchsorted(places, speed, side='right') - 1]


def largest_slopes_below(law: FrictionLaw, speed: FloatArray) -> FloatArray:
    """Return the largest slope of a law up to each speed >= 0 [m/s], shape of ``speed`` [s/m]."""
    places, _, largest_slope = _slope_course(law)
    return largest_slope[np.minimum(np.searchsorted(places, speed), places.size - 1)]


def _largest_slope(law: FrictionLaw, sign: float) -> float:
    """Return the largest ``sign * slope`` between breakpoints and up to four times the last one [s/m].

    Args:
        law: The law.
        sign: 1 for the steepest rise, -1 for the steepest fall.

    Returns:
        A bound, larger by a rounding, without which no cycle might seem possible; 0 where there is no such
        slope, or no breakpoint.
    """
    edges, share = _slope_edges(law), _SLOPE_SHARES
    low, width, largest = edges[:-1], np.diff(edges), 0.0
    # Each search is a 32nd as wide as the one before: three find a maximum to 1e-10 of its height.
    for _ in range(3 if low.size else 0):
        places = np.clip(low[:, None] + width[:, None] * share, edges[:-1, None], edges[1:, None])
        slope = sign * np.asarray(law.slope(places))
        largest = max(largest, float(np.max(slope)))
        low = low + width * np.clip(share[np.argmax(slope, axis=1)] - share[1], 0.0, 1.0)
        width = 2.0 * width * share[1]
    return largest * (1.0 + 1e-12)
