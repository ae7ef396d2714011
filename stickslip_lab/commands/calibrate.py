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
import math
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_lab.calibration.calibration import (
    FRAGMENT_MARK,
    Calibration,
    Evidence,
    EvidenceSource,
    to_document,
    yaml_fragment,
)
from stickslip_lab.calibration.evidence import read_reports
from stickslip_lab.calibration.level_reports import NoTwoModes
from stickslip_lab.drawing.studies import draw_calibration, draw_levels
from stickslip_monitor import __version__
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import plural
from stickslip_monitor.monitor.calibration_file import CALIBRATION_SCHEMA
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.statements import rounded_text
from stickslip_monitor.offline.check import RecordingBuffer, check_recording
from stickslip_monitor.physics.probability import QUANTILES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_file(parser, 'bags', nargs='+', metavar='BAG', help='recording or log')
    options.add_config(parser)
    options.add_shared(parser, '--bearing', help=options.ONE_OF_SEVERAL)
    text = "an operator's reports of vibration"
    options.add_file(parser, '--reports', metavar='CSV', help=text)
    # The result of the last calibration, of an earlier version too, may be renewed in its place.
    result = {'': CALIBRATION_SCHEMA.rpartition('/')[0].encode()}
    text = 'write the result, JSON'
    options.add_file(parser, '--output', '-o', marks=result, renews=True, help=text)
    text = 'allow a slow drift of the boundary: standard deviation of ln N, e.g. 0.03'
    options.add_number(parser, '--forget', 0, 1, kind=float, default=0.0, metavar='S', help=text)
    yaml = {'': FRAGMENT_MARK}
    text = 'write damping and friction as a configuration fragment, YAML'
    options.add_file(parser, '--fragment', marks=yaml, help=text)
    options.add_picture(parser, 'the level with its edges, and the boundaries')
    options.add_shared(parser, '--force', '--json')


def run(args: argparse.Namespace) -> int:
    """Calibrate a bearing; write the outputs asked for and print the result.

    Where the level has no two modes, its picture is written before the error is raised.

    Returns:
        1 with a warning about the result, else 0.

    Raises:
        CalibrationError: There is no evidence, or it is contradictory or of another bearing.
        ConfigurationError: The configuration or an option is invalid.
        BagError: A recording cannot be read.
        OSError: A file of a recording was removed while it was read.
        PhysicsError: The friction law cannot be moved so far.
        DrawingError, OutputError: An output cannot be made or written.
    """
    whole = load_config(args.config, args.node)
    config = options.require_single_bearing(whole) if args.bearing is None else whole.bearing(args.bearing)
    source = source_of(args.reports, whole)
    with output.ProgressBar() as meter:
        evidence = _read_evidence(args.bags, config, source, meter)
    try:
        calibration = source.calibrated(config, evidence, args.forget)
    except NoTwoModes as error:
        levels = error.levels
        output.write_outputs(args, picture=lambda: draw_levels(config, levels))
        raise
    now = datetime.now(timezone.utc).isoformat(timespec='seconds')
    document = to_document(config, calibration, now, __version__)
    output.write_outputs(
        args,
        output=lambda: output.json_text(document),
        fragment=lambda: yaml_fragment(config, calibration),
        picture=lambda: draw_calibration(config, calibration),
    )
    if args.json:
        output.print_json(document)
    else:
        _print_calibration(output.console(), config, calibration)
    return int(bool(calibration.warnings))


def source_of(reports: str | None, config: MonitorConfig) -> EvidenceSource:
    """Return the source of evidence: the file of an operator's reports, or for ``None`` the recordings.

    Raises:
        CalibrationError: The file cannot be read or breaks a rule.
    """
    names = [bearing.name for bearing in config.bearings]
    return EvidenceSource(None if reports is None else tuple(read_reports(reports, names)))


def _read_evidence(
    bags: Sequence[str], config: BearingConfig, source: EvidenceSource, meter: output.ProgressBar
) -> list[Evidence]:
    """Check the recordings one after the other and return the evidence of each; show progress.

    Raises:
        BagError: A recording cannot be read.
        OSError: A file of one was removed after it was opened.
        CalibrationError: A recording has neither a level nor the truth, and there are no reports.
    """
    evidence = []
    for k, path in enumerate(bags):
        meter.show(f'reading {Path(path).name}', k, len(bags))
        outline = RecordingBuffer()
        check_recording(path, MonitorConfig((config,)), [outline])
        evidence.append(source.of_recording(outline, config))
    return evidence


def _print_calibration(out: Console, config: BearingConfig, calibration: Calibration) -> None:
    """Print loads, boundaries, factors, remarks and warnings of a calibration.

    Raises:
        PhysicsError: The friction law cannot be moved so far.
    """
    (low, high), (log_r, log_q) = calibration.loads, calibration.factors
    out.print(
        f'[bold]{escape(config.name)}[/]: {plural(len(calibration.edges.tracks), "passage")},'
        f' {plural(calibration.episodes, "episode")}, {rounded_text(low, 4)} to {rounded_text(high, 4)} N'
    )
    out.print(_boundary_table(config, calibration))
    out.print(
        f'speeds of both boundaries times {math.exp(log_r):.3g} (+-{calibration.spread[0]:.0%}), loads'
        f' divided by {math.exp(log_q):.3g} (+-{calibration.spread[1]:.0%}), as one known far better than'
        ' either'
    )
    for text in calibration.remarks:
        out.print(escape(text))
    for text in calibration.warnings:
        out.print(f'[yellow]warning:[/] {escape(text)}')
    out.print('It holds for the readings of these sensors, and is no measurement of friction.')


def _boundary_table(config: BearingConfig, calibration: Calibration) -> Table:
    """Return the table of both boundaries [rpm]: their 5, 50 and 95 % quantiles before and now.

    It has two rows for each load of :meth:`.Calibration.boundaries`.

    Raises:
        PhysicsError: The friction law cannot be moved so far.
    """
    table = output.make_table(escape('boundaries [rpm]: 5 %, 50 %, 95 %'), 'load; boundary; before; now', ())
    rpm = config.bearing.speed.factor('rpm')
    before = calibration.before.hopf_speed, calibration.before.fold_speed
    for load, *now in calibration.boundaries():
        for k, (name, of) in enumerate(zip(('Hopf', 'fold'), before, strict=True)):
            past = [of(load, p) for p in QUANTILES]
            texts = [
                ', '.join(f'{value / rpm:.1f}' for value in values)
                for values in (past, now[3 * k : 3 * k + 3])
            ]
            table.add_row('' if k else f'{rounded_text(load, 4)} N', name, *texts)
    return table
