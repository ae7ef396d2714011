# SPDX-License-Identifier: Apache-2.0
"""A session in the test's own time: what it tells of samples, silence and people, and keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from sending import SECOND, T0, Ship, configured

from stickslip_monitor import MonitorConfig
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_states import AlarmKind
from stickslip_monitor.monitor.bearing_records import verdict_value
from stickslip_monitor.monitor.session import HEARTBEAT_NS, Moment


@pytest.fixture
def config() -> MonitorConfig:
    return configured(speed__timeout=2.0, load__timeout=2.0)


@pytest.fixture
def ship(config: MonitorConfig) -> Ship:
    return Ship(config)


def test_the_record_of_a_bearing_has_numbers(ship: Ship) -> None:
    record = ship.sail(20.0, rpm=20.0)
    assert (record['reason'], record['sticking'], record['severity']) == ('stick_slip', True, 'ERROR')
    assert record['rpm'] == pytest.approx(20.0)
    # Fold speed 40.7179 rpm of this bearing at 1000 N (docs/physics.md).
    assert record['fold_margin'] == pytest.approx(20.0 / 40.7179 - 1.0, abs=1e-4)
    assert record['inputs']['speed']['rate'] == pytest.approx(5.0)
    assert record['inputs']['load']['age'] == 0.0
    assert record['inputs']['load']['counts']['accepted'] == 100


@pytest.mark.parametrize(('rpm', 'regime'), [(7.0, 'bistable'), (30.0, 'stable')])
def test_a_bearing_without_a_fold_under_averaging_has_a_margin(rpm: float, regime: str) -> None:
    ship = Ship(configured(friction__law='coulomb'))
    record = ship.sail(2.0, rpm=rpm)
    assert (record['regime'], record['fold_speed_kbm']) == (regime, None)
    # Its exact fold, by bisection of single slip phases (test_assessment.py), is at 7.1936 rpm.
    assert record['fold_margin'] == pytest.approx(rpm / 7.1936 - 1.0, rel=1e-3)
    assert verdict_value('fold_margin', ship.verdicts[-1]) == record['fold_margin']


def test_a_held_state_is_not_held_while_an_input_is_lost(ship: Ship) -> None:
    ship.sail(20.0, rpm=20.0)
    assert ship.sail(3.0)['held_until'] is not None
    record = ship.sail(4.0, rpm=None)
    assert (record['reason'], record['held_until']) == ('input_stale', None)


def test_a_mostly_dead_sensor_is_reported_with_its_share(ship: Ship) -> None:
    assert ship.sail(20.0, rpm=lambda k: 60.0 if k % 10 else math.nan)['severity'] == 'OK'
    record = ship.sail(60.0, rpm=lambda k: math.nan if k % 5 else 60.0)
    assert record['severity'] == 'WARN'
    assert '80% of the samples on /shaft/speed are refused, most because: not a' in record['text']
    assert ship.sail(60.0)['severity'] == 'OK'


def test_an_honest_sender_of_whole_seconds_repeats_itself_without_complaint(ship: Ship) -> None:
    for _ in range(300):
        ship.steady_ns += SECOND // 5
        for place, value in enumerate((60.0, 1000.0)):
            ship.take('aft', place, value, ship.now.time_ns // SECOND * SECOND)
        ship.tick()
    record = ship.look()
    assert (record['severity'], record['reason']) == ('OK', 'normal')
    assert record['inputs']['speed']['counts']['repeated'] == 300 - 61  # of 61 seconds


def test_a_mix_of_two_quantities_is_an_alarm_and_no_all_clear(ship: Ship) -> None:
    """Two of 1000 and two of 20 rpm in turn, of whose medians no verdict can be made."""
    record = ship.sail(10.0, rpm=lambda k: 20.0 if k % 4 < 2 else 1000.0)
    assert (record['reason'], record['severity']) == ('unreliable', 'WARN')
    jump = 'On /shaft/speed, values jump between two levels: two publishers on one topic, or a loose contact'
    assert record['text'].startswith(f'aft: {jump} (here 20 and 1000 rpm). No verdict can be relied on.')
    assert ship.states() == {'input_implausible': 'unacknowledged'}
    (text,) = (a['text'] for a in ship.published[-1]['alarms'] if a['alarm'] == 'input_implausible')
    assert text == f'aft: Input speed implausible: o{jump[1:]}. No verdict can be relied on.'
    # A minute after the last jump it is what it says.
    assert ship.sail(70.0)['reason'] == 'normal'


@pytest.mark.parametrize('number', [-999.25, 30e3])
def test_refused_samples_mix_no_verdict(ship: Ship, number: float) -> None:
    record = ship.sail(20.0, rpm=lambda k: number if k % 3 == 0 else 60.0)
    assert (record['reason'], ship.states()) == ('normal', {'input_implausible': 'unacknowledged'})


def test_a_mix_of_two_quantities_clears_no_alarm_of_stick_slip(ship: Ship) -> None:
    ship.sail(10.0, rpm=20.0)
    record = ship.sail(60.0, rpm=lambda k: 20.0 if k % 5 < 2 else 1000.0)
    assert [event.after.value for event in ship.events][-1] == 'normal'
    assert 'No verdict can be relied on. On /shaft/speed, values jump' in ship.events[-1].text
    assert record['reason'] == 'unreliable'
    alarms = {a['alarm']: a['active'] for a in ship.published[-1]['alarms']}
    assert alarms['stick_slip']
    ship.sail(80.0)
    alarms = {a['alarm']: a['active'] for a in ship.published[-1]['alarms']}
    assert not alarms['stick_slip']


def test_a_second_level_that_is_rare_holds_no_alarm(ship: Ship) -> None:
    # Every fiftieth value is on it: verdicts can be relied on, and the alarm clears when stick-slip ends.
    record = ship.sail(200.0, rpm=lambda k: 1000.0 if k % 50 == 0 else 20.0)
    assert record['reason'] == 'stick_slip'
    # The jumps are told for a minute after the last.
    ship.sail(40.0, rpm=1000.0)
    alarms = {a['alarm']: a['active'] for a in ship.published[-1]['alarms']}
    assert (alarms['stick_slip'], alarms['input_implausible']) == (False, True)


@pytest.mark.parametrize(('time_ns', 'is_named'), [(0, True), (T0, False)])
def test_simulated_time_that_does_not_come_is_named(ship: Ship, time_ns: int, is_named: bool) -> None:
    for second in range(1, 12):
        ship.session.tick(Moment(second * SECOND, time_ns), second * SECOND)
    assert any('/clock' in line for line in ship.lines) == is_named


def test_after_a_pause_the_node_waits_for_inputs_again(ship: Ship) -> None:
    ship.sail(20.0, rpm=20.0)
    event_count = len(ship.events)
    ship.session.end()
    ship.steady_ns += 60 * SECOND
    ship.session.begin()
    ship.sail(1.0, rpm=None, load=None)
    assert ship.sail(5.0, rpm=20.0)['reason'] == 'stick_slip'
    assert ship.events[event_count:] == []


def test_a_stall_of_the_process_loses_no_input(ship: Ship) -> None:
    ship.sail(5.0)
    ship.steady_ns += 10 * SECOND
    ship.session.discount_stall(10 * SECOND)
    ship.sail(1.0)
    assert ship.events == []
    ship.sail(4.0, rpm=None)
    assert [event.after.value for event in ship.events] == ['input_stale']
    assert 'no valid value on /shaft/speed' in ship.events[0].text


def test_verdicts_are_published_once_a_period_and_at_changes(config: MonitorConfig) -> None:
    ship = Ship(replace(config, publish_period=1.0))
    ship.sail(10.0)
    assert len(ship.verdicts) in (10, 11)
    verdict_count = len(ship.verdicts)
    ship.sail(10.0, rpm=20.0)
    changes = len(ship.events)
    assert verdict_count + 10 <= len(ship.verdicts) <= verdict_count + 10 + 2 * changes
    assert changes >= 1


def test_samples_time_and_people_change_the_list_and_the_store(config: MonitorConfig) -> None:
    ship = Ship(config)
    ship.sail(5.0, rpm=20.0)  # deep in the stick-slip range
    assert ship.states()['stick_slip'] == 'unacknowledged'
    assert ship.states()['bistable'] == 'acknowledged'
    assert not any(' by ' in line for line in ship.lines)  # the monitor's own changes are events
    (change,) = ship.does(Action.ACKNOWLEDGE, AlarmKind.STICK_SLIP)
    assert change.by == 'Ada'
    assert ship.lines[-1] == 'aft/stick_slip: acknowledge by Ada, unacknowledged -> acknowledged'
    ship.sail(10.0, rpm=None, load=None)  # nothing more is heard: lost, and what stood stands
    assert ship.states()['input_lost'] == 'unacknowledged'
    assert ship.states()['stick_slip'] == 'acknowledged'
    after = Ship(config, ship.kept)  # a restart
    assert after.states()['stick_slip'] == 'acknowledged'
    sequence = [record['sequence'] for record in ship.published]
    assert sequence == list(range(1, len(sequence) + 1))


def test_the_list_is_published_once_a_minute_without_any_change(ship: Ship) -> None:
    ship.session.tick(ship.now, HEARTBEAT_NS - 1)
    assert len(ship.published) == 1
    ship.session.tick(ship.now, HEARTBEAT_NS)
    ship.session.tick(ship.now, HEARTBEAT_NS + 1)
    assert [record['changes'] for record in ship.published] == [[], []]


def test_a_note_comes_once_with_the_next_list(ship: Ship) -> None:
    ship.session.note('node', 'it was held up')
    for _ in range(2):
        ship.tick()
    assert ship.published[-1]['notes'] == [{'time': T0, 'what': 'node', 'text': 'it was held up'}]
    assert len(ship.published) == 2


def test_a_failing_store_is_reported_once_for_each_outage(ship: Ship) -> None:
    ship.sail(5.0, rpm=20.0)
    counts = []
    for full in ('disk full', 'disk full', '', 'disk full'):
        ship.full = full
        for action in (Action.SHELVE, Action.UNSHELVE):
            ship.does(action)
        counts.append(sum('not kept' in line for line in ship.lines))
    assert counts == [1, 1, 1, 2]


def test_a_damaged_store_starts_fresh(config: MonitorConfig) -> None:
    ship = Ship(config, 'rubbish')
    assert ship.states() == {}
    assert ship.lines == [
        'state_file state.json is damaged: it is not JSON; it is now state.json.damaged,'
        ' and the alarms start fresh'
    ]
    # It stands in the status and the notes until somebody has acknowledged all alarms.
    assert ship.session.damage == ship.lines[0] == ship.published[0]['notes'][0]['text']
    ship.does(Action.ACKNOWLEDGE)
    assert ship.session.damage == ''
