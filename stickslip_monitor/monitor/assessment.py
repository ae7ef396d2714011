# SPDX-License-Identifier: Apache-2.0
"""The verdict of the averaged model on an operating point: regime, margins, amplitudes."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.physics.arrays import flatten, restore
from stickslip_monitor.physics.bifurcation import (
    damping_per_load,
    fold_load,
    growth_rate,
    hopf_load,
    kbm,
)
from stickslip_monitor.physics.cycle_surface import exact_amplitude
from stickslip_monitor.physics.oscillator import Bearing

FloatArray = NDArray[np.float64]


class Regime(str, Enum):
    """What can happen at an operating point, in rising order of trouble."""

    STABLE = 'stable'
    BISTABLE = 'bistable'
    UNSTABLE = 'unstable'
    UNDETERMINED = 'undetermined'

    def __str__(self) -> str:
        return self.value


class Outcome(str, Enum):
    """Why an assessment says what it says; each member carries its sentence."""

    sentence: str

    def __new__(cls, name: str, sentence: str) -> Outcome:
        """Make a member from its name and its sentence."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.sentence = sentence
        return member

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

    def __str__(self) -> str:
        return self.value


REGIMES = tuple(Regime)
OUTCOMES = tuple(Outcome)
_REGIME_NAMES = np.array([regime.value for regime in REGIMES])
_OUTCOME_NAMES = np.array([outcome.value for outcome in OUTCOMES])
_REGIME_OF_OUTCOME = np.array(
    [
        REGIMES.index(regime)
        for regime in (
            Regime.STABLE,
            Regime.BISTABLE,
            Regime.UNSTABLE,
            Regime.STABLE,
            Regime.STABLE,
            Regime.UNDETERMINED,
            Regime.UNDETERMINED,
        )
    ],
    dtype=np.int8,
)


@dataclass(frozen=True, slots=True)
class Assessment:
    """First-order KBM's verdict on operating points; every field has the inputs' shape.

    Attributes:
        speed: Journal surface speed as given, negative astern [m/s].
        load: Bearing load as given [N].
        outcome_code: Index into :data:`OUTCOMES`.
        hopf_speed: Highest unstable speed at this load [m/s]; ``nan`` without one.
        fold_speed: Highest speed with a stick-slip cycle at this load [m/s]; ``nan`` without one.
        hopf_margin: ``|V|/V_H - 1`` [-]; negative inside, ``inf`` where there is no Hopf speed.
        fold_margin: ``|V|/V_F - 1`` [-]; negative inside, ``inf`` where there is no fold.
        hopf_load: Load at which this speed turns unstable [N]; ``nan`` without one.
        fold_load: Load from which a stick-slip cycle exists at this speed [N]; ``nan`` without.
        growth_rate: Growth rate of a small disturbance of steady sliding [1/s].
        amplitude: Displacement amplitude of the stick-slip cycle [m]; ``nan`` where none exists.
        threshold_amplitude: Amplitude of the unstable cycle [m]: in the bistable range a larger
            disturbance starts stick-slip; ``nan`` elsewhere.

    What the averaged model leaves out is told by ``amplitude_exact`` and ``amplitude_error``,
    which are computed when they are asked for.
    """

    speed: Any
    load: Any
    outcome_code: Any
    hopf_speed: Any
    fold_speed: Any
    hopf_margin: Any
    fold_margin: Any
    hopf_load: Any
    fold_load: Any
    growth_rate: Any
    amplitude: Any
    threshold_amplitude: Any
    _bearing: Bearing = field(repr=False, compare=False)

    @property
    def outcome(self) -> Any:
        """The :class:`Outcome`, or an array of outcome names."""
        if isinstance(self.outcome_code, int):
            return OUTCOMES[self.outcome_code]
        return _OUTCOME_NAMES[self.outcome_code]

    @property
    def amplitude_exact(self) -> Any:
        """Displacement amplitude of the exact stick-slip cycle, to 1e-6 [m]; ``nan`` for none.

        See :func:`stickslip_monitor.physics.cycle_surface.exact_amplitude`.
        """
        shape, (speed, load, fold) = flatten(self.speed, self.load, self.fold_speed)
        return restore(exact_amplitude(self._bearing, speed, load, fold), shape)

    @property
    def amplitude_error(self) -> Any:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]."""
        return np.divide(self.amplitude, self.amplitude_exact) - 1.0

    @property
    def regime_code(self) -> Any:
        """Index into :data:`REGIMES`, of the inputs' shape."""
        code = _REGIME_OF_OUTCOME[self.outcome_code]
        return int(code) if isinstance(self.outcome_code, int) else code

    @property
    def regime(self) -> Any:
        """The :class:`Regime`, or an array of regime names."""
        if isinstance(self.outcome_code, int):
            return REGIMES[self.regime_code]
        return _REGIME_NAMES[self.regime_code]


