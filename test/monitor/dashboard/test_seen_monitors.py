# SPDX-License-Identifier: Apache-2.0
"""What comes from a monitor that may say anything, and what is kept of it."""

from __future__ import annotations

import asyncio
import csv
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG

from stickslip_monitor.dashboard.event_log import LOG_FAMILY, MAX_ENTRIES, MAX_SHOWN, EventLog
from stickslip_monitor.dashboard.page_records import NUMBERS, OFFERED, checked_alarms, checked_record
from stickslip_monitor.dashboard.seen_monitors import SPAN, STEP, BearingView, DashboardState, WatchedMonitor
from stickslip_monitor.errors import DashboardError, RosError
from stickslip_monitor.monitor.alarm_list import Action, Annunciator
from stickslip_monitor.monitor.alarm_records import ActionRequest, alarms_record
from stickslip_monitor.monitor.alarm_states import AlarmKind, AlarmState
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.state_file import StateWriter

VIEW = BearingView('aft_stern', 190.0, (0.0, 1.0), (0.0, 1.0), {}, 0.1, None, {})
Happening = Callable[[WatchedMonitor, list[float]], Any]


@pytest.fixture
def now() -> list[float]:
    return [100.0]


@pytest.fixture
def board(now: list[float]) -> DashboardState:
    return board_of(now, VIEW)


def board_of(now: list[float], *views: BearingView) -> DashboardState:
    return DashboardState([WatchedMonitor('test', views, clock=lambda: now[0])])


def bearing_status(bearing: str = 'aft_stern', time_ns: int = 0, **changes: Any) -> dict[str, Any]:
    """Return the record of a bearing."""
    record = {'bearing': bearing, 'time': time_ns, 'text': 'fine', 'reason': 'normal'}
    inputs = {name: {'lost': False, 'counts': {'accepted': 1}} for name in ('speed', 'load')}
    return record | {'speed': 1.0, 'load': 1.0, 'inputs': inputs} | changes


