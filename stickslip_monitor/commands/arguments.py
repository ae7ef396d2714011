# SPDX-License-Identifier: Apache-2.0
"""Arguments that commands share: the bearing, ranges, and quantities such as ``20rpm``."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from stickslip_monitor.commands import declared
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.files import PICTURES
from stickslip_monitor.monitor.config import LOAD_UNITS, BearingConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.physics.oscillator import SPEED_UNITS, BearingSpeed

if TYPE_CHECKING:
    from stickslip_monitor.drawing.map import Range

ONE_OF_SEVERAL = 'which bearing, where several are configured'
_QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*')


def _split(what: str, text: str, units: tuple[str, ...]) -> tuple[float, str]:
    """Number and unit; letters in the wrong case are understood, as no two units differ by it."""
    match = _QUANTITY.fullmatch(text)
    written = match.group(2) if match else ''
    unit = {unit.lower(): unit for unit in units}.get(written.lower())
    if match is None or unit is None or not math.isfinite(float(match.group(1))):
        why = f", and '{written}' is none of these" if written and unit is None else ''
        raise ConfigurationError(
            f"{what} '{text}' must be a number with a unit: one of {', '.join(units)}{why}"
        )
    return float(match.group(1)), unit


def parse_speed(text: str, conversion: BearingSpeed, what: str = 'speed') -> float:
    """Surface speed [m/s] from a text such as ``'20rpm'``; the unit is required."""
    value, unit = _split(what, text, SPEED_UNITS)
    return float(conversion.to_surface(value, unit))


def parse_load(text: str, what: str = 'load') -> float:
    """Load [N] from a text such as ``'1.2kN'``; the unit is required."""
    value, unit = _split(what, text, LOAD_UNITS)
    return value * (1000.0 if unit == 'kN' else 1.0)


def parse_loaded(text: str) -> float:
    """Load [N] of what needs one: above 0."""
    load = parse_load(text)
    if load <= 0.0:
        raise ConfigurationError(f"load '{text}' must be above 0: without load, no friction")
    return load


def add_drawing(parser: argparse.ArgumentParser) -> None:
    """Declare what both drawing commands take: the bearing and where to write."""
    declared.add_config(parser)
    declared.add_bearing(parser, ONE_OF_SEVERAL)
    marks = {**PICTURES, **declared.TABLE}
    text = 'file to write: .png, .svg or .csv'
    declared.add_output(parser, '--output', '-o', required=True, marks=marks, help=text)
    declared.add_force(parser)


def chosen(args: argparse.Namespace) -> MonitorConfig:
    """The configuration, of all bearings or of that of ``--bearing`` only.

    Raises:
        ConfigurationError: It cannot be read, or has no such bearing.
    """
    config = load_config(args.config)
    if args.bearing is None:
        return config
    return replace(config, bearings=(config.bearing(args.bearing),))


def the_bearing(config: MonitorConfig) -> BearingConfig:
    """The only bearing there is.

    Raises:
        ConfigurationError: There are several.
    """
    if len(config.bearings) > 1:
        names = ', '.join(bearing.name for bearing in config.bearings)
        raise ConfigurationError(f'several bearings are configured: choose --bearing from {names}')
    return config.bearings[0]


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
