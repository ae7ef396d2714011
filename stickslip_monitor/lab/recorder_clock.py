# SPDX-License-Identifier: Apache-2.0
"""Puts the monitor's verdicts on the recorder's clock, which is that of the truth.

The monitor's time is that of the samples, and a sensor's clock may be wrong or jump. For a lead
it counts when a warning could be noticed: a change at a sample came when the recorder got that
sample; one that fell due between two samples came as long before the second as the samples' clock
says, and not before the first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.scan import Scan, scan_bearing
from stickslip_monitor.monitor.signals import Status, Stream
from stickslip_monitor.offline.follow import WholeBag

_EARLIEST = np.iinfo(np.int64).min


def scan_on_recorder_clock(whole: WholeBag, config: BearingConfig) -> Scan:
    """The verdicts on one bearing of a bag, with times of the recorder."""
    own = whole.bearings[config.name]
    return on_recorder_clock(config, own.stream, own.arrival_ns, own.scan, whole.start_ns)


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """A stretch between two jumps of the samples' clock, with its points and events of the scan.

    Attributes:
        now_ns: The monitor's time at each believed sample, not falling, shape (n,) [ns].
        log_time_ns: When the recorder got each, not falling, shape (n,) [ns].
        since_ns: When the recorder got the last sample before [ns].
        points: Which points of the scan fell into it.
        events: Which events.
    """

    now_ns: IntArray
    log_time_ns: IntArray
    since_ns: int
    points: slice
    events: slice

    def log_time(self, time_ns: IntArray) -> IntArray:
        """When the recorder's clock said what the monitor's time was, shape (m,) [ns]."""
        place = np.searchsorted(self.now_ns, time_ns)
        known = np.minimum(place, self.now_ns.size - 1)
        there = self.log_time_ns[known] + (time_ns - self.now_ns[known])
        return np.maximum(there, np.append(self.since_ns, self.log_time_ns)[place])


def on_recorder_clock(
    config: BearingConfig, stream: Stream, log_time_ns: IntArray, scan: Scan, start_ns: int | None
) -> Scan:
    """The verdicts of a scan, with times of the recorder.

    Each jump of the samples' clock costs one more scan, of what came before it: it tells which
    events had come by then, which their times alone do not.

    Args:
        config: The bearing.
        stream: The samples that were scanned, m of them.
        log_time_ns: When the recorder got each, not falling, shape (m,) [ns].
        scan: Their scan.
        start_ns: The start that the scan was given [ns].

    Returns:
        The scan with other ``time_ns``, ``until_ns`` and times of events; where the samples bear
        the recorder's time already, it itself.
    """
    if np.array_equal(stream.time_ns, log_time_ns):
        return scan
    time, until = scan.time_ns.copy(), scan.until_ns.copy()
    events = list(scan.events)
    for stretch in _stretches(config, stream, log_time_ns, scan, start_ns):
        own = stretch.points
        time[own] = stretch.log_time(scan.time_ns[own])
        until[own] = time[own] + (scan.until_ns[own] - scan.time_ns[own])
        said = events[stretch.events]
        moved = stretch.log_time(np.array([event.time_ns for event in said], np.int64)).tolist()
        events[stretch.events] = [
            replace(event, time_ns=time_ns) for event, time_ns in zip(said, moved, strict=True)
        ]
    # A point that held until the next one still does.
    joined = scan.until_ns[:-1] == scan.time_ns[1:]
    until[:-1] = np.where(joined, time[1:], np.minimum(until[:-1], time[1:]))
    return replace(scan, time_ns=time, until_ns=until, events=events)


def _stretches(
    config: BearingConfig, stream: Stream, log_time_ns: IntArray, scan: Scan, start_ns: int | None
) -> Iterator[_Stretch]:
    believed = np.flatnonzero(scan.status <= Status.CLOCK_JUMP)
    jumps = np.flatnonzero(scan.status[believed] == Status.CLOCK_JUMP)
    edges = [0, *jumps.tolist(), believed.size]
    log_time = log_time_ns[believed]
    points = events = 0
    for start, end in pairwise(edges):
        if start == end:
            continue
        now = np.maximum.accumulate(stream.time_ns[believed[start:end]])
        before = scan
        if end < believed.size:
            cut = stream.until(int(believed[end]))
            before = scan_bearing(config, cut, start_ns, int(now[-1]))
        yield _Stretch(
            now_ns=now,
            log_time_ns=log_time[start:end],
            since_ns=int(log_time[start - 1]) if start else _EARLIEST,
            points=slice(points, before.time_ns.size),
            events=slice(events, len(before.events)),
        )
        points, events = before.time_ns.size, len(before.events)
