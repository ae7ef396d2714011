# SPDX-License-Identifier: Apache-2.0
"""What the evidence leaves of a prior: adaptive importance sampling with all proposals mixed.

Points of the prior first; then, round by round, points of a multivariate t that is fitted to the
weighted points so far and widened. Every point counts with the mixture of all proposals that there
have been (O. Cappe et al., J. Comput. Graph. Statist. 13 (2004) 907; the deterministic mixture of
A. Owen and Y. Zhou, J. Amer. Statist. Assoc. 95 (2000) 135).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, multivariate_t, qmc

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, PhysicsError
from stickslip_monitor.lab.calibration.likelihood import PARAMETERS, log_likelihood
from stickslip_monitor.physics.belief import EXACT, Tolerance, require_stribeck
from stickslip_monitor.physics.oscillator import Bearing

SEED = 13
_DAMPING, _DECAY, _FALL = 0.40, 0.30, 0.25
"""Deviations of damping, decay and ``mu_s - mu_k`` where the configuration has none."""
_FIRST, _POINTS = 2048, 1024
_ROUNDS, _MORE_ROUNDS = 4, 4
_DEGREES = 6
_WIDER = 1.5
_TEMPERED, _ENOUGH, FEWEST = 60.0, 250.0, 100.0
_DRAWS = 512
# e-folds from noise to stick-slip and time constant of the growth, and delay of the end, both in
# units of 2m/c; blows a second, scatter: mean, deviation.
_FOLDS, _GROWTH, _END = (5.0, 0.4), (1.0, 0.45), (4.8, 0.5)
_BLOWS, _SCATTER = (1.0 / 900.0, 1.5), (0.02, 0.5)

Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Prior:
    """What is believed before the evidence: a Gaussian over :data:`PARAMETERS`."""

    mean: FloatArray  # shape (7,)
    covariance: FloatArray  # shape (7, 7)
    viscous: float = 0.0  # ``nu/c``, which is not inferred [1/N]
    log_damping: float = math.nan  # mean of ``ln c``, for what is known of the law alone
    damping_variance: float = math.nan  # of ``ln c``


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
    damping = (tolerance.damping or _DAMPING) ** 2
    decay = (tolerance.decay or _DECAY) ** 2
    level = (tolerance.of_fall(law) or _FALL) ** 2
    time = 2.0 * bearing.mass / bearing.damping
    values = [
        law.decay, bearing.damping / (fall * law.decay), _FOLDS[0] * _GROWTH[0] * time,
        _END[0] * time, _BLOWS[0], tolerance.scatter or _SCATTER[0], _FOLDS[0],
    ]  # fmt: skip
    spreads = [_END[1], _BLOWS[1], _SCATTER[1], _FOLDS[1]]
    onset = _FOLDS[1] ** 2 + _GROWTH[1] ** 2
    covariance = np.diag([decay, damping + decay + level, onset, *np.square(spreads)])
    covariance[0, 1] = covariance[1, 0] = -decay
    covariance[2, 6] = covariance[6, 2] = _FOLDS[1] ** 2
    return Prior(
        np.log(values),
        covariance,
        law.viscous / bearing.damping,
        math.log(bearing.damping),
        damping,
    )


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

    Progress is told the dips done and the dips to do at the most.

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
