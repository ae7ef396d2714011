# SPDX-License-Identifier: Apache-2.0
"""Draws the stability map: which regime where, over shaft speed and load."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.canvas import HEIGHT, WIDTH, new_figure, style
from stickslip_monitor.drawing.labels import Labeller
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
from stickslip_monitor.physics.belief import QUANTILES, Belief
from stickslip_monitor.physics.oscillator import Bearing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_CELLS = (110, 160)
_KILO_FROM = 5000.0
_BEYOND = 2.0
_BAND_LOADS = 120
# Room around the axes [inch], whatever the size of the figure.
_MARGIN_LEFT, _MARGINS_BESIDE, _MARGIN_BELOW, _MARGIN_ABOVE = 0.855, 1.08, 0.7, 0.196


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
        curves = boundaries(bearing, speeds, loads, margin)
        figure = new_figure(*size)
        above = legend_height(track, size[0]) if track is not None else 0.0
        axes = figure.add_axes(_frame(size, above))
        x_unit = bearing.speed.factor('rpm')
        y_unit = 1000.0 if loads[1] >= _KILO_FROM else 1.0
        axes.set_xlim(speeds[0] / x_unit, speeds[1] / x_unit)
        axes.set_ylim(loads[0] / y_unit, loads[1] / y_unit)
        axes.set_xlabel('shaft speed [rpm]')
        axes.set_ylabel(f'bearing load [{"kN" if y_unit > 1.0 else "N"}]')
        labels = Labeller(axes)
        _regions(axes, curves, loads, x_unit, y_unit)
        if bearing_config.belief is not None:
            _bands(axes, bearing_config.belief, loads, x_unit, y_unit)
        _lines(axes, labels, curves, x_unit, y_unit)
        if track is not None:
            draw_track(axes, labels, track, x_unit, y_unit, size[0])
        _line_names(labels, curves, margin, x_unit, y_unit)
        _region_names(labels, curves, speeds, loads)
        figure.text(
            0.975, 0.012, f'{bearing_config.name}, averaged model (KBM)',
            ha='right', va='bottom', size=9.0, color=MUTED,
        )  # fmt: skip
        return figure


def _frame(size: tuple[float, float], above: float) -> tuple[float, float, float, float]:
    """Where the axes stand: left, bottom, width and height as parts of the figure."""
    width, height = size
    bottom = _MARGIN_BELOW / height
    top = 1.0 - max(_MARGIN_ABOVE, above) / height
    return _MARGIN_LEFT / width, bottom, 1.0 - _MARGINS_BESIDE / width, top - bottom


def _regions(axes: Axes, curves: Boundaries, loads: Range, x_unit: float, y_unit: float) -> None:
    """Fill the regions, each over the one below it."""
    axes.set_facecolor(REGIME_FILL[Regime.STABLE])
    x, ceiling = curves.speed / x_unit, _BEYOND * loads[1]
    for load, colour in (
        (curves.caution_load, CAUTION_FILL),
        (curves.fold_load, REGIME_FILL[Regime.BISTABLE]),
        (curves.hopf_load, REGIME_FILL[Regime.UNSTABLE]),
    ):
        bottom = np.minimum(np.nan_to_num(load, nan=ceiling), ceiling) / y_unit
        axes.fill_between(x, bottom, ceiling / y_unit, color=colour, lw=0.0, zorder=1)


def _named(
    curves: Boundaries, margin: float
) -> tuple[tuple[str, FloatArray, dict[str, Any]], ...]:
    return (
        ('Hopf', curves.hopf_load, {'color': HOPF, 'lw': 2.0, 'ls': '-'}),
        ('fold', curves.fold_load, {'color': FOLD, 'lw': 2.0, 'ls': DASHES}),
        (
            f'margin low: fold margin below {margin:.4g}',
            curves.caution_load,
            {'color': MUTED, 'lw': 1.0, 'ls': ':'},
        ),
    )


def _lines(axes: Axes, labels: Labeller, curves: Boundaries, x_unit: float, y_unit: float) -> None:
    x = curves.speed / x_unit
    for load in curves.amplitude_load:
        axes.plot(x, load / y_unit, color=MUTED, lw=0.9, zorder=2)
        labels.avoid(x, load / y_unit)
    for _, load, look in _named(curves, 0.0):
        axes.plot(x, load / y_unit, zorder=3, **look)
        labels.avoid(x, load / y_unit)


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


def _line_names(
    labels: Labeller, curves: Boundaries, margin: float, x_unit: float, y_unit: float
) -> None:
    x = curves.speed / x_unit
    for name, load, _ in _named(curves, margin):
        size = 9.5 if name.startswith('margin') else 11.0
        labels.along(name, x, load / y_unit, size=size, zorder=13)
    for amplitude, load in zip(curves.amplitude, curves.amplitude_load, strict=True):
        text = f'{amplitude * 1e3:.6g} mm'
        labels.along(text, x, load / y_unit, 2.0, size=9.0, color=MUTED, zorder=13)


def _region_names(labels: Labeller, curves: Boundaries, speeds: Range, loads: Range) -> None:
    """Name each region in a wide part of it."""
    rows, columns = _CELLS
    speed = speeds[0] + (np.arange(columns) + 0.5) / columns * (speeds[1] - speeds[0])
    load = (loads[0] + (np.arange(rows) + 0.5) / rows * (loads[1] - loads[0]))[:, None]
    fold, hopf = (
        np.interp(speed, curves.speed, np.minimum(np.nan_to_num(line, nan=1e300), 1e300))
        for line in (curves.fold_load, curves.hopf_load)
    )
    regions = {
        Regime.UNSTABLE: load > hopf,
        Regime.BISTABLE: (load > fold) & (load <= hopf),
        Regime.STABLE: (load <= fold) & (load <= hopf),
    }
    for regime, inside in regions.items():
        if inside.any():
            labels.area(regime.value, inside, style='italic', size=12.0, zorder=13)
    if not (regions[Regime.UNSTABLE] | regions[Regime.BISTABLE]).any():
        labels.area('no stick-slip in this range', inside, zorder=13)
