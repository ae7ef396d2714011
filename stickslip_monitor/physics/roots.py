# SPDX-License-Identifier: Apache-2.0
"""Safeguarded root finding on brackets, for many independent equations at once.

An element that is done leaves the iteration and none sees its neighbours, so a root never depends
on what else is in the array. The number of steps is bounded.

Roots of functions that cost a whole orbit: as few evaluations as can be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray

_LIMIT = 120
_CLOSE = 2e-16
_SECANT_CLOSE = 1e-14


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
        The roots, shape (n,). Where the function has one sign on the whole bracket, the end of
        the bracket it points to.
    """
    root = start.copy()
    running = np.arange(root.size)
    x = start
    last = before_last = high - low
    arguments = list(parameters)
    for _ in range(_LIMIT):
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
    parameters: Sequence[FloatArray] = (),
    beyond: tuple[FloatArray, FloatArray] | None = None,
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
        beyond: Points outside the brackets and the values there, for a better first guess.

    Returns:
        The roots, shape (n,).
    """
    root = np.where(ends[0] == 0.0, low, high)
    running = np.flatnonzero((ends[0] != 0.0) & (ends[1] != 0.0))
    # The last point, the one on the other side of the root, and the one before.
    b, a, fb, fa = low[running], high[running], ends[0][running], ends[1][running]
    arguments = [argument[running] for argument in parameters]
    share = fb / (fb - fa)
    if beyond is not None:
        guess = _next_share(a, b, beyond[0][running], fa, fb, beyond[1][running])
        share = np.where((guess > 0.0) & (guess < 1.0) & (guess != 0.5), guess, share)
    for _ in range(_LIMIT):
        x = b + share * (a - b)
        fx = function(x, *arguments)
        same = np.sign(fx) == np.sign(fb)
        c, fc = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = x, fx
        with np.errstate(divide='ignore', invalid='ignore'):
            secant = fb * (b - c) / (fb - fc)
        # So close a last step along the secant cannot miss by more than rounding.
        there = (fb == 0.0) | (np.abs(secant) <= _SECANT_CLOSE * np.abs(b))
        close = np.abs(a - b) <= _CLOSE * np.abs(b)
        root[running] = np.where(there & (fb != 0.0), b - secant, b)
        keep = ~(there | close)
        if not keep.any():
            break
        running, a, b, c = running[keep], a[keep], b[keep], c[keep]
        fa, fb, fc = fa[keep], fb[keep], fc[keep]
        arguments = [argument[keep] for argument in arguments]
        least = np.minimum(_CLOSE * np.abs(b) / np.abs(a - b), 0.5)
        share = np.clip(_next_share(a, b, c, fa, fb, fc), least, 1.0 - least)
    return root


def _next_share(
    a: FloatArray, b: FloatArray, c: FloatArray, fa: FloatArray, fb: FloatArray, fc: FloatArray
) -> FloatArray:
    """Where between ``b`` (0) and ``a`` (1) to look next."""
    with np.errstate(all='ignore'):
        xi, phi = (b - a) / (c - a), (fb - fa) / (fc - fa)
        # Inverse quadratic interpolation is monotone under these conditions.
        fits = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        ahead = fb / (fa - fb) * fc / (fa - fc)
        share = ahead + (c - b) / (a - b) * fb / (fc - fb) * fa / (fc - fa)
    return np.where(fits & np.isfinite(share), share, 0.5)


_COSTLY_LIMIT = 100
_COSTLY_CLOSE = 4e-16


def costly_root(
    function: Callable[[FloatArray, IndexArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
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
    for _ in range(_COSTLY_LIMIT):
        x = a + t * (b - a)
        fx = function(x, rows)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        root[rows] = best
        with np.errstate(divide='ignore', invalid='ignore'):
            limit = 2.0 * _COSTLY_CLOSE * np.abs(best) / np.abs(b - c)
        keep = (limit <= 0.5) & (fx != 0.0)
        if not keep.any():
            break
        rows, limit = rows[keep], limit[keep]
        a, b, c, fa, fb, fc = a[keep], b[keep], c[keep], fa[keep], fb[keep], fc[keep]
        t = np.clip(_fraction(a, b, c, fa, fb, fc), limit, 1.0 - limit)
    return root


def _fraction(
    a: FloatArray, b: FloatArray, c: FloatArray, fa: FloatArray, fb: FloatArray, fc: FloatArray
) -> FloatArray:
    """Where between ``a`` and ``b`` to look next."""
    with np.errstate(divide='ignore', invalid='ignore'):
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        quadratic = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        across = fa / (fb - fa) * fc / (fb - fc)
        beside = (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        return np.where(quadratic, across + beside, 0.5)
