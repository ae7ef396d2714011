# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of judging warnings, on episodes and alarms made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from sending import SECOND, change, configured, points

from benchmarks.voyages import output_of, sounds_of
from benchmarks.warning_quality import (
    Episode,
    Quality,
    RuleOutput,
    announced_episodes,
    baseless_alarms,
    false_alarms,
    largest_burst,
    pool_qualities,
    quality_of,
)
from stickslip_lab.scenes.truth_topics import TruthNumbers, TruthRecord
from stickslip_monitor import Monitor
from stickslip_monitor.monitor.rule_over_arrays import Scan
from stickslip_monitor.monitor.severity import Condition

Array = NDArray[np.float64]
HOUR = 3600
Spans = Sequence[tuple[float, float]]


def to_nanoseconds(spans: Spans) -> tuple[tuple[int, int], ...]:
    return tuple((round(start * 1e9), round(end * 1e9)) for start, end in spans)


def make_record(span: tuple[int, int], episodes: Spans, margin: Array) -> TruthRecord:
    """Return the truth over some seconds, with a fold margin once a second from their begin."""
    time = (span[0] + np.arange(margin.size)) * 10**9
    none, truth = TruthNumbers(time[:0], margin[:0]), TruthNumbers(time, margin)
    return TruthRecord(span[0] * 10**9, span[1] * 10**9, to_nanoseconds(episodes), none, truth, none)


def make_truth(episodes: Spans, margin: Sequence[float] = ()) -> TruthRecord:
    """Return the truth of an hour, with a margin of 0.2 where none is given."""
    values = np.full(HOUR + 1, 0.2)
    values[: len(margin)] = margin
    return make_record((0, HOUR), episodes, values)


def make_output(
    warned: Spans = (), alarmed: Spans = (), changes: int = 0, raised: Sequence[int] = ()
) -> RuleOutput:
    return RuleOutput(
        to_nanoseconds(warned), to_nanoseconds(alarmed), [(time * 10**9, 1) for time in raised], changes
    )


def test_leads_misses_and_detection() -> None:
    """Warn of four episodes 20 s before, 4 s before, 3 s late and never; two of them are detected."""
    quality = quality_of(
        make_output(
            warned=[(80, 150), (996, 1001), (2003, 2010)], alarmed=[(105, 150), (2003, 2010)], changes=9
        ),
        make_truth([(100, 120), (1000, 1010), (2000, 2020), (3000, 3010)]),
        plain=True,
    )
    assert sorted(quality.leads) == [-3.0, 4.0, 20.0]
    figures = quality.figures()
    assert figures['episodes'] == 4
    assert figures['warned'] == 2 / 4
    assert figures['lead_10s'] == 1 / 4
    assert figures['missed'] == 1 / 4
    assert figures['detected'] == figures['detected_plain'] == 2 / 4
    # 5 s and 3 s late; 15 s of the first episode, 13 s of the third, and the others pass without.
    assert (figures['told'], figures['alarm_least']) == (2 / 4, -5.0)
    assert quality.unalarmed == pytest.approx(5.0 + 10.0 + 3.0 + 10.0 + 10.0)
    assert not quality.is_good
    assert figures['lead_median'] == 4.0
    # Between the lowest, -3, and the next, 4, a fifth of the way up: quantile 0.1 of three.
    assert figures['lead_p10'] == pytest.approx(-3.0 + 0.2 * 7.0)
    assert figures['changes_per_hour'] == 9.0
    assert figures['hours'] == 1.0


def test_an_alarm_is_false_where_no_episode_is_within_a_minute() -> None:
    """60 s before and after an episode belong to it; the rest of an alarm is wrong time."""
    quality = quality_of(
        make_output(alarmed=[(900, 941), (1100, 1300), (2000, 2010), (3590, HOUR)]),
        make_truth([(1000, 1050)]),
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
        make_output(warned=[(10, 20), (30, 31), (1790, 1810), (2000, 2010)]), make_truth([], margin), True
    )
    assert quality.far_warnings == 2
    assert quality.far_seconds == 1800.0
    assert quality.figures()['far_per_1000h'] == 4000.0
    assert quality.figures()['missed'] is None


@pytest.mark.parametrize(
    ('times', 'expected'), [([], 0), ([0], 1), ([0, 599, 600, 601, 1300], 3), ([0, 600], 1), ([5] * 12, 12)]
)
def test_largest_burst_in_ten_minutes(times: list[int], expected: int) -> None:
    assert largest_burst([time * 10**9 for time in times]) == expected


def test_a_warning_is_newly_given_in_time_and_after_the_episode_before() -> None:
    """Warn of three bouts, one of two episodes: 11 s before; only held since then; 9 s before."""
    quality = quality_of(
        make_output(warned=[(50, 2000)], raised=[89, 100, 110, 2991]),
        make_truth([(100, 120), (1000, 1010), (1040, 1050), (3000, 3010)]),
        plain=True,
    )
    assert (quality.episodes, quality.bouts, quality.newly) == (4, 3, 1)
    assert quality.figures()['newly_given'] == 1 / 3


def test_holding_an_alarm_is_time_without_an_episode_and_time_under_a_warning() -> None:
    """Hold an alarm 200 s for an episode of 50 s; of 1000 s far away 150 s are under a warning."""
    quality = quality_of(
        make_output(warned=[(850, 1100)], alarmed=[(1990, 2190)]),
        make_truth([(2000, 2050)], [0.5] * 1000),
        plain=True,
    )
    assert quality.unfounded == 150.0
    assert (quality.far_warned, quality.figures()['far_warned']) == (150.0, 0.15)


