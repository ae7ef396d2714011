# SPDX-License-Identifier: Apache-2.0
"""The curves of a bifurcation diagram: limit cycles over speed, ended exactly where they end.

At one speed the averaged model has any number of cycles. Going up in speed their number changes
only where one grows out of, or dies in, the equilibrium (Hopf) or where two meet (fold). The
number is counted on a grid of speeds, its changes are located by bisection, and between two
changes the k-th smallest cycle is one curve. No number of cycles or changes is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.map_curves import Range
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.physics.averaging.boundaries import (
    fold_speed,
    growth_rate,
    hopf_speed,
    stationary_amplitudes,
)
from stickslip_monitor.physics.oscillator import Bearing

Cycle = tuple[float, bool]
"""Displacement amplitude [m] and stability of one cycle."""

_BISECTIONS = 40
_ROUNDS = 6
_NEAR_AN_END = 0.5 ** np.arange(1, 13)
_SAME = 1e-9
_LOW = 1e-3


class MarkKind(str, Enum):
    """What happens at the end of a branch."""

    HOPF = 'hopf'
    FOLD = 'fold'


@dataclass(frozen=True, slots=True)
class BranchMark:
    """A bifurcation: where a branch ends.

    Attributes:
        kind: Hopf (the cycle meets the equilibrium) or fold (it meets another cycle).
        speed: Surface speed [m/s].
        amplitude: Displacement amplitude [m]; 0 at a Hopf.
    """

    kind: MarkKind
    speed: float
    amplitude: float


@dataclass(frozen=True, slots=True)
class Branch:
    """One family of limit cycles.

    Attributes:
        stable: Whether its cycles attract; an unstable one is the threshold between two states.
        amplitude: Displacement amplitude at each speed of the diagram, ``nan`` beyond its ends,
            shape (n,) [m].
    """

    stable: bool
    amplitude: FloatArray


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of speed in one regime [m/s]."""

    low: float
    high: float
    regime: Regime


@dataclass(frozen=True, slots=True)
class Diagram:
    """The bifurcation diagram of a bearing over speed, at one load.

    Attributes:
        load: Load [N].
        speed: Surface speeds, rising, with every mark among them, shape (n,) [m/s].
        sliding_limit: Displacement amplitude at which ``a = V``, shape (n,) [m].
        growth_rate: Growth rate of a small disturbance of the equilibrium, shape (n,) [1/s].
        branches: All limit cycles; stable first, larger first.
        marks: Hopf and fold points, by speed.
        spans: The regimes, by speed.
    """

    load: float
    speed: FloatArray
    sliding_limit: FloatArray
    growth_rate: FloatArray
    branches: tuple[Branch, ...]
    marks: tuple[BranchMark, ...]
    spans: tuple[Span, ...]


@dataclass(frozen=True, slots=True)
class _Change:
    """The cycles just below and just above a speed at which their number changes."""

    speed: float
    before: tuple[Cycle, ...]
    after: tuple[Cycle, ...]


def bifurcation_diagram(
    bearing: Bearing, load: float, speeds: Range, points: int = 400
) -> Diagram:
    """Follow every limit cycle of the averaged model over a range of speeds.

    Args:
        bearing: The bearing.
        load: Load ``N`` > 0 [N].
        speeds: Lowest and highest surface speed, 0 <= low < high [m/s].
        points: Number of evenly spaced speeds; the ends of branches come on top.

    Returns:
        The diagram.
    """
    coarse = _grid(bearing, speeds, points)
    changes = _changes(bearing, load, coarse)
    ends = np.array([change.speed for change in changes])
    fine = _refined(coarse, ends)
    cycles = _cycles(bearing, load, fine)
    speed = np.union1d(fine, ends)
    branches, marks = _Tracer(bearing, speed).trace(fine, cycles, changes)
    return Diagram(
        load=load,
        speed=speed,
        sliding_limit=speed / bearing.natural_frequency,
        growth_rate=np.asarray(growth_rate(bearing, speed, load)),
        branches=branches,
        marks=marks,
        spans=_spans(bearing, load, (speeds[0], *ends.tolist(), speeds[1])),
    )


def _grid(bearing: Bearing, speeds: Range, points: int) -> FloatArray:
    """Even speeds and the law's break points, all above rest: at rest nothing slides."""
    low, high = speeds
    grid = np.linspace(low, high, points)
    if low == 0.0:
        grid[0] = _LOW * grid[1]
    breaks = np.array([v for v in bearing.friction.breakpoints if grid[0] < v < high])
    return np.union1d(grid, breaks)


