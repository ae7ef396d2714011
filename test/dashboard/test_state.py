# SPDX-License-Identifier: Apache-2.0
"""What comes from a monitor that may say anything, and what is kept of it."""

from __future__ import annotations

import asyncio
import csv
import io
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor.dashboard.event_log import KEPT, SHOWN, EventLog
from stickslip_monitor.dashboard.history import SPAN, STEP
from stickslip_monitor.dashboard.received import (
    OFFERED,
    checked_alarms,
    read_status,
    status_record,
)
from stickslip_monitor.dashboard.state import DashboardState
from stickslip_monitor.dashboard.watched import BearingView, Curves, WatchedMonitor
from stickslip_monitor.errors import DashboardError, RosError
from stickslip_monitor.monitor.alarms.alarm_records import alarms_record
from stickslip_monitor.monitor.alarms.annunciator import Action, Annunciator
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.alarms.lifecycle import AlarmState
from stickslip_monitor.monitor.alarms.requests import ActionRequest, parse_request, request_record
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.messages import diagnostic_record, state_of
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.ros.state_file import StateFile, StateWriter

VIEW = BearingView(
    'aft_stern', 190.0, (0.0, 1.0), (0.0, 1.0), Curves([], [], [], []), 0.1, None, {}
)


@pytest.fixture
def now() -> list[float]:
    return [100.0]


@pytest.fixture
def board(now: list[float]) -> DashboardState:
    return board_of(now, VIEW)


def board_of(now: list[float], *views: BearingView) -> DashboardState:
    return DashboardState([WatchedMonitor('test', views, clock=lambda: now[0])])


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
    take = board.monitors[0].take_status
    rows = SPAN // STEP
    for k in range(2 * rows):
        take('aft_stern', k * 10**9, '', values(k, 1.0))
        take('aft_stern', k * 10**9 + 5 * 10**8, '', values(k, 2.0))
    history = board.history('aft_stern')
    assert history is not None
    assert [row[1:3] for row in history['rows']] == [
        [float(k), 2.0] for k in range(rows, 2 * rows)
    ]
    # A clock that steps back leaves nothing that lies ahead of it.
    take('aft_stern', (2 * rows - 5) * 10**9, '', values(7.0, 1.0))
    rest = board.history('aft_stern')
    assert rest is not None
    assert [row[1] for row in rest['rows'][-2:]] == [2.0 * rows - 6.0, 7.0]
    assert board.history('fore') is None
    for k in range(KEPT + 2 * SHOWN):
        board.log.extend([change(k)])
    assert [c['time'] for c in board.state()['log']] == list(range(KEPT + SHOWN, KEPT + 2 * SHOWN))
    assert len(board.log.csv().splitlines()) == 1 + KEPT


def test_a_bearing_nobody_knows_is_passed_over(board: DashboardState) -> None:
    board.monitors[0].take_status('fore', 0, '', values(1.0, 1.0))
    assert not board.there
    board.monitors[0].take_alarms(record([]) | {'alarms': [alarm(bearing='fore'), alarm()]})
    assert board.alarms is not None
    assert [a['bearing'] for a in board.alarms['alarms']] == ['aft_stern']


def test_silence_is_noticed_and_samples_age(board: DashboardState, now: list[float]) -> None:
    reader = board.hub.join()
    assert (
        board.monitors[0].silent_for is board.monitors[0].sample_age('aft_stern', 'speed') is None
    )
    board.monitors[0].take_alarms(record([]))
    board.monitors[0].take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=5))
    assert board.there
    now[0] += 2.5
    board.monitors[0].take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=5))
    assert board.monitors[0].sample_age('aft_stern', 'speed') == pytest.approx(2.5)
    # What is refused is no sample.
    refused = values(1.0, 1.0, accepted=5) | {'speed samples implausible': '9'}
    board.monitors[0].take_status('aft_stern', 0, '', refused)
    assert board.monitors[0].sample_age('aft_stern', 'speed') == pytest.approx(2.5)
    # A monitor that was started anew counts from the start.
    board.monitors[0].take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=0))
    now[0] += 1.0
    board.monitors[0].take_status('aft_stern', 0, '', values(1.0, 1.0, accepted=1))
    assert board.monitors[0].sample_age('aft_stern', 'speed') == 0.0
    now[0] += 3.1
    board.tick()
    assert not board.there
    assert board.monitor() == {
        'there': False,
        'finished': False,
        'silent': 3.1,
        'faults': ['The monitor test has been silent for 3 s.'],
        'notices': [],
        'unheard': ['aft_stern'],
    }
    assert b'"there":false' in reader._waiting['monitor ']


def change(time_ms: int) -> dict[str, Any]:
    texts = ('bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
    return dict.fromkeys(texts, 'x') | {'time': time_ms}


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
    board.monitors[0].take_alarms(document)
    assert board.alarms is None


def test_what_is_offered_is_what_does_something() -> None:
    """Each offered action, done to a real alarm in that state, changes it; no other one does."""
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
        ActionRequest(Action.SILENCE, 'Éowyn 船長', reason='new oil'),
    ):
        assert parse_request(request_record(request), ['aft_stern']) == request


