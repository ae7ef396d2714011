# SPDX-License-Identifier: Apache-2.0
"""Reads numbers out of CDR messages: where each lies, and the way to it in many messages at once.

A message is a row of tokens. A cursor steps over them: one number for all messages while nothing of variable
length was met, an array of one per message behind it. Messages that this cannot follow are decoded one by one
with mcap-ros2-support, which is also the reference for the bulk reader.
"""

from __future__ import annotations

import contextlib
import io
import math
import struct
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Schema
from mcap.well_known import MessageEncoding
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from stickslip_logs.arrays import BoolArray, FloatArray, IntArray
from stickslip_logs.errors import BagError
from stickslip_logs.field_paths import ByName, FieldPath, NoSuchElementError, NumberField
from stickslip_logs.recordings.mcap_chunks import view_numbers
from stickslip_logs.recordings.message_types import (
    NUMBERS,
    TEXTS,
    Definitions,
    SchemaError,
    find_primitive,
    parse_schema,
)
from stickslip_logs.recordings.recording import Fault, Request, Series, short_type
from stickslip_logs.units import SECOND_NS

# Beyond this a message is no telemetry, and its tokens would cost more than they save.
_MAX_TOKENS = 500
# A type that contains itself has no end.
_MAX_DEPTH = 50
# Names of elements that messages for others have are reported; a robot has some dozen joints.
_MAX_NAMES = 20

# Bytes before the fields of a message, which say how it is encoded.
_ENCAPSULATION = 4
# As the two bytes lie in the message, read little-endian.
_CDR_LE, _CDR_BE = 0x0100, 0x0000
_STAMP: tuple[FieldPath, ...] = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))

# The standard error belongs to the process, not to one of its threads.
_SILENCE = threading.Lock()
# Everything the decoder raises on data that is not of the type the schema describes.
_DECODE_ERRORS = (struct.error, ValueError, LookupError, NotImplementedError, RecursionError, MemoryError)


class Token(NamedTuple):
    """A stretch of CDR data: ``length`` numbers of numpy type ``code``.

    Where there is no ``length``, it stands before them. A text is such a sequence of bytes.
    """

    code: str
    length: int | None = 1


Layout = tuple[Sequence[Token], Sequence[tuple[int, int]]]
"""Tokens of a message and, for each number wanted, in order, its token and its place in it."""


def compile_layout(definitions: Definitions, root: str, paths: Sequence[FieldPath]) -> Layout | None:
    """Return where the numbers at some paths lie in messages of a type.

    None where the messages must be decoded one by one: an element is chosen by name, or the type has arrays
    of varying size in the way, or is too large.

    The paths lead to numbers of the type ``root``, as :func:`find_primitive` has checked.
    """
    if any(isinstance(step, ByName) for path in paths for step in path):
        return None
    tokens: list[Token] = []
    numbers: dict[FieldPath, int] = {}
    for path, token in _list_tokens(definitions, short_type(root), ()):
        if token is None or len(tokens) >= _MAX_TOKENS:
            return None
        numbers[path] = len(tokens)
        tokens.append(token)
    return tokens, [
        (numbers[path[:-1]], path[-1]) if isinstance(path[-1], int) else (numbers[path], 0) for path in paths
    ]


