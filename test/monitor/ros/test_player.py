# SPDX-License-Identifier: Apache-2.0
"""Recordings played to subscribers, and to the node: it says what the check of the bag says."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import kit
import numpy as np
import pytest
from made_logs import write_recording

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.writer import BagWriter
from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.bearing_records import event_record
from stickslip_monitor.monitor.configuration import build_config
from stickslip_monitor.offline.check import check_recording

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


BEGIN = 1_700_000_000 * 10**9
FLOAT64 = 'std_msgs/msg/Float64'


def encode_float64(value: float) -> bytes:
    return b'\x00\x01\x00\x00' + np.float64(value).tobytes()


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Two topics at 10 Hz for 2 s, the second 20 ms after the first."""
    times, values = BEGIN + np.arange(20, dtype=np.int64) * 10**8, np.arange(20.0)
    return write_recording(tmp_path / 'bag', {'/a': (times, values), '/b': (times + 2 * 10**7, -values)})


@pytest.fixture
def play(run: Any) -> Callable[..., Any]:
    return lambda *arguments: run(sys.executable, '-m', 'stickslip_monitor.cli', 'play', *map(str, arguments))


class Received:
    """Messages of a topic."""

    def __init__(self, peer: Any, kind: Any, topic: str, raw: bool = False) -> None:
        self.messages: list[Any] = []
        peer.node.create_subscription(kind, topic, self.messages.append, 2000, raw=raw)


def clock_ns(message: Any) -> int:
    return int(message.clock.sec) * 10**9 + int(message.clock.nanosec)


@pytest.mark.parametrize(
    ('runs', 'error'), [(False, KeyboardInterrupt), (True, RosError)], ids=['ended', 'full']
)
def test_a_message_that_cannot_be_sent(
    monkeypatch: pytest.MonkeyPatch, runs: bool, error: type[BaseException]
) -> None:
    """ROS was shut down, which ends the player, or a queue stays full."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    from stickslip_monitor.ros.player import publish_message

    def refuse(_: Any) -> None:
        raise rclpy_implementation.RCLError('no room')

    monkeypatch.setattr('rclpy.ok', lambda: runs)
    monkeypatch.setattr('time.sleep', lambda _: None)
    publisher: Any = SimpleNamespace(publish=refuse, topic_name='/a')
    with pytest.raises(error, match='/a does not keep up' if runs else '^$'):
        publish_message(publisher, None)


def test_messages_and_clock_are_due_at_their_times_divided_by_the_rate(
    peer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play ten messages a second at twice the speed, on a clock that runs as it is slept."""
    from stickslip_monitor.ros import player

    now, clock, sent = [0.0], list[tuple[float, int]](), list[tuple[float, bytes]]()

    def sleep(seconds: float) -> None:
        now[0] += seconds

    def publish(publisher: Any, message: Any) -> None:
        if publisher.topic_name == '/clock':
            clock.append((now[0], clock_ns(message)))
        else:
            sent.append((now[0], message))

    monkeypatch.setattr(player, 'time', SimpleNamespace(monotonic=lambda: now[0], sleep=sleep))
    monkeypatch.setattr(player, 'publish_message', publish)
    recorded = [(BEGIN + k * 10**8, b'%d' % k) for k in range(20)]
    played = player.Player({'/a': FLOAT64})
    assert played.play((('/a', *message) for message in recorded), 2.0) == 20
    played.node.destroy_node()
    assert [at for at, _ in sent] == pytest.approx([k / 20.0 for k in range(20)], abs=1e-9)
    assert [message for _, message in sent] == [message for _, message in recorded]
    # The clock runs on between messages, and the time of a message is its log time.
    assert [time_ns for _, time_ns in clock] == pytest.approx(
        [BEGIN + round(2e9 * at) for at, _ in clock], abs=1000
    )
    assert max(b - a for (a, _), (b, _) in pairwise(clock)) <= player.CLOCK_PERIOD + 1e-9
    assert {time_ns for time_ns, _ in recorded} <= {time_ns for _, time_ns in clock}


@pytest.mark.slow
def test_bytes_and_the_order_of_the_clock(peer: Any, bag: Path, play: Any) -> None:
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64

    a, b = Received(peer, Float64, '/a', raw=True), Received(peer, Float64, '/b')
    clock = peer.listen(Clock, '/clock', reliable=False)
    player = play(bag, '--rate', '2', '--wait', '60')
    peer.until(lambda: len(a.messages) >= 20 and len(b.messages) >= 20, 'all messages')
    peer.until(lambda: not player.alive, 'the end')
    assert player.wait() == 0
    assert player.output == 'played 40 messages\n'
    assert [bytes(message) for message in a.messages] == [encode_float64(k) for k in range(20)]
    assert [message.data for message in b.messages] == [-float(k) for k in range(20)]
    times = [clock_ns(message) for message in clock]
    assert times == sorted(times)
    assert times[0] >= BEGIN
    assert times[-1] <= BEGIN + 192 * 10**7


@pytest.mark.slow
def test_loop_takes_the_clock_back_and_loses_nothing(peer: Any, tmp_path: Path, play: Any) -> None:
    """Reliable, and a queue as long as the bag, which has 400 messages in as many ms."""
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64

    times = BEGIN + np.arange(400, dtype=np.int64) * 10**6
    write_recording(tmp_path / 'dense', {'/a': (times, np.arange(400.0))})
    a = Received(peer, Float64, '/a')
    clock = peer.listen(Clock, '/clock', reliable=False)
    player = play(tmp_path / 'dense', '--rate', '20', '--loop', '3', '--wait', '60')
    peer.until(lambda: len(a.messages) >= 1200, 'all messages')
    assert player.wait() == 0
    assert player.output == 'played 400 messages\n' * 3
    assert [message.data for message in a.messages] == [*map(float, range(400))] * 3
    times = [clock_ns(message) for message in clock]
    assert sum(y < x for x, y in pairwise(times)) == 2


