# SPDX-License-Identifier: Apache-2.0
"""The order of events where the clock of a recorder was set back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.bags.mcap_chunks import Block, DamagedBlock, Piece, loading, walk
from stickslip_monitor.bags.mcap_file import McapFile
from stickslip_monitor.bags.recording import Request, Series

# A step back of a clock that was set, in gaps between lines and in time [ns]; smaller ones are
# lines that came late.
_STEP_GAPS, _STEP_NS = 2.5, 10**9

# How far behind the last message the next one is put [ns].
_BEHIND_NS = 10**7
_NONE = np.empty(0, np.int64)
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
    """Where the clock of a recorder was set back, in files that are read block by block.

    What is behind a step goes on behind what was before. A step counts where its topics go on in
    time from there, which is a time that the recording had before: else blocks were written in no
    order of time, and none counts. Only blocks that begin before their topics ended are looked at.

    Args:
        files: The files in order.
        least_ns: The least log time that is one [ns].
    """

    def __init__(self, files: Sequence[McapFile], least_ns: int) -> None:
        self._least_ns, self._shift_ns = least_ns, 0
        # From which byte of which block on, and by how much.
        self._steps: list[tuple[int, int, int]] = []
        self._latest: dict[str, int] = {}
        self._spans: list[tuple[int, int]] = []
        blocks = [(file, block) for file in files for block in file.blocks]
        for number, (file, block) in enumerate(blocks):
            if not self._take(number, file, block):
                self._steps = []
                break

    @property
    def text(self) -> str:
        """That the clock was set back, where it was."""
        steps = [step - _BEHIND_NS for *_, step in self._steps]
        return set_back('of the recorder', steps) if steps else ''

    def _take(self, number: int, file: McapFile, block: Block) -> bool:
        """Take the next block; whether blocks are in an order of time as yet."""
        names = file.topics_of(block)
        start, end = block.start_ns + self._shift_ns, block.end_ns + self._shift_ns
        if any(start < self._latest.get(name, start) - _STEP_NS for name in names):
            found = _messages(file, block, self._least_ns)
            if found[0].size:
                return self._look(number, *found)
        self._go_on(names, start, end)
        return True

    def _go_on(self, names: Iterable[str], start: int, end: int) -> None:
        self._latest.update({name: max(end, self._latest.get(name, end)) for name in names})
        self._spans.append((start, end))

    def _look(self, number: int, time_ns: IntArray, byte: IntArray, topic: NDArray[Any]) -> bool:
        """Look for a step among the messages of a block; whether it is in an order of time."""
        time_ns = time_ns + self._shift_ns
        is_back = np.zeros(time_ns.size, np.bool_)
        names = np.unique(topic).tolist()
        for name in names:
            rows = np.flatnonzero(topic == name)
            known = np.append(self._latest.get(name, time_ns[rows[0]]), time_ns[rows])
            is_back[rows] = time_ns[rows] < np.maximum.accumulate(known)[:-1] - _STEP_NS
        if np.count_nonzero(is_back) > 1:
            k = int(is_back.argmax())
            behind, latest = time_ns[k:], max([*self._latest.values(), *time_ns[:k].tolist()])
            own = [behind[topic[k:] == name] for name in names]
            spans = self._spans
            if k:
                spans = [*spans, (int(time_ns[:k].min()), int(time_ns[:k].max()))]
            middle = int(np.median(behind))
            goes_on = all((np.diff(each) >= -_STEP_NS).all() for each in own)
            if not goes_on or not any(start <= middle <= end for start, end in spans):
                return False
            # Late ones, behind which time goes on, are no step.
            if is_back[k:].all():
                self._steps.append((number, int(byte[k]), latest - int(behind[0]) + _BEHIND_NS))
                self._shift_ns += self._steps[-1][-1]
                time_ns[k:] += self._steps[-1][-1]
        self._go_on(names, int(time_ns.min()), int(time_ns.max()))
        return True

    def span(self, number: int, block: Block) -> tuple[int, int]:
        """First and last time of the block of a number, as they go on [ns]."""
        return self._spans[number] if self._steps else (block.start_ns, block.end_ns)

    def follow(self, number: int, piece: Piece) -> IntArray:
        """The times of the messages of a block of a number, as they go on [ns], shape (n,)."""
        time_ns = piece.log_time_ns
        is_time = time_ns >= self._least_ns
        for at, byte, shift in self._steps:
            if at <= number:
                time_ns = time_ns + shift * (is_time & ((at < number) | (piece.offset >= byte)))
        return time_ns


def _messages(file: McapFile, block: Block, least_ns: int) -> tuple[IntArray, IntArray, NDArray[Any]]:
    """Log times of the messages of a block [ns], where in it they are, and their topics."""
    topics = np.array([file.channels[key].topic if key in file.channels else '' for key in range(1 << 16)])
    found: list[tuple[IntArray, IntArray, NDArray[Any]]] = [(_NONE, _NONE, np.empty(0, topics.dtype))]
    with contextlib.suppress(DamagedBlock):
        for _, take in loading([block]):
            for piece in walk(take()):
                rows = piece.log_time_ns >= least_ns
                found.append((piece.log_time_ns[rows], piece.offset[rows], topics[piece.channel[rows]]))
    time_ns, byte, topic = (np.concatenate(each) for each in zip(*found, strict=True))
    return time_ns, byte, topic


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
