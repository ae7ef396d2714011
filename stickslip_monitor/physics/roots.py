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


def newton_on_bracket(
    function: Callable[..., tuple[FloatArray, FloatArray]],
    low: FloatArray,
    high: FloatArray,
    start: FloatArray,
    parameters: Sequence[FloatArray] = (),
) -> FloatArray:
    """Roots of falling functions by Newton's method, one on each bracket ``[low, high]``.

    A step that leaves the bracket, or does not at least halve the one before last, is replaced by
    bisection.

    Args:
        function: ``(x, *parameters) -> (value, slope)``, positive below its root and negative
            above; called with the elements still running.
        low: Lower ends, shape (n,).
        high: Upper ends, shape (n,).
        start: First guesses inside the brackets, shape (n,).
        parameters: Arrays of shape (n,) handed on to ``function``.

    Returns:
        The roots, shape (n,). Where the function has one sign on the whole bracket, the end of the
        bracket it points to.
    """
    root = start.copy()
    running = np.arange(root.size)
    x = start
    last = before_last = high - low
    arguments = list(parameters)
    for _ in range(_LIMIT if root.size else 0):
        value, slope = function(x, *arguments)
        low = np.where(value > 0.0, x, low)
        high = np.where(value < 0.0, x, high)
        with np.errstate(divide='ignore', invalid='ignore'):
            newton = x - value / slope
        good = (newton >= low) & (newton <= high) & (np.abs(newton - x) < 0.5 * before_last)
        good &= np.isfinite(slope)
        following = np.where(value == 0.0, x, np.where(good, newton, 0.5 * (low + high)))
        step = np.abs(following - x)
        root[running] = following
        # A Newton step this small leaves its square behind; a bisection must end on its own.
        tolerance = np.where(good, 1e-9, _CLOSE)
        keep = (value != 0.0) & (step > tolerance * np.abs(following))
        if not keep.any():
            break
        running, x, low, high = running[keep], following[keep], low[keep], high[keep]
        before_last, last = last[keep], step[keep]
        arguments = [argument[keep] for argument in arguments]
    return root


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
