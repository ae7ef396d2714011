# SPDX-License-Identifier: Apache-2.0
"""Safeguarded root finding on brackets, for many independent equations at once.

An element that is done leaves the iteration and none sees its neighbours, so a root never depends
on what else is in the array. The number of steps is bounded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stickslip_monitor.physics.friction import Array

_LIMIT = 120
_CLOSE = 2e-16


def newton_on_bracket(
    function: Callable[..., tuple[Array, Array]],
    low: Array,
    high: Array,
    start: Array,
    parameters: Sequence[Array] = (),
) -> Array:
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


def secant_on_bracket(
    function: Callable[..., Array],
    low: Array,
    high: Array,
    parameters: Sequence[Array] = (),
) -> Array:
    """Roots by the Illinois method, one on each bracket whose ends differ in sign.

    Args:
        function: ``(x, *parameters) -> value``; called with the elements still running.
        low: Lower ends, shape (n,).
        high: Upper ends, shape (n,).
        parameters: Arrays of shape (n,) handed on to ``function``.

    Returns:
        The roots, shape (n,).
    """
    root = 0.5 * (low + high)
    running = np.arange(root.size)
    arguments = list(parameters)
    a, b = low, high
    fa, fb = function(a, *arguments), function(b, *arguments)
    for count in range(_LIMIT):
        with np.errstate(divide='ignore', invalid='ignore'):
            x = b - fb * (b - a) / (fb - fa)
        # Every fourth step bisects, so a kink cannot hold the secant at one end.
        inside = (x > np.minimum(a, b)) & (x < np.maximum(a, b))
        x = np.where(inside & (count % 4 != 3), x, 0.5 * (a + b))
        fx = function(x, *arguments)
        flipped = np.sign(fx) != np.sign(fb)
        a, fa = np.where(flipped, b, a), np.where(flipped, fb, 0.5 * fa)
        step = np.abs(x - b)
        b, fb = x, fx
        root[running] = x
        wide = np.abs(a - b) > _CLOSE * np.abs(b)
        keep = (fx != 0.0) & wide & (step > _CLOSE * np.abs(b))
        if not keep.any():
            break
        running, a, b, fa, fb = running[keep], a[keep], b[keep], fa[keep], fb[keep]
        arguments = [argument[keep] for argument in arguments]
    return root
