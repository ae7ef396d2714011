# SPDX-License-Identifier: Apache-2.0
"""A measured friction curve as a friction law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, require_finite, require_not_negative
from stickslip_monitor.physics.friction_pieces import Pieces
from stickslip_monitor.physics.numerics import hermite_cubics, monotone_slopes


@dataclass(frozen=True, slots=True)
class Tabulated:
    """A measured friction curve, joined by a monotone cubic interpolant (:func:`.monotone_slopes`).

    Below the first and above the last measured speed the coefficient stays at its end value, so
    nothing is claimed that was not measured.

    Args:
        speed: At least two relative speeds, >= 0 and strictly rising, shape (n,) [m/s].
        coefficient: The coefficients measured there, >= 0, shape (n,) [-].

    Attributes:
        values: The coefficients.
        cubics: The cubic of each interval in the distance from its begin, highest power first,
            shape (4, n - 1).

    Raises:
        PhysicsError: A column breaks its rule, or the curve is too steep for a finite slope.

    >>> Tabulated([0.0, 0.1, 0.4], [0.30, 0.17, 0.11]).coefficient([0.1, 2.0]).tolist()
    [0.17, 0.11]
    """

    speed: tuple[float, ...]
    values: tuple[float, ...]
    cubics: FloatArray = field(init=False, repr=False, compare=False)
    _begins: FloatArray = field(init=False, repr=False, compare=False)
    _rises: FloatArray = field(init=False, repr=False, compare=False)

    def __init__(self, speed: Sequence[float], coefficient: Sequence[float]) -> None:
        v = _table_column('speed', speed)
        mu = _table_column('coefficient', coefficient)
        if len(v) != len(mu):
            raise PhysicsError(
                f'friction table has {len(v)} speeds and {len(mu)} coefficients: give one'
                ' coefficient for each speed'
            )
        if len(v) < 2:
            raise PhysicsError(f'friction table has {len(v)} point: give at least two')
        falling = np.flatnonzero(np.diff(v) <= 0.0)
        if falling.size:
            index = int(falling[0])
            raise PhysicsError(
                f'friction table speed[{index + 1}] = {v[index + 1]:g} m/s does not exceed'
                f' speed[{index}] = {v[index]:g} m/s: speeds must rise strictly'
            )
        for name, value in (
            ('speed', v),
            ('values', mu),
            ('cubics', _monotone_cubics(v, mu)),
            ('_begins', np.array(v[:-1])),
            ('_rises', np.sign(np.diff(mu))),
        ):
            object.__setattr__(self, name, value)

    @property
    def static(self) -> float:
        """The coefficient at the slowest measured speed [-]."""
        return self.values[0]

    @property
    def kinks(self) -> tuple[float, ...]:
        """Speeds at which the second derivative of the coefficient jumps: the measured ones."""
        return self.breakpoints

    @property
    def numbers(self) -> Pieces:
        """The cubics in the distance from where each begins, for the loops; made anew at each call.

        The last one is level; a table that begins above zero speed has a level one before its first.
        """
        begins, flat = np.array(self.speed), np.zeros((4, 1))
        cubics = np.hstack([self.cubics[::-1], np.vstack([self.values[-1], flat[1:]])])
        if begins[0] > 0.0:
            first = np.vstack([self.values[0], flat[1:]])
            begins, cubics = np.append(0.0, begins), np.hstack([first, cubics])
        return Pieces(begins, begins, np.ones(begins.size), 3, self.values[0], cubics.T.ravel())

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The measured speeds, where the interpolant changes from one cubic to the next."""
        return tuple(v for v in self.speed if v > 0.0)

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Return ``mu`` at relative speeds [m/s], of their shape and sign [-]: above 0 at 0, level beyond."""
        v = np.asarray(speed, dtype=float)
        i, s = self._find_interval(np.minimum(np.maximum(np.abs(v), self.speed[0]), self.speed[-1]))
        a, b, c, d = self.cubics[:, i]
        value: FloatArray = ((a * s + b) * s + c) * s + d
        # At v = 0 the positive end, whatever the sign of zero.
        return np.copysign(value, v + 0.0)

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Return ``d mu / d|v|`` at relative speeds [m/s], of their shape [s/m]; 0 beyond the table.

        It is 0 for ``nan``, too.
        """
        v = np.abs(np.asarray(speed, dtype=float))
        inside = np.minimum(np.maximum(v, self.speed[0]), self.speed[-1])
        i, s = self._find_interval(inside)
        a, b, c, _ = self.cubics[:, i]
        derivative = (3.0 * a * s + 2.0 * b) * s + c
        # Where the curve turns level, rounding must not give its slope the wrong sign.
        falls_or_rises = derivative * self._rises[i] > 0.0
        return np.where((v == inside) & falls_or_rises, derivative, 0.0)

    def _find_interval(self, inside: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the index of the interval of each speed in the table, and its distance from there [m/s]."""
        i = np.searchsorted(self._begins[1:], inside, side='right')
        return i, inside - self._begins[i]


def _monotone_cubics(v: tuple[float, ...], mu: tuple[float, ...]) -> FloatArray:
    """Return the monotone cubics between points as ``scipy.interpolate.PPoly.c``, shape (4, n - 1).

    ``v`` are rising speeds [m/s], ``mu`` the coefficients there, n of each.

    Raises:
        PhysicsError: A slope is too steep to be a finite number.
    """
    speed, values = np.array(v), np.array(mu)
    with np.errstate(all='ignore'):
        cubics = hermite_cubics(speed, values, monotone_slopes(speed, values))
    if not np.isfinite(cubics).all():
        raise PhysicsError('friction table is too steep for its slope to be a finite number')
    return cubics


def _table_column(name: str, values: Sequence[float]) -> tuple[float, ...]:
    """Return the numbers of a column as a tuple.

    Args:
        name: The column's name, for messages.
        values: One number or several.

    Raises:
        PhysicsError: A number is negative or not finite.
    """
    column = tuple(float(value) for value in np.atleast_1d(np.asarray(values, dtype=float)))
    for index, value in enumerate(column):
        require_finite(f'friction table {name}[{index}]', value)
        require_not_negative(f'friction table {name}[{index}]', value)
    return column
