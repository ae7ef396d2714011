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
from hard_sensors import LEVELS, SHIPS, STAMPS
from trade_off import Curve, TradeOff, draw_trade_offs

from benchmarks.score import RULES, judge_all
from benchmarks.table import format_row
from benchmarks.voyages import (
    BELOW_FOLD,
    BELOW_HOPF,
    OURS,
    Call,
    Sailed,
    SensorRecord,
    Voyage,
    cases_of,
    output_of,
)
from benchmarks.warning_quality import FIGURES, Quality, format_figure, pool_qualities, quality_of
from stickslip_lab.scenes.scene import load_scene
from stickslip_lab.scenes.truth_topics import TruthRecord
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
    'sounds',
)
# Of voyages with spoilt sensors.
_OF_SPOILT = ('told', 'false_per_100h', 'wrong_hours')
# Of manoeuvres.
_OF_MANOEUVRES = ('episodes', 'warned', 'missed', 'false_per_100h', 'sounds')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the evaluation; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=SEEDS, help='seeds of each scene')
    parser.add_argument('--first-seed', type=int, default=FIRST_SEED, help='the first of them')
    parser.add_argument('--jobs', type=int, default=core_count(), help='processes')
    parser.add_argument('--print', action='store_true', help='print, and write nothing')
    args = parser.parse_args(argv)
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    voyages = judge_all(_make_calls(seeds), args.jobs)
    changed = _judged_changed(seeds, args.jobs)
    manoeuvres = judge_all(_manoeuvre_calls(seeds), args.jobs)
    tables = [*_page_lines(voyages, seeds), '', *_spoilt_table(changed), '', *_manoeuvre_table(manoeuvres)]
    text = '\n'.join(tables)
    if args.print:
        print(text)
        return 0
    save_figure(draw_trade_offs(_make_panels(voyages, changed)), PICTURE, force=True)
    head, _, _ = PAGE.read_text('utf-8').partition(MARK)
    PAGE.write_text(f'{head}{MARK}\n{text}\n', 'utf-8')
    return 0


def _varied_values() -> dict[str, tuple[float, ...]]:
    """Return the parameters to vary that there are, with their values and, among these, the default."""
    rows = {parameter.name: parameter for parameter in BEARING_PARAMETERS}
    return {
        name: tuple(sorted({*values, float(rows[name].default)}))
        for name, values in VARIED.items()
        if name in rows
    }


def _alarm_field(name: str, value: float) -> dict[str, Any]:
    """Return the field of the alarm's configuration that a parameter sets."""
    field = name.removeprefix('alarm.')
    timed = field not in AlarmConfig.__dataclass_fields__
    return {f'{field}_ns': nanoseconds(value)} if timed else {field: value}


def _make_calls(seeds: Iterable[int]) -> list[Call]:
    # What the lining does is followed with the first of them.
    sensors = tuple(map(str, (WITH_LEVEL, *SENSORS)))
    return [Call(str(scene), seed, sensors) for scene in sorted(SCENES.glob('*.yaml')) for seed in seeds]


def _is_main(voyage: Voyage) -> bool:
    return Path(voyage.scene).stem != WRONG_SOURCE


def _page_lines(voyages: Sequence[Voyage], seeds: range) -> Iterable[str]:
    main_voyages = [voyage for voyage in voyages if _is_main(voyage)]
    figures = pool_qualities(v.rules[OURS] for v in main_voyages if v.sensors == str(ORDINARY)).figures()
    hours, episodes = (format_figure(name, figures[name]) for name in ('hours', 'episodes'))
    yield (
        f'Seeds {seeds[0]} to {seeds[-1]} of each scene, {hours} h with {episodes} episodes;'
        ' the bare rules with ordinary sensors.'
    )
    yield ''
    yield from _total_lines(main_voyages)
    yield ''
    yield from _wrong_source(voyages)


def _total_lines(voyages: Sequence[Voyage]) -> Iterable[str]:
    columns = {path.stem.replace('_', ', '): (OURS, path) for path in (*SENSORS, WITH_LEVEL)}
    columns |= {f'`{RULES[rule]}`': (rule, ORDINARY) for rule in (BELOW_FOLD, BELOW_HOPF)}
    yield format_row(['', *columns])
    yield format_row(['---', *('---:' for _ in columns)])
    figures_of_columns = [
        pool_qualities(v.rules[rule] for v in voyages if v.sensors == str(path)).figures()
        for rule, path in columns.values()
    ]
    for name in _SHOWN:
        yield format_row(
            [FIGURES[name][0], *(format_figure(name, figures[name]) for figures in figures_of_columns)]
        )


def _wrong_source(voyages: Sequence[Voyage]) -> Iterable[str]:
    reported: dict[str, list[int]] = {}
    for voyage in voyages:
        name = Path(voyage.scene).stem
        if voyage.sensors == str(WITH_LEVEL):
            continue
        kind = name if name in (WRONG_SOURCE, ODD_SAMPLES) else ''
        reported.setdefault(kind, []).append(voyage.rules[OURS].wrong_source)
    shares = [
        f'{sum(counts)} of {len(counts)} voyages of {f"`{kind}`" if kind else "the other scenes"}'
        for kind, counts in sorted(reported.items(), reverse=True)
    ]
    yield f'Doubtful inputs were reported on {", ".join(shares)}.'


