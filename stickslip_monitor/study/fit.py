# SPDX-License-Identifier: Apache-2.0
"""Fits the Stribeck law to a measured friction curve, and says how well the curve knows it.

``mu(v) = mu_k + (mu_s - mu_k) exp(-beta v) [+ nu v]``. For a given ``beta`` the law is linear, so
``beta`` is searched over all its decades first (``fit_start``) and no start value is asked for.
From there Tukey's biweight is iterated to convergence (``fit_solve``), the viscous slope is put to
the test (``fit_viscous``), the uncertainty follows (``fit_uncertainty``), and a curve that cannot
identify the law is refused (``fit_identify``).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from stickslip_monitor.errors import FitError
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.study.curve_file import FrictionCurve
from stickslip_monitor.study.fit_identify import (
    has_points,
    require_decay,
    require_distinct,
    require_fall,
    require_kept,
    require_points,
)
from stickslip_monitor.study.fit_result import StribeckFit
from stickslip_monitor.study.fit_solution import Model, Solution
from stickslip_monitor.study.fit_solve import solve
from stickslip_monitor.study.fit_uncertainty import (
    covariance_of,
    decay_interval,
    fall_of,
    leverage_of,
)
from stickslip_monitor.study.fit_viscous import ViscousTest, viscous_test

Viscous = Literal['auto', 'yes', 'no']

_SIGNIFICANT = 2.0


def fit_stribeck(curve: FrictionCurve, viscous: Viscous = 'auto') -> StribeckFit:
    """Fit the Stribeck law to a measured curve.

    Args:
        curve: The curve.
        viscous: Whether the law has a viscous slope; ``'auto'`` where the F-test wants it. With
            ``'yes'`` a slope that is negative by chance is held at 0.

    Returns:
        The law with its uncertainty.

    Raises:
        FitError: The curve cannot identify the law.
    """
    require_points(curve, Model(viscous=viscous == 'yes'))
    test = None
    if has_points(curve, Model(viscous=True)):
        full = solve(curve, Model(viscous=True))
        test = viscous_test(full)
        if viscous == 'yes' and test.t_value < -_SIGNIFICANT:
            raise FitError(
                f'viscous = {test.slope:.4g} s/m (t = {test.t_value:.3g}) must not be negative:'
                ' the curve has no viscous rise; leave it out with --viscous no'
            )
        if (viscous == 'yes' and test.slope >= 0.0) or (viscous == 'auto' and test.demands_slope):
            return _identified(full, test)
    return _identified(solve(curve, Model(viscous=False)), test)


def _identified(free: Solution, test: ViscousTest | None) -> StribeckFit:
    """The fit, if the curve identifies it."""
    require_kept(free)
    require_fall(free)
    require_decay(free, decay_interval(free))
    solution = free
    if free.kinetic < 0.0:
        solution = solve(free.curve, replace(free.model, kinetic=False))
        require_kept(solution)
    covariance = covariance_of(solution)
    require_distinct(solution, covariance)
    kinetic, viscous = max(solution.kinetic, 0.0), max(solution.viscous, 0.0)
    law = Stribeck(kinetic + fall_of(solution), kinetic, solution.decay, viscous)
    names = solution.model.names
    return StribeckFit(
        law=law,
        curve=solution.curve,
        names=names,
        estimate=np.array([getattr(law, name) for name in names]),
        covariance=covariance,
        decay_interval=decay_interval(solution),
        weight=solution.weight,
        residual=solution.residual,
        leverage=leverage_of(solution),
        scale=math.sqrt(solution.variance),
        degrees_of_freedom=solution.freedom,
        viscous_test=test,
    )
