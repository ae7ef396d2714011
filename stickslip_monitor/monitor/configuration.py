# SPDX-License-Identifier: Apache-2.0
"""Builds the configuration from flat parameters, and checks what spans several of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar

from stickslip_logs.field_paths import FieldPath, parse_field
from stickslip_monitor.errors import ConfigurationError, FieldError, PhysicsError, did_you_mean
from stickslip_monitor.monitor import parameters
from stickslip_monitor.monitor.calibration_file import UnusableCalibration, read_calibration
from stickslip_monitor.monitor.config_questions import note_on_table
from stickslip_monitor.monitor.parameters import (
    MAX_LOAD_POINTS,
    BearingConfig,
    InputConfig,
    LoadConfig,
    MonitorConfig,
    SpeedConfig,
    build_section,
)
from stickslip_monitor.monitor.value_check import REQUIRED, refused
from stickslip_monitor.physics.bearing import TURNING_UNITS, Bearing
from stickslip_monitor.physics.friction import LAWS, FrictionLaw
from stickslip_monitor.physics.lubrication import Lubrication
from stickslip_monitor.physics.probability import Belief, Tolerance

QOS_OVERRIDES = 'qos_overrides'
"""Section of a parameter file with the quality of service of topics, which ROS 2 reads."""
_NAME = re.compile(r'[a-z][a-z0-9_]*')
_WHERE = '.where.'
_TOPIC = re.compile(r'(?:~?/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*')
_TYPE = re.compile(r'[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*')
_Input = TypeVar('_Input', bound=InputConfig)


def check_topic(whose: str, topic: str) -> None:
    """Check that a text is a name of a ROS topic.

    Raises:
        ConfigurationError: It is not; the text begins with ``whose``.
    """
    if not _TOPIC.fullmatch(topic):
        raise refused(whose, topic, 'a ROS topic name')


def build_config(values: Mapping[str, Any], *, is_live: bool = False) -> MonitorConfig:
    """Validate flat, dotted parameters and build the configuration; files of calibrations are read.

    Args:
        values: Parameter values by full name, e.g. ``{'bearings': ['aft'], 'aft.mass': 50.0}``.
        is_live: Whether a ship is to be monitored now, if need be without a calibration that is missing,
            damaged or of another version; the ``faults`` of the configuration name it.

    Returns:
        The configuration.

    Raises:
        ConfigurationError: A parameter is unknown or missing, or breaks its rule; the text names parameter,
            value and rule.

    >>> lining = {'mass': 50.0, 'damping': 400.0, 'stiffness': 2.0e6, 'journal_diameter': 0.1}
    >>> law = {'friction.static': 0.3, 'friction.kinetic': 0.1, 'friction.decay': 10.0}
    >>> inputs = {'speed.topic': '/rpm', 'speed.unit': 'rpm', 'load.topic': '/load', 'load.unit': 'kN'}
    >>> own = {f'aft.{name}': value for name, value in (lining | law | inputs).items()}
    >>> config = build_config({'bearings': ['aft']} | own)
    >>> config.bearing('aft').alarm.caution_margin
    0.2
    >>> build_config({'bearings': ['aft']} | own | {'aft.mass': -1.0})
    Traceback (most recent call last):
    stickslip_monitor.errors.ConfigurationError: aft.mass = -1.0 must be a finite number ... kg
    """
    values = _join_where_pairs(values)
    node = {row.name: row.checked(row.name, values) for row in parameters.NODE_PARAMETERS}
    names = bearing_names(values)
    notes = _check_names(values, names)
    sections = [_Section(name, values, is_live=is_live) for name in names]
    bearings = tuple(section.build() for section in sections)
    notes += [note for s, bearing in zip(sections, bearings, strict=True) for note in s.find_unused(bearing)]
    notes += [
        f'{item_config.name}: {note}'
        for item_config in bearings
        if (note := note_on_table(item_config.bearing))
    ]
    clips = build_section(parameters.ClipConfig, 'clips.', node)
    faults = tuple(section.fault for section in sections if section.fault)
    return build_section(
        MonitorConfig, '', node, bearings=bearings, clips=clips, notes=tuple(notes), faults=faults
    )


def _join_where_pairs(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters with all ``where.COLUMN: TEXT`` of an input joined to one list of pairs.

    Raises:
        ConfigurationError: A text is missing: the value is a list, a switch or none.
    """
    joined = {key: value for key, value in values.items() if _WHERE not in key}
    for key in (key for key in values if _WHERE in key):
        (name, _, column), text = key.partition(_WHERE), values[key]
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise refused(key, text, 'the text of a column, in quotation marks if need be')
        pairs = joined.setdefault(f'{name}{_WHERE[:-1]}', [])
        joined[f'{name}{_WHERE[:-1]}'] = [*pairs, column, str(text)]
    return joined


