# SPDX-License-Identifier: Apache-2.0
"""The bifurcation diagram: vibration amplitude over shaft speed, at one load.

The cycles of the averaged model are known at each speed. Where their number changes by one, a
cycle begins in the equilibrium (Hopf), where it changes by two, two of them meet (fold); between
these speeds the order of the amplitudes joins them to branches. No number of branches is assumed.
The exact cycle, of which there is one stable and one unstable, stands beside.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing import canvas
from stickslip_monitor.drawing.map import Range, corners, diagram_speeds, water_note
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.physics.averaging import (
    count_cycles,
    fold_speed,
    growth_rate,
    hopf_speed,
    stationary_amplitudes,
)
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import end_of_vibration, exact_amplitude, exact_fold_speed

# Share of a speed within which two turns, or a turn and a boundary, are one [-].
_SAME = 1e-9


class BranchMark(NamedTuple):
    """End of a branch: at a Hopf it meets the equilibrium, at a fold another cycle."""

    kind: str  # 'Hopf' or 'fold'
    speed: float  # of the surface [m/s]
    amplitude: float  # of the displacement, 0 at a Hopf [m]


@dataclass(frozen=True, slots=True)
class Branch:
    """One family of limit cycles; an unstable one is the threshold between two states."""

    stable: bool
    amplitude: FloatArray  # of the displacement, ``nan`` beyond the branch's ends, shape (n,) [m]


@dataclass(frozen=True, slots=True)
class Diagram:
    """The bifurcation diagram of a bearing over speed, at one load."""

    load: float  # [N]
    speed: FloatArray  # of the surface, rising, with every mark among them, shape (n,) [m/s]
    sliding_limit: FloatArray  # displacement amplitude at which ``a = V``, shape (n,) [m]
    growth_rate: FloatArray  # of a small disturbance of the equilibrium, shape (n,) [1/s]
    branches: tuple[Branch, ...]  # all cycles of the averaged model; stable first, larger first
    marks: tuple[BranchMark, ...]  # its Hopf and fold points, by speed
    spans: tuple[tuple[float, float, Regime], ...]  # from [m/s], to [m/s], regime
    exact: FloatArray  # amplitude of the exact cycle, ``nan`` for none, shape (n,) [m]
    exact_fold: float  # speed beyond which it does not stick [m/s]; ``inf`` where it never ends


def bifurcation_diagram(bearing: Bearing, load: float, speeds: Range, points: int = 400) -> Diagram:
    """Compute every limit cycle of the averaged model at a load > 0 [N], and the exact one.

    Args:
        bearing: The bearing.
        load: The load.
        speeds: Lowest and highest surface speed, 0 <= low < high [m/s]. A lowest of 0 is replaced by
            a thousandth of the next one, because nothing slides at rest.
        points: Number of even speeds, to which those where branches end are added.
    """
    grid = np.linspace(*speeds, points)
    if speeds[0] == 0.0:
        grid[0] = 1e-3 * grid[1]
    exact_fold = float(exact_fold_speed(bearing, load))
    # The exact branch is drawn up to its end.
    last = [exact_fold * (1.0 - _SAME)] if grid[0] < exact_fold < grid[-1] else []
    end = [v for v in [float(end_of_vibration(bearing, load))] if grid[0] < v < grid[-1]]
    grid = np.union1d(grid, last)
    # At both sides of the law's break points the balance may jump.
    columns = np.linspace(grid[0], grid[-1], 400) if points < 400 else grid
    between = columns, corners(bearing, (grid[0], grid[-1]), load)
    scan = np.union1d(grid, np.concatenate(between))
    cycles = _find_amplitudes(bearing, scan, load)
    turns = _find_turns(bearing, load, scan, cycles)
    marks = [turn.mark for turn in turns]
    ends = [mark.speed for mark in marks]
    speed = np.union1d(grid, ends)
    # A mark is not among the scanned speeds: the turn has its amplitudes.
    rows = np.minimum(np.searchsorted(scan, speed), scan.size - 1)
    return Diagram(
        load=load,
        speed=speed,
        sliding_limit=speed / bearing.natural_frequency,
        growth_rate=np.asarray(growth_rate(bearing, speed, load)),
        branches=tuple(_join_branches(speed, turns, cycles[rows])),
        marks=tuple(marks),
        spans=_find_spans(bearing, load, sorted({speeds[0], *ends, *last, *end, speeds[1]})),
        exact=np.asarray(exact_amplitude(bearing, speed, load)),
        exact_fold=exact_fold,
    )


class _Turn(NamedTuple):
    """A speed at which cycles appear or vanish."""

    mark: BranchMark
    before: FloatArray  # amplitudes just below it, rising [m]
    after: FloatArray  # those just above it
    changed: slice  # which of those on the side that has more of them appear or vanish


def _find_amplitudes(bearing: Bearing, speed: FloatArray, load: float) -> FloatArray:
    """Return the averaged amplitudes of all cycles at speeds, rising, ``nan`` for none, shape (n, k) [m]."""
    return stationary_amplitudes(bearing, speed, load).amplitude


def _find_turns(bearing: Bearing, load: float, speeds: FloatArray, amplitude: FloatArray) -> list[_Turn]:
    """Locate each change in the number of cycles to rounding, and return them by speed.

    Changes that are one within :data:`_SAME` are joined; those that cancel are dropped.

    Args:
        bearing: The bearing.
        load: The load [N].
        speeds: Ascending surface speeds [m/s], shape (n,).
        amplitude: Amplitudes at them, ``nan`` for none, shape (n, k) [m].
    """
    counts = np.isfinite(amplitude).sum(axis=1)
    ends, cycles = (np.stack([c[:-1], c[1:]]) for c in (speeds, counts))
    while np.any(ends[1] - ends[0] > 1e-14 * ends[1]):
        changes = cycles[0] != cycles[1]
        low, high = ends[:, changes]
        parts = np.linspace(low, high, 9)
        inside = count_cycles(bearing, parts[1:-1], load)
        counts = np.concatenate([cycles[:1, changes], inside, cycles[1:, changes]])
        ends, cycles = (np.stack([c[:-1].ravel(), c[1:].ravel()]) for c in (parts, counts))
    ends = ends[:, cycles[0] != cycles[1]]
    ends = ends[:, np.argsort(ends[0])]
    # Those so close to one another are one, at which the number flickers by rounding.
    apart = np.flatnonzero(np.diff(ends[0]) > _SAME * ends[0, 1:]) + 1
    groups = np.split(ends, apart, axis=1) if ends.size else []
    boundaries = float(fold_speed(bearing, load)), float(hopf_speed(bearing, load))
    turns = [
        _classify_turn(bearing, load, boundaries, float(group[0, 0]), float(group[1, -1])) for group in groups
    ]
    return [turn for turn in turns if turn.before.size != turn.after.size]


def _classify_turn(bearing: Bearing, load: float, boundaries: Range, low: float, high: float) -> _Turn:
    """Return the Hopf or the fold between two neighbouring speeds ``low`` and ``high`` [m/s].

    It is a Hopf if the number of cycles changes by an odd number, else a fold. Its speed is ``high``;
    ``boundaries`` are the fold and the Hopf speed [m/s], which replace a speed that agrees with them.
    """
    rows = _find_amplitudes(bearing, np.array([low, high]), load)
    before, after = (row[np.isfinite(row)] for row in rows)
    speed = next((v for v in boundaries if math.isclose(v, high, rel_tol=_SAME)), high)
    more, change = max(before, after, key=len), abs(before.size - after.size)
    if change % 2:
        return _Turn(BranchMark('Hopf', speed, 0.0), before, after, slice(0, change))
    first = int(np.argmin(np.diff(more)))
    changed = slice(first, first + change)
    amplitude, limit = float(np.mean(more[changed])), speed / bearing.natural_frequency
    # Most folds are at the sliding limit, where the work of friction has a cusp.
    amplitude = limit if math.isclose(amplitude, limit, rel_tol=1e-6) else amplitude
    return _Turn(BranchMark('fold', speed, amplitude), before, after, changed)


def _join_branches(speed: FloatArray, turns: Sequence[_Turn], cycles: FloatArray) -> list[Branch]:
    """Join the cycles at rising speeds to branches, from turn to turn by the order of their amplitudes.

    Args:
        speed: Rising, with the speed of every turn among them, shape (n,) [m/s].
        turns: The turns, by speed.
        cycles: Amplitudes at each speed, rising, ``nan`` for none, shape (n, k) [m]; not used at turns.

    Returns:
        The branches: stable ones first, of these the larger first.
    """
    max_count = max((max(turn.before.size, turn.after.size) for turn in turns), default=0)
    # A stretch with more may be too short for a speed.
    missing = max(max_count - cycles.shape[1], 0)
    cycles = np.pad(cycles, ((0, 0), (0, missing)), constant_values=np.nan)
    branches: list[Branch] = []

    def begin_branches(count: int, rows: slice) -> list[Branch]:
        """Return empty branches for the ``rows`` of ``count`` cycles, and add them to ``branches``.

        Every other one from the largest down is stable.
        """
        stable = [(count - k) % 2 == 1 for k in range(count)[rows]]
        new = [Branch(is_stable, np.full(speed.size, np.nan)) for is_stable in stable]
        branches.extend(new)
        return new

    first = turns[0].before.size if turns else int(np.isfinite(cycles[0]).sum())
    running, row = begin_branches(first, slice(None)), 0
    for turn in turns:
        at, changed = int(np.searchsorted(speed, turn.mark.speed)), turn.changed
        for k, branch in enumerate(running):
            branch.amplitude[row:at], branch.amplitude[at] = cycles[row:at, k], turn.before[k]
        if turn.before.size < turn.after.size:
            running[changed.start : changed.start] = begin_branches(turn.after.size, changed)
        for branch in running[changed]:
            branch.amplitude[at] = turn.mark.amplitude
        if turn.before.size > turn.after.size:
            del running[changed]
        row = at + 1
    for k, branch in enumerate(running):
        branch.amplitude[row:] = cycles[row:, k]
    return sorted(branches, key=lambda b: (not b.stable, -float(np.nanmax(b.amplitude, initial=0.0))))


def _find_spans(
    bearing: Bearing, load: float, edges: Sequence[float]
) -> tuple[tuple[float, float, Regime], ...]:
    """Return low and high speed [m/s] and regime between ascending edges; equal neighbours are joined."""
    middles = 0.5 * (np.array(edges[:-1]) + edges[1:])
    spans: list[tuple[float, float, Regime]] = []
    for (low, high), name in zip(pairwise(edges), assess(bearing, middles, load).regime, strict=True):
        if spans and spans[-1][2] is Regime(name):
            low = spans.pop()[0]
        spans.append((low, high, Regime(name)))
    return tuple(spans)


def diagram_columns(bearing: Bearing, diagram: Diagram) -> dict[str, NDArray[Any]]:
    """Return the diagram as the columns of a table, by heading with the unit, each of shape (n,)."""
    columns: dict[str, NDArray[Any]] = {
        'shaft_speed [rpm]': bearing.speed.from_surface(diagram.speed, 'rpm'),
        'surface_speed [m/s]': diagram.speed,
        'load [N]': np.full(diagram.speed.size, diagram.load),
        'regime': assess(bearing, diagram.speed, diagram.load).regime,
        'growth_rate [1/s]': diagram.growth_rate,
        'sliding_limit [m]': diagram.sliding_limit,
    }
    for stable, name in ((True, 'stick_slip_amplitude'), (False, 'threshold_amplitude')):
        amplitudes = [branch.amplitude for branch in diagram.branches if branch.stable is stable]
        for k, amplitude in enumerate(amplitudes or [np.full(diagram.speed.size, np.nan)]):
            columns[f'{name}{f"_{k + 1}" if k else ""} [m]'] = amplitude
    columns['exact_amplitude [m]'] = diagram.exact
    return columns


def draw_diagram(
    config: BearingConfig, load: float, speeds: Range | None = None, points: int = 400
) -> canvas.Figure:
    """Draw the bifurcation diagram of a bearing at a load > 0 [N].

    ``speeds`` are the lowest and highest surface speed [m/s], by default chosen to show Hopf and fold;
    ``points`` the number of even speeds.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with canvas.style():
        bearing, rpm = config.bearing, config.bearing.speed.factor('rpm')
        speeds = speeds or diagram_speeds(bearing, load)
        diagram = bifurcation_diagram(bearing, load, speeds, points)
        figure, axes = canvas.new_panel(
            'shaft speed [rpm]',
            'displacement amplitude [mm]',
            box=(0.095, 0.245, 0.88, 0.635),
            footnote=f'{config.name}, load {load / 1e3:.6g} kN{water_note(bearing)}',
        )
        curves = [diagram.exact, *(branch.amplitude for branch in diagram.branches)]
        top = max(float(np.nanmax(curve, initial=0.0)) for curve in curves) or diagram.sliding_limit[-1]
        axes.set_xlim(speeds[0] / rpm, speeds[1] / rpm)
        axes.set_ylim(-0.07 * top * 1e3, 1.2 * top * 1e3)
        both_ways = (lambda x: np.multiply(x, rpm), lambda x: np.divide(x, rpm))
        axes.secondary_xaxis('top', functions=both_ways).set_xlabel('surface speed [m/s]', labelpad=6.0)
        _draw_curves(axes, diagram, rpm, 1.1 * top)
        canvas.draw_regime_bands(
            axes, [(low / rpm, high / rpm, regime) for low, high, regime in diagram.spans]
        )
        _draw_marks(axes, diagram, rpm)
        if not diagram.branches and not np.isfinite(diagram.exact).any():
            why = textwrap.fill(assess(bearing, 0.5 * sum(speeds), load).outcome.sentence, 46)
            axes.text(0.04, 0.85, why, transform=axes.transAxes, va='top', linespacing=1.5)
        canvas.legend_below(figure, 3)
        return figure


