# SPDX-License-Identifier: Apache-2.0
"""Fit the Stribeck law to a measured friction-against-speed curve.

The CSV file has a line of headings and one point a line; the columns of speed and coefficient are
recognised by their headings, as is one of standard deviations (std) or weights. With --config and
--load the uncertainty of the fit is carried on to the Hopf and fold speed of the bearings; their
own friction law is not used. The exit code is 1 where the fit comes with a warning, and 2 where
the curve cannot identify the law.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.commands.arguments import parse_load, parse_speed
from stickslip_monitor.commands.declared import (
    TABLE,
    add_config,
    add_force,
    add_input,
    add_output,
    add_picture,
    say_written,
)
from stickslip_monitor.commands.fit_results import FRAGMENT_MARK, fragment, print_fit, to_json
from stickslip_monitor.commands.output import add_json, console, print_json
from stickslip_monitor.drawing.canvas import save_figure, write_csv
from stickslip_monitor.drawing.friction_fit import Boundary, FrictionFitPicture, draw_friction_fit
from stickslip_monitor.errors import ConfigurationError, plural
from stickslip_monitor.files import write_whole
from stickslip_monitor.lab.friction_fit.curve_file import Columns, FrictionCurve, read_curve
from stickslip_monitor.lab.friction_fit.fit import StribeckFit, fit_stribeck
from stickslip_monitor.lab.friction_fit.spread import BoundarySpread, boundary_spread
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import SPEED_UNITS

_FEWEST_DRAWS, _MOST_DRAWS = 100, 1_000_000
_CURVE_POINTS = 400
_BEYOND = 1.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_input(parser, 'curve', metavar='CURVE.csv', help='the measured curve')
    for name in ('speed', 'coefficient', 'std', 'weight'):
        parser.add_argument(f'--{name}-column', metavar='HEADING', help=f'column of the {name}')
    parser.add_argument(
        '--speed-unit', choices=SPEED_UNITS, help='unit of the speeds, if the heading has none'
    )
    parser.add_argument(
        '--journal-diameter', type=float, metavar='D', help='in m, for speeds of turning'
    )
    parser.add_argument(
        '--viscous', choices=('auto', 'yes', 'no'), default='auto',
        help='whether the law has a viscous slope (default: where the F-test at 1 %% wants it)',
    )  # fmt: skip
    _add_bearing(parser)
    text = '.csv: the points with what the fit says of each'
    add_output(parser, '--output', '-o', marks=TABLE, help=text)
    add_picture(parser, 'the points and the law')
    yaml = {'': FRAGMENT_MARK.encode()}
    add_output(parser, '--fragment', marks=yaml, help='write the configuration fragment')
    add_force(parser)
    add_json(parser)


def _add_bearing(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('spread of the boundaries')
    add_config(group, required=False)
    group.add_argument('--bearing', help='only this bearing')
    group.add_argument('--load', help='bearing load with unit, e.g. 1000N')
    group.add_argument('--speed', help='shaft speed with unit for the margins, e.g. 35rpm')
    group.add_argument('--draws', type=int, default=20000, help='laws drawn (default 20000)')
    group.add_argument('--seed', type=int, default=0, help='of the draws (default 0)')


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    _check(args)
    bearings = _bearings(args)
    curve = _read(args, bearings)
    fit = fit_stribeck(curve, args.viscous)
    spreads = [(item, _spread(args, fit, item)) for item in bearings]
    if args.json:
        print_json(to_json(args.curve, fit, args, spreads))
    else:
        print_fit(console(), args, fit, spreads)
    if args.fragment:
        _write(args.fragment, fragment(args.curve, fit), args.force)
    if args.output:
        write_csv(point_columns(fit), args.output, args.force)
    if args.picture:
        _draw(args, fit, spreads)
    say_written(args.fragment, args.output, args.picture)
    return int(bool(fit.warnings))


def _check(args: argparse.Namespace) -> None:
    if bool(args.config) != bool(args.load):
        given, missing = ('--config', '--load') if args.config else ('--load', '--config')
        raise ConfigurationError(f'{given} needs {missing}: the boundaries follow from both')
    for name in ('bearing', 'speed'):
        if getattr(args, name) and not args.config:
            raise ConfigurationError(f'--{name} needs --config and --load')
    if not _FEWEST_DRAWS <= args.draws <= _MOST_DRAWS:
        raise ConfigurationError(
            f'draws = {args.draws} must be from {_FEWEST_DRAWS} to {_MOST_DRAWS}'
        )
    if args.seed < 0:
        raise ConfigurationError(f'seed = {args.seed} must not be negative')


def _bearings(args: argparse.Namespace) -> list[BearingConfig]:
    if not args.config:
        return []
    config = load_config(args.config)
    return [config.bearing(args.bearing)] if args.bearing else list(config.bearings)


def _read(args: argparse.Namespace, bearings: list[BearingConfig]) -> FrictionCurve:
    columns = Columns(
        args.speed_column, args.coefficient_column, args.std_column, args.weight_column
    )
    diameters = {item.bearing.journal_diameter for item in bearings}
    diameter = args.journal_diameter
    if diameter is None and len(diameters) == 1:
        diameter = diameters.pop()
    return read_curve(args.curve, columns, args.speed_unit, diameter)


def _spread(args: argparse.Namespace, fit: StribeckFit, item: BearingConfig) -> BoundarySpread:
    speed = abs(parse_speed(args.speed, item.bearing.speed)) if args.speed else None
    load = parse_load(args.load)
    return boundary_spread(fit, item.bearing.damping, load, speed, args.draws, args.seed)


def _write(path: str, text: str, force: bool) -> None:
    try:
        write_whole(path, text.encode(), FRAGMENT_MARK.encode(), force)
    except OSError as error:
        raise ConfigurationError(f'{path}: {error.strerror or error}') from error


def _draw(
    args: argparse.Namespace,
    fit: StribeckFit,
    spreads: list[tuple[BearingConfig, BoundarySpread]],
) -> None:
    curve = fit.curve
    speed = np.linspace(0.0, _BEYOND * float(curve.speed.max()), _CURVE_POINTS)
    varied = float(np.ptp(curve.std)) > 0.0
    picture = FrictionFitPicture(
        title=_title(fit.law),
        speed=curve.speed,
        coefficient=curve.coefficient,
        std=curve.std * fit.scale if varied else None,
        counts=fit.weight >= 0.5,
        lines=curve.line,
        curve_speed=speed,
        curve=fit.law.coefficient(speed),
        band=fit.band(speed),
        boundaries=_marks(spreads[0][1]) if len(spreads) == 1 else (),
        footnote=_footnote(args, fit, spreads),
    )
    save_figure(draw_friction_fit(picture), args.picture, args.force)


def point_columns(fit: StribeckFit) -> dict[str, Any]:
    """The points with what the fit says of each, for a CSV file in SI units."""
    curve = fit.curve
    return {
        'line': curve.line,
        'speed': curve.speed,
        'coefficient': curve.coefficient,
        'fitted': curve.coefficient - fit.residual,
        'band': fit.band(curve.speed),
        'residual': fit.residual,
        'weight': fit.weight,
        'leverage': fit.leverage,
    }


def _title(law: Stribeck) -> str:
    text = f'μ = {law.kinetic:.4g} + {law.static - law.kinetic:.4g} exp(−{law.decay:.4g} v)'
    return text + (f' + {law.viscous:.3g} v' if law.viscous else '')


def _footnote(
    args: argparse.Namespace,
    fit: StribeckFit,
    spreads: list[tuple[BearingConfig, BoundarySpread]],
) -> str:
    outliers = plural(fit.outliers.size, 'outlier')
    text = f'{Path(args.curve).name}: {fit.weight.size} points, {outliers}'
    if len(spreads) == 1:
        text += f'; boundaries of {spreads[0][0].name} at {args.load} with 95 % intervals'
    return text


def _marks(spread: BoundarySpread) -> tuple[Boundary, ...]:
    both = (
        ('Hopf speed', spread.hopf_speed, Regime.UNSTABLE),
        ('fold speed', spread.fold_speed, Regime.BISTABLE),
    )
    return tuple(
        Boundary(name, item.estimate, item.low, item.high, regime)
        for name, item, regime in both
        if item.estimate > 0.0
    )
