# SPDX-License-Identifier: Apache-2.0
"""Branch memory and deadbands, at speeds placed by the closed forms of the reference bearing."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_monitor import MonitorConfig, assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.ladder import LADDER, Condition, ConditionClassifier, latched

Configure = Callable[..., MonitorConfig]
LOAD = 1000.0
# kappa = c / (N Delta beta) = 0.2 and beta = 10 s/m; the fold is PHYSICS.md's, to its digits.
HOPF = -math.log(0.2) / 10.0
FOLD = 0.2132256
QUIET, INSIDE, UNSTABLE = 1.5 * FOLD, 0.5 * (HOPF + FOLD), 0.5 * HOPF


def _course(
    config: BearingConfig, speeds: list[float], load: float = LOAD
) -> tuple[list[Condition], list[bool]]:
    """The same course in one piece and point by point, which must agree."""
    whole = ConditionClassifier(config.alarm)
    rungs, sticking = whole.rungs(assess(config.bearing, np.array(speeds), load))
    single = ConditionClassifier(config.alarm)
    for k, speed in enumerate(speeds):
        rung, stick = single.rungs(assess(config.bearing, np.array([speed]), load))
        assert (rung[0], stick[0]) == (rungs[k], sticking[k])
    return [LADDER[rung] for rung in rungs], sticking.tolist()


def test_coming_down_it_stays_quiet_until_the_hopf_speed(configure: Configure) -> None:
    speeds = [QUIET, FOLD * (1 - 1e-6), INSIDE, HOPF * (1 + 1e-9), HOPF * (1 - 1e-9)]
    conditions, sticking = _course(configure().bearing('aft'), speeds)
    assert sticking == [False, False, False, False, True]
    assert conditions[1:] == [Condition.BISTABLE] * 3 + [Condition.STICK_SLIP]


def test_coming_up_it_sticks_until_the_fold(configure: Configure) -> None:
    speeds = [UNSTABLE, HOPF * (1 + 1e-9), INSIDE, FOLD * (1 - 1e-6), FOLD * (1 + 1e-6), INSIDE]
    conditions, sticking = _course(configure().bearing('aft'), speeds)
    assert sticking == [True, True, True, True, False, False]
    assert conditions == [Condition.STICK_SLIP] * 4 + [Condition.CAUTION, Condition.BISTABLE]


def test_starting_inside_it_is_taken_for_quiet(configure: Configure) -> None:
    conditions, sticking = _course(configure().bearing('aft'), [INSIDE])
    assert (conditions, sticking) == ([Condition.BISTABLE], [False])


def test_astern_is_the_same_picture(configure: Configure) -> None:
    speeds = [QUIET, INSIDE, UNSTABLE, INSIDE, FOLD * 1.05, QUIET]
    config = configure().bearing('aft')
    assert _course(config, speeds) == _course(config, [-v for v in speeds])


@pytest.mark.parametrize('pause', [(0.0, LOAD), (UNSTABLE, 0.0), (UNSTABLE, -5.0)])
def test_at_rest_or_unloaded_it_has_stopped(
    configure: Configure, pause: tuple[float, float]
) -> None:
    config = configure().bearing('aft')
    speeds = np.array([UNSTABLE, pause[0], INSIDE])
    loads = np.array([LOAD, pause[1], LOAD])
    rungs, sticking = ConditionClassifier(config.alarm).rungs(
        assess(config.bearing, speeds, loads)
    )
    assert sticking.tolist() == [True, False, False]
    assert [LADDER[r] for r in rungs] == [
        Condition.STICK_SLIP,
        Condition.NORMAL,
        Condition.BISTABLE,
    ]


def test_at_rest_there_is_no_caution(configure: Configure) -> None:
    # At rest the margin is -1, but nothing slides.
    conditions, _ = _course(configure().bearing('aft'), [FOLD * 1.05, 0.0, FOLD * 1.11])
    assert conditions == [Condition.CAUTION, Condition.NORMAL, Condition.NORMAL]


def test_deadband_of_the_caution(configure: Configure) -> None:
    config = configure(alarm__caution_margin=0.1, alarm__hysteresis=0.02).bearing('aft')
    margins = [0.13, 0.11, 0.101, 0.099, 0.101, 0.119, 0.121, 0.11, 0.099]
    conditions, _ = _course(config, [FOLD * (1.0 + m) for m in margins])
    normal, caution = Condition.NORMAL, Condition.CAUTION
    assert conditions == [normal] * 3 + [caution] * 3 + [normal] * 2 + [caution]


def test_deadband_of_the_amplitude(configure: Configure) -> None:
    # PHYSICS.md: 0.26352 / 0.52688 / 0.78708 mm at 10 / 20 / 30 rpm; limit and clear in between.
    config = configure(alarm__amplitude_limit=0.6e-3, alarm__hysteresis=0.5).bearing('aft')
    rpm = [20.0, 30.0, 20.0, 10.0, 20.0]
    conditions, sticking = _course(config, [math.pi * 0.1 * n / 60.0 for n in rpm])
    stick, over = Condition.STICK_SLIP, Condition.AMPLITUDE
    assert conditions == [stick, over, over, stick, stick]
    assert all(sticking)


def test_amplitude_counts_only_while_sticking(configure: Configure) -> None:
    config = configure(alarm__amplitude_limit=0.6e-3).bearing('aft')
    conditions, _ = _course(config, [INSIDE, UNSTABLE * 1.9, INSIDE, QUIET, INSIDE])
    assert conditions == [
        Condition.BISTABLE,
        Condition.AMPLITUDE,
        Condition.AMPLITUDE,
        Condition.NORMAL,
        Condition.BISTABLE,
    ]


@pytest.mark.parametrize('quiet', [[35.0], [30.0, 60.0]])
def test_deadband_of_the_amplitude_starts_anew_with_the_sticking(
    configure: Configure, quiet: list[float]
) -> None:
    # 20 rpm lies between clearing and limit: what an earlier or unreached cycle had is no matter.
    config = configure(alarm__amplitude_limit=0.6e-3, alarm__hysteresis=0.5).bearing('aft')
    conditions, _ = _course(config, [math.pi * 0.1 * n / 60.0 for n in [*quiet, 20.0]])
    assert conditions[-1] is Condition.STICK_SLIP


def test_a_new_limit_applies_to_the_next_point(configure: Configure) -> None:
    config = configure().bearing('aft')
    point = assess(config.bearing, np.array([UNSTABLE]), LOAD)
    bands = ConditionClassifier(config.alarm)
    assert LADDER[bands.rungs(point)[0][0]] is Condition.STICK_SLIP
    bands.config = configure(alarm__amplitude_limit=1e-6).bearing('aft').alarm
    assert LADDER[bands.rungs(point)[0][0]] is Condition.AMPLITUDE


@given(
    steps=st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30),
    before=st.booleans(),
)
def test_latch(steps: list[tuple[bool, bool]], before: bool) -> None:
    state, expected = before, []
    for on, off in steps:
        if on:
            state = True
        elif off:
            state = False
        expected.append(state)
    columns = np.array(steps, dtype=bool)
    assert latched(columns[:, 0], columns[:, 1], before).tolist() == expected
