# SPDX-License-Identifier: Apache-2.0
"""The bifurcation diagram: vibration amplitude over shaft speed, at one load.

At a load the cycles of the averaged model are the level set of its balance over speed and
amplitude, ``2 S(a; V)/a = c/N``. The level set is contoured, cut where a branch turns back (fold)
or begins in the equilibrium (Hopf), and brought to rounding by Newton steps. No number of
branches is assumed. The exact cycle, of which there is one stable and one unstable, stands beside.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.canvas import (
    DASHES,
    FOLD,
    HOPF,
    INK,
    MUTED,
    PAPER,
    REGIME_COLOUR,
    REGIME_FILL,
    labelled,
    legend_below,
    span_words,
    style,
)
from stickslip_monitor.drawing.map import Range, diagram_speeds
from stickslip_monitor.monitor.assessment import Regime, assess
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import (
    fold_speed,
    growth_rate,
    harmonic,
    hopf_speed,
)
from stickslip_monitor.physics.cycle.cycles import exact_cycle, exact_fold_speed
from stickslip_monitor.physics.oscillator import Bearing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LOW = 1e-3
_SAME = 1e-9
_BESIDE = (1.0 - 1e-9, 1.0, 1.0 + 1e-9)
_NEWTON_STEPS = 12
_STEP = 1e-6
_SETTLED = 1e-9
# Amplitudes as t with a = V (1 + t |t|): -1 at rest, 0 at the sliding limit, where the balance
# has a cusp in a and none in t. Beyond 31 V no law has a cycle: friction brakes on both ways.
_AT_REST, _AT_LIMIT = -1.0, 0.0
_MOST_COLUMNS = 150
_ROWS = np.concatenate(
    [np.linspace(_AT_REST, -0.02, 50), [_AT_LIMIT], np.geomspace(2e-4, 5.5, 60)]
)
_HEADROOM, _BELOW_ZERO = 1.2, 0.07


class MarkKind(str, Enum):
    """What happens at the end of a branch."""

    HOPF = 'Hopf'
    FOLD = 'fold'


class BranchMark(NamedTuple):
    """Where a branch ends: at a Hopf it meets the equilibrium, at a fold another cycle.

    ``speed`` is the surface speed [m/s], ``amplitude`` that of the displacement, 0 at a Hopf [m].
    """

    kind: MarkKind
    speed: float
    amplitude: float


@dataclass(frozen=True, slots=True)
class Branch:
    """One family of limit cycles; an unstable one is the threshold between two states.

    ``amplitude`` is that of the displacement at each speed of the diagram, ``nan`` beyond the ends
    of the branch, shape (n,) [m].
    """

    stable: bool
    amplitude: FloatArray


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
        spans: The regimes by speed: from [m/s], to [m/s], regime.
        exact: Amplitude of the exact stick-slip cycle, ``nan`` for none, shape (n,) [m].
        exact_fold: Speed beyond which there is none [m/s]; ``inf`` where it never ends.
    """

    load: float
    speed: FloatArray
    sliding_limit: FloatArray
    growth_rate: FloatArray
    branches: tuple[Branch, ...]
    marks: tuple[BranchMark, ...]
    spans: tuple[tuple[float, float, Regime], ...]
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
    """
    grid = np.linspace(*speeds, points)
    if speeds[0] == 0.0:
        grid[0] = _LOW * grid[1]  # at rest nothing slides
    levels = _LevelSet(bearing, load, _columns(bearing, grid))
    pieces = list(levels.pieces())
    marks = sorted(
        {mark for piece in pieces for mark in piece.marks}, key=lambda m: (m.speed, m.amplitude)
    )
    ends = [mark.speed for mark in marks]
    exact_fold = float(exact_fold_speed(bearing, load))
    # The exact branch is drawn up to its end.
    last = [exact_fold * (1.0 - _SAME)] if grid[0] < exact_fold < grid[-1] else []
    speed = np.union1d(grid, [*ends, *last])
    branches = [levels.branch(piece, speed) for piece in pieces]
    branches.sort(key=lambda b: (not b.stable, -float(np.nanmax(b.amplitude, initial=0.0))))
    return Diagram(
        load=load,
        speed=speed,
        sliding_limit=speed / bearing.natural_frequency,
        growth_rate=np.asarray(growth_rate(bearing, speed, load)),
        branches=tuple(branches),
        marks=tuple(marks),
        spans=_spans(bearing, load, sorted({speeds[0], *ends, *last, speeds[1]})),
        exact=np.asarray(exact_cycle(bearing, speed, load).amplitude),
        exact_fold=exact_fold,
    )


def _columns(bearing: Bearing, grid: FloatArray) -> FloatArray:
    """Some even speeds and both sides of the law's break points, where the balance may jump."""
    low, high = grid[0], grid[-1]
    even = np.linspace(low, high, min(grid.size, _MOST_COLUMNS))
    breaks = np.outer(bearing.friction.breakpoints, _BESIDE).ravel()
    return np.union1d(even, breaks[(breaks > low) & (breaks < high)])


