# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import gumbel_r
from shared import REFERENCE_BEARING
from slow_passages import RPM

from stickslip_lab.calibration.edges import LAGS, Edges, End, Passage, Reference, ReportedCourse
from stickslip_lab.calibration.evidence import VibrationReport
from stickslip_lab.calibration.posterior import (
    _FOLD_NODES,
    _FOLDS,
    _LAG_PRIOR,
    Spreads,
    infer,
    onset_probability,
    passage_log_likelihood,
)
from stickslip_monitor.arrays import FloatArray

REFERENCE = Reference(REFERENCE_BEARING)
PRIOR = np.array([[0.09, -0.09], [-0.09, 0.30]])
REPORT = VibrationReport('aft', 0, 10**11, True, 1.0, 0.999, 'level, 1')


def make_edges(*speeds: float, load: float = 1000.0) -> Edges:
    """Ends at some speeds [m/s], each of a recording of its own, on a slow passage."""
    column = np.full(20, load)
    track = ReportedCourse('bag', (REPORT,), np.arange(20.0), np.full(20, 0.2), column, np.ones(20))
    ends = [
        End(REPORT, f'bag {k}', float(k), np.tile([speed, load], (25, 1)), 0.0)
        for k, speed in enumerate(speeds)
    ]
    return Edges(ends, [], [track])


def scaled_fold(speed_factor: float) -> float:
    return speed_factor * float(np.exp(REFERENCE.fold(np.log([1000.0]))[0]))


def test_without_an_end_the_prior_is_left() -> None:
    estimate = infer(make_edges(), REFERENCE, PRIOR, Spreads()).by_ends
    slope = REFERENCE.slope(math.log(1000.0))
    by = np.array([1.0, slope])
    assert estimate.middle == pytest.approx((0.0, 0.0), abs=0.04)
    # To first order; the fold bends with the load.
    assert math.sqrt(estimate.covariance[0, 0]) == pytest.approx(math.sqrt(by @ PRIOR @ by), rel=0.1)
    assert math.sqrt(estimate.covariance[1, 1]) == pytest.approx(math.sqrt(0.30), rel=0.05)


def test_ends_are_averaged_as_normal_numbers_are() -> None:
    # Four ends 10 % above: the fold is there, within the prior's scatter of 2 % of the load and
    # the bias of the load of 3 % between recordings, by the slope of the fold, over sqrt(4).
    estimate = infer(make_edges(*[scaled_fold(1.1)] * 4), REFERENCE, PRIOR, Spreads(load=0.03)).by_ends
    assert estimate.middle[0] == pytest.approx(math.log(1.1), abs=0.004)
    expected = math.hypot(0.02, 0.03) * REFERENCE.slope(math.log(1000.0)) / 2.0
    assert math.sqrt(estimate.covariance[0, 0]) == pytest.approx(expected, rel=0.2)


def test_ends_at_the_configured_fold_do_not_move_the_estimate() -> None:
    # The prior's best is at (0, 0), and ends at the configured fold do not move it off there.
    estimate = infer(make_edges(*[scaled_fold(1.0)] * 5), REFERENCE, PRIOR, Spreads()).by_ends
    assert estimate.middle == pytest.approx((0.0, 0.0), abs=0.01)


def test_a_bound_pushes_the_fold_up() -> None:
    edges = make_edges(scaled_fold(1.0))
    bound = End(REPORT, 'bag 9', 9.0, np.array([[scaled_fold(1.3), 1000.0]]), 0.0)
    only = Edges([bound], [], edges.tracks)
    estimate = infer(only, REFERENCE, PRIOR, Spreads()).by_ends
    low = float(estimate.quantiles(np.tile(estimate.u[:, None], estimate.log_q.size), [0.05])[0])
    assert low > math.log(1.2)


def test_forgetting_follows_the_newest_ends() -> None:
    speeds = [scaled_fold(1.0)] * 4 + [scaled_fold(1.1)] * 2
    estimate, followed = (
        infer(make_edges(*speeds), REFERENCE, PRIOR, Spreads(forget=forget)).by_ends.middle[0]
        for forget in (0.0, 0.1)
    )
    assert estimate < 0.06 < 0.08 < followed


LAG = LAGS.index(0.0)
RATE = 0.3
"""Of the ramps: down from the Hopf speed [rpm/s]."""


def make_onset(seconds: float, began: bool = True) -> Passage:
    """Down from the Hopf speed for some seconds, then over by the tolerance and the longest lag."""
    time = np.arange(0.0, seconds + 3.5, 0.25)
    speed = math.log(5.0) / 10.0 - RATE * RPM * time
    return Passage(seconds, time, speed, np.full(time.size, 1000.0), began, 1.0, 0.99)


def growth_after(seconds: FloatArray) -> FloatArray:
    """On a ramp G = (c/2m) ((e^x - 1)/b - t) with x = b t, b = beta rate [e-folds]."""
    b = 10.0 * RATE * RPM
    return np.asarray(400.0 / 100.0 * ((np.exp(b * seconds) - 1.0) / b - seconds))


