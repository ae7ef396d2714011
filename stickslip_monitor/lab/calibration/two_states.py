# SPDX-License-Identifier: Apache-2.0
"""The two hidden states of a dip, quiet and sticking, followed from bin to bin: the inner loop.

Plain arithmetic on numbers, for numba to compile; :mod:`likelihood` has the same over arrays,
where numba is not installed, and says what the quantities are.
"""

from __future__ import annotations

import math
from typing import Any

NOISE_FOLDS = 6.0
"""e-folds by which noise grows until it is stick-slip: ``L``."""
END_SHAPE = 4.0
QUIET, STICKING = 1, 2
_LEAST = 1e-300


def log_likelihoods(theta: Any, nodes: Any, weights: Any, dip: Any, table: Any, out: Any) -> None:
    """Log likelihood of one dip at many points.

    Args:
        theta: ``ln beta, ln N0, ln tau, ln tau_e, ln lambda, ln s``, shape (n, 6).
        nodes: Of the dip's own shift of the boundary, shape (k,).
        weights: Their weights, shape (k,).
        dip: Columns ``h, V, ln V, load term, state, begin, right, wrong``, shape (bins, 8); of
            the first row ``h`` is the probability that the dip begins with sticking where it
            does not begin beyond the fold.
        table: ``D`` over ``ln v``: first ``ln v``, points for each unit, then the values.
        out: Takes the result, shape (n, 1 + reports): with how probable it is that each report is
            worthless.
    """
    reports = out.shape[1] - 1
    doubts = [0.0] * (reports + 1)
    for i in range(theta.shape[0]):
        log_beta, log_load = theta[i, 0], theta[i, 1]
        tau, tau_e = math.exp(theta[i, 2]), math.exp(theta[i, 3])
        rate, scatter = math.exp(theta[i, 4]), math.exp(theta[i, 5])
        best, total = -1e308, 0.0
        for r in range(reports):
            out[i, 1 + r] = 0.0
        for k in range(nodes.shape[0]):
            value = _follow(
                dip, table, log_beta + scatter * nodes[k], log_load, tau, tau_e, rate, doubts
            )
            if value > best:
                shrink = math.exp(best - value) if best > -1e300 else 0.0
                total *= shrink
                for r in range(reports):
                    out[i, 1 + r] *= shrink
                best = value
            share = weights[k] * math.exp(value - best)
            total += share
            for r in range(reports):
                out[i, 1 + r] += share * doubts[r]
        out[i, 0] = best + math.log(total)
        for r in range(reports):
            out[i, 1 + r] /= total


def _decline(table: Any, x: float, v: float) -> float:
    place = (x - table[0]) * table[1]
    if place < 0.0:
        return v
    j = int(place)
    if j >= table.shape[0] - 3:
        return 1.5 * x + 0.2257913526447274
    return table[2 + j] + (place - j) * (table[3 + j] - table[2 + j])


def _end_survival(spent: float, tau_e: float) -> float:
    if spent < 0.1 * tau_e:
        return 1.0
    return -math.expm1(-math.exp(-END_SHAPE * (spent / tau_e - 1.0)))


def _onset_survival(growth: float) -> float:
    if growth < 0.25:
        return 1.0
    return -math.expm1(-math.exp(-2.0 * NOISE_FOLDS * (growth - 1.0)))


def _follow(  # noqa: C901 - one loop, whose state is too much to hand to functions
    dip: Any,
    table: Any,
    log_beta: float,
    log_load: float,
    tau: float,
    tau_e: float,
    rate: float,
    doubts: Any,
) -> float:
    beta = math.exp(log_beta)
    quiet, sticking, quiet_c, sticking_c = 1.0, 0.0, 1.0, 0.0
    spent, growth, most, pace = 0.0, 0.0, 0.0, 0.0
    before, left = 1.0, 1.0
    result, report, calm = 0.0, 0, math.exp(-rate)
    for t in range(dip.shape[0]):
        h, v, d = dip[t, 0], beta * dip[t, 1], dip[t, 3] - log_load
        value = _decline(table, log_beta + dip[t, 2], v)
        excess = value - d
        if t == 0:
            sticking = h if excess < 0.0 else 0.0
            quiet = 1.0 - sticking
            before = excess
            pace = max(math.exp(min(d - v, 50.0)) - 1.0, -1.0)
        else:
            on, off = 0.0, 0.0
            if excess >= 0.0:
                part = h if before >= 0.0 else h * excess / (excess - before)
                old = spent
                spent += part
                growth, most, left = 0.0, 0.0, 1.0
                if spent > 3.0 * tau_e:
                    off = 1.0
                else:
                    off = 1.0 - _end_survival(spent, tau_e) / _end_survival(old, tau_e)
                pace = -1.0
            else:
                spent = max(0.0, spent - h)
                new = math.exp(min(d - v, 50.0)) - 1.0
                growth = max(0.0, growth + 0.5 * (pace + new) * h / tau)
                pace = new
                stay = 1.0
                if growth == 0.0:
                    most, left = 0.0, 1.0
                elif growth > most:
                    survived = _onset_survival(growth) if most < 4.0 else 0.0
                    stay = survived / left if left > _LEAST else 0.0
                    left, most = survived, growth
                if d > v:
                    on = 1.0 - stay * calm**h
                else:
                    x = (v - d) / (v - value)
                    on = 1.0 - stay * math.exp(-rate * math.exp(-4.0 * x) * h)
                    off = -math.expm1(-rate * math.exp(-4.0 * (1.0 - x)) * h)
            before = excess
            move = quiet * on - sticking * off
            quiet, sticking = quiet - move, sticking + move
            move = quiet_c * on - sticking_c * off
            quiet_c, sticking_c = quiet_c - move, sticking_c + move
        state = dip[t, 4]
        if state > 0.0:
            if dip[t, 5] > 0.0:
                quiet_c, sticking_c = quiet, sticking
            if state == QUIET:
                sticking_c = 0.0
            else:
                quiet_c = 0.0
            right, wrong = dip[t, 6], dip[t, 7]
            if right > 0.0 or wrong > 0.0:
                alternative = wrong * (quiet + sticking)
                quiet = right * quiet_c + wrong * quiet
                sticking = right * sticking_c + wrong * sticking
                total = max(quiet + sticking, _LEAST)
                result += math.log(total)
                quiet, sticking = quiet / total, sticking / total
                doubts[report] = alternative / total
                report += 1
    return result
