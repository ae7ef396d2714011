# SPDX-License-Identifier: Apache-2.0
"""What comes from a monitor that may say anything, and what is kept of it."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from stickslip_monitor.dashboard.received import (
    OFFERED,
    checked_alarms,
    read_status,
    status_record,
)
from stickslip_monitor.dashboard.state import LOG, TRAIL, BearingView, Curves, DashboardState
from stickslip_monitor.errors import DashboardError
from stickslip_monitor.monitor.alarms.alarm_records import alarms_record
from stickslip_monitor.monitor.alarms.annunciator import Action, Annunciator
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.alarms.lifecycle import AlarmState
from stickslip_monitor.monitor.alarms.requests import ActionRequest, parse_request, request_record
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.messages import diagnostic_record, state_of
from stickslip_monitor.monitor.monitor import Monitor

VIEW = BearingView(
    'aft_stern', 190.0, (0.0, 1.0), (0.0, 1.0), Curves([], [], [], []), 0.1, None, {}
)


@pytest.fixture
def now() -> list[float]:
    return [100.0]


@pytest.fixture
def board(now: list[float]) -> DashboardState:
    return DashboardState([VIEW], 'test', clock=lambda: now[0])


def values(speed: float, load: float, accepted: int = 1) -> dict[str, str]:
    return {
        'speed [m/s]': str(speed),
        'load [N]': str(load),
        'speed samples accepted': str(accepted),
    }


def test_a_status_is_read_back_as_the_monitor_had_it(kit: Any) -> None:
    monitor = Monitor(load_config(kit.REFERENCE))
    bearing = monitor.bearings['aft_stern']
    # The first point below the Hopf speed decides.
    alarm = replace(bearing.config.alarm, onset_growth=0.0)
    bearing.retune(replace(bearing.config, alarm=alarm))
    bearing.update(0, 10**9, 20.0)
    verdict = bearing.update(1, 2 * 10**9, 1000.0).verdict
    assert verdict is not None
    bearing.update(1, 2 * 10**9, float('nan'))
    bearing.advance(9 * 10**9)
    record = diagnostic_record('stickslip_monitor', state_of(bearing))
    status = read_status(7, record.message, record.values)
    point = verdict.assessment
    for name in ('speed', 'load', 'hopf_margin', 'fold_margin', 'amplitude', 'amplitude_exact'):
        assert status.numbers[name] == pytest.approx(getattr(point, name), rel=1e-8)
    assert (status.time_ns, status.sticking) == (7, True)
    assert status.words == {
        'reason': 'input_stale', 'regime': 'unstable', 'outcome': 'stick_slip'
    }  # fmt: skip
    assert status.ages == pytest.approx({'speed': 8.0, 'load': 7.0})
    assert status.counts['load'] == {
        'accepted': 1, 'clock_jump': 0, 'not_finite': 1,
        'implausible': 0, 'repeated': 0, 'out_of_order': 0,
    }  # fmt: skip


def test_what_is_no_number_is_left_out() -> None:
    status = read_status(0, '', {'speed [m/s]': 'fast', 'load [N]': 'inf', 'hopf margin': 'nan'})
    record = status_record(status)
    assert record['speed'] is record['load'] is record['hopf_margin'] is None
    assert (record['reason'], record['sticking']) == ('waiting', None)


def test_memory_is_bounded(board: DashboardState) -> None:
    for k in range(3 * TRAIL):
        board.take_status('aft_stern', k, '', values(k, 1.0))
        board.take_status('aft_stern', k, '', values(k, 1.0))
    trail = board.state()['bearings'][0]['trail']
    assert trail == [(float(k), 1.0) for k in range(2 * TRAIL, 3 * TRAIL)]
    for k in range(2 * LOG):
        board.take_alarms(record([change(k)]))
    assert [c['time'] for c in board.state()['log']] == list(range(LOG, 2 * LOG))


def test_a_bearing_nobody_knows_is_passed_over(board: DashboardState) -> None:
    board.take_status('fore', 0, '', values(1.0, 1.0))
    assert not board.there
    board.take_alarms(record([]) | {'alarms': [alarm(bearing='fore'), alarm()]})
    assert board.alarms is not None
    assert [a['bearing'] for a in board.alarms['alarms']] == ['aft_stern']


def test_silence_is_noticed_and_samples_age(board: DashboardState, now: list[float]) -> None:
    reader = board.hub.join()
    assert board.silent_for is board.sample_age('aft_stern', 'speed') is None
    board.take_alarms(record([]))
    board.take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=5))
    assert board.there
    now[0] += 2.5
    board.take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=5))
    assert board.sample_age('aft_stern', 'speed') == pytest.approx(2.5)
    # What is refused is no sample.
    refused = values(1.0, 1.0, accepted=5) | {'speed samples implausible': '9'}
    board.take_status('aft_stern', 0, '', refused)
    assert board.sample_age('aft_stern', 'speed') == pytest.approx(2.5)
    # A monitor that was started anew counts from the start.
    board.take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=0))
    now[0] += 1.0
    board.take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=1))
    assert board.sample_age('aft_stern', 'speed') == 0.0
    now[0] += 3.1
    board.tick()
    assert not board.there
    assert board.monitor() == {
        'there': False,
        'finished': False,
        'silent': 3.1,
        'faults': ['The monitor has been silent for 3 s.'],
        'unheard': ['aft_stern'],
    }
    assert b'"there":false' in reader._waiting['monitor ']


def change(time_ms: int) -> dict[str, Any]:
    texts = ('bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
    return dict.fromkeys(texts, 'x') | {'time': time_ms * 10**6}


def alarm(**changes: Any) -> dict[str, Any]:
    texts = {'bearing': 'aft_stern', 'alarm': 'stick_slip', 'priority': 'alarm'}
    return texts | {'state': 'normal', 'by': '', 'text': ''} | changes


def record(changes: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        'schema': 'stickslip_monitor/alarm/1',
        'time': 10**9,
        'sounding': False,
        'unacknowledged': 0,
        'flood': {},
        'changes': changes,
        'alarms': [],
    }


@pytest.mark.parametrize(
    'document',
    [
        None,
        [],
        {},
        record([]) | {'schema': 'stickslip_monitor/alarm/2'},
        record([]) | {'time': 'now'},
        record([]) | {'alarms': None},
        record([]) | {'alarms': [7]},
        record([]) | {'alarms': [alarm(state=None)]},
        record([]) | {'changes': [{}]},
    ],
)
def test_what_is_no_list_of_alarms_changes_nothing(board: DashboardState, document: Any) -> None:
    board.take_alarms(document)
    assert board.alarms is None


def test_what_is_offered_is_what_does_something() -> None:
    """Each offered action, done to a real alarm in that state, changes it; no other one does."""
    from pathlib import Path

    root = Path(__file__).resolve().parents[2]
    config = load_config(root / 'launch_configs' / 'reference_bearing.yaml')
    for state in AlarmState:
        for action in OFFERED:
            annunciator = Annunciator(config)
            live = annunciator.alarms['aft_stern'][AlarmKind.STICK_SLIP]
            live.state, live.active = state, state is AlarmState.UNACKNOWLEDGED
            checked = checked_alarms(alarms_record(annunciator, [], 0, 1), ['aft_stern'])
            assert checked is not None
            (shown,) = [a for a in checked['alarms'] if a['alarm'] == 'stick_slip']
            done = annunciator.act(action, 0, 'Ada', 'aft_stern', AlarmKind.STICK_SLIP)
            quiet = state in (AlarmState.NORMAL, AlarmState.SUPPRESSED) and action is Action.SHELVE
            assert (action.value in shown['actions']) == (bool(done) and not quiet)


def test_a_request_travels_there_and_back() -> None:
    for request in (
        ActionRequest(Action.SHELVE, 'Ada', 'aft_stern', AlarmKind.BISTABLE),
        ActionRequest(Action.SILENCE, 'Éowyn 船長'),
    ):
        assert parse_request(request_record(request), ['aft_stern']) == request


def test_the_end_of_a_recording_is_told_once(board: DashboardState) -> None:
    reader = board.hub.join()
    board.take_status('aft_stern', 0, '', values(1.0, 1.0))
    reader._waiting.clear()
    board.finish()
    assert b'"there":false,"finished":true' in reader._waiting.pop('monitor ')
    board.tick()
    assert reader._waiting == {}


def test_what_another_did_is_no_answer(board: DashboardState) -> None:
    waiting = {'state': 'unacknowledged', 'sounding': True}
    board.take_alarms(record([]) | {'alarms': [alarm(**waiting)]})

    class Desk:
        by = 'Ada'

        def act(self, request: ActionRequest) -> None:
            done = change(1) | {'bearing': 'aft_stern', 'alarm': 'stick_slip', 'by': self.by}
            board.take_alarms(
                record([done | {'what': 'acknowledge'}]) | {'alarms': [alarm(**waiting)]}
            )

    async def ask(by: str) -> int:
        request = ActionRequest(Action.ACKNOWLEDGE, by, 'aft_stern', AlarmKind.STICK_SLIP)
        return await board.ask(Desk(), request, 0.01)

    assert asyncio.run(ask('Ada')) == 1
    with pytest.raises(DashboardError, match='nothing is known to be done'):
        asyncio.run(ask('Bob'))


def hear(board: DashboardState, bearing: str = 'aft_stern', **more: str) -> None:
    board.take_status(bearing, 0, '', values(1.0, 1.0) | more)


@pytest.mark.parametrize(
    ('happens', 'words'),
    [
        (lambda b, now: None, 'Nothing has been heard of the monitor test yet.'),
        (lambda b, now: b.take_other('port/monitor'), 'other monitors: /port/monitor; see --node'),
        (lambda b, now: hear(b), 'The list of alarms has not come'),
        (lambda b, now: (hear(b, 'fore'), b.take_alarms(record([]))), 'Nothing has been heard'),
        (lambda b, now: (hear(b), hear(b, 'fore')), 'fore: watched by test, but not in --config'),
        (
            lambda b, now: (
                hear(b),
                b.take_alarms(record([]) | {'alarms': [alarm(bearing='fore')]}),
            ),
            'fore: watched by test, but not in --config',
        ),
        (
            lambda b, now: (hear(b), b.take_alarms(record([]) | {'monitoring': False})),
            'Not monitoring: the node is not active',
        ),
        (
            lambda b, now: (hear(b, reason='not_monitoring'), now.append(now.pop() + 60.0)),
            'Not monitoring: the node is not active',
        ),
        (
            lambda b, now: (
                b.take_alarms(record([])),
                now.append(now.pop() + 200.0),
                hear(b),
            ),
            'The list of alarms is 200 s old',
        ),
    ],
)
def test_never_all_clear_by_mistake(
    board: DashboardState, now: list[float], happens: Any, words: str
) -> None:
    happens(board, now)
    assert not board.there
    assert words in ' '.join(board.monitor()['faults'])


def test_a_bearing_that_the_node_does_not_have_is_told(now: list[float]) -> None:
    board = DashboardState([VIEW, replace(VIEW, name='fore')], 'test', clock=lambda: now[0])
    board.take_alarms(record([]))
    hear(board)
    assert (board.heard, board.there) == (True, False)
    assert board.faults() == ['Of fore nothing is heard: test does not watch it.']
    reader = board.hub.join()
    hear(board, 'fore')
    assert board.there
    assert b'"faults":[]' in reader._waiting['monitor ']


def test_what_cannot_be_delivered_is_said(board: DashboardState) -> None:
    request = ActionRequest(Action.ACKNOWLEDGE, 'Ada')
    with pytest.raises(DashboardError, match='the list of alarms has not come'):
        asyncio.run(board.ask(None, request, 0.01))  # type: ignore[arg-type]