def bearing_names(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the checked list ``bearings`` of the parameters, in its order.

    Raises:
        ConfigurationError: It is missing or empty, or a name is invalid or given twice.
    """
    names: tuple[str, ...] = parameters.BEARINGS.checked('bearings', values)
    if not names:
        raise refused('bearings', [], 'one or more names of bearings')
    for name in names:
        if not _NAME.fullmatch(name):
            rule = 'a name of lower-case letters, digits and underscores that starts with a letter'
            raise refused('bearings', name, f'{rule}, because it becomes part of topic names')
        if names.count(name) > 1:
            raise ConfigurationError(f"bearings: '{name}' is listed twice; names must differ")
    return names


def _check_names(values: Mapping[str, Any], names: tuple[str, ...]) -> list[str]:
    """Check that all parameters are known; return a sentence on each retired one, which has no effect.

    Raises:
        ConfigurationError: A parameter or section is unknown; the text suggests a near name.
    """
    allowed, notes = parameters.parameters_of(names), []
    for key in (name for name in values if name not in allowed):
        head, _, parameter = key.partition('.')
        members = [name for name in allowed if name.startswith(f'{head}.')]
        if parameter and head not in names and not members:
            near = did_you_mean(head, [*names, QOS_OVERRIDES])
            raise ConfigurationError(
                f"section '{head}' is not a bearing: add it to bearings, which lists {', '.join(names)}{near}"
            )
        if parameter not in parameters.RETIRED:
            # Of the few of the node's own sections all are named.
            listed = f'; {head} has {", ".join(members)}' if members and head not in names else ''
            hint = did_you_mean(key, allowed) or listed
            raise ConfigurationError(f"unknown parameter '{key}' = {values[key]!r}{hint}")
        why = parameters.RETIRED[parameter]
        notes.append(f'{key} has no effect and will be refused in a later version: {why}')
    return notes


def _convert_torsional(name: str, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return parameters, by full name, with mass, damping and stiffness of a bearing from torsional values.

    These are added, and the torsional ones stay. Each torsional value is divided by the square of the
    journal's radius. Without any the parameters come back as they are; with one all three are required.

    Raises:
        ConfigurationError: One, or the diameter, is missing or invalid, or mass, damping or stiffness is
            given beside them.
    """
    rows = {row.name: row for row in parameters.LINING_PARAMETERS}
    given = [row for row in parameters.TORSIONAL_PARAMETERS.values() if f'{name}.{row.name}' in values]
    if not given:
        return values
    torsional_names = ', '.join(row.name for row in parameters.TORSIONAL_PARAMETERS.values())
    diameter = rows['journal_diameter'].checked(f'{name}.journal_diameter', values)
    converted = dict(values)
    for key, row in parameters.TORSIONAL_PARAMETERS.items():
        if f'{name}.{key}' in values:
            raise ConfigurationError(
                f"'{name}.{key}' and '{name}.{given[0].name}' are given: give mass, damping and"
                f' stiffness, or {torsional_names}'
            )
        torsional = replace(row, default=REQUIRED).checked(f'{name}.{row.name}', values)
        converted[f'{name}.{key}'] = torsional / (0.25 * diameter * diameter)
    return converted


def _in_any_water(bearing: Bearing) -> Bearing:
    """Return the bearing with the temperature unknown (``nan``) and a viscosity ratio of 1.

    One belief then serves water of any temperature. A bearing without lubrication comes back as it is.
    """
    lubrication = bearing.lubrication
    if lubrication is None:
        return bearing
    return replace(bearing, lubrication=replace(lubrication, viscosity_ratio=1.0, water_temperature=math.nan))


# A live parameter that changes makes the whole configuration anew.
_make_belief = lru_cache(maxsize=16)(Belief.from_tolerance)


def split_load_table(name: str, numbers: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
    """Split a table of the load, given as one flat list of pairs, into speeds and loads in their own units.

    Raises:
        ConfigurationError: There are fewer than 2 or more than 16 pairs, or the speeds do not rise; the text
            begins with the name.
    """
    speeds, loads = numbers[::2], numbers[1::2]
    rises = all(low < high for low, high in pairwise(speeds))
    if 2 <= len(speeds) <= MAX_LOAD_POINTS and rises:
        return speeds, loads
    pairs = [list(pair) for pair in zip(speeds, loads, strict=True)]
    raise refused(
        name,
        pairs,
        f'2 to {MAX_LOAD_POINTS} pairs of a shaft speed in rpm and the load there, speeds rising, as in'
        ' [[0, 32], [60, 28], [120, 19]]',
    )


def _is_left_out(value: object) -> bool:
    """Return whether an optional value is not given: ``nan`` or an empty tuple."""
    return bool(value == () or value != value)


class _Section:
    """The parameters of one bearing, each checked by itself.

    Attributes:
        fault: Why its calibration is not used, where it could not be read while live; empty otherwise.

    Args:
        name: Name of the bearing.
        values: Parameter values by full name, with the name before each.
        is_live: Whether a ship is to be monitored now.

    Raises:
        ConfigurationError: A value breaks its rule.
    """

    def __init__(self, name: str, values: Mapping[str, Any], *, is_live: bool) -> None:
        self.fault, self._is_live = '', is_live
        values, rows = _convert_torsional(name, values), parameters.BEARING_PARAMETERS
        self.name, self._own = name, {row.name: row.checked(f'{name}.{row.name}', values) for row in rows}

    def _text_of(self, key: str, unit: str = '') -> str:
        """Return a parameter as ``aft.mass = 50 kg``, as refusals name it; only a float has a unit."""
        value = self._own[key]
        text = f'{value:g} {unit}'.rstrip() if isinstance(value, float) else repr(value)
        return f'{self.name}.{key} = {text}'

    def build(self) -> BearingConfig:
        """Build the configuration of the bearing; set ``fault`` where its calibration cannot be used.

        A ``speed.maximum`` that is left out is set here, to 3000 rpm but at most 60 m/s.

        Raises:
            ConfigurationError: Its parameters contradict one another; the text is one sentence.
        """
        values, name = self._own, self.name
        lining = {row.name: values[row.name] for row in parameters.LINING_PARAMETERS}
        tolerance = Tolerance(
            **{
                row.name.removeprefix('tolerance.'): values[row.name]
                for row in parameters.TOLERANCE_PARAMETERS
            }
        )
        try:
            bearing = Bearing(
                **lining, friction=self._build_friction(), lubrication=self._build_lubrication()
            )
        except PhysicsError as error:
            raise ConfigurationError(f'{name}: {error}') from error
        alarm = build_section(parameters.AlarmConfig, 'alarm.', values)
        if math.isnan(values['speed.maximum']):
            fastest = parameters.FASTEST_RPM * float(bearing.speed.factor('rpm'))
            values['speed.maximum'] = min(parameters.FASTEST, fastest)
        if alarm.minimum_speed >= values['speed.maximum']:
            rest, maximum = (
                self._text_of('alarm.minimum_speed', 'm/s'),
                self._text_of('speed.maximum', 'm/s'),
            )
            raise ConfigurationError(f'{rest} must be below {maximum}')
        speed = self._build_speed(float(bearing.speed.factor(values['speed.unit'])), alarm.minimum_speed)
        load = self._build_load(speed, float(bearing.speed.factor('rpm')))
        if not load.is_assumed:
            self._require_other_field('load', load, {'speed': speed})
        level = self._build_level({'speed': speed, 'load': load})
        try:
            bearing, belief = self._apply_calibration(bearing, tolerance, {'speed': speed, 'load': load})
        except PhysicsError as error:
            raise ConfigurationError(f'{name}: {error}') from error
        water = self._build_water(
            {'speed': speed, 'load': load} | ({} if level is None else {'level': level})
        )
        return BearingConfig(name, bearing, speed, load, alarm, tolerance, belief, level, water)

    def _apply_calibration(
        self, bearing: Bearing, tolerance: Tolerance, inputs: Mapping[str, InputConfig]
    ) -> tuple[Bearing, Belief | None]:
        """Return the bearing by which alarms go, and the belief about it; ``None`` for an exact one.

        Live, a calibration that cannot be used sets ``fault``, and the bearing goes by its tolerances.

        Raises:
            UnusableCalibration: It is missing, damaged or of another version, while not live.
            ConfigurationError: It is of another bearing, or made with other sensors, live or not.
        """
        path = self._own['calibration']
        if path:
            try:
                return read_calibration(path, self.name, inputs, bearing, tolerance)
            except UnusableCalibration as error:
                if not self._is_live:
                    raise
                self.fault = (
                    f'{self.name}: the calibration is damaged or missing, so {self.name} is monitored as if'
                    f' it had none: {error}'
                )
        return bearing, None if tolerance.is_exact else _make_belief(_in_any_water(bearing), tolerance)

    def _build_friction(self) -> FrictionLaw:
        """Return the friction law with its parameters.

        Raises:
            ConfigurationError: A parameter that the law needs is missing.
            PhysicsError: The law refuses their values.
        """
        law = self._own['friction.law']
        make, names = LAWS[law]
        optional = {row.name for row in parameters.FRICTION_PARAMETERS if row.is_optional}
        needed = [key for key in names if f'friction.{key}' in optional]
        for key in needed:
            value = self._own[f'friction.{key}']
            if _is_left_out(value):
                raise ConfigurationError(
                    f"parameter '{self.name}.friction.{key}' is missing: the law {law} needs"
                    f' {", ".join(needed)}'
                )
        return make(*(self._own[f'friction.{key}'] for key in names))

    def _build_lubrication(self) -> Lubrication | None:
        """Return the load and the water at which friction was measured; ``None`` where neither matters.

        It is at the constant water temperature, or at that of the measurement until one comes. The load is
        1 N where friction does not depend on it.

        Raises:
            ConfigurationError: Friction depends on one of them, and its value at the measurement is missing.
        """
        values = self._own
        exponent, water = values['friction.load_exponent'], values['water_temperature.constant']
        source = self._water_key()
        for given, key, needed, meaning in (
            (exponent > 0.0, 'friction.load_exponent', 'friction.at_load', 'load'),
            (bool(source), source, 'friction.at_temperature', 'temperature'),
        ):
            if given and math.isnan(values[needed]):
                raise ConfigurationError(
                    f"parameter '{self.name}.{needed}' is missing: {self._text_of(key)} needs the {meaning}"
                    ' at which friction was measured'
                )
        if exponent == 0.0 and not source:
            return None
        at_salinity, salinity = values['friction.at_salinity'], values['water_temperature.salinity']
        lubrication = Lubrication(
            values['friction.at_load'] if exponent > 0.0 else 1.0,
            exponent,
            values['friction.at_temperature'],
            salinity if math.isnan(at_salinity) else at_salinity,
            salinity,
        )
        if not source:
            return lubrication
        # Until a temperature has come friction is taken as measured.
        return lubrication.in_water(values['friction.at_temperature'] if math.isnan(water) else water)

    def _water_key(self) -> str:
        """Return the parameter that gives the water's temperature, without the bearing's name; '' for none.

        The topic comes before the column, and this before the constant.
        """
        given = self._own
        keys = ('water_temperature.topic', 'water_temperature.column', 'water_temperature.constant')
        return next((key for key in keys if given[key] and given[key] == given[key]), '')

    def find_unused(self, config: BearingConfig) -> Iterator[str]:
        """Yield a sentence on each parameter of friction, load, water and alarms that is set without effect.

        A parameter at its default is skipped: over ROS all of them are declared.
        """
        law = self._own['friction.law']
        taken = [f'friction.{key}' for key in LAWS[law][1]]
        lubrication = [row.name for row in parameters.LUBRICATION_PARAMETERS]
        of_load = ('friction.at_load',)
        of_water = 'friction.at_temperature', 'friction.at_salinity', 'water_temperature.salinity'
        without_load = self._own['friction.load_exponent'] == 0.0
        without_water = not self._water_key()
        for row in parameters.BEARING_PARAMETERS:
            if row.is_default(self._own[row.name]):
                continue
            shown = f'{self._text_of(row.name, row.unit)} has no effect'
            if row.name in of_load and without_load:
                yield f'{shown} without friction.load_exponent: friction depends on speed alone'
            elif row.name in of_water and without_water:
                yield f'{shown} without water_temperature.constant or .topic: the water has no temperature'
            elif row.name in lubrication:
                continue
            elif row.name.startswith('friction.') and row.name not in ('friction.law', *taken):
                yield f'{shown}: the law {law} takes {", ".join(taken)}; is friction.law right?'
            elif row.name.endswith('_probability') and not config.alarms_by_chance:
                yield f'{shown}: alarms go by margins without tolerances, and after a calibration'
            elif row.name == 'alarm.caution_margin' and config.alarms_by_chance:
                yield f'{shown} near the fold: with tolerances caution goes by alarm.caution_probability'

    def _build_speed(self, factor: float, rest: float) -> SpeedConfig:
        """Return the input of the speed; the speed of an engine is divided by the gear.

        Args:
            factor: Surface speed of one unit of the input [m/s].
            rest: Surface speed below which the shaft is at rest [m/s].

        Raises:
            ConfigurationError: A gear is given with a scale or a surface speed, or the input is invalid.
        """
        settings = self._own
        if settings['speed.gear'] != 1.0:
            gear = self._text_of('speed.gear')
            if settings['speed.scale'] != 1.0:
                raise ConfigurationError(
                    f'{gear} and {self._text_of("speed.scale")} are both given: a gear takes the place of a'
                    ' scale'
                )
            if settings['speed.unit'] == 'm/s':
                raise ConfigurationError(
                    f"{gear} is given and {self.name}.speed.unit = 'm/s' is the journal's own speed: an"
                    f" engine's is in {', '.join(TURNING_UNITS)}"
                )
        return self._build_input(SpeedConfig, 'speed', factor / settings['speed.gear'], rest)

    def _build_load(self, speed: InputConfig, per_rpm: float) -> LoadConfig:
        """Return the input of the load; an assumed one has the topic, field and timing of the speed.

        Args:
            speed: The input of the speed.
            per_rpm: Surface speed of one revolution a minute [m/s].

        Raises:
            ConfigurationError: The load is given in two ways or in none, or is invalid.
        """
        settings, factor = self._own, parameters.LOAD_UNITS[self._own['load.unit']]
        given = [key for key in parameters.ASSUMED_LOADS if not _is_left_out(settings[key])]
        if not given:
            return self._build_input(LoadConfig, 'load', factor)
        shown = self._text_of(given[0], settings['load.unit'])
        for key in (*given[1:], *(key for key in ('load.topic', 'load.column') if settings[key])):
            raise ConfigurationError(
                f'{shown} and {self._text_of(key)} are both given: the load is measured, constant, or from a'
                ' table'
            )
        # Surface speeds [m/s] and the loads there [N].
        table: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
        if settings['load.over_speed']:
            speeds, loads = split_load_table(f'{self.name}.load.over_speed', settings['load.over_speed'])
            table = tuple(rpm * per_rpm for rpm in speeds), tuple(load * factor for load in loads)
        for load in table[1] or (settings['load.constant'] * factor,):
            if not 0.0 < load <= settings['load.maximum']:
                limit = self._text_of('load.maximum', 'N')
                raise ConfigurationError(f'{shown} must be above 0 and not above {limit}')
        beside = {
            'load.topic': speed.topic,
            'load.type': speed.type,
            'load.field': speed.field_text,
            'load.column': speed.column,
            'load.where': speed.where,
            'load.scale': 0.0,
            'load.offset': 0.0 if table[1] else settings['load.constant'],
            'load.timeout': settings['speed.timeout'],
            'load.hold': settings['speed.hold'],
        }
        more = {'field': speed.field, 'factor': factor, 'is_assumed': True, 'table': table}
        return build_section(LoadConfig, 'load.', settings | beside, **more)

    def _build_input(self, kind: type[_Input], quantity: str, factor: float, deadband: float = 0.0) -> _Input:
        """Return the configuration of one input.

        Args:
            kind: The dataclass to build.
            quantity: Name of the input, which begins the names of its parameters.
            factor: SI units in a unit of the input.
            deadband: Magnitude below which a value counts as 0 [SI].

        Raises:
            ConfigurationError: Neither topic nor column is given, or topic, type, field or ``where`` is
                invalid.
        """
        name, values = f'{self.name}.{quantity}', self._own
        topic = values[f'{quantity}.topic']
        if not topic and not values[f'{quantity}.column']:
            assumed = f', or {name}.constant or {name}.over_speed where nothing measures it'
            remedy = assumed if quantity == 'load' else ''
            raise ConfigurationError(
                f"parameter '{name}.topic' is missing: give the topic that carries the {quantity},"
                f' {name}.column for a log{remedy}'
            )
        if len(values[f'{quantity}.where']) % 2:
            rule = 'pairs of a column of a log and its text, as in {shaft: port}'
            raise refused(f'{name}.where', values[f'{quantity}.where'], rule)
        if topic:
            check_topic(f'{name}.topic', topic)
        if not _TYPE.fullmatch(values[f'{quantity}.type']):
            raise ConfigurationError(
                f'{self._text_of(f"{quantity}.type")} must be written package/msg/Type, e.g.'
                ' std_msgs/msg/Float64'
            )
        try:
            path: FieldPath = parse_field(values[f'{quantity}.field'])
        except FieldError as error:
            raise ConfigurationError(f'{name}.field: {error}') from error
        return build_section(kind, f'{quantity}.', values, field=path, factor=factor, deadband=deadband)

    def _require_other_field(
        self, name: str, source: InputConfig, sources: Mapping[str, InputConfig]
    ) -> None:
        """Check that an input with a topic is not read from the same field of it as another.

        Raises:
            ConfigurationError: It is.
        """
        for beside, source_beside in sources.items():
            if source.topic and (source.topic, source.field) == (source_beside.topic, source_beside.field):
                raise ConfigurationError(
                    f'{self.name}.{name} is read from the same field as the {beside},'
                    f' {source.topic} {source.field_text}: it must be a number of its own'
                )

    def _is_measured(self, name: str, subject: str, beside: Sequence[str] = ()) -> bool:
        """Return whether an optional input has a topic or a column.

        Args:
            name: Name of the input.
            subject: What it measures, for the error.
            beside: Its parameters that may be given without a topic.

        Raises:
            ConfigurationError: It has neither, and another of its parameters is given.
        """
        settings = self._own
        if settings[f'{name}.topic'] or settings[f'{name}.column']:
            return True
        for row in parameters.INPUT_PARAMETERS[name]:
            if row.name not in beside and not row.is_default(settings[row.name]):
                raise ConfigurationError(
                    f"parameter '{self.name}.{name}.topic' is missing, and {self._text_of(row.name)} is"
                    f' given: name the topic of {subject}'
                )
        return False

    def _build_water(self, sources: Mapping[str, InputConfig]) -> parameters.WaterConfig | None:
        """Return the input of the water's temperature; ``None`` where nothing measures it.

        Raises:
            ConfigurationError: It is invalid, or read from the field of another of the ``sources``.
        """
        beside = 'water_temperature.constant', 'water_temperature.salinity'
        if not self._is_measured('water_temperature', 'the temperature of the water', beside):
            return None
        water = self._build_input(parameters.WaterConfig, 'water_temperature', 1.0)
        self._require_other_field('water_temperature', water, sources)
        return water

    def _build_level(self, sources: Mapping[str, InputConfig]) -> parameters.LevelConfig | None:
        """Return the input of measured vibration; ``None`` where there is none.

        Raises:
            ConfigurationError: It or its threshold is invalid, or it is read from the field of another of the
                ``sources``, or from the topic of one as another message type.
        """
        if not self._is_measured('level', 'the measured vibration'):
            return None
        level = self._build_input(parameters.LevelConfig, 'level', 1.0)
        threshold = self._text_of('level.threshold', level.unit)
        if level.threshold <= 0.0 and level.unit != 'dB':
            raise ConfigurationError(
                f'{threshold} must be above 0, as every RMS value is; for a level in decibels set level.unit'
                ' to dB'
            )
        if abs(level.threshold) > level.maximum:
            maximum = self._text_of('level.maximum', level.unit)
            raise ConfigurationError(f'{threshold} must not be above {maximum}: a value beyond is invalid')
        self._require_other_field('level', level, sources)
        for quantity, source in sources.items():
            if level.topic and level.topic == source.topic and level.type != source.type:
                raise ConfigurationError(
                    f'{self._text_of("level.type")} must be that of {self.name}.{quantity}, {source.type!r}:'
                    f' both are read from {level.topic}'
                )
        return level
