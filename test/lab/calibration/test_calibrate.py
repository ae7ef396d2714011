# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.lab.calibration.calibrate import (
    Calibration,
    DipResult,
    EpisodeEnd,
    calibrate,
    dip_limit,
)
from stickslip_monitor.lab.calibration.evidence import (
    BIN_NS,
    Dip,
    TelemetryBins,
    VibrationReport,
    cut_dips,
)
from stickslip_monitor.lab.calibration.posterior import prior_of, sample_posterior
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
# Damping 40 % high, mu_s - mu_k 20 % low, decay 25 % high: a fold speed of 24 rpm, not 41.
DRAWN_WRONG = Bearing(50.0, 560.0, 2.0e6, Stribeck(0.26, 0.10, 12.5), 0.100)
RPM = BEARING.speed.factor('rpm')
Coast = Callable[..., tuple[TelemetryBins, list[VibrationReport]]]
PRIOR = prior_of(DRAWN_WRONG)


HOPF, FOLD = 30.738, 40.723  # of the bearing at 1 kN [rpm]


def passage(number: int, rate: float, folds: float) -> tuple[TelemetryBins, list[VibrationReport]]:
    """Down and up again at a rate [rpm/s]: noise grows by so many e-folds from the Hopf speed on.

    By the averaged model, ``(e^x - 1 - x)/(beta r) = L 2m/c`` for ``x = beta r t``; the cycle ends
    1.2 s beyond the fold.
    """
    ramp = BEARING.friction.decay * rate * RPM
    x = brentq(lambda x: math.expm1(x) - x - ramp * folds * 100.0 / 400.0, 1e-6, 5.0)
    half = round(40.0 / rate)
    second = np.arange(2 * half + 1)
    time = number * 10**13 + second * BIN_NS
    course = TelemetryBins(
        f'bag {number}', time, (20.0 + rate * np.abs(second - half)) * RPM, np.full(time.size, 1e3)
    )
    seconds = (0.0, (60.0 - HOPF) / rate + x / ramp, half + (FOLD - 20.0) / rate + 1.2, 2.0 * half)
    edges = [int(time[0] + second * 1e9) for second in seconds]
    return course, [
        VibrationReport('aft', a, b, k == 1, 2.0, 0.99, f'report {number}.{k}')
        for k, (a, b) in enumerate(pairwise(edges))
    ]


def dips_of(*made: tuple[TelemetryBins, list[VibrationReport]]) -> list[Dip]:
    limit = dip_limit(PRIOR)
    return [dip for course, reports in made for dip in cut_dips(course, reports, limit)]


def fold(found: Calibration, p: float) -> float:
    return float(found.belief().fold_speed(1000.0, p)) / RPM


def test_no_evidence_leaves_the_prior() -> None:
    posterior = sample_posterior(PRIOR, [])
    assert posterior.log_evidence.sum() == 0.0
    assert posterior.mean == pytest.approx(PRIOR.mean, abs=0.01)
    assert posterior.covariance == pytest.approx(PRIOR.covariance, abs=0.02)


def test_a_recording_counts_once(coast: Coast) -> None:
    course, reports = coast(0)
    (dip,) = dips_of((course, reports))
    (copy,) = dips_of((replace(course, name='copy of it'), reports))
    one, both = calibrate([dip], PRIOR), calibrate([dip, copy], PRIOR)
    assert both.posterior.mean.tolist() == one.posterior.mean.tolist()
    assert both.remarks[1] == 'copy of it was given before and counts once'
    known = [(dip.fingerprint, dip.start_ns, dip.end_ns)]
    with pytest.raises(CalibrationError, match='copy of it is in the earlier result already'):
        calibrate([copy], PRIOR, known=known)


def test_one_report_alone_is_little(coast: Coast) -> None:
    # An operator's squeal at 58 rpm, and no word of when it was quiet.
    course, _ = coast()
    start = int(course.time_ns[10])
    alone = VibrationReport('aft', start, start + 30 * BIN_NS, True, 10.0, 0.9, 'list, line 2')
    found = calibrate(dips_of((course, [alone])), prior_of(BEARING))
    # It may be wrong: 5 % of the prior have their fold below 17 rpm, and of this below 22.
    assert fold(found, 0.05) < 22.0
    assert found.warnings[0].startswith('all rests on one report of vibration (list, line 2)')


def test_two_episodes_correct_a_wrong_drawing(coast: Coast) -> None:
    made = [coast(0), coast(1)]
    found = calibrate(dips_of(*made), PRIOR)
    assert fold(found, 0.5) == pytest.approx(40.7, rel=0.03)
    assert fold(found, 0.05) < 40.7 < fold(found, 0.95) < 1.2 * fold(found, 0.05)
    assert found.episodes == 2
    assert found.warnings == []
    assert any('all evidence is at 1000 to 1000 N' in text for text in found.remarks)
    # The order in which recordings are given does not matter.
    again = calibrate(dips_of(*made[::-1]), PRIOR)
    assert again.posterior.mean.tolist() == found.posterior.mean.tolist()


