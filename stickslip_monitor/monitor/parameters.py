# SPDX-License-Identifier: Apache-2.0
"""The configuration: each parameter is declared once, as the field of a dataclass that holds its value.

Validation, the ROS parameter descriptors and the reference page are made from the declaration.
Plain dataclass fields do it: the sentences of refusal are our own, so what pydantic, msgspec or
cattrs would add is another set of sentences to translate and a dependency of the node.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, TypeVar

from stickslip_logs.field_paths import FieldPath
from stickslip_logs.units import factors_of, names_of
from stickslip_monitor.errors import ConfigurationError, did_you_mean
from stickslip_monitor.monitor.sample_types import INPUTS, Input
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter
from stickslip_monitor.physics.bearing import SPEED_UNITS, Bearing
from stickslip_monitor.physics.friction import LAWS
from stickslip_monitor.physics.lubrication import MAX_SALINITY, MAX_TEMPERATURE, MIN_TEMPERATURE, SEA
from stickslip_monitor.physics.probability import EXACT, Belief, Tolerance

WEEK = 604800.0
"""The longest duration that is allowed where nothing else sets a limit [s]."""
Section = TypeVar('Section')


def nanoseconds(seconds: float) -> int:
    """Convert a duration of the configuration [s] to whole nanoseconds."""
    return round(seconds * 1e9)


def parameter(
    default: Any, text: str, unit: str = '', within: tuple[float, float] = (-math.inf, math.inf), **rules: Any
) -> Any:
    """Return a field of a dataclass that is a configuration parameter, with its rules as metadata.

    Args:
        default: The parameter's default; with :data:`.value_check.REQUIRED` the field is keyword-only.
        text: What it is; ``{input}`` stands for the name of the section.
        unit: Its unit.
        within: Least and largest value.
        **rules: Further attributes of :class:`Parameter`, where they are not as the field's name and
            annotation say, and ``convert``, which makes the field's value of the parameter's.
    """
    metadata = {'text': text, 'unit': unit, 'default': default, 'minimum': within[0], 'maximum': within[1]}
    rules = {'convert': lambda value: value} | metadata | rules
    if default is REQUIRED:
        return field(metadata=rules, kw_only=True)
    return field(default=rules['convert'](default), metadata=rules)


def duration(default: float, text: str, within: tuple[float, float] = (0.0, WEEK), **rules: Any) -> Any:
    """Return a field ``*_ns`` [ns] of a parameter in seconds, whose name goes without the ``_ns``.

    ``default`` and ``within``, the least and the largest value, are in seconds; ``rules`` as of
    :func:`parameter`.
    """
    return parameter(default, text, 's', within, convert=nanoseconds, kind='float', **rules)


def declared_parameters(
    section: type[Any], prefix: str = '', **changes: dict[str, Any]
) -> tuple[Parameter, ...]:
    """Return the parameters that a dataclass declares, in the order of its fields, names after a prefix.

    Fields that are no parameters are left out. ``changes`` replace attributes of a parameter, by its name
    without the prefix; one for a name that is not there does nothing.
    """
    parameters = []
    for item in fields(section):
        if item.metadata:
            name, text = _parameter_name(item), item.metadata['text'].replace('{input}', prefix.rstrip('.'))
            values = {'kind': str(item.type)} | dict(item.metadata) | changes.get(name, {})
            values |= {'name': prefix + name, 'text': changes.get(name, {}).get('text', text)}
            del values['convert']
            parameters.append(Parameter(**values))
    return tuple(parameters)


def _parameter_name(item: Field[Any]) -> str:
    """Return the name of the parameter that a field is: as stated, else the field's without ``_ns``."""
    return str(item.metadata.get('name', item.name.removesuffix('_ns')))


