# SPDX-License-Identifier: Apache-2.0
"""Declares and parses options: files, numbers, the bearing, ranges, and quantities such as ``20rpm``.

An option that names a file is added by :func:`add_file`, so that :func:`.output.check_files` knows
all that a command reads and writes.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from stickslip_monitor.errors import ConfigurationError, OutputError
from stickslip_monitor.monitor.value_check import Parameter, refused
from stickslip_monitor.safe_files import PICTURES

if TYPE_CHECKING:
    from stickslip_monitor.drawing.map import Range
    from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
    from stickslip_monitor.physics.bearing import BearingSpeed

Marks = Mapping[str, bytes | None]
"""By its ending, what the beginning of a file of ours contains; None where only the contents can
show, as of a table by its headings. The ending '' stands for any other."""

TABLE: Marks = {'.csv': None}
ONE_OF_SEVERAL = 'which bearing, where several are configured'
_QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*')
_SHARED: Mapping[str, Mapping[str, Any]] = {
    '--bearing': {'metavar': 'NAME', 'help': 'only this bearing'},
    '--node': {'metavar': 'NAME', 'help': 'full name of the node, where the parameter file is for several'},
    '--force': {'action': 'store_true', 'help': 'replace files that stickslip did not write'},
    '--json': {'action': 'store_true', 'help': 'print JSON: SI units, null for no value'},
    '--diagnostics': {
        'default': '/diagnostics',
        'metavar': 'TOPIC',
        'help': 'topic of the diagnostics (default /diagnostics)',
    },
}

OptionGroup = argparse._ActionsContainer  # a parser or a group of its options


@dataclass(frozen=True, slots=True)
class FileOption:
    """Option for a path to read, or to write where it has marks or is a recording."""

    dest: str
    spelling: str  # what a user knows it by
    marks: Marks | None = None  # of an output
    renews: bool = False  # whether an output may take the place of an input of the same kind
    is_folder: bool | None = None  # of a recording to write: whether it is a folder for such

    @property
    def is_read(self) -> bool:
        """Whether the option names an input."""
        return self.marks is None and self.is_folder is None

    def paths(self, args: argparse.Namespace) -> Sequence[str]:
        """Return the paths given for the option; empty without it.

        Raises:
            OutputError: One is an empty text.
        """
        value = getattr(args, self.dest)
        if value is None:
            return ()
        paths = [value] if isinstance(value, str) else list(value)
        if '' in paths:
            raise OutputError(f'{self.spelling} is given an empty name')
        return paths


def add_file(
    options: OptionGroup,
    *names: str,
    marks: Marks | None = None,
    renews: bool = False,
    is_folder: bool | None = None,
    **more: Any,
) -> None:
    """Add an argument for a path and register it for :func:`.output.check_files`.

    It is an input unless ``marks`` or ``is_folder`` is given.

    Args:
        options: The parser.
        names: The option's spellings.
        marks: For a file to write, its allowed endings; see :data:`Marks`.
        renews: Whether it may replace an input of the same kind.
        is_folder: For recordings to write: True for a folder of them, False for one file.
        more: Keywords of ``add_argument``.
    """
    action = options.add_argument(*names, **({'metavar': 'FILE'} if marks else {}) | more)
    spelling = (*action.option_strings, action.dest)[0]
    files = options.get_default('files') or ()
    options.set_defaults(files=(*files, FileOption(action.dest, spelling, marks, renews, is_folder)))


def add_shared(options: OptionGroup, *names: str, **more: Any) -> None:
    """Add options that several commands have, as ``--json``.

    Keywords ``more`` of ``add_argument`` replace the usual ones.
    """
    for name in names:
        options.add_argument(name, **{**_SHARED[name], **more})


def add_picture(options: OptionGroup, text: str) -> None:
    """Add ``--picture``, an output; ``text`` says what the picture shows."""
    add_file(options, '--picture', marks=PICTURES, help=f'.png or .svg: {text}')


def add_config(options: OptionGroup, *, required: bool = True, node: bool = True) -> None:
    """Add ``--config``, and if ``node`` also ``--node``, to choose one in a file for several."""
    add_file(options, '--config', '-c', required=required, metavar='FILE', help='ROS 2 parameter file')
    if node:
        add_shared(options, '--node')


def add_drawing(parser: argparse.ArgumentParser) -> None:
    """Add the options of both drawing commands: configuration, bearing, output file, and ``--force``."""
    add_config(parser)
    add_shared(parser, '--bearing', help=ONE_OF_SEVERAL)
    text = 'file to write: .png, .svg or .csv'
    add_file(parser, '--output', '-o', required=True, marks={**PICTURES, **TABLE}, help=text)
    add_shared(parser, '--force')


def add_number(
    options: OptionGroup,
    name: str,
    low: float,
    high: float = math.inf,
    *,
    above: bool = False,
    kind: type[float] = int,
    **more: Any,
) -> None:
    """Add an option that takes a number from ``low`` (``above``: greater than it) to ``high``.

    It is a whole number unless ``kind`` is float. The parser raises ConfigurationError for any other. The
    keywords ``more`` are argparse's.
    """
    keywords: dict[str, Any] = {'rule': (low, high, above), 'kind': kind, 'type': partial(_read_number, kind)}
    options.add_argument(name, action=_Number, **keywords, **more)


def _read_number(kind: type[float], text: str) -> float | str:
    """Return the number of a text; any other text unchanged, for the caller to refuse."""
    try:
        return kind(text)
    except ValueError:
        return text


class _Number(argparse.Action):
    """Stores a number; raises ConfigurationError for one out of bounds, or a text that is not a number.

    ``rule`` has the least, the greatest, and whether the least itself is not allowed.
    """

    def __init__(self, *, rule: tuple[float, float, bool], kind: type[float], **more: Any) -> None:
        super().__init__(**more)
        self.rule, self.kind = rule, kind

    def __call__(
        self, parser: argparse.ArgumentParser, args: Any, value: Any, name: str | None = None
    ) -> None:
        (low, high, above), option = self.rule, self.option_strings[0]
        row = Parameter(option, self.kind.__name__, None, '', minimum=low, maximum=high, above_minimum=above)
        setattr(args, self.dest, row.checked(option, {option: value}))


def read_quantity(noun: str, text: str, units: Iterable[str]) -> tuple[float, str]:
    """Read number and unit of a text such as ``'20rpm'``.

    Case is ignored, but for the prefix M (mega).

    Args:
        noun: What the text is for, in the error.
        text: The text.
        units: The allowed units; '' allows a plain number.

    Returns:
        The number as written, not converted, and its unit as spelled in ``units``.

    Raises:
        ConfigurationError: The text is not a finite number with one of the units; the message lists them.
    """
    match = _QUANTITY.fullmatch(text)
    written = match.group(2) if match else ''
    named = [unit for unit in units if unit]
    unit = {unit.lower(): unit for unit in units}.get(written.lower())
    if unit is not None and unit[:1] == 'M' != written[:1]:
        unit = None  # m is milli, and not mega
    if match is None or unit is None or not math.isfinite(float(match.group(1))):
        why = f", and '{written}' is none of these" if written and unit is None and named else ''
        rule = f'a number with a unit: one of {", ".join(named)}{why}' if named else 'a number'
        raise refused(noun, text, rule)
    return float(match.group(1)), unit


def parse_speed(text: str, conversion: BearingSpeed, noun: str = 'speed') -> float:
    """Return the surface speed [m/s] of a text such as ``'20rpm'``, which may be negative.

    Raises:
        ConfigurationError: It has no number or no unit of a speed; the text names ``noun``.
    """
    from stickslip_monitor.physics.bearing import SPEED_UNITS

    return float(conversion.to_surface(*read_quantity(noun, text, SPEED_UNITS)))


def parse_load(text: str, noun: str = 'load') -> float:
    """Return the load [N] of a text such as ``'1.2kN'``, which may be negative.

    Raises:
        ConfigurationError: It has no number or no unit of a load; the text names ``noun``.
    """
    from stickslip_monitor.monitor.parameters import LOAD_UNITS

    value, unit = read_quantity(noun, text, LOAD_UNITS)
    return value * LOAD_UNITS[unit]


def parse_positive_load(text: str) -> float:
    """Return the load [N] of a text such as ``'1.2kN'``, which must be above 0.

    Raises:
        ConfigurationError: It is not a load with a unit, or not above 0.
    """
    load = parse_load(text)
    if load <= 0.0:
        raise refused('load', text, 'above 0: without load, no friction')
    return load


def load_chosen(args: argparse.Namespace) -> MonitorConfig:
    """Load the configuration, of all bearings or of the one of ``--bearing``.

    Raises:
        ConfigurationError: It cannot be read, or has no such bearing.
    """
    # Taking a configuration takes time to import, and is not needed for help.
    from stickslip_monitor.monitor.parameter_file import load_config

    config = load_config(args.config, args.node)
    if args.bearing is None:
        return config
    return replace(config, bearings=(config.bearing(args.bearing),))


def require_single_bearing(config: MonitorConfig) -> BearingConfig:
    """Return the only bearing of a configuration.

    Raises:
        ConfigurationError: There are several; the text names them and the option that chooses one.
    """
    if len(config.bearings) > 1:
        names = ', '.join(bearing.name for bearing in config.bearings)
        raise ConfigurationError(f'several bearings are configured: choose --bearing from {names}')
    return config.bearings[0]


def parse_speed_range(text: str | None, config: BearingConfig) -> Range | None:
    """Return the surface speeds [m/s] of a text such as ``'5rpm:45rpm'``; ``None`` for no text.

    Raises:
        ConfigurationError: The text is not of this form, or the speeds do not rise or are below 0.
    """
    conversion = config.bearing.speed
    return parse_range(text, 'speeds', lambda part: parse_speed(part, conversion, 'speeds'))


def parse_range(text: str | None, noun: str, parse: Callable[[str], float]) -> Range | None:
    """Return the two quantities of a text ``'LOW:HIGH'``, as numbers; ``None`` for no text.

    Args:
        text: The text.
        noun: Name of the quantity, for the error.
        parse: Parses each of the two.

    Raises:
        ConfigurationError: The text is not of this form, or the numbers do not rise or are below 0.
    """
    if text is None:
        return None
    parts = text.split(':')
    if len(parts) != 2:
        raise refused(noun, text, 'LOW:HIGH, each with its unit')
    low, high = parse(parts[0]), parse(parts[1])
    if not 0.0 <= low < high:
        raise refused(noun, text, 'rising from its first value, not below 0, to its second')
    return low, high
