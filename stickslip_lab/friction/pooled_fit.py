# SPDX-License-Identifier: Apache-2.0
"""Fits one law to curves measured at several loads or water temperatures.

With ``s = (N/N0)^g eta(T0)/eta(T)`` (:mod:`stickslip_monitor.physics.lubrication`) all points lie on one
curve over ``v/s``. The exponent ``g`` is where its robust misfit is least; its variance and what it
adds to that of the coefficients come from the gradient of the law by ``g``, as those of the coefficients do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from stickslip_lab.friction.curve_file import FrictionCurve
from stickslip_lab.friction.friction_fit import (
    CAUCHY,
    PLAIN,
    StribeckFit,
    Viscous,
    explained_fit_errors,
    fit_stribeck,
    lack_of_points,
    solve_law,
)
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.lubrication import Lubrication, viscosity

MIN_LOAD_RATIO = 1.05
"""Loads that differ by less than this factor are one load: cells scatter by a few per cent."""


@dataclass(frozen=True, eq=False)
class PooledFit(StribeckFit):
    """A law fitted at reference points, with the exponent of the load where loads differ."""

    measured: FrictionCurve = field(kw_only=True)  # the points at their own speeds
    load: float = field(kw_only=True)  # of the reference points, ``N0`` [N]; nan without a column of loads
    temperature: float = field(kw_only=True)  # of the reference points [C]; nan without a column of it
    exponent: float = field(kw_only=True)  # ``g``; 0 where loads do not differ
    has_exponent: bool = field(kw_only=True)  # whether loads differ, so that the exponent was fitted

    @property
    def points(self) -> FrictionCurve:
        """The points as measured."""
        return self.measured

    @property
    def lubrication(self) -> Lubrication | None:
        """The conditions as a bearing has them, the exponent held within 0 to 1; ``None`` without one."""
        if not self.has_exponent:
            return None
        return Lubrication(self.load, min(max(self.exponent, 0.0), 1.0), self.temperature)

    @property
    def free_count(self) -> int:
        """Number of fitted coefficients, with the exponent where loads differ."""
        return len(self.names) + int(self.has_exponent)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the free coefficients, shape (k, k), with what the exponent's error adds."""
        return self.full_covariance[: len(self.names), : len(self.names)]

    @property
    def exponent_error(self) -> float:
        """Standard error of the exponent; 0 without one."""
        return float(np.sqrt(self.full_covariance[-1, -1])) if self.has_exponent else 0.0

    @property
    def exponent_interval(self) -> tuple[float, float]:
        """95 % interval of the exponent, low and high; (0, 0) without one."""
        reach = self.t_quantile * self.exponent_error
        return self.exponent - reach, self.exponent + reach

    @cached_property
    def full_covariance(self) -> FloatArray:
        """Covariance of the free coefficients and, as the last, the exponent where loads differ.

        Shape (k + 1, k + 1), or (k, k) where they do not; ``inf`` where the curve leaves it open.
        """
        orthogonal, inverse = self.decomposed
        covariance = self.scale**2 * (inverse @ inverse.T)
        if not self.has_exponent:
            return covariance
        root = np.sqrt(self.weight) / self.curve.std
        log_load = np.log(np.asarray(self.measured.load, float) / self.load)
        by_exponent = -log_load * self.curve.speed * self.law.slope(self.curve.speed) * root
        along = orthogonal.T @ by_exponent
        variance = self.scale**2 / float(np.sum((by_exponent - orthogonal @ along) ** 2))
        shift = np.append(-inverse @ along, 1.0)
        full = np.pad(covariance, ((0, 1), (0, 1))) + variance * np.outer(shift, shift)
        return np.asarray(full)

    @property
    def sentence(self) -> str:
        """Clause on the effect of the load on friction, with the exponent, or on why there is none.

        It has no capital and no full stop; '' without a column of loads.
        """
        if not self.has_exponent:
            return 'the points are of one load' if self.load == self.load else ''
        low, high = self.exponent_interval
        number = f'g = {self.exponent:.2f} +- {0.5 * (high - low):.2g}'
        if low > 0.0:
            return f'the load explains it ({number})'
        if high < 0.0:
            return f'friction falls with the load in another way ({number}): pool no loads'
        return f'no effect of the load stands out of the scatter ({number})'


