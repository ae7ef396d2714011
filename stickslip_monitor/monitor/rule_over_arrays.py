# SPDX-License-Identifier: Apache-2.0
"""Runs the rule over a recording: samples in blocks, verdicts as columns.

Each block goes on from the memory that the one before has left, so any cut into blocks gives the
same verdicts, and memory does not grow with the recording. A long one runs compiled.
"""

from __future__ import annotations

import math
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
    REPEATED,
    Model,
    Numbers,
    Rows,
    condition_index,
    has_repeats,
    is_amplitude_due,
    measured_now,
    receive_sample,
    repeat_value,
    take_value,
)
from stickslip_monitor.monitor.rule_settings import RuleNumbers, RuleSettings, settings_of
from stickslip_monitor.monitor.rule_state import LEVEL, LOAD, NEVER, SPEED, STATE_TYPE, State
from stickslip_monitor.monitor.sample_types import Input, Status, Stream
from stickslip_monitor.monitor.severity import Unknown
from stickslip_monitor.monitor.statements import Event, Standing, size_cycle
from stickslip_monitor.physics import boundary_table, lubrication, probability, scalar_law

SAMPLE, TIME, BEFORE, AFTER, ONSET, POINTS = range(6)
"""What is noted of each change of the alarm; the last is how many points there were then."""


def run(
    states: Sequence[State],
    numbers: Sequence[RuleNumbers],
    model: Model,
    samples: tuple[Sequence[int], Sequence[int], Sequence[int], Numbers, Numbers],
    span: tuple[int, int, int],
    noted: Rows,
    points: tuple[Rows, Rows],
    made: int,
    changes: Rows,
    memories: MutableSequence[State],
) -> tuple[int, int, int]:
    """Take samples of a recording until there is no more room for changes, or an amplitude is due.

    The memory advances in place.

    Args:
        states: The memory, as a row of one.
        numbers: The numbers of the configuration, as a row of one.
        model: The law, the tables of the boundaries and of the belief.
        samples: Columns: index of the input, stamp [ns], arrival [ns], number, excess of the loudest
            other level where it is a level [dB].
        span: Number of the first sample in the recording; begin and end of those to take.
        noted: Columns that are filled: status and the monitor's time [ns] of each sample.
        points: Columns of :data:`_POINT` that are filled, and three probabilities.
        made: How many points are made already.
        changes: Rows of six numbers that are filled, one for each change of the alarm.
        memories: Room for a copy of the memory at each change.

    Returns:
        The index of the first sample not taken, how many changes there were, and how many points are made.
    """
    places, stamps, arrivals, values, rivals = samples
    first, begin, end = span
    statuses, now = noted
    (time_ns, until_ns, speed, load, water, sample, rung, sticking, vibration), chances = points
    s, c = states[0], numbers[0]
    count, before = 0, condition_index(s)
    for k in range(begin, end):
        if count + 2 > len(memories) or (k > begin and is_amplitude_due(s, c)):
            return k, count, made
        place = places[k]
        lost, onsets, until = s.lost, s.onsets, NEVER
        if place == LEVEL:
            s.rival = rivals[k]
        status, time, si = receive_sample(s, c, place, stamps[k], arrivals[k], values[k])
        if s.lost != lost:
            note = first + k, s.lost_since, before, condition_index(s), s.onsets - onsets, made
            count = store_change(states, changes, memories, count, note)
            before = condition_index(s)
        if status == ACCEPTED and place < LEVEL:
            until = take_value(s, c, model, place, time, si)
        elif status == REPEATED and has_repeats(c, place):
            until = repeat_value(s, c, model, place)
        statuses[k], now[k] = status, s.now - s.shift
        if until == NEVER:
            continue
        time_ns[made], until_ns[made] = s.now - s.shift, until - s.shift
        if made:
            end_point(time_ns, until_ns, made - 1, time_ns[made])
        speed[made], load[made], water[made] = s.value[SPEED], s.value[LOAD], s.water
        sample[made] = first + k
        after = condition_index(s)
        rung[made], sticking[made], vibration[made] = after, s.sticking > 0, measured_now(s, c)
        if c.has_belief:
            chances[made][0], chances[made][1], chances[made][2] = s.can, s.will, s.runs
        made += 1
        if s.onsets > onsets or after != before:
            note = first + k, s.now, before, after, s.onsets - onsets, made
            count = store_change(states, changes, memories, count, note)
        before = after
    return end, count, made


