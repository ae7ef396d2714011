# SPDX-License-Identifier: Apache-2.0
"""Write a parameter file for a bearing from its drawing and a data sheet.

Every value comes with the formula and the source that it follows from, and with its tolerance.
What has no published typical value is asked for. A quantity may state its relative standard
deviation after a tilde: 0.15~30%. Called bare on a terminal it asks for one value after the other.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

from stickslip_logs.units import factors_of
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.bearing_records import finite_or_none
from stickslip_monitor.monitor.config_questions import blade_question
from stickslip_monitor.monitor.configuration import bearing_names, check_topic, split_load_table
from stickslip_monitor.monitor.parameters import INPUT_PARAMETERS, LOAD_UNITS
from stickslip_monitor.monitor.value_check import Parameter, refused
from stickslip_monitor.physics.averaging import fold_speed, hopf_speed
from stickslip_monitor.physics.bearing import SPEED_UNITS
from stickslip_monitor.physics.bearing_estimate import (
    DENSITY,
    ELSEWHERE,
    LOAD_EXPONENT,
    MAX_HARDNESS,
    MIN_HARDNESS,
    Estimate,
    FoldShift,
    Given,
    bearing_of,
    estimate,
    fold_shifts,
)
from stickslip_monitor.physics.cycles import end_of_vibration
from stickslip_monitor.safe_files import printable

SCHEMA = 'stickslip_monitor/init/2'
MARK = '# Written by stickslip init'
_TABLE_TEXT = "of the alignment calculation, as '0:32, 60:28, 120:19' in rpm and the unit of the load"
_PAIR = re.compile(r'\s*([\d.eE+-]+)\s*:\s*([\d.eE+-]+)\s*')
_SPREAD = re.compile(r'(.*?)\s*~\s*(\d+(?:\.\d*)?)\s*%\s*')


class Quantity(NamedTuple):
    """Value to be given, by an option or in the dialogue."""

    name: str
    units: dict[str, float]  # SI per unit
    low: float  # [SI]
    high: float
    text: str

    @property
    def option(self) -> str:
        """Name of the option."""
        return f'--{self.name.replace("_", "-")}'

    @property
    def question(self) -> str:
        """Question of the dialogue, with the units that an answer may have."""
        units = ' or '.join(unit for unit in self.units if unit)
        return self.text + (f', in {units}' if units else '')

    def read(self, text: str) -> Given:
        """Read the value [SI] of a text such as ``20mm`` or ``0.15~30%``, and its spread as a share (0.3).

        Without a spread that is ``nan``.

        Raises:
            ConfigurationError: The text is malformed or out of bounds; the message has units and bounds.
        """
        spread = _SPREAD.fullmatch(text)
        number, unit = options.read_quantity(self.option, spread.group(1) if spread else text, self.units)
        value = number * self.units[unit]
        if not self.low <= value <= self.high:
            name, factor = next(iter(self.units.items()))
            bounds = self.low / factor, self.high / factor
            raise refused(self.option, text, Parameter(self.option, 'float', None, '', name, *bounds).rule())
        if spread and not 0.0 < float(spread.group(2)) < 100.0:
            raise refused(self.option, text, 'a number with a spread of 0 to 100 %')
        return Given(value, float(spread.group(2)) / 100.0) if spread else Given(value)


_LENGTH, _PLAIN = factors_of('mm', 'm'), {'': 1.0}
_RING_DOWN = 'damping ratio of a ring-down of the wet lining (first_alarm.md, section 2)'
_LOSS = 'loss factor (tan delta) of the rubber, from its data sheet'
_STATIC = (
    'friction coefficient at creep, wet (first_alarm.md, section 3; stickslip fit makes all three of a curve)'
)
_DECAY = 'decay of friction: one over the speed [m/s] at which 37 % of its fall is left'
NEEDS = (
    (Quantity('journal_diameter', _LENGTH, 0.02, 2.0, 'diameter of the journal (shaft sleeve)'),),
    (
        Quantity('length', _LENGTH, 0.01, 5.0, 'loaded length of the bearing'),
        Quantity('area', factors_of('m2', 'cm2'), 1e-4, 10.0, 'loaded area of the lining'),
    ),
    (Quantity('thickness', _LENGTH, 1e-3, 0.2, 'thickness of the rubber'),),
    (
        Quantity('hardness', _PLAIN, MIN_HARDNESS, MAX_HARDNESS, 'hardness of the rubber [Shore A]'),
        Quantity('shear_modulus', factors_of('MPa'), 1e5, 1e8, 'shear modulus of the rubber'),
    ),
    (
        Quantity('damping_ratio', _PLAIN, 1e-4, 0.9, _RING_DOWN),
        Quantity('loss_factor', _PLAIN, 1e-3, 1.5, _LOSS),
    ),
    (Quantity('static', _PLAIN, 0.001, 3.0, _STATIC),),
    (Quantity('kinetic', _PLAIN, 0.0, 3.0, 'friction coefficient at full speed, wet'),),
    (Quantity('decay', {'s/m': 1.0}, 0.01, 1e4, _DECAY),),
    (Quantity('load', factors_of('kN') | LOAD_UNITS, 1.0, 1e8, 'mean load, as of the shaft alignment'),),
)
"""What has to be known: of each line one, within bounds [SI] beyond which it is a slip of the unit."""
_DENSITY = Quantity('density', {'kg/m3': 1.0}, 500.0, 3000.0, 'density of the rubber')
_QUANTITIES = {item.name: item for need in (*NEEDS, (_DENSITY,)) for item in need}
_CURVE = 'a friction curve of the material in water, then stickslip fit'
_NEXT = {
    'damping': 'a ring-down or impact test of the wet lining',
    'static': _CURVE,
    'kinetic': _CURVE,
    'decay': _CURVE,
    'load': 'a jack-up test, or a load sensor',
    LOAD_EXPONENT: 'a second friction curve at another load, then stickslip fit with a column of loads',
}
_TOLERANCES = ('damping', 'static', 'kinetic', 'decay', 'load')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    for item in _QUANTITIES.values():
        # A help text is a format of argparse.
        parser.add_argument(item.option, metavar='VALUE', help=item.question.replace('%', '%%'))
    text = 'rubber, for its density (default nitrile)'
    parser.add_argument('--material', choices=DENSITY, default='nitrile', help=text)
    parser.add_argument('--name', default='aft_stern', help='name of the bearing (default aft_stern)')
    text = 'topic of the shaft speed (default /shaft/speed)'
    parser.add_argument('--speed-topic', default='/shaft/speed', metavar='TOPIC', help=text)
    parser.add_argument(
        '--speed-unit', choices=SPEED_UNITS, default='rpm', help='unit of that speed (default rpm)'
    )
    text = 'gear between the engine and the shaft, where that topic has the speed of the engine'
    parser.add_argument('--gear', metavar='RATIO', help=text)
    text = f'load over the shaft speed {_TABLE_TEXT}, in place of the mean load'
    parser.add_argument('--load-over-speed', metavar='TABLE', help=text)
    text = 'topic of the load; without it the mean load is taken'
    parser.add_argument('--load-topic', metavar='TOPIC', help=text)
    parser.add_argument(
        '--load-unit',
        choices=LOAD_UNITS,
        default='kN',
        help='unit of --load-topic and --load-over-speed (default kN)',
    )
    marks = {'': MARK.encode()}
    options.add_file(parser, '--output', '-o', marks=marks, help='parameter file to write')
    options.add_shared(parser, '--force', '--json')


def run(args: argparse.Namespace) -> int:
    """Print a parameter file and what to measure next; write the file if asked; return 0.

    Given nothing on a terminal, ask for all; answers and the file to write are stored in ``args``.

    Raises:
        ConfigurationError: A value is missing, given twice, or refused.
        OutputError: The file cannot be written, or replaces one that is not ours.
    """
    given = {
        name: item.read(getattr(args, name))
        for name, item in _QUANTITIES.items()
        if getattr(args, name) is not None
    }
    if not given and sys.stdin.isatty():
        given = ask(input)
        ask_more(input, args)
        args.output = args.output or f'{args.name}.yaml'
        output.check_files(args)
    _read_gear(args.gear)
    table = _read_table(args.load_over_speed)
    if table and args.load_topic is not None:
        raise ConfigurationError('--load-over-speed and --load-topic are given: choose one')
    if table and 'load' not in given:
        given['load'] = Given(sum(table[1::2]) / len(table[1::2]) * LOAD_UNITS[args.load_unit])
    require_complete(given)
    bearing_names({'bearings': [args.name]})
    check_topic('--speed-topic', args.speed_topic)
    if args.load_topic is not None:
        check_topic('--load-topic', args.load_topic)
    values = estimate(given, args.material)
    text = parameter_file_text(values, args)
    if args.json:
        output.print_json(to_json(values, text))
    else:
        output.console().print(f'{text}\n{summary_text(values)}', markup=False, soft_wrap=True)
    output.write_outputs(args, output=lambda: text)
    return 0


def ask(answer: Callable[[str], str]) -> dict[str, Given]:
    """Ask until there is one value of each line of :data:`NEEDS`, and return the values by name.

    An empty answer moves on to the alternative. A refused value is reported by ``answer``, and asked again.

    Args:
        answer: Shows a text and returns what is typed.
    """
    given: dict[str, Given] = {}
    for need in NEEDS:
        while not any(item.name in given for item in need):
            for item in need:
                text = answer(f'{item.question}: ').strip()
                try:
                    values = {item.name: item.read(text)} if text else {}
                    _require_fall(given | values)
                    given |= values
                except ConfigurationError as error:
                    answer(f'{printable(str(error))}; press Enter ')
                if item.name in given:
                    break
    return given


def ask_more(answer: Callable[[str], str], args: argparse.Namespace) -> None:
    """Ask for gear and table of loads, each unless ``args`` has it, and store the answers there.

    An empty answer leaves ``None``. ``answer`` is as for :func:`ask`; a refused value is reported by it, and
    asked again.
    """
    for name, read, text in (
        ('gear', _read_gear, 'gear between engine and shaft, where the engine speed is measured'),
        ('load_over_speed', _read_table, f'load over the shaft speed {_TABLE_TEXT}'),
    ):
        while getattr(args, name) is None:
            text = answer(f'{text}; Enter for none: ').strip()
            if not text:
                break
            try:
                read(text)
                setattr(args, name, text)
            except ConfigurationError as error:
                answer(f'{printable(str(error))}; press Enter ')


def _read_gear(text: str | None) -> float:
    """Return the ratio of a gear; 1 for None.

    Raises:
        ConfigurationError: The text is not a valid ratio.
    """
    if text is None:
        return 1.0
    (row,) = (parameter for parameter in INPUT_PARAMETERS['speed'] if parameter.name == 'speed.gear')
    try:
        gear: float = row.checked('--gear', {'--gear': float(text)})
    except ValueError as error:
        raise refused('--gear', text, row.rule()) from error
    return gear


def _read_table(text: str | None) -> list[float]:
    """Return a table as speed [rpm], load, speed, load, ... in the unit of the load; [] for None.

    Raises:
        ConfigurationError: The text is not 2 to 16 pairs of rising speed, or a load is not above 0.
    """
    if text is None:
        return []
    pairs = [_PAIR.fullmatch(pair) for pair in text.split(',')]
    numbers = [float(number) for pair in pairs if pair for number in pair.groups()]
    if None in pairs or not all(math.isfinite(number) for number in numbers):
        raise refused('--load-over-speed', text, 'pairs of a shaft speed in rpm and a load, as 0:32, 60:28')
    _, loads = split_load_table('--load-over-speed', numbers)
    if min(loads) <= 0.0:
        raise refused('--load-over-speed', text, 'loads above 0')
    return numbers


def require_complete(given: Mapping[str, Given]) -> None:
    """Check that of each line of :data:`NEEDS` exactly one value is given, and that friction falls.

    Raises:
        ConfigurationError: Nothing is given of some lines, all of which are named, or more than one value of
            a line; or static friction is not above kinetic.
    """
    missing = []
    for need in NEEDS:
        given_options = [item.option for item in need if item.name in given]
        if len(given_options) > 1:
            raise ConfigurationError(f'{" and ".join(given_options)} are given: choose one')
        if not given_options:
            missing.append(' or '.join(item.option for item in need))
    if missing:
        raise ConfigurationError(
            f'missing: {", ".join(missing)} (see stickslip init --help). None has a typical value worth'
            ' a warning; a spread may follow a tilde, as in 0.15~30%'
        )
    _require_fall(given)


def _require_fall(given: Mapping[str, Given]) -> None:
    """Check that static friction is above kinetic, where both are given.

    Raises:
        ConfigurationError: It is not.
    """
    static, kinetic = given.get('static'), given.get('kinetic')
    if static and kinetic and static.value <= kinetic.value:
        raise ConfigurationError(
            f'--static {static.value:g} must be above --kinetic {kinetic.value:g}: friction that'
            ' does not fall brings no stick-slip'
        )


def _format_number(value: float, places: int = 6) -> str:
    """Return a number to ``places`` significant digits, with the point or exponent of a float of ROS 2."""
    text = f'{value:.{places}g}'
    return text if set(text) & set('.e') else f'{text}.0'


def parameter_file_text(values: Sequence[Estimate], args: argparse.Namespace) -> str:
    """Return the text of the parameter file, with formula, source and spread of values as comments.

    Raises:
        ConfigurationError: The gear or the table of loads over speed cannot be read.
    """
    by_name = {item.name: item for item in values}
    spreads = ', '.join(f'{name}: {_format_number(by_name[name].spread, 2)}' for name in _TOLERANCES)
    load = f'{{constant: {_format_number(by_name["load"].value / 1e3)}, unit: kN}}  # assumed'
    if args.load_topic is not None:
        load = f'{{topic: {args.load_topic}, unit: {args.load_unit}}}'
    elif table := _read_table(args.load_over_speed):
        pairs = ', '.join(map(_format_number, table))
        load = (
            f'{{over_speed: [{pairs}], unit: {args.load_unit}}}  # rpm, load, rpm, load, ... of the alignment'
        )
    gear = '' if args.gear is None else f', gear: {_format_number(_read_gear(args.gear))}'
    law = ', '.join(
        f'{name}: {_format_number(by_name[name].value)}' for name in ('static', 'kinetic', 'decay')
    )
    lines = [
        f'{MARK}. Each value says where it comes from; replace what you measure.',
        '/**:',
        '  ros__parameters:',
        f'    bearings: [{args.name}]',
        f'    {args.name}:',
        f'      journal_diameter: {_format_number(by_name["journal_diameter"].value)}  # m, given',
    ]
    for name in ('mass', 'damping', 'stiffness'):
        item = by_name[name]
        lines.append(
            f'      # {item.unit}; {item.origin}; +-{item.spread:.0%}\n'
            f'      {name}: {_format_number(item.value)}'
        )
    lines += [
        f'      friction: {{law: stribeck, {law}}}',
        '      # Relative standard deviations of the values above.',
        f'      tolerance: {{{spreads}}}',
        f'      speed: {{topic: {args.speed_topic}, unit: {args.speed_unit}{gear}}}',
        f'      load: {load}',
    ]
    return '\n'.join(lines) + '\n'


def summary_text(values: Sequence[Estimate]) -> str:
    """Return lines of text: boundaries and lining frequency at the mean load, and what to measure next.

    A load that the number of blades makes doubtful has a line, too. There is no newline after the last one.
    """
    bearing, load = bearing_of(values), values[-1].value
    per_rpm = bearing.speed.factor('rpm')
    fold, hopf = (float(at(bearing, load)) / per_rpm for at in (end_of_vibration, hopf_speed))
    frequency = bearing.natural_frequency / math.tau
    if fold != fold:
        head = f'At {load / 1e3:.4g} kN this bearing has no stick-slip at any speed'
    else:
        head = (
            f'At {load / 1e3:.4g} kN stick-slip starts by itself below {hopf:.3g} rpm and can last'
            f' up to {fold:.3g} rpm'
        )
    lines = [f'{head}; the lining vibrates at {frequency:.3g} Hz.']
    if text := blade_question(bearing, load):
        lines.append(f'The load {text}')
    lines.append('Measure next:')
    lines += [f'  {line}' for line in _next_lines(fold_shifts(values))]
    return '\n'.join(lines)


def _next_lines(ranked: Sequence[FoldShift]) -> Iterator[str]:
    """Yield for each parameter, as ranked, a line on its effect on the fold speed and how to measure it."""
    for effect in ranked:
        low, high = sorted((effect.below, effect.above))
        spread_text = f'known to {effect.spread:.0%}'
        if effect.name == LOAD_EXPONENT:
            spread_text = (
                f'unknown between 0 and 1, of a curve at {ELSEWHERE:g} times the load or its inverse'
            )
        yield (
            f'{effect.name}, {spread_text}: moves the fold speed by {low:+.0%} to'
            f' {high:+.0%}; {_NEXT.get(effect.name, "measure it")}'
        )


def to_json(values: Sequence[Estimate], text: str) -> dict[str, Any]:
    """Return the estimates, the load last, as the documented JSON object with the parameter file's text.

    Numbers that are not finite are ``None``.
    """
    bearing, load = bearing_of(values), values[-1].value
    return {
        'schema': SCHEMA,
        'values': [asdict(item) for item in values],
        'hopf_speed': finite_or_none(hopf_speed(bearing, load)),
        'fold_speed': finite_or_none(end_of_vibration(bearing, load)),
        'fold_speed_kbm': finite_or_none(fold_speed(bearing, load)),
        'measure_next': [
            {
                'name': e.name,
                'spread': e.spread,
                'below': finite_or_none(e.below),
                'above': finite_or_none(e.above),
            }
            for e in fold_shifts(values)
        ],
        'file': text,
    }
