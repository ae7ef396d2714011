# SPDX-License-Identifier: Apache-2.0
"""What the reader of the ``mcap`` package finds in a recording, and ours must not lose."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
import zlib
from collections import Counter
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from fuzz.files import FLOAT64, TOPICS
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording, Request
from stickslip_monitor.errors import BagError

_NO_TIME = 1 << 63
_DATED = 10**17
Sample = tuple[str, int, bytes]


def messages_of(data: bytes) -> Counter[Sample]:
    """Return topic, log time and data of what MCAP's reader finds before it fails, if it does.

    It takes the records in the order of the file, each channel as it was last defined.
    """
    samples: Counter[Sample] = Counter()
    channels: dict[int, Channel] = {}
    reader = StreamReader(BytesIO(data), emit_chunks=True, record_size_limit=1 << 24)
    try:
        for record in reader.records:
            for part in _records_in(record):
                if isinstance(part, Channel):
                    channels[part.id] = part
                elif isinstance(part, Message) and part.channel_id in channels:
                    topic = channels[part.channel_id].topic
                    samples[topic, part.log_time, bytes(part.data)] += 1
    except Exception:  # What it raises on damage is not ours to judge.
        pass
    return samples


def rows_of(path: Path) -> Counter[Sample]:
    """Count the samples of a database as SQL joins its tables; return nothing where it cannot."""
    try:
        with contextlib.closing(sqlite3.connect(f'file:{path}?immutable=1', uri=True)) as database:
            rows = database.execute(
                'SELECT name, timestamp, data FROM messages JOIN topics ON topic_id = topics.id'
                " WHERE typeof(timestamp) = 'integer' AND typeof(data) = 'blob'"
            )
            return Counter(row for row in rows if isinstance(row[0], str) and 0 <= row[1] < 1 << 62)
    except (sqlite3.Error, ValueError, MemoryError):
        return Counter()


def _records_in(record: McapRecord) -> list[McapRecord]:
    if not isinstance(record, Chunk):
        return [record]
    if record.uncompressed_size > 1 << 24:
        return []
    try:
        return breakup_chunk(record, validate_crc=True)
    except Exception:  # A chunk that the oracle cannot open holds nothing to compare.
        return []


def difference(path: Path) -> str:
    """Describe what our reader loses or invents without a warning; return an empty text if nothing.

    Differences that are meant, each told to the user:

    - messages from the piece on that has a definition that contradicts the first are not read;
    - a chunk that is damaged is skipped as a whole, where MCAP's reader gives what lies before
      the damage or takes what has no checksum;
    - log times that are none are left out;
    - the records behind a cut, or behind one that is longer than the file, are not looked for.
    """
    expected = messages_of(path.read_bytes()) if path.suffix == '.mcap' else rows_of(path)
    try:
        bag = open_bag(path)
    except BagError:
        # Told as an error: nothing is read, and nobody believes it was.
        return ''
    series = {topic: _read_numbers(bag, topic) for topic in TOPICS}
    samples = Counter((m.topic, m.log_time_ns, m.data) for m in bag.messages())
    # A note on the clock is no word on messages: they are there at other times.
    is_moved = any(' the clock of the recorder ' in f' {text}' for text in bag.warnings)
    dated = [sample for sample in expected.elements() if _has_time(sample[1], expected)]
    missing = (_without_times(dated, is_moved) - _without_times(samples.elements(), is_moved)).total()
    if missing and not bag.losses:
        return f'{missing} of {expected.total()} messages are missing without a word'
    for topic, text in ((t, s) for t, s in series.items() if isinstance(s, str)):
        return f'{topic}: {text}'
    return '' if bag.losses or is_moved else _wrong_numbers(series, samples)


def _without_times(samples: Iterable[Sample], is_moved: bool) -> Counter[Sample]:
    """Count samples, all of one time if times were moved."""
    return Counter((topic, 0 if is_moved else time_ns, data) for topic, time_ns, data in samples)


def _has_time(time_ns: int, expected: Counter[Sample]) -> bool:
    dated = any(_DATED <= time < _NO_TIME for _, time, _ in expected)
    return (0 if dated else -1) < time_ns < _NO_TIME


def _read_numbers(bag: Recording, topic: str) -> dict[str, object] | str | None:
    """Return the numbers of a topic, or None where an error names why there are none."""
    request = Request(topic, 'data', FLOAT64)
    try:
        series = bag.read([request])[request]
    except BagError:
        return None
    return {'time': series.log_time_ns.tolist(), 'value': series.value, 'told': bool(series.faults)}


def _wrong_numbers(series: dict[str, object], samples_found: Counter[Sample]) -> str:
    """Return which numbers differ from those in the messages, by a decoder of one line; empty if none."""
    for topic, numbers in series.items():
        if not isinstance(numbers, dict) or numbers['told']:
            continue
        samples = sorted(
            (time, data) for sample_topic, time, data in samples_found.elements() if sample_topic == topic
        )
        if [time for time, _ in samples] != sorted(numbers['time']):
            return f'{topic}: other messages are read than there are'
        if all(data[:4] == b'\0\1\0\0' and len(data) >= 12 for _, data in samples):
            values = np.array([struct.unpack_from('<d', data, 4)[0] for _, data in samples])
            if not np.array_equal(np.sort(values), np.sort(numbers['value']), equal_nan=True):
                return f'{topic}: other numbers are read than there are'
    return ''


def digest(data: bytes) -> str:
    """Return a short name for a mutant."""
    return f'{zlib.crc32(data):08x}'
