# SPDX-License-Identifier: Apache-2.0
"""The rule over a recording: its samples in blocks, verdicts as columns.

Each block goes on from the memory that the one before has left, so any cut into blocks gives the
same verdicts, and memory does not grow with the recording. A long one runs compiled.
"""

from __future__ import annotations

from collections.abc import Iterator, MutableSequence, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from importlib import import_module
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor import jit
from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray, IntArray
from stickslip_monitor.monitor import rule, vibration_rule
from stickslip_monitor.monitor.assessment import Assessments, assess
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule import (
    ACCEPTED,
    LEVEL,
    LOAD,
    SPEED,
    Model,
    Numbers,
    Rows,
    amplitude_due,
    arrive,
    condition,
    measured_now,
    standing_until,
    take,
)
from stickslip_monitor.monitor.rule_state import (
    NEVER,
    STATE_TYPE,
    RuleNumbers,
    RuleSettings,
    State,
    settings_of,
)
from stickslip_monitor.monitor.severity import LADDER, Unknown
from stickslip_monitor.monitor.signals import Input, Status, Stream
from stickslip_monitor.monitor.verdict import Event, Standing, size_cycle
from stickslip_monitor.physics import boundary_table, probability, scalar_law

STATUS, NOW, POINT, UNTIL, CONDITION, STICKING, MEASURED = range(7)
"""What is noted of each sample: the columns of the table that :func:`run` fills."""
SAMPLE, TIME, BEFORE, AFTER, ONSET = range(5)
"""What is noted of each change of the alarm."""


def run(
    states: Sequence[State],
    numbers: Sequence[RuleNumbers],
    model: Model,
    samples: tuple[Sequence[int], Sequence[int], Sequence[int], Numbers],
    begin: int,
    end: int,
    notes: Rows,
    points: Rows,
    changes: Rows,
    kept: MutableSequence[State],
) -> tuple[int, int]:
    """Take samples of a recording until there is no more room, or an amplitude is due.

    The memory and the numbers of the configuration are rows of one. A sample is which input it is of, its
    stamp and its arrival [ns], and its number. What is noted of each has 7 columns; a point has speed and
    load, and with a belief three probabilities; a change has 5, and the memory at it is kept.

    Returns:
        The sample after the last one taken, and how many changes there were.
    """
    places, stamps, arrivals, values = samples
    s, c = states[0], numbers[0]
    count = 0
    for k in range(begin, end):
        if count + 2 > len(kept) or (k > begin and amplitude_due(s, c)):
            return k, count
        place = places[k]
        before, lost, onsets, point = condition(s), s.lost, s.onsets, False
        status, time, si = arrive(s, c, place, stamps[k], arrivals[k], values[k])
        if s.lost != lost:
            note = k, s.lost_since, before, condition(s), s.onsets - onsets
            count = keep(states, changes, kept, count, note)
            before = condition(s)
        if status == ACCEPTED and place != LEVEL:
            point = take(s, c, model, place, time, si)
            if s.onsets > onsets or condition(s) != before:
                note = k, s.now, before, condition(s), s.onsets - onsets
                count = keep(states, changes, kept, count, note)
        row = notes[k]
        row[STATUS], row[NOW], row[POINT] = status, s.now - s.shift, int(point)
        row[CONDITION], row[STICKING] = condition(s), s.sticking
        if point:
            row[UNTIL], row[MEASURED] = standing_until(s, c) - s.shift, measured_now(s, c)
            points[k][0], points[k][1] = s.value[SPEED], s.value[LOAD]
            if c.has_belief:
                points[k][2], points[k][3], points[k][4] = s.can, s.will, s.runs
    return end, count


def keep(
    states: Sequence[State],
    changes: Rows,
    kept: MutableSequence[State],
    count: int,
    note: tuple[int, int, int, int, int],
) -> int:
    """Note a change of the alarm, with the memory as it is then; how many there are now."""
    for column in range(len(note)):
        changes[count][column] = note[column]
    kept[count] = states[0]
    return count + 1


LONG = 30_000
"""Samples from which on it pays to compile; fewer take less than numba's import."""
# Room for changes of the alarm; the loop is left and entered again where they are more.
_CHANGES = 256


