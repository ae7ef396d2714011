# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from sending import SECOND, brief, configured, feed
from shared import REFERENCE

from stickslip_monitor import Monitor, MonitorConfig, Sample, Stream, build_config
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.bearing_monitor import BearingMonitor
from stickslip_monitor.monitor.rule_settings import settings_of
from stickslip_monitor.monitor.rule_state import DOUBT, State
from stickslip_monitor.monitor.sample_types import NO_VALUES, Input, Status
from stickslip_monitor.monitor.severity import LADDER, Condition
from stickslip_monitor.monitor.statements import OrderKind, SpeedOrder, speed_order
from stickslip_monitor.monitor.vibration_rule import (
    BEGUN,
    LASTING,
    SHORT,
    UNKNOWN,
    VIBRATING,
    doubt_foreign,
    has_begun,
    take_level,
    usable_state,
)

# The first point below the Hopf speed decides, and no delay waits for a second one.
AT_ONCE = {'alarm__onset_growth': 0.0, 'alarm__on_delay': 0.0}
# Reference bearing at 1000 N (PHYSICS.md): Hopf 30.738 rpm, fold 40.723 rpm.
UNSTABLE, INSIDE, CAUTION, QUIET = 20.0, 35.0, 43.0, 60.0


def update_point(monitor: Monitor, time: float, rpm: float, bearing: str = 'aft') -> list[Any]:
    """Send both inputs at one instant; return the events as (seconds, before, after)."""
    inputs = (('speed', rpm), ('load', 1000.0))
    updates = [feed(monitor, time, quantity, value, bearing) for quantity, value in inputs]
    return [brief(event) for update in updates for event in update.events]


def two_bearings(**changes: Any) -> MonitorConfig:
    values: dict[str, Any] = {'bearings': ['aft', 'forward']}
    for name in values['bearings']:
        values |= {f'{name}.{k}': v for k, v in REFERENCE.items()}
    return build_config(values | changes)


def test_a_point_needs_both_inputs() -> None:
    monitor = Monitor(configured())
    assert feed(monitor, 0.0, 'speed', UNSTABLE).verdict is None
    assert monitor.bearings['aft'].asked_rung == 0
    update = feed(monitor, 1.0, 'load', 1000.0)
    assert update.status is Status.ACCEPTED
    assert update.verdict is not None
    assert update.verdict.bearing == 'aft'
    assert update.verdict.time_ns == SECOND
    assert monitor.bearings['aft'].asked_rung == LADDER.index(Condition.BISTABLE)
    assert update.verdict.assessment.speed == pytest.approx(20.0 * math.pi * 0.1 / 60.0)
    assert update.verdict.assessment.load == 1000.0
    assert update.verdict.assessment.amplitude == pytest.approx(0.52688e-3, rel=1e-4)


def test_a_rejected_sample_changes_nothing() -> None:
    monitor = Monitor(configured())
    update_point(monitor, 0.0, QUIET)
    for time, value, status in (
        (1.0, math.nan, Status.NOT_FINITE),
        (1.0, -999.25, Status.NO_VALUE),
        (1.0, 1e9, Status.IMPLAUSIBLE),
        (0.0, QUIET, Status.REPEATED),
        (-1.0, UNSTABLE, Status.OUT_OF_ORDER),
    ):
        update = monitor.update(Sample('aft', 'speed', round(time * SECOND), value, round(0.5 * SECOND)))
        assert (update.status, update.verdict, update.events) == (status, None, [])
    assert monitor.bearings['aft'].now_ns == 0
    assert not monitor.bearings['aft'].sticking


