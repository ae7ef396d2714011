# SPDX-License-Identifier: Apache-2.0
"""The highest averaged slope ``max_a rho(a; V)`` over the speed, of all amplitudes that slide.

``rho(a; V) = 2 S(a; V)/a``; beyond the sliding limit it falls, so the highest stands at an
amplitude ``a <= V``. See :mod:`.quadrature`.
"""

from __future__ import annotations

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.physics.averaging import closed_form
from stickslip_monitor.physics.averaging.quadrature import slope_surface
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck, computes_as

# Amplitudes in units of the speed at which rho is looked at.
_SHARES = np.linspace(0.0, 1.0, 33)
# How far below the highest of a speed, as a share of it, a neighbour's highest may stand.
_LOWER = 0.05


def highest_slopes(law: FrictionLaw, speed: FloatArray, every: int = 1) -> FloatArray:
    """``max_a rho(a; V)`` [s/m] at ascending speeds.

    Args:
        law: The friction law.
        speed: ``V`` > 0, ascending, shape (n,) [m/s].
        every: All amplitudes are looked at for each so-many-th speed, and between those that
            stand high at one of two neighbours.
    """
    if computes_as(law, Stribeck):
        return closed_form.peak_slope(law, speed)
    n, m = speed.size, _SHARES.size
    coarse = np.unique(np.append(np.arange(0, n, every), n - 1))
    rows = slope_surface(law, np.tile(_SHARES, coarse.size), np.repeat(speed[coarse], m))
    rows = rows.reshape(-1, m)
    if every > 1:
        near = _high(rows)
        block = np.minimum(np.arange(n) // every, coarse.size - 2)
        point, column = np.nonzero(near[block] | near[block + 1])
        rows = np.full((n, m), -np.inf)
        rows[point, column] = slope_surface(law, _SHARES[column], speed[point])
    return _refined(law, speed, rows)


def _high(rows: FloatArray) -> BoolArray:
    """Amplitudes that may hold the highest value of a speed or of its neighbours."""
    most = rows.max(axis=1, keepdims=True)
    near: BoolArray = rows > most - _LOWER * np.abs(most)
    near[:, 1:] |= near[:, :-1]
    near[:, :-1] |= near[:, 1:]
    near[:, [0, -1]] = True
    return near


def _refined(law: FrictionLaw, speed: FloatArray, rows: FloatArray) -> FloatArray:
    """The highest of each row, by parabolas through three points that move together."""
    best, i = np.argmax(rows, axis=1), np.arange(speed.size)
    peak, k = rows[i, best], np.clip(best, 1, _SHARES.size - 2)
    left, here, right = rows[i, k - 1], rows[i, k], rows[i, k + 1]
    with np.errstate(all='ignore'):
        off = 0.5 * (left - right) / (left - 2.0 * here + right)
        todo = np.flatnonzero((best > 0) & (np.abs(off) < 1.0) & (k + off < _SHARES.size - 1))
    x, v, width = (k + off)[todo] * _SHARES[1], speed[todo], _SHARES[1]
    for _ in range(2):
        width *= 0.125
        some = np.concatenate([x - width, x, np.minimum(x + width, 1.0)])
        left, here, right = slope_surface(law, some, np.tile(v, 3)).reshape(3, -1)
        with np.errstate(all='ignore'):
            move = 0.5 * (left - right) / (left - 2.0 * here + right)
        x = np.clip(x + np.nan_to_num(np.clip(move, -1.0, 1.0)) * width, 0.0, 1.0 - width)
        peak[todo] = np.maximum(peak[todo], np.maximum(np.maximum(left, here), right))
    return peak
