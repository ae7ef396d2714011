# SPDX-License-Identifier: Apache-2.0
"""The order of events where the clock of a recorder was set back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.recording import Request, Series

# A step back of a clock that was set, in gaps between lines and in time [ns]; smaller ones are
# lines that came late.
_STEP_GAPS, _STEP_NS = 2.5, 10**9

# Messages at least on both sides of a step, and how far behind the last one the next is put [ns].
_LEAST, _BEHIND_NS = 20, 10**7
# The years 2001 to 2099 [ns].
_DATES = 978_307_200 * 10**9, 4_102_444_800 * 10**9
LATEST_NS = 1 << 62
"""Of the year 2116: later times are none, and two of them would have no sum [ns]."""
# Messages of a topic a second that no telemetry has.
_TOO_MANY = 1000.0


def question_of_unit(start_ns: int | None, end_ns: int | None, most: int) -> str:
    """Whether log times look like dates in another unit, where a topic has so many messages."""
    if start_ns is None or end_ns is None or end_ns <= start_ns:
        return ''
    rate = most / ((end_ns - start_ns) * 1e-9)
    for factor, unit in ((10**3, 'microseconds'), (10**6, 'milliseconds')):
        if rate > _TOO_MANY and _DATES[0] <= start_ns * factor and end_ns * factor <= _DATES[1]:
            return (
                f'log times are of January 1970, and one topic has {rate:.4g} messages a second:'
                f' are they in {unit}, not in nanoseconds?'
            )
    return ''


class StepClock:
    """Makes the times of lines go on where the clock of their writer was set back.

    The order of the file is the order of events: what follows a step back begins one gap behind
    what was before. Single lines from before are late, and stay what they are.
    """

    def __init__(self, gap_ns: int) -> None:
        self._gap_ns = gap_ns
        self._limit_ns = min(max(_STEP_NS, round(_STEP_GAPS * gap_ns)), 1 << 60)
        self.latest_ns: int | None = None
        self._shift_ns = 0
        self.steps_ns: list[int] = []

    def follow(self, time_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Times as they go on, and when each came [ns], shape (n,)."""
        shifted = time_ns + self._shift_ns
        begin = 0
        while shifted.size:
            start = self.latest_ns if self.latest_ns is not None else int(shifted[0])
            before = np.maximum.accumulate(np.append(start, shifted))[:-1]
            below = shifted < before - self._limit_ns
            # Two in a row: one alone is a line that came late.
            set_back = np.flatnonzero(below[begin:-1] & below[begin + 1 :])
            if not set_back.size:
                break
            begin += int(set_back[0])
            step = int(before[begin]) - int(shifted[begin]) + self._gap_ns
            if self._shift_ns + step > LATEST_NS:
                break
            self.steps_ns.append(step - self._gap_ns)
            self._shift_ns += step
            shifted = np.append(shifted[:begin], shifted[begin:] + step)
        arrival = shifted
        if shifted.size:
            start = self.latest_ns if self.latest_ns is not None else int(shifted[0])
            arrival = np.maximum.accumulate(np.append(start, shifted))[1:]
            self.latest_ns = int(arrival[-1])
        return shifted, arrival

    def sentence(self, whose: str) -> str:
        """That the clock of somebody was set back, and what is made of it."""
        return set_back(whose, self.steps_ns)


def set_back(whose: str, steps_ns: Sequence[int]) -> str:
    """That the clock of somebody was set back by some times, and what is made of it."""
    times = 'once' if len(steps_ns) == 1 else f'{len(steps_ns)} times'
    return (
        f'the clock {whose} was set back {times}, by {max(steps_ns) * 1e-9:.6g} s at most: what'
        ' follows is taken to go on behind what was before'
    )


class BlockSteps:
    """Steps back of a recorder's clock inside of blocks, which are read by their starts.

    A step counts where the messages before it and those behind it go on in time, and it leads to a
    time that the recording had before: else blocks may have been written in no order of time.
    """

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._steps: list[tuple[int, int]] = []
        self.steps_ns: list[int] = []

    def follow(self, number: int, time_ns: IntArray) -> IntArray:
        """The times of messages of the block of a number, as they go on [ns], shape (n,)."""
        shifted = time_ns + sum(shift for at, shift in self._steps if at < number)
        back = np.flatnonzero(np.diff(time_ns) < -_STEP_NS)
        if back.size != 1:
            return shifted
        k = int(back[0]) + 1
        before, behind = time_ns[:k], time_ns[k:]
        step = int(before.max()) - int(behind[0])
        is_set = min(before.size, behind.size) >= _LEAST and int(behind.min()) > self._start_ns
        if not is_set or int(behind.max()) > int(before.max()) - _STEP_NS:
            return shifted
        self._steps.append((number, step + _BEHIND_NS))
        self.steps_ns.append(step)
        shifted[k:] += step + _BEHIND_NS
        return shifted


MOST = 1.5
"""Between clocks that were not rewritten no pace differs by this factor."""
Part = Mapping[Request, Series]
_LEAST_NS, _LONGEST_NS = 5 * 10**9, 60 * 10**9


class LogTimes:
    """The log times of a recording, as its first stretch with messages shows them.

    Attributes:
        text: What is wrong with them, as a sentence; empty where nothing is.
        replaced: Whether stamps count in their place.
    """

    def __init__(self) -> None:
        self.text, self.replaced, self._begun = '', False, False

    def of(self, reading: Iterable[Part]) -> Iterator[Part]:
        """The stretches of a recording with the times that count."""
        for part in reading:
            if not self._begun:
                self._judge(list(part.values()))
            yield (
                part
                if not self.replaced
                else {
                    request: replace(each, log_time_ns=np.maximum.accumulate(each.stamp_ns))
                    for request, each in part.items()
                }
            )

    def _judge(self, series: Sequence[Series]) -> None:
        paces = [_pace(each) for each in series if each.value.size]
        self._begun = bool(paces)
        odd = [pace for pace in paces if pace is not None and not 1 / MOST <= pace <= MOST]
        if odd:
            self.replaced = None not in paces
            by = 'stamps' if self.replaced else 'log times, because an input has no stamps'
            self.text = (
                f'Log times pass {odd[0]:.3g} times as fast as the stamps, so they were rewritten:'
                f' judged by the {by}.'
            )


def _pace(series: Series) -> float | None:
    """How fast the log times pass by the stamps; ``None`` where no stamp differs from them.

    Pauses and steps of either clock are left out; what is short says nothing, which is 1.
    """
    if np.array_equal(series.log_time_ns, series.stamp_ns):
        return None
    log, stamp = np.diff(series.log_time_ns), np.diff(series.stamp_ns)
    usual = (log >= 0) & (log < _LONGEST_NS) & (stamp >= 0) & (stamp < _LONGEST_NS)
    passed = int(stamp[usual].sum())
    return 1.0 if passed < _LEAST_NS else int(log[usual].sum()) / passed
