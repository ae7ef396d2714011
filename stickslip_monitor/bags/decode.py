# SPDX-License-Identifier: Apache-2.0
"""Reads numbers out of CDR data: for many messages at once where possible, else one by one.

A message is a row of tokens.  A cursor steps over them: one number for all messages while nothing
of variable length was met, an array of one per message behind it.
Messages that this cannot follow are decoded one by one with mcap-ros2-support, which is also the
reference for the bulk reader.
"""

from __future__ import annotations

import contextlib
import enum
import io
import math
import struct
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap.well_known import MessageEncoding
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.bags.records import view
from stickslip_monitor.bags.schema import (
    NUMBERS,
    TEXTS,
    Definitions,
    SchemaError,
    number_at,
    short_name,
)
from stickslip_monitor.fields import FieldPath, read_field

# Beyond this a message is no telemetry, and its tokens would cost more than they save.
_MOST_TOKENS = 500

# A type that contains itself has no end.
_DEEPEST = 50

# Longer texts are left to the decoder: they are checked eight bytes at a time.
_LONGEST_TEXT = 256

_NOT_ASCII = np.uint64(0x8080808080808080)


class TokenKind(enum.Enum):
    """What a token is."""

    NUMBERS = 'numbers'
    SEQUENCE = 'sequence of numbers'
    TEXT = 'text'


@dataclass(frozen=True, slots=True)
class Token:
    """A stretch of CDR data: ``count`` numbers of numpy type ``code``, a sequence, or a text."""

    kind: TokenKind
    code: str = 'u1'
    count: int = 1

    @property
    def item_size(self) -> int:
        """Bytes of one number, which is also its alignment."""
        return np.dtype(self.code).itemsize


@dataclass(frozen=True, slots=True)
class Layout:
    """Tokens of a message and, for each number wanted, its token and its place in it."""

    tokens: tuple[Token, ...]
    targets: tuple[tuple[int, int], ...]


def compile_layout(
    definitions: Definitions, root: str, paths: Sequence[FieldPath]
) -> Layout | None:
    """Compile the layout of a type for some of its numbers.

    Args:
        definitions: Definitions of the type and those it uses.
        root: The type.
        paths: Paths that lead to numbers.

    Returns:
        The layout; None for a type whose messages must be decoded one by one.
    """
    tokens: list[Token] = []
    numbers: dict[FieldPath, int] = {}
    for path, token in _tokens(definitions, short_name(root), ()):
        if token is None or len(tokens) >= _MOST_TOKENS:
            return None
        numbers[path] = len(tokens)
        tokens.append(token)
    return Layout(tuple(tokens), tuple(_target(numbers, path) for path in paths))


def _target(numbers: dict[FieldPath, int], path: FieldPath) -> tuple[int, int]:
    element = path[-1]
    return (numbers[path[:-1]], element) if isinstance(element, int) else (numbers[path], 0)


def _tokens(
    definitions: Definitions, root: str, prefix: FieldPath
) -> Iterator[tuple[FieldPath, Token | None]]:
    """List the tokens of a type with their paths; None for what has no layout."""
    if len(prefix) > _DEEPEST:
        yield prefix, None
        return
    if not definitions[root]:
        # CDR has no empty structure; ROS 2 gives it one unused byte.
        yield (*prefix, ''), Token(TokenKind.NUMBERS)
    for member in definitions[root]:
        path = (*prefix, member.name)
        if member.base in NUMBERS:
            kind = (
                TokenKind.SEQUENCE
                if member.is_array and member.size is None
                else TokenKind.NUMBERS
            )
            count = member.size if member.size is not None else 1
            yield path, Token(kind, NUMBERS[member.base], count)
        elif member.base == 'wstring' or (member.is_array and member.size is None):
            yield path, None
        elif member.base in TEXTS:
            for _ in range(1 if member.size is None else member.size):
                yield path, Token(TokenKind.TEXT)
        elif member.size is None:
            yield from _tokens(definitions, member.base, path)
        else:
            for index in range(member.size):
                yield from _tokens(definitions, member.base, (*path, index))


