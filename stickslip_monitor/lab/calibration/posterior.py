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

import numpy as np
from scipy.special import gammaln, logsumexp, ndtri

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.lab.calibration.likelihood import PARAMETERS, Likelihood
from stickslip_monitor.physics.belief import Tolerance
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

SEED = 13
DEFAULT_TOLERANCE = Tolerance(damping=0.40, decay=0.30)
DEFAULT_FALL = 0.25
"""Standard deviations of damping, decay and ``mu_s - mu_k`` where the configuration has none."""
_PRIOR_POINTS, _POINTS = 2048, 1024
_ROUNDS, _MORE_ROUNDS = 4, 4
_DEGREES = 6.0
_WIDER = 1.5
_TEMPERED, _ENOUGH, FEWEST = 60.0, 250.0, 100.0
_DRAWS = 512
# Delay of the onset and of the end in units of 2m/c, blows a second, scatter: mean, deviation.
_DELAYS = ((6.0, 0.6), (4.8, 0.5))
_BLOWS, _SCATTER = (1.0 / 900.0, 1.5), (0.02, 0.5)

Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Prior:
    """What is believed before the evidence: a Gaussian over :data:`PARAMETERS`.

    Attributes:
        mean: Shape (6,).
        covariance: Shape (6, 6).
        viscous: ``nu/c``, which is not inferred [1/N].
        log_damping: Mean of ``ln c``, for what is known of the law alone.
        damping_variance: Of ``ln c``.
    """

    mean: FloatArray
    covariance: FloatArray
    viscous: float = 0.0
    log_damping: float = math.nan
    damping_variance: float = math.nan

    def log_density(self, theta: FloatArray) -> FloatArray:
        """Of points of shape (n, 6)."""
        return _log_gaussian(theta, self.mean, self.covariance)


def prior_of(bearing: Bearing, tolerance: Tolerance | None = None) -> Prior:
    """The prior that a bearing's configuration makes.

    Args:
        bearing: With the Stribeck law, damping > 0 and ``mu_s > mu_k``.
        tolerance: Relative standard deviations; those that are 0 are taken from
            :data:`DEFAULT_TOLERANCE` and :data:`DEFAULT_FALL`.

    Raises:
        CalibrationError: The bearing is another.
    """
    law = bearing.friction
    if not isinstance(law, Stribeck):
        raise CalibrationError(
            f'a calibration needs the friction law stribeck, and this is {type(law).__name__}'
        )
    fall = law.static - law.kinetic
    if not (bearing.damping > 0.0 and fall > 0.0):
        raise CalibrationError(
            f'a calibration needs damping = {bearing.damping:g} N s/m above 0 and static ='
            f' {law.static:g} above kinetic = {law.kinetic:g}'
        )
    given = tolerance or Tolerance()
    of_fall = math.hypot(given.static * law.static, given.kinetic * law.kinetic) / fall
    damping = (given.damping or DEFAULT_TOLERANCE.damping) ** 2
    decay = (given.decay or DEFAULT_TOLERANCE.decay) ** 2
    level = (of_fall or DEFAULT_FALL) ** 2
    half_rate = bearing.damping / (2.0 * bearing.mass)
    others = [(mean / half_rate, spread) for mean, spread in _DELAYS]
    others += [_BLOWS, (given.scatter or _SCATTER[0], _SCATTER[1])]
    mean = [math.log(law.decay), math.log(bearing.damping / (fall * law.decay))]
    covariance = np.diag([decay, damping + decay + level, *(spread**2 for _, spread in others)])
    covariance[0, 1] = covariance[1, 0] = -decay
    return Prior(
        np.array(mean + [math.log(value) for value, _ in others]),
        covariance,
        law.viscous / bearing.damping,
        math.log(bearing.damping),
        damping,
    )


