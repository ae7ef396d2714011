# SPDX-License-Identifier: Apache-2.0
"""What a calibration reaches, on simulated ships and on the exact oscillator.

``python -m benchmarks.calibration_study [PART...]`` works out all parts, or some, and keeps their
figures in ``docs/calibration.json``; then it writes ``docs/calibration.md`` from them.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration_ships import BEARING, Passage, Ship, make_ships, reports_of, sail
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.physics.averaging.dimensionless import decline, speed_for_decline
from stickslip_monitor.physics.belief import Belief
from stickslip_monitor.study.calibration.calibrate import Calibration, calibrate
from stickslip_monitor.study.calibration.dips import (
    BIN_NS,
    Dip,
    TelemetryBins,
    VibrationReport,
    cut_dips,
)
from stickslip_monitor.study.calibration.posterior import prior_of

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / 'docs/calibration.json', ROOT / 'docs/calibration.md'
RPM = BEARING.speed.factor('rpm')
PRIOR = prior_of(BEARING)
_LOAD = 1000.0
_SHIPS, _OPERATED, _DRIFTING = 18, 9, 4
_STEADY_BAGS = (
    'coast_down', 'manoeuvring', 'slow_steaming_waves', 'load_excursion', 'history_above',
    'history_below', 'bistable_knock',
)  # fmt: skip


def everywhere(load: Array) -> Array:
    """No limit: a passage is one dip."""
    return np.full(load.shape, 1e3)


def dips_of(
    passages: Sequence[Passage],
    random: np.random.Generator,
    tolerance: float = 2.0,
    trust: float = 0.99,
    swapped: float = 0.0,
) -> list[Dip]:
    """The dips of a ship with the reports of a level, or of an operator."""
    return [
        dip
        for passage in passages
        for dip in cut_dips(
            passage.course, reports_of(passage, random, tolerance, trust, swapped), everywhere
        )
    ]


def truth(ship: Ship) -> tuple[float, float]:
    """Fold and Hopf speed of a ship at 1 kN [m/s]."""
    d = math.log(_LOAD) - ship.log_load
    beta = math.exp(ship.log_beta)
    return float(speed_for_decline(np.array([d]))[0]) / beta, d / beta


def fleet(count: int, seed: int) -> tuple[list[Ship], np.random.Generator]:
    """Ships with a bistable range at the loads of the study."""
    random = np.random.default_rng(seed)
    ships = [s for s in make_ships(3 * count, random) if math.log(_LOAD) - s.log_load > 0.4]
    return ships[:count], random


def judged(found: Calibration, ship: Ship) -> list[float]:
    """Error, half-width and whether it covers, of fold and Hopf speed at 1 kN."""
    row: list[float] = []
    belief = found.belief()
    for speed, true in zip((belief.fold_speed, belief.hopf_speed), truth(ship), strict=True):
        low, middle, high = (speed(_LOAD, p) for p in (0.05, 0.5, 0.95))
        row += [middle / true - 1.0, (high - low) / (2.0 * true), float(low <= true <= high)]
    return [*row, found.posterior.effective]


def coverage(seed: int, count: int, counts: Sequence[int], **kind: float) -> dict[str, Any]:
    """Error and coverage against the number of episodes."""
    ships, random = fleet(count, seed)
    rows: dict[int, list[list[float]]] = {n: [] for n in counts}
    for ship, own in zip(ships, sail(ships, max(counts), random), strict=True):
        dips = dips_of(own, random, **kind)
        for n in counts:
            rows[n].append(judged(calibrate(dips[:n], PRIOR), ship))
    return {
        'ships': len(ships),
        'rows': [[n, *_summary(np.array(rows[n]))] for n in counts],
    }


def _summary(rows: Array) -> list[float]:
    """Median error, bias and half-width, and share covered, of both; least effective number."""
    found: list[float] = []
    for k in (0, 3):
        error, half, covered = rows[:, k], rows[:, k + 1], rows[:, k + 2]
        found += [float(np.median(np.abs(error))), float(np.median(error))]
        found += [float(np.median(half)), float(covered.mean())]
    return [*found, float(rows[:, 6].min())]


def level() -> dict[str, Any]:
    """Reports of a level topic."""
    return coverage(202, _SHIPS, (1, 2, 5, 10, 20))


def operator() -> dict[str, Any]:
    """Reports of an operator: times +-10 s, one in ten with the state swapped."""
    return coverage(303, _OPERATED, (2, 5, 20), tolerance=10.0, trust=0.9, swapped=0.1)


def reliability() -> dict[str, Any]:
    """What was said of passages never seen, after five, and what was."""
    ships, random = fleet(8, 404)
    said: dict[str, list[tuple[Array, Array]]] = {name: [] for name in ('can', 'will', 'runs')}
    for ship, own in zip(ships, sail(ships, 13, random), strict=True):
        found = calibrate(dips_of(own[:5], random), PRIOR)
        draws = found.posterior.draws()[:, [0, 1, 5]]
        belief = Belief.from_draws(draws, found.floor, loads=found.loads)
        for passage in own[5:]:
            for name, pair in _said_and_was(belief, ship, passage).items():
                said[name].append(pair)
    return {name: _reliability(*map(np.concatenate, zip(*p, strict=True))) for name, p in
            said.items()}  # fmt: skip


def _said_and_was(belief: Belief, ship: Ship, passage: Passage) -> dict[str, tuple[Array, Array]]:
    from stickslip_monitor.physics.belief import probability_runs

    speed, load = passage.course.speed, passage.course.load
    d = np.log(load) - ship.log_load
    v = math.exp(passage.log_beta) * speed
    can, will = belief.probabilities(speed, load)
    return {
        'can': (can, (d > decline(v)).astype(float)),
        'will': (will, (d > v).astype(float)),
        'runs': (probability_runs(can, will), passage.sticking.astype(float)),
    }


def _reliability(said: Array, was: Array) -> dict[str, Any]:
    edges = np.array([0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0 + 1e-9])
    place = np.digitize(said, edges) - 1
    rows = [
        [float(said[place == k].mean()), float(was[place == k].mean()), int((place == k).sum())]
        for k in range(edges.size - 1)
        if (place == k).any()
    ]
    return {'rows': rows, 'brier': float(np.mean((said - was) ** 2))}


def drift() -> dict[str, Any]:
    """A bearing whose mu_s - mu_k rises by 42 % over 24 passages, with and without forgetting."""
    ships, random = fleet(_DRIFTING, 505)
    step = math.log(1.42) / 23.0
    rows: dict[str, list[list[float]]] = {'0': [], '0.03': []}
    warned = []
    for ship, own in zip(ships, sail(ships, 24, random, drift=step), strict=True):
        dips = dips_of(own, random)
        last = Ship(ship.log_beta, ship.log_load - 23.0 * step, ship.damping)
        try:
            together = calibrate(dips, PRIOR)
        except CalibrationError:  # no clear answer is a warning too
            warned.append(True)
        else:
            warned.append(any('may have changed' in text for text in together.warnings))
            rows['0'].append(judged(together, last))
        rows['0.03'].append(judged(calibrate(dips, PRIOR, forget=0.03), last))
    return {
        'ships': len(ships),
        'warned': int(sum(warned)),
        'rows': [[name, *_summary(np.array(found))] for name, found in rows.items() if found],
    }


def failures() -> dict[str, Any]:
    """What little, or wrong, evidence leaves: 5, 50, 95 % of both boundaries [rpm]."""
    cases: dict[str, Any] = {'no evidence': _rpm(calibrate([_quiet(300.0, 0)], PRIOR))}
    for count in (1, 5, 20):
        dips = [_quiet(43.5, k) for k in range(count)]
        cases[f'{count} quiet passages down to 43.5 rpm, above the fold'] = _rpm(
            calibrate(dips, PRIOR)
        )
    dips = [_quiet(32.9, k) for k in range(5)]
    cases['5 quiet passages down to 32.9 rpm, in the bistable range'] = _rpm(
        calibrate(dips, PRIOR)
    )
    return cases


def _quiet(lowest: float, number: int) -> Dip:
    second = np.arange(400)
    speed = np.maximum(lowest, lowest + 0.2 * np.abs(second - 200)) * RPM
    time = number * 10**12 + second * BIN_NS
    course = TelemetryBins('quiet', time, speed, np.full(400, _LOAD))
    report = VibrationReport('ship', int(time[0]), int(time[-1]), False, 2.0, 0.99, 'level')
    (dip,) = cut_dips(course, [report], everywhere)
    return dip


def _rpm(found: Calibration) -> list[list[float]]:
    belief = found.belief()
    return [
        [float(speed(_LOAD, p)) / RPM for p in (0.05, 0.5, 0.95)]
        for speed in (belief.hopf_speed, belief.fold_speed)
    ]


def oscillator() -> dict[str, Any]:
    """The exact oscillator's own truth in the package's recordings, two drawings, 1 and 7 bags."""
    right = (ROOT / 'launch_configs/reference_bearing.yaml').read_text()
    wrong = right.replace('damping: 400.0 ', 'damping: 560.0 ').replace(
        'static: 0.30, kinetic: 0.10, decay: 10.0', 'static: 0.26, kinetic: 0.10, decay: 12.5'
    )
    cases: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for drawing, text in (('right on average', right), ('wrong', wrong)):
            config, output = Path(folder) / 'config.yaml', Path(folder) / 'result.json'
            config.write_text(text)
            for bags in (_STEADY_BAGS[:1], _STEADY_BAGS):
                paths = [str(ROOT / 'bags' / bag) for bag in bags]
                command = ['stickslip_monitor', 'calibrate', *paths]
                subprocess.run(
                    [sys.executable, '-m', *command, '-c', str(config), '-o', str(output)],
                    check=False, capture_output=True,
                )  # fmt: skip
                cases[f'{drawing}, {len(bags)} recordings'] = _from_file(output)
    return cases


def _from_file(path: Path) -> list[list[float]]:
    from stickslip_monitor.study.calibration.calibrate import belief_in

    document = json.loads(path.read_text())
    belief = belief_in(np.array(document['draws']), document['floor'], 0.0, (1.0, 1e9))
    return [
        [float(speed(_LOAD, p)) / RPM for p in (0.05, 0.5, 0.95)]
        for speed in (belief.hopf_speed, belief.fold_speed)
    ]


PARTS: dict[str, Callable[[], dict[str, Any]]] = {
    part.__name__: part for part in (oscillator, failures, level, operator, reliability, drift)
}


def main(asked: Sequence[str]) -> None:
    """Work out the parts that are asked for, or all, and write the page."""
    from benchmarks.calibration_page import page

    for name in asked or PARTS:
        if name != 'page':
            found = {name: PARTS[name]()}
            RESULTS.write_text(json.dumps(_results() | found) + '\n')
            print(name, 'done', flush=True)
    PAGE.write_text(page(PAGE.read_text(), _results()))


def _results() -> dict[str, Any]:
    return dict(json.loads(RESULTS.read_text())) if RESULTS.exists() else {}


if __name__ == '__main__':
    main(sys.argv[1:])