def _draw_curves(axes: canvas.Axes, diagram: Diagram, rpm: float, highest: float) -> None:
    """Draw the exact cycle wide, that of averaging narrow, steady sliding along zero, in rpm and mm.

    ``rpm`` is the surface speed of one rpm [m/s], ``highest`` the amplitude up to which the sliding limit
    is drawn [m].
    """
    named: set[str] = set()

    def line(label: str, speed: ArrayLike, amplitude: ArrayLike, colour: str, **look: Any) -> None:
        """Draw amplitudes [m] over speeds [m/s]; a label is in the legend once."""
        x, y = np.divide(speed, rpm), np.multiply(amplitude, 1e3)
        axes.plot(x, y, color=colour, label='_' if label in named else label, **look)
        named.add(label)

    v, limit = diagram.speed, diagram.sliding_limit
    if np.isfinite(diagram.exact).any():
        line('stick-slip, exact', v, diagram.exact, canvas.REGIME_COLOUR[Regime.UNSTABLE], lw=3.4, zorder=4)
    for branch in diagram.branches:
        if branch.stable:
            line('stick-slip, averaging', v, branch.amplitude, canvas.INK, lw=1.3, zorder=5)
        else:
            look: canvas.Look = {'ls': canvas.DASHES, 'lw': 1.6, 'zorder': 5}
            line('threshold (unstable), averaging', v, branch.amplitude, canvas.INK, **look)
    hopf = [mark.speed for mark in diagram.marks if mark.kind == 'Hopf']
    for ends in pairwise([v[0], *hopf, v[-1]]):
        growing = np.interp(0.5 * sum(ends), v, diagram.growth_rate) > 0.0
        name, dashes = ('steady sliding, unstable', canvas.DASHES) if growing else ('steady sliding', '-')
        line(name, ends, (0.0, 0.0), canvas.REGIME_COLOUR[Regime.STABLE], ls=dashes, lw=2.4, zorder=3)
    shown = np.where(limit < highest, limit, np.nan)
    line('sliding limit a = V', v, shown, canvas.MUTED, lw=1.0, ls=':', zorder=2)


