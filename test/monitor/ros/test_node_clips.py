# SPDX-License-Identifier: Apache-2.0
"""Event clips of the real node: what is in them, and what happens where they cannot be written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import kit
import pytest

from stickslip_logs.recordings.reader import open_bag
from stickslip_monitor import build_config
from stickslip_monitor.offline.check import check_recording

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


@pytest.fixture
def values(tmp_path: Path) -> dict[str, Any]:
    """Return parameters of one bearing, with clips of two seconds before and after an alarm."""
    return kit.stamped_parameters() | {
        'clips.directory': str(tmp_path / 'clips'),
        'clips.around': 2.0,
        'clips.most': 2,
    }


def clip_files(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / 'clips').glob('*.mcap'))


def raise_alarm(telemetry: Any, seconds: float) -> float:
    """Five quiet seconds, then stick-slip for so long; when its alarm is raised [s].

    By the median, 20 rpm are there from the second value on, and for the on-delay of 0.5 s.
    """
    telemetry.hold(60.0, 1000.0, 5.0)
    telemetry.hold(20.0, 1000.0, seconds)
    return float(telemetry.now - seconds + 0.7)


def test_an_alarm_leaves_a_clip_that_can_be_checked(
    host: Callable[..., Any], values: dict[str, Any], tmp_path: Path
) -> None:
    monitor = host(values)
    raised = raise_alarm(kit.Telemetry(monitor), 4.0)
    monitor.peer.until(lambda: clip_files(tmp_path), 'the clip')
    path = clip_files(tmp_path)[0]
    bag = open_bag(path)
    space = f'/{monitor.space}'
    kinds = {name: topic.type for name, topic in bag.topics.items()}
    assert kinds[f'{space}/shaft'] == 'sensor_msgs/msg/JointState'
    for name in ('aft/amplitude', 'aft/hopf_margin', 'aft/fold_margin', 'aft/regime', 'warnings'):
        assert f'{space}/stickslip_monitor/{name}' in kinds
    assert f'{space}/diagnostics' in kinds
    # Two seconds before the first event of the alarm and after the last, and no other, to half a sample.
    seconds = [(m.log_time_ns - kit.T0) / kit.SECOND for m in bag.messages([f'{space}/shaft'])]
    assert raised - 2.75 <= seconds[0] <= raised - 1.85
    assert raised + 1.25 <= seconds[-1] <= raised + 2.05
    # The same monitor over the clip alone says the same.
    inputs = {f'aft.{quantity}.topic': f'{space}/shaft' for quantity in ('speed', 'load')}
    report = check_recording(path, build_config(kit.node_parameters(kit.STAMPED) | inputs))
    onsets = [e for e in report.bearings['aft'].events if e.after.value == 'stick_slip']
    assert onsets[0].time_ns == pytest.approx(kit.T0 + raised * kit.SECOND, abs=1e3)


def test_a_clip_that_is_not_over_is_written_when_the_node_stops(
    host: Callable[..., Any], values: dict[str, Any], tmp_path: Path
) -> None:
    monitor = host(values)
    raise_alarm(kit.Telemetry(monitor), 1.0)
    assert clip_files(tmp_path) == []
    monitor.end()
    (path,) = clip_files(tmp_path)
    assert path.name.endswith('_aft_stick_slip.mcap')
    assert open_bag(path).message_count > 10
    assert not list((tmp_path / 'clips').glob('.*'))


def test_a_clip_that_cannot_be_written_is_reported_and_written_when_there_is_room_again(
    host: Callable[..., Any], values: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('stickslip_monitor.state_file.RETRY_PERIOD', 0.02)
    monitor = host(values)
    diagnostics = monitor.diagnostics()
    telemetry = kit.Telemetry(monitor)
    shutil.rmtree(tmp_path / 'clips')
    (tmp_path / 'clips').touch()
    raise_alarm(telemetry, 4.0)
    monitor.peer.until(lambda: 'an event clip is lost' in monitor.output, 'the log')
    assert "clips' is a file, not a folder" in monitor.output
    assert telemetry.step(60.0, 1000.0)['regime'] == 'stable'

    def health() -> str:
        return str(kit.latest_status(diagnostics, 'the node').get('message', ''))

    monitor.peer.until(lambda: 'an event clip is lost' in health(), 'the fault')
    (tmp_path / 'clips').unlink()
    monitor.peer.until(lambda: clip_files(tmp_path), 'the clip')
    monitor.peer.until(lambda: 'an event clip is lost' not in health(), 'the end of the fault')
