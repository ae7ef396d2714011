# SPDX-License-Identifier: Apache-2.0
"""Parses types of messages: definitions in ``ros2msg`` text, with the texts known here, and fields."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from stickslip_logs.field_paths import NAMES, ByName, FieldPath
from stickslip_logs.recordings.recording import short_type
from stickslip_logs.units import KIB

# numpy codes, without byte order, of what the mcap-ros2-support decoder reads for each type; it
# takes char as signed.
_NUMPY_NAMES = 'int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64', 'float32', 'float64'
NUMBERS: Mapping[str, str] = {
    **{name: np.dtype(name).str[1:] for name in _NUMPY_NAMES},
    'bool': '?',
    'byte': 'u1',
    'char': 'i1',
}
TEXTS = ('string', 'wstring')

MAX_DEFINITION_BYTES = 256 * KIB
"""Longer definitions are none of telemetry; the longest of ROS 2 have some 60 kB [bytes]."""

# CDR counts items with 32 bits, and Python refuses to read thousands of digits.
_TYPE = re.compile(r'(?P<base>[\w/]+)(?:<=\d+)?(?P<array>\[(?:(?:<=)?(?P<length>\d{1,10}))?\])?')
_SEPARATOR = re.compile(r'^={3,}$', re.MULTILINE)
_CONSTANT = re.compile(r'\S+\s+\w+\s*=')

_BUILT_IN = Path(__file__).with_name('definitions.txt')


class SchemaError(Exception):
    """A definition cannot be used, or a path does not fit it; the text is a clause."""


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a type.

    ``base`` is a primitive or a type's name. ``array`` is how the definition writes that it is an
    array, empty for none; ``length`` is the number in its brackets, None for none.
    """

    name: str
    base: str
    array: str = ''
    length: int | None = None

    @property
    def size(self) -> int | None:
        """The length of an array that always has this one."""
        return None if '<=' in self.array else self.length

    @property
    def text(self) -> str:
        """The type as a message definition writes it."""
        return self.base + self.array


Definitions = Mapping[str, tuple[Field, ...]]

# What the decoder assumes where the text does not define them.
_TIME = (Field('sec', 'uint32'), Field('nanosec', 'uint32'))


def parse_schema(name: str, data: bytes) -> Definitions:
    """Parse a concatenated ``ros2msg`` definition; return the fields of each type by its short name.

    Constants are skipped. ``Time`` and ``Duration`` are among the types in any case.

    Args:
        name: The type that the first part defines.
        data: The definition, in UTF-8.

    Raises:
        SchemaError: It is too long or no text, a part has no name, a line is not a field or its array not
            valid, or a type is used but not defined.
    """
    if len(data) > MAX_DEFINITION_BYTES:
        raise SchemaError(f'its definition is longer than {MAX_DEFINITION_BYTES} letters, the limit')
    try:
        first, *sections = _SEPARATOR.split(data.decode())
    except UnicodeDecodeError:
        raise SchemaError('its definition is not text') from None
    parsed: dict[str, tuple[Field, ...]] = {
        'builtin_interfaces/Time': _TIME,
        'builtin_interfaces/Duration': _TIME,
    }
    parsed[short_type(name)] = _parse_fields(_strip_comments(first), name)
    for part in sections:
        head, *lines = _strip_comments(part) or ['']
        if not head.startswith('MSG:'):
            raise SchemaError('its definition has a part without a name')
        name = head.removeprefix('MSG:').strip()
        parsed[short_type(name)] = _parse_fields(lines, name)
    for name, members in parsed.items():
        for member in members:
            if '/' in member.base and member.base not in parsed:
                raise SchemaError(f'its definition leaves {member.base}, used by {name}, undefined')
    return parsed


def _strip_comments(text: str) -> list[str]:
    """Return the lines of a definition without comments, blanks around them, and empty lines."""
    lines = (line.partition('#')[0].strip() for line in text.splitlines())
    return [line for line in lines if line]


