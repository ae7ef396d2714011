# SPDX-License-Identifier: Apache-2.0
"""Every configuration parameter, once: name, type, default, range, unit and meaning.

The file's validation, the ROS parameter descriptors and the reference page of the docs are all
made from this table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from stickslip_monitor.physics.oscillator import SPEED_UNITS

REQUIRED = object()
FRICTION_LAWS = ('stribeck', 'coulomb', 'tabulated')
LOAD_UNITS = ('N', 'kN')
LEVEL_UNITS = ('m/s^2', 'g', 'mm/s', 'um', 'Pa', 'V', 'none', 'dB')
TOLERANCES = (
    ('damping', 'the damping'),
    ('static', 'the static coefficient'),
    ('kinetic', 'the kinetic coefficient'),
    ('decay', 'the decay'),
    ('speed', 'the measured speed'),
    ('load', 'the measured load'),
    ('model_error', "a boundary's speed, for what the averaged model leaves out"),
    ('scatter', "a boundary's speed from one passage to the next"),
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One configuration parameter.

    Attributes:
        name: Dotted name; for a bearing's parameter without the bearing's name.
        kind: ``float``, ``int``, ``bool``, ``str``, or ``float[]``/``str[]`` for a list of these.
        default: Value used where the file gives none; :data:`REQUIRED` where it must.
        text: What it is, for descriptors and docs.
        unit: Unit of the value, empty for a pure number.
        minimum: Least value allowed.
        maximum: Greatest value allowed.
        above_minimum: The minimum itself is not allowed.
        choices: The values allowed, empty for any.
        live: May be changed while the node is active.
    """

    name: str
    kind: str
    default: Any
    text: str
    unit: str = ''
    minimum: float = -math.inf
    maximum: float = math.inf
    above_minimum: bool = False
    choices: tuple[str, ...] = ()
    live: bool = False

    def rule(self) -> str:
        """The rule a value must keep, in words that follow 'must be'."""
        kinds = {
            'float': 'a number' if self.default == math.inf else 'a finite number',
            'int': 'a whole number',
            'bool': 'true or false',
            'str': 'a text',
            'float[]': 'a list of finite numbers',
            'str[]': 'a list of texts',
        }
        if self.choices:
            return f'one of {", ".join(self.choices)}'
        words = [kinds[self.kind]]
        if self.minimum > -math.inf:
            words.append(f'{"above" if self.above_minimum else "not below"} {self.minimum:g}')
        if self.maximum < math.inf:
            words.append(f'not above {self.maximum:g}')
        return ' and '.join([' '.join(words[:2]), *words[2:]]) + (f' {self.unit}'.rstrip())


NODE_PARAMETERS = (
    Parameter('bearings', 'str[]', REQUIRED, 'Names of the bearings; each has its own section.'),
    Parameter(
        'autostart', 'bool', True, 'Configure and activate the node by itself when it starts.'
    ),
    Parameter(
        'publish_period',
        'float',
        0.0,
        "Least time between two publications of a bearing's values; 0 publishes every evaluation."
        ' A change of condition is always published at once.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        live=True,
    ),
    Parameter(
        'shelve_time',
        'float',
        1800.0,
        'How long a shelved alarm stays on the shelf.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        above_minimum=True,
        live=True,
    ),
    Parameter(
        'silence_time',
        'float',
        30.0,
        'How long a silenced alarm stays silent if nobody acknowledges it.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        above_minimum=True,
        live=True,
    ),
    Parameter(
        'state_file',
        'str',
        '',
        'File that keeps acknowledgements, shelves and latches over a restart; empty for none.',
    ),
    Parameter(
        'clips.directory',
        'str',
        '',
        'Folder for event clips: what came and went around each alarm; empty for none.',
    ),
    Parameter(
        'clips.around',
        'float',
        60.0,
        'How much of the time before and after an alarm a clip has.',
        unit='s',
        minimum=1.0,
        maximum=600.0,
    ),
    Parameter(
        'clips.most', 'int', 50, 'Clips kept; the oldest make room.', minimum=1, maximum=10_000
    ),
    Parameter(
        'clips.size',
        'float',
        5.0,
        'Largest clip, before compression; one that is full ends early.',
        unit='MB',
        minimum=0.1,
        maximum=100.0,
    ),
)


