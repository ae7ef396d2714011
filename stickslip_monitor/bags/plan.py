# SPDX-License-Identifier: Apache-2.0
"""How to read some numbers of one message type: in bulk where possible, else one by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from stickslip_monitor.monitor.fields import FieldPath

from .decode import Decoder, or_nan
from .layout import Gather, compile_layout
from .schema import Definitions, SchemaError, number_at, short_name
from .values import BoolArray, FloatArray, IntArray
from .views import view

_ENCAPSULATION = 4
_SECOND = 1_000_000_000
_STAMP: tuple[FieldPath, ...] = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """What a plan read from n messages.

    ``stamp_ns`` is None where the type has no header, and zero where a message has no stamp;
    ``values`` has a row for each path; ``undecoded`` counts the messages that are not of the type,
    ``short`` for each path those whose array is too short.
    """

    stamp_ns: IntArray | None
    values: FloatArray
    undecoded: int
    short: Counter[int]


class Plan:
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

    def read(self, data: bytes, offset: IntArray, size: IntArray) -> Numbers:
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
        numbers = Numbers(stamp_ns, np.full((len(self._paths), count), np.nan), 0, Counter())
        done = self._gather(data, offset, size, numbers)
        if done.all():
            return numbers
        return self._decode(data, offset, size, np.flatnonzero(~done), numbers)

    def _gather(
        self, data: bytes, offset: IntArray, size: IntArray, numbers: Numbers
    ) -> BoolArray:
        """Fill in what can be gathered, and say which messages that is."""
        done = np.zeros(len(offset), np.bool_)
        if self._layout is None or not (size >= _ENCAPSULATION).all():
            return done
        little_endian = (view(data, 'u1')[offset + 1] & 1).astype(np.bool_)
        for big_endian, mine in ((False, little_endian), (True, ~little_endian)):
            if mine.any():
                # Messages are rarely mixed, and a slice costs nothing where a selection copies.
                chosen = slice(None) if mine.all() else np.flatnonzero(mine)
                base = offset[chosen] + _ENCAPSULATION
                gather = Gather(data, base, size[chosen] - _ENCAPSULATION, big_endian)
                _fill(numbers, gather.run(self._layout), chosen)
                done[chosen] = gather.sound
        return done

    def _decode(
        self, data: bytes, offset: IntArray, size: IntArray, rest: IntArray, numbers: Numbers
    ) -> Numbers:
        """Fill in the messages that are left, one by one."""
        undecoded, short = 0, Counter[int]()
        for position in rest.tolist():
            begin = int(offset[position])
            reading = self._decoder.read(data[begin : begin + int(size[position])])
            undecoded += not reading.decoded
            if reading.decoded:
                short.update(row for row, value in enumerate(reading.values) if value is None)
            numbers.values[:, position] = [or_nan(value) for value in reading.values]
            if numbers.stamp_ns is not None:
                numbers.stamp_ns[position] = reading.stamp_ns
        return Numbers(numbers.stamp_ns, numbers.values, undecoded, short)


def _fill(numbers: Numbers, found: list[NDArray[Any]], chosen: slice | IntArray) -> None:
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
        return all(number_at(definitions, root, path) for path in _STAMP)
    except SchemaError:
        return False
