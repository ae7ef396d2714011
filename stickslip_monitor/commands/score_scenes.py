# SPDX-License-Identifier: Apache-2.0
"""The part of ``stickslip score`` that simulates scenes with many seeds and judges them."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from stickslip_monitor.commands.output import ProgressBar, console, print_json
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.lab.scenes.scene import load_scene
from stickslip_monitor.lab.voyages import BELOW_FOLD, BELOW_HOPF, OURS, Call, Voyage, judge_calls
from stickslip_monitor.lab.warning_quality import Quality, pooled
from stickslip_monitor.offline.processes import core_count

SCHEMA = 'stickslip_monitor/warning_quality/1'
RULES = {OURS: 'monitor', BELOW_FOLD: 'V < V_F', BELOW_HOPF: 'V < V_H'}
# Each figure with what it is called and how it is written.
FIGURES: Mapping[str, tuple[str, str]] = {
    'hours': ('hours', '.1f'),
    'voyages': ('voyages', 'd'),
    'episodes': ('episodes of stick-slip', 'd'),
    'warned': ('warned before onset', '.1%'),
    'lead_p10': ('lead in s, lowest tenth', '.1f'),
    'lead_median': ('lead in s, median', '.1f'),
    'lead_10s': ('lead of 10 s or more', '.1%'),
    'newly_given': ('a warning newly given 10 s before', '.1%'),
    'missed': ('missed', '.1%'),
    'detected': ('detected', '.1%'),
    'told': ('detected within 5 s', '.1%'),
    'detected_plain': ('detected, without knocks, wear and waves', '.1%'),
    'false_per_100h': ('false alarms per 100 h', '.1f'),
    'wrong_hours': ('hours wrongly in alarm', '.2f'),
    'unfounded_hours': ('hours in stick-slip without an episode', '.2f'),
    'far_hours': ('hours far from the boundary', '.1f'),
    'far_per_1000h': ('warnings per 1000 h there', '.1f'),
    'far_warned_hours': ('hours under a warning there', '.2f'),
    'far_warned': ('share of the time under a warning there', '.1%'),
    'changes_per_hour': ('changes of condition an hour', '.1f'),
    'largest_burst': ('most raised conditions in 10 min', 'd'),
    'bursts': ('voyages with more than 10 in 10 min', 'd'),
    'largest_given': ('most alarms given to people in 10 min', 'd'),
    'wrong_source': ('voyages with a wrong source told', 'd'),
}


def is_scene(path: str) -> bool:
    """Whether an argument is a scene file rather than a bag."""
    return Path(path).suffix in ('.yaml', '.yml')


def run_scenes(args: argparse.Namespace) -> int:
    """Simulate and judge; the arguments are those of ``stickslip score``."""
    _check(args)
    sensors = tuple(args.sensors) if args.sensors else (None,)
    calls = [
        Call(scene, seed, sensors)
        for scene in args.bags
        for seed in seeds_of(scene, sensors[0], args.first_seed, args.seeds)
    ]
    voyages = judge_all(calls, args.jobs or core_count())
    if args.json:
        print_json(to_json(voyages))
    else:
        print_voyages(console(), voyages)
    total = pooled(voyage.rules[OURS] for voyage in voyages)
    return int(bool(total.missed or total.false or any(lead < 0.0 for lead in total.leads)))


def _check(args: argparse.Namespace) -> None:
    """Refuse what is for bags only, or breaks a rule."""
    bags = [path for path in args.bags if not is_scene(path)]
    if bags:
        raise ConfigurationError(
            f"'{bags[0]}' is no scene: give either scenes (.yaml) or bags, not both"
        )
    for name in ('config', 'bearing', 'picture'):
        if getattr(args, name) is not None:
            raise ConfigurationError(f'--{name} is for bags: a scene says what is judged')
    for name, least in (('seeds', 1), ('first_seed', 0), ('jobs', 1)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise ConfigurationError(
                f'--{name.replace("_", "-")} {value} must be at least {least}'
            )


def seeds_of(scene: str, sensors: str | None, first: int | None, count: int) -> range:
    """The seeds of a scene: so many from the first one on, by default from the file's own."""
    first = load_scene(scene, sensors=sensors).seed if first is None else first
    return range(first, first + count)


