# SPDX-License-Identifier: Apache-2.0
"""A fitted friction law as the documented JSON object, in words, and as configuration."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_monitor.commands.arguments import parse_load, parse_speed
from stickslip_monitor.errors import plural
from stickslip_monitor.lab.friction_fit.fit import StribeckFit
from stickslip_monitor.lab.friction_fit.solve import UNITS
from stickslip_monitor.lab.friction_fit.spread import BoundarySpread, Spread
from stickslip_monitor.lab.friction_fit.uncertainty import VISCOUS_LEVEL
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.messages import number

SCHEMA = 'stickslip_monitor/fit/1'


def to_json(
    path: str,
    fit: StribeckFit,
    args: argparse.Namespace,
    spreads: list[tuple[BearingConfig, BoundarySpread]],
) -> dict[str, Any]:
    """The fit as the documented JSON object."""
    return {
        'schema': SCHEMA,
        'path': path,
        'points': int(fit.weight.size),
        'speed_unit': fit.curve.unit,
        'friction': {
            'law': 'stribeck',
            **{name: getattr(fit.law, name) for name in UNITS},
        },
        'estimated': list(fit.names),
        'standard_error': dict(zip(fit.names, fit.standard_error.tolist(), strict=True)),
        'interval': dict(zip(fit.names, fit.intervals.tolist(), strict=True)),
        'correlation': fit.correlation.tolist(),
        'covariance': fit.covariance.tolist(),
        'scale': fit.scale,
        'degrees_of_freedom': fit.degrees_of_freedom,
        'viscous': _viscous_json(fit, args.viscous),
        'outliers': _outliers_json(fit),
        'warnings': list(fit.warnings),
        'fragment': fragment(path, fit),
        'bearings': [_bearing_json(item, spread, args) for item, spread in spreads],
    }


def _viscous_json(fit: StribeckFit, asked: str) -> dict[str, Any]:
    test = fit.viscous_test
    names = ('slope', 't_value', 'f_value', 'p_value', 'aicc_gain')
    return {
        'asked': asked,
        'used': 'viscous' in fit.names,
        **{name: number(getattr(test, name)) if test else None for name in names},
        'sentence': viscous_sentence(fit, asked),
    }


def _outliers_json(fit: StribeckFit) -> list[dict[str, Any]]:
    return [
        {
            'line': int(fit.curve.line[k]),
            'speed': float(fit.curve.speed[k]),
            'coefficient': float(fit.curve.coefficient[k]),
            'residual': float(fit.residual[k]),
            'weight': float(fit.weight[k]),
        }
        for k in fit.outliers
    ]


def _bearing_json(
    item: BearingConfig, spread: BoundarySpread, args: argparse.Namespace
) -> dict[str, Any]:
    return {
        'bearing': item.name,
        'load': parse_load(args.load),
        'speed': abs(parse_speed(args.speed, item.bearing.speed)) if args.speed else None,
        'draws': args.draws,
        'seed': args.seed,
        'without_boundary': spread.without,
        'hopf_speed': _spread_json(spread.hopf_speed),
        'fold_speed': _spread_json(spread.fold_speed),
        'hopf_margin': _spread_json(spread.hopf_margin),
        'fold_margin': _spread_json(spread.fold_margin),
        'regimes': spread.regimes,
    }


def _spread_json(spread: Spread | None) -> dict[str, float | None] | None:
    if spread is None:
        return None
    names = ('estimate', 'delta_error', 'median', 'low', 'high')
    return {name: number(getattr(spread, name)) for name in names}


FRAGMENT_MARK = '# Fitted to '


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
    numbers = (
        f'slope {test.slope:.3g} s/m, t = {test.t_value:.3g}, F = {test.f_value:.3g},'
        f' p = {test.p_value:.2g}, AICc gain {test.aicc_gain:.3g}'
    )
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
    out.print(f'scatter of a point: {fit.scale:.3g}; degrees of freedom:'
              f' {fit.degrees_of_freedom:.1f}')  # fmt: skip
    out.print(viscous_sentence(fit, args.viscous))
    _print_outliers(out, fit)
    for text in fit.warnings:
        out.print(f'[yellow]warning:[/] {escape(text)}')
    for item, spread in spreads:
        out.print(_spread_table(item, spread, args))
        if spread.regimes:
            shares = ', '.join(f'{name} {share:.1%}' for name, share in spread.regimes.items())
            out.print(f'of the laws drawn, at this speed: {shares}')
    out.print()
    out.print(escape(fragment(args.curve, fit)), end='')


def _estimates(fit: StribeckFit) -> Table:
    table = Table(title='Stribeck law', title_justify='left')
    for heading in ('coefficient', 'value', 'standard error', '95 % interval', 'unit'):
        table.add_column(
            heading, justify='left' if heading in ('coefficient', 'unit') else 'right'
        )
    for k, name in enumerate(fit.names):
        low, high = fit.intervals[k]
        table.add_row(
            name, f'{fit.estimate[k]:.5g}', f'{fit.standard_error[k]:.2g}',
            f'{low:.5g} to {high:.5g}', UNITS[name],
        )  # fmt: skip
    return table


def _print_outliers(out: Console, fit: StribeckFit) -> None:
    aside = int(np.sum(fit.weight == 0.0))
    out.print(f'outliers: {fit.outliers.size} with less than half the weight, {aside} with none')
    for k in fit.outliers:
        out.print(
            f'  line {fit.curve.line[k]}: {fit.curve.coefficient[k]:.4g} at'
            f' {fit.curve.speed[k]:.4g} m/s, {fit.residual[k]:+.3g} off the curve, weight'
            f' {fit.weight[k]:.2f}'
        )


def _spread_table(item: BearingConfig, spread: BoundarySpread, args: argparse.Namespace) -> Table:
    rpm = item.bearing.speed.factor('rpm')
    without = f'{spread.without:.1%} of the laws drawn have no boundary: 0 rpm'
    table = Table(
        title=f'{item.name} with this law at {args.load}',
        title_justify='left',
        caption=without if spread.without else None,
    )
    for heading in ('quantity', 'value', 'standard error', 'median', '95 % interval', 'unit'):
        table.add_column(heading, justify='left' if heading in ('quantity', 'unit') else 'right')
    rows: list[tuple[str, Spread | None, float, str]] = [
        ('Hopf speed', spread.hopf_speed, 1.0 / rpm, 'rpm'),
        ('fold speed', spread.fold_speed, 1.0 / rpm, 'rpm'),
        ('Hopf margin', spread.hopf_margin, 100.0, '%'),
        ('fold margin', spread.fold_margin, 100.0, '%'),
    ]
    for name, row, factor, unit in rows:
        if row is not None:
            table.add_row(
                name, f'{row.estimate * factor:.4g}', f'{row.delta_error * factor:.2g}',
                f'{row.median * factor:.4g}',
                f'{row.low * factor:.4g} to {row.high * factor:.4g}', unit,
            )  # fmt: skip
    return table
