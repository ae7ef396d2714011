# SPDX-License-Identifier: Apache-2.0
"""Cubics through points, and roots on brackets: what scipy has, without the memory of loading it.

Of the roots an element that is done leaves the iteration and none sees its neighbours, so a root
never depends on what else is in the array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray


def gauss_rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss-Legendre nodes and weights on [0, 1], shape (order,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return 0.5 + 0.5 * nodes, 0.5 * weights


def hermite_cubics(x: FloatArray, y: FloatArray, slope: FloatArray) -> FloatArray:
    """Return the cubic of each interval, highest power of the distance from its begin first.

    Args:
        x: Rising places, shape (n,), n >= 2.
        y: Values there, shape (n,).
        slope: Slopes there, shape (n,).

    Returns:
        Coefficients, shape (4, n - 1), as scipy's ``PPoly.c``.

    >>> hermite_cubics(np.array([0.0, 2.0]), np.array([1.0, 5.0]), np.array([0.0, 4.0])).tolist()
    [[0.0], [1.0], [0.0], [1.0]]
    """
    h = np.diff(x)
    chord = np.diff(y) / h
    cube = (slope[:-1] + slope[1:] - 2.0 * chord) / h
    square = (chord - slope[:-1]) / h - cube
    return np.stack([cube / h, square, slope[:-1], y[:-1]])


def hermite(x: FloatArray, y: FloatArray, slope: FloatArray, at: FloatArray) -> FloatArray:
    """Evaluate the piecewise cubic Hermite interpolant at places, constant outside the points.

    Args:
        x: Rising places of the points, shape (n,), n >= 2.
        y: Values there, shape (n,).
        slope: Derivatives there, shape (n,).
        at: Places to evaluate at, of any shape.

    >>> x, y, slope = np.array([0.0, 2.0]), np.array([1.0, 5.0]), np.array([0.0, 4.0])
    >>> hermite(x, y, slope, np.array([1.0, 9.0])).tolist()
    [2.0, 5.0]
    """
    inside = np.clip(at, x[0], x[-1])
    i = np.clip(np.searchsorted(x, inside, side='right') - 1, 0, x.size - 2)
    return np.asarray(np.polyval(hermite_cubics(x, y, slope)[:, i], inside - x[i]))


def local_polynomials(x: FloatArray, y: FloatArray, at: FloatArray, points: int) -> FloatArray:
    """Evaluate at each place the polynomial through the nearest points (Lagrange's formula).

    Args:
        x: Rising places of the points, shape (n,).
        y: Values there, shape (n,).
        at: Places to evaluate at, shape (m,).
        points: Number of points of each polynomial, at most n.

    Returns:
        Shape (m,).

    >>> x = np.linspace(0.0, 2.0, 7)
    >>> local_polynomials(x, x**3, np.array([0.5, 1.9]), 4).round(12).tolist()
    [0.125, 6.859]
    """
    first = np.clip(np.searchsorted(x, at) - points // 2, 0, x.size - points)
    near = first[:, None] + np.arange(points)
    result = np.zeros(at.size)
    for k in range(points):
        other_points = np.delete(near, k, axis=1)
        result += y[near[:, k]] * np.prod(
            (at[:, None] - x[other_points]) / (x[near[:, [k]]] - x[other_points]), axis=1
        )
    return result


def monotone_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the slopes of the cubic interpolant that is monotone where its points are, shape (n,).

    Inside the weighted harmonic mean of the two chords, 0 where they differ in sign (F. N. Fritsch
    and J. Butland, SIAM J. Sci. Stat. Comput. 5, 1984); at the ends the parabola through three
    points, limited so as to keep the shape (C. Moler, Numerical Computing with MATLAB, 2004).

    Args:
        x: Rising places, shape (n,), n >= 2.
        y: Values there, shape (n,).

    >>> monotone_slopes(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0])).tolist()
    [2.0, 0.0, -2.0]
    """
    h, chord = np.diff(x), np.diff(y) / np.diff(x)
    if x.size == 2:
        return np.repeat(chord, 2)
    left, right = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    same = chord[1:] * chord[:-1] > 0.0
    with np.errstate(all='ignore'):
        mean = (left + right) / (left / chord[:-1] + right / chord[1:])
    ends = (_end_slope(h[0], h[1], chord[0], chord[1]), _end_slope(h[-1], h[-2], chord[-1], chord[-2]))
    return np.concatenate([ends[:1], np.where(same, mean, 0.0), ends[1:]])


def spline_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the slopes of the cubic spline whose second derivative is continuous, shape (n,).

    At the second and at the last but one point the third is too: "not a knot" (C. de Boor, A
    Practical Guide to Splines, Springer, 1978, chapter IV).

    Args:
        x: Rising places, shape (n,), n >= 4.
        y: Values there, shape (n,).

    >>> x = np.arange(5.0)
    >>> np.allclose(spline_slopes(x, x**3), 3.0 * x**2)
    True
    """
    h, chord = np.diff(x), np.diff(y) / np.diff(x)
    below, above = np.append(h[1:], h[-1] + h[-2]), np.append(h[0] + h[1], h[:-1])
    middle = np.concatenate([[h[1]], 2.0 * (h[:-1] + h[1:]), [h[-2]]])
    right = np.empty(x.size)
    right[1:-1] = 3.0 * (h[1:] * chord[:-1] + h[:-1] * chord[1:])
    right[0] = _end_balance(h[0], h[1], chord[0], chord[1])
    right[-1] = _end_balance(h[-1], h[-2], chord[-1], chord[-2])
    diagonal, slope = middle.tolist(), right.tolist()
    low, up = below.tolist(), above.tolist()
    for i in range(1, x.size):  # Gauss's elimination of three diagonals
        share = low[i - 1] / diagonal[i - 1]
        diagonal[i] -= share * up[i - 1]
        slope[i] -= share * slope[i - 1]
    slope[-1] /= diagonal[-1]
    for i in range(x.size - 2, -1, -1):
        slope[i] = (slope[i] - up[i] * slope[i + 1]) / diagonal[i]
    return np.array(slope)


def _end_balance(h: float, beside: float, chord: float, next_chord: float) -> float:
    """Return the right side of the "not a knot" equation at an end; arguments as of :func:`_end_slope`."""
    total = h + beside
    return ((h + 2.0 * total) * beside * chord + h * h * next_chord) / total


def _end_slope(h: float, beside: float, chord: float, next_chord: float) -> float:
    """Return the slope at an end of the parabola through three points, limited so as to keep the shape.

    Args:
        h: Width of the interval at the end.
        beside: Width of the one beside it.
        chord: Slope of the chord at the end.
        next_chord: Slope of the one beside it.
    """
    slope = ((2.0 * h + beside) * chord - h * next_chord) / (h + beside)
    if slope * chord <= 0.0:
        return 0.0
    return 3.0 * chord if chord * next_chord <= 0.0 and abs(slope) > 3.0 * abs(chord) else slope


def last_above(heights: FloatArray, level: FloatArray) -> IndexArray:
    """Return the index of the last of m heights that exceeds each level; -1 where none does.

    Args:
        heights: Shape (m,).
        level: Shape (n,), in the same unit.
    """
    from_right = np.maximum.accumulate(heights[::-1])[::-1]
    return np.searchsorted(-from_right, -level, side='left') - 1


def root_on_bracket(
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    parameters: Sequence[NDArray[Any]] = (),
) -> FloatArray:
    """Find the root on each bracket whose ends differ in sign, by Chandrupatla's method.

    Inverse quadratic interpolation where the last three points allow it, else bisection
    (T. R. Chandrupatla, Adv. Eng. Software 28, 1997, 145-149).

    Args:
        function: ``(x, *parameters) -> value``; called with the elements still running.
        low: Lower ends, shape (n,).
        high: Upper ends, shape (n,).
        ends: The values at ``low`` and at ``high``, shape (n,) each.
        parameters: Arrays of shape (n,); ``function`` is given the elements that are still running.

    Returns:
        The roots, shape (n,), to rounding. Without a change of sign, the end whose value is nearer to 0; the
        upper one where neither is.
    """
    close = 2e-16  # width of a bracket, as a share of the root, below which only rounding is left
    opposite = np.sign(ends[0]) * np.sign(ends[1]) <= 0.0
    nearer_low = (ends[0] == 0.0) | (~opposite & (np.abs(ends[0]) < np.abs(ends[1])))
    root = np.where(nearer_low, low, high)
    running = np.flatnonzero(opposite & (ends[0] != 0.0) & (ends[1] != 0.0))
    # The last point, the one on the other side of the root, and the one before.
    b, a, fb, fa = low[running], high[running], ends[0][running], ends[1][running]
    arguments = [argument[running] for argument in parameters]
    share = fb / (fb - fa)
    for step in range(120 if running.size else 0):
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
        is_done = (fb == 0.0) | (miss <= 1e-14 * np.abs(b))
        root[running] = np.where(is_done & (fb != 0.0), b - secant, b)
        keep = ~(is_done | (np.abs(a - b) <= close * np.abs(b)))
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
        # What no parabola follows within 12 steps is bisected.
        fits &= np.isfinite(share) & (step < 12)
        share = np.where(fits, share, 0.5)
        min_share = np.minimum(close * np.abs(b) / np.abs(a - b), 0.5)
        share = np.clip(share, min_share, 1.0 - min_share)
    return root
