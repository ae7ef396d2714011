# SPDX-License-Identifier: Apache-2.0
"""KBM averages of the exponential Stribeck law, from its closed forms.

With ``Delta = mu_s - mu_k`` and the damping left after the viscous rise ``c + N nu``:
``v = beta V``, ``alpha = beta a``, ``kappa = (c + N nu) / (N Delta beta)``, ``r = mu_k / Delta``.
Below the sliding limit the average is a modified Bessel function, so the Hopf and fold speeds and
the unstable amplitude each follow from one function of one variable,

    ``growth(alpha) = ln(2 I1(alpha) / alpha)``    and    ``decline(v) = v - growth(v)``,

inverted here by Newton's method in a fixed number of steps: an element's value never depends on
what else is in the array.

The functions of a law are those that :mod:`.averages_by_quadrature` has for any other. They take arrays of
shape (n,): surface speeds ``V`` > 0 [m/s] and the damping for each unit of load, ``q = c/N`` [s/m]
(``inf`` without load). What would warn on the way to ``inf`` and ``nan`` is for the caller to silence.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics import averages_by_quadrature
from stickslip_monitor.physics.bearing import balancing_load, damping_per_load
from stickslip_monitor.physics.bessel import i0e, i1e
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.numerics import gauss_rule, root_on_bracket

# Largest argument for which a power series is summed in place of Bessel functions.
_SERIES_LIMIT = 0.5
# Gauss-Legendre nodes of the average beyond the sliding limit.
_NODES, _WEIGHTS = gauss_rule(14)
_Function = Callable[[FloatArray], FloatArray]
# Beyond these a dimensionless speed or its Bessel function leaves the range of a float.
_TINY, _HUGE = 1e-300, 1e200


def _series_or_bessel(x: FloatArray, series: _Function, bessel: _Function) -> FloatArray:
    """Evaluate ``series`` where ``x`` is up to :data:`_SERIES_LIMIT`, ``bessel`` elsewhere."""
    small = x <= _SERIES_LIMIT
    if not small.any():
        return bessel(x)
    result = bessel(np.maximum(x, _SERIES_LIMIT))
    result[small] = series(x[small])
    return result


def _log_excess(alpha: FloatArray) -> FloatArray:
    """Return ``ln(2 I1(alpha)/alpha)`` from the power series, for ``alpha <= 0.5``, of its shape."""
    quarter = 0.25 * alpha * alpha
    total = np.zeros_like(alpha)
    for k in range(8, 0, -1):
        total = (total + 1.0) * quarter / (k * (k + 1.0))
    return np.log1p(total)


def growth(alpha: FloatArray) -> FloatArray:
    """Return ``ln(2 I1(alpha)/alpha)`` for ``alpha`` >= 0, of its shape, to full relative precision."""
    return _series_or_bessel(alpha, _log_excess, lambda large: np.log(2.0 * i1e(large) / large) + large)


def decline(v: FloatArray) -> FloatArray:
    """Return ``-ln(2 exp(-v) I1(v)/v) = v - growth(v)`` for ``v`` >= 0, of its shape; it rises from 0."""
    return _series_or_bessel(
        v, lambda small: small - _log_excess(small), lambda large: np.log(0.5 * large / i1e(large))
    )


def _growth_slope(alpha: FloatArray) -> FloatArray:
    """Return ``d growth / d alpha = I2/I1``, shape of ``alpha``, as precise as Newton's method needs it."""
    return _series_or_bessel(
        alpha,
        lambda small: small / 4.0 * (1.0 - small * small / 24.0),
        lambda large: i0e(large) / i1e(large) - 2.0 / large,
    )


def _decline_slope(v: FloatArray) -> FloatArray:
    """Return ``d decline / dv = 1 - I2(v)/I1(v)``, shape of ``v``."""
    far = 1e6  # I2/I1 tends to 1 - 1.5/v; farther out the difference from 1 has no digits left
    return np.where(v < far, 1.0 - _growth_slope(np.minimum(v, far)), 1.5 / np.maximum(v, 1.0))


