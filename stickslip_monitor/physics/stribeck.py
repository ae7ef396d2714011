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
from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
from scipy.special import i0e, i1e

from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.quadrature import unit_gauss
from stickslip_monitor.physics.rootfinding import newton_on_bracket

_SERIES_LIMIT = 0.5
_FAR = 1e6
_BLOCK = 4096
_NEWTON_STEPS = 2
_NODES, _WEIGHTS = (np.array(column) for column in zip(*unit_gauss(14), strict=True))
_START_LOGS = np.linspace(math.log(1e-4), math.log(1e5), 121)
_START_SHARES = np.linspace(0.0, 1.0, 41)


def _bessel_excess(alpha: Array) -> Array:
    """``2 I1(alpha)/alpha - 1`` from its power series, for ``alpha <= 0.5``."""
    quarter = 0.25 * alpha * alpha
    total = np.zeros_like(alpha)
    for k in range(8, 0, -1):
        total = (total + 1.0) * quarter / (k * (k + 1.0))
    return total


def _joined(
    alpha: Array, series: Callable[[Array], Array], bessel: Callable[[Array], Array]
) -> Array:
    """The series for small arguments, Bessel functions for the others."""
    result = bessel(np.maximum(alpha, _SERIES_LIMIT))
    small = alpha <= _SERIES_LIMIT
    if small.any():
        result[small] = series(alpha[small])
    return result


def growth(alpha: Array) -> Array:
    """``ln(2 I1(alpha)/alpha)`` for ``alpha`` >= 0, to full relative precision."""
    return _joined(
        alpha,
        lambda small: np.log1p(_bessel_excess(small)),
        lambda large: np.log(2.0 * i1e(large) / large) + large,
    )


def _growth_slope(alpha: Array) -> Array:
    """``d growth / d alpha = I2(alpha)/I1(alpha)``, as precise as Newton's method needs it."""
    return _joined(
        alpha,
        lambda small: small / 4.0 * (1.0 - small * small / 24.0),
        lambda large: i0e(large) / i1e(large) - 2.0 / large,
    )


