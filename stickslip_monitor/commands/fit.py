# SPDX-License-Identifier: Apache-2.0
"""Fit the Stribeck law to a measured friction-against-speed curve.

The CSV file has a line of headings and one line for each point; the columns of speed and
coefficient are recognised by their headings, as is one of standard deviations (std) or weights.
With --config and --load the uncertainty of the fit is propagated to the Hopf and fold speed of the
bearings; their own friction law is not used. Exits 1 if the fit has a warning, 2 if the curve
cannot identify the law.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_monitor.commands import options, output
from stickslip_monitor.drawing.studies import draw_friction_fit
from stickslip_monitor.errors import ConfigurationError, plural
from stickslip_monitor.lab.curve_file import NAMES, FrictionCurve, read_curve
from stickslip_monitor.lab.friction_fit import (
    ASIDE,
    UNITS,
    VISCOUS_LEVEL,
    BoundarySpread,
    Spread,
    StribeckFit,
    boundary_spread,
    fit_stribeck,
    unchecked,
)
from stickslip_monitor.monitor.messages import number
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.physics.bearing import SPEED_UNITS

SCHEMA = 'stickslip_monitor/fit/1'
FRAGMENT_MARK = '# Fitted to '
_POINT = ('speed', 'coefficient', 'residual', 'weight')
_VISCOUS = ('slope', 'f_value', 'p_value')
_SPREADS = {
    'hopf_speed': 'Hopf speed',
    'fold_speed': 'fold speed',
    'hopf_margin': 'Hopf margin',
    'fold_margin': 'fold margin',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_input(parser, 'curve', metavar='CURVE.csv', help='the measured curve')
    for name in NAMES:
        parser.add_argument(f'--{name}-column', metavar='HEADING', help=f'column of the {name}')
    parser.add_argument(
        '--speed-unit', choices=SPEED_UNITS, help='unit of the speeds, if the heading has none'
    )
    parser.add_argument(
        '--journal-diameter',
        type=float,
        metavar='D',
        help='journal diameter [m], needed if speeds are in rpm, rad/s or Hz',
    )
    parser.add_argument(
        '--viscous',
        choices=('auto', 'yes', 'no'),
        default='auto',
        help='fit a viscous slope (default auto: if an F-test at 1 %% supports it)',
    )
    _add_bearing(parser)
    text = '.csv: the points with fitted values and residuals'
    options.add_output(parser, '--output', '-o', marks=options.TABLE, help=text)
    options.add_picture(parser, 'the points and the law')
    yaml = {'': FRAGMENT_MARK.encode()}
    options.add_output(parser, '--fragment', marks=yaml, help='write the configuration fragment')
    options.add_force(parser)
    options.add_json(parser)


def _add_bearing(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('spread of the boundaries')
    options.add_config(group, required=False)
    options.add_bearing(group)
    group.add_argument('--load', help='bearing load with unit, e.g. 1000N')
    group.add_argument('--speed', help='shaft speed with unit for the margins, e.g. 35rpm')
    text = 'Monte Carlo samples (default 20000)'
    options.add_number(group, '--draws', 100, 1_000_000, default=20000, help=text)
    options.add_number(group, '--seed', 0, default=0, help='seed of the samples (default 0)')


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    _check(args)
    bearings = options.chosen(args).bearings if args.config else ()
    fit = fit_stribeck(_read(args, bearings), args.viscous)
    spreads = [(item, _spread(args, fit, item)) for item in bearings]
    if args.json:
        output.print_json(to_json(fit, args, spreads))
    else:
        print_fit(output.console(), args, fit, spreads)
    item, spread = spreads[0] if len(spreads) == 1 else (None, None)
    output.write_outputs(
        args,
        fragment=lambda: fragment(args.curve, fit),
        output=lambda: point_columns(fit),
        picture=lambda: draw_friction_fit(fit, _footnote(args, fit, item), spread),
    )
    return int(bool(fit.warnings))


def _check(args: argparse.Namespace) -> None:
    if bool(args.config) != bool(args.load):
        given, missing = ('--config', '--load') if args.config else ('--load', '--config')
        raise ConfigurationError(f'{given} needs {missing}: the boundaries follow from both')
    for name in ('bearing', 'speed'):
        if getattr(args, name) and not args.config:
            raise ConfigurationError(f'--{name} needs --config and --load')


def _read(args: argparse.Namespace, bearings: Sequence[BearingConfig]) -> FrictionCurve:
    columns = {name: getattr(args, f'{name}_column') for name in NAMES}
    diameters = {item.bearing.journal_diameter for item in bearings}
    diameter = args.journal_diameter
    if diameter is None and len(diameters) == 1:
        diameter = diameters.pop()
    return read_curve(args.curve, columns, args.speed_unit, diameter)


def _spread(args: argparse.Namespace, fit: StribeckFit, item: BearingConfig) -> BoundarySpread:
    speed = abs(options.parse_speed(args.speed, item.bearing.speed)) if args.speed else None
    load = options.parse_load(args.load)
    return boundary_spread(fit, item.bearing.damping, load, speed, args.draws, args.seed)


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


def _footnote(args: argparse.Namespace, fit: StribeckFit, item: BearingConfig | None) -> str:
    outliers = plural(fit.outliers.size, 'outlier')
    text = f'{Path(args.curve).name}: {fit.weight.size} points, {outliers}'
    if item is not None:
        load = options.parse_load(args.load) * 1e-3
        text += f'; boundaries of {item.name} at {load:.4g} kN with 95 % intervals'
    return text


def to_json(
    fit: StribeckFit, args: argparse.Namespace, spreads: list[tuple[BearingConfig, BoundarySpread]]
) -> dict[str, Any]:
    """The fit as the documented JSON object."""
    points = point_columns(fit)
    return {
        'schema': SCHEMA,
        'path': args.curve,
        'points': int(fit.weight.size),
        'speed_unit': fit.curve.unit,
        'friction': {'law': 'stribeck', **{name: getattr(fit.law, name) for name in UNITS}},
        'estimated': list(fit.names),
        'standard_error': dict(zip(fit.names, fit.standard_error.tolist(), strict=True)),
        'interval': dict(zip(fit.names, fit.intervals.tolist(), strict=True)),
        'correlation': fit.correlation.tolist(),
        'covariance': fit.covariance.tolist(),
        'scale': fit.scale,
        'degrees_of_freedom': fit.degrees_of_freedom,
        'viscous': _viscous_json(fit, args.viscous),
        'outliers': [
            {'line': int(fit.curve.line[k])} | {name: float(points[name][k]) for name in _POINT}
            for k in fit.outliers
        ],
        'warnings': list(fit.warnings),
        'unchecked': unchecked(fit) or None,
        'fragment': fragment(args.curve, fit),
        'bearings': [_bearing_json(item, spread, args) for item, spread in spreads],
    }


def _viscous_json(fit: StribeckFit, asked: str) -> dict[str, Any]:
    test = fit.viscous_test
    return {
        'asked': asked,
        'used': 'viscous' in fit.names,
        **{name: number(getattr(test, name)) if test else None for name in _VISCOUS},
        'sentence': viscous_sentence(fit, asked),
    }


def _bearing_json(item: BearingConfig, spread: BoundarySpread, args: argparse.Namespace) -> dict[str, Any]:
    return {
        'bearing': item.name,
        'load': options.parse_load(args.load),
        'speed': abs(options.parse_speed(args.speed, item.bearing.speed)) if args.speed else None,
        'draws': args.draws,
        'seed': args.seed,
        'without_boundary': spread.without,
        **{name: _spread_json(getattr(spread, name)) for name in _SPREADS},
        'regimes': spread.regimes,
    }


def _spread_json(spread: Spread | None) -> dict[str, float | None] | None:
    return None if spread is None else {k: number(v) for k, v in asdict(spread).items()}


def fragment(source: str, fit: StribeckFit) -> str:
    """The law as a bearing's entry in the parameter file."""
    law = fit.law
    entries = [('static', law.static), ('kinetic', law.kinetic), ('decay', law.decay)]
    if 'viscous' in fit.names:
        entries.append(('viscous', law.viscous))
    values = ', '.join(f'{name}: {value:.6g}' for name, value in entries)
    errors = ', '.join(
        f'{name} {error:.2g}' for name, error in zip(fit.names, fit.standard_error, strict=True)
    )
    name = ' '.join(Path(source).name.split())
    outliers = plural(fit.outliers.size, 'outlier')
    return (
        f'{FRAGMENT_MARK}{name}: {fit.weight.size} points, {outliers}.\n'
        f'# Standard errors: {errors}.\n'
        f'friction: {{law: stribeck, {values}}}\n'
    )