COLUMNS = tuple(column.name for column in fields(Assessment) if column.compare)
"""The names of what is stored for every operating point."""


def assess(bearing: Bearing, speed: ArrayLike, load: ArrayLike) -> Assessment:
    """Assess operating points of a bearing by first-order KBM averaging.

    Args:
        bearing: The bearing.
        speed: Journal surface speed ``V`` [m/s]; negative astern.
        load: Bearing load ``N`` [N]; broadcasts with ``speed``.

    Returns:
        The assessment, of scalars for scalar inputs, else of arrays of the broadcast shape. It
        never raises for a number: an input that is not finite has its own outcome.
    """
    shape, (v, n) = flatten(speed, load)
    law = bearing.friction
    solver = kbm(law)
    finite = np.isfinite(v) & np.isfinite(n)
    magnitude = np.abs(np.where(finite, v, 0.0))
    pressing = np.where(finite, n, 0.0)
    q = damping_per_load(bearing, pressing)
    hopf, fold = solver.hopf_speed(law, q), solver.fold_speed(law, q)
    unstable = solver.equilibrium_is_unstable(law, magnitude, q, hopf)

    sliding = finite & (magnitude > 0.0)
    threshold, amplitude = np.full(v.shape, np.nan), np.full(v.shape, np.nan)
    threshold[sliding], amplitude[sliding] = (
        a / bearing.natural_frequency
        for a in solver.amplitudes(law, magnitude[sliding], q[sliding], fold[sliding])
    )
    has_cycle = ~np.isnan(amplitude)
    code = np.select(
        [~finite, magnitude == 0.0, pressing <= 0.0, unstable, has_cycle, np.isnan(fold)],
        [
            OUTCOMES.index(outcome)
            for outcome in (
                Outcome.NOT_FINITE,
                Outcome.AT_REST,
                Outcome.NO_CONTACT,
                Outcome.STICK_SLIP,
                Outcome.BISTABLE,
                Outcome.NO_BOUNDARY,
            )
        ],
        OUTCOMES.index(Outcome.NO_CYCLE),
    ).astype(np.int8)

    missing = np.where(finite, 0.0, np.nan)
    columns = {
        'speed': v,
        'load': n,
        'outcome_code': code,
        'hopf_speed': hopf + missing,
        'fold_speed': fold + missing,
        'hopf_margin': margin(magnitude, hopf) + missing,
        'fold_margin': margin(magnitude, fold) + missing,
        'hopf_load': np.atleast_1d(hopf_load(bearing, magnitude)) + missing,
        'fold_load': np.atleast_1d(fold_load(bearing, magnitude)) + missing,
        'growth_rate': np.atleast_1d(growth_rate(bearing, magnitude, pressing)) + missing,
        'amplitude': amplitude,
        'threshold_amplitude': threshold,
    }
    restored = {name: restore(column, shape) for name, column in columns.items()}
    return Assessment(**restored, _bearing=bearing)


def margin(speed: FloatArray, boundary: FloatArray) -> FloatArray:
    """``V/V_b - 1``, with the sign of ``V - V_b`` to the last bit.

    Args:
        speed: ``V`` >= 0, shape (n,) [m/s].
        boundary: Hopf or fold speed, shape (n,) [m/s]; ``nan`` without one, ``inf`` where there is
            no end to it.
    """
    bounded = np.isfinite(boundary)
    safe = np.where(bounded, boundary, 1.0)
    unbounded = np.where(np.isnan(boundary), np.inf, -1.0)
    with np.errstate(over='ignore'):
        return np.where(bounded, (speed - safe) / safe, unbounded)