def build_section(section: type[Section], prefix: str, values: Mapping[str, Any], **derived: Any) -> Section:
    """Return an instance of a dataclass, made from the checked values of its parameters.

    Args:
        section: The dataclass.
        prefix: What stands before each parameter's name in ``values``.
        values: A value for each of its parameters, and perhaps others; converted as the parameter declares,
            as seconds to nanoseconds.
        **derived: Values of its other fields, or, as they are, in place of a parameter's.

    Raises:
        KeyError: A parameter has no value.
    """
    filled_values = {
        item.name: item.metadata['convert'](values[prefix + _parameter_name(item)])
        for item in fields(section)  # type: ignore[arg-type]
        if item.metadata and item.name not in derived
    }
    return section(**filled_values, **derived)


LOAD_UNITS = factors_of(*names_of('force'))
"""The units of a load, and newtons in each."""
FASTEST_RPM, FASTEST = 3000.0, 60.0
"""No ship's shaft turns faster [rpm], and no journal's surface moves faster [m/s]."""
LEVEL_UNITS = ('m/s^2', 'g', 'mm/s', 'um', 'Pa', 'V', 'none', 'dB')


@dataclass(frozen=True, slots=True)
class InputConfig:
    """Source of one measured quantity and its conversion to SI.

    ``SI value = factor * (scale * number + offset)``; magnitudes above ``maximum`` [SI] are
    invalid, and magnitudes below ``deadband`` [SI] count as zero.
    """

    topic: str = parameter('', 'Topic of the {input}.')
    type: str = parameter('std_msgs/msg/Float64', 'Message type of that topic.')
    field_text: str = parameter(
        'data', 'Path to the number in the message, as velocity[0] or wrench.force.z.', name='field'
    )
    unit: str = parameter(REQUIRED, 'Unit of scale * number + offset.')
    scale: float = parameter(
        1.0, 'Factor applied to the number.', not_zero=True, within=(-1e9, 1e9), live=True
    )
    offset: float = parameter(0.0, 'Added after the factor, in the unit.', within=(-1e9, 1e9), live=True)
    timeout_ns: int = duration(
        5.0, 'Age at which the last value is stale and the input lost.', above_minimum=True, live=True
    )
    hold_ns: int = duration(0.0, 'How long a value stands where its source sends changes only.', live=True)
    maximum: float = parameter(
        REQUIRED, 'Largest valid magnitude.', within=(0.0, math.inf), above_minimum=True, live=True
    )
    column: str = parameter(
        '',
        "Its column in a log: a heading, a name where a line has one value, or '#3'; else by unit and name.",
    )
    where: tuple[str, ...] = parameter(
        (),
        "The lines of a log that count, by text of other columns: {shaft: port}; '*' is any.",
        kind='str[]',
    )
    sender: str = parameter(
        '', 'The only sender that counts in a log of a bus; by default that of the link, or else the first.'
    )
    field: FieldPath = ('data',)
    factor: float = 1.0
    deadband: float = 0.0
    is_assumed: bool = False  # no sensor measures it, and a constant or a table stands for it

    @property
    def stands_ns(self) -> int:
        """Time for which a value counts [ns]."""
        return max(self.timeout_ns, self.hold_ns)

    @property
    def where_texts(self) -> dict[str, str]:
        """The text that lines must have to count, by column."""
        return dict(zip(self.where[::2], self.where[1::2], strict=True))


@dataclass(frozen=True, slots=True)
class SpeedConfig(InputConfig):
    """Source of the speed: the shaft's, or that of an engine that turns it by a gear."""

    gear: float = parameter(
        1.0,
        'Engine speed over shaft speed, where an engine is measured; in place of a scale.',
        within=(0.0, 1e3),
        above_minimum=True,
    )

    @property
    def gear_text(self) -> str:
        """The clause that names the gear; empty without one."""
        return '' if self.gear == 1.0 else f'of an engine with a gear of {self.gear:g}'


MAX_LOAD_POINTS = 16
"""Points of a table of the load: alignment calculations have three to ten."""


