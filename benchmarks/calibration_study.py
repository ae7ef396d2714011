# SPDX-License-Identifier: Apache-2.0
"""What a calibration reaches on simulated ships: from a level to edges to the result.

``python -m benchmarks.calibration_study [PART...]`` works out all parts, or some, and keeps their
figures in ``docs/calibration.json``; then it writes them into ``docs/calibration.md`` and draws
its pictures. The ships of a part have a seed of their own; no constant was chosen on them.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibrated_warnings import COLUMNS, SEEDS, VARIANTS, judge_all_variants
from benchmarks.calibration_ships import Kind, Passage, Ship, make_ships, sail_passages
from benchmarks.table import format_row
from benchmarks.warning_quality import format_figure
from stickslip_lab.calibration.calibration import Calibration, Evidence, calibrate, read_levels
from stickslip_lab.calibration.evidence import VibrationReport, bin_telemetry
from stickslip_lab.calibration.level_reports import bin_level
from stickslip_lab.drawing.studies import draw_calibration
from stickslip_monitor.drawing.canvas import INK, MUTED, new_figure, save_figure, style
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.physics.averaging import fold_load, hopf_load
from stickslip_monitor.physics.probability import QUANTILES, Tolerance

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / 'docs/calibration.json', ROOT / 'docs/calibration.md'
RELIABILITY = ROOT / 'docs/images/reliability.png'
EXAMPLE = ROOT / 'docs/images/calibration.png'
_SHIPS, _FEWER, _DRIFTING, _MANY = 40, 20, 8, 60
# Points of a passage at which a probability is judged.
_POINTS = 60
_TOLERANCE = Tolerance(damping=0.40, static=0.15, kinetic=0.15, decay=0.30, load=0.03)
_FAR = (0.6, 1.0, 1.6)


def measured_evidence(passages: Sequence[Passage]) -> list[Evidence]:
    """Return what the sensors of some passages measure, as recordings do."""
    evidence = []
    for k, passage in enumerate(passages, 1):
        stamps = np.round(passage.time * 1e9).astype(np.int64)
        course = bin_telemetry(f'passage {k}', stamps, passage.speed, passage.load)
        level = bin_level(passage.time, passage.level, passage.time, passage.speed)
        evidence.append(Evidence(course.name, (course,), level=level))
    return read_levels('ship', evidence)


def reported_evidence(passages: Sequence[Passage], random: np.random.Generator) -> list[Evidence]:
    """Return an operator's reports: times off by up to 5 s, onsets late, one state in ten swapped."""
    evidence = []
    for k, passage in enumerate(passages, 1):
        stamps = np.round(passage.time * 1e9).astype(np.int64)
        course = bin_telemetry(f'passage {k}', stamps, passage.speed, passage.load)
        edges = [float(passage.time[0])]
        for a, b in passage.episodes:
            if b - a > 20.0:
                edges += [a + random.uniform(0.0, 10.0), b + random.uniform(-5.0, 5.0)]
        edges.append(float(passage.time[-1]))
        reports = tuple(
            VibrationReport(
                'ship',
                round(1e9 * a),
                round(1e9 * b),
                bool(i % 2) ^ (random.random() < 0.1),
                10.0,
                0.9,
                f'list {k}, line {i + 1}',
            )
            for i, (a, b) in enumerate(pairwise(edges))
            if b > a
        )
        evidence.append(Evidence(course.name, (course,), reports))
    return evidence


def judge_calibration(
    calibration: Calibration, ship: Ship, share: float = 1.0, moved: float = 1.0
) -> list[float]:
    """Return error, half-width and coverage of fold and then Hopf speed, at a share of the load."""
    load, row = ship.load * share, []
    fold = [float(calibration.belief.fold_speed(load, p)) for p in QUANTILES]
    for of, (low, middle, high) in ((ship.fold, fold), (ship.hopf, calibration.hopf_speeds(load))):
        true = of(load * moved)
        row += [middle / true - 1.0, (high - low) / (2.0 * true), float(low <= true <= high)]
    return row


def _summarise_rows(rows: Sequence[Sequence[float]]) -> list[float]:
    """Return median error, bias, half-width and share covered, of fold and then of Hopf speed."""
    table, summary = np.array(rows), list[float]()
    for k in (0, 3):
        error, half, covered = table[:, k], table[:, k + 1], table[:, k + 2]
        summary += [float(np.median(np.abs(error))), float(np.median(error))]
        summary += [float(np.median(half)), float(np.mean(covered))]
    return summary


