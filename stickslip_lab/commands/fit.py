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
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_lab.drawing.studies import draw_friction_fit
from stickslip_lab.friction.curve_file import NAMES, FrictionCurve, read_curve
from stickslip_lab.friction.friction_fit import (
    ASIDE,
    UNITS,
    VISCOUS_LEVEL,
    StribeckFit,
    boundary_belief,
    boundary_quantiles,
    unchecked_point,
)
from stickslip_lab.friction.pooled_fit import PooledFit, fit_curve
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import ConfigurationError, plural
from stickslip_monitor.monitor.bearing_records import finite_or_none
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.physics.bearing import SPEED_UNITS
from stickslip_monitor.physics.lubrication import reference_point
from stickslip_monitor.physics.probability import Belief

SCHEMA = 'stickslip_monitor/fit/2'
FRAGMENT_MARK = '# Fitted to '
# The columns of an outlier in the JSON object.
_POINT = ('speed', 'coefficient', 'residual', 'weight')
Boundaries = dict[str, list[float]]
"""Lower end, middle and upper end of the 95 % interval of ``hopf_speed`` and ``fold_speed`` [m/s]; 0 for
none."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_file(parser, 'curve', metavar='CURVE.csv', help='the measured curve')
    for name in NAMES:
        parser.add_argument(f'--{name}-column', metavar='HEADING', help=f'column of the {name}')
    text = 'unit of the speeds, if the heading has none'
    parser.add_argument('--speed-unit', choices=SPEED_UNITS, help=text)
    text = 'journal diameter [m], needed if speeds are in rpm, rad/s or Hz'
    options.add_number(parser, '--journal-diameter', 0, above=True, kind=float, metavar='D', help=text)
    text = 'fit a viscous slope (default auto: if an F-test at 1 %% supports it)'
    parser.add_argument('--viscous', choices=('auto', 'yes', 'no'), default='auto', help=text)
    group = parser.add_argument_group('spread of the boundaries')
    options.add_config(group, required=False)
    options.add_shared(group, '--bearing')
    group.add_argument('--load', help='bearing load with unit, e.g. 1000N')
    group.add_argument('--speed', help='shaft speed with unit for the regimes, e.g. 35rpm')
    text = '.csv: the points with fitted values and residuals'
    options.add_file(parser, '--output', '-o', marks=options.TABLE, help=text)
    options.add_picture(parser, 'the points and the law')
    yaml = {'': FRAGMENT_MARK.encode()}
    options.add_file(parser, '--fragment', marks=yaml, help='write the configuration fragment')
    options.add_shared(parser, '--force', '--json')


def run(args: argparse.Namespace) -> int:
    """Fit the law, print it and write the outputs asked for.

    Returns:
        1 with a warning of the fit, else 0.

    Raises:
        ConfigurationError: Options contradict each other, the configuration is refused, or a bearing has no
            damping.
        FitError: The curve cannot be read, or cannot identify the law.
        DrawingError, OutputError: An output cannot be made or written.
    """
    if bool(args.config) != bool(args.load):
        given, missing = ('--config', '--load') if args.config else ('--load', '--config')
        raise ConfigurationError(f'{given} needs {missing}: the boundaries follow from both')
    for name in ('bearing', 'speed'):
        if getattr(args, name) and not args.config:
            raise ConfigurationError(f'--{name} needs --config and --load')
    bearings = options.load_chosen(args).bearings if args.config else ()
    fit = fit_curve(_read_curve(args, bearings), args.viscous)
    load = options.parse_positive_load(args.load) if args.load else 0.0
    for item in bearings:
        if item.bearing.damping == 0.0:
            raise refused(f'{item.name}.damping', 0.0, 'above 0 N s/m: without it every speed is unstable')
    beliefs = [(item, boundary_belief(fit, item.bearing, load)) for item in bearings]
    results = [
        (item, boundary_quantiles(belief, load), _regime_probabilities(args, belief, load))
        for item, belief in beliefs
    ]
    if args.json:
        output.print_json(to_json(fit, args, load, results))
    else:
        print_fit(output.console(), args, fit, results)
    drawn = results[0][1] if len(results) == 1 else None
    output.write_outputs(
        args,
        fragment=lambda: yaml_fragment(args.curve, fit),
        output=lambda: columns_of_points(fit),
        picture=lambda: draw_friction_fit(fit, _footnote_text(args, fit, results), drawn),
    )
    return int(bool(fit.warnings))


BearingResults = list[tuple[BearingConfig, Boundaries, dict[str, float] | None]]
"""Bearings, each with its boundaries by the fit and the probability of each regime, ``None`` without a
speed."""


def _read_curve(args: argparse.Namespace, bearings: Sequence[BearingConfig]) -> FrictionCurve:
    """Read the curve; its diameter is the option's, else that of the bearings if all have the same.

    Raises:
        FitError: The file breaks a rule, or its speeds are in a unit of turning and no diameter is known.
    """
    columns = {name: getattr(args, f'{name}_column') for name in NAMES}
    diameters = {item.bearing.journal_diameter for item in bearings}
    diameter = args.journal_diameter
    if diameter is None and len(diameters) == 1:
        diameter = diameters.pop()
    return read_curve(args.curve, columns, args.speed_unit, diameter)


def _regime_probabilities(args: argparse.Namespace, belief: Belief, load: float) -> dict[str, float] | None:
    """Return the probability of each regime by name at ``--speed`` and a load [N]; ``None`` without speed.

    Raises:
        ConfigurationError: The speed is not a number with a unit, or is 0.
    """
    if not args.speed:
        return None
    speed = abs(options.parse_speed(args.speed, belief.bearing.speed))
    if speed == 0.0:
        raise refused('--speed', args.speed, 'other than 0: at rest there is no regime')
    point = reference_point(belief.bearing, speed, load)[:2]
    can, will = (float(p) for p in belief.probabilities(*point))
    return {'unstable': will, 'bistable': can - will, 'stable': 1.0 - can}


def columns_of_points(fit: StribeckFit) -> dict[str, Any]:
    """Return the columns of the points by heading, in SI units, shape (n,) each, in the curve's order.

    They are ``line``, ``speed``, ``coefficient``, ``fitted``, ``band``, ``residual``, ``weight`` and
    ``leverage``; ``band`` is the half width of the 95 % band at the reference point.
    """
    curve = fit.points
    return {
        'line': curve.line,
        'speed': curve.speed,
        'coefficient': curve.coefficient,
        'fitted': curve.coefficient - fit.residual,
        'band': fit.band(fit.curve.speed),
        'residual': fit.residual,
        'weight': fit.weight,
        'leverage': fit.leverage,
    }


def _curve_clause(source: str, fit: StribeckFit) -> str:
    """Return a clause on the curve: the name of its file ``source``, the numbers of points and outliers."""
    name, outliers = ' '.join(Path(source).name.split()), plural(fit.outliers.size, 'outlier')
    return f'{name}: {fit.weight.size} points, {outliers}'


def _footnote_text(args: argparse.Namespace, fit: StribeckFit, results: BearingResults) -> str:
    """Return the line below the picture: the curve, and the bearing whose boundaries are drawn, if any."""
    if len(results) != 1:
        return _curve_clause(args.curve, fit)
    bearing = results[0][0]
    return f'{_curve_clause(args.curve, fit)}; boundaries of {bearing.name} at {args.load}, 95 % intervals'


def to_json(
    fit: StribeckFit, args: argparse.Namespace, load: float, results: BearingResults
) -> dict[str, Any]:
    """Return the fit at ``load`` [N] as the documented JSON object."""
    points, test = columns_of_points(fit), fit.viscous_test
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
        'viscous': {
            'asked': args.viscous,
            'used': 'viscous' in fit.names,
            **{
                name: finite_or_none(getattr(test, name)) if test else None
                for name in ('slope', 'f_value', 'p_value')
            },
            'sentence': viscous_slope_clause(fit, args.viscous),
        },
        'outliers': [
            {'line': int(fit.curve.line[k])} | {name: float(points[name][k]) for name in _POINT}
            for k in fit.outliers
        ],
        'conditions': _reference_conditions(fit),
        'warnings': list(fit.warnings),
        'unchecked': unchecked_point(fit) or None,
        'fragment': yaml_fragment(args.curve, fit),
        'bearings': [
            {'bearing': item.name, 'load': load, **speeds, 'regimes': regimes}
            for item, speeds, regimes in results
        ],
    }


def _reference_conditions(fit: StribeckFit) -> dict[str, Any] | None:
    """Return load and water to which the points were reduced, and the exponent, as a JSON object.

    It has the exponent's error and interval, ``None`` each without an exponent, and a sentence too. ``None``
    for a curve without a column of loads or temperatures.
    """
    if not isinstance(fit, PooledFit):
        return None
    return {
        'at_load': finite_or_none(fit.load),
        'at_temperature': finite_or_none(fit.temperature),
        'load_exponent': fit.exponent if fit.has_exponent else None,
        'standard_error': fit.exponent_error if fit.has_exponent else None,
        'interval': list(fit.exponent_interval) if fit.has_exponent else None,
        'sentence': fit.sentence,
    }


def yaml_fragment(source: str, fit: StribeckFit) -> str:
    """Return the law as YAML for a bearing's entry in the parameter file, its standard errors in comments."""
    written = [name for name in UNITS if name != 'viscous' or name in fit.names]
    values = ', '.join(f'{name}: {getattr(fit.law, name):.6g}' for name in written)
    estimates = zip(fit.names, fit.standard_error, strict=True)
    errors = ', '.join(f'{name} {error:.2g}' for name, error in estimates)
    if isinstance(fit, PooledFit):
        conditions = {'at_load': fit.load, 'at_temperature': fit.temperature}
        values += ''.join(f', {name}: {value:.6g}' for name, value in conditions.items() if value == value)
        if fit.lubrication is not None:
            values += f', load_exponent: {fit.lubrication.load_exponent:.4g}'
            errors += f', load_exponent {fit.exponent_error:.2g}'
    return (
        f'{FRAGMENT_MARK}{_curve_clause(source, fit)}.\n'
        f'# Standard errors: {errors}.\n'
        f'friction: {{law: stribeck, {values}}}\n'
    )


