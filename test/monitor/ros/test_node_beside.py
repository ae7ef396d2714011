# SPDX-License-Identifier: Apache-2.0
"""What stands beside the real node: the dashboard, and the ship's buses."""

from __future__ import annotations

import json
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import kit
import pytest
import yaml
from shared import DEADLINE, Bus

from stickslip_monitor import build_config
from stickslip_monitor.monitor.sample_types import Input

pytest.importorskip('rclpy', reason='ROS 2 is not installed')
pytest.importorskip('aiohttp', reason="the extras 'dashboard' and 'links' are not installed")


class Page:
    """The dashboard as a browser sees it, without one."""

    def __init__(self, url: str, space: str) -> None:
        self.url, self.space = url, space

    def state(self) -> dict[str, Any]:
        """Return the state that the page shows, the first event of a stream."""
        with urllib.request.urlopen(f'{self.url}events', timeout=DEADLINE) as stream:
            for line in stream:
                if line.startswith(b'data: '):
                    return dict(json.loads(line[6:]))
        raise AssertionError('the stream has ended')

    def metrics(self) -> dict[str, float]:
        with urllib.request.urlopen(f'{self.url}metrics', timeout=DEADLINE) as answer:
            lines = answer.read().decode().splitlines()
        pairs = (line.rpartition(' ') for line in lines if not line.startswith('#'))
        return {name: float(value) for name, _, value in pairs}

    def act(self, action: str, alarm: str | None = None) -> tuple[int, str]:
        document = {
            'schema': 'stickslip_monitor/action/1',
            'action': action,
            'by': 'Ada',
            'bearing': f'{self.space}/aft',
            'alarm': alarm,
            'reason': 'new oil' if action == 'shelve' else None,
        }
        request = urllib.request.Request(
            f'{self.url}act', json.dumps(document).encode(), {'Content-Type': 'application/json'}
        )
        try:
            with urllib.request.urlopen(request, timeout=DEADLINE) as answer:
                return answer.status, json.load(answer)['text']
        except urllib.error.HTTPError as error:
            return error.code, json.load(error)['text']

    def figure(self, name: str, **labels: str) -> float | None:
        """Return a metric of the bearing, or with other labels; ``None`` where it is missing."""
        names = labels or {'bearing': 'aft', 'namespace': f'/{self.space}'}
        text = ','.join(f'{key}="{names[key]}"' for key in sorted(names))
        return self.metrics().get(f'stickslip_{name}{{{text}}}')

    def up(self, space: str = '') -> float | None:
        return self.figure('monitor_up', namespace=f'/{space or self.space}')


@pytest.fixture
def open_page(run: Any, tmp_path: Path) -> Iterator[Any]:
    """Yield a function that starts a dashboard beside nodes, in a process of its own."""
    started = []

    def open_page(*monitors: Any, more: tuple[str, ...] = ()) -> tuple[Any, Page]:
        first = monitors[0]
        nodes = [m.name('').rstrip('/') for m in monitors]
        dashboard = run(
            *(sys.executable, '-m', 'stickslip_monitor.cli', 'dashboard', '--port', '0'),
            *('--config', str(tmp_path / f'{first.space}.yaml')),
            *('--diagnostics', f'/{first.space}/diagnostics', *more),
            *(word for node in nodes for word in ('--node', node)),
        )
        started.append(dashboard)
        match = first.peer.until(
            lambda: re.search(r'Dashboard on (http://127\.0\.0\.1:\d+/)\n', dashboard.output),
            'the dashboard',
            120.0,  # on a busy machine its imports alone take long
        )
        return dashboard, Page(match[1], first.space)

    yield open_page
    for dashboard in started:
        assert dashboard.stop() == 0
        assert 'Traceback' not in dashboard.output


