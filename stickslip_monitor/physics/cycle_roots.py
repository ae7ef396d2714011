# SPDX-License-Identifier: Apache-2.0
"""Roots of functions that cost a whole orbit: as few evaluations as can be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip_monitor.physics.cycle_laws import Index
from stickslip_monitor.physics.friction import Array

_LIMIT = 100
_CLOSE = 4e-16


def costly_root(function: Callable[[Array, Index], Array], low: Array, high: Array) -> Array:
    """Roots on brackets whose ends differ in sign, by Chandrupatla's method.

    Inverse quadratic interpolation where the function is known to be smooth enough for it,
    bisection elsewhere: Advances in Engineering Software 28 (1997) 145-149.

    Args:
        function: ``(x, rows) -> value`` for the rows still running.
        low: Lower ends, shape (n,).
        high: Upper ends, shape (n,).

    Returns:
        The roots, shape (n,).
    """
    rows = np.arange(low.size)
    root = low.copy()
    a, b = high.copy(), low.copy()
    fa, fb = function(a, rows), function(b, rows)
    t = np.full(low.size, 0.5)
    for _ in range(_LIMIT):
        x = a + t * (b - a)
        fx = function(x, rows)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        root[rows] = best
        with np.errstate(divide='ignore', invalid='ignore'):
            limit = 2.0 * _CLOSE * np.abs(best) / np.abs(b - c)
        keep = (limit <= 0.5) & (fx != 0.0)
        if not keep.any():
            break
        rows, limit = rows[keep], limit[keep]
        a, b, c, fa, fb, fc = a[keep], b[keep], c[keep], fa[keep], fb[keep], fc[keep]
        t = np.clip(_fraction(a, b, c, fa, fb, fc), limit, 1.0 - limit)
    return root


def _fraction(a: Array, b: Array, c: Array, fa: Array, fb: Array, fc: Array) -> Array:
    """Where between ``a`` and ``b`` to look next."""
    with np.errstate(divide='ignore', invalid='ignore'):
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        quadratic = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        across = fa / (fb - fa) * fc / (fb - fc)
        beside = (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        return np.where(quadratic, across + beside, 0.5)