def _parse_fields(lines: Iterable[str], name: str) -> tuple[Field, ...]:
    """Return the fields that lines of a definition, without comments, declare; skip constants.

    The package of the type ``name`` is that of types without one.

    Raises:
        SchemaError: A line is not a field, or the length of its array is not a number.
    """
    package = name.split('/')[0]
    return tuple(_parse_field(line, package) for line in lines if not _CONSTANT.match(line))


def _parse_field(line: str, package: str) -> Field:
    """Parse the line of a field, which is not blank; ``package`` is that of a type without one.

    Raises:
        SchemaError: It is not a field, or the length of its array is not a number of up to ten digits.
    """
    type_text, *rest = line.split()
    match = _TYPE.fullmatch(type_text)
    if match is None or not rest:
        raise SchemaError(f"its definition has the line '{line}', which is not a field")
    base, length = match['base'], match['length']
    if base not in NUMBERS and base not in TEXTS and '/' not in base:
        base = f'{package}/{base}'
    return Field(rest[0], base, match['array'] or '', int(length) if length else None)


def find_primitive(definitions: Definitions, root: str, path: FieldPath) -> str:
    """Return the primitive type, such as ``float64``, of the number at a path in the type ``root``.

    The definitions have, by short name, the fields of the root and of all types within it.

    Raises:
        SchemaError: The path does not lead to a number.
    """
    field, members = Field('', short_type(root)), dict[str, Field]()
    for step in path:
        if field.array:
            if isinstance(step, str):
                break
            _check_element(field, step, members)
            field = replace(field, array='')
        elif isinstance(step, str) and field.base in definitions:
            members = {member.name: member for member in definitions[field.base]}
            if step not in members:
                names = ', '.join(members) or 'none'
                raise SchemaError(f"{field.base} has no field '{step}': its fields are {names}")
            field = members[step]
        else:
            part = f"field '{step}'" if isinstance(step, str) else f'element {step}'
            raise SchemaError(f"'{field.name}' is a {field.text}, which has no {part}")
    if field.array:
        raise SchemaError(f"'{field.name}' is a {field.text}: name an element, e.g. {field.name}[0]")
    if field.base not in NUMBERS:
        names = ', '.join(member.name for member in definitions.get(field.base, ()))
        its_fields = f': its fields are {names}' if names else ''
        raise SchemaError(f"'{field.name}' is a {field.text}, not a number{its_fields}")
    return field.base


def _check_element(array: Field, element: int | ByName, members: Mapping[str, Field]) -> None:
    """Check that an array field can have an element; ``members`` are the fields beside it, by name.

    Raises:
        SchemaError: It is too short, or has no list of names beside it by which an element could be chosen.
    """
    if isinstance(element, ByName):
        names = members.get(NAMES)
        if names is None or names.base != 'string' or not names.array:
            raise SchemaError(
                f"'{array.name}' has no list '{NAMES}' beside it to choose [{element}] by: give a number"
            )
    elif array.length is not None and element >= array.length:
        raise SchemaError(f"'{array.name}' is a {array.text}, which has no element {element}")


def definition_of(kind: str) -> str | None:
    """Return the ``ros2msg`` text of a type, by its full or short name, with the types that it uses.

    None where it is not built in; all that a built-in type uses is.
    """
    texts, names = _load_built_in(), list[str]()
    if short_type(kind) not in texts:
        return None
    _collect_names(short_type(kind), names)
    referred = (f'{"=" * 80}\nMSG: {name}\n{texts[name]}' for name in names[1:])
    return texts[names[0]] + ''.join(referred)


def _collect_names(name: str, names: list[str]) -> None:
    """Append a built-in type to ``names``, and behind it those it uses that are not there, by short names."""
    names.append(name)
    for member in _parse_fields(_strip_comments(_load_built_in()[name]), name):
        if '/' in member.base and member.base not in names:
            _collect_names(member.base, names)


@cache
def _load_built_in() -> dict[str, str]:
    """Return the texts of the types that this package brings, by short name."""
    _, *parts = re.split(r'^MSG: (.*)\n', _BUILT_IN.read_text('utf-8'), flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))