def _list_tokens(
    definitions: Definitions, root: str, prefix: FieldPath
) -> Iterator[tuple[FieldPath, Token | None]]:
    """Yield each token of a type with its path, in the order of the data; None for what has no layout.

    An array of numbers is one token, a text one without a length; a type without fields has one of a byte,
    called ''. A wstring, an array without a fixed size and too deep nesting have no layout. ``root`` is the
    short name of the type, ``prefix`` the path to it, with which all paths begin.
    """
    if len(prefix) > _MAX_DEPTH:
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
    layout: Layout, data: bytes, offset: IntArray, size: IntArray
) -> tuple[list[NDArray[Any]], BoolArray]:
    """Gather numbers from messages, in little-endian order, by stepping through all of them at once.

    In ``data`` each message begins at its ``offset``, shape (n,), and has its ``size`` [bytes], shape (n,).

    Returns:
        An array of shape (n,) for each number; and for which messages they are right, shape (n,).
        The others have to be decoded one by one, as they are too short or unusual.
    """
    sound = np.ones(len(offset), np.bool_)

    def fetch(code: str, place: int | IntArray) -> NDArray[Any]:
        """Return a number of each message, shape (n,); clear ``sound`` where the message ends before it.

        Its place behind the head of the message [bytes] is one for all, or of shape (n,).
        """
        numbers = view_numbers(data, '<' + code, _ENCAPSULATION)
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
        SchemaError: The decoder refuses the definition, or its encoding is not ``ros2msg``.
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

    ``count`` is how many messages were read, ``reasons`` counts those without numbers by a clause on why;
    by the index of a path ``short`` counts those whose array is too short for it, ``foreign`` those that name
    other elements, ``names``.
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

        The faults of the series are empty.

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
        """Count a message that lacks the named element of path ``row``; keep some 20 of its names."""
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

    Args:
        wanted: The paths to the numbers; takes the counts of messages and faults.
        schema: The definition.

    Raises:
        BagError: A path does not lead to a number, or the definition cannot be used.
    """

    def __init__(self, wanted: TopicNumbers, schema: Schema) -> None:
        self._wanted, self._paths = wanted, tuple(wanted.requests)
        self._fields = [NumberField(path) for path in self._paths]
        self._undecoded = f'cannot be decoded as {schema.name}'
        try:
            definitions = parse_schema(schema.name, schema.data)
            for path, (request, *_) in wanted.requests.items():
                try:
                    find_primitive(definitions, schema.name, path)
                except SchemaError as error:
                    raise BagError(
                        f"field '{request.field}' of topic '{wanted.topic}' ({schema.name}) is not a number:"
                        f' {error}'
                    ) from None
            self._stamped = _begins_with_header(definitions, schema.name)
            self._decode = _find_decoder(schema)
        except SchemaError as error:
            raise BagError(f"topic '{wanted.topic}' ({schema.name}) cannot be read: {error}") from None
        paths = (*self._paths, *(_STAMP if self._stamped else ()))
        self._layout = compile_layout(definitions, schema.name, paths)

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
            elements are chosen by name, a row for each path: 1 for a message not for it, else NaN. And the
            stamps [ns], shape (n,): the log time where a message has none; the array of log times itself
            where the type has none.
        """
        count, faults = len(offset), self._wanted.reasons
        self._wanted.count += count
        values = np.full((self._wanted.width, count), np.nan)
        stamp_ns = log_time_ns.copy() if self._stamped else log_time_ns
        rows = np.flatnonzero(size >= _ENCAPSULATION)
        if rows.size < count:
            faults[self._undecoded] += count - rows.size
        # The two bytes of the representation: zero, and zero or one for plain CDR.
        kind = view_numbers(data, '<u2')[offset[rows]]
        is_usual = kind == _CDR_LE
        # As a rule all, which are not copied.
        usual = slice(None) if rows.size == count and is_usual.all() else rows[is_usual]
        alone = self._fill_rows(values, stamp_ns, usual, data, offset[usual], size[usual])
        for place in [*alone.tolist(), *rows[kind == _CDR_BE].tolist()]:
            begin = int(offset[place])
            self._decode_alone(data[begin : begin + int(size[place])], place, values, stamp_ns)
        unknown = kind[~is_usual & (kind != _CDR_BE)]
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
    ) -> IntArray:
        """Write the numbers and stamps of messages, in little-endian order, into two arrays.

        Numbers go to ``values``, shape (k, n), stamps that are not zero to ``stamp_ns``, shape (n,) [ns].
        Of the messages, ``rows`` of the n, ``offset`` and ``size`` are where each begins, and its length.

        Returns:
            The indexes among the n of those that have to be decoded one by one: what was written is wrong.
        """
        if self._layout is None:
            return np.arange(len(stamp_ns))[rows]
        gathered, sound = _gather_numbers(self._layout, data, offset, size)
        for row, numbers in zip(values, gathered, strict=False):
            row[rows] = numbers
        if self._stamped:
            sec, nanosec = (part.astype(np.int64) for part in gathered[-2:])
            own_ns = sec * SECOND_NS + nanosec
            stamp_ns[rows] = np.where(sound & (own_ns != 0), own_ns, stamp_ns[rows])
        return np.arange(len(stamp_ns))[rows][~sound] if not sound.all() else np.empty(0, np.int64)

    def _decode_alone(self, data: bytes, place: int, values: FloatArray, stamp_ns: IntArray) -> None:
        """Decode one message, write its numbers and stamp into two arrays, and count what fails.

        Args:
            data: The message.
            place: Its column in the arrays.
            values: Takes the numbers, NaN for one that is not there, shape (width, n); and, where elements
                are chosen by name, 1 in the further row of each path that the message is not for.
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
            stamp_ns[place] = stamp.sec * SECOND_NS + stamp.nanosec or stamp_ns[place]


def _begins_with_header(definitions: Definitions, root: str) -> bool:
    """Return whether a type begins with a ``std_msgs/Header`` whose stamp has two whole numbers."""
    first = definitions[short_type(root)][:1]
    if [(member.name, member.text) for member in first] != [('header', 'std_msgs/Header')]:
        return False
    try:
        return all(find_primitive(definitions, root, p) in ('int32', 'uint32') for p in _STAMP)
    except SchemaError:
        return False