def test_coast_down_and_recovery() -> None:
    """Ten points a second; each change of speed counts a point later, by the median of three."""
    monitor = Monitor(configured(alarm__on_delay=2.0, alarm__off_delay=3.0))
    speeds = [QUIET, CAUTION, INSIDE, UNSTABLE, INSIDE, CAUTION, QUIET]
    events = [e for k in range(350) for e in update_point(monitor, k / 10, speeds[k // 50])]
    assert events == [
        (7.1, 'normal', 'caution'),
        (12.1, 'caution', 'bistable'),
        # Growth is (20 exp(-10 V) - 4) = 3.0186 per second: 3 e-folds from 15.1 s on.
        (16.1, 'bistable', 'stick_slip'),
        # Coming up it sticks until the fold, passed at 25.1 s, and dies out in 4.8 * 2 m/c.
        (pytest.approx(25.1 + 1.2 + 3.0), 'stick_slip', 'caution'),
        (33.1, 'caution', 'normal'),
    ]


def test_a_condition_that_returns_within_a_minute_is_held_for_a_minute() -> None:
    # A change of speed counts a point later, by the median of three; both conditions clear in 10 s.
    monitor, speeds = Monitor(configured()), [INSIDE, QUIET, INSIDE, QUIET, QUIET, QUIET, QUIET]
    events = [e for k in range(700) for e in update_point(monitor, k / 5, speeds[k // 100])]
    cleared = [time for time, _, after in events if after == 'normal']
    assert cleared == [pytest.approx(20.2 + 10.0), pytest.approx(60.2 + 60.0)]


def test_lost_and_returned() -> None:
    monitor = Monitor(configured(speed__timeout=3.0, load__timeout=4.0))
    monitor.advance(0)
    update_point(monitor, 1.0, QUIET)
    assert monitor.advance(4 * SECOND) == []
    (lost,) = monitor.advance(10 * SECOND)
    assert brief(lost) == (4.0, 'normal', 'input_stale')
    assert lost.lost == {'speed': 3.0}  # as it was then
    assert lost.text == 'aft: Input speed lost: no valid value on /shaft/speed for 3 s.'
    assert monitor.condition('aft') is Condition.INPUT_STALE
    assert monitor.bearings['aft'].lost_ages() == {'speed': 9.0, 'load': 9.0}
    assert monitor.bearings['aft'].text() == (
        'aft: Input speed lost: no valid value on /shaft/speed for 9 s.'
        ' Input load lost: no valid value on /bearing/aft/load for 9 s.'
    )
    assert feed(monitor, 11.0, 'speed', QUIET).events == []
    (back,) = feed(monitor, 12.0, 'load', 1000.0).events
    assert brief(back) == (12.0, 'input_stale', 'normal')
    assert monitor.bearings['aft'].lost_ages() == {}


def test_rejected_samples_do_not_keep_an_input_alive() -> None:
    monitor = Monitor(configured(speed__timeout=3.0))
    update_point(monitor, 0.0, QUIET)
    events = []
    for time in range(1, 8):
        assert feed(monitor, time, 'speed', math.nan).status is Status.NOT_FINITE
        events += [brief(e) for e in feed(monitor, time, 'load', 1000.0).events]
    assert events == [(3.0, 'normal', 'input_stale')]


def test_bearings_are_independent() -> None:
    changes = {f'{name}.alarm.{k}': 0.0 for name in ('aft', 'forward') for k in ('on_delay', 'onset_growth')}
    monitor = Monitor(two_bearings(**changes))
    assert update_point(monitor, 100.0, QUIET, 'aft') == []
    # The other bearing's clock runs by its own samples.
    assert update_point(monitor, 0.0, UNSTABLE, 'forward') == [(0.0, 'normal', 'stick_slip')]
    assert monitor.condition('aft') is Condition.NORMAL
    assert monitor.condition('forward') is Condition.STICK_SLIP
    events = monitor.bearings['aft'].advance(200 * SECOND)
    assert [brief(e) for e in events] == [(105.0, 'normal', 'input_stale')]
    assert monitor.condition('forward') is Condition.STICK_SLIP


def test_a_first_sample_before_the_start_moves_the_start() -> None:
    # A recording is played whose stamps are long past.
    monitor = Monitor(configured(alarm__on_delay=0.0, load__timeout=4.0))
    monitor.advance(1000 * SECOND)
    assert feed(monitor, 10.0, 'speed', UNSTABLE).events == []
    assert monitor.bearings['aft'].now_ns == 10 * SECOND
    assert [brief(e) for e in monitor.advance(15 * SECOND)] == [(14.0, 'normal', 'input_stale')]


def test_the_clock_jumps_back() -> None:
    # The memory of the lining and the delays go on, from the first message after the jump.
    monitor = Monitor(configured(alarm__on_delay=0.0, alarm__off_delay=2.0))
    for time in (97.0, 98.0, 99.0, 100.0, 101.0, 102.0):
        update_point(monitor, time, UNSTABLE)
    assert monitor.condition('aft') is Condition.STICK_SLIP
    update_point(monitor, 103.0, QUIET)
    update = feed(monitor, 0.0, 'speed', QUIET)
    assert (update.status, update.events) == (Status.ACCEPTED, [])
    assert update.verdict is not None
    assert update.verdict.time_ns == monitor.bearings['aft'].now_ns == 0
    assert monitor.condition('aft') is Condition.STICK_SLIP
    # It dies out in 1.2 s, and clears after the off-delay.
    events = [event for k in range(1, 60) for event in update_point(monitor, k / 10, QUIET)]
    assert events == [(pytest.approx(1.2 + 2.0, abs=0.11), 'stick_slip', 'normal')]


def test_after_a_jump_the_other_input_stands_for_its_timeout() -> None:
    monitor = Monitor(configured(load__timeout=4.0))
    update_point(monitor, 100.0, QUIET)
    for time in (0.0, 1.0, 2.0):
        assert feed(monitor, time, 'speed', QUIET).verdict is not None
    events = monitor.advance(6 * SECOND + 1)
    assert [(brief(e), e.lost) for e in events] == [((4.0, 'normal', 'input_stale'), {'load': 4.0})]


@pytest.mark.parametrize('offset', [-2.9, 2.9])
def test_sensors_whose_clocks_differ_by_less_than_the_timeout_less_a_period_are_paired(offset: float) -> None:
    monitor = Monitor(configured(speed__timeout=4.0, load__timeout=4.0))
    events, verdicts = [], []
    for time in range(20):
        for quantity, shift, value in (('speed', 0.0, UNSTABLE), ('load', offset, 1000.0)):
            update = feed(monitor, time + shift, quantity, value)
            events += [brief(e) for e in update.events]
            verdicts.append(update.verdict)
    assert [after for _, _, after in events if after != 'bistable'] == ['stick_slip']
    assert all(verdict is not None for verdict in verdicts[1:])
    times = [v.time_ns for v in verdicts if v is not None]
    assert times == sorted(times)
    # The monitor's time is that of the clock that is ahead.
    assert times[-1] == round((19 + max(offset, 0.0)) * SECOND)


def test_event_text_names_speed_load_amplitude_and_way_out() -> None:
    monitor = Monitor(configured(**AT_ONCE))
    feed(monitor, 0.0, 'speed', UNSTABLE)
    (event,) = feed(monitor, 0.0, 'load', 1000.0).events
    # 1.22 times the fold of docs/physics.md, 40.723 rpm, is 49.7 rpm; the amplitude of the exact
    # cycle is 0.55676 mm by scipy's integrator (scripts/expected_events.py).
    assert event.text == (
        'aft: Stick-slip predicted. Raise speed above 50 rpm, or stop the shaft.'
        ' Now 20 rpm, 1 kN, amplitude 0.557 mm, 51 % below the fold.'
    )
    assert event.standing.assessment is not None
    assert event.standing.assessment.amplitude == pytest.approx(0.52688e-3, rel=1e-4)


def test_no_text_asks_to_stop_a_shaft_that_stands() -> None:
    monitor = Monitor(configured())
    for k in range(40):
        update_point(monitor, k / 2, UNSTABLE if k < 30 else 0.0)
    assert monitor.condition('aft') is Condition.STICK_SLIP
    text = 'aft: Stick-slip predicted. Now 0 rpm, 1 kN. The shaft is at rest: nothing slides.'
    assert monitor.bearings['aft'].text() == text


def test_texts_of_milder_conditions_say_what_to_do() -> None:
    """At 1 kN the fold is at 40.723 rpm, and caution clears above 1.22 times it, 49.7 rpm."""
    monitor, texts = Monitor(configured(load__timeout=600.0)), []
    for time in range(80):  # from 80 rpm down by 1 rpm/s, past the fold, and on there
        update_point(monitor, time, max(80.0 - time, 36.0))
        texts.append(monitor.bearings['aft'].text())
    text = ' '.join(texts)
    assert 'Slowing towards stick-slip: stay above 50 rpm. Now 5' in text
    assert 'Near the stick-slip boundary. Clears above 50 rpm.' in text
    assert 'In the bistable range for less than 2 s: no alarm yet.' in text
    last = 'Bistable: quiet so far, but a shock can start stick-slip. Raise speed above 50 rpm,'
    assert texts[-1].startswith(f'aft: {last} or stop the shaft. Now 36 rpm, 1 kN, 12 % below')


def test_a_mild_condition_gives_the_order_of_the_worse_that_is_starting() -> None:
    """Go from near the boundary straight into the unstable range, whose delay is still running."""
    monitor = Monitor(configured(alarm__on_delay=4.0))
    for time in range(12):
        update_point(monitor, time, 45.0)  # 1.1 times the fold: margin low
    update_point(monitor, 12.5, UNSTABLE)
    bearing = monitor.bearings['aft']
    assert bearing.condition is Condition.CAUTION
    begin = 'aft: Steady sliding is unstable: stick-slip is starting.'
    assert bearing.text().startswith(f'{begin} Raise speed above 50 rpm, or stop the shaft.')
    assert speed_order(bearing) == SpeedOrder(OrderKind.RAISE_SPEED, 50.0)


@pytest.mark.parametrize(('sign', 'astern'), [(1.0, ''), (-1.0, ' astern')])
def test_the_order_is_that_of_the_text(sign: float, astern: str) -> None:
    """Caution clears above 1.22 times the fold of 40.723 rpm: 49.7, and so 50 rpm."""
    monitor, kinds = Monitor(configured(load__timeout=600.0)), set()
    phrases = {'raise_speed': 'Raise speed above', 'stay_above': 'stay above', 'clears_above': 'Clears above'}
    for time in range(80):
        update_point(monitor, time, sign * max(80.0 - time, 36.0))
        text, given = monitor.bearings['aft'].text(), speed_order(monitor.bearings['aft'])
        assert (given is None) == (' above 50 rpm' not in text)
        if given is not None:
            kinds.add(given.kind.value)
            assert f'{phrases[given.kind.value]} 50 rpm{astern}' in text
            assert given.rpm == sign * 50.0
    assert kinds == set(phrases)


def test_retune_keeps_the_state() -> None:
    monitor = Monitor(configured(alarm__on_delay=10.0))
    for time in range(8):
        assert update_point(monitor, time, INSIDE) == []
    monitor.retune(configured(alarm__on_delay=6.0))
    # The delay has counted since 0 s.
    assert update_point(monitor, 8.0, INSIDE) == [(8.0, 'normal', 'bistable')]
    assert monitor.bearings['aft'].counts.sum() == 18


def test_retune_takes_over_scale_deadband_and_limit() -> None:
    monitor = Monitor(configured(**AT_ONCE))
    update_point(monitor, 0.0, UNSTABLE)
    changed = configured(**AT_ONCE, load__scale=2.0, alarm__amplitude_limit=1e-6, speed__maximum=0.11)
    monitor.retune(changed)
    update = feed(monitor, 1.0, 'load', 600.0)
    assert update.verdict is not None
    assert update.verdict.assessment.load == 1200.0
    assert monitor.condition('aft') is Condition.AMPLITUDE
    assert feed(monitor, 2.0, 'speed', 22.0).status is Status.IMPLAUSIBLE
    monitor.retune(configured(alarm__minimum_speed=0.2))
    feed(monitor, 3.0, 'speed', INSIDE)
    verdict = monitor.bearings['aft'].verdict
    assert verdict is not None
    assert verdict.assessment.speed == 0.0


def test_a_shorter_timeout_reaches_an_input_already_silent() -> None:
    monitor = Monitor(configured(speed__timeout=3600.0, load__timeout=3600.0))
    update_point(monitor, 0.0, QUIET)
    assert monitor.advance(60 * SECOND) == []
    monitor.retune(configured(speed__timeout=5.0, load__timeout=3600.0))
    # It would have been lost at 5 s; it is told when it is known, at 60 s.
    assert [(brief(e), e.lost) for e in monitor.advance(61 * SECOND)] == [
        ((60.0, 'normal', 'input_stale'), {'speed': 60.0})
    ]


def test_retune_converts_the_values_that_stand() -> None:
    monitor = Monitor(configured())
    for time in range(3):
        update_point(monitor, time, UNSTABLE)
    state = monitor.bearings['aft'].state
    speed = state.value[0]
    monitor.retune(configured(load__scale=2.0, speed__scale=-1.0))
    # The medians go on with the same three numbers, in the new scale.
    for values in (state.value, state.before, state.earlier):
        assert values == pytest.approx([-speed, 2000.0])
    assert (state.fast, state.slow) == (pytest.approx(-speed), pytest.approx(-speed))
    verdict = feed(monitor, 3.0, 'load', 500.0).verdict
    assert verdict is not None
    assert verdict.assessment.load == 1000.0


def test_retune_with_other_bearings_is_refused_whole() -> None:
    one_bearing = configured()
    both_bearings = two_bearings(**{'aft.alarm.on_delay': 0.0})
    for config, other_config in ((one_bearing, both_bearings), (both_bearings, one_bearing)):
        monitor = Monitor(config)
        with pytest.raises(ConfigurationError, match=r'bearings = \[aft.*must stay \[aft'):
            monitor.retune(other_config)
        assert monitor.config is config
        assert monitor.bearings['aft'].config is config.bearing('aft')


def test_unknown_names() -> None:
    monitor = Monitor(configured())
    with pytest.raises(ConfigurationError, match="bearing 'bow' is not configured"):
        monitor.update(Sample('bow', 'speed', 0, 1.0))
    with pytest.raises(ConfigurationError, match="quantity 'torque' is not one of speed, load"):
        monitor.update(Sample('aft', 'torque', 0, 1.0))
    with pytest.raises(ConfigurationError, match="bearing 'bow' is not configured"):
        monitor.condition('bow')


def test_scan_leaves_the_monitor_alone() -> None:
    monitor = Monitor(configured())
    update_point(monitor, 0.0, QUIET)
    stream = Stream(np.array([5, 5]) * SECOND, np.array([False, True]), np.array([20.0, 1e3]))
    assert monitor.scan({'aft': stream})['aft'].time_ns.tolist() == [5 * SECOND]
    assert monitor.bearings['aft'].now_ns == 0
    with pytest.raises(ConfigurationError, match="bearing 'bow' is not configured"):
        monitor.scan({'bow': stream})


RISES_FIRST = {
    'friction__law': 'tabulated',
    'friction__speed': [0.0, 0.02, 0.05, 0.1, 0.2, 0.4],
    'friction__coefficient': [0.15, 0.25, 0.3, 0.2, 0.12, 0.1],
}


def test_below_the_range_stick_slip_ends() -> None:
    """Unstable from 9.96 rpm on: at 5 rpm friction rises, and the lining is still."""
    monitor = Monitor(configured(alarm__on_delay=1.0, alarm__off_delay=5.0, **RISES_FIRST))
    speeds = [5.0, UNSTABLE, 5.0]
    events = [e for k in range(900) for e in update_point(monitor, k / 5.0, speeds[k // 300])]
    assert [after for _, _, after in events] == ['stick_slip', 'normal']
    text = monitor.bearings['aft'].text()
    assert 'Stay below 9.9' in text
    assert 'or go above 49.9 rpm' in text
    assert 'the fold' not in text
    assert 'Raise speed' not in text


LIMITS = {float(np.iinfo(bits).max) for bits in ('i2', 'u2', 'i4', 'u4')} | {float(np.iinfo('i4').min)}


@pytest.mark.parametrize('number', sorted({*NO_VALUES, *LIMITS}))
def test_a_number_that_means_no_value_hides_no_stick_slip(number: float) -> None:
    # As it stands in the message, whatever scale and offset make of it; as NaN it is lost.
    monitor = Monitor(configured(speed__scale=0.1))
    for k in range(60):
        feed(monitor, k / 2, 'speed', 10.0 * UNSTABLE)
        feed(monitor, k / 2, 'load', 1000.0)
    assert monitor.condition('aft') is Condition.STICK_SLIP
    updates = [feed(monitor, 30.0 + k, 'speed', number) for k in range(4)]
    assert {update.status for update in updates} == {Status.NO_VALUE}
    assert monitor.condition('aft') is Condition.STICK_SLIP
    events = monitor.advance(60 * SECOND)
    assert [brief(event)[2] for event in events] == ['input_stale']
    # Nor does single precision change it.
    assert feed(monitor, 61.0, 'load', float(np.float32(number))).status is Status.NO_VALUE


def test_implausible_speeds_and_negative_loads_are_rejected() -> None:
    # A speed above 3000 rpm is implausible, and so is a load below zero unless its sensor may show one.
    monitor = Monitor(configured())
    statuses = [feed(monitor, k, 'speed', rpm).status for k, rpm in enumerate([2990.0, -3010.0])]
    assert statuses == [Status.ACCEPTED, Status.IMPLAUSIBLE]
    assert feed(monitor, 3.0, 'load', -44e3).status is Status.BELOW_MINIMUM
    signed = Monitor(configured(load__minimum=-50e3))
    assert feed(signed, 3.0, 'load', -44e3).status is Status.ACCEPTED


@pytest.mark.parametrize(
    ('off', 'expected'),
    # By up to a second before its arrival a stamp is the time of a value.
    [(-3600.0, 100.5), (-2.0, 100.5), (-1.0, 99.5), (-0.3, 100.2), (0.3, 100.5), (3600.0, 100.5)],
)
def test_a_stamp_near_its_arrival_is_the_time_of_a_value(off: float, expected: float) -> None:
    monitor = Monitor(configured())
    feed(monitor, 99.4 + off, 'speed', QUIET, arrival=99.4)
    update = feed(monitor, 100.5 + off, 'load', 1000.0, arrival=100.5)
    assert update.verdict is not None
    assert update.verdict.time_ns == round(expected * SECOND)


def test_an_equal_stamp_is_a_copy_with_an_equal_value_only() -> None:
    monitor = Monitor(configured())
    sent = [(10.0, 60.0), (10.0, 60.0), (10.0, 61.0), (10.0, 60.0)]
    statuses = [
        feed(monitor, stamp, 'speed', rpm, arrival=10.1 + k).status for k, (stamp, rpm) in enumerate(sent)
    ]
    assert statuses == [Status.ACCEPTED, Status.REPEATED, Status.ACCEPTED, Status.ACCEPTED]


def test_no_condition_begins_that_the_latest_value_ends() -> None:
    """Two values at 20 rpm a second apart, then rest: the medians say 20 rpm once more."""
    monitor = Monitor(configured())
    events = []
    for k, rpm in enumerate([QUIET, QUIET, UNSTABLE, UNSTABLE, 0.0, 0.0, 0.0, 0.0]):
        events += update_point(monitor, float(k), rpm)
    assert 'stick_slip' not in {after for _, _, after in events}


def test_a_stop_warns_before_the_range_that_it_goes_through() -> None:
    # From 120 rpm by 8 rpm/s: within 20 s it is astern, on the other side of the range.
    monitor = Monitor(configured())
    events = [
        event
        for k in range(300)
        for event in update_point(monitor, k / 10, max(0.0, 120.0 - 0.8 * max(0, k - 200)))
    ]
    time, _, after = events[0]
    assert after == 'caution'
    # It would be within a fifth of the fold, at 48.9 rpm, 8.9 s after it began to slow down.
    assert 20.0 < time < 26.0


def test_no_sentence_says_normal_of_values_within_the_region() -> None:
    # The alarm goes by medians of three: the first values of a slow-down have not moved them yet.
    monitor = Monitor(configured())
    for time in range(40):
        update_point(monitor, time, QUIET)
    update_point(monitor, 40, UNSTABLE)
    assert monitor.bearings['aft'].condition is Condition.NORMAL
    text = monitor.bearings['aft'].text()
    assert text.startswith('aft: Near the stick-slip boundary for less than 2 s: no alarm yet. Now 20 rpm')


def test_the_limits_of_whole_numbers_mean_no_value() -> None:
    # These are the largest numbers of 16 and 32 bits, in whole, tenths (NMEA 2000) and quarters (J1939).
    integers = {2**15 - 1, -(2**15), 2**16 - 1, 2**31 - 1, -(2**31), 2**32 - 1}
    tenths = {(2**15 - 1) / 10, -(2**15) / 10, (2**16 - 2) / 10 + 0.1}
    assert {*NO_VALUES} >= integers | tenths | {(2**16 - 1) / 4, (2**16 - 2) / 4}


@pytest.mark.parametrize('apart', [0.0, 0.001, 0.1])
@pytest.mark.parametrize('copies', [2, 3])
def test_values_in_pairs_are_not_lost(copies: int, apart: float) -> None:
    # Minimum, mean and maximum of ten seconds: known until the next are late, as a single value is.
    monitor = BearingMonitor(configured().bearing('aft'))
    events = []
    for k in range(1, 60):
        for copy in range(copies):
            for place, value in ((Input.SPEED, 80.0 + copy), (Input.LOAD, 1000.0 + copy)):
                update = monitor.update(place, int((10.0 * k + apart * copy) * 1e9), value)
                events += [(event.time_ns, event.after) for event in update.events]
        events += [(event.time_ns, event.after) for event in monitor.advance(int((10.0 * k + 9.9) * 1e9))]
    assert max((time_ns for time_ns, after in events if after is Condition.INPUT_STALE), default=0) < 40e9
    assert monitor.condition is Condition.NORMAL
    assert len(monitor.advance(int(630e9))) == 1


def test_two_values_far_apart_are_no_pair() -> None:
    # After one gap of 100 s the time-out is as it was: 5 s after the second value it is lost.
    monitor = BearingMonitor(configured().bearing('aft'))
    for second in (0, 100):
        for place, value in ((Input.SPEED, 80.0), (Input.LOAD, 1000.0)):
            monitor.update(place, second * 10**9, value)
    timeout = monitor.config.speed.timeout_ns
    (event,) = monitor.advance(200 * 10**9)
    assert (event.time_ns, event.after) == (100 * 10**9 + timeout, Condition.INPUT_STALE)


def test_an_input_is_lost_until_its_first_value_and_after_its_timeout() -> None:
    monitor = Monitor(configured())
    bearing = monitor.bearings['aft']
    lost = [[bearing.is_lost(place) for place in Input]]
    for time, quantity in ((0.0, 'speed'), (1.0, 'load'), (6.0, 'load')):
        feed(monitor, time, quantity, 1000.0)
        lost.append([bearing.is_lost(place) for place in Input])
    # Neither level nor water temperature is configured.
    assert lost == [
        [True, True, False, False],
        [False, True, False, False],
        [False, False, False, False],
        [True, False, False, False],
    ]


@pytest.mark.parametrize(
    ('rate', 'grown_before', 'high_for', 'expected'),
    [
        (1.0, BEGUN * 1.01, 0, True),  # sliding was unstable before it rose
        (1.0, BEGUN, LASTING - 1, False),  # it rose first: a pump does
        (0.0, BEGUN * 1.01, LASTING - 1, False),  # sliding is stable again
        (-1.0, 0.0, LASTING, True),  # after a shock it goes on
    ],
)
def test_a_vibration_is_stick_slip_when_it_rose_after_growth_or_has_lasted(
    rate: float, grown_before: float, high_for: int, expected: bool
) -> None:
    state = State()
    state.rate, state.grown_before, state.high_for = rate, grown_before, high_for
    assert has_begun(state) == expected


def test_a_vibration_is_foreign_once_it_has_gone_on_for_15_s_beyond_the_fold() -> None:
    # Time inside the fold, where it may be stick-slip, does not count.
    state = State()
    state.vibrating, state.high_for, state.beyond_for, state.doubt = VIBRATING, LASTING, SHORT - 1, 0
    doubt_foreign(state, can_be_foreign=True)
    assert (state.doubt, state.beyond_for) == (0, SHORT - 1)
    doubt_foreign(state, can_be_foreign=False)
    assert (state.doubt, state.beyond_for) == (0, 0)
    state.beyond_for = SHORT
    doubt_foreign(state, can_be_foreign=True)
    assert usable_state(state) == UNKNOWN


def test_a_vibration_keeps_over_a_gap_how_long_it_lasted_and_what_had_grown_before() -> None:
    numbers = settings_of(
        configured(level__topic='/v', level__unit='mm/s', level__threshold=1.0).bearings[0]
    ).live
    state = State()
    for growth, level, gap in ((0.0, 0.1, -1), (0.7, 5.0, SECOND), (1.5, 5.0, -1), (2.0, 5.0, SECOND)):
        state.growth = growth
        take_level(state, numbers, level, gap)
    assert (state.high_for, state.grown_before) == (2 * SECOND, 0.7)


@pytest.mark.parametrize(
    ('doubt', 'high_for', 'still', 'expected'),
    [
        (0, SHORT - 1, 0, VIBRATING),  # quiet for long enough before: used at once
        (1, SHORT - 1, 0, UNKNOWN),
        (1, SHORT, 0, VIBRATING),  # it goes on, so it counts
        (DOUBT, SHORT, DOUBT, VIBRATING),
        (DOUBT + 1, SHORT, 0, UNKNOWN),
        (0, SHORT, DOUBT + 1, UNKNOWN),  # stuck
    ],
)
def test_a_vibration_counts_at_once_or_when_it_goes_on(
    doubt: int, high_for: int, still: int, expected: int
) -> None:
    state = State()
    state.vibrating, state.doubt, state.high_for, state.still = VIBRATING, doubt, high_for, still
    assert usable_state(state) == expected
