# SPDX-License-Identifier: Apache-2.0
"""Reads and runs a scene: events on one ship's shaft, and the messages of its sensors.

It runs block by block: memory does not grow with its duration.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

# Those of effects are imported for what they declare.
from stickslip_lab.scenes import lining_effects, sensor_effects, shaft_effects, telemetry  # noqa: F401
from stickslip_lab.scenes.effects import DECLARED, Effect, SceneRun
from stickslip_lab.scenes.settings import Settings, draw_numbers, read_parameter_error, suggestion
from stickslip_lab.scenes.telemetry import Channel, Shaft, Signal, TimeBlock, read_channels
from stickslip_lab.scenes.truth_topics import BOOL, FLOAT64, STRING
from stickslip_logs.recordings.writer import (
    BagWriter,
    encode_bool,
    encode_float64s,
    encode_stamped,
    encode_string,
)
from stickslip_logs.time_order import EPOCH
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import ConfigurationError, SceneError
from stickslip_monitor.monitor.parameter_file import load_config, load_yaml
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.value_check import refused

SCHEMA = 'stickslip_monitor/scene/1'
KEYS = (
    *('scene', 'description', 'duration', 'start', 'seed', 'config'),
    *('telemetry', 'sensors', 'parameter_error', 'effects'),
)
SENSORS_SCHEMA = 'stickslip_monitor/sensors/1'
SENSORS_KEYS = ('sensors', 'description', 'telemetry', 'effects', 'parameter_error')
# Last time stamp that a recording can have [ns since 1970].
_MAX_TIME_NS: int = np.iinfo(np.int64).max
STAGES: Mapping[str, tuple[str, ...]] = {
    stage: tuple(name for name, effect in DECLARED.items() if effect.stage == stage)
    for stage in ('shaft', 'turning', 'lining', 'sensing', 'sensor', 'recording', 'file')
}
"""The effects of each stage. Stages act in this order, and so do the effects of a stage, whatever
the order in the file. The effects of 'shaft' and 'turning' add functions of time; 'sensing' follows them
between the samples; the others change block after block."""
EFFECTS: Mapping[str, Effect] = {name: DECLARED[name] for names in STAGES.values() for name in names}
SENSOR_EFFECTS = (*STAGES['sensing'], *STAGES['sensor'], *STAGES['recording'])
"""The effects that act on a measurement, not on the ship."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A validated scene."""

    description: str  # what it shows
    duration: float  # its duration, > 0 [s]
    start_ns: int  # time stamp of its start [ns since 1970]
    seed: int  # seed of all random streams
    folder: Path  # folder of the scene file
    config_path: Path  # file of the configuration
    config: MonitorConfig  # the configuration of the bearings
    channels: tuple[Channel, ...]  # the channels of telemetry
    effects: tuple[Settings, ...]  # the settings of each effect, in the order in which they act
    # Largest relative error of each parameter that the monitor is configured with; a run does not use it.
    parameter_error: Mapping[str, float] = field(default_factory=dict)

    def build(self) -> SceneRun:
        """Build one run of the scene: a fresh shaft with every effect added, in the order in which they act.

        Tables that the effects name are read.

        Raises:
            SceneError: A setting of an effect breaks a rule, or a table cannot be read.
        """
        shaft = Shaft(self.channels)
        run = SceneRun(self.duration, self.seed, self.channels, self.folder, self.start_ns, shaft)
        for settings in self.effects:
            EFFECTS[settings.name].build(settings, run)
        return run


def load_scene(path: str | Path, seed: int | None = None, sensors: str | Path | None = None) -> Scene:
    """Read and validate a scene file; its numbers ``{between: [low, high]}`` are drawn by the seed.

    Args:
        path: The file.
        seed: Seed in place of the file's; ``None`` for that one.
        sensors: File of sensors in place of the one that the scene names; ``None`` for that one.

    Raises:
        SceneError: It cannot be read or breaks a rule; the text names the file.
        ConfigurationError: The configuration it refers to cannot be read or breaks a rule.
    """
    path = Path(path)
    document = _read_document(path, 'scene', 'scene file', SCHEMA)
    try:
        return _build_scene(path, document, seed, sensors)
    except SceneError as error:
        raise SceneError(f'{path}: {error}') from error