def viscous_sentence(fit: StribeckFit, asked: str) -> str:
    """Why the law has a viscous slope or not."""
    used = 'viscous' in fit.names
    test = fit.viscous_test
    if test is None:
        return 'no viscous slope: too few points to test one'
    numbers = f'slope {test.slope:.3g} s/m, F = {test.f_value:.3g}, p = {test.p_value:.2g}'
    rule = f'rule: slope > 0 and p < {VISCOUS_LEVEL:g}'
    asked_for = '' if asked == 'auto' else f', as asked for by --viscous {asked}'
    if asked == 'yes' and not used:
        asked_for = ': it would be negative and is held at 0'
    return f'{"with" if used else "no"} viscous slope{asked_for} ({numbers}; {rule})'


def print_fit(
    out: Console,
    args: argparse.Namespace,
    fit: StribeckFit,
    spreads: list[tuple[BearingConfig, BoundarySpread]],
) -> None:
    """Print the fit and what its uncertainty means for the bearings."""
    curve = fit.curve
    out.print(
        f'[bold]{escape(args.curve)}[/]: {fit.weight.size} points, speeds in {curve.unit}'
        f' ({escape(curve.unit_source)}), from {curve.speed.min():.4g} to'
        f' {curve.speed.max():.4g} m/s'
    )
    out.print(_estimates(fit))
    names = fit.names
    pairs = [(i, j) for j in range(len(names)) for i in range(j)]
    texts = [f'{names[i]}-{names[j]} {fit.correlation[i, j]:.3f}' for i, j in pairs]
    out.print(f'correlation: {", ".join(texts)}')
    out.print(f'scatter of a point: {fit.scale:.3g}; degrees of freedom: {fit.degrees_of_freedom:.1f}')
    out.print(viscous_sentence(fit, args.viscous))
    _print_outliers(out, fit)
    for text in fit.warnings:
        out.print(f'[yellow]warning:[/] {escape(text)}')
    if note := unchecked(fit):
        out.print(f'note: {escape(note)}')
    for item, spread in spreads:
        out.print(_spread_table(item, spread, args))
        if spread.regimes:
            shares = ', '.join(f'{name} {share:.1%}' for name, share in spread.regimes.items())
            out.print(f'Monte Carlo samples at this speed: {shares}')
    out.print()
    out.print(escape(fragment(args.curve, fit)), end='')