def _cycles(bearing: Bearing, load: float, speed: FloatArray) -> list[tuple[Cycle, ...]]:
    found = stationary_amplitudes(bearing, speed, load)
    return [
        tuple((a, s) for a, s in zip(row, stable, strict=True) if a == a)
        for row, stable in zip(found.amplitude.tolist(), found.stable.tolist(), strict=True)
    ]


def _pattern(cycles: Sequence[Cycle]) -> tuple[bool, ...]:
    return tuple(stable for _, stable in cycles)


def _changes(bearing: Bearing, load: float, grid: FloatArray) -> list[_Change]:
    """Where the number of cycles changes, to rounding, by speed."""
    cycles = _cycles(bearing, load, grid)
    open_ = [
        (grid[i], grid[i + 1], cycles[i], cycles[i + 1])
        for i in range(grid.size - 1)
        if _pattern(cycles[i]) != _pattern(cycles[i + 1])
    ]
    known = (fold_speed(bearing, load), hopf_speed(bearing, load)) if open_ else ()
    found: list[_Change] = []
    for _ in range(_ROUNDS):
        if not open_:
            break
        left, right = _bisected(bearing, load, open_)
        before, after = _cycles(bearing, load, left), _cycles(bearing, load, right)
        found += [
            _Change(_snapped(known, 0.5 * (a + b)), below, above)
            for a, b, below, above in zip(left, right, before, after, strict=True)
        ]
        # Another change may hide between the one just found and the next point of the grid.
        open_ = [
            (right[k], old[1], after[k], old[3])
            for k, old in enumerate(open_)
            if _pattern(after[k]) != _pattern(old[3])
        ]
    return sorted(found, key=lambda change: change.speed)


def _bisected(
    bearing: Bearing,
    load: float,
    intervals: Sequence[tuple[float, float, tuple[Cycle, ...], tuple[Cycle, ...]]],
) -> tuple[FloatArray, FloatArray]:
    """Shrink each interval onto the first speed where the cycles of its left end are no more."""
    left = np.array([interval[0] for interval in intervals])
    right = np.array([interval[1] for interval in intervals])
    patterns = [_pattern(interval[2]) for interval in intervals]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (left + right)
        here = _cycles(bearing, load, middle)
        same = np.array([_pattern(c) == p for c, p in zip(here, patterns, strict=True)])
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    return left, right


def _snapped(known: Sequence[float], speed: float) -> float:
    """The package's own Hopf or fold speed where bisection has found the same to rounding."""
    for boundary in known:
        if abs(speed - boundary) < _SAME * speed:
            return float(boundary)
    return float(speed)


def _refined(grid: FloatArray, ends: FloatArray) -> FloatArray:
    """The grid without points on an end, with more points close to each, where branches bend."""
    if not ends.size:
        return grid
    step = float(np.max(np.diff(grid)))
    near = np.concatenate([ends[:, None] + sign * step * _NEAR_AN_END for sign in (-1.0, 1.0)])
    inside = near[(near > grid[0]) & (near < grid[-1])]
    speeds = np.union1d(grid, inside)
    distance = np.min(np.abs(speeds[:, None] - ends), axis=1)
    return speeds[distance > _SAME * speeds]


def _links(before: Sequence[Cycle], after: Sequence[Cycle]) -> list[tuple[int, int]]:
    """The cycles that go on through a change: as many as can, in order, by least difference."""
    for count in range(min(len(before), len(after)), 0, -1):
        fits = [
            (sum(abs(before[i][0] - after[j][0]) for i, j in zip(a, b, strict=True)), a, b)
            for a in combinations(range(len(before)), count)
            for b in combinations(range(len(after)), count)
            if all(before[i][1] == after[j][1] for i, j in zip(a, b, strict=True))
        ]
        if fits:
            _, a, b = min(fits)
            return list(zip(a, b, strict=True))
    return []


