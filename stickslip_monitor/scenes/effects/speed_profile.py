# SPDX-License-Identifier: Apache-2.0
"""The shaft's speed over time: ``{unit, points: [[time in s, value], ...], bearing}``."""

from __future__ import annotations

from stickslip_monitor.physics.oscillator import SPEED_UNITS
from stickslip_monitor.scenes.settings import Settings

from .effect import Effect, Frame
from .profiles import KEYS as KEYS
from .profiles import build_profile


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    return build_profile(settings, frame, 'speed', SPEED_UNITS)
