# SPDX-License-Identifier: Apache-2.0
"""Draws the stability map: which regime where, over shaft speed and load."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stickslip_monitor.drawing.canvas import HEIGHT, WIDTH, new_figure, style
from stickslip_monitor.drawing.map_curves import (
    Boundaries,
    Range,
    boundaries,
    map_loads,
    map_speeds,
)
from stickslip_monitor.drawing.palette import (
    CAUTION_FILL,
    DASHES,
    FOLD,
    HOPF,
    MUTED,
    REGIME_COLOUR,
    REGIME_FILL,
)
from stickslip_monitor.drawing.track import Track, draw_track, legend_height
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import fold_speed
from stickslip_monitor.physics.belief import QUANTILES, Belief
from stickslip_monitor.physics.cycle.cycles import exact_cycle, exact_fold_speed
from stickslip_monitor.physics.oscillator import Bearing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_BEYOND = 2.0
_BAND_LOADS = 120
# Where exact cycles and folds are worked out.
_EXACT_GRID, _EXACT_LOADS = (48, 32), 32
_FOLDS_APART = 0.005
_NARROW = 5.0
# The legend below the map [inch].
_LEGEND_COLUMN, _LEGEND_ROW, _MOST_NAMES = 1.25, 0.2, 7
# Room around the axes [inch], whatever the size of the figure.
_MARGIN_LEFT, _MARGINS_BESIDE, _MARGIN_BELOW, _MARGIN_ABOVE = 0.855, 1.08, 0.64, 0.24


def map_ranges(
    bearing: Bearing,
    speeds: Range | None = None,
    loads: Range | None = None,
    track: Track | None = None,
) -> tuple[Range, Range]:
    """The speeds [m/s] and loads [N] a map shows; what is not given is chosen.

    Chosen ranges have the boundaries and the whole track inside.
    """
    if track is not None:
        fastest, heaviest = (
            float(np.nanmax(np.abs(column), initial=0.0)) for column in (track.speed, track.load)
        )
    else:
        fastest = heaviest = 0.0
    loads = loads or map_loads(bearing, heaviest)
    return speeds or map_speeds(bearing, loads[1], fastest), loads


def draw_map(
    bearing_config: BearingConfig,
    speeds: Range | None = None,
    loads: Range | None = None,
    track: Track | None = None,
    size: tuple[float, float] = (WIDTH, HEIGHT),
) -> Figure:
    """Draw the stability map of a bearing.

    Args:
        bearing_config: The bearing; its alarm's caution margin is drawn too.
        speeds: Lowest and highest surface speed [m/s]; chosen if ``None``.
        loads: Lowest and highest load [N]; chosen if ``None``.
        track: Operating points to draw on it.
        size: Width and height [inch].

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        bearing, margin = bearing_config.bearing, bearing_config.alarm.caution_margin
        speeds, loads = map_ranges(bearing, speeds, loads, track)
        curves = boundaries(bearing, speeds, margin)
        figure = new_figure(*size)
        columns = max(2, int(size[0] / _LEGEND_COLUMN))
        above = legend_height(track, size[0]) if track is not None else 0.0
        axes = figure.add_axes(_frame(size, above, -(-_MOST_NAMES // columns)))
        x_unit, y_unit = bearing.speed.factor('rpm'), 1000.0
        axes.set_xlim(speeds[0] / x_unit, speeds[1] / x_unit)
        axes.set_ylim(loads[0] / y_unit, loads[1] / y_unit)
        axes.set_xlabel('shaft speed [rpm]')
        axes.set_ylabel('bearing load [kN]')
        handles = _regions(axes, curves, loads, x_unit, y_unit)
        if bearing_config.belief is not None:
            _bands(axes, bearing_config.belief, loads, x_unit, y_unit)
        handles += _lines(axes, curves, x_unit, y_unit)
        handles += _exact_fold(axes, bearing, loads, x_unit, y_unit)
        _amplitudes(axes, bearing, speeds, loads, 5 if size[0] > _NARROW else 3)
        if track is not None:
            draw_track(axes, track, x_unit, y_unit, size[0])
        if not np.isfinite([curves.fold_load, curves.hopf_load]).any():
            axes.text(
                0.5, 0.5, 'no stick-slip in this range', transform=axes.transAxes, ha='center'
            )
        figure.legend(
            handles=handles, loc='lower left', bbox_to_anchor=(_MARGIN_LEFT / size[0] - 0.01, 0.0),
            ncols=columns, frameon=False, fontsize=9.5, handlelength=1.8, columnspacing=1.2,
            handletextpad=0.5, labelspacing=0.3,
        )  # fmt: skip
        figure.text(0.985, 0.995, bearing_config.name, ha='right', va='top', size=9.0, color=MUTED)
        return figure


def _frame(
    size: tuple[float, float], above: float, rows: int
) -> tuple[float, float, float, float]:
    """Where the axes stand: left, bottom, width and height as parts of the figure."""
    width, height = size
    bottom = (_MARGIN_BELOW + _LEGEND_ROW * rows) / height
    top = 1.0 - max(_MARGIN_ABOVE, above) / height
    return _MARGIN_LEFT / width, bottom, 1.0 - _MARGINS_BESIDE / width, top - bottom


def _regions(
    axes: Axes, curves: Boundaries, loads: Range, x_unit: float, y_unit: float
) -> list[Artist]:
    """Fill the regions, each over the one below it; what names them in the legend."""
    axes.set_facecolor(REGIME_FILL[Regime.STABLE])
    x, ceiling = curves.speed / x_unit, _BEYOND * loads[1]
    named: list[Artist] = [_patch(REGIME_FILL[Regime.STABLE], 'stable')]
    for load, colour, name in (
        (curves.caution_load, CAUTION_FILL, 'margin low'),
        (curves.fold_load, REGIME_FILL[Regime.BISTABLE], 'bistable'),
        (curves.hopf_load, REGIME_FILL[Regime.UNSTABLE], 'unstable'),
    ):
        bottom = np.minimum(np.nan_to_num(load, nan=ceiling), ceiling) / y_unit
        axes.fill_between(x, bottom, ceiling / y_unit, color=colour, lw=0.0, zorder=1)
        named.append(_patch(colour, name))
    return named


def _patch(colour: str, name: str) -> Artist:
    from matplotlib.patches import Patch

    return Patch(fc=colour, ec=MUTED, lw=0.5, label=name)


def _lines(axes: Axes, curves: Boundaries, x_unit: float, y_unit: float) -> list[Artist]:
    x = curves.speed / x_unit
    axes.plot(x, curves.caution_load / y_unit, color=MUTED, lw=1.0, ls=':', zorder=3)
    return [
        axes.plot(x, load / y_unit, color=colour, lw=2.0, ls=dashes, zorder=3, label=name)[0]
        for name, load, colour, dashes in (
            ('Hopf', curves.hopf_load, HOPF, '-'),
            ('fold', curves.fold_load, FOLD, DASHES),
        )
    ]


def _exact_fold(
    axes: Axes, bearing: Bearing, loads: Range, x_unit: float, y_unit: float
) -> list[Artist]:
    """The fold of the exact model, where it is another line than that of averaging."""
    load = np.linspace(loads[0], loads[1], _EXACT_LOADS + 1)[1:]
    exact = np.asarray(exact_fold_speed(bearing, load))
    averaged = np.asarray(fold_speed(bearing, load))
    if not np.any(np.abs(exact - averaged) > _FOLDS_APART * exact):
        return []
    axes.plot(
        exact / x_unit, load / y_unit, color=FOLD, lw=1.4, ls='-.', zorder=3, label='fold, exact'
    )
    return [axes.lines[-1]]


def _amplitudes(axes: Axes, bearing: Bearing, speeds: Range, loads: Range, levels: int) -> None:
    """Lines of one amplitude of the exact stick-slip cycle, labelled in mm."""
    columns, rows = _EXACT_GRID
    speed = np.linspace(speeds[0], speeds[1], columns + 1)[1:]
    load = np.linspace(loads[0], loads[1], rows + 1)[1:]
    exact = exact_cycle(bearing, speed[None, :], load[:, None]).amplitude * 1e3
    if not np.isfinite(exact).any():
        return
    lines = axes.contour(
        speed / bearing.speed.factor('rpm'), load / 1e3, np.ma.masked_invalid(exact), levels,
        colors=MUTED, linewidths=0.9, zorder=2,
    )  # fmt: skip
    axes.clabel(lines, fmt='%g mm', fontsize=9.0)


def _bands(axes: Axes, belief: Belief, loads: Range, x_unit: float, y_unit: float) -> None:
    """Where 5 to 95 % of the belief have the Hopf and the fold speed."""
    load = np.linspace(max(loads[0], 1e-6 * loads[1]), loads[1], _BAND_LOADS)
    for quantile, regime in (
        (belief.fold_speed, Regime.BISTABLE),
        (belief.hopf_speed, Regime.UNSTABLE),
    ):
        low, high = (quantile(load, p) / x_unit for p in (QUANTILES[0], QUANTILES[-1]))
        axes.fill_betweenx(
            load / y_unit, low, high, color=REGIME_COLOUR[regime], alpha=0.35, lw=0.0, zorder=2
        )
