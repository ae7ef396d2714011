# SPDX-License-Identifier: Apache-2.0
"""First-order KBM averaging of the bearing: how fast the amplitude of a vibration grows.

With ``x - x_e = A cos psi`` and the velocity amplitude ``a = omega A``,

    ``dA/dt = (N S(a; V) - c a/2) / (m omega)``
    ``S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt``

(Krylov, Bogoliubov and Mitropolsky's first approximation; the phase average vanishes by
symmetry). The functions here serve every friction law, in closed form where there is one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import i1e

from stickslip_monitor.physics.friction import Array, Coulomb, FrictionLaw, Stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.quadrature import crossing_angle, friction_harmonic
from stickslip_monitor.physics.stribeck import harmonic_beyond_limit

_CLOSED_FORM_REACH, _CLOSED_FORM_RATIO = 2.0, 8.0


def harmonic(law: FrictionLaw, speed: ArrayLike, amplitude: ArrayLike) -> Array:
    """``S(a; V)``, the in-phase harmonic of the friction coefficient over a cycle.

    Args:
        law: Friction law.
        speed: Surface speed ``V`` [m/s]; astern mirrors ahead.
        amplitude: Velocity amplitude ``a`` >= 0 [m/s]; broadcasts with ``speed``.

    Returns:
        ``S`` [-], shape of the broadcast inputs.
    """
    v, a = np.broadcast_arrays(np.abs(np.asarray(speed, float)), np.asarray(amplitude, float))
    moving = a > 0.0
    result = np.zeros(v.shape)
    result[moving] = _HARMONICS.get(type(law), friction_harmonic)(law, v[moving], a[moving])
    return result


def _coulomb(law: FrictionLaw, speed: Array, amplitude: Array) -> Array:
    assert isinstance(law, Coulomb)
    reach = np.maximum(amplitude, speed)
    sine = np.sqrt((reach - speed) * (reach + speed)) / reach
    return -(2.0 / np.pi) * law.kinetic * sine


def _stribeck(law: FrictionLaw, speed: Array, amplitude: Array) -> Array:
    assert isinstance(law, Stribeck)
    delta = law.static - law.kinetic
    v, alpha = law.decay * speed, law.decay * amplitude
    result = np.empty_like(v)
    near = alpha <= v
    result[near] = delta * i1e(alpha[near]) * np.exp(alpha[near] - v[near])
    # An angle close to pi/2 no longer tells the amplitude to the last digit.
    close = (alpha <= v + _CLOSED_FORM_REACH) & (amplitude <= _CLOSED_FORM_RATIO * speed)
    beyond = ~near & close & (delta != 0.0)
    if beyond.any():
        theta = crossing_angle(speed[beyond], amplitude[beyond], 0.0)
        ratio = law.kinetic / delta
        result[beyond] = delta * harmonic_beyond_limit(v[beyond], theta, ratio)
    far = ~near & ~beyond
    falling = Stribeck(law.static, law.kinetic, law.decay)
    result[far] = friction_harmonic(falling, speed[far], amplitude[far])
    return result - 0.5 * law.viscous * amplitude


_HARMONICS = {Coulomb: _coulomb, Stribeck: _stribeck}


def amplitude_rate(
    bearing: Bearing, speed: ArrayLike, load: ArrayLike, amplitude: ArrayLike
) -> Array:
    """Growth ``dA/dt`` of a vibration of displacement amplitude ``A`` under first-order KBM.

    Args:
        bearing: The bearing.
        speed: Surface speed ``V`` [m/s].
        load: Load ``N`` >= 0 [N].
        amplitude: Displacement amplitude ``A`` >= 0 [m]; all three broadcast.

    Returns:
        ``dA/dt`` [m/s], shape of the broadcast inputs.
    """
    omega = bearing.natural_frequency
    a = omega * np.asarray(amplitude, dtype=float)
    drive = np.asarray(load, dtype=float) * harmonic(bearing.friction, speed, a)
    return (drive - 0.5 * bearing.damping * a) / (bearing.mass * omega)
