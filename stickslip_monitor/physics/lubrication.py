# SPDX-License-Identifier: Apache-2.0
"""Friction at another load or water temperature than those at which it was measured.

Friction of a lubricated bearing is a function of speed times viscosity over load (R. Stribeck, Z. VDI
46, 1902; M. D. Hersey, J. Wash. Acad. Sci. 4, 1914). A law ``mu(v)`` measured at the load ``N0`` and the
temperature ``T0`` is ``mu(v/s)`` elsewhere, with

    ``s = (N/N0)^g eta(T0)/eta(T)``

and an exponent ``g`` of the load: 0 where the load does not matter, 1 where all of it does. With
``V = s V'``, ``N = s N'`` and ``x = s x'`` the equation of motion is that of the law as measured, at the
*reference point* ``(V', N')``. So every speed and amplitude at ``(V, N)`` is ``s`` times that at
``(V', N')``, and growth rates, periods, shares of sticking and multipliers are the same. The functions here
take other functions of the room to such a point; a bearing without a :class:`Lubrication` does not pass here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, wraps
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray, mapped
from stickslip_monitor.errors import PhysicsError, require_finite, require_positive
from stickslip_monitor.physics.numerics import root_on_bracket

SEA = 35.0
"""Salinity of the oceans [g/kg]."""
MIN_TEMPERATURE, MAX_TEMPERATURE = -2.0, 60.0
"""Temperatures of water that are accepted [C]: sea water freezes at the one; the formula holds up to 180."""
MAX_SALINITY = 100.0
"""Largest salinity that is accepted [g/kg]: no navigable water has it; the formula holds up to 150."""
MAX_SURFACE_SPEED = 1e4
"""Speed up to which the load of a boundary is sought: beyond that of any journal's surface [m/s]."""
# The logarithm of a load beyond any number.
_MAX_LOG_LOAD = 700.0


def viscosity(temperature: Any, salinity: float = SEA) -> Any:
    """Return the dynamic viscosity of water [Pa s], of the shape of ``temperature``, to 1.5 %.

    M. H. Sharqawy, J. H. Lienhard and S. M. Zubair, Desalination and Water Treatment 16, 2010, equations 22
    and 23. Plain arithmetic, for numbers and arrays and for compiled loops; no temperature is refused.

    Args:
        temperature: Of the water [C].
        salinity: Of the water [g/kg]; 0 for fresh water.

    >>> f'{1e3 * viscosity(20.0, 0.0):.3f} {1e3 * viscosity(20.0):.3f} mPa s'
    '1.002 1.077 mPa s'
    """
    t, s = temperature, 1e-3 * salinity
    warm = t + 64.993
    fresh = 4.2844e-5 + 1.0 / (0.157 * warm * warm - 91.296)
    by_salt = 1.541 + 1.998e-2 * t - 9.52e-5 * t * t
    by_square = 7.974 - 7.561e-2 * t + 4.724e-4 * t * t
    return fresh * (1.0 + by_salt * s + by_square * s * s)


@dataclass(frozen=True, slots=True)
class Lubrication:
    """The load and the water at which the friction of a bearing was measured, and the present water.

    Args:
        load: ``N0`` > 0 [N]; of no matter without an exponent.
        load_exponent: ``g``, 0 to 1.
        temperature: ``T0`` of the water at the measurement [C]; ``nan`` where it is not known.
        salinity: Of the water at the measurement [g/kg].
        water_salinity: Of the present water [g/kg].
        viscosity_ratio: ``eta(T)/eta(T0)`` > 0 of the present water: it counts, and not the temperatures.
        water_temperature: ``T`` of the present water [C]; ``nan`` where it is that of the measurement.

    Raises:
        PhysicsError: The load, the exponent or the viscosity ratio breaks its rule; the water is not checked.

    >>> Lubrication(1000.0, 1.0, 15.0).scale(4000.0)
    4.0
    """

    load: float = 1.0
    load_exponent: float = 0.0
    temperature: float = math.nan
    salinity: float = SEA
    water_salinity: float = SEA
    viscosity_ratio: float = 1.0
    water_temperature: float = math.nan

    def __post_init__(self) -> None:
        require_positive('friction.at_load', self.load, 'N')
        require_finite('friction.load_exponent', self.load_exponent)
        if not 0.0 <= self.load_exponent <= 1.0:
            raise PhysicsError(f'friction.load_exponent = {self.load_exponent:g} must be from 0 to 1')
        require_positive('viscosity_ratio', self.viscosity_ratio)

    def ratio_at(self, temperature: Any) -> Any:
        """Return ``eta(T)/eta(T0)`` at temperatures [C], of their shape; for ``None`` the ratio in use.

        ``nan`` where the temperature of the measurement is not known.
        """
        if temperature is None:
            return self.viscosity_ratio
        return viscosity(temperature, self.water_salinity) / viscosity(self.temperature, self.salinity)

    def in_water(self, temperature: float) -> Lubrication:
        """Return a copy for water of another temperature [C], with the viscosity ratio there.

        Raises:
            PhysicsError: The temperature of the measurement is not known, or water of this one has no
                viscosity above 0.
        """
        ratio = float(self.ratio_at(temperature))
        return replace(self, viscosity_ratio=ratio, water_temperature=float(temperature))

    def scale(self, load: Any, temperature: Any = None) -> Any:
        """Return ``s = (N/N0)^g eta(T0)/eta(T)`` [-], the factor of speeds and amplitudes.

        Args:
            load: Loads [N]: a number or an array; one that is not positive counts as ``N0``.
            temperature: Of the water [C], broadcasts with ``load``; ``None`` for the viscosity ratio in use.

        Returns:
            A float for a float, else an array of the broadcast shape; ``nan`` at a temperature, if that of
            the measurement is not known.
        """
        if isinstance(load, float) and not isinstance(temperature, np.ndarray):
            return scale_at(self.load, self.load_exponent, float(self.ratio_at(temperature)), load)
        n = np.asarray(load, dtype=float)
        with np.errstate(all='ignore'):
            relative = np.where(n > 0.0, n / self.load, 1.0)
            return relative**self.load_exponent / self.ratio_at(temperature)