@dataclass(slots=True)
class Gather:
    """Numbers gathered from messages in one byte order.

    ``base`` is where each message's CDR data begins in ``data`` (behind its encapsulation head),
    ``size`` how long it is.  ``sound`` becomes False for messages that have anything unusual:
    only the decoder can tell what they hold.
    """

    data: bytes
    base: IntArray
    size: IntArray
    big_endian: bool
    sound: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        """Begin with every message sound."""
        self.sound = np.ones(len(self.base), np.bool_)

    def run(self, layout: Layout) -> list[NDArray[Any]]:
        """Step through all messages.

        Args:
            layout: Their layout.

        Returns:
            One array per target, meaningful where ``sound``.
        """
        found: dict[tuple[int, int], NDArray[Any]] = {}
        place: int | IntArray = 0
        for number, token in enumerate(layout.tokens):
            begin, place, length = self._enter(token, place)
            for target in layout.targets:
                if target[0] == number:
                    self.sound &= target[1] < length
                    spot = begin + target[1] * token.item_size
                    found[target] = self._fetch(token.code, spot)
            end = begin + length * token.item_size
            # Nothing is aligned for the items of a sequence that has none.
            place = np.where(length > 0, end, place) if token.kind is TokenKind.SEQUENCE else end
        self.sound &= place <= self.size
        return [found[target] for target in layout.targets]

    def _enter(
        self, token: Token, place: int | IntArray
    ) -> tuple[int | IntArray, int | IntArray, int | IntArray]:
        """Find the first item of a token, the end of its length field, and how many items."""
        if token.kind is TokenKind.NUMBERS:
            begin = _align(place, token.item_size)
            return begin, begin, token.count
        place = _align(place, 4)
        length = self._fetch('u4', place).astype(np.int64)
        place = place + 4
        if token.kind is TokenKind.TEXT:
            self._check_text(place, length)
        return _align(place, token.item_size), place, length

    def _fetch(self, code: str, place: int | IntArray) -> NDArray[Any]:
        # A byte that is neither 0 nor 1 is still a bool, but not one numpy can hold.
        stored = 'u1' if code == '?' else code
        numbers = view(self.data, f'{">" if self.big_endian else "<"}{stored}')
        self.sound &= place + numbers.itemsize <= self.size
        spot = self.base + place
        if not self.sound.all():
            spot = np.where(self.sound, spot, 0)
        found: NDArray[Any] = numbers[spot]
        return np.not_equal(found, 0) if code == '?' else found

    def _check_text(self, place: int | IntArray, length: IntArray) -> None:
        """Leave text that is not ASCII to the decoder: it may not be valid UTF-8."""
        self.sound &= (length <= _LONGEST_TEXT) & (place + length <= self.size)
        words = view(self.data, '<u8')
        longest = int(length[self.sound].max(initial=0))
        for done in range(0, longest, 8):
            spot = self.base + place + done
            rest = np.clip(length - done, 0, 8)
            self.sound &= (rest == 0) | (spot < len(words))
            text = words[np.where(self.sound & (rest > 0), spot, 0)]
            unused = (8 * (8 - rest)).astype(np.uint64)
            high = (text << np.minimum(unused, np.uint64(63))) & _NOT_ASCII
            self.sound &= (rest == 0) | (high == 0)


def _align(place: int | IntArray, size: int) -> int | IntArray:
    return (place + size - 1) // size * size if size > 1 else place


# The standard error belongs to the process, not to one of its threads.
_SILENCE = threading.Lock()

# Everything the decoder raises on data that is not of the type the schema describes.
_DECODE_ERRORS = (
    struct.error, ValueError, LookupError, NotImplementedError, RecursionError, MemoryError,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class DecodedValue:
    """Numbers of one message: None for an array that is too short, all None if not ``decoded``."""

    decoded: bool
    stamp_ns: int
    values: tuple[float | None, ...]


class Decoder:
    """Reads numbers from the messages of one type."""

    def __init__(self, schema: Schema, paths: Sequence[FieldPath], stamped: bool) -> None:
        """Prepare for a type.

        Args:
            schema: Its definition.
            paths: The numbers to read.
            stamped: Whether the messages have a header.

        Raises:
            SchemaError: The definition cannot be parsed.
        """
        self._paths = paths
        self._stamped = stamped
        try:
            # The parser prints what it raises.
            with _SILENCE, contextlib.redirect_stderr(io.StringIO()):
                decode = DecoderFactory().decoder_for(MessageEncoding.CDR, schema)
        except Exception as error:  # The parser raises whatever its parts raise.
            raise SchemaError(f'its definition cannot be parsed ({error})') from None
        if decode is None:
            raise SchemaError(f"its schema encoding '{schema.encoding}' is not ros2msg")
        self._decode = decode

    def read(self, data: bytes) -> DecodedValue:
        """Read one message; data of another type than the schema says is not an error here."""
        try:
            message = self._decode(data)
        except _DECODE_ERRORS:
            return DecodedValue(False, 0, (None,) * len(self._paths))
        stamp = message.header.stamp if self._stamped else None
        stamp_ns = 0 if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
        values: list[float | None] = []
        for path in self._paths:
            try:
                values.append(read_field(message, path))
            except LookupError:
                values.append(None)
        return DecodedValue(True, stamp_ns, tuple(values))


def or_nan(value: float | None) -> float:
    """Give NaN for a number that is not there."""
    return math.nan if value is None else value


_ENCAPSULATION = 4
# As the two bytes lie in the message, read little-endian.
_CDR_LE, _CDR_BE = 0x0100, 0x0000
_SECOND = 1_000_000_000
_SECONDS = ('int32', 'uint32')
_STAMP: tuple[FieldPath, ...] = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))


