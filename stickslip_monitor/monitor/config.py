# SPDX-License-Identifier: Apache-2.0
"""The validated configuration: what the monitor is told about each bearing and its inputs."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

from stickslip_monitor.errors import ConfigurationError, PhysicsError, did_you_mean
from stickslip_monitor.fields import FieldPath, parse_field
from stickslip_monitor.monitor.calibration_file import (
    INPUT_KEYS,
    belief_of,
    load_calibration,
    require_same_sensors,
)
from stickslip_monitor.monitor.table import (
    BEARING_PARAMETERS,
    NODE_PARAMETERS,
    REQUIRED,
    TOLERANCES,
    Parameter,
)
from stickslip_monitor.physics.belief import EXACT, Belief, Tolerance
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing

_NAME = re.compile(r'[a-z][a-z0-9_]*')
_TOPIC = re.compile(r'(?:~?/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*')
_TYPE = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*')
_NEWTONS = {'N': 1.0, 'kN': 1000.0}
_LAW_NEEDS = {
    'stribeck': ('static', 'kinetic', 'decay'),
    'coulomb': ('static', 'kinetic'),
    'tabulated': ('speed', 'coefficient'),
}


def nanoseconds(seconds: float) -> int:
    """A duration of the configuration [s] as whole nanoseconds."""
    return round(seconds * 1e9)


@dataclass(frozen=True, slots=True)
class InputConfig:
    """Where one measured quantity comes from and how it becomes SI.

    ``SI value = factor * (scale * number + offset)``; magnitudes above ``maximum`` [SI] are not
    believed, and magnitudes below ``deadband`` [SI] count as zero.
    """

    topic: str
    type: str
    field: FieldPath
    field_text: str
    scale: float
    offset: float
    factor: float
    timeout_ns: int
    maximum: float
    deadband: float
    unit: str = ''


@dataclass(frozen=True, slots=True)
class LevelConfig(InputConfig):
    """Where the measured vibration comes from, and what tells it from quiet.

    Attributes:
        threshold: Level from which on it is vibration, in the unit; ``nan``: to be learned.
        hysteresis: How far below it the level must fall to be quiet [dB].
    """

    threshold: float = math.nan
    hysteresis: float = 3.0

    @property
    def learns(self) -> bool:
        """Whether the threshold is learned from the level itself."""
        return math.isnan(self.threshold)


@dataclass(frozen=True, slots=True)
class AlarmConfig:
    """Thresholds and delays of a bearing's alarm; meanings as in the parameter table."""

    caution_margin: float
    hysteresis: float
    amplitude_limit: float
    on_delay_ns: int
    off_delay_ns: int
    input_off_delay_ns: int = 0
    latch: bool = False
    startup_inhibit_ns: int = 0
    trend_window_ns: int = 0
    can_probability: float = 0.5
    runs_probability: float = 0.5
    caution_probability: float = 0.05
    onset_growth: float = 3.0
    look_ahead_ns: int = 20 * 10**9


@dataclass(frozen=True, slots=True)
class BearingConfig:
    """One monitored bearing."""

    name: str
    bearing: Bearing
    speed: InputConfig
    load: InputConfig
    alarm: AlarmConfig
    tolerance: Tolerance = EXACT
    belief: Belief | None = field(default=None, compare=False)
    level: LevelConfig | None = None

    @property
    def inputs(self) -> dict[str, InputConfig]:
        """The inputs that there are, by name: speed, load and, where measured, level."""
        found = {'speed': self.speed, 'load': self.load}
        return found if self.level is None else {**found, 'level': self.level}


@dataclass(frozen=True, slots=True)
class ClipConfig:
    """Where event clips go (empty: nowhere), how long, how many and how large [bytes] they are."""

    directory: str = ''
    around_ns: int = 60 * 10**9
    most: int = 50
    size: int = 5_000_000


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """Everything the monitor and its node are told."""

    bearings: tuple[BearingConfig, ...]
    autostart: bool = True
    publish_period: float = 0.0
    shelve_time_ns: int = 0
    silence_time_ns: int = 0
    state_file: str = ''
    clips: ClipConfig = ClipConfig()

    def bearing(self, name: str) -> BearingConfig:
        """The bearing of that name.

        Raises:
            ConfigurationError: There is none.
        """
        for candidate in self.bearings:
            if candidate.name == name:
                return candidate
        names = [bearing.name for bearing in self.bearings]
        hint = did_you_mean(name, names) or f'; there are: {", ".join(names)}'
        raise ConfigurationError(f"bearing '{name}' is not configured{hint}")


