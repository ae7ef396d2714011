# SPDX-License-Identifier: Apache-2.0
"""What the fit's uncertainty means for a bearing: the spread of its Hopf and fold speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ive

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.friction_fit.fit import StribeckFit
from stickslip_monitor.lab.friction_fit.solve import UNITS
from stickslip_monitor.lab.friction_fit.uncertainty import CONFIDENCE
from stickslip_monitor.physics.averaging import closed_form
from stickslip_monitor.physics.friction import Stribeck, require_positive


@dataclass(frozen=True, slots=True)
class Spread:
    """What the fit's uncertainty leaves of a quantity that follows from the law.

    Attributes:
        estimate: At the fitted law.
        delta_error: Standard error by the delta method; ``nan`` where that does not apply.
        median: Of the drawn laws.
        low: 2.5 % quantile of the drawn laws.
        high: 97.5 % quantile of the drawn laws.
    """

    estimate: float
    delta_error: float
    median: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class BoundarySpread:
    """Spread of the boundaries of a bearing; 0 m/s stands for a bearing without a boundary.

    Attributes:
        hopf_speed: Hopf speed [m/s].
        fold_speed: Fold speed [m/s].
        without: Share of the drawn laws that have no boundary at this load [-].
        hopf_margin: ``V/V_H - 1`` at a speed, ``inf`` without a boundary; ``None`` without speed.
        fold_margin: ``V/V_F - 1``, likewise.
        regimes: Shares of the drawn laws that are unstable, bistable and stable at that speed.
    """

    hopf_speed: Spread
    fold_speed: Spread
    without: float
    hopf_margin: Spread | None = None
    fold_margin: Spread | None = None
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
    ``V_F`` follows from the same ``d``. The delta method takes the gradient in closed form.

    Args:
        fit: The fit.
        damping: ``c`` > 0 of the bearing [N s/m].
        load: ``N`` > 0 [N].
        speed: Surface speed > 0 for the margins [m/s].
        draws: Number of laws drawn.
        seed: Of the random generator; the same seed gives the same answer.

    Raises:
        PhysicsError: A quantity breaks its rule.
    """
    require_positive('damping', damping, 'N s/m')
    require_positive('load', load, 'N')
    require_positive('draws', draws)
    laws = drawn_laws(fit, draws, seed)
    hopf, fold = _boundaries(laws, damping / load)
    best = _boundaries(_as_row(fit.law), damping / load)
    errors = _delta_errors(fit, damping / load)
    spreads = [
        _spread(float(at[0]), error, drawn)
        for at, error, drawn in zip(best, errors, (hopf, fold), strict=True)
    ]
    result = BoundarySpread(spreads[0], spreads[1], float(np.mean(fold == 0.0)))
    if speed is None:
        return result
    require_positive('speed', speed, 'm/s')
    with np.errstate(divide='ignore'):
        margins = [
            _spread(
                float(speed / at[0] - 1.0) if at[0] else math.inf,
                speed * error / float(at[0]) ** 2 if at[0] else math.nan,
                speed / drawn - 1.0,
            )
            for at, error, drawn in zip(best, errors, (hopf, fold), strict=True)
        ]
    unstable, within = float(np.mean(speed < hopf)), float(np.mean(speed < fold))
    shares = {'unstable': unstable, 'bistable': within - unstable, 'stable': 1.0 - within}
    return replace(result, hopf_margin=margins[0], fold_margin=margins[1], regimes=shares)


def _as_row(law: Stribeck) -> FloatArray:
    return np.array([[law.static, law.kinetic, law.decay, law.viscous]])


def drawn_laws(fit: StribeckFit, draws: int, seed: int) -> FloatArray:
    """Laws that the curve does not rule out: columns static, kinetic, decay, viscous; (draws, 4).

    They are drawn in ``ln beta``, so that no decay is negative; a negative slope counts as 0.
    """
    generator = np.random.Generator(np.random.PCG64(seed))
    place = fit.names.index('decay')
    scaling = np.ones(len(fit.names))
    scaling[place] = 1.0 / fit.law.decay
    factor = np.linalg.cholesky(fit.correlation) * (fit.standard_error * scaling)[:, None]
    freedom = fit.degrees_of_freedom
    normal = generator.standard_normal((draws, len(fit.names)))
    wide = np.sqrt(freedom / generator.chisquare(freedom, draws))
    drawn = (normal @ factor.T) * wide[:, None]
    laws = np.repeat(_as_row(fit.law), draws, axis=0)
    for column, name in enumerate(fit.names):
        laws[:, list(UNITS).index(name)] += drawn[:, column] * (name != 'decay')
    with np.errstate(over='ignore'):
        laws[:, 2] *= np.exp(drawn[:, place])
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


def _delta_errors(fit: StribeckFit, q: float) -> tuple[float, float]:
    """Standard errors of Hopf and fold speed by the delta method [m/s]."""
    gradients = boundary_gradients(fit.law, q)
    if gradients is None:
        return math.nan, math.nan
    free = [list(UNITS).index(name) for name in fit.names]
    hopf, fold = (g[free] for g in gradients)
    return math.sqrt(hopf @ fit.covariance @ hopf), math.sqrt(fold @ fit.covariance @ fold)


def boundary_gradients(law: Stribeck, q: float) -> tuple[FloatArray, FloatArray] | None:
    """Derivatives of Hopf and fold speed by static, kinetic, decay, viscous at ``q = c/N``.

    ``dv_F/dd = 1/(1 - I2(v_F)/I1(v_F))`` by ``2 I1(v) exp(-v)/v = exp(-d)`` and
    ``I0 - I2 = 2 I1/v``.

    Returns:
        Two arrays of shape (4,) [m/s for each unit]; ``None`` where there is no boundary.
    """
    fall, decay = law.static - law.kinetic, law.decay
    hopf, fold = (float(at[0]) for at in _boundaries(_as_row(law), q))
    if hopf == 0.0:
        return None
    by_fall, by_viscous = 1.0 / fall, -1.0 / (q + law.viscous)
    number = np.array([by_fall, -by_fall, 1.0 / decay, by_viscous])
    stretch = np.array([0.0, 0.0, 1.0 / decay, 0.0])
    v = fold * decay
    steep = 1.0 / (1.0 - float(ive(2, v) / ive(1, v)))
    return number / decay - hopf * stretch, steep * number / decay - fold * stretch


def _spread(estimate: float, delta_error: float, drawn: FloatArray) -> Spread:
    tail = 50.0 * (1.0 - CONFIDENCE)
    # Quantiles without interpolation, which inf would spoil.
    low, median, high = np.percentile(drawn, [tail, 50.0, 100.0 - tail], method='nearest')
    return Spread(estimate, delta_error, float(median), float(low), float(high))
