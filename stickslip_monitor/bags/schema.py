# SPDX-License-Identifier: Apache-2.0
"""Message definitions in ``ros2msg`` text, and the way to one number in them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from stickslip_monitor.fields import FieldPath

# numpy codes, without byte order, of what the mcap-ros2-support decoder reads for each type; it
# takes char as signed.
NUMBERS: Mapping[str, str] = {
    'bool': '?',
    'byte': 'u1',
    'char': 'i1',
    'int8': 'i1',
    'uint8': 'u1',
    'int16': 'i2',
    'uint16': 'u2',
    'int32': 'i4',
    'uint32': 'u4',
    'int64': 'i8',
    'uint64': 'u8',
    'float32': 'f4',
    'float64': 'f8',
}
TEXTS = ('string', 'wstring')

# A definition that is longer is none of telemetry; the longest of ROS 2 have some 60 kB [bytes].
LONGEST_TEXT = 1 << 18
_MOST_DIGITS = 10

# CDR counts items with 32 bits.
_LONGEST_SEQUENCE = (1 << 32) - 1

_TYPE = re.compile(r'(?P<base>[\w/]+)(?:<=\d+)?(?P<array>\[(?:<=)?\d*\])?')
_SEPARATOR = re.compile(r'^={3,}$', re.MULTILINE)


class SchemaError(Exception):
    """A definition cannot be used, or a path does not fit it; the text is a clause."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field: ``base`` is a primitive or a type name; ``size`` is the length of a fixed array.

    ``bound`` is the largest length of a bounded sequence.
    """

    name: str
    base: str
    is_array: bool = False
    size: int | None = None
    bound: int | None = None

    @property
    def text(self) -> str:
        """The type as a message definition writes it."""
        if not self.is_array:
            return self.base
        limit = f'<={self.bound}' if self.bound is not None else ''
        return f'{self.base}[{self.size if self.size is not None else limit}]'


Definitions = Mapping[str, tuple[Field, ...]]

# What the decoder assumes where the text does not define them.
_TIME = (Field('sec', 'uint32'), Field('nanosec', 'uint32'))


def short_name(name: str) -> str:
    """Write a type name without its middle: ``std_msgs/msg/Float64`` is ``std_msgs/Float64``."""
    parts = name.split('/')
    return f'{parts[0]}/{parts[-1]}'


def parse_schema(name: str, text: str) -> Definitions:
    """Parse a concatenated message definition.

    Args:
        name: Type of the message, e.g. ``std_msgs/msg/Float64``.
        text: Its definition, followed by those of the types it uses.

    Returns:
        Fields of every type by short name.

    Raises:
        SchemaError: A line is not a field, or a type is used but not defined.
    """
    found: dict[str, tuple[Field, ...]] = {
        'builtin_interfaces/Time': _TIME,
        'builtin_interfaces/Duration': _TIME,
    }
    for number, part in enumerate(_SEPARATOR.split(text)):
        lines = [line for line in map(_without_comment, part.splitlines()) if line]
        if lines and lines[0].startswith('MSG:'):
            name = lines.pop(0).removeprefix('MSG:').strip()
        elif number:
            raise SchemaError('its definition has a part without a name')
        package = name.split('/')[0]
        fields = [_field(line, package) for line in lines if not _is_constant(line)]
        found[short_name(name)] = tuple(fields)
    _check_defined(found)
    return found


def number_at(definitions: Definitions, root: str, path: FieldPath) -> str:
    """Follow a path through the definition of a type.

    Args:
        definitions: From :func:`parse_schema`.
        root: Type of the message.
        path: From :func:`stickslip_monitor.fields.parse_field`.

    Returns:
        The primitive at its end, a key of :data:`NUMBERS`.

    Raises:
        SchemaError: The path does not lead to a number.
    """
    steps = list(path)
    current = short_name(root)
    while steps:
        field = _member(definitions, current, steps.pop(0))
        if field.is_array:
            _check_element(field, steps)
        elif steps and isinstance(steps[0], int):
            raise SchemaError(f"'{field.name}' is a {field.base}, which has no element {steps[0]}")
        current = field.base
        if current in TEXTS or (current in NUMBERS and steps):
            rest = '' if current in TEXTS else f", which has no field '{steps[0]}'"
            raise SchemaError(f"'{field.name}' is a {current}{rest or ', not a number'}")
    if current not in NUMBERS:
        names = ', '.join(field.name for field in definitions[current])
        raise SchemaError(f'it ends at a {current}, not at a number: its fields are {names}')
    return current


def _member(definitions: Definitions, type_name: str, step: str | int) -> Field:
    fields = {field.name: field for field in definitions[type_name]}
    if isinstance(step, int) or step not in fields:
        names = ', '.join(fields) or 'none'
        raise SchemaError(f"{type_name} has no field '{step}': its fields are {names}")
    return fields[step]


def _check_element(field: Field, steps: list[str | int]) -> None:
    if not steps or not isinstance(steps[0], int):
        raise SchemaError(
            f"'{field.name}' is a {field.text}: name an element, e.g. {field.name}[0]"
        )
    index = steps.pop(0)
    limits = (field.size, field.bound, _LONGEST_SEQUENCE)
    limit = next(limit for limit in limits if limit is not None)
    if isinstance(index, int) and index >= limit:
        raise SchemaError(f"'{field.name}' is a {field.text}, which has no element {index}")


def _without_comment(line: str) -> str:
    return line.partition('#')[0].strip()


def _is_constant(line: str) -> bool:
    return re.match(r'\S+\s+\w+\s*=', line) is not None


def _field(line: str, package: str) -> Field:
    type_text, *rest = line.split()
    match = _TYPE.fullmatch(type_text)
    if match is None or not rest:
        raise SchemaError(f"its definition has the line '{line}', which is not a field")
    base, array = match['base'], match['array']
    if base not in NUMBERS and base not in TEXTS and '/' not in base:
        base = f'{package}/{base}'
    if array is None:
        return Field(rest[0], base)
    limit = array[1:-1].removeprefix('<=')
    bounded = array.startswith('[<=')
    if len(limit) > _MOST_DIGITS or (limit and int(limit) > _LONGEST_SEQUENCE):
        raise SchemaError(f"its definition has the line '{line}', an array that is too long")
    if bounded and not limit:
        raise SchemaError(f"its definition has the line '{line}', a bound without a number")
    return Field(
        rest[0], base, True,
        size=int(limit) if limit and not bounded else None,
        bound=int(limit) if bounded else None,
    )  # fmt: skip


def _check_defined(definitions: Definitions) -> None:
    for name, fields in definitions.items():
        for field in fields:
            if '/' in field.base and field.base not in definitions:
                raise SchemaError(f'its definition leaves {field.base}, used by {name}, undefined')
