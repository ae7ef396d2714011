# SPDX-License-Identifier: Apache-2.0
"""What is published of a bearing: each field is declared once.

Records, topics, diagnostic keys, metrics, Signal K values, the table of ``assess`` and the installed schemas
are made from these rows. ``scripts/make_docs.py`` writes the schemas.
"""

from __future__ import annotations

from typing import Any, NamedTuple

FLOAT64, STRING = 'std_msgs/msg/Float64', 'std_msgs/msg/String'
BELIEF, LEVEL, WATER = 'belief', 'level', 'water'


class RecordField(NamedTuple):
    """A field of a record, and all the forms in which it is published."""

    name: str
    text: str  # what it is, for schemas, metrics and Signal K
    unit: str = ''
    note: str = ''  # more of it, for schemas alone
    kinds: str = 'number null'  # JSON types
    key: str = ''  # in /diagnostics; empty where it is not there
    metric: str = ''  # of Prometheus, without the prefix
    path: str = ''  # last part of its path of Signal K
    path_unit: str = ''  # its unit there
    shown: tuple[tuple[str, str], ...] = ()  # titles and units in the table of assess
    topic: str = ''  # message type of a topic of its own; only what an assessment has can have one
    # What of a bearing has to be configured for a topic and a diagnostic key: BELIEF, LEVEL or WATER.
    needs: str = ''
    is_zero_without_cycle: bool = False  # topics, metrics and Signal K say 0 where no cycle exists
    values: tuple[str, ...] = ()  # all that it can be, where its schema says so
    is_recorded: bool = True  # warnings and bearings have it; assess alone has the others

    @property
    def help(self) -> str:
        """The sentence of metrics and of Signal K."""
        return f'{self.text[:1].upper()}{self.text[1:]}{"; 0 without one" * self.is_zero_without_cycle}.'

    @property
    def schema(self) -> dict[str, Any]:
        """JSON schema: type, description with unit and note, and any allowed values."""
        kinds = self.kinds.split()
        unit, note = (f' [{self.unit}]' if self.unit else ''), (f'; {self.note}' if self.note else '')
        schema = {'type': kinds if len(kinds) > 1 else kinds[0], 'description': f'{self.text}{unit}{note}'}
        return schema | ({'enum': list(self.values)} if self.values else {})


