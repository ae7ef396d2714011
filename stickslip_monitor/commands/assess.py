# SPDX-License-Identifier: Apache-2.0
"""Assess one operating point: regime, margins and predicted amplitude of each bearing.

Exits 1 if the monitor would warn at this point: near the stick-slip region or inside it. A speed
below alarm.minimum_speed is a shaft at rest.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

from rich.table import Table

from stickslip_monitor.commands import options, output
from stickslip_monitor.monitor import record_fields
from stickslip_monitor.monitor.assessment import BELIEFS, Assessment, assess
from stickslip_monitor.monitor.bearing_records import finite_or_none
from stickslip_monitor.monitor.config_questions import question_sentences
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.statements import calls_for_caution

SCHEMA = 'stickslip_monitor/assessment/2'
_ROWS = [(title, item.name, unit) for item in record_fields.ASSESSED for title, unit in item.shown]
_NAMES = [name for _, name, _ in _ROWS]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_config(parser)
    parser.add_argument('--speed', required=True, help='shaft speed with unit, e.g. 20rpm')
    parser.add_argument('--load', required=True, help='bearing load with unit, e.g. 1000N')
    options.add_shared(parser, '--bearing', '--json')


def run(args: argparse.Namespace) -> int:
    """Print the assessment of each chosen bearing; return 1 if the monitor would warn of one, else 0.

    Questions about the configuration follow each. A speed below the dead band counts as 0. As JSON it is
    one object, or a list of several.

    Raises:
        ConfigurationError: The configuration, the speed or the load is refused.
    """
    load = options.parse_load(args.load)
    points, warned = [], False
    for item in options.load_chosen(args).bearings:
        speed = options.parse_speed(args.speed, item.bearing.speed)
        speed *= abs(speed) >= item.speed.deadband  # as the monitor counts it
        points.append((item, assess(item.bearing, speed, load, item.belief)))
        warned |= calls_for_caution(item, points[-1][1])
    if args.json:
        documents = [
            to_json(item.name, point) | {'questions': question_sentences(item, load)}
            for item, point in points
        ]
        output.print_json(documents if len(documents) > 1 else documents[0])
    else:
        for item, point in points:
            output.console().print(_build_table(item, point))
            for question in question_sentences(item, load):
                output.console().print(f'question: {question}', soft_wrap=True)
    return int(warned)


def to_json(bearing: str, point: Assessment) -> dict[str, Any]:
    """Return an assessment of scalars as the documented JSON object; ``None`` for a number not finite."""
    return {
        'schema': SCHEMA,
        'bearing': bearing,
        'regime': point.regime.value,
        'outcome': point.outcome.value,
        'sentence': point.outcome.sentence,
        **{name: finite_or_none(getattr(point, name)) for name in (*_NAMES, *BELIEFS)},
    }


def _build_table(item: BearingConfig, point: Assessment) -> Table:
    """Return the table of an assessment; values that are not finite are shown as 'none'.

    Probabilities have no rows where the bearing has no tolerance.
    """
    title = f'{item.name}: {point.regime.value}'
    table = output.make_table(title, 'quantity; value', caption=point.outcome.sentence)
    units = {'rpm': 1.0 / item.bearing.speed.factor('rpm'), '%': 100.0, 'mm': 1e3}
    for title, name, unit in _ROWS:
        value = getattr(point, name)
        if name not in BELIEFS or point.has_belief:
            shown = f'{value * units.get(unit, 1.0):.4g} {unit}'
            table.add_row(title, shown if math.isfinite(value) else 'none')
    return table
