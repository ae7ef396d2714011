# SPDX-License-Identifier: Apache-2.0
"""The node that hears a replayed bag says what the offline check of the bag says."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.monitor.configure import build_config
from stickslip_monitor.monitor.messages import event_record
from stickslip_monitor.offline.check import check_bag

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

BEGIN = 1_700_000_000 * 10**9
HEADER = """std_msgs/Header header
{fields}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = HEADER.format(
    fields='string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort'
)
DELAYS = {'alarm.on_delay': 1.0, 'alarm.off_delay': 3.0}


def coast(seconds: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [ns], speeds [rpm] with noise, and loads [N] of a coast-down and recovery."""
    random = np.random.default_rng(7)
    time = np.arange(0.0, seconds, 1.0 / rate)
    rpm = 15.0 + 90.0 * np.abs(time / seconds - 0.5) + random.normal(0.0, 0.6, time.size)
    jitter = random.uniform(0.0, 0.2 / rate, time.size)
    return BEGIN + np.round((time + jitter) * 1e9).astype(np.int64), rpm, np.full(time.size, 1e3)


def offline(path: Path, values: dict[str, Any]) -> list[dict[str, Any]]:
    report = check_bag(path, build_config(values))
    # As JSON brings them.
    events = [event_record(event) for event in report.bearings['aft'].events]
    return list(json.loads(json.dumps(events)))


def replay(monitor: Any, run: Any, kit: Any, path: Path, rate: float, count: int) -> Any:
    warnings = monitor.warnings()
    topic = monitor.input(monitor.values['aft.speed.topic'])
    monitor.peer.until(lambda: monitor.peer.node.count_subscribers(topic), 'the input')
    player = run(
        *(sys.executable, '-m', 'stickslip_monitor.cli', 'play', str(path)),
        *('--rate', str(rate), '--wait', '60'),
    )
    monitor.peer.until(lambda: not player.alive, 'the end', 60.0)
    assert player.wait() == 0, player.output
    monitor.peer.until(
        lambda: len(warnings) >= count, f'{count} events, not {kit.events(warnings)}', 5.0
    )
    return kit.events(warnings)


@pytest.mark.slow
def test_stamped_messages_give_the_same_events_to_the_nanosecond(
    start: Any, run: Any, kit: Any, tmp_path: Path
) -> None:
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import JointState

    monitor = start(kit.parameters(kit.STAMPED, DELAYS))
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        topic = monitor.input('shaft')
        writer.add_topic(topic, kit.JOINT, JOINT_STATE)
        for time, rpm, load in zip(*coast(40.0, 10.0), strict=True):
            message = JointState(velocity=[rpm], effort=[load])
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(time), 10**9)
            # Recorded some milliseconds after it was measured.
            writer.write(topic, int(time) + 7_000_000, serialize_message(message))
    absolute = {'aft.speed.topic': topic, 'aft.load.topic': topic}
    expected = offline(path, monitor.values | absolute)
    assert len(expected) >= 5
    heard = replay(monitor, run, kit, path, 20.0, len(expected))
    assert heard == expected


@pytest.mark.slow
def test_plain_numbers_on_simulated_time(start: Any, run: Any, kit: Any, tmp_path: Path) -> None:
    # Before the first /clock the inputs count as lost after their timeout.
    patient = {'speed.timeout': 60.0, 'load.timeout': 60.0}
    monitor = start(kit.parameters(DELAYS, patient), '-p', 'use_sim_time:=true')
    topics = {
        f'aft.{quantity}.topic': monitor.input(monitor.values[f'aft.{quantity}.topic'])
        for quantity in ('speed', 'load')
    }
    # Six seconds each: normal, caution, bistable, stick-slip, caution again, normal.
    rpm = np.repeat([60.0, 42.5, 35.0, 25.0, 42.5, 60.0], 60)
    time = BEGIN + np.arange(rpm.size, dtype=np.int64) * 10**8
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        for topic in topics.values():
            writer.add_topic(topic, 'std_msgs/msg/Float64')
        columns = ((time, rpm), (time + 10**7, np.full(rpm.size, 1e3)))
        writer.write_float64s(dict(zip(topics.values(), columns, strict=True)))
    expected = offline(path, monitor.values | topics)
    assert {e['to'] for e in expected} == {'caution', 'bistable', 'stick_slip', 'normal'}
    rate = 8.0
    heard = replay(monitor, run, kit, path, rate, len(expected))
    assert [(e['from'], e['to']) for e in heard] == [(e['from'], e['to']) for e in expected]
    # A message has the time that the clock shows when it arrives. Delivery and two busy
    # processes are allowed 0.4 s of real time.
    errors = [(a['time'] - b['time']) * 1e-9 for a, b in zip(heard, expected, strict=True)]
    assert max(map(abs, errors)) < 0.4 * rate
