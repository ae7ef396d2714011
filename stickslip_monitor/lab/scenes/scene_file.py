# SPDX-License-Identifier: Apache-2.0
"""Reads a scene file."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

from stickslip_monitor.errors import ConfigurationError, SceneError
from stickslip_monitor.lab.scenes.effects.registry import SENSOR_EFFECTS, in_order, read_effects
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.telemetry import read_channels
from stickslip_monitor.lab.scenes.variation import drawn, read_parameter_error
from stickslip_monitor.monitor.config_file import load_config, load_yaml

SCHEMA = 'stickslip_monitor/scene/1'
KEYS = (
    'scene', 'description', 'duration', 'start', 'seed', 'config', 'telemetry', 'sensors',
    'parameter_error', 'effects',
)  # fmt: skip
SENSORS_SCHEMA = 'stickslip_monitor/sensors/1'
SENSORS_KEYS = ('sensors', 'description', 'telemetry', 'effects', 'parameter_error')
_LATEST_NS = (1 << 63) - 1
_EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.timezone.utc)


def load_scene(
    path: str | Path, seed: int | None = None, sensors: str | Path | None = None
) -> Scene:
    """Read and validate a scene file.

    Args:
        path: The file.
        seed: The seed; by default the file's.
        sensors: A file of sensors; by default that which the scene names, if any.

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
        return _build(path, document, seed, sensors)
    except SceneError as error:
        raise SceneError(f'{path}: {error}') from error


def _build(path: Path, document: Any, seed: int | None, sensors: str | Path | None) -> Scene:
    _check_schema(document)
    seed = _seed(Settings('', document, document)) if seed is None else seed
    settings = Settings('', drawn(document, seed), KEYS)
    given = _sensors(path.parent, settings, seed, sensors)
    description = settings.text('description', 'what the scene shows')
    duration = settings.number('duration', 's', above=0.0, most=_LATEST_NS * 1e-9)
    start_ns = _start_ns(settings, duration)
    config_path = _config_path(path.parent, settings, seed)
    config = load_config(config_path)
    rates = settings if 'telemetry' in settings or given is None else given
    telemetry = rates.value('telemetry', '{speed: {rate: Hz}, load: {rate: Hz}}')
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
        effects=_effects(settings, given),
        parameter_error=read_parameter_error(
            settings if 'parameter_error' in settings or given is None else given
        ),
    )
    # Built here only to hear of wrong settings before anything is written.
    scene.build()
    return scene


def _check_schema(document: Any) -> None:
    if not isinstance(document, dict) or 'scene' not in document:
        raise SceneError(f"not a scene file: it must begin with 'scene: {SCHEMA}'")
    if document['scene'] != SCHEMA:
        raise SceneError(f"scene = {document['scene']!r} must be '{SCHEMA}'")


def _seed(settings: Settings) -> int:
    seed = settings.value('seed', 'a whole number, from which all random numbers follow')
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise settings.broken('seed', 'must be a whole number not below 0')
    return seed


def _config_path(folder: Path, settings: Settings, seed: int) -> Path:
    """The configuration's file; of a folder of them each seed takes the next."""
    path = folder / settings.text('config', 'the path of a configuration file')
    if not path.is_dir():
        return path
    found = sorted(path.glob('*.yaml'))
    if not found:
        raise settings.broken('config', 'is a folder without a .yaml file')
    return found[seed % len(found)]


def _sensors(
    folder: Path, settings: Settings, seed: int, path: str | Path | None
) -> Settings | None:
    """The file of sensors that was asked for, else that which the scene names, if any."""
    if path is None:
        if 'sensors' not in settings:
            return None
        path = folder / settings.text('sensors', 'the path of a file of sensors')
    return read_sensors(path, seed)


def read_sensors(path: str | Path, seed: int) -> Settings:
    """Read a file of sensors, with what varies drawn for a seed.

    Raises:
        SceneError: It cannot be read; the text names the file.
    """
    try:
        document = load_yaml(path)
    except ConfigurationError as error:
        raise SceneError(str(error)) from error
    if not isinstance(document, dict) or document.get('sensors') != SENSORS_SCHEMA:
        raise SceneError(
            f"{path}: not a file of sensors: it must begin with 'sensors: {SENSORS_SCHEMA}'"
        )
    try:
        return Settings('', drawn(document, seed, 'sensors'), SENSORS_KEYS)
    except SceneError as error:
        raise SceneError(f'{path}: {error}') from error


def load_sensors_description(path: str | Path) -> str:
    """What a file of sensors says of itself.

    Raises:
        SceneError: It cannot be read; the text names the file.
    """
    given = read_sensors(path, 0)
    return given.text('description', 'what the sensors are')


def _effects(settings: Settings, sensors: Settings | None) -> tuple[Settings, ...]:
    """What happens, and what the sensors make of it; where both name an effect the scene's."""
    own = read_effects(settings.value('effects', 'the list of what happens'))
    if sensors is None or 'effects' not in sensors:
        return own
    named = {effect.name for effect in own}
    given = read_effects(sensors.value('effects', 'what the sensors do'))
    for effect in given:
        if effect.name not in SENSOR_EFFECTS:
            raise SceneError(
                f"effect '{effect.name}' of the sensors must be one of {', '.join(SENSOR_EFFECTS)}"
            )
    return in_order([*own, *(effect for effect in given if effect.name not in named)])


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
