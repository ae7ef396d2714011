# SPDX-License-Identifier: Apache-2.0
"""The truth in a simulated recording: what the lining did, on topics that no monitor reads.

The truth of a scene: what no sensor of a ship could tell, on topics that no monitor reads.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.bags.reader import Bag
from stickslip_monitor.bags.values import Request, Series
from stickslip_monitor.errors import BagError

EVENT_SCHEMA = 'stickslip_monitor/truth/1'
_FLOAT64 = 'std_msgs/msg/Float64'
_STRING = 'std_msgs/msg/String'
_NUMBERS = ('hopf_margin', 'fold_margin', 'amplitude')


@dataclass(frozen=True, slots=True, eq=False)
class TruthNumbers:
    """One number over time; empty where it was not recorded.

    Attributes:
        time_ns: When, shape (n,) [ns].
        value: Shape (n,).
    """

    time_ns: IntArray
    value: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TruthRecord:
    """The truth about one bearing.

    Attributes:
        start_ns: From when on it was recorded [ns].
        end_ns: Until when [ns].
        episodes: First and last instant of sticking of each episode of stick-slip [ns]; one that
            was going on at the end ends with the recording.
        hopf_margin: True Hopf margin.
        fold_margin: True fold margin, taken at the same times.
        amplitude: Half the peak to peak of the lining's displacement [m].
    """

    start_ns: int
    end_ns: int
    episodes: tuple[tuple[int, int], ...]
    hopf_margin: TruthNumbers
    fold_margin: TruthNumbers
    amplitude: TruthNumbers


def has_truth(bag: Bag, bearing: str) -> bool:
    """Whether a recording holds the truth about a bearing."""
    return _topic(bearing, 'events') in bag.topics


def read_truth(bag: Bag, bearing: str) -> TruthRecord:
    """Read the truth about a bearing.

    Raises:
        BagError: The recording holds none, or it is not of the kind this version knows.
    """
    topic = _topic(bearing, 'events')
    if not has_truth(bag, bearing):
        known = ', '.join(name for name in _bearings(bag) if has_truth(bag, name))
        have = 'only simulated recordings of a scene with the effect lining_motion have it'
        raise BagError(
            f"bag '{bag.path}' holds no truth about {bearing}: topic '{topic}' is not in it; "
            + (f'it is about {known}' if known else have)
        )
    if bag.topics[topic].type != _STRING:
        raise BagError(f"topic '{topic}' of bag '{bag.path}' is no {_STRING}")
    events = [_event(bag, message.data, topic) for message in bag.messages([topic])]
    times = [time for _, time in events] or [0]
    start = bag.start_ns if bag.start_ns is not None else times[0]
    over = bool(events) and events[-1][0] == 'end'
    end = times[-1] if over or bag.end_ns is None else bag.end_ns
    asked = {
        name: Request(_topic(bearing, name), 'data', _FLOAT64)
        for name in _NUMBERS
        if _topic(bearing, name) in bag.topics
    }
    series = bag.read(asked.values())
    found = {name: series[request] for name, request in asked.items()}
    numbers = {name: _numbers(found.get(name)) for name in _NUMBERS}
    return TruthRecord(start, end, tuple(episodes_of(events, end)), **numbers)


def _topic(bearing: str, name: str) -> str:
    return f'/truth/{bearing}/{name}'


def _bearings(bag: Bag) -> list[str]:
    parts = [topic.split('/') for topic in bag.topics]
    return sorted({part[2] for part in parts if part[:2] == ['', 'truth'] and len(part) == 4})


def _event(bag: Bag, data: bytes, topic: str) -> tuple[str, int]:
    """Name and time of an event [ns]."""
    try:
        (size,) = struct.unpack_from('<I', data, 4)
        record: Any = json.loads(data[8 : 8 + size].rstrip(b'\0'))
        if record['schema'] == EVENT_SCHEMA:
            return str(record['event']), int(record['time'])
    except (struct.error, ValueError, LookupError, TypeError, OverflowError, RecursionError):
        pass
    raise BagError(f"topic '{topic}' of bag '{bag.path}' holds an event that is no {EVENT_SCHEMA}")


def episodes_of(events: Iterable[tuple[str, int]], end: int) -> Iterable[tuple[int, int]]:
    """First and last stick of each episode [ns], of events by name and time in their order.

    One that is going on at the end ends there.
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


def _numbers(series: Series | None) -> TruthNumbers:
    if series is None:
        return TruthNumbers(np.empty(0, np.int64), np.empty(0))
    return TruthNumbers(series.log_time_ns, series.value)


ROOT = '/truth'
FLOAT64 = 'std_msgs/msg/Float64'
BOOL = 'std_msgs/msg/Bool'
STRING = 'std_msgs/msg/String'


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """Messages of one truth topic over a stretch of time.

    Attributes:
        topic: The topic.
        type: Its message type: of a number, a truth value or a text.
        time: When, not falling, shape (n,) [s since the scene's start].
        values: What, n of them.
    """

    topic: str
    type: str
    time: FloatArray
    values: Sequence[Any] | FloatArray

    def stamps(self, start_ns: int) -> IntArray:
        """Log times [ns] in a scene that starts at ``start_ns``."""
        return start_ns + np.rint(self.time * 1e9).astype(np.int64)


def topic(bearing: str, name: str) -> str:
    """The truth topic of a bearing."""
    return f'{ROOT}/{bearing}/{name}'


def event_text(bearing: str, event: str, time_ns: int, **more: float) -> str:
    """An event of the lining as JSON; docs/interfaces.md has the schema."""
    record = {'schema': EVENT_SCHEMA, 'bearing': bearing, 'event': event, 'time': time_ns}
    return json.dumps(record | more)
