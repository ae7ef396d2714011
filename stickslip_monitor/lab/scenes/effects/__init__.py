# SPDX-License-Identifier: Apache-2.0
"""The effects that a scene may list, in their order of action."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.effects import lining_motion, sensors, ship
from stickslip_monitor.lab.scenes.effects.effect import DECLARED, Effect
from stickslip_monitor.lab.scenes.settings import Settings, suggestion

# Imported for the effects that they declare.
_MODULES = (ship, lining_motion, sensors)
STAGES: Mapping[str, tuple[str, ...]] = {
    stage: tuple(name for name, effect in DECLARED.items() if effect.stage == stage)
    for stage in ('shaft', 'turning', 'lining', 'sensing', 'sensor', 'recording', 'file')
}
"""The effects of each stage. Stages act in this order, and so do the effects of a stage, whatever
the order in the file. What 'shaft' and 'turning' add is a function of time; 'sensing' follows it
between the samples; the others change block after block."""
EFFECTS: Mapping[str, Effect] = {
    name: DECLARED[name] for names in STAGES.values() for name in names
}
SENSOR_EFFECTS = (*STAGES['sensing'], *STAGES['sensor'], *STAGES['recording'])
"""What happens to a measurement, not to the ship."""


def read_effects(listed: Any) -> tuple[Settings, ...]:
    """The settings of the listed effects, in the order in which they act.

    The list is of mappings ``{name: {settings}}`` or ``{effect: name, settings}``.
    """
    if not isinstance(listed, list):
        raise SceneError(f'effects = {listed!r} must be a list')
    return in_order(_settings(number, entry) for number, entry in enumerate(listed, 1))


def in_order(effects: Iterable[Settings]) -> tuple[Settings, ...]:
    """Effects in the order in which they act."""
    order = list(EFFECTS)
    return tuple(sorted(effects, key=lambda settings: order.index(settings.name)))


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
    return Settings(name, content, EFFECTS[name].keys)
