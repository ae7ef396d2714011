# SPDX-License-Identifier: Apache-2.0
"""The effects that a scene may list, in their order of action; only listed ones are imported."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.effects.effect import (
    BuildContext,
    Effect,
    EffectKind,
    RecordingCut,
)
from stickslip_monitor.lab.scenes.sensing import Sensor
from stickslip_monitor.lab.scenes.settings import Settings, suggestion
from stickslip_monitor.lab.scenes.shaft import Shaft

# By stage; stages act in this order, and so do the effects of a stage, whatever the order in the
# file. What 'shaft' and 'turning' add is a function of time; 'sensing' follows it between the
# samples; the others change block after block.
STAGES: Mapping[str, tuple[str, ...]] = {
    'shaft': (
        'speed_profile', 'speed_steps', 'manoeuvre', 'load_profile', 'load_steps', 'load_in_waves',
    ),
    'turning': ('blade_ripple', 'misalignment'),
    'lining': ('friction_drift', 'operating_point', 'lining_motion'),
    'sensing': ('filtering', 'averaging'),
    'sensor': (
        'vibration_background', 'bias', 'sensor_noise', 'spikes', 'quantisation', 'stuck',
        'not_a_number',
    ),
    'recording': (
        'clock_jitter', 'clock_jump', 'out_of_order', 'repeated_stamps', 'dropout',
        'second_publisher',
    ),
    'file': ('cut_off',),
}  # fmt: skip
# The module of each effect, whose table ``EFFECTS`` has it; only what a scene lists is imported.
MODULES: Mapping[str, tuple[str, ...]] = {
    'profiles': ('speed_profile', 'speed_steps', 'manoeuvre', 'load_profile', 'load_steps'),
    'disturbances': ('load_in_waves', 'blade_ripple', 'misalignment'),
    'filters': ('filtering', 'averaging'),
    'sensor': (
        'vibration_background',
        'bias',
        'sensor_noise',
        'spikes',
        'quantisation',
        'stuck',
        'not_a_number',
    ),
    'recorder': (
        'clock_jitter',
        'clock_jump',
        'out_of_order',
        'repeated_stamps',
        'dropout',
        'second_publisher',
        'cut_off',
    ),
    'lining_motion': ('friction_drift', 'operating_point', 'lining_motion'),
}
# Each effect's module; its place is its place in the order of action.
EFFECTS = {
    name: next(module for module, own in MODULES.items() if name in own)
    for names in STAGES.values()
    for name in names
}
SENSOR_EFFECTS = (*STAGES['sensing'], *STAGES['sensor'], *STAGES['recording'])
"""What happens to a measurement, not to the ship."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneRun:
    """What one run of a scene consists of.

    Attributes:
        shaft: The operating point over time.
        sensors: By topic, the sensors that remember more than the instant of a sample.
        effects: The effects that act block by block, in their order.
        cut: Where the recording breaks off, if it does.
    """

    shaft: Shaft
    sensors: dict[str, Sensor]
    effects: list[Effect]
    cut: RecordingCut | None = None


def read_effects(listed: Any) -> tuple[Settings, ...]:
    """The settings of the listed effects, in the order in which they act.

    Args:
        listed: The scene's list ``effects``: of mappings ``{name: {settings}}`` or
            ``{effect: name, settings}``.

    Raises:
        SceneError: An entry is neither, or names an unknown effect or setting.
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
    return Settings(name, content, effect_kind(name).keys)


def effect_kind(name: str) -> EffectKind:
    """The settings and the builder of an effect; its module is imported now."""
    module = importlib.import_module(f'{__package__}.{EFFECTS[name]}')
    kinds: dict[str, EffectKind] = module.EFFECTS
    return kinds[name]


def build_run(effects: Iterable[Settings], context: BuildContext) -> SceneRun:
    """Build effects for one run of a scene, in the order given.

    Raises:
        SceneError: A setting breaks its rule, or an effect is listed twice for a channel.
    """
    acting: list[Effect] = []
    cut = None
    for settings in effects:
        built = context.build(settings.name, effect_kind(settings.name).build, settings)
        if isinstance(built, RecordingCut):
            cut = built
        elif built is not None:
            acting.append(built)
    return SceneRun(context.shaft, context.sensors, acting, cut)
