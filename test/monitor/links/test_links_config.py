# SPDX-License-Identifier: Apache-2.0
"""The section of links: what it makes, and one sentence for whatever breaks a rule."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from shared import ROOT

from stickslip_monitor.commands.watch import load_watch
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.links.bus_inputs import BusInputs
from stickslip_monitor.links.links_config import BusInput
from stickslip_monitor.links.live_monitor import LiveMonitor
from stickslip_monitor.links.signalk import SignalKInputs
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import NoLog, Sink

EXAMPLE = ROOT / 'launch_configs' / 'examples' / 'ship.yaml'
PAGE = ROOT / 'docs' / 'ship.md'
REFERENCE = yaml.safe_load((ROOT / 'launch_configs' / 'reference_bearing.yaml').read_text())
BEARING = REFERENCE['/**']['ros__parameters']['aft_stern'] | {'speed': {'unit': 'Hz'}, 'load': {'unit': 'N'}}
SIGNALK = {
    'signalk.url': 'http://127.0.0.1:3000',
    'aft.speed': {'from': 'signalk', 'path': 'propulsion.port.revolutions'},
    'aft.load': {'from': 'signalk', 'path': 'propulsion.port.shaft.aft.load'},
}
TOPICS = {'speed': {'unit': 'Hz', 'topic': '/s'}, 'load': {'unit': 'kN', 'topic': '/l'}}
NMEA = {
    'nmea.listen': 'udp://127.0.0.1:10110',
    'aft.speed': {'from': 'nmea', 'sentence': 'RPM', 'kind': 'S', 'number': 2},
    'aft.load': {'from': 'nmea', 'sentence': 'XDR', 'kind': 'N', 'name': 'AFTLOAD'},
}


class Files:
    def __init__(self, folder: Path) -> None:
        self.path = folder / 'ship.yaml'

    def write(self, links: dict[str, Any] | None, **bearing: Any) -> str:
        document = {'/**': {'ros__parameters': {'bearings': ['aft'], 'aft': BEARING | bearing}}}
        if links is not None:
            document['/stickslip_links'] = {'ros__parameters': links}
        self.path.write_text(yaml.safe_dump(document))
        return str(self.path)


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def test_both_buses(files: Files) -> None:
    config, links = load_watch(files.write(SIGNALK | {'nmea.alerts': 'udp://10.0.0.9:1'}), None)
    assert links.signalk is not None
    assert links.nmea is not None
    assert not links.signalk.accept_actions
    assert not links.nmea.accept_actions
    assert links.of('signalk')[0].timeout == 5.0
    # What people read names the path; there is no topic.
    assert config.bearings[0].speed.topic == 'Signal K propulsion.port.revolutions'
    config, links = load_watch(files.write(NMEA, speed={'unit': 'rpm'}), None)
    assert links.signalk is None
    assert config.bearings[0].speed.topic == 'NMEA RPM S 2'
    assert config.bearings[0].load.topic == 'NMEA XDR AFTLOAD'


def test_the_example_and_the_docs_are_configurations(files: Files) -> None:
    config, links = load_watch(str(EXAMPLE), None)
    assert config.bearings[0].name == 'aft_stern'
    assert links.signalk is not None
    assert links.nmea is not None
    (block,) = re.findall(r'^```yaml\n(.*?)^```', PAGE.read_text('utf-8'), re.DOTALL | re.M)
    document = yaml.safe_load(EXAMPLE.read_text('utf-8')) | yaml.safe_load(block)
    document['/**']['ros__parameters']['aft_stern']['speed'] = {'unit': 'rpm'}
    files.path.write_text(yaml.safe_dump(document))
    _, links = load_watch(str(files.path), None)
    assert [item.label for item in links.of('nmea')] == ['NMEA RPM S 1', 'NMEA XDR AFTLOAD']


def test_beside_a_node_topics_are_the_nodes_and_inputs_may_come_from_elsewhere(files: Files) -> None:
    links = {key: value for key, value in SIGNALK.items() if key != 'aft.load'}
    config, links_config = load_watch(files.write(links, **TOPICS), '/stickslip_monitor')
    assert config.bearings[0].speed.topic == '/s'
    assert list(links_config.labels) == [('aft', Input.SPEED)]


WATERED = {'friction': BEARING['friction'] | {'at_temperature': 15.0}, 'water_temperature': {'unit': 'K'}}
WATER = {'aft.water_temperature': {'from': 'signalk', 'path': 'environment.water.temperature'}}


def test_the_temperature_of_the_water_comes_over_signal_k(files: Files) -> None:
    config, links = load_watch(files.write(SIGNALK | WATER, **WATERED), None)
    (water,) = (item for item in links.inputs if item.place is Input.WATER_TEMPERATURE)
    assert (water.label, water.timeout) == ('Signal K environment.water.temperature', 600.0)
    assert config.bearings[0].inputs['water_temperature'].topic == water.label
    inputs = SignalKInputs(links.of('signalk'), print)
    inputs.greet({'self': 'vessels.a', 'timestamp': '2026-11-21T22:00:00.000Z'}, 0.0)
    values = [{'path': 'environment.water.temperature', 'value': 278.15}]
    update = {'$source': 'x', 'timestamp': '2026-11-21T22:00:00.000Z', 'values': values}
    ((_, place, number, stamp_ns),) = inputs.take({'context': 'vessels.a', 'updates': [update]}, 0.0)
    session = LiveMonitor(config, Sink(), NoLog())
    session.begin()
    for input_place, value in ((Input.LOAD, 1e3), (place, number), (Input.SPEED, 2.0)):
        session.take('aft', input_place, value)
    bearing = session._session.monitor.bearings['aft']
    assert stamp_ns is not None
    assert 'water at 5 C, ' in bearing.text()


SPEED = 'aft.speed'
PATH = {'from': 'signalk', 'path': 'a.b'}
RPM = {'from': 'nmea', 'sentence': 'RPM', 'kind': 'S'}


@pytest.mark.parametrize(
    ('base', 'change', 'text'),
    [
        (SIGNALK, {'signalk.url': 'ws://127.0.0.1'}, "signalk.url = 'ws://127.0.0.1' must be an"),
        (SIGNALK, {'signalk.url': 'http://a:99999'}, 'must be an address such as http://127.0.0'),
        (SIGNALK, {'signalk.url': 'http://a/signalk/v1/stream'}, 'must be an address'),
        (
            SIGNALK,
            {'signalk.url': 'http://10.0.0.2:3000', 'signalk.token_file': 't'},
            'must be https://: a token would be sent for all to read',
        ),
        (SIGNALK, {'signalk.prefix': 'a..b'}, "signalk.prefix = 'a..b' must be a Signal K path"),
        (SIGNALK, {'signalk.accept_actions': True}, 'accept_actions = True must be false without'),
        (SIGNALK, {'signalk.tokenfile': 'x'}, "did you mean 'signalk.token_file'?"),
        (SIGNALK, {'fore.speed': PATH}, "unknown parameter 'fore.speed.from' = 'signalk'"),
        (SIGNALK, {SPEED: {'path': 'a.b'}}, "parameter 'aft.speed.from' is missing"),
        (SIGNALK, {SPEED: {'from': 'n2k'}}, "aft.speed.from = 'n2k' must be one of signalk, nmea"),
        (SIGNALK, {SPEED: PATH | {'path': 'a.*'}}, "aft.speed.path = 'a.*' must be"),
        (NMEA, {SPEED: RPM | {'sentence': 'RPN'}}, "aft.speed.sentence = 'RPN' must be RPM"),
        (NMEA, {SPEED: RPM | {'kind': 'P'}}, "aft.speed.kind = 'P' must be S for a shaft or E"),
        (NMEA, {SPEED: RPM}, "aft.speed.unit = 'Hz' must be rpm, in which RPM gives it"),
        (SIGNALK, {'signalk.url': ''}, "signalk.url = '' must be given: Signal K is used"),
        (NMEA, {'nmea.listen': 'udp://127.0.0.1'}, 'must be written udp://127.0.0.1:10110'),
        (NMEA, {'nmea.listen': 'usb://0'}, "nmea.listen = 'usb://0' must be an address such as"),
        (NMEA, {'nmea.listen': 'serial://ttyUSB0'}, 'must be serial:///dev/ttyUSB0'),
        (NMEA, {'nmea.alerts': 'serial:///dev/t?baud=1'}, 'with one of 4800, 9600'),
        (NMEA, {'nmea.talker': 'i'}, "nmea.talker = 'i' must be two upper-case letters"),
        (NMEA, {'nmea.manufacturer': 'ABCD'}, 'must be three upper-case letters, or empty'),
        (NMEA, {'nmea.first_alert': 0}, 'nmea.first_alert = 0 must be a whole number'),
    ],
)
def test_one_sentence_for_whatever_breaks_a_rule(
    files: Files, base: dict[str, Any], change: dict[str, Any], text: str
) -> None:
    unit = 'rpm' if base is NMEA and 'unit' not in text else 'Hz'
    path = files.write(base | change, speed={'unit': unit})
    with pytest.raises(ConfigurationError, match=re.escape(text)) as error:
        load_watch(path, None)
    assert str(error.value).startswith(path)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('address', 'is_safe'),
    [
        *((f'http://{host}', True) for host in ('[::1]', '127.0.0.1', '127.8.9.1', 'localhost')),
        *(
            (f'http://{host}', False)
            for host in ('[2001:db8::1]', '10.0.0.2', '128.0.0.1', 'localhost.example')
        ),
        ('https://10.0.0.2', True),
    ],
)
def test_a_token_goes_unencrypted_to_this_machine_only(files: Files, address: str, is_safe: bool) -> None:
    path = files.write(SIGNALK | {'signalk.url': f'{address}:3000', 'signalk.token_file': 't'})
    if is_safe:
        assert load_watch(path, None)[1].signalk is not None
    else:
        with pytest.raises(ConfigurationError, match='must be https://: a token would be sent'):
            load_watch(path, None)


@pytest.mark.parametrize(
    ('links', 'bearing', 'with_node', 'text'),
    [
        (SIGNALK, {'speed': {'unit': 'rpm'}}, False, "unit = 'rpm' must be Hz, in which Signal K"),
        (SIGNALK, {'load': {'unit': 't'}}, False, "aft.load.unit = 't' must be N, in which Signal K"),
        ({'nmea.talker': 'II'}, TOPICS, True, 'uses no bus: give'),
        (None, {}, False, "has no section '/stickslip_links:'"),
        ({k: v for k, v in SIGNALK.items() if k != 'aft.load'}, {}, False, "'aft.load' is missing"),
        (
            SIGNALK,
            WATERED | {'water_temperature': {'topic': '/w'}},
            False,
            "'aft.water_temperature' is missing",
        ),
        (
            SIGNALK | WATER,
            WATERED | {'water_temperature': {'unit': 'C'}},
            False,
            "unit = 'C' must be K, in which",
        ),
        (
            SIGNALK | WATER,
            TOPICS | {'load': {'unit': 'N', 'topic': '/l'}},
            True,
            "'aft.water_temperature.topic' is missing",
        ),
        (
            SIGNALK
            | NMEA
            | {'aft.speed': SIGNALK['aft.speed'], 'aft.water_temperature': dict(NMEA['aft.load'])},
            WATERED,
            False,
            "aft.water_temperature.from = 'nmea' must be signalk",
        ),
        (SIGNALK, {}, True, "parameter 'aft.speed.topic' is missing"),
    ],
)
def test_links_that_do_not_fit_the_bearing_are_refused(
    files: Files, links: Any, bearing: dict[str, Any], with_node: bool, text: str
) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(text)):
        load_watch(files.write(links, **bearing), '/stickslip_monitor' if with_node else None)


def test_an_input_with_a_hold_is_silent_only_after_it() -> None:
    kinds = (('a', 0.0), ('b', 3600.0))
    items = [
        BusInput(bearing=name, place=Input.SPEED, hold=hold, bus='signalk', path=f'x.{name}')
        for name, hold in kinds
    ]
    inputs = BusInputs(items, lambda _: None)
    inputs.start_waiting(0.0)
    assert [item.bearing for item in inputs.take_silent(3599.0)] == ['a']
    assert [item.bearing for item in inputs.take_silent(3600.0)] == ['b']