def _table(title: str, headings: str, caption: str | None = None) -> Table:
    """A table whose first and last columns are names."""
    table = Table(title=title, title_justify='left', caption=caption)
    names = headings.split('; ')
    for k, heading in enumerate(names):
        table.add_column(heading, justify='left' if k in (0, len(names) - 1) else 'right')
    return table


def _estimates(fit: StribeckFit) -> Table:
    table = _table('Stribeck law', 'coefficient; value; standard error; 95 % interval; unit')
    for k, name in enumerate(fit.names):
        low, high = fit.intervals[k]
        table.add_row(
            name,
            f'{fit.estimate[k]:.5g}',
            f'{fit.standard_error[k]:.2g}',
            f'{low:.5g} to {high:.5g}',
            UNITS[name],
        )
    return table


def _print_outliers(out: Console, fit: StribeckFit) -> None:
    aside = int(np.sum(fit.weight < ASIDE))
    out.print(
        f'outliers: {fit.outliers.size} with less than half the weight, {aside} with less than {ASIDE:.0%}'
    )
    for k in fit.outliers:
        out.print(
            f'  line {fit.curve.line[k]}: {fit.curve.coefficient[k]:.4g} at'
            f' {fit.curve.speed[k]:.4g} m/s, {fit.residual[k]:+.3g} off the curve, weight'
            f' {fit.weight[k]:.2f}'
        )


def _spread_table(item: BearingConfig, spread: BoundarySpread, args: argparse.Namespace) -> Table:
    without = f'{spread.without:.1%} of the samples have no boundary: 0 rpm'
    table = _table(
        f'{item.name} with this law at {args.load}',
        'quantity; value; median; 95 % interval; unit',
        without if spread.without else None,
    )
    per_rpm = 1.0 / item.bearing.speed.factor('rpm')
    for field, name in _SPREADS.items():
        row: Spread | None = getattr(spread, field)
        factor, unit = (per_rpm, 'rpm') if 'speed' in field else (100.0, '%')
        if row is not None:
            table.add_row(
                name,
                f'{row.estimate * factor:.4g}',
                f'{row.median * factor:.4g}',
                f'{row.low * factor:.4g} to {row.high * factor:.4g}',
                unit,
            )
    return table