def end_point(time_ns: Numbers, until_ns: MutableSequence[float], row: int, end_ns: float) -> None:
    """Let the point in a row count until ``end_ns`` at most [ns]; not at all where the clock jumped back.

    ``time_ns`` and ``until_ns`` are columns of points, of which the second changes.
    """
    until_ns[row] = max(time_ns[row], min(end_ns, until_ns[row]))


def store_change(
    states: Sequence[State],
    changes: Rows,
    memories: MutableSequence[State],
    count: int,
    note: tuple[int, int, int, int, int, int],
) -> int:
    """Store ``note``, an alarm change, and the memory in row ``count``; return ``count + 1``.

    The one memory is ``states[0]``. ``memories`` has to copy what is assigned, as an array of records does.
    ``note`` has the six numbers whose places are :data:`SAMPLE` to :data:`POINTS`.
    """
    for column in range(len(note)):
        changes[count][column] = note[column]
    memories[count] = states[0]
    return count + 1


LONG = 30_000
"""Samples from which on it pays to compile; fewer take less than numba's import."""
_POINT: dict[str, Any] = {
    'time_ns': np.int64,
    'until_ns': np.int64,
    'speed': np.float64,
    'load': np.float64,
    'water': np.float64,
    'sample': np.int64,
    'rung': np.int8,
    'sticking': np.bool_,
    'measured': np.int8,
}
"""The columns of the operating points as :class:`Scan` has them; the chances follow."""
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
    water: FloatArray  # by which friction went at each, shape (n,) [C]; nan where it goes by none
    chances: FloatArray  # the first three of BELIEFS at each, (n, 3); without a belief (n, 0)
    rung: NDArray[np.int8]  # of the alarm after each, index into LADDER, shape (n,)
    sticking: BoolArray  # whether stick-slip is predicted after each, shape (n,)
    measured: NDArray[np.int8] | None  # index into MEASURED, (n,); None without a level
    sample: IntArray  # which sample of the recording made each, shape (n,)
    events: list[Event]  # changes of the alarm, in order
    at: list[int]  # which sample of the recording brought each of them, k
    now_ns: IntArray  # the monitor's time at each sample of the stream, shape (m,)
    status: NDArray[np.int8]  # what became of each of them, a Status, shape (m,)
    counts: IntArray  # samples by Input and Status, shape (4, 7)
    unknown: Unknown | None  # why the level says nothing at the end, where there is one
    water_doubt: str  # why the temperature of the water is in doubt at the end; empty where it is not

    @property
    def clock_part(self) -> IntArray:
        """Number of steps back of the clock before each point of a whole recording, shape (n,)."""
        back = np.diff(self.now_ns, prepend=self.now_ns[:1]) < 0
        jumps: IntArray = np.cumsum(back, dtype=np.int64)[self.sample]
        return jumps

    @cached_property
    def assessment(self) -> Assessments:
        """The models' assessments of the points, of arrays of shape (n,)."""
        return self.assessed(slice(None))

    def fold_speed(self, rows: IndexArray) -> FloatArray:
        """Return the fold that decides at some of the points, shape (rows,) [m/s]; ``nan`` without one."""
        lubrication, load, scale = self.config.bearing.lubrication, self.load[rows], 1.0
        if lubrication is not None:
            water = None if self.config.water_temperature is None else self.water[rows]
            scale = lubrication.scale(load, water)
        with np.errstate(all='ignore'):
            return scale * self.settings.boundaries.fold(load / scale)

    def assessed(self, rows: IndexArray | slice) -> Assessments:
        """Return the models' assessments of some of the points, of arrays of shape (rows,)."""
        config, table = self.config, self.settings.boundaries
        speed, load, chances = self.speed[rows], self.load[rows], self.chances[rows].T
        water = None if config.water_temperature is None else self.water[rows]
        return assess(config.bearing, speed, load, config.belief, table, chances, water)


def join_scans(parts: Sequence[Scan]) -> Scan:
    """Return the verdicts on the successive parts of a recording, at least one, as those of one part.

    The places in ``sample`` and ``at`` must be those in the whole recording. ``unknown`` and ``water_doubt``
    are those of the last part.
    """
    columns: dict[str, Any] = {
        column.name: np.concatenate([getattr(part, column.name) for part in parts])
        for column in fields(Scan)
        if isinstance(getattr(parts[0], column.name), np.ndarray)
    }
    return replace(
        parts[-1],
        **columns | {'counts': np.sum([part.counts for part in parts], 0)},
        events=[event for part in parts for event in part.events],
        at=[sample for part in parts for sample in part.at],
    )


