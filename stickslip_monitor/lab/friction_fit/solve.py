# SPDX-License-Identifier: Apache-2.0
"""The robust least-squares fit of the law to a curve, without a start value.

For a given decay the law is linear (variable projection: Golub and Pereyra, SIAM J. Numer. Anal.
10, 1973), so the start is found on a scan of all decades of the decay. From there
``scipy.optimize.least_squares`` minimises Tukey's biweight (Technometrics 16, 1974).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.optimize import brentq, least_squares

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.lab.friction_fit.curve_file import FrictionCurve

UNITS = {'static': '', 'kinetic': '', 'decay': 's/m', 'viscous': 's/m'}
CONFIDENCE = 0.95
TUKEY = 4.685
"""Residuals beyond this many scales count nothing; on clean data 95 % efficient."""
_FLOOR = 1e-14
_PER_DECADE = 10
_MAD = 1.482602218505602
_SMALL_SAMPLE = 2.0
# Residuals beyond this share of the scale count by their amount and not by their square.
_ABSOLUTE = 0.1
_TOLERANCE, _SINGULAR = 1e-15, 1e-12


PLAIN, RISING = ('static', 'kinetic', 'decay'), tuple(UNITS)
"""The free coefficients of the law without and with its viscous slope."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The best curve with some of the law's coefficients free."""

    curve: FrictionCurve  # the points
    names: tuple[str, ...]  # the k free coefficients, in the order of ``UNITS``
    # The drop of the decaying part at the lowest speed [-], ``mu_k`` [-], ``ln beta`` [ln s/m] and
    # ``nu`` [s/m], shape (4,).
    values: FloatArray
    weight: FloatArray  # tukey's weight of each point, shape (n,)
    median_scale: float  # standard deviation by the median residual that the weights go by [-]

    @property
    def decay(self) -> float:
        """``beta`` [s/m]."""
        return math.exp(self.values[2])

    @property
    def fall(self) -> float:
        """``mu_s - mu_k``: the drop, extrapolated from the lowest speed to 0."""
        return float(self.values[0] * np.exp(self.decay * self.curve.speed.min()))

    @property
    def residual(self) -> FloatArray:
        """Measured minus fitted coefficient, shape (n,) [-]."""
        return self._residual_of(self.values)

    @property
    def row_weight(self) -> FloatArray:
        """Weights of the squared residuals: Tukey's, by the variance of each point."""
        return self.weight / self.curve.std**2

    @property
    def scale(self) -> float:
        """Standard deviation of a point, in units of its ``std`` [-]."""
        return math.sqrt(self.variance)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom: the sum of the weights less k."""
        return float(self.weight.sum()) - len(self.names)

    @property
    def squares(self) -> float:
        """Weighted sum of the squared residuals."""
        return float(np.sum(self.row_weight * self.residual**2))

    @property
    def variance(self) -> float:
        """``s^2`` with which ``s^2 (J'WJ)^-1`` is the covariance; exact data keep a floor.

        Huber and Ronchetti, Robust Statistics, 2nd ed., eq. (7.81).
        """
        n, p = self.weight.size, len(self.names)
        ratio = (self.residual / (self.median_scale * self.curve.std * TUKEY)) ** 2
        slope = np.where(ratio < 1.0, (1.0 - ratio) * (1.0 - 5.0 * ratio), 0.0)
        mean = max(float(slope.mean()), 0.1)
        correction = 1.0 + p / n * float(slope.var()) / mean**2
        influence = float(np.sum((self.weight * self.residual / self.curve.std) ** 2)) / (n - p)
        spread = correction**2 * influence / mean**2 * float(self.weight.mean())
        return max(spread, scale_floor(self.curve) ** 2)

    @property
    def t_quantile(self) -> float:
        """How many standard errors make a 95 % interval."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.degrees_of_freedom))

    @property
    def leverage(self) -> FloatArray:
        """Diagonal of the weighted hat matrix, shape (n,)."""
        orthogonal, _ = self._decomposed()
        return np.sum(orthogonal**2, axis=1)

    @property
    def covariance(self) -> FloatArray:
        """``s^2 (J'WJ)^-1`` of the named coefficients, (k, k); ``inf`` where it is singular."""
        _, inverse = self._decomposed()
        return self.variance * (inverse @ inverse.T)

    def band(self, speed: ArrayLike) -> FloatArray:
        """Half width of the curve's pointwise 95 % confidence band at speeds >= 0 [-]."""
        gradient = self._gradient(np.asarray(speed, dtype=float))
        variance = np.einsum('ni,ij,nj->n', gradient, self.covariance, gradient)
        return self.t_quantile * np.sqrt(np.maximum(variance, 0.0))

    def _gradient(self, speed: FloatArray) -> FloatArray:
        """Derivatives of the law at speeds, shape (n,), by the named coefficients, (n, k)."""
        left = np.exp(-self.decay * speed)
        by_decay = -self.values[0] * speed * np.exp(self.decay * (self.curve.speed.min() - speed))
        columns = {'static': left, 'kinetic': 1.0 - left, 'decay': by_decay, 'viscous': speed}
        return np.stack([columns[name] for name in self.names], axis=1)

    def _decomposed(self) -> tuple[FloatArray, FloatArray]:
        """``Q`` (n, k) and ``R^-1`` (k, k) of the weighted gradient; ``inf`` if it is singular."""
        rows = self._gradient(self.curve.speed) * np.sqrt(self.row_weight)[:, None]
        size = np.linalg.norm(rows, axis=0)
        orthogonal, triangle = np.linalg.qr(rows / size)
        if np.abs(np.diag(triangle)).min() > _SINGULAR:
            return orthogonal, np.linalg.inv(triangle) / size[:, None]
        return orthogonal, np.full((size.size, size.size), np.inf)

    def profile(self, rate: FloatArray) -> FloatArray:
        """Least weighted squares at each of some :func:`_rates`, the rest free, shape (rates,)."""
        return self.least_squares_of(_columns(self.curve, self.names, rate))

    def least_squares_of(self, columns: FloatArray) -> FloatArray:
        """Least weighted squares of linear models with columns of shape (models, n, k)."""
        root = np.sqrt(self.row_weight)
        left, size, _ = np.linalg.svd(columns * root[:, None], full_matrices=False)
        target = root * self.curve.coefficient
        seen = np.einsum('bnk,n->bk', left, target) * (size > _SINGULAR * size[:, :1])
        return np.sum((target - np.einsum('bnk,bk->bn', left, seen)) ** 2, axis=1)

    @cached_property
    def decay_interval(self) -> tuple[float, float]:
        """95 % profile interval of ``beta`` [s/m]; 0 or ``inf`` where it has no end.

        Bates and Watts, Nonlinear Regression Analysis, ch. 6.
        """
        span = float(np.ptp(self.curve.speed))
        level = self.squares + self.variance * self.t_quantile**2

        def above(log_rate: float) -> float:
            return float(self.profile(np.exp([log_rate]))[0]) - level

        grid = np.log(_rates(self.curve))
        inside = np.append(
            grid[self.profile(np.exp(grid)) <= level], self.values[2] + math.log(span)
        )

        def end(outside: FloatArray, within: float, without_end: float) -> float:
            if not outside.size:
                return without_end
            # On exact data rounding may leave nothing within.
            if above(within) < 0.0:
                within = float(brentq(above, outside[0], within, xtol=1e-14))
            return math.exp(within) / span

        low, high = float(inside.min()), float(inside.max())
        return end(grid[grid < low][::-1], low, 0.0), end(grid[grid > high], high, math.inf)

    def started(self) -> Solution:
        """The same with the best decay of the scan, by least squares at the weights."""
        curve, rate, values = self.curve, _rates(self.curve), np.zeros(4)
        values[2] = math.log(rate[int(np.argmin(self.profile(rate)))] / np.ptp(curve.speed))
        linear = self._free & [True, True, False, True]
        root = np.sqrt(self.row_weight)
        left = self._derivatives(values)[:, linear] * root[:, None]
        values[linear] = np.linalg.lstsq(left, root * curve.coefficient, rcond=None)[0]
        return replace(self, values=values)

    def descended(self, loss: Any = 'linear') -> Solution:
        """The same with the values that fit best, from these on, at the weights and the scale.

        scipy knows the loss by its name.
        """
        free, root = self._free, np.sqrt(self.row_weight) / self.median_scale

        def whole(part: FloatArray) -> FloatArray:
            full = self.values.copy()
            full[free] = part
            full[2] = min(full[2], 300.0)
            return full

        def misfit(part: FloatArray) -> FloatArray:
            return -root * self._residual_of(whole(part))

        def gradient(part: FloatArray) -> FloatArray:
            return root[:, None] * self._derivatives(whole(part))[:, free]

        found = least_squares(
            misfit, self.values[free], gradient,
            x_scale='jac', loss=loss, f_scale=_ABSOLUTE if loss == 'soft_l1' else TUKEY,
            ftol=_TOLERANCE, xtol=_TOLERANCE, gtol=_TOLERANCE, max_nfev=100,
        )  # fmt: skip
        return replace(self, values=whole(found.x))

    def robust_scale(self) -> float:
        """Standard deviation from the median absolute residual.

        k residuals are small by construction, so the smallest k - 1 are left out (Street, Carroll
        and Ruppert 1988). The median of few residuals scatters: the last factor, 1 for many, keeps
        it from setting good points aside.
        """
        ordered, k = np.sort(np.abs(self.residual / self.curve.std)), len(self.names)
        caution = 1.0 + _SMALL_SAMPLE / (ordered.size - k)
        scale = _MAD * caution * float(np.median(ordered[k - 1 :]))
        return max(scale, scale_floor(self.curve))

    @property
    def _free(self) -> BoolArray:
        """Which of the values are free, shape (4,)."""
        return np.array([name in self.names for name in UNITS])

    def _residual_of(self, values: FloatArray) -> FloatArray:
        drop, kinetic, log_decay, viscous = values
        speed = self.curve.speed
        decayed = np.exp(-np.exp(log_decay) * (speed - speed.min()))
        return self.curve.coefficient - (kinetic + drop * decayed + viscous * speed)

    def _derivatives(self, values: FloatArray) -> FloatArray:
        """Of the law at the points, by all values, shape (n, 4)."""
        path = np.exp(values[2]) * (self.curve.speed - self.curve.speed.min())
        decayed = np.exp(-path)
        rows = [decayed, np.ones_like(path), -values[0] * path * decayed, self.curve.speed]
        return np.stack(rows, axis=1)


def solve(curve: FrictionCurve, names: tuple[str, ...]) -> Solution:
    """The robust fit with some coefficients free, whether or not it makes sense.

    An MM-estimate (Yohai 1987): from the start nearly absolute residuals are minimised, which
    outliers move little. Their median makes the scale at which Tukey's biweight is minimised.
    """
    found = Solution(curve, names, np.zeros(4), np.ones(curve.speed.size), 1.0).started()
    for loss in ('soft_l1', 'soft_l1', _biweight):
        found = replace(found, median_scale=found.robust_scale()).descended(loss)
    ratio = found.residual / (found.median_scale * curve.std * TUKEY)
    return replace(found, weight=np.maximum(1.0 - ratio**2, 0.0) ** 2)


def _biweight(z: FloatArray) -> FloatArray:
    """Tukey's loss of the squared residuals by the scale, with two derivatives, for scipy."""
    left = np.maximum(1.0 - z, 0.0)
    return np.stack([(1.0 - left**3) / 3.0, left**2, -2.0 * left])


def scale_floor(curve: FrictionCurve) -> float:
    """The least scale: what rounding leaves of exact data."""
    return _FLOOR * max(float(np.max(np.abs(curve.coefficient / curve.std))), _FLOOR)


def _rates(curve: FrictionCurve) -> FloatArray:
    """``beta`` times the range of speeds: from a straight line to a step at the lowest speed."""
    place = np.unique(_place(curve))
    top = min(math.log10(40.0 / place[1]), 12.0)
    return np.logspace(-4.0, top, math.ceil((top + 4.0) * _PER_DECADE) + 1)


def _place(curve: FrictionCurve) -> FloatArray:
    """Speeds from 0 for the lowest to 1 for the highest."""
    return (curve.speed - curve.speed.min()) / np.ptp(curve.speed)


def _columns(curve: FrictionCurve, names: Sequence[str], rate: FloatArray) -> FloatArray:
    """Columns that span the law at given rates, well scaled at any, shape (rates, n, k - 1)."""
    x, rate = _place(curve), rate[:, None]
    columns = [np.exp(-rate * x)]
    if 'kinetic' in names:
        columns = [np.ones((rate.size, x.size)), np.expm1(-rate * x) / np.expm1(-rate)]
    if 'viscous' in names:
        columns.append(np.broadcast_to(curve.speed / curve.speed.max(), columns[0].shape))
    return np.stack(columns, axis=2)
