# SPDX-License-Identifier: Apache-2.0
"""Repeats values of inputs whose source stores changes only, for as long as ``hold`` lets them stand."""

from __future__ import annotations

import numpy as np

from stickslip_logs.time_order import MAX_LATE_NS
from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.monitor.bearing_monitor import repeat_step
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule import judge_value, si_value
from stickslip_monitor.monitor.rule_settings import settings_of
from stickslip_monitor.monitor.sample_types import QUANTITIES, Status, Stream


class HeldValues:
    """Puts repeats between the samples of a bearing, as its monitor makes them live.

    A repeat has the stamp of its value and an arrival of its own, so that the rule knows it as one.
    A number that is not valid has no repeats.
    """

    def __init__(self, config: BearingConfig) -> None:
        self._numbers = settings_of(config).live
        held = ((place, config.inputs[name]) for place, name in enumerate(QUANTITIES))
        self._schedules = {
            place: _repeat_schedule(source.hold_ns)
            for place, source in held
            if source.hold_ns and not source.is_assumed
        }
        # Of each input its latest sample (stamp, arrival, value, and how many repeats it has had).
        self._latest: dict[int, tuple[int, int, float, int]] = {}

    def fill(self, stream: Stream, until_ns: int | None) -> tuple[Stream, BoolArray]:
        """Insert the repeats due up to a time, and store the latest values for the next part.

        Args:
            stream: The next samples, in order of arrival.
            until_ns: Log time of the end of the part [ns]; None inserts no repeats and stores no values.

        Returns:
            The samples with repeats, and which of them are repeats, shape (m,).
        """
        none = np.zeros(stream.time_ns.size, np.bool_)
        if not self._schedules or until_ns is None:
            return stream, none
        columns = [self._make_repeats(place, stream, until_ns) for place in self._schedules]
        stamp_ns, arrival_ns, value = (np.concatenate(parts) for parts in zip(*columns, strict=True))
        inputs = np.repeat(np.array([*self._schedules], np.int8), [stamps.size for stamps, *_ in columns])
        order = np.argsort(arrival_ns, kind='stable')
        # Times that jump back are left in the order of the recording.
        place = np.searchsorted(np.maximum.accumulate(stream.arrival_ns), arrival_ns[order], 'right')
        filled = Stream(
            np.insert(stream.time_ns, place, stamp_ns[order]),
            np.insert(stream.inputs, place, inputs[order]),
            np.insert(stream.value, place, value[order]),
            arrival_ns=np.insert(stream.arrival_ns, place, arrival_ns[order]),
        )
        return filled, np.insert(none, place, True)

    def _make_repeats(
        self, place: int, stream: Stream, until_ns: int
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return stamps, arrivals [ns] and values of one input's due repeats; store its last value.

        Each has shape (n,); n may be 0.

        Args:
            place: The number of the input, which may be held.
            stream: The next samples of all inputs.
            until_ns: Log time up to which repeats are due [ns].
        """
        rows, schedule = stream.inputs == place, self._schedules[place]
        stamp_ns, arrival_ns, value = stream.time_ns[rows], stream.arrival_ns[rows], stream.value[rows]
        made = np.zeros(value.size, np.int64)
        if place in self._latest:
            columns = zip(self._latest[place], (stamp_ns, arrival_ns, value, made), strict=True)
            stamp_ns, arrival_ns, value, made = (np.append(latest, column) for latest, column in columns)
        if not value.size:
            return stamp_ns, arrival_ns, value
        c = self._numbers
        statuses = [judge_value(c, place, number, si_value(c, place, number)) for number in value.tolist()]
        is_valid = np.array(statuses) == Status.ACCEPTED
        # One that is older than another before it changes nothing; where a clock was set back all are.
        newest_ns = np.maximum.accumulate(np.where(is_valid, stamp_ns, 0))
        counts = ~is_valid | (stamp_ns == newest_ns) | (stamp_ns < newest_ns - MAX_LATE_NS)
        stamp_ns, arrival_ns, value, made, is_valid = (
            column[counts] for column in (stamp_ns, arrival_ns, value, made, is_valid)
        )
        # Before the next sample, and up to the end of the part.
        room = np.diff(arrival_ns, append=until_ns + 1)
        due = np.searchsorted(schedule, room, 'left')
        due[~is_valid] = 0
        due = np.maximum(due, made)
        self._latest[place] = int(stamp_ns[-1]), int(arrival_ns[-1]), float(value[-1]), int(due[-1])
        count = due - made
        of = np.repeat(np.arange(value.size), count)
        steps = np.arange(of.size) - np.repeat(np.cumsum(count) - count, count) + made[of]
        return stamp_ns[of], arrival_ns[of] + schedule[steps], value[of]


def _repeat_schedule(hold_ns: int) -> IntArray:
    """Return the delays after its arrival [ns] at which a value is repeated, up to ``hold_ns``, ascending.

    Shape (n,); empty where the first would be later.
    """
    offsets, passed_ns = list[int](), repeat_step(0)
    while passed_ns <= hold_ns:
        offsets.append(passed_ns)
        passed_ns += repeat_step(passed_ns)
    return np.array(offsets, np.int64)
