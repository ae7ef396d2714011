#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Judges the monitor over many voyages and writes docs/warning_quality.md and its picture.

The voyages are those of launch_configs/scenes/quality/, each with several seeds, with the sensors
of launch_configs/sensors/; manoeuvres in which alarms sound most are those of scenes/sounds/.
The head of the page, above the mark, is kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hard_sensors import LEVELS, STAMPS
from trade_off import Curve, TradeOff, draw_trade_offs

from benchmarks.score import RULES, judge_all
from benchmarks.voyages import BELOW_FOLD, BELOW_HOPF, OURS, Call, Sailed, Sent, Voyage, cases_of, output_of
from benchmarks.warning_quality import FIGURES, Quality, pooled, quality_of, written
from stickslip_lab.scenes.scene import load_scene
from stickslip_lab.scenes.truth import TruthRecord
from stickslip_monitor.drawing.canvas import save_figure
from stickslip_monitor.monitor.parameters import BEARING_PARAMETERS, AlarmConfig, nanoseconds
from stickslip_monitor.offline.processes import core_count, run_in_processes

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'warning_quality.md'
PICTURE = ROOT / 'docs' / 'images' / 'warning_quality.png'
SCENES = ROOT / 'launch_configs' / 'scenes' / 'quality'
MANOEUVRES = ROOT / 'launch_configs' / 'scenes' / 'sounds'
SENSORS = [ROOT / 'launch_configs' / 'sensors' / f'{n}.yaml' for n in ('ideal', 'ordinary', 'poor')]
ORDINARY = SENSORS[1]
WITH_LEVEL = ROOT / 'launch_configs' / 'sensors' / 'ordinary_level.yaml'
MARK = '<!-- Made by `make warning-quality`. -->'
# Of a wrong source no verdict can come, only the fault; it stands by itself.
WRONG_SOURCE, ODD_SAMPLES = 'two_publishers', 'spikes'
SEEDS, FIRST_SEED = 10, 16001
# Each is varied by itself; those that this version does not have are left out.
VARIED: dict[str, tuple[float, ...]] = {
    'alarm.onset_growth': (0.0, 0.5, 1.0, 2.0, 3.0, 4.0),
    'alarm.on_delay': (0.0, 1.0, 2.0, 4.0),
    'alarm.caution_margin': (0.0, 0.05, 0.1, 0.2, 0.3),
    'alarm.look_ahead': (0.0, 10.0, 20.0, 40.0),
}
_OF_ALARM = ('alarm.onset_growth', 'alarm.on_delay')
_OF_WARNING = ('alarm.caution_margin', 'alarm.look_ahead')
# Rows of the page, and its columns beside those of the grades of sensors.
_SHOWN = (
    'warned',
    'newly_given',
    'lead_median',
    'missed',
    'told',
    'detected_plain',
    'false_per_100h',
    'baseless_per_100h',
    'wrong_hours',
    'far_warned',
    'sounds',
)
# Of voyages with spoilt sensors.
_OF_SPOILT = ('newly_given', 'told', 'false_per_100h', 'wrong_hours')
# Of manoeuvres.
_OF_MANOEUVRES = ('episodes', 'warned', 'missed', 'false_per_100h', 'sounds', 'unheard')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the evaluation; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=SEEDS, help='seeds of each scene')
    parser.add_argument('--first-seed', type=int, default=FIRST_SEED, help='the first of them')
    parser.add_argument('--jobs', type=int, default=core_count(), help='processes')
    parser.add_argument('--print', action='store_true', help='print, and write nothing')
    args = parser.parse_args(argv)
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    voyages = judge_all(_calls(seeds), args.jobs)
    changed = _judged_changed(seeds, args.jobs)
    manoeuvres = judge_all(_manoeuvre_calls(seeds), args.jobs)
    tables = [*_page(voyages, seeds), '', *_spoilt_table(changed), '', *_manoeuvre_table(manoeuvres)]
    text = '\n'.join(tables)
    if args.print:
        print(text)
        return 0
    save_figure(draw_trade_offs(_panels(voyages, changed)), PICTURE, force=True)
    head, _, _ = PAGE.read_text('utf-8').partition(MARK)
    PAGE.write_text(f'{head}{MARK}\n{text}\n', 'utf-8')
    return 0