@dataclass(frozen=True)
class Scan:
    """The verdicts on a recording of one bearing, or on a part of one.

    It has n operating points, m samples and k events.
    """

    config: BearingConfig
    settings: RuleSettings  # what the rule took
    time_ns: IntArray  # of the points, shape (n,)
    until_ns: IntArray  # how long each counts: to the next or to the loss of an input, (n,)
    speed: FloatArray  # of the surface at each point, shape (n,) [m/s]
    load: FloatArray  # at each point, shape (n,) [N]
    chances: FloatArray  # the first three of BELIEFS at each, (n, 3); without a belief (n, 0)
    rung: NDArray[np.int8]  # of the alarm after each, index into LADDER, shape (n,)
    sticking: BoolArray  # whether stick-slip is predicted after each, shape (n,)
    measured: NDArray[np.int8] | None  # index into MEASURED, (n,); None without a level
    sample: IntArray  # which sample of the recording made each, shape (n,)
    stretch: IntArray  # how often the clock had jumped before each, shape (n,)
    events: list[Event]  # changes of the alarm, in order
    at: list[int]  # which sample of the recording brought each of them, k
    now_ns: IntArray  # the monitor's time at each sample of the stream, shape (m,)
    status: NDArray[np.int8]  # what became of each of them, a Status, shape (m,)
    counts: IntArray  # samples by Input and Status, shape (3, 7)
    unknown: Unknown | None  # why the level says nothing at the end, where there is one

    @cached_property
    def assessment(self) -> Assessments:
        """The models' assessments of the points, of arrays of shape (n,)."""
        return self.assessed(slice(None))

    def assessed(self, rows: IndexArray | slice) -> Assessments:
        """The models' assessments of some of the points."""
        own, table = self.config, self.settings.boundaries
        speed, load, chances = self.speed[rows], self.load[rows], self.chances[rows].T
        return assess(own.bearing, speed, load, own.belief, table, chances)


def joined(parts: Sequence[Scan]) -> Scan:
    """The verdicts on a recording from those on its parts."""
    columns: dict[str, Any] = {
        each.name: np.concatenate([getattr(part, each.name) for part in parts])
        for each in fields(Scan)
        if isinstance(getattr(parts[0], each.name), np.ndarray)
    }
    return replace(
        parts[-1],
        **columns | {'counts': np.sum([part.counts for part in parts], 0)},
        events=[event for part in parts for event in part.events],
        at=[sample for part in parts for sample in part.at],
    )


class _Snapshots(list[State]):
    """Room for copies of a memory, filled as an array of records is."""

    def __setitem__(self, place: SupportsIndex, state: State) -> None:  # type: ignore[override]
        super().__setitem__(place, state.copy())


