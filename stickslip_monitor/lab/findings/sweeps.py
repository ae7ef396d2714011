# SPDX-License-Identifier: Apache-2.0
"""Amplitudes of the limit cycles over speed, load and kinetic coefficient, both branches.

The unstable branch is found twice: by the return map of the exact cycle and, as published, by
integration in reverse time, in which a pure-slip unstable cycle attracts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.optimize import bisect
from scipy.special import i1e

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.findings.published import stribeck_of
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.averaging.boundaries import (
    fold_load,
    fold_speed,
    hopf_load,
    hopf_speed,
)
from stickslip_monitor.physics.cycle.cycles import (
    exact_cycle,
    exact_fold_speed,
    exact_unstable_cycle,
)
from stickslip_monitor.physics.oscillator import Bearing

_START = 0.5
_TURNS, _LAST_TURN, _MOST_CHUNKS = 40.0, 1.25, 200
_TOLERANCE = 1e-10
Flow = Callable[[float, FloatArray], FloatArray]


def reverse_time_amplitudes(
    bearing: Bearing, speed: ArrayLike, load: float, accuracy: float = 1e-8
) -> FloatArray:
    """The unstable pure-slip amplitude by integration in reverse time, as published.

    Where steady sliding is stable, time reversed drives the motion away from it and onto the
    unstable cycle. Every motion begins inside that cycle, with half the amplitude KBM gives it,
    and is followed by Dormand and Prince's method of order 8 until its amplitude stays. With
    ``tau = -omega t``, ``u = omega (x - x_e)/V`` and ``w = x'/V``:

        ``du/dtau = -w``
        ``dw/dtau = u + 2 zeta w - N (mu(V (1 - w)) - mu(V)) / (m omega V)``

    Args:
        bearing: The bearing.
        speed: Surface speeds between Hopf and fold, shape (n,) [m/s].
        load: Load [N].
        accuracy: Relative change that is still to come when an amplitude is taken [-].

    Returns:
        Half the peak-to-peak displacement, shape (n,) [m]; ``nan`` where it did not settle.
    """
    v = np.atleast_1d(np.asarray(speed, dtype=float))
    threshold = np.asarray(assess(bearing, v, load).threshold_amplitude)
    bistable = np.isfinite(threshold)
    found = np.full(v.size, np.nan)
    if bistable.any():
        scale = v[bistable] / bearing.natural_frequency
        start = _START * threshold[bistable] / scale
        flow = _reversed_flow(bearing, v[bistable], load)
        found[bistable] = _settled(flow, start, accuracy) * scale
    return found


def _settled(flow: Flow, start: FloatArray, accuracy: float) -> FloatArray:
    """The amplitudes at which motions from turning points at ``start`` settle [V/omega]."""
    count = start.size
    state = np.concatenate([start, np.zeros(count)])
    amplitude, change = np.full((2, count), np.inf)
    found = np.full(count, np.nan)
    turning = [partial(_velocity, count + i) for i in range(count)]
    for _ in range(_MOST_CHUNKS):
        state = _followed(flow, _TURNS - _LAST_TURN, state).y[:, -1]
        turn = _followed(flow, _LAST_TURN, state, turning)
        ends = [turn.y_events[i][:2, i] for i in range(count)]
        now = np.array([0.5 * np.ptp(x) if x.size == 2 else math.nan for x in ends])
        state, last, change, amplitude = turn.y[:, -1], change, np.abs(now - amplitude), now
        # The changes fall as a geometric series, whose rest is what is still to come.
        known = np.isfinite(last) & (change < last)
        rest = np.full(count, np.inf)
        rest[known] = change[known] ** 2 / (last[known] - change[known])
        done = np.isnan(found) & (rest <= accuracy * amplitude)
        found[done] = amplitude[done]
        if np.isfinite(found).all():
            break
    return found


def _velocity(place: int, _: float, state: FloatArray) -> float:
    return float(state[place])


def _reversed_flow(bearing: Bearing, v: FloatArray, load: float) -> Flow:
    law, zeta = bearing.friction, bearing.damping_ratio
    force = load / (bearing.mass * bearing.natural_frequency * v)
    steady = law.coefficient(v)

    def flow(_: float, state: FloatArray) -> FloatArray:
        u, w = state[: v.size], state[v.size :]
        rise = force * (law.coefficient(v * (1.0 - w)) - steady)
        return np.concatenate([-w, u + 2.0 * zeta * w - rise])

    return flow


def _followed(flow: Flow, turns: float, state: FloatArray, events: Any = None) -> Any:
    return solve_ivp(
        flow, (0.0, 2.0 * np.pi * turns), state, method='DOP853', rtol=_TOLERANCE,
        atol=_TOLERANCE * 1e-2, events=events,
    )  # fmt: skip


_NEAR_AN_END = np.geomspace(1e-9, 0.05, 8)
_WIDTHS = (1e-4, 1e-3, 1e-2, 0.1, 0.5)
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

    value: FloatArray
    exact: FloatArray
    exact_unstable: FloatArray
    averaged: FloatArray
    averaged_unstable: FloatArray
    hopf: float
    exact_fold: float
    averaged_fold: float
    fold_amplitude: float
    reverse_value: FloatArray = field(default_factory=lambda: np.empty(0))
    reverse: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def error(self) -> FloatArray:
        """Relative error of the averaged stick-slip amplitude, shape (n,) [-]."""
        return self.averaged / self.exact - 1.0

    @property
    def unstable_error(self) -> FloatArray:
        """Relative error of the averaged unstable amplitude, shape (n,) [-]."""
        return self.averaged_unstable / self.exact_unstable - 1.0

    def columns(self, heading: str) -> dict[str, FloatArray]:
        """The curves as the columns of a table, SI units; the heading is the parameter's."""
        rows = np.argsort(np.concatenate([self.value, self.reverse_value]), kind='stable')

        def column(values: FloatArray, reverse: FloatArray | None = None) -> FloatArray:
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
    value: FloatArray,
    exact: FloatArray,
    unstable: FloatArray,
    averaged: tuple[Any, Any],
    ends: tuple[float, float, float],
    reverse: tuple[FloatArray, FloatArray] | None = None,
) -> Sweep:
    hopf, fold, averaged_fold = ends
    exists = np.flatnonzero(np.isfinite(exact))
    nearest = exists[np.argsort(np.abs(value[exists] - fold))[:1]]
    found, amplitude = reverse or (np.empty(0), np.empty(0))
    return Sweep(
        value, exact, unstable, np.asarray(averaged[0]), np.asarray(averaged[1]),
        hopf, fold, averaged_fold, float(np.max(exact[nearest], initial=0.0)), found, amplitude,
    )  # fmt: skip


def _grid(low: float, high: float, ends: tuple[float, ...], points: int) -> FloatArray:
    """Even values, and more beside each bifurcation, where the branches bend."""
    near = np.outer(ends, np.concatenate([1.0 - _NEAR_AN_END, 1.0 + _NEAR_AN_END])).ravel()
    inside = near[(near > low) & (near < high)]
    return np.union1d(np.linspace(low, high, points), inside)


def _has_cycle(bearing: Bearing, speed: float, load: float) -> bool:
    return math.isfinite(exact_cycle(bearing, speed, load).amplitude)


def _edge(exists: Callable[[float], bool], about: float) -> float:
    """Where a cycle begins to exist, sought in ever wider brackets about a value close to it."""
    for width in _WIDTHS:
        outside, inside = about * (1.0 - width), about * (1.0 + width)
        if exists(inside) and not exists(outside):
            return float(bisect(lambda x: exists(x) - 0.5, outside, inside, xtol=1e-14 * about))
    return math.nan


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
