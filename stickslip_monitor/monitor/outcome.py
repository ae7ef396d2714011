# SPDX-License-Identifier: Apache-2.0
"""The words of a verdict: regime and outcome."""

from __future__ import annotations

from enum import Enum

from stickslip_monitor.monitor.word import Word


class Regime(str, Enum):
    """What can happen at an operating point, in rising order of trouble."""

    STABLE = 'stable'
    BISTABLE = 'bistable'
    UNSTABLE = 'unstable'
    UNDETERMINED = 'undetermined'

    def __str__(self) -> str:
        return self.value


class Outcome(Word):
    """Why an assessment says what it says; each member carries its sentence."""

    NO_CYCLE = 'no_cycle', 'Beyond the fold: no stick-slip cycle exists at this speed and load.'
    BISTABLE = (
        'bistable',
        'Steady sliding and stick-slip are both stable: which one runs depends on the history.',
    )
    STICK_SLIP = 'stick_slip', 'Steady sliding is unstable: stick-slip starts by itself.'
    NO_BOUNDARY = (
        'no_boundary',
        'Friction does not fall fast enough with speed to overcome the damping at this load:'
        ' no speed has stick-slip.',
    )
    NO_CONTACT = 'no_contact', 'The bearing carries no load: there is no friction.'
    AT_REST = 'at_rest', 'The shaft is at rest: nothing slides.'
    NOT_FINITE = 'not_finite', 'Speed or load is not a finite number.'


REGIMES = tuple(Regime)
OUTCOMES = tuple(Outcome)
REGIME_OF_OUTCOME = (
    Regime.STABLE,
    Regime.BISTABLE,
    Regime.UNSTABLE,
    Regime.STABLE,
    Regime.STABLE,
    Regime.UNDETERMINED,
    Regime.UNDETERMINED,
)
"""The regime of each of :data:`OUTCOMES`."""
