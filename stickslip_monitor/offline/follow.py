# SPDX-License-Identifier: Apache-2.0
"""A bag read and its bearings scanned in blocks: memory does not grow with the recording."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.reader import Bag, Fault, Request, Series, open_bag
from stickslip_monitor.bags.series import Progress
from stickslip_monitor.monitor.bulk import BearingScan, Scan, scan_bearing
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.signals import Stream

Inputs = tuple[Series, ...]
"""Speed, load and, where it is measured, level of a bearing."""
_AHEAD_NS = 10**9
"""A stamp may be so much later than the recorder's time, by the errors of both clocks [ns]."""
_NOTHING = np.empty(0, np.int64)
_SILENCE = Series(_NOTHING, _NOTHING, _NOTHING, np.empty(0), ())


@dataclass(frozen=True, slots=True)
class BearingBlock:
    """A stretch of a recording, for one bearing."""

    series: Inputs  # each input as it was recorded
    stream: Stream  # the same, merged in the order of the recording
    scan: Scan  # the verdicts that are known with them, a point behind


class Follower(Protocol):
    """Takes the blocks of one bearing in order."""

    def take(self, block: BearingBlock) -> None:
        """Take the next one."""


_Follower = TypeVar('_Follower', bound=Follower)


@dataclass(frozen=True, slots=True)
class Followed(Generic[_Follower]):
    """What came of a bag; start and end are ``None`` in a recording without messages."""

    followers: dict[str, _Follower]  # by the bearing's name
    faults: Mapping[Request, tuple[Fault, ...]]  # what was wrong with the messages read
    start_ns: int | None  # on the clock of the samples
    end_ns: int | None


def follow(
    bag: Bag,
    config: MonitorConfig,
    make: Callable[[BearingConfig], _Follower],
    progress: Progress | None = None,
) -> Followed[_Follower]:
    """Run the monitor over a bag.

    Args:
        bag: The bag.
        config: The configuration; its topics must be in the bag.
        make: Makes what takes the blocks of a bearing.
        progress: Called with bytes read and bytes in all.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or a field leads to no number.
    """
    reading = bag.reading({r for b in config.bearings for r in requests_of(b)}, progress)
    span = SampleSpan(bag)
    courses = [_Course(b, make(b)) for b in config.bearings]
    running: list[Future[None]] = []
    # Bearings know nothing of each other, and arithmetic on arrays needs no interpreter.
    with ThreadPoolExecutor(min(len(courses), os.cpu_count() or 1)) as pool:
        for part in itertools.chain(reading, [None]):
            # What was read before is scanned while the next is read.
            for future in running:
                future.result()
            if part is not None:
                span.hear(part.values())
            running = [
                pool.submit(each.take, part, span.start_ns, span.end_ns) for each in courses
            ]
        for future in running:
            future.result()
    followers = {each.config.name: each.follower for each in courses}
    return Followed(followers, reading.faults(), span.start_ns, span.end_ns)


def requests_of(config: BearingConfig) -> tuple[Request, ...]:
    """What to read for a bearing: one request for each of its inputs."""
    return tuple(Request(i.topic, i.field_text, i.type) for i in config.inputs.values())


def _merged(series: Inputs) -> tuple[Stream, NDArray[np.intp]]:
    """Series in the order in which the bag holds their messages, and where each was."""
    order = np.argsort(np.concatenate([each.sequence for each in series]), kind='stable')
    inputs = np.repeat(np.arange(len(series)), [each.sequence.size for each in series])
    stream = Stream(
        np.concatenate([each.stamp_ns for each in series])[order],
        inputs[order].astype(np.int8),
        np.concatenate([each.value for each in series])[order],
    )
    return stream, order


class SampleSpan:
    """Start and end of a recording on the clock of the samples.

    Stamps in headers may be from another clock than the recorder's: then the samples' own span
    counts. Which it is shows with the first message.

    Attributes:
        start_ns: The start [ns], known with the first message.
        end_ns: The end as far as it was read [ns].
    """

    def __init__(self, bag: Bag) -> None:
        self.start_ns, self.end_ns = bag.start_ns, bag.end_ns
        self._begun = False

    def hear(self, series: Iterable[Series]) -> None:
        """Take the messages of a stretch."""
        known = [each for each in series if each.sequence.size]
        if self.start_ns is None or self.end_ns is None or not known:
            return
        if not self._begun:
            self._begun = True
            first = min(known, key=lambda each: int(each.sequence[0]))
            stamp, log_time = int(first.stamp_ns[0]), int(first.log_time_ns[0])
            if not self.start_ns <= stamp <= log_time + _AHEAD_NS:
                self.start_ns = self.end_ns = stamp
        self.end_ns = max(self.end_ns, *(int(each.stamp_ns.max()) for each in known))


class _Course(Generic[_Follower]):
    """One bearing on its way through a recording."""

    def __init__(self, config: BearingConfig, follower: _Follower) -> None:
        self.config, self.follower = config, follower
        self._requests = requests_of(config)
        self._scan: BearingScan | None = None

    def take(
        self, part: Mapping[Request, Series] | None, start_ns: int | None, end_ns: int | None
    ) -> None:
        """Take a stretch of the recording, or come to its end."""
        series = tuple(_SILENCE if part is None else part[request] for request in self._requests)
        stream, _ = _merged(series)
        if self._scan is None:
            self._scan = BearingScan(self.config, start_ns)
        scan = self._scan.finish(stream, end_ns) if part is None else self._scan.take(stream)
        self.follower.take(BearingBlock(series, stream, scan))


@dataclass(frozen=True)
class WholeBearing:
    """One bearing over a whole recording in memory."""

    config: BearingConfig
    stream: Stream  # its samples, m of them
    arrival_ns: IntArray  # when the recorder got each, shape (m,)
    span: SampleSpan

    @cached_property
    def scan(self) -> Scan:
        """The verdicts, worked out when they are first asked for."""
        return scan_bearing(self.config, self.stream, self.span.start_ns, self.span.end_ns)


@dataclass(frozen=True, slots=True)
class WholeBag:
    """A bag with all its verdicts in memory, for what needs them at once."""

    bag: Bag
    bearings: dict[str, WholeBearing]  # by name
    start_ns: int | None  # on the clock of the samples


def scan_whole(path: str | Path, config: MonitorConfig) -> WholeBag:
    """Run the monitor over a bag and keep everything.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or a field leads to no number.
    """
    bag = open_bag(path)
    asked = {b.name: requests_of(b) for b in config.bearings}
    series = bag.read({request for own in asked.values() for request in own})
    span = SampleSpan(bag)
    span.hear(series.values())
    found = {}
    for bearing in config.bearings:
        own = tuple(series[request] for request in asked[bearing.name])
        stream, order = _merged(own)
        arrival = np.concatenate([each.log_time_ns for each in own])[order]
        found[bearing.name] = WholeBearing(bearing, stream, arrival, span)
    return WholeBag(bag, found, span.start_ns)
