# SPDX-License-Identifier: Apache-2.0
"""Draws the published findings on amplitudes: exact and averaged branches over one parameter."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.canvas import WIDTH, new_figure, style
from stickslip_monitor.drawing.labels import Labeller, LabelPlace, around
from stickslip_monitor.drawing.palette import (
    DASHES,
    FOLD,
    HOPF,
    INK,
    MUTED,
    PAPER,
    REGIME_COLOUR,
    REGIME_FILL,
)
from stickslip_monitor.monitor.assessment import Regime

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


EXACT = REGIME_COLOUR[Regime.UNSTABLE]
SLIDING = REGIME_COLOUR[Regime.STABLE]
VEIL = {'fc': PAPER, 'ec': 'none', 'alpha': 0.8, 'pad': 0.8}
_TALL = 6.6
_LETTERS = 86
_HEADROOM, _BELOW_ZERO = 1.32, 0.06
_FROM_ZERO = 0.02
_WORST_SHOWN = -100.0
_NARROWEST = 75.0
_SLIDING_AT = (0.93, 0.88, 0.1, 0.2, 0.3, 0.7)
_REGIMES = (Regime.UNSTABLE, Regime.BISTABLE, Regime.STABLE)


@dataclass(frozen=True, slots=True, eq=False)
class AmplitudePicture:
    """What the picture shows; the parameter in its shown unit, amplitudes in m.

    Attributes:
        statement: The published statement, above the axes.
        footnote: Said below the axes.
        x_label: Name and unit of the parameter.
        unit: The unit beside the numbers of the marks, with a space before it; may be empty.
        x: The parameter, rising, shape (n,).
        exact: Exact stick-slip amplitude, shape (n,), ``nan`` without a cycle, as are the others.
        exact_unstable: Exact unstable amplitude, shape (n,).
        averaged: Stick-slip amplitude under KBM, shape (n,).
        averaged_unstable: Unstable amplitude under KBM, shape (n,).
        hopf: Parameter at the Hopf.
        exact_fold: Parameter at the exact fold.
        averaged_fold: Parameter at the fold under KBM.
        fold_amplitude: Exact amplitude at the fold.
        reverse_x: Parameters of the unstable cycles found in reverse time.
        reverse: Their amplitudes.
    """

    statement: str
    footnote: str
    x_label: str
    unit: str
    x: FloatArray
    exact: FloatArray
    exact_unstable: FloatArray
    averaged: FloatArray
    averaged_unstable: FloatArray
    hopf: float
    exact_fold: float
    averaged_fold: float
    fold_amplitude: float
    reverse_x: FloatArray = field(default_factory=lambda: np.empty(0))
    reverse: FloatArray = field(default_factory=lambda: np.empty(0))


def stated_figure(statement: str, footnote: str) -> Figure:
    """A tall figure with a statement at its head; to be called inside :func:`~.canvas.style`."""
    figure = new_figure()
    figure.set_size_inches(WIDTH, _TALL)
    figure.text(
        0.085, 0.975, textwrap.fill(statement, _LETTERS), ha='left', va='top', size=11.5,
        weight='bold', linespacing=1.35,
    )  # fmt: skip
    figure.text(0.975, 0.012, footnote, ha='right', va='bottom', size=9.0, color=MUTED)
    return figure


def draw_amplitudes(picture: AmplitudePicture) -> Figure:
    """Draw the branches over the parameter and, below them, the error of averaging.

    Returns:
        A figure that pyplot does not know of; :func:`~.canvas.save_figure` writes it.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    with style():
        figure = stated_figure(picture.statement, picture.footnote)
        axes = figure.add_axes((0.085, 0.345, 0.89, 0.49))
        below = figure.add_axes((0.085, 0.105, 0.89, 0.185))
        _frames(axes, below, picture)
        _bands(axes, below, picture)
        _branches(axes, picture)
        _marks(axes, picture)
        _words(axes, picture)
        _errors(below, picture)
        axes.legend(
            loc='lower left', bbox_to_anchor=(-0.008, 1.0), ncols=5, frameon=False, fontsize=9.5,
            handlelength=2.2, columnspacing=1.1, handletextpad=0.5, borderaxespad=0.2,
        )  # fmt: skip
        return figure


def _frames(axes: Axes, below: Axes, picture: AmplitudePicture) -> None:
    both = np.concatenate([picture.exact, picture.averaged])
    top = float(np.nanmax(both, initial=0.0)) * 1e3 or 1.0
    for each in (axes, below):
        each.set_xlim(_lowest(picture), float(picture.x[-1]))
    axes.set_ylim(-_BELOW_ZERO * top, _HEADROOM * top)
    axes.tick_params(labelbottom=False)
    axes.set_ylabel('amplitude [mm]')
    below.set_xlabel(picture.x_label)
    below.set_ylabel('KBM error [%]')
    axes.yaxis.set_label_coords(-0.065, 0.5)
    below.yaxis.set_label_coords(-0.065, 0.5)


def _lowest(picture: AmplitudePicture) -> float:
    low = float(picture.x[0])
    return 0.0 if low < _FROM_ZERO * picture.x[-1] else low