def decline(v: Array) -> Array:
    """``-ln(2 exp(-v) I1(v)/v) = v - growth(v)``: rises from 0 with ``v``."""
    return _joined(
        v,
        lambda small: small - np.log1p(_bessel_excess(small)),
        lambda large: np.log(0.5 * large / i1e(large)),
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
    alpha = np.where(
        log_d > growths[-1], d + 1.5 * log_d + math.log(math.sqrt(math.pi / 2)), alpha
    )
    for _ in range(2):
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
    for _ in range(2):
        # In ln v the curve is almost straight, from v << 1 (slope v) to v >> 1 (slope 1.5).
        v = v * np.exp(-(decline(v) - decrement) / (v * _decline_slope(v)))
    return v


def sliding_limit_excess(v: Array, kappa: Array) -> Array:
    """``S/Delta - kappa alpha/2`` at the sliding limit ``alpha = v``; negative beyond the fold."""
    return i1e(v) - 0.5 * kappa * v


def _beyond_limit(theta: Array, v: Array, kappa: Array, r: float) -> tuple[Array, Array]:
    """Balance ``S/Delta - kappa alpha/2`` at ``alpha = v / cos(theta)`` and its slope in theta.

    ``S/Delta = exp(-v) I1(alpha)
    - (2/pi) integral_0^theta (cosh(alpha cos t - v) + r) cos t dt``; the angle removes the
    square root with which the average starts at the sliding limit.
    """
    cos_theta, sin_theta = np.cos(theta), np.sin(theta)
    half = np.sin(0.5 * theta)
    alpha = v / cos_theta
    scale = np.exp(2.0 * v * half * half / cos_theta)
    cos_t = np.cos(theta[:, None] * _NODES)
    rise = np.exp(alpha[:, None] * (cos_t - cos_theta[:, None]))
    weighted = _WEIGHTS * cos_t
    # cosh and sinh from one exponential; a row's sum does not depend on the other rows.
    loss = np.add.reduce(weighted * (rise + 1.0 / rise), axis=1)
    loss_slope = np.add.reduce(weighted * cos_t * (rise - 1.0 / rise), axis=1)
    i1 = i1e(alpha) * scale
    drag = 0.5 * kappa * alpha
    balance = i1 - drag - (2.0 * r * sin_theta + theta * loss) / np.pi
    feed = alpha * i0e(alpha) * scale - i1 - drag
    slope = (sin_theta * feed - alpha * sin_theta * theta * loss_slope / np.pi) / cos_theta - (
        2.0 / np.pi
    ) * (r + 1.0) * cos_theta
    return balance, slope


def harmonic_beyond_limit(v: Array, theta: Array, r: float) -> Array:
    """``S/Delta`` at ``alpha = v / cos(theta)``, shape of ``v``; for ``alpha`` up to ``v + 2``.

    Past that the two terms cancel and quadrature on each side of the reversal does better.
    """
    return _beyond_limit(theta, v, np.zeros_like(v), r)[0]


def _tangent_start(v: Array, kappa: Array, r: float) -> Array:
    """``theta`` of the stable cycle to first order about the sliding limit."""
    return 0.5 * np.pi * (i1e(v) - 0.5 * kappa * v) / (1.0 + r)


@lru_cache(maxsize=64)
def _start_table(r: float) -> Array:
    """The stable ``theta`` over its first-order estimate, on a grid of ``ln v`` and ``kappa``.

    ``kappa`` is taken relative to its value at the fold, so the ratio goes to 1 on that side.
    """
    v, share = (grid.ravel() for grid in np.meshgrid(np.exp(_START_LOGS), _START_SHARES[:-1]))
    kappa = share * 2.0 * i1e(v) / v
    start = _tangent_start(v, kappa, r)
    upper = np.arccos(v / (v + 2.0))
    theta = newton_on_bracket(
        lambda x, vv, kk: _beyond_limit(x, vv, kk, r),
        np.zeros_like(v),
        upper,
        np.minimum(start, upper),
        (v, kappa),
    )
    ratio = (theta / start).reshape(_START_SHARES.size - 1, _START_LOGS.size)
    return np.vstack([ratio, np.ones(_START_LOGS.size)])


def stable_amplitude(v: Array, kappa: Array, r: float) -> Array:
    """The ``alpha`` >= v of the stable stick-slip cycle, for points below the fold.

    There is exactly one: the balance is positive at the sliding limit, falls with infinite slope
    in ``alpha`` there and is negative at ``alpha = v + 2`` for every ``kappa, r >= 0``. Newton's
    method starts from a table so close to the root that a fixed number of steps suffices.

    Args:
        v: ``beta V`` > 0, shape (n,).
        kappa: Damping number >= 0 with ``2 I1e(v)/v >= kappa``, shape (n,).
        r: ``mu_k/Delta`` >= 0.

    Returns:
        ``alpha`` >= v, shape (n,); exactly ``v`` where rounding leaves no room above it.
    """
    result = np.empty_like(v)
    for start in range(0, v.size, _BLOCK):
        part = slice(start, start + _BLOCK)
        result[part] = _stable_block(v[part], kappa[part], r)
    return result


def _stable_block(v: Array, kappa: Array, r: float) -> Array:
    table = _start_table(r)
    column = (np.log(v) - _START_LOGS[0]) / (_START_LOGS[1] - _START_LOGS[0])
    column = np.clip(column, 0.0, _START_LOGS.size - 1.000001)
    row = np.clip(0.5 * kappa * v / i1e(v), 0.0, 0.999999) * (_START_SHARES.size - 1)
    i, j = row.astype(np.intp), column.astype(np.intp)
    y, x = row - i, column - j
    low = table[i, j] * (1.0 - x) + table[i, j + 1] * x
    high = table[i + 1, j] * (1.0 - x) + table[i + 1, j + 1] * x
    theta = np.maximum(_tangent_start(v, kappa, r), 0.0) * (low * (1.0 - y) + high * y)
    for _ in range(_NEWTON_STEPS):
        balance, slope = _beyond_limit(theta, v, kappa, r)
        theta = np.maximum(theta - balance / slope, 0.0)
    return v / np.cos(theta)