def _known() -> dict[str, tuple[float, ...]]:
    """Return the parameters to vary that there are, with their values and, among these, the default."""
    rows = {parameter.name: parameter for parameter in BEARING_PARAMETERS}
    return {
        name: tuple(sorted({*values, float(rows[name].default)}))
        for name, values in VARIED.items()
        if name in rows
    }


def _field(name: str, value: float) -> dict[str, Any]:
    """Return the field of the alarm's configuration that a parameter sets."""
    own = name.removeprefix('alarm.')
    timed = own not in AlarmConfig.__dataclass_fields__
    return {f'{own}_ns': nanoseconds(value)} if timed else {own: value}


def _calls(seeds: Iterable[int]) -> list[Call]:
    # What the lining does is followed with the first of them.
    sensors = tuple(map(str, (WITH_LEVEL, *SENSORS)))
    return [Call(str(scene), seed, sensors) for scene in sorted(SCENES.glob('*.yaml')) for seed in seeds]


def _is_main(voyage: Voyage) -> bool:
    return Path(voyage.scene).stem != WRONG_SOURCE


def _page(voyages: Sequence[Voyage], seeds: range) -> Iterable[str]:
    own = [voyage for voyage in voyages if _is_main(voyage)]
    one = pooled(v.rules[OURS] for v in own if v.sensors == str(ORDINARY)).figures()
    long = f'{written("hours", one["hours"])} h with {written("episodes", one["episodes"])} episodes'
    yield f'Seeds {seeds[0]} to {seeds[-1]} of each scene, {long}; the bare rules with ordinary sensors.'
    yield ''
    yield from _totals(own)
    yield ''
    yield from _wrong_source(voyages)


def _row(*cells: str) -> str:
    return f'| {" | ".join(cells)} |'


def _totals(voyages: Sequence[Voyage]) -> Iterable[str]:
    columns = {path.stem.replace('_', ', '): (OURS, path) for path in (*SENSORS, WITH_LEVEL)}
    columns |= {f'`{RULES[rule]}`': (rule, ORDINARY) for rule in (BELOW_FOLD, BELOW_HOPF)}
    yield _row('', *columns)
    yield _row('---', *('---:' for _ in columns))
    found = [
        pooled(v.rules[rule] for v in voyages if v.sensors == str(path)).figures()
        for rule, path in columns.values()
    ]
    for name in _SHOWN:
        yield _row(FIGURES[name][0], *(written(name, figures[name]) for figures in found))


def _wrong_source(voyages: Sequence[Voyage]) -> Iterable[str]:
    reported: dict[str, list[int]] = {}
    for voyage in voyages:
        name = Path(voyage.scene).stem
        if voyage.sensors == str(WITH_LEVEL):
            continue
        kind = name if name in (WRONG_SOURCE, ODD_SAMPLES) else ''
        reported.setdefault(kind, []).append(voyage.rules[OURS].wrong_source)
    for kind, found in sorted(reported.items(), reverse=True):
        label = f'`{kind}`' if kind else 'the other scenes'
        yield f'- {label}: reported on {sum(found)} of {len(found)} voyages'


def judge_changed(scene: str, seed: int) -> dict[str, Quality]:
    """Run the monitor on a voyage with spoilt sensors or another alarm configuration.

    With ordinary sensors: a level and stamps spoilt in every way, by the way's name, and each
    parameter at each of its values, by both.
    """
    found: dict[str, list[Quality]] = {}
    truths: dict[str, TruthRecord] = {}
    for case in cases_of(load_scene(scene, seed, str(WITH_LEVEL)), truths):
        if case.sent.config.level is None:
            continue
        for number, (name, spoil) in enumerate((LEVELS | STAMPS).items()):
            random = np.random.default_rng([seed, number])
            found.setdefault(name, []).append(_heard(spoil(case.sent, random), case))
    for case in cases_of(load_scene(scene, seed, str(ORDINARY)), truths):
        config = case.sent.config
        for name, values in _known().items():
            for value in values:
                alarm = replace(config.alarm, **_field(name, value))
                sent = replace(case.sent, config=replace(config, alarm=alarm))
                found.setdefault(_variant(name, value), []).append(_heard(sent, case))
    return {name: pooled(parts) for name, parts in found.items()}


