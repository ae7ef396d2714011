# SPDX-License-Identifier: Apache-2.0
"""The alarms of the live node: its services, its list, and what survives a restart."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from stickslip_monitor.bags.writer import BagWriter

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


class Panel:
    """What a person sees and does."""

    def __init__(self, monitor: Any) -> None:
        from std_msgs.msg import String

        self.monitor, self.peer = monitor, monitor.peer
        topic = monitor.name('alarms')
        self.heard = self.peer.listen(String, topic, latched=True)
        self.peer.until(lambda: self.peer.node.count_publishers(topic), 'the node')
        self.peer.until(lambda: self.heard, 'the list')
        self._clients: dict[str, Any] = {}

    @property
    def lists(self) -> list[dict[str, Any]]:
        return [json.loads(message.data) for message in self.heard]

    @property
    def changes(self) -> list[dict[str, Any]]:
        return [change for record in self.lists for change in record['changes']]

    def states(self) -> dict[str, str]:
        """The alarms that are not normal, by name."""
        alarms = self.lists[-1]['alarms'] if self.heard else []
        return {a['alarm']: a['state'] for a in alarms if a['state'] != 'normal'}

    def until(self, **states: str) -> None:
        self.peer.until(lambda: self.states() == states, f'{states}, not {self.states()}')

    def meet(self, *services: str) -> Panel:
        """Find several services and be found by them."""
        from std_srvs.srv import SetBool, Trigger

        for name in services:
            kind = SetBool if name.endswith(('suppress', 'out_of_service')) else Trigger
            client = self.peer.node.create_client(kind, self.monitor.name(name))
            self._clients[name] = client
        self.monitor.meet()
        return self

    def ask(self, service: str) -> tuple[bool, str]:
        from std_srvs.srv import Trigger

        return self._answer(service, Trigger.Request())

    def switch(self, service: str, on: bool) -> tuple[bool, str]:
        from std_srvs.srv import SetBool

        return self._answer(service, SetBool.Request(data=on))

    def _answer(self, service: str, request: Any) -> tuple[bool, str]:
        answer = self.peer.call(self._clients[service], request)
        return answer.success, answer.message


def sticks(telemetry: Any, second: float) -> None:
    """Deep in the stick-slip range at 20 rpm and 1000 N, for longer than the on-delay of 0.5 s."""
    for step in range(10):
        telemetry.step(20.0, 1000.0, second + 0.25 * step)


COVERED = {'bistable': 'acknowledged', 'margin_low': 'acknowledged'}


ALL = (
    *('acknowledge', 'silence', 'reset', 'shelve', 'unshelve'),
    *('suppress', 'out_of_service'),
)


def test_the_services(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(kit.STAMPED, shelve_time=1.0))
    panel = Panel(monitor).meet(*ALL, *(f'aft/{name}' for name in ALL))
    telemetry = kit.Telemetry(monitor)
    assert panel.ask('acknowledge') == (False, 'there is nothing to acknowledge')
    sticks(telemetry, 0.0)
    panel.until(stick_slip='unacknowledged', **COVERED)
    assert panel.lists[-1]['sounding']
    assert panel.ask('silence') == (True, 'silence: aft/stick_slip')
    panel.peer.until(lambda: not panel.lists[-1]['sounding'], 'silence')
    assert panel.ask('aft/acknowledge') == (True, 'acknowledge: aft/stick_slip')
    panel.until(stick_slip='acknowledged', **COVERED)

    assert panel.ask('aft/shelve')[0]
    panel.until(stick_slip='shelved', bistable='shelved', margin_low='shelved')
    panel.until(stick_slip='unacknowledged', **COVERED)  # after a second, by itself
    assert panel.ask('shelve')[0]
    assert panel.ask('unshelve') == (
        True,
        'unshelve: aft/stick_slip, aft/bistable, aft/margin_low',
    )
    assert panel.switch('aft/out_of_service', on=True)[0]
    panel.peer.until(lambda: set(panel.states().values()) == {'out_of_service'}, 'removal')
    assert panel.switch('out_of_service', on=True) == (True, 'it is so already')
    assert panel.switch('out_of_service', on=False)[0]
    panel.until(stick_slip='unacknowledged', **COVERED)
    assert panel.ask('acknowledge')[0]
    assert panel.switch('suppress', on=True)[0]
    panel.peer.until(lambda: set(panel.states().values()) == {'suppressed'}, 'suppression')
    assert panel.ask('reset') == (False, 'there is nothing to reset')

    assert {c['by'] for c in panel.changes} == {'monitor', 'timer', 'ros service'}
    mine = [c['what'] for c in panel.changes if c['by'] == 'ros service' and c['to'] != c['from']]
    assert mine[:2] == ['acknowledge', 'shelve']
    sequence = [record['sequence'] for record in panel.lists]
    assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))
    assert 'aft/stick_slip: acknowledge by ros service, unacknowledged -> ack' in monitor.output


@pytest.mark.slow
def test_absurd_values_and_a_lost_input(start: Any, kit: Any) -> None:
    fast = {
        'alarm.on_delay': 0.3,
        'alarm.off_delay': 5.0,
        'alarm.input_off_delay': 1.0,
        'speed.timeout': 1.0,
        'load.timeout': 1.0,
    }
    monitor = start(kit.parameters(kit.STAMPED, fast))
    panel, telemetry = Panel(monitor), kit.Telemetry(monitor)
    # The greeting of the telemetry is over: from here on nothing believable comes.
    for tenth in range(10):
        telemetry.send(float('nan'), 1000.0, tenth / 10.0)
        panel.peer.spin(0.1)
    panel.peer.until(lambda: 'input_implausible' in panel.states(), 'absurd values')
    panel.peer.until(lambda: panel.states().get('input_lost') == 'unacknowledged', 'the loss')
    panel.peer.until(
        lambda: panel.states().get('input_implausible') == 'returned_unacknowledged', 'the return'
    )
    texts = {a['alarm']: a['text'] for a in panel.lists[-1]['alarms']}
    topic = monitor.values['aft.speed.topic']
    assert texts['input_implausible'] == (
        f'aft: Input speed implausible: values on {topic} are not a finite number.'
    )
    assert 'Input speed lost' in texts['input_lost']


@pytest.mark.slow
def test_an_acknowledged_alarm_survives_a_restart(start: Any, kit: Any, tmp_path: Path) -> None:
    from sensor_msgs.msg import JointState

    file = tmp_path / 'alarms.json'
    values = kit.parameters(kit.STAMPED, state_file=str(file))
    first = start(values)
    panel, telemetry = Panel(first).meet('acknowledge'), kit.Telemetry(first)
    sticks(telemetry, 0.0)
    panel.until(stick_slip='unacknowledged', **COVERED)
    assert panel.ask('acknowledge')[0]
    panel.until(stick_slip='acknowledged', **COVERED)
    assert first.stop() == 0

    second = start(values)
    panel = Panel(second)
    assert panel.states() == {'stick_slip': 'acknowledged', **COVERED}
    diagnostics = second.diagnostics()
    # Without the greeting at 60 rpm, which would end the stick-slip.
    quiet = SimpleNamespace(_publisher=panel.peer.talk(JointState, second.input('shaft')))
    for tenth in range(30):
        kit.Telemetry.send(quiet, 20.0, 1000.0, 10.0 + tenth / 10.0)
        panel.peer.spin(0.1)
    # The condition goes on, and so does the alarm: somebody knows already.
    panel.peer.until(lambda: kit.status(diagnostics)['reason'] == 'stick_slip', 'stick-slip')
    assert panel.states() == {'stick_slip': 'acknowledged', **COVERED}
    assert panel.changes == []
    assert not any(record['sounding'] for record in panel.lists)
    assert second.stop() == 0

    # What is damaged is set aside by name, and the alarms start fresh.
    file.write_bytes(file.read_bytes()[:-100])
    third = start(values)
    panel = Panel(third)
    assert panel.states() == {}
    assert f'state_file {file} cannot be used: it is not JSON: ' in third.output
    assert (tmp_path / 'alarms.json.damaged').exists()

    # What cannot be written is told, and no more: a folder stands where the new file would.
    (tmp_path / 'alarms.json.new').mkdir()
    assert panel.meet('suppress').switch('suppress', on=True)[0]
    panel.peer.until(lambda: 'the alarms are not kept: ' in third.output, 'the reason')
    panel.peer.until(lambda: set(panel.states().values()) == {'suppressed'}, 'suppression')
    assert third.alive


@pytest.mark.slow
def test_a_state_file_without_a_folder_is_refused(start: Any, kit: Any, tmp_path: Path) -> None:
    monitor = start(kit.parameters(state_file=str(tmp_path / 'no' / 'alarms.json')))
    assert monitor.wait() == 2
    assert "alarms.json': there is no folder" in monitor.output
    assert monitor.output.count('\n') == 1


@pytest.fixture
def bag(kit: Any, tmp_path: Path) -> Callable[[str], Path]:
    """A recording of 20 s: 60 rpm, then 20 rpm, then 60 rpm again, at 10 Hz."""

    def make(topic: str) -> Path:
        from rclpy.serialization import serialize_message
        from sensor_msgs.msg import JointState

        path = tmp_path / 'bag'
        with BagWriter(path) as writer:
            writer.add_topic(topic, kit.JOINT, JOINT_STATE)
            for tenth in range(200):
                time = kit.T0 + tenth * kit.SECOND // 10
                rpm = 20.0 if 60 <= tenth < 120 else 60.0
                message = JointState(velocity=[rpm], effort=[1000.0])
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(time, 10**9)
                writer.write(topic, time, serialize_message(message))
        return path

    return make


@pytest.mark.slow
def test_a_bag_looped_three_times(start: Any, run: Any, kit: Any, bag: Any) -> None:
    own = {
        'alarm.on_delay': 1.0,
        'alarm.off_delay': 3.0,
        'alarm.look_ahead': 0.0,
        'speed.timeout': 15.0,
        'load.timeout': 15.0,
    }
    monitor = start(kit.parameters(kit.STAMPED, own))
    panel, warnings = Panel(monitor), monitor.warnings()
    path = bag(monitor.input('shaft'))
    player = run(
        *(sys.executable, '-m', 'stickslip_monitor.cli', 'play', str(path)),
        *('--loop', '3', '--rate', '10', '--wait', '20'),
    )
    panel.peer.until(lambda: not player.alive, 'the end', 60.0)
    assert player.wait() == 0, player.output
    panel.peer.until(lambda: len(warnings) >= 6, 'all events')
    panel.until(stick_slip='returned_unacknowledged')
    record = {a['alarm']: a for a in panel.lists[-1]['alarms']}
    # At 20 rpm from second 6 to 12: raised after 1 s, cleared 3 s after it is over.
    assert record['stick_slip']['since'] == kit.T0 + 7 * kit.SECOND
    assert record['stick_slip']['changed'] == kit.T0 + 15 * kit.SECOND
    # Nobody looked: it went on waiting through all rounds, and was given once.
    assert record['stick_slip']['count'] == 1
    assert [c['what'] for c in panel.changes if c['alarm'] == 'stick_slip'] == [
        'raise',
        'clear',
    ] * 3
    times = [(e['time'] - kit.T0, e['to']) for e in kit.events(warnings)]
    once = [(7 * kit.SECOND, 'stick_slip'), (15 * kit.SECOND, 'normal')]
    assert times == once * 3
    assert monitor.alive
