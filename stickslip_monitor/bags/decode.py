# SPDX-License-Identifier: Apache-2.0
"""Messages decoded one by one with mcap-ros2-support: the reference for the bulk reader."""

from __future__ import annotations

import contextlib
import io
import math
import struct
import threading
from collections.abc import Sequence
from dataclasses import dataclass

from mcap.records import Schema
from mcap.well_known import MessageEncoding
from mcap_ros2.decoder import DecoderFactory

from stickslip_monitor.monitor.fields import FieldPath, read_field

from .schema import SchemaError

# The standard error belongs to the process, not to one of its threads.
_SILENCE = threading.Lock()

# Everything the decoder raises on data that is not of the type the schema describes.
_DECODE_ERRORS = (
    struct.error, ValueError, LookupError, NotImplementedError, RecursionError, MemoryError,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Reading:
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

    def read(self, data: bytes) -> Reading:
        """Read one message; data of another type than the schema says is not an error here."""
        try:
            message = self._decode(data)
        except _DECODE_ERRORS:
            return Reading(False, 0, (None,) * len(self._paths))
        stamp = message.header.stamp if self._stamped else None
        stamp_ns = 0 if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
        values: list[float | None] = []
        for path in self._paths:
            try:
                values.append(read_field(message, path))
            except LookupError:
                values.append(None)
        return Reading(True, stamp_ns, tuple(values))


def or_nan(value: float | None) -> float:
    """Give NaN for a number that is not there."""
    return math.nan if value is None else value