def _positive(name: str, unit: str, text: str) -> Parameter:
    return Parameter(name, 'float', REQUIRED, text, unit, minimum=0.0, above_minimum=True)


def _input(
    quantity: str,
    units: tuple[str, ...],
    maximum: float,
    si_unit: str,
    topic: tuple[Any, str] = (REQUIRED, ''),
    unit: Any = REQUIRED,
) -> tuple[Parameter, ...]:
    return (
        Parameter(
            f'{quantity}.topic', 'str', topic[0], f'Topic that carries the {quantity}{topic[1]}.'
        ),
        Parameter(
            f'{quantity}.type', 'str', 'std_msgs/msg/Float64', 'Message type of that topic.'
        ),
        Parameter(
            f'{quantity}.field',
            'str',
            'data',
            'Path to the number inside the message, e.g. data, velocity[0] or wrench.force.z.',
        ),
        Parameter(
            f'{quantity}.unit', 'str', unit, 'Unit of scale * number + offset.', choices=units
        ),
        Parameter(f'{quantity}.scale', 'float', 1.0, 'Factor applied to the number.', live=True),
        Parameter(
            f'{quantity}.offset', 'float', 0.0, 'Added after the factor, in the unit.', live=True
        ),
        Parameter(
            f'{quantity}.timeout',
            'float',
            5.0,
            'Age at which the last value no longer counts and the input is reported lost.',
            unit='s',
            minimum=0.0,
            maximum=1e9,  # with a stamp of today it must fit into 64 bits of nanoseconds
            above_minimum=True,
            live=True,
        ),
        Parameter(
            f'{quantity}.maximum',
            'float',
            maximum,
            'Largest magnitude believed; a larger value is counted as implausible and not used.',
            unit=si_unit,
            minimum=0.0,
            above_minimum=True,
            live=True,
        ),
    )