@dataclass(frozen=True, slots=True)
class LoadConfig(InputConfig):
    """Source of the load, or what is assumed in its place: a constant, or a table over the speed.

    Values below ``minimum`` [N] are invalid. An assumed load is read from the messages of the speed:
    whatever hands out numbers of the speed hands out the load as well.
    """

    minimum: float = parameter(
        0.0,
        'Smallest valid load; below 0 for a sensor that may show so little.',
        'N',
        within=(-1e9, 0.0),
        live=True,
    )
    constant: float = parameter(math.nan, 'Load that is assumed in place of a topic.', within=(0.0, 1e9))
    over_speed: tuple[float, ...] = parameter(
        (),
        f'The same as 2 to {MAX_LOAD_POINTS} pairs of rising shaft speed in rpm and load; linear between,'
        ' constant beyond.',
        kind='float[]',
        in_pairs=True,
        within=(0.0, 1e9),
    )
    table: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())  # surface speeds [m/s], loads there [N]

    @property
    def assumed(self) -> tuple[float, float] | None:
        """Least and largest load that is assumed [N]; ``None`` where the load is measured."""
        if not self.is_assumed:
            return None
        loads = self.table[1] or (self.constant * self.factor,)
        return min(loads), max(loads)

    @property
    def origin(self) -> str:
        """Origin of an assumed load, for a person; empty for a measured one."""
        return 'from the alignment table' if self.table[1] else 'assumed' if self.is_assumed else ''


@dataclass(frozen=True, slots=True)
class LevelConfig(InputConfig):
    """Source of the measured vibration, and the threshold that separates it from quiet."""

    threshold: float = parameter(
        math.nan,
        'Level from which on a rise of 10 dB above its background is a vibration.',
        within=(-1e12, 1e12),
        live=True,
    )
    hysteresis: float = parameter(
        3.0, 'How far below the threshold the level is quiet.', 'dB', within=(0.0, 60.0), live=True
    )


@dataclass(frozen=True, slots=True)
class WaterConfig(InputConfig):
    """Source of the temperature of the water at the bearing, or the constant that stands for it."""

    constant: float = parameter(
        math.nan,
        'Temperature of the water where nothing measures it, and until the first value.',
        'C',
        within=(MIN_TEMPERATURE, MAX_TEMPERATURE),
        live=True,
    )
    salinity: float = parameter(
        SEA, 'Salinity of the water at the bearing; 0: fresh.', 'g/kg', within=(0.0, MAX_SALINITY)
    )


def _declare_probability(default: float, text: str) -> Any:
    """Return the field of a parameter from 0 to 1."""
    return parameter(default, text, within=(0.0, 1.0))


@dataclass(frozen=True, slots=True)
class AlarmConfig:
    """Thresholds and delays of a bearing's alarm."""

    caution_margin: float = parameter(0.2, 'Caution while the fold margin is below this.', within=(0.0, 10.0))
    hysteresis: float = parameter(
        0.02,
        'Deadband: caution ends this far above its margin, the amplitude alarm this fraction below'
        ' its limit.',
        within=(0.0, 0.9),
    )
    amplitude_limit: float = parameter(
        math.inf,
        'Predicted stick-slip amplitude that raises the amplitude alarm; .inf for none.',
        'm',
        within=(0.0, math.inf),
        above_minimum=True,
    )
    on_delay_ns: int = duration(
        2.0, 'Net time after which a condition is raised; stick-slip goes by growth.', within=(0.0, 600.0)
    )
    off_delay_ns: int = duration(
        10.0, 'Net time after which a condition is cleared; longer if it keeps returning.'
    )
    input_off_delay_ns: int = duration(60.0, 'How long inputs must be fine before their alarms clear.')
    latch: bool = parameter(
        default=False, text='The stick-slip and amplitude alarms stay until they are reset.', live=True
    )
    startup_inhibit_ns: int = duration(
        0.0, 'Time after the shaft starts to turn in which stick-slip alarms are suppressed.'
    )
    can_probability: float = _declare_probability(
        0.5, 'With tolerances: bistable above this probability that stick-slip can happen.'
    )
    runs_probability: float = parameter(
        0.5,
        'With tolerances: stick-slip is predicted where it starts in this share of the possible'
        ' bearings, until fewer have a cycle.',
        within=(0.001, 0.999),
    )
    caution_probability: float = _declare_probability(0.05, 'The same for caution, in place of the margin.')
    onset_growth: float = parameter(
        3.0,
        'Growth of a disturbance at which stick-slip is predicted; it sticks at about 6. Less warns'
        ' earlier and falsely more often.',
        'e-folds',
        within=(0.0, 20.0),
    )
    look_ahead_ns: int = duration(
        20.0,
        'Caution also where the speed on its slope passes the fold within this time.',
        within=(0.0, 600.0),
    )
    minimum_speed: float = parameter(
        0.003, 'Surface speeds below this count as a shaft at rest.', 'm/s', within=(0.0, 10.0)
    )