def _read_document(path: str | Path, kind: str, meaning: str, schema: str) -> Any:
    """Read a YAML file of the kind and schema wanted; return its mapping.

    Args:
        path: The file.
        kind: The key that names the kind of the file; its value is the schema.
        meaning: Name of the kind, for the error.
        schema: The version that is read.

    Raises:
        SceneError: The file cannot be read, or is of another kind or schema; the text names it.
    """
    try:
        document = load_yaml(path)
    except ConfigurationError as error:
        raise SceneError(str(error)) from error
    if not isinstance(document, dict) or kind not in document:
        raise SceneError(f"{path}: not a {meaning}: it must begin with '{kind}: {schema}'")
    if document[kind] != schema:
        raise refused(f'{path}: {kind}', document[kind], repr(schema), SceneError)
    return document


def _build_scene(path: Path, document: Any, seed: int | None, sensors: str | Path | None) -> Scene:
    """Return the scene of a parsed file; its effects are built once, as a check.

    Args:
        path: The file, from whose folder other paths count.
        document: Its content.
        seed: Seed in place of the file's; ``None`` for that one.
        sensors: File of sensors in place of the one that the scene names; ``None`` for that one.

    Raises:
        SceneError: It breaks a rule; the text does not name the file.
        ConfigurationError: The configuration it refers to cannot be read or breaks a rule.
    """
    if seed is None:
        meaning = 'a whole number, from which all random numbers follow'
        seed = Settings('', document, document).whole('seed', meaning, 0)
    settings = Settings('', draw_numbers(document, seed), KEYS)
    given = _read_sensors(path.parent, settings, seed, sensors)
    description = settings.text('description', 'what the scene shows')
    duration = settings.number('duration', 's', above=0.0, maximum=_MAX_TIME_NS * 1e-9)
    start_ns = _read_start_ns(settings, duration)
    config_path = _choose_config_path(path.parent, settings, seed)
    config = load_config(config_path)
    telemetry, errors = (
        settings if given is None or key in settings else given for key in ('telemetry', 'parameter_error')
    )
    meaning = '{speed: {rate: Hz}, load: {rate: Hz}}, or give a file of sensors by --sensors'
    rates = telemetry.value('telemetry', meaning)
    channels = read_channels(config, rates)
    for channel in channels:
        if start_ns + round(duration * 1e9) >= channel.stamps_end_ns:
            rule = f'in 2038 the time stamps in the headers of topic {channel.topic} end'
            raise settings.value_error('start', f'before that, with the whole scene: {rule}')
    effects, wrong = _join_effects(settings, given), read_parameter_error(errors)
    place = path.parent, config_path, config
    scene = Scene(description, duration, start_ns, seed, *place, channels, effects, wrong)
    # Built here only to find wrong settings before anything is written.
    scene.build()
    return scene


def _choose_config_path(folder: Path, settings: Settings, seed: int) -> Path:
    """Return the path of the configuration, which need not exist.

    Of a folder of files the seed chooses one.

    Raises:
        SceneError: The key is missing, or the folder has no ``.yaml`` file.
    """
    path = folder / settings.text('config', 'the path of a configuration file')
    if not path.is_dir():
        return path
    candidates = sorted(path.glob('*.yaml'))
    if not candidates:
        raise settings.value_error('config', 'a folder with a .yaml file')
    return candidates[seed % len(candidates)]


def _read_sensors(folder: Path, settings: Settings, seed: int, path: str | Path | None) -> Settings | None:
    """Read a file of sensors; return its content with numbers drawn, or ``None`` where no file is named.

    Args:
        folder: Folder of the scene file, from which the path that the scene names counts.
        settings: The scene, which may name a file of sensors.
        seed: Seed for the numbers to draw.
        path: File in place of the one that the scene names; ``None`` for that one.

    Raises:
        SceneError: It cannot be read or breaks a rule; the text names it.
    """
    if path is None:
        if 'sensors' not in settings:
            return None
        path = folder / settings.text('sensors', 'the path of a file of sensors')
    document = _read_document(path, 'sensors', 'file of sensors', SENSORS_SCHEMA)
    try:
        return Settings('', draw_numbers(document, seed, 'sensors'), SENSORS_KEYS)
    except SceneError as error:
        raise SceneError(f'{path}: {error}') from error


def _join_effects(settings: Settings, sensors: Settings | None) -> tuple[Settings, ...]:
    """Return the effects of a scene and those of its sensors file, in the order in which they act.

    An effect of the scene replaces those of the same name in the sensors file.

    Args:
        settings: The scene.
        sensors: The sensors file; None without one.

    Raises:
        SceneError: The scene has no ``effects``, one of the lists breaks a rule of :func:`read_effects`, or
            the sensors file lists an effect that is not one of the sensors.
    """
    own_effects = read_effects(settings.value('effects', 'the list of what happens'))
    if sensors is None or 'effects' not in sensors:
        return own_effects
    named = {effect.name for effect in own_effects}
    given = read_effects(sensors.value('effects', 'what the sensors do'))
    for name in (effect.name for effect in given):
        if name not in SENSOR_EFFECTS:
            raise refused('effect of the sensors', name, f'one of {", ".join(SENSOR_EFFECTS)}', SceneError)
    return sort_effects([*own_effects, *(effect for effect in given if effect.name not in named)])


