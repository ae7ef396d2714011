# SPDX-License-Identifier: Apache-2.0
"""``stickslip simulate``: the bag as another reader sees it, and no bag where there is none."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from shared import Stickslip

from stickslip_logs.recordings.writer import BagWriter

STORE = get_typestore(Stores.ROS2_JAZZY)
CONFIG = """
/**:
  ros__parameters:
    bearings: [aft]
    aft:
      mass: 50.0
      damping: 400.0
      stiffness: 2.0e6
      journal_diameter: 0.1
      friction: {law: stribeck, static: 0.3, kinetic: 0.1, decay: 10.0}
      speed: {topic: /shaft/speed, unit: rpm, scale: 0.5}
      load: {topic: /bearing/aft/load, unit: kN, offset: -2.0}
"""
SCENE = """
scene: stickslip_monitor/scene/1
description: A test.
duration: 150.0
start: 2026-05-04T12:00:00Z
seed: 7
config: config.yaml
telemetry: {speed: {rate: 2.0}, load: {rate: 0.5}}
effects:
  - speed_profile: {unit: rpm, points: [[0, 60], [150, 30]]}
  - load_profile: {unit: N, points: [[0, 1000]]}
"""
START = 1_777_896_000 * 10**9


@pytest.fixture
def scene(tmp_path: Path) -> str:
    (tmp_path / 'config.yaml').write_text(CONFIG, 'utf-8')
    (tmp_path / 'scene.yaml').write_text(SCENE, 'utf-8')
    return str(tmp_path / 'scene.yaml')


def test_a_scene_without_rates_takes_those_of_a_file_of_sensors(
    tmp_path: Path, scene: str, stickslip: Stickslip
) -> None:
    without = tmp_path / 'without.yaml'
    without.write_text('\n'.join(line for line in SCENE.splitlines() if 'telemetry' not in line), 'utf-8')
    refused = stickslip('simulate', without, '-o', tmp_path / 'bag')
    assert refused.code == 2
    assert 'or give a file of sensors by --sensors' in refused.err
    sensors = tmp_path / 'sensors.yaml'
    rates = '{speed: {rate: 1.0}, load: {rate: 0.1}}'
    text = f'sensors: stickslip_monitor/sensors/1\ndescription: Slow.\ntelemetry: {rates}\n'
    sensors.write_text(text, 'utf-8')
    done = stickslip('simulate', without, '--sensors', sensors, '-o', tmp_path / 'bag')
    assert (done.code, '167 messages' in done.out) == (0, True)


@pytest.mark.parametrize('name', ['bag', 'bag.mcap', 'new/folder/bag'])
def test_rosbags_reads_the_bag(tmp_path: Path, scene: str, stickslip: Stickslip, name: str) -> None:
    target = tmp_path / name
    expected = f'{target}: 150 s, 377 messages on /shaft/speed, /bearing/aft/load\n'
    assert stickslip('simulate', scene, '-o', target) == (0, expected, '')
    rows: dict[str, list[tuple[int, float]]] = {}
    order = []
    with Reader(target) as reader:
        assert {c.msgtype for c in reader.connections} == {'std_msgs/msg/Float64'}
        for connection, time, data in reader.messages():
            message: Any = STORE.deserialize_cdr(data, connection.msgtype)
            rows.setdefault(connection.topic, []).append((time, message.data))
            order.append(time)
    assert order == sorted(order)
    stamps, speed = zip(*rows['/shaft/speed'], strict=True)
    assert list(stamps) == [START + k * 500_000_000 for k in range(301)]
    np.testing.assert_allclose(speed, 2.0 * np.linspace(60.0, 30.0, 301), rtol=1e-13)
    stamps, load = zip(*rows['/bearing/aft/load'], strict=True)
    assert list(stamps) == [START + k * 2_000_000_000 for k in range(76)]
    np.testing.assert_allclose(load, 3.0, rtol=1e-13)


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_an_existing_output_is_not_overwritten(
    tmp_path: Path, scene: str, stickslip: Stickslip, name: str
) -> None:
    target = tmp_path / name
    target.write_text('dear', 'utf-8')
    message = f"ERROR: bag '{target}' exists already and is not overwritten\n"
    assert stickslip('simulate', scene, '-o', target) == (2, '', message)
    assert target.read_text('utf-8') == 'dear'
    assert {p.name for p in tmp_path.iterdir()} == {'config.yaml', 'scene.yaml', name}


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_file_that_may_not_grow_leaves_no_bag(tmp_path: Path, scene: str, name: str) -> None:
    # The system itself refuses to write on, as on a full disk.
    code = (
        'import resource, sys\n'
        'from stickslip_monitor.cli import main\n'
        'resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))\n'
        'sys.exit(main(sys.argv[1:]))\n'
    )
    target = str(tmp_path / name)
    command = [sys.executable, '-c', code, 'simulate', scene, '-o', target]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr == f"ERROR: bag '{target}' cannot be written: File too large\n"
    assert {p.name for p in tmp_path.iterdir()} == {'config.yaml', 'scene.yaml'}


def test_operating_point_out_of_range_leaves_no_bag(tmp_path: Path, scene: str, stickslip: Stickslip) -> None:
    # It is found in the third minute, when two are written already.
    config = tmp_path / 'config.yaml'
    config.write_text(config.read_text('utf-8').replace('-2.0}', '-2.0, maximum: 1500}'), 'utf-8')
    path = tmp_path / 'scene.yaml'
    text = path.read_text('utf-8').replace('[[0, 1000]]', '[[130, 1000], [150, 2000]]')
    path.write_text(text, 'utf-8')
    assert stickslip('simulate', scene, '-o', tmp_path / 'bag').err == (
        f'ERROR: {scene}: load = 1600 N at 142 s is more than topic /bearing/aft/load can carry:'
        ' aft.load.maximum = 1500 N in the configuration\n'
    )
    assert {p.name for p in tmp_path.iterdir()} == {'config.yaml', 'scene.yaml'}


def test_day_is_written_as_it_is_made(tmp_path: Path, scene: str) -> None:
    """Compare the largest memory of an hour and of a day; kept messages would take 17 MB."""
    code = (
        'import sys\n'
        'from dataclasses import replace\n'
        'from stickslip_lab.scenes.scene import write_bag\n'
        'from stickslip_lab.scenes.scene import load_scene\n'
        'scene = load_scene(sys.argv[1])\n'
        'for hours in (1, 24):\n'
        '    write_bag(replace(scene, duration=3600.0 * hours), f"{sys.argv[2]}/{hours}.mcap")\n'
        '    status = open("/proc/self/status").read()\n'
        '    print(status.partition("VmHWM:")[2].split()[0])\n'
    )
    command = [sys.executable, '-c', code, scene, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    hour, day = map(int, done.stdout.split())
    assert day - hour < 12_000  # kilobytes; chunks and their compression take up to nine


def test_truth_and_cut_are_told_apart_from_telemetry(
    tmp_path: Path, scene: str, stickslip: Stickslip
) -> None:
    """Before 100 s: 200 and 50 messages, and 100 on each of the four topics at 1 Hz."""
    with Path(scene).open('a', encoding='utf-8') as file:
        file.write('  - operating_point: {rate: 1.0}\n  - cut_off: {time: 100.0}\n')
    assert stickslip('simulate', scene, '-o', tmp_path / 'bag').out == (
        f'{tmp_path / "bag"}: 150 s, cut off at 100 s, 250 messages on /shaft/speed,'
        ' /bearing/aft/load, 400 on 4 of the truth\n'
    )


def test_stopping_in_the_middle_leaves_no_bag(
    tmp_path: Path, scene: str, stickslip: Stickslip, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = BagWriter.write_columns
    blocks: list[Any] = []

    def stop(writer: BagWriter, columns: Any) -> None:
        if blocks:
            raise KeyboardInterrupt
        blocks.append(columns)
        write(writer, columns)

    monkeypatch.setattr(BagWriter, 'write_columns', stop)
    assert stickslip('simulate', scene, '-o', tmp_path / 'bag').code == 130
    assert blocks
    assert {p.name for p in tmp_path.iterdir()} == {'config.yaml', 'scene.yaml'}
