# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from slow_passages import FOLD, ONSET, slow_passage

from stickslip_lab.calibration.level_reports import (
    LevelBins,
    NoTwoModes,
    bin_level,
    level_reports,
    threshold_of,
)
from stickslip_monitor.arrays import FloatArray

NOISE = np.random.default_rng(4).standard_normal(4000)
TIME = np.arange(4000) * 0.25


def level_course(decibels: FloatArray, speed: FloatArray | float = 0.2) -> LevelBins:
    return bin_level(TIME, decibels, TIME, np.broadcast_to(speed, TIME.shape))


def test_a_cycle_stands_out_whatever_its_gain() -> None:
    for gain in (-60.0, 0.0, 40.0):
        level = slow_passage().level
        assert level is not None
        threshold = threshold_of([LevelBins(level.time, level.value + gain, level.by_speed)])
        # In vibration the level is the surface speed, 0 dB over it; quiet is 26 dB below the fold's, so
        # that it is 26 dB less 20 lg of a speed of 0.5 to 1.5 folds.
        assert gain - 15.0 < threshold < gain - 11.0


def test_edges_are_where_the_level_leaves_its_plateau() -> None:
    level = slow_passage(rate=0.2).level
    assert level is not None
    reports, knocks = level_reports('aft', level, threshold_of([level]), 'bag')
    assert [report.squeal for report in reports] == [False, True, False]
    assert knocks == []
    begin, end = (round(t * 1e-9 - 1e4, 1) for t in (reports[1].start_ns, reports[1].end_ns))
    assert begin == pytest.approx((60.0 - ONSET) / 0.2, abs=0.6)
    assert end == pytest.approx(200.0 + (FOLD - 20.0) / 0.2, abs=0.6)
    assert reports[1].rings


def test_the_lag_of_a_level_is_read_from_its_fall_and_taken_off_its_rise() -> None:
    # A detector whose mean square lags by 2 s falls 2.17 dB a second: 3 dB are 1.38 s late, and
    # so is the half of the power, 3 dB below the plateau, on the way up.
    loud = (TIME > 300.0) & (TIME < 500.0)
    power = np.where(loud, 1.0, 1e-4)
    for k in range(1, power.size):
        power[k] = power[k - 1] + (power[k] - power[k - 1]) * (1.0 - np.exp(-0.125))
    level = level_course(10.0 * np.log10(power))
    reports, _ = level_reports('aft', level, threshold_of([level]), 'bag')
    assert reports[1].start_ns * 1e-9 == pytest.approx(300.0, abs=0.55)  # two bins
    assert reports[1].end_ns * 1e-9 == pytest.approx(500.0, abs=0.55)


def test_a_knock_is_no_episode_and_a_gap_is_no_quiet() -> None:
    loud = (TIME % 300.0 < 6.0) | ((TIME > 700.0) & (TIME < 800.0))
    level = level_course(np.where(loud, 0.0, -20.0) + 0.3 * NOISE)
    keep = (level.time < 500.0) | (level.time > 600.0)
    cut = LevelBins(level.time[keep], level.value[keep], level.by_speed[keep])
    reports, knocks = level_reports('aft', cut, threshold_of([cut]), 'bag')
    assert sum(report.squeal for report in reports) == 1
    assert len(knocks) == 4
    assert not any(report.start_ns < 550e9 < report.end_ns for report in reports)


SLOWER = np.where(TIME < 500.0, 1.0, 0.2)
BAD: dict[str, tuple[Callable[[], LevelBins], str]] = {
    'silent': (lambda: level_course(np.full(4000, np.nan)), 'no valid value came while the shaft turned'),
    'at rest': (lambda: level_course(NOISE, 0.0), 'no valid value came while the shaft turned'),
    'stuck': (lambda: level_course(np.full(4000, -20.0), SLOWER), 'it stays at -20.0 dB'),
    'noise alone': (lambda: level_course(NOISE), 'of the values between them'),
    'another speed': (lambda: level_course(-20.0 + NOISE, SLOWER), 'of the values between them'),
    'a drift': (lambda: level_course(np.linspace(-20.0, 0.0, 4000) + NOISE), 'of the values between them'),
}


@pytest.mark.parametrize('kind', BAD)
def test_a_level_without_two_modes_is_refused(kind: str) -> None:
    make, words = BAD[kind]
    with pytest.raises(NoTwoModes, match=words) as caught:
        threshold_of([make()])
    assert len(caught.value.levels) == 1


def test_a_clipped_level_still_has_two_modes() -> None:
    speed = np.where(TIME < 500.0, 0.3, 0.15)
    loud = (TIME > 400.0) & (TIME < 700.0)
    decibels = np.where(loud, 20.0 * np.log10(speed), -34.0) + NOISE
    level = level_course(np.minimum(decibels, -14.0), speed)
    reports, _ = level_reports('aft', level, threshold_of([level]), 'bag')
    assert [report.squeal for report in reports] == [False, True, False]
