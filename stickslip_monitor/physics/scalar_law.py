# SPDX-License-Identifier: Apache-2.0
"""Any friction law as plain functions of one speed, for motions that are followed point by point.

The first four functions call the methods of a law object, for loops that run as they stand. In compiled loops
they are replaced by those of the same name in the law's own module (:func:`stickslip_monitor.jit.compiled`).
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

from stickslip_monitor.physics import friction, friction_pieces
from stickslip_monitor.physics.friction import ALMOST_REST as ALMOST_REST
from stickslip_monitor.physics.friction import Exponential, FrictionLaw, computes_as, speed_scales
from stickslip_monitor.physics.friction_table import Cubics


def friction_drop(law: Any, origin: float, step: float) -> float:
    """Return the fall of friction ``mu(origin) - mu(origin + step)`` while sliding ahead [-].

    Args:
        law: :attr:`LawInUse.numbers` of the friction law.
        origin: Sliding speed at which the step begins [m/s].
        step: Change of the sliding speed [m/s].

    >>> friction_drop(scalar_law(Tabulated([0.0, 1.0], [0.75, 0.25])).plain.numbers, 0.0, 1.0)
    0.5
    """
    return law.drop(origin, step)


def friction_slope(law: Any, speed: float) -> float:
    """Return the slope ``d mu / d|v|`` at a relative speed [s/m]; from the right at 0.

    Args:
        law: :attr:`LawInUse.numbers` of the friction law.
        speed: Relative speed, of either sign [m/s].

    >>> friction_slope(scalar_law(Stribeck(0.5, 0.25, 10.0)).plain.numbers, 0.0)
    -2.5
    """
    return law.slope(speed)


def begin_series(
    law: Any, origin: float, slip: float, unit: float, work: MutableSequence[float]
) -> tuple[float, float, float]:
    """Begin the power series of a law's coefficient in the row of work of :mod:`.series`.

    Args:
        law: :attr:`LawInUse.numbers` of :func:`series_law`.
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
        law: :attr:`LawInUse.numbers` of :func:`series_law`.
        k: The power, > 0; called after :func:`begin_series`, for 1, 2, 3 ... in turn.
        work: The row of work with the relative speed up to that power; written: the law's rows.
    """
    return law.extend(k, work)


class LawInUse(NamedTuple):
    """A law as the loops take it: what its functions are called with, and bounds.

    Attributes:
        numbers: What :func:`friction_drop` and :func:`friction_slope` take; of a :func:`series_law` also
            what :func:`begin_series` and :func:`extend_series` take.
        kinks: Ascending speeds at which the second derivative of ``mu`` jumps [m/s].
        hold: Largest coefficient that sticking can carry [-]: by Filippov's convex hull never less
            than that of slow sliding.
        top: ``mu`` of slow sliding [-].
        fall: Upper bound of ``-d mu / d|v|`` [s/m]; ``inf`` for a law that drops from rest to sliding.
        steepest: Upper bound of ``|d mu / d|v||`` while it slides [s/m].
    """

    numbers: Any
    kinks: Any
    hold: float
    top: float
    fall: float
    steepest: float


class _LawFunctions:
    """Functions of a law without its first argument, as the functions of this module call them.

    Args:
        law: The law.
        module: Its :func:`own_module`, or that of its series; ``None`` for one whose methods are called.
        numbers: What the module's functions take, in arrays or numbers; unused without a module.

    Attributes:
        begin: As :func:`begin_series`; only of a module that has it.
        drop: As :func:`friction_drop`; ``nan`` where it overflows.
        extend: As :func:`extend_series`; only of a module that has it.
        slope: As :func:`friction_slope`.
    """

    __slots__ = ('begin', 'drop', 'extend', 'slope')

    def __init__(self, law: FrictionLaw, module: ModuleType | None, numbers: Any = None) -> None:
        if module is None:
            self.drop: Any = partial(_drop_of, law, float(law.slope(0.0)))
            self.slope: Any = partial(_slope_of, law)
        else:
            columns = (x.tolist() if isinstance(x, np.ndarray) else x for x in numbers)
            law_numbers = type(numbers)(*columns)
            never = getattr(module, 'NEVER_OVERFLOWS', False)
            self.drop = (
                partial(module.friction_drop, law_numbers)
                if never
                else partial(_guard_overflow, module.friction_drop, law_numbers)
            )
            self.slope = partial(module.friction_slope, law_numbers)
            if hasattr(module, 'extend_series'):
                self.begin = partial(module.begin_series, law_numbers)
                self.extend = partial(module.extend_series, law_numbers)


def _guard_overflow(drop: Any, law_numbers: Any, origin: float, step: float) -> float:
    """Return ``drop(law_numbers, origin, step)``; ``nan`` where it overflows, so that the step is refused."""
    try:
        return drop(law_numbers, origin, step)
    except OverflowError:
        return math.nan


def _drop_of(law: FrictionLaw, rise: float, origin: float, step: float) -> float:
    """Return :func:`friction_drop` of a law without functions of its own [-].

    Args:
        law: The law.
        rise: Its slope from the right at rest, by which it is continued below a speed of 0 [s/m].
        origin: Sliding speed at which the step begins [m/s].
        step: Change of the sliding speed [m/s].
    """
    v = origin + step
    top, now = law.coefficient(np.array([max(origin, ALMOST_REST), max(v, ALMOST_REST)])).tolist()
    return top - now - (rise * v if v < 0.0 and math.isfinite(rise) else 0.0)


def _slope_of(law: FrictionLaw, speed: float) -> float:
    """Return :func:`friction_slope` of a law without functions of its own [s/m]."""
    return float(law.slope(speed))


@dataclass(frozen=True, slots=True, eq=False)
class ScalarLaw:
    """A friction law for plain and for compiled loops.

    Attributes:
        plain: For loops that run as they stand.
        compiled: For compiled loops; ``None`` for a law without functions of its own.
        module: The module of these.
    """

    plain: LawInUse
    compiled: LawInUse | None
    module: ModuleType | None

    @property
    def pieces(self) -> int:
        """Number of pieces of a law of :func:`series_law`; 0 for one that is whole."""
        return len(self.compiled.numbers.begin) if self.compiled and self.module is friction_pieces else 0

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the function and arguments by which pickle makes the law again, the module by its name."""
        return _make_scalar_law, (self.plain, self.compiled, self.module and self.module.__name__)


