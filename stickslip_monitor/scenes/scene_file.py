# SPDX-License-Identifier: Apache-2.0
"""Reads a scene file."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

from stickslip_monitor.errors import ConfigurationError, SceneError
from stickslip_monitor.monitor.config_file import load_config, load_yaml
from stickslip_monitor.scenes.effects.registry import read_effects
from stickslip_monitor.scenes.scene import Scene
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.telemetry import read_channels

SCHEMA = 'stickslip_monitor/scene/1'
KEYS = (
    'scene', 'description', 'duration', 'start', 'seed', 'config', 'telemetry', 'effects',
)  # fmt: skip
_LATEST_NS = (1 << 63) - 1
_EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.timezone.utc)


def load_scene(path: str | Path) -> Scene:
    """Read and validate a scene file.

    Args:
        path: The file.

    Raises:
        SceneError: It cannot be read or breaks a rule; the text names the file.
        ConfigurationError: The configuration it refers to cannot be read or breaks a rule.
    """
    path = Path(path)
    try:
        document = load_yaml(path)
    except ConfigurationError as error:
        raise SceneError(str(error)) from error
    try:
        return _build(path, document)
    except SceneError as error:
        raise SceneError(f'{path}: {error}') from error


def _build(path: Path, document: Any) -> Scene:
    _check_schema(document)
    settings = Settings('', document, KEYS)
    description = settings.text('description', 'what the scene shows')
    duration = settings.number('duration', 's', above=0.0, most=_LATEST_NS * 1e-9)
    start_ns = _start_ns(settings, duration)
    seed = settings.value('seed', 'a whole number, from which all random numbers follow')
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise settings.broken('seed', 'must be a whole number not below 0')
    config_path = path.parent / settings.text('config', 'the path of a configuration file')
    config = load_config(config_path)
    telemetry = settings.value('telemetry', '{speed: {rate: Hz}, load: {rate: Hz}}')
    channels = read_channels(config, telemetry)
    for channel in channels:
        if start_ns + round(duration * 1e9) >= channel.stamps_end_ns:
            rule = f'in 2038 the time stamps in the headers of topic {channel.topic} end'
            raise settings.broken('start', f'must lie, with the whole scene, before that: {rule}')
    scene = Scene(
        description=description,
        duration=duration,
        start_ns=start_ns,
        seed=seed,
        folder=path.parent,
        config_path=config_path,
        config=config,
        channels=channels,
        effects=read_effects(settings.value('effects', 'the list of what happens')),
    )
    # Built here only to hear of wrong settings before anything is written.
    scene.build()
    return scene


def _check_schema(document: Any) -> None:
    if not isinstance(document, dict) or 'scene' not in document:
        raise SceneError(f"not a scene file: it must begin with 'scene: {SCHEMA}'")
    if document['scene'] != SCHEMA:
        raise SceneError(f"scene = {document['scene']!r} must be '{SCHEMA}'")


def _start_ns(settings: Settings, duration: float) -> int:
    """Nanoseconds since 1970 from nanoseconds or an ISO time, which is UTC if it has no zone."""
    what = 'an ISO time such as 2026-05-04T06:00:00Z, or whole nanoseconds since 1970'
    value = settings.value('start', what)
    if isinstance(value, str):
        try:
            value = dt.datetime.fromisoformat(value.replace('Z', '+00:00'))
        except ValueError:
            raise settings.broken('start', f'must be {what}') from None
    if isinstance(value, dt.datetime):
        if value.tzinfo is None:
            value = value.replace(tzinfo=dt.timezone.utc)
        value = (value - _EPOCH) // dt.timedelta(microseconds=1) * 1000
    if isinstance(value, bool) or not isinstance(value, int):
        raise settings.broken('start', f'must be {what}')
    if not 0 <= value <= _LATEST_NS - round(duration * 1e9):
        raise settings.broken('start', 'must lie, with the whole scene, between 1970 and 2262')
    return value
