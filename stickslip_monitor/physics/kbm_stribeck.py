# SPDX-License-Identifier: Apache-2.0
"""Boundaries and amplitudes of a bearing with the Stribeck law, from its closed forms.

All functions take the damping for each unit of load, ``q = c/N`` [s/m] (``inf`` without load), as
an array of shape (n,) in extended precision where the machine has it, and surface speeds ``V`` > 0
[m/s] of the same shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import i1e

from stickslip_monitor.physics import stribeck
from stickslip_monitor.physics.friction import Array, LongArray, Stribeck

# Near kappa = 1 the threshold amplitude is the small difference of beta V and -ln kappa: with
# the digits of a double it would be off by 1e-10 there.
PRECISION = np.longdouble

# Beyond these a dimensionless speed or its Bessel function leaves the range of a float.
_TINY, _HUGE, _MOST_DECLINE = 1e-300, 1e200, 690.0


def _damping_number(law: Stribeck, q: LongArray) -> LongArray:
    """``kappa``; ``inf`` where friction does not fall with speed."""
    fall = (np.longdouble(law.static) - law.kinetic) * law.decay
    if fall <= 0.0:
        return np.full_like(q, np.inf)
    with np.errstate(over='ignore'):
        return (q + law.viscous) / fall


def _long_log_drive(law: Stribeck, q: LongArray) -> LongArray:
    """``-ln kappa`` with the digits that ``beta V + ln kappa`` loses close to the Hopf speed."""
    with np.errstate(divide='ignore'):
        return -np.log(_damping_number(law, q))


def _log_drive(law: Stribeck, q: LongArray) -> Array:
    """``-ln kappa``: the dimensionless Hopf speed where it is positive."""
    return _long_log_drive(law, q).astype(float)


def _where_bounded(number: Array) -> NDArray[np.bool_]:
    return np.isfinite(number) & (number > 0.0)


def hopf_speed(law: Stribeck, q: LongArray) -> Array:
    """``V_H = -ln(kappa)/beta`` [m/s]; ``nan`` where there is none, ``inf`` without damping."""
    number = _log_drive(law, q)
    return np.where(number > 0.0, number / law.decay, np.nan)


def fold_speed(law: Stribeck, q: LongArray) -> Array:
    """``V_F`` with ``2 I1e(v)/v = kappa`` [m/s]; ``nan`` and ``inf`` as for the Hopf speed."""
    number = _log_drive(law, q)
    result = np.where(number > 0.0, np.inf, np.nan)
    bounded = _where_bounded(number)
    decline = np.minimum(number[bounded], _MOST_DECLINE)
    result[bounded] = stribeck.speed_for_decline(decline) / law.decay
    return result


def hopf_load(law: Stribeck, speed: Array, damping: float) -> Array:
    """``N_H = c exp(beta V)/(Delta beta)`` [N] of a law without viscous rise; ``nan`` if none.

    The law's slope itself underflows from ``beta V`` = 708 on, long before ``N_H`` overflows.
    """
    fall = (law.static - law.kinetic) * law.decay
    if fall <= 0.0:
        return np.full_like(speed, np.nan)
    if damping == 0.0:
        return np.zeros_like(speed)
    with np.errstate(over='ignore'):
        half = np.exp(0.5 * law.decay * speed)
        return (damping / fall * half) * half


def peak_slope(law: Stribeck, speed: Array) -> Array:
    """Largest averaged negative slope ``max_a 2 S/a``, reached at the sliding limit [s/m]."""
    with np.errstate(over='ignore'):
        v = np.clip(law.decay * speed, _TINY, _HUGE)
    fall = (law.static - law.kinetic) * law.decay
    return fall * 2.0 * i1e(v) / v - law.viscous


def amplitudes(law: Stribeck, speed: Array, q: LongArray, fold: Array) -> tuple[Array, Array]:
    """Velocity amplitudes of the unstable and of the stable cycle; ``nan`` where there is none.

    Args:
        law: Friction law.
        speed: ``V`` > 0 [m/s], shape (n,).
        q: ``c/N`` [s/m], shape (n,).
        fold: The fold speed at ``q`` [m/s], shape (n,).

    Returns:
        Threshold and stick-slip amplitude [m/s], each of shape (n,).
    """
    threshold, stable = np.full_like(speed, np.nan), np.full_like(speed, np.nan)
    inside = speed < fold
    with np.errstate(over='ignore'):
        number = np.minimum(law.decay * speed, _HUGE)
    v = np.maximum(number[inside], _TINY)
    kappa = _damping_number(law, q[inside]).astype(float)
    if v.size:
        ratio = law.kinetic / (law.static - law.kinetic)
        alpha = stribeck.stable_amplitude(v, kappa, ratio)
        stable[inside] = np.maximum(alpha / law.decay, speed[inside])
    rise = (speed * np.longdouble(law.decay) - _long_log_drive(law, q)).astype(float)
    inside &= rise > 0.0
    alpha = stribeck.amplitude_for_growth(np.minimum(rise[inside], _HUGE))
    threshold[inside] = np.minimum(alpha / law.decay, speed[inside])
    return threshold, stable


def cycles(law: Stribeck, speed: Array, q: LongArray) -> tuple[Array, Array]:
    """Every cycle's velocity amplitude, ascending and padded with ``nan``, and its stability.

    Returns:
        Amplitudes [m/s] and stability (1.0 stable, 0.0 unstable), both of shape (n, 2).
    """
    pair = np.stack(amplitudes(law, speed, q, fold_speed(law, q)), axis=1)
    order = np.argsort(pair, axis=1, kind='stable')
    stable = np.broadcast_to([0.0, 1.0], pair.shape)
    return np.take_along_axis(pair, order, 1), np.take_along_axis(stable, order, 1)


def equilibrium_is_unstable(
    law: Stribeck, speed: Array, q: LongArray, hopf: Array
) -> NDArray[np.bool_]:
    """Where a small disturbance grows; told by the Hopf speed, which cannot underflow."""
    return speed < hopf
