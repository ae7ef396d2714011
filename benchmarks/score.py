# SPDX-License-Identifier: Apache-2.0
"""Judge the monitor's warnings over simulated bags, or scenes, by what the lining really did.

A bag must hold the truth: simulate it from a scene with the effect lining_motion. Scenes (.yaml)
are simulated with several seeds, in parallel. The bare rules V < V_F and V < V_H are judged beside
the monitor; docs/warning_quality.md defines the figures. Exits 1 if an episode of stick-slip was
missed or warned of too late, or if a stick-slip alarm was false.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.voyages import BELOW_FOLD, BELOW_HOPF, OURS, Call, Sailed, Voyage, judge_bag, judge_calls
from benchmarks.warning_quality import (
    FIGURES,
    Episode,
    Quality,
    announced_episodes,
    false_alarms,
    format_figure,
    pool_qualities,
)
from stickslip_lab.scenes.scene import load_scene
from stickslip_monitor.cli import main as run_command
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.offline.extremes import condition_intervals
from stickslip_monitor.offline.processes import core_count

OF_BAGS, OF_SCENES = 'stickslip_monitor/score/2', 'stickslip_monitor/warning_quality/2'
RULES = {OURS: 'monitor', BELOW_FOLD: 'V < V_F', BELOW_HOPF: 'V < V_H'}
_SCENE, _SENSORS = attrgetter('scene'), attrgetter('sensors')
_COLUMNS = {
    'episodes': 'epi-\nsodes',
    'lead_least': 'least\nlead',
    'alarm_least': 'of the\nalarm',
    'lead_10s': 'lead\n10 s',
    'missed': 'mis-\nsed',
    'detected': 'detec-\nted',
    'false_per_100h': 'false\n/100 h',
    'far_per_1000h': 'far\n/1000 h',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = 'recording or log; or scene files (.yaml)'
    options.add_file(parser, 'bags', nargs='+', metavar='BAG', help=text)
    options.add_config(parser, required=False)
    options.add_shared(parser, '--bearing')
    text = 'speed, load, margins, amplitude, truth and warnings over time, for one bearing of a bag'
    options.add_picture(parser, text)
    text = 'for scenes: number of seeds of each (default 1)'
    options.add_number(parser, '--seeds', 1, default=1, metavar='N', help=text)
    text = "for scenes: the first seed (default: the scene's own)"
    options.add_number(parser, '--first-seed', 0, metavar='S', help=text)
    text = "for scenes: a file of sensors, in place of the scene's own; repeat for more"
    options.add_file(parser, '--sensors', action='append', metavar='FILE', help=text)
    options.add_number(parser, '--jobs', 1, metavar='J', help='for scenes: processes (default: all cores)')
    options.add_shared(parser, '--force', '--json')


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    scenes = [path for path in args.bags if Path(path).suffix in ('.yaml', '.yml')]
    judged = [] if scenes else _judged_bags(args)
    voyages = _judged_scenes(args, scenes) if scenes else [voyage for voyage, _ in judged]
    output.write_outputs(args, picture=lambda: _draw_case(judged))
    if args.json:
        output.print_json(_scenes_json(voyages) if scenes else _bags_json(judged))
    else:
        out = output.console()
        _print_tables(out, voyages, 'scene' if scenes else 'bag')
        for voyage, case in judged:
            for text in _describe_case(case):
                out.print(f'{escape(_short_name(voyages, voyage))}: {text}')
    return int(not pool_qualities(voyage.rules[OURS] for voyage in voyages).is_good)


def _judged_bags(args: argparse.Namespace) -> list[tuple[Voyage, Sailed]]:
    if args.config is None:
        raise ConfigurationError('--config is missing: a bag does not say what bearing it is of')
    if args.sensors or args.seeds > 1 or args.first_seed is not None:
        raise ConfigurationError('--seeds, --first-seed and --sensors are for scenes (.yaml)')
    config = options.load_chosen(args)
    return [judged for path in args.bags for judged in judge_bag(path, config)]


def _judged_scenes(args: argparse.Namespace, scenes: Sequence[str]) -> list[Voyage]:
    bags = [path for path in args.bags if path not in scenes]
    if bags:
        raise ConfigurationError(f"'{bags[0]}' is no scene: give either scenes (.yaml) or bags, not both")
    for name in ('config', 'bearing', 'picture'):
        if getattr(args, name) is not None:
            raise ConfigurationError(f'--{name} is for bags: a scene says what is judged')
    sensors = tuple(args.sensors) if args.sensors else (None,)
    calls = []
    for scene in scenes:
        first = args.first_seed
        first = load_scene(scene, sensors=sensors[0]).seed if first is None else first
        calls += [Call(scene, first + k, sensors) for k in range(args.seeds)]
    return judge_all(calls, args.jobs or core_count())


def judge_all(calls: Sequence[Call], jobs: int) -> list[Voyage]:
    """Judge all calls, with a progress bar; the order of the results is that of the calls."""
    by_number: dict[int, list[Voyage]] = {}
    with output.ProgressBar() as meter:
        for number, voyages in judge_calls(calls, min(jobs, len(calls))):
            by_number[number] = voyages
            meter.show(f'{len(by_number)} of {len(calls)} voyages', len(by_number), len(calls))
    return [voyage for number in range(len(calls)) for voyage in by_number[number]]


def _bags_json(judged: Sequence[tuple[Voyage, Sailed]]) -> dict[str, Any]:
    bags: dict[str, dict[str, Any]] = {}
    for voyage, case in judged:
        output_of_monitor = case.output()
        bags.setdefault(voyage.scene, {})[voyage.bearing] = {
            'figures': voyage.rules[OURS].figures(),
            'episodes': [asdict(episode) for episode in announced_episodes(output_of_monitor, case.truth)],
            'false_alarms': [
                {'start_ns': start, 'end_ns': end}
                for start, end in false_alarms(output_of_monitor, case.truth)
            ],
        }
    return {
        'schema': OF_BAGS,
        'bags': [{'path': path, 'bearings': bearings} for path, bearings in bags.items()],
        'total': _total_figures([voyage for voyage, _ in judged]),
    }


def _scenes_json(voyages: Sequence[Voyage]) -> dict[str, Any]:
    return {
        'schema': OF_SCENES,
        'seeds': {
            scene: list(dict.fromkeys(voyage.seed for voyage in group))
            for scene, group in _group_by(voyages, _SCENE).items()
        },
        'sensors': [
            {
                'file': sensors,
                'total': _total_figures(group),
                'scenes': {
                    scene: _pool_monitor(parts).figures() for scene, parts in _group_by(group, _SCENE).items()
                },
            }
            for sensors, group in _group_by(voyages, _SENSORS).items()
        ],
    }


def _group_by(voyages: Iterable[Voyage], of: Callable[[Voyage], Any]) -> dict[Any, list[Voyage]]:
    groups: dict[Any, list[Voyage]] = {}
    for voyage in voyages:
        groups.setdefault(of(voyage), []).append(voyage)
    return groups


def _pool_monitor(voyages: Iterable[Voyage]) -> Quality:
    return pool_qualities(voyage.rules[OURS] for voyage in voyages)


def _total_figures(voyages: Sequence[Voyage]) -> dict[str, dict[str, float | None]]:
    return {rule: pool_qualities(v.rules[rule] for v in voyages).figures() for rule in RULES}


def _print_tables(out: Console, voyages: Sequence[Voyage], kind: str) -> None:
    """Print a table of all figures for each grade of sensors, and a line for each scene or bag."""
    for sensors, group in _group_by(voyages, _SENSORS).items():
        title = 'warnings judged by the truth' + (f', {sensors}' if sensors else '')
        table = Table(title=title, title_justify='left', box=SIMPLE_HEAD)
        table.add_column('')
        for label in RULES.values():
            table.add_column(label, justify='right', no_wrap=True)
        rows = _total_figures(group).values()
        for name, (label, *_) in FIGURES.items():
            table.add_row(label, *(format_figure(name, row[name]) for row in rows))
        out.print(table)
        lines = _group_by(group, partial(_short_name, group))
        out.print(_by_name(kind, {name: _pool_monitor(parts).figures() for name, parts in lines.items()}))


def _by_name(kind: str, rows: Mapping[str, Mapping[str, float | None]]) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(kind, overflow='fold', min_width=min(max(map(len, rows)), 30))
    for label in _COLUMNS.values():
        table.add_column(label, justify='right', no_wrap=True)
    for name, figures in rows.items():
        table.add_row(escape(name), *(format_figure(column, figures[column]) for column in _COLUMNS))
    return table


def _short_name(voyages: Sequence[Voyage], voyage: Voyage) -> str:
    """Return a scene or a bag as briefly as it differs from the others."""
    if voyage.seed is not None:
        return Path(voyage.scene).stem
    bag = Path(voyage.scene).name
    if any(v.scene != voyage.scene and Path(v.scene).name == bag for v in voyages):
        bag = voyage.scene
    several = len({v.bearing for v in voyages}) > 1
    return f'{bag} {voyage.bearing}' if several else bag


def _describe_case(case: Sailed) -> list[str]:
    """Return a sentence for every episode and for every false alarm."""
    rule_output, truth = case.output(), case.truth

    def at(time_ns: int) -> str:
        return f'{(time_ns - truth.start_ns) / 1e9:.1f} s'

    sentences = [
        f'stick-slip from {at(e.first_ns)} to {at(e.last_ns)}, {_lead_text(e)}'
        for e in announced_episodes(rule_output, truth)
    ]
    return sentences + [
        f'[red]false[/]: stick-slip alarm from {at(start)} to {at(end)}'
        for start, end in false_alarms(rule_output, truth)
    ]


def _lead_text(episode: Episode) -> str:
    if episode.lead is None:
        return '[red]missed[/]'
    text = f'warned {_format_lead(episode.lead)}'
    if episode.alarm_lead is None:
        return f'{text}, never predicted'
    return f'{text}, predicted {_format_lead(episode.alarm_lead)}'


def _format_lead(lead: float) -> str:
    return f'{lead:.1f} s before' if lead >= 0.0 else f'[red]{-lead:.1f} s late[/]'


def _draw_case(judged: Sequence[tuple[Voyage, Sailed]]) -> Any:
    if len(judged) != 1:
        names = ', '.join(f'{voyage.bearing} in {voyage.scene}' for voyage, _ in judged)
        raise ConfigurationError(
            f'--picture shows one bearing in one bag, and here are {names}: give one bag, and'
            ' --bearing where it has several'
        )
    from stickslip_monitor.drawing.timeline import Timeline, draw_timeline

    ((voyage, case),) = judged
    scan, truth = case.sent.scan, case.truth
    intervals = condition_intervals(scan.events, truth.start_ns, truth.end_ns)
    title = f'{Path(voyage.scene).name}: {voyage.bearing}'
    return draw_timeline(Timeline(case.sent.config, scan, intervals, truth, title))


def main(argv: Sequence[str] | None = None) -> int:
    """Run as a command of the package does, with its sentences and exit codes."""
    arguments = sys.argv[1:] if argv is None else argv
    return run_command(['score', *arguments], {'score': 'judge warnings'}, 'benchmarks')


if __name__ == '__main__':
    sys.exit(main())
