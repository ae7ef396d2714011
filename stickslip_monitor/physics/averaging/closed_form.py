# SPDX-License-Identifier: Apache-2.0
"""Boundaries and amplitudes of a bearing with the Stribeck law, from its closed forms.

All functions take the damping for each unit of load, ``q = c/N`` [s/m] (``inf`` without load), as
an array of shape (n,), and surface speeds ``V`` > 0 [m/s] of the same shape. What would warn on
the way to ``inf`` and ``nan`` is for the caller to silence.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging import dimensionless
from stickslip_monitor.physics.bessel import i1e
from stickslip_monitor.physics.friction import Stribeck

# Beyond these a dimensionless speed or its Bessel function leaves the range of a float.
_TINY, _HUGE, _MOST_DECLINE = 1e-300, 1e200, 690.0


def _fall(law: Stribeck) -> float:
    return (law.static - law.kinetic) * law.decay


def _log_drive(law: Stribeck, q: FloatArray) -> FloatArray:
    """``-ln kappa``: the dimensionless Hopf speed where it is positive."""
    fall = _fall(law)
    if fall <= 0.0:
        return np.full_like(q, -np.inf)
    return -np.log((q + law.viscous) / fall)


def _rise(law: Stribeck, speed: FloatArray, damping: float, load: FloatArray) -> FloatArray:
    """``beta V + ln kappa``: how far the speed is past the Hopf speed.

    Near ``kappa`` = 1 it is so small a difference that the amplitude would be off by 1e-10 with
    the digits of a double: it is taken in extended precision, where the machine has it.
    """
    fall = (np.longdouble(law.static) - law.kinetic) * law.decay
    kappa = (np.longdouble(damping) / load.astype(np.longdouble) + law.viscous) / fall
    return (speed * np.longdouble(law.decay) + np.log(kappa)).astype(float)


def hopf_speed(law: Stribeck, q: FloatArray) -> FloatArray:
    """``V_H = -ln(kappa)/beta`` [m/s]; ``nan`` where there is none, ``inf`` without damping."""
    return boundaries(law, q, with_fold=False)[0]


def boundaries(
    law: Stribeck, q: FloatArray, with_fold: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold speed, with ``2 I1e(v)/v = kappa`` [m/s]; ``nan`` and ``inf`` as for Hopf."""
    number = _log_drive(law, q)
    number = np.where(number > 0.0, number, np.nan)
    hopf = number / law.decay
    if not with_fold:
        return hopf, hopf
    fold = dimensionless.speed_for_decline(np.minimum(number, _MOST_DECLINE)) / law.decay
    endless = number == np.inf
    return hopf, np.where(endless, np.inf, fold) if endless.any() else fold


def boundaries_of_number(law: Stribeck, q: float) -> tuple[float, float]:
    """:func:`boundaries` of one number, finite and >= 0."""
    fall = _fall(law)
    kappa = (q + law.viscous) / fall if fall > 0.0 else math.inf
    if kappa == 0.0:
        return math.inf, math.inf
    number = -float(np.log(kappa))
    if not number > 0.0:
        return math.nan, math.nan
    fold = dimensionless.speed_for_decline_of_number(min(number, _MOST_DECLINE))
    return number / law.decay, fold / law.decay


def hopf_load(law: Stribeck, speed: FloatArray, damping: float) -> FloatArray:
    """``N_H = c exp(beta V)/(Delta beta)`` [N] of a law without viscous rise; ``nan`` if none.

    The law's slope itself underflows from ``beta V`` = 708 on, long before ``N_H`` overflows.
    """
    fall = _fall(law)
    if fall <= 0.0:
        return np.full_like(speed, np.nan)
    if damping == 0.0:
        return np.zeros_like(speed)
    half = np.exp(0.5 * law.decay * speed)
    return (damping / fall * half) * half


def peak_slope(law: Stribeck, speed: FloatArray) -> FloatArray:
    """Largest averaged negative slope ``max_a 2 S/a``, reached at the sliding limit [s/m]."""
    v = np.minimum(np.maximum(law.decay * speed, _TINY), _HUGE)
    return _fall(law) * 2.0 * i1e(v) / v - law.viscous


def stable_amplitude(law: Stribeck, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Velocity amplitude of the stable cycle [m/s], for speeds below the fold speed."""
    v = np.minimum(np.maximum(law.decay * speed, _TINY), _HUGE)
    kappa = (q + law.viscous) / _fall(law)
    alpha = dimensionless.stable_amplitude(v, kappa, law.kinetic / (law.static - law.kinetic))
    return np.maximum(alpha / law.decay, speed)


def stable_amplitude_of_number(law: Stribeck, speed: float, q: float) -> float:
    """:func:`stable_amplitude` of one point."""
    v = min(max(law.decay * speed, _TINY), _HUGE)
    kappa = (q + law.viscous) / _fall(law)
    ratio = law.kinetic / (law.static - law.kinetic)
    return max(dimensionless.stable_amplitude_of_number(v, kappa, ratio) / law.decay, speed)


def threshold_amplitude(
    law: Stribeck, speed: FloatArray, damping: float, load: FloatArray
) -> FloatArray:
    """Velocity amplitude of the unstable cycle [m/s], for speeds between Hopf and fold."""
    rise = np.minimum(np.maximum(_rise(law, speed, damping, load), _TINY), _HUGE)
    return np.minimum(dimensionless.amplitude_for_growth(rise) / law.decay, speed)


def cycles(
    law: Stribeck, speed: FloatArray, damping: float, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Every cycle's velocity amplitude, ascending and padded with ``nan``, and its stability.

    Returns:
        Amplitudes [m/s] and stability (1.0 stable, 0.0 unstable), both of shape (n, 2).
    """
    q = np.where(load > 0.0, damping / load, np.inf)
    hopf, fold = boundaries(law, q)
    pair = np.full((speed.size, 2), np.nan)
    inside = speed < fold
    if inside.any():
        pair[inside, 1] = stable_amplitude(law, speed[inside], q[inside])
    inside &= speed >= hopf
    if inside.any():
        pair[inside, 0] = threshold_amplitude(law, speed[inside], damping, load[inside])
    order = np.argsort(pair, axis=1, kind='stable')
    stable = np.broadcast_to([0.0, 1.0], pair.shape)
    return np.take_along_axis(pair, order, 1), np.take_along_axis(stable, order, 1)
