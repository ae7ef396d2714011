# SPDX-License-Identifier: Apache-2.0
"""Infer a bearing's stability boundaries from recordings and reports of vibration.

The evidence is an operator's CSV file (--reports: bearing, start, end, state, optionally
tolerance [s] and trust); without one, the level configured for the bearing; without a level, the
truth in simulated bags. Name the resulting file under `calibration:` in the bearing's
configuration. It is valid for readings of the same sensors and does not measure friction. Exits 1
if a warning lowers the value of the result (no episode, a doubtful report, a surprise), 2 for bad
input.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_monitor import __version__
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import ConfigurationError, cause, plural
from stickslip_monitor.files import read_json
from stickslip_monitor.lab.calibration.calibrate import FLOOR, Calibration, calibrate
from stickslip_monitor.lab.calibration.evidence import Dip, read_reports
from stickslip_monitor.lab.calibration.posterior import Prior, prior_of
from stickslip_monitor.lab.calibration.recordings import EvidenceSource
from stickslip_monitor.lab.calibration.result import (
    FRAGMENT_MARK,
    fragment,
    inputs_of,
    known_dips,
    prior_from,
    prior_with_bench,
    to_document,
)
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.configure import (
    CALIBRATION_SCHEMA,
    LARGEST_JSON,
    belief_of,
    load_calibration,
    require_same_sensors,
)
from stickslip_monitor.offline.check import Kept, check_recording
from stickslip_monitor.physics.belief import EXACT, QUANTILES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = 'rosbag2 folder or .mcap file'
    options.add_input(parser, 'bags', nargs='+', metavar='BAG', help=text)
    options.add_config(parser)
    options.add_bearing(parser, options.ONE_OF_SEVERAL)
    text = "an operator's reports of vibration"
    options.add_input(parser, '--reports', metavar='CSV', help=text)
    # The result of the last calibration may be renewed in its place.
    result = {'': CALIBRATION_SCHEMA.encode()}
    text = 'write the result, JSON'
    options.add_output(parser, '--output', '-o', marks=result, renews=True, help=text)
    options.add_input(parser, '--add', metavar='FILE', help='start from this earlier result')
    text = 'allow a slow drift of the boundary: standard deviation of ln N0, e.g. 0.03'
    options.add_number(parser, '--forget', 0, 1, kind=float, default=0.0, metavar='S', help=text)
    options.add_input(parser, '--bench', metavar='FIT', help='result of stickslip fit --json')
    yaml = {'': FRAGMENT_MARK}
    options.add_output(
        parser,
        '--fragment',
        marks=yaml,
        help='write damping and friction as a configuration fragment, YAML',
    )
    options.add_picture(parser, 'the map with its bands')
    options.add_force(parser)
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    whole = load_config(args.config)
    config = options.the_bearing(whole) if args.bearing is None else whole.bearing(args.bearing)
    source = source_of(args.reports, whole)
    earlier = _earlier(args.add, config)
    prior = _prior(args, config, earlier)
    with output.ProgressBar() as meter:
        dips = _dips(args.bags, config, source, prior, meter)
        found = calibrate(
            dips,
            prior,
            config.tolerance.model_error or FLOOR,
            args.forget,
            progress=lambda done, total: meter.show('inferring', done, total),
            known=known_dips(earlier, dips) if earlier is not None else (),
        )
    now = datetime.now(timezone.utc).isoformat(timespec='seconds')
    document = to_document(config, found, earlier, now, __version__)
    output.write_outputs(
        args,
        output=lambda: output.json_text(document),
        fragment=lambda: fragment(config, found),
        picture=lambda: _drawn(config, found),
    )
    if args.json:
        output.print_json(document)
    else:
        _print(output.console(), config, found)
    return int(bool(found.warnings))


def _earlier(path: str | None, config: BearingConfig) -> Mapping[str, Any] | None:
    if path is None:
        return None
    document = load_calibration(path)
    require_same_sensors(path, document, config.name, inputs_of(config))
    belief_of(path, document, EXACT)  # refuses what is damaged before hours of reading
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
        return prior_from(args.add, earlier, prior_of(config.bearing, config.tolerance))
    if args.bench is None:
        return prior_of(config.bearing, config.tolerance)
    try:
        document = read_json(args.bench, LARGEST_JSON)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f'{args.bench} cannot be read: {cause(error)}') from error
    return prior_with_bench(config.bearing, config.tolerance, args.bench, document)


def source_of(reports: str | None, config: MonitorConfig) -> EvidenceSource:
    """The source of when the bearings of a configuration vibrated: an operator's file, if any."""
    names = [bearing.name for bearing in config.bearings]
    return EvidenceSource(None if reports is None else tuple(read_reports(reports, names)))


def _dips(
    bags: Sequence[str],
    config: BearingConfig,
    source: EvidenceSource,
    prior: Prior,
    meter: output.ProgressBar,
) -> list[Dip]:
    """The dips of all recordings of which something was reported."""
    found = []
    for k, path in enumerate(bags):
        meter.show(f'reading {Path(path).name}', k, len(bags))
        kept = Kept()
        check_recording(path, MonitorConfig((config,)), [kept])
        found.append(source.of_recording(kept, config))
    return source.dips(config, prior, found)


def _drawn(config: BearingConfig, found: Calibration) -> Any:
    # Drawing takes time to import.
    from stickslip_monitor.drawing.fits import draw_calibration

    return draw_calibration(config, found)


def _print(out: Console, config: BearingConfig, found: Calibration) -> None:
    low, high = found.loads
    out.print(
        f'[bold]{escape(config.name)}[/]: {plural(len(found.dips), "dip")},'
        f' {plural(found.episodes, "episode")}, {low:.4g} to {high:.4g} N'
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
    table = Table(
        title=escape('boundaries [rpm]: 5 %, 50 %, 95 %'), title_justify='left', box=SIMPLE_HEAD
    )
    for heading in ('load', 'boundary', 'before', 'now'):
        table.add_column(heading, justify='right', no_wrap=True)
    before, rpm = found.prior_belief(), config.bearing.speed.factor('rpm')
    for load, *now in found.boundaries():
        for k, name in enumerate(('hopf_speed', 'fold_speed')):
            past = [getattr(before, name)(load, p) for p in QUANTILES]
            texts = [
                ', '.join(f'{value / rpm:.1f}' for value in values)
                for values in (past, now[3 * k : 3 * k + 3])
            ]
            table.add_row('' if k else f'{load:.4g} N', ('Hopf', 'fold')[k], *texts)
    return table
