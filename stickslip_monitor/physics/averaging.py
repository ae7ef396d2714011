# SPDX-License-Identifier: Apache-2.0
"""The Hopf speed and the averaged (KBM) fold, growth and amplitudes of vibrations: first-order averaging.

With ``x - x_e = A cos psi`` and the velocity amplitude ``a = omega A``,

    ``dA/dt = (N S(a; V) - c a/2) / (m omega)``
    ``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt``

(Krylov, Bogoliubov and Mitropolsky's first approximation; the phase average vanishes by symmetry). At the
Hopf boundary the equilibrium loses its stability, ``N mu'(V) + c = 0``; the fold is the last speed
(at a load) with a stick-slip cycle, where the unstable cycle meets the sliding limit ``a = V``. Speeds astern
mirror speeds ahead. A law with several unstable speed ranges is described by its highest Hopf speed.

Conventions of every function: inputs broadcast; a 0-d result comes back as ``float``; ``nan`` says
that there is no such boundary, ``inf`` that no finite speed or load bounds it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, flatten, mapped
from stickslip_monitor.physics import averages_by_quadrature, averages_closed_form
from stickslip_monitor.physics.bearing import Bearing, balancing_load, damping_per_load
from stickslip_monitor.physics.friction import FrictionLaw, Stribeck, computes_as
from stickslip_monitor.physics.lubrication import at_points, gives_load, gives_speed, reference_point


def averages_of(law: FrictionLaw) -> Any:
    """Return the module with a law's averages: closed forms for a plain ``Stribeck``, else quadrature."""
    return averages_closed_form if computes_as(law, Stribeck) else averages_by_quadrature


@gives_speed
def hopf_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """Return the Hopf speed ``V_H`` [m/s] at a load [N]: below it steady sliding is unstable.

    The highest root of ``-N mu'(V) = c``; for Stribeck's law ``ln((mu_s - mu_k) beta N/c)/beta``. It
    is exact: averaging takes nothing away from a small vibration.

    Returns:
        Shape of ``load``; ``nan`` where steady sliding is stable at every speed, as without a load, or the
        load is not finite. Without damping it is ``inf`` for Stribeck's law, and for others the last speed at
        which their fall is looked for.

    >>> float(round(hopf_speed(bearing, 1000.0), 6))  # ln(5)/10
    0.160944
    >>> hopf_speed(bearing, [100.0, 1000.0]).round(3).tolist()
    [nan, 0.161]
    """
    law, c = bearing.friction, bearing.damping
    return mapped(lambda n: averages_of(law).hopf_speed(law, damping_per_load(c, n)), load)


@gives_speed
def fold_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """Return the averaged fold speed ``V_F`` [m/s] at a load [N]: above it no stick-slip cycle exists.

    There the unstable cycle meets the sliding limit ``omega A = V``; for Stribeck's law
    ``2 I1(v) exp(-v)/v = c/((mu_s - mu_k) beta N)`` with ``v = beta V``.

    Returns:
        Shape of ``load``; ``nan`` where no speed has a cycle, as without a load, or the load is not finite,
        ``inf`` where every high speed has one.

    >>> float(bearing.speed.from_surface(fold_speed(bearing, 1000.0), 'rpm').round(2))
    40.72
    """
    law, c = bearing.friction, bearing.damping
    return mapped(lambda n: averages_of(law).boundaries(law, damping_per_load(c, n))[1], load)


@gives_speed
def sticking_end(bearing: Bearing, load: ArrayLike) -> Any:
    """Return the last speed [m/s] at a load [N] at which a cycle reaches the sliding limit, by averaging.

    It is that of :func:`fold_speed` but for laws by which a cycle that never sticks lives on beyond it.

    Returns:
        Shape of ``load``; ``nan`` where no speed has one, as without a load, or the load is not finite,
        ``inf`` where every high speed has one.
    """
    law, c = bearing.friction, bearing.damping
    if averages_of(law) is averages_closed_form:
        return fold_speed(bearing, load)
    return mapped(lambda n: averages_by_quadrature.sticking_end(law, damping_per_load(c, n)), load)