class _Piece(NamedTuple):
    """A stretch of the level set on which speed rises, and the bifurcations at its ends."""

    speed: FloatArray
    t: FloatArray
    marks: tuple[BranchMark, ...]


class _LevelSet:
    """The cycles of the averaged model at a load."""

    def __init__(self, bearing: Bearing, load: float, columns: FloatArray) -> None:
        self._bearing, self._load, self._columns = bearing, load, columns
        self._step = float(np.max(np.diff(columns)))
        self._known = (fold_speed(bearing, load), hopf_speed(bearing, load))

    def balance(self, speed: FloatArray, t: FloatArray) -> FloatArray:
        """What a cycle gains beside what it loses, as the growth rate of its amplitude [1/s]."""
        a = speed * (1.0 + t * np.abs(t))
        rest = np.asarray(growth_rate(self._bearing, speed, self._load))
        drive = 2.0 * harmonic(self._bearing.friction, speed, a) / np.where(a > 0.0, a, 1.0)
        moving = (self._load * drive - self._bearing.damping) / (2.0 * self._bearing.mass)
        return np.where(t > _AT_REST, moving, rest)

    def pieces(self) -> Iterator[_Piece]:
        """The lines of the level set, cut where their speed turns back."""
        from contourpy import contour_generator  # comes with matplotlib
        from scipy.signal import find_peaks

        z = self.balance(self._columns[None, :], _ROWS[:, None])
        lines: Any = contour_generator(self._columns, _ROWS, z).lines(0.0)
        for line in lines:
            speed, t = line.T
            turns = [find_peaks(s * speed, prominence=1e-3 * self._step)[0] for s in (1, -1)]
            cuts = [0, *np.sort(np.concatenate(turns)).tolist(), speed.size - 1]
            ends = [self._end(line, place) for place in cuts]
            for (first, last), marks in zip(pairwise(cuts), pairwise(ends), strict=True):
                v, own = speed[first : last + 1].copy(), t[first : last + 1].copy()
                for place, mark in zip((0, -1), marks, strict=True):
                    if mark is not None:
                        v[place], own[place] = mark[0].speed, mark[1]
                order = slice(None, None, 1 if v[-1] >= v[0] else -1)
                yield _Piece(v[order], own[order], tuple(mark[0] for mark in marks if mark))

    def _end(self, line: FloatArray, place: int) -> tuple[BranchMark, float] | None:
        """What a piece ends in, and its t; nothing at the edge of the range of speeds."""
        v, t = map(float, line[place])
        if place in (0, line.shape[0] - 1):
            if t > _AT_REST:
                return None
            return BranchMark(MarkKind.HOPF, self._snapped(self._speed_at(t, v)), 0.0), t
        near = line[place - 1 : place + 2, 1]
        if float(near.min()) <= _AT_LIMIT <= float(near.max()):
            # The peak of friction's work, a cusp, is at the sliding limit.
            t = _AT_LIMIT
        else:
            from scipy.optimize import minimize_scalar

            sign = 1.0 if v < line[place - 1, 0] else -1.0
            t = float(
                minimize_scalar(
                    lambda at: sign * self._speed_at(at, v), method='bounded',
                    bounds=(near.min(), near.max()), options={'xatol': 1e-9},
                ).x
            )  # fmt: skip
        v = self._snapped(self._speed_at(t, v))
        amplitude = v * (1.0 + t * abs(t)) / self._bearing.natural_frequency
        return BranchMark(MarkKind.FOLD, v, amplitude), t

    def _speed_at(self, t: float, near: float) -> float:
        """The speed of the level set at an amplitude, between the columns around a speed."""
        from scipy.optimize import brentq

        def gain(speed: float) -> float:
            return float(self.balance(np.array([speed]), np.array([t]))[0])

        last = self._columns.size - 1
        after = int(np.clip(np.searchsorted(self._columns, near), 1, last))
        for reach in (0, 1):
            low = float(self._columns[max(after - 1 - reach, 0)])
            high = float(self._columns[min(after + reach, last)])
            if (gain(low) > 0.0) != (gain(high) > 0.0):
                return float(brentq(gain, low, high, xtol=1e-16))
        return near

    def _snapped(self, speed: float) -> float:
        """The package's own Hopf or fold speed where the contour has found the same."""
        for boundary in self._known:
            if abs(speed - boundary) < 1e-2 * self._step:
                return float(boundary)
        return speed

    def branch(self, piece: _Piece, speeds: FloatArray) -> Branch:
        """A piece at each speed that it covers, by Newton steps from the contour."""
        covered = (speeds >= piece.speed[0]) & (speeds <= piece.speed[-1])
        v = speeds[covered]
        t = self._polished(v, np.interp(v, piece.speed, piece.t))
        amplitude = np.full(speeds.shape, np.nan)
        amplitude[covered] = v * (1.0 + t * np.abs(t)) / self._bearing.natural_frequency
        for mark in piece.marks:
            amplitude[np.searchsorted(speeds, mark.speed)] = mark.amplitude
        middle = slice(v.size // 2, v.size // 2 + 1)
        v, t, step = v[middle], t[middle], 1e-3 * np.abs(t[middle]) + 1e-7
        # More amplitude loses more.
        stable = bool(np.all(self.balance(v, t + step) < self.balance(v, t - step)))
        return Branch(stable, amplitude)

    def _polished(self, speed: FloatArray, t: FloatArray) -> FloatArray:
        """Newton steps in t, on the own side of the cusp, as long as they lead nearer."""
        value = self.balance(speed, t)
        for _ in range(_NEWTON_STEPS):
            step = np.where(t < _AT_LIMIT, -_STEP, _STEP)
            slope = (self.balance(speed, t + step) - value) / step
            with np.errstate(all='ignore'):
                better = np.nan_to_num(t - value / slope, nan=_AT_REST)
            better = np.clip(better, _AT_REST, _ROWS[-1])
            gain = self.balance(speed, better)
            nearer = np.abs(gain) < np.abs(value)
            t, value = np.where(nearer, better, t), np.where(nearer, gain, value)
        scale = self._bearing.damping / self._bearing.mass or 1.0
        for k in np.flatnonzero(np.abs(value) > _SETTLED * scale):
            t[k] = self._between_rows(float(speed[k]), float(t[k]))
        return t

    def _between_rows(self, speed: float, t: float) -> float:
        """The zero at a speed that is nearest to a guess, where a law's corner stops Newton."""
        from scipy.optimize import brentq

        def gain(at: float) -> float:
            return float(self.balance(np.array([speed]), np.array([at]))[0])

        above = self.balance(np.full(_ROWS.shape, speed), _ROWS) > 0.0
        changes = np.flatnonzero(above[1:] != above[:-1])
        if not changes.size:
            return t
        row = int(changes[np.argmin(np.abs(_ROWS[changes] - t))])
        return float(brentq(gain, _ROWS[row], _ROWS[row + 1], xtol=1e-15))


def _spans(
    bearing: Bearing, load: float, edges: Sequence[float]
) -> tuple[tuple[float, float, Regime], ...]:
    middles = 0.5 * (np.array(edges[:-1]) + edges[1:])
    spans: list[tuple[float, float, Regime]] = []
    for (low, high), name in zip(
        pairwise(edges), assess(bearing, middles, load).regime, strict=True
    ):
        if spans and spans[-1][2] is Regime(name):
            low = spans.pop()[0]
        spans.append((low, high, Regime(name)))
    return tuple(spans)


def diagram_columns(bearing: Bearing, diagram: Diagram) -> dict[str, Sequence[object]]:
    """The diagram as the columns of a table, by heading, SI units but for the shaft speed."""
    columns: dict[str, Sequence[object]] = {
        'shaft_speed [rpm]': bearing.speed.from_surface(diagram.speed, 'rpm').tolist(),
        'surface_speed [m/s]': diagram.speed.tolist(),
        'load [N]': [diagram.load] * diagram.speed.size,
        'regime': assess(bearing, diagram.speed, diagram.load).regime.tolist(),
        'growth_rate [1/s]': diagram.growth_rate.tolist(),
        'sliding_limit [m]': diagram.sliding_limit.tolist(),
    }
    for stable, name in ((True, 'stick_slip_amplitude'), (False, 'threshold_amplitude')):
        own = [branch.amplitude for branch in diagram.branches if branch.stable is stable]
        for k, amplitude in enumerate(own or [np.full(diagram.speed.size, np.nan)]):
            columns[f'{name}{f"_{k + 1}" if k else ""} [m]'] = amplitude.tolist()
    columns['exact_amplitude [m]'] = diagram.exact.tolist()
    return columns


def draw_diagram(
    config: BearingConfig, load: float, speeds: Range | None = None, points: int = 400
) -> Figure:
    """Draw the bifurcation diagram of a bearing.

    Args:
        config: The bearing.
        load: Load > 0 [N].
        speeds: Lowest and highest surface speed [m/s]; chosen to show Hopf and fold by default.
        points: Number of evenly spaced speeds.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        bearing, rpm = config.bearing, config.bearing.speed.factor('rpm')
        speeds = speeds or diagram_speeds(bearing, load)
        diagram = bifurcation_diagram(bearing, load, speeds, points)
        figure, axes = labelled(
            'shaft speed [rpm]', 'displacement amplitude [mm]', box=(0.095, 0.245, 0.88, 0.635),
            footnote=f'{config.name}, load {load / 1e3:.6g} kN',
        )  # fmt: skip
        top = _top(diagram)
        axes.set_xlim(speeds[0] / rpm, speeds[1] / rpm)
        axes.set_ylim(-_BELOW_ZERO * top, _HEADROOM * top)
        both_ways = (lambda x: np.multiply(x, rpm), lambda x: np.divide(x, rpm))
        metres = axes.secondary_xaxis('top', functions=both_ways)
        metres.set_xlabel('surface speed [m/s]', labelpad=6.0)
        _curves(axes, diagram, rpm)
        spans = [(low / rpm, high / rpm, regime) for low, high, regime in diagram.spans]
        for low, high, regime in spans:
            axes.axvspan(low, high, color=REGIME_FILL[regime], lw=0.0, zorder=0)
        span_words(axes, ((low, high, regime.value) for low, high, regime in spans))
        _marks(axes, diagram, rpm)
        if not diagram.branches and not np.isfinite(diagram.exact).any():
            sentence = assess(bearing, 0.5 * sum(speeds), load).outcome.sentence
            axes.text(
                0.04, 0.85, textwrap.fill(sentence, 46), transform=axes.transAxes, va='top',
                linespacing=1.5,
            )  # fmt: skip
        legend_below(figure, 3)
        return figure


def _top(diagram: Diagram) -> float:
    """Amplitude [mm] that the axes must show."""
    curves = [branch.amplitude for branch in diagram.branches] + [diagram.exact]
    highest = max(float(np.nanmax(curve, initial=0.0)) for curve in curves)
    return (highest or float(diagram.sliding_limit[-1])) * 1e3


def _curves(axes: Axes, diagram: Diagram, rpm: float) -> None:
    """The exact cycle wide, what averaging has of it narrow, steady sliding along zero."""
    x = diagram.speed / rpm
    names = {
        True: 'stick-slip, averaging',
        False: 'threshold (unstable), averaging',
        '-': 'steady sliding',
        DASHES: 'steady sliding, unstable',
    }
    if np.isfinite(diagram.exact).any():
        axes.plot(
            x, diagram.exact * 1e3, color=REGIME_COLOUR[Regime.UNSTABLE], lw=3.4, zorder=4,
            label='stick-slip, exact',
        )  # fmt: skip
    for branch in diagram.branches:
        axes.plot(
            x, branch.amplitude * 1e3, color=INK, lw=1.3 if branch.stable else 1.6, zorder=5,
            ls='-' if branch.stable else DASHES, label=names.pop(branch.stable, '_'),
        )  # fmt: skip
    hopf = [mark.speed for mark in diagram.marks if mark.kind is MarkKind.HOPF]
    for low, high in pairwise([diagram.speed[0], *hopf, diagram.speed[-1]]):
        growing = np.interp(0.5 * (low + high), diagram.speed, diagram.growth_rate) > 0.0
        line: Any = DASHES if growing else '-'
        axes.plot(
            (low / rpm, high / rpm), (0.0, 0.0), color=REGIME_COLOUR[Regime.STABLE], ls=line,
            lw=2.4, zorder=3, label=names.pop(line, '_'),
        )  # fmt: skip
    limit = diagram.sliding_limit * 1e3
    limit = np.where(limit < axes.get_ylim()[1] / _HEADROOM * 1.1, limit, np.nan)
    axes.plot(x, limit, color=MUTED, lw=1.0, ls=':', zorder=2, label='sliding limit a = V')


def _marks(axes: Axes, diagram: Diagram, rpm: float) -> None:
    """Mark the bifurcations; the legend says at which speeds they are."""
    for kind, colour, fill, shape in (
        (MarkKind.HOPF, HOPF, PAPER, 'o'),
        (MarkKind.FOLD, FOLD, FOLD, 'D'),
    ):
        own = [mark for mark in diagram.marks if mark.kind is kind]
        text = f'{kind.value} {", ".join(f"{mark.speed / rpm:.4g}" for mark in own)} rpm'
        if kind is MarkKind.FOLD and own:
            text += f' (exact {diagram.exact_fold / rpm:.4g} rpm)'
        elif kind is MarkKind.FOLD and diagram.speed[0] < diagram.exact_fold < diagram.speed[-1]:
            # Where averaging has none, the end of the exact branch stands in.
            last = float(diagram.exact[np.isfinite(diagram.exact)][-1])
            own = [BranchMark(kind, diagram.exact_fold, last)]
            text = f'fold, exact {diagram.exact_fold / rpm:.4g} rpm (averaging has none)'
        if own:
            axes.plot(
                [mark.speed / rpm for mark in own], [mark.amplitude * 1e3 for mark in own],
                shape, ms=7.5, mec=colour, mew=1.4, mfc=fill, zorder=6, clip_on=False, label=text,
            )  # fmt: skip
