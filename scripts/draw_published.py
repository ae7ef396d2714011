# SPDX-License-Identifier: Apache-2.0
"""Draws docs/images/published_bstab.png: another group's verdicts on our boundaries and branches.

bSTAB (TU Hamburg, MATLAB, case_friction; its Python port is pyBasin) integrates a mass on a belt
from thousands of starting points at twenty speeds of the belt, and says where they end.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stickslip_monitor import (
    Bearing,
    Regime,
    Stribeck,
    exact_cycle,
    exact_fold_speed,
    exact_unstable_cycle,
    hopf_speed,
)
from stickslip_monitor.drawing.canvas import (
    DASHES,
    FOLD,
    HOPF,
    INK,
    REGIME_COLOUR,
    labelled,
    legend_above,
    regime_bands,
    save_figure,
    style,
)

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'images' / 'published_bstab.png'
# In its own units: mass and stiffness 1, damping ratio 0.05, load 1.
BLOCK = Bearing(1.0, 0.1, 1.0, Stribeck(1.0, 0.5, 2.0), journal_diameter=1.0)
SPEEDS = np.arange(0.5, 1.926, 0.075)
# Published: the first speed at which some starts end in steady sliding, and the last at which some
# end in the cycle. Which attractors there are is theirs; how large they are drawn is ours.
FIRST_REST, LAST_CYCLE = 1.175, 1.775


def main() -> None:
    """Draw the picture."""
    hopf, fold = float(hopf_speed(BLOCK, 1.0)), float(exact_fold_speed(BLOCK, 1.0))
    below, between = (np.linspace(0.45, fold * (1.0 - 1e-6), 400), np.linspace(hopf, fold, 200)[1:-1])
    with style():
        figure, axes = labelled('belt speed', 'amplitude', box=(0.085, 0.125, 0.89, 0.79))
        stable = exact_cycle(BLOCK, below, 1.0).amplitude
        unstable = exact_unstable_cycle(BLOCK, between, 1.0).amplitude
        axes.plot(below, stable, color=INK, lw=1.8, label='our stick-slip')
        axes.plot(between, unstable, color=INK, lw=1.4, ls=DASHES, label='our unstable cycle')
        axes.axvline(hopf, color=HOPF, lw=1.4, label=f'our Hopf speed {hopf:.3f}')
        axes.axvline(fold, color=FOLD, lw=1.4, ls=DASHES, label=f'our fold {fold:.3f}')
        cycling, resting = SPEEDS < LAST_CYCLE + 1e-9, SPEEDS > FIRST_REST - 1e-9
        for where, height, marker, regime, what in (
            (cycling, exact_cycle(BLOCK, SPEEDS, 1.0).amplitude, 'o', Regime.UNSTABLE, 'a cycle'),
            (resting, np.zeros(SPEEDS.size), 's', Regime.STABLE, 'steady sliding'),
        ):
            axes.plot(
                SPEEDS[where],
                height[where],
                marker,
                ms=6.0,
                color=REGIME_COLOUR[regime],
                label=f'bSTAB: some starts end in {what}',
                clip_on=False,
                zorder=10,
            )
        axes.set_xlim(0.45, 2.0)
        axes.set_ylim(0.0, 2.2)
        spans = (0.45, hopf, Regime.UNSTABLE), (hopf, fold, Regime.BISTABLE)
        regime_bands([axes], (*spans, (fold, 2.0, Regime.STABLE)))
        legend_above(axes, 3)
        save_figure(figure, PICTURE, force=True)


if __name__ == '__main__':
    main()