def _make_scalar_law(plain: LawInUse, compiled: LawInUse | None, module: str | None) -> ScalarLaw:
    """Return a law that another process has sent, with its module by name."""
    return ScalarLaw(plain, compiled, None if module is None else import_module(module))


@lru_cache(maxsize=64)
def scalar_law(law: FrictionLaw) -> ScalarLaw:
    """Return a friction law as plain functions of one speed, with its bounds and kinks; cached.

    >>> scalar_law(Stribeck(0.3, 0.1, 10.0)).plain.hold
    0.3
    """
    module = own_module(law)
    kinks = tuple(getattr(law, 'kinks', ())) if module else ()
    top, fall, rise = float(law.coefficient(ALMOST_REST)), _largest_slope(law, -1.0), _largest_slope(law, 1.0)
    drops_from_rest = law.static > top * (1.0 + 1e-15)
    bounds = max(law.static, top), top, math.inf if drops_from_rest else fall, max(fall, rise)
    numbers = None if module is None else getattr(law, 'numbers', None)
    plain = LawInUse(_LawFunctions(law, module, numbers), kinks, *bounds)
    if module is None:
        return ScalarLaw(plain, None, None)
    return ScalarLaw(plain, LawInUse(numbers, np.array(kinks), *bounds), module)


@lru_cache(maxsize=64)
def series_law(law: FrictionLaw) -> ScalarLaw:
    """Return a friction law as :func:`scalar_law` does, with functions that have its power series; cached.

    An exponential law with an exponent of 1 or 2 stays as it is; a table, and any other law, becomes
    polynomials in pieces. Of every law there is a compiled form.
    """
    scalar = scalar_law(law)
    numbers = scalar.compiled.numbers if scalar.compiled else None
    module: ModuleType = friction_pieces
    if isinstance(numbers, Cubics):
        numbers = friction_pieces.pieces_of_cubics(numbers)
    elif isinstance(numbers, Exponential) and numbers.exponent in (1.0, 2.0):
        module = friction
    else:
        numbers = friction_pieces.fit_pieces(law)
    plain = scalar.plain._replace(numbers=_LawFunctions(law, module, numbers))
    return ScalarLaw(plain, scalar.plain._replace(numbers=numbers), module)


def own_module(law: FrictionLaw) -> ModuleType | None:
    """Return the module with a law's ``friction_drop`` and ``friction_slope``, for compiling.

    ``None`` for a law without ``numbers`` or without these functions, one whose subclass computes otherwise,
    and a module without a file.

    >>> own_module(Stribeck(0.3, 0.1, 10.0)).__name__
    'stickslip_monitor.physics.friction'
    """
    kind = next((base for base in type(law).__mro__ if 'numbers' in vars(base)), None)
    if kind is None or not computes_as(law, kind):
        return None
    module = import_module(kind.__module__)
    is_file = getattr(module, '__file__', None) is not None
    return module if is_file and hasattr(module, 'friction_drop') else None


def _largest_slope(law: FrictionLaw, sign: float) -> float:
    """Return the largest ``sign * slope`` between breakpoints and up to four times the last one [s/m].

    Args:
        law: The law.
        sign: 1 for the steepest rise, -1 for the steepest fall.

    Returns:
        A bound, larger by a rounding, without which no cycle might seem possible; 0 where there is no such
        slope, or no breakpoint.
    """
    breaks = speed_scales(law)
    if not breaks:
        return 0.0
    edges = np.array([ALMOST_REST, *breaks, 4.0 * breaks[-1]])
    low, width, largest = edges[:-1], np.diff(edges), 0.0
    share = np.linspace(0.0, 1.0, 65)
    # Each search is a 32nd as wide as the one before: three find a maximum to 1e-10 of its height.
    for _ in range(3):
        places = np.clip(low[:, None] + width[:, None] * share, edges[:-1, None], edges[1:, None])
        slope = sign * np.asarray(law.slope(places))
        largest = max(largest, float(np.max(slope)))
        low = low + width * np.clip(share[np.argmax(slope, axis=1)] - share[1], 0.0, 1.0)
        width = 2.0 * width * share[1]
    return largest * (1.0 + 1e-12)
