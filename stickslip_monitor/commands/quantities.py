# SPDX-License-Identifier: Apache-2.0
"""Speeds and loads as a person types them: ``20rpm``, ``0.1 m/s``, ``1000N``, ``1.2kN``."""

from __future__ import annotations

import math
import re

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.table import LOAD_UNITS
from stickslip_monitor.physics.oscillator import SPEED_UNITS, BearingSpeed

_QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)\s*')


def _split(what: str, text: str, units: tuple[str, ...]) -> tuple[float, str]:
    match = _QUANTITY.fullmatch(text)
    if match is None or match.group(2) not in units or not math.isfinite(float(match.group(1))):
        raise ConfigurationError(
            f"{what} '{text}' must be a number with a unit: one of {', '.join(units)}"
        )
    return float(match.group(1)), match.group(2)


def parse_speed(text: str, conversion: BearingSpeed, what: str = 'speed') -> float:
    """Surface speed [m/s] from a text such as ``'20rpm'``; the unit is required."""
    value, unit = _split(what, text, SPEED_UNITS)
    return float(conversion.to_surface(value, unit))


def parse_load(text: str, what: str = 'load') -> float:
    """Load [N] from a text such as ``'1.2kN'``; the unit is required."""
    value, unit = _split(what, text, LOAD_UNITS)
    return value * (1000.0 if unit == 'kN' else 1.0)
