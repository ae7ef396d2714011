# SPDX-License-Identifier: Apache-2.0
"""The alarms of the live node: its services, its list, and what survives a restart."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import kit
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

COVERED = {'bistable': 'acknowledged', 'margin_low': 'acknowledged'}


class Panel:
    """A list of alarms and its buttons, as a person has them."""

    def __init__(self, monitor: Any) -> None:
        self.monitor, self.peer = monitor, monitor.peer
        self.received = monitor.listen('alarms', latched=True)
        self.peer.until(lambda: self.received, 'the list')

    @property
    def lists(self) -> list[dict[str, Any]]:
        return [json.loads(message.data) for message in self.received]

    @property
    def changes(self) -> list[dict[str, Any]]:
        return [change for record in self.lists for change in record['changes']]

    def states(self) -> dict[str, str]:
        """Return the states of the alarms that are not normal, by name."""
        alarms = self.lists[-1]['alarms']
        return {a['alarm']: a['state'] for a in alarms if a['state'] != 'normal'}

    def until(self, **states: str) -> None:
        self.peer.until(lambda: self.states() == states, f'{states}, not {self.states()}')

    def ask(self, service: str, on: bool | None = None) -> tuple[bool, str]:
        """Call a service, with a switch where it takes one; return success and message."""
        from std_srvs.srv import SetBool, Trigger

        kind, request = (Trigger, {}) if on is None else (SetBool, {'data': on})
        answer = self.peer.call(kind, self.monitor.name(service), **request)
        return answer.success, answer.message


def test_the_services(host: Any) -> None:
    monitor = host(kit.stamped_parameters(shelve_time=1.0))
    panel, telemetry = Panel(monitor), kit.Telemetry(monitor)
    assert panel.ask('acknowledge') == (False, 'there is nothing to acknowledge')
    telemetry.until(20.0, 1000.0, panel.states, 'the alarm')
    panel.until(stick_slip='unacknowledged', **COVERED)
    assert panel.lists[-1]['sounding']
    assert panel.ask('silence') == (True, 'silence: aft/stick_slip')
    panel.peer.until(lambda: not panel.lists[-1]['sounding'], 'silence')
    assert panel.ask('acknowledge') == (True, 'acknowledge: aft/stick_slip')
    panel.until(stick_slip='acknowledged', **COVERED)

    assert panel.ask('shelve')[0]
    panel.until(stick_slip='shelved', bistable='shelved', margin_low='shelved')
    panel.until(stick_slip='unacknowledged', **COVERED)  # after a second, by itself
    assert panel.ask('shelve')[0]
    assert panel.ask('unshelve') == (True, 'unshelve: aft/stick_slip, aft/bistable, aft/margin_low')
    assert panel.ask('out_of_service', True)[0]
    panel.peer.until(lambda: set(panel.states().values()) == {'out_of_service'}, 'removal')
    assert panel.ask('out_of_service', True) == (True, 'no change: it is so already')
    assert panel.ask('out_of_service', False)[0]
    panel.until(stick_slip='unacknowledged', **COVERED)
    assert panel.ask('acknowledge')[0]
    assert panel.ask('reset') == (False, 'there is nothing to reset')

    assert {c['by'] for c in panel.changes} == {'monitor', 'timer', 'ros service'}
    mine = [c['what'] for c in panel.changes if c['by'] == 'ros service' and c['to'] != c['from']]
    assert mine[:2] == ['acknowledge', 'shelve']
    sequence = [record['sequence'] for record in panel.lists]
    assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))
    assert 'aft/stick_slip: acknowledge by ros service, unacknowledged -> ack' in monitor.output


def test_requests_on_the_topic(host: Any) -> None:
    from std_msgs.msg import String

    monitor = host(kit.stamped_parameters())
    panel = Panel(monitor)
    publisher = monitor.peer.talk(String, monitor.name('actions'))
    good = '{"schema": "stickslip_monitor/action/1", "action": "remove", "by": "Ada"'
    removed_action = good.replace('remove', 'suppress') + '}'
    bad = ('no', '[1]', good + ', "bearing": "fore"}', removed_action, '[' * 100_000)
    for text in bad:
        publisher.publish(String(data=text))
    refused = 'a request on ~/actions is refused: '
    monitor.peer.until(lambda: monitor.output.count(refused) == len(bad), 'the refusals')
    publisher.publish(String(data=good + '}'))
    monitor.peer.until(lambda: panel.changes, 'the alarms are out of service')
    assert {(c['what'], c['by']) for c in panel.changes} == {('remove', 'Ada')}
    assert "action = 'suppress' no longer exists: use 'shelve'" in monitor.output


def test_a_state_file_of_zeros_is_put_aside_and_the_node_monitors(host: Any, tmp_path: Path) -> None:
    file = tmp_path / 'alarms.json'
    file.write_bytes(bytes(4096))  # as a power cut leaves it
    monitor = host(kit.node_parameters() | {'state_file': str(file)})
    aside = f'{file}.damaged'
    lines = [line for line in monitor.log.lines if aside in line]
    assert len(lines) == 1
    assert lines[0].startswith(f'[warning] state_file {file} is damaged: it is not JSON: ')
    panel, diagnostics = Panel(monitor), monitor.diagnostics()

    def level() -> Any:
        return kit.latest_status(diagnostics, 'the node').get('level')

    panel.peer.until(lambda: level() == b'\x01', 'the status says so')
    assert Path(aside).read_bytes() == bytes(4096)
    assert panel.ask('acknowledge')
    panel.peer.until(lambda: level() == b'\x00', 'somebody knows')


def test_an_acknowledged_alarm_survives_a_restart(host: Any, tmp_path: Path) -> None:
    file = tmp_path / 'alarms.json'
    values = kit.stamped_parameters(state_file=str(file))
    first = host(values)
    panel, telemetry = Panel(first), kit.Telemetry(first)
    telemetry.until(20.0, 1000.0, panel.states, 'the alarm')
    panel.until(stick_slip='unacknowledged', **COVERED)
    assert panel.ask('acknowledge')[0]
    panel.until(stick_slip='acknowledged', **COVERED)
    first.end()

    second = host(values)
    panel, diagnostics = Panel(second), second.diagnostics()
    assert panel.states() == {'stick_slip': 'acknowledged', **COVERED}
    # A greeting at 60 rpm would end the stick-slip.
    kit.Telemetry(second, 20.0, telemetry.now).hold(20.0, 1000.0, 2.0)
    # The condition goes on, and so does the alarm: somebody knows already.
    panel.peer.until(lambda: kit.latest_status(diagnostics).get('reason') == 'stick_slip', 'stick-slip')
    assert panel.states() == {'stick_slip': 'acknowledged', **COVERED}
    assert panel.changes == []
    assert not any(record['sounding'] for record in panel.lists)
