# SPDX-License-Identifier: Apache-2.0
"""How probable the reports of a dip are, given the bearing: a filter of two hidden states.

Quiet and sticking change with probabilities that follow from the path of speed and load alone.
With ``v = beta V``, ``d = ln(N/N0) - ln(1 + nu N/c)`` and the fold at ``d = D(v)``:

* beyond the fold a cycle survives the time ``E`` spent there with
  ``S_e = 1 - exp(-exp(-4 (E/tau_e - 1)))``; back inside, ``E`` is given back second by second;
* in the bistable range, ``x = (v - d)/(v - D(v))`` of the way from the Hopf speed to the fold,
  blows begin a cycle at the rate ``lambda exp(-4 x)`` and end one at ``lambda exp(-4 (1 - x))``;
* while steady sliding is unstable noise grows, ``G += (exp(d - v) - 1) h/tau``, and has not yet
  become stick-slip with ``S = 1 - exp(-exp(-2 L (G - 1)))``: the Gumbel law of a Rayleigh
  distributed envelope that is ``L`` e-folds below stick-slip. In the bistable range ``G`` falls
  again at its own rate.

A report is either right, and then the state that contradicts it never ran in its core, or, with a
small probability, worthless. Every dip has a boundary of its own: ``ln beta`` shifted by ``s z``
with ``z ~ N(0, 1)``. The functions of numbers are compiled where numba is installed.
"""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics import chances
from stickslip_monitor.physics.belief import curve_of_decline
from stickslip_monitor.physics.chances import decline_at

PARAMETERS = ('ln_beta', 'ln_n0', 'ln_tau', 'ln_tau_e', 'ln_lambda', 'ln_s', 'ln_folds')
"""Names of a point's coordinates; ``beta`` [s/m], ``N0`` [N], ``tau`` [s], ``tau_e`` [s],
``lambda`` [1/s], ``s`` [-], ``L`` [-]."""

H, SPEED, LOG_SPEED, LOAD_TERM, STATE, BEGIN, RIGHT, WRONG = range(8)
"""Columns of a dip's path: seconds since the last row (in the first one the probability that a
dip which begins inside the fold begins with sticking), speed [m/s], its logarithm,
``ln(N/(1 + nu N/c))``, the state that is reported, whether a report begins, and at its end the
probabilities that it is right, and that it is worthless and says just this."""
QUIET, STICKING = 1, 2
"""The states of :data:`STATE`; 0 where nothing is reported."""

_NODES = np.linspace(-2.6, 2.6, 9)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()
_END_SHAPE = 4.0
_LEAST = 1e-300
# What is followed: probabilities of quiet and of sticking; the same if the running report is
# right; time beyond the fold, growth of noise, the most of it so far, its pace, D - d before.
_SPENT, _GROWTH, _MOST, _PACE, _BEFORE, _SIZE = range(4, 10)


def log_likelihood(theta: FloatArray, path: FloatArray) -> FloatArray:
    """Log likelihood of one dip's reports, and how doubtful each report is.

    Args:
        theta: Points, :data:`PARAMETERS`, shape (n, 7).
        path: The dip, shape (bins, 8).

    Returns:
        Shape (n, 1 + reports): the logarithm, then for each report the probability, after all
        that came before it, that it is worthless.
    """
    reports = int(np.count_nonzero((path[:, RIGHT] > 0.0) | (path[:, WRONG] > 0.0)))
    out = np.zeros((theta.shape[0], 1 + reports))
    if reports:
        loop: Any = fill_log_likelihoods
        if jit.has_compiler():
            loop = jit.compiled('fill_log_likelihoods', sys.modules[__name__], chances)
        loop(theta, _NODES, _WEIGHTS, path, curve_of_decline(), out)
    return out


def fill_log_likelihoods(
    theta: Any, nodes: Any, weights: Any, path: Any, curve: Any, out: Any
) -> None:
    """The loop of :func:`log_likelihood` over points and over the dip's own boundaries."""
    doubts = np.zeros((nodes.shape[0], out.shape[1]))
    values = np.zeros(nodes.shape[0])
    for i in range(theta.shape[0]):
        for k in range(nodes.shape[0]):
            log_beta = theta[i, 0] + math.exp(theta[i, 5]) * nodes[k]
            values[k] = _follow(path, curve, log_beta, theta[i], doubts[k])
        best = values.max()
        share = weights * np.exp(values - best)
        out[i, 0] = best + math.log(share.sum())
        for r in range(1, out.shape[1]):
            out[i, r] = (share * doubts[:, r]).sum() / share.sum()


