# SPDX-License-Identifier: Apache-2.0
"""The unstable cycle as it was published: by integration in reverse time, where it attracts."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing

_START = 0.5
_TURNS, _LAST_TURN, _MOST_CHUNKS = 40.0, 1.25, 200
_TOLERANCE = 1e-10
_SAMPLES = 64


def reverse_time_amplitudes(
    bearing: Bearing, speed: ArrayLike, load: float, accuracy: float = 1e-8
) -> Array:
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


def _settled(flow: Callable[[float, Array], Array], start: Array, accuracy: float) -> Array:
    """The amplitudes at which motions from turning points at ``start`` settle [V/omega]."""
    state = np.concatenate([start, np.zeros(start.size)])
    amplitude, change = np.full((2, start.size), np.inf)
    found = np.full(start.size, np.nan)
    for _ in range(_MOST_CHUNKS):
        state = _followed(flow, 2.0 * np.pi * (_TURNS - _LAST_TURN), state).y[:, -1]
        turn = _followed(flow, 2.0 * np.pi * _LAST_TURN, state, dense_output=True)
        state, before, last = turn.y[:, -1], amplitude, change
        amplitude = np.array([_half_stroke(turn.sol, i, start.size) for i in range(start.size)])
        change = np.abs(amplitude - before)
        # The changes fall as a geometric series, whose rest is what is still to come.
        known = np.isfinite(last) & (change < last)
        rest = np.full(start.size, np.inf)
        rest[known] = change[known] ** 2 / (last[known] - change[known])
        done = np.isnan(found) & (rest <= accuracy * amplitude)
        found[done] = amplitude[done]
        if np.isfinite(found).all():
            break
    return found


def _reversed_flow(bearing: Bearing, v: Array, load: float) -> Callable[[float, Array], Array]:
    law, zeta = bearing.friction, bearing.damping_ratio
    force = load / (bearing.mass * bearing.natural_frequency * v)
    steady = law.coefficient(v)

    def flow(_: float, state: Array) -> Array:
        u, w = state[: v.size], state[v.size :]
        rise = force * (law.coefficient(v * (1.0 - w)) - steady)
        return np.concatenate([-w, u + 2.0 * zeta * w - rise])

    return flow


def _followed(
    flow: Callable[[float, Array], Array], span: float, state: Array, dense_output: bool = False
) -> Any:
    return solve_ivp(
        flow, (0.0, span), state, method='DOP853', rtol=_TOLERANCE, atol=_TOLERANCE * 1e-2,
        dense_output=dense_output,
    )  # fmt: skip


def _half_stroke(solution: Any, index: int, count: int) -> float:
    """Half the way between two successive turning points, ``nan`` if it has none [V/omega]."""
    tau = np.linspace(0.0, 2.0 * np.pi * _LAST_TURN, _SAMPLES)
    w = solution(tau)[count + index]
    turns = np.flatnonzero(w[:-1] * w[1:] <= 0.0)[:2]
    if turns.size < 2:
        return math.nan
    ends = [
        solution(brentq(lambda t: solution(t)[count + index], tau[i], tau[i + 1], xtol=1e-13))
        for i in turns
    ]
    return 0.5 * abs(float(ends[1][index] - ends[0][index]))
