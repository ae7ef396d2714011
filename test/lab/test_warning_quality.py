# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of judging warnings, on episodes and alarms made by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from stickslip_monitor.lab.score import Truth
from stickslip_monitor.lab.warning_quality import (
    Forecast,
    Quality,
    Said,
    largest_burst,
    pooled,
    quality_of,
)

HOUR = 3600
Spans = Sequence[tuple[float, float]]


def ns(spans: Spans) -> tuple[tuple[int, int], ...]:
    return tuple((round(start * 1e9), round(end * 1e9)) for start, end in spans)


def truth(episodes: Spans, margin: Sequence[float] = ()) -> Truth:
    """An hour; margins of both boundaries once a second, 0.2 where none are given."""
    values = np.full(HOUR + 1, 0.2)
    values[: len(margin)] = margin
    time = np.arange(HOUR + 1) * 10**9
    return Truth(0, HOUR * 10**9, ns(episodes), time, values, values)


def said(warned: Spans = (), alarmed: Spans = (), changes: int = 0) -> Said:
    return Said(ns(warned), ns(alarmed), [], changes)


def test_leads_misses_and_detection() -> None:
    """Of four episodes: 20 s before, 4 s before, 3 s late, never; two of them are detected."""
    quality = quality_of(
        said(
            warned=[(80, 150), (996, 1001), (2003, 2010)],
            alarmed=[(105, 150), (2003, 2010)],
            changes=9,
        ),
        truth([(100, 120), (1000, 1010), (2000, 2020), (3000, 3010)]),
        plain=True,
    )
    assert sorted(quality.leads) == [-3.0, 4.0, 20.0]
    figures = quality.figures()
    assert figures['episodes'] == 4
    assert figures['warned'] == 2 / 4
    assert figures['lead_10s'] == 1 / 4
    assert figures['missed'] == 1 / 4
    assert figures['detected'] == figures['detected_plain'] == 2 / 4
    assert figures['lead_median'] == 4.0
    # Between the lowest, -3, and the next, 4, a fifth of the way up: quantile 0.1 of three.
    assert figures['lead_p10'] == pytest.approx(-3.0 + 0.2 * 7.0)
    assert figures['changes_per_hour'] == 9.0
    assert figures['hours'] == 1.0


def test_an_alarm_is_false_where_no_episode_is_within_a_minute() -> None:
    """60 s before and after an episode belong to it; the rest of an alarm is wrong time."""
    quality = quality_of(
        said(alarmed=[(900, 941), (1100, 1300), (2000, 2010), (3590, HOUR)]),
        truth([(1000, 1050)]),
        plain=False,
    )
    assert quality.false == 2
    # 40 s before 940, all but the 10 s up to 1110, and both others.
    assert quality.wrong == pytest.approx(40.0 + 190.0 + 10.0 + 10.0)
    assert quality.figures()['false_per_100h'] == 200.0
    assert quality.figures()['detected_plain'] is None


def test_far_warnings_and_far_time() -> None:
    """Far for the first 1800 s; a warning that goes on into what is near is none of them."""
    margin = [0.4] * 1800
    quality = quality_of(
        said(warned=[(10, 20), (30, 31), (1790, 1810), (2000, 2010)]), truth([], margin), True
    )
    assert quality.far_warnings == 2
    assert quality.far_seconds == 1800.0
    assert quality.figures()['far_per_1000h'] == 4000.0
    assert quality.figures()['missed'] is None


@pytest.mark.parametrize(
    ('times', 'expected'),
    [([], 0), ([0], 1), ([0, 599, 600, 601, 1300], 3), ([0, 600], 1), ([5] * 12, 12)],
)
def test_largest_burst_in_ten_minutes(times: list[int], expected: int) -> None:
    assert largest_burst([time * 10**9 for time in times]) == expected


@pytest.mark.parametrize(
    ('seconds', 'earliest', 'latest', 'known', 'right', 'covered'),
    [
        # The margin of 0.2 crosses zero at 100.5 s, 90.5 s after the forecast.
        (90.0, 85.0, 95.0, 1, 1, 1),
        (46.0, 30.0, 60.0, 1, 1, 0),
        (45.0, 30.0, 90.0, 1, 0, 1),
        (182.0, 90.0, 200.0, 1, 0, 1),
    ],
)
def test_forecast_of_the_begin(
    seconds: float, earliest: float, latest: float, known: int, right: int, covered: int
) -> None:
    forecast = Forecast(10 * 10**9, seconds, earliest, latest)
    margin = [0.2] * 101 + [-0.2] * 3500
    quality = quality_of(said(), truth([], margin), True, [forecast])
    assert (quality.forecasts, quality.right, quality.covered) == (known, right, covered)


def test_forecast_of_what_never_happens_is_wrong_and_one_beyond_the_end_unknown() -> None:
    never = Forecast(0, 100.0, 50.0, 200.0)
    beyond = Forecast(3000 * 10**9, 400.0, 300.0, 500.0)
    quality = quality_of(said(), truth([]), True, [never, beyond])
    assert (quality.forecasts, quality.right, quality.covered) == (1, 0, 0)


def test_voyages_add_up() -> None:
    one = quality_of(said(warned=[(0, 10)], changes=2), truth([(5, 8)]), True)
    both = pooled([one, one])
    assert (both.seconds, both.episodes, both.changes) == (7200.0, 2, 4)
    assert both.figures()['warned'] == one.figures()['warned'] == 1.0
    assert pooled([]) == Quality()
    assert Quality().figures()['false_per_100h'] is None
