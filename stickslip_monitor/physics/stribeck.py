# SPDX-License-Identifier: Apache-2.0
"""KBM averages of the exponential Stribeck law in closed form, in dimensionless groups.

With ``Delta = mu_s - mu_k`` and the damping left after the viscous rise ``c + N nu``:
``v = beta V``, ``alpha = beta a``, ``kappa = (c + N nu) / (N Delta beta)``, ``r = mu_k / Delta``.
Below the sliding limit the average is a modified Bessel function, so the Hopf and fold speeds and
the unstable amplitude each follow from one function of one variable,

    ``growth(alpha) = ln(2 I1(alpha) / alpha)``,

inverted here by Newton's method from a table to the last digit. Each Newton count is fixed, so an
element's value never depends on what else is in the array.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.special import i0e, i1e

from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.rootfinding import newton_on_bracket
from stickslip_monitor.physics.quadrature import unit_gauss

_SERIES_LIMIT = 0.5
_FAR = 1e6
_RULE = unit_gauss(16)


def _bessel_excess(alpha: Array) -> Array:
    """``2 I1(alpha)/alpha - 1`` from its power series, for ``alpha <= 0.5``."""
    quarter = 0.25 * alpha * alpha
    total = np.zeros_like(alpha)
    for k in range(8, 0, -1):
        total = (total + 1.0) * quarter / (k * (k + 1.0))
    return total


def growth(alpha: Array) -> Array:
    """``ln(2 I1(alpha)/alpha)`` for ``alpha`` >= 0, to full relative precision."""
    small = np.minimum(alpha, _SERIES_LIMIT)
    large = np.maximum(alpha, _SERIES_LIMIT)
    return np.where(
        alpha <= _SERIES_LIMIT,
        np.log1p(_bessel_excess(small)),
        np.log(2.0 * i1e(large) / large) + large,
    )


def _growth_slope(alpha: Array) -> Array:
    """``d growth / d alpha = I2(alpha)/I1(alpha)``."""
    small = np.minimum(alpha, _SERIES_LIMIT)
    large = np.maximum(alpha, _SERIES_LIMIT)
    square = small * small
    series = small / 4.0 * (1.0 - square / 24.0 + square * square / 384.0)
    return np.where(alpha <= _SERIES_LIMIT, series, i0e(large) / i1e(large) - 2.0 / large)


def decline(v: Array) -> Array:
    """``-ln(2 exp(-v) I1(v)/v) = v - growth(v)``: rises from 0 with ``v``."""
    small = np.minimum(v, _SERIES_LIMIT)
    large = np.maximum(v, _SERIES_LIMIT)
    return np.where(
        v <= _SERIES_LIMIT,
        small - np.log1p(_bessel_excess(small)),
        np.log(0.5 * large / i1e(large)),
    )


def _decline_slope(v: Array) -> Array:
    # I0/I1 - 2/v tends to 1 - 1.5/v; past _FAR the difference from 1 has no digits left.
    return np.where(v < _FAR, 1.0 - _growth_slope(np.minimum(v, _FAR)), 1.5 / np.maximum(v, 1.0))


@cache
def _table() -> tuple[Array, Array, Array]:
    alpha = np.geomspace(1e-3, 1e5, 3000)
    return np.log(alpha), np.log(growth(alpha)), np.log(decline(alpha))


def amplitude_for_growth(d: Array) -> Array:
    """The ``alpha`` > 0 at which ``growth(alpha) = d``, for finite ``d`` > 0."""
    logs, growths, _ = _table()
    log_d = np.log(d)
    alpha = np.exp(np.interp(log_d, growths, logs))
    alpha = np.where(log_d < growths[0], np.sqrt(8.0 * d), alpha)
    alpha = np.where(log_d > growths[-1], d + 1.5 * log_d + math.log(math.sqrt(math.pi / 2)), alpha)
    for _ in range(3):
        alpha = alpha - (growth(alpha) - d) / _growth_slope(alpha)
    return alpha


def speed_for_decline(decrement: Array) -> Array:
    """The ``v`` > 0 at which ``decline(v) = decrement``, for finite ``decrement`` > 0."""
    logs, _, declines = _table()
    log_l = np.log(decrement)
    v = np.exp(np.interp(log_l, declines, logs))
    v = np.where(log_l < declines[0], decrement + decrement * decrement / 8.0, v)
    far = np.exp((2.0 / 3.0) * (decrement + math.log(2.0 / math.sqrt(2.0 * math.pi))))
    v = np.where(log_l > declines[-1], far, v)
    for _ in range(3):
        # In ln v the curve is almost straight, from v << 1 (slope v) to v >> 1 (slope 1.5).
        v = v * np.exp(-(decline(v) - decrement) / (v * _decline_slope(v)))
    return v


def sliding_limit_excess(v: Array, kappa: Array) -> Array:
    """``S/Delta - kappa alpha/2`` at the sliding limit ``alpha = v``; negative beyond the fold."""
    return i1e(v) - 0.5 * kappa * v


def _beyond_limit(theta: Array, v: Array, kappa: Array, r: Array) -> tuple[Array, Array]:
    """Balance ``S/Delta - kappa alpha/2`` at ``alpha = v / cos(theta)`` and its slope in theta.

    ``S/Delta = exp(-v) I1(alpha)
    - (2/pi) integral_0^theta (cosh(alpha cos t - v) + r) cos t dt``; the angle removes the
    square root with which the average starts at the sliding limit.
    """
    cos_theta = np.cos(theta)
    tan_theta = np.tan(theta)
    half = np.sin(0.5 * theta)
    alpha = v / cos_theta
    scale = np.exp(2.0 * v * half * half / cos_theta)
    loss = np.zeros_like(theta)
    loss_slope = np.zeros_like(theta)
    for node, weight in _RULE:
        t = node * theta
        cos_t = np.cos(t)
        exponent = alpha * (2.0 * np.sin(0.5 * (theta + t)) * np.sin(0.5 * (theta - t)))
        loss += weight * np.cosh(exponent) * cos_t
        loss_slope += weight * np.sinh(exponent) * cos_t * cos_t
    i1 = i1e(alpha) * scale
    drag = 0.5 * kappa * alpha
    balance = i1 - drag - (2.0 / np.pi) * (r * np.sin(theta) + theta * loss)
    rise = alpha * i0e(alpha) * scale - i1 - drag
    slope = tan_theta * rise - (2.0 / np.pi) * (
        (r + 1.0) * cos_theta + alpha * tan_theta * theta * loss_slope
    )
    return balance, slope


def harmonic_beyond_limit(v: Array, theta: Array, r: float) -> Array:
    """``S/Delta`` at ``alpha = v / cos(theta)``, shape of ``v``; for ``alpha`` up to ``v + 2``.

    Past that the two terms cancel and quadrature on each side of the reversal does better.
    """
    return _beyond_limit(theta, v, np.zeros_like(v), np.full_like(v, r))[0]


def stable_amplitude(v: Array, kappa: Array, r: float) -> Array:
    """The ``alpha`` >= v of the stable stick-slip cycle, for points below the fold.

    There is exactly one: the balance is positive at the sliding limit, falls with infinite slope
    in ``alpha`` there and is negative at ``alpha = v + 2`` for every ``kappa, r >= 0``.

    Args:
        v: ``beta V`` > 0, shape (n,).
        kappa: Damping number >= 0 with ``2 I1e(v)/v >= kappa``, shape (n,).
        r: ``mu_k/Delta`` >= 0.

    Returns:
        ``alpha`` >= v, shape (n,); exactly ``v`` where rounding leaves no room above it.
    """
    upper = np.arccos(v / (v + 2.0))
    start = 0.5 * np.pi * sliding_limit_excess(v, kappa) / (1.0 + r)
    theta = newton_on_bracket(
        lambda x, vv, kk: _beyond_limit(x, vv, kk, np.full_like(vv, r)),
        np.zeros_like(v),
        upper,
        np.clip(start, 0.0, upper),
        (v, kappa),
    )
    return v / np.cos(theta)