def test_quiet_alone_bounds_the_hopf_speed(coast: Coast) -> None:
    course, _ = coast()
    fast = replace(course, speed=np.maximum(course.speed, 45.0 * RPM))
    report = VibrationReport(
        'aft', int(course.time_ns[0]), int(course.time_ns[-1]), False, 2.0, 0.99, ''
    )
    found = calibrate(dips_of((fast, [report])), prior_of(BEARING))
    hopf = found.belief().hopf_speed(1000.0, 0.95) / RPM
    assert hopf < 44.0
    assert fold(found, 0.95) > 55.0
    assert 'no episode was seen' in found.warnings[0]


@pytest.mark.parametrize(
    'folds',
    [pytest.param(3.5, marks=pytest.mark.slow), 5.0, pytest.param(8.0, marks=pytest.mark.slow)],
)
def test_the_hopf_interval_holds_however_loud_the_noise(folds: float) -> None:
    """Linings took 3.5 e-folds from loud noise to stick-slip, and quiet ones take eight."""
    made = [passage(k, rate, folds) for k, rate in enumerate((0.1, 0.15, 0.2, 0.3, 0.5))]
    found = calibrate(dips_of(*made), PRIOR)
    low, middle, high = (found.belief().hopf_speed(1000.0, p) / RPM for p in (0.05, 0.5, 0.95))
    assert low < HOPF < high
    assert middle == pytest.approx(HOPF, rel=0.05)
    assert high < 1.25 * low


def test_a_false_report_is_named_and_does_little(coast: Coast) -> None:
    made = [coast(k) for k in range(3)]
    before = calibrate(dips_of(*made), PRIOR)
    course, reports = coast(3)
    # A squeal at 58 rpm, where none of the four had one.
    start = int(course.time_ns[3])
    false = VibrationReport(
        'aft', start, start + 8 * BIN_NS, True, 2.0, 0.9, 'squeals.csv, line 7'
    )
    late = replace(reports[0], start_ns=false.end_ns)
    found = calibrate(dips_of(*made, (course, [false, late, *reports[1:]])), PRIOR)
    assert fold(found, 0.5) == pytest.approx(fold(before, 0.5), rel=0.015)
    (text,) = found.warnings
    assert text.startswith('squeals.csv, line 7: squeal for 8 s')
    assert text.endswith('worthless with 100%')


@pytest.mark.slow
def test_a_bearing_that_changed_is_noticed_and_forgetting_follows(coast: Coast) -> None:
    # Six dips tell the fold to 2 %; three ends 10 % above it are together one in 500.
    made = [coast(k) for k in range(6)]
    for k in range(6, 9):
        course, reports = coast(k)
        made.append((replace(course, speed=1.1 * course.speed), reports))
    dips = dips_of(*made)
    surprised = calibrate(dips, PRIOR)
    assert any('hardly to be expected' in text for text in surprised.warnings)
    followed = calibrate(dips, PRIOR, forget=0.05)
    assert fold(followed, 0.5) == pytest.approx(1.1 * 40.7, rel=0.03)
    assert fold(surprised, 0.5) < fold(followed, 0.5)


def test_forgetting_follows_the_newest_dips(coast: Coast) -> None:
    course, reports = coast(1)
    changed = replace(course, speed=1.1 * course.speed), reports
    followed = calibrate(dips_of(coast(0), changed), PRIOR, forget=0.1)
    assert fold(followed, 0.5) > 1.07 * 40.7


@pytest.mark.parametrize(('late', 'told'), [(0.95, True), (0.05, True), (0.5, False)])
def test_episodes_that_end_on_one_side_are_told(late: float, told: bool, coast: Coast) -> None:
    (dip,) = dips_of(coast(0))
    judged = DipResult(dip, -0.1, (), (EpisodeEnd(0, 1.0, 1.0, late),))
    found = Calibration(PRIOR, sample_posterior(PRIOR, []), (judged,) * 5)
    assert any('hardly to be expected' in text for text in found.warnings) == told


def test_quiet_in_which_stick_slip_was_certain_is_surprising(coast: Coast) -> None:
    (dip,) = dips_of((coast()[0], [VibrationReport('aft', 0, 10**12, False, 2.0, 0.99, '')]))
    assert DipResult(dip, -5.0, (0.5,), ()).surprising
    assert not DipResult(dip, -0.1, (0.5,), ()).surprising
