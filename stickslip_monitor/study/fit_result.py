# SPDX-License-Identifier: Apache-2.0
"""The fitted law with its uncertainty, and what a user should know before believing it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.study.curve_file import FrictionCurve
from stickslip_monitor.study.fit_uncertainty import CONFIDENCE, correlation_of, gradient_of
from stickslip_monitor.study.fit_viscous import ViscousTest

Array = NDArray[np.float64]

_MANY_OUTLIERS = 0.2
_MUCH_LEVERAGE = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class StribeckFit:
    """A fitted law with its uncertainty.

    Attributes:
        law: The fitted law.
        curve: What it was fitted to.
        names: The estimated coefficients, k of ``static``, ``kinetic``, ``decay``, ``viscous``.
        estimate: Their values, shape (k,).
        covariance: Their covariance matrix, shape (k, k).
        decay_interval: 95 % profile interval of ``decay`` [s/m].
        weight: Tukey's weight of each point, 1 counts fully, 0 not at all, shape (n,).
        residual: Measured minus fitted coefficient, shape (n,) [-].
        leverage: How far each point draws the curve to itself, 0 to 1, shape (n,).
        scale: Standard deviation of a point, in units of its ``std`` [-].
        degrees_of_freedom: Sum of the weights less k.
        viscous_test: The test of the viscous slope; ``None`` with too few points for it.
    """

    law: Stribeck
    curve: FrictionCurve
    names: tuple[str, ...]
    estimate: Array
    covariance: Array
    decay_interval: tuple[float, float]
    weight: Array
    residual: Array
    leverage: Array
    scale: float
    degrees_of_freedom: float
    viscous_test: ViscousTest | None = None

    @property
    def standard_error(self) -> Array:
        """Standard error of each estimate, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates, shape (k, k)."""
        return correlation_of(self.covariance)

    @property
    def t_quantile(self) -> float:
        """How many standard errors make a 95 % interval."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.degrees_of_freedom))

    @property
    def intervals(self) -> Array:
        """95 % intervals, that of ``decay`` by profile, shape (k, 2)."""
        reach = self.t_quantile * self.standard_error
        both = np.stack([self.estimate - reach, self.estimate + reach], axis=1)
        both[self.names.index('decay')] = self.decay_interval
        return both

    @property
    def outliers(self) -> NDArray[np.intp]:
        """Indices of the points that count less than half, in the curve's order."""
        return np.flatnonzero(self.weight < 0.5)

    @property
    def kinetic_at_bound(self) -> bool:
        """Whether ``kinetic`` would be negative and was held at 0."""
        return 'kinetic' not in self.names

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know before believing the fit, one sentence each."""
        curve, found = self.curve, []
        share = self.outliers.size / self.weight.size
        if share > _MANY_OUTLIERS:
            found.append(
                f'{share:.0%} of the points count less than half: the law may not be the right one'
            )
        if self.kinetic_at_bound:
            found.append('kinetic would be negative and is held at 0, without a standard error')
        reach = self.law.decay * float(curve.speed.min())
        if reach > 1.0:
            found.append(
                f'static is extrapolated: at the lowest speed, {curve.speed.min():.3g} m/s, the'
                f' fall has gone down to {math.exp(-reach):.0%} of it'
            )
        top = int(np.argmax(self.leverage))
        if self.leverage[top] > _MUCH_LEVERAGE:
            found.append(
                f'the point of line {curve.line[top]}, {curve.speed[top]:.3g} m/s, is not checked'
                f' by any other (leverage {self.leverage[top]:.2f}): repeat it'
            )
        return tuple(found)

    def band(self, speed: ArrayLike) -> Array:
        """Half width of the curve's pointwise 95 % confidence band at speeds >= 0 [-]."""
        v = np.asarray(speed, dtype=float)
        fall = self.law.static - self.law.kinetic
        gradient = gradient_of(fall, self.law.decay, v, self.names)
        variance = np.einsum('ni,ij,nj->n', gradient, self.covariance, gradient)
        return self.t_quantile * np.sqrt(np.maximum(variance, 0.0))