def build_config(values: Mapping[str, Any]) -> MonitorConfig:
    """Validate flat, dotted parameters and build the configuration.

    Args:
        values: Parameter values by full name, e.g. ``{'bearings': ['aft'], 'aft.mass': 50.0}``.

    Returns:
        The configuration.

    Raises:
        ConfigurationError: A value breaks its rule; the text names parameter, value and rule.
    """
    node = {p.name: checked(p, p.name, values) for p in NODE_PARAMETERS}
    names = bearing_names(values)
    _refuse_unknown(values, names)
    return MonitorConfig(
        bearings=tuple(_build_bearing(name, values) for name in names),
        autostart=node['autostart'],
        publish_period=node['publish_period'],
        shelve_time_ns=nanoseconds(node['shelve_time']),
        silence_time_ns=nanoseconds(node['silence_time']),
        state_file=node['state_file'],
        clips=ClipConfig(
            directory=node['clips.directory'],
            around_ns=nanoseconds(node['clips.around']),
            most=node['clips.most'],
            size=round(node['clips.size'] * 1e6),
        ),
    )


def bearing_names(values: Mapping[str, Any]) -> tuple[str, ...]:
    """The validated list ``bearings``."""
    names = tuple(checked(NODE_PARAMETERS[0], 'bearings', values))
    if not names:
        raise ConfigurationError('bearings = [] must name at least one bearing')
    for name in names:
        if not _NAME.fullmatch(name):
            raise ConfigurationError(
                f"bearings: '{name}' must be a name of lower-case letters, digits and underscores"
                ' that starts with a letter, because it becomes part of topic names'
            )
        if names.count(name) > 1:
            raise ConfigurationError(f"bearings: '{name}' is listed twice; names must differ")
    return names


def parameters_of(names: tuple[str, ...]) -> dict[str, Parameter]:
    """The table's row for every full parameter name of these bearings."""
    rows = {p.name: p for p in NODE_PARAMETERS}
    rows.update({f'{name}.{p.name}': p for name in names for p in BEARING_PARAMETERS})
    return rows


def _refuse_unknown(values: Mapping[str, Any], names: tuple[str, ...]) -> None:
    known = parameters_of(names)
    for key in values:
        if key in known:
            continue
        head = key.split('.', 1)[0]
        if '.' in key and head not in names:
            raise ConfigurationError(
                f"section '{head}' is not a bearing: add it to bearings, which lists"
                f' {", ".join(names)}'
            )
        hint = did_you_mean(key, known)
        raise ConfigurationError(f"unknown parameter '{key}' = {values[key]!r}{hint}")


def checked(parameter: Parameter, name: str, values: Mapping[str, Any]) -> Any:
    """The value of one parameter, checked against its row of the table.

    Raises:
        ConfigurationError: It is missing, of the wrong type, or breaks its rule.
    """
    if name not in values:
        if parameter.default is REQUIRED:
            unit = f' [{parameter.unit}]' if parameter.unit else ''
            raise ConfigurationError(f"parameter '{name}'{unit} is missing: {parameter.text}")
        return parameter.default
    value = values[name]
    if not _fits(parameter, value):
        raise ConfigurationError(f'{name} = {value!r} must be {parameter.rule()}')
    if parameter.kind == 'float':
        return float(value)
    if parameter.kind == 'float[]':
        return tuple(float(item) for item in value)
    return value


def _fits(parameter: Parameter, value: Any) -> bool:
    kind = parameter.kind
    if kind.endswith('[]'):
        return not isinstance(value, str | bytes) and (
            hasattr(value, '__iter__') and all(_fits_one(parameter, kind[:-2], v) for v in value)
        )
    return _fits_one(parameter, kind, value)