def likelihood_at(passage: Passage, log_q: FloatArray) -> FloatArray:
    """Likelihood of a passage along ln q by the median e-folds, without a lag."""
    likelihood = passage_log_likelihood(passage, REFERENCE, np.zeros(log_q.size), log_q)
    return np.asarray(np.exp(likelihood[:, _FOLD_NODES.size // 2, LAG]))


def test_onsets_come_when_noise_has_grown() -> None:
    # At the true boundary, over the times of onset: the distribution of ln(Rayleigh) about the e-folds,
    # beside the even one of onsets that a blow began, or that are worthless.
    seconds = np.arange(2.0, 40.0, 0.05)
    density = np.array([likelihood_at(make_onset(float(t)), np.zeros(1))[0] for t in seconds])
    right = 0.9 * 0.99
    density -= (1.0 - right) / (seconds + 3.25)
    expected = gumbel_r(_FOLDS, 0.5).cdf(growth_after(np.stack([seconds - 1.0, seconds + 1.0])))
    np.testing.assert_allclose(density, right * np.diff(expected, axis=0)[0] / 2.0, atol=0.003)
    mean, expected_mean = (
        np.average(seconds, weights=weight) for weight in (density, np.gradient(expected.mean(axis=0)))
    )
    assert mean == pytest.approx(expected_mean, abs=0.1)


def test_a_speed_that_lags_shows_the_onset_later() -> None:
    # Of one course, an onset at 12 s with a lag of 1.5 s is as likely as one at 13.5 s without.
    later = make_onset(13.5)
    early = replace(later, time=12.0)
    a, b = (passage_log_likelihood(one, REFERENCE, np.zeros(1), np.zeros(1)) for one in (early, later))
    np.testing.assert_allclose(a[..., LAGS.index(1.5)], b[..., LAG])


def test_growing_noise_reaches_an_amplitude_as_the_logarithm_of_a_rayleigh_amplitude() -> None:
    # Paths of da = s t a dt + dw, from far before the boundary: in growth since then, they reach an amplitude
    # with the scatter of ln(Rayleigh), pi/sqrt(24), whatever the noise, as ours do.
    random, step, slope, paths = np.random.default_rng(5), 0.01, 0.5, 4000
    a, reached = np.zeros(paths, complex), np.full((2, paths), np.nan)
    for k in range(-500, 800):
        a *= math.exp(slope * k * step * step)
        a += math.sqrt(step) * (random.standard_normal(paths) + 1j * random.standard_normal(paths))
        for row, amplitude in enumerate((1e3, 1e4)):
            new = np.isnan(reached[row]) & (np.abs(a) >= amplitude) & (k > 0)
            reached[row, new] = 0.5 * slope * (k * step) ** 2
    assert reached.std(axis=1) == pytest.approx(math.pi / math.sqrt(24.0), rel=0.04)
    assert np.diff(reached.mean(axis=1)) == pytest.approx(math.log(10.0), rel=0.02)
    growth = np.linspace(-3.0, 12.0, 3001)[None]
    probability = onset_probability(growth)[0, _FOLD_NODES.size // 2]
    weight = np.gradient(probability)
    mean = np.average(growth[0], weights=weight)
    deviation = math.sqrt(np.average((growth[0] - mean) ** 2, weights=weight))
    assert deviation == pytest.approx(math.pi / math.sqrt(24.0), rel=1e-3)


def test_quiet_bounds_how_far_noise_can_have_grown() -> None:
    log_q = np.array([-0.5, 0.0, 0.5])
    steady, middle, wild = likelihood_at(make_onset(12.0, began=False), log_q)
    assert steady > middle > wild


def test_the_load_of_a_passage_scatters_by_a_normal_number() -> None:
    # An onset pulls the Hopf speed as one whose likelihood is averaged over many loads of the passage.
    edges = make_edges(*[scaled_fold(1.0)] * 4)
    onset = make_onset(14.0)
    posterior = infer(replace(edges, passages=[onset]), REFERENCE, PRIOR, Spreads(load=0.03))
    fold = posterior.by_ends
    z = np.linspace(-3.0, 3.0, 41)
    common = np.exp(-0.5 * _FOLD_NODES**2)[:, None] * np.exp(_LAG_PRIOR)
    likelihood = sum(
        math.exp(-0.5 * k * k)
        * np.exp(
            passage_log_likelihood(
                onset,
                REFERENCE,
                fold.log_r.ravel(),
                np.tile(fold.log_q, fold.u.size) + k * math.hypot(0.02, 0.03),
            )
        )
        for k in z.tolist()
    )
    weight = fold.weight * (likelihood * common).sum(axis=(1, 2)).reshape(fold.weight.shape)
    expected = replace(fold, weight=weight / weight.sum())
    hopf = fold.log_r + REFERENCE.hopf(fold.load + fold.log_q)
    smoothed, averaged = (grid.quantiles(hopf, [0.05, 0.5, 0.95]) for grid in (posterior.by_all, expected))
    np.testing.assert_allclose(smoothed, averaged, atol=0.01)
