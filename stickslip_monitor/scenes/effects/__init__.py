# SPDX-License-Identifier: Apache-2.0
"""The effects a scene may list, by name; one that is not listed is not even imported."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from stickslip_monitor.errors import SceneError
from stickslip_monitor.scenes.settings import Settings, did_you_mean

from .effect import Builder, Effect, Frame
