# SPDX-License-Identifier: Apache-2.0
"""Numbers out of CDR messages: their definitions in ``ros2msg`` text, and the way to one number.

A message is a row of tokens.  A cursor steps over them: one number for all messages while nothing
of variable length was met, an array of one per message behind it.
Messages that this cannot follow are decoded one by one with mcap-ros2-support, which is also the
reference for the bulk reader.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import struct
import threading
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Schema
from mcap.well_known import MessageEncoding
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import BagError
from stickslip_logs.fields import NAMES, ByName, FieldPath, NoSuchElementError, NumberField
from stickslip_logs.files import read_file
from stickslip_logs.recordings.mcap_chunks import view_numbers
from stickslip_logs.recordings.recording import Fault, Request, Series, short_name

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

LONGEST_TEXT = 1 << 18
"""Longer definitions are none of telemetry; the longest of ROS 2 have some 60 kB [bytes]."""
_MOST_DIGITS = 10
# CDR counts items with 32 bits.
_LONGEST_SEQUENCE = (1 << 32) - 1
# Beyond this a message is no telemetry, and its tokens would cost more than they save.
_MOST_TOKENS = 500
# A type that contains itself has no end.
_DEEPEST = 50
# Names of elements that messages for others have are reported; a robot has some dozen joints.
_MAX_NAMES = 20

_TYPE = re.compile(r'(?P<base>[\w/]+)(?:<=\d+)?(?P<array>\[(?P<bound><=)?(?P<number>\d*)\])?')
_SEPARATOR = re.compile(r'^={3,}$', re.MULTILINE)
_CONSTANT = re.compile(r'\S+\s+\w+\s*=')

_ENCAPSULATION = 4
# As the two bytes lie in the message, read little-endian.
_CDR_LE, _CDR_BE = 0x0100, 0x0000
_SECOND = 1_000_000_000
_STAMP: tuple[FieldPath, ...] = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))

# The standard error belongs to the process, not to one of its threads.
_SILENCE = threading.Lock()
# Everything the decoder raises on data that is not of the type the schema describes.
_DECODE_ERRORS = (struct.error, ValueError, LookupError, NotImplementedError, RecursionError, MemoryError)


class SchemaError(Exception):
    """A definition cannot be used, or a path does not fit it; the text is a clause."""


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a type.

    ``base`` is a primitive or a type's name. ``array`` is how the definition writes that it is an
    array, empty for none; ``size`` the length of a fixed one, ``most`` the largest of any.
    """

    name: str
    base: str
    array: str = ''
    size: int | None = None
    most: int = _LONGEST_SEQUENCE

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
        SchemaError: It is too long or no text, a part has no name, a line is not a field, or a type is used
            but not defined.
    """
    if len(data) > LONGEST_TEXT:
        raise SchemaError(f'its definition is longer than {LONGEST_TEXT} letters, the limit')
    try:
        first, *sections = _SEPARATOR.split(data.decode())
    except UnicodeDecodeError:
        raise SchemaError('its definition is not text') from None
    parsed: dict[str, tuple[Field, ...]] = {
        'builtin_interfaces/Time': _TIME,
        'builtin_interfaces/Duration': _TIME,
    }
    parsed[short_name(name)] = _parse_fields(_strip_comments(first), name)
    for part in sections:
        head, *lines = _strip_comments(part) or ['']
        if not head.startswith('MSG:'):
            raise SchemaError('its definition has a part without a name')
        name = head.removeprefix('MSG:').strip()
        parsed[short_name(name)] = _parse_fields(lines, name)
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
    """Return the fields that lines of a definition declare; skip constants.

    Args:
        lines: The lines without comments.
        name: The type, whose package is that of types without one.

    Raises:
        SchemaError: A line is not a field, or its array is too long.
    """
    package = name.split('/')[0]
    return tuple(_parse_field(line, package) for line in lines if not _CONSTANT.match(line))


def _parse_field(line: str, package: str) -> Field:
    """Parse the line of a field.

    Args:
        line: The line, not blank.
        package: The package of a type without one.

    Raises:
        SchemaError: It is not a field, or its array is too long or has a bound without a number.
    """
    type_text, *rest = line.split()
    match = _TYPE.fullmatch(type_text)
    if match is None or not rest:
        raise SchemaError(f"its definition has the line '{line}', which is not a field")
    base, array, number = match['base'], match['array'] or '', match['number'] or ''
    if base not in NUMBERS and base not in TEXTS and '/' not in base:
        base = f'{package}/{base}'
    if len(number) > _MOST_DIGITS or int(number or 0) > _LONGEST_SEQUENCE:
        raise SchemaError(f"its definition has the line '{line}', an array that is too long")
    if match['bound'] and not number:
        raise SchemaError(f"its definition has the line '{line}', a bound without a number")
    max_length = int(number) if number else _LONGEST_SEQUENCE
    return Field(rest[0], base, array, max_length if number and not match['bound'] else None, max_length)


def find_primitive(definitions: Definitions, root: str, path: FieldPath) -> str:
    """Return the primitive type, such as ``float64``, of the number at a path in a type.

    Raises:
        SchemaError: The path does not lead to a number.
    """
    steps = list(path)
    current = short_name(root)
    while steps:
        step = steps.pop(0)
        members = {member.name: member for member in definitions[current]}
        if not isinstance(step, str) or step not in members:
            names = ', '.join(members) or 'none'
            raise SchemaError(f"{current} has no field '{step}': its fields are {names}")
        member = members[step]
        if member.array:
            _take_element(member, steps, members)
        elif steps and not isinstance(steps[0], str):
            raise SchemaError(f"'{step}' is a {member.base}, which has no element {steps[0]}")
        current = member.base
        if current in TEXTS or (current in NUMBERS and steps):
            rest = '' if current in TEXTS else f", which has no field '{steps[0]}'"
            raise SchemaError(f"'{step}' is a {current}{rest or ', not a number'}")
    if current not in NUMBERS:
        names = ', '.join(member.name for member in definitions[current])
        raise SchemaError(f'it ends at a {current}, not at a number: its fields are {names}')
    return current


def _take_element(member: Field, steps: list[str | int | ByName], members: Mapping[str, Field]) -> None:
    """Remove the next step of a path, which has to choose an element of an array field.

    Args:
        member: The array field.
        steps: The rest of the path; changed.
        members: The fields beside it, by name.

    Raises:
        SchemaError: There is no such step, or no such element.
    """
    index = steps.pop(0) if steps else None
    name, text = member.name, member.text
    if isinstance(index, ByName):
        names = members.get(NAMES)
        if names is None or names.base != 'string' or not names.array:
            raise SchemaError(
                f"'{name}' has no list '{NAMES}' beside it to choose [{index}] by: give a number"
            )
        return
    if not isinstance(index, int):
        raise SchemaError(f"'{name}' is a {text}: name an element, e.g. {name}[0]")
    if index >= member.most:
        raise SchemaError(f"'{name}' is a {text}, which has no element {index}")


class Token(NamedTuple):
    """A stretch of CDR data: ``length`` numbers of numpy type ``code``.

    Where there is no ``length``, it stands before them. A text is such a sequence of bytes.
    """

    code: str
    length: int | None = 1


Layout = tuple[Sequence[Token], Sequence[tuple[int, int]]]
"""Tokens of a message and, for each number wanted, its token and its place in it."""


def compile_layout(definitions: Definitions, root: str, paths: Sequence[FieldPath]) -> Layout | None:
    """Return where the numbers at some paths lie in messages of a type.

    None where the messages must be decoded one by one: an element is chosen by name, or the type has arrays
    of varying size in the way, or is too large.

    Args:
        definitions: The fields of all types.
        root: The type.
        paths: Paths that lead to numbers, as :func:`find_primitive` has checked.
    """
    if any(isinstance(step, ByName) for path in paths for step in path):
        return None
    tokens: list[Token] = []
    numbers: dict[FieldPath, int] = {}
    for path, token in _list_tokens(definitions, short_name(root), ()):
        if token is None or len(tokens) >= _MOST_TOKENS:
            return None
        numbers[path] = len(tokens)
        tokens.append(token)
    elements = [path[-1] if isinstance(path[-1], int) else None for path in paths]
    return tokens, [
        (numbers[path], 0) if element is None else (numbers[path[:-1]], element)
        for path, element in zip(paths, elements, strict=True)
    ]


def _list_tokens(
    definitions: Definitions, root: str, prefix: FieldPath
) -> Iterator[tuple[FieldPath, Token | None]]:
    """Yield each token of a type with its path, in the order of the data; None for what has no layout.

    An array of numbers is one token, a text one without a length. A wstring, an array without a fixed size
    and too deep nesting have no layout.
    """
    if len(prefix) > _DEEPEST:
        yield prefix, None
        return
    if not definitions[root]:
        # CDR has no empty structure; ROS 2 gives it one unused byte.
        yield (*prefix, ''), Token('u1')
    for member in definitions[root]:
        path = (*prefix, member.name)
        count = member.size if member.array else 1
        if member.base in NUMBERS:
            yield path, Token(NUMBERS[member.base], count)
        elif member.base == 'wstring' or count is None:
            yield path, None
        else:
            for member_path in ((*path, index) for index in range(count)) if member.array else [path]:
                if member.base in TEXTS:
                    yield member_path, Token('u1', None)
                else:
                    yield from _list_tokens(definitions, member.base, member_path)


def _gather_numbers(
    layout: Layout, data: bytes, offset: IntArray, size: IntArray, order: str
) -> tuple[list[NDArray[Any]], BoolArray]:
    """Gather numbers from messages by stepping through all of them at once.

    Args:
        layout: Their layout.
        data: What they lie in.
        offset: Where each message begins in it, shape (n,).
        size: How long it is [bytes], shape (n,).
        order: Its byte order, as numpy writes it.

    Returns:
        An array of shape (n,) for each number; and for which messages they are right, shape (n,).
        The others have to be decoded one by one, as they are too short or unusual.
    """
    sound = np.ones(len(offset), np.bool_)

    def fetch(code: str, place: int | IntArray) -> NDArray[Any]:
        """Return a number of each message, shape (n,); clear ``sound`` where the message ends before it.

        Args:
            code: The type of the number, as numpy writes it without byte order.
            place: Where it begins behind the head of the message [bytes]: one for all, or shape (n,).
        """
        numbers = view_numbers(data, order + code, _ENCAPSULATION)
        np.logical_and(sound, place + (_ENCAPSULATION + numbers.itemsize) <= size, out=sound)
        spot = offset + place
        numbers_there: NDArray[Any] = numbers[spot if sound.all() else np.where(sound, spot, 0)]
        return numbers_there

    tokens, targets = layout
    gathered_by_target: dict[tuple[int, int], NDArray[Any]] = {}
    place: int | IntArray = 0
    for number, (code, count) in enumerate(tokens):
        # A byte that is neither 0 nor 1 is still a bool, but not one numpy can hold.
        stored, width = 'u1' if code == '?' else code, np.dtype(code).itemsize
        length: int | IntArray = count or 0
        if count is None:
            place = _align_place(place, 4)
            length = fetch('u4', place).astype(np.int64)
            place = place + 4
        begin = _align_place(place, width)
        for target in targets:
            if target[0] == number and target not in gathered_by_target:
                sound &= target[1] < length
                values = fetch(stored, begin + target[1] * width)
                gathered_by_target[target] = values != 0 if code == '?' else values
        end = begin + length * width
        # Nothing is aligned for the items of a sequence that has none.
        place = np.where(length > 0, end, place) if count is None else end
    sound &= place + _ENCAPSULATION <= size
    return [gathered_by_target[target] for target in targets], sound


def _align_place(place: int | IntArray, size: int) -> int | IntArray:
    """Return the next multiple of a size at or behind a byte, or of each byte of an array."""
    return (place + size - 1) // size * size if size > 1 else place


def _find_decoder(schema: Schema) -> Callable[[bytes], Any]:
    """Return the function that decodes one message.

    Raises:
        SchemaError: The decoder refuses the definition, or its encoding.
    """
    try:
        # The parser prints what it raises.
        with _SILENCE, contextlib.redirect_stderr(io.StringIO()):
            decode = DecoderFactory().decoder_for(MessageEncoding.CDR, schema)
    except Exception as error:  # The parser raises whatever its parts raise.
        raise SchemaError(f'its definition cannot be parsed ({error})') from None
    if decode is None:
        raise SchemaError(f"its schema encoding '{schema.encoding}' is not ros2msg")
    return decode


@dataclass(slots=True)
class TopicNumbers:
    """The numbers wanted of one topic with the requests for each, and what was wrong with them.

    ``count`` is how many messages were read, ``reasons`` counts those without numbers, ``short``
    those whose array is too short for one, ``foreign`` those that name other elements, ``names``.
    """

    topic: str
    requests: Mapping[FieldPath, Sequence[Request]]
    count: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    short: Counter[int] = field(default_factory=Counter)
    foreign: Counter[int] = field(default_factory=Counter)
    names: set[str] = field(default_factory=set)
    _readers: dict[tuple[str, bytes], FieldReader | BagError] = field(default_factory=dict)

    @property
    def has_foreign(self) -> bool:
        """Whether messages may be for others: an element is chosen by its name."""
        return any(isinstance(step, ByName) for path in self.requests for step in path)

    @property
    def width(self) -> int:
        """Rows of an array of values: one for each number, and which messages are not for it."""
        return len(self.requests) * (2 if self.has_foreign else 1)

    def series(
        self, times: tuple[IntArray, IntArray, IntArray], values: FloatArray
    ) -> Iterator[tuple[Request, Series]]:
        """Yield each request and its series, without the messages that lack an element chosen by name.

        Args:
            times: Log times [ns], stamps [ns] and sequence numbers, shape (n,) each.
            values: What :meth:`FieldReader.read` gives, shape (width, n).
        """
        count = len(self.requests)
        for row, requests in enumerate(self.requests.values()):
            row_times, numbers = times, values[row]
            if self.has_foreign and (is_foreign := values[count + row] == 1.0).any():
                log_time_ns, stamp_ns, sequence = (column[~is_foreign] for column in times)
                row_times, numbers = (log_time_ns, stamp_ns, sequence), numbers[~is_foreign]
            series = Series(*row_times, numbers, ())
            yield from ((request, series) for request in requests)

    def count_foreign(self, row: int, names: Iterable[str]) -> None:
        """Count a message that lacks the element, chosen by name, of a path; keep up to some 20 of its names.

        Args:
            row: The number of the path.
            names: The names of the elements of the message.
        """
        self.foreign[row] += 1
        if len(self.names) < _MAX_NAMES:
            self.names.update(names)

    def reader(self, schema: Schema) -> FieldReader | BagError:
        """Return the cached reader of messages of a schema, or the error, not raised, if it has none."""
        key = schema.name, schema.data
        if key not in self._readers:
            try:
                self._readers[key] = FieldReader(self, schema)
            except BagError as error:
                self._readers[key] = error
        return self._readers[key]

    def faults(self) -> Iterator[tuple[Request, tuple[Fault, ...]]]:
        """Yield each request with the faults of its messages so far; an empty tuple where there are none.

        Messages that are for others count as faults only if all messages are.
        """
        for row, requests in enumerate(self.requests.values()):
            element = f"the element of field '{requests[0].field}'"
            short = f'lack {element}'
            # Messages for others are no fault, unless there are no others.
            foreign = self.foreign[row] if self.foreign[row] == self.count else 0
            named = f'do not name {element}: they name {", ".join(sorted(self.names))}'
            reasons = {**self.reasons, short: self.short[row], named: foreign}
            faults = tuple(
                Fault(count, f"{count} of {self.count} messages of '{self.topic}' {reason}")
                for reason, count in reasons.items()
                if count
            )
            yield from ((request, faults) for request in requests)


class FieldReader:
    """Reads the numbers wanted of a topic from messages of one definition, many at once.

    Raises:
        BagError: A path does not lead to a number, or the definition cannot be used.
    """

    def __init__(self, wanted: TopicNumbers, schema: Schema) -> None:
        self._wanted, self._paths = wanted, tuple(wanted.requests)
        self._fields = [NumberField(path) for path in self._paths]
        self._undecoded = f'cannot be decoded as {schema.name}'
        try:
            definitions = parse_schema(schema.name, schema.data)
            self._check_fields(wanted.topic, schema.name, definitions)
            self._stamped = _begins_with_header(definitions, schema.name)
            self._decode = _find_decoder(schema)
        except SchemaError as error:
            raise BagError(f"topic '{wanted.topic}' ({schema.name}) cannot be read: {error}") from None
        paths = (*self._paths, *(_STAMP if self._stamped else ()))
        self._layout = compile_layout(definitions, schema.name, paths)

    def _check_fields(self, topic: str, type_name: str, definitions: Definitions) -> None:
        """Check that all wanted paths lead to numbers.

        Args:
            topic: The topic, for the error.
            type_name: The type of its messages.
            definitions: The fields of all types.

        Raises:
            BagError: A path does not; the first one is named.
        """
        for path in self._paths:
            try:
                find_primitive(definitions, type_name, path)
            except SchemaError as error:
                steps = (f'.{s}' if isinstance(s, str) else f'[{s}]' for s in path)
                raise BagError(
                    f"field '{''.join(steps).removeprefix('.')}' of topic '{topic}' ({type_name})"
                    f' is no number: {error}'
                ) from None

    def read(
        self, data: bytes, offset: IntArray, size: IntArray, log_time_ns: IntArray
    ) -> tuple[FloatArray, IntArray]:
        """Read n messages, and count them and their faults in the ``TopicNumbers`` of this reader.

        Args:
            data: A block of records.
            offset: Where the data of each message begins in it, shape (n,).
            size: How long they are [bytes], shape (n,).
            log_time_ns: The log times [ns], shape (n,).

        Returns:
            Values, shape (width, n): a row for each path, NaN for a message without a number; then, where
            elements are chosen by name, a row for each path with 1 for a message that is not for it. And the
            stamps [ns], shape (n,): the log time where a message has none; the array of log times itself
            where the type has none.
        """
        count, faults = len(offset), self._wanted.reasons
        self._wanted.count += count
        values = np.full((self._wanted.width, count), np.nan)
        stamp_ns = log_time_ns.copy() if self._stamped else log_time_ns
        # As a rule all, which are not copied.
        rows: slice | IntArray = slice(None)
        if count and size.min() < _ENCAPSULATION:
            rows = np.flatnonzero(size >= _ENCAPSULATION)
            faults[self._undecoded] += count - rows.size
        # The two bytes of the representation: zero, and zero or one for plain CDR.
        kind = view_numbers(data, '<u2')[offset[rows]]
        for code, order in ((_CDR_LE, '<'), (_CDR_BE, '>')):
            is_own = kind == code
            if is_own.any():
                decodable = rows if is_own.all() else np.arange(count)[rows][is_own]
                for place in self._fill_rows(
                    values, stamp_ns, decodable, data, offset[decodable], size[decodable], order
                ).tolist():
                    begin = int(offset[place])
                    self._decode_alone(data[begin : begin + int(size[place])], place, values, stamp_ns)
            if is_own.all():
                return values, stamp_ns
        unknown = kind[(kind != _CDR_LE) & (kind != _CDR_BE)]
        for code, number in sorted(Counter(unknown.byteswap().tolist()).items()):
            faults[f'are in the encapsulation 0x{code:04x}, which is not decoded'] += number
        return values, stamp_ns

    def _fill_rows(
        self,
        values: FloatArray,
        stamp_ns: IntArray,
        rows: IntArray | slice,
        data: bytes,
        offset: IntArray,
        size: IntArray,
        order: str,
    ) -> IntArray:
        """Write the numbers and stamps of messages in one byte order into two arrays.

        Args:
            values: Takes the numbers, shape (k, n).
            stamp_ns: Takes the stamps that are not zero, shape (n,) [ns].
            rows: The messages among the n.
            data: What they lie in.
            offset: Where each of them begins in it.
            size: How long each is [bytes].
            order: Their byte order, as numpy writes it.

        Returns:
            The indexes among the n of those that have to be decoded one by one.
        """
        if self._layout is None:
            return np.arange(len(stamp_ns))[rows]
        gathered, sound = _gather_numbers(self._layout, data, offset, size, order)
        for row, numbers in zip(values, gathered, strict=False):
            row[rows] = numbers
        if self._stamped:
            sec, nanosec = (part.astype(np.int64) for part in gathered[-2:])
            own_ns = sec * _SECOND + nanosec
            stamp_ns[rows] = np.where(sound & (own_ns != 0), own_ns, stamp_ns[rows])
        return np.arange(len(stamp_ns))[rows][~sound] if not sound.all() else np.empty(0, np.int64)

    def _decode_alone(self, data: bytes, place: int, values: FloatArray, stamp_ns: IntArray) -> None:
        """Decode one message, write its numbers and stamp into two arrays, and count what fails.

        Args:
            data: The message.
            place: Its column in the arrays.
            values: Takes the numbers, NaN for one that is not there, shape (width, n).
            stamp_ns: Takes a stamp that is not zero, shape (n,) [ns].
        """
        values[:, place] = math.nan
        try:
            message = self._decode(data)
        except _DECODE_ERRORS:
            self._wanted.reasons[self._undecoded] += 1
            return
        for row, field_config in enumerate(self._fields):
            try:
                values[row, place] = field_config.read(message)
            except NoSuchElementError as error:
                values[len(self._fields) + row, place] = 1.0
                self._wanted.count_foreign(row, error.names)
            except LookupError:
                self._wanted.short[row] += 1
        if self._stamped:
            stamp = message.header.stamp
            stamp_ns[place] = stamp.sec * _SECOND + stamp.nanosec or stamp_ns[place]


def _begins_with_header(definitions: Definitions, root: str) -> bool:
    """Return whether a type begins with a ``std_msgs/Header`` whose stamp has two whole numbers."""
    first = definitions[short_name(root)][:1]
    if [(member.name, member.text) for member in first] != [('header', 'std_msgs/Header')]:
        return False
    try:
        return all(find_primitive(definitions, root, p) in ('int32', 'uint32') for p in _STAMP)
    except SchemaError:
        return False


class MessageReading(ABC):
    """A pass over messages for numbers of some topics."""

    def __init__(self, wanted: Sequence[TopicNumbers]) -> None:
        self._wanted, self._sequence = wanted, 0
        self._width = max((topic.width for topic in wanted), default=0)

    @abstractmethod
    def _read_stretches(self) -> Iterator[tuple[NDArray[Any], ...]]:
        """Yield log times [ns], topics by number, stamps [ns], shape (n,), and values, shape (k, n)."""

    def __iter__(self) -> Iterator[dict[Request, Series]]:
        """Yield the series, without faults, of one stretch of time after the other.

        Raises:
            BagError: A file cannot be read.
        """
        none = np.empty(0, np.int64)
        is_empty = True
        for stretch in self._read_stretches():
            is_empty = False
            yield self._make_series(*stretch)
        if is_empty:
            yield self._make_series(none, none, none, np.empty((self._width, 0)))

    def _make_series(
        self, log_time_ns: IntArray, topic: IntArray, stamp_ns: IntArray, values: FloatArray
    ) -> dict[Request, Series]:
        """Return the series of a stretch by request, and move the sequence numbers on.

        The arrays are those of :meth:`_read_stretches`.
        """
        result: dict[Request, Series] = {}
        is_unstamped = np.array_equal(log_time_ns, stamp_ns)
        for number, topic_numbers in enumerate(self._wanted):
            rows = np.flatnonzero(topic == number)
            times_ns = log_time_ns[rows]
            times = times_ns, times_ns if is_unstamped else stamp_ns[rows], rows + self._sequence
            result.update(topic_numbers.series(times, values[: topic_numbers.width].take(rows, axis=1)))
        self._sequence += log_time_ns.size
        return result

    def faults(self) -> dict[Request, tuple[Fault, ...]]:
        """Return the faults of the messages read so far, by request."""
        return dict(pair for topic in self._wanted for pair in topic.faults())


_BUILT_IN = Path(__file__).with_name('definitions.txt')
_RULE = '=' * 80


def definition_of(kind: str) -> str | None:
    """Return the ``ros2msg`` text of a type with the types that it uses; None where one is not known.

    The texts are those of this package, or else of a sourced ROS 2.
    """
    parts: dict[str, str] = {}
    if not _collect_texts(short_name(kind), parts):
        return None
    first, *referred = parts.items()
    return first[1] + ''.join(f'{_RULE}\nMSG: {name}\n{text}' for name, text in referred)


def _collect_texts(name: str, parts: dict[str, str]) -> bool:
    """Add the texts of a type and of the types that it uses; return False where one is not known.

    Args:
        name: The short name of the type.
        parts: Takes the texts by short name; incomplete where False is returned.
    """
    text = _load_built_in().get(name) or _read_installed_type(name)
    if text is None:
        return False
    parts[name] = text
    try:
        bases = [member.base for member in _parse_fields(_strip_comments(text), name)]
    except SchemaError:
        return False
    return all('/' not in base or base in parts or _collect_texts(short_name(base), parts) for base in bases)


@cache
def _load_built_in() -> dict[str, str]:
    """Return the texts of the types that this package brings, by short name."""
    _, *parts = re.split(r'^MSG: (.*)\n', _BUILT_IN.read_text('utf-8'), flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _read_installed_type(name: str) -> str | None:
    """Return the text of a type from the packages of a sourced ROS 2; None where it is not there.

    Args:
        name: The short name, as ``std_msgs/Float64``; None is returned for any other text.
    """
    if not re.fullmatch(r'\w+/\w+', name):
        return None
    package, short_name = name.split('/')
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        path = Path(prefix) / 'share' / package / 'msg' / f'{short_name}.msg'
        try:
            return read_file(path, LONGEST_TEXT).decode('utf-8', 'replace').rstrip() + '\n'
        except OSError:
            continue
    return None