def fit_curve(curve: FrictionCurve, viscous: Viscous = 'auto') -> StribeckFit:
    """Fit the law to a curve, or to curves at several loads or water temperatures.

    Args:
        curve: The curve, or the points of all curves.
        viscous: Whether it has a viscous slope, ``'yes'``, ``'no'`` or ``'auto'``: see :func:`.fit_stribeck`.

    Returns:
        A :class:`PooledFit` at the geometric mean load and the mean temperature, if the curve has a load or a
        temperature; else a plain fit.

    Raises:
        FitError: The curve cannot identify the law.
    """
    if curve.load is None and curve.temperature is None:
        return fit_stribeck(curve, viscous)
    load, temperature, ratio = np.nan, np.nan, np.ones(curve.speed.size)
    log_load = np.zeros(curve.speed.size)
    if curve.load is not None:
        load = float(np.exp(np.mean(np.log(curve.load))))
        log_load = np.log(curve.load / load)
    if curve.temperature is not None:
        temperature = float(np.mean(curve.temperature))
        ratio = np.asarray(viscosity(curve.temperature) / viscosity(temperature))

    def reduced(exponent: float) -> FrictionCurve:
        """Return the curve with its speeds divided by ``s``, for an exponent."""
        return replace(curve, speed=curve.speed * ratio * np.exp(-exponent * log_load))

    # Without enough points no exponent is looked for: the fit then says what is missing.
    differs = bool(np.ptp(log_load) > np.log(MIN_LOAD_RATIO)) and not lack_of_points(curve, PLAIN)
    with explained_fit_errors(curve):
        exponent = _fit_exponent(reduced, PLAIN) if differs else 0.0
    fit = fit_stribeck(reduced(exponent), viscous)
    if differs and fit.names != PLAIN:
        with explained_fit_errors(curve):
            exponent = _fit_exponent(reduced, fit.names)
        fit = fit_stribeck(reduced(exponent), viscous)
    values = {field.name: getattr(fit, field.name) for field in fields(StribeckFit)}
    return PooledFit(
        **values, measured=curve, load=load, temperature=temperature, exponent=exponent, has_exponent=differs
    )


def _fit_exponent(reduced: Callable[[float], FrictionCurve], names: tuple[str, ...]) -> float:
    """Return the exponent of the load with the least misfit by Cauchy's loss.

    Numerical errors pass through, as from :func:`.solve_law`.

    Args:
        reduced: Returns the curve at the reference load, for an exponent.
        names: The coefficients that are free.

    Returns:
        The exponent, between -0.5 and 1.5: scatter may take it out of 0 to 1.
    """
    exponents = np.linspace(-0.5, 1.5, 9)
    fits = [solve_law(reduced(float(g)), names) for g in exponents]
    # Nearly absolute residuals choose the start and the scale, which outliers move little.
    best = int(np.argmin([float(np.sum(np.abs(fit.residual / fit.curve.std))) for fit in fits]))
    # By a smaller scale exact points would make the misfit a spike.
    scale = max(fits[best].median_scale, 1e-5 * float(np.ptp(fits[best].curve.coefficient)))

    def misfit(g: float) -> float:
        """Return the sum of Cauchy's loss at an exponent."""
        fit = solve_law(reduced(g), names, scale)
        return float(np.sum(np.log1p((fit.residual / (CAUCHY * scale * fit.curve.std)) ** 2)))

    low, high = exponents[max(best - 1, 0)], exponents[min(best + 1, exponents.size - 1)]
    return float(minimize_scalar(misfit, bounds=(low, high), method='bounded', options={'xatol': 1e-7}).x)
