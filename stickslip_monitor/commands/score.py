# SPDX-License-Identifier: Apache-2.0
"""Judge the monitor's warnings over simulated bags, or scenes, by what the lining really did.

A bag must hold the truth, as those of a scene with the effect lining_motion do. For each episode
of stick-slip: how long before its first stick the monitor warned (lead), and how long before it
predicted stick-slip (alarm lead); the table has the least of each. A warning is false if what it
says never was true: docs/warning_quality.md. The exit code is 1 where an episode was missed or
warned of too late, or a warning was false.

Of scenes (.yaml) no bag is written: each is simulated with several seeds, in processes, and judged
as a whole, with the bare rules V < V_F and V < V_H beside the monitor.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_monitor.commands.declared import (
    add_config,
    add_force,
    add_input,
    add_picture,
    say_written,
)
from stickslip_monitor.commands.output import add_json, console, print_json
from stickslip_monitor.commands.score_scenes import is_scene, run_scenes
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.lab.recorder_clock import scan_on_recorder_clock
from stickslip_monitor.lab.score import (
    EpisodeScore,
    Score,
    Truth,
    WarningInterval,
    in_total,
    score_bearing,
)
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.offline.follow import WholeBag, scan_whole
from stickslip_monitor.offline.intervals import condition_intervals
from stickslip_monitor.offline.truth import TruthRecord, has_truth, read_truth

SCHEMA = 'stickslip_monitor/score/1'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_input(
        parser,
        'bags',
        nargs='+',
        metavar='BAG',
        help='rosbag2 folder or .mcap file; or scene files (.yaml)',
    )
    add_config(parser, required=False)
    parser.add_argument('--bearing', help='only this bearing')
    add_picture(
        parser,
        'speed, load, margins, amplitude, truth and warnings of one bearing in one bag over time',
    )
    parser.add_argument(
        '--seeds', type=int, default=1, metavar='N', help='of scenes: how many seeds of each (1)'
    )
    parser.add_argument(
        '--first-seed', type=int, metavar='S', help="of scenes: the first seed (the scene's own)"
    )
    add_input(
        parser,
        '--sensors',
        action='append',
        metavar='FILE',
        help='of scenes: a file of sensors, in place of what the scene names; again for more',
    )
    parser.add_argument('--jobs', type=int, metavar='J', help='of scenes: processes (all cores)')
    add_force(parser)
    add_json(parser)


@dataclass(frozen=True, slots=True)
class Judged:
    """One bearing in one bag; the scan's times are those of the recorder."""

    path: str
    config: BearingConfig
    scan: Scan
    truth: TruthRecord
    score: Score


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    if any(map(is_scene, args.bags)):
        return run_scenes(args)
    if args.config is None:
        raise ConfigurationError('--config is missing: a bag does not say what bearing it is of')
    if args.sensors or args.seeds > 1 or args.first_seed is not None:
        raise ConfigurationError('--seeds, --first-seed and --sensors are for scenes (.yaml)')
    config = load_config(args.config)
    if args.bearing is not None:
        config = MonitorConfig((config.bearing(args.bearing),), config.autostart)
    judged = [one for path in args.bags for one in judge_bag(path, config)]
    total = in_total(one.score for one in judged)
    if args.picture is not None:
        _draw(args.picture, judged, args.force)
    if args.json:
        print_json(to_json(judged, total))
    else:
        _print(console(), judged, total)
    return int(not total.is_good)


def judge_bag(path: str | Path, config: MonitorConfig) -> list[Judged]:
    """Judge the bearings of a bag about which it holds the truth.

    Raises:
        BagError: The bag cannot be read, or it holds no truth.
    """
    whole = scan_whole(path, config)
    known = [b for b in config.bearings if has_truth(whole.bag, b.name)]
    return [_judge(str(path), whole, bearing) for bearing in known or config.bearings[:1]]


def _judge(path: str, whole: WholeBag, config: BearingConfig) -> Judged:
    record = read_truth(whole.bag, config.name)
    scan = scan_on_recorder_clock(whole, config)
    truth = Truth(
        start_ns=record.start_ns,
        end_ns=record.end_ns,
        episodes=record.episodes,
        time_ns=record.fold_margin.time_ns,
        hopf_margin=record.hopf_margin.value,
        fold_margin=record.fold_margin.value,
    )
    span = (record.start_ns, record.end_ns)
    score = score_bearing(config.alarm, scan.events, span, truth)
    return Judged(path, config, scan, record, score)


def to_json(judged: Sequence[Judged], total: Score) -> dict[str, Any]:
    """The judgement as the documented JSON object."""
    bags: dict[str, dict[str, Any]] = {}
    for one in judged:
        lists = {
            'events': {
                'episodes': [_episode_json(e) for e in one.score.episodes],
                'warnings': [_claim_json(c) for c in one.score.warnings],
                'alarms': [_claim_json(c) for c in one.score.alarms],
            }
        }
        bags.setdefault(one.path, {})[one.config.name] = _figures(one.score) | lists
    return {
        'schema': SCHEMA,
        'bags': [{'path': path, 'bearings': bearings} for path, bearings in bags.items()],
        'total': _figures(total),
    }


