# SPDX-License-Identifier: Apache-2.0
"""Draw the published findings on stick-slip of a water-lubricated rubber bearing.

Four pictures, each with the statement it reproduces and a CSV file of its data:
amplitude against belt speed, against normal force and against the kinetic friction coefficient,
and stick-slip in time and in the phase plane. Without a configuration they show the reference
bearing of the docs; another bearing needs a Stribeck law.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.markup import escape

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.commands import options, output
from stickslip_monitor.drawing.canvas import save_figure, write_csv
from stickslip_monitor.drawing.studies import draw_amplitudes, draw_motion
from stickslip_monitor.errors import ConfigurationError, DrawingError
from stickslip_monitor.files import PICTURES
from stickslip_monitor.lab import findings
from stickslip_monitor.physics.bearing import Bearing

FORMATS = ('png', 'svg')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        '--output',
        '-o',
        default='figures',
        metavar='DIR',
        help='output folder, created if missing (default: figures)',
    )
    text = 'ROS 2 parameter file (default: the reference bearing of the docs)'
    options.add_config(parser, required=False, text=text)
    options.add_bearing(parser, options.ONE_OF_SEVERAL)
    parser.add_argument('--speed', default=f'{findings.REFERENCE_RPM:g}rpm', help='default 20rpm')
    parser.add_argument('--load', default=f'{findings.REFERENCE_LOAD:g}N', help='default 1000N')
    parser.add_argument('--format', choices=FORMATS, default='png', help='default png')
    options.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    point = _the_point(args)
    findings.check_point(point.bearing, point.speed, point.load)
    folder = Path(args.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DrawingError(f'{folder}: {error.strerror or error}') from error
    for name in FINDINGS:
        output.check_output(folder / f'{name}.csv', options.TABLE, args)
        output.check_output(folder / f'{name}.{args.format}', PICTURES, args)
    out = output.console()
    with output.ProgressBar() as bar:
        for done, (name, find) in enumerate(FINDINGS.items()):
            bar.show(f'{name}: computing', 2 * done, 2 * len(FINDINGS))
            finding = find(point)
            bar.show(f'{name}: drawing', 2 * done + 1, 2 * len(FINDINGS))
            write_csv(finding.columns, folder / f'{name}.csv', args.force)
            save_figure(finding.draw(), folder / f'{name}.{args.format}', args.force)
            out.print(escape(f'{folder / name}.{args.format}: {finding.summary}'))
    return 0


@dataclass(frozen=True, slots=True)
class Point:
    """The bearing and the operating point the findings are drawn for [m/s, N]."""

    name: str
    bearing: Bearing
    speed: float
    load: float

    @property
    def rpm(self) -> float:
        """Surface speed of one rpm [m/s]."""
        return self.bearing.speed.factor('rpm')

    @property
    def footnote(self) -> str:
        """All of it for a person."""
        return f'{self.name}, {self.speed / self.rpm:.6g} rpm, load {self.load:.6g} N'


@dataclass(frozen=True, slots=True)
class _Finding:
    """One finding: its data as columns, its picture, and what it says in one line."""

    columns: Mapping[str, FloatArray]
    draw: Callable[[], Any]
    summary: str


def _the_point(args: argparse.Namespace) -> Point:
    name, bearing = 'reference bearing', findings.REFERENCE
    if args.config is not None:
        config = options.the_bearing(options.chosen(args))
        name, bearing = config.name, config.bearing
    elif args.bearing is not None:
        raise ConfigurationError(f"bearing '{args.bearing}' needs a --config that has it")
    speed = options.parse_speed(args.speed, bearing.speed)
    return Point(name, bearing, speed, options.parse_loaded(args.load))


def _swept(
    sweep: findings.Sweep,
    columns: Mapping[str, FloatArray],
    statement: str,
    footnote: str,
    label: str,
    unit: str = '',
    scale: float = 1.0,
) -> _Finding:
    """A finding on amplitudes; the picture's unit, with a space before it, is ``scale`` SI."""
    summary = (
        f'Hopf {sweep.hopf / scale:.6g}{unit}, fold {sweep.exact_fold / scale:.6g}{unit}'
        f' (KBM {sweep.averaged_fold / scale:.6g}{unit})'
    )
    draw = partial(draw_amplitudes, sweep, statement, footnote, label, unit, scale)
    return _Finding(columns, draw, summary)


def _speed(point: Point) -> _Finding:
    sweep = findings.over_speed(point.bearing, point.load)
    columns = sweep.columns('surface_speed [m/s]')
    rpm = {'shaft_speed [rpm]': columns['surface_speed [m/s]'] / point.rpm}
    statement = (
        'The amplitude of stick-slip grows with the belt speed up to a fold, where it meets an'
        ' unstable cycle; steady sliding is lost in a subcritical Hopf bifurcation.'
    )
    footnote = f'{point.name}, load {point.load:.6g} N'
    return _swept(sweep, rpm | columns, statement, footnote, 'shaft speed [rpm]', ' rpm', point.rpm)


def _load(point: Point) -> _Finding:
    sweep = findings.over_load(point.bearing, point.speed, point.load)
    statement = (
        'The amplitude of stick-slip rises slowly with the normal force; at a low force there is'
        ' only the equilibrium.'
    )
    footnote = f'{point.name}, {point.speed / point.rpm:.6g} rpm'
    columns = sweep.columns('load [N]')
    return _swept(sweep, columns, statement, footnote, 'normal force [N]', ' N')


def _kinetic(point: Point) -> _Finding:
    sweep = findings.over_kinetic(point.bearing, point.speed, point.load)
    statement = (
        'The amplitude of stick-slip falls as the kinetic friction coefficient rises; beyond a'
        f' coefficient of about {sweep.averaged_fold:.2g} there is only the equilibrium.'
    )
    label = 'kinetic friction coefficient $\\mu_k$ [-]'
    columns = sweep.columns('kinetic_coefficient [-]')
    return _swept(sweep, columns, statement, point.footnote, label)


def _motion(point: Point) -> _Finding:
    history = findings.stick_slip_history(point.bearing, point.speed, point.load)
    statement = (
        'A small disturbance of steady sliding grows into stick-slip: in the phase plane the'
        ' motion runs onto a limit cycle with a straight piece, the stick phase.'
    )
    summary = (
        f'amplitude {history.cycle.amplitude * 1e3:.6g} mm'
        f' (KBM {history.averaged_amplitude * 1e3:.6g} mm), period'
        f' {history.cycle.period * 1e3:.6g} ms,'
        f' sticking {history.cycle.stick_fraction * 100:.3g} % of it'
    )
    draw = partial(draw_motion, history, statement, point.footnote)
    return _Finding(history.columns(), draw, summary)


FINDINGS: Mapping[str, Callable[[Point], _Finding]] = {
    'finding_1_speed': _speed,
    'finding_2_load': _load,
    'finding_3_kinetic': _kinetic,
    'finding_4_motion': _motion,
}
