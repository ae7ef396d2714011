# SPDX-License-Identifier: Apache-2.0
"""Looks at the inputs once a second: what comes of each, how fast, and what is wrong with it.

It knows neither clock nor ROS: time is an argument, and who publishes on a topic is asked of a
:class:`Graph`.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.ladder import Unknown
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.signals import INPUTS, LEVEL, QUANTITIES, Status, to_si
from stickslip_monitor.monitor.source_faults import SourceWatch, fault_text, least_gap

PATIENCE = 3
"""A fault is told when so many looks in a row have found it: discovery takes its time."""
SHARE_SAMPLES, SHARE_NS = 20, 10 * 10**9
"""The share of refused samples is that of at least so many, over at least such a time [ns]."""
_GRAPH_PERIOD = 5
_RATE_LOOKS = 10
_NUMBERS = re.compile(r'[\d.]+')
_BELIEVED = [status for status in Status if status.believed]
Counts = tuple[int, ...]
"""Samples by :class:`Status`."""


class Graph:
    """Who publishes what: this one knows nothing, as beside a ship's buses."""

    def publishers(self, topic: str) -> Sequence[Publisher] | None:
        """Who publishes on a topic of that full name; ``None`` where nobody can know."""
        del topic
        return None


@dataclass(frozen=True, slots=True)
class InputState:
    """An input as it is now.

    Attributes:
        age: Time since the last believed sample came [s]; ``inf`` before the first.
        rate: Believed samples lately [Hz]; ``nan`` while unknown.
        fault: What is wrong with it; empty for nothing.
    """

    age: float = math.inf
    rate: float = math.nan
    fault: str = ''


@dataclass(slots=True)
class _Track:
    """One input as it was at the looks before; times of the steady clock [ns]."""

    source: SourceWatch
    arrived_ns: int | None = None
    last: Counts = ()
    refused: Counts = ()
    marks: deque[tuple[int, Counts]] = field(default_factory=lambda: deque(maxlen=2))
    rates: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_RATE_LOOKS))
    looks: int = 0
    told: str = ''

    def look(self, now_ns: int, counts: Counts) -> None:
        """Take the counts of now."""
        self.rates.append((now_ns, _believed(counts)))
        if not self.marks:
            self.marks.append((now_ns, counts))
        since_ns, before = self.marks[-1]
        if now_ns - since_ns >= SHARE_NS and sum(counts) - sum(before) >= SHARE_SAMPLES:
            self.marks.append((now_ns, counts))
        if _believed(counts) != _believed(self.last) or not self.refused:
            self.refused = counts
        self.last = counts

    def rate(self) -> float:
        """Believed samples lately [Hz]; ``nan`` while unknown."""
        if len(self.rates) < 2:
            return math.nan
        (begin, before), (end, after) = self.rates[0], self.rates[-1]
        return (after - before) * 1e9 / (end - begin) if end > begin else math.nan

    def lately(self) -> Counts:
        """The samples of the last while."""
        return _grown(self.last, self.marks[0][1]) if self.marks else ()

    def since_believed(self) -> Counts:
        """The samples since the last look that found a new believed one."""
        return _grown(self.last, self.refused)