def count_statuses(inputs: NDArray[np.int8], status: NDArray[np.int8]) -> IntArray:
    """Count samples by their :class:`Input` and :class:`Status`, shape (n,) each; return shape (4, 7)."""
    kinds = np.bincount(inputs * len(Status) + status, minlength=len(Input) * len(Status))
    return kinds.reshape(len(Input), len(Status))


class _Snapshots(list[State]):
    """Room for copies of a memory, filled as an array of records is."""

    def __setitem__(self, place: SupportsIndex, state: State) -> None:  # type: ignore[override]
        super().__setitem__(place, state.copy())


class BearingScan:
    """One bearing over a recording in blocks, whose inputs are waited for from a time on.

    How long a point counts is known with the next one only, so each part ends a point before the samples that
    went in.

    Args:
        config: The bearing.
        start_ns: Time from which inputs are waited for [ns]; ``None`` for that of the first sample.
        long: Whether to run compiled, which needs numba; ``None``: where a block is long and numba is there.
    """

    def __init__(self, config: BearingConfig, start_ns: int | None, *, long: bool | None = None) -> None:
        self.config = config
        self.settings = settings_of(config)
        self.state = State()
        rule.use_configured_water(self.state, self.settings.live)
        self._long = long
        # The points of a block, behind the one that was held back, if any; how many they are.
        self._points: dict[str, NDArray[Any]] = {}
        self._taken = self._held = self._made = 0
        if start_ns is not None:
            rule.advance(self.state, self.settings.live, start_ns)

    def take(self, stream: Stream) -> Scan:
        """Take the next samples and return their verdicts; the last point waits for the next."""
        return self._take_stream(stream, None, final=False)

    def finish(self, stream: Stream, end_ns: int | None) -> Scan:
        """Take the last samples, perhaps none, and return the rest of the verdicts.

        Inputs may go stale until the end of the recording [ns]; ``None`` where that is unknown.
        """
        return self._take_stream(stream, end_ns, final=True)

    def _take_stream(self, stream: Stream, end_ns: int | None, *, final: bool) -> Scan:
        """Run the rule over the next samples; return their verdicts, of the last point only if ``final``.

        Events by the end ``end_ns`` [ns] are added only then; ``None``: there are none.
        """
        size = stream.time_ns.size
        noted = np.empty(size, np.int8), np.empty(size, np.int64)
        made, changes, _ = self._run_rule(stream, noted)
        events, at = [], []
        for row, state in changes:
            before, time_ns, onset, sample, count = row[[BEFORE, TIME, ONSET, SAMPLE, POINTS]].tolist()
            events.append(self._make_standing(state, count).event(before, time_ns, onset=bool(onset)))
            at.append(sample)
        if final and end_ns is not None and self.state.now != NEVER:
            end = self._make_standing(self.state, made)
            events += end.advance(max(end_ns, self.state.now - self.state.shift))
            at += [self._taken + size - 1] * (len(events) - len(at))
        out = made if final else max(made - 1, 0)
        columns: dict[str, Any] = {name: column[:out] for name, column in self._points.items()}
        if final and made:
            times = columns['time_ns']
            end_point(times, columns['until_ns'], -1, times[-1] if end_ns is None else end_ns)
        if self.config.level is None:
            columns['measured'] = None
        self._made, self._held, self._taken = made, made - out, self._taken + size
        status, now_ns = noted
        now = Standing(self.config, self.settings, self.state)
        return Scan(
            self.config,
            self.settings,
            **columns,
            events=events,
            at=at,
            now_ns=now_ns,
            status=status,
            counts=count_statuses(stream.inputs, status),
            unknown=now.unknown,
            water_doubt=now.water_doubt,
        )

    def memories(self, stream: Stream, ends: Sequence[int]) -> Iterator[tuple[State, FloatArray | None]]:
        """Take samples and yield the memory and the latest point after each of some rising counts of them.

        A point is speed, load, temperature of the water and probabilities; ``None`` before the first. Samples
        are taken when the first pair is asked for; exhaust the iterator before the next block.
        """
        size = stream.time_ns.size
        made, _, saved = self._run_rule(stream, (np.empty(size, np.int8), np.empty(size, np.int64)), ends)
        for state, count in saved:
            yield state, self._latest_point(count)
        self._made, self._held, self._taken = made, min(made, 1), self._taken + size

    def _latest_point(self, count: int) -> FloatArray | None:
        """Return the latest of some points: speed, load, water and probabilities; ``None`` for no points."""
        if not count:
            return None
        *point, chances = (self._points[name][count - 1] for name in ('speed', 'load', 'water', 'chances'))
        return np.array([*point, *chances])

    def _make_columns(self, size: int) -> tuple[tuple[Any, ...], Any]:
        """Replace the stored columns by new ones for ``size`` points, and for one held back before, in row 0.

        Without one held back points begin in row 0. Other rows hold anything until the rule fills them.

        Returns:
            The columns of :data:`_POINT`, shape (size + 1,), and that of the probabilities: shape
            (size + 1, 3), or (size + 1, 0) without a belief.
        """
        before = self._points
        self._points = {name: np.empty(size + 1, kind) for name, kind in _POINT.items()}
        self._points['chances'] = np.empty((size + 1, 0 if self.config.belief is None else 3))
        if self._held:
            for name, column in before.items():
                self._points[name][0] = column[self._made - 1]
        *columns, chances = self._points.values()
        return tuple(columns), chances

    def _run_rule(
        self, stream: Stream, noted: tuple[NDArray[np.int8], IntArray], ends: Sequence[int] = ()
    ) -> tuple[int, list[tuple[IntArray, State]], list[tuple[State, int]]]:
        """Run the rule over a block, compiled where that pays, and fill ``noted`` with status and time.

        The memory goes on to its end, and the columns of the points are filled.

        Args:
            stream: The samples of the block, n of them.
            noted: Columns to fill: the :class:`.Status` and the monitor's time [ns] of each, shape (n,).
            ends: Rising counts of samples after which the memory is wanted.

        Returns:
            How many points there are, with one held back; the changes of the alarm, each as the six numbers
            of :func:`store_change` with the memory at it; and the memory and the number of points after each
            count of samples in ``ends``.
        """
        settings = self.settings
        size, points, made = stream.time_ns.size, self._make_columns(stream.time_ns.size), self._held
        long = self._long
        if long is None:
            long = self._taken + size >= LONG and jit.has_compiler()
        rival = stream.rival if stream.rival.size else np.full(size, math.nan)
        columns: Any = (stream.inputs, stream.time_ns, stream.arrival_ns, stream.value, rival)
        given: tuple[Any, ...]
        if long:
            physics = boundary_table, lubrication, probability, scalar_law
            modules = (import_module(__name__), rule, vibration_rule, *physics)
            loop: Any = jit.compiled('run', *modules, law=settings.law.module)
            states = self.state.row()
            given = settings.row, (settings.law.compiled, settings.boundaries.pieces, settings.chances)
        else:
            loop, states = run, [self.state]
            given = [settings.live], settings.model
            columns = tuple(column.tolist() for column in columns)
        rows = np.empty((_CHANGES, 6), np.int64)
        room: Any = np.empty(_CHANGES, STATE_TYPE) if long else _Snapshots([self.state] * _CHANGES)
        changes, memories, begin = list[tuple[IntArray, State]](), list[tuple[State, int]](), 0
        for end in (*ends, size):
            while begin < end:
                span = self._taken, begin, end
                begin, count, made = loop(states, *given, columns, span, noted, points, made, rows, room)
                # A view as a recarray, which it is written through, takes longer than a copy.
                if rule.is_amplitude_due(State.of_row(states[0]) if long else self.state, settings.live):
                    size_cycle(self.config, states.view(np.recarray)[0] if long else self.state)
                for k in range(count):
                    changes.append((rows[k].copy(), State.of_row(room[k]) if long else room[k]))
            if len(memories) < len(ends):
                memories.append((State.of_row(states[0]) if long else self.state.copy(), made))
        if long:
            self.state = State.of_row(states[0])
        return made, changes, memories

    def _make_standing(self, state: State, count: int) -> Standing:
        """Return the bearing with a memory, and with the verdict on the latest of ``count`` points if any."""
        standing, point = Standing(self.config, self.settings, state), self._latest_point(count)
        if point is not None:
            standing.judge(point.tolist())
        return standing
