# SPDX-License-Identifier: Apache-2.0
"""Safeguarded root finding on brackets, for many independent equations at once.

An element that is done leaves the iteration and none sees its neighbours, so a root never depends
on what else is in the array. The number of steps is bounded, and the result says where the bound
was reached.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray

_LIMIT = 120
_CLOSE = 2e-16
_SECANT_CLOSE = 1e-14
# Steps by interpolation, after which the bracket is divided into parts, at most so often.
_PATIENCE, _PARTS, _DIVISIONS = 12, 16, 300


@dataclass(frozen=True, slots=True)
class Roots:
    """What a root finder found.

    Attributes:
        value: The roots, or the best known where the limit was reached, shape (n,).
        converged: Whether it was not, and the bracket had a root, shape (n,).
    """

    value: FloatArray
    converged: BoolArray


def newton_on_bracket(
    function: Callable[..., tuple[FloatArray, FloatArray]],
    low: FloatArray,
    high: FloatArray,
    start: FloatArray,
    parameters: Sequence[FloatArray] = (),
) -> Roots:
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
        The roots. Where the function has one sign on the whole bracket, the end of the bracket
        it points to.
    """
    root, converged = start.copy(), np.ones(start.size, dtype=bool)
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
            return Roots(root, converged)
        running, x, low, high = running[keep], following[keep], low[keep], high[keep]
        before_last, last = last[keep], step[keep]
        arguments = [argument[keep] for argument in arguments]
    converged[running] = False
    return Roots(root, converged)


def root_on_bracket(
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    parameters: Sequence[NDArray[Any]] = (),
    beyond: tuple[FloatArray, FloatArray] | None = None,
) -> Roots:
    """Roots by Chandrupatla's method, one on each bracket whose ends differ in sign.

    Inverse quadratic interpolation where the last three points allow it, else bisection
    (T. R. Chandrupatla, Adv. Eng. Software 28, 1997, 145-149). A function that no parabola
    follows, as one with a logarithm at its root, is soon evaluated at many points at once.

    Args:
        function: ``(x, *parameters) -> value``; called with the elements still running.
        low: Lower ends, shape (n,).
        high: Upper ends, shape (n,).
        ends: The values there.
        parameters: Arrays of shape (n,) handed on to ``function``.
        beyond: Points outside the brackets and the values there, for a better first guess.
    """
    opposite = np.sign(ends[0]) * np.sign(ends[1]) <= 0.0
    nearer_low = (ends[0] == 0.0) | (~opposite & (np.abs(ends[0]) < np.abs(ends[1])))
    root, converged = np.where(nearer_low, low, high), opposite.copy()
    running = np.flatnonzero(opposite & (ends[0] != 0.0) & (ends[1] != 0.0))
    # The last point, the one on the other side of the root, and the one before.
    b, a, fb, fa = low[running], high[running], ends[0][running], ends[1][running]
    arguments = [argument[running] for argument in parameters]
    share = fb / (fb - fa)
    if beyond is not None:
        guess = _next_share(a, b, beyond[0][running], fa, fb, beyond[1][running])
        share = np.where((guess > 0.0) & (guess < 1.0) & (guess != 0.5), guess, share)
    for _ in range(_PATIENCE if running.size else 0):
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
        running, a, b, c = running[keep], a[keep], b[keep], c[keep]
        if not running.size:
            break
        fa, fb, fc = fa[keep], fb[keep], fc[keep]
        arguments = [argument[keep] for argument in arguments]
        least = np.minimum(_CLOSE * np.abs(b) / np.abs(a - b), 0.5)
        share = np.clip(_next_share(a, b, c, fa, fb, fc), least, 1.0 - least)
    if running.size:
        root[running], converged[running] = _divided(function, (b, a), (fb, fa), arguments)
    return Roots(root, converged)


def _divided(
    function: Callable[..., FloatArray],
    ends: tuple[FloatArray, FloatArray],
    values: tuple[FloatArray, FloatArray],
    arguments: Sequence[NDArray[Any]],
) -> tuple[FloatArray, BoolArray]:
    """Roots by dividing brackets into parts, and whether the limit was not reached.

    Args:
        function: As of :func:`root_on_bracket`.
        ends: Of the brackets, each of shape (n,).
        values: There, of either sign and the other, each of shape (n,).
        arguments: Of the function, each of shape (n,).
    """
    (near, far), (f_near, f_far) = ends, values
    root, running = near.copy(), np.arange(near.size)
    shares = np.arange(_PARTS + 1) / _PARTS
    for _ in range(_DIVISIONS):
        x = near[:, None] + (far - near)[:, None] * shares
        many = [np.repeat(argument, _PARTS - 1, axis=0) for argument in arguments]
        inner = function(x[:, 1:-1].ravel(), *many).reshape(-1, _PARTS - 1)
        x[:, -1], f = far, np.column_stack([f_near, inner, f_far])
        beyond = np.sign(f[:, 1:]) != np.sign(f_near)[:, None]
        every, place, width = (
            np.arange(running.size),
            np.argmax(beyond, axis=1),
            np.abs(far - near),
        )
        near, far = x[every, place], x[every, place + 1]
        f_near, f_far = f[every, place], f[every, place + 1]
        root[running] = np.where(np.abs(f_near) < np.abs(f_far), near, far)
        now = np.abs(far - near)
        keep = (now > 2.0 * _CLOSE * np.abs(near)) & (now < width)
        running, near, far, f_near, f_far, *arguments = (
            column[keep] for column in (running, near, far, f_near, f_far, *arguments)
        )
        if not running.size:
            break
    converged = np.ones(root.size, dtype=bool)
    converged[running] = False
    return root, converged


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
