# SPDX-License-Identifier: Apache-2.0
"""Infer a bearing's stability boundaries from recordings and reports of vibration.

Evidence is an operator's CSV file (--reports: bearing, start, end, state, and as one likes
tolerance [s] and trust), a topic with the level of vibration (--level), or the truth in simulated
bags. The result is a file that `calibration:` in the bearing's configuration names; it holds for
the readings of the same sensors, and is no measurement of friction. The exit code is 1 where a
warning says that the result is worth less (no episode, a doubtful report, a surprise), and 2 for
bad input.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_monitor import __version__
from stickslip_monitor.bags.reader import Request
from stickslip_monitor.commands.arguments import the_bearing
from stickslip_monitor.commands.output import (
    ProgressBar,
    add_config,
    add_force,
    add_json,
    check_outputs,
    console,
    json_text,
    print_json,
    say_written,
)
from stickslip_monitor.commands.score import judge_bag
from stickslip_monitor.errors import CalibrationError, ConfigurationError, cause
from stickslip_monitor.files import write_whole
from stickslip_monitor.monitor.calibration_file import (
    CALIBRATION_SCHEMA,
    load_calibration,
    require_same_sensors,
)
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.scan import Scan
from stickslip_monitor.offline.check import check_bag
from stickslip_monitor.offline.truth import has_truth
from stickslip_monitor.physics.belief import QUANTILES, Belief
from stickslip_monitor.study.calibration.calibrate import (
    FLOOR,
    Calibration,
    belief_in,
    calibrate,
    dip_limit,
)
from stickslip_monitor.study.calibration.dips import (
    Dip,
    TelemetryBins,
    VibrationReport,
    course_of,
    cut_dips,
)
from stickslip_monitor.study.calibration.evidence import (
    LEVEL_TOLERANCE,
    TRUST,
    TRUTH_TOLERANCE,
    alternating,
    in_order,
    level_episodes,
    level_threshold,
    read_reports,
)
from stickslip_monitor.study.calibration.posterior import SEED, Prior, prior_of
from stickslip_monitor.study.calibration.result import (
    FRAGMENT_MARK,
    fragment,
    inputs_of,
    prior_from,
    prior_with_bench,
    to_document,
)

_PRIOR_DRAWS = 512
_RESULT_MARK = CALIBRATION_SCHEMA.encode()
_PICTURE_LOADS = 60


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What one recording tells of a bearing."""

    courses: tuple[TelemetryBins, ...]
    reports: tuple[VibrationReport, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bags', nargs='+', metavar='BAG', help='rosbag2 folder or .mcap file')
    add_config(parser)
    parser.add_argument('--bearing', help='which bearing, where several are configured')
    source = parser.add_mutually_exclusive_group()
    source.add_argument('--reports', metavar='CSV', help="an operator's reports of vibration")
    source.add_argument('--level', metavar='TOPIC', help='a topic with the level of vibration')
    parser.add_argument(
        '--field', default='data', help='path to the number in its messages (default: data)'
    )
    parser.add_argument('--output', '-o', metavar='FILE', help='write the result, JSON')
    parser.add_argument('--add', metavar='FILE', help='begin with this earlier result')
    parser.add_argument(
        '--forget',
        type=float,
        default=0.0,
        metavar='S',
        help='let ln N0 wander by this standard deviation from dip to dip, e.g. 0.03',
    )
    parser.add_argument('--bench', metavar='FIT', help='what stickslip fit --json printed')
    parser.add_argument('--fragment', metavar='FILE', help='write damping and friction, YAML')
    parser.add_argument('--picture', metavar='FILE', help='.png or .svg: the map with its bands')
    add_force(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    if not 0.0 <= args.forget <= 1.0:
        raise ConfigurationError(f'--forget {args.forget:g} must be from 0 to 1')
    _check_outputs(args)
    config = the_bearing(load_config(args.config), args.bearing)
    earlier = _earlier(args.add, config)
    prior = _prior(args, config, earlier)
    with ProgressBar() as meter:
        dips = _dips(args, config, prior, meter)
        found = calibrate(
            dips,
            prior,
            config.tolerance.model_error or FLOOR,
            args.forget,
            progress=lambda done, total: meter.show('inferring', done, total),
        )
    now = datetime.now(timezone.utc).isoformat(timespec='seconds')
    document = to_document(config, found, earlier, now, __version__)
    _write(args, config, found, document)
    if args.json:
        print_json(document)
    else:
        _print(console(), config, found)
    return int(bool(found.warnings))


def _earlier(path: str | None, config: BearingConfig) -> Mapping[str, Any] | None:
    if path is None:
        return None
    document = load_calibration(path)
    require_same_sensors(path, document, config.name, inputs_of(config))
    return document


def _prior(
    args: argparse.Namespace, config: BearingConfig, earlier: Mapping[str, Any] | None
) -> Prior:
    if earlier is not None:
        if args.bench is not None:
            raise ConfigurationError(
                '--bench is a prior for a first calibration, and --add already has one: give one'
                ' of them'
            )
        return prior_from(args.add, earlier)
    prior = prior_of(config.bearing, config.tolerance)
    if args.bench is None:
        return prior
    try:
        document = json.loads(Path(args.bench).read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f'{args.bench} cannot be read: {cause(error)}') from error
    return prior_with_bench(prior, args.bench, document)


def _dips(
    args: argparse.Namespace, config: BearingConfig, prior: Prior, meter: ProgressBar
) -> list[Dip]:
    """The dips of all recordings of which something was reported."""
    found = []
    for k, path in enumerate(args.bags):
        meter.show(f'reading {Path(path).name}', k, len(args.bags))
        found.append(_evidence(args, path, config))
    if args.level is not None:
        found = _with_levels(args, config, found)
    reports = _operator_reports(args.reports, config, found)
    limit = dip_limit(prior)
    timeout = max(config.speed.timeout_ns, config.load.timeout_ns)
    dips = [
        dip
        for one in found
        for course in one.courses
        for dip in cut_dips(course, reports or one.reports, limit, prior.viscous, timeout)
    ]
    if not dips:
        raise CalibrationError(
            f'there is no evidence on {config.name}: no report is about a time in which the shaft'
            ' turned slowly enough for stick-slip; record a slow passage with reports'
        )
    return dips


def _evidence(args: argparse.Namespace, path: str, config: BearingConfig) -> Evidence:
    only = MonitorConfig((config,))
    if args.reports is not None or args.level is not None:
        return Evidence(_courses(path, check_bag(path, only).bearings[config.name].scan), ())
    (judged,) = judge_bag(path, only) if _has_truth(path, config) else (None,)
    if judged is None:
        raise CalibrationError(
            f"bag '{path}' holds no truth about {config.name}, as those of a simulation do: give"
            ' --reports or --level'
        )
    truth = judged.truth
    span = truth.start_ns, truth.end_ns
    source = f'truth of {Path(path).name}'
    reports = alternating(config.name, span, truth.episodes, TRUTH_TOLERANCE, TRUST, source)
    return Evidence(_courses(path, judged.scan), tuple(reports))


def _has_truth(path: str, config: BearingConfig) -> bool:
    from stickslip_monitor.bags.reader import open_bag

    return has_truth(open_bag(path), config.name)


def _courses(path: str, scan: Scan) -> tuple[TelemetryBins, ...]:
    """Speed and load between two jumps of the clock."""
    begins = np.append(np.unique(scan.first), scan.time_ns.size)
    speed, load = scan.assessment.speed, scan.assessment.load
    return tuple(
        course_of(Path(path).name, scan.time_ns[a:b], speed[a:b], load[a:b])
        for a, b in pairwise(begins)
        if b > a
    )


def _with_levels(
    args: argparse.Namespace, config: BearingConfig, found: Sequence[Evidence]
) -> list[Evidence]:
    """The recordings with the reports that a level makes; one threshold for all of them."""
    from stickslip_monitor.bags.reader import open_bag

    request = Request(args.level, args.field)
    series = [open_bag(path).read([request])[request] for path in args.bags]
    threshold = level_threshold(args.level, np.concatenate([one.value for one in series]))
    gap = max(config.speed.timeout_ns, config.load.timeout_ns)
    result = []
    for path, own, evidence in zip(args.bags, series, found, strict=True):
        known = np.isfinite(own.value) & (own.value > 0.0)
        time = own.stamp_ns[known]
        reports = [
            report
            for a, b in _stretches(time, gap)
            for report in alternating(
                config.name,
                (int(time[a]), int(time[b - 1])),
                level_episodes(time[a:b], own.value[known][a:b], threshold, gap),
                LEVEL_TOLERANCE,
                TRUST,
                f'{args.level} in {Path(path).name}',
            )
        ]
        result.append(Evidence(evidence.courses, tuple(in_order(reports))))
    return result


def _stretches(time: NDArray[np.int64], gap: int) -> list[tuple[int, int]]:
    """Stretches of times without a gap, as ranges of their indices."""
    bounds = [0, *(np.flatnonzero(np.diff(time) > gap) + 1).tolist(), time.size]
    return [(a, b) for a, b in pairwise(bounds) if b - a > 1]


def _operator_reports(
    path: str | None, config: BearingConfig, found: Sequence[Evidence]
) -> tuple[VibrationReport, ...]:
    if path is None:
        return ()
    spans = [
        (int(c.time_ns[0]), int(c.time_ns[-1])) for one in found for c in one.courses
    ]  # fmt: skip
    own = [r for r in read_reports(path, [config.name]) if r.bearing == config.name]
    for report in own:
        if not any(report.end_ns > a and report.start_ns < b for a, b in spans):
            raise CalibrationError(
                f'{report.source}: the report lies outside the recordings: give the bag that it'
                ' is about'
            )
    return tuple(own)


def _write(
    args: argparse.Namespace,
    config: BearingConfig,
    found: Calibration,
    document: Mapping[str, Any],
) -> None:
    if args.output is not None:
        write_whole(args.output, json_text(document).encode(), _RESULT_MARK, args.force)
    if args.fragment is not None:
        write_whole(args.fragment, fragment(config, found).encode(), FRAGMENT_MARK, args.force)
    if args.picture is not None:
        from stickslip_monitor.drawing.calibration import draw_calibration
        from stickslip_monitor.drawing.canvas import save_figure

        save_figure(draw_calibration(_picture(config, found)), args.picture, args.force)
    say_written(args.output, args.fragment, args.picture)


def _check_outputs(args: argparse.Namespace) -> None:
    outputs: list[tuple[str | None, bytes | None]] = [
        (args.output, _RESULT_MARK),
        (args.fragment, FRAGMENT_MARK),
    ]
    if args.picture is not None:
        from stickslip_monitor.drawing.canvas import MARKS, checked_suffix

        outputs.append((args.picture, MARKS.get(checked_suffix(args.picture))))
    inputs = [*args.bags, args.config, args.reports, args.bench]
    # The result of the last calibration may be renewed in its place.
    check_outputs(outputs, inputs, args.force)


def _prior_belief(found: Calibration) -> Belief:
    random = np.random.default_rng(SEED)
    prior = found.prior
    draws = random.multivariate_normal(prior.mean, prior.covariance, _PRIOR_DRAWS)
    return belief_in(draws, found.floor, prior.viscous, (1e-9, 1e12))


def _picture(config: BearingConfig, found: Calibration) -> Any:
    from stickslip_monitor.drawing.calibration import CalibrationPicture

    low, high = found.loads
    load = np.linspace(0.6 * low, 1.4 * high, _PICTURE_LOADS)
    rpm = config.bearing.speed.factor('rpm')
    prior, posterior = (
        np.array(
            [
                [speed(load, p) / rpm for p in QUANTILES]
                for speed in (belief.fold_speed, belief.hopf_speed)
            ]
        )
        for belief in (_prior_belief(found), found.belief())
    )
    dips, episodes = len(found.dips), found.episodes
    title = f'{config.name}: {dips} dips, {episodes} episodes'
    tracks = [_track(one, rpm, found) for one in found.dips]
    return CalibrationPicture(title, load, prior, posterior, tracks)


def _track(one: Any, rpm: float, found: Calibration) -> Any:
    from stickslip_monitor.drawing.calibration import DipTrack
    from stickslip_monitor.study.calibration.likelihood import LOAD_TERM

    dip, time = one.dip, one.dip.time_ns[: one.dip.path.shape[0]]
    squeal, doubtful = (np.zeros(time.size, dtype=bool) for _ in range(2))
    for report, p in zip(dip.reports, one.worthless, strict=False):
        own = (time >= report.start_ns) & (time <= report.end_ns)
        squeal |= own & report.squeal
        doubtful |= own & (p > 0.5)
    term = np.exp(dip.path[:, LOAD_TERM])
    load = term / (1.0 - found.prior.viscous * term)
    return DipTrack(dip.speed / rpm, load, squeal, doubtful)


def _print(out: Console, config: BearingConfig, found: Calibration) -> None:
    low, high = found.loads
    out.print(
        f'[bold]{escape(config.name)}[/]: {len(found.dips)} dips, {found.episodes} episodes,'
        f' {low:.4g} to {high:.4g} N'
    )
    out.print(_boundary_table(config, found))
    mean, spread = found.posterior.mean, np.sqrt(np.diag(found.posterior.covariance))
    for name, k, unit in (
        ('decay beta', 0, 's/m'), ('load N0', 1, 'N'), ('delay of the onset', 2, 's'),
        ('delay of the end', 3, 's'), ('scatter of a passage', 5, ''),
    ):  # fmt: skip
        out.print(f'{name}: {np.exp(mean[k]):.3g} {unit} (+-{spread[k]:.1%})'.replace('  ', ' '))
    evidence = found.posterior.log_evidence
    per_dip = float(evidence.mean()) if evidence.size else 0.0
    out.print(
        f'effective number of points: {found.posterior.effective:.0f}; log evidence a dip:'
        f' {per_dip:.2f}'
    )
    for text in found.remarks:
        out.print(escape(text))
    for text in found.warnings:
        out.print(f'[yellow]warning:[/] {escape(text)}')
    out.print('It holds for the readings of these sensors, and is no measurement of friction.')


def _boundary_table(config: BearingConfig, found: Calibration) -> Table:
    rpm = config.bearing.speed.factor('rpm')
    table = Table(
        title=escape('boundaries [rpm]: 5 %, 50 %, 95 %'), title_justify='left', box=SIMPLE_HEAD
    )
    for heading in ('load', 'boundary', 'before', 'now'):
        table.add_column(heading, justify='right', no_wrap=True)
    prior = _prior_belief(found)
    for load, *now in found.boundaries():
        before = [s(load, p) for s in (prior.hopf_speed, prior.fold_speed) for p in QUANTILES]
        for k, name in enumerate(('Hopf', 'fold')):
            own = slice(3 * k, 3 * k + 3)
            texts = [
                ', '.join(f'{value / rpm:.1f}' for value in values[own])
                for values in (before, now)
            ]
            table.add_row(f'{load:.4g} N' if k == 0 else '', name, *texts)
    return table