@dataclass(frozen=True, slots=True)
class BearingConfig:
    """One monitored bearing."""

    name: str
    bearing: Bearing
    speed: SpeedConfig
    load: LoadConfig
    alarm: AlarmConfig
    tolerance: Tolerance = EXACT
    belief: Belief | None = field(default=None, compare=False)
    level: LevelConfig | None = None
    water_temperature: WaterConfig | None = None

    @property
    def inputs(self) -> dict[str, InputConfig]:
        """The inputs by name, in order: speed, load (also an assumed one), level and water if configured."""
        every: dict[str, InputConfig | None] = {name: getattr(self, name) for name in INPUTS}
        return {name: source for name, source in every.items() if source is not None}

    @property
    def places(self) -> tuple[Input, ...]:
        """Places of the :attr:`inputs` among all that a bearing may have, in order."""
        return tuple(Input[name.upper()] for name in self.inputs)

    @property
    def alarms_by_chance(self) -> bool:
        """Whether probabilities take the place of the margins.

        After a calibration they do not: its bearing has the fold within a per cent, and margins of
        that bearing warned earlier and were half as long wrongly in alarm (docs/calibration.md).
        """
        return self.belief is not None and not self.belief.calibrated


@dataclass(frozen=True, slots=True)
class ClipConfig:
    """Folder of event clips (empty: none), and their length, number and size [bytes]."""

    directory: str = parameter('', 'Folder for event clips, short recordings around alarms.', fixed=True)
    around_ns: int = duration(60.0, 'Time before and after an alarm in a clip.', within=(1.0, 600.0))
    most: int = parameter(50, 'Clips kept; the oldest make room.', within=(1, 10_000))
    size: int = parameter(
        5.0,
        'Largest clip, before compression.',
        'MB',
        kind='float',
        within=(0.1, 100.0),
        convert=lambda megabytes: round(megabytes * 1e6),
    )


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """The configuration of the monitor and its node.

    ``notes`` says what of it has no effect, ``faults`` which file that it names cannot be used.
    """

    bearings: tuple[BearingConfig, ...]
    autostart: bool = parameter(default=True, text='Configure and activate the node when it starts.')
    publish_period: float = parameter(
        0.0,
        'Least time between two publications of a bearing; a change of condition is published at once.',
        's',
        within=(0.0, 3600.0),
        live=True,
    )
    shelve_time_ns: int = duration(
        1800.0, 'How long a shelved alarm stays shelved.', above_minimum=True, live=True
    )
    silence_time_ns: int = duration(
        30.0, 'How long a silenced alarm stays silent.', above_minimum=True, live=True
    )
    state_file: str = parameter('', 'File that keeps the alarms over a restart.', fixed=True)
    clips: ClipConfig = ClipConfig()
    notes: tuple[str, ...] = field(default=(), compare=False)
    faults: tuple[str, ...] = field(default=(), compare=False)

    def bearing(self, name: str) -> BearingConfig:
        """Return the bearing of that name.

        Raises:
            ConfigurationError: There is none.
        """
        for candidate in self.bearings:
            if candidate.name == name:
                return candidate
        names = [bearing.name for bearing in self.bearings]
        hint = did_you_mean(name, names) or f'; there are: {", ".join(names)}'
        raise ConfigurationError(f"bearing '{name}' is not configured{hint}")