def read_effects(listed: Any) -> tuple[Settings, ...]:
    """Return the settings of the listed effects, in the order in which they act.

    The list is of mappings ``{name: {settings}}`` or ``{effect: name, settings}``. Values are not checked.

    Raises:
        SceneError: It is no such list, or an effect or one of its keys is unknown.
    """
    if not isinstance(listed, list):
        raise refused('effects', listed, 'a list', SceneError)
    return sort_effects(_parse_effect(number, entry) for number, entry in enumerate(listed, 1))


def sort_effects(effects: Iterable[Settings]) -> tuple[Settings, ...]:
    """Return effects sorted into the order in which they act."""
    return tuple(sorted(effects, key=lambda settings: list(EFFECTS).index(settings.name)))


def _parse_effect(number: int, entry: Any) -> Settings:
    """Return the settings of entry ``number`` of the list of effects.

    Raises:
        SceneError: It is no mapping as :func:`read_effects` wants, or the effect or a key is unknown.
    """
    if not isinstance(entry, Mapping) or not ('effect' in entry or len(entry) == 1):
        rule = '{name: {settings}} or {effect: name, settings}'
        raise refused(f'effects: entry {number}', entry, rule, SceneError)
    if 'effect' in entry:
        name, content = entry['effect'], {k: v for k, v in entry.items() if k != 'effect'}
    else:
        ((name, content),) = entry.items()
    if not isinstance(name, str) or name not in EFFECTS:
        hint = suggestion(name, list(EFFECTS))
        raise SceneError(f"effects: entry {number} is unknown effect '{name}'; {hint}")
    return Settings(name, content, EFFECTS[name].keys)


def _read_start_ns(settings: Settings, duration: float) -> int:
    """Return the ``start`` [ns since 1970], which is given in nanoseconds or as an ISO time, to microseconds.

    An ISO time without a zone is UTC. ``duration`` [s] is the scene's.

    Raises:
        SceneError: It is missing or neither, looks like another unit, or the scene does not lie between
            1970 and 2262.
    """
    meaning = 'an ISO time such as 2026-05-04T06:00:00Z, or whole nanoseconds since 1970'
    value = settings.value('start', meaning)
    if isinstance(value, str):
        try:
            dt.date.fromisoformat(value[:10]), dt.time.fromisoformat(value[11:16])
            time = dt.datetime.fromisoformat(value.replace('Z', '+00:00'))
        except ValueError:
            raise settings.value_error('start', meaning) from None
        zoned = time if time.tzinfo else time.replace(tzinfo=dt.timezone.utc)
        value = (zoned - EPOCH) // dt.timedelta(microseconds=1) * 1000
    if isinstance(value, bool) or not isinstance(value, int):
        raise settings.value_error('start', meaning)
    for unit, factor in (('seconds', 10**9), ('milliseconds', 10**6), ('microseconds', 1000)):
        if 10**18 <= value * factor < 4 * 10**18:  # from 2001 to 2096 in that unit
            raise settings.value_error('start', f'{value * factor}: nanoseconds since 1970, not {unit}')
    if not 0 <= value <= _MAX_TIME_NS - round(duration * 1e9):
        raise settings.value_error('start', 'between 1970 and 2262, with the whole scene')
    return value


BLOCK_LENGTH = 60.0
"""Length of a block [s]: memory is that of its samples."""


def simulate(
    scene: Scene, block_length: float = BLOCK_LENGTH, run: SceneRun | None = None
) -> Iterator[TimeBlock]:
    """Yield the blocks of a scene in order of time, to its end or where its recording is cut.

    Speeds and loads start at zero (a shaft at rest, no load), and each effect adds its own. The
    values do not depend on the length of the blocks.

    Args:
        scene: The scene.
        block_length: Length of a block > 0 [s].
        run: A fresh run of it, whose effects and memories advance; by default one is built at the first
            block.

    Raises:
        SceneError: A speed or load leaves what the telemetry can carry, the lining cannot be followed, or a
            table cannot be read any more.
    """
    run = scene.build() if run is None else run
    finish = scene.duration if run.cut is None else run.cut
    last = math.ceil(finish / block_length) - 1
    for number in range(last + 1):
        start = number * block_length
        end = finish if number == last else (number + 1) * block_length
        signals = {c.topic: _measure_channel(scene, run, c, start, end) for c in scene.channels}
        block = TimeBlock(start, end, scene.duration, run.shaft, signals)
        for effect in run.effects:
            effect(block)
        yield block