def _figures(score: Score) -> dict[str, Any]:
    return {
        'seconds': score.seconds,
        'episodes': len(score.episodes),
        'missed': score.missed,
        'late': score.late,
        'lead': _spread(score.leads),
        'alarm_lead': _spread(score.alarm_leads),
        'warnings': len(score.warnings),
        'alarms': len(score.alarms),
        'false_warnings': sum(claim.holds is False for claim in score.warnings),
        'false_alarms': sum(claim.holds is False for claim in score.alarms),
        'false_per_hour': score.false_per_hour,
        'sticking': score.sticking,
        'unpredicted': score.unpredicted,
        'unwarned': score.unwarned,
        'overpredicted': score.overpredicted,
        'wrong': score.wrong,
        'blind': score.blind,
    }


def _spread(leads: list[float]) -> dict[str, float] | None:
    return {'least': min(leads), 'median': statistics.median(leads)} if leads else None


def _episode_json(episode: EpisodeScore) -> dict[str, Any]:
    return {
        'first_stick': episode.first_ns,
        'last_stick': episode.last_ns,
        'lead': episode.lead,
        'alarm_lead': episode.alarm_lead,
        'blind': episode.blind,
    }


def _claim_json(claim: WarningInterval) -> dict[str, Any]:
    return {
        'start': claim.start_ns,
        'end': claim.end_ns,
        'highest': claim.highest.value,
        'holds': claim.holds,
    }


def _print(out: Console, judged: Sequence[Judged], total: Score) -> None:
    table = Table(title='warnings judged by the truth', title_justify='left', box=SIMPLE_HEAD)
    names = [_name(one, judged) for one in judged]
    table.add_column('bag', overflow='fold', min_width=min(max(map(len, names)), 30))
    for heading in (
        'hours', 'epi-\nsodes', 'missed', 'late', 'lead\n\\[s]', 'alarm\n\\[s]', 'false',
        'false\nper h', 'wrong\n\\[s]',
    ):  # fmt: skip
        table.add_column(heading, justify='right', no_wrap=True)
    for name, one in zip(names, judged, strict=True):
        table.add_row(escape(name), *_cells(one.score))
    if len(judged) > 1:
        table.add_section()
        table.add_row('total', *_cells(total), style='bold')
    out.print(table)
    for one in judged:
        for text in _remarks(one):
            out.print(f'{escape(_name(one, judged))}: {text}')


def _name(one: Judged, judged: Sequence[Judged]) -> str:
    bag = Path(one.path).name
    if any(other.path != one.path and Path(other.path).name == bag for other in judged):
        bag = one.path
    several = len({other.config.name for other in judged}) > 1
    return f'{bag} {one.config.name}' if several else bag


def _cells(score: Score) -> list[str]:
    false = len(score.false_claims)
    return [
        f'{score.seconds / 3600.0:.2f}',
        str(len(score.episodes)),
        _coloured(score.missed),
        _coloured(score.late),
        f'{min(score.leads):+.1f}' if score.leads else '',
        f'{min(score.alarm_leads):+.1f}' if score.alarm_leads else '',
        _coloured(false),
        f'{score.false_per_hour:.2g}',
        f'{score.wrong:.1f}',
    ]


def _coloured(count: int) -> str:
    return f'[red]{count}[/]' if count else '0'


def _remarks(one: Judged) -> list[str]:
    """A sentence for every episode and for every warning that was false."""
    start = one.truth.start_ns

    def at(time_ns: int) -> str:
        return f'{(time_ns - start) / 1e9:.1f} s'

    found = [
        f'stick-slip from {at(e.first_ns)} to {at(e.last_ns)}, {_lead_text(e)}'
        for e in one.score.episodes
    ]
    found += [
        f'[red]false[/]: {claim.highest.value} from {at(claim.start_ns)} to {at(claim.end_ns)}'
        for claim in one.score.false_claims
    ]
    return found


def _lead_text(episode: EpisodeScore) -> str:
    if episode.lead is None:
        blind = ' (an input was lost)' if episode.blind else ''
        return f'[red]missed[/]{blind}'
    text = f'warned {_before(episode.lead)}'
    if episode.alarm_lead is None:
        return f'{text}, never predicted'
    return f'{text}, predicted {_before(episode.alarm_lead)}'


def _before(lead: float) -> str:
    return f'{lead:.1f} s before' if lead >= 0.0 else f'[red]{-lead:.1f} s late[/]'


def _draw(path: str, judged: Sequence[Judged], force: bool) -> None:
    if len(judged) != 1:
        names = ', '.join(f'{one.config.name} in {one.path}' for one in judged)
        raise ConfigurationError(
            f'--picture shows one bearing in one bag, and here are {names}: give one bag, and'
            ' --bearing where it has several'
        )
    from stickslip_monitor.drawing.canvas import save_figure
    from stickslip_monitor.drawing.timeline import LiningTruth, Timeline, draw_timeline

    (one,) = judged
    record = one.truth
    lining = LiningTruth(
        episodes=record.episodes,
        margin_ns=record.fold_margin.time_ns,
        hopf_margin=record.hopf_margin.value,
        fold_margin=record.fold_margin.value,
        amplitude_ns=record.amplitude.time_ns,
        amplitude=record.amplitude.value,
    )
    spells = condition_intervals(one.scan.events, record.start_ns, record.end_ns)
    title = f'{Path(one.path).name}: {one.config.name}'
    timeline = Timeline(one.config, one.scan, spells, lining, title)
    save_figure(draw_timeline(timeline), path, force)
    say_written(path)
