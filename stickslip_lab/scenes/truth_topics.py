# SPDX-License-Identifier: Apache-2.0
"""Reads and names the truth of a scene: numbers no sensor measures, on topics that no monitor reads.

Its times are log times, by the recorder's clock.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_logs.recordings.recording import Recording, Request, Series
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.errors import BagError

EVENT_SCHEMA = 'stickslip_monitor/truth/1'
ROOT = '/truth'
FLOAT64 = 'std_msgs/msg/Float64'
BOOL = 'std_msgs/msg/Bool'
STRING = 'std_msgs/msg/String'
_NUMBERS = ('hopf_margin', 'fold_margin', 'amplitude')


@dataclass(frozen=True, slots=True, eq=False)
class TruthNumbers:
    """One number over time; empty where it was not recorded."""

    time_ns: IntArray  # shape (n,)
    value: FloatArray  # shape (n,)


@dataclass(frozen=True, slots=True, eq=False)
class TruthRecord:
    """The truth about one bearing, from start to end.

    An episode is the first and the last instant of sticking [ns]; one that was going on at the end
    ends with the recording.
    """

    start_ns: int
    end_ns: int
    episodes: tuple[tuple[int, int], ...]
    hopf_margin: TruthNumbers
    fold_margin: TruthNumbers  # taken at the same times
    amplitude: TruthNumbers  # half the peak to peak of the lining's displacement [m]


def has_truth(bag: Recording, bearing: str) -> bool:
    """Return whether a recording holds the truth about a bearing."""
    return topic(bearing, 'events') in bag.topics


def read_truth(bag: Recording, bearing: str) -> TruthRecord:
    """Read the truth about a bearing whose lining was followed.

    Raises:
        BagError: The recording holds none, cannot be read, or an event is not of the schema that this version
            knows.
    """
    name = topic(bearing, 'events')
    if not has_truth(bag, bearing):
        names = ', '.join(
            bearing_name for bearing_name in _bearing_names(bag) if has_truth(bag, bearing_name)
        )
        have = 'only simulated recordings of a scene with the effect lining_motion have it'
        raise BagError(
            f"bag '{bag.path}' holds no truth about {bearing}: topic '{name}' is not in it; "
            + (f'it is about {names}' if names else have)
        )
    if bag.topics[name].type != STRING:
        raise BagError(f"topic '{name}' of bag '{bag.path}' is of type {bag.topics[name].type}, not {STRING}")
    return known_truth(bag, bearing)


def known_truth(bag: Recording, bearing: str) -> TruthRecord:
    """Read as much of the truth about a bearing as a recording holds.

    Without a lining that was followed it has no episodes; numbers that were not recorded are empty. It starts
    with the recording and ends with the event ``end``, or with the recording where there is none.

    Raises:
        BagError: The recording cannot be read, or an event is not of the schema that this version knows.
    """
    name = topic(bearing, 'events')
    messages = bag.messages([name]) if has_truth(bag, bearing) else ()
    events = [_decode_event(bag, message.data, name) for message in messages]
    times = [time for _, time in events] or [0]
    start = bag.start_ns if bag.start_ns is not None else times[0]
    over = bool(events) and events[-1][0] == 'end'
    end = times[-1] if over or bag.end_ns is None else bag.end_ns
    requests = {name: Request(topic(bearing, name), 'data', FLOAT64) for name in _NUMBERS}
    series = bag.read(r for r in requests.values() if r.topic in bag.topics)
    numbers = {name: _to_numbers(series.get(request)) for name, request in requests.items()}
    return TruthRecord(start, end, tuple(_find_episodes(events, end)), **numbers)


def _bearing_names(bag: Recording) -> list[str]:
    """Return the names of the bearings that a recording has truth about, sorted."""
    parts = [topic.split('/') for topic in bag.topics]
    return sorted({part[2] for part in parts if part[:2] == ['', 'truth'] and len(part) == 4})


def _decode_event(bag: Recording, data: bytes, topic: str) -> tuple[str, int]:
    """Return name and time [ns] of an encoded event.

    Raises:
        BagError: It is not of the schema that this version knows.
    """
    try:
        (size,) = struct.unpack_from('<I', data, 4)
        record: Any = json.loads(data[8 : 8 + size].rstrip(b'\0'))
        if record['schema'] == EVENT_SCHEMA:
            return str(record['event']), int(record['time'])
    except (struct.error, ValueError, LookupError, TypeError, OverflowError, RecursionError):
        pass
    raise BagError(f"topic '{topic}' of bag '{bag.path}' holds an event that is not of schema {EVENT_SCHEMA}")


def _find_episodes(events: Iterable[tuple[str, int]], end: int) -> Iterable[tuple[int, int]]:
    """Yield the times [ns] of first and last stick of each episode, by events in order of time.

    ``events`` are names and times [ns]. An episode that goes on ends at ``end`` [ns].
    """
    first: int | None = None
    for name, time in events:
        if name == 'first_stick':
            first = time
        elif name == 'last_stick' and first is not None:
            yield first, time
            first = None
    if first is not None:
        yield first, end


def _to_numbers(series: Series | None) -> TruthNumbers:
    """Return a series as log times and values; empty ones for ``None``."""
    if series is None:
        return TruthNumbers(np.empty(0, np.int64), np.empty(0))
    return TruthNumbers(series.log_time_ns, series.value)


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """n messages of one truth topic over a stretch of time."""

    topic: str
    type: str  # of a number, a truth value or a text
    time: FloatArray  # not falling, shape (n,) [s since the scene's start]
    values: Sequence[Any] | FloatArray  # n values of the type

    def stamps(self, start_ns: int) -> IntArray:
        """Return the log times [ns], shape (n,), in a scene that starts at ``start_ns``."""
        return start_ns + np.rint(self.time * 1e9).astype(np.int64)


def topic(bearing: str, name: str) -> str:
    """Return the name of the truth topic ``name`` of a bearing."""
    return f'{ROOT}/{bearing}/{name}'


def event_text(bearing: str, event: str, time_ns: int, **more: float) -> str:
    """Return an event of the lining as a JSON text; docs/interfaces.md has the schema.

    Args:
        bearing: Name of the bearing.
        event: Name of the event.
        time_ns: When it was [ns since 1970].
        more: More numbers of it, by key.
    """
    record = {'schema': EVENT_SCHEMA, 'bearing': bearing, 'event': event, 'time': time_ns}
    return json.dumps(record | more)
