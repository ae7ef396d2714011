# SPDX-License-Identifier: Apache-2.0
"""The load from which a vibration can last, over the speed: the inverse of the fold that decides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_monitor.arrays import FloatArray, mapped
from stickslip_monitor.physics.averaging import fold_load
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.boundary_table import known_table
from stickslip_monitor.physics.lubrication import gives_load

# Speed beyond that of any journal's surface, up to which the fold is followed over the load [m/s].
_FASTEST = 1e4
# Each halves the interval of ``ln N`` of a table's step, about 0.01: rounding is reached after 43.
_HALVINGS = 44


@gives_load
def load_of_fold(bearing: Bearing, speed: ArrayLike) -> Any:
    """Return the least load [N] whose fold that decides lies above surface speeds [m/s].

    Returns:
        Shape of ``speed``; 0 where every load has it, ``nan`` where none has it.

    >>> round(load_of_fold(bearing, 0.213198), 2)
    1000.0
    """
    table = known_table(bearing)
    last_fold = float(table.pieces[0, -1].sum())
    place = np.arange(len(table.pieces[0]) + 1.0)
    if last_fold > 0.0 and table.growth[0] > 0.0:
        beyond = math.log(max(_FASTEST / last_fold, 1.0)) / float(table.growth[0])
        place = np.append(place, place[-1] + beyond)

    def fold(at: FloatArray) -> FloatArray:
        """Return the fold that decides [m/s] at places of the table, in steps; 0 for none."""
        return np.nan_to_num(table.fold(np.exp(table.first + table.step * at)), posinf=np.inf)

    def loads(v: FloatArray) -> FloatArray:
        """Return loads [N] at speeds of either sign, shape (n,) [m/s]; 0 for every load, ``nan`` for none."""
        size = np.abs(v)
        reached = np.maximum.accumulate(fold(place))
        after = np.searchsorted(reached, size, side='right')
        high = place[np.minimum(after, place.size - 1)]
        low = place[np.clip(after - 1, 0, place.size - 1)]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            above = fold(middle) > size
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        load = np.where(reached[0] == np.inf, 0.0, np.exp(table.first + table.step * high))
        return np.where(after < place.size, load, np.nan)

    return mapped(loads, speed)


@gives_load
def deciding_load(bearing: Bearing, speed: ArrayLike) -> Any:
    """Return the least load [N] at which a vibration can last at surface speeds [m/s].

    That of :func:`load_of_fold`. A law may vibrate in several ranges of speed: in a quiet one between
    them, as averaging finds, it is that of :func:`.averaging.fold_load`.

    Returns:
        Shape of ``speed``; 0 where every load has a cycle, ``nan`` where none has one.

    >>> round(deciding_load(bearing, 0.213198), 2)
    1000.0
    """
    table = known_table(bearing)

    def loads(v: FloatArray) -> FloatArray:
        """Return loads [N] at speeds of either sign, shape (n,) [m/s]; 0 for every load, ``nan`` for none."""
        reaching, averaged = np.asarray(load_of_fold(bearing, v)), np.asarray(fold_load(bearing, v))
        inside = (np.abs(v) < table.fold_kbm(reaching)) & ~(reaching >= averaged)
        return np.where(inside, averaged, reaching)

    return mapped(loads, speed)
