# SPDX-License-Identifier: Apache-2.0
"""A friction law added as a class is simulated, too."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import CONFIG, ROOT


def run_stickslip(folder: Path, *arguments: str) -> str:
    """Return the output of a command in a process that has added the law."""
    code = 'import sys, own_law; from stickslip_monitor.cli import main; sys.exit(main())'
    paths = os.pathsep.join([str(ROOT / 'test'), str(ROOT)])
    done = subprocess.run(
        [sys.executable, '-c', code, *arguments],
        cwd=folder,
        env=os.environ | {'PYTHONPATH': paths},
        capture_output=True,
        text=True,
    )
    assert done.returncode in (0, 1), done.stderr
    return done.stdout


@pytest.mark.slow
def test_commands_take_it_as_they_take_stribecks(tmp_path: Path) -> None:
    """Simulate and check a scene with it, and find the same boundaries in the map."""
    events: dict[str, Any] = {}
    scene = (ROOT / 'launch_configs' / 'scenes' / 'history_below.yaml').read_text('utf-8')
    scene = scene.replace('duration: 120.0', 'duration: 40.0')
    scene = scene.replace('[[10, 20], [60, 36]]', '[[5, 50], [30, 20]]')
    for law in ('stribeck', 'own'):
        folder = tmp_path / law
        folder.mkdir()
        text = CONFIG.read_text('utf-8').replace('law: stribeck', f'law: {law}')
        (folder / 'bearing.yaml').write_text(text, 'utf-8')
        (folder / 'scene.yaml').write_text(
            scene.replace('../reference_bearing.yaml', 'bearing.yaml'), 'utf-8'
        )
        run_stickslip(folder, 'simulate', 'scene.yaml', '-o', 'bag')
        check = json.loads(run_stickslip(folder, 'check', 'bag', '-c', 'bearing.yaml', '--json'))
        run_stickslip(folder, 'map', '-c', 'bearing.yaml', '-o', 'map.csv')
        columns = np.genfromtxt(folder / 'map.csv', delimiter=',', skip_header=1)
        events[law] = check, columns
    (stribeck, boundaries), (by_methods, own_boundaries) = events['stribeck'], events['own']
    assert own_boundaries == pytest.approx(boundaries, rel=1e-5, nan_ok=True)
    assert [condition_changes(report) for report in (by_methods, stribeck)] == [
        condition_changes(stribeck)
    ] * 2
    assert condition_changes(stribeck)


def condition_changes(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the condition before and after each change in a check's report."""
    events = next(iter(report['bearings'].values()))['events']
    return [(event['from'], event['to']) for event in events]
