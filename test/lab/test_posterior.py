# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm
from shared import REFERENCE_BEARING
from slow_passages import RPM

from stickslip_lab.calibration.edges import Edges, End, Passage, Reference, ReportedCourse
from stickslip_lab.calibration.evidence import VibrationReport
from stickslip_lab.calibration.posterior import (
    _FOLD_NODES,
    _FOLDS_SPREAD,
    _GROWN,
    Spreads,
    infer,
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


def make_onset(rate: float, seconds: float, began: bool = True) -> Passage:
    """Down from the Hopf speed at a rate [rpm/s] for some seconds, then over by the tolerance."""
    time = np.arange(0.0, seconds + 3.25, 0.25)
    speed = math.log(5.0) / 10.0 - rate * RPM * time
    step = np.diff(time, prepend=time[0])
    return Passage(seconds, speed, np.full(time.size, 1000.0), step, began, 1.0, 0.99)


def likelihood_at(passage: Passage, log_q: FloatArray) -> FloatArray:
    """Likelihood of a passage along ln q, e-folds summed over by their prior, without a lag."""
    likelihood = passage_log_likelihood(passage, REFERENCE, np.zeros(log_q.size), log_q)
    weight = np.exp(-0.5 * np.linspace(-2.2, 2.2, likelihood.shape[1]) ** 2)
    return np.asarray(np.exp(likelihood[:, :, 1]) @ weight)


def test_an_onset_is_likeliest_where_noise_has_grown_three_e_folds() -> None:
    # On a ramp G = (c/2m) ((e^x - 1)/b - t) with x = b t, b = beta rate: 3 e-folds after t.
    rate = 0.3
    b = 10.0 * rate * RPM
    time = np.linspace(1.0, 40.0, 4000)
    grown = 400.0 / 100.0 * ((np.exp(b * time) - 1.0) / b - time)
    seconds = float(time[np.argmin(np.abs(grown - 3.0))])
    log_q = np.linspace(-0.3, 0.3, 121)
    likely = likelihood_at(make_onset(rate, seconds), log_q)
    assert log_q[np.argmax(likely)] == pytest.approx(0.0, abs=0.05)


def test_quiet_bounds_how_far_noise_can_have_grown() -> None:
    log_q = np.array([-0.5, 0.0, 0.5])
    steady, middle, wild = likelihood_at(make_onset(0.3, 12.0, began=False), log_q)
    assert steady > middle > wild


def test_the_nodes_of_the_onsets_stand_for_a_normal_spread() -> None:
    """Between ships and between onsets the e-folds differ as normal numbers do: their variances add."""
    offset = np.linspace(-2.0, 2.0, 201) * math.hypot(_FOLDS_SPREAD, _GROWN)
    weight = np.exp(-0.5 * _FOLD_NODES**2)
    density = norm.pdf(offset[:, None], _FOLDS_SPREAD * _FOLD_NODES, _GROWN) @ weight / weight.sum()
    np.testing.assert_allclose(density, norm.pdf(offset, 0.0, math.hypot(_FOLDS_SPREAD, _GROWN)), rtol=0.02)
