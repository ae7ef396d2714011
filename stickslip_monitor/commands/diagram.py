# SPDX-License-Identifier: Apache-2.0
"""Draw the bifurcation diagram: vibration amplitude over shaft speed, at one load.

The ending of the output file chooses what is written: a picture (.png, .svg) or the curves
themselves (.csv, SI units). Speeds are chosen to show the Hopf and the fold unless given.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from stickslip_monitor.commands.output import add_config
from stickslip_monitor.commands.quantities import parse_load, parse_speed
from stickslip_monitor.drawing.branches import bifurcation_diagram, diagram_columns
from stickslip_monitor.drawing.canvas import checked_suffix, save_figure, write_csv
from stickslip_monitor.drawing.diagram import draw_diagram
from stickslip_monitor.drawing.ranges import Range, diagram_speeds
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import load_config

_FEWEST, _MOST = 10, 100_000


def add_output(parser: argparse.ArgumentParser) -> None:
    """Declare what both drawing commands take: the bearing and where to write."""
    add_config(parser)
    parser.add_argument('--bearing', help='which bearing, where several are configured')
    parser.add_argument(
        '--output', '-o', required=True, metavar='FILE', help='file to write: .png, .svg or .csv'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_output(parser)
    parser.add_argument('--load', required=True, help='bearing load with unit, e.g. 1000N')
    parser.add_argument('--speeds', metavar='A:B', help='shaft speeds, e.g. 5rpm:45rpm')
    parser.add_argument(
        '--points', type=int, default=400, help='number of even steps in speed (default 400)'
    )


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    suffix = checked_suffix(args.output)
    if not _FEWEST <= args.points <= _MOST:
        raise ConfigurationError(f'points = {args.points} must be from {_FEWEST} to {_MOST}')
    config = the_bearing(load_config(args.config), args.bearing)
    bearing = config.bearing
    load = parse_load(args.load)
    if load <= 0.0:
        raise ConfigurationError(f"load '{args.load}' must be above 0: without load, no friction")
    speeds = speed_range(args.speeds, config) or diagram_speeds(bearing, load)
    if suffix == '.csv':
        diagram = bifurcation_diagram(bearing, load, speeds, args.points)
        write_csv(diagram_columns(bearing, diagram), args.output)
    else:
        save_figure(draw_diagram(config, load, speeds, args.points), args.output)
    return 0


def the_bearing(config: MonitorConfig, name: str | None) -> BearingConfig:
    """The bearing of that name; the only one there is if no name is given.

    Raises:
        ConfigurationError: There is none of that name, or no name and several bearings.
    """
    if name is None and len(config.bearings) > 1:
        names = ', '.join(bearing.name for bearing in config.bearings)
        raise ConfigurationError(f'several bearings are configured: choose --bearing from {names}')
    return config.bearings[0] if name is None else config.bearing(name)


def speed_range(text: str | None, config: BearingConfig) -> Range | None:
    """Surface speeds [m/s] from a text such as ``'5rpm:45rpm'``; ``None`` for no text."""
    conversion = config.bearing.speed
    return parse_range(text, 'speeds', lambda part: parse_speed(part, conversion, 'speeds'))


def parse_range(text: str | None, what: str, parse: Callable[[str], float]) -> Range | None:
    """Two quantities with a colon between them, not negative and rising.

    Raises:
        ConfigurationError: The text is anything else; it is named, with the rule.
    """
    if text is None:
        return None
    parts = text.split(':')
    if len(parts) != 2:
        raise ConfigurationError(f"{what} '{text}' must be LOW:HIGH, each with its unit")
    low, high = parse(parts[0]), parse(parts[1])
    if not 0.0 <= low < high:
        raise ConfigurationError(
            f"{what} '{text}' must rise from its first value, not below 0, to its second"
        )
    return low, high