def _fits_one(parameter: Parameter, kind: str, value: Any) -> bool:
    if kind == 'bool':
        return isinstance(value, bool)
    if kind == 'int':
        whole = isinstance(value, int) and not isinstance(value, bool)
        return whole and parameter.minimum <= value <= parameter.maximum
    if kind == 'str':
        return isinstance(value, str) and (not parameter.choices or value in parameter.choices)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        value = float(value)
    except OverflowError:
        return False
    low = value > parameter.minimum if parameter.above_minimum else value >= parameter.minimum
    bounded = math.isfinite(value) or parameter.default == math.inf
    return low and value <= parameter.maximum and bounded


def _build_bearing(name: str, values: Mapping[str, Any]) -> BearingConfig:
    own = {p.name: checked(p, f'{name}.{p.name}', values) for p in BEARING_PARAMETERS}
    try:
        bearing = Bearing(
            mass=own['mass'],
            damping=own['damping'],
            stiffness=own['stiffness'],
            friction=_friction(name, own),
            journal_diameter=own['journal_diameter'],
        )
    except PhysicsError as error:
        raise ConfigurationError(f'{name}: {error}') from error
    bearing, belief = _believed(name, bearing, own)
    minimum_speed = own['alarm.minimum_speed']
    if minimum_speed >= own['speed.maximum']:
        raise ConfigurationError(
            f'{name}.alarm.minimum_speed = {minimum_speed:g} m/s must be below'
            f' {name}.speed.maximum = {own["speed.maximum"]:g} m/s'
        )
    speed = _input(name, 'speed', own, bearing.speed.factor(own['speed.unit']), minimum_speed)
    load = _input(name, 'load', own, _NEWTONS[own['load.unit']], 0.0)
    return BearingConfig(
        name=name,
        bearing=bearing,
        speed=speed,
        load=load,
        level=_level(name, own, (speed, load)),
        alarm=AlarmConfig(
            caution_margin=own['alarm.caution_margin'],
            can_probability=own['alarm.can_probability'],
            runs_probability=own['alarm.runs_probability'],
            caution_probability=own['alarm.caution_probability'],
            hysteresis=own['alarm.hysteresis'],
            amplitude_limit=own['alarm.amplitude_limit'],
            on_delay_ns=nanoseconds(own['alarm.on_delay']),
            off_delay_ns=nanoseconds(own['alarm.off_delay']),
            input_off_delay_ns=nanoseconds(own['alarm.input_off_delay']),
            latch=own['alarm.latch'],
            startup_inhibit_ns=nanoseconds(own['alarm.startup_inhibit']),
            trend_window_ns=nanoseconds(own['alarm.trend_window']),
            onset_growth=own['alarm.onset_growth'],
            look_ahead_ns=nanoseconds(own['alarm.look_ahead']),
        ),
        tolerance=_tolerance(own),
        belief=belief,
    )


def _believed(
    name: str, bearing: Bearing, own: Mapping[str, Any]
) -> tuple[Bearing, Belief | None]:
    """What is believed of the boundaries, and the bearing in the middle of that.

    The belief is ``None`` where all is taken for exact.
    """
    tolerance = _tolerance(own)
    path = own['calibration']
    try:
        if path:
            document = load_calibration(path)
            inputs = {
                quantity: {key: own[f'{quantity}.{key}'] for key in INPUT_KEYS}
                for quantity in ('speed', 'load')
            }
            require_same_sensors(path, document, name, inputs)
            belief = belief_of(path, document, tolerance)
            return belief.nominal(bearing), belief
        if tolerance.is_exact:
            return bearing, None
        return bearing, _of_tolerance(bearing, tolerance)
    except PhysicsError as error:
        raise ConfigurationError(f'{name}: {error}') from error


def _tolerance(own: Mapping[str, Any]) -> Tolerance:
    return Tolerance(**{item: own[f'tolerance.{item}'] for item, _ in TOLERANCES})


# A live parameter that changes makes the whole configuration anew.
_of_tolerance = lru_cache(maxsize=16)(Belief.from_tolerance)


