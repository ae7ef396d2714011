# SPDX-License-Identifier: Apache-2.0
"""The verdicts on a checked bag as messages, the same as the node publishes, beside its inputs.

The bag is followed once more, and what each stretch of it gives is handed on in order of time, so
memory does not grow with the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.encode import (
    MESSAGE_TYPES,
)
from stickslip_monitor.bags.values import Payload, TimeSpans
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.messages import (
    output_topics,
)
from stickslip_monitor.offline.check import CheckReport

NODE = 'stickslip_monitor'
_TICK_NS = 10**9
_SILENCE_NS = 3600 * 10**9
# Evaluations whose messages are laid out at a time.
_SLICE = 1 << 14
_NEVER = -(1 << 63)
_ALWAYS = TimeSpans([(0, (1 << 63) - 1)])


class MessageColumn(NamedTuple):
    """Messages of one topic: n log times [ns], and as many messages in CDR."""

    topic: str
    type: str
    time_ns: IntArray
    payload: Payload


def check_target(path: str | Path) -> Path:
    """The path of a recording of verdicts, which is one MCAP file that is not there yet.

    Raises:
        BagError: It ends in something else, or exists.
    """
    path = Path(path)
    if path.suffix != '.mcap':
        raise BagError(f"recording of verdicts '{path}' must end in .mcap")
    if path.exists():
        raise BagError(f"bag '{path}' exists already and is not overwritten")
    return path


def write_verdicts(
    checked: CheckReport,
    config: MonitorConfig,
    path: str | Path,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write the inputs of a checked bag and the verdicts on them as one MCAP file.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        path: Where to; a name ending in ``.mcap`` that is not there yet.
        progress: Told the messages written, now and then.

    Raises:
        BagError: It cannot be written, or the bag cannot be read again.
    """
    with BagWriter(check_target(path)) as writer:
        for topic, kind, definition in topics(checked, config):
            writer.add_topic(topic, kind, definition)

        def write(columns: Sequence[MessageColumn]) -> None:
            for part in _slices(columns):
                writer.write_columns((each.topic, each.time_ns, each.payload) for each in part)
            if progress is not None:
                progress(sum(writer.message_counts.values()))

        tell_verdicts(checked, config, write)


def _slices(columns: Sequence[MessageColumn]) -> Iterator[list[MessageColumn]]:
    """Cut columns into stretches of time, so that little is laid out at once."""
    longest = max(columns, key=lambda each: each.time_ns.size, default=None)
    if longest is None:
        return
    edges = np.sort(longest.time_ns)[_SLICE::_SLICE]
    places = [np.searchsorted(edges, each.time_ns, 'right') for each in columns]
    for number in range(edges.size + 1):
        yield [
            _picked(each, np.flatnonzero(place == number))
            for each, place in zip(columns, places, strict=True)
        ]


def _picked(column: MessageColumn, rows: NDArray[np.intp]) -> MessageColumn:
    payload = column.payload
    if rows.size == column.time_ns.size:
        return column
    some = payload[rows] if isinstance(payload, np.ndarray) else [payload[k] for k in rows]
    return MessageColumn(column.topic, column.type, column.time_ns[rows], some)


def topics(checked: CheckReport, config: MonitorConfig) -> Iterator[tuple[str, str, str | None]]:
    """Name, type and, where it is not built in, definition of every topic of the verdicts."""
    for name in _inputs(config):
        kind = checked.bag.topics[name].type
        yield name, kind, None if kind in MESSAGE_TYPES else checked.bag.definition(name)
    for name, kind in output_topics(config.bearings, f'/{NODE}').items():
        yield name, kind, None


def _inputs(config: MonitorConfig) -> list[str]:
    """The topics the bearings read, each once."""
    return list(dict.fromkeys(i.topic for b in config.bearings for i in b.inputs.values()))


def tell_verdicts(
    checked: CheckReport,
    config: MonitorConfig,
    tell: Callable[[Sequence[MessageColumn]], None],
    spans: TimeSpans = _ALWAYS,
) -> None:
    """Inputs and verdicts, one stretch of the recording after the other.

    The inputs have the log times they were recorded with, a verdict has its own time: that of the
    later of its two measurements.

    Args:
        checked: What the check found.
        config: The configuration it was checked with.
        tell: Given the messages of a stretch, inputs before verdicts. The stretches follow each
            other in time but for single messages at their edges.
        spans: The times that are wanted: nothing else is encoded.

    Raises:
        BagError: The bag cannot be read again.
    """
    raise NotImplementedError