def test_the_end_of_a_recording_is_told_once(board: DashboardState) -> None:
    reader = board.hub.join()
    board.monitors[0].take_status('aft_stern', 0, '', values(1.0, 1.0))
    reader._waiting.clear()
    board.finish()
    assert b'"there":false,"finished":true' in reader._waiting.pop('monitor ')
    board.tick()
    assert reader._waiting == {}


def test_what_another_did_is_no_answer(board: DashboardState) -> None:
    waiting = {'state': 'unacknowledged', 'sounding': True}
    board.monitors[0].take_alarms(record([]) | {'alarms': [alarm(**waiting)]})

    def act(request: ActionRequest) -> None:
        done = change(1) | {'bearing': 'aft_stern', 'alarm': 'stick_slip', 'by': 'Ada'}
        board.monitors[0].take_alarms(
            record([done | {'what': 'acknowledge'}]) | {'alarms': [alarm(**waiting)]}
        )

    async def ask(by: str) -> int:
        request = ActionRequest(Action.ACKNOWLEDGE, by, 'aft_stern', AlarmKind.STICK_SLIP)
        return await board.ask(request, 0.01)

    board.monitors[0].act = act

    assert asyncio.run(ask('Ada')) == 1
    with pytest.raises(DashboardError, match='nothing is known to be done'):
        asyncio.run(ask('Bob'))


def hear(monitor: WatchedMonitor, bearing: str = 'aft_stern', **more: str) -> None:
    monitor.take_status(bearing, 0, '', values(1.0, 1.0) | more)


@pytest.mark.parametrize(
    ('happens', 'words'),
    [
        (lambda b, now: None, 'Nothing has been heard of the monitor test yet.'),
        (
            lambda b, now: b.take_other('port/monitor'),
            'other monitors: /port/monitor; see --node',
        ),
        (lambda b, now: hear(b), 'The list of alarms of test has not come'),
        (
            lambda b, now: (hear(b, 'fore'), b.take_alarms(record([]))),
            'Nothing has been heard',
        ),
        (lambda b, now: (hear(b), hear(b, 'fore')), 'fore: watched by test, but not in --config'),
        (
            lambda b, now: (
                hear(b),
                b.take_alarms(record([]) | {'alarms': [alarm(bearing='fore')]}),
            ),
            'fore: watched by test, but not in --config',
        ),
        (
            lambda b, now: (
                hear(b),
                b.take_alarms(record([]) | {'monitoring': False}),
            ),
            'Not monitoring: test is not active',
        ),
        (
            lambda b, now: (hear(b, reason='not_monitoring'), now.append(now.pop() + 60.0)),
            'Not monitoring: test is not active',
        ),
        (
            lambda b, now: (
                b.take_alarms(record([])),
                now.append(now.pop() + 200.0),
                hear(b),
            ),
            'The list of alarms of test is 200 s old',
        ),
    ],
)
def test_never_all_clear_by_mistake(
    board: DashboardState, now: list[float], happens: Any, words: str
) -> None:
    happens(board.monitors[0], now)
    assert not board.there
    assert words in ' '.join(board.monitor()['faults'])


def test_a_bearing_that_the_node_does_not_have_is_told(now: list[float]) -> None:
    board = board_of(now, VIEW, replace(VIEW, name='fore'))
    board.monitors[0].take_alarms(record([]))
    hear(board.monitors[0])
    assert (board.heard, board.there) == (True, False)
    assert board.faults() == ['Of fore nothing is heard: test does not watch it.']
    reader = board.hub.join()
    hear(board.monitors[0], 'fore')
    assert board.there
    assert b'"faults":[]' in reader._waiting['monitor ']


def test_what_cannot_be_delivered_is_said(board: DashboardState) -> None:
    request = ActionRequest(Action.ACKNOWLEDGE, 'Ada')
    with pytest.raises(DashboardError, match='the list of alarms has not come'):
        asyncio.run(board.ask(request, 0.01))


def test_the_log_outlives_a_restart_and_has_everything_once(tmp_path: Path) -> None:
    def log() -> tuple[EventLog, StateWriter]:
        store = StateWriter(StateFile(str(tmp_path / 'log.json'), '--log', 'dashboard'))
        return EventLog(store), store

    first, store = log()
    first.extend([change(k) | {'what': f'{k}'} for k in range(3)])
    # Nobody else writes there meanwhile.
    with pytest.raises(RosError, match='is in use by another dashboard'):
        log()
    store.close()
    # The latched topic tells the newest again.
    second, store = log()
    second.extend([change(k) | {'what': f'{k}'} for k in range(2, 5)])
    assert [entry['what'] for entry in second.latest()] == ['0', '1', '2', '3', '4']
    store.close()
    rows = list(csv.reader(io.StringIO(log()[0].csv())))
    assert [row[5] for row in rows] == ['what', '0', '1', '2', '3', '4']
    assert rows[1][0] == '1970-01-01T00:00:00.000Z'


