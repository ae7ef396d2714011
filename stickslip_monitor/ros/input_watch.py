# SPDX-License-Identifier: Apache-2.0
"""Looks at the inputs once a second, and at who publishes on their topics: what is wrong?"""

from __future__ import annotations

import math
import re
import time
from dataclasses import dataclass, replace
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from stickslip_monitor.monitor.config import InputConfig
from stickslip_monitor.monitor.input_faults import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.signals import INPUTS, LEVEL, QUANTITIES, Status, number_to_si
from stickslip_monitor.monitor.source_faults import SourceWatch, fault_text, least_gap
from stickslip_monitor.ros.inputs import TELEMETRY

PATIENCE = 3
"""A fault is told when so many looks in a row have found it: discovery takes its time."""
_GRAPH_PERIOD = 5
_NUMBERS = re.compile(r'[\d.]+')
_BELIEVED = (Status.ACCEPTED, Status.CLOCK_JUMP)


@dataclass(slots=True)
class _Track:
    """One input as it was at the last look."""

    source: SourceWatch
    arrived: float = -math.inf
    believed: int = 0
    refused: tuple[int, ...] = ()
    looks: int = 0
    told: str = ''


class InputWatch:
    """The faults of the inputs.

    Args:
        node: The node.
        bearings: The bearings by name.
    """

    def __init__(self, node: Node, bearings: dict[str, BearingMonitor]) -> None:
        self._node, self._bearings = node, bearings
        self._tracks = {
            name: tuple(
                _Track(SourceWatch(least_gap(bearing.config, is_load)))
                for is_load in range(len(bearing.config.inputs))
            )
            for name, bearing in bearings.items()
        }
        self._publishers: dict[str, tuple[Publisher, ...]] = {}
        self._topics: dict[str, str] = {}
        self._looks = 0
        self._lost = False

    def take(self, bearing: str, is_load: int, time_ns: int, value: float, believed: bool) -> None:
        """Take note of a sample, and of whether it is believed."""
        track, config = self._tracks[bearing][is_load], self._bearings[bearing].config
        now_ns = time.monotonic_ns()
        if believed:
            track.arrived = now_ns * 1e-9
        # A level that jumps between two values is what is looked for, and no fault.
        source = config.inputs[INPUTS[is_load]]
        si = math.nan if is_load == LEVEL else number_to_si(source, value)[0]
        track.source.see(now_ns, time_ns, si)

    def faults(self, bearing: str) -> dict[str, str]:
        """What is wrong with the inputs of a bearing, by quantity."""
        tracks = zip(INPUTS, self._tracks[bearing], strict=False)
        return {name: track.told for name, track in tracks if track.told}

    def explain(self, bearing: str, now: float, without_clock: bool) -> str:
        """What is wrong with the lost inputs of a bearing right now; arguments as for look."""
        self._publishers.clear()
        lost = self._bearings[bearing].lost()
        found = (
            # Stamps that have just jumped are not yet stamps of another clock.
            input_fault(replace(self._facts(bearing, is_load, now, without_clock), behind=0.0))
            for is_load, name in enumerate(QUANTITIES)
            if name in lost
        )
        return ' '.join(dict.fromkeys(text for text in found if text))

    def look(self, now: float, without_clock: bool) -> list[tuple[str, str]]:
        """Look at every input.

        Args:
            now: The steady clock now [s].
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
            for is_load, track in enumerate(tracks)
            if self._look_at(name, is_load, track, now, without_clock)
        ]

    def _look_at(
        self, bearing: str, is_load: int, track: _Track, now: float, without_clock: bool
    ) -> bool:
        """Look at one input; whether there is a fault that was not told before."""
        fault = input_fault(self._facts(bearing, is_load, now, without_clock))
        track.looks = track.looks + 1 if fault else 0
        told = fault if track.looks >= PATIENCE else ''
        new = bool(told) and _NUMBERS.sub('', told) != _NUMBERS.sub('', track.told)
        track.told = told
        return new

    def _facts(self, bearing: str, is_load: int, now: float, without_clock: bool) -> InputFacts:
        monitor, track = self._bearings[bearing], self._tracks[bearing][is_load]
        sources = list(monitor.config.inputs.values())
        place = 0 if is_load else 1  # of the input that its clock is compared with
        source, other = sources[is_load], sources[place]
        own_ns, other_ns = monitor.last_ns(is_load), monitor.last_ns(place)
        refused = _refused(monitor, is_load, track)
        behind = 0.0
        if own_ns is not None and other_ns is not None and source.topic != other.topic:
            behind = (other_ns - own_ns) * 1e-9
        lost = own_ns is None or monitor.is_lost(is_load)
        self._lost |= lost
        timeout = source.timeout_ns * 1e-9
        return InputFacts(
            topic=self._topic(source),
            type=source.type,
            timeout=timeout,
            lost=lost,
            publishers=self._publishers_of(self._topic(source)),
            heard=now - track.arrived < 0.5 * timeout,
            refused=refused,
            without_clock=without_clock,
            behind=behind,
            other=self._topic(other),
            source=', '.join(
                fault_text(fault, source) for fault in track.source.standing(round(now * 1e9))
            ),
        )

    def _topic(self, source: InputConfig) -> str:
        if source.topic not in self._topics:
            self._topics[source.topic] = self._node.resolve_topic_name(source.topic)
        return self._topics[source.topic]

    def _publishers_of(self, topic: str) -> tuple[Publisher, ...]:
        found = self._publishers.get(topic)
        if found is None:
            infos = self._node.get_publishers_info_by_topic(topic)
            found = self._publishers[topic] = tuple(_publisher(info) for info in infos)
        return found


def _refused(monitor: BearingMonitor, is_load: int, track: _Track) -> Status | None:
    """Why samples have been refused since the last believed one; ``None`` where none was."""
    counts = tuple(int(count) for count in monitor.counted(is_load))
    believed = sum(counts[status] for status in _BELIEVED)
    if believed != track.believed or not track.refused:
        track.believed, track.refused = believed, counts
    grown = [count - old for count, old in zip(counts, track.refused, strict=True)]
    worst = max(Status, key=lambda status: grown[status])
    return worst if grown[worst] > 0 else None


def publishers_on(node: Node, topic: str) -> list[str]:
    """The full names of the nodes that publish on a topic."""
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return sorted({_node_name(info) for info in infos})


def _node_name(info: Any) -> str:
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _publisher(info: Any) -> Publisher:
    match, reason = qos_check_compatible(info.qos_profile, TELEMETRY)
    fits = match is not QoSCompatibility.ERROR
    return Publisher(_node_name(info), info.topic_type, '' if fits else str(reason).strip(' ;.'))
