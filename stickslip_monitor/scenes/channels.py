# SPDX-License-Identifier: Apache-2.0
"""From a configuration and a scene's telemetry rates to the channels of the recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from stickslip_monitor.bags.cdr import NUMBER_FIELDS
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.signals import QUANTITIES

from .settings import Settings
from .signals import Channel

_LOWEST_RATE, _HIGHEST_RATE = 1e-6, 1000.0


def read_channels(config: MonitorConfig, telemetry: Any) -> tuple[Channel, ...]:
    """The channels of a scene, in the configuration's order.

    Args:
        config: The configuration; its inputs give topics, units, scales and offsets.
        telemetry: The scene's section ``telemetry``: ``{speed: {rate: Hz}, load: {rate: Hz}}``,
            or one such mapping for each bearing.

    Returns:
        One channel for each topic.

    Raises:
        SceneError: A rate is missing or breaks its rule, or an input cannot be simulated.
    """
    channels: dict[str, Channel] = {}
    for bearing in config.bearings:
        own = _section(telemetry, bearing.name, [b.name for b in config.bearings])
        for quantity in QUANTITIES:
            rate = own.section(quantity, ['rate'], 'its sampling, {rate: Hz}').number(
                'rate', 'Hz', least=_LOWEST_RATE, most=_HIGHEST_RATE
            )
            channel = Channel(quantity, (bearing,), rate)
            _check_input(f'{bearing.name}.{quantity}', channel.input)
            known = channels.get(channel.topic)
            channels[channel.topic] = channel if known is None else _shared(known, channel)
    return tuple(channels.values())


def _section(telemetry: Any, bearing: str, bearings: Sequence[str]) -> Settings:
    """The telemetry of one bearing: its own, or what is said for all."""
    names = set(telemetry) if isinstance(telemetry, dict) else set()
    for_each = not names.isdisjoint(bearings) and names.isdisjoint(QUANTITIES)
    if not for_each:
        return Settings('telemetry', telemetry, QUANTITIES)
    rates = 'the rates of its speed and load'
    return Settings('telemetry', telemetry, bearings).section(bearing, QUANTITIES, rates)


def _check_input(name: str, settings: InputConfig) -> None:
    fields = NUMBER_FIELDS.get(settings.type)
    if fields is None:
        raise SceneError(
            f'{name} is of type {settings.type} in the configuration: a scene can write'
            f' {", ".join(NUMBER_FIELDS)} only'
        )
    if '.'.join(map(str, settings.field)) not in fields:
        raise SceneError(
            f"{name} is field '{settings.field_text}' of {settings.type} in the configuration: a"
            f' scene can write {", ".join(fields)} only'
        )
    if settings.scale == 0.0:
        raise SceneError(f'{name}.scale = 0 in the configuration: no number stands for a value')


def _shared(known: Channel, other: Channel) -> Channel:
    """One channel for two bearings, which must take its numbers to mean the same."""
    first, second = known.bearings[0], other.bearings[0]
    where = f'topic {known.topic} serves {first.name} and {second.name}'
    if known.quantity != other.quantity:
        raise SceneError(f'{where}, as {known.quantity} and as {other.quantity}: use two topics')
    if (known.input.type, known.input.field) != (other.input.type, other.input.field):
        raise SceneError(f'{where} with different types or fields: they must agree')
    if known.rate != other.rate:
        raise SceneError(f'{where}: its rate cannot be both {known.rate:g} and {other.rate:g} Hz')
    if not all(map(math.isclose, _meaning(known, first), _meaning(other, second))):
        raise SceneError(f'{where} with different units, scales or offsets: they must agree')
    return replace(known, bearings=(*known.bearings, second))


def _meaning(channel: Channel, bearing: BearingConfig) -> tuple[float, float, float]:
    """Scale, offset and unit of a channel's numbers, speeds by the turning of the shaft."""
    turning = bearing.bearing.speed.factor('Hz') if channel.quantity == 'speed' else 1.0
    return channel.input.scale, channel.input.offset, channel.input.factor / turning