def _spans(picture: AmplitudePicture) -> list[tuple[float, float, Regime]]:
    """Where the parameter gives which regime, by its exact boundaries."""
    low, high = _lowest(picture), float(picture.x[-1])
    if picture.hopf < picture.exact_fold:
        edges, regimes = (low, picture.hopf, picture.exact_fold, high), _REGIMES
    else:
        edges, regimes = (low, picture.exact_fold, picture.hopf, high), _REGIMES[::-1]
    spans = zip(edges[:-1], edges[1:], regimes, strict=True)
    return [(a, b, regime) for a, b, regime in spans if b > a]


def _bands(axes: Axes, below: Axes, picture: AmplitudePicture) -> None:
    for low, high, regime in _spans(picture):
        for each in (axes, below):
            each.axvspan(low, high, color=REGIME_FILL[regime], lw=0.0, zorder=0)
        line = DASHES if regime is Regime.UNSTABLE else '-'
        axes.plot((low, high), (0.0, 0.0), color=SLIDING, ls=line, lw=2.4, zorder=3)


def _branches(axes: Axes, picture: AmplitudePicture) -> None:
    looks: tuple[tuple[FloatArray, str, dict[str, Any]], ...] = (
        (picture.exact, 'exact, stable', {'color': EXACT, 'lw': 3.0, 'zorder': 4}),
        (
            picture.exact_unstable,
            'exact, unstable',
            {'color': EXACT, 'lw': 3.0, 'ls': (0, (2.6, 1.3)), 'zorder': 4},
        ),
        (picture.averaged, 'KBM, stable', {'color': INK, 'lw': 1.3, 'zorder': 5}),
        (
            picture.averaged_unstable,
            'KBM, unstable',
            {'color': INK, 'lw': 1.3, 'ls': DASHES, 'zorder': 5},
        ),
    )
    for y, name, look in looks:
        axes.plot(picture.x, np.asarray(y) * 1e3, label=name, **look)
    if picture.reverse.size:
        axes.plot(
            picture.reverse_x, picture.reverse * 1e3, 's', ms=6.5, mfc=PAPER, mec=SLIDING,
            mew=1.6, zorder=6, label='unstable, reverse time',
        )  # fmt: skip


def _marks(axes: Axes, picture: AmplitudePicture) -> None:
    look: dict[str, Any] = {'ms': 7.5, 'mew': 1.4, 'zorder': 7, 'clip_on': False}
    axes.plot(picture.hopf, 0.0, 'o', mec=HOPF, mfc=PAPER, **look)
    axes.plot(picture.exact_fold, picture.fold_amplitude * 1e3, 'D', mec=FOLD, mfc=FOLD, **look)


def _words(axes: Axes, picture: AmplitudePicture) -> None:
    labels = Labeller(axes)
    curves = (
        picture.exact, picture.exact_unstable, picture.averaged, picture.averaged_unstable,
        np.zeros_like(picture.x),
    )  # fmt: skip
    for y in curves:
        labels.avoid(picture.x, np.asarray(y) * 1e3)
    for x, y in zip(picture.reverse_x, picture.reverse * 1e3, strict=True):
        labels.reserve(x, y)
    _regime_words(labels, picture)
    fold = (picture.exact_fold, picture.fold_amplitude * 1e3)
    leftwards = picture.hopf < picture.exact_fold
    marks = (
        (
            f'Hopf {picture.hopf:.4g}{picture.unit}',
            (picture.hopf, 0.0),
            (1, 4, 0) if leftwards else (0, 4, 1),
        ),
        (_fold_words(picture), fold, (2, 1, 3, 6, 0)),
    )
    for _, at, _ in marks:
        labels.reserve(*at)
    for text, at, order in marks:
        places = [around(d)[k] for d in (9.0, 30.0, 48.0, 66.0, 90.0) for k in order]
        labels.point(text, at, places, weight='bold', size=10.5, zorder=13)
    labels.along(
        'steady sliding', picture.x, np.zeros_like(picture.x), fractions=_SLIDING_AT, size=10.0
    )


def _fold_words(picture: AmplitudePicture) -> str:
    error = 100.0 * (picture.averaged_fold / picture.exact_fold - 1.0)
    return f'fold {picture.exact_fold:.4g}{picture.unit}\n(KBM {error:+.2g} %)'


def _regime_words(labels: Labeller, picture: AmplitudePicture) -> None:
    axes = labels.axes
    top = axes.get_ylim()[1]
    for low, high, regime in _spans(picture):
        left, right = axes.transData.transform([(low, 0.0), (high, 0.0)])[:, 0]
        if right - left > _NARROWEST:
            middle = (0.5 * (low + high), top)
            place = (LabelPlace(0.0, -5.0, 'center', 'top'),)
            labels.point(regime.value, middle, place, style='italic')


def _errors(below: Axes, picture: AmplitudePicture) -> None:
    with np.errstate(divide='ignore', invalid='ignore'):
        stable = 100.0 * (picture.averaged / picture.exact - 1.0)
        unstable = 100.0 * (picture.averaged_unstable / picture.exact_unstable - 1.0)
    below.axhline(0.0, color=MUTED, lw=0.8, zorder=2)
    below.plot(picture.x, stable, color=INK, lw=1.8, zorder=4)
    below.plot(picture.x, unstable, color=INK, lw=1.8, ls=DASHES, zorder=4)
    lowest = float(np.nanmin(np.concatenate([stable, unstable]), initial=-0.1))
    shown = max(1.08 * lowest, _WORST_SHOWN)
    below.set_ylim(shown, -0.16 * shown)
