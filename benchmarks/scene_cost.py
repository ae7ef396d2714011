# SPDX-License-Identifier: Apache-2.0
"""Measure what each effect costs in an hour of telemetry; write the table of docs/scenes.md.

Each effect runs by itself, with the settings of its example on that page, on top of a steady shaft
that sticks and slips (20 rpm, 1000 N). The best of some repetitions counts.
"""

from __future__ import annotations

import argparse
import platform
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stickslip_monitor.commands.simulate import TELEMETRY, write_bag
from stickslip_monitor.lab.scenes.cost import REST, Stopwatch
from stickslip_monitor.lab.scenes.effects.registry import EFFECTS
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.scene_file import load_scene

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'scenes.md'
MARK = '<!-- Made by `python benchmarks/scene_cost.py`. -->\n'
HOUR, RATE = 3600.0, 10.0
STEADY = [
    {'speed_profile': {'unit': 'rpm', 'points': [[0, 20]]}},
    {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}},
]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--repeat', type=int, default=3, help='repetitions (default: 3)')
    parser.add_argument('--print', action='store_true', help='print the table, do not write it')
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        table = render(measure(Path(folder), args.repeat))
    if args.print:
        print(table)
        return 0
    head, _, _ = PAGE.read_text('utf-8').partition(MARK)
    PAGE.write_text(head + MARK + '\n' + table, 'utf-8')
    return 0


def examples() -> dict[str, Any]:
    """The settings of each effect's example in the docs."""
    blocks = re.findall(r'```yaml\n(- .*?)```', PAGE.read_text('utf-8'), flags=re.DOTALL)
    return {k: v for block in blocks for entry in yaml.safe_load(block) for k, v in entry.items()}


def measure(folder: Path, repeat: int) -> dict[str, float]:
    """Seconds for an hour: of the telemetry as such, of writing it, and of each effect."""
    found = examples()
    best: dict[str, float] = {}
    for name in ('', *EFFECTS):
        own = [{name: found[name]}] if name else []
        clash = {'speed_profile', 'load_profile'} & {name}
        steady = [effect for effect in STEADY if not clash & set(effect)]
        scene = _scene(folder, [*steady, *own])
        _run(replace(scene, duration=100.0), folder)  # imports, and compiles the integrator
        for _ in range(repeat):
            spent = _run(scene, folder)
            for key in (name,) if name else (TELEMETRY, REST):
                best[key] = min(best.get(key, np.inf), spent.get(key, 0.0))
    return best


def _scene(folder: Path, effects: list[dict[str, Any]]) -> Scene:
    reference = ROOT / 'launch_configs' / 'reference_bearing.yaml'
    config = yaml.safe_load(reference.read_text('utf-8'))
    bearing = config['/**']['ros__parameters']['aft_stern']
    bearing['speed'] |= {'type': 'geometry_msgs/msg/TwistStamped', 'field': 'twist.angular.x'}
    bearing['load'] |= {'type': 'geometry_msgs/msg/WrenchStamped', 'field': 'wrench.force.z'}
    telemetry = {'speed': {'rate': RATE}, 'load': {'rate': RATE}}
    if any('vibration_background' in effect for effect in effects):
        bearing['level'] = {'topic': '/aft/level', 'unit': 'mm/s'}
        telemetry['level'] = {'rate': RATE}
    (folder / 'config.yaml').write_text(yaml.safe_dump(config), 'utf-8')
    scene = {
        'scene': 'stickslip_monitor/scene/1',
        'description': 'An hour.',
        'duration': HOUR,
        'start': 1_700_000_000_000_000_000,
        'seed': 1,
        'config': 'config.yaml',
        'telemetry': telemetry,
        'effects': effects,
    }
    path = folder / 'scene.yaml'
    path.write_text(yaml.safe_dump(scene), 'utf-8')
    return load_scene(path)


def _run(scene: Scene, folder: Path) -> dict[str, float]:
    stopwatch = Stopwatch(time.process_time)
    path = folder / 'bag.mcap'
    write_bag(scene, path, stopwatch=stopwatch)
    path.unlink()
    return stopwatch.spent


def render(seconds: dict[str, float]) -> str:
    """The section with the table."""
    samples = 2 * (HOUR * RATE + 1)
    machine = (
        f'Python {platform.python_version()}, numpy {np.__version__}, {_processor()}, one core'
    )
    lines = [
        'Processor time for an hour of a speed and a load at 10 Hz, each effect by itself with',
        'the settings of its example above, while the lining sticks and slips at 32 Hz',
        f'({machine}).',
        'What a sensor with a memory asks of the shaft between its samples counts for the effects',
        'on the shaft, and `friction_drift` acts within `lining_motion`.',
        '',
        '| effect | an hour takes | per sample |',
        '|---|---:|---:|',
    ]
    for name, spent in seconds.items():
        label = f'`{name}`' if name in EFFECTS else f'({name})'
        lines.append(f'| {label} | {_time(spent)} | {_time(spent / samples)} |')
    return '\n'.join(lines) + '\n'


def _time(seconds: float) -> str:
    if not seconds:
        return '–'
    for unit, size in (('s', 1.0), ('ms', 1e-3), ('µs', 1e-6)):
        if seconds >= size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds * 1e9:.0f} ns'


def _processor() -> str:
    for line in Path('/proc/cpuinfo').read_text('utf-8').splitlines():
        if line.startswith('model name'):
            return line.partition(':')[2].strip()
    return platform.machine()


if __name__ == '__main__':
    sys.exit(main())