@cache
def _known_declines() -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of declines and of the ``v`` that have them, rising, shape (n,) each; cached.

    A ``v`` read between them is off by 1e-6.
    """
    v = np.geomspace(1e-3, 1e5, 2**13)
    return np.log(decline(v)), np.log(v)


def amplitude_for_growth(d: FloatArray) -> FloatArray:
    """Return the ``alpha = beta a`` > 0 at which ``growth(alpha) = d``, for finite ``d`` > 0."""
    alpha = np.sqrt(d) * np.sqrt(d + 8.0)  # between sqrt(8 d) and d + 1.5 ln d
    for _ in range(5):  # the first guess is off by a twentieth at most
        alpha = alpha + (d - growth(alpha)) / _growth_slope(alpha)
    return alpha


def speed_for_decline(decrement: FloatArray) -> FloatArray:
    """Return the ``v = beta V`` > 0 at which ``decline(v) = decrement``, for finite ``decrement`` > 0."""
    # Other guesses would change last bits, and with the nominal fold speed every bit of a level in
    # the recordings of bags/.
    declines, speeds = _known_declines()
    place = np.log(decrement)
    v = np.exp(np.interp(place, declines, speeds))
    outside = (place < declines[0]) | (place > declines[-1])
    if outside.any():
        near = np.minimum(decrement, 1.0)
        far = (2.0 / np.pi) ** (1.0 / 3.0) * np.exp(decrement / 1.5)
        v = np.where(outside, np.where(decrement < 1.0, near + near * near / 8.0, far), v)
    for _ in range(2):
        # In ln v the curve is almost straight, from v << 1 (slope v) to v >> 1 (slope 1.5).
        v = v * np.exp((decrement - decline(v)) / (v * _decline_slope(v)))
    return v


def _beyond_limit(theta: FloatArray, v: FloatArray, kappa: FloatArray, r: float) -> FloatArray:
    """Return ``S/Delta - kappa alpha/2`` at ``alpha = v/cos(theta)``; > 0 where a vibration grows.

    ``S/Delta = exp(-v) I1(alpha) - (2/pi) integral_0^theta (cosh(alpha cos t - v) + r) cos t dt``; the angle
    removes the square root with which the average starts at the sliding limit.

    Args:
        theta: The angle, 0 to below pi/2, shape (n,) [rad].
        v: ``beta V`` > 0, shape (n,).
        kappa: Damping number >= 0, shape (n,).
        r: ``mu_k/Delta`` >= 0.
    """
    cosine, half = np.cos(theta), np.sin(0.5 * theta)
    alpha = v / cosine
    # cos t and cos t - cos theta from the sine of half the angle, without their cancellation.
    half_t = np.sin(theta[:, None] * (0.5 * _NODES))
    above = (half[:, None] - half_t) * (half[:, None] + half_t)
    rise = np.exp(2.0 * alpha[:, None] * above)
    # cosh from one exponential; a row's sum does not depend on the other rows.
    weighted = _WEIGHTS * (1.0 - 2.0 * half_t * half_t)
    loss = np.add.reduce(weighted * (rise + 1.0 / rise), axis=1)
    gain = i1e(alpha) * np.exp(2.0 * v * half * half / cosine) - 0.5 * kappa * alpha
    balance: FloatArray = gain - (2.0 * r * np.sin(theta) + theta * loss) / np.pi
    return balance


def amplitude_of_cycle(v: FloatArray, kappa: FloatArray, r: float) -> FloatArray:
    """Return ``alpha = beta a`` of the stable stick-slip cycle, for points below the fold.

    There is exactly one: the balance is positive at the sliding limit, falls with infinite slope
    in ``alpha`` there and is negative at ``alpha = v + 2`` for every ``kappa, r >= 0``.

    Args:
        v: ``beta V`` > 0, shape (n,).
        kappa: Damping number >= 0 with ``2 I1e(v)/v >= kappa``, shape of ``v``.
        r: ``mu_k/Delta`` >= 0.

    Returns:
        ``alpha`` >= v, shape of ``v``; exactly ``v`` where rounding leaves no room above it.
    """
    highest = 2.0 * np.arcsin(np.sqrt(1.0 / (v + 2.0)))
    ends = i1e(v) - 0.5 * kappa * v, _beyond_limit(highest, v, kappa, r)
    theta = root_on_bracket(
        lambda x, speed, drag: _beyond_limit(x, speed, drag, r), np.zeros_like(v), highest, ends, (v, kappa)
    )
    half = np.sin(0.5 * theta)
    amplitude: FloatArray = v + 2.0 * v * half * half / np.cos(theta)
    return amplitude


def harmonic(law: Stribeck, speed: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Return the averaged friction ``S(a; V)`` [-] at velocity amplitudes ``a`` > 0 [m/s].

    Shape (n,), as ``speed`` and ``amplitude``.
    """
    result, near = np.empty_like(speed), amplitude <= speed
    v, a = speed[near], amplitude[near]
    falls = i1e(law.decay * a) * np.exp(law.decay * a - law.decay * v)
    result[near] = (law.static - law.kinetic) * falls - 0.5 * law.viscous * a
    # Further out the closed form's two terms cancel: quadrature on each side of the reversal does better.
    result[~near] = averages_by_quadrature.harmonic(law, speed[~near], amplitude[~near])
    return result


