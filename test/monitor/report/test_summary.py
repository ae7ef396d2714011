# SPDX-License-Identifier: Apache-2.0
"""The verdict in words.

At 1000 N the reference bearing has its Hopf speed at 30.74 rpm and its fold at 40.72 rpm; its
alarm has an on-delay of 2 s, an off-delay of 5 s and a limit of 0.9 mm. The times follow by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timezone
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest
from made_logs import START

from stickslip_monitor import assess
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.extremes import ConditionInterval
from stickslip_monitor.physics.probability import Belief, Tolerance
from stickslip_monitor.report import summary
from stickslip_monitor.report.summary import Course, Finding, facts, judge_all, judge_bearing

Make = Callable[..., Course]


def sentences_of(finding: Finding) -> str:
    return ' '.join(finding.sentences).replace('\N{NO-BREAK SPACE}', ' ')


def test_clear(course: Make) -> None:
    finding = judge_bearing(course([60.0] * 30))
    assert finding.grade == 'clear'
    assert finding.sentences[0] == (
        'aft_stern: no stick-slip was predicted, and the bearing kept clear of it.'
    )
    # 60 / 40.7179 - 1, by the exact fold of PHYSICS.md
    assert 'least fold margin was +47.4 %, at 60.0 rpm and 1 kN' in sentences_of(finding)


def make_intervals(*parts: tuple[int, Condition]) -> list[ConditionInterval]:
    """Conditions that follow each other, each with the second that it lasts to."""
    edges = [START, *(START + end * 10**9 for end, _ in parts)]
    return [
        ConditionInterval(begin, end, condition)
        for (begin, end), (_, condition) in zip(pairwise(edges), parts, strict=True)
    ]


def test_stick_slip_comes_first(course: Make) -> None:
    in_and_out = make_intervals((13, Condition.NORMAL), (28, Condition.STICK_SLIP), (40, Condition.NORMAL))
    three_intervals = course([60.0] * 10 + [20.0] * 10 + [60.0] * 20)
    finding = judge_bearing(replace(three_intervals, intervals=in_and_out))
    assert finding.grade == 'alarm'
    assert finding.sentences[0].replace('\N{NO-BREAK SPACE}', ' ') == (
        'aft_stern: stick-slip was predicted for 15 s, from 06:00:13 to 06:00:28 UTC on 2026-05-04.'
    )
    # At 20 rpm first-order KBM has 0.52688 mm and the exact cycle 0.556755 mm.
    assert 'amplitude was 0.557 mm, at 20.0 rpm and 1 kN, below the limit' in sentences_of(finding)
    twice = [*in_and_out, *make_intervals((50, Condition.NORMAL), (77, Condition.STICK_SLIP))[1:]]
    text = sentences_of(judge_bearing(replace(three_intervals, intervals=twice)))
    assert 'stick-slip was predicted for 42 s in 2 spells, between 06:00:13 and' in text


def test_close(course: Make) -> None:
    calm = course([60.0] * 40)
    near = make_intervals((12, Condition.NORMAL), (25, Condition.CAUTION), (40, Condition.NORMAL))
    finding = judge_bearing(replace(calm, intervals=near))
    assert finding.grade == 'warning'
    assert 'no stick-slip was predicted, but the bearing was within the caution margin' in sentences_of(
        finding
    )
    assert 'a disturbance' not in sentences_of(finding)
    inside = make_intervals((12, Condition.NORMAL), (24, Condition.BISTABLE), (40, Condition.NORMAL))
    text = sentences_of(judge_bearing(replace(calm, intervals=inside)))
    assert 'for 12 s where a disturbance could have started it' in text


def test_a_wrong_source_is_no_clear_verdict(course: Make) -> None:
    calm = course([60.0] * 30)
    doubted = replace(calm, sources=['speed on /a: two'], questions=['load on /b is it?'])
    finding = judge_bearing(doubted)
    assert (finding.grade, finding.word) == ('unknown', 'No verdict')
    assert finding.sentences[-2:] == ('In doubt: speed on /a: two.', 'Load on /b is it?')
    assert judge_bearing(replace(doubted, sources=())).grade == 'clear'
    assert judge_bearing(replace(course([20.0] * 30), sources=['a'])).grade == 'alarm'


def test_lost_time_is_reported_and_is_no_clear_verdict(course: Make) -> None:
    # The last samples at second 29 count for 5 s, so from 34 on an input is lost.
    judged = judge_bearing(course([60.0] * 30, seconds=40))
    assert judged.grade == 'warning'
    assert 'An input was missing for 6.0 s (15 % of the time)' in sentences_of(judged)
    assert judge_bearing(course([60.0] * 30, seconds=300)).grade == 'unknown'


def test_nothing_usable(course: Make) -> None:
    finding = judge_bearing(course([], seconds=60))
    assert (finding.grade, finding.word) == ('unknown', 'No verdict')
    assert 'no verdict' in sentences_of(finding)


@pytest.mark.parametrize(
    ('grades', 'grade', 'text'),
    [
        (['clear', 'clear'], 'clear', 'No stick-slip was predicted in any of 2 recordings.'),
        (['clear', 'alarm'], 'alarm', 'Stick-slip was predicted in 1 of 2 recordings.'),
        (['warning', 'clear'], 'warning', 'No stick-slip was predicted; 1 of 2 recordings gave'),
        (['unknown', 'clear'], 'unknown', 'but 1 of 2 recordings have no sound verdict.'),
    ],
)
def test_the_worst_counts_overall(grades: list[str], grade: str, text: str) -> None:
    parts = [(f'bag{i}', Finding(g, (f'aft: {g}.',))) for i, g in enumerate(grades)]
    finding = judge_all(parts)
    assert finding.grade == grade
    assert text in finding.sentences[0]
    assert len(finding.sentences) == 1 + sum(g != 'clear' for g in grades)


def test_probabilities_are_a_fact_where_there_are_any(course: Callable[..., Course]) -> None:
    name = 'greatest probability of stick-slip'
    quiet = course([60.0, 40.723091, 60.0])
    assert name not in {fact.name for fact in facts(quiet)}
    # With the damping alone unknown, the fold and what is faster have at most 50 %.
    config = quiet.config
    belief = Belief.from_tolerance(config.bearing, Tolerance(damping=0.1))
    point = quiet.scan.assessment
    points = assess(config.bearing, point.speed, point.load, belief)
    outline: Any = SimpleNamespace(assessment=points, time_ns=quiet.scan.time_ns)
    believed = replace(quiet, item=replace(quiet.item, outline=outline))
    (fact,) = (fact for fact in facts(believed) if fact.name == name)
    assert fact.value == '50%'
    assert fact.note == 'that it starts by itself: at most 0%'


# --- times, durations and quantities; expected by the calendar and by hand ----------------------

NS = 10**9


def epoch_ns(text: str) -> int:
    return int(datetime.fromisoformat(text).replace(tzinfo=timezone.utc).timestamp()) * NS


@pytest.mark.parametrize(
    ('quantity', 'text'),
    [
        (summary.format_duration(0.0), '0.0 s'),
        (summary.format_duration(9.96), '10 s'),
        (summary.format_duration(59.6), '1 min'),
        (summary.format_duration(130.0), '2 min 10 s'),
        (summary.format_duration(3900.0), '1 h 5 min'),
        (summary.format_duration(90_000.0), '1 d 1 h'),
        (summary.format_duration(math.inf), 'for ever'),
        (summary.format_share(0.0, 5.0), '0 %'),
        (summary.format_share(1e-9, 5.0), 'below 0.1 %'),
        (summary.format_share(0.05, 1.0), '5.0 %'),
        (summary.format_share(1.0, 1.0), '100 %'),
        (summary.format_share(1.0, 0.0), '0 %'),
        (summary.format_margin(-0.0512), '\N{MINUS SIGN}5.1 %'),
        (summary.format_margin(math.inf), 'no boundary'),
        (summary.format_millimetres(0.00106249), '1.06 mm'),
        (summary.format_load(998.4), '0.9984 kN'),
        (summary.format_load(25_000.0), '25 kN'),
        (summary.format_rpm(-20.04), '\N{MINUS SIGN}20.0 rpm'),
        (summary.format_count(1, 'event'), '1 event'),
        (summary.format_count(1250, 'event'), '1 250 events'),
    ],
)
def test_quantities(quantity: str, text: str) -> None:
    spaces = ('\N{NO-BREAK SPACE}', '\N{NARROW NO-BREAK SPACE}')
    assert quantity.replace(spaces[0], ' ').replace(spaces[1], ' ') == text


@pytest.mark.parametrize(
    ('ends', 'text'),
    [
        (('04T06:00:00', '04T06:00:30'), 'from 06:00:00 to 06:00:30 UTC on 2026-05-04'),
        (('04T23:59:50', '05T00:00:20'), 'between 23:59:50 UTC on 2026-05-04 and 00:00:20 UTC on 2026-05-05'),
        (
            ('04T06:00:00', '04T06:00:30', '04T07:00:00', '04T07:00:10'),
            'between 06:00:00 and 07:00:10 UTC on 2026-05-04',
        ),
    ],
)
def test_times_of_events_have_each_day_once(ends: tuple[str, ...], text: str) -> None:
    times = [epoch_ns(f'2026-05-{end}') for end in ends]
    intervals = [
        ConditionInterval(begin, end, Condition.STICK_SLIP)
        for begin, end in zip(times[::2], times[1::2], strict=True)
    ]
    assert summary._format_times(intervals) == text


def test_times_are_utc_whatever_the_machine_says(monkeypatch: pytest.MonkeyPatch) -> None:
    import time

    monkeypatch.setenv('TZ', 'Asia/Tokyo')
    time.tzset()
    try:
        at = epoch_ns('2026-05-04T06:01:27') + 49 * 10**6
        assert summary.format_date(at) == '2026-05-04'
        assert summary.format_clock(at) == '06:01:27.0'
        assert summary.format_time_of_day(at) == '06:01:27'
        assert summary.format_iso(at) == '2026-05-04T06:01:27.049000Z'
        # Tenths carry over midnight.
        assert summary.format_clock(epoch_ns('2026-05-04T23:59:59') + 960 * 10**6) == '00:00:00.0'
    finally:
        monkeypatch.undo()
        time.tzset()


def test_a_clock_that_counts_from_a_start_has_no_date() -> None:
    assert not summary.is_dated(90 * NS)
    assert summary.format_clock(90 * NS) == '90.0 s'
    assert summary.format_date(90 * NS) == summary.format_iso(90 * NS) == ''