def viscous_slope_clause(fit: StribeckFit, option: str) -> str:
    """Return a clause on why the law has a viscous slope or not, by F-test and option ``--viscous``."""
    used, test = 'viscous' in fit.names, fit.viscous_test
    if test is None:
        return 'no viscous slope: too few points to test one'
    numbers = f'slope {test.slope:.3g} s/m, F = {test.f_value:.3g}, p = {test.p_value:.2g}'
    rule = f'rule: slope > 0 and p < {VISCOUS_LEVEL:g}'
    asked_for = '' if option == 'auto' else f', as asked for by --viscous {option}'
    if option == 'yes' and not used:
        asked_for = ': it would be negative and is held at 0'
    return f'{"with" if used else "no"} viscous slope{asked_for} ({numbers}; {rule})'


def print_fit(out: Console, args: argparse.Namespace, fit: StribeckFit, results: BearingResults) -> None:
    """Print the fit with its outliers and warnings, the boundaries of each bearing, and the YAML fragment."""
    curve, names = fit.points, fit.names
    out.print(
        f'[bold]{escape(args.curve)}[/]: {fit.weight.size} points, speeds in {curve.unit}'
        f' ({escape(curve.unit_source)}), from {curve.speed.min():.4g} to'
        f' {curve.speed.max():.4g} m/s'
    )
    table = output.make_table(
        'Stribeck law', 'coefficient; value; standard error; 95 % interval; unit', (0, 4)
    )
    columns = zip(names, fit.estimate, fit.standard_error, fit.intervals, strict=True)
    for name, value, error, (low, high) in columns:
        table.add_row(name, f'{value:.5g}', f'{error:.2g}', f'{low:.5g} to {high:.5g}', UNITS[name])
    if isinstance(fit, PooledFit) and fit.has_exponent:
        low, high = fit.exponent_interval
        interval = f'{low:.3g} to {high:.3g}'
        table.add_row('load exponent', f'{fit.exponent:.3g}', f'{fit.exponent_error:.2g}', interval, '')
    out.print(table)
    if isinstance(fit, PooledFit):
        out.print(_reference_clause(fit))
    pairs = [(i, j) for j in range(len(names)) for i in range(j)]
    texts = [f'{names[i]}-{names[j]} {fit.correlation[i, j]:.3f}' for i, j in pairs]
    out.print(f'correlation: {", ".join(texts)}')
    out.print(f'scatter of a point: {fit.scale:.3g}; degrees of freedom: {fit.degrees_of_freedom:.1f}')
    out.print(viscous_slope_clause(fit, args.viscous))
    _print_outliers(out, fit)
    for text in fit.warnings:
        out.print(f'[yellow]warning:[/] {escape(text)}')
    if note := unchecked_point(fit):
        out.print(f'note: {escape(note)}')
    for item, speeds, regimes in results:
        out.print(_boundary_table(item, speeds, args.load))
        if regimes:
            shares = ', '.join(f'{name} {share:.1%}' for name, share in regimes.items())
            out.print(f'probability at {args.speed}: {shares}')
    out.print()
    out.print(escape(yaml_fragment(args.curve, fit)), end='')


