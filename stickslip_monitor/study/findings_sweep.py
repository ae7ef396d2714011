# SPDX-License-Identifier: Apache-2.0
"""Amplitudes of the limit cycles over speed, load and kinetic coefficient, both branches."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import i1e

from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.bifurcation import fold_load, fold_speed, hopf_load, hopf_speed
from stickslip_monitor.physics.cycle import exact_cycle, exact_fold_speed, exact_unstable_cycle
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.study.findings import stribeck_of
from stickslip_monitor.study.findings_reverse import reverse_time_amplitudes

_NEAR_AN_END = np.geomspace(1e-9, 0.05, 8)
_WIDTHS, _HALVINGS = (1e-4, 1e-3, 1e-2, 0.1, 0.5), 40
_SPEED_ROOM, _LOAD_ROOM, _FALL_ROOM = 1.12, 6.0, 0.55


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Amplitudes of the limit cycles over one parameter, in the parameter's own unit.

    Attributes:
        value: The parameter, rising, close-set beside the bifurcations, shape (n,).
        exact: Displacement amplitude of the exact stick-slip cycle, shape (n,) [m].
        exact_unstable: The same of the exact unstable cycle.
        averaged: Stick-slip amplitude under first-order KBM averaging.
        averaged_unstable: Unstable amplitude under KBM. All four are ``nan`` without a cycle.
        hopf: Parameter at the Hopf bifurcation, the same for both methods.
        exact_fold: Parameter at the exact fold.
        averaged_fold: Parameter at the fold under KBM.
        fold_amplitude: Exact amplitude at the fold [m].
        reverse_value: Parameters at which the unstable cycle was sought in reverse time.
        reverse: Amplitude found there [m].
    """

    value: Array
    exact: Array
    exact_unstable: Array
    averaged: Array
    averaged_unstable: Array
    hopf: float
    exact_fold: float
    averaged_fold: float
    fold_amplitude: float
    reverse_value: Array = field(default_factory=lambda: np.empty(0))
    reverse: Array = field(default_factory=lambda: np.empty(0))

    @property
    def error(self) -> Array:
        """Relative error of the averaged stick-slip amplitude, shape (n,) [-]."""
        return self.averaged / self.exact - 1.0

    @property
    def unstable_error(self) -> Array:
        """Relative error of the averaged unstable amplitude, shape (n,) [-]."""
        return self.averaged_unstable / self.exact_unstable - 1.0

    def columns(self, heading: str) -> dict[str, Array]:
        """The curves as the columns of a table, SI units; the heading is the parameter's."""
        rows = np.argsort(np.concatenate([self.value, self.reverse_value]), kind='stable')

        def column(values: Array, reverse: Array | None = None) -> Array:
            none = np.full(self.reverse_value.size, np.nan)
            return np.concatenate([values, none if reverse is None else reverse])[rows]

        return {
            heading: column(self.value, self.reverse_value),
            'exact_stick_slip_amplitude [m]': column(self.exact),
            'exact_unstable_amplitude [m]': column(self.exact_unstable),
            'kbm_stick_slip_amplitude [m]': column(self.averaged),
            'kbm_unstable_amplitude [m]': column(self.averaged_unstable),
            'reverse_time_unstable_amplitude [m]': column(
                np.full(self.value.size, np.nan), self.reverse
            ),
        }


def over_speed(bearing: Bearing, load: float, points: int = 120, reverse: int = 9) -> Sweep:
    """Amplitude against belt speed, with both branches.

    Args:
        bearing: A bearing with a fold at this load.
        load: Load [N].
        points: Number of even steps in speed.
        reverse: Number of speeds between Hopf and fold at which the unstable cycle is sought in
            reverse time as well.

    Returns:
        The amplitudes over the surface speed [m/s].
    """
    hopf, averaged_fold = float(hopf_speed(bearing, load)), float(fold_speed(bearing, load))
    fold = float(exact_fold_speed(bearing, load))
    highest = _SPEED_ROOM * float(np.fmax(fold, averaged_fold))
    speed = _grid(highest / points, highest, (hopf, fold, averaged_fold), points)
    between = hopf + (fold - hopf) * np.linspace(0.2, 0.97, reverse)
    averaged = assess(bearing, speed, load)
    return _sweep(
        speed,
        np.asarray(exact_cycle(bearing, speed, load).amplitude),
        np.asarray(exact_unstable_cycle(bearing, speed, load).amplitude),
        (averaged.amplitude, averaged.threshold_amplitude),
        (hopf, fold, averaged_fold),
        (between, reverse_time_amplitudes(bearing, between, load)),
    )