def _heard(sent: Sent, case: Sailed) -> Quality:
    """Judge the monitor by the clock of the samples."""
    return quality_of(output_of(sent.scan, case.truth), case.truth, case.plain)


def _variant(name: str, value: float) -> str:
    return f'{name} = {value:g}'


def _judged_changed(seeds: range, jobs: int) -> dict[str, Quality]:
    scenes = [str(scene) for scene in sorted(SCENES.glob('*.yaml')) if scene.stem != WRONG_SOURCE]
    calls = [(scene, seed) for scene in scenes for seed in seeds]
    found: dict[str, list[Quality]] = {}
    for _, outcome in run_in_processes(judge_changed, dict(enumerate(calls)), jobs):
        if isinstance(outcome, BaseException):
            raise outcome
        for name, quality in outcome.items():
            found.setdefault(name, []).append(quality)
    return {name: pooled(parts) for name, parts in found.items()}


def _spoilt_table(found: Mapping[str, Quality]) -> Iterable[str]:
    """Return a row for each way in which a level, or the stamps of speed and load, can be spoilt."""
    yield _row('ordinary sensors', *(FIGURES[name][0] for name in _OF_SPOILT))
    yield _row('---', *('---:' for _ in _OF_SPOILT))
    for kinds, what in ((LEVELS, 'level'), (STAMPS, 'no level')):
        for name in kinds:
            figures = found[name].figures()
            yield _row(f'{what}: {name}', *(written(f, figures[f]) for f in _OF_SPOILT))


def _manoeuvre_calls(seeds: Iterable[int]) -> list[Call]:
    scenes = sorted(MANOEUVRES.glob('*.yaml'))
    return [Call(str(scene), seed, (str(ORDINARY),)) for scene in scenes for seed in seeds]


def _manoeuvre_table(voyages: Sequence[Voyage]) -> Iterable[str]:
    """Return a row for each scene of manoeuvres, with ordinary sensors."""
    yield _row('ordinary sensors', *(FIGURES[name][0] for name in _OF_MANOEUVRES))
    yield _row('---', *('---:' for _ in _OF_MANOEUVRES))
    for scene in dict.fromkeys(voyage.scene for voyage in voyages):
        figures = pooled(v.rules[OURS] for v in voyages if v.scene == scene).figures()
        name = Path(scene).stem.replace('_', ' ')
        yield _row(name, *(written(f, figures[f]) for f in _OF_MANOEUVRES))


def _panels(voyages: Sequence[Voyage], changed: Mapping[str, Quality]) -> list[TradeOff]:
    own = [v for v in voyages if _is_main(v) and v.sensors == str(ORDINARY)]
    bare = {rule: pooled(v.rules[rule] for v in own).figures() for rule in (BELOW_FOLD, BELOW_HOPF)}
    rules = [
        (RULES[rule], row['false_per_100h'] or 0.0, _missing(row['detected_plain']))
        for rule, row in bare.items()
    ]
    return [
        TradeOff(
            'Stick-slip alarm',
            'false alarms per 100 h',
            'episodes not detected [%]',
            _curves(changed, _OF_ALARM, 'false_per_100h', 'detected_plain'),
            rules,
        ),
        TradeOff(
            'Warning',
            'warnings per 1000 h far from the boundary',
            'episodes without a lead of 10 s [%]',
            _curves(changed, _OF_WARNING, 'far_per_1000h', 'lead_10s'),
        ),
    ]


def _missing(share: float | None) -> float:
    return 0.0 if share is None else 1.0 - share


def _curves(changed: Mapping[str, Quality], names: Iterable[str], false: str, kept: str) -> list[Curve]:
    found = []
    defaults = {parameter.name: parameter.default for parameter in BEARING_PARAMETERS}
    for name, values in _known().items():
        rows = [changed[_variant(name, value)].figures() for value in values]
        if name in names:
            found.append(
                Curve(
                    name.removeprefix('alarm.'),
                    [f'{value:g}' for value in values],
                    [row[false] or 0.0 for row in rows],
                    [_missing(row[kept]) for row in rows],
                    values.index(float(defaults[name])),
                )
            )
    return found


if __name__ == '__main__':
    sys.exit(main())