def scale_at(at_load: float, exponent: float, viscosity_ratio: float, load: float) -> float:
    """Return ``s`` of one load, as :meth:`Lubrication.scale`.

    Args:
        at_load: ``N0`` [N].
        exponent: ``g``.
        viscosity_ratio: ``eta(T)/eta(T0)``.
        load: Load [N]; one that is not positive counts as ``N0``.
    """
    if exponent == 0.0 or not load > 0.0:
        return 1.0 / viscosity_ratio
    scale: float = (load / at_load) ** exponent / viscosity_ratio
    return scale


class Lubricated(Protocol):
    """A bearing, which is built on this module."""

    @property
    def lubrication(self) -> Lubrication | None:
        """The load and the water at which friction was measured."""


_Bearing = TypeVar('_Bearing', bound=Lubricated)
_Function = TypeVar('_Function', bound=Callable[..., Any])


def as_measured(bearing: _Bearing) -> _Bearing:
    """Return the bearing without lubrication: friction as measured at any load and temperature; cached."""
    if bearing.lubrication is None:
        return bearing
    return cast(_Bearing, _without_lubrication(cast(Any, bearing)))


@lru_cache(maxsize=64)
def _without_lubrication(bearing: Any) -> Any:
    """Return a copy of a bearing without lubrication; cached."""
    return replace(bearing, lubrication=None)


def gives_speed(function: _Function) -> _Function:
    """Decorate ``function(bearing, load)``, a boundary [m/s], so that it follows the lubrication."""

    @wraps(function)
    def scaled(bearing: Lubricated, load: ArrayLike) -> Any:
        """Return the boundary [m/s] at loads [N], of their shape, by :func:`speed_over_load`."""
        return speed_over_load(bearing, lambda n: function(as_measured(bearing), n), load)

    return cast(_Function, scaled)


def speed_over_load(bearing: Lubricated, boundary: Callable[[Any], Any], load: Any) -> Any:
    """Return a boundary [m/s] at loads [N], of their shape, with lubrication: ``s V_b(N/s)``.

    Args:
        bearing: The bearing; without lubrication ``boundary`` applies unchanged.
        boundary: Function of loads [N] to ``V_b`` [m/s], for friction as measured.
        load: Loads [N].
    """
    if bearing.lubrication is None:
        return boundary(load)
    s = bearing.lubrication.scale(load)
    with np.errstate(all='ignore'):
        return s * boundary(np.asarray(load, float) / s if np.ndim(load) else float(load) / s)


def at_points(rescale: Callable[[Any, Any], Any]) -> Callable[[_Function], _Function]:
    """Return a decorator that lets ``function(bearing, speed, load, ...)`` follow the lubrication.

    The decorated function calls ``function`` at the reference point ``(V/s, N/s)`` with the bearing as
    measured and rescales its result; without :class:`Lubrication` it calls ``function`` unchanged.

    Args:
        rescale: Function of a result at the reference point and ``s``, to the result at the point itself.
    """

    def decorate(function: _Function) -> _Function:
        """Wrap ``function``, so that it follows the lubrication."""

        @wraps(function)
        def scaled(bearing: Lubricated, speed: ArrayLike, load: ArrayLike, *args: Any, **more: Any) -> Any:
            """Call the function at the reference point and rescale; unchanged without lubrication."""
            if bearing.lubrication is None:
                return function(bearing, speed, load, *args, **more)
            v, n, s = reference_point(bearing, speed, load)
            return rescale(function(as_measured(bearing), v, n, *args, **more), s)

        return cast(_Function, scaled)

    return decorate


