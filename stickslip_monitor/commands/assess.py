# SPDX-License-Identifier: Apache-2.0
"""Assess one operating point: regime, margins and predicted amplitude of each bearing.

The exit code is 1 where a bearing would warn: close to the stick-slip region or inside it.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

from rich.table import Table

from stickslip_monitor.commands.arguments import parse_load, parse_speed
from stickslip_monitor.commands.declared import add_config
from stickslip_monitor.commands.output import add_json, console, print_json
from stickslip_monitor.monitor.assessment import BELIEFS, Assessment, assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.messages import number
from stickslip_monitor.monitor.verdict import warns

SCHEMA = 'stickslip_monitor/assessment/1'
_NUMBERS = (
    'hopf_speed',
    'fold_speed',
    'hopf_margin',
    'fold_margin',
    'exact_fold_speed',
    'exact_fold_margin',
    'hopf_load',
    'fold_load',
    'growth_rate',
    'amplitude',
    'amplitude_exact',
    'amplitude_error',
    'threshold_amplitude',
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_config(parser)
    parser.add_argument('--speed', required=True, help='shaft speed with unit, e.g. 20rpm')
    parser.add_argument('--load', required=True, help='bearing load with unit, e.g. 1000N')
    parser.add_argument('--bearing', help='only this bearing')
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(args.config)
    bearings = [config.bearing(args.bearing)] if args.bearing else list(config.bearings)
    load = parse_load(args.load)
    points, warned = [], False
    for item in bearings:
        speed = parse_speed(args.speed, item.bearing.speed)
        points.append((item, assess(item.bearing, speed, load, item.belief)))
        warned |= warns(item, points[-1][1])
    if args.json:
        documents = [to_json(item.name, point) for item, point in points]
        print_json(documents if len(documents) > 1 else documents[0])
    else:
        for item, point in points:
            console().print(_table(item, point))
    return int(warned)


def to_json(bearing: str, point: Assessment) -> dict[str, Any]:
    """The assessment of scalars as the documented JSON object."""
    return {
        'schema': SCHEMA,
        'bearing': bearing,
        'speed': point.speed,
        'load': point.load,
        'regime': point.regime.value,
        'outcome': point.outcome.value,
        'sentence': point.outcome.sentence,
        **{name: number(getattr(point, name)) for name in (*_NUMBERS, *BELIEFS)},
    }


def _table(item: BearingConfig, point: Assessment) -> Table:
    table = Table(title=f'{item.name}: {point.regime.value}', caption=point.outcome.sentence)
    table.add_column('quantity')
    table.add_column('value', justify='right')
    rpm = item.bearing.speed.factor('rpm')
    rows = [
        ('surface speed', point.speed, 1.0, 'm/s'),
        ('shaft speed', point.speed, 1.0 / rpm, 'rpm'),
        ('load', point.load, 1.0, 'N'),
        ('Hopf speed', point.hopf_speed, 1.0 / rpm, 'rpm'),
        ('fold speed', point.fold_speed, 1.0 / rpm, 'rpm'),
        ('Hopf margin', point.hopf_margin, 100.0, '%'),
        ('fold margin', point.fold_margin, 100.0, '%'),
        ('fold speed (exact cycle)', point.exact_fold_speed, 1.0 / rpm, 'rpm'),
        ('fold margin (exact cycle)', point.exact_fold_margin, 100.0, '%'),
        ('Hopf load', point.hopf_load, 1.0, 'N'),
        ('fold load', point.fold_load, 1.0, 'N'),
        ('growth rate', point.growth_rate, 1.0, '1/s'),
        ('stick-slip amplitude (KBM)', point.amplitude, 1e3, 'mm'),
        ('stick-slip amplitude (exact cycle)', point.amplitude_exact, 1e3, 'mm'),
        ('error of KBM in the amplitude', point.amplitude_error, 100.0, '%'),
        ('threshold amplitude (KBM)', point.threshold_amplitude, 1e3, 'mm'),
    ]
    if point.has_belief:
        rows += [
            ('probability that stick-slip can happen', point.probability_can, 100.0, '%'),
            ('probability that it starts by itself', point.probability_will, 100.0, '%'),
            ('fold margin, 5 % quantile', point.fold_margin_low, 100.0, '%'),
            ('fold margin, 95 % quantile', point.fold_margin_high, 100.0, '%'),
        ]
    for name, value, factor, unit in rows:
        table.add_row(name, f'{value * factor:.6g} {unit}' if math.isfinite(value) else 'none')
    return table
