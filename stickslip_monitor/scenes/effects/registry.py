# SPDX-License-Identifier: Apache-2.0
"""The effects a scene may list; one that is not listed is not even imported."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from typing import Any

from stickslip_monitor.errors import SceneError
from stickslip_monitor.scenes.settings import Settings, suggestion

from .effect import Builder, Effect, Frame

_HERE = 'stickslip_monitor.scenes.effects'

# Each module has KEYS, the settings it takes, and build(settings, frame).
EFFECTS = {
    'load_profile': f'{_HERE}.load_profile',
    'sensor_noise': f'{_HERE}.sensor_noise',
    'speed_profile': f'{_HERE}.speed_profile',
}


def read_effects(listed: Any) -> tuple[Settings, ...]:
    """The settings of the listed effects, in their order, each named as its effect.

    Args:
        listed: The scene's list ``effects``: of mappings ``{name: {settings}}`` or
            ``{effect: name, settings}``.

    Raises:
        SceneError: An entry is neither, or names an unknown effect or setting.
    """
    if not isinstance(listed, list):
        raise SceneError(f'effects = {listed!r} must be a list')
    return tuple(_settings(number, entry) for number, entry in enumerate(listed, 1))


def _settings(number: int, entry: Any) -> Settings:
    if not isinstance(entry, Mapping) or not ('effect' in entry or len(entry) == 1):
        raise SceneError(
            f'effects: entry {number} = {entry!r} must be {{name: {{settings}}}} or'
            ' {effect: name, settings}'
        )
    if 'effect' in entry:
        name, content = entry['effect'], {k: v for k, v in entry.items() if k != 'effect'}
    else:
        ((name, content),) = entry.items()
    if not isinstance(name, str) or name not in EFFECTS:
        hint = suggestion(name, list(EFFECTS))
        raise SceneError(f"effects: entry {number} is unknown effect '{name}'; {hint}")
    return Settings(name, content, importlib.import_module(EFFECTS[name]).KEYS)


def build_effects(effects: Iterable[Settings], frame: Frame) -> list[Effect]:
    """Build effects for one run of a scene.

    Raises:
        SceneError: A setting breaks its rule, or an effect is listed twice for a channel.
    """
    built = []
    for settings in effects:
        build: Builder = importlib.import_module(EFFECTS[settings.name]).build
        built.append(build(settings, frame))
    return built
