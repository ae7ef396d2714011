# SPDX-License-Identifier: Apache-2.0
"""Safeguarded root finding on brackets, for many independent equations at once.

An element that is done leaves the iteration and none sees its neighbours, so a root never
depends on what else is in the array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray

_LIMIT = 120
_CLOSE = 2e-16
_SECANT_CLOSE = 1e-14
# Steps by interpolation, after which a function that no parabola follows is bisected.
_PATIENCE = 12


def root_on_bracket(
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    parameters: Sequence[NDArray[Any]] = (),
) -> FloatArray:
    """Roots by Chandrupatla's method, one on each bracket whose ends differ in sign.

    Inverse quadratic interpolation where the last three points allow it, else bisection
    (T. R. Chandrupatla, Adv. Eng. Software 28, 1997, 145-149).

    Args:
        function: ``(x, *parameters) -> value``; called with the elements still running.
        low: Lower ends, shape (n,).
        high: Upper ends, shape (n,).
        ends: The values there.
        parameters: Arrays of shape (n,) handed on to ``function``.

    Returns:
        The roots, shape (n,). Without a change of sign, the end with the smaller value.
    """
    opposite = np.sign(ends[0]) * np.sign(ends[1]) <= 0.0
    nearer_low = (ends[0] == 0.0) | (~opposite & (np.abs(ends[0]) < np.abs(ends[1])))
    root = np.where(nearer_low, low, high)
    running = np.flatnonzero(opposite & (ends[0] != 0.0) & (ends[1] != 0.0))
    # The last point, the one on the other side of the root, and the one before.
    b, a, fb, fa = low[running], high[running], ends[0][running], ends[1][running]
    arguments = [argument[running] for argument in parameters]
    share = fb / (fb - fa)
    for step in range(_LIMIT if running.size else 0):
        x = b + share * (a - b)
        fx = function(x, *arguments)
        same = np.sign(fx) == np.sign(fb)
        c, fc = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = x, fx
        with np.errstate(divide='ignore', invalid='ignore'):
            secant = fb * (b - c) / (fb - fc)
        # A last step along the secant misses by about its length times the one before it, over
        # the bracket: so close it cannot miss by more than rounding.
        miss = np.abs(secant) * np.minimum(np.abs(b - c) / np.abs(a - b), 1.0)
        there = (fb == 0.0) | (miss <= _SECANT_CLOSE * np.abs(b))
        close = np.abs(a - b) <= _CLOSE * np.abs(b)
        root[running] = np.where(there & (fb != 0.0), b - secant, b)
        keep = ~(there | close)
        running, a, b, c = running[keep], a[keep], b[keep], c[keep]
        if not running.size:
            break
        fa, fb, fc = fa[keep], fb[keep], fc[keep]
        arguments = [argument[keep] for argument in arguments]
        with np.errstate(all='ignore'):
            xi, phi = (b - a) / (c - a), (fb - fa) / (fc - fa)
            # Inverse quadratic interpolation is monotone under these conditions.
            fits = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            ahead = fb / (fa - fb) * fc / (fa - fc)
            share = ahead + (c - b) / (a - b) * fb / (fc - fb) * fa / (fc - fa)
        fits &= np.isfinite(share) & (step < _PATIENCE)
        share = np.where(fits, share, 0.5)
        least = np.minimum(_CLOSE * np.abs(b) / np.abs(a - b), 0.5)
        share = np.clip(share, least, 1.0 - least)
    return root
