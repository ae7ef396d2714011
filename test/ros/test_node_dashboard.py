# SPDX-License-Identifier: Apache-2.0
"""The dashboard beside the real node: what it hears of it, and what it makes it do."""

from __future__ import annotations

import json
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')
pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")


class Page:
    """The dashboard as a browser sees it, without one."""

    def __init__(self, url: str) -> None:
        self.url = url

    def state(self) -> dict[str, Any]:
        """All that is shown; the first event of a stream."""
        with urllib.request.urlopen(f'{self.url}events', timeout=10.0) as stream:
            for line in stream:
                if line.startswith(b'data: '):
                    return dict(json.loads(line[6:]))
        raise AssertionError('the stream has ended')

    def status(self) -> dict[str, Any]:
        return self.state()['bearings'][0]['status'] or {}

    def alarms(self) -> dict[str, str]:
        record = self.state()['alarms'] or {'alarms': []}
        return {a['alarm']: a['state'] for a in record['alarms'] if a['state'] != 'normal'}

    def metrics(self) -> dict[str, float]:
        with urllib.request.urlopen(f'{self.url}metrics', timeout=10.0) as answer:
            lines = answer.read().decode().splitlines()
        pairs = (line.rpartition(' ') for line in lines if not line.startswith('#'))
        return {name: float(value) for name, _, value in pairs}

    def act(self, action: str, alarm: str | None = None) -> tuple[int, str]:
        document = {
            'schema': 'stickslip_monitor/action/1',
            'action': action,
            'by': 'Ada',
            'bearing': 'aft',
            'alarm': alarm,
        }
        request = urllib.request.Request(
            f'{self.url}act', json.dumps(document).encode(), {'Content-Type': 'application/json'}
        )
        try:
            with urllib.request.urlopen(request, timeout=10.0) as answer:
                return answer.status, json.load(answer)['text']
        except urllib.error.HTTPError as error:
            return error.code, json.load(error)['text']


@pytest.fixture
def page(start: Any, run: Any, kit: Any, tmp_path: Path) -> Iterator[tuple[Any, Page]]:
    """A node, and a dashboard beside it in a process of its own."""
    monitor = start(kit.parameters(kit.STAMPED))
    config = tmp_path / f'{monitor.space}.yaml'
    dashboard = run(
        *(sys.executable, '-m', 'stickslip_monitor.cli', 'dashboard', '--config', str(config)),
        *('--port', '0', '--node', monitor.name('').rstrip('/')),
        *('--diagnostics', f'/{monitor.space}/diagnostics'),
    )
    found = monitor.peer.until(
        lambda: re.search(r'Dashboard on (http://127\.0\.0\.1:\d+/)\n', dashboard.output),
        'the dashboard',
    )
    yield monitor, Page(found[1])
    assert dashboard.stop() == 0
    assert 'Traceback' not in dashboard.output


@pytest.mark.slow
def test_it_shows_the_node_and_acts_on_it(page: tuple[Any, Page], kit: Any) -> None:
    monitor, shown = page
    peer = monitor.peer
    telemetry = kit.Telemetry(monitor)
    heard = telemetry.step(45.0, 1000.0, 0.0)
    peer.until(lambda: shown.status().get('rpm') == pytest.approx(45.0), 'the operating point')
    status = shown.status()
    assert status['load'] == 1000.0
    assert status['fold_margin'] == pytest.approx(heard['fold_margin'], rel=1e-8)
    assert shown.state()['monitor']['there']

    # Deep in the stick-slip range, for more values than the on-delay of 0.5 s needs.
    for step in range(6):
        telemetry.step(20.0, 1000.0, 1.0 + step)
    peer.until(lambda: shown.alarms().get('stick_slip') == 'unacknowledged', 'the alarm')
    assert shown.act('acknowledge', 'stick_slip') == (200, 'acknowledge: 1 alarm')
    assert shown.alarms()['stick_slip'] == 'acknowledged'
    last = shown.state()['log'][-1]
    assert (last['what'], last['by'], last['bearing']) == ('acknowledge', 'Ada', 'aft')
    # The node itself says so, in its log too.
    assert 'aft/stick_slip: acknowledge by Ada, unacknowledged -> ack' in monitor.output
    assert shown.act('acknowledge', 'stick_slip') == (409, 'there is nothing to acknowledge')
    assert shown.act('shelve', 'stick_slip')[0] == 200

    peer.until(lambda: shown.metrics().get('stickslip_predicted{bearing="aft"}') == 1.0, 'it')
    figures = shown.metrics()
    assert figures['stickslip_load_newtons{bearing="aft"}'] == 1000.0
    one = 'alarm="stick_slip",bearing="aft",priority="alarm",state="shelved"'
    assert figures[f'stickslip_alarm_state{{{one}}}'] == 1.0
    assert figures['stickslip_monitor_up'] == 1.0

    # Without the node nothing is repeated, and nothing is done.
    assert monitor.stop() == 0
    peer.until(lambda: not shown.state()['monitor']['there'], 'silence')
    assert shown.metrics()['stickslip_monitor_up'] == 0.0
    assert 'stickslip_load_newtons{bearing="aft"}' not in shown.metrics()
    assert shown.act('unshelve', 'stick_slip') == (
        503,
        'the monitor is not there, or not active: nothing was done',
    )


@pytest.mark.slow
def test_the_node_refuses_what_is_no_request(start: Any, kit: Any) -> None:
    from std_msgs.msg import String

    monitor = start(kit.parameters(kit.STAMPED))
    publisher = monitor.peer.talk(String, monitor.name('actions'))
    good = '{"schema": "stickslip_monitor/action/1", "action": "silence", "by": "Ada"'
    for text in ('no', '[1]', good + ', "bearing": "fore"}', '[' * 100_000):
        publisher.publish(String(data=text))
    refused = 'a request on ~/actions is refused: '
    monitor.peer.until(lambda: refused in monitor.output, 'the refusal')
    assert monitor.alive
    alarms = monitor.peer.listen(String, monitor.name('alarms'), latched=True)
    locked = good.replace('silence', 'suppress') + '}'
    publisher.publish(String(data=locked))
    monitor.peer.until(
        lambda: alarms and '"what": "suppress"' in alarms[-1].data, 'the shaft is locked'
    )
    assert '"by": "Ada"' in alarms[-1].data
