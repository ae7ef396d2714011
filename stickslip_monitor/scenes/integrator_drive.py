# SPDX-License-Identifier: Apache-2.0
"""What drives the lining: surface speed and load, piecewise cubic in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.friction import Array

RULES = ('linear', 'cubic', 'hold')


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Surface speed ``V`` and load ``N`` on the pieces between rising times.

    Use :meth:`constant` or :meth:`sampled`. On piece ``i``, with ``s`` the time since
    ``time[i]``, each is ``sum c[i, j] s^j``.

    Attributes:
        time: Ends of the pieces, shape (n + 1,) [s].
        speed: Coefficients of ``V``, which is continuous, shape (n, 4) [m/s, m/s^2, ...].
        load: Coefficients of ``N`` >= 0, which may jump between pieces, shape (n, 4)
            [N, N/s, ...].
    """

    time: Array
    speed: Array
    load: Array

    @classmethod
    def constant(cls, speed: float, load: float, duration: float, start: float = 0.0) -> Drive:
        """A speed [m/s] and a load [N] for a while.

        Args:
            speed: ``V`` [m/s].
            load: ``N`` >= 0 [N].
            duration: > 0 [s].
            start: Time at its begin [s].

        Raises:
            PhysicsError: A quantity breaks its rule.
        """
        return cls.sampled([start, start + duration], [speed] * 2, [load] * 2)

    @classmethod
    def sampled(
        cls,
        time: ArrayLike,
        speed: ArrayLike,
        load: ArrayLike,
        rule: str = 'linear',
        load_rule: str | None = None,
    ) -> Drive:
        """Samples on a grid of times, joined by a rule.

        Args:
            time: Rising times, shape (n,), at least two [s].
            speed: ``V`` at each, shape (n,) [m/s].
            load: ``N`` >= 0 at each, shape (n,) [N].
            rule: ``'linear'``, or ``'cubic'``: the monotone cubic of Fritsch and Carlson, which
                stays between neighbouring samples.
            load_rule: The same for the load (default: ``rule``), or ``'hold'``: each sample until
                the next.

        Raises:
            PhysicsError: A sample or a rule breaks its rule.
        """
        t = np.asarray(time, dtype=float)
        v, n = np.asarray(speed, dtype=float), np.asarray(load, dtype=float)
        _check_grid(t, v, n)
        load_rule = rule if load_rule is None else load_rule
        if rule not in RULES[:2]:
            raise PhysicsError(f"rule = '{rule}' is not one of linear, cubic: a shaft cannot jump")
        if load_rule not in RULES:
            raise PhysicsError(f"load_rule = '{load_rule}' is not one of {', '.join(RULES)}")
        return cls(t, _pieces(t, v, rule), _pieces(t, n, load_rule))

    @property
    def start(self) -> float:
        """Its first instant [s]."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """Its last instant [s]."""
        return float(self.time[-1])

    def speed_at(self, time: float) -> float:
        """``V`` [m/s] at a time [s] within the drive."""
        piece = int(np.searchsorted(self.time[1:-1], time, side='left'))
        return float(np.polyval(self.speed[piece, ::-1], time - self.time[piece]))

    @property
    def largest_load(self) -> float:
        """An upper bound of ``N`` [N]."""
        width = np.diff(self.time)[:, None]
        return float(np.max(np.sum(np.abs(self.load) * width ** np.arange(4), axis=1)))


def _check_grid(time: Array, speed: Array, load: Array) -> None:
    if time.ndim != 1 or time.shape != speed.shape or time.shape != load.shape:
        raise PhysicsError(
            f'drive has times of shape {time.shape}, speeds of {speed.shape} and loads of'
            f' {load.shape}: give one speed and one load for each time'
        )
    if time.size < 2:
        raise PhysicsError(f'drive has {time.size} samples: give at least two')
    for name, values in (('time', time), ('speed', speed), ('load', load)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise PhysicsError(
                f'drive {name}[{bad[0]}] = {values[bad[0]]:g} must be a finite number'
            )
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        index = int(back[0])
        raise PhysicsError(
            f'drive time[{index + 1}] = {time[index + 1]:g} s does not exceed time[{index}] ='
            f' {time[index]:g} s: times must rise strictly'
        )
    negative = np.flatnonzero(load < 0.0)
    if negative.size:
        index = int(negative[0])
        raise PhysicsError(f'drive load[{index}] = {load[index]:g} N must not be negative')


def _pieces(time: Array, values: Array, rule: str) -> Array:
    pieces = np.zeros((time.size - 1, 4))
    pieces[:, 0] = values[:-1]
    if rule == 'linear':
        pieces[:, 1] = np.diff(values) / np.diff(time)
    elif rule == 'cubic':
        pieces[:, :] = PchipInterpolator(time, values).c[::-1].T
    return pieces