@pytest.mark.slow
def test_topics_that_cannot_be_played_are_skipped_and_named(
    peer: Any, tmp_path: Path, play: Any, run: Any
) -> None:
    from std_msgs.msg import Float64

    path = tmp_path / 'odd'
    unknown = {'/speed': 'nowhere_msgs/msg/Speed', '/level': 'std_msgs/msg/Severity', '/x': 'Old'}
    with BagWriter(path) as writer:
        writer.add_topic('/a', FLOAT64)
        writer.add_topic('/not a topic', FLOAT64)
        writer.add_topic('/clock', 'rosgraph_msgs/msg/Clock', 'builtin_interfaces/Time clock')
        for topic, kind in unknown.items():
            writer.add_topic(topic, kind, 'float64 data')
        for k in range(10):
            for topic in ('/a', '/clock', '/not a topic', *unknown):
                writer.write(topic, BEGIN + k * 10**7, encode_float64(k))
    a = Received(peer, Float64, '/a')
    player = play(path, '--wait', '60')
    peer.until(lambda: len(a.messages) >= 10, 'all messages')
    assert player.wait() == 0
    lines = player.output.splitlines()
    assert lines[-1] == 'played 10 messages'
    skipped = {line.split(': ')[1]: line for line in lines if line.startswith('not played: ')}
    assert set(skipped) == {'/clock', '/not a topic', *unknown}
    assert skipped['/speed'].endswith('package nowhere_msgs is not installed')
    assert skipped['/level'].endswith("package std_msgs has no message type 'Severity'")
    assert 'Traceback' not in player.output


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_player(peer: Any, bag: Path, play: Any, number: int) -> None:
    from std_msgs.msg import Float64

    a = Received(peer, Float64, '/a')
    player = play(bag, '--rate', '0.1', '--wait', '60')
    peer.until(lambda: a.messages, 'a message')
    player.process.send_signal(number)
    assert player.wait() == 130
    assert player.output == ''


DELAYS = {'alarm.on_delay': 1.0, 'alarm.off_delay': 3.0}


def coast_down(seconds: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [ns], speeds [rpm] with noise, and loads [N] of a coast-down and recovery."""
    random = np.random.default_rng(7)
    time = np.arange(0.0, seconds, 1.0 / rate)
    rpm = 15.0 + 90.0 * np.abs(time / seconds - 0.5) + random.normal(0.0, 0.6, time.size)
    jitter = random.uniform(0.0, 0.2 / rate, time.size)
    return BEGIN + np.round((time + jitter) * 1e9).astype(np.int64), rpm, np.full(time.size, 1e3)


@pytest.mark.slow
def test_stamped_messages_give_the_same_events_to_the_nanosecond(
    host: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play a recording to a node in step: the player goes on when the node has taken what was sent."""
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import JointState

    from stickslip_monitor.ros import player
    from stickslip_monitor.ros.inputs import compose_definition

    monitor = host(kit.stamped_parameters(DELAYS))
    warnings, topic, path = monitor.warnings(), monitor.input('shaft'), tmp_path / 'bag'
    stamps = []
    with BagWriter(path) as writer:
        writer.add_topic(topic, kit.JOINT, compose_definition(kit.JOINT))
        for time, rpm, load in zip(*coast_down(40.0, 10.0), strict=True):
            message = JointState(velocity=[rpm], effort=[load])
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(time), 10**9)
            stamps.append(int(time))
            # A stamp counts where it is at most a second older than its arrival.
            writer.write(topic, int(time) + 500_000_000, serialize_message(message))
    absolute = {'speed.topic': topic, 'load.topic': topic}
    report = check_recording(path, build_config(kit.node_parameters(kit.STAMPED, DELAYS, absolute)))
    # As JSON brings them.
    expected = json.loads(json.dumps([*map(event_record, report.bearings['aft'].events)]))
    assert len(expected) >= 5

    now, publish, sent = [0.0], player.publish_message, iter(stamps)
    clock = monitor.node.get_clock()

    def sleep(seconds: float) -> None:
        now[0] += seconds

    def publish_and_wait(publisher: Any, message: Any) -> None:
        publish(publisher, message)
        if publisher.topic_name == topic:
            stamp_ns = next(sent)
            monitor.peer.until(lambda: monitor.has_taken(stamp_ns), 'the message')
        else:
            monitor.peer.until(lambda: clock.now().nanoseconds == clock_ns(message), 'the clock')

    remapping = ['--ros-args', '-r', f'/clock:={monitor.input("clock")}']
    monkeypatch.setattr(player, 'Node', partial(player.Node, cli_args=remapping))
    monkeypatch.setattr(player, 'time', SimpleNamespace(monotonic=lambda: now[0], sleep=sleep))
    monkeypatch.setattr(player, 'publish_message', publish_and_wait)
    playing = player.Player({topic: kit.JOINT})
    peer = monitor.peer
    publishers = [playing._clock, *playing._publishers.values()]
    peer.until(lambda: all(p.get_subscription_count() for p in publishers), 'the node')
    recorded = ((m.topic, m.log_time_ns, m.data) for m in open_bag(path).messages())
    assert playing.play(recorded, 5.0) == len(stamps)
    playing.node.destroy_node()
    peer.until(lambda: len(warnings) >= len(expected), f'{len(expected)} events')
    assert kit.decode_warnings(warnings) == expected
