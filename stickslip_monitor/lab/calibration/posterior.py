# SPDX-License-Identifier: Apache-2.0
"""How probable the reports of dips are, given the bearing, and what they leave of a prior.

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

The posterior comes by adaptive importance sampling with all proposals mixed.

Points of the prior first; then, round by round, points of a multivariate t that is fitted to the
weighted points so far and widened. Every point counts with the mixture of all proposals that there
have been (O. Cappe et al., J. Comput. Graph. Statist. 13 (2004) 907; the deterministic mixture of
A. Owen and Y. Zhou, J. Amer. Statist. Assoc. 95 (2000) 135).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, multivariate_t, qmc

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, PhysicsError
from stickslip_monitor.physics import chances
from stickslip_monitor.physics.belief import EXACT, Tolerance, curve_of_decline, require_stribeck
from stickslip_monitor.physics.chances import decline_at
from stickslip_monitor.physics.oscillator import Bearing

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
            _take_report(state, path[t, STATE], path[t, BEGIN])
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


def _take_report(state: Any, report: float, begins: float) -> None:
    """What a running report leaves of the states, if it is right."""
    if begins > 0.0:
        state[2], state[3] = state[0], state[1]
    if report == QUIET:
        state[3] = 0.0
    else:
        state[2] = 0.0


def _close(state: Any, right: float, wrong: float) -> float:
    """The end of a report: its probability; the states after it."""
    quiet, sticking = right * state[2] + wrong * state[0], right * state[3] + wrong * state[1]
    total = max(quiet + sticking, _LEAST)
    state[0], state[1] = quiet / total, sticking / total
    return total


SEED = 13
DAMPING, _DECAY, _FALL = 0.40, 0.30, 0.25
"""Deviations of damping, decay and ``mu_s - mu_k`` where the configuration has none."""
_FIRST, _POINTS = 2048, 1024
_ROUNDS, _MORE_ROUNDS = 4, 4
_DEGREES = 6
_WIDER = 1.5
_TEMPERED, _ENOUGH, FEWEST = 60.0, 250.0, 100.0
_DRAWS = 512
# e-folds from noise to stick-slip and time constant of the growth, and delay of the end, both in
# units of 2m/c; blows a second, scatter: mean, deviation.
_FOLD_PRIOR, _GROWTH_PRIOR, _END_PRIOR = (5.0, 0.4), (1.0, 0.45), (4.8, 0.5)
_BLOWS, _SCATTER = (1.0 / 900.0, 1.5), (0.02, 0.5)

Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Prior:
    """The distribution before the evidence: a Gaussian over :data:`PARAMETERS`."""

    mean: FloatArray  # shape (7,)
    covariance: FloatArray  # shape (7, 7)
    viscous: float = 0.0  # ``nu/c``, which is not inferred [1/N]


def prior_of(bearing: Bearing, tolerance: Tolerance = EXACT) -> Prior:
    """The prior that a bearing's configuration makes.

    Args:
        bearing: With the Stribeck law, damping > 0 and ``mu_s > mu_k``.
        tolerance: Relative standard deviations; those that are 0 are taken as 40 % of the
            damping, 30 % of the decay and 25 % of ``mu_s - mu_k``.

    Raises:
        CalibrationError: The bearing is another.
    """
    try:
        law = require_stribeck(bearing, 'a calibration')
    except PhysicsError as error:
        raise CalibrationError(str(error)) from error
    fall = law.static - law.kinetic
    damping = (tolerance.damping or DAMPING) ** 2
    decay = (tolerance.decay or _DECAY) ** 2
    level = (tolerance.of_fall(law) or _FALL) ** 2
    time = 2.0 * bearing.mass / bearing.damping
    values = [
        law.decay, bearing.damping / (fall * law.decay), _FOLD_PRIOR[0] * _GROWTH_PRIOR[0] * time,
        _END_PRIOR[0] * time, _BLOWS[0], tolerance.scatter or _SCATTER[0], _FOLD_PRIOR[0],
    ]  # fmt: skip
    spreads = [_END_PRIOR[1], _BLOWS[1], _SCATTER[1], _FOLD_PRIOR[1]]
    onset = _FOLD_PRIOR[1] ** 2 + _GROWTH_PRIOR[1] ** 2
    covariance = np.diag([decay, damping + decay + level, onset, *np.square(spreads)])
    covariance[0, 1] = covariance[1, 0] = -decay
    covariance[2, 6] = covariance[6, 2] = _FOLD_PRIOR[1] ** 2
    return Prior(np.log(values), covariance, law.viscous / bearing.damping)


@dataclass(frozen=True, slots=True)
class Posterior:
    """Weighted points of what the evidence leaves."""

    theta: FloatArray  # :data:`PARAMETERS`, shape (n, 7)
    log_dips: FloatArray  # log likelihood of each dip, shape (n, dips)
    log_base: FloatArray  # log of the prior over the mixture of all proposals, shape (n,)

    @property
    def weight(self) -> FloatArray:
        """Adds up to 1, shape (n,)."""
        return self.weight_before(self.log_dips.shape[1])

    def weight_before(self, dips: int) -> FloatArray:
        """The weights that the first so many dips alone leave, shape (n,)."""
        return _normalised(self.log_base + self.log_dips[:, :dips].sum(axis=1))

    @property
    def effective(self) -> float:
        """Effective number of points."""
        return _effective(self.weight)

    @property
    def log_evidence(self) -> FloatArray:
        """Log probability of each dip after those before it, shape (dips,)."""
        steps = np.cumsum(self.log_dips, axis=1) + self.log_base[:, None]
        return np.diff(logsumexp(steps, axis=0), prepend=logsumexp(self.log_base))

    @property
    def mean(self) -> FloatArray:
        """Shape (7,)."""
        return self.weight @ self.theta

    @property
    def covariance(self) -> FloatArray:
        """Shape (7, 7)."""
        return np.cov(self.theta.T, aweights=self.weight, bias=True)

    def draws(self, count: int = _DRAWS, before: int | None = None) -> FloatArray:
        """Equally probable points, taken systematically along ``ln N0``, shape (count, 7).

        Only the dips ``before`` a place count, where it is given.
        """
        weight = self.weight if before is None else self.weight_before(before)
        order = np.argsort(self.theta[:, 1])
        reached = np.cumsum(weight[order])
        places = np.searchsorted(reached, (np.arange(count) + 0.5) / count * reached[-1])
        return self.theta[order[np.minimum(places, order.size - 1)]]


def sample_posterior(
    prior: Prior, paths: Sequence[FloatArray], seed: int = SEED, progress: Progress | None = None
) -> Posterior:
    """Sample what the dips, each of shape (bins, 8), leave of a prior.

    Progress is given the dips done and the dips to do at the most.

    Raises:
        CalibrationError: The points do not settle on a posterior.
    """
    most, done = 1 + _ROUNDS + _MORE_ROUNDS, 0
    random, density = (
        np.random.default_rng(seed),
        multivariate_normal(prior.mean, prior.covariance),
    )
    proposal: Any = density
    points = qmc.MultivariateNormalQMC(prior.mean, prior.covariance, seed=seed).random(_FIRST)
    size = len(PARAMETERS)
    result = Posterior(np.empty((0, size)), np.empty((0, len(paths))), np.empty(0))
    proposals: list[tuple[int, Any]] = []
    for number in range(most if paths else 1):
        if number > _ROUNDS and result.effective >= _ENOUGH:
            break
        if number:
            proposal = _proposal(prior, result, random)
            points = proposal.rvs(_POINTS)
        proposals.append((points.shape[0], proposal))
        new = np.empty((points.shape[0], len(paths)))
        for k, path in enumerate(paths):
            new[:, k] = log_likelihood(points, path)[:, 0]
            done += 1
            if progress is not None:
                progress(done, len(paths) * most)
        theta = np.concatenate([result.theta, points])
        shares = [np.log(count / theta.shape[0]) + p.logpdf(theta) for count, p in proposals]
        base = density.logpdf(theta) - logsumexp(shares, axis=0)
        result = Posterior(theta, np.concatenate([result.log_dips, new]), base)
    if result.effective < FEWEST:
        raise CalibrationError(
            f'the evidence has no clear answer: of {result.theta.shape[0]} points tried only'
            f' {result.effective:.0f} count, and at least {FEWEST:.0f} should; the bearing may'
            ' have changed between the recordings (give fewer, or --forget 0.03), or reports'
            ' contradict each other (give them less trust)'
        )
    return result


def _proposal(prior: Prior, sofar: Posterior, random: np.random.Generator) -> Any:
    """A t distribution fitted to the points so far and widened."""
    weight = _tempered(sofar.log_base + sofar.log_dips.sum(axis=1))
    mean, covariance = weight @ sofar.theta, np.cov(sofar.theta.T, aweights=weight, bias=True)
    covariance = _WIDER * covariance + 1e-10 * prior.covariance
    return multivariate_t(mean, covariance, _DEGREES, seed=random)


def _normalised(log_weight: FloatArray) -> FloatArray:
    return np.exp(log_weight - logsumexp(log_weight))


def _effective(weight: FloatArray) -> float:
    return float(1.0 / np.sum(weight**2))


def _tempered(log_weight: FloatArray) -> FloatArray:
    """The weights, made more even until enough points count."""

    def missing(power: float) -> float:
        return _effective(_normalised(power * log_weight)) - _TEMPERED

    power = 1.0 if missing(1.0) >= 0.0 else brentq(missing, 0.0, 1.0, xtol=1e-9)
    return _normalised(power * log_weight)
