# SPDX-License-Identifier: Apache-2.0
"""Messages decoded one by one with mcap-ros2-support: the reference for the bulk reader.

How to read some numbers of one message type: in bulk where possible, else one by one.
"""

from __future__ import annotations

import contextlib
import io
import math
import struct
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap.well_known import MessageEncoding
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.bags.layout import Gather, compile_layout
from stickslip_monitor.bags.mcap_records import view
from stickslip_monitor.bags.schema import Definitions, SchemaError, number_at, short_name
from stickslip_monitor.fields import FieldPath, read_field

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
_DECODED = (0, 1)
_SECOND = 1_000_000_000
_SECONDS = ('int32', 'uint32')
_STAMP: tuple[FieldPath, ...] = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))


@dataclass(frozen=True, slots=True, eq=False)
class FieldNumbers:
    """What a plan read from n messages.

    ``stamp_ns`` is None where the type has no header, and zero where a message has no stamp;
    ``values`` has a row for each path; ``undecoded`` counts the messages that are not of the type,
    ``encapsulations`` those in an encapsulation that is not decoded, by its number, and ``short``
    for each path those whose array is too short.
    """

    stamp_ns: IntArray | None
    values: FloatArray
    undecoded: int
    short: Counter[int]
    encapsulations: Counter[int] = field(default_factory=Counter)


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
        numbers = FieldNumbers(stamp_ns, np.full((len(self._paths), count), np.nan), 0, Counter())
        done = self._gather(data, offset, size, numbers)
        if done.all():
            return numbers
        return self._decode(data, offset, size, np.flatnonzero(~done), numbers)

    def _gather(
        self, data: bytes, offset: IntArray, size: IntArray, numbers: FieldNumbers
    ) -> BoolArray:
        """Fill in what can be gathered, and say which messages that is."""
        done = np.zeros(len(offset), np.bool_)
        if self._layout is None or not (size >= _ENCAPSULATION).all():
            return done
        # The two bytes of the representation: zero, and zero or one for plain CDR.
        kind = view(data, '<u2')[offset]
        for code, big_endian in ((_CDR_LE, False), (_CDR_BE, True)):
            mine = kind == code
            if mine.any():
                # Messages are rarely mixed, and a slice costs nothing where a selection copies.
                chosen = slice(None) if mine.all() else np.flatnonzero(mine)
                base = offset[chosen] + _ENCAPSULATION
                gather = Gather(data, base, size[chosen] - _ENCAPSULATION, big_endian)
                _fill(numbers, gather.run(self._layout), chosen)
                done[chosen] = gather.sound
                if isinstance(chosen, slice):
                    return done
        other = (kind != _CDR_LE) & (kind != _CDR_BE)
        numbers.encapsulations.update(kind[other].byteswap().tolist())
        done[other] = True
        return done

    def _decode(
        self, data: bytes, offset: IntArray, size: IntArray, rest: IntArray, numbers: FieldNumbers
    ) -> FieldNumbers:
        """Fill in the messages that are left, one by one."""
        undecoded, short = 0, Counter[int]()
        for position in rest.tolist():
            begin = int(offset[position])
            message = data[begin : begin + int(size[position])]
            kind = int.from_bytes(message[:2], 'big')
            if len(message) >= _ENCAPSULATION and kind not in _DECODED:
                numbers.encapsulations[kind] += 1
                continue
            reading = self._decoder.read(message)
            undecoded += not reading.decoded
            if reading.decoded:
                short.update(row for row, value in enumerate(reading.values) if value is None)
            numbers.values[:, position] = [or_nan(value) for value in reading.values]
            if numbers.stamp_ns is not None:
                numbers.stamp_ns[position] = reading.stamp_ns
        return replace(numbers, undecoded=undecoded, short=short)


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