BEARING_PARAMETERS = (
    _positive('mass', 'kg', 'Moving mass of the lining.'),
    Parameter('damping', 'float', REQUIRED, 'Damping of the lining.', 'N s/m', minimum=0.0),
    _positive('stiffness', 'N/m', 'Tangential stiffness of the lining.'),
    _positive('journal_diameter', 'm', 'Diameter of the journal in the bearing.'),
    Parameter('friction.law', 'str', 'stribeck', 'Friction law.', choices=FRICTION_LAWS),
    Parameter('friction.static', 'float', math.nan, 'Static coefficient mu_s.', minimum=0.0),
    Parameter('friction.kinetic', 'float', math.nan, 'Kinetic coefficient mu_k.', minimum=0.0),
    Parameter(
        'friction.decay',
        'float',
        math.nan,
        'Decay beta of the Stribeck law with speed.',
        's/m',
        minimum=0.0,
        above_minimum=True,
    ),
    Parameter(
        'friction.viscous',
        'float',
        0.0,
        'Viscous rise nu of the Stribeck law.',
        's/m',
        minimum=0.0,
    ),
    Parameter('friction.speed', 'float[]', (), 'Speeds of a tabulated law.', 'm/s', minimum=0.0),
    Parameter(
        'friction.coefficient', 'float[]', (), 'Coefficients of a tabulated law.', minimum=0.0
    ),
    *(
        Parameter(
            f'tolerance.{name}',
            'float',
            0.0,
            f'Relative standard deviation of {text}; 0 for exact. Limits of +-10 % are 0.058.',
            minimum=0.0,
            maximum=3.0,
        )
        for name, text in TOLERANCES
    ),
    Parameter(
        'calibration',
        'str',
        '',
        'File that stickslip calibrate wrote for this bearing, in a parameter file relative to'
        ' it; takes the place of damping, decay and their tolerances. Empty for none.',
    ),
    *_input('speed', SPEED_UNITS, 100.0, 'm/s'),
    *_input('load', LOAD_UNITS, 1e8, 'N'),
    *_input(
        'level',
        LEVEL_UNITS,
        1e12,
        '',
        ('', ' of measured vibration, an RMS value or a band level; empty for none'),
        'm/s^2',
    ),
    Parameter(
        'level.threshold',
        'float',
        math.nan,
        'Level from which on it is vibration, in the unit; without it the monitor learns one from'
        ' the two modes of the level, once both have been seen.',
        live=True,
    ),
    Parameter(
        'level.hysteresis',
        'float',
        3.0,
        'How far below the threshold the level must fall to be quiet.',
        unit='dB',
        minimum=0.0,
        maximum=60.0,
        live=True,
    ),
    Parameter(
        'alarm.caution_margin',
        'float',
        0.2,
        'Caution while the fold margin is below this: wide enough for the error of the friction'
        ' law and of the load, and for the time that the crew needs.',
        minimum=0.0,
        live=True,
    ),
    Parameter(
        'alarm.look_ahead',
        'float',
        20.0,
        'Caution also where the trend of the last seconds takes the speed below the fold within'
        ' this time; 0 for not looking ahead.',
        unit='s',
        minimum=0.0,
        maximum=600.0,
        live=True,
    ),
    Parameter(
        'alarm.onset_growth',
        'float',
        3.0,
        'How far a disturbance of steady sliding must have grown for stick-slip to be predicted;'
        ' it sticks at about 6. Less warns earlier and falsely more often; 0 predicts stick-slip'
        ' at the first point below the Hopf speed.',
        unit='e-folds',
        minimum=0.0,
        maximum=20.0,
        live=True,
    ),
    Parameter(
        'alarm.can_probability',
        'float',
        0.5,
        'With a tolerance or a calibration: bistable above this probability that stick-slip can'
        ' happen, until it is below half of it.',
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        'alarm.runs_probability',
        'float',
        0.5,
        'With a tolerance or a calibration: stick-slip is predicted where this share of the'
        ' bearings believed in has it start, and ends where half of it has no cycle any more.',
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        'alarm.caution_probability',
        'float',
        0.05,
        'The same for caution, in the place of the margin.',
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        'alarm.hysteresis',
        'float',
        0.02,
        'Deadband: caution ends this far above its margin, the amplitude alarm this fraction below'
        ' its limit.',
        minimum=0.0,
        maximum=0.9,
        live=True,
    ),
    Parameter(
        'alarm.amplitude_limit',
        'float',
        math.inf,
        'Predicted stick-slip amplitude that raises the amplitude alarm; .inf for none.',
        unit='m',
        minimum=0.0,
        above_minimum=True,
        live=True,
    ),
    Parameter(
        'alarm.on_delay',
        'float',
        2.0,
        'How long a condition must hold before it is raised, net: time in which it does not is'
        ' taken off. Stick-slip has its growth (alarm.onset_growth) in place of it.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        live=True,
    ),
    Parameter(
        'alarm.off_delay',
        'float',
        10.0,
        'How long a condition must be gone before it is cleared, net; longer for one that keeps'
        ' returning.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        live=True,
    ),
    Parameter(
        'alarm.minimum_speed',
        'float',
        0.0,
        'Surface speeds below this count as a shaft at rest (sensor noise of a stopped shaft).',
        unit='m/s',
        minimum=0.0,
        live=True,
    ),
    Parameter(
        'alarm.input_off_delay',
        'float',
        60.0,
        'How long both inputs must be fine before the alarms on them clear: one that comes and'
        ' goes is one alarm.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        live=True,
    ),
    Parameter(
        'alarm.latch',
        'bool',
        False,
        'The stick-slip and amplitude alarms stay until they are reset.',
        live=True,
    ),
    Parameter(
        'alarm.startup_inhibit',
        'float',
        0.0,
        'For how long after the shaft starts to turn the alarms on stick-slip are suppressed.',
        unit='s',
        minimum=0.0,
        maximum=604800.0,
        live=True,
    ),
    Parameter(
        'alarm.trend_window',
        'float',
        30.0,
        'Time over which the rate of change of speed and load is taken, to say when steady sliding'
        ' turns unstable at that rate; 0 for not saying it.',
        unit='s',
        minimum=0.0,
        maximum=86400.0,
        live=True,
    ),
)
