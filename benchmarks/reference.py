# SPDX-License-Identifier: Apache-2.0
"""The reference bearing that everything is compared on."""

from __future__ import annotations

from pathlib import Path

from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.physics.bearing import Bearing

CONFIG = Path(__file__).resolve().parents[1] / 'launch_configs' / 'reference_bearing.yaml'
LOAD = 1000.0
"""Its load [N]."""


def bearing() -> Bearing:
    """Return the bearing of the reference configuration."""
    return load_config(CONFIG).bearings[0].bearing
