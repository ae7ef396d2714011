# SPDX-License-Identifier: Apache-2.0
"""The order of events where the clock of a recorder was set back."""

from __future__ import annotations

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_logs.arrays import BoolArray, IntArray
from stickslip_logs.errors import plural
from stickslip_logs.recordings.mcap_chunks import Block, DamagedBlock, Piece, load, walk
from stickslip_logs.recordings.mcap_file import McapFile
from stickslip_logs.recordings.recording import Request, Series, TimeSpans

# A step back of a clock that was set, in gaps between lines and in time [ns]; smaller ones are
# lines that came late.
_STEP_GAPS, STEP_NS = 2.5, 10**9
# Of each topic of a recorder whose clock is set, or of what is played in a loop, so many step back,
# or two.
_SELDOM = 0.25
# How far behind the last message the next one is put [ns].
_BEHIND_NS = 10**7
# So many times ahead are those of damaged lines; more are those of a clock that is set back then.
_FEW_AHEAD = 2
_NONE = np.empty(0, np.int64)
# Larger chunks, which no recorder writes, are not looked at [bytes].
_MOST_LOOKED = 16 << 20
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
    for factor, unit in ((10**3, 'microseconds'), (10**6, 'milliseconds'), (10**9, 'seconds')):
        if rate > _TOO_MANY and _DATES[0] <= start_ns * factor and end_ns * factor <= _DATES[1]:
            return (
                f'log times are of January 1970, and one topic has {rate:.4g} messages a second:'
                f' are they in {unit}, not in nanoseconds?'
            )
    return ''


class Order:
    """Whether times are in an order, in which a clock may have been set back, or in none.

    Where a clock was set back all topics step back, and seldom: some are written newest first, one
    topic after the other, or in any order.

    Args:
        limit_ns: Smaller steps back are messages that came late [ns].
        passes_late: Whether one alone is late whatever its step, as for :class:`StepClock`.
    """

    def __init__(self, limit_ns: int = STEP_NS, *, passes_late: bool = False) -> None:
        self._limit_ns, self._passes_late, self._goes_back = limit_ns, passes_late, False
        self._latest_ns: int | None = None
        self._last: dict[int, int] = {}
        self._counts, self._steps = Counter[int](), Counter[int]()

    def add(self, time_ns: IntArray, topic: IntArray) -> None:
        """Take up the next messages: log times [ns] and the numbers of their topics, shape (n,)."""
        if not time_ns.size:
            return
        latest = _latest(self._latest_ns, time_ns)
        early = time_ns < latest[:-1] - self._limit_ns
        self._goes_back |= bool((early[:-1] & early[1:]).any() if self._passes_late else early.any())
        self._latest_ns = int(latest[-1])
        for key in np.unique(topic).tolist():
            own = time_ns[topic == key]
            gaps = np.diff(own, prepend=self._last.get(key, own[0]))
            self._steps[key] += int(np.count_nonzero(gaps < -self._limit_ns))
            self._counts[key] += own.size
            self._last[key] = int(own[-1])

    @property
    def steps_often(self) -> bool:
        """Whether a topic steps back more often than a clock is set."""
        return any(n > max(2, _SELDOM * self._counts[key]) for key, n in self._steps.items())

    @property
    def is_none(self) -> bool:
        """Whether they are in none."""
        return self.steps_often or (self._goes_back and not self._steps.total())


def no_order(what: str) -> str:
    """That something is in no order of time, and what is made of it."""
    return f'{what} in no order of time: sorted by time'


def _latest(before_ns: int | None, time_ns: IntArray) -> IntArray:
    """The latest time before each of some, and behind them [ns], shape (n + 1,)."""
    return np.maximum.accumulate(np.append(time_ns[0] if before_ns is None else before_ns, time_ns))