def _declare_optional(name: str, unit: str, text: str, maximum: float, *, above: bool = True) -> Parameter:
    """Return a parameter for a number of 0 or more, or with ``above`` of more than 0; ``nan`` if left out."""
    return Parameter(name, 'float', math.nan, text, unit, 0.0, maximum, above_minimum=above)


BEARINGS = Parameter('bearings', 'str[]', REQUIRED, 'Names of the bearings.', fixed=True)
NODE_PARAMETERS = (BEARINGS, *declared_parameters(MonitorConfig), *declared_parameters(ClipConfig, 'clips.'))
"""The parameters of the node."""
# Bounds keep out what is no bearing and cannot be computed with: from a watch's to a mountain's.
LINING_PARAMETERS = (
    Parameter('mass', 'float', REQUIRED, 'Moving mass of the lining.', 'kg', 1e-6, 1e7),
    Parameter('damping', 'float', REQUIRED, 'Damping of the lining.', 'N s/m', 0.0, 1e10),
    Parameter('stiffness', 'float', REQUIRED, 'Tangential stiffness of the lining.', 'N/m', 1e-3, 1e13),
    Parameter(
        'journal_diameter', 'float', REQUIRED, 'Diameter of the journal in the bearing.', 'm', 1e-4, 1e3
    ),
)
"""The parameters of :class:`Bearing`, but for its friction."""
TORSIONAL_PARAMETERS = {
    'mass': _declare_optional(
        'inertia', 'kg m^2', "In place of mass: the lining's inertia about the shaft's axis.", 1e12
    ),
    'damping': _declare_optional('torsional_damping', 'N m s/rad', 'In place of damping.', 1e15, above=False),
    'stiffness': _declare_optional('torsional_stiffness', 'N m/rad', 'In place of stiffness.', 1e18),
}
"""What all three of a lining may be given by instead: each over the square of the radius."""
FRICTION_PARAMETERS = (
    Parameter('friction.law', 'str', 'stribeck', 'Friction law.', choices=tuple(LAWS)),
    _declare_optional('friction.static', '', 'Static coefficient mu_s.', 10.0, above=False),
    _declare_optional('friction.kinetic', '', 'Kinetic coefficient mu_k.', 10.0, above=False),
    _declare_optional('friction.decay', 's/m', 'Decay beta of the Stribeck law with speed.', 1e3),
    Parameter('friction.viscous', 'float', 0.0, 'Viscous rise nu of the Stribeck law.', 's/m', 0.0, 1e3),
    Parameter(
        'friction.exponent', 'float', 1.0, 'Exponent delta of the Stribeck law; 2 is Gaussian.', '', 1.0, 4.0
    ),
    Parameter('friction.speed', 'float[]', (), 'Speeds of a tabulated law.', 'm/s', 0.0, 1e3),
    Parameter('friction.coefficient', 'float[]', (), 'Coefficients of a tabulated law.', '', 0.0, 10.0),
)
LUBRICATION_PARAMETERS = (
    _declare_optional('friction.at_load', 'N', 'Load at which friction was measured.', 1e9),
    Parameter(
        'friction.load_exponent',
        'float',
        0.0,
        'Exponent g of the load: friction depends on speed over load^g.',
        '',
        0.0,
        1.0,
    ),
    Parameter(
        'friction.at_temperature',
        'float',
        math.nan,
        'Temperature of the water when friction was measured.',
        'C',
        MIN_TEMPERATURE,
        MAX_TEMPERATURE,
    ),
    Parameter(
        'friction.at_salinity',
        'float',
        math.nan,
        'Salinity of that water; 0: fresh. Left out: as water_temperature.salinity.',
        'g/kg',
        0.0,
        MAX_SALINITY,
    ),
)
"""The load and the water at which friction was measured."""
_UNCERTAIN = {
    'damping': 'the damping',
    'static': 'the static coefficient',
    'kinetic': 'the kinetic coefficient',
    'decay': 'the decay',
    'speed': 'the measured speed',
    'load': 'the measured load',
    'model_error': "a boundary's speed, for what the averaged model leaves out",
    'scatter': "a boundary's speed from one passage to the next",
}
TOLERANCE_PARAMETERS = tuple(
    Parameter(
        f'tolerance.{item.name}',
        'float',
        item.default,
        f'Relative standard deviation of {_UNCERTAIN[item.name]}.',
        '',
        0.0,
        3.0,
    )
    for item in fields(Tolerance)
)
INPUT_PARAMETERS = {
    'speed': declared_parameters(
        SpeedConfig,
        'speed.',
        unit={'choices': SPEED_UNITS},
        maximum={
            'default': math.nan,
            'unit': 'm/s',
            'maximum': 1e3,
            'text': f'Largest valid magnitude. Left out: {FASTEST_RPM:g} rpm, at most {FASTEST:g} m/s.',
        },
    ),
    'load': declared_parameters(
        LoadConfig,
        'load.',
        unit={'choices': tuple(LOAD_UNITS)},
        maximum={'default': 1e8, 'unit': 'N', 'maximum': 1e9},
    ),
    'level': declared_parameters(
        LevelConfig,
        'level.',
        topic={
            'default': '',
            'text': 'Topic of the measured vibration, an RMS value or a band level; empty for none.',
        },
        unit={'choices': LEVEL_UNITS, 'default': 'm/s^2'},
        maximum={'default': 1e12, 'maximum': 1e12},
    ),
    'water_temperature': declared_parameters(
        WaterConfig,
        'water_temperature.',
        topic={
            'default': '',
            'text': 'Topic of the temperature of the water at the bearing; empty for none.',
        },
        unit={'choices': ('C', 'K'), 'default': 'C'},
        timeout={'default': 600.0},
        maximum={'default': MAX_TEMPERATURE, 'unit': 'C', 'maximum': MAX_TEMPERATURE},
    ),
}
"""The parameters of each input."""
ASSUMED_LOADS = 'load.constant', 'load.over_speed'
"""What stands for a load that nothing measures."""
BEARING_PARAMETERS = (
    *LINING_PARAMETERS,
    *TORSIONAL_PARAMETERS.values(),
    *FRICTION_PARAMETERS,
    *LUBRICATION_PARAMETERS,
    *TOLERANCE_PARAMETERS,
    Parameter(
        'calibration',
        'str',
        '',
        'Result of stickslip calibrate, relative to the parameter file; replaces damping, decay and'
        ' their tolerances.',
        fixed=True,
    ),
    *(row for input_rows in INPUT_PARAMETERS.values() for row in input_rows),
    *(replace(row, live=True) for row in declared_parameters(AlarmConfig, 'alarm.')),
)
"""The parameters of each bearing."""

RETIRED = {'alarm.trend_window': 'times to a boundary are not forecast any more'}
"""Parameters of a bearing in 0.2.0 that are accepted without effect in 0.3, and why."""


def parameters_of(names: tuple[str, ...]) -> dict[str, Parameter]:
    """Return the parameters of the node and of these bearings by full name."""
    by_name = {row.name: row for row in NODE_PARAMETERS}
    return by_name | {f'{name}.{row.name}': row for name in names for row in BEARING_PARAMETERS}