def _total_fall(law: Stribeck) -> float:
    """Return ``(mu_s - mu_k) beta``, the fall of friction at rest without the viscous rise [s/m]."""
    return (law.static - law.kinetic) * law.decay


def _hopf_number(law: Stribeck, q: FloatArray) -> FloatArray:
    """Return ``beta V`` of the Hopf speed, ``-ln kappa`` [-], shape of ``q = c/N`` [s/m].

    ``nan`` where steady sliding is always stable, ``inf`` where nothing damps it.
    """
    fall = _total_fall(law)
    if fall <= 0.0:
        return np.full_like(q, np.nan)
    number = -np.log((q + law.viscous) / fall)
    return np.where(number > 0.0, number, np.nan)


def hopf_speed(law: Stribeck, q: FloatArray) -> FloatArray:
    """Return ``V_H = -ln(kappa)/beta`` [m/s], shape of ``q``; ``nan`` for none, ``inf`` without damping."""
    return _hopf_number(law, q) / law.decay


def boundaries(law: Stribeck, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Hopf and fold speed [m/s], the fold from ``2 I1e(v)/v = kappa``.

    Args:
        law: Stribeck's law.
        q: ``c/N``, shape (n,) [s/m].

    Returns:
        Two arrays of shape (n,): ``nan`` where there is no boundary, ``inf`` where it has no end.
    """
    number = _hopf_number(law, q)
    fold = speed_for_decline(np.minimum(number, 690.0))  # beyond it the speed leaves the range of a float
    return number / law.decay, np.where(number < np.inf, fold, number) / law.decay


def hopf_load(law: Stribeck, speed: FloatArray, damping: float) -> FloatArray:
    """Return ``N_H = -c/mu'(V)`` at speeds >= 0, of their shape [N]; ``nan`` where friction does not fall.

    It is 0 without damping. Without viscous rise ``c exp(beta V)/(Delta beta)``: the law's slope itself
    underflows from ``beta V`` = 708 on, long before ``N_H`` overflows.
    """
    if law.viscous > 0.0:
        return balancing_load(-law.slope(speed), damping)
    fall = _total_fall(law)
    if fall <= 0.0:
        return np.full_like(speed, np.nan)
    if damping == 0.0:
        return np.zeros_like(speed)
    half = np.exp(0.5 * law.decay * speed)
    return (damping / fall * half) * half


def peak_slope(law: Stribeck, speed: FloatArray) -> FloatArray:
    """Return the largest averaged negative slope ``max_a 2 S/a`` at speeds >= 0 [m/s], of their shape [s/m].

    It is that of the sliding limit.
    """
    v = np.clip(law.decay * speed, _TINY, _HUGE)
    return _total_fall(law) * 2.0 * i1e(v) / v - law.viscous


def has_cycle(law: Stribeck, speed: FloatArray, q: FloatArray, fold: FloatArray) -> BoolArray:
    """Return where a stable cycle exists, shape (n,): at speeds below the averaged ``fold`` [m/s both].

    Neither ``law`` nor ``q`` is used.
    """
    return speed < fold


def is_unstable(law: Stribeck, speed: FloatArray, q: FloatArray, hopf: FloatArray) -> BoolArray:
    """Return where a small disturbance of steady sliding grows, shape (n,): at speeds below ``hopf`` [m/s].

    Not from the slope of ``law``, which underflows; it and ``q`` are not used.
    """
    return speed < hopf


def stable_amplitude(law: Stribeck, speed: FloatArray, q: FloatArray) -> FloatArray:
    """Return the velocity amplitude of the stable cycle [m/s], shape (n,); only for speeds below the fold.

    It is never below the speed; at other speeds it is unspecified, not ``nan``.

    Args:
        law: Stribeck's law.
        speed: Shape (n,) [m/s].
        q: ``c/N``, shape (n,) [s/m].
    """
    v = np.clip(law.decay * speed, _TINY, _HUGE)
    kappa = (q + law.viscous) / _total_fall(law)
    alpha = amplitude_of_cycle(v, kappa, law.kinetic / (law.static - law.kinetic))
    return np.maximum(alpha / law.decay, speed)


def threshold_amplitude(law: Stribeck, speed: FloatArray, damping: float, load: FloatArray) -> FloatArray:
    """Return the velocity amplitude of the unstable cycle [m/s]; only for speeds between Hopf and fold.

    Shape (n,), from speeds [m/s], a damping [N s/m] and loads [N]. It is never above the speed; outside that
    range it is unspecified, not ``nan``.
    """
    # How far the speed is past the Hopf speed, beta V + ln kappa, is near kappa = 1 so small a
    # difference that the amplitude would be off by 1e-10 with the digits of a double: it is taken
    # in extended precision, where the machine has it.
    fall = (np.longdouble(law.static) - law.kinetic) * law.decay
    kappa = (np.longdouble(damping) / load.astype(np.longdouble) + law.viscous) / fall
    rise = (speed * np.longdouble(law.decay) + np.log(kappa)).astype(float)
    return np.minimum(amplitude_for_growth(np.clip(rise, _TINY, _HUGE)) / law.decay, speed)


def cycles(
    law: Stribeck, speed: FloatArray, damping: float, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the velocity amplitudes of all cycles and their stability.

    Args:
        law: The law.
        speed: Surface speed > 0, shape (n,) [m/s].
        damping: Damping >= 0 [N s/m].
        load: Load, shape (n,) [N]; without one above 0 there is no cycle.

    Returns:
        Amplitudes, ascending and padded with ``nan`` [m/s], and 1.0 for a stable, 0.0 for an unstable cycle;
        both of shape (n, 2). Of padding the second may be either.
    """
    q = damping_per_load(damping, load)
    hopf, fold = boundaries(law, q)
    pair = np.full((speed.size, 2), np.nan)
    inside = speed < fold
    if inside.any():  # of a law that does not fall none is
        pair[inside, 1] = stable_amplitude(law, speed[inside], q[inside])
        inside &= speed >= hopf
        pair[inside, 0] = threshold_amplitude(law, speed[inside], damping, load[inside])
    order = np.argsort(pair, axis=1, kind='stable')
    stable = np.broadcast_to([0.0, 1.0], pair.shape)
    return np.take_along_axis(pair, order, 1), np.take_along_axis(stable, order, 1)


def count_cycles(law: Stribeck, speed: FloatArray, q: FloatArray) -> IndexArray:
    """Return the number of cycles at speeds [m/s] and ``q = c/N`` [s/m], shape (n,)."""
    hopf, fold = boundaries(law, q)
    inside = speed < fold
    return inside.astype(np.intp) + (inside & (speed >= hopf))