def over_load(bearing: Bearing, speed: float, load: float, points: int = 100) -> Sweep:
    """Amplitude against normal force at a belt speed.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: A load with a stick-slip cycle at this speed [N].
        points: Number of even steps in load.

    Returns:
        The amplitudes over the load [N].
    """
    hopf, averaged_fold = float(hopf_load(bearing, speed)), float(fold_load(bearing, speed))
    fold = _edge(lambda n: _has_cycle(bearing, speed, n), averaged_fold)
    highest = max(_LOAD_ROOM * averaged_fold, load)
    loads = _grid(highest / points, highest, (hopf, fold, averaged_fold), points)
    averaged = assess(bearing, speed, loads)
    return _sweep(
        loads,
        np.asarray(exact_cycle(bearing, speed, loads).amplitude),
        np.asarray(exact_unstable_cycle(bearing, speed, loads).amplitude),
        (averaged.amplitude, averaged.threshold_amplitude),
        (hopf, fold, averaged_fold),
    )


def over_kinetic(bearing: Bearing, speed: float, load: float, points: int = 40) -> Sweep:
    """Amplitude against the kinetic friction coefficient, at a belt speed and a load.

    The static coefficient stays, so friction falls by less the larger the kinetic one is. With
    ``kappa = (c + N nu)/(N Delta beta)`` the Hopf lies at ``kappa = exp(-v)`` and the fold under
    KBM at ``kappa = 2 I1e(v)/v``.

    Args:
        bearing: A bearing with a stick-slip cycle at this point.
        speed: Surface speed [m/s].
        load: Load [N].
        points: Number of even steps in the coefficient.

    Returns:
        The amplitudes over ``mu_k`` [-].
    """
    law = stribeck_of(bearing)
    v = law.decay * speed
    damping = (bearing.damping + load * law.viscous) / (load * law.decay)
    hopf, averaged_fold = damping * math.exp(v), damping * 0.5 * v / float(i1e(v))

    def with_fall(fall: float) -> Bearing:
        return replace(bearing, friction=replace(law, kinetic=max(law.static - fall, 0.0)))

    fold = _edge(lambda fall: _has_cycle(with_fall(fall), speed, load), averaged_fold)
    lowest = _FALL_ROOM * averaged_fold
    falls = _grid(lowest, law.static, (hopf, fold, averaged_fold), points)[::-1]
    rows = [_amplitudes(with_fall(fall), speed, load) for fall in falls.tolist()]
    exact, unstable, averaged, averaged_unstable = np.array(rows).T
    ends = (law.static - hopf, law.static - fold, law.static - averaged_fold)
    return _sweep(law.static - falls, exact, unstable, (averaged, averaged_unstable), ends)


def _sweep(
    value: Array,
    exact: Array,
    unstable: Array,
    averaged: tuple[Any, Any],
    ends: tuple[float, float, float],
    reverse: tuple[Array, Array] | None = None,
) -> Sweep:
    hopf, fold, averaged_fold = ends
    exists = np.flatnonzero(np.isfinite(exact))
    nearest = exists[np.argsort(np.abs(value[exists] - fold))[:1]]
    found, amplitude = reverse or (np.empty(0), np.empty(0))
    return Sweep(
        value, exact, unstable, np.asarray(averaged[0]), np.asarray(averaged[1]),
        hopf, fold, averaged_fold, float(np.max(exact[nearest], initial=0.0)), found, amplitude,
    )  # fmt: skip


def _grid(low: float, high: float, ends: tuple[float, ...], points: int) -> Array:
    """Even values, and more beside each bifurcation, where the branches bend."""
    near = np.outer(ends, np.concatenate([1.0 - _NEAR_AN_END, 1.0 + _NEAR_AN_END])).ravel()
    inside = near[(near > low) & (near < high)]
    return np.union1d(np.linspace(low, high, points), inside)


def _has_cycle(bearing: Bearing, speed: float, load: float) -> bool:
    return math.isfinite(exact_cycle(bearing, speed, load).amplitude)


def _edge(exists: Callable[[float], bool], about: float) -> float:
    """The least value with a cycle, sought in ever wider brackets about one close to it."""
    for width in _WIDTHS:
        outside, inside = about * (1.0 - width), about * (1.0 + width)
        if exists(inside) and not exists(outside):
            return _bisected(exists, outside, inside)
    return math.nan


def _bisected(exists: Callable[[float], bool], outside: float, inside: float) -> float:
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        if not outside < middle < inside:
            break
        if exists(middle):
            inside = middle
        else:
            outside = middle
    return inside


def _amplitudes(bearing: Bearing, speed: float, load: float) -> tuple[float, float, float, float]:
    averaged = assess(bearing, speed, load)
    # Where steady sliding is unstable no cycle bounds its basin; looking for one takes a while.
    attracts = averaged.growth_rate <= 0.0
    return (
        exact_cycle(bearing, speed, load).amplitude,
        exact_unstable_cycle(bearing, speed, load).amplitude if attracts else math.nan,
        averaged.amplitude,
        averaged.threshold_amplitude,
    )