def _measure_channel(scene: Scene, run: SceneRun, channel: Channel, start: float, end: float) -> Signal:
    """Return the signal of a channel from ``start`` to before ``end`` [s], before effects on sensors.

    The memory of its sensor advances.

    Raises:
        SceneError: A value is larger than the configuration allows.
    """
    span = telemetry.instant_numbers(channel.rate, start, end, scene.duration)
    numbers = np.array(span, np.int64)
    time = numbers / channel.rate
    stamp_ns = scene.start_ns + np.rint(numbers * (1e9 / channel.rate)).astype(np.int64)
    sensor = run.sensors.get(channel.topic)
    value = sensor.read(span) if sensor else run.shaft.value(channel.topic, time)
    _check_range(channel, time, value)
    arrival_ns = stamp_ns.copy() if channel.is_stamped else None
    return Signal(channel, time, stamp_ns, value, np.ones_like(numbers), arrival_ns)


def _check_range(channel: Channel, time: FloatArray, value: FloatArray) -> None:
    """Raise SceneError for a value whose size is above the configured maximum of one of the bearings.

    Args:
        channel: The channel; of a speed the surface speed of each bearing that reads it counts.
        time: Times, for the error, shape (n,) [s].
        value: Values in the units of :meth:`.Channel.factor`, of either sign, shape (n,); ``nan`` passes.
    """
    for bearing in channel.bearings:
        size = np.abs(value) * channel.speed_ratio(bearing.name)
        maximum = bearing.inputs[channel.quantity].maximum
        beyond = np.flatnonzero(size > maximum)
        if beyond.size:
            unit = {'speed': 'm/s', 'load': 'N'}.get(channel.quantity, 'C')
            raise SceneError(
                f'{channel.quantity} = {size[beyond[0]]:g} {unit} at {time[beyond[0]]:g} s is more'
                f' than topic {channel.topic} can carry: {bearing.name}.{channel.quantity}.maximum'
                f' = {maximum:g} {unit} in the configuration'
            )


_ENCODERS: Mapping[str, Callable[[Any], Iterable[bytes]]] = {
    BOOL: partial(map, encode_bool),
    FLOAT64: encode_float64s,
    STRING: partial(map, encode_string),
}


def write_bag(
    scene: Scene, path: str | Path, progress: Callable[[float], None] | None = None
) -> dict[str, int]:
    """Write a scene's telemetry and truth; the recording appears under its name when it is complete.

    A scene with the effect ``cut_off`` leaves an unfinished file, on purpose.

    Args:
        scene: The scene.
        path: A rosbag2 folder, or one file if the name ends in ``.mcap``.
        progress: Called with the seconds simulated so far after each block, unless ``None``.

    Returns:
        Number of messages written, by topic.

    Raises:
        BagError: The bag exists already or cannot be written.
        SceneError: A speed or load leaves what the telemetry can carry, the lining cannot be followed, or a
            table cannot be read any more.
    """
    run = scene.build()
    with BagWriter(path) as writer:
        for channel in scene.channels:
            writer.add_topic(channel.topic, channel.input.type)
        for block in simulate(scene, run=run):
            messages = {topic: _encode_signal(signal) for topic, signal in block.signals.items()}
            for column in block.truth:
                if block.start == 0.0:
                    writer.add_topic(column.topic, column.type)
                data = list(_ENCODERS[column.type](column.values))
                messages[column.topic] = column.stamps(scene.start_ns), data
            writer.write_columns((topic, *columns) for topic, columns in messages.items())
            if progress:
                progress(block.end)
        if run.cut is not None:
            writer.break_off()
        return writer.message_counts


def _encode_signal(signal: Signal) -> tuple[IntArray, list[bytes]]:
    """Return log times [ns] of the messages of a signal, shape (n,), and the messages encoded.

    Raises:
        BagError: A stamp is out of the range of a ROS header.
    """
    (log_time_ns, stamp_ns, raw), source = signal.messages(), signal.channel.input
    if stamp_ns is None:
        return log_time_ns, encode_float64s(raw)
    return log_time_ns, encode_stamped(source.type, '.'.join(map(str, source.field)), stamp_ns, raw)
