# SPDX-License-Identifier: Apache-2.0
"""Cubics between points, from the values and slopes there."""

from __future__ import annotations

import numpy as np

from stickslip_monitor.arrays import FloatArray


def hermite_cubics(x: FloatArray, y: FloatArray, slope: FloatArray) -> FloatArray:
    """The cubic of each interval, highest power of the distance from its begin first.

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


def monotone_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Slopes of the cubic interpolant that is monotone where its points are.

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
    """Slopes of the cubic spline whose second derivative is continuous.

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
    both = h + beside
    return ((h + 2.0 * both) * beside * chord + h * h * next_chord) / both


def _end_slope(h: float, beside: float, chord: float, next_chord: float) -> float:
    slope = ((2.0 * h + beside) * chord - h * next_chord) / (h + beside)
    if slope * chord <= 0.0:
        return 0.0
    return 3.0 * chord if chord * next_chord <= 0.0 and abs(slope) > 3.0 * abs(chord) else slope