def _follow(path: Any, curve: Any, log_beta: float, point: Any, doubts: Any) -> float:
    beta, result, report = math.exp(log_beta), 0.0, 0
    tau, tau_e, rate = math.exp(point[2]), math.exp(point[3]), math.exp(point[4])
    folds = math.exp(point[6])
    state = np.zeros(_SIZE)
    for t in range(path.shape[0]):
        h, v, d = path[t, H], beta * path[t, SPEED], path[t, LOAD_TERM] - point[1]
        value = decline_at(curve, log_beta + path[t, LOG_SPEED])
        if t == 0:
            state[1] = h if value < d else 0.0
            state[0] = 1.0 - state[1]
            state[_PACE] = math.exp(min(d - v, 50.0)) - 1.0
        elif value >= d:
            off = _ends_beyond(state, h, value - d, tau_e)
            _move(state, 0.0, off)
        else:
            stay = _still_noise(state, h, d - v, tau, folds)
            on, off = _blown(v, d, value, rate * h)
            _move(state, 1.0 - stay * (1.0 - on), off)
        state[_BEFORE] = value - d
        if path[t, STATE] > 0.0:
            _hear(state, path[t, STATE], path[t, BEGIN])
            right, wrong = path[t, RIGHT], path[t, WRONG]
            if right > 0.0 or wrong > 0.0:
                report += 1
                total = _close(state, right, wrong)
                result += math.log(total)
                doubts[report] = wrong / total
    return result


def _ends_beyond(state: Any, h: float, excess: float, tau_e: float) -> float:
    """Probability that a cycle ends in a bin beyond the fold; noise begins anew."""
    old, before = state[_SPENT], state[_BEFORE]
    state[_SPENT] += h if before >= 0.0 else h * excess / (excess - before)
    state[_GROWTH], state[_MOST], state[_PACE] = 0.0, 0.0, -1.0
    if state[_SPENT] > 3.0 * tau_e:
        return 1.0
    return 1.0 - _survival(_END_SHAPE, state[_SPENT] / tau_e) / _survival(_END_SHAPE, old / tau_e)


def _survival(shape: float, share: float) -> float:
    """``1 - exp(-exp(-shape (share - 1)))``."""
    return -math.expm1(-math.exp(min(-shape * (share - 1.0), 50.0)))


def _still_noise(state: Any, h: float, drive: float, tau: float, folds: float) -> float:
    """Let noise grow or decay; the probability that it has not become a cycle in this bin."""
    state[_SPENT] = max(0.0, state[_SPENT] - h)
    pace = math.exp(min(drive, 50.0)) - 1.0
    growth = max(0.0, state[_GROWTH] + 0.5 * (state[_PACE] + pace) * h / tau)
    state[_GROWTH], state[_PACE] = growth, pace
    most = state[_MOST]
    state[_MOST] = max(most, growth) if growth > 0.0 else 0.0
    if growth <= most:
        return 1.0
    left = _survival(2.0 * folds, most)
    return _survival(2.0 * folds, growth) / left if left > _LEAST else 0.0


def _blown(v: float, d: float, value: float, blows: float) -> tuple[float, float]:
    """Probabilities that blows begin a cycle, and end one, inside the fold."""
    if d > v:
        return -math.expm1(-blows), 0.0
    x = (v - d) / (v - value)
    on = -math.expm1(-blows * math.exp(-4.0 * x))
    return on, -math.expm1(-blows * math.exp(-4.0 * (1.0 - x)))


def _move(state: Any, on: float, off: float) -> None:
    for k in (0, 2):
        moved = state[k] * on - state[k + 1] * off
        state[k] -= moved
        state[k + 1] += moved


def _hear(state: Any, said: float, begins: float) -> None:
    """What a running report leaves of the states, if it is right."""
    if begins > 0.0:
        state[2], state[3] = state[0], state[1]
    if said == QUIET:
        state[3] = 0.0
    else:
        state[2] = 0.0


def _close(state: Any, right: float, wrong: float) -> float:
    """The end of a report: its probability; the states after it."""
    quiet, sticking = right * state[2] + wrong * state[0], right * state[3] + wrong * state[1]
    total = max(quiet + sticking, _LEAST)
    state[0], state[1] = quiet / total, sticking / total
    return total