def make_fleet(
    seed: int, count: int, passages: int, kind: Kind
) -> tuple[list[Ship], list[list[Passage]], np.random.Generator]:
    """Make ships with their passages."""
    random = np.random.default_rng(seed)
    ships = make_ships(count, random, kind)
    return ships, sail_passages(ships, passages, random, kind), random


def study_accuracy(
    seed: int,
    count: int,
    counts: Sequence[int],
    kind: Kind | None = None,
    operator: bool = False,
    shares: Sequence[float] = (1.0,),
) -> dict[str, Any]:
    """Calibrate by some numbers of passages, at their loads and at other shares of them."""
    ships, voyages, random = make_fleet(seed, count, max(counts), kind or Kind())
    rows: dict[str, list[list[float]]] = {}
    refused, changed_count, doubt_count, seconds = 0, 0, 0, []
    for ship, passages in zip(ships, voyages, strict=True):
        for n in counts:
            begin = time.process_time()
            try:
                evidence = (
                    reported_evidence(passages[:n], random) if operator else measured_evidence(passages[:n])
                )
                prior = ship.drawn, _TOLERANCE
                calibration = calibrate(evidence, *prior, onsets=not operator)
            except CalibrationError:
                refused += 1
                continue
            seconds.append((n, time.process_time() - begin))
            changed_count += calibration.has_changed
            doubt_count += len(calibration.doubts)
            for share in shares:
                name = f'{n}' if len(shares) == 1 else f'{n}, at {share:g} of the loads'
                rows.setdefault(name, []).append(judge_calibration(calibration, ship, share))
    costs = {n: float(np.median([s for m, s in seconds if m == n])) for n in counts}
    return {
        'ships': count,
        'refused': refused,
        'changed': changed_count,
        'doubted': doubt_count,
        'seconds': costs,
        'rows': [[name, *_summarise_rows(passages)] for name, passages in rows.items()],
    }


def study_slow_ramps() -> dict[str, Any]:
    """Study ramps of one to ten minutes, with a level and no threshold."""
    return study_accuracy(3101, _SHIPS, (2, 5))


def study_many_passages() -> dict[str, Any]:
    """Study twenty passages."""
    return study_accuracy(3102, _FEWER, (20,))


def study_other_loads() -> dict[str, Any]:
    """Study loads that five passages did not meet."""
    return study_accuracy(3103, _SHIPS, (5,), shares=_FAR)


def study_wrong_drawings() -> dict[str, Any]:
    """Calibrate a ship whose damping is 1.75 times the drawing's and whose other parameters are guessed."""
    return study_accuracy(3104, _FEWER, (5,), Kind(wrong=1.75), shares=_FAR)


def study_fast_ramps() -> dict[str, Any]:
    """Study ramps of 15 to 60 s."""
    return study_accuracy(3105, _FEWER, (5,), Kind(ramps=(15.0, 60.0)))


def study_loud_linings() -> dict[str, Any]:
    """Study noise of the lining five times as strong."""
    return study_accuracy(3106, _FEWER, (2, 5), Kind(noise=0.01))


def study_quiet_linings() -> dict[str, Any]:
    """Study noise of the lining a quarter as strong."""
    return study_accuracy(3110, _FEWER, (2, 5), Kind(noise=0.0005))


def study_operator_lists() -> dict[str, Any]:
    """Study an operator's list."""
    return study_accuracy(3107, _FEWER, (5, 20), operator=True)


def study_drift() -> dict[str, Any]:
    """Raise the fall of friction by 42 % over sixteen passages and judge the last."""
    kind = Kind(drift=math.log(1.42) / 15.0)
    ships, voyages, _ = make_fleet(3108, _DRIFTING, 16, kind)
    rows: dict[str, list[list[float]]] = {'0': [], '0.03': []}
    warned = 0
    for ship, passages in zip(ships, voyages, strict=True):
        evidence = measured_evidence(passages)
        for forget, judgements in rows.items():
            try:
                result = calibrate(evidence, ship.drawn, _TOLERANCE, forget=float(forget))
            except CalibrationError:  # that too is a warning
                warned += forget == '0'
                continue
            warned += forget == '0' and result.has_changed
            judgements.append(judge_calibration(result, ship, moved=1.42))
    return {
        'ships': _DRIFTING,
        'warned': int(warned),
        'rows': [[name, *_summarise_rows(judgements)] for name, judgements in rows.items() if judgements],
    }


