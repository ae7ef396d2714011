# SPDX-License-Identifier: Apache-2.0
"""The summary section of an MCAP file, believed only where it proves consistent."""

from __future__ import annotations

import zlib
from io import BytesIO
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from .records import HEAD, MAGIC, PARSE_ERRORS

_FOOTER_BODY = 20
_TAIL = HEAD.size + _FOOTER_BODY + len(MAGIC)


def read_summary(file: IO[bytes], size: int) -> tuple[Summary, int] | None:
    """Read the summary of a file that is whole.

    Args:
        file: The file.
        size: Its length [bytes].

    Returns:
        The summary and the byte at which it begins; None when it is missing, damaged, or does not
        list every channel and schema of the file.
    """
    try:
        found = _summary_bytes(file, size)
        if found is None:
            return None
        data, start = found
        summary = _parse(data)
    except PARSE_ERRORS:
        return None
    return (summary, start) if _complete(summary, start) else None


def _summary_bytes(file: IO[bytes], size: int) -> tuple[bytes, int] | None:
    if size < 2 * len(MAGIC) + _TAIL:
        return None
    file.seek(size - _TAIL)
    tail = file.read(_TAIL)
    if tail[: HEAD.size] != HEAD.pack(Opcode.FOOTER, _FOOTER_BODY) or not tail.endswith(MAGIC):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(tail[HEAD.size :])))
    if not len(MAGIC) <= footer.summary_start < size - _TAIL:
        return None
    file.seek(footer.summary_start)
    data = file.read(size - footer.summary_start)
    checked = data[: -len(MAGIC) - 4]
    if footer.summary_crc and zlib.crc32(checked) != footer.summary_crc:
        return None
    return data, footer.summary_start


def _parse(data: bytes) -> Summary:
    summary = Summary()
    reader = StreamReader(BytesIO(data), skip_magic=True, record_size_limit=len(data))
    for record in reader.records:
        if isinstance(record, Statistics):
            summary.statistics = record
        elif isinstance(record, Schema):
            summary.schemas[record.id] = record
        elif isinstance(record, Channel):
            summary.channels[record.id] = record
        elif isinstance(record, ChunkIndex):
            summary.chunk_indexes.append(record)
    return summary


def _complete(summary: Summary, start: int) -> bool:
    counts = summary.statistics
    if counts is None:
        return False
    if not counts.channel_message_counts.keys() <= summary.channels.keys():
        return False
    if any(c.schema_id and c.schema_id not in summary.schemas for c in summary.channels.values()):
        return False
    summary.chunk_indexes.sort(key=lambda chunk: chunk.chunk_start_offset)
    ends = [len(MAGIC)]
    for chunk in summary.chunk_indexes:
        if chunk.chunk_start_offset < ends[-1]:
            return False
        ends.append(chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length)
    return ends[-1] <= start and (counts.channel_count == len(summary.channels))
