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
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.lubrication import MAX_SURFACE_SPEED, gives_load
from stickslip_monitor.physics.numerics import root_on_bracket


@gives_load
def load_of_fold(bearing: Bearing, speed: ArrayLike) -> Any:
    """Return the least load [N] whose fold that decides lies above surface speeds [m/s].

    Speeds astern mirror those ahead. Below the fold of the table's first load it is that load.

    Returns:
        Shape of ``speed``; 0 where every load has it, ``nan`` where none has it or the speed is not finite.

    >>> round(load_of_fold(bearing, 0.213198), 2)
    1000.0
    """
    table = boundary_table(bearing)
    last_fold = float(table.pieces[0, -1].sum())
    place = np.arange(len(table.pieces[0]) + 1.0)
    if last_fold > 0.0 and table.growth[0] > 0.0:
        beyond = math.log(max(MAX_SURFACE_SPEED / last_fold, 1.0)) / float(table.growth[0])
        place = np.append(place, place[-1] + beyond)

    def excess(at: FloatArray, size: FloatArray | float) -> FloatArray:
        """Return the excess of the fold that decides, 0 for none, over speeds [m/s] at table places."""
        return np.nan_to_num(table.fold(np.exp(table.first + table.step * at)), posinf=np.inf) - size

    def loads(v: FloatArray) -> FloatArray:
        """Return loads [N] at speeds of either sign, shape (n,) [m/s]; 0 for every load, ``nan`` for none."""
        size = np.abs(v)
        reached = np.maximum.accumulate(excess(place, 0.0))
        after = np.searchsorted(reached, size, side='right')
        high = place[np.minimum(after, place.size - 1)]
        low = place[np.clip(after - 1, 0, place.size - 1)]
        high = root_on_bracket(excess, low, high, (excess(low, size), excess(high, size)), (size,))
        load = np.where(reached[0] == np.inf, 0.0, np.exp(table.first + table.step * high))
        return np.where(after < place.size, load, np.nan)

    return mapped(loads, speed)


@gives_load
def deciding_load(bearing: Bearing, speed: ArrayLike) -> Any:
    """Return the least load [N] at which a vibration can last at surface speeds [m/s].

    That of :func:`load_of_fold`, also at rest and astern. A law may vibrate in several ranges of speed: in a
    quiet one between them, as averaging finds, it is that of :func:`.averaging.fold_load`.

    Returns:
        Shape of ``speed``; 0 where every load has a cycle, ``nan`` where none has one or the speed is not
        finite.

    >>> round(deciding_load(bearing, 0.213198), 2)
    1000.0
    """
    table = boundary_table(bearing)

    def loads(v: FloatArray) -> FloatArray:
        """Return loads [N] at speeds of either sign, shape (n,) [m/s]; 0 for every load, ``nan`` for none."""
        reaching, averaged = np.asarray(load_of_fold(bearing, v)), np.asarray(fold_load(bearing, v))
        # Where the averaged fold decides it is the speed there, to the rounding of a root.
        inside = (np.abs(v) < table.fold_kbm(reaching) * (1.0 + 1e-9)) & ~(reaching >= averaged)
        return np.where(inside, averaged, reaching)

    return mapped(loads, speed)
