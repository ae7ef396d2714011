# SPDX-License-Identifier: Apache-2.0
"""What the drawing commands share: which bearing, which range, where to write."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from stickslip_monitor.commands.output import add_config
from stickslip_monitor.commands.quantities import parse_speed
from stickslip_monitor.drawing.ranges import Range
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig


def add_output(parser: argparse.ArgumentParser) -> None:
    """Declare what both drawing commands take: the bearing and where to write."""
    add_config(parser)
    parser.add_argument('--bearing', help='which bearing, where several are configured')
    parser.add_argument(
        '--output', '-o', required=True, metavar='FILE', help='file to write: .png, .svg or .csv'
    )


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
