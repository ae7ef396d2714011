# SPDX-License-Identifier: Apache-2.0
"""A bearing's load in steps: ``{unit, steps: [[time in s, value], ...], rise in s, bearing}``."""

from __future__ import annotations

from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.steps import KEYS as KEYS
from stickslip_monitor.scenes.steps import read_steps

from .effect import UNITS, Frame
from .profiles import add_profile


def build(settings: Settings, frame: Frame) -> None:
    """Add the steps to the load."""
    steps = read_steps(settings, UNITS['load'], frame.duration)
    add_profile(settings, frame, 'load', steps)
