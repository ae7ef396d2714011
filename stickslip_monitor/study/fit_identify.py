# SPDX-License-Identifier: Apache-2.0
"""Refuses a curve that cannot identify the law, with what is missing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stickslip_monitor.errors import FitError
from stickslip_monitor.study.curve_file import FrictionCurve
from stickslip_monitor.study.fit_solution import Model, Solution
from stickslip_monitor.study.fit_uncertainty import correlation_of, fall_of, squares_of

Array = NDArray[np.float64]

FALL_LEVEL = 0.001
MOST_CORRELATION = 0.999
SPARE_POINTS = 2

_FARTHEST = 5.0


def has_points(curve: FrictionCurve, model: Model) -> bool:
    """Whether the curve has points enough for the model."""
    enough = curve.speed.size >= model.size + SPARE_POINTS
    return enough and np.unique(curve.speed).size >= model.size


def require_points(curve: FrictionCurve, model: Model) -> None:
    """Refuse a curve with too few points or too few different speeds."""
    n, k = curve.speed.size, model.size
    coefficients = f'{k} coefficients ({", ".join(model.names)})'
    if n < k + SPARE_POINTS:
        raise FitError(
            f'points = {n} must be at least {k + SPARE_POINTS}: {coefficients} and'
            f' {SPARE_POINTS} more to judge them by'
        )
    distinct = np.unique(curve.speed).size
    if distinct < k:
        raise FitError(f'different speeds = {distinct} must be at least {k}: {coefficients}')


def require_kept(solution: Solution) -> None:
    """Refuse a curve most of which was set aside as outliers."""
    kept, least = int(np.sum(solution.weight > 0.0)), solution.model.size + SPARE_POINTS
    if kept < least:
        raise FitError(
            f'points on one curve = {kept} must be at least {least}: the other'
            f' {solution.weight.size - kept} lie far from it, so no Stribeck law describes the'
            ' measurement'
        )


def require_fall(solution: Solution) -> None:
    """Refuse a fall that is none, or that a constant explains as well (F-test at 0.1 %)."""
    if not solution.drop > 0.0:
        raise FitError(
            f'static - kinetic = {fall_of(solution):.3g} must be above 0: the curve has no falling'
            ' part that levels off, as the Stribeck law has'
        )
    straight = replace(solution.model, kinetic=False)
    constant = np.ones((1, solution.weight.size, 1))
    if straight.viscous:
        constant = np.concatenate([constant, solution.curve.speed[None, :, None]], axis=2)
    gain = squares_of(solution, constant)[0] - solution.squares
    f_value = gain / 2.0 / solution.variance
    least = float(stats.f.isf(FALL_LEVEL, 2.0, solution.freedom))
    if not f_value > least:
        raise FitError(
            f'F = {f_value:.3g} of the falling part must be above {least:.3g} (0.1 % level): no'
            f' falling part stands out of the scatter of {solution.scale:.2g}'
        )


def require_decay(solution: Solution, interval: tuple[float, float]) -> None:
    """Refuse speeds that do not hold the decay between them."""
    low, high = interval
    slowest, fastest = solution.curve.speed.min(), solution.curve.speed.max()
    if not math.isfinite(high):
        raise FitError(
            f'decay has no upper limit (95 % interval from {low:.3g} s/m): all speeds but the'
            f' lowest, {slowest:.3g} m/s, may lie beyond the decay; measure at lower speeds'
        )
    reach = solution.decay * float(slowest)
    if reach > _FARTHEST:
        raise FitError(
            f'decay * lowest speed = {solution.decay:.3g} s/m * {slowest:.3g} m/s = {reach:.3g}'
            f' must not be above {_FARTHEST:g}: all speeds lie beyond the decay; measure at lower'
            ' speeds'
        )
    if not low > 0.0:
        raise FitError(
            f'decay has no lower limit (95 % interval up to {high:.3g} s/m): up to the highest'
            f' speed, {fastest:.3g} m/s, the fall does not bend towards a level; measure at higher'
            ' speeds'
        )


def require_distinct(solution: Solution, covariance: Array) -> None:
    """Refuse coefficients of which the curve knows only a combination."""
    if not np.all(np.isfinite(covariance)):
        raise FitError(
            f'decay = {solution.decay:.3g} s/m: the covariance of the coefficients must be finite,'
            ' and it is singular'
        )
    correlation = np.abs(correlation_of(covariance)) - np.eye(len(covariance))
    i, j = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    if correlation[i, j] > MOST_CORRELATION:
        names = solution.model.names
        raise FitError(
            f'correlation of {names[i]} and {names[j]} = {correlation[i, j]:.6f} must not be above'
            f' {MOST_CORRELATION:g}: the curve knows only a combination of the two'
        )
