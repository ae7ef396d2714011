# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from stickslip_monitor import MonitorConfig, build_config

REFERENCE: dict[str, Any] = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction.law': 'stribeck',
    'friction.static': 0.3,
    'friction.kinetic': 0.1,
    'friction.decay': 10.0,
    'speed.topic': '/shaft/speed',
    'speed.unit': 'rpm',
    'load.topic': '/bearing/aft/load',
    'load.unit': 'N',
}


@pytest.fixture
def reference() -> dict[str, Any]:
    """Parameters of the reference bearing, without a bearing name."""
    return dict(REFERENCE)


@pytest.fixture
def configure() -> Callable[..., MonitorConfig]:
    """Configuration of the reference bearing, named aft, with some parameters replaced."""

    def build(**changes: Any) -> MonitorConfig:
        values = REFERENCE | {key.replace('__', '.'): value for key, value in changes.items()}
        return build_config(
            {'bearings': ['aft']} | {f'aft.{key}': value for key, value in values.items()}
        )

    return build
