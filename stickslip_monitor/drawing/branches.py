# SPDX-License-Identifier: Apache-2.0
"""The curves of a bifurcation diagram: limit cycles over speed, ended exactly where they end.

At a load the cycles of the averaged model are the level set of its balance over speed and
amplitude, ``2 S(a; V)/a = c/N``. The level set is contoured, cut where a branch turns back (fold)
or begins in the equilibrium (Hopf), and brought to rounding by Newton steps. No number of
branches is assumed. The exact cycle, of which there is one stable and one unstable, stands beside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.drawing.map_curves import Range
from stickslip_monitor.errors import DrawingError
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.physics.averaging.boundaries import (
    fold_speed,
    growth_rate,
    harmonic,
    hopf_speed,
)
from stickslip_monitor.physics.cycle.cycles import exact_cycle, exact_fold_speed
from stickslip_monitor.physics.oscillator import Bearing

_LOW = 1e-3
_SAME = 1e-9
_BESIDE = (1.0 - 1e-9, 1.0, 1.0 + 1e-9)
_BISECTIONS = 60
_NEWTON_STEPS = 8
_SETTLED = 1e-9
_ROUNDS, _NARROWER = 5, 6.0
_STEP = 1e-6
# Amplitudes as t with a = V (1 + t |t|): -1 at rest, 0 at the sliding limit, where the balance
# has a cusp in a and none in t. Beyond 31 V no law has a cycle: friction brakes on both ways.
_AT_REST, _AT_LIMIT = -1.0, 0.0
_MOST_COLUMNS = 150
_ROWS = np.concatenate(
    [np.linspace(_AT_REST, -0.02, 50), [_AT_LIMIT], np.geomspace(2e-4, 5.5, 60)]
)


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
        branches: All limit cycles of the averaged model; stable first, larger first.
        marks: Its Hopf and fold points, by speed.
        spans: The regimes, by speed.
        exact: Amplitude of the exact stick-slip cycle, ``nan`` for none, shape (n,) [m].
        exact_fold: Speed beyond which there is none [m/s]; ``inf`` where it never ends.
    """

    load: float
    speed: FloatArray
    sliding_limit: FloatArray
    growth_rate: FloatArray
    branches: tuple[Branch, ...]
    marks: tuple[BranchMark, ...]
    spans: tuple[Span, ...]
    exact: FloatArray
    exact_fold: float


def bifurcation_diagram(
    bearing: Bearing, load: float, speeds: Range, points: int = 400
) -> Diagram:
    """Every limit cycle of the averaged model over a range of speeds, and the exact one.

    Args:
        bearing: The bearing.
        load: Load ``N`` > 0 [N].
        speeds: Lowest and highest surface speed, 0 <= low < high [m/s].
        points: Number of evenly spaced speeds; the ends of branches come on top.

    Returns:
        The diagram.
    """
    grid = _grid(bearing, speeds, points)
    columns = np.union1d(_grid(bearing, speeds, min(points, _MOST_COLUMNS)), grid[:1])
    contour = _Contour(bearing, load, columns)
    pieces = [piece for line in contour.lines() for piece in contour.pieces(line)]
    marks = sorted({mark for piece in pieces for mark in piece.ends if mark}, key=_by_speed)
    ends = [mark.speed for mark in marks]
    exact_fold = float(exact_fold_speed(bearing, load))
    # The exact branch is drawn up to its end.
    last = [exact_fold * (1.0 - _SAME)] if grid[0] < exact_fold < grid[-1] else []
    speed = np.union1d(grid, [*ends, *last])
    branches = [contour.branch(piece, speed) for piece in pieces]
    branches.sort(key=lambda b: (not b.stable, -float(np.nanmax(b.amplitude, initial=0.0))))
    return Diagram(
        load=load,
        speed=speed,
        sliding_limit=speed / bearing.natural_frequency,
        growth_rate=np.asarray(growth_rate(bearing, speed, load)),
        branches=tuple(branches),
        marks=tuple(marks),
        spans=_spans(bearing, load, sorted({speeds[0], *ends, speeds[1]})),
        exact=np.asarray(exact_cycle(bearing, speed, load).amplitude),
        exact_fold=exact_fold,
    )


def _by_speed(mark: BranchMark) -> tuple[float, float]:
    return mark.speed, mark.amplitude


def _grid(bearing: Bearing, speeds: Range, points: int) -> FloatArray:
    """Even speeds and the law's break points, all above rest: at rest nothing slides."""
    low, high = speeds
    grid = np.linspace(low, high, points)
    if low == 0.0:
        grid[0] = _LOW * grid[1]
    # On both sides of a break, where the balance may jump.
    breaks = np.outer(bearing.friction.breakpoints, _BESIDE).ravel()
    return np.union1d(grid, breaks[(breaks > grid[0]) & (breaks < high)])


