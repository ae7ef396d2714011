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
from stickslip_monitor.drawing import canvas

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
    below = np.linspace(0.45, fold * (1.0 - 1e-6), 400)
    # It begins as a root: steps from the Hopf speed on are squares.
    between = hopf + (fold - hopf) * np.linspace(0.0, 1.0, 200)[1:-1] ** 2
    with canvas.style():
        figure, axes = canvas.new_panel('belt speed [-]', 'amplitude [-]', box=(0.085, 0.125, 0.89, 0.79))
        stable = exact_cycle(BLOCK, below, 1.0).amplitude
        unstable = exact_unstable_cycle(BLOCK, between, 1.0).amplitude
        axes.plot(below, stable, color=canvas.INK, lw=1.8, label='our stick-slip')
        axes.plot(between, unstable, color=canvas.INK, lw=1.4, ls=canvas.DASHES, label='our unstable cycle')
        axes.axvline(hopf, color=canvas.HOPF, lw=1.4, label=f'our Hopf speed {hopf:.3f}')
        axes.axvline(fold, color=canvas.FOLD, lw=1.4, ls=canvas.DASHES, label=f'our fold {fold:.3f}')
        cycling, resting = SPEEDS < LAST_CYCLE + 1e-9, SPEEDS > FIRST_REST - 1e-9
        for is_outcome, height, marker, regime, label in (
            (cycling, exact_cycle(BLOCK, SPEEDS, 1.0).amplitude, 'o', Regime.UNSTABLE, 'a cycle'),
            (resting, np.zeros(SPEEDS.size), 's', Regime.STABLE, 'steady sliding'),
        ):
            look: canvas.Look = {'ms': 6.0, 'color': canvas.REGIME_COLOUR[regime], 'zorder': 10}
            name = f'bSTAB: some starts end in {label}'
            axes.plot(SPEEDS[is_outcome], height[is_outcome], marker, label=name, clip_on=False, **look)
        axes.set_xlim(0.45, 2.0)
        axes.set_ylim(0.0, 2.2)
        spans = (0.45, hopf, Regime.UNSTABLE), (hopf, fold, Regime.BISTABLE)
        canvas.draw_regime_bands(axes, (*spans, (fold, 2.0, Regime.STABLE)))
        canvas.legend_above(axes, 3)
        canvas.save_figure(figure, PICTURE, force=True)


if __name__ == '__main__':
    main()