@gives_load
def hopf_load(bearing: Bearing, speed: ArrayLike) -> Any:
    """Return the load [N] above which steady sliding at a surface speed [m/s] is unstable.

    ``N_H = -c/mu'(V)``, the inverse of :func:`hopf_speed`, of the shape of ``speed``; ``nan`` where friction
    does not fall or the speed is not finite, ``inf`` where the load is too large for a float. It is 0
    without damping.

    >>> round(hopf_load(bearing, hopf_speed(bearing, 1000.0)), 6)
    1000.0
    """
    law, c = bearing.friction, bearing.damping
    return mapped(lambda v: averages_of(law).hopf_load(law, np.abs(v), c), speed)


@gives_load
def fold_load(bearing: Bearing, speed: ArrayLike) -> Any:
    """Return the load [N] above which a stick-slip cycle exists at a surface speed [m/s], by averaging.

    The inverse of :func:`fold_speed`, of the shape of ``speed``; ``nan`` where no load has a cycle or the
    speed is not finite, 0 without damping.

    >>> round(fold_load(bearing, fold_speed(bearing, 1000.0)), 6)
    1000.0
    """
    law, c = bearing.friction, bearing.damping
    return mapped(lambda v: balancing_load(averages_of(law).peak_slope(law, np.abs(v)), c), speed)


