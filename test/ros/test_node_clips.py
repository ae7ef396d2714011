# SPDX-License-Identifier: Apache-2.0
"""Event clips of the real node: what is in them, and what happens where they cannot be written."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from stickslip_monitor import build_config
from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.offline.follow import scan_whole

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


@pytest.fixture
def values(kit: Any, tmp_path: Path) -> dict[str, Any]:
    """One bearing that alarms at once, and clips of five seconds before and after."""
    parameters: dict[str, Any] = kit.parameters(kit.STAMPED | {'alarm.on_delay': 0.0})
    return parameters | {
        'clips.directory': str(tmp_path / 'clips'),
        'clips.around': 5.0,
        'clips.most': 2,
    }


def clips(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / 'clips').glob('*.mcap'))


def alarm_at(telemetry: Any, second: int) -> None:
    """Ten quiet seconds, then stick-slip from that second on."""
    for early in range(second - 10, second):
        telemetry.step(60.0, 1000.0, early)
    telemetry.step(20.0, 1000.0, second)


@pytest.mark.slow
def test_an_alarm_leaves_a_clip_that_can_be_checked(
    kit: Any, start: Callable[..., Any], values: dict[str, Any], tmp_path: Path
) -> None:
    monitor = start(values)
    telemetry = kit.Telemetry(monitor)
    alarm_at(telemetry, 10)
    for second in range(11, 17):
        telemetry.step(20.0, 1000.0, second)
    monitor.peer.until(lambda: clips(tmp_path), 'the clip')
    (path,) = clips(tmp_path)
    assert path.name.endswith('_aft_stick_slip.mcap')
    bag = open_bag(path)
    space = f'/{monitor.space}'
    kinds = {name: topic.type for name, topic in bag.topics.items()}
    assert kinds[f'{space}/shaft'] == 'sensor_msgs/msg/JointState'
    for name in ('aft/amplitude', 'aft/hopf_margin', 'aft/fold_margin', 'aft/regime', 'warnings'):
        assert f'{space}/stickslip_monitor/{name}' in kinds
    assert f'{space}/diagnostics' in kinds
    # The seconds 5 to 15 and no other.
    seconds = [(m.log_time_ns - kit.T0) / kit.SECOND for m in bag.messages([f'{space}/shaft'])]
    assert seconds == [float(second) for second in range(5, 16)]
    # The same monitor over the clip alone says the same.
    inputs = {f'aft.{quantity}.topic': f'{space}/shaft' for quantity in ('speed', 'load')}
    flat = kit.parameters(kit.STAMPED | {'alarm.on_delay': 0.0})
    scan = scan_whole(path, build_config(flat | inputs)).bearings['aft'].scan
    assert scan.events[0].after.value == 'stick_slip'
    assert scan.events[0].time_ns == kit.T0 + 10 * kit.SECOND


@pytest.mark.slow
def test_a_clip_that_is_not_over_is_written_when_the_node_stops(
    kit: Any, start: Callable[..., Any], values: dict[str, Any], tmp_path: Path
) -> None:
    monitor = start(values)
    alarm_at(kit.Telemetry(monitor), 10)
    assert clips(tmp_path) == []
    assert monitor.stop() == 0
    (path,) = clips(tmp_path)
    assert open_bag(path).message_count > 10
    assert not list((tmp_path / 'clips').glob('.*'))


@pytest.mark.slow
def test_a_clip_that_cannot_be_written_is_told_and_the_node_goes_on(
    kit: Any, start: Callable[..., Any], values: dict[str, Any], tmp_path: Path
) -> None:
    monitor = start(values)
    telemetry = kit.Telemetry(monitor)
    shutil.rmtree(tmp_path / 'clips')
    (tmp_path / 'clips').touch()
    alarm_at(telemetry, 10)
    for second in range(11, 17):
        telemetry.step(20.0, 1000.0, second)
    monitor.peer.until(lambda: 'an event clip is lost' in monitor.output, 'the log')
    assert "clips' is a file, not a folder" in monitor.output
    assert telemetry.step(60.0, 1000.0, 17)['regime'] == 'stable'


@pytest.mark.slow
@pytest.mark.parametrize(
    ('module', 'words'),
    [
        ('stickslip_monitor.live', 'cannot be made: '),
        ('stickslip_monitor.ros.run', "run the executable 'monitor'"),
    ],
)
def test_a_node_that_cannot_keep_clips_does_not_start(
    module: str, words: str, run: Callable[..., Any], tmp_path: Path, kit: Any
) -> None:
    (tmp_path / 'file').touch()
    file = tmp_path / 'config.yaml'
    folder = {'clips.directory': str(tmp_path / 'file' / 'clips')}
    document = {'/**': {'ros__parameters': kit.parameters(kit.STAMPED) | folder}}
    file.write_text(yaml.safe_dump(document))
    program = run(sys.executable, '-m', module, '--ros-args', '--params-file', str(file))
    assert program.wait() == 2
    assert words in program.output