@dataclass(frozen=True, slots=True)
class _Piece:
    """A stretch of the level set on which speed rises, and what stands at its two ends."""

    speed: FloatArray
    t: FloatArray
    ends: tuple[BranchMark | None, BranchMark | None]


class _Contour:
    """The level set of the averaged balance at a load."""

    def __init__(self, bearing: Bearing, load: float, grid: FloatArray) -> None:
        self._bearing, self._load, self._grid = bearing, load, grid
        self._known = (fold_speed(bearing, load), hopf_speed(bearing, load))

    def balance(self, speed: FloatArray, t: FloatArray) -> FloatArray:
        """What a cycle gains beside what it loses, as the growth rate of its amplitude [1/s]."""
        a = speed * (1.0 + t * np.abs(t))
        rest = np.asarray(growth_rate(self._bearing, speed, self._load))
        drive = 2.0 * harmonic(self._bearing.friction, speed, a) / np.where(a > 0.0, a, 1.0)
        moving = (self._load * drive - self._bearing.damping) / (2.0 * self._bearing.mass)
        return np.where(t > _AT_REST, moving, rest)

    def lines(self) -> Sequence[FloatArray]:
        """The lines of the level set, each of points of speed and t, shape (n, 2)."""
        try:
            from contourpy import contour_generator
        except ImportError as error:
            raise DrawingError(
                f'branches need contourpy, which comes with matplotlib 3.6 ({error}): install the'
                " extra 'report', e.g. pip install 'stickslip_monitor[report]'"
            ) from error
        z = self.balance(self._grid[None, :], _ROWS[:, None])
        found: Any = contour_generator(self._grid, _ROWS, z).lines(0.0)
        return list(found)

    def pieces(self, line: FloatArray) -> Iterator[_Piece]:
        """Cut a line where its speed turns back."""
        speed, t = line.T
        turns = np.flatnonzero(np.diff(np.sign(np.diff(speed))) != 0) + 1
        cuts = [0, *self._real(speed, turns), speed.size - 1]
        for first, last in pairwise(cuts):
            order = slice(first, last + 1)
            one, other = self._end(speed, t, first), self._end(speed, t, last)
            if speed[last] >= speed[first]:
                yield _Piece(speed[order], t[order], (one, other))
            else:
                yield _Piece(speed[order][::-1], t[order][::-1], (other, one))

    def _real(self, speed: FloatArray, turns: IndexArray) -> list[int]:
        """The turns that are no rounding: the line goes back a good part of a step there."""
        least = 1e-3 * float(np.max(np.diff(self._grid)))
        kept: list[int] = []
        for turn in turns.tolist():
            if abs(speed[turn] - speed[kept[-1] if kept else 0]) > least:
                kept.append(turn)
        if kept and abs(speed[-1] - speed[kept[-1]]) <= least:
            kept.pop()
        return kept

    def _end(self, speed: FloatArray, t: FloatArray, place: int) -> BranchMark | None:
        """What a piece ends in; nothing at the edge of the range of speeds."""
        v, at = float(speed[place]), float(t[place])
        if place in (0, speed.size - 1):
            if at > _AT_REST:
                return None
            speed_ = self._bisected(v, _AT_REST)
            return BranchMark(MarkKind.HOPF, self._snapped(speed_), 0.0)
        # The peak of friction's work, a cusp, is at the sliding limit; elsewhere a branch bends.
        near = t[max(0, place - 1) : place + 2]
        if float(near.min()) <= _AT_LIMIT <= float(near.max()):
            v, at = self._bisected(v, _AT_LIMIT), _AT_LIMIT
        else:
            v, at = self._vertex(speed[place - 1 : place + 2], t[place - 1 : place + 2])
        v = self._snapped(v)
        amplitude = v * (1.0 + at * abs(at)) / self._bearing.natural_frequency
        return BranchMark(MarkKind.FOLD, v, amplitude)

    def _bisected(self, speed: float, t: float) -> float:
        """The speed between two of the grid at which the balance changes its sign."""
        after = int(np.clip(np.searchsorted(self._grid, speed), 1, self._grid.size - 1))
        low, high = float(self._grid[after - 1]), float(self._grid[after])
        value: Callable[[float], float] = lambda v: float(  # noqa: E731
            self.balance(np.array([v]), np.array([t]))[0]
        )
        begin = value(low)
        if (begin > 0.0) == (value(high) > 0.0):
            return speed
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if (value(middle) > 0.0) == (begin > 0.0) else (low, middle)
        return 0.5 * (low + high)

    def _vertex(self, speed: FloatArray, t: FloatArray) -> tuple[float, float]:
        """The turning point near three points of the level set, by ever narrower parabolas."""
        turn, v, width = float(t[1]), speed, float(np.ptp(t)) / 2.0
        for _ in range(_ROUNDS):
            around = turn + width * np.array([-1.0, 0.0, 1.0])
            v = self._moved(np.full(3, v[1]), around)
            curve = np.polynomial.Polynomial.fit(around, v, 2)
            (found,) = curve.deriv().roots().real[:1]
            turn = float(np.clip(found, around[0], around[2]))
            width /= _NARROWER
        return float(self._moved(v[1:2], np.array([turn]))[0]), turn

    def _moved(self, speed: FloatArray, t: FloatArray) -> FloatArray:
        """The points at the same amplitudes on the level set, by Newton steps in speed."""
        most = float(np.max(np.diff(self._grid)))
        for _ in range(_NEWTON_STEPS):
            step = _STEP * speed
            value = self.balance(speed, t)
            slope = (self.balance(speed + step, t) - value) / step
            with np.errstate(all='ignore'):
                change = np.nan_to_num(value / slope, posinf=0.0, neginf=0.0)
            speed = speed - np.clip(change, -most, most)
        return speed

    def _snapped(self, speed: float) -> float:
        """The package's own Hopf or fold speed where the contour has found the same."""
        step = float(np.max(np.diff(self._grid)))
        for boundary in self._known:
            if abs(speed - boundary) < 1e-2 * step:
                return float(boundary)
        return speed

    def branch(self, piece: _Piece, speeds: FloatArray) -> Branch:
        """A piece at each speed that it covers, by Newton steps from the contour."""
        own_speed, own_t = piece.speed.copy(), piece.t.copy()
        for place, mark in zip((0, -1), piece.ends, strict=True):
            if mark:
                own_speed[place], own_t[place] = mark.speed, self._t_of(mark)
        covered = (speeds >= own_speed[0]) & (speeds <= own_speed[-1])
        v = speeds[covered]
        t = self._polished(v, np.interp(v, own_speed, own_t))
        amplitude = np.full(speeds.shape, np.nan)
        amplitude[covered] = v * (1.0 + t * np.abs(t)) / self._bearing.natural_frequency
        for mark in piece.ends:
            if mark:
                amplitude[np.searchsorted(speeds, mark.speed)] = mark.amplitude
        return Branch(self._is_stable(v, t), amplitude)

    def _t_of(self, mark: BranchMark) -> float:
        beyond = mark.amplitude * self._bearing.natural_frequency / mark.speed - 1.0
        return math.copysign(math.sqrt(abs(beyond)), beyond)

    def _polished(self, speed: FloatArray, t: FloatArray) -> FloatArray:
        """Newton steps in t, none across the cusp."""
        low = np.where(t < _AT_LIMIT, _AT_REST, _AT_LIMIT)
        high = np.where(t < _AT_LIMIT, _AT_LIMIT, _ROWS[-1])
        for _ in range(_NEWTON_STEPS):
            value = self.balance(speed, t)
            step = np.where(t < _AT_LIMIT, -_STEP, _STEP)
            slope = (self.balance(speed, t + step) - value) / step
            with np.errstate(all='ignore'):
                better = np.clip(t - value / slope, low, high)
            better = np.where(np.isfinite(better) & (np.abs(better - t) < 0.1), better, t)
            better = np.where(np.abs(self.balance(speed, better)) < np.abs(value), better, t)
            if np.array_equal(better, t):
                break
            t = better
        scale = self._bearing.damping / self._bearing.mass or 1.0
        for k in np.flatnonzero(np.abs(self.balance(speed, t)) > _SETTLED * scale):
            t[k] = self._between_rows(speed[k], t[k])
        return t

    def _between_rows(self, speed: float, t: float) -> float:
        """The zero of the balance at a speed that is nearest to a guess, by bisection."""
        above = self.balance(np.full(_ROWS.shape, speed), _ROWS) > 0.0
        changes = np.flatnonzero(above[1:] != above[:-1])
        if not changes.size:
            return t
        row = int(changes[np.argmin(np.abs(_ROWS[changes] - t))])
        low, high = float(_ROWS[row]), float(_ROWS[row + 1])
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            is_above = self.balance(np.array([speed]), np.array([middle]))[0] > 0.0
            low, high = (middle, high) if is_above == above[row] else (low, middle)
        return low

    def _is_stable(self, speed: FloatArray, t: FloatArray) -> bool:
        """Whether more amplitude loses more, in the middle of a branch."""
        middle = slice(speed.size // 2, speed.size // 2 + 1)
        v, at, step = speed[middle], t[middle], 1e-3 * np.abs(t[middle]) + 1e-7
        return bool(np.all(self.balance(v, at + step) < self.balance(v, at - step)))


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
    columns['exact_amplitude [m]'] = diagram.exact.tolist()
    return columns
