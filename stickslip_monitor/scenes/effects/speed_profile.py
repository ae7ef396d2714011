# SPDX-License-Identifier: Apache-2.0
"""The shaft's speed over time: ``{unit, points: [[time in s, value], ...], bearing}``."""

from __future__ import annotations

from stickslip_monitor.scenes.profile import KEYS as KEYS
from stickslip_monitor.scenes.profile import read_profile
from stickslip_monitor.scenes.settings import Settings

from .effect import UNITS, Frame
from .profiles import add_profile


def build(settings: Settings, frame: Frame) -> None:
    """Add the profile to the speed."""
    profile = read_profile(settings, UNITS['speed'], frame.duration, frame.folder)
    add_profile(settings, frame, 'speed', profile)
