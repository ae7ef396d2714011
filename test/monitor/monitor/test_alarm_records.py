# SPDX-License-Identifier: Apache-2.0
"""What is published of the alarms, and what survives a restart."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from sending import change, configured

from stickslip_monitor import MonitorConfig
from stickslip_monitor.errors import AlarmStateError
from stickslip_monitor.monitor.alarm_list import WINDOW_NS, Action, Annunciator
from stickslip_monitor.monitor.alarm_records import alarms_record, recall_state, state_record
from stickslip_monitor.monitor.alarm_states import AlarmKind
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.monitor.statements import Event

SECOND = 10**9
T0 = 1_700_000_000 * SECOND


@pytest.fixture
def config() -> MonitorConfig:
    return replace(configured(), shelve_time_ns=600 * SECOND, silence_time_ns=30 * SECOND)


def condition_change(second: int, previous: Condition, current: Condition) -> Event:
    return change(T0 + second * SECOND, previous, current)


@pytest.fixture
def stuck(config: MonitorConfig) -> Annunciator:
    """Stick-slip since second 1, not acknowledged."""
    annunciator = Annunciator(config)
    annunciator.advance(1 * SECOND, T0 + SECOND)
    annunciator.take_event(condition_change(1, Condition.NORMAL, Condition.STICK_SLIP))
    return annunciator


def restart_annunciator(old: Annunciator, down: int, second: int = 2) -> Annunciator:
    """Return a new annunciator after a restart that took some seconds."""
    document = json.loads(json.dumps(state_record(old, T0 + second * SECOND)))
    new = Annunciator(old.config)
    recall_state(new, document, T0 + (second + down) * SECOND)
    return new


def test_the_record(stuck: Annunciator) -> None:
    """Check its values; test/ros/test_interfaces.py holds its keys to the schema."""
    changes = stuck.act(Action.ACKNOWLEDGE, T0 + 2 * SECOND, 'Ada')
    record = json.loads(json.dumps(alarms_record(stuck, changes, T0 + 2 * SECOND, 7)))
    assert (record['schema'], record['time']) == ('stickslip_monitor/alarm/1', T0 + 2 * SECOND)
    assert (record['sequence'], record['sounding'], record['unacknowledged']) == (7, False, 0)
    assert record['flood'] == {'alarms_10min': 1, 'most_10min': 1, 'flooding': False}
    (change,) = record['changes']
    expected_change = {
        'from': 'unacknowledged',
        'to': 'acknowledged',
        'by': 'Ada',
        'text': 'aft: Stick-slip predicted.',
    }
    assert change.items() >= (expected_change | {'alarm': 'stick_slip', 'what': 'acknowledge'}).items()
    alarms = {alarm['alarm']: alarm for alarm in record['alarms']}
    assert [*alarms, 'vibration'] == [kind.value for kind in AlarmKind]
    expected_alarm = {'state': 'acknowledged', 'active': True, 'shelved_until': None, 'by': 'Ada', 'count': 1}
    times = {'since': T0 + SECOND, 'changed': T0 + 2 * SECOND}
    assert alarms['stick_slip'].items() >= (expected_alarm | times).items()


@pytest.mark.parametrize(
    ('down', 'remaining'),
    # Shelved for 600 s at second 2; a clock that went back says that no time has passed.
    [(0, 600), (100, 500), (10_000, 0), (-10_000, 600)],
)
def test_the_shelf_survives_a_restart(stuck: Annunciator, down: int, remaining: int) -> None:
    stuck.act(Action.SHELVE, T0 + 2 * SECOND, 'Ada')
    new = restart_annunciator(stuck, down)
    alarm = new.alarms['aft'][AlarmKind.STICK_SLIP]
    # By the clock as it is now.
    assert alarm.shelved_until_ns == T0 + (2 + down + remaining) * SECOND
    new.advance(remaining * SECOND - 1, T0)
    assert alarm.state == ('shelved' if remaining else 'unacknowledged')
    new.advance(remaining * SECOND, T0)
    assert alarm.state == 'unacknowledged'


def test_an_alarm_that_waits_sounds_from_the_restart(stuck: Annunciator) -> None:
    """Expect what docs/alarms.md says of a sound within ten minutes: a new onset makes none."""
    new = restart_annunciator(stuck, down=0)
    assert new.sounding
    new.act(Action.ACKNOWLEDGE, T0 + 2 * SECOND, 'Ada')
    new.take_event(change(T0 + 3 * SECOND, Condition.STICK_SLIP, Condition.STICK_SLIP, onset=True))
    assert not new.sounding
    new.advance(WINDOW_NS, T0)
    new.take_event(change(T0 + 700 * SECOND, Condition.STICK_SLIP, Condition.STICK_SLIP, onset=True))
    assert new.sounding


def test_other_bearings_are_passed_over(stuck: Annunciator) -> None:
    document = state_record(stuck, T0)
    document['bearings']['bow'] = document['bearings'].pop('aft')
    new = Annunciator(stuck.config)
    recall_state(new, document, T0)
    assert {alarm.state.value for alarm in new} == {'normal'}


def test_the_alarms_of_0_2_0_are_taken_over_though_it_kept_no_memories(stuck: Annunciator) -> None:
    document = state_record(stuck, T0)
    del document['states']
    new = Annunciator(stuck.config)
    assert recall_state(new, document, T0) == {}
    assert new.alarms['aft'][AlarmKind.STICK_SLIP].state == 'unacknowledged'


@pytest.mark.parametrize('reasons', [[], ['at_rest']])
@pytest.mark.parametrize(('condition', 'state'), [('stick_slip', 'unacknowledged'), ('normal', 'normal')])
def test_alarms_of_a_locked_shaft_sound_again_after_an_update(
    config: MonitorConfig, reasons: list[str], condition: str, state: str
) -> None:
    """Restore a state of 0.3.0 or earlier, whose shaft a person had locked."""
    old = Annunciator(config)
    document = state_record(old, T0)
    bearing_record = document['bearings']['aft']
    bearing_record['shaft_locked'] = True
    for kind, alarm_record in bearing_record['alarms'].items():
        alarm_record |= {'state': 'suppressed', 'suppressed_by': ['shaft_locked', *reasons]}
        alarm_record['active'] = kind in (condition, 'input_lost') and condition != 'normal'
    new = Annunciator(config)
    recall_state(new, document, T0)
    new.advance(SECOND, T0)
    alarms = new.alarms['aft']
    assert {alarms[kind].state.value for kind in (AlarmKind.STICK_SLIP, AlarmKind.INPUT_LOST)} == {state}
    assert new.sounding == (condition != 'normal')
    assert not any(alarm.suppressed_by for alarm in new)


def spoil_document(document: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    *parents, key = path.split('.')
    place = document
    for step in parents:
        place = place[step]
    if value is KeyError:
        del place[key]
    else:
        place[key] = value
    return document


@pytest.mark.parametrize(
    ('path', 'value', 'text'),
    [
        ('schema', 'stickslip_monitor/alarm_state/2', "'stickslip_monitor/alarm_state/2' must be"),
        ('time', '12', "the document: time = '12' has the wrong type"),
        ('bearings', KeyError, "the document has no 'bearings'"),
        ('bearings.aft.alarms.stick_slip.state', 'loud', "aft.stick_slip: unknown state 'loud'"),
        ('bearings.aft.alarms.stick_slip.active', KeyError, "aft.stick_slip has no 'active'"),
        ('bearings.aft.alarms.smoke', {}, "aft: unknown alarm 'smoke'"),
    ],
)
def test_a_damaged_state_is_named_and_nothing_is_taken_over(
    stuck: Annunciator, path: str, value: Any, text: str
) -> None:
    document = spoil_document(state_record(stuck, T0), path, value)
    new = Annunciator(stuck.config)
    with pytest.raises(AlarmStateError) as caught:
        recall_state(new, document, T0)
    assert text in str(caught.value)
    assert {alarm.state.value for alarm in new} == {'normal'}


@pytest.mark.parametrize('document', [None, 5, [], 'text', {}])
def test_records_that_are_no_state_are_refused(stuck: Annunciator, document: Any) -> None:
    with pytest.raises(AlarmStateError, match='the document has no'):
        recall_state(stuck, document, T0)


def test_the_row_of_an_input_that_is_back_says_since_when_and_when_it_clears(config: MonitorConfig) -> None:
    annunciator = Annunciator(config)
    for second, previous, current in (
        (5, Condition.NORMAL, Condition.INPUT_STALE),
        (8, Condition.INPUT_STALE, Condition.NORMAL),
    ):
        annunciator.advance(second * SECOND, T0 + second * SECOND)
        annunciator.take_event(condition_change(second, previous, current))
    annunciator.advance(9 * SECOND, T0 + 9 * SECOND)
    (row,) = alarms_record(annunciator, [], T0 + 9 * SECOND, 1)['rows']
    # The default input_off_delay is a minute.
    assert (row['back_since'], row['clears_at']) == (T0 + 8 * SECOND, T0 + 68 * SECOND)