class StepClock:
    """Makes the times of lines go on where the clock of their writer was set back.

    The order of the file is the order of events: what follows a step back begins one gap behind
    what was before. Single lines from before are late, and stay what they are. A time or two that
    leap ahead, behind which time goes on from where it was, are between those beside them.
    """

    def __init__(self, gap_ns: int) -> None:
        self._gap_ns, self._limit_ns = gap_ns, limit_of(gap_ns)
        self.latest_ns: int | None = None
        self._shift_ns = self._ahead = 0
        self.steps_ns: list[int] = []

    def follow(self, time_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Times as they go on, and when each came [ns], shape (n,)."""
        if not time_ns.size:
            return time_ns, time_ns
        shifted, begin = time_ns + self._shift_ns, 0
        while True:
            latest = _latest(self.latest_ns, shifted)
            below = shifted < latest[:-1] - self._limit_ns
            # Two in a row: one alone is a line that came late.
            set_back = np.flatnonzero(below[begin:-1] & below[begin + 1 :])
            if not set_back.size:
                break
            begin += int(set_back[0])
            if self._mend(shifted, latest, begin):
                continue
            step = int(latest[begin]) - int(shifted[begin])
            if self._shift_ns + step + self._gap_ns > LATEST_NS:
                break
            self.steps_ns.append(step)
            self._shift_ns += step + self._gap_ns
            shifted[begin:] += step + self._gap_ns
        self.latest_ns = int(latest[-1])
        return shifted, latest[1:]

    def _mend(self, time_ns: IntArray, latest: IntArray, begin: int) -> bool:
        """Put times that leap ahead before a line between those beside them; whether they are so few."""
        first = int(latest[1:].searchsorted(time_ns[begin] + self._limit_ns, 'right'))
        before = int(latest[first])
        is_back = time_ns[begin] >= before - self._limit_ns and (first or self.latest_ns is not None)
        if not is_back or not 0 < np.unique(time_ns[first:begin]).size <= _FEW_AHEAD:
            return False
        self._ahead += begin - first
        time_ns[first:begin] = (before + int(time_ns[begin])) // 2
        return True

    def notes(self, whose: str) -> Iterator[str]:
        """That the clock of somebody was set back, or leapt ahead, and what is made of it."""
        if self.steps_ns:
            yield set_back(whose, self.steps_ns)
        if self._ahead:
            few = plural(self._ahead, 'time')
            yield f'the clock {whose} leapt ahead and back: {few} taken from those of the lines beside'


def limit_of(gap_ns: float) -> int:
    """Steps back of lines with some gaps that are larger are those of a clock that was set [ns]."""
    return min(max(STEP_NS, round(_STEP_GAPS * gap_ns)), 1 << 60)


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
    order of time, and none counts. Blocks are looked at where they, or those behind them, begin
    before their topics had ended; the last one is when it is read.

    Args:
        files: The files in order.
        least_ns: The least log time that is one [ns].
    """

    def __init__(self, files: Sequence[McapFile], least_ns: int) -> None:
        self._least_ns, self._shift_ns, self._no_order = least_ns, 0, ''
        # From which byte of which block on, and by how much.
        self._steps: list[tuple[int, int, int]] = []
        self._latest: dict[str, int] = {}
        self._spans: list[tuple[int, int]] = []
        blocks = [(file, block) for file in files for block in file.blocks]
        self._last = len(blocks) - 1
        for (file, block), (other, behind) in itertools.pairwise(blocks):
            names = file.topics_of(block)
            ends = dict.fromkeys(names, block.end_ns + self._shift_ns)
            is_next = self._is_early(other.topics_of(behind), behind, self._later(ends))
            is_odd = is_next or self._is_early(names, block, self._latest)
            found = _messages(file, block, least_ns) if is_odd and block.size <= _MOST_LOOKED else None
            if found is None or not found[0].size:
                self._go_on(ends, block.start_ns + self._shift_ns)
            elif not self._look(*found, is_next):
                self._no_order = no_order(f"file '{file.path.name}' is written")
                self._steps, self._spans, self._shift_ns, self._last = [], [], 0, -1
                break

    def _is_early(self, names: Iterable[str], block: Block, ends: Mapping[str, int]) -> bool:
        start = block.start_ns + self._shift_ns
        return any(start < ends.get(name, start) - STEP_NS for name in names)

    def _later(self, ends: Mapping[str, int]) -> dict[str, int]:
        return self._latest | {name: max(end, self._latest.get(name, end)) for name, end in ends.items()}

    def _go_on(self, ends: Mapping[str, int], start: int) -> None:
        """Take up a block by the last time of each of its topics and its first [ns]."""
        self._latest = self._later(ends)
        self._spans.append((start, max(ends.values(), default=start)))

    def _look(self, time_ns: IntArray, byte: IntArray, topic: NDArray[Any], is_next: bool = False) -> bool:
        """Look for a step in the next block; whether it is in an order of time.

        ``is_next`` is whether the block behind it begins too early as well.
        """
        time_ns = time_ns + self._shift_ns
        rows = {name: np.flatnonzero(topic == name) for name in np.unique(topic).tolist()}
        is_back = np.zeros(time_ns.size, np.bool_)
        for name, own in rows.items():
            is_back[own] = time_ns[own] < _latest(self._latest.get(name), time_ns[own])[:-1] - STEP_NS
        # Of one alone it is not known.
        if np.count_nonzero(is_back) + is_next > 1 and is_back.any():
            k = int(is_back.argmax())
            before, behind = time_ns[:k], time_ns[k:]
            spans = [*self._spans, *([(int(before.min()), int(before.max()))] if k else [])]
            had = np.mean(TimeSpans(spans).holds(time_ns[is_back])) > 0.5
            goes_on = all((np.diff(time_ns[own[own >= k]]) >= -STEP_NS).all() for own in rows.values())
            # A clock that stands still was not set back.
            if not goes_on or not had or (behind.size > 1 and behind.max() == behind.min()):
                return False
            step = max([*self._latest.values(), *before.tolist()]) - int(behind[0]) + _BEHIND_NS
            # Behind late ones time leaps to where it was.
            if is_back[k:].all() or 2 * int(np.diff(behind).max()) < step - _BEHIND_NS:
                self._steps.append((len(self._spans), int(byte[k]), step))
                self._shift_ns += step
                time_ns[k:] += step
        self._go_on({name: int(time_ns[own].max()) for name, own in rows.items()}, int(time_ns.min()))
        return True

    @property
    def text(self) -> str:
        """That the clock was set back, or that there is no order, as far as it is known; else empty."""
        steps = [step - _BEHIND_NS for *_, step in self._steps]
        return set_back('of the recorder', steps) if steps else self._no_order

    def span(self, number: int, block: Block) -> tuple[int, int]:
        """First and last time of the block of a number, as they go on [ns]."""
        if self._steps and number < len(self._spans):
            return self._spans[number]
        return block.start_ns + self._shift_ns, block.end_ns + self._shift_ns

    def follow(self, number: int, file: McapFile, piece: Piece) -> IntArray:
        """The times of the messages of a block of a number, as they go on [ns], shape (n,)."""
        time_ns = piece.log_time_ns
        is_time = time_ns >= self._least_ns
        if number == self._last == len(self._spans) and is_time.any():
            self._look(*_of_piece(file, piece, is_time))
        for at, byte, shift in self._steps:
            if at <= number:
                time_ns = time_ns + shift * (is_time & ((at < number) | (piece.offset >= byte)))
        return time_ns


def _messages(file: McapFile, block: Block, least_ns: int) -> tuple[IntArray, IntArray, NDArray[Any]]:
    """Log times of the messages of a block [ns], where in it they are, and their topics."""
    found = [(_NONE, _NONE, np.empty(0, 'U1'))]
    with contextlib.suppress(DamagedBlock):
        found += [_of_piece(file, piece, piece.log_time_ns >= least_ns) for piece in walk(load(block))]
    time_ns, byte, topic = (np.concatenate(each) for each in zip(*found, strict=True))
    return time_ns, byte, topic


def _of_piece(file: McapFile, piece: Piece, rows: BoolArray) -> tuple[IntArray, IntArray, NDArray[Any]]:
    keys, which = np.unique(piece.channel[rows], return_inverse=True)
    names = [file.channels[key].topic if key in file.channels else '' for key in keys.tolist()]
    topic = np.array(names, np.str_)[which]
    return piece.log_time_ns[rows], piece.offset[rows], topic


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