def study_reliability() -> dict[str, Any]:
    """Compare probabilities of unseen passages after five with how often stick-slip could or did start."""
    ships, voyages, _ = make_fleet(3109, _MANY, 11, Kind())
    predictions: dict[str, list[tuple[Array, Array]]] = {'can': [], 'will': []}
    for ship, passages in zip(ships, voyages, strict=True):
        try:
            calibration = calibrate(measured_evidence(passages[:5]), ship.drawn, _TOLERANCE)
        except CalibrationError:
            continue
        belief = replace(calibration.belief, load=0.03)
        for passage in passages[5:]:
            every = max(1, passage.speed.size // _POINTS)
            v, n = passage.speed[::every], passage.load[::every]
            of = {'can': fold_load, 'will': hopf_load}
            for (name, boundary), p in zip(of.items(), belief.probabilities(v, n), strict=True):
                with np.errstate(all='ignore'):
                    bound = np.asarray(boundary(ship.true, v), float)
                is_so = passage.true_load > np.where(np.isnan(bound), np.inf, bound)
                predictions[name].append((np.asarray(p), is_so.astype(float)))
    return {
        'ships': len(ships),
        **{n: _bin_predictions(*map(np.concatenate, zip(*p, strict=True))) for n, p in predictions.items()},
    }


def study_warnings() -> dict[str, Any]:
    """Judge warnings of voyages as configured, calibrated, and with the true parameters."""
    by_variant = judge_all_variants(SEEDS)
    first = by_variant['configured']
    rows = [[VARIANTS[name], *map(quality.figures().get, COLUMNS)] for name, quality in by_variant.items()]
    return {'hours': first.seconds / 3600.0, 'episodes': first.episodes, 'rows': rows}


def _bin_predictions(predicted: Array, observed: Array) -> dict[str, Any]:
    edges = np.array([0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0 + 1e-9])
    place = np.digitize(predicted, edges) - 1
    rows = [
        [float(predicted[place == k].mean()), float(observed[place == k].mean()), int((place == k).sum())]
        for k in range(edges.size - 1)
        if (place == k).any()
    ]
    return {'rows': rows, 'brier': float(np.mean((predicted - observed) ** 2))}


PARTS: dict[str, Callable[[], dict[str, Any]]] = {
    'warnings': study_warnings,
    'slow': study_slow_ramps,
    'many': study_many_passages,
    'other_loads': study_other_loads,
    'wrong_drawing': study_wrong_drawings,
    'fast': study_fast_ramps,
    'loud': study_loud_linings,
    'quiet': study_quiet_linings,
    'operator': study_operator_lists,
    'drift': study_drift,
    'reliability': study_reliability,
}

MARK = '<!-- What follows is made by `make calibration-study`. -->\n'
_SHIPS_TEXT = """
None was missed.

Simulated ships of 20 to 200 kg, five laws, sensors of 0.5 to 10 Hz, tachometers 0.1 to 1 s late,
loads off by 3 %, drawings by 40, 25 and 30 % (damping, `mu_s - mu_k`, decay). In per cent: median
error, half-width of the 90 % interval, how often it held:

"""
_NAMES = {
    'slow': 'ramps of 1 to 10 min',
    'many': 'the same',
    'other_loads': 'other loads',
    'wrong_drawing': 'damping × 1.75',
    'fast': 'ramps of 15 to 60 s',
    'loud': 'noise × 5',
    'quiet': 'noise × 0.25',
    'operator': "an operator's list",
    'drift': 'wear, `--forget`',
}
_SAYINGS = {'can': 'stick-slip can happen', 'will': 'it starts by itself'}
_LOOKS = (('#0072b2', 'o'), ('#d55e00', 's'))


def _render_page(old_page: str, results: Mapping[str, Any]) -> str:
    """Return the page with a new table."""
    rows, notes = [], []
    for name, text in _NAMES.items():
        if name not in results:
            continue
        result = results[name]
        for k, (label, *values) in enumerate(result['rows']):
            # What is named above is not named again.
            row_title = '' if k else f'{text} ({result["ships"]})'
            cells = (_format_cell(error, half, cover) for error, _, half, cover in (values[:4], values[4:]))
            rows.append([row_title, label.replace(' of the loads', ''), *cells])
        if result.get('refused'):
            notes.append(f'{text}: {result["refused"]} refused')
    head = 'what (ships)', 'slow-downs', 'fold', 'Hopf'
    text = f'{MARK}\n{_warnings_table(results)}{_format_table(head, rows)}'
    if notes:
        text += f'\nNo result: {"; ".join(notes)}.\n'
    if 'slow' in results and 'drift' in results:
        result, worn = results['slow'], results['drift']
        text += (
            f'\nA change was reported of {result["changed"]} of the first ships and {worn["warned"]} of'
            f' {worn["ships"]} worn ones.\n'
        )
    if 'reliability' in results:
        result = results['reliability']
        brier = ', '.join(f'{label} {result[name]["brier"]:.4f}' for name, label in _SAYINGS.items())
        text += (
            f'\nProbabilities of passages never seen, {result["ships"]} ships (Brier scores: {brier}):\n\n'
            '![Predicted and observed](images/reliability.png)\n'
        )
    return old_page.partition(MARK)[0] + text


def _warnings_table(results: Mapping[str, Any]) -> str:
    if 'warnings' not in results:
        return ''
    result = results['warnings']
    cells = [[name, *map(format_figure, COLUMNS, figures)] for name, *figures in result['rows']]
    return (
        f'Warnings on {result["hours"]:.0f} h of voyages, {result["episodes"]} episodes, ordinary sensors,'
        ' parameters off by 5 to 10 %:\n\n' + _format_table(('', *COLUMNS.values()), cells) + _SHIPS_TEXT
    )


def _format_cell(error: float, half: float, cover: float) -> str:
    return f'{error:.1%}, {half:.1%}, {cover:.0%}'.replace('%', '')


def _format_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return '\n'.join([format_row(head), f'|{"---|" * len(head)}', *map(format_row, rows), ''])


def _draw_reliability(result: Mapping[str, Any]) -> None:
    with style():
        figure = new_figure(5.6, 5.2)
        axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], color=MUTED, lw=1.0, ls='--', label='as often as predicted')
        # How many points each mark has: one curve's to its upper left, the other's to its lower right.
        beside: Any = ({'xytext': (-7.0, 5.0), 'ha': 'right'}, {'xytext': (8.0, -10.0)})
        for (name, text), (colour, marker), placement in zip(_SAYINGS.items(), _LOOKS, beside, strict=True):
            predicted, observed, count = np.array(result[name]['rows']).T
            axes.plot(predicted, observed, color=colour, lw=1.2, marker=marker, label=text)
            size = 12.0 + 40.0 * np.log10(count)
            axes.scatter(predicted, observed, size, color=colour, marker=marker, ec='white', zorder=3)
            for x, y, n in zip(predicted, observed, count.astype(int), strict=True):
                axes.annotate(f'{n}', (x, y), textcoords='offset points', size=7.5, color=colour, **placement)
        axes.set_xlabel('predicted probability [-]')
        axes.set_ylabel('share of points at which it was so [-]\n(beside a mark: number of points)')
        axes.set(xlim=(-0.15, 1.15), ylim=(-0.1, 1.1))
        axes.set_aspect('equal')
        axes.tick_params(colors=INK)
        axes.legend(frameon=False, loc='upper left')
        figure.tight_layout()
    save_figure(figure, RELIABILITY, force=True)