@pytest.mark.slow
def test_of_two_nodes_on_a_page_the_one_that_is_meant_acts(start: Any, open_page: Any) -> None:
    """Show twin screws: bearings and topics have one name, but for the namespace."""
    port = start(kit.node_parameters(kit.STAMPED))
    shared = ('-r', f'/diagnostics:=/{port.space}/diagnostics')
    starboard = start(kit.node_parameters(kit.STAMPED), *shared)
    port_page = open_page(port, starboard)[1]
    starboard_page, peer = Page(port_page.url, starboard.space), port.peer
    sick, well = kit.Telemetry(port), kit.Telemetry(starboard)
    expected = {f'{port.space}/aft': 'stick_slip', f'{starboard.space}/aft': 'normal'}

    def reasons() -> dict[str, str]:
        return {b['name']: (b['status'] or {}).get('reason') for b in port_page.state()['bearings']}

    sick.until(20.0, 1000.0, lambda: reasons()[f'{port.space}/aft'] == 'stick_slip', 'stick-slip')
    well.until(60.0, 1000.0, lambda: reasons() == expected, 'both')
    assert (port_page.figure('predicted'), starboard_page.figure('predicted')) == (1.0, 0.0)
    assert starboard_page.act('acknowledge', 'stick_slip') == (409, 'there is nothing to acknowledge')
    assert port_page.act('acknowledge', 'stick_slip') == (200, 'acknowledge: 1 alarm')
    peer.until(lambda: 'acknowledge by Ada' in port.output, 'its word')
    assert 'acknowledge by Ada' not in starboard.output
    last = port_page.state()['log'][-1]
    bearing = f'{port.space}/aft'
    assert (last['what'], last['by'], last['bearing']) == ('acknowledge', 'Ada', bearing)
    assert port_page.act('shelve', 'stick_slip')[0] == 200
    labels = {'bearing': 'aft', 'namespace': f'/{port.space}', 'alarm': 'stick_slip'}
    shelved = labels | {'priority': 'alarm', 'state': 'shelved'}
    peer.until(lambda: port_page.figure('alarm_state', **shelved) == 1.0, 'the shelf')
    notes = [entry['text'] for entry in port_page.state()['log'] if not entry['alarm']]
    assert 'aft/stick_slip: shelve by Ada: new oil' in notes
    # One that is silent is told, and the other is not taken for it.
    assert port.stop() == 0
    peer.until(lambda: port_page.up() == 0.0, 'silence')
    # Nothing old is repeated, and nothing is done.
    assert port_page.figure('load_newtons') is None
    refusal = (503, 'the monitor is not there, or not active: nothing was done')
    peer.until(lambda: port_page.act('unshelve', 'stick_slip') == refusal, 'the word that it is gone')
    missing = [f'{port.space}/aft']
    peer.until(lambda: port_page.state()['monitor']['missing'] == missing, 'which it is')
    assert starboard_page.up() == 1.0


def test_of_two_bearings_on_one_shaft_the_speed_is_published_once() -> None:
    from stickslip_monitor.ros.other_nodes import Bridge

    sent: list[tuple[str, float]] = []

    def create_publisher(kind: Any, topic: str, depth: int) -> Any:
        return SimpleNamespace(publish=lambda message: sent.append((topic, message.data)))

    values: dict[str, Any] = {'bearings': ['fore', 'aft']}
    for name in values['bearings']:
        bearing_values = {f'{name}.{key}': value for key, value in kit.PARAMETERS.items()}
        values |= bearing_values | {f'{name}.load.topic': f'{name}/load'}
    inputs = [(name, place) for name in values['bearings'] for place in (Input.SPEED, Input.LOAD)]
    node: Any = SimpleNamespace(create_publisher=create_publisher)
    bridge = Bridge(node, '/port/stickslip_monitor', build_config(values), inputs)
    for name, place in inputs:
        bridge.take(name, place, 60.0)
    assert sent == [('/port/shaft/speed', 60.0), ('/port/fore/load', 60.0), ('/port/aft/load', 60.0)]


@pytest.mark.slow
def test_a_node_between_two_ends_of_a_bus(start: Any, run: Any, tmp_path: Path) -> None:
    changes = {'alarm.on_delay': 0.2, 'speed.timeout': 2.0, 'load.timeout': 2.0}
    monitor, bus = start(kit.node_parameters(changes)), Bus()
    path = tmp_path / f'{monitor.space}.yaml'
    document = yaml.safe_load(path.read_text())
    document['/stickslip_links'] = {'ros__parameters': bus.links('aft')}
    path.write_text(yaml.safe_dump(document))
    until = monitor.peer.until
    watch = run(
        *(sys.executable, '-m', 'stickslip_monitor.cli', 'watch', '--config', str(path)),
        *('--node', monitor.name('').rstrip('/')),
        *('--diagnostics', f'/{monitor.space}/diagnostics'),
    )
    raised = bus.sails('20.0', lambda: bus.alarms.get('10002') == 'V')
    until(raised, 'the alarm')
    bus.say('BNACN,060130.00,,10002,1,A,C')
    until(bus.sails('20.0', lambda: bus.alarms.get('10002') == 'A'), 'its acknowledgement')
    # Its log is written behind the alarm.
    until(lambda: 'aft/stick_slip: acknowledge by nmea' in monitor.output, 'its word')
    # An invalid speed is published as NaN: it is lost, and nothing clears.
    until(bus.sails('', lambda: bus.alarms.get('10005') == 'V'), 'the lost input')
    assert bus.alarms['10002'] == 'A'
    monitor.stop()
    bus.beats.clear()
    until(bus.sails('20.0', lambda: 'V' in bus.beats), 'the word that nobody watches')
    assert bus.alarms['10002'] == 'A'
    assert watch.stop() == 0
    assert 'Traceback' not in watch.output
