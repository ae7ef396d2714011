# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from shared import REFERENCE_BEARING
from slow_passages import FOLD, ONSET, RPM, alternating_reports, slow_passage

from stickslip_lab.calibration.calibration import (
    Calibration,
    Evidence,
    calibrate,
    prior_covariance,
    read_levels,
)
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.physics.averaging import fold_speed, hopf_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import FrictionLaw, Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.probability import EXACT, Tolerance

# Damping 40 % high, mu_s - mu_k 20 % low, decay 25 % high: a fold speed of 24 rpm, not 41.
DRAWN_WRONG = Bearing(50.0, 560.0, 2.0e6, Stribeck(0.26, 0.10, 12.5), 0.100)
SPEED = np.linspace(0.0, 0.6, 40)
RATES = (0.2, 0.4, 0.15, 0.3, 0.25)


def calibrate_levels(evidence: Sequence[Evidence], bearing: Bearing = DRAWN_WRONG) -> Calibration:
    return calibrate(read_levels('aft', evidence), bearing, EXACT)


def fold_rpm(calibration: Calibration, p: float = 0.5) -> float:
    return float(calibration.belief.fold_speed(1000.0, p)) / RPM


@pytest.mark.parametrize(
    'law',
    [
        Stribeck(0.26, 0.10, 12.5),
        Stribeck(0.30, 0.10, 8.0, 0.05),
        Stretched(0.26, 0.10, 7.0, 0.0, 1.5),
        Tabulated(SPEED.tolist(), (0.1 + 0.16 * np.exp(-12.5 * SPEED)).tolist()),
    ],
)
def test_five_passages_correct_a_wrong_drawing_of_any_law(law: FrictionLaw) -> None:
    calibration = calibrate_levels(
        [slow_passage(k, rate) for k, rate in enumerate(RATES)], replace(DRAWN_WRONG, friction=law)
    )
    assert fold_rpm(calibration) == pytest.approx(FOLD, rel=0.02)
    assert (
        fold_rpm(calibration, 0.05) < FOLD < fold_rpm(calibration, 0.95) < 1.1 * fold_rpm(calibration, 0.05)
    )
    # The bearing that is used instead has this fold itself.
    assert fold_speed(calibration.bearing, 1000.0) / RPM == pytest.approx(fold_rpm(calibration), rel=0.01)
    assert calibration.episodes == 5
    assert calibration.warnings == []
    assert any('all evidence is at 1000 to 1000 N' in text for text in calibration.remarks)


def test_the_bearing_that_is_believed_has_grown_some_e_folds_at_the_onsets() -> None:
    """``G = (c/2m) ((e^(b t) - 1)/b - t)`` on a ramp, t after the Hopf speed, ``b = beta dV/dt``."""
    calibration = calibrate_levels([slow_passage(k, rate) for k, rate in enumerate(RATES)])
    bearing, law = calibration.belief.bearing, calibration.belief.bearing.friction
    assert isinstance(law, Stribeck)
    hopf = hopf_speed(bearing, 1000.0) / RPM
    rate = np.array(RATES)
    b, t = law.decay * rate * RPM, (hopf - ONSET) / rate
    grown = bearing.damping / (2.0 * bearing.mass) * (np.expm1(b * t) / b - t)
    # Onsets at one speed, whatever the rate, are of less growth than the 2.2 e-folds of most ships.
    assert 1.0 < np.median(grown) < 2.2
    assert calibration.hopf_speeds(1000.0)[1] == pytest.approx(hopf * RPM, rel=0.01)


def test_a_value_without_a_tolerance_is_as_uncertain_as_a_drawing() -> None:
    """Take 40 % of the damping, 30 % of the decay and 25 % of mu_s - mu_k (here 0.2), as in the docs."""
    for tolerance, fall in (
        (EXACT, 0.25),
        (Tolerance(static=0.05, kinetic=0.05), math.hypot(0.05 * 0.3, 0.05 * 0.1) / 0.2),
    ):
        expected = [[0.09, -0.09], [-0.09, 0.09 + 0.16 + fall**2]]
        np.testing.assert_allclose(prior_covariance(REFERENCE_BEARING, tolerance), expected, rtol=1e-12)