@dataclass(slots=True, eq=False)
class FieldNumbers:
    """What a plan read from n messages.

    ``stamp_ns`` is None where the type has no header, and zero where a message has no stamp;
    ``values`` has a row for each path; ``undecoded`` counts the messages that are not of the type,
    ``encapsulations`` those in an encapsulation that is not decoded, by its number, ``short``
    for each path those whose array is too short, and ``alone`` those that were decoded one by one.
    """

    stamp_ns: IntArray | None
    values: FloatArray
    undecoded: int = 0
    short: Counter[int] = field(default_factory=Counter)
    encapsulations: Counter[int] = field(default_factory=Counter)
    alone: int = 0


class FieldReader:
    """Reads numbers from messages of one type, many at once."""

    def __init__(
        self, schema: Schema, definitions: Definitions, paths: Sequence[FieldPath]
    ) -> None:
        """Prepare for a type.

        Args:
            schema: Its definition.
            definitions: The same, parsed.
            paths: Paths to numbers of the type.

        Raises:
            SchemaError: The definition cannot be parsed.
        """
        self._paths = tuple(paths)
        self._stamped = _has_header(definitions, schema.name)
        self._decoder = Decoder(schema, self._paths, self._stamped)
        wanted = (*self._paths, *(_STAMP if self._stamped else ()))
        self._layout = compile_layout(definitions, schema.name, wanted)

    def read(self, data: bytes, offset: IntArray, size: IntArray) -> FieldNumbers:
        """Read messages.

        Args:
            data: A block of records.
            offset: Where the data of each message begins in it, shape (n,).
            size: How long it is, shape (n,) [bytes].

        Returns:
            The numbers, ``values`` of shape (paths, n).
        """
        count = len(offset)
        stamp_ns = np.zeros(count, np.int64) if self._stamped else None
        numbers = FieldNumbers(stamp_ns, np.full((len(self._paths), count), np.nan))
        rows: slice | IntArray = slice(None)
        if (size < _ENCAPSULATION).any():
            rows = np.flatnonzero(size >= _ENCAPSULATION)
            numbers.undecoded += count - len(rows)
        # The two bytes of the representation: zero, and zero or one for plain CDR.
        kind = view(data, '<u2')[offset[rows]]
        for code in (_CDR_LE, _CDR_BE):
            mine = kind == code
            if mine.any():
                # Messages are rarely mixed, and a slice costs nothing where a selection copies.
                is_all = mine.all()
                chosen = rows if is_all else np.arange(count)[rows][mine]
                self._gather(data, offset, size, chosen, code == _CDR_BE, numbers)
                if is_all:
                    return numbers
        other = kind[(kind != _CDR_LE) & (kind != _CDR_BE)]
        numbers.encapsulations.update(other.byteswap().tolist())
        return numbers

    def _gather(
        self,
        data: bytes,
        offset: IntArray,
        size: IntArray,
        chosen: slice | IntArray,
        big_endian: bool,
        numbers: FieldNumbers,
    ) -> None:
        """Fill in messages in one byte order."""
        base, length = offset[chosen], size[chosen]
        rest = np.arange(len(base))
        if self._layout is not None:
            gather = Gather(data, base + _ENCAPSULATION, length - _ENCAPSULATION, big_endian)
            _fill(numbers, gather.run(self._layout), chosen)
            rest = np.flatnonzero(~gather.sound)
        for place in np.arange(len(offset))[chosen][rest].tolist() if rest.size else ():
            begin = int(offset[place])
            self._decode(data[begin : begin + int(size[place])], place, numbers)
        numbers.alone += len(rest)

    def _decode(self, message: bytes, place: int, numbers: FieldNumbers) -> None:
        """Fill in a message that is decoded by itself."""
        reading = self._decoder.read(message)
        numbers.undecoded += not reading.decoded
        if reading.decoded:
            numbers.short.update(row for row, value in enumerate(reading.values) if value is None)
        numbers.values[:, place] = [or_nan(value) for value in reading.values]
        if numbers.stamp_ns is not None:
            numbers.stamp_ns[place] = reading.stamp_ns


def _fill(numbers: FieldNumbers, found: list[NDArray[Any]], chosen: slice | IntArray) -> None:
    for row, values in zip(numbers.values, found, strict=False):
        row[chosen] = values
    if numbers.stamp_ns is not None:
        sec, nanosec = (part.astype(np.int64) for part in found[-2:])
        numbers.stamp_ns[chosen] = sec * _SECOND + nanosec


def _has_header(definitions: Definitions, root: str) -> bool:
    first = definitions[short_name(root)][:1]
    if [(field.name, field.text) for field in first] != [('header', 'std_msgs/Header')]:
        return False
    try:
        return all(number_at(definitions, root, path) in _SECONDS for path in _STAMP)
    except SchemaError:
        return False
