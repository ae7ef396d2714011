# SPDX-License-Identifier: Apache-2.0
"""The rule over a recording: its samples in blocks, verdicts as columns.

Each block goes on from the memory that the one before has left, so any cut into blocks gives the
same verdicts, and memory does not grow with the recording. A long one runs compiled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor import jit
from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray, IntArray
from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.assessment import Assessment, assess, at_indices
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.ladder import CONDITIONS, LADDER, Condition
from stickslip_monitor.monitor.level import Unknown, why_unknown
from stickslip_monitor.monitor.rule_settings import RuleSettings, settings_of
from stickslip_monitor.monitor.rule_state import NEVER, STATE_TYPE, State
from stickslip_monitor.monitor.signals import QUANTITIES, Input, Status, Stream
from stickslip_monitor.monitor.verdict import Event, event_of, standing_of
from stickslip_monitor.physics import boundary_table, chances, law_numbers
from stickslip_monitor.physics.cycle.cycles import exact_amplitude

LONG = 30_000
"""Samples from which on it pays to compile; fewer take less than numba's import."""
MANY_CYCLES = 2000
"""Cycles from which on it pays to compile them."""
# Room for changes of the alarm; the loop is left and entered again where they are more.
_CHANGES = 256


@dataclass(frozen=True)
class Scan:
    """The verdicts on a recording of one bearing, or on a part of one.

    Attributes:
        config: The bearing.
        time_ns: Times of the evaluated operating points, shape (n,) [ns].
        until_ns: How long each counts: to the next one or to the loss of an input, (n,) [ns].
        speed: Surface speed of each, shape (n,) [m/s].
        load: Load of each, shape (n,) [N].
        runs: The probability that stick-slip runs after each, shape (n,); 0 without a belief.
        rung: The alarm's rung after each, index into ``LADDER``, shape (n,).
        sticking: Whether stick-slip is predicted after each, shape (n,).
        measured: What the level says at each, index into ``MEASURED``; ``None`` without a level.
        sample: Which sample of the recording made each, shape (n,).
        stretch: How often the clock had jumped before each, shape (n,).
        events: Changes of the alarm, in order.
        at: Which sample of the recording brought each of them.
        now_ns: The monitor's time at each sample of the stream, shape (m,) [ns].
        status: What became of each of them, a :class:`Status`, shape (m,).
        counts: Samples by :class:`Input` and :class:`Status`, shape (3, 7).
        unknown: Why the level says nothing at the end; ``None`` where it does, or there is none.
        settings: What the rule took.
    """

    config: BearingConfig
    time_ns: IntArray
    until_ns: IntArray
    speed: FloatArray
    load: FloatArray
    runs: FloatArray
    rung: NDArray[np.int8]
    sticking: BoolArray
    measured: NDArray[np.int8] | None
    sample: IntArray
    stretch: IntArray
    events: list[Event]
    at: list[int]
    now_ns: IntArray
    status: NDArray[np.int8]
    counts: IntArray
    unknown: Unknown | None
    settings: RuleSettings

    @cached_property
    def assessment(self) -> Assessment:
        """The models' assessments of the points, of arrays of shape (n,)."""
        config, table = self.config, self.settings.boundaries
        found = assess(config.bearing, self.speed, self.load, config.belief, table)
        found.remember_runs(self.runs)
        return found

    @property
    def condition(self) -> list[Condition]:
        """What the alarm says after each point."""
        return [LADDER[rung] for rung in self.rung]

    def point(self, k: int) -> Assessment:
        """The assessment of one point."""
        return at_indices(self.assessment, k)


def scan_bearing(
    config: BearingConfig, stream: Stream, start_ns: int | None, end_ns: int | None
) -> Scan:
    """Evaluate the recording of one bearing, with start and end as in :meth:`Monitor.scan`."""
    return BearingScan(config, start_ns).finish(stream, end_ns)


def lost_inputs(s: Any, c: Any, now: int) -> dict[str, float]:
    """The inputs whose values no longer stand, with their ages [s]; ``inf`` for none so far.

    Args:
        s: The memory.
        c: The settings.
        now: At which time [ns].
    """
    found: dict[str, float] = {}
    if s.began == NEVER:
        return found
    for place, name in enumerate(QUANTITIES):
        came = s.came[place]
        begun = s.began if came == NEVER else came
        if now >= begun + rule.age_limit(s, c, place):
            found[name] = math.inf if came == NEVER else (now - came) / 1e9
    return found


