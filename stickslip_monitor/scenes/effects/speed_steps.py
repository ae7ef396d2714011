# SPDX-License-Identifier: Apache-2.0
"""The shaft's speed in steps: ``{unit, steps: [[time in s, value], ...], rise in s, bearing}``."""

from __future__ import annotations

from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.steps import KEYS as KEYS
from stickslip_monitor.scenes.steps import read_steps

from .effect import UNITS, Frame
from .profiles import add_profile


def build(settings: Settings, frame: Frame) -> None:
    """Add the steps to the speed."""
    steps = read_steps(settings, UNITS['speed'], frame.duration)
    add_profile(settings, frame, 'speed', steps)
