# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stickslip_lab.scenes.scene import Scene, load_scene, simulate
from stickslip_lab.scenes.telemetry import Messages

BEARING: dict[str, Any] = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction': {'law': 'stribeck', 'static': 0.3, 'kinetic': 0.1, 'decay': 10.0},
    'speed': {'topic': '/shaft/speed', 'unit': 'rpm'},
    'load': {'topic': '/bearing/aft/load', 'unit': 'N'},
}
FORCE = {'type': 'geometry_msgs/msg/WrenchStamped', 'field': 'wrench.force.z'}
TURN = {'type': 'geometry_msgs/msg/TwistStamped', 'field': 'twist.angular.x'}
STAMPED: dict[str, Any] = {'speed': TURN, 'load': FORCE}
MEASURED = STAMPED | {'level': FORCE | {'topic': '/aft/level', 'unit': 'mm/s'}}
WATERED = MEASURED | {'friction': {'at_temperature': 15.0}, 'water_temperature': {'constant': 10.0}}
KNOWN = {
    'stamped': {'aft': STAMPED},
    'measured': {'aft': MEASURED},
    'watered': {'aft': WATERED},
    None: {'aft': {}},
}
SCENE: dict[str, Any] = {
    'scene': 'stickslip_monitor/scene/1',
    'description': 'A test.',
    'duration': 100.0,
    'start': 1_700_000_000_000_000_000,
    'seed': 7,
    'config': 'config.yaml',
    'telemetry': {'speed': {'rate': 10.0}, 'load': {'rate': 4.0}},
    'effects': [
        {'speed_profile': {'unit': 'rpm', 'points': [[10, 60], [50, 20]]}},
        {'load_profile': {'unit': 'kN', 'points': [[0, 1.0]]}},
    ],
}


def bearing_with(changes: dict[str, Any]) -> dict[str, Any]:
    """Return the reference bearing with some quantities replaced, and some of the inputs' keys."""
    return BEARING | {k: BEARING.get(k, {}) | v if isinstance(v, dict) else v for k, v in changes.items()}


@pytest.fixture
def scene_path(tmp_path: Path) -> Callable[..., Path]:
    """Write a configuration and a scene.

    ``bearings`` holds for each what differs from the reference bearing (``'stamped'``: stamps in
    the headers, ``'measured'``: these and a level), ``rate`` is that of speed and load, and the
    other arguments are what differs in the scene (None: left out).
    """

    def write(bearings: dict[str, Any] | str | None = None, rate: float = 0.0, **changes: Any) -> Path:
        changes_by_name = bearings if isinstance(bearings, dict) else KNOWN[bearings]
        bearing_values = {name: bearing_with(changes) for name, changes in changes_by_name.items()}
        if rate:
            changes['telemetry'] = {'speed': {'rate': rate}, 'load': {'rate': rate}}
        config = {'/**': {'ros__parameters': {'bearings': list(bearing_values)} | bearing_values}}
        (tmp_path / 'config.yaml').write_text(dump_yaml(config), 'utf-8')
        scene = {k: v for k, v in (SCENE | changes).items() if v is not None}
        path = tmp_path / 'scene.yaml'
        path.write_text(dump_yaml(scene), 'utf-8')
        return path

    return write


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def dump_yaml(document: Any) -> str:
    return str(yaml.dump(document, Dumper=_Plain, sort_keys=False))


@pytest.fixture
def make_scene(scene_path: Callable[..., Path]) -> Callable[..., Scene]:
    """Return a function that loads the scene with some keys replaced."""
    return lambda *args, **changes: load_scene(scene_path(*args, **changes))


@pytest.fixture
def messages_of() -> Callable[..., dict[str, Messages]]:
    """Return a function that collects the messages of each topic of a scene."""

    def collect(scene: Scene, *block_length: float) -> dict[str, Messages]:
        blocks = list(simulate(scene, *block_length))
        messages = {}
        for topic in blocks[0].signals:
            parts = [block.signals[topic].messages() for block in blocks]
            stamps = [p.stamp_ns for p in parts if p.stamp_ns is not None]
            messages[topic] = Messages(
                np.concatenate([part.log_time_ns for part in parts]),
                np.concatenate(stamps) if stamps else None,
                np.concatenate([part.raw for part in parts]),
            )
        return messages

    return collect
