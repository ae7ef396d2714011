# SPDX-License-Identifier: Apache-2.0
"""Draw the bifurcation diagram: vibration amplitude over shaft speed, at one load.

The suffix of the output file chooses the format: a picture (.png, .svg) or the curves
themselves (.csv, SI units). Speeds are chosen to show the Hopf and the fold unless given.
"""

from __future__ import annotations

import argparse

from stickslip_monitor.commands.arguments import add_drawing, parse_load, speed_range, the_bearing
from stickslip_monitor.commands.declared import say_written
from stickslip_monitor.drawing.canvas import save_figure, write_csv
from stickslip_monitor.drawing.diagram import bifurcation_diagram, diagram_columns, draw_diagram
from stickslip_monitor.drawing.map import diagram_speeds
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config_file import load_config

_FEWEST, _MOST = 10, 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_drawing(parser)
    parser.add_argument('--load', required=True, help='bearing load with unit, e.g. 1000N')
    parser.add_argument('--speeds', metavar='A:B', help='shaft speeds, e.g. 5rpm:45rpm')
    parser.add_argument(
        '--points', type=int, default=400, help='number of even steps in speed (default 400)'
    )


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    is_table = args.output.lower().endswith('.csv')
    if not _FEWEST <= args.points <= _MOST:
        raise ConfigurationError(f'points = {args.points} must be from {_FEWEST} to {_MOST}')
    config = the_bearing(load_config(args.config), args.bearing)
    bearing = config.bearing
    load = parse_load(args.load)
    if load <= 0.0:
        raise ConfigurationError(f"load '{args.load}' must be above 0: without load, no friction")
    speeds = speed_range(args.speeds, config) or diagram_speeds(bearing, load)
    if is_table:
        diagram = bifurcation_diagram(bearing, load, speeds, args.points)
        write_csv(diagram_columns(bearing, diagram), args.output, args.force)
    else:
        save_figure(draw_diagram(config, load, speeds, args.points), args.output, args.force)
    say_written(args.output)
    return 0