class InputWatch:
    """The faults of the inputs, their rates and ages.

    Args:
        bearings: The bearings by name.
        graph: Who publishes.
    """

    def __init__(self, bearings: Mapping[str, BearingMonitor], graph: Graph) -> None:
        self._bearings, self._graph = bearings, graph
        self._tracks = {
            name: tuple(
                _Track(SourceWatch(least_gap(bearing.config, place)))
                for place in range(len(bearing.config.inputs))
            )
            for name, bearing in bearings.items()
        }
        self._publishers: dict[str, Sequence[Publisher] | None] = {}
        self._looks = 0
        self._lost = False

    def take(
        self, bearing: str, place: int, time_ns: int, value: float, believed: bool, now_ns: int
    ) -> None:
        """Take note of a sample that came at a time of the steady clock, believed or not."""
        track, config = self._tracks[bearing][place], self._bearings[bearing].config
        if believed:
            track.arrived_ns = now_ns
        # A level that jumps between two values is what is looked for, and no fault.
        source = config.inputs[INPUTS[place]]
        si = math.nan if place == LEVEL else to_si(source, value)
        track.source.see(now_ns, time_ns, si)

    def states(self, bearing: str, now_ns: int) -> dict[str, InputState]:
        """The inputs of a bearing by quantity."""
        return {
            name: InputState(_age(track, now_ns), track.rate(), track.told)
            for name, track in zip(INPUTS, self._tracks[bearing], strict=False)
        }

    def explain(self, bearing: str, now_ns: int, without_clock: bool) -> str:
        """What is wrong with the lost inputs of a bearing right now; arguments as for look."""
        self._publishers.clear()
        lost = self._bearings[bearing].lost()
        found = (
            # Stamps that have just jumped are not yet stamps of another clock.
            input_fault(replace(self._facts(bearing, place, now_ns, without_clock), behind=0.0))
            for place, name in enumerate(QUANTITIES)
            if name in lost
        )
        return ' '.join(dict.fromkeys(text for text in found if text))

    def look(self, now_ns: int, without_clock: bool) -> list[tuple[str, str]]:
        """Look at every input; to be called once a second.

        Args:
            now_ns: The steady clock [ns].
            without_clock: Whether time follows ``/clock``, which has said nothing yet.

        Returns:
            Bearing and sentence of each fault that is to be told now.
        """
        self._looks += 1
        if self._lost or self._looks % _GRAPH_PERIOD == 0:
            self._publishers.clear()
        self._lost = False
        return [
            (name, track.told)
            for name, tracks in self._tracks.items()
            for place, track in enumerate(tracks)
            if self._look_at(name, place, track, now_ns, without_clock)
        ]

    def _look_at(
        self, bearing: str, place: int, track: _Track, now_ns: int, without_clock: bool
    ) -> bool:
        """Look at one input; whether there is a fault that was not told before."""
        track.look(now_ns, tuple(map(int, self._bearings[bearing].counts[place])))
        fault = input_fault(self._facts(bearing, place, now_ns, without_clock))
        track.looks = track.looks + 1 if fault else 0
        told = fault if track.looks >= PATIENCE else ''
        new = bool(told) and _NUMBERS.sub('', told) != _NUMBERS.sub('', track.told)
        track.told = told
        return new

    def _facts(self, bearing: str, place: int, now_ns: int, without_clock: bool) -> InputFacts:
        monitor, track = self._bearings[bearing], self._tracks[bearing][place]
        sources = list(monitor.config.inputs.values())
        beside = 0 if place else 1  # the input that its clock is compared with
        source, other = sources[place], sources[beside]
        own_ns, other_ns = monitor.last_ns(place), monitor.last_ns(beside)
        behind = 0.0
        if own_ns is not None and other_ns is not None and source.topic != other.topic:
            behind = (other_ns - own_ns) * 1e-9
        lost = own_ns is None or monitor.is_lost(place)
        self._lost |= lost
        timeout = source.timeout_ns * 1e-9
        lately = track.lately()
        return InputFacts(
            topic=source.topic,
            type=source.type,
            timeout=timeout,
            lost=lost,
            publishers=self._publishers_of(source.topic),
            heard=_age(track, now_ns) < 0.5 * timeout,
            refused=_worst(track.since_believed()),
            share=_refused(lately) if sum(lately) >= SHARE_SAMPLES else 0.0,
            reason=_worst(lately),
            without_clock=without_clock,
            behind=behind,
            other=other.topic,
            stuck=place == LEVEL and _is_stuck(monitor),
            source=', '.join(fault_text(fault, source) for fault in track.source.standing(now_ns)),
        )

    def _publishers_of(self, topic: str) -> Sequence[Publisher] | None:
        if topic not in self._publishers:
            self._publishers[topic] = self._graph.publishers(topic)
        return self._publishers[topic]


def _is_stuck(monitor: BearingMonitor) -> bool:
    return monitor.measured is not None and monitor.unknown is Unknown.STUCK


def _age(track: _Track, now_ns: int) -> float:
    return math.inf if track.arrived_ns is None else (now_ns - track.arrived_ns) * 1e-9


def _believed(counts: Counts) -> int:
    return sum(counts[status] for status in _BELIEVED) if counts else 0


def _grown(counts: Counts, before: Counts) -> Counts:
    return tuple(count - old for count, old in zip(counts, before, strict=True)) if counts else ()


def _refused(counts: Counts) -> float:
    """The share of the samples that were refused."""
    return 1.0 - _believed(counts) / sum(counts)


def _worst(counts: Counts) -> Status | None:
    """Why most of the refused ones were refused; ``None`` where none was."""
    refused = [status for status in Status if counts and not status.believed and counts[status]]
    return max(refused, key=lambda status: counts[status]) if refused else None