class _Tracer:
    """Carries the open branches from change to change."""

    def __init__(self, bearing: Bearing, speed: FloatArray) -> None:
        self.bearing, self.speed = bearing, speed
        self.curves: list[tuple[bool, FloatArray]] = []
        self.marks: list[BranchMark] = []

    def trace(
        self,
        fine: FloatArray,
        cycles: Sequence[tuple[Cycle, ...]],
        changes: Sequence[_Change],
    ) -> tuple[tuple[Branch, ...], tuple[BranchMark, ...]]:
        """Walk up in speed; return branches and marks."""
        panel = np.searchsorted([change.speed for change in changes], fine)
        first = changes[0].before if changes else cycles[0]
        active = [self._begin(stable) for _, stable in first]
        for k in range(len(changes) + 1):
            for i in np.flatnonzero(panel == k).tolist():
                self._follow(active, fine[i], cycles[i])
            if k < len(changes):
                active = self._pass(active, changes[k])
        branches = [Branch(stable, amplitude) for stable, amplitude in self.curves]
        branches.sort(key=lambda b: (not b.stable, -float(np.nanmax(b.amplitude, initial=0.0))))
        return tuple(branches), tuple(self.marks)

    def _begin(self, stable: bool) -> int:
        self.curves.append((stable, np.full(self.speed.shape, np.nan)))
        return len(self.curves) - 1

    def _set(self, curve: int, speed: float, amplitude: float) -> None:
        self.curves[curve][1][np.searchsorted(self.speed, speed)] = amplitude

    def _follow(self, active: Sequence[int], speed: float, cycles: Sequence[Cycle]) -> None:
        if _pattern(cycles) == tuple(self.curves[curve][0] for curve in active):
            for curve, (amplitude, _) in zip(active, cycles, strict=True):
                self._set(curve, speed, amplitude)

    def _pass(self, active: list[int], change: _Change) -> list[int]:
        links = dict(_links(change.before, change.after))
        ending = [i for i in range(len(change.before)) if i not in links]
        starting = [j for j in range(len(change.after)) if j not in links.values()]
        following = {j: active[i] for i, j in links.items()}
        following |= {j: self._begin(change.after[j][1]) for j in starting}
        for i, j in links.items():
            middle = 0.5 * (change.before[i][0] + change.after[j][0])
            self._set(active[i], change.speed, middle)
        self._end([(active[i], i, change.before[i][0]) for i in ending], change.speed)
        self._end([(following[j], j, change.after[j][0]) for j in starting], change.speed)
        return [following[j] for j in range(len(change.after))]

    def _end(self, ends: list[tuple[int, int, float]], speed: float) -> None:
        """End (or begin) curves: the smallest in the equilibrium, the others two by two."""
        if len(ends) % 2 == 1:
            curve, place, amplitude = ends.pop(0)
            self._set(curve, speed, 0.0 if place == 0 else amplitude)
            if place == 0:
                self.marks.append(BranchMark(MarkKind.HOPF, speed, 0.0))
        for (one, _, low), (other, _, high) in zip(ends[::2], ends[1::2], strict=True):
            amplitude = self._meeting(speed, 0.5 * (low + high))
            self._set(one, speed, amplitude)
            self._set(other, speed, amplitude)
            self.marks.append(BranchMark(MarkKind.FOLD, speed, amplitude))

    def _meeting(self, speed: float, amplitude: float) -> float:
        limit = speed / self.bearing.natural_frequency
        return limit if abs(amplitude - limit) < 1e-5 * limit else amplitude


def _spans(bearing: Bearing, load: float, edges: Sequence[float]) -> tuple[Span, ...]:
    middles = 0.5 * (np.array(edges[:-1]) + edges[1:])
    names = assess(bearing, middles, load).regime
    spans: list[Span] = []
    for low, high, name in zip(edges, edges[1:], names, strict=False):
        regime = Regime(name)
        if spans and spans[-1].regime is regime:
            low = spans.pop().low
        spans.append(Span(low, high, regime))
    return tuple(spans)


def diagram_columns(bearing: Bearing, diagram: Diagram) -> dict[str, Sequence[object]]:
    """The diagram as the columns of a table, by heading, SI units but for the shaft speed."""
    rpm = bearing.speed.from_surface(diagram.speed, 'rpm')
    columns: dict[str, Sequence[object]] = {
        'shaft_speed [rpm]': rpm.tolist(),
        'surface_speed [m/s]': diagram.speed.tolist(),
        'load [N]': [diagram.load] * diagram.speed.size,
        'regime': assess(bearing, diagram.speed, diagram.load).regime.tolist(),
        'growth_rate [1/s]': diagram.growth_rate.tolist(),
        'sliding_limit [m]': diagram.sliding_limit.tolist(),
    }
    for stable, name in ((True, 'stick_slip_amplitude'), (False, 'threshold_amplitude')):
        own = [branch for branch in diagram.branches if branch.stable is stable]
        for k, branch in enumerate(own):
            heading = f'{name}{f"_{k + 1}" if k else ""} [m]'
            columns[heading] = branch.amplitude.tolist()
        if not own:
            columns[f'{name} [m]'] = [float('nan')] * diagram.speed.size
    return columns
