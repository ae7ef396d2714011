# SPDX-License-Identifier: Apache-2.0
"""Where stick-slip begins and ends: Hopf and fold boundaries, growth rate, stationary cycles.

The Hopf boundary is where the equilibrium loses its stability, ``N mu'(V) + c = 0``. The fold is
the last speed (at a load) with a stick-slip cycle under first-order KBM averaging; there the
unstable cycle meets the sliding limit ``a = V``. Speeds astern mirror speeds ahead. A law with
several unstable speed ranges is described by its highest Hopf speed.

Conventions of every function: inputs broadcast; a 0-d result comes back as ``float``; ``nan`` says
that there is no such boundary, ``inf`` that no finite speed or load bounds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.physics import kbm_scan, kbm_stribeck
from stickslip_monitor.physics.arrays import flatten, mapped
from stickslip_monitor.physics.friction import Array, FrictionLaw, Stribeck
from stickslip_monitor.physics.oscillator import Bearing


def kbm(law: FrictionLaw) -> ModuleType:
    """The module that solves the averaged equations of a law."""
    return kbm_stribeck if type(law) is Stribeck else kbm_scan


def damping_per_load(bearing: Bearing, load: Array) -> Array:
    """``q = c/N`` [s/m]; ``inf`` where there is no load. What it warns of means nothing."""
    return np.where(load > 0.0, bearing.damping / load, np.inf)


def hopf_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """Hopf speed ``V_H`` [m/s] at a load [N]: below it steady sliding is unstable."""
    law = bearing.friction
    return mapped(lambda n: kbm(law).hopf_speed(law, damping_per_load(bearing, n)), load)


def fold_speed(bearing: Bearing, load: ArrayLike) -> Any:
    """Fold speed ``V_F`` [m/s] at a load [N]: above it no stick-slip cycle exists."""
    law = bearing.friction
    return mapped(lambda n: kbm(law).fold_speed(law, damping_per_load(bearing, n)), load)


def _load_at(bearing: Bearing, slope: Array) -> Array:
    falling = slope > 0.0
    return np.where(falling, bearing.damping / np.where(falling, slope, 1.0), np.nan)


def hopf_load(bearing: Bearing, speed: ArrayLike) -> Any:
    """Load [N] above which steady sliding at a surface speed [m/s] is unstable.

    An exponential law falls at every speed, so the load is ``inf`` only where it is too large for
    a float.
    """
    law = bearing.friction
    if isinstance(law, Stribeck) and law.viscous == 0.0:
        return mapped(lambda v: kbm_stribeck.hopf_load(law, np.abs(v), bearing.damping), speed)
    return mapped(lambda v: _load_at(bearing, -law.slope(v)), speed)


def fold_load(bearing: Bearing, speed: ArrayLike) -> Any:
    """Load [N] above which a stick-slip cycle exists at a surface speed [m/s]."""
    law = bearing.friction
    return mapped(lambda v: _load_at(bearing, kbm(law).peak_slope(law, np.abs(v))), speed)


def growth_rate(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Any:
    """Growth rate of a small disturbance of steady sliding, ``(-N mu'(V) - c)/(2 m)`` [1/s].

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: Load [N]; a negative one carries no friction.
    """

    def rate(v: Array, n: Array) -> Array:
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

    amplitude: Array
    stable: NDArray[np.bool_]


def stationary_amplitudes(
    bearing: Bearing, speed: ArrayLike, load: ArrayLike
) -> StationaryAmplitudes:
    """Amplitudes ``A`` > 0 at which ``dA/dt = 0``, with their stability.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: Load [N]; broadcasts with ``speed``.

    Returns:
        All cycles of all points; none at rest, without load or where an input is not finite.
    """
    shape, (v, n) = flatten(speed, load)
    v = np.abs(v)
    usable = np.isfinite(v) & np.isfinite(n) & (v > 0.0)
    with np.errstate(all='ignore'):
        a, stable = _cycles(bearing, v[usable], n[usable])
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


def _cycles(bearing: Bearing, speed: Array, load: Array) -> tuple[Array, Array]:
    law = bearing.friction
    if type(law) is Stribeck:
        return kbm_stribeck.cycles(law, speed, bearing.damping, load)
    return kbm_scan.cycles(law, speed, damping_per_load(bearing, load))


def stable_amplitude(bearing: Bearing, speed: Array, load: Array) -> Array:
    """Amplitude of the largest stable cycle [m] where there is one, each shape (n,)."""
    q = damping_per_load(bearing, load)
    return kbm(bearing.friction).stable_amplitude(bearing.friction, speed, q) / (
        bearing.natural_frequency
    )


def threshold_amplitude(bearing: Bearing, speed: Array, load: Array) -> Array:
    """Amplitude of the smallest unstable cycle [m] of bistable points, each shape (n,)."""
    law = bearing.friction
    if type(law) is Stribeck:
        velocity = kbm_stribeck.threshold_amplitude(law, speed, bearing.damping, load)
    else:
        velocity = kbm_scan.threshold_amplitude(law, speed, damping_per_load(bearing, load))
    return velocity / bearing.natural_frequency