def judge_all(calls: Sequence[Call], jobs: int) -> list[Voyage]:
    """Judge all calls, with a progress bar; the order of the results is that of the calls."""
    found: dict[int, list[Voyage]] = {}
    with ProgressBar() as meter:
        for number, voyages in judge_calls(calls, min(jobs, len(calls))):
            found[number] = voyages
            meter.show(f'{len(found)} of {len(calls)} voyages', len(found), len(calls))
    return [voyage for number in range(len(calls)) for voyage in found[number]]


def grouped(voyages: Iterable[Voyage], rule: str, *by: str) -> dict[tuple[Any, ...], Quality]:
    """The sums of one rule for each value of some attributes of a voyage, in order."""
    parts: dict[tuple[Any, ...], list[Quality]] = {}
    for voyage in voyages:
        key = tuple(getattr(voyage, name) for name in by)
        parts.setdefault(key, []).append(voyage.rules[rule])
    return {key: pooled(own) for key, own in parts.items()}


def to_json(voyages: Sequence[Voyage]) -> dict[str, Any]:
    """The judgement as the documented JSON object."""
    seeds: dict[str, dict[int, None]] = {}
    for voyage in voyages:
        seeds.setdefault(voyage.scene, {})[voyage.seed] = None
    totals = {rule: grouped(voyages, rule, 'sensors') for rule in RULES}
    scenes = grouped(voyages, OURS, 'sensors', 'scene')
    return {
        'schema': SCHEMA,
        'seeds': {scene: list(own) for scene, own in seeds.items()},
        'sensors': [
            {
                'file': sensors,
                'total': {rule: totals[rule][(sensors,)].figures() for rule in RULES},
                'scenes': {
                    scene: quality.figures()
                    for (own, scene), quality in scenes.items()
                    if own == sensors
                },
            }
            for (sensors,) in totals[OURS]
        ],
    }


def written(name: str, value: float | None) -> str:
    """A figure as text; empty where there is none."""
    return '' if value is None else format(value, FIGURES[name][1])


def print_voyages(out: Console, voyages: Sequence[Voyage]) -> None:
    """Print a table for each grade of sensors, and a line for each scene."""
    totals = {rule: grouped(voyages, rule, 'sensors') for rule in RULES}
    scenes = grouped(voyages, OURS, 'sensors', 'scene')
    for (sensors,) in totals[OURS]:
        title = 'warnings judged by the truth' + (f', {sensors}' if sensors else '')
        table = Table(title=title, title_justify='left', box=SIMPLE_HEAD)
        table.add_column('')
        for label in RULES.values():
            table.add_column(label, justify='right', no_wrap=True)
        rows = [totals[rule][(sensors,)].figures() for rule in RULES]
        for name, (label, _) in FIGURES.items():
            table.add_row(label, *(written(name, row[name]) for row in rows))
        out.print(table)
        out.print(_by_scene({s: q for (own, s), q in scenes.items() if own == sensors}))


_OF_SCENE = {
    'episodes': 'epi-\nsodes',
    'lead_10s': 'lead\n10 s',
    'missed': 'mis-\nsed',
    'detected': 'detec-\nted',
    'false_per_100h': 'false\n/100 h',
    'far_per_1000h': 'far\n/1000 h',
    'changes_per_hour': 'chan-\nges/h',
    'largest_burst': '\nburst',
}


def _by_scene(scenes: Mapping[str, Quality]) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column('scene', no_wrap=True)
    for label in _OF_SCENE.values():
        table.add_column(label, justify='right', no_wrap=True)
    for scene, quality in scenes.items():
        figures = quality.figures()
        table.add_row(Path(scene).stem, *(written(name, figures[name]) for name in _OF_SCENE))
    return table
