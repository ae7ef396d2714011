# SPDX-License-Identifier: Apache-2.0
"""What the fit's uncertainty means for a bearing: the spread of its Hopf and fold speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.friction_fit.fit import StribeckFit
from stickslip_monitor.lab.friction_fit.solve import CONFIDENCE, UNITS
from stickslip_monitor.physics.averaging import closed_form
from stickslip_monitor.physics.friction import Stribeck, require_positive

# Of a standard error, for the gradient of the delta method.
_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class Spread:
    """What the fit's uncertainty leaves of a quantity that follows from the law."""

    estimate: float  # at the fitted law
    delta_error: float  # standard error by the delta method; ``nan`` where that does not apply
    median: float  # of the drawn laws
    low: float  # 2.5 % quantile of the drawn laws
    high: float  # 97.5 % quantile of the drawn laws


@dataclass(frozen=True, slots=True)
class BoundarySpread:
    """Spread of the boundaries of a bearing; 0 m/s stands for a bearing without a boundary."""

    hopf_speed: Spread  # hopf speed [m/s]
    fold_speed: Spread  # fold speed [m/s]
    without: float  # share of the drawn laws that have no boundary at this load [-]
    # ``V/V_H - 1`` at a speed, ``inf`` without a boundary; ``None`` without speed.
    hopf_margin: Spread | None = None
    fold_margin: Spread | None = None  # ``V/V_F - 1``, likewise
    # Shares of the drawn laws that are unstable, bistable and stable at that speed.
    regimes: dict[str, float] | None = None


def boundary_spread(
    fit: StribeckFit,
    damping: float,
    load: float,
    speed: float | None = None,
    draws: int = 20000,
    seed: int = 0,
) -> BoundarySpread:
    """What the fit's uncertainty means for a bearing.

    Laws are drawn from the multivariate t distribution of (mu_s, mu_k, ln beta, nu) with the fit's
    covariance and degrees of freedom. ``V_H = d/beta`` with ``d = ln(Delta beta/(c/N + nu))``, and
    ``V_F`` follows from the same ``d``; damping ``c`` [N s/m] and load ``N`` [N] are above 0. A
    surface speed > 0 [m/s] has margins, too.

    Raises:
        PhysicsError: A quantity breaks its rule.
    """
    require_positive('damping', damping, 'N s/m')
    require_positive('load', load, 'N')
    require_positive('draws', draws)
    q = damping / load
    best = [float(at[0]) for at in _boundaries(_as_row(fit.law), q)]
    drawn = _boundaries(drawn_laws(fit, draws, seed), q)
    both = list(zip(best, _delta_errors(fit, q), drawn, strict=True))
    hopf, fold = (_spread(*each) for each in both)
    result = BoundarySpread(hopf, fold, float(np.mean(drawn[1] == 0.0)))
    if speed is None:
        return result
    require_positive('speed', speed, 'm/s')
    with np.errstate(divide='ignore'):
        margins = [
            _spread(
                speed / at - 1.0 if at else math.inf,
                speed * error / at**2 if at else math.nan,
                speed / each - 1.0,
            )
            for at, error, each in both
        ]
    unstable, within = (float(np.mean(speed < each)) for each in drawn)
    shares = {'unstable': unstable, 'bistable': within - unstable, 'stable': 1.0 - within}
    return replace(result, hopf_margin=margins[0], fold_margin=margins[1], regimes=shares)


def _as_row(law: Stribeck) -> FloatArray:
    return np.array([[getattr(law, name) for name in UNITS]])


def drawn_laws(fit: StribeckFit, draws: int, seed: int) -> FloatArray:
    """Laws that the curve does not rule out: columns static, kinetic, decay, viscous; (draws, 4).

    They are drawn in ``ln beta``, so that no decay is negative; a negative slope counts as 0.
    """
    scaling = np.where(np.array(fit.names) == 'decay', 1.0 / fit.law.decay, 1.0)
    freedom: Any = fit.degrees_of_freedom  # scipy's types want a whole number
    distribution = stats.multivariate_t(
        shape=fit.covariance * np.outer(scaling, scaling),
        df=freedom,
        allow_singular=True,
        seed=seed,
    )
    off = np.zeros((draws, len(UNITS)))
    off[:, [list(UNITS).index(name) for name in fit.names]] = distribution.rvs(draws)
    laws = _as_row(fit.law) + off
    with np.errstate(over='ignore'):
        laws[:, 2] = fit.law.decay * np.exp(off[:, 2])
    laws[:, 3] = np.maximum(laws[:, 3], 0.0)
    return laws


def _boundaries(laws: FloatArray, q: float) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold speed of many laws at ``q = c/N`` [s/m]; 0 where there is no boundary."""
    static, kinetic, decay, viscous = laws.T
    with np.errstate(invalid='ignore', divide='ignore'):
        number = np.log(np.maximum(static - kinetic, 0.0) * decay / (q + viscous))
    bounded = np.isfinite(number) & (number > 0.0)
    hopf, fold = np.zeros_like(decay), np.zeros_like(decay)
    hopf[bounded] = number[bounded] / decay[bounded]
    fold[bounded] = closed_form.speed_for_decline(number[bounded]) / decay[bounded]
    return hopf, fold


def _delta_errors(fit: StribeckFit, q: float) -> list[float]:
    """Standard errors of Hopf and fold speed by the delta method [m/s]; ``nan`` without them."""
    step = np.zeros((len(fit.names), len(UNITS)))
    step[:, [list(UNITS).index(name) for name in fit.names]] = np.diag(_STEP * fit.standard_error)
    above, below = (_boundaries(_as_row(fit.law) + off, q) for off in (step, -step))
    errors = []
    for high, low in zip(above, below, strict=True):
        gradient = (high - low) / (2.0 * _STEP * fit.standard_error)
        known = bool(np.all(high * low > 0.0))
        errors.append(math.sqrt(gradient @ fit.covariance @ gradient) if known else math.nan)
    return errors


def _spread(estimate: float, delta_error: float, drawn: FloatArray) -> Spread:
    tail = 50.0 * (1.0 - CONFIDENCE)
    # Quantiles without interpolation, which inf would spoil.
    low, median, high = np.percentile(drawn, [tail, 50.0, 100.0 - tail], method='nearest')
    return Spread(estimate, delta_error, float(median), float(low), float(high))
