# SPDX-License-Identifier: Apache-2.0
"""Infers two factors from edges: ``r`` of all speeds and ``q`` of all loads, as weights on a grid.

The true boundaries are ``r V_F(q N)`` and ``r V_H(q N)``, of the configured ``V_F`` and ``V_H``. One axis of
the grid is ``u``, the offset of the fold at the middle of the loads, which an end shows; the other is
``ln q``:

    ``u = ln r + f(n + ln q) - f(n)``,    ``f(n) = ln V_F(e^n)``

An end at ``V, N`` has the density ``trust phi((ln V - ln r - f(ln N + ln q))/s) / s`` beside that
of a worthless one. The delay of the speed, the share of the time for which a cycle outlives its fold, and the
scatter of boundaries from passage to passage are common to all ends, and summed over. At an onset the growth
``G`` of steady sliding along its passage is ``K`` e-folds, by :func:`onset_probability`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import logsumexp, ndtr

from stickslip_lab.calibration.edges import LAGS, SHARES, Edges, End, Passage, Reference
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging import growth_rate

# Scatter of a passage's own boundary, as a load: nodes; a median of 2 %, known to a factor 1.65.
_SCATTER = np.array([0.008, 0.012, 0.018, 0.027, 0.04, 0.06, 0.09])
_SCATTER_PRIOR = -0.5 * (np.log(_SCATTER / 0.02) / 0.5) ** 2
# Delay of the speed against the vibration: 0.5 s, with a spread of 0.9 s.
_LAG_PRIOR = -0.5 * ((np.array(LAGS) - 0.5) / 0.9) ** 2
# e-folds from noise to stick-slip: median, spread between ships; share of onsets that a blow began. Counted
# along passages of 20 ships they are 2.6, with noise five times as strong 1.2, a quarter as strong 4.1: the
# median is their middle. With one of 1.7 the Hopf speed of quiet ships was 2 % low, of loud ones as now.
_FOLDS, _FOLDS_SPREAD, _BLOWN = 2.2, 0.9, 0.10
_FOLD_NODES = np.linspace(-2.2, 2.2, 9)
# Range of ln V over which a worthless end is equally probable.
_WORTHLESS_RANGE = 1.5
# Slopes of a boundary's speed over the load that count: the fold turns back, the Hopf speed falls to 0.
_MIN_SLOPE, _MAX_SLOPE = 0.3, 3.0
# What is less probable than the best by this factor is left out.
_NEGLIGIBLE = math.exp(-14.0)


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Weights over both factors."""

    u: FloatArray  # offset of the fold at the middle load, ascending, shape (m,)
    log_q: FloatArray  # ascending, shape (n,)
    log_r: FloatArray  # shape (m, n)
    weight: FloatArray  # adds up to 1, shape (m, n)
    load: float  # the middle of the loads [ln N]

    @property
    def middle(self) -> tuple[float, float]:
        """Median of ``u``, and the most probable ``ln q``, as a pair.

        Ends alone leave ``ln q`` nearly to the prior, along a fold that bends: its mean moves where
        the evidence agrees with the configuration, and made the Hopf speed 1.5 % low in voyages.
        """
        of_u, of_q = self.weight.sum(1), self.weight.sum(0)
        u = float(np.interp(0.5, np.cumsum(of_u) - 0.5 * of_u, self.u))
        k = min(max(int(np.argmax(of_q)), 1), of_q.size - 2)
        below, top, above = np.log(np.maximum(of_q[k - 1 : k + 2], 1e-300))
        bend = below - 2.0 * top + above
        off = 0.5 * (below - above) / bend if bend < 0.0 else 0.0
        return u, float(self.log_q[k] + off * (self.log_q[1] - self.log_q[0]))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of ``u`` and ``ln q``, shape (2, 2).

        The deviation of ``u`` is that of a normal distribution with its 90 % interval: a report
        that may be worthless leaves long tails.
        """
        of_u, of_q = self.weight.sum(1), self.weight.sum(0)
        a, b = self.u - of_u @ self.u, self.log_q - of_q @ self.log_q
        low, high = np.interp((0.05, 0.95), np.cumsum(of_u), self.u)
        scale = (high - low) / (2.0 * 1.6449 * math.sqrt(of_u @ a**2))
        product = float(a @ self.weight @ b) * scale
        return np.array([[float(of_u @ a**2) * scale**2, product], [product, float(of_q @ b**2)]])

    def quantiles(self, values: FloatArray, shares: Sequence[float]) -> FloatArray:
        """Return the weighted quantiles of a value in each cell.

        Args:
            values: The values, shape (m, n).
            shares: Shares of the weight, k of them.

        Returns:
            Shape (k,).
        """
        order = np.argsort(values, axis=None)
        reached = np.cumsum(self.weight.ravel()[order])
        return np.interp(shares, reached, values.ravel()[order])


@dataclass(frozen=True, slots=True)
class Spreads:
    """Uncertainties besides those of the bearing."""

    load: float = 0.0  # relative standard deviation of the load, common to a recording
    forget: float = 0.0  # standard deviation by which ln q drifts before each recording but the first


class Posterior(NamedTuple):
    """Posterior of both factors."""

    by_ends: Grid  # by the ends and bounds alone
    by_all: Grid  # by onsets and passages without one, too


def infer(edges: Edges, reference: Reference, prior: FloatArray, spreads: Spreads) -> Posterior:
    """Compute the posterior of both factors from the edges: by the ends, and by onsets too.

    Args:
        edges: The edges, with ``edges.loads`` above 0: a bin is slower than three times the fold.
        reference: The configured bearing.
        prior: Covariance of ``(ln r, ln q)`` about 0, shape (2, 2).
        spreads: Other uncertainties.
    """
    low, high = edges.loads
    load = 0.5 * (math.log(low) + math.log(high))
    reach = 3.5  # standard deviations of the prior
    log_q = reach * math.sqrt(prior[1, 1]) * np.linspace(-1.0, 1.0, 41)
    along = np.array([1.0, reference.slope(load)])
    wide = reach * math.sqrt(float(along @ prior @ along))
    grid = partial(_fold_grid, edges, reference, prior, spreads, load, log_q)
    u = np.arange(-wide, wide, 0.0125)
    coarse = grid(u, quick=True)
    rows = np.flatnonzero(coarse.weight.max(axis=1) > coarse.weight.max() * _NEGLIGIBLE)
    fold = grid(np.linspace(u[rows[0]] - 0.04, u[rows[-1]] + 0.04, 101))
    return Posterior(fold, _weigh_onsets(fold, edges, reference, spreads))


def _fold_grid(
    edges: Edges,
    reference: Reference,
    prior: FloatArray,
    spreads: Spreads,
    load: float,
    log_q: FloatArray,
    u: FloatArray,
    quick: bool = False,
) -> Grid:
    """Return a grid of ``u`` and ``ln q``, weighted by the prior and the ends.

    Args:
        edges: The edges; only the ends count here, and those of one recording must be neighbours.
        reference: The configured bearing.
        prior: Covariance of ``(ln r, ln q)``, shape (2, 2).
        spreads: Other uncertainties. With ``forget`` the weights spread from recording to recording.
        load: Middle of the loads [ln N].
        log_q: Ascending ``ln q``, shape (n,).
        u: Ascending and evenly spaced ``u``, shape (m,).
        quick: Whether to take one typical lag, share and scatter, instead of the sum over all: good
            enough to find the extent of the grid.
    """
    bend = reference.fold(load + log_q) - reference.fold(np.array([load]))
    log_r = u[:, None] - bend
    inverse = np.linalg.inv(prior)
    distance = inverse[0, 0] * log_r**2 + 2.0 * inverse[0, 1] * log_r * log_q + inverse[1, 1] * log_q**2
    nodes = [len(SHARES) * len(LAGS) // 2] if quick else range(len(SHARES) * len(LAGS))
    scatter = np.array([_SCATTER[-2]]) if quick else _SCATTER
    total = np.zeros((len(nodes), scatter.size, *log_r.shape))
    if not quick:
        # The prior of lag, share and scatter, which all ends have in common.
        node_prior = np.tile(_LAG_PRIOR - logsumexp(_LAG_PRIOR), len(SHARES)) - math.log(len(SHARES))
        common = node_prior[:, None] + (_SCATTER_PRIOR - logsumexp(_SCATTER_PRIOR))
        total += common[..., None, None]
    step = float(u[1] - u[0])
    for k, (_, group) in enumerate(groupby(edges.ends, lambda end: end.recording)):
        if k and spreads.forget:
            drift = reference.slope(load) * spreads.forget / step
            best = total.max()
            moved = gaussian_filter1d(np.exp(total - best), drift, axis=2, mode='nearest')
            total = np.log(np.maximum(moved, 1e-300)) + best
        ends = list(group)
        for end in ends:
            bias = spreads.load * math.sqrt(len(ends))
            total += end_log_likelihood(end, reference, log_r, log_q, nodes, scatter, bias)
    log_p = -0.5 * distance + logsumexp(total, axis=(0, 1))
    weight = np.exp(log_p - log_p.max())
    return Grid(u, log_q, log_r, weight / weight.sum(), load)


def end_log_likelihood(
    end: End,
    reference: Reference,
    log_r: FloatArray,
    log_q: FloatArray,
    nodes: Sequence[int],
    scatter: FloatArray,
    bias: float,
) -> FloatArray:
    """Compute the log likelihood of an end, or of a bound, in each cell of a grid.

    Args:
        end: The end, or bound.
        reference: The configured bearing.
        log_r: ``ln r`` of the cells, shape (m, n).
        log_q: ``ln q`` of the cells, shape (n,).
        nodes: Indices of the end's points to take; a bound has one point only.
        scatter: Standard deviations of a passage's own boundary, as ``ln N``, shape (scatters,).
        bias: Standard deviation that the ends of one recording have in common, as ``ln N``.

    Returns:
        Shape (nodes, scatters, m, n); of a bound (1, scatters, m, n).
    """
    _, load = end.middle
    slope = max(reference.slope(math.log(load)), _MIN_SLOPE)
    spread = np.hypot(np.hypot(scatter, bias) * slope, end.timing).reshape(-1, 1, 1)
    trust = end.report.trust
    points = end.points[:1] if end.is_bound else end.points[list(nodes)]
    terms = []
    for v, n in np.log(points).tolist():
        z = (v - log_r - reference.fold(n + log_q)) / spread
        if end.is_bound:
            p = trust * ndtr(-z) + (1.0 - trust) * 0.5
        else:
            density = np.exp(-0.5 * z * z) / (spread * math.sqrt(2.0 * math.pi))
            p = trust * density + (1.0 - trust) / _WORTHLESS_RANGE
        terms.append(np.log(p))
    return np.stack(terms)


def wrong_report_probability(
    end: End, reference: Reference, log_r: float, log_q: float, spread: float
) -> float:
    """Return the probability that an end or bound is a wrong report, for known factors.

    ``spread`` is the standard deviation of the boundary, as ``ln N``; full trust gives 0.
    """
    grid = np.array([[log_r]]), np.array([log_q])
    nodes = range(len(end.points))
    with_trust = end_log_likelihood(end, reference, *grid, nodes, np.array([spread]), 0.0)
    trust = end.report.trust
    wrong = (1.0 - trust) * (0.5 if end.is_bound else 1.0 / _WORTHLESS_RANGE)
    return float(min(wrong / np.exp(with_trust).mean(), 1.0)) if trust < 1.0 else 0.0


def _weigh_onsets(fold: Grid, edges: Edges, reference: Reference, spreads: Spreads) -> Grid:
    """Return the grid ``fold`` with new weights: by onsets as well, and by passages without one.

    Columns of ``ln q`` that are improbable by the ends get the weight 0. Of a bearing that wears
    (``spreads.forget``) only passages of the newest recording count: the errors that older ones have by its
    drift are no more independent than the steps of a walk.
    """
    since = edges.tracks[-1].time[0] if spreads.forget else -math.inf
    columns = np.flatnonzero(fold.weight.max(axis=0) > fold.weight.max() * _NEGLIGIBLE)
    log_r, log_q = fold.log_r[:, columns], fold.log_q[columns]
    common = -0.5 * _FOLD_NODES**2
    total = np.zeros((*log_r.shape, common.size, len(LAGS))) + (
        (common - logsumexp(common))[:, None] + (_LAG_PRIOR - logsumexp(_LAG_PRIOR))
    )
    # The scatter of a passage's own boundary, as a load, moves its likelihood along the speeds.
    above, below = (reference.hopf(fold.load + log_q + off) for off in (0.02, -0.02))
    slope = np.clip((above - below) / 0.04, _MIN_SLOPE, _MAX_SLOPE)
    scatter = slope * math.hypot(0.02, spreads.load) / float(fold.u[1] - fold.u[0])
    for one in (passage for passage in edges.passages if passage.time >= since):
        log_p = passage_log_likelihood(one, reference, log_r.ravel(), np.tile(log_q, fold.u.size))
        likelihood = np.exp(log_p).reshape(total.shape)
        for k, deviation in enumerate(scatter.tolist()):
            total[:, k] += np.log(gaussian_filter1d(likelihood[:, k], deviation, axis=0, mode='nearest'))
    weight = np.zeros_like(fold.weight)
    log_p = np.log(np.maximum(fold.weight[:, columns], 1e-300)) + logsumexp(total, axis=(2, 3))
    weight[:, columns] = np.exp(log_p - log_p.max())
    return replace(fold, weight=weight / weight.sum())


def passage_log_likelihood(
    one: Passage, reference: Reference, log_r: FloatArray, log_q: FloatArray
) -> FloatArray:
    """Compute the log likelihood of a passage in each cell of a grid.

    Args:
        one: The passage, of k bins.
        reference: The configured bearing.
        log_r: ``ln r`` of the cells, shape (cells,).
        log_q: ``ln q`` of the cells, shape (cells,).

    Returns:
        Shape (cells, e-folds, lags); without an onset it is the same for all lags.
    """
    speed, load = one.speed * np.exp(-log_r)[:, None], one.load * np.exp(log_q)[:, None]
    rate = growth_rate(reference.bearing, speed, load)
    step = np.minimum(np.diff(one.bin_time, prepend=one.bin_time[0]), 5.0)
    step = 0.5 * (rate + np.concatenate([rate[:, :1], rate[:, :-1]], axis=1)) * step
    sums = np.cumsum(np.maximum(step, -60.0), axis=1)  # a bin's growth counts as no less [e-folds]
    growth = sums - np.minimum(np.minimum.accumulate(sums, axis=1), 0.0)
    growth = np.maximum.accumulate(growth, axis=1)
    if not one.began:
        p = one.trust * (1.0 - onset_probability(growth[:, -1])) + (1.0 - one.trust) * 0.5
        return np.repeat(np.log(p)[..., None], len(LAGS), axis=-1)
    # Within the tolerance of the time at which a speed that lags shows the point of the onset.
    times = one.time + np.add.outer(np.array([-1.0, 1.0]) * max(one.tolerance, 0.5), LAGS)
    place = np.interp(times, one.bin_time, np.arange(one.bin_time.size))
    low = np.minimum(place.astype(int), one.bin_time.size - 2)
    reached = growth[:, low] + (place - low) * (growth[:, low + 1] - growth[:, low])
    density = np.diff(onset_probability(reached), axis=2)[:, :, 0] / np.diff(times, axis=0)
    right = (1.0 - _BLOWN) * one.trust
    return np.log(right * density + (1.0 - right) / float(one.bin_time[-1] - one.bin_time[0]))


def onset_probability(growth: FloatArray) -> FloatArray:
    """Return the probability that stick-slip has begun after some growth, for each number of e-folds.

    Noise gives a disturbance a Rayleigh amplitude, so that the growth at the onset scatters about the e-folds
    as the logarithm of one does (Gumbel), by ``pi/sqrt(24) = 0.64``.

    Args:
        growth: The growth [e-folds], shape (cells, ...).

    Returns:
        Shape (cells, e-folds, ...).
    """
    folds = _FOLDS * np.exp(_FOLDS_SPREAD * _FOLD_NODES)
    rest = growth[:, None] - folds.reshape(-1, *(1,) * (growth.ndim - 1))
    return np.asarray(np.exp(-np.exp(np.minimum(-2.0 * rest, 60.0))))