def test_sounds_are_those_of_the_alarms() -> None:
    """Two crash stops into stick-slip, and one to rest: the second sounds once it has lasted 15 s."""
    rpm = np.repeat([60.0, 20.0, 60.0, 20.0, 60.0, 0.0], [30, 60, 120, 60, 120, 60])
    config = configured(alarm__startup_inhibit=0.0)
    scan = Monitor(config).scan({'aft': points(rpm, 1000.0)}, 0)['aft']
    onsets = [event.time_ns for event in scan.events if event.onset]
    assert [
        round(onset / SECOND) in range(begin, begin + 8)
        for onset, begin in zip(onsets, (30, 210), strict=True)
    ] == [True, True]
    sounds, unheard = sounds_of(scan, 0, rpm.size * SECOND)
    assert (sounds, unheard) == ([onsets[0], onsets[1] + 15 * SECOND], 0)
    resting = Monitor(config).scan({'aft': points(np.zeros(60), 1000.0)}, 0)['aft']
    assert sounds_of(resting, 0, 60 * SECOND) == ([], 0)


def test_voyages_add_up() -> None:
    quality = quality_of(make_output(warned=[(0, 10)], changes=2), make_truth([(5, 8)]), True)
    pooled_pair = pool_qualities([quality, quality])
    assert (pooled_pair.seconds, pooled_pair.episodes, pooled_pair.changes) == (7200.0, 2, 4)
    assert pooled_pair.figures()['warned'] == quality.figures()['warned'] == 1.0
    assert pool_qualities([]) == Quality()
    assert Quality().figures()['false_per_100h'] is None


NORMAL, CAUTION, BISTABLE = Condition.NORMAL, Condition.CAUTION, Condition.BISTABLE
STICK_SLIP, STALE = Condition.STICK_SLIP, Condition.INPUT_STALE


def by_monitor(*changes: tuple[float, Condition]) -> RuleOutput:
    """Return the output of a monitor whose condition changes at some seconds."""
    monitor_events, condition = [], NORMAL
    for second, new_condition in changes:
        monitor_events.append(change(round(second * 1e9), condition, new_condition))
        condition = new_condition

    class Recorded:
        events = monitor_events

    return output_of(cast(Scan, Recorded()), make_truth([]))


@pytest.mark.parametrize(
    ('changes', 'lead', 'alarm_lead', 'false'),
    [
        # That which stood at the first stick, not one that was cleared before.
        (
            [(5, CAUTION), (8, NORMAL), (20, CAUTION), (30, BISTABLE), (38, STICK_SLIP), (60, NORMAL)],
            30.0,
            12.0,
            0,
        ),
        ([(52, CAUTION), (54, STICK_SLIP), (65, NORMAL)], -2.0, -4.0, 0),
        ([], None, None, 0),
        ([(20, CAUTION), (49, NORMAL)], None, None, 0),
        ([(61, STICK_SLIP), (80, NORMAL)], None, None, 0),
        ([(121, STICK_SLIP), (130, NORMAL)], None, None, 1),
        # It goes on while an input is lost, and a lost input alone is none.
        ([(20, BISTABLE), (40, STALE), (60, BISTABLE), (80, NORMAL)], 30.0, None, 0),
        ([(40, STALE), (60, NORMAL)], None, None, 0),
    ],
)
def test_an_episode_from_50_to_60_s(
    changes: list[tuple[float, Condition]], lead: float | None, alarm_lead: float | None, false: int
) -> None:
    output = by_monitor(*changes)
    what_was = make_truth([(50, 60)])
    assert announced_episodes(output, what_was) == [Episode(50 * 10**9, 60 * 10**9, lead, alarm_lead)]
    assert len(false_alarms(output, what_was)) == false
    good = lead is not None and lead >= 0.0 and not false
    assert quality_of(output, what_was, True).is_good == good


def test_a_false_alarm_is_baseless_where_sliding_was_stable_while_it_stood() -> None:
    """Sliding is unstable from 200 to 202 s; the alarm of 300 s belongs to an episode."""
    what_was = make_truth([(290, 310)])
    margin = np.where((what_was.fold_margin.time_ns // 10**9 - 200) // 2 == 0, -0.01, 0.2)
    what_was = replace(what_was, hopf_margin=replace(what_was.fold_margin, value=margin))
    alarmed = [(100, 120), (190, 200), (201, 215), (300, 310), (500, 510)]
    assert false_alarms(make_output(alarmed=alarmed), what_was) == list(
        to_nanoseconds([*alarmed[:3], alarmed[4]])
    )
    assert baseless_alarms(make_output(alarmed=alarmed), what_was) == list(
        to_nanoseconds([*alarmed[:2], alarmed[4]])
    )
    figures = quality_of(make_output(alarmed=alarmed), what_was, True).figures()
    assert (figures['false_per_100h'], figures['baseless_per_100h']) == (400.0, 300.0)


def test_only_the_time_of_the_truth_is_judged() -> None:
    """Judge from 30 to 70 s: an episode that goes on ends there; what stood before counts from 30."""
    output = RuleOutput(to_nanoseconds([(10, 90)]), to_nanoseconds([(10, 20), (80, 90)]), [], 0)
    voyage = make_record((30, 70), [(5, 8), (60, 99)], np.full(2, 0.2))
    assert announced_episodes(output, voyage) == [Episode(60 * 10**9, 70 * 10**9, 30.0, None)]
    quality = quality_of(output, voyage, True)
    assert (quality.seconds, quality.false, quality.unalarmed) == (40.0, 0, 10.0)
