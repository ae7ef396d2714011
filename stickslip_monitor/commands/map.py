# SPDX-License-Identifier: Apache-2.0
"""Draw the stability map: which regime at which shaft speed and bearing load.

The suffix of the output file chooses the format: a picture (.png, .svg) or the boundaries
themselves as loads over speed (.csv, SI units). With --track the operating points of a recorded
bag are drawn on the map, with marks where the alarm changed.
"""

from __future__ import annotations

import argparse
from typing import Any

from stickslip_monitor.commands import options, output
from stickslip_monitor.drawing.map import Track, boundaries, draw_map, map_columns, map_ranges, track_of_scan
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_drawing(parser)
    parser.add_argument('--speeds', metavar='A:B', help='shaft speeds, e.g. 0rpm:60rpm')
    parser.add_argument('--loads', metavar='A:B', help='bearing loads, e.g. 0N:2kN')
    options.add_file(parser, '--track', metavar='BAG', help='draw the operating points of this bag')


def run(args: argparse.Namespace) -> int:
    """Write the map of the bearing to the output file, as a picture or a table (.csv); return 0.

    Raises:
        ConfigurationError: The configuration or a range is refused, or a track is asked for in a table.
        BagError: The recording of the track cannot be read.
        OSError: A file of a recording was removed while it was read.
        DrawingError, OutputError: The file cannot be written.
    """
    is_table = args.output.lower().endswith('.csv')
    if is_table and args.track:
        raise ConfigurationError(
            f"track '{args.track}' is for pictures: write a .png or .svg, not '{args.output}'"
        )
    bearing = options.require_single_bearing(options.load_chosen(args))
    speeds = options.parse_speed_range(args.speeds, bearing)
    loads = options.parse_range(args.loads, 'loads', lambda part: options.parse_load(part, 'loads'))

    def make_contents() -> Any:
        """Return the columns of a table, or a figure with the track if there is one."""
        if is_table:
            drawn, _ = map_ranges(bearing.bearing, speeds, loads)
            curves = boundaries(bearing.bearing, drawn, bearing.alarm.caution_margin)
            return map_columns(bearing.bearing, curves)
        return draw_map(bearing, speeds, loads, _read_track(args.track, bearing) if args.track else None)

    output.write_outputs(args, output=make_contents)
    return 0


def _read_track(path: str, bearing: BearingConfig) -> Track:
    """Run the monitor over a recording and return its operating points and events.

    Raises:
        BagError: The recording cannot be read, is empty, or has not both speed and load of the bearing.
        OSError: A file of it was removed after it was opened.
    """
    # Imported only for a track: reading bags takes time to import.
    from stickslip_monitor.offline.check import RecordingBuffer, check_recording

    recording = RecordingBuffer()
    check_recording(path, MonitorConfig((bearing,)), [recording])
    return track_of_scan(recording.scan(bearing.name))
