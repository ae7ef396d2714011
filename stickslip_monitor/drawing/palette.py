# SPDX-License-Identifier: Apache-2.0
"""The colours of regimes and conditions, for pictures and dashboards alike.

The hues are those of Okabe and Ito, which people with any common colour blindness can tell apart;
caution is a dark yellow, because green means that all is well (IEC 60073).
Fills get darker from stable to unstable, so that they keep their order in a grey print.
"""

from __future__ import annotations

from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.ladder import Condition

INK = '#222222'
MUTED = '#595959'
PAPER = '#ffffff'

REGIME_COLOUR = {
    Regime.STABLE: '#0072b2',
    Regime.BISTABLE: '#e69f00',
    Regime.UNSTABLE: '#d55e00',
    Regime.UNDETERMINED: '#8c8c8c',
}
"""Strong colours, for lines, marks and words on white."""

HOPF, FOLD = '#9c3d00', '#7a5400'
"""The two boundaries, as lines on any of the fills; the fold is dashed (:data:`DASHES`)."""

DASHES = (0, (4.5, 2.2))

REGIME_FILL = {
    Regime.STABLE: '#eff6fb',
    Regime.BISTABLE: '#fcedc4',
    Regime.UNSTABLE: '#f6cdb8',
    Regime.UNDETERMINED: '#d9d9d9',
}
"""Light colours, for areas behind lines and dark text."""

CAUTION_FILL = '#faf7d6'
"""The stable stretch next to the fold in which the alarm says caution."""

CONDITION_COLOUR = {
    Condition.NORMAL: '#0072b2',
    Condition.VIBRATION: '#6b4fb3',
    Condition.CAUTION: '#a08c00',
    Condition.BISTABLE: '#e69f00',
    Condition.STICK_SLIP: '#d55e00',
    Condition.AMPLITUDE: '#7a1f5c',
    Condition.INPUT_STALE: '#595959',
}
"""Strong colours, for marks on any of the fills."""

CONDITION_NAMES = {
    Condition.NORMAL: 'Normal',
    Condition.VIBRATION: 'Vibration not explained',
    Condition.CAUTION: 'Margin low',
    Condition.BISTABLE: 'Bistable',
    Condition.STICK_SLIP: 'Stick-slip predicted',
    Condition.AMPLITUDE: 'Amplitude above limit',
    Condition.INPUT_STALE: 'Input lost',
}
"""Each condition as people read it, everywhere (docs/glossary.md)."""

ON_DARK = {
    PAPER: '#16191d',
    INK: '#e8eaed',
    MUTED: '#a9b0b8',
    '#0072b2': '#56b4e9',
    '#a08c00': '#e0cc3f',
    '#e69f00': '#f0b429',
    '#d55e00': '#ff8f4d',
    '#7a1f5c': '#e58fc6',
    '#6b4fb3': '#b9a5f2',
    '#8c8c8c': '#9aa0a6',
    HOPF: '#ffb08a',
    FOLD: '#ffd97a',
    '#eff6fb': '#16212b',
    CAUTION_FILL: '#2e2c10',
    '#fcedc4': '#4a3b12',
    '#f6cdb8': '#5a2a17',
    '#d9d9d9': '#33373c',
}
"""What each colour above becomes on a dark page; there the fills get lighter with trouble."""