def alarm_change(time_ms: int, **changes: Any) -> dict[str, Any]:
    texts = ('bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
    return dict.fromkeys(texts, 'x') | {'time': time_ms} | changes


def alarm_row(**changes: Any) -> dict[str, Any]:
    texts = {'bearing': 'aft_stern', 'alarm': 'stick_slip', 'priority': 'alarm'}
    return texts | {'state': 'normal', 'by': '', 'text': ''} | changes


def alarm_table(*alarms: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Return a list of alarms."""
    counts = {'time': 10**9, 'sounding': False, 'unacknowledged': 0, 'flood': {}, 'changes': []}
    counts |= {'rows': [], 'notes': []}
    return {'schema': 'stickslip_monitor/alarm/1', **counts, 'alarms': list(alarms)} | changes


def acknowledge_request(by: str = 'Ada', bearing: str | None = 'aft_stern') -> ActionRequest:
    return ActionRequest(Action.ACKNOWLEDGE, by, bearing, AlarmKind.STICK_SLIP)


def test_a_value_that_is_no_number_is_dropped() -> None:
    record = checked_record(
        bearing_status(
            speed='fast',
            load=float('inf'),
            rpm=True,
            growth_rate=10**400,
            sticking='no',
            inputs={'speed': {}},
        )
    )
    assert [record[name] for name in NUMBERS] == [None] * len(NUMBERS)
    assert record['sticking'] is None
    speed = record['inputs']['speed']
    assert not any(speed.pop('counts').values())
    assert speed == {'lost': False, 'age': None, 'rate': None, 'fault': ''}


def test_values_that_no_browser_can_show_are_dropped() -> None:
    """Drop inputs that no bearing has, counts beyond a float, and dates after the last of JavaScript."""
    last_ms = 8_640_000_000_000_000  # of ECMAScript, section 'Time Values and Time Range'
    input_record = {'lost': False, 'counts': {'accepted': last_ms + 1, 'repeated': -1, 'no_value': last_ms}}
    record = checked_record(
        bearing_status(inputs={'"] img': input_record, 'load': input_record}, held_until=10**40)
    )
    assert list(record['inputs']) == ['load']
    counts = record['inputs']['load']['counts']
    assert (counts['accepted'], counts['repeated'], counts['no_value']) == (0, 0, last_ms)
    assert record['held_until'] is None
    assert checked_record(bearing_status(time_ns=last_ms * 10**6))['time'] == last_ms
    assert checked_record(bearing_status(time_ns=(last_ms + 1) * 10**6)) is None


def test_memory_is_bounded(board: DashboardState) -> None:
    take = board.monitors[0].take_record
    rows = SPAN // STEP
    for k in range(2 * rows):
        take(bearing_status(time_ns=k * 10**9, speed=float(k)))
        take(bearing_status(time_ns=k * 10**9 + 5 * 10**8, speed=float(k), load=2.0))
    history = board.history('aft_stern')
    assert [row[1:3] for row in history['rows']] == [[float(k), 2.0] for k in range(rows, 2 * rows)]
    # A clock that steps back leaves nothing that lies ahead of it.
    take(bearing_status(time_ns=(2 * rows - 5) * 10**9, speed=7.0))
    remaining = board.history('aft_stern')
    assert [row[1] for row in remaining['rows'][-2:]] == [2.0 * rows - 6.0, 7.0]
    assert board.history('fore') is None
    for k in range(MAX_ENTRIES + 2 * MAX_SHOWN):
        board.log.extend([alarm_change(k)])
    assert [c['time'] for c in board.state()['log']] == list(
        range(MAX_ENTRIES + MAX_SHOWN, MAX_ENTRIES + 2 * MAX_SHOWN)
    )
    assert len(board.log.to_csv().splitlines()) == 1 + MAX_ENTRIES


def test_a_lost_input_is_a_gap_in_the_history(board: DashboardState) -> None:
    board.monitors[0].take_record(bearing_status(time_ns=10**9, fold_margin=0.5))
    lost = {'speed': {'lost': True}, 'load': {'lost': False}}
    board.monitors[0].take_record(bearing_status(time_ns=2 * 10**9, fold_margin=0.5, inputs=lost))
    history = board.history('aft_stern')
    place = history['columns'].index('fold_margin')
    assert [[*row[1:3], row[place]] for row in history['rows']] == [[1.0, 1.0, 0.5], [None, 1.0, None]]


@pytest.mark.parametrize(
    'document',
    [
        None,
        [],
        {},
        *(bearing_status(text=None), bearing_status(time='now'), bearing_status(inputs=[])),
        *(alarm_table(schema='stickslip_monitor/alarm/2'), alarm_table(time='now'), alarm_table(alarms=None)),
        *(alarm_table(alarm_row(state=None)), alarm_table(changes=[{}]), alarm_table(rows=[7])),
    ],
)
def test_invalid_records_change_nothing(board: DashboardState, document: Any) -> None:
    board.monitors[0].take_record(document)
    board.monitors[0].take_alarms(document)
    assert not board.presence()['there']
    assert board.alarms is None


def test_the_offered_actions_are_those_with_an_effect() -> None:
    """Apply each offered action to a real alarm in that state: it changes the alarm, and no other does."""
    config = load_config(CONFIG)
    for state in AlarmState:
        for action in OFFERED:
            annunciator = Annunciator(config)
            live = annunciator.alarms['aft_stern'][AlarmKind.STICK_SLIP]
            live.state, live.active = state, state is AlarmState.UNACKNOWLEDGED
            checked = checked_alarms(alarms_record(annunciator, [], 0, 1), ['aft_stern'])
            (row,) = [a for a in checked['alarms'] if a['alarm'] == 'stick_slip']
            changes = annunciator.act(action, 0, 'Ada', 'aft_stern', AlarmKind.STICK_SLIP)
            quiet = state in (AlarmState.NORMAL, AlarmState.SUPPRESSED) and action is Action.SHELVE
            assert (action.value in row['actions']) == (bool(changes) and not quiet)


def test_one_matter_is_one_row(board: DashboardState) -> None:
    """Give a bearing one row with its worst alarm, and all actions on any of its alarms."""
    alarms = [
        alarm_row(alarm='margin_low', priority='caution', state='acknowledged'),
        alarm_row(alarm='bistable', priority='warning', state='unacknowledged'),
        alarm_row(alarm='stick_slip', priority='alarm', state='unacknowledged', sounding=True),
        alarm_row(alarm='amplitude_limit', state='shelved'),
        alarm_row(alarm='vibration', state='normal'),
    ]
    worst = alarm_row(state='unacknowledged', text='now', came_back=4, came_back_since=5 * 10**6)
    board.monitors[0].take_alarms(alarm_table(*alarms, rows=[worst, alarm_row(bearing='fore')]))
    (row,) = board.alarms['rows']
    assert row['actions'] == ['acknowledge', 'silence', 'shelve']
    assert (row['text'], row['came_back'], row['came_back_since']) == ('now', 4, 5)


def test_an_action_of_another_person_is_no_answer(board: DashboardState) -> None:
    waiting = alarm_row(state='unacknowledged', sounding=True)
    (monitor,) = board.monitors
    with pytest.raises(DashboardError, match='the list of alarms has not come'):
        asyncio.run(board.ask(acknowledge_request(), 0.01))
    monitor.take_alarms(alarm_table(waiting))
    done = alarm_change(1, bearing='aft_stern', alarm='stick_slip', by='Ada', what='acknowledge')
    monitor.act = lambda _: monitor.take_alarms(alarm_table(waiting, changes=[done]))
    assert asyncio.run(board.ask(acknowledge_request('Ada'), 0.01)) == 1
    with pytest.raises(DashboardError, match='it may not have been done'):
        asyncio.run(board.ask(acknowledge_request('Bob'), 0.01))


def send_records(monitor: WatchedMonitor, *bearings: str, **changes: Any) -> None:
    for bearing in bearings or ('aft_stern',):
        monitor.take_record(bearing_status(bearing, **changes))


def pass_seconds(now: list[float], seconds: float) -> None:
    now[0] += seconds


FOREIGN = 'fore: watched by test, but not in --config'
IDLE = 'Not monitoring: test is not active'
DOUBTS: list[tuple[Happening, str]] = [
    (lambda m, now: None, 'No data from the monitor test yet.'),
    (lambda m, now: m.take_other('port/monitor'), 'Other monitors run: /port/monitor; see --node'),
    (lambda m, now: send_records(m), 'No list of alarms from test yet'),
    (lambda m, now: (send_records(m, 'fore'), m.take_alarms(alarm_table())), 'No data from'),
    (lambda m, now: send_records(m, 'aft_stern', 'fore'), FOREIGN),
    (lambda m, now: (send_records(m), m.take_alarms(alarm_table(alarm_row(bearing='fore')))), FOREIGN),
    (lambda m, now: (send_records(m), m.take_alarms(alarm_table(monitoring=False))), IDLE),
    (lambda m, now: (send_records(m, reason='not_monitoring'), pass_seconds(now, 60.0)), IDLE),
    (
        lambda m, now: (m.take_alarms(alarm_table()), send_records(m), pass_seconds(now, 3.1)),
        'The monitor test has been silent for 3 s.',
    ),
    (
        lambda m, now: (m.take_alarms(alarm_table()), pass_seconds(now, 200.0), send_records(m)),
        'The list of alarms of test is 3.3 min old',
    ),
]


@pytest.mark.parametrize(('happens', 'words'), DOUBTS)
def test_never_all_clear_by_mistake(
    board: DashboardState, now: list[float], happens: Happening, words: str
) -> None:
    happens(board.monitors[0], now)
    assert words in ' '.join(board.presence()['faults'])


def test_a_bearing_that_the_node_does_not_have_is_named(now: list[float]) -> None:
    board = board_of(now, VIEW, replace(VIEW, name='fore'))
    board.monitors[0].take_alarms(alarm_table(alarm_row(bearing='bow'), alarm_row()))
    assert [a['bearing'] for a in board.alarms['alarms']] == ['aft_stern']
    board.monitors[0].take_alarms(alarm_table())
    send_records(board.monitors[0])
    assert board.presence()['there']
    assert 'No data on fore: test does not watch it.' in board.presence()['faults']


def test_entries_of_two_nodes_are_in_order_of_time_and_those_of_one_in_their_own() -> None:
    # One node is received late; the clock of the other was set back by a minute, which changes nothing.
    log = EventLog()
    log.extend({'node': '/a', 'time': t, 'text': str(t)} for t in (10, 30, 50, 5, 70))
    log.extend({'node': '/b', 'time': t, 'text': str(t)} for t in (20, 40, None, 60))
    texts = [entry['text'] for entry in log.latest()]
    assert texts == ['10', '20', '30', '40', 'None', '50', '5', '60', '70']
    rows = list(csv.reader(io.StringIO(log.to_csv())))
    assert [row[-1] for row in rows[1:]] == texts


def test_the_log_outlives_a_restart_and_has_everything_once(tmp_path: Path) -> None:
    def log() -> tuple[EventLog, StateWriter]:
        store = StateWriter(str(tmp_path / 'log.json'), '--log', 'dashboard', LOG_FAMILY)
        return EventLog(store), store

    first, store = log()
    first.extend([alarm_change(k, what=f'{k}') for k in range(3)])
    # Nobody else writes there meanwhile.
    with pytest.raises(RosError, match='is in use by another dashboard'):
        log()
    store.close()
    # The latched topic tells the newest again.
    second, store = log()
    second.extend([alarm_change(k, what=f'{k}') for k in range(2, 5)])
    assert [entry['what'] for entry in second.latest()] == ['0', '1', '2', '3', '4']
    store.close()
    rows = list(csv.reader(io.StringIO(log()[0].to_csv())))
    assert [row[5] for row in rows] == ['what', '0', '1', '2', '3', '4']
    assert rows[1][0] == '1970-01-01T00:00:00.000Z'


@pytest.mark.parametrize(
    'content',
    [bytes(999), b'{"schema": "stickslip_monitor/log/2"}', b'{"schema": "stickslip_monitor/log/1"}'],
)
def test_a_damaged_log_is_put_aside_and_both_log_and_page_say_so(
    tmp_path: Path, now: list[float], content: bytes
) -> None:
    path = tmp_path / 'log.json'
    path.write_bytes(content)
    store = StateWriter(str(path), '--log', 'dashboard', LOG_FAMILY)
    log = EventLog(store)
    store.close()
    assert (tmp_path / 'log.json.damaged').read_bytes() == content
    assert log.damage.startswith(f'the log {path} is damaged: ')
    assert [entry['what'] for entry in log.latest()] == ['log']
    board = DashboardState([WatchedMonitor('test', [VIEW], clock=lambda: now[0])], log=log)
    assert board.presence()['notices'] == [log.damage]


def test_a_map_is_made_for_the_first_point_and_grows(now: list[float]) -> None:
    calls = []

    def wider(speed: float, load: float) -> BearingView:
        calls.append((speed, load))
        return replace(view, speeds=(0.0, speed), loads=(0.0, load))

    view = replace(VIEW, speeds=(0.0, 9.0), loads=(0.0, 9.0), wider=wider)
    board = board_of(now, view)
    # A single wrong sample is no reason.
    for k, speed in enumerate((0.5, 50.0, 0.5, 0.5, -2.0, -3.0, -2.5, -2.0, -2.0)):
        board.monitors[0].take_record(bearing_status(time_ns=k * 10**9, speed=speed))
        board.tick()
        assert len(calls) == 1 + (k == 8)
    assert calls == [(pytest.approx(0.6), 1.5), (pytest.approx(2.4), 1.5)]
    assert board.state()['bearings'][0]['speeds'] == (0.0, pytest.approx(2.4))


def twin_bearings(now: list[float]) -> DashboardState:
    """Return one bearing in the namespaces of two nodes."""
    return DashboardState(
        WatchedMonitor(f'/{side}/monitor', [VIEW], side, clock=lambda: now[0])
        for side in ('port', 'starboard')
    )


def test_twin_screws_are_two_things(now: list[float]) -> None:
    board = twin_bearings(now)
    port, starboard = board.monitors
    requests: list[Any] = []
    port.act, starboard.act = requests.append, lambda _: pytest.fail('the wrong ship side')
    for monitor in board.monitors:
        send_records(monitor, text='aft_stern: fine')
    waiting = alarm_row(state='unacknowledged', active=True, text='aft_stern: bad')
    port.take_alarms(alarm_table(waiting, unacknowledged=1, rows=[waiting]))
    assert board.presence()['there']
    assert board.presence()['faults']
    starboard.take_alarms(alarm_table(alarm_row()))
    assert (board.presence()['there'], board.presence()['faults']) == (True, [])
    assert board.alarms['unacknowledged'] == 1
    assert [(a['bearing'], a['state']) for a in board.alarms['alarms']] == [
        ('port/aft_stern', 'unacknowledged'),
        ('starboard/aft_stern', 'normal'),
    ]
    assert [row['text'] for row in board.alarms['rows']] == ['port/aft_stern: bad']
    with pytest.raises(DashboardError, match='no answer from the monitor'):
        asyncio.run(board.ask(acknowledge_request(bearing='port/aft_stern'), 0.01))
    assert requests == [acknowledge_request()]
    with pytest.raises(DashboardError, match='there is nothing to acknowledge'):
        asyncio.run(board.ask(acknowledge_request(bearing='starboard/aft_stern'), 0.01))


@pytest.mark.parametrize(
    ('fold', 'load', 'foreign'),
    [
        (0.3, 250.0, False),  # on the curve
        (0.3, 270.0, False),
        (0.3, 290.0, True),
        (0.3, 200.0, True),
        (0.5, 900.0, False),  # where the map has no fold
        (0.7, 900.0, False),  # beyond the map
        (None, 900.0, False),
        (0.3, None, False),
    ],
)
def test_a_map_of_other_parameters_is_reported(
    now: list[float], fold: float | None, load: float | None, foreign: bool
) -> None:
    # The page was started with another file than the node: its own curve leads through (0.3, 250).
    curves = {'speed': [0.2, 0.4, 0.6], 'fold': [100.0, 400.0, None]}
    board = board_of(now, replace(VIEW, curves=curves))
    board.monitors[0].take_record(bearing_status(fold_speed_kbm=fold, load=load))
    notices = ['aft_stern: the map is that of --config, and test has other parameters.']
    assert board.presence()['notices'] == notices * foreign
