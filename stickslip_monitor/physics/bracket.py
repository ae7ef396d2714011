# SPDX-License-Identifier: Apache-2.0
"""The root of one costly function on a bracket, a trial at a time: plain functions of numbers.

T. R. Chandrupatla, Advances in Engineering Software 28, 1997, 145-149: inverse quadratic
interpolation where it can be trusted, else bisection. A caller evaluates the function between two
calls, so that compiled loops need no functions as arguments:

    bracket = begun_bracket(a, fa, b, fb)
    while not is_found(bracket, tolerance):
        x = next_trial(bracket, tolerance)
        bracket = narrowed(bracket, x, function(x))
    root = best_of(bracket)
"""

from __future__ import annotations

import math
from typing import TypeAlias

# The latest point, the one on the other side of the root, and the one before: place and value.
Bracket: TypeAlias = tuple[float, float, float, float, float, float]


def begun_bracket(a: float, fa: float, b: float, fb: float) -> Bracket:
    """A bracket from two places with values of different sign."""
    return a, fa, b, fb, a, fa


def narrowed(bracket: Bracket, x: float, fx: float) -> Bracket:
    """The bracket with one more place inside it and its value."""
    a, fa, b, fb, _, _ = bracket
    if (fx > 0.0) == (fa > 0.0):
        return x, fx, b, fb, a, fa
    return x, fx, a, fa, b, fb


def best_of(bracket: Bracket) -> float:
    """The end with the smaller value."""
    return bracket[0] if abs(bracket[1]) < abs(bracket[3]) else bracket[2]


def is_found(bracket: Bracket, tolerance: float) -> bool:
    """Whether the root is known to a relative tolerance."""
    a, fa, b, fb, _, _ = bracket
    return fa == 0.0 or fb == 0.0 or abs(b - a) <= 2.0 * tolerance * abs(best_of(bracket))


def next_trial(bracket: Bracket, tolerance: float) -> float:
    """Where to evaluate the function next."""
    a, fa, b, fb, c, fc = bracket
    share = 0.5
    if c == a:  # nothing but two ends: where the straight line between them vanishes
        share = fa / (fa - fb)
    elif fa != fc and fb != fc and c != b:
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            share = fa / (fb - fa) * fc / (fb - fc)
            share += (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    least = tolerance * abs(best_of(bracket)) / abs(b - a)
    if not math.isfinite(share):
        share = 0.5
    return a + min(max(share, least), 1.0 - least) * (b - a)
