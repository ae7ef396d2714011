# SPDX-License-Identifier: Apache-2.0
"""The judgement of warnings on timelines small enough to be judged by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stickslip_monitor.lab.score import Score, Truth, WarningInterval, in_total, score_bearing
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.verdict import Event

ROOT = Path(__file__).resolve().parents[2]
ALARM = replace(
    load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml').bearings[0].alarm,
    caution_margin=0.1,
    hysteresis=0.02,
    on_delay_ns=2_000_000_000,
)
NORMAL, CAUTION, BISTABLE = Condition.NORMAL, Condition.CAUTION, Condition.BISTABLE
STICK_SLIP, AMPLITUDE, STALE = Condition.STICK_SLIP, Condition.AMPLITUDE, Condition.INPUT_STALE
QUIET = [(0.0, 0.5, 0.5)]


def events(*changes: tuple[float, Condition]) -> list[Event]:
    """Events at some seconds, each with the condition from then on."""
    found, before = [], NORMAL
    for second, after in changes:
        found.append(Event('aft', round(second * 1e9), before, after, None, False, {}, ''))
        before = after
    return found


def truth(
    episodes: Sequence[tuple[float, float]] = (),
    margins: Sequence[tuple[float, float, float]] = QUIET,
    span: tuple[float, float] = (0.0, 100.0),
) -> Truth:
    """Episodes, and steps (from when on, Hopf margin, fold margin) sampled once a second."""
    time = np.arange(round(span[0]), round(span[1]) + 1)
    rows = np.array(margins) if margins else np.empty((0, 3))
    step = np.searchsorted(rows[:, 0], time, 'right') - 1 if margins else np.empty(0, int)
    return Truth(
        start_ns=round(span[0] * 1e9),
        end_ns=round(span[1] * 1e9),
        episodes=tuple((round(a * 1e9), round(b * 1e9)) for a, b in episodes),
        time_ns=(time if margins else time[:0]) * 1_000_000_000,
        hopf_margin=rows[step, 1],
        fold_margin=rows[step, 2],
    )


def judge(said: list[Event], what_was: Truth) -> Score:
    return score_bearing(ALARM, said, (0, 100_000_000_000), what_was)


def test_nothing_said_and_nothing_happened() -> None:
    score = judge([], truth())
    assert score.is_good
    assert (score.seconds, score.wrong, score.false_per_hour) == (100.0, 0.0, 0.0)
    assert (score.episodes, score.warnings, score.alarms) == ((), (), ())


def test_lead_is_from_the_warning_that_stood_at_the_first_stick() -> None:
    said = events(
        (5, CAUTION), (8, NORMAL), (20, CAUTION), (30, BISTABLE), (38, STICK_SLIP), (60, NORMAL)
    )
    score = judge(said, truth([(45, 57)], [(0, 0.5, 0.5), (4, 0.2, 0.05), (8, 0.5, 0.5)]))
    (episode,) = score.episodes
    assert (episode.lead, episode.alarm_lead) == (25.0, 7.0)
    assert score.leads == [25.0]
    assert score.alarm_leads == [7.0]
    assert score.is_good
    # Predicted from 38 to 60 s, true from 45 to 57 s.
    assert (score.overpredicted, score.unpredicted) == pytest.approx((10.0, 0.0))
    assert (score.sticking, score.wrong) == pytest.approx((12.0, 10.0))


def test_a_warning_within_the_episode_is_late() -> None:
    score = judge(events((52, CAUTION), (54, STICK_SLIP), (65, NORMAL)), truth([(50, 60)]))
    (episode,) = score.episodes
    assert (episode.lead, episode.alarm_lead) == (-2.0, -4.0)
    assert episode.late
    assert not episode.missed
    assert (score.late, score.missed) == (1, 0)
    assert not score.is_good
    assert score.unwarned == pytest.approx(2.0)
    assert score.unpredicted == pytest.approx(4.0)
    assert score.overpredicted == pytest.approx(5.0)


@pytest.mark.parametrize('said', [(), ((20, CAUTION), (49, NORMAL)), ((61, STICK_SLIP),)])
def test_an_episode_without_a_warning_is_missed(said: Sequence[tuple[float, Condition]]) -> None:
    score = judge(events(*said), truth([(50, 60)]))
    assert (score.missed, score.late, score.leads) == (1, 0, [])
    assert not score.is_good
    assert score.unwarned == score.unpredicted == score.sticking == pytest.approx(10.0)


def test_a_bistable_warning_is_lead_but_no_prediction() -> None:
    """A knock starts stick-slip where the monitor says that a disturbance could."""
    said = events((30, BISTABLE), (90, NORMAL))
    score = judge(said, truth([(50, 60)], [(0, 0.5, 0.5), (28, 0.2, -0.1), (85, 0.5, 0.5)]))
    (episode,) = score.episodes
    assert (episode.lead, episode.alarm_lead) == (20.0, None)
    assert score.is_good
    assert (score.unpredicted, score.unwarned) == pytest.approx((10.0, 0.0))


# Claim, true Hopf and fold margin while it stands, whether it holds: the table of the module.
CLAIMS = [
    (CAUTION, 0.3, 0.119, True),
    (CAUTION, 0.3, 0.121, False),
    (BISTABLE, 0.3, -0.01, True),
    (BISTABLE, 0.3, 0.01, False),
    (STICK_SLIP, -0.01, -0.3, True),
    (STICK_SLIP, 0.01, -0.3, False),
    (AMPLITUDE, -0.01, -0.3, True),
    (AMPLITUDE, 0.01, -0.3, False),
]


@pytest.mark.parametrize(('condition', 'hopf', 'fold', 'holds'), CLAIMS)
def test_a_claim_without_an_episode_is_judged_by_the_true_margins(
    condition: Condition, hopf: float, fold: float, holds: bool
) -> None:
    """The alarm comes 2 s after its cause and goes 5 s after it."""
    margins = [(0.0, 0.9, 0.9), (40.0, hopf, fold), (44.0, 0.9, 0.9)]
    score = judge(events((42, condition), (49, NORMAL)), truth([], margins))
    claims = score.alarms if condition in (STICK_SLIP, AMPLITUDE) else score.warnings
    assert [(c.start_ns, c.end_ns, c.highest) for c in claims] == [
        (42 * 10**9, 49 * 10**9, condition)
    ]
    assert [claim.holds for claim in claims] == [holds]


def test_a_cause_that_ends_as_the_delay_does_still_counts() -> None:
    """True from 40 s to before 42 s; raised 2 s after it came, and cleared 5 s after it went."""
    margins = [(0.0, 0.9, 0.9), (40.0, -0.1, -0.3), (42.0, 0.9, 0.9)]
    score = judge(events((42, STICK_SLIP), (47, NORMAL)), truth([], margins))
    assert [claim.holds for claim in (*score.warnings, *score.alarms)] == [True, True]


def test_a_false_alarm_is_told_from_the_true_warning_around_it() -> None:
    said = events((20, BISTABLE), (40, STICK_SLIP), (50, BISTABLE), (80, NORMAL))
    score = judge(said, truth([], [(0, 0.5, 0.5), (18, 0.2, -0.1), (75, 0.5, 0.5)]))
    second = 10**9
    assert score.warnings == (WarningInterval(20 * second, 80 * second, BISTABLE, True),)
    assert score.alarms == (WarningInterval(40 * second, 50 * second, STICK_SLIP, False),)
    assert score.false_claims == list(score.alarms)
    assert score.false_per_hour == pytest.approx(36.0)
    assert not score.is_good


def test_two_alarms_are_judged_one_by_one() -> None:
    said = events((20, STICK_SLIP), (30, NORMAL), (60, STICK_SLIP), (70, NORMAL))
    score = judge(said, truth([(62, 66)]))
    assert [alarm.holds for alarm in score.alarms] == [False, True]
    # Each alarm is a warning too, which claims that the bearing is bistable at least.
    assert [warning.holds for warning in score.warnings] == [False, True]


def test_without_true_margins_a_warning_cannot_be_false() -> None:
    said = events((20, BISTABLE), (40, STICK_SLIP), (50, NORMAL))
    score = judge(said, truth([], []))
    assert [warning.holds for warning in score.warnings] == [None]
    assert [alarm.holds for alarm in score.alarms] == [False]


def test_a_lost_input_keeps_the_warning_that_stood() -> None:
    said = events((20, BISTABLE), (40, STALE), (60, BISTABLE), (80, NORMAL))
    score = judge(said, truth([(50, 55)]))
    (episode,) = score.episodes
    assert (episode.lead, episode.blind) == (30.0, True)
    assert score.blind == pytest.approx(20.0)
    assert [(w.start_ns, w.end_ns) for w in score.warnings] == [(20 * 10**9, 80 * 10**9)]


def test_a_lost_input_is_no_warning() -> None:
    score = judge(events((40, STALE), (60, NORMAL)), truth([(50, 55)]))
    assert score.missed == 1
    assert score.episodes[0].blind
    assert score.warnings == score.alarms == ()


def test_only_what_both_have_seen_is_judged() -> None:
    """The truth from 30 to 70 s: no claim and no episode outside counts."""
    said = events((10, STICK_SLIP), (20, NORMAL), (80, CAUTION))
    score = judge(said, truth([(90, 95)], span=(30.0, 70.0)))
    assert score.is_good
    assert (score.seconds, score.warnings, score.episodes) == (40.0, (), ())


def test_what_goes_on_at_the_end_ends_with_it() -> None:
    score = judge(events((90, STICK_SLIP)), truth([(95, 120)]))
    (episode,) = score.episodes
    assert (episode.lead, episode.last_ns) == (5.0, 100 * 10**9)
    assert score.alarms[0].end_ns == 100 * 10**9


def test_events_before_the_truth_set_the_condition_at_its_begin() -> None:
    said = events((10, BISTABLE), (50, NORMAL))
    score = judge(said, truth([], [(30, 0.2, -0.1)], span=(30.0, 70.0)))
    assert [(w.start_ns, w.end_ns) for w in score.warnings] == [(30 * 10**9, 50 * 10**9)]


def test_total_adds_up() -> None:
    first = judge(events((40, CAUTION), (60, STICK_SLIP), (90, NORMAL)), truth([(62, 80)]))
    second = judge(events((20, STICK_SLIP), (30, NORMAL)), truth([(50, 60)]))
    total = in_total([first, second])
    assert (total.seconds, total.missed, total.late) == (200.0, 1, 0)
    assert total.leads == [22.0]
    assert len(total.false_claims) == 2
    assert total.false_per_hour == pytest.approx(36.0)
    assert total.wrong == pytest.approx(first.wrong + second.wrong)
    assert in_total([]).false_per_hour == 0.0
