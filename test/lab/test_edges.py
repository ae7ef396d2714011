# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shared import REFERENCE_BEARING
from slow_passages import FOLD, RPM, alternating_reports, slow_passage

from stickslip_lab.calibration.edges import (
    LAGS,
    SHARES,
    Reference,
    find_edges,
    reported_course,
    time_beyond_fold,
)
from stickslip_lab.calibration.evidence import TelemetryBins
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.physics.friction import Coulomb, Stribeck

REFERENCE = Reference(REFERENCE_BEARING)


def test_the_reference_has_both_boundaries() -> None:
    fold, hopf = (math.exp(of(np.log([1000.0]))[0]) for of in (REFERENCE.fold, REFERENCE.hopf))
    # The fold that decides is the exact one, 0.013 % below averaging's.
    assert fold / RPM == pytest.approx(40.7179, rel=1e-5)
    assert hopf / RPM == pytest.approx(30.738, rel=1e-4)


@pytest.mark.parametrize(
    'bearing',
    [
        replace(REFERENCE_BEARING, friction=Stribeck(0.1, 0.3, 10.0)),
        replace(REFERENCE_BEARING, friction=Coulomb(0.1, 0.1)),
    ],
)
def test_a_bearing_without_a_fold_cannot_be_calibrated(bearing: object) -> None:
    with pytest.raises(CalibrationError, match='needs a bearing with a fold'):
        Reference(bearing)  # type: ignore[arg-type]


def test_an_end_with_rising_speed_is_at_the_fold() -> None:
    passage = slow_passage(level=False)
    edges = find_edges([(passage.courses[0], passage.reports)], REFERENCE)
    (end,) = edges.seen
    assert end.middle[0] / RPM == pytest.approx(FOLD, abs=0.3)
    (episode, quiet) = edges.passages
    assert episode.began
    assert not quiet.began


def test_a_list_knows_no_cycle_that_outlives_its_fold_so_all_shares_are_alike() -> None:
    passage = slow_passage(level=False)
    (end,) = find_edges([(passage.courses[0], passage.reports)], REFERENCE).seen
    by_share = end.points.reshape(len(SHARES), len(LAGS), 2)
    assert np.array_equal(by_share, np.broadcast_to(by_share[0], by_share.shape))
    # The posterior weighs the shares alike: they lie evenly from none to all of the time.
    assert np.allclose(np.diff(SHARES), 1.0 / (len(SHARES) - 1))


def test_a_report_shorter_than_its_two_uncertain_ends_is_left_out() -> None:
    passage = slow_passage(level=False)
    (course,), loud = passage.courses, passage.reports[1]
    for tolerance, is_used in ((loud.seconds / 2.0, True), (loud.seconds / 1.9, False)):
        track = reported_course(course, [replace(loud, tolerance=tolerance)], REFERENCE)
        assert (track is not None) == is_used


def test_an_onset_on_a_ramp_of_half_a_minute_is_no_evidence() -> None:
    # At 26 rpm a fall of 0.2 rpm a second is a factor e in 130 s, one of 2 rpm in 13 s.
    for rate, has_onset in ((0.2, True), (2.0, False)):
        reported = slow_passage(rate=rate, level=False)
        edges = find_edges([(reported.courses[0], reported.reports)], REFERENCE)
        assert any(passage.began for passage in edges.passages) == has_onset


def test_an_end_with_falling_speed_or_without_quiet_is_a_bound() -> None:
    episode = slow_passage(level=False)
    (course,) = episode.courses
    quiet_before, loud, _ = episode.reports
    # It ends on the way down, at 24 rpm, by a disturbance.
    loud_early = replace(loud, end_ns=loud.start_ns + 10 * 10**9)
    quiet = replace(quiet_before, start_ns=loud_early.end_ns, end_ns=int(course.time_ns[-1]))
    # A minute without a report lies between.
    quiet_late = replace(quiet, start_ns=loud.end_ns + 60 * 10**9)
    for reports in (
        (quiet_before, loud_early, quiet),
        (quiet_before, loud),
        (quiet_before, loud, quiet_late),
    ):
        edges = find_edges([(course, reports)], REFERENCE)
        (end,) = edges.ends
        assert end.is_bound
        assert end.middle[0] / RPM < FOLD
        # Of quiet behind it nobody knows how far a disturbance has grown already.
        assert [episode.began for episode in edges.passages] == [True]


@pytest.mark.parametrize(('tolerance', 'deviation'), [(2.0, 2.0), (8.0, 4.0)])
def test_half_of_a_wide_tolerance_is_a_deviation(tolerance: float, deviation: float) -> None:
    # At V, rising by r a second, half of ln((V + r s)/(V - r s)) is atanh(r s/V).
    passage = slow_passage(level=False)
    reports = tuple(replace(report, tolerance=tolerance) for report in passage.reports)
    (end,) = find_edges([(passage.courses[0], reports)], REFERENCE).seen
    expected = math.atanh(0.2 * deviation * RPM / end.middle[0])
    assert end.timing == pytest.approx(expected, rel=0.02)


def test_an_onset_is_worth_no_more_than_the_vibration_behind_it() -> None:
    passage_before = slow_passage(level=False)
    quiet_before, loud, quiet_after = passage_before.reports
    reports = quiet_before, replace(loud, trust=0.4), quiet_after
    assert [
        passage.trust for passage in find_edges([(passage_before.courses[0], reports)], REFERENCE).passages
    ] == [0.4, 0.9]


def test_a_shaft_that_stops_ends_no_episode_at_the_fold() -> None:
    passage = slow_passage(level=False)
    (course,) = passage.courses
    stopped = np.where(np.arange(course.speed.size) > 220, 0.0, course.speed)
    still = TelemetryBins(course.name, course.time_ns, stopped, course.load)
    stop = int(course.time_ns[220])
    edges = [int(course.time_ns[0]), int(course.time_ns[170]), stop, int(course.time_ns[-1])]
    (end,) = find_edges([(still, alternating_reports(edges, 'list'))], REFERENCE).ends
    assert end.is_bound


def test_a_cycle_outlives_the_fold_the_longer_the_faster_the_ramp() -> None:
    # Beyond the fold the amplitude leaves y = 1 as a saddle-node is passed, slowly at first:
    # d ln y/dt = (c/2m)(N/N_b(y) - 1) is 0 at the fold itself.
    delays = []
    for rate in (0.2, 2.0):
        passage = slow_passage(rate=rate, level=False)
        track = reported_course(passage.courses[0], passage.reports, REFERENCE)
        assert track is not None
        delays.append(time_beyond_fold(track, passage.reports[1].end_ns * 1e-9, REFERENCE) * rate)
    assert 0.0 < delays[0] < delays[1] < 5.0  # in rpm