def _draw_marks(axes: canvas.Axes, diagram: Diagram, rpm: float) -> None:
    """Mark the bifurcations; the legend says at which speeds they are.

    ``rpm`` is the surface speed of one rpm [m/s]. Without a fold of averaging the end of sticking is marked.
    """
    end = diagram.exact_fold
    for kind, edge, fill, shape in (
        ('Hopf', canvas.HOPF, canvas.PAPER, 'o'),
        ('fold', canvas.FOLD, canvas.FOLD, 'D'),
    ):
        marks = [mark for mark in diagram.marks if mark.kind == kind]
        text = f'{kind} {", ".join(f"{mark.speed / rpm:.4g}" for mark in marks)} rpm'
        if kind == 'fold' and marks:
            text = f'KBM {text}, sticks up to {end / rpm:.4g} rpm'
        elif kind == 'fold' and diagram.speed[0] < end < diagram.speed[-1]:
            # Where averaging has none, the end of the exact branch stands in.
            marks = [BranchMark(kind, end, float(diagram.exact[np.isfinite(diagram.exact)][-1]))]
            text = f'end of sticking {end / rpm:.4g} rpm (averaging has no fold)'
        if marks:
            at = [mark.speed / rpm for mark in marks], [mark.amplitude * 1e3 for mark in marks]
            look: canvas.Look = {'ms': 7.5, 'mec': edge, 'mew': 1.4, 'mfc': fill, 'zorder': 6}
            axes.plot(*at, shape, clip_on=False, label=text, **look)