def draw_example() -> None:
    """Save the picture of one ship of five passages, with knocks of its level."""
    ships, voyages, _ = make_fleet(3203, 1, 5, replace(Kind(), ramps=(100.0, 400.0)))
    calibration = calibrate(measured_evidence(voyages[0]), ships[0].drawn, _TOLERANCE)
    config: Any = SimpleNamespace(name='aft_stern', bearing=ships[0].drawn)
    save_figure(draw_calibration(config, calibration), EXAMPLE, force=True)


def main(names: Sequence[str]) -> None:
    """Run the named parts, or all, and write the page."""
    with ProcessPoolExecutor() as pool:
        running = {pool.submit(PARTS[name]): name for name in names or PARTS if name != 'page'}
        for done in as_completed(running):
            result = {running[done]: done.result()}
            RESULTS.write_text(json.dumps(_load_results() | result) + '\n', 'utf-8')
            print(running[done], 'done', flush=True)
    results = _load_results()
    if 'reliability' in results:
        _draw_reliability(results['reliability'])
    draw_example()
    PAGE.write_text(_render_page(PAGE.read_text('utf-8'), results), 'utf-8')


def _load_results() -> dict[str, Any]:
    return dict(json.loads(RESULTS.read_text('utf-8'))) if RESULTS.exists() else {}


if __name__ == '__main__':
    main(sys.argv[1:])