def judge_changed(scene: str, seed: int) -> dict[str, Quality]:
    """Run the monitor on a voyage with spoilt sensors or another alarm configuration.

    With ordinary sensors: a level and stamps spoilt in every way, by the way's name, and each
    parameter at each of its values, by both.
    """
    qualities: dict[str, list[Quality]] = {}
    truths: dict[str, TruthRecord] = {}
    for case in cases_of(load_scene(scene, seed, str(WITH_LEVEL)), truths):
        if case.sent.config.level is None:
            continue
        for number, (name, spoil) in enumerate((LEVELS | STAMPS | SHIPS).items()):
            random = np.random.default_rng([seed, number])
            qualities.setdefault(name, []).append(_judge_sensors(spoil(case.sent, random), case))
    for case in cases_of(load_scene(scene, seed, str(ORDINARY)), truths):
        config = case.sent.config
        for name, values in _varied_values().items():
            for value in values:
                alarm = replace(config.alarm, **_alarm_field(name, value))
                sent = replace(case.sent, config=replace(config, alarm=alarm))
                qualities.setdefault(_variant_name(name, value), []).append(_judge_sensors(sent, case))
    return {name: pool_qualities(parts) for name, parts in qualities.items()}


def _judge_sensors(sent: SensorRecord, case: Sailed) -> Quality:
    """Judge the monitor by the clock of the samples."""
    return quality_of(output_of(sent.scan, case.truth), case.truth, case.plain)


def _variant_name(name: str, value: float) -> str:
    return f'{name} = {value:g}'


def _judged_changed(seeds: range, jobs: int) -> dict[str, Quality]:
    scenes = [str(scene) for scene in sorted(SCENES.glob('*.yaml')) if scene.stem != WRONG_SOURCE]
    calls = [(scene, seed) for scene in scenes for seed in seeds]
    qualities: dict[str, list[Quality]] = {}
    for _, outcome in run_in_processes(judge_changed, dict(enumerate(calls)), jobs):
        if isinstance(outcome, BaseException):
            raise outcome
        for name, quality in outcome.items():
            qualities.setdefault(name, []).append(quality)
    return {name: pool_qualities(parts) for name, parts in qualities.items()}


def _spoilt_table(by_name: Mapping[str, Quality]) -> Iterable[str]:
    """Return a row for all ways with the same figures to spoil a level, or stamps of inputs."""
    yield format_row(['level of ordinary sensors', *(FIGURES[name][0] for name in _OF_SPOILT)])
    yield format_row(['---', *('---:' for _ in _OF_SPOILT)])
    labels: dict[tuple[str, ...], list[str]] = {}
    for kinds, prefix in ((LEVELS, ''), (SHIPS, ''), (STAMPS, 'none, ')):
        for name in kinds:
            figures = by_name[name].figures()
            cells = tuple(format_figure(figure, figures[figure]) for figure in _OF_SPOILT)
            labels.setdefault(cells, []).append(f'{prefix}{name}')
    for cells, names in labels.items():
        yield format_row(['; '.join(names), *cells])


def _manoeuvre_calls(seeds: Iterable[int]) -> list[Call]:
    scenes = sorted(MANOEUVRES.glob('*.yaml'))
    return [Call(str(scene), seed, (str(ORDINARY),)) for scene in scenes for seed in seeds]


def _manoeuvre_table(voyages: Sequence[Voyage]) -> Iterable[str]:
    """Return a row for each scene of manoeuvres, with ordinary sensors."""
    yield format_row(['ordinary sensors', *(FIGURES[name][0] for name in _OF_MANOEUVRES)])
    yield format_row(['---', *('---:' for _ in _OF_MANOEUVRES)])
    unheard = 0
    for scene in dict.fromkeys(voyage.scene for voyage in voyages):
        figures = pool_qualities(v.rules[OURS] for v in voyages if v.scene == scene).figures()
        name = Path(scene).stem.replace('_', ' ')
        yield format_row([name, *(format_figure(f, figures[f]) for f in _OF_MANOEUVRES)])
        unheard += int(figures['unheard'] or 0)
    yield f'\nWithout a sound: {unheard}.'


def _make_panels(voyages: Sequence[Voyage], changed: Mapping[str, Quality]) -> list[TradeOff]:
    main_voyages = [v for v in voyages if _is_main(v) and v.sensors == str(ORDINARY)]
    bare = {
        rule: pool_qualities(v.rules[rule] for v in main_voyages).figures()
        for rule in (BELOW_FOLD, BELOW_HOPF)
    }
    rules = [
        (RULES[rule], row['false_per_100h'] or 0.0, _missing_share(row['detected_plain']))
        for rule, row in bare.items()
    ]
    return [
        TradeOff(
            'Stick-slip alarm',
            'false alarms per 100 h',
            'episodes not detected [%]',
            _make_curves(changed, _OF_ALARM, 'false_per_100h', 'detected_plain'),
            rules,
        ),
        TradeOff(
            'Warning',
            'warnings per 1000 h far from the boundary',
            'episodes without a lead of 10 s [%]',
            _make_curves(changed, _OF_WARNING, 'far_per_1000h', 'lead_10s'),
        ),
    ]


def _missing_share(share: float | None) -> float:
    return 0.0 if share is None else 1.0 - share


def _make_curves(changed: Mapping[str, Quality], names: Iterable[str], false: str, gain: str) -> list[Curve]:
    curves = []
    defaults = {parameter.name: parameter.default for parameter in BEARING_PARAMETERS}
    for name, values in _varied_values().items():
        rows = [changed[_variant_name(name, value)].figures() for value in values]
        if name in names:
            curves.append(
                Curve(
                    name.removeprefix('alarm.'),
                    [f'{value:g}' for value in values],
                    [row[false] or 0.0 for row in rows],
                    [_missing_share(row[gain]) for row in rows],
                    values.index(float(defaults[name])),
                )
            )
    return curves


if __name__ == '__main__':
    sys.exit(main())