@dataclass(frozen=True, slots=True)
class Posterior:
    """Weighted points of what the evidence leaves.

    Attributes:
        theta: :data:`PARAMETERS`, shape (n, 6).
        log_dips: Log likelihood of each dip, shape (n, dips).
        log_base: Log of the prior over the mixture of all proposals, shape (n,).
        effective: Effective number of points.
        log_evidence: Log of the evidence, dip after dip, shape (dips,).
    """

    theta: FloatArray
    log_dips: FloatArray
    log_base: FloatArray
    effective: float
    log_evidence: FloatArray

    @property
    def weight(self) -> FloatArray:
        """Adds up to 1, shape (n,)."""
        return self.weight_before(self.log_dips.shape[1])

    def weight_before(self, dips: int) -> FloatArray:
        """The weights that the first so many dips alone leave, shape (n,)."""
        return _normalised(self.log_base + self.log_dips[:, :dips].sum(axis=1))

    @property
    def mean(self) -> FloatArray:
        """Shape (6,)."""
        return self.weight @ self.theta

    @property
    def covariance(self) -> FloatArray:
        """Shape (6, 6)."""
        return _moments(self.theta, self.weight)[1]

    def draws(self, count: int = _DRAWS) -> FloatArray:
        """Equally probable points, taken systematically along ``ln N0``, shape (count, 6)."""
        order = np.argsort(self.theta[:, 1])
        reached = np.cumsum(self.weight[order])
        places = np.searchsorted(reached, (np.arange(count) + 0.5) / count * reached[-1])
        return self.theta[order[np.minimum(places, order.size - 1)]]


def sample_posterior(
    prior: Prior,
    paths: Sequence[FloatArray],
    likelihood: Likelihood | None = None,
    seed: int = SEED,
    progress: Progress | None = None,
) -> Posterior:
    """Sample what the dips leave of a prior.

    Args:
        prior: The prior.
        paths: The dips, each of shape (bins, 8).
        likelihood: How likelihoods are worked out.
        seed: Of the points.
        progress: Told the dips done and the dips to do at the most.

    Raises:
        CalibrationError: The points do not settle on a posterior.
    """
    sampler = _Sampler(prior, paths, likelihood or Likelihood(), seed, progress)
    sampler.add_prior()
    rounds = 0
    while rounds < _ROUNDS or (rounds < _ROUNDS + _MORE_ROUNDS and sampler.effective() < _ENOUGH):
        if not paths:
            break
        sampler.add_fitted()
        rounds += 1
    result = sampler.result()
    if result.effective < FEWEST:
        raise CalibrationError(
            f'the evidence has no clear answer: of {result.theta.shape[0]} points tried only'
            f' {result.effective:.0f} count, and at least {FEWEST:.0f} should; the bearing may'
            ' have changed between the recordings (give fewer, or --forget 0.03), or reports'
            ' contradict each other (give them less trust)'
        )
    return result