def assessed(
    config: BearingConfig, settings: RuleSettings, speed: float, load: float, runs: float
) -> Assessment:
    """The models' assessment of one operating point.

    Args:
        config: The bearing.
        settings: What the rule takes.
        speed: Surface speed [m/s].
        load: Load [N].
        runs: The probability that stick-slip runs.
    """
    point = assess(config.bearing, speed, load, config.belief, settings.boundaries)
    point.remember_runs(runs)
    return point


def size_cycle(config: BearingConfig, s: Any, many: bool = False) -> None:
    """Work out the amplitude of the exact cycle, into the memory ``s``; compiled if many are."""
    speed, load = rule.median_point(s)
    amplitude = exact_amplitude(config.bearing, float(speed), float(load), many)
    s.amplitude, s.sized = s.amplitude if math.isnan(amplitude) else amplitude, s.now


class _Snapshots(list[Any]):
    """Room for copies of a memory, filled as an array of records is."""

    def __setitem__(self, place: Any, state: Any) -> None:
        super().__setitem__(place, state.copy())


class BearingScan:
    """One bearing over a recording that comes in blocks.

    Args:
        config: The bearing.
        start_ns: When the recording begins: inputs are waited for from then on [ns].
        long: Whether to run compiled; ``None``: where a block is long and numba is there.

    How long a point counts is known with the next one only, so each part ends a point before the
    samples that went in.
    """

    def __init__(
        self, config: BearingConfig, start_ns: int | None, long: bool | None = None
    ) -> None:
        self.config = config
        self.settings = settings_of(config)
        self.state = State()
        self._long = long
        self._taken = self._jumps = self._sized = 0
        self._held: tuple[NDArray[Any], ...] | None = None
        self._last: tuple[float, float] | None = None
        if start_ns is not None:
            rule.pass_time(self.state, self.settings.live, start_ns)

    def take(self, stream: Stream) -> Scan:
        """Take the next samples; what is known of the recording with them comes out."""
        return self._take(stream, None, False)

    def finish(self, stream: Stream, end_ns: int | None) -> Scan:
        """Take the last samples, perhaps none; the rest comes out.

        Args:
            stream: The samples.
            end_ns: When the recording ends: inputs may go stale until then [ns].
        """
        return self._take(stream, end_ns, True)

    def _take(self, stream: Stream, end_ns: int | None, final: bool) -> Scan:
        size = stream.time_ns.size
        notes, points = np.zeros((size, 7), np.int64), np.zeros((size, 3))
        changes = self._run(stream, notes, points)
        made = np.flatnonzero(notes[:, rule.POINT])
        events = [self._event(points, made, row, state) for row, state in changes]
        at = [int(row[rule.SAMPLE]) + self._taken for row, _ in changes]
        if final and end_ns is not None and self.state.now != NEVER:
            events += self._end(max(end_ns, self.state.now), points, made)
            at += [self._taken + size - 1] * (len(events) - len(at))
        rows, status = made, notes[:, rule.STATUS].astype(np.int8)
        jumps = self._jumps + np.cumsum(status == Status.CLOCK_JUMP)
        self._jumps = int(jumps[-1]) if size else self._jumps
        new = (
            notes[rows, rule.NOW],
            notes[rows, rule.UNTIL],
            points[rows, 0],
            points[rows, 1],
            points[rows, 2],
            notes[rows, rule.CONDITION].astype(np.int8),
            notes[rows, rule.STICKING] > 0,
            notes[rows, rule.MEASURED].astype(np.int8),
            rows + self._taken,
            jumps[rows],
        )
        if rows.size:
            self._last = float(points[rows[-1], 0]), float(points[rows[-1], 1])
        if self._held is not None:
            new = tuple(map(np.concatenate, zip(self._held, new, strict=True)))  # type: ignore[assignment]
        out = max(new[0].size - (not final), 0)
        self._held = tuple(column[out:].copy() for column in new)
        self._taken += size
        return self._scan(new, out, end_ns, (events, at), (notes[:, rule.NOW], status), stream)

    def _scan(
        self,
        columns: tuple[NDArray[Any], ...],
        size: int,
        end_ns: int | None,
        told: tuple[list[Event], list[int]],
        noted: tuple[IntArray, NDArray[np.int8]],
        stream: Stream,
    ) -> Scan:
        time, until, speed, load, runs, rung, sticking, measured, sample, stretch = columns
        now, status = noted
        following = np.append(time[1:], time[-1:] if end_ns is None else [end_ns])[: time.size]
        # Where the clock jumps back nobody can tell how long the point counted.
        lasting = np.maximum(time, np.minimum(np.maximum(following, time), until))
        kinds = stream.inputs.astype(np.int64) * len(Status) + status
        counts = np.bincount(kinds, minlength=len(Input) * len(Status))
        has_level = self.config.level is not None
        return Scan(
            self.config,
            time[:size],
            lasting[:size],
            speed[:size],
            load[:size],
            runs[:size],
            rung[:size],
            sticking[:size],
            measured[:size] if has_level else None,
            sample[:size],
            stretch[:size],
            *told,
            now,
            status,
            counts.reshape(len(Input), len(Status)),
            why_unknown(self.state, self.settings.live) if has_level else None,
            self.settings,
        )

    def _run(
        self, stream: Stream, notes: IntArray, points: FloatArray
    ) -> list[tuple[IntArray, State]]:
        """Run the rule over a block; the changes of the alarm, with the memory at each."""
        settings = self.settings
        long = self._long
        if long is None:
            long = stream.time_ns.size >= LONG and jit.has_compiler()
        loop: Any = _compiled() if long else rule.run
        columns = (stream.inputs, stream.time_ns, stream.value)
        if long:
            law: Any
            table: Any
            belief: Any
            states, c = self.state.row(), settings.row
            law, table, belief = (
                np.array(settings.law),
                settings.boundaries.pieces,
                settings.chances,
            )
        else:
            states, c = [self.state], [settings.live]
            law, table, belief = settings.law, settings.table, settings.belief
            columns = tuple(column.tolist() for column in columns)
        changes, begin, size = [], 0, stream.time_ns.size
        while begin < size:
            rows = np.zeros((_CHANGES, 5), np.int64)
            kept: Any = np.zeros(_CHANGES, STATE_TYPE) if long else _Snapshots([None] * _CHANGES)
            begin, count = loop(
                states, c, law, table, belief, columns, begin, notes, points, rows, kept
            )
            state = states.view(np.recarray)[0] if long else self.state
            if rule.amplitude_due(state, settings.live):
                self._sized += 1
                size_cycle(self.config, state, long and self._sized > MANY_CYCLES)
            for k in range(count):
                changes.append((rows[k], State.of_row(kept[k]) if long else kept[k]))
        if long:
            self.state = State.of_row(states[0])
        return changes

    def _event(self, points: FloatArray, made: IndexArray, row: IntArray, state: State) -> Event:
        """A change of the alarm as an event; of a loss, before the sample that showed it."""
        lost = int(row[rule.AFTER]) == len(LADDER)
        last = int(np.searchsorted(made, row[rule.SAMPLE], 'left' if lost else 'right')) - 1
        return self._told(row, state, points[made[last]] if last >= 0 else self._last)

    def _told(self, row: Any, state: State, at: Any) -> Event:
        c = self.settings.live
        point = None
        if at is not None:
            point = assessed(self.config, self.settings, float(at[0]), float(at[1]), state.runs)
        change = CONDITIONS[int(row[rule.BEFORE])], CONDITIONS[int(row[rule.AFTER])]
        time_ns, onset = int(row[rule.TIME]), bool(row[rule.ONSET])
        lost = lost_inputs(state, c, time_ns) if state.lost else {}
        standing = standing_of(state, c)
        return event_of(self.config, time_ns, change, point, standing, lost, onset)

    def _end(self, end_ns: int, points: FloatArray, made: IndexArray) -> list[Event]:
        """Let time pass to the end of the recording."""
        state = self.state
        before, lost = rule.condition(state), state.lost
        rule.pass_time(state, self.settings.live, end_ns)
        if state.lost == lost:
            return []
        row = [0, state.lost_since, before, rule.condition(state), 0]
        return [self._told(row, state, points[made[-1]] if made.size else self._last)]


def _compiled() -> Any:
    return jit.compiled('run', rule, boundary_table, chances, law_numbers, inline=False)