_OUTCOMES = 'no_cycle, bistable, stick_slip, below_the_range, no_boundary, no_contact, at_rest'
_OPERATING_POINT = (
    RecordField(
        'regime', 'stable, bistable, unstable, undetermined', kinds='string null', key='regime', topic=STRING
    ),
    RecordField('outcome', f'why: {_OUTCOMES}', kinds='string null', key='outcome'),
    RecordField(
        'speed',
        'surface speed of the journal, negative astern',
        'm/s',
        key='speed [m/s]',
        metric='speed_meters_per_second',
        shown=(('surface speed', 'm/s'), ('shaft speed', 'rpm')),
    ),
    RecordField(
        'load',
        'load of the bearing',
        'N',
        key='load [N]',
        metric='load_newtons',
        path='load',
        path_unit='N',
        shown=(('load', 'N'),),
    ),
    RecordField(
        'hopf_speed',
        'Hopf speed of the surface at this load',
        'm/s',
        'null without one',
        key='hopf speed [m/s]',
        metric='hopf_speed_meters_per_second',
        shown=(('Hopf speed', 'rpm'),),
    ),
    RecordField(
        'fold_speed',
        'fold speed of the surface at this load',
        'm/s',
        'which decides: above it no vibration lasts; null without one',
        key='fold speed [m/s]',
        metric='fold_speed_meters_per_second',
        shown=(('fold speed', 'rpm'),),
    ),
    RecordField(
        'hopf_margin',
        'margin to the Hopf speed, negative inside',
        '',
        '|V|/V_H - 1, null where there is no boundary',
        key='hopf margin',
        metric='hopf_margin_ratio',
        path='hopfMargin',
        path_unit='ratio',
        shown=(('Hopf margin', '%'),),
        topic=FLOAT64,
    ),
    RecordField(
        'fold_margin',
        'margin to the fold, negative inside',
        '',
        '|V|/V_F - 1, null where there is no boundary',
        key='fold margin',
        metric='fold_margin_ratio',
        path='foldMargin',
        path_unit='ratio',
        shown=(('fold margin', '%'),),
        topic=FLOAT64,
    ),
    RecordField(
        'fold_speed_kbm',
        'fold speed by averaging (KBM)',
        'm/s',
        'null without one',
        shown=(('fold speed (KBM)', 'rpm'),),
    ),
    RecordField(
        'fold_margin_kbm', 'margin to that fold', note='decides nothing', shown=(('fold margin (KBM)', '%'),)
    ),
    RecordField(
        'hopf_load',
        'load at which this speed turns unstable',
        'N',
        shown=(('Hopf load', 'N'),),
        is_recorded=False,
    ),
    RecordField(
        'fold_load',
        'load from which a cycle exists at this speed',
        'N',
        shown=(('fold load', 'N'),),
        is_recorded=False,
    ),
    RecordField(
        'growth_rate',
        'growth rate of a small disturbance (1/s)',
        key='growth rate [1/s]',
        metric='growth_rate_hertz',
        shown=(('growth rate', '1/s'),),
    ),
    RecordField(
        'amplitude',
        'amplitude of the stick-slip cycle by averaging (KBM)',
        'm',
        'null where none exists (the topic says 0)',
        key='amplitude [m]',
        metric='amplitude_meters',
        shown=(('stick-slip amplitude (KBM)', 'mm'),),
        topic=FLOAT64,
        is_zero_without_cycle=True,
    ),
    RecordField(
        'amplitude_exact',
        'amplitude of the exact stick-slip cycle',
        'm',
        'null where none exists (the topic says 0)',
        key='amplitude of the exact cycle [m]',
        metric='exact_amplitude_meters',
        path='stickSlipAmplitude',
        path_unit='m',
        shown=(('stick-slip amplitude (exact cycle)', 'mm'),),
        topic=FLOAT64,
        is_zero_without_cycle=True,
    ),
    RecordField(
        'amplitude_error',
        'amplitude / amplitude_exact - 1',
        note='what averaging misses at this operating point',
        key='error of the amplitude',
        shown=(('error of KBM in the amplitude', '%'),),
    ),
    RecordField(
        'threshold_amplitude',
        'in the bistable range a larger disturbance starts stick-slip',
        'm',
        key='threshold amplitude [m]',
        metric='threshold_amplitude_meters',
        shown=(('threshold amplitude (KBM)', 'mm'),),
    ),
    RecordField(
        'probability_can',
        'probability that stick-slip can happen',
        note='null without tolerances and calibration',
        key='probability can',
        metric='can_probability_ratio',
        shown=(('probability that stick-slip can happen', '%'),),
        topic=FLOAT64,
        needs=BELIEF,
    ),
    RecordField(
        'probability_will',
        'probability that it starts by itself',
        note='null without tolerances and calibration',
        key='probability will',
        metric='will_probability_ratio',
        shown=(('probability that it starts by itself', '%'),),
        topic=FLOAT64,
        needs=BELIEF,
    ),
    RecordField(
        'probability_runs',
        'probability that stick-slip runs',
        note='by these, with the memory of the bistable range; null without tolerances and calibration',
        key='probability runs',
        metric='runs_probability_ratio',
        topic=FLOAT64,
        needs=BELIEF,
    ),
    RecordField(
        'fold_margin_low',
        '5 % quantile of the fold margin',
        note='null without tolerances and calibration, or where that share has no fold',
        key='fold margin low',
        shown=(('fold margin, 5 % quantile', '%'),),
        topic=FLOAT64,
        needs=BELIEF,
    ),
    RecordField(
        'fold_margin_high',
        '95 % quantile of the fold margin',
        note='null without tolerances and calibration, or where that share has no fold',
        key='fold margin high',
        shown=(('fold margin, 95 % quantile', '%'),),
        topic=FLOAT64,
        needs=BELIEF,
    ),
)
ASSESSED = _OPERATING_POINT[2:]
"""The numbers of an operating point, in SI units."""
POINT = tuple(item for item in _OPERATING_POINT if item.is_recorded)
"""What every record has of an operating point."""
NUMBERS = tuple(item for item in ASSESSED if item.is_recorded)
_BEARING_NAME = RecordField('bearing', 'name of the bearing', kinds='string')
_STICKING = RecordField(
    'sticking', 'whether stick-slip is predicted to run', kinds='boolean', key='stick-slip predicted'
)
_GROWTH = RecordField(
    'growth',
    'how far a disturbance has grown while stick-slip is not predicted',
    'e-folds',
    kinds='number',
    key='growth [e-folds]',
)
_CLEARS_IN = RecordField(
    'clears_in',
    'where the condition is only held, the time until it clears if the point stays',
    's',
    key='clears in [s]',
)
_RAISED = RecordField(
    'raised',
    '1 where the condition is raised, 2 where it came back soon after it had cleared and is held longer;'
    ' 0 else',
    kinds='integer',
    key='raised lately',
)
_MEASURED = RecordField(
    'measured',
    'what the measured vibration says, where a level is configured: quiet, vibrating or unknown',
    kinds='string',
    key='measured',
    topic=STRING,
    needs=LEVEL,
)
_CONDITIONS = 'normal, vibration, caution, bistable, stick_slip, amplitude_limit, input_stale'
WARNING = (
    _BEARING_NAME,
    RecordField(
        'time',
        'when the change fell due, nanoseconds since 1970 on the clock of the samples',
        kinds='integer',
    ),
    RecordField('from', f'condition before: {_CONDITIONS}', kinds='string'),
    RecordField('to', f'condition from then on: {_CONDITIONS}', kinds='string'),
    RecordField('severity', 'of the condition to: OK, WARN, ERROR', kinds='string'),
    RecordField('reason', 'the same as to; the key that /diagnostics has too', kinds='string'),
    _STICKING,
    _GROWTH,
    _CLEARS_IN,
    _RAISED,
    _MEASURED,
    *POINT,
    RecordField(
        'input_age',
        'age [s] of each lost input, speed and load, at time; null for one never received; empty unless to is'
        ' input_stale',
        kinds='object',
    ),
    RecordField('text', 'what happened, for a person', kinds='string'),
)
"""The fields of a warning: a change of a bearing's condition."""
BEARING = (
    _BEARING_NAME,
    RecordField(
        'time', 'nanoseconds since 1970 on the clock of the samples; 0 before the first', kinds='integer'
    ),
    RecordField('severity', 'severity', kinds='string', values=('OK', 'WARN', 'ERROR')),
    RecordField(
        'reason',
        'the condition as in the warnings, waiting, unreliable (normal by values that jump between two'
        ' sources), or not_monitoring',
        kinds='string',
        key='reason',
    ),
    RecordField('text', 'how it is now, for a person', kinds='string'),
    RecordField('monitoring', 'whether anybody watches the bearing', kinds='boolean'),
    _STICKING._replace(kinds='boolean null'),
    _GROWTH._replace(kinds='number null'),
    _CLEARS_IN,
    RecordField('held_until', 'clears_in as a time [ns]', kinds='integer null'),
    _RAISED,
    RecordField(
        'rpm',
        'speed of the shaft in revolutions a minute, negative astern',
        key='shaft speed [rpm]',
        metric='shaft_speed_rpm',
    ),
    RecordField(
        'order',
        'what the text asks for: raise_speed, stay_above or clears_above; null where it asks for nothing',
        kinds='string null',
    ),
    RecordField(
        'speed_to_reach', 'the speed of that order, rounded up as in the text; negative astern', 'rpm'
    ),
    *POINT,
    _MEASURED._replace(kinds='string null'),
    RecordField(
        'unmeasured',
        'why it says nothing; empty where it does',
        kinds='string',
        key='measured unknown',
        needs=LEVEL,
    ),
    RecordField(
        'unseen',
        'for how long stick-slip is predicted but not measured',
        's',
        key='predicted but not measured for [s]',
        needs=LEVEL,
    ),
    RecordField(
        'water_temperature',
        'temperature of the water by which friction is scaled',
        'C',
        'before the first value as configured or as when friction was measured; null without one',
        key='water temperature [C]',
        needs=WATER,
    ),
    RecordField(
        'viscosity_ratio',
        'viscosity of that water over its viscosity when friction was measured',
        note='null without a water temperature',
        key='viscosity ratio',
        needs=WATER,
    ),
)
"""The fields of a bearing as it is now, but for its inputs."""


ASSESSMENT = (
    _BEARING_NAME,
    *(item._replace(kinds='string') for item in _OPERATING_POINT[:2]),
    RecordField('sentence', 'the outcome, for a person', kinds='string'),
    # These always have a value: what is assessed is given.
    *(
        item._replace(kinds='number') if item.name in ('speed', 'load', 'growth_rate') else item
        for item in ASSESSED
    ),
)
"""The fields of what ``assess`` prints."""


def schema_of(rows: tuple[RecordField, ...], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return ``required`` and ``properties`` of the JSON schema of an object with these fields.

    ``optional`` names fields that are not required.
    """
    return {
        'required': [item.name for item in rows if item.name not in optional],
        'properties': {item.name: item.schema for item in rows},
    }
