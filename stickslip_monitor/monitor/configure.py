# SPDX-License-Identifier: Apache-2.0
"""Makes the configuration of flat parameters, and checks the rules that span several of them.

The result of a calibration is read, and refused where the sensors have changed since.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.errors import ConfigurationError, PhysicsError, did_you_mean
from stickslip_monitor.fields import FieldPath, parse_field
from stickslip_monitor.files import read_json
from stickslip_monitor.monitor import config
from stickslip_monitor.monitor.parameter import REQUIRED, filled
from stickslip_monitor.monitor.questions import note_on_table
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import LAWS, FrictionLaw
from stickslip_monitor.physics.probability import Belief, Tolerance

CALIBRATION_SCHEMA = 'stickslip_monitor/calibration/2'
_LAST_SCHEMA = 'stickslip_monitor/calibration/1'
LARGEST_JSON = 64 << 20
"""The largest file of a result that is read [bytes]; a year of dips is a tenth of it."""
INPUT_KEYS = ('topic', 'field', 'scale', 'offset', 'unit')
MOST_DAMPED = 3.0
"""A lining with more damping than so many times the critical one is refused: it has no vibration
to predict, and the search for one takes minutes."""
_LARGEST_VARIANCE = 100.0


def load_calibration(path: str | Path) -> dict[str, Any]:
    """The JSON object of a calibration.

    Raises:
        ConfigurationError: The file cannot be read or is none; the text names it.
    """
    try:
        document = read_json(path, LARGEST_JSON)
    except OSError as error:
        raise ConfigurationError(f'{path}: {error.strerror or error}') from error
    except ValueError as error:
        raise ConfigurationError(f'{path} is not JSON: {error}') from error
    schema = document.get('schema') if isinstance(document, dict) else None
    if schema == _LAST_SCHEMA:
        raise ConfigurationError(
            f'{path} was made by an earlier version, which weighed its evidence by another model:'
            " take out the parameter 'calibration', and make it anew from the same recordings"
            f' with `stickslip calibrate BAG... --config FILE --output {path}`'
        )
    if schema != CALIBRATION_SCHEMA:
        raise ConfigurationError(
            f'{path} has the schema {schema!r} and must have {CALIBRATION_SCHEMA!r}: make it with'
            ' stickslip calibrate'
        )
    assert isinstance(document, dict)
    return document


def require_same_sensors(
    path: str | Path, document: Mapping[str, Any], bearing: str, inputs: Mapping[str, Any]
) -> None:
    """Refuse a calibration of another bearing, or one with other sensors.

    Args:
        path: The file, for the sentence.
        document: From :func:`load_calibration`.
        bearing: Name of the bearing.
        inputs: What :data:`INPUT_KEYS` are now, by quantity.

    Raises:
        ConfigurationError: Something differs; the text says what.
    """
    if document.get('bearing') != bearing:
        raise ConfigurationError(
            f"{path} is a calibration of '{document.get('bearing')}' and not of '{bearing}'"
        )
    past = document.get('inputs')
    for quantity, now in inputs.items():
        then = past.get(quantity) if isinstance(past, dict) else None
        if not isinstance(then, dict):
            raise ConfigurationError(f'{path} is damaged: it does not name its sensors')
        for key in INPUT_KEYS:
            if then.get(key) != now[key]:
                raise ConfigurationError(
                    f'{path} was made with {quantity}.{key} = {then.get(key)!r}, and it is'
                    f' {now[key]!r} now: a calibration holds for its own sensors only, so'
                    ' calibrate anew'
                )


def belief_of(
    path: str | Path, document: Mapping[str, Any], bearing: Bearing, tolerance: Tolerance
) -> Belief:
    """The bearing that a calibration has found, with its uncertainty.

    Args:
        path: The file, for the sentence.
        document: From :func:`load_calibration`.
        bearing: The bearing that is configured: its mass, stiffness and diameter are used.
        tolerance: What is uncertain of the sensors besides.

    Raises:
        ConfigurationError: The object is incomplete.
    """
    try:
        own = document['parameters']
        make, names = LAWS[own['friction.law']]
        given = {name: own[f'friction.{name}'] for name in names if f'friction.{name}' in own}
        found = replace(bearing, damping=float(own['damping']), friction=make(**given))
        covariance = np.array(document['covariance'], dtype=float)
        np.linalg.cholesky(covariance)
        low, high = (float(load) for load in document['loads'])
        floor = float(document['floor'])
    except (
        KeyError,
        IndexError,
        TypeError,
        ValueError,
        OverflowError,
        PhysicsError,
        np.linalg.LinAlgError,
    ) as error:
        raise ConfigurationError(f'{path} is damaged: {error!r}') from error
    sound = covariance.shape == (2, 2) and bool((np.abs(covariance) < _LARGEST_VARIANCE).all())
    if not (sound and 0.0 < low <= high < math.inf and 0.0 <= floor <= 1.0):
        raise ConfigurationError(
            f'{path} is damaged: its covariance, loads and floor must be finite numbers, loads'
            ' above 0 and rising'
        )
    speed = math.hypot(floor, tolerance.speed, tolerance.scatter)
    return Belief(found, covariance, speed, tolerance.load, (low, high), True)


_NAME = re.compile(r'[a-z][a-z0-9_]*')
_TOPIC = re.compile(r'(?:~?/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*')
_TYPE = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*')
_NEWTONS = {'N': 1.0, 'kN': 1000.0}


def check_topic(whose: str, topic: str) -> None:
    """Refuse what is no name of a topic.

    Raises:
        ConfigurationError: It is none; the text names it after ``whose``.
    """
    if not _TOPIC.fullmatch(topic):
        raise ConfigurationError(f'{whose} {topic!r} must be a ROS topic name')


def build_config(values: Mapping[str, Any]) -> config.MonitorConfig:
    """Validate flat, dotted parameters and build the configuration.

    Args:
        values: Parameter values by full name, e.g. ``{'bearings': ['aft'], 'aft.mass': 50.0}``.

    Returns:
        The configuration.

    Raises:
        ConfigurationError: A value breaks its rule; the text names parameter, value and rule.
    """
    node = {row.name: row.checked(row.name, values) for row in config.NODE_PARAMETERS}
    names = bearing_names(values)
    notes = list(_notes(values, names))
    bearings = tuple(_build_bearing(name, values) for name in names)
    tables = ((each.name, note_on_table(each.bearing)) for each in bearings)
    notes += [f'{name}: {note}' for name, note in tables if note]
    return filled(
        config.MonitorConfig,
        '',
        node,
        bearings=bearings,
        clips=filled(config.ClipConfig, 'clips.', node),
        notes=tuple(notes),
    )


def bearing_names(values: Mapping[str, Any]) -> tuple[str, ...]:
    """The validated list ``bearings``."""
    names: tuple[str, ...] = config.BEARINGS.checked('bearings', values)
    if not names:
        raise ConfigurationError('bearings = [] must name at least one bearing')
    for name in names:
        if not _NAME.fullmatch(name):
            raise ConfigurationError(
                f'bearings: {name!r} must be a name of lower-case letters, digits and underscores'
                ' that starts with a letter, because it becomes part of topic names'
            )
        if names.count(name) > 1:
            raise ConfigurationError(f"bearings: '{name}' is listed twice; names must differ")
    return names


def _notes(values: Mapping[str, Any], names: tuple[str, ...]) -> tuple[str, ...]:
    """A sentence on each retired parameter; what is not known at all is refused."""
    known = config.parameters_of(names)
    retired = {f'{name}.{own}': why for name in names for own, why in config.RETIRED.items()}
    for key in values:
        if key in known or key in retired:
            continue
        head = key.split('.', 1)[0]
        if '.' in key and head not in names:
            raise ConfigurationError(
                f"section '{head}' is not a bearing: add it to bearings, which lists {', '.join(names)}"
            )
        hint = did_you_mean(key, known)
        raise ConfigurationError(f"unknown parameter '{key}' = {values[key]!r}{hint}")
    return tuple(
        f'{key} has no effect and will be refused by the next version: {why}'
        for key, why in retired.items()
        if key in values
    )


def _at_surface(name: str, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """The parameters with mass, damping and stiffness, where torsional values are given."""
    rows = {row.name: row for row in config.LINING_PARAMETERS}
    given = [row for row in config.TORSIONAL_PARAMETERS.values() if f'{name}.{row.name}' in values]
    if not given:
        return values
    torsional_names = ', '.join(each.name for each in config.TORSIONAL_PARAMETERS.values())
    diameter = rows['journal_diameter'].checked(f'{name}.journal_diameter', values)
    found = dict(values)
    for key, row in config.TORSIONAL_PARAMETERS.items():
        if f'{name}.{key}' in values:
            raise ConfigurationError(
                f"'{name}.{key}' and '{name}.{given[0].name}' are given: give mass, damping and"
                f' stiffness, or {torsional_names}'
            )
        torsional = replace(row, default=REQUIRED).checked(f'{name}.{row.name}', values)
        found[f'{name}.{key}'] = torsional / (0.25 * diameter * diameter)
    return found


def _build_bearing(name: str, values: Mapping[str, Any]) -> config.BearingConfig:
    values = _at_surface(name, values)
    own = {row.name: row.checked(f'{name}.{row.name}', values) for row in config.BEARING_PARAMETERS}
    try:
        bearing = Bearing(
            **{row.name: own[row.name] for row in config.LINING_PARAMETERS}, friction=_friction(name, own)
        )
    except PhysicsError as error:
        raise ConfigurationError(f'{name}: {error}') from error
    critical = 2.0 * math.sqrt(bearing.stiffness * bearing.mass)
    if bearing.damping > MOST_DAMPED * critical:
        raise ConfigurationError(
            f'{name}.damping = {bearing.damping:g} N s/m must not be above'
            f' {MOST_DAMPED * critical:.4g} N s/m, which is {MOST_DAMPED:g} times critical with'
            ' this mass and stiffness: such a lining cannot vibrate; look at their units'
        )
    tolerance = Tolerance(
        **{key.removeprefix('tolerance.'): own[key] for key in own if key.startswith('tolerance.')}
    )
    bearing, belief = _believed(name, bearing, own, tolerance)
    alarm = filled(config.AlarmConfig, 'alarm.', own)
    if math.isnan(own['speed.maximum']):
        fastest = config.FASTEST_RPM * float(bearing.speed.factor('rpm'))
        own['speed.maximum'] = min(config.FASTEST, fastest)
    if alarm.minimum_speed >= own['speed.maximum']:
        raise ConfigurationError(
            f'{name}.alarm.minimum_speed = {alarm.minimum_speed:g} m/s must be below'
            f' {name}.speed.maximum = {own["speed.maximum"]:g} m/s'
        )
    factor = bearing.speed.factor(own['speed.unit'])
    speed = _input(config.InputConfig, name, 'speed', own, factor, alarm.minimum_speed)
    load = _load(name, own, speed)
    if not load.is_assumed and speed.topic and speed.topic == load.topic:
        _require_other_field(name, 'load', load, 'speed', speed)
    level = _level(name, own, speed, load)
    return config.BearingConfig(name, bearing, speed, load, alarm, tolerance, belief, level)


def _believed(
    name: str, bearing: Bearing, own: Mapping[str, Any], tolerance: Tolerance
) -> tuple[Bearing, Belief | None]:
    """How uncertain the boundaries are, and the bearing in the middle of that.

    The belief is ``None`` where all is taken for exact.
    """
    path = own['calibration']
    if not path and tolerance.is_exact:
        return bearing, None
    try:
        if not path:
            return bearing, _of_tolerance(bearing, tolerance)
        document = load_calibration(path)
        sensors = {name: {key: own[f'{name}.{key}'] for key in INPUT_KEYS} for name in ('speed', 'load')}
        require_same_sensors(path, document, name, sensors)
        belief = belief_of(path, document, bearing, tolerance)
        return belief.bearing, belief
    except PhysicsError as error:
        raise ConfigurationError(f'{name}: {error}') from error


# A live parameter that changes makes the whole configuration anew.
_of_tolerance = lru_cache(maxsize=16)(Belief.from_tolerance)


def _friction(name: str, own: Mapping[str, Any]) -> FrictionLaw:
    make, names = LAWS[own['friction.law']]
    optional = {row.name for row in config.FRICTION_PARAMETERS if row.optional}
    needed = [key for key in names if f'friction.{key}' in optional]
    for key in needed:
        value = own[f'friction.{key}']
        if value == () or value != value:
            raise ConfigurationError(
                f"parameter '{name}.friction.{key}' is missing: the law"
                f' {own["friction.law"]} needs {", ".join(needed)}'
            )
    law: FrictionLaw = make(*(own[f'friction.{key}'] for key in names))
    return law


def _load(name: str, own: Mapping[str, Any], speed: config.InputConfig) -> config.LoadConfig:
    """The input of the load, or the constant that stands for it, which comes with the speed."""
    constant, factor = own['load.constant'], _NEWTONS[own['load.unit']]
    if math.isnan(constant):
        load: config.LoadConfig = _input(config.LoadConfig, name, 'load', own, factor)
        return load
    for key in ('topic', 'column'):
        if own[f'load.{key}']:
            raise ConfigurationError(
                f'{name}.load.constant = {constant:g} and {name}.load.{key} ='
                f' {own[f"load.{key}"]!r} are both given: the load is measured, or assumed'
            )
    if not 0.0 < constant * factor <= own['load.maximum']:
        raise ConfigurationError(
            f'{name}.load.constant = {constant:g} {own["load.unit"]} must be above 0 and not above'
            f' {name}.load.maximum = {own["load.maximum"]:g} N'
        )
    beside = {
        'load.topic': speed.topic,
        'load.type': speed.type,
        'load.field': speed.field_text,
        'load.column': speed.column,
        'load.scale': 0.0,
        'load.offset': constant,
    }
    values = {**own, **beside, 'load.timeout': own['speed.timeout']}
    return filled(config.LoadConfig, 'load.', values, field=speed.field, factor=factor)


def _input(
    kind: type[Any], name: str, quantity: str, own: Mapping[str, Any], factor: float, deadband: float = 0.0
) -> Any:
    """The configuration of one input, of that dataclass."""
    topic, type_name = own[f'{quantity}.topic'], own[f'{quantity}.type']
    if not topic and not own[f'{quantity}.column']:
        remedy = f', or {name}.load.constant for one that is assumed' if quantity == 'load' else ''
        raise ConfigurationError(
            f"parameter '{name}.{quantity}.topic' is missing: give the topic that carries the"
            f' {quantity}, {name}.{quantity}.column for a log{remedy}'
        )
    if topic:
        check_topic(f'{name}.{quantity}.topic =', topic)
    if not _TYPE.fullmatch(type_name):
        raise ConfigurationError(
            f'{name}.{quantity}.type = {type_name!r} must be written package/msg/Type, e.g.'
            ' std_msgs/msg/Float64'
        )
    try:
        path: FieldPath = parse_field(own[f'{quantity}.field'])
    except ConfigurationError as error:
        raise ConfigurationError(f'{name}.{quantity}.field: {error}') from error
    return filled(kind, f'{quantity}.', own, field=path, factor=factor, deadband=deadband)


def _require_other_field(
    name: str, quantity: str, source: config.InputConfig, beside: str, other: config.InputConfig
) -> None:
    if source.field == other.field:
        raise ConfigurationError(
            f'{name}.{quantity} is read from the same field as the {beside},'
            f' {source.topic} {source.field_text}: it must be a number of its own'
        )


def _level(name: str, own: Mapping[str, Any], *others: config.InputConfig) -> config.LevelConfig | None:
    """The input of measured vibration; ``None`` where there is none."""
    if not own['level.topic'] and not own['level.column']:
        for row in config.INPUT_PARAMETERS['level']:
            value = own[row.name]
            if value != row.default and value == value:
                raise ConfigurationError(
                    f"parameter '{name}.level.topic' is missing, and {name}.{row.name} ="
                    f' {value!r} is given: name the topic of the measured vibration'
                )
        return None
    level: config.LevelConfig = _input(config.LevelConfig, name, 'level', own, 1.0)
    threshold, unit = level.threshold, level.unit
    if threshold <= 0.0 and unit != 'dB':
        raise ConfigurationError(
            f'{name}.level.threshold = {threshold:g} {unit} must be above 0, as every RMS'
            ' value is; for a level in decibels set level.unit to dB'
        )
    if abs(threshold) > level.maximum:
        raise ConfigurationError(
            f'{name}.level.threshold = {threshold:g} {unit} must not be above'
            f' {name}.level.maximum = {level.maximum:g} {unit}: a value beyond is invalid'
        )
    for quantity, other in zip(('speed', 'load'), others, strict=True):
        if level.topic != other.topic or not level.topic:
            continue
        _require_other_field(name, 'level', level, quantity, other)
        if level.type != other.type:
            raise ConfigurationError(
                f'{name}.level.type = {level.type!r} must be that of {name}.{quantity},'
                f' {other.type!r}: both are read from {level.topic}'
            )
    return level
