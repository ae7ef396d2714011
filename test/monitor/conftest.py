# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from shared import REFERENCE

from stickslip_monitor import MonitorConfig, build_config


@pytest.fixture
def reference() -> dict[str, Any]:
    """Parameters of the reference bearing, without a bearing name."""
    return dict(REFERENCE)


@pytest.fixture
def configure() -> Callable[..., MonitorConfig]:
    """Configuration of the reference bearing, named aft, with some parameters replaced."""

    def build(**changes: Any) -> MonitorConfig:
        values = REFERENCE | {key.replace('__', '.'): value for key, value in changes.items()}
        return build_config({'bearings': ['aft']} | {f'aft.{key}': value for key, value in values.items()})

    return build