def test_knocks_move_nothing_and_are_counted() -> None:
    quiet = calibrate_levels([slow_passage(k) for k in range(2)])
    knocked = calibrate_levels([slow_passage(k, knocks=(30.0, 350.0)) for k in range(2)])
    assert fold_rpm(knocked) == pytest.approx(fold_rpm(quiet), rel=1e-3)
    assert any('4 vibrations of less than 10 s left out' in text for text in knocked.remarks)


def test_a_recording_counts_once_whatever_its_name() -> None:
    first, second = slow_passage(0), slow_passage(1)
    course = replace(first.courses[0], name='copy of it')
    copy = replace(first, name='copy of it', courses=(course,))
    calibration = calibrate_levels([first, copy, second])
    assert fold_rpm(calibration) == fold_rpm(calibrate_levels([first, second]))
    assert 'copy of it was given before and counts once' in calibration.remarks


def test_one_end_alone_is_reported() -> None:
    (text,) = calibrate_levels([slow_passage(0)]).warnings
    assert text.startswith('all rests on one end of vibration (bag 0, 2)')


def test_quiet_alone_says_little_of_the_fold() -> None:
    passage = slow_passage(level=False)
    fast = replace(passage.courses[0], speed=np.maximum(passage.courses[0].speed, 45.0 * RPM))
    span = [int(fast.time_ns[0]), int(fast.time_ns[-1])]
    calibration = calibrate(
        [Evidence('bag', (fast,), alternating_reports(span, 'list'))], REFERENCE_BEARING, EXACT
    )
    assert 'no episode was seen' in calibration.warnings[0]
    # Noise would have grown at 45 rpm, had it been below the Hopf speed.
    assert calibration.hopf_speeds(1000.0)[2] / RPM < 48.0
    assert fold_rpm(calibration, 0.95) > 55.0


def test_a_false_report_is_named_and_does_little() -> None:
    passages = [slow_passage(k, level=False) for k in range(4)]
    undisturbed = calibrate(passages, REFERENCE_BEARING, EXACT)
    (course,) = passages[3].courses
    start = int(course.time_ns[5])
    # A squeal while the shaft slowed down from 59 to 56 rpm and turned at 60 again after it.
    speed = np.where(course.time_ns > start + 12 * 10**9, 60.0 * RPM, course.speed)
    false_course = replace(course, name='bag 9', speed=speed)
    edges = [int(course.time_ns[0]), start, start + 14 * 10**9, int(course.time_ns[-1])]
    false = Evidence('bag 9', (false_course,), alternating_reports(edges, 'squeals.csv'))
    calibration = calibrate([*passages, false], REFERENCE_BEARING, EXACT)
    assert fold_rpm(calibration) == pytest.approx(fold_rpm(undisturbed), rel=0.01)
    (text,) = calibration.warnings
    assert text.startswith('squeals.csv, line 2: vibration for 14 s')
    assert 'worthless with' in text


def test_a_bearing_that_changed_is_noticed_and_forgetting_follows() -> None:
    passages = [slow_passage(k) for k in range(5)] + [slow_passage(k, by=1.15) for k in range(5, 8)]
    evidence = read_levels('aft', passages)
    calibration = calibrate(evidence, REFERENCE_BEARING, EXACT)
    assert any('may have changed' in text for text in calibration.warnings)
    followed = calibrate(evidence, REFERENCE_BEARING, EXACT, forget=0.1)
    assert fold_rpm(calibration) < 1.12 * FOLD < fold_rpm(followed) < 1.18 * FOLD
    steady = calibrate_levels([slow_passage(k, rate) for k, rate in enumerate(RATES)])
    assert not steady.has_changed


def test_the_level_of_another_bearing_is_refused() -> None:
    # Vibration that ends at 3 and at 5 times the fold is none of this bearing's.
    far = [slow_passage(0, by=3.5), slow_passage(1, by=9.0)]
    with pytest.raises(CalibrationError, match='is the level that of another bearing, or a unit'):
        calibrate_levels(far, REFERENCE_BEARING)


def test_without_a_slow_passage_there_is_no_evidence() -> None:
    passage = slow_passage(level=False)
    with pytest.raises(CalibrationError, match='there is no evidence'):
        calibrate([replace(passage, reports=())], REFERENCE_BEARING, EXACT)
