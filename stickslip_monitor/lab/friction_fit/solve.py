# SPDX-License-Identifier: Apache-2.0
"""The robust least-squares fit of a model to a curve, without a start value.

For a given decay the law is linear (variable projection: Golub and Pereyra, SIAM J. Numer. Anal.
10, 1973), so the start is found on a scan of all decades of the decay: by least squares, and where
that leaves points in doubt by the least median of residuals (Rousseeuw 1984). From there
``scipy.optimize.least_squares`` minimises Tukey's biweight (Technometrics 16, 1974).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
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
_TOLERANCE = 1e-15


@dataclass(frozen=True, slots=True)
class Model:
    """Which coefficients are free besides the drop and the decay."""

    viscous: bool
    kinetic: bool = True

    @property
    def free(self) -> BoolArray:
        """Which of drop, kinetic, decay and viscous are free, shape (4,)."""
        return np.array([True, self.kinetic, True, self.viscous])

    @property
    def size(self) -> int:
        """Number of free coefficients, k."""
        return int(self.free.sum())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free coefficients, in the order of ``UNITS``."""
        return tuple(name for name, free in zip(UNITS, self.free, strict=True) if free)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The best curve of a model."""

    curve: FrictionCurve  # the points
    model: Model  # what is free
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
        return self.curve.coefficient - coefficient_at(self.curve, self.values)

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
        return float(self.weight.sum()) - self.model.size

    @property
    def squares(self) -> float:
        """Weighted sum of the squared residuals."""
        return float(np.sum(self.row_weight * self.residual**2))

    @property
    def variance(self) -> float:
        """``s^2`` with which ``s^2 (J'WJ)^-1`` is the covariance; exact data keep a floor.

        Huber and Ronchetti, Robust Statistics, 2nd ed., eq. (7.81).
        """
        n, p = self.weight.size, self.model.size
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
        rows, size = self._scaled_gradient()
        orthogonal, _ = np.linalg.qr(rows / size)
        return np.sum(orthogonal**2, axis=1)

    @property
    def covariance(self) -> FloatArray:
        """``s^2 (J'WJ)^-1`` of the named coefficients, (k, k); ``inf`` where it is singular."""
        away = self.decay * float(self.curve.speed.min())
        by_value = np.diag([math.exp(away), 1.0, self.decay, 1.0])
        by_value[0, 1:3] = 1.0, self.fall * away
        free = self.model.free
        return by_value[np.ix_(free, free)] @ self._covariance() @ by_value[np.ix_(free, free)].T

    def _covariance(self) -> FloatArray:
        """The same of the free values."""
        rows, size = self._scaled_gradient()
        if np.all(np.isfinite(rows)) and np.all(size > 0.0):
            triangle = np.linalg.qr(rows / size, mode='r')
            if np.min(np.abs(np.diag(triangle))) > 1e-12:
                inverse = np.linalg.inv(triangle) / size[:, None]
                return self.variance * (inverse @ inverse.T)
        return np.full((size.size, size.size), np.inf)

    def band(self, speed: ArrayLike) -> FloatArray:
        """Half width of the curve's pointwise 95 % confidence band at speeds >= 0 [-]."""
        gradient = self.gradient(np.asarray(speed, dtype=float))
        variance = np.einsum('ni,ij,nj->n', gradient, self._covariance(), gradient)
        return self.t_quantile * np.sqrt(np.maximum(variance, 0.0))

    def gradient(self, speed: FloatArray) -> FloatArray:
        """Derivatives of the law at speeds, shape (n,), by the free values, shape (n, k)."""
        return _gradient(self.values, speed, float(self.curve.speed.min()))[:, self.model.free]

    def _scaled_gradient(self) -> tuple[FloatArray, FloatArray]:
        """Weighted Jacobian by the free values, shape (n, k), and its columns' lengths, (k,)."""
        rows = self.gradient(self.curve.speed) * np.sqrt(self.row_weight)[:, None]
        return rows, np.linalg.norm(rows, axis=0)

    def profile(self, rate: FloatArray) -> FloatArray:
        """Least weighted squares at each :func:`rates`, the rest being free, shape (rates,)."""
        return self.least_squares_of(columns_of(self.curve, self.model, rate))

    def least_squares_of(self, columns: FloatArray) -> FloatArray:
        """Least weighted squares of linear models with columns of shape (models, n, k)."""
        root = np.sqrt(self.row_weight)
        left, size, _ = np.linalg.svd(columns * root[:, None], full_matrices=False)
        target = root * self.curve.coefficient
        seen = np.einsum('bnk,n->bk', left, target) * (size > 1e-12 * size[:, :1])
        return np.sum((target - np.einsum('bnk,bk->bn', left, seen)) ** 2, axis=1)

    def profile_interval(self) -> tuple[float, float]:
        """95 % profile interval of ``beta`` [s/m]; 0 or ``inf`` where it has no end.

        Bates and Watts, Nonlinear Regression Analysis, ch. 6.
        """
        span = float(np.ptp(self.curve.speed))
        level = self.squares + self.variance * self.t_quantile**2

        def above(log_rate: float) -> float:
            return float(self.profile(np.exp([log_rate]))[0]) - level

        grid = np.log(rates(self.curve))
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


def scale_floor(curve: FrictionCurve) -> float:
    """The least scale: what rounding leaves of exact data."""
    return _FLOOR * max(float(np.max(np.abs(curve.coefficient / curve.std))), _FLOOR)


def rates(curve: FrictionCurve) -> FloatArray:
    """``beta`` times the range of speeds: from a straight line to a step at the lowest speed."""
    place = np.unique(_place(curve))
    top = min(math.log10(40.0 / place[1]), 12.0)
    return np.logspace(-4.0, top, math.ceil((top + 4.0) * _PER_DECADE) + 1)


def _place(curve: FrictionCurve) -> FloatArray:
    """Speeds from 0 for the lowest to 1 for the highest."""
    return (curve.speed - curve.speed.min()) / np.ptp(curve.speed)


def columns_of(curve: FrictionCurve, model: Model, rate: FloatArray) -> FloatArray:
    """Columns that span the law at given rates, well scaled at any, shape (rates, n, k - 1)."""
    x, rate = _place(curve), rate[:, None]
    columns = [np.exp(-rate * x)]
    if model.kinetic:
        columns = [np.ones((rate.size, x.size)), np.expm1(-rate * x) / np.expm1(-rate)]
    if model.viscous:
        columns.append(np.broadcast_to(curve.speed / curve.speed.max(), columns[0].shape))
    return np.stack(columns, axis=2)


def coefficient_at(curve: FrictionCurve, values: FloatArray) -> FloatArray:
    """The law at the points, by :attr:`Solution.values`, shape (n,) [-]."""
    drop, kinetic, log_decay, viscous = values
    decayed = np.exp(-np.exp(log_decay) * (curve.speed - curve.speed.min()))
    return kinetic + drop * decayed + viscous * curve.speed


def _gradient(values: FloatArray, speed: FloatArray, slowest: float) -> FloatArray:
    """Derivatives of the law by all :attr:`Solution.values`, shape (n, 4)."""
    path = np.exp(values[2]) * (speed - slowest)
    decayed = np.exp(-path)
    return np.stack([decayed, np.ones_like(path), -values[0] * path * decayed, speed], axis=1)


def solve(curve: FrictionCurve, model: Model) -> Solution:
    """The robust fit of a model, whether or not it makes sense: an MM-estimate (Yohai 1987).

    From the best decay of the scan by least squares nearly absolute residuals are minimised, which
    outliers move little. Their median makes the scale at which Tukey's biweight is minimised.
    """
    rate = rates(curve)
    unit = Solution(curve, model, np.zeros(4), np.ones(curve.speed.size), 1.0)
    values = np.array([0.0, 0.0, 0.0, 0.0])
    values[2] = math.log(rate[int(np.argmin(unit.profile(rate)))] / np.ptp(curve.speed))
    linear = model.free & [True, True, False, True]
    rows = _gradient(values, curve.speed, curve.speed.min())[:, linear] / curve.std[:, None]
    values[linear] = np.linalg.lstsq(rows, curve.coefficient / curve.std, rcond=None)[0]
    for loss in ('soft_l1', 'soft_l1', _biweight):
        scale = _scale(curve, model, values)
        values = descend(curve, model, values, 1.0 / scale, loss)
    weight = _tukey(_misfit(curve, values) / scale)
    return Solution(curve, model, values, weight, scale)


def descend(
    curve: FrictionCurve,
    model: Model,
    values: FloatArray,
    root: FloatArray | float,
    loss: Any = 'linear',
) -> FloatArray:
    """The values that fit best, from a start of the form of :attr:`Solution.values` on.

    ``root`` times a residual by its std is of the order of 1; scipy knows the loss by its name.
    """
    free, rows, slowest = model.free, root / curve.std, curve.speed.min()

    def whole(part: FloatArray) -> FloatArray:
        full = values.copy()
        full[free] = part
        full[2] = min(full[2], 300.0)
        return full

    def misfit(part: FloatArray) -> FloatArray:
        return rows * (coefficient_at(curve, whole(part)) - curve.coefficient)

    def gradient(part: FloatArray) -> FloatArray:
        return (_gradient(whole(part), curve.speed, slowest) * rows[:, None])[:, free]

    found = least_squares(
        misfit, values[free], gradient, x_scale='jac', loss=loss,
        f_scale=_ABSOLUTE if loss == 'soft_l1' else TUKEY, ftol=_TOLERANCE, xtol=_TOLERANCE,
        gtol=_TOLERANCE, max_nfev=100,
    )  # fmt: skip
    return whole(found.x)


def _biweight(z: FloatArray) -> FloatArray:
    """Tukey's loss of the squared residuals by the scale, with two derivatives, for scipy."""
    left = np.maximum(1.0 - z, 0.0)
    return np.stack([(1.0 - left**3) / 3.0, left**2, -2.0 * left])


def _tukey(misfit: FloatArray) -> FloatArray:
    return np.maximum(1.0 - (misfit / TUKEY) ** 2, 0.0) ** 2


def _misfit(curve: FrictionCurve, values: FloatArray) -> FloatArray:
    return (curve.coefficient - coefficient_at(curve, values)) / curve.std


def _scale(curve: FrictionCurve, model: Model, values: FloatArray) -> float:
    """Standard deviation from the median absolute residual.

    k residuals are small by construction, so the smallest k - 1 are left out (Street, Carroll and
    Ruppert 1988). The median of few residuals scatters: the last factor, 1 for many, keeps it
    from setting good points aside.
    """
    ordered = np.sort(np.abs(_misfit(curve, values)))
    caution = 1.0 + _SMALL_SAMPLE / (ordered.size - model.size)
    return max(_MAD * caution * float(np.median(ordered[model.size - 1 :])), scale_floor(curve))
