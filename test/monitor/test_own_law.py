# SPDX-License-Identifier: Apache-2.0
"""A friction law added as a class works everywhere, and as Stribeck's of the same numbers does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_law import OwnLaw, WithoutFunctions
from shared import CONFIG, ROOT

from stickslip_monitor import Bearing, Stribeck, exact_cycle, exact_unstable_cycle
from stickslip_monitor.jit import has_compiler
from stickslip_monitor.physics.integrator import Drive, MotionState, integrate
from stickslip_monitor.physics.scalar_law import scalar_law

NUMBERS = (0.3, 0.1, 10.0)
REFERENCE = Bearing(50.0, 400.0, 2.0e6, Stribeck(*NUMBERS), 0.1)
OWN = replace(REFERENCE, friction=OwnLaw(*NUMBERS))
SPEED, LOAD = 0.05, 1000.0


def test_it_has_the_cycles_of_stribecks_law() -> None:
    for solve, speed in ((exact_cycle, SPEED), (exact_unstable_cycle, 0.18)):
        known, own = solve(REFERENCE, speed, LOAD), solve(OWN, speed, LOAD)
        assert own.amplitude == pytest.approx(known.amplitude, rel=1e-9)
        assert own.period == pytest.approx(known.period, rel=1e-9)


@pytest.mark.parametrize('law', [OwnLaw(*NUMBERS), WithoutFunctions(*NUMBERS)])
@pytest.mark.parametrize('compiled', [False, True])
def test_it_has_the_motion_of_stribecks_law(law: OwnLaw, compiled: bool) -> None:
    if compiled and not has_compiler():
        pytest.skip('numba is not installed')
    drive, start = Drive.sampled([0.0, 0.3], [0.03, 0.08], [900.0, 1100.0]), MotionState(0.0, 0.0)
    times = np.linspace(0.0, 0.3, 301)
    known, own = (
        integrate(replace(REFERENCE, friction=each), drive, start, times, compiled=compiled)
        for each in (REFERENCE.friction, law)
    )
    assert own.transitions.after.tolist() == known.transitions.after.tolist()
    assert own.displacement == pytest.approx(known.displacement, abs=1e-12)


def test_a_law_that_computes_otherwise_does_not_use_its_parents_functions() -> None:
    assert scalar_law(OwnLaw(*NUMBERS)).module is not None
    assert scalar_law(WithoutFunctions(*NUMBERS)).module is None


def stickslip(folder: Path, *arguments: str) -> str:
    """The output of a command in a process that has added the law."""
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
    """A scene is simulated with it and checked with it, and the map has the same boundaries."""
    found: dict[str, Any] = {}
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
        stickslip(folder, 'simulate', 'scene.yaml', '-o', 'bag')
        check = json.loads(stickslip(folder, 'check', 'bag', '-c', 'bearing.yaml', '--json'))
        stickslip(folder, 'map', '-c', 'bearing.yaml', '-o', 'map.csv')
        columns = np.genfromtxt(folder / 'map.csv', delimiter=',', skip_header=1)
        found[law] = check, columns
    (known, boundaries), (own, own_boundaries) = found['stribeck'], found['own']
    assert own_boundaries == pytest.approx(boundaries, rel=1e-5, nan_ok=True)
    assert [changes(report) for report in (own, known)] == [changes(known)] * 2
    assert changes(known)


def changes(report: dict[str, Any]) -> list[tuple[str, str]]:
    """From what to what the condition changed in a check's report."""
    events = next(iter(report['bearings'].values()))['events']
    return [(event['from'], event['to']) for event in events]
