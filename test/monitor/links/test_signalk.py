# SPDX-License-Identifier: Apache-2.0
"""The rules of Signal K by tables: samples in, alarms out, and whose act an echo is."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from stickslip_logs.field_paths import signalk_source
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.links.links_config import BusInput
from stickslip_monitor.links.signalk import Notifications, SignalKInputs, SignalKValues
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import AlarmKind
from stickslip_monitor.monitor.sample_types import Input

SHIP = 'vessels.urn:mrn:imo:mmsi:230099999'
PATH = 'propulsion.port.revolutions'
HELLO = {'name': 'signalk-server', 'version': '2.23.0', 'self': SHIP, 'timestamp': '2026-11-21T22:00:00.000Z'}


def make_delta(
    value: Any, second: float = 0.0, source: str = 'shaft.1', path: str = PATH, context: str = SHIP
) -> dict[str, Any]:
    """Return one value, stamped so many seconds after the greeting."""
    minute, remainder = divmod(second, 60.0)
    stamp = f'2026-11-21T22:{int(minute):02}:{remainder:06.3f}Z'
    if second < 0.0:
        stamp = f'2026-11-21T21:59:{60.0 + second:06.3f}Z'
    values = [{'path': path, 'value': value}]
    return {'context': context, 'updates': [{'$source': source, 'timestamp': stamp, 'values': values}]}


class Reader:
    """Inputs at a server that greeted at 100 s of our clock."""

    def __init__(self) -> None:
        speed = BusInput(bus='signalk', bearing='aft', place=Input.SPEED, path=PATH)
        forward = BusInput(bus='signalk', bearing='fwd', place=Input.SPEED, path=PATH)
        self.inputs = SignalKInputs([speed, forward], print)
        self.inputs.greet(HELLO, 100.0)

    def take(self, frame: object, second: float = 0.0) -> list[float]:
        """Return the values that the first bearing gets."""
        samples = self.inputs.take(frame, 100.0 + second)
        return [value for bearing, _, value, _ in samples if bearing == 'aft']


@pytest.mark.parametrize(
    ('value', 'expected'),
    [
        (1.2433, 1.2433),
        (-3, -3.0),
        (0, 0.0),
        (None, math.nan),
        ('74.6', math.nan),
        (True, math.nan),
        ({'value': 3}, math.nan),
        ([3.0], math.nan),
        (10**400, math.nan),
    ],
)
def test_a_value_that_is_no_number_is_no_rest(value: Any, expected: float) -> None:
    assert Reader().take(make_delta(value)) == pytest.approx([expected], nan_ok=True)


def make_meta(unit: str) -> dict[str, Any]:
    """Return what the server says of the path, as version 2.23 sends it with sendMeta=all."""
    return {'context': SHIP, 'updates': [{'meta': [{'path': PATH, 'value': {'units': unit}}]}]}


@pytest.mark.parametrize(
    ('unit', 'expected', 'result'),
    [
        ('rpm', 74.6 / 60.0, 'converted to Hz'),
        ('rad/s', 74.6 / (2.0 * math.pi), 'converted to Hz'),
        ('bar', math.nan, 'and it is read in Hz: not used'),
    ],
)
def test_a_number_in_another_unit_is_converted_as_in_a_log(
    unit: str, expected: float, result: str, capsys: pytest.CaptureFixture[str]
) -> None:
    reader = Reader()
    reader.take(make_meta(unit))
    reader.take(make_meta(unit))
    assert reader.take(make_delta(74.6)) == pytest.approx([expected], nan_ok=True)
    assert capsys.readouterr().out == f"Signal K {PATH}: its unit is '{unit}', {result}\n"
    reader.take(make_meta('Hz'))
    assert reader.take(make_delta(1.2433)) == [1.2433]


@pytest.mark.parametrize(
    'frame',
    [
        make_meta(''),
        make_delta(3.0) | make_meta(''),
        json.loads(json.dumps(make_meta('rpm')).replace('port', 'starboard')),
    ],
)
def test_meta_data_without_a_unit_or_of_another_path_change_nothing(frame: Any) -> None:
    reader = Reader()
    reader.take(frame)
    assert reader.take(make_delta(1.2433)) == [1.2433]


@pytest.mark.parametrize('context', [SHIP, 'vessels.self'])
def test_a_server_that_greets_without_the_word_vessels_is_heard(context: str) -> None:
    reader = Reader()
    reader.inputs.greet(HELLO | {'self': SHIP.removeprefix('vessels.')}, 100.0)
    assert reader.take(make_delta(1.0, context=context)) == [1.0]


@pytest.mark.parametrize(
    'frame',
    [
        "Only 'instant' and 'fixed' policies supported",
        HELLO,
        None,
        [],
        3,
        {'updates': 3},
        {'updates': [3, {'values': 3}, {'values': [3, {'value': 3}, {'path': 3}]}]},
        make_delta(3.0, context='vessels.urn:mrn:imo:mmsi:111'),  # somebody else's shaft, by AIS
        make_delta(3.0, path='propulsion.port'),
    ],
)
def test_frames_that_bring_nothing(frame: object) -> None:
    assert Reader().take(frame) == []


def test_a_value_that_the_server_had_kept_is_dropped_once() -> None:
    reader = Reader()
    assert reader.take(make_delta(3.0, second=-45.0), 0.1) == []
    assert reader.take(make_delta(3.1, second=-44.0), 0.2) == [3.1]  # a clock that is slow all the time
    assert reader.take(make_delta(3.2, second=-4.0, source='young'), 0.3) == []  # another sends
    reader = Reader()
    assert reader.take(make_delta(3.0, second=-4.0), 0.5) == [3.0]
    reader.inputs.greet({**HELLO, 'timestamp': '2026-11-21T22:01:00.000Z'}, 160.0)
    assert reader.take(make_delta(3.0, second=1.0), 60.1) == []  # after a reconnection once more
    frame = make_delta(3.0)
    frame['updates'][0]['timestamp'] = 'yesterday'
    assert Reader().take(frame) == []


def test_stamps_are_those_of_the_sender() -> None:
    """They tell a copy, of the same stamp and value, from a clock that stands."""
    reader = Reader()
    for value in (3.0, 3.0, 3.1):
        ((*_, stamp), _) = reader.inputs.take(make_delta(value, second=1.0), 101.0)
        assert stamp == 1_795_298_401 * 10**9  # 2026-11-21T22:00:01Z
    bad = make_delta(3.0)
    bad['updates'][0]['timestamp'] = 'noon'
    ((*_, stamp), _) = reader.inputs.take(bad, 102.0)
    assert stamp is None


RECORD = {
    'reason': 'stick_slip',
    'regime': 'stick_slip',
    'fold_margin': -0.508878146,
    'hopf_margin': None,
    'amplitude_exact': 0.00092,
    'load': 1000.0,
}
AT = 'propulsion.port.shaft.aftStern.'


@pytest.mark.parametrize(
    ('record', 'expected'),
    [
        (RECORD, [-0.508878146, None, 0.00092, 1000.0, 'stick_slip']),
        ({**RECORD, 'amplitude_exact': None}, [-0.508878146, None, 0.0, 1000.0, 'stick_slip']),
        ({**RECORD, 'reason': 'input_stale'}, [None] * 5),  # what was is not what is
        ({**dict.fromkeys(RECORD), 'reason': 'waiting'}, [None] * 5),
        (None, [None] * 5),
    ],
)
def test_values(record: dict[str, Any] | None, expected: list[Any]) -> None:
    out = SignalKValues('propulsion.port.shaft', ['aft_stern'])
    update = json.loads(json.dumps(out.make_update('aft_stern', record), allow_nan=False))
    assert update['$source'] == 'stickslip_monitor'
    names = ['foldMargin', 'hopfMargin', 'stickSlipAmplitude', 'load', 'regime']
    values = {item['path']: item['value'] for item in update['values']}
    assert values == {AT + name: value for name, value in zip(names, expected, strict=True)}
    assert len(values) == len(update['values'])


def test_meta_has_units_and_no_zones_and_a_load_of_theirs_is_not_ours() -> None:
    out = SignalKValues('propulsion.port.shaft', [])
    meta = {item['path']: item['value'] for item in out.make_meta('aft_stern')['meta']}
    assert {path: value['units'] for path, value in meta.items()} == {
        f'{AT}foldMargin': 'ratio',
        f'{AT}hopfMargin': 'ratio',
        f'{AT}stickSlipAmplitude': 'm',
    }
    assert {value['timeout'] for value in meta.values()} == {5}
    assert 'zones' not in json.dumps(meta)


def test_two_bearings_have_two_paths() -> None:
    with pytest.raises(ConfigurationError) as error:
        Notifications(['stern1', 'stern_1'], 'p', 'run')
    assert "'stern1' and 'stern_1' have one Signal K path, notifications.p.stern1." in str(error.value)


STICK = 'notifications.p.aft.stickSlip'


class Server:
    """A server that stores notifications and echoes them."""

    def __init__(self, resets: bool = True) -> None:
        self.resets = resets
        self.out = Notifications(['aft'], 'p', 'run')
        self.status: dict[tuple[str, str], dict[str, bool]] = {}
        self.values: dict[tuple[str, str], dict[str, Any]] = {}
        self.requests: list[ActionRequest] = []

    def alarm(
        self,
        state: str,
        kind: AlarmKind = AlarmKind.STICK_SLIP,
        silenced: bool = False,
        text: str = 'aft: text',
    ) -> list[dict[str, Any]]:
        """Change the list of alarms; take and echo what is sent until all is quiet."""
        alarm = {
            'bearing': 'aft',
            'alarm': kind.value,
            'state': state,
            'sounding': state == 'unacknowledged' and not silenced,
            'silenced': silenced,
            'text': text,
        }
        updates = self.out.take_alarms({'alarms': [alarm]})
        sent = list(updates)
        while updates:
            updates = [u for update in updates for u in self.echo(*self.store(update))]
            sent += updates
        return [{'source': u['$source'], **u['values'][0]['value']} for u in sent]

    def store(self, update: dict[str, Any]) -> tuple[str, str]:
        key = update['$source'], update['values'][0]['path']
        value = self.values[key] = dict(update['values'][0]['value'])
        status = self.status.setdefault(key, {'acknowledged': False, 'silenced': False})
        if value['state'] == 'normal' and self.resets:
            status.update(acknowledged=False, silenced=False)
        if value.get('acknowledgeStatus') == 'Yes':
            status['acknowledged'] = True
        return key

    def echo(self, source: str, path: str = STICK) -> list[dict[str, Any]]:
        """Echo a notification, as the server does."""
        value = {**self.values[source, path], 'status': dict(self.status[source, path])}
        updates, requests = self.out.take_echo(make_delta(value, source=source, path=path), SHIP)
        self.requests += requests
        return updates


@pytest.mark.parametrize(
    ('kind', 'state', 'silenced', 'expected'),
    [
        ('stick_slip', 'unacknowledged', False, ('alarm', ['visual', 'sound'], None)),
        ('bistable', 'unacknowledged', False, ('warn', ['visual', 'sound'], None)),
        ('margin_low', 'unacknowledged', False, ('alert', ['visual', 'sound'], None)),
        ('stick_slip', 'unacknowledged', True, ('alarm', ['visual'], 'temporarySilenceStatus')),
        ('stick_slip', 'acknowledged', False, ('alarm', [], 'acknowledgeStatus')),
        ('stick_slip', 'latched', False, ('alarm', [], 'acknowledgeStatus')),
        ('stick_slip', 'returned_unacknowledged', False, ('alarm', ['visual'], None)),
        ('stick_slip', 'shelved', False, ('normal', [], None)),
        ('stick_slip', 'suppressed', False, ('normal', [], None)),
        ('stick_slip', 'out_of_service', False, ('normal', [], None)),
    ],
)
def test_every_state_as_a_notification(
    kind: str, state: str, silenced: bool, expected: tuple[str, list[str], str | None]
) -> None:
    value = Server().alarm(state, AlarmKind(kind), silenced)[-1]
    flag = {'temporarySilenceStatus', 'acknowledgeStatus'} & set(value)
    assert (value['state'], value['method'], flag) == (*expected[:2], {expected[2]} if expected[2] else set())
    assert value['data']['lifecycle'] == state
    messages = {'returned_unacknowledged': 'Over: aft: text'}
    expected_message = '' if value['state'] == 'normal' else 'aft: text'
    assert value['message'] == messages.get(state, expected_message)


def test_rounds_at_a_server_that_forgets_no_acknowledgement() -> None:
    """Invent no acknowledgement and lose none, as 2.23 forgets those of a source."""
    server = Server(resets=False)
    expected = [ActionRequest(Action.ACKNOWLEDGE, 'signal k', 'aft', AlarmKind.STICK_SLIP)]
    for _ in range(3):
        server.requests = []
        source = server.alarm('unacknowledged')[-1]['source']
        assert server.requests == []
        assert server.status[source, STICK]['acknowledged'] is False
        server.status[source, STICK]['acknowledged'] = True
        assert (server.echo(source), server.requests) == ([], expected)
        server.alarm('acknowledged')
        server.alarm('normal')


def test_an_echo_of_an_earlier_occurrence_or_run_is_no_request() -> None:
    server = Server()
    server.alarm('unacknowledged')
    earlier = dict(server.values['stickslip_monitor', STICK])
    server.alarm('acknowledged')
    server.alarm('normal')
    server.alarm('unacknowledged')
    for token in (earlier['data']['occurrence'], 'before-3', None):
        value = {**earlier, 'data': {'occurrence': token}, 'status': {'acknowledged': True}}
        frame = make_delta(value, source='stickslip_monitor', path=STICK)
        assert server.out.take_echo(frame, SHIP) == ([], [])
    # One that an earlier run left under a source of its own is put to rest there.
    frame = make_delta(earlier, source='stickslip_monitor.before-3', path=STICK)
    ((update,), requests) = server.out.take_echo(frame, SHIP)
    assert requests == []
    assert update['$source'] == 'stickslip_monitor.before-3'
    assert update['values'][0]['value']['state'] == 'normal'
    # Of somebody else's source nothing is said.
    assert server.out.take_echo(make_delta(earlier, source='gps', path=STICK), SHIP) == ([], [])


def test_an_alarm_that_latched_and_comes_again_passes_through_normal() -> None:
    server = Server()
    for state in ('unacknowledged', 'acknowledged', 'latched'):
        server.alarm(state)
    states = [(v['state'], v['method']) for v in server.alarm('unacknowledged')]
    assert states == [('normal', []), ('alarm', ['visual', 'sound'])]


def test_a_sound_that_an_older_client_took_away_is_a_silence() -> None:
    server = Server()
    server.alarm('unacknowledged')
    value = server.values['stickslip_monitor', STICK]
    old = dict(value)
    value['method'] = []
    assert server.echo('stickslip_monitor') == []
    silence = ActionRequest(Action.SILENCE, 'signal k', 'aft', AlarmKind.STICK_SLIP)
    assert server.requests == [silence]
    server.alarm('unacknowledged', silenced=True)
    server.alarm('unacknowledged')
    # The echo of what was sent before, without sound, comes late.
    delayed = {**old, 'method': ['visual'], 'status': {}}
    frame = make_delta(delayed, source='stickslip_monitor', path=STICK)
    assert server.out.take_echo(frame, SHIP) == ([], [])


@pytest.mark.parametrize(
    ('update', 'source'),
    [
        ({'$source': 'N2K.17', 'source': {'label': 'x'}}, 'N2K.17'),
        # As getSourceId of the specification's own package makes them.
        ({'source': {'label': 'N2K', 'type': 'NMEA2000', 'src': '17', 'pgn': 127488}}, 'N2K.17'),
        ({'source': {'label': 'GPS', 'type': 'NMEA0183', 'talker': 'GP', 'sentence': 'RMC'}}, 'GPS.GP'),
        ({'source': {'label': 'shaft'}}, 'shaft.XX'),
        ({}, ''),
    ],
)
def test_the_source_of_an_update_of_signal_k(update: dict[str, Any], source: str) -> None:
    assert signalk_source(update) == source