def _reference_clause(fit: PooledFit) -> str:
    """Return a clause: at which load and water the law holds as it stands, and what the load does to it."""
    conditions = [f'{fit.load:.4g} N'] * (fit.load == fit.load)
    conditions += [f'{fit.temperature:.3g} C'] * (fit.temperature == fit.temperature)
    return f'the law is that at {" and ".join(conditions)}{f"; {fit.sentence}" if fit.sentence else ""}'


def _print_outliers(out: Console, fit: StribeckFit) -> None:
    """Print how many points have little weight, and each outlier with its line."""
    aside, curve = int(np.sum(fit.weight < ASIDE)), fit.points
    out.print(
        f'outliers: {fit.outliers.size} with less than half the weight, {aside} with less than {ASIDE:.0%}'
    )
    for k in fit.outliers:
        out.print(
            f'  line {curve.line[k]}: {curve.coefficient[k]:.4g} at {curve.speed[k]:.4g} m/s,'
            f' {fit.residual[k]:+.3g} off the curve, weight {fit.weight[k]:.2f}'
        )


def _boundary_table(item: BearingConfig, speeds: Boundaries, load: str) -> Table:
    """Return the table of both boundaries of a bearing in rpm, with 95 % intervals.

    ``load`` is the text of the load that they are at, for the title.
    """
    title = f'{item.name} with this law at {load}'
    table = output.make_table(title, 'boundary; speed; 95 % interval; unit', (0, 3))
    for name, three in speeds.items():
        low, middle, high = (value / item.bearing.speed.factor('rpm') for value in three)
        label = name.replace('_', ' ').replace('hopf', 'Hopf')
        table.add_row(label, f'{middle:.4g}', f'{low:.4g} to {high:.4g}', 'rpm')
    return table