class _Sampler:
    """Points so far, and the proposals that they were drawn from."""

    def __init__(
        self,
        prior: Prior,
        paths: Sequence[FloatArray],
        likelihood: Likelihood,
        seed: int,
        progress: Progress | None,
    ) -> None:
        self.prior, self.paths, self.likelihood = prior, paths, likelihood
        self.seed, self.progress = seed, progress
        self.random = np.random.default_rng(seed)
        self.theta = np.empty((0, len(PARAMETERS)))
        self.log_dips = np.empty((0, len(paths)))
        self.proposals: list[tuple[int, Callable[[FloatArray], FloatArray]]] = []
        self.done = 0

    def add_prior(self) -> None:
        """Points of the prior, spread evenly by a Sobol sequence."""
        from scipy.stats import qmc  # takes long to import

        sobol = qmc.Sobol(len(PARAMETERS), seed=self.seed).random(_PRIOR_POINTS)
        normal = ndtri(np.clip(sobol, 1e-9, 1.0 - 1e-9))
        root = np.linalg.cholesky(self.prior.covariance)
        self._add(self.prior.mean + normal @ root.T, self.prior.log_density)

    def add_fitted(self) -> None:
        """Points of a t distribution fitted to those so far."""
        log_weight = self._log_weight()
        mean, covariance = _moments(self.theta, _tempered(log_weight, _TEMPERED))
        covariance = _WIDER * covariance + 1e-10 * self.prior.covariance
        root = np.linalg.cholesky(covariance)
        normal = self.random.standard_normal((_POINTS, len(PARAMETERS)))
        scale = np.sqrt(_DEGREES / self.random.chisquare(_DEGREES, _POINTS))
        points = mean + (normal @ root.T) * scale[:, None]
        self._add(points, lambda theta: _log_t(theta, mean, covariance))

    def _add(self, points: FloatArray, log_density: Callable[[FloatArray], FloatArray]) -> None:
        self.proposals.append((points.shape[0], log_density))
        values = self.likelihood.of_dips(points, self.paths, self._tell)
        self.theta = np.concatenate([self.theta, points])
        self.log_dips = np.concatenate([self.log_dips, values])

    def _tell(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, len(self.paths) * (1 + _ROUNDS + _MORE_ROUNDS))

    def log_base(self) -> FloatArray:
        """Prior over the mixture of proposals, of all points."""
        total = self.theta.shape[0]
        mixture = logsumexp(
            [np.log(count / total) + density(self.theta) for count, density in self.proposals],
            axis=0,
        )
        return self.prior.log_density(self.theta) - mixture

    def _log_weight(self) -> FloatArray:
        return self.log_base() + self.log_dips.sum(axis=1)

    def effective(self) -> float:
        """Effective number of points so far."""
        return _effective(_normalised(self._log_weight()))

    def result(self) -> Posterior:
        """The posterior of all points."""
        base = self.log_base()
        steps = np.cumsum(self.log_dips, axis=1)
        own = logsumexp(base)
        evidence = [float(logsumexp(base + step) - own) for step in steps.T]
        return Posterior(
            self.theta,
            self.log_dips,
            base,
            self.effective(),
            np.diff(np.array(evidence), prepend=0.0),
        )


def _normalised(log_weight: FloatArray) -> FloatArray:
    return np.exp(log_weight - logsumexp(log_weight))


def _effective(weight: FloatArray) -> float:
    return float(1.0 / np.sum(weight**2))


def _tempered(log_weight: FloatArray, enough: float) -> FloatArray:
    """The weights, made more even until enough points count."""
    low, high = 0.0, 1.0
    if _effective(_normalised(log_weight)) >= enough:
        return _normalised(log_weight)
    for _ in range(40):
        middle = 0.5 * (low + high)
        if _effective(_normalised(middle * log_weight)) >= enough:
            low = middle
        else:
            high = middle
    return _normalised(low * log_weight)


def _moments(theta: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weight @ theta
    off = theta - mean
    return mean, (off * weight[:, None]).T @ off


def _distance(
    theta: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, float]:
    """Squared Mahalanobis distances, and log of the covariance's determinant."""
    root = np.linalg.cholesky(covariance)
    scaled = np.linalg.solve(root, (theta - mean).T)
    return np.sum(scaled**2, axis=0), 2.0 * float(np.sum(np.log(np.diag(root))))


def _log_gaussian(theta: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    distance, log_det = _distance(theta, mean, covariance)
    return -0.5 * (distance + log_det + mean.size * math.log(2.0 * math.pi))


def _log_t(theta: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    distance, log_det = _distance(theta, mean, covariance)
    size = mean.size
    constant = gammaln(0.5 * (_DEGREES + size)) - gammaln(0.5 * _DEGREES)
    constant -= 0.5 * (size * math.log(_DEGREES * math.pi) + log_det)
    return constant - 0.5 * (_DEGREES + size) * np.log1p(distance / _DEGREES)
