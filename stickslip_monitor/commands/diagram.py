# SPDX-License-Identifier: Apache-2.0
"""Draw the bifurcation diagram: vibration amplitude over shaft speed, at one load.

The suffix of the output file chooses the format: a picture (.png, .svg) or the curves
themselves (.csv, SI units). By default the speeds span the Hopf and the fold.
"""

from __future__ import annotations

import argparse
from typing import Any

from stickslip_monitor.commands import options, output
from stickslip_monitor.drawing.diagram import bifurcation_diagram, diagram_columns, draw_diagram
from stickslip_monitor.drawing.map import diagram_speeds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_drawing(parser)
    parser.add_argument('--load', required=True, help='bearing load with unit, e.g. 1000N')
    parser.add_argument('--speeds', metavar='A:B', help='shaft speeds, e.g. 5rpm:45rpm')
    text = 'number of even steps in speed (default 400)'
    options.add_number(parser, '--points', 10, 100_000, default=400, help=text)


def run(args: argparse.Namespace) -> int:
    """Write the diagram of the bearing to the output file, as a picture or a table (.csv); return 0.

    Raises:
        ConfigurationError: The configuration, the load or the speeds are refused.
        DrawingError, OutputError: The file cannot be written.
    """
    config = options.require_single_bearing(options.load_chosen(args))
    bearing = config.bearing
    load = options.parse_positive_load(args.load)
    speeds = options.parse_speed_range(args.speeds, config) or diagram_speeds(bearing, load)

    def make_contents() -> Any:
        """Return the columns of a table for .csv, else a figure."""
        if args.output.lower().endswith('.csv'):
            diagram = bifurcation_diagram(bearing, load, speeds, args.points)
            return diagram_columns(bearing, diagram)
        return draw_diagram(config, load, speeds, args.points)

    output.write_outputs(args, output=make_contents)
    return 0