def reference_point(
    bearing: Lubricated, speed: Any, load: Any, temperature: Any = None
) -> tuple[Any, Any, Any]:
    """Return ``V/s``, ``N/s`` and ``s`` of points; without lubrication the point itself, as given, and 1.

    ``s`` has the broadcast shape of ``load`` and ``temperature``, and so has ``N/s``; ``V/s`` broadcasts with
    ``speed``, too. They are floats for numbers.

    Args:
        bearing: The bearing.
        speed: Surface speeds [m/s].
        load: Loads [N].
        temperature: Of the water [C]; ``None`` for the temperature in use.
    """
    if bearing.lubrication is None:
        return speed, load, 1.0
    s = bearing.lubrication.scale(load if np.ndim(load) else float(load), temperature)
    with np.errstate(all='ignore'):
        return np.divide(speed, s), np.divide(load, s), s


def gives_load(function: _Function) -> _Function:
    """Decorate ``function(bearing, speed)``, a boundary's load [N], so that it follows the lubrication.

    It has to return the *least* load, and has the sentinels, of :func:`load_over_speed`; without lubrication
    its result is returned as it is.
    """

    @wraps(function)
    def scaled(bearing: Lubricated, speed: ArrayLike) -> Any:
        """Return the loads [N] at speeds [m/s], of their shape, by :func:`load_over_speed`.

        Without lubrication they are those of ``function``.
        """
        lubrication = bearing.lubrication
        if lubrication is None:
            return function(bearing, speed)
        return load_over_speed(
            lubrication, lambda v: function(as_measured(bearing), v), speed, lubrication.viscosity_ratio
        )

    return cast(_Function, scaled)


def load_over_speed(
    lubrication: Lubrication,
    boundary: Callable[[FloatArray], Any],
    speed: ArrayLike,
    viscosity_ratio: ArrayLike,
) -> Any:
    """Return the least load [N] at which a point lies within a boundary.

    Args:
        lubrication: The lubrication.
        boundary: Function of speeds [m/s] to the least load [N] within it, for friction as measured;
            ``nan`` or ``inf`` where no load is.
        speed: Surface speeds [m/s].
        viscosity_ratio: ``eta(T)/eta(T0)`` at each.

    Returns:
        Shape of the broadcast inputs; ``nan`` where no load is within it, 0 where every load is. With a
        load exponent of 0 the values of ``boundary`` pass through, scaled; for others, speeds up to 1e-6 m/s
        count as that.
    """
    g = lubrication.load_exponent
    if g == 0.0:
        return mapped(lambda v, e: np.asarray(boundary(v * e)) / e, speed, viscosity_ratio)
    # Reference speeds: 40 rows an e-fold keep two crossings apart that a table 1 % wide has.
    lowest, highest = math.log(1e-9), math.log(MAX_SURFACE_SPEED)
    size = math.ceil((highest - lowest) * 40)
    grid = np.linspace(lowest, highest, size)

    def log_boundary(at: FloatArray) -> FloatArray:
        """Return ``ln N`` of the boundary at ``ln V``, of its shape; ``inf`` where no load is within it."""
        with np.errstate(all='ignore'):
            load = np.log(np.asarray(boundary(np.exp(at)), dtype=float))
        return np.where(np.isnan(load), np.inf, load)

    def within(at: FloatArray, log_load: FloatArray) -> FloatArray:
        """Return by how much ``ln N'`` is above the boundary where the reference speed is ``exp(at)``."""
        return log_load - (1.0 / g - 1.0) * at - np.clip(log_boundary(at), -_MAX_LOG_LOAD, _MAX_LOG_LOAD)

    log_loads = np.clip(log_boundary(grid), -_MAX_LOG_LOAD, _MAX_LOG_LOAD)

    def loads(v: FloatArray, ratio: FloatArray) -> FloatArray:
        """Return the least loads [N] at speeds [m/s] and ratios of viscosity, shape (n,) each."""
        # s = V/V', and N = N0 (s ratio)^(1/g): the faster the reference point, the less the load.
        log_v = np.log(np.maximum(np.abs(v), 1e-6))
        log_load = math.log(lubrication.load) + np.log(ratio) / g + (1.0 / g - 1.0) * log_v
        above = log_load[:, None] - (1.0 / g - 1.0) * grid - log_loads > 0.0
        last = size - 1 - np.argmax(above[:, ::-1], axis=1)
        is_found = above.any(axis=1)
        low, high = grid[last], grid[np.minimum(last + 1, size - 1)]
        ends = within(low, log_load), within(high, log_load)
        at = np.where(last == size - 1, high, root_on_bracket(within, low, high, ends, [log_load]))
        load = lubrication.load * np.exp((log_v - at + np.log(ratio)) / g)
        load = np.where(last == size - 1, 0.0, load)  # whatever the load: nothing damps
        return np.where(is_found, load, np.nan)

    return mapped(loads, speed, viscosity_ratio)
