# SPDX-License-Identifier: Apache-2.0
"""Whether the measured curve demands a viscous slope."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from stickslip_monitor.study.fit_solution import Solution, scale_floor
from stickslip_monitor.study.fit_solve import curve_of, gauss_newton_step
from stickslip_monitor.study.fit_start import rates
from stickslip_monitor.study.fit_uncertainty import covariance_of, profile

VISCOUS_LEVEL = 0.01


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
