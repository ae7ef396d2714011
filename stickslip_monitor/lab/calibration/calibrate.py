# SPDX-License-Identifier: Apache-2.0
"""A calibration: the posterior of a bearing's boundaries, and what its evidence is worth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, plural
from stickslip_monitor.lab.calibration.evidence import (
    Dip,
    VibrationReport,
    counter_reports,
    load_of,
)
from stickslip_monitor.lab.calibration.posterior import (
    BEGIN,
    LOAD_TERM,
    RIGHT,
    SEED,
    STATE,
    STICKING,
    WRONG,
    H,
    Posterior,
    Prior,
    Progress,
    log_likelihood,
    sample_posterior,
)
from stickslip_monitor.physics.averaging.closed_form import speed_for_decline
from stickslip_monitor.physics.belief import QUANTILES, Belief

FLOOR = 0.006
"""Relative error of a boundary that no evidence takes away: the model's own."""
_DOUBTFUL = 0.5
_SURPRISING = 0.025
_LAST, _TOO_MANY = 10, 3
# Normal scores of the last ends, whose sum is beyond this with half a per cent.
_SHORTEST_RUN, _LONGEST_RUN, _ONE_SIDED = 3, 5, 2.8
_JUDGES = 256
_LIMIT_SHARE, _LIMIT_FACTOR = 0.99, 1.5
_LOADS, _PRIOR_DRAWS = 5, 512
_ONE_LOAD = 1.1


@dataclass(frozen=True, slots=True)
class EpisodeEnd:
    """The end of one episode against what was expected of it before its dip."""

    time_ns: int  # when it ended [ns]
    speed: float  # surface speed there [m/s]
    predicted: float  # median fold speed at the load there [m/s]; 0 where there was none
    # Probability that it would have ended by then; 0.5 on average. Its report's tolerance is
    # allowed for: that of the time within it at which this is nearest to 0.5.
    late: float