@at_points(lambda rate, _: rate)
def growth_rate(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Any:
    """Return the growth rate of a small disturbance of steady sliding, ``(-N mu'(V) - c)/(2 m)`` [1/s].

    Args:
        bearing: The bearing.
        speed: Surface speed, of either sign [m/s]; at 0 it is the rate of slow sliding.
        load: Load [N]; broadcasts with ``speed``. A negative one carries no friction.

    Returns:
        Of the broadcast shape; ``nan`` where an input is not finite.

    >>> round(growth_rate(bearing, bearing.speed.to_surface(20.0, 'rpm'), 1000.0), 4)
    3.0184
    """

    def rate(v: FloatArray, n: FloatArray) -> FloatArray:
        """Return the growth rates [1/s] at speeds [m/s] and loads [N], shape (n,) each."""
        drive = np.maximum(n, 0.0) * -bearing.friction.slope(v)
        return (drive - bearing.damping) / (2.0 * bearing.mass)

    return mapped(rate, speed, load)


@dataclass(frozen=True, slots=True)
class StationaryAmplitudes:
    """Displacement amplitudes of all limit cycles under first-order KBM averaging.

    Attributes:
        amplitude: Ascending along the last axis and padded with ``nan``, shape of the broadcast
            inputs plus one axis [m].
        stable: Whether a disturbance of that cycle dies out; same shape, ``False`` as padding.
    """

    amplitude: FloatArray
    stable: NDArray[np.bool_]


@at_points(lambda result, s: replace(result, amplitude=result.amplitude * np.asarray(s)[..., None]))
def stationary_amplitudes(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> StationaryAmplitudes:
    """Return the amplitudes ``A`` > 0 at which ``dA/dt = 0``, with their stability.

    Args:
        bearing: The bearing.
        speed: Surface speed, of either sign [m/s].
        load: Load [N]; broadcasts with ``speed``.

    Returns:
        All cycles of all points, in arrays of the broadcast shape and one more axis, padded with ``nan`` and
        False; none at rest, without load or where an input is not finite.

    >>> cycles = stationary_amplitudes(bearing, bearing.speed.to_surface(34.0, 'rpm'), 1000.0)
    >>> (1e3 * cycles.amplitude).round(3).tolist(), cycles.stable.tolist()  # in mm
    ([0.593, 0.891], [False, True])
    """
    shape, (v, n), usable = _usable_points(speed, load)
    with np.errstate(all='ignore'):
        law = bearing.friction
        a, stable = averages_of(law).cycles(law, v[usable], bearing.damping, n[usable])
        width = a.shape[1]
        amplitude, stability = np.full((v.size, width), np.nan), np.zeros((v.size, width))
        amplitude[usable] = a / bearing.natural_frequency
    stability[usable] = stable
    exists = ~np.isnan(amplitude)
    used = np.flatnonzero(exists.any(axis=0))
    return StationaryAmplitudes(
        amplitude[:, used].reshape(*shape, used.size),
        ((stability > 0.0) & exists)[:, used].reshape(*shape, used.size),
    )


@at_points(lambda counts, _: counts)
def count_cycles(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> NDArray[np.intp]:
    """Return the number of cycles of :func:`stationary_amplitudes`, without solving them.

    Args:
        bearing: The bearing.
        speed: Surface speed, of either sign [m/s].
        load: Load [N]; broadcasts with ``speed``.

    Returns:
        Counts, an array of the broadcast shape, 0-d for numbers; 0 at rest, without load or where an input is
        not finite.

    >>> count_cycles(bearing, bearing.speed.to_surface([20.0, 34.0, 50.0], 'rpm'), 1000.0).tolist()
    [1, 2, 0]
    """
    shape, (v, n), usable = _usable_points(speed, load)
    counts, law = np.zeros(v.size, np.intp), bearing.friction
    with np.errstate(all='ignore'):
        q = damping_per_load(bearing.damping, n[usable])
        counts[usable] = averages_of(law).count_cycles(law, v[usable], q)
    return counts.reshape(shape)


def _usable_points(
    speed: ArrayLike, load: ArrayLike
) -> tuple[tuple[int, ...], list[FloatArray], NDArray[np.bool_]]:
    """Return the broadcast shape of points, their speed magnitudes and loads as a list, and which are usable.

    The arrays are of shape (n,). A point is usable where both are finite and the shaft turns.
    """
    shape, (v, n) = flatten(speed, load)
    v = np.abs(v)
    return shape, [v, n], np.isfinite(v) & np.isfinite(n) & (v > 0.0)


def stable_amplitude(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Return the displacement amplitude of the largest stable cycle [m].

    Args:
        bearing: Bearing without lubrication effects.
        speed: ``V`` > 0, shape (n,) [m/s].
        load: Load, shape (n,) [N].

    Returns:
        Shape (n,). Without a stable cycle it is ``nan`` for a scanned law and unspecified for
        one with closed forms.
    """
    q = damping_per_load(bearing.damping, load)
    law = bearing.friction
    velocity: FloatArray = averages_of(law).stable_amplitude(law, speed, q)
    return velocity / bearing.natural_frequency


def threshold_amplitude(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """Return the displacement amplitude of the smallest unstable cycle at bistable points [m], shape (n,).

    At other points it is unspecified.

    Args:
        bearing: Bearing without lubrication effects.
        speed: ``V`` > 0, shape (n,) [m/s].
        load: Load, shape (n,) [N].
    """
    law = bearing.friction
    velocity: FloatArray = averages_of(law).threshold_amplitude(law, speed, bearing.damping, load)
    return velocity / bearing.natural_frequency


def harmonic(law: FrictionLaw, speed: ArrayLike, amplitude: ArrayLike) -> FloatArray:
    """Return ``S(a; V)``, the in-phase harmonic of the friction coefficient over a cycle.

    Args:
        law: Friction law.
        speed: Surface speed ``V`` [m/s]; astern mirrors ahead.
        amplitude: Velocity amplitude ``a`` >= 0 [m/s]; broadcasts with ``speed``.

    Returns:
        ``S`` [-], an array of the broadcast shape; 0 where ``a`` is not above 0.
    """
    v, a = np.broadcast_arrays(np.abs(np.asarray(speed, float)), np.asarray(amplitude, float))
    moving = a > 0.0
    result = np.zeros(v.shape)
    result[moving] = averages_of(law).harmonic(law, v[moving], a[moving])
    return result


def amplitude_rate(bearing: Bearing, speed: ArrayLike, load: ArrayLike, amplitude: ArrayLike) -> FloatArray:
    """Return the growth ``dA/dt`` of a vibration of displacement amplitude ``A`` under first-order KBM.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` [m/s].
        load: Load ``N`` >= 0 [N].
        amplitude: Displacement amplitude ``A`` >= 0 [m]; all three broadcast.

    Returns:
        ``dA/dt = (N S(omega A; V) - c omega A/2)/(m omega)`` [m/s], shape of the broadcast inputs.

    >>> v = bearing.speed.to_surface(34.0, 'rpm')
    >>> np.sign(amplitude_rate(bearing, v, 1000.0, [0.5e-3, 0.7e-3, 1.0e-3])).tolist()
    [-1.0, 1.0, -1.0]
    """
    omega = bearing.natural_frequency
    speed, load, scale = reference_point(bearing, speed, load)
    a = omega * np.asarray(amplitude, dtype=float) / scale
    drive = np.asarray(load, dtype=float) * harmonic(bearing.friction, speed, a)
    return scale * (drive - 0.5 * bearing.damping * a) / (bearing.mass * omega)
