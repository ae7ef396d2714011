# SPDX-License-Identifier: Apache-2.0
"""What a calibration reaches, on simulated ships and on the exact oscillator.

``python -m benchmarks.calibration_study [PART...]`` works out all parts, or some, and keeps their
figures in ``docs/calibration.json``; then it writes ``docs/calibration.md`` from them.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration_ships import BEARING, Passage, Ship, make_ships, reports_of, sail
from stickslip_monitor.drawing.canvas import INK, MUTED, new_figure, save_figure, style
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.lab.calibration.calibrate import (
    Calibration,
    calibrate,
    dip_limit,
)
from stickslip_monitor.lab.calibration.evidence import (
    TRUST,
    TRUTH_TOLERANCE,
    Dip,
    alternating,
    cut_dips,
)
from stickslip_monitor.lab.calibration.posterior import prior_of
from stickslip_monitor.lab.calibration.recordings import courses_of
from stickslip_monitor.lab.scenes.scene import load_scene
from stickslip_monitor.lab.voyages import OURS, Sailed, cases_of
from stickslip_monitor.lab.warning_quality import FIGURES, Quality, pooled, written
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.closed_form import decline, speed_for_decline
from stickslip_monitor.physics.probability import Belief, probability_runs

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / 'docs/calibration.json', ROOT / 'docs/calibration.md'
PICTURE = ROOT / 'docs/images/reliability.png'
RPM = BEARING.speed.factor('rpm')
PRIOR = prior_of(BEARING)
_LOAD = 1000.0
_SHIPS, _OPERATED, _SAID, _DRIFTING = 24, 24, 12, 8
_PASSAGES = 24
_QUALITY = ROOT / 'launch_configs/scenes/quality'
_LEARNING = ('manoeuvring', 'slowing_down')
_JUDGED = ('manoeuvring', 'slowing_down', 'creeping', 'slow_load', 'trim_change')
_SENSORS = ROOT / 'launch_configs/sensors/ordinary.yaml'
_TEN = 10
_MEASURES = ('episodes', 'warned', 'lead_10s', 'missed', 'detected', 'false_per_100h')


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
    refused, warned = 0, 0
    for ship, own in zip(ships, sail(ships, max(counts) + 4, random), strict=True):
        dips = dips_of(own, random, **kind)
        episodes = np.cumsum([dip.episode for dip in dips])
        for n in counts:
            try:
                found = calibrate(dips[: int(np.searchsorted(episodes, n)) + 1], PRIOR)
            except CalibrationError:
                refused += 1
                continue
            rows[n].append(judged(found, ship))
            warned += n == max(counts) and _says_changed(found)
    return {
        'ships': len(ships),
        'refused': refused,
        'warned': warned,
        'rows': [[n, *_summary(np.array(rows[n]))] for n in counts],
    }


def _says_changed(found: Calibration) -> bool:
    return any('may have changed' in text for text in found.warnings)


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
    return coverage(606, _SHIPS, (1, 2, 5, 10, 20))


def operator() -> dict[str, Any]:
    """Reports of an operator: times +-10 s, one in ten with the state swapped."""
    return coverage(707, _OPERATED, (2, 5, 20), tolerance=10.0, trust=0.9, swapped=0.1)


def reliability() -> dict[str, Any]:
    """Predicted probabilities of passages never seen, after five, and what was observed."""
    ships, random = fleet(_SAID, 404)
    said: dict[str, list[tuple[Array, Array]]] = {name: [] for name in ('can', 'will', 'runs')}
    for ship, own in zip(ships, sail(ships, 13, random), strict=True):
        found = calibrate(dips_of(own[:5], random), PRIOR)
        draws = found.posterior.draws()[:, [0, 1, 5]]
        belief = Belief.from_draws(draws, found.floor, loads=found.loads)
        for passage in own[5:]:
            for name, pair in _said_and_was(belief, ship, passage).items():
                said[name].append(pair)
    return {
        'ships': len(ships),
        **{n: _reliability(*map(np.concatenate, zip(*p, strict=True))) for n, p in said.items()},
    }


def _said_and_was(belief: Belief, ship: Ship, passage: Passage) -> dict[str, tuple[Array, Array]]:
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
    """A bearing whose mu_s - mu_k rises by 42 % over its passages, with and without forgetting."""
    ships, random = fleet(_DRIFTING, 505)
    step = math.log(1.42) / (_PASSAGES - 1)
    rows: dict[str, list[list[float]]] = {'0': [], '0.03': []}
    warned = []
    for ship, own in zip(ships, sail(ships, _PASSAGES, random, drift=step), strict=True):
        dips = dips_of(own, random)
        last = Ship(ship.log_beta, ship.log_load - (_PASSAGES - 1) * step, ship.damping)
        for forget, found in rows.items():
            try:
                result = calibrate(dips, PRIOR, forget=float(forget))
            except CalibrationError:  # no clear answer is a warning too
                warned.append(forget == '0')
                continue
            warned.append(forget == '0' and _says_changed(result))
            found.append(judged(result, last))
    return {
        'ships': len(ships),
        'warned': int(sum(warned)),
        'rows': [[name, *_summary(np.array(found))] for name, found in rows.items() if found],
    }


def voyages() -> dict[str, Any]:
    """The warnings over whole voyages, with a wrong drawing and after wear, then calibrated."""
    found: dict[str, list[Quality]] = {}
    for number in range(_TEN):
        learning = [case for name in _LEARNING for case in _simulated(name, _TEN + number)]
        judged_cases = [case for name in _JUDGED for case in _simulated(name, 2 * _TEN + number)]
        true = learning[0].sent.config
        told = {'as it is': true, 'wrong drawing': _drawn_wrong(true), 'worn': _unworn(true)}
        for name, config in told.items():
            calibrated = _calibrated(config, learning)
            for state, own in (('', config), (', calibrated', calibrated)):
                part = found.setdefault(name + state, [])
                part += [
                    replace(case, sent=replace(case.sent, config=own)).rules()[OURS]
                    for case in judged_cases
                ]
    figures = {name: pooled(parts).figures() for name, parts in found.items()}
    return {name: {key: own[key] for key in ('hours', *_MEASURES)} for name, own in
            figures.items()}  # fmt: skip


def _simulated(scene: str, seed: int) -> list[Sailed]:
    return list(cases_of(load_scene(_QUALITY / f'{scene}.yaml', seed, _SENSORS)))


def _drawn_wrong(config: BearingConfig) -> BearingConfig:
    """Damping 40 % high, ``mu_s - mu_k`` 20 % low and decay 25 % high."""
    law: Any = config.bearing.friction
    fall = 0.8 * (law.static - law.kinetic)
    law = replace(law, static=law.kinetic + fall, decay=1.25 * law.decay)
    bearing = replace(config.bearing, damping=1.4 * config.bearing.damping, friction=law)
    return replace(config, bearing=bearing)


def _unworn(config: BearingConfig) -> BearingConfig:
    """The law of the first day: since then friction has risen by 60 %."""
    law: Any = config.bearing.friction
    law = replace(law, static=law.static / 1.6, kinetic=law.kinetic / 1.6)
    return replace(config, bearing=replace(config.bearing, friction=law))


def _calibrated(config: BearingConfig, learning: Sequence[Sailed]) -> BearingConfig:
    """With what the lining did on other voyages, as a level would tell it."""
    dips = []
    prior = prior_of(config.bearing, config.tolerance)
    for number, case in enumerate(learning):
        own, span = case.truth, (case.truth.start_ns, case.truth.end_ns)
        reports = alternating('ship', span, own.episodes, TRUTH_TOLERANCE, TRUST, 'level')
        for course in courses_of(f'voyage {number + 1}', case.recorded()):
            dips += cut_dips(course, reports, dip_limit(prior), prior.viscous)
    found = calibrate(dips, prior)
    draws = found.posterior.draws()[:, [0, 1, 5]]
    belief = Belief.from_draws(draws, found.floor, prior.viscous, found.loads)
    return replace(config, bearing=belief.nominal(config.bearing), belief=belief)


PARTS: dict[str, Callable[[], dict[str, Any]]] = {
    part.__name__: part
    for part in (
        level, operator, reliability, drift, voyages,
    )
}  # fmt: skip


MARK = '<!-- What follows is made by `make calibration-study`. -->\n'
_SAYINGS = {
    'can': 'stick-slip can happen',
    'will': 'it starts by itself',
    'runs': 'it runs (thresholds)',
}
_LOOKS = (('#0072b2', 'o'), ('#d55e00', 's'), ('#009e73', 'D'))
_HEAD = ('fold: error', 'half-width', 'cover', 'Hopf: error', 'half-width', 'cover')


def _page(before: str, results: Mapping[str, Any]) -> str:
    """The page with its results made anew; those that there are."""
    parts = [before.partition(MARK)[0] + MARK]
    for name, section in _TEXTS.items():
        if name in results:
            parts.append(section(results[name]))
    return '\n'.join(parts).rstrip() + '\n'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f'| {" | ".join(head)} |', f'|{"---|" * len(head)}']
    return '\n'.join([*lines, *(f'| {" | ".join(row)} |' for row in rows), ''])


def _coverage(rows: Sequence[Sequence[Any]], first: str = 'episodes') -> str:
    cells = []
    for name, *values in rows:
        texts = [str(name)]
        for k in (0, 4):
            error, _, half, cover = values[k : k + 4]
            texts += [f'{error:.1%}', f'{half:.1%}', f'{cover:.0%}']
        cells.append(texts)
    return _table([first, *_HEAD], cells)


def _level_text(result: Mapping[str, Any]) -> str:
    return (
        f'## Reports of a level: {result["ships"]} ships\n\n'
        'Median error of the posterior median, median half-width of the 90 % interval, and how'
        ' often it\ncovers the truth.\n\n'
        + _coverage(result['rows'])
        + f'\nA change of the bearing was reported falsely for {result["warned"]} ships;'
        f' results refused: {result["refused"]}.\n'
    )


def _operator_text(result: Mapping[str, Any]) -> str:
    return (
        f'## Reports of an operator: {result["ships"]} ships\n\n'
        'Times off by up to 5 s and given with 10 s; one report in ten says the opposite; trust'
        f' 0.9.\nResults refused: {result["refused"]}.\n\n' + _coverage(result['rows'])
    )


def _reliability_text(result: Mapping[str, Any]) -> str:
    brier = ', '.join(f'{text} {result[name]["brier"]:.4f}' for name, text in _SAYINGS.items())
    return (
        '## Reliability: predicted and observed\n\n'
        f'{result["ships"]} ships, calibrated with five passages, then eight passages never seen.'
        f' Brier scores: {brier}.\n`runs` goes by thresholds and begins before the noise has'
        ' grown: it is for warnings.\n\n![Predicted and observed](images/reliability.png)\n'
    )


def _draw_reliability(result: Mapping[str, Any]) -> None:
    with style():
        figure = new_figure(5.6, 5.2)
        axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], color=MUTED, lw=1.0, ls='--', label='as often as predicted')
        for (name, text), (colour, marker) in zip(_SAYINGS.items(), _LOOKS, strict=True):
            said, was, count = np.array(result[name]['rows']).T
            axes.plot(said, was, color=colour, lw=1.2, marker=marker, label=text)
            size = 12.0 + 40.0 * np.log10(count)
            axes.scatter(said, was, size, color=colour, marker=marker, ec='white', zorder=3)
        axes.set_xlabel('predicted probability')
        axes.set_ylabel('share of the seconds in which it was so')
        axes.set_aspect('equal')
        axes.tick_params(colors=INK)
        axes.legend(frameon=False, loc='upper left')
        figure.tight_layout()
    save_figure(figure, PICTURE, force=True)


def _drift_text(result: Mapping[str, Any]) -> str:
    return (
        '## A bearing that wears\n\n'
        f'`mu_s - mu_k` rises by 42 % over {_PASSAGES} passages; the last one is judged,'
        f' {result["ships"]} ships.\nThat the bearing may have changed was reported, or the result'
        f' refused, for {result["warned"]} of\nthem. The rows are of those that had an answer.\n\n'
        + _coverage(result['rows'], '`--forget`')
    )


def _voyages_text(result: Mapping[str, Any]) -> str:
    rows = [[name, *(written(m, own[m]) for m in _MEASURES)] for name, own in result.items()]
    hours = next(iter(result.values()))['hours']
    return (
        '## Whole voyages, before and after\n\n'
        f'Ten bearings, ordinary sensors, {hours:.0f} h of {", ".join(_JUDGED)} in the measures of'
        '\n[warning quality](warning_quality.md); calibrated on one other voyage each of'
        f' {" and ".join(_LEARNING)}.\nThe wrong drawing is that above; worn: friction has risen'
        ' by 60 % since the configuration was written.\n\n'
        + _table(['', *(FIGURES[name][0] for name in _MEASURES)], rows)
    )


_TEXTS = {
    'level': _level_text,
    'operator': _operator_text,
    'reliability': _reliability_text,
    'drift': _drift_text,
    'voyages': _voyages_text,
}


def main(asked: Sequence[str]) -> None:
    """Work out the parts that are asked for, or all, and write the page."""
    for name in asked or PARTS:
        if name != 'page':
            found = {name: PARTS[name]()}
            RESULTS.write_text(json.dumps(_results() | found) + '\n')
            print(name, 'done', flush=True)
    results = _results()
    if 'reliability' in results:
        _draw_reliability(results['reliability'])
    PAGE.write_text(_page(PAGE.read_text(), results))


def _results() -> dict[str, Any]:
    return dict(json.loads(RESULTS.read_text())) if RESULTS.exists() else {}


if __name__ == '__main__':
    main(sys.argv[1:])
