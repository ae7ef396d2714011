# SPDX-License-Identifier: Apache-2.0
"""What the monitor says in words; the numbers come from the closed forms of PHYSICS.md."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from scipy.optimize import brentq
from scipy.special import i1e

from stickslip_monitor import MonitorConfig, assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.decision import QUIET, Standing
from stickslip_monitor.monitor.ladder import LADDER, Condition, ConditionChange
from stickslip_monitor.monitor.trend import Trend
from stickslip_monitor.monitor.verdict import describe, event_of

Configure = Callable[..., MonitorConfig]
# Fold: 2 I1e(v)/v = kappa with kappa = 0.2 at 1000 N, v = beta V, beta = 10 s/m, D = 0.1 m.
FOLD = brentq(lambda v: 2.0 * i1e(v) / v - 0.2, 0.1, 10.0, xtol=1e-14) / 10.0
PER_RPM = math.pi * 0.1 / 60.0


@pytest.fixture
def aft(configure: Configure) -> BearingConfig:
    return configure().bearing('aft')


def _text(
    config: BearingConfig, condition: Condition, rpm: float, load: float, sticking: bool = False
) -> str:
    point = assess(config.bearing, rpm * PER_RPM, load)
    return describe(config, condition, point, _standing(condition, sticking), {})


def _standing(condition: Condition, sticking: bool = False) -> Standing:
    """A rung that the point asks for."""
    rung = LADDER.index(condition)
    return Standing(rung, sticking, asked=rung)


def _fold_kilonewton(rpm: float) -> float:
    v = 10.0 * rpm * PER_RPM
    return 400.0 / (0.2 * 10.0 * 2.0 * i1e(v) / v) / 1e3


def test_stick_slip(aft: BearingConfig) -> None:
    assert _text(aft, Condition.STICK_SLIP, 20.0, 1000.0, sticking=True) == (
        'aft: Stick-slip predicted. At 20 rpm and 1 kN, predicted amplitude 0.527 mm, fold margin'
        f' {20.0 * PER_RPM / FOLD - 1.0:+.1%}. Ends above {FOLD / PER_RPM:.4g} rpm or below'
        f' {_fold_kilonewton(20.0):.4g} kN.'
    )
    # The two numbers PHYSICS.md prints.
    assert f'{FOLD / PER_RPM:.4f}' == '40.7231'
    assert f'{_fold_kilonewton(20.0) * 1e3:.0f}' == '498'


def test_bistable_and_quiet(aft: BearingConfig) -> None:
    assert _text(aft, Condition.BISTABLE, 35.0, 1000.0) == (
        'aft: Inside the bistable range: quiet now, but a disturbance can start stick-slip.'
        f' At 35 rpm and 1 kN, fold margin {35.0 * PER_RPM / FOLD - 1.0:+.1%}.'
        f' Ends above 40.72 rpm or below {_fold_kilonewton(35.0):.4g} kN.'
    )


def test_caution_ends_beyond_its_deadband(configure: Configure) -> None:
    aft = configure(alarm__caution_margin=0.1, alarm__hysteresis=0.05).bearing('aft')
    assert _text(aft, Condition.CAUTION, 42.0, 1000.0) == (
        'aft: Close to the stick-slip region. At 42 rpm and 1 kN, fold margin'
        f' {42.0 * PER_RPM / FOLD - 1.0:+.1%}. Ends above {1.15 * FOLD / PER_RPM:.4g} rpm.'
    )


def test_caution_names_the_speed_only(aft: BearingConfig) -> None:
    # A lower load ends the bistable range, but at which one the caution ends is not known.
    text = _text(aft, Condition.CAUTION, 35.0, 1000.0)
    assert f'Ends above {1.22 * FOLD / PER_RPM:.4g} rpm.' in text
    assert 'below' not in text


def test_normal_has_no_way_out(aft: BearingConfig) -> None:
    assert _text(aft, Condition.NORMAL, 60.0, 1000.0) == (
        'aft: No stick-slip predicted. At 60 rpm and 1 kN, fold margin'
        f' {60.0 * PER_RPM / FOLD - 1.0:+.1%}.'
    )


def test_a_condition_that_is_only_held_by_its_delay_names_no_way_out(aft: BearingConfig) -> None:
    point = assess(aft.bearing, 60.0 * PER_RPM, 1000.0)
    assert 'Ends' not in describe(aft, Condition.STICK_SLIP, point, Standing(4, clears=5.0), {})


@pytest.mark.parametrize(
    ('rpm', 'load', 'sentence'),
    [
        (0.0, 1000.0, 'The shaft is at rest: nothing slides.'),
        (20.0, 0.0, 'The bearing carries no load: there is no friction.'),
        (20.0, 100.0, 'Friction does not fall fast enough'),  # below c / (Delta beta) = 200 N
    ],
)
def test_points_without_a_boundary(
    aft: BearingConfig, rpm: float, load: float, sentence: str
) -> None:
    text = _text(aft, Condition.NORMAL, rpm, load)
    start = f'aft: No stick-slip predicted. At {rpm:.4g} rpm and {load / 1e3:.4g} kN. {sentence}'
    assert text.startswith(start)
    assert 'nan' not in text
    assert 'inf' not in text


def test_a_law_that_always_sticks_names_no_endless_speed(configure: Configure) -> None:
    aft = configure(friction__law='coulomb').bearing('aft')
    text = _text(aft, Condition.NORMAL, 300.0, 1000.0)
    assert 'inf' not in text
    assert 'nan' not in text


def test_lost_inputs_name_their_topics_and_ages(aft: BearingConfig) -> None:
    lost = {'speed': 5.0, 'load': math.inf}
    point = assess(aft.bearing, 0.1, 1000.0)
    assert describe(aft, Condition.INPUT_STALE, point, QUIET, lost) == (
        'aft: Input speed lost: nothing believable on /shaft/speed for 5 s.'
        ' Input load lost: nothing believable on /bearing/aft/load so far.'
    )


def test_lost_without_an_age_does_not_speak_of_an_old_point(aft: BearingConfig) -> None:
    point = assess(aft.bearing, 0.1, 1000.0)
    assert describe(aft, Condition.INPUT_STALE, point, QUIET, {}) == (
        'aft: An input is lost: nothing can be predicted.'
    )


def test_before_any_point(aft: BearingConfig) -> None:
    assert describe(aft, Condition.NORMAL, None, QUIET, {}) == 'aft: No stick-slip predicted.'


def test_event_carries_the_change_and_the_assessment(aft: BearingConfig) -> None:
    point = assess(aft.bearing, 20.0 * PER_RPM, 1000.0)
    change = ConditionChange(7, Condition.NORMAL, Condition.STICK_SLIP)
    event = event_of(aft, change, point, _standing(Condition.STICK_SLIP, sticking=True))
    assert (event.bearing, event.time_ns, event.before, event.after) == (
        'aft',
        7,
        Condition.NORMAL,
        Condition.STICK_SLIP,
    )
    assert event.assessment is point
    assert (event.sticking, event.lost) == (True, {})
    assert event.text == _text(aft, Condition.STICK_SLIP, 20.0, 1000.0, sticking=True)


TREND = Trend(seconds=41.3, earliest=33.4, latest=52.6, span=29.2)


@pytest.mark.parametrize(
    ('trend', 'words'),
    [
        (TREND, 'in about 40 s at this rate (35 s to 55 s at 90%, judged by the last 29 s).'),
        (
            Trend(150.0, 149.0, 151.0, 60.0),
            'in about 2.5 min at this rate (judged by the last 60 s).',
        ),
        (Trend(7.2, 6.0, 9.0, 30.0), 'in about 7 s at this rate (6 s to 9 s at 90%, judged by'),
    ],
)
def test_when_it_begins(aft: BearingConfig, trend: Trend, words: str) -> None:
    point = assess(aft.bearing, 42.0 * PER_RPM, 1000.0)
    quiet = describe(aft, Condition.CAUTION, point, QUIET, {}, trend=trend)
    assert f'. Steady sliding turns unstable {words}' in quiet


# 20 rpm: the growth rate is 3.0184 per second, so 6 - 1.5 e-folds take 1.49 s.
@pytest.mark.parametrize(
    ('rpm', 'standing', 'what'),
    [
        (
            60.0,
            Standing(2, clears=4.2),
            'No longer close to the stick-slip region: caution clears in 4 s. At',
        ),
        (
            60.0,
            Standing(4, clears=4.2),
            'Stick-slip no longer predicted: stick_slip clears in 4 s. At',
        ),
        (
            20.0,
            Standing(3, asked=3, growth=1.5),
            'Steady sliding is unstable: stick-slip is starting, in about 1 s. At',
        ),
        (
            30.73,
            Standing(3, asked=3),
            'Steady sliding is unstable: stick-slip is starting slowly. At',
        ),
        (20.0, Standing(0, True, asked=4), 'Stick-slip predicted, but not yet for 2 s. At'),
        (43.0, Standing(0, asked=2), 'Close to the stick-slip region, but not yet for 2 s. At'),
        (39.0, Standing(2, asked=3), 'can start stick-slip, but not yet for 2 s. At'),
        (60.0, Standing(2, asked=2), 'The speed is falling towards the stick-slip region. At'),
        (
            35.0,
            Standing(3, asked=3, raised=3),
            'can start stick-slip. Fluctuating across the boundary: raised 3 times lately. At',
        ),
    ],
)
def test_the_text_says_what_is_about_to_change(
    aft: BearingConfig, rpm: float, standing: Standing, what: str
) -> None:
    point = assess(aft.bearing, rpm * PER_RPM, 1000.0)
    text = describe(aft, standing.condition, point, standing, {})
    assert what in text
    # Where the condition that stands ends is no end of the one that is coming.
    assert not ('not yet for' in text and 'Ends' in text)
    assert 'No stick-slip predicted' not in text


def test_an_eased_condition_says_so_and_an_alarm_does_not(aft: BearingConfig) -> None:
    point = assess(aft.bearing, 43.0 * PER_RPM, 1000.0)
    change = ConditionChange(7, Condition.STICK_SLIP, Condition.CAUTION)
    event = event_of(aft, change, point, Standing(2, asked=2))
    assert event.text.startswith('aft: Eased from stick_slip. Close to the stick-slip region. At')
    assert event.says == _text(aft, Condition.CAUTION, 43.0, 1000.0)


def test_astern(aft: BearingConfig) -> None:
    assert _text(aft, Condition.STICK_SLIP, -20.0, 1000.0, sticking=True) == _text(
        aft, Condition.STICK_SLIP, 20.0, 1000.0, sticking=True
    ).replace(' rpm', ' rpm astern')


def test_inputs_that_are_back(aft: BearingConfig) -> None:
    point = assess(aft.bearing, 60.0 * PER_RPM, 1000.0)
    text = describe(aft, Condition.NORMAL, point, QUIET, {}, Condition.INPUT_STALE)
    assert text.startswith('aft: Speed and load are back. No stick-slip predicted. At 60 rpm')