def _friction(name: str, own: Mapping[str, Any]) -> FrictionLaw:
    law = own['friction.law']
    for quantity in _LAW_NEEDS[law]:
        value = own[f'friction.{quantity}']
        if value == () or (isinstance(value, float) and math.isnan(value)):
            raise ConfigurationError(
                f"parameter '{name}.friction.{quantity}' is missing: the law {law} needs"
                f' {", ".join(_LAW_NEEDS[law])}'
            )
    if law == 'tabulated':
        return Tabulated(own['friction.speed'], own['friction.coefficient'])
    if law == 'coulomb':
        return Coulomb(own['friction.static'], own['friction.kinetic'])
    return Stribeck(
        own['friction.static'],
        own['friction.kinetic'],
        own['friction.decay'],
        own['friction.viscous'],
    )


def _input(
    name: str, quantity: str, own: Mapping[str, Any], factor: float, deadband: float
) -> InputConfig:
    topic, type_name = own[f'{quantity}.topic'], own[f'{quantity}.type']
    if not _TOPIC.fullmatch(topic):
        raise ConfigurationError(f'{name}.{quantity}.topic = {topic!r} must be a ROS topic name')
    if not _TYPE.fullmatch(type_name):
        raise ConfigurationError(
            f'{name}.{quantity}.type = {type_name!r} must be written package/msg/Type, e.g.'
            ' std_msgs/msg/Float64'
        )
    text = own[f'{quantity}.field']
    try:
        path = parse_field(text)
    except ConfigurationError as error:
        raise ConfigurationError(f'{name}.{quantity}.field: {error}') from error
    return InputConfig(
        topic=topic,
        type=type_name,
        field=path,
        field_text=text,
        scale=own[f'{quantity}.scale'],
        offset=own[f'{quantity}.offset'],
        factor=factor,
        timeout_ns=nanoseconds(own[f'{quantity}.timeout']),
        maximum=own[f'{quantity}.maximum'],
        deadband=deadband,
        unit=own[f'{quantity}.unit'],
    )


def _level(
    name: str, own: Mapping[str, Any], others: tuple[InputConfig, ...]
) -> LevelConfig | None:
    """The input of measured vibration; ``None`` where there is none."""
    if not own['level.topic']:
        _require_no_level(name, own)
        return None
    base = _input(name, 'level', own, 1.0, 0.0)
    level = LevelConfig(
        **{item.name: getattr(base, item.name) for item in fields(InputConfig)},
        threshold=own['level.threshold'],
        hysteresis=own['level.hysteresis'],
    )
    _check_threshold(name, level)
    for quantity, other in zip(('speed', 'load'), others, strict=True):
        if level.topic != other.topic:
            continue
        if level.field == other.field:
            raise ConfigurationError(
                f'{name}.level is read from the same field as the {quantity},'
                f' {level.topic} {level.field_text}: it must be a number of its own'
            )
        if level.type != other.type:
            raise ConfigurationError(
                f'{name}.level.type = {level.type!r} must be that of {name}.{quantity},'
                f' {other.type!r}: both are read from {level.topic}'
            )
    return level


def _require_no_level(name: str, own: Mapping[str, Any]) -> None:
    for row in BEARING_PARAMETERS:
        value = own[row.name]
        if row.name.startswith('level.') and value != row.default and value == value:
            raise ConfigurationError(
                f"parameter '{name}.level.topic' is missing, and {name}.{row.name} = {value!r} is"
                ' given: name the topic of the measured vibration'
            )


def _check_threshold(name: str, level: LevelConfig) -> None:
    threshold, in_db = level.threshold, level.unit == 'dB'
    if threshold <= 0.0 and not in_db:
        raise ConfigurationError(
            f'{name}.level.threshold = {threshold:g} {level.unit} must be above 0, as every RMS'
            ' value is; for a level in decibels set level.unit to dB'
        )
    if abs(threshold) > level.maximum:
        raise ConfigurationError(
            f'{name}.level.threshold = {threshold:g} {level.unit} must not be above'
            f' {name}.level.maximum = {level.maximum:g} {level.unit}: no value beyond is believed'
        )