@dataclass(frozen=True, slots=True, eq=False)
class DipResult:
    """What a calibration makes of one dip."""

    dip: Dip  # the dip
    log_predictive: float  # log probability of its reports after those of all dips before it
    worthless: tuple[float, ...]  # probability that each report is worthless, in their order
    ends: tuple[EpisodeEnd, ...]  # its episodes' ends

    @property
    def doubtful(self) -> list[tuple[VibrationReport, float]]:
        """Reports that are more likely worthless than not, with that probability."""
        return [
            (report, p)
            for report, p in zip(self.dip.reports, self.worthless, strict=False)
            if p > _DOUBTFUL
        ]

    @property
    def surprising(self) -> bool:
        """Whether what was seen was hardly to be expected."""
        if not self.dip.episode:
            return 0.5 * math.exp(self.log_predictive) < _SURPRISING
        return any(min(end.late, 1.0 - end.late) <= _SURPRISING for end in self.ends)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What the evidence gives of a bearing."""

    prior: Prior  # before the evidence
    posterior: Posterior  # after the evidence
    dips: tuple[DipResult, ...]  # in order of time
    floor: float = FLOOR  # relative error of a boundary that no evidence takes away
    seed: int = SEED  # of the points drawn
    # Names of recordings with dips that were given before, which count once.
    repeated: tuple[str, ...] = ()

    @property
    def episodes(self) -> int:
        """Reports of vibration."""
        return sum(r.squeal for one in self.dips for r in one.dip.reports)

    @property
    def loads(self) -> tuple[float, float]:
        """Least and greatest load of the dips [N]."""
        loads = np.concatenate([load_of(one.dip.path, self.prior.viscous) for one in self.dips])
        return float(loads.min()), float(loads.max())

    @property
    def warnings(self) -> list[str]:
        """What makes the result worth less, a sentence each."""
        found = []
        if not self.episodes:
            found.append(
                'no episode was seen: quiet bounds the Hopf speed, and says little of the fold'
            )
        if self.episodes == 1:
            found += [
                f'all rests on one report of vibration ({report.source}), and no report of quiet'
                ' meets it: one more episode, or when it was quiet before and after, would'
                ' confirm it'
                for one in self.dips
                for k, report in enumerate(one.dip.reports)
                if report.squeal and not counter_reports(one.dip.reports, k)
            ]
        found += [
            f'{report.source}: {"squeal" if report.squeal else "quiet"} for'
            f' {report.seconds:.0f} s at {report.start_ns / 1e9:.0f} s ({one.dip.recording}) fits'
            f' nothing else: worthless with {p:.0%}'
            for one in self.dips
            for report, p in one.doubtful
        ]
        if self._has_changed:
            found.append(
                'the last dips were hardly to be expected after those before them: the bearing may'
                ' have changed; calibrate with --forget 0.03, or with the newest recordings alone'
            )
        return found

    @property
    def _has_changed(self) -> bool:
        """Whether many of the last dips surprise, or the last episodes end on one side."""
        surprising = sum(one.surprising for one in self.dips[-_LAST:])
        late = [end.late for one in self.dips for end in one.ends][-_LONGEST_RUN:]
        scores = ndtri(np.clip(late, 1e-6, 1.0 - 1e-6))
        runs = range(_SHORTEST_RUN, len(late) + 1)
        one_sided = any(abs(scores[-n:].sum()) > _ONE_SIDED * math.sqrt(n) for n in runs)
        return surprising >= _TOO_MANY or one_sided

    @property
    def remarks(self) -> list[str]:
        """What more evidence would give, a sentence each."""
        low, high = self.loads
        found = [self.ends_text] if self.ends_text else []
        found += [f'{name} was given before and counts once' for name in self.repeated]
        flickers = [report for one in self.dips for report in one.dip.flickers]
        if flickers:
            found.append(
                f'{plural(len(flickers), "report")} shorter than twice the tolerance left out,'
                f' the first of {flickers[0].seconds:.1f} s ({flickers[0].source})'
            )
        if high < _ONE_LOAD * low:
            found.append(
                f'all evidence is at {low:.4g} to {high:.4g} N: at other loads the boundaries rest'
                ' on the friction law alone, and beyond a fifth they are worth less'
            )
        correlation = self.correlation
        if abs(correlation) > 0.95:
            found.append(
                f'decay and N0 are known together only (correlation {correlation:.2f}): episodes'
                ' at other loads, or reports of the onset too, would separate them'
            )
        return found

    @property
    def ends_text(self) -> str:
        """How the ends of the episodes compare with what was predicted before each."""
        offs = [
            e.speed / e.predicted - 1.0 for d in self.dips for e in d.ends if e.predicted > 0.0
        ]
        if not offs:
            return ''
        middle = 100.0 * float(np.median(offs))
        count = f'{len(offs)} episode ends' if len(offs) == 1 else f'{len(offs)} episodes end'
        side = 'above' if middle >= 0.0 else 'below'
        return f'{count} {abs(middle):.1f} % {side} the fold speed predicted before it'

    @property
    def correlation(self) -> float:
        """Posterior correlation of ``ln beta`` and ``ln N0``."""
        c = self.posterior.covariance
        return float(c[0, 1] / math.sqrt(c[0, 0] * c[1, 1]))

    def belief(self) -> Belief:
        """The boundaries themselves, without the scatter of single passages."""
        return self._belief(self.posterior.draws(), self.loads)

    def prior_belief(self) -> Belief:
        """The same before the evidence, at any load."""
        random = np.random.default_rng(SEED)
        draws = random.multivariate_normal(self.prior.mean, self.prior.covariance, _PRIOR_DRAWS)
        return self._belief(draws, (1e-9, 1e12))

    def _belief(self, draws: FloatArray, loads: tuple[float, float]) -> Belief:
        fixed = np.column_stack([draws[:, :2], np.full(draws.shape[0], -30.0)])
        return Belief.from_draws(fixed, self.floor, self.prior.viscous, loads)

    def boundaries(self) -> list[list[float]]:
        """Rows of load, Hopf speed at :data:`QUANTILES`, fold speed at the same."""
        belief, loads = self.belief(), np.unique(np.linspace(*self.loads, _LOADS))
        speeds = [of(loads, p) for of in (belief.hopf_speed, belief.fold_speed) for p in QUANTILES]
        return np.column_stack([loads, *speeds]).tolist()


def dip_limit(prior: Prior) -> Callable[[FloatArray], FloatArray]:
    """Speed below which a dip lasts [m/s], by load [N].

    1.5 times the fold speed that 99 % of the prior are below.
    """
    random = np.random.default_rng(SEED)
    theta = random.multivariate_normal(prior.mean[:2], prior.covariance[:2, :2], 4000)
    logs = np.linspace(prior.mean[1] - 6.0, prior.mean[1] + 8.0, 113)
    limits = []
    for log_load in logs:
        d = log_load - theta[:, 1]
        fold = speed_for_decline(np.clip(d, 1e-9, 100.0)) / np.exp(theta[:, 0])
        limits.append(float(np.quantile(np.where(d > 0.0, fold, 0.0), _LIMIT_SHARE)))
    speeds = _LIMIT_FACTOR * np.array(limits)

    def limit(load: FloatArray) -> FloatArray:
        return np.interp(np.log(load / (1.0 + prior.viscous * load)), logs, speeds)

    return limit


def calibrate(
    dips: Sequence[Dip],
    prior: Prior,
    floor: float = FLOOR,
    forget: float = 0.0,
    seed: int = SEED,
    progress: Progress | None = None,
    known: Sequence[tuple[str, int, int]] = (),
) -> Calibration:
    """Infer a bearing's boundaries.

    Args:
        dips: The evidence.
        prior: The distribution before the evidence.
        floor: Relative error of a boundary that no evidence takes away.
        forget: Standard deviation that ``ln N0`` is given anew before each dip: the bearing wears.
        seed: Of the points drawn.
        progress: Given the work done and the work to do at the most.
        known: Fingerprint, begin and end [ns] of the dips that the prior rests on.

    Raises:
        CalibrationError: The evidence has no clear answer, or is known already.
    """
    ordered = sorted((d for d in dips if d.path.shape[0]), key=lambda dip: dip.start_ns)
    ordered, repeated = _once(ordered, known)
    if repeated and not ordered:
        raise CalibrationError(
            f'{", ".join(repeated)} is in the earlier result already: give other recordings'
        )
    if forget:
        posterior, results = _one_by_one(ordered, prior, forget, seed, progress)
    else:
        posterior = sample_posterior(prior, [d.path for d in ordered], seed, progress)
        results = [_judged(dip, k, posterior) for k, dip in enumerate(ordered)]
    return Calibration(prior, posterior, tuple(results), floor, seed, repeated)


def _once(
    dips: Sequence[Dip], known: Sequence[tuple[str, int, int]]
) -> tuple[list[Dip], tuple[str, ...]]:
    """Each dip once, and the names of the recordings that repeat one."""
    kept: list[Dip] = []
    repeated: dict[str, None] = {}
    for dip in dips:
        seen = [*known, *((one.fingerprint, one.start_ns, one.end_ns) for one in kept)]
        if any(dip.repeats(*other) for other in seen):
            repeated[dip.recording] = None
        else:
            kept.append(dip)
    return kept, tuple(repeated)


def _one_by_one(
    dips: Sequence[Dip], prior: Prior, forget: float, seed: int, progress: Progress | None
) -> tuple[Posterior, list[DipResult]]:
    """The posterior of each dip, as a Gaussian, is the prior of the next."""
    posterior, results = sample_posterior(prior, [], seed), []
    for k, dip in enumerate(dips):
        covariance = prior.covariance.copy()
        covariance[1, 1] += forget**2
        posterior = sample_posterior(replace(prior, covariance=covariance), [dip.path], seed + k)
        results.append(_judged(dip, 0, posterior))
        prior = replace(prior, mean=posterior.mean, covariance=posterior.covariance)
        if progress is not None:
            progress(k + 1, len(dips))
    return posterior, results


def _judged(dip: Dip, before: int, posterior: Posterior) -> DipResult:
    worthless = log_likelihood(posterior.draws(_JUDGES), dip.path)[:, 1:].mean(axis=0)
    known = posterior.draws(_JUDGES, before)
    ends = tuple(
        end
        for report, following in pairwise(dip.reports)
        if report.squeal and not following.squeal
        for end in _end(dip, report, known)
    )
    return DipResult(dip, float(posterior.log_evidence[before]), tuple(worthless.tolist()), ends)


def _end(dip: Dip, report: VibrationReport, theta: FloatArray) -> list[EpisodeEnd]:
    """How an episode's end compares with what points of other evidence expect."""
    start, _ = report.core
    off = round(report.tolerance * 1e9)
    first = int(np.searchsorted(dip.time_ns, start))
    bounds = [report.end_ns - off, report.end_ns, report.end_ns + off]
    early, last, late = np.searchsorted(dip.time_ns, bounds) - 1
    if not 0 <= first < last < dip.path.shape[0]:
        return []
    low, high = (
        1.0 - _lasting(dip.path[first : row + 1], theta)
        for row in (max(early, first + 1), min(late, dip.path.shape[0] - 1))
    )
    d = dip.path[last, LOAD_TERM] - theta[:, 1]
    fold = np.where(d > 0.0, speed_for_decline(np.maximum(d, 1e-9)) / np.exp(theta[:, 0]), 0.0)
    nearest = min(max(low, 0.5), high)
    return [EpisodeEnd(report.end_ns, float(dip.speed[last]), float(np.median(fold)), nearest)]


def _lasting(path: FloatArray, theta: FloatArray) -> float:
    """Probability that a cycle which runs in the first bin runs in all."""
    own = path.copy()
    own[:, STATE], own[:, (BEGIN, RIGHT, WRONG)] = STICKING, 0.0
    own[0, H] = own[0, BEGIN] = own[-1, RIGHT] = 1.0
    return float(np.exp(log_likelihood(theta, own)[:, 0]).mean())