class BearingScan:
    """One bearing over a recording in blocks, whose inputs are waited for from a time on [ns].

    ``long`` is whether to run compiled; ``None``: where a block is long and numba is there. How long a point
    counts is known with the next one only, so each part ends a point before the samples that went in.
    """

    def __init__(self, config: BearingConfig, start_ns: int | None, *, long: bool | None = None) -> None:
        self.config = config
        self.settings = settings_of(config)
        self.state = State()
        self._long = long
        self._taken = self._jumps = 0
        self._now = NEVER
        self._held: dict[str, NDArray[Any]] = {}
        self._last: FloatArray | None = None
        if start_ns is not None:
            rule.pass_time(self.state, self.settings.live, start_ns)

    def take(self, stream: Stream) -> Scan:
        """Take the next samples; what is known of the recording with them comes out."""
        return self._take(stream, None, final=False)

    def finish(self, stream: Stream, end_ns: int | None) -> Scan:
        """Take the last samples, perhaps none; inputs may go stale until the end [ns]. The rest comes out."""
        return self._take(stream, end_ns, final=True)

    def _take(self, stream: Stream, end_ns: int | None, *, final: bool) -> Scan:
        size, has_level = stream.time_ns.size, self.config.level is not None
        notes, points = self._room(stream)
        changes = self._run(stream, notes, points)
        made = np.flatnonzero(notes[:, POINT])
        events, at = [], []
        for row, state in changes:
            # A loss comes before the sample that showed it.
            lost = int(row[AFTER]) == len(LADDER)
            last = int(np.searchsorted(made, row[SAMPLE], 'left' if lost else 'right')) - 1
            standing = self._standing(state, points[made[last]] if last >= 0 else self._last)
            before, time_ns, onset = row[[BEFORE, TIME, ONSET]].tolist()
            events.append(standing.event(before, time_ns, onset=bool(onset)))
            at.append(int(row[SAMPLE]) + self._taken)
        if made.size:
            self._last = points[made[-1]].copy()
        if final and end_ns is not None and self.state.now != NEVER:
            end = self._standing(self.state, self._last)
            events += end.advance(max(end_ns, self.state.now - self.state.shift))
            at += [self._taken + size - 1] * (len(events) - len(at))
        status = notes[:, STATUS].astype(np.int8)
        now = notes[:, NOW]
        jumps = self._jumps + np.cumsum(np.diff(now, prepend=self._now) < 0)
        if size:
            self._jumps, self._now = int(jumps[-1]), int(now[-1])
        rows = slice(None) if made.size == size else made
        columns: dict[str, Any] = {
            'time_ns': now[rows],
            'until_ns': notes[rows, UNTIL],
            'speed': points[rows, 0],
            'load': points[rows, 1],
            'chances': points[rows, 2:],
            'rung': notes[rows, CONDITION].astype(np.int8),
            'sticking': notes[rows, STICKING] > 0,
            'measured': notes[rows, MEASURED].astype(np.int8),
            'sample': made + self._taken,
            'stretch': jumps[rows],
        }
        if self._held:
            columns = {name: np.concatenate([self._held[name], new]) for name, new in columns.items()}
        time, until = columns['time_ns'], columns['until_ns']
        following = np.append(time[1:], time[-1:] if end_ns is None else [end_ns])[: time.size]
        out = max(time.size - (not final), 0)
        self._held = {name: column[out:].copy() for name, column in columns.items()}
        # Where the clock jumps back it is unknown how long the point counted.
        columns['until_ns'] = np.maximum(time, np.minimum(np.maximum(following, time), until))
        columns = {name: column[:out] for name, column in columns.items()}
        kinds = stream.inputs.astype(np.int64) * len(Status) + status
        counts = np.bincount(kinds, minlength=len(Input) * len(Status))
        self._taken += size
        return Scan(
            self.config,
            self.settings,
            **(columns if has_level else columns | {'measured': None}),
            events=events,
            at=at,
            now_ns=now,
            status=status,
            counts=counts.reshape(len(Input), len(Status)),
            unknown=self._standing(self.state, None).unknown,
        )

    def memories(self, stream: Stream, ends: Sequence[int]) -> Iterator[tuple[State, FloatArray | None]]:
        """Take samples without verdicts; the memory and the latest point after so many of them, rising."""
        notes, points = self._room(stream)
        kept: list[State] = []
        self._run(stream, notes, points, ends, kept)
        self._taken += stream.time_ns.size
        made = np.flatnonzero(notes[:, POINT])
        latest = np.searchsorted(made, ends) - 1
        before = self._last
        if made.size:
            self._last = points[made[-1]].copy()
        for state, k in zip(kept, latest.tolist(), strict=True):
            yield state, before if k < 0 else points[made[k]]

    def _room(self, stream: Stream) -> tuple[IntArray, FloatArray]:
        """Where the rule notes what became of each sample, and the points."""
        size, numbers = stream.time_ns.size, 2 if self.config.belief is None else 5
        # Each column in one piece: they are taken one by one.
        return np.zeros((7, size), np.int64).T, np.zeros((numbers, size)).T

    def _run(
        self,
        stream: Stream,
        notes: IntArray,
        points: FloatArray,
        ends: Sequence[int] = (),
        kept: list[State] | None = None,
    ) -> list[tuple[IntArray, State]]:
        """Run the rule over a block; the changes of the alarm, with the memory at each.

        The memory after so many samples as ``ends`` says is added to what is ``kept``.
        """
        settings = self.settings
        size = stream.time_ns.size
        long = self._long
        if long is None:
            long = self._taken + size >= LONG and jit.has_compiler()
        compiled = settings.law.compiled if long else None
        long = compiled is not None  # a law without functions of its own runs as it stands
        columns: Any = (stream.inputs, stream.time_ns, stream.arrival_ns, stream.value)
        given: tuple[Any, ...]
        if compiled:
            modules = (import_module(__name__), rule, vibration_rule, boundary_table, probability, scalar_law)
            loop: Any = jit.compiled('run', *modules, law=settings.law.module, inline=False)
            states = self.state.row()
            given = settings.row, (compiled.own, settings.boundaries.pieces, settings.chances)
        else:
            loop, states = run, [self.state]
            given = [settings.live], settings.model
            columns = tuple(column.tolist() for column in columns)
        changes, begin, count = list[tuple[IntArray, State]](), 0, 1
        for end in (*ends, size):
            while begin < end:
                if count:
                    rows = np.zeros((_CHANGES, 5), np.int64)
                    room: Any = (
                        np.zeros(_CHANGES, STATE_TYPE) if long else _Snapshots([self.state] * _CHANGES)
                    )
                begin, count = loop(states, *given, columns, begin, end, notes, points, rows, room)
                state = states.view(np.recarray)[0] if long else self.state
                if rule.amplitude_due(state, settings.live):
                    size_cycle(self.config, state)
                for k in range(count):
                    changes.append((rows[k], State.of_row(room[k]) if long else room[k]))
            if kept is not None and len(kept) < len(ends):
                kept.append(State.of_row(states[0]) if long else self.state.copy())
        if long:
            self.state = State.of_row(states[0])
        return changes

    def _standing(self, state: State, point: FloatArray | None) -> Standing:
        """The bearing with a memory, and the operating point that led to it."""
        standing = Standing(self.config, self.settings, state)
        if point is not None:
            standing.judge(point.tolist())
        return standing
