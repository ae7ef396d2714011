# SPDX-License-Identifier: Apache-2.0
"""How well a curve knows the coefficients, and whether it demands a viscous slope.

Covariance: Huber and Ronchetti, Robust Statistics, 2nd ed., eq. (7.81). Profile interval of the
decay: Bates and Watts, Nonlinear Regression Analysis, ch. 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.friction_fit.solve import (
    Solution,
    columns_of,
    curve_of,
    gauss_newton_step,
    rates,
    scale_floor,
)

CONFIDENCE = 0.95
VISCOUS_LEVEL = 0.01


def covariance_of(solution: Solution) -> FloatArray:
    """``s^2 (J'WJ)^-1`` of the coefficients, shape (k, k); ``inf`` where it is singular."""
    rows, size = _scaled_gradient(solution)
    singular = np.full((rows.shape[1], rows.shape[1]), np.inf)
    if not np.all(np.isfinite(size) & (size > 0.0)):
        return singular
    triangle = np.linalg.qr(rows, mode='r')
    if np.min(np.abs(np.diag(triangle))) < 1e-12:
        return singular
    inverse = np.linalg.inv(triangle) / size[:, None]
    return solution.variance * (inverse @ inverse.T)


def _scaled_gradient(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Weighted Jacobian with columns of length 1, shape (n, k), and their lengths, shape (k,)."""
    root, curve = np.sqrt(solution.row_weight), solution.curve
    with np.errstate(invalid='ignore', divide='ignore', over='ignore'):
        names = solution.model.names
        gradient = gradient_of(fall_of(solution), solution.decay, curve.speed, names)
        size = np.linalg.norm(gradient * root[:, None], axis=0)
        return gradient * root[:, None] / size, size


def gradient_of(
    fall: float, decay: float, speed: FloatArray, names: tuple[str, ...]
) -> FloatArray:
    """Derivatives of ``mu(v)`` by the named coefficients, ``fall`` being mu_s - mu_k; (n, k)."""
    decayed = np.exp(-decay * speed)
    by_name = {
        'static': decayed,
        'kinetic': 1.0 - decayed,
        'decay': -fall * speed * decayed,
        'viscous': speed,
    }
    return np.stack([by_name[name] for name in names], axis=-1)


def fall_of(solution: Solution) -> float:
    """``mu_s - mu_k``: the drop, extrapolated from the lowest speed to 0."""
    with np.errstate(over='ignore'):
        rise = np.exp(solution.decay * solution.curve.speed.min())
    return float(solution.drop * rise)


def leverage_of(solution: Solution) -> FloatArray:
    """Diagonal of the weighted hat matrix, shape (n,)."""
    orthogonal, _ = np.linalg.qr(_scaled_gradient(solution)[0])
    return np.sum(orthogonal**2, axis=1)


def correlation_of(covariance: FloatArray) -> FloatArray:
    """Correlation matrix of a covariance matrix, shape (k, k)."""
    error = np.sqrt(np.diag(covariance))
    matrix: FloatArray = covariance / np.outer(error, error)
    np.fill_diagonal(matrix, 1.0)
    return matrix


def decay_interval(solution: Solution) -> tuple[float, float]:
    """95 % profile interval of ``beta`` [s/m]; 0 or ``inf`` where it has no end."""
    span = float(np.ptp(solution.curve.speed))
    level = solution.squares + solution.variance * float(
        stats.t.ppf(0.5 + 0.5 * CONFIDENCE, solution.freedom) ** 2
    )

    def above(log_rate: float) -> float:
        return float(profile(solution, np.exp([log_rate]))[0]) - level

    best = math.log(solution.decay * span)
    grid = np.log(rates(solution.curve))
    inside = grid[profile(solution, np.exp(grid)) <= level]
    reach = np.append(inside, best)
    low, high = float(reach.min()), float(reach.max())
    below, beyond = grid[grid < low], grid[grid > high]

    def end(outside: float, within: float) -> float:
        # On exact data rounding may leave nothing within.
        if above(within) >= 0.0:
            return math.exp(within) / span
        return math.exp(float(brentq(above, outside, within, xtol=1e-14))) / span

    return (
        end(below[-1], low) if below.size else 0.0,
        end(beyond[0], high) if beyond.size else math.inf,
    )


def profile(solution: Solution, rate: FloatArray) -> FloatArray:
    """Least weighted squares at each rate, the other coefficients being free, shape (rates,)."""
    return squares_of(solution, columns_of(solution.curve, solution.model, rate))


def squares_of(solution: Solution, columns: FloatArray) -> FloatArray:
    """Least weighted squares of linear models with columns of shape (models, n, k); (models,)."""
    root = np.sqrt(solution.row_weight)
    left, size, _ = np.linalg.svd(columns * root[:, None], full_matrices=False)
    target = root * solution.curve.coefficient
    seen = np.einsum('bnk,n->bk', left, target) * (size > 1e-12 * size[:, :1])
    return np.sum((target - np.einsum('bnk,bk->bn', left, seen)) ** 2, axis=1)


@dataclass(frozen=True, slots=True)
class ViscousTest:
    """The comparison of the law with and without its viscous slope, at the same weights.

    Attributes:
        slope: The slope that fits best, of either sign [s/m].
        t_value: The slope by its standard error [-].
        f_value: What it takes from the weighted squares, by their variance [-].
        p_value: Probability of a larger ``f_value`` without any slope [-].
        aicc_gain: By how much it lowers the corrected Akaike criterion; negative if it does not.
    """

    slope: float
    t_value: float
    f_value: float
    p_value: float
    aicc_gain: float

    @property
    def demands_slope(self) -> bool:
        """The criterion of ``auto``: the slope is positive and significant at 1 %."""
        return self.slope > 0.0 and self.p_value < VISCOUS_LEVEL


def viscous_test(full: Solution) -> ViscousTest:
    """Compare with the best plain law at the weights of the full one."""
    gain = max(_plain_squares(full) - full.squares, 0.0)
    f_value = gain / full.variance
    p_value = float(stats.f.sf(f_value, 1.0, max(full.freedom, 1.0)))
    index = full.model.names.index('viscous')
    error = math.sqrt(float(covariance_of(full)[index, index]))
    count = float(full.weight.sum())
    floor = count * scale_floor(full.curve) ** 2
    lower = count * math.log(max(full.squares + gain, floor) / max(full.squares, floor))
    price = _aicc_price(count, full.model.size)
    return ViscousTest(full.viscous, full.viscous / error, f_value, p_value, lower - price)


def _plain_squares(full: Solution) -> float:
    """Least weighted squares of the law without viscous slope, at the weights of the full one."""
    curve, rate = full.curve, rates(full.curve)
    plain = replace(full, model=replace(full.model, viscous=False))
    best = rate[int(np.argmin(profile(plain, rate)))]
    values = np.array([0.0, 0.0, math.log(best / np.ptp(curve.speed)), 0.0])
    root = np.sqrt(full.weight)
    for free in ([True, True, False, False], *([[True, True, True, False]] * 40)):
        values = gauss_newton_step(curve, values, root, np.array(free))
    residual = curve.coefficient - curve_of(curve, values)
    return float(np.sum(full.row_weight * residual**2))


def _aicc_price(count: float, size: int) -> float:
    """What the corrected Akaike criterion asks for the last of ``size`` coefficients."""

    def penalty(k: int) -> float:
        return 2.0 * k * count / max(count - k - 1.0, 1e-9)

    return penalty(size + 1) - penalty(size)
