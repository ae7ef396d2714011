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

    from stickslip_monitor.ros.message_types import definition

    monitor = start(kit.parameters(kit.STAMPED, DELAYS))
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        topic = monitor.input('shaft')
        writer.add_topic(topic, kit.JOINT, definition(kit.JOINT))
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
