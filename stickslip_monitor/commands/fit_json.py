# SPDX-License-Identifier: Apache-2.0
"""A fitted friction law as the documented JSON object."""

from __future__ import annotations

import argparse
from typing import Any

from stickslip_monitor.commands.fit_text import fragment, viscous_sentence
from stickslip_monitor.commands.quantities import parse_load, parse_speed
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.records import number
from stickslip_monitor.study.fit_result import StribeckFit
from stickslip_monitor.study.fit_solution import UNITS
from stickslip_monitor.study.fit_spread import BoundarySpread, Spread

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
