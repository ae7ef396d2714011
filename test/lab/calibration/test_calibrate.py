# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.lab.calibration.calibrate import (
    Calibration,
    DipResult,
    calibrate,
    dip_limit,
)
from stickslip_monitor.lab.calibration.dips import (
    BIN_NS,
    Dip,
    TelemetryBins,
    VibrationReport,
    cut_dips,
)
from stickslip_monitor.lab.calibration.posterior import prior_of, sample_posterior
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
# Damping 40 % high, mu_s - mu_k 20 % low, decay 25 % high: a fold speed of 24 rpm, not 41.
DRAWN_WRONG = Bearing(50.0, 560.0, 2.0e6, Stribeck(0.26, 0.10, 12.5), 0.100)
RPM = BEARING.speed.factor('rpm')
Coast = Callable[..., tuple[TelemetryBins, list[VibrationReport]]]
PRIOR = prior_of(DRAWN_WRONG)


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


def test_a_bearing_that_changed_is_noticed_and_forgetting_follows(coast: Coast) -> None:
    made = [coast(k) for k in range(3)]
    for k in range(3, 6):
        course, reports = coast(k)
        made.append((replace(course, speed=1.1 * course.speed), reports))
    dips = dips_of(*made)
    surprised = calibrate(dips, PRIOR)
    assert any('hardly to be expected' in text for text in surprised.warnings)
    followed = calibrate(dips, PRIOR, forget=0.05)
    assert fold(followed, 0.5) == pytest.approx(1.1 * 40.7, rel=0.03)
    assert fold(surprised, 0.5) < fold(followed, 0.5)


@pytest.mark.parametrize(
    ('bearing', 'words'),
    [
        (Bearing(50.0, 400.0, 2.0e6, Coulomb(0.3, 0.1), 0.1), 'law stribeck'),
        (Bearing(50.0, 0.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1), 'damping = 0'),
    ],
)
def test_a_bearing_without_boundaries_is_refused(bearing: Bearing, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        prior_of(bearing)


def test_quiet_in_which_stick_slip_was_certain_is_surprising(coast: Coast) -> None:
    (dip,) = dips_of((coast()[0], [VibrationReport('aft', 0, 10**12, False, 2.0, 0.99, '')]))
    assert DipResult(dip, -5.0, (0.5,), ()).surprising
    assert not DipResult(dip, -0.1, (0.5,), ()).surprising