def test_a_log_that_cannot_be_written_is_told(board: DashboardState, tmp_path: Path) -> None:
    folder = tmp_path / 'folder'
    folder.mkdir()
    store = StateWriter(StateFile(str(folder / 'log.json'), '--log', 'dashboard'))
    board.log = EventLog(store)
    shutil.rmtree(folder)
    board.log.extend([change(1)])
    end = time.monotonic() + 30.0
    while not board.notices():
        assert time.monotonic() < end
        time.sleep(0.01)
    assert 'The log is not kept' in board.notices()[0]
    store.close()


def test_what_the_node_says_of_itself_is_told(board: DashboardState) -> None:
    monitor = board.monitors[0]
    hear(board.monitors[0])
    monitor.take_alarms(record([]) | {'notes': [{'time': 5 * 10**6, 'what': 'node', 'text': 'T'}]})
    monitor.take_health(0, 'Monitoring.')
    assert board.notices() == []
    monitor.take_health(2, '3 callbacks failed, last: division by zero')
    assert board.monitor()['notices'] == ['test: 3 callbacks failed, last: division by zero']
    assert board.there
    (entry,) = board.state()['log']
    assert (entry['time'], entry['node'], entry['text'], entry['alarm']) == (5, 'test', 'T', '')


def test_a_map_grows_to_contain_the_running_speed(now: list[float]) -> None:
    made = []

    def wider(speed: float, load: float) -> BearingView:
        made.append((speed, load))
        return replace(view, speeds=(0.0, speed), loads=(0.0, load))

    view = replace(VIEW, wider=wider)
    board = board_of(now, view)
    take = board.monitors[0].take_status
    # A single wrong sample is no reason.
    for k, speed in enumerate((0.5, 50.0, 0.5, 0.5, -2.0, -3.0, -2.5, -2.0, -2.0)):
        take('aft_stern', k * 10**9, '', values(speed, 0.5))
        board.tick()
    assert made == [(2.4, 1.0)]
    assert board.state()['bearings'][0]['speeds'] == (0.0, 2.4)


def twins(now: list[float]) -> DashboardState:
    """The same bearing in the namespaces of two nodes."""
    return DashboardState(
        WatchedMonitor(f'/{side}/monitor', [VIEW], side, clock=lambda: now[0])
        for side in ('port', 'starboard')
    )


def test_twin_screws_are_two_things(now: list[float]) -> None:
    board = twins(now)
    port, starboard = board.monitors
    asked: list[Any] = []
    port.act, starboard.act = lambda r: asked.append(('port', r)), lambda r: None
    for monitor in board.monitors:
        monitor.take_status('aft_stern', 0, 'aft_stern: fine', values(1.0, 1.0))
    waiting = alarm(state='unacknowledged', active=True, text='aft_stern: bad')
    port.take_alarms(record([]) | {'alarms': [waiting], 'unacknowledged': 1})
    assert board.heard
    assert not board.there
    starboard.take_alarms(record([]) | {'alarms': [alarm()]})
    assert board.there
    assert board.alarms is not None
    assert board.alarms['unacknowledged'] == 1
    assert [(a['bearing'], a['state']) for a in board.alarms['alarms']] == [
        ('port/aft_stern', 'unacknowledged'),
        ('starboard/aft_stern', 'normal'),
    ]
    assert board.alarms['alarms'][0]['text'] == 'port/aft_stern: bad'
    request = ActionRequest(Action.ACKNOWLEDGE, 'Ada', 'port/aft_stern', AlarmKind.STICK_SLIP)
    with pytest.raises(DashboardError, match='has not answered'):
        asyncio.run(board.ask(request, 0.01))
    assert asked == [('port', replace(request, bearing='aft_stern'))]
    other = replace(request, bearing='starboard/aft_stern')
    with pytest.raises(DashboardError, match='there is nothing to acknowledge'):
        asyncio.run(board.ask(other, 0.01))


@pytest.mark.parametrize('dead', [0, 1])
def test_the_healthy_twin_never_covers_the_other(now: list[float], dead: int) -> None:
    board = twins(now)
    for monitor in board.monitors:
        monitor.take_alarms(record([]) | {'alarms': [alarm()]})
        monitor.take_status('aft_stern', 0, '', values(1.0, 1.0))
    assert board.there
    now[0] += 4.0
    board.monitors[1 - dead].take_status('aft_stern', 0, '', values(1.0, 1.0))
    side = ('port', 'starboard')[dead]
    assert (board.heard, board.there) == (True, False)
    assert board.faults() == [f'The monitor /{side}/monitor has been silent for 4 s.']
    assert board.monitor()['unheard'] == [f'{side}/aft_stern']


def test_a_lost_input_is_a_gap_in_the_history(board: DashboardState) -> None:
    take = board.monitors[0].take_status
    take('aft_stern', 10**9, '', values(1.0, 2.0) | {'fold margin': '0.5'})
    stale = {'fold margin': '0.5', 'speed age [s]': '9'}
    take('aft_stern', 2 * 10**9, '', values(1.0, 2.0) | stale)
    history = board.history('aft_stern')
    assert history is not None
    assert [row[1:4] for row in history['rows']] == [[1.0, 2.0, 0.5], [None, 2.0, None]]
