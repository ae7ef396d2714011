# SPDX-License-Identifier: Apache-2.0
"""The verdict of the averaged model on an operating point: regime, margins, amplitudes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.monitor.columns import (
    AT_REST,
    AVERAGED,
    BISTABLE,
    NO_BOUNDARY,
    NO_CONTACT,
    NO_CYCLE,
    NOT_FINITE,
    STICK_SLIP,
    Points,
    column,
    margin,
    margin_of_number,
)
from stickslip_monitor.monitor.outcome import (
    OUTCOMES,
    REGIME_OF_OUTCOME,
    REGIMES,
    Outcome,
    Regime,
)
from stickslip_monitor.physics.arrays import flatten, in_blocks, restore
from stickslip_monitor.physics.bifurcation import damping_per_load, kbm
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.oscillator import Bearing

__all__ = ['COLUMNS', 'OUTCOMES', 'REGIMES', 'Assessment', 'Outcome', 'Regime', 'assess', 'margin']

_REGIME_NAMES = np.array([regime.value for regime in REGIMES])
_OUTCOME_NAMES = np.array([outcome.value for outcome in OUTCOMES])
_REGIME_CODES = np.array([REGIMES.index(regime) for regime in REGIME_OF_OUTCOME], np.int8)
COLUMNS = ('speed', 'load', 'outcome_code', 'hopf_speed', 'fold_speed', *AVERAGED)
"""The names of what averaging says of every operating point."""


@dataclass(frozen=True, slots=True)
class Assessment:
    """First-order KBM's verdict on operating points; everything has the inputs' shape.

    What a verdict rests on is stored; the rest is worked out when it is first asked for.

    Attributes:
        speed: Journal surface speed as given, negative astern [m/s].
        load: Bearing load as given [N].
        outcome_code: Index into :data:`OUTCOMES`.
        hopf_speed: Highest unstable speed at this load [m/s]; ``nan`` without one.
        fold_speed: Highest speed with a stick-slip cycle at this load [m/s]; ``nan`` without one.
    """

    speed: Any
    load: Any
    outcome_code: Any
    hopf_speed: Any
    fold_speed: Any
    _bearing: Bearing = field(repr=False, compare=False)
    _points: Points | None = field(default=None, repr=False, compare=False)
    _known: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def _column(self, name: str) -> Any:
        value = self._known.get(name)
        if value is None:
            value = self._known[name] = self._work_out(name)
        return value

    def _work_out(self, name: str) -> Any:
        points = self._points
        if points is None:
            stored = self.speed, self.load, self.outcome_code, self.hopf_speed, self.fold_speed
            points = Points(*(np.asarray(column).reshape(-1) for column in stored))
        shape = () if isinstance(self.outcome_code, int) else self.outcome_code.shape
        return restore(column(name, self._bearing, points), shape)

    @property
    def hopf_margin(self) -> Any:
        """``|V|/V_H - 1`` [-]; negative inside, ``inf`` where there is no Hopf speed."""
        if isinstance(self.outcome_code, int):
            return margin_of_number(self.speed, self.hopf_speed, self.outcome_code)
        return self._column('hopf_margin')

    @property
    def fold_margin(self) -> Any:
        """``|V|/V_F - 1`` [-]; negative inside, ``inf`` where there is no fold."""
        if isinstance(self.outcome_code, int):
            return margin_of_number(self.speed, self.fold_speed, self.outcome_code)
        return self._column('fold_margin')

    @property
    def hopf_load(self) -> Any:
        """Load at which this speed turns unstable [N]; ``nan`` without one."""
        return self._column('hopf_load')

    @property
    def fold_load(self) -> Any:
        """Load from which a stick-slip cycle exists at this speed [N]; ``nan`` without."""
        return self._column('fold_load')

    @property
    def growth_rate(self) -> Any:
        """Growth rate of a small disturbance of steady sliding [1/s]."""
        return self._column('growth_rate')

    @property
    def amplitude(self) -> Any:
        """Displacement amplitude of the stick-slip cycle [m]; ``nan`` where none exists."""
        return self._column('amplitude')

    @property
    def threshold_amplitude(self) -> Any:
        """Amplitude of the unstable cycle [m].

        In the bistable range a larger disturbance starts stick-slip; ``nan`` elsewhere.
        """
        return self._column('threshold_amplitude')

    @property
    def amplitude_exact(self) -> Any:
        """Displacement amplitude of the exact stick-slip cycle, to 1e-6 [m]; ``nan`` for none.

        See :func:`stickslip_monitor.physics.cycle_surface.exact_amplitude`.
        """
        return self._column('amplitude_exact')

    @property
    def amplitude_error(self) -> Any:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]."""
        return np.divide(self.amplitude, self.amplitude_exact) - 1.0

    @property
    def outcome(self) -> Any:
        """The :class:`Outcome`, or an array of outcome names."""
        if isinstance(self.outcome_code, int):
            return OUTCOMES[self.outcome_code]
        return _OUTCOME_NAMES[self.outcome_code]

    @property
    def regime_code(self) -> Any:
        """Index into :data:`REGIMES`, of the inputs' shape."""
        code = _REGIME_CODES[self.outcome_code]
        return int(code) if isinstance(self.outcome_code, int) else code

    @property
    def regime(self) -> Any:
        """The :class:`Regime`, or an array of regime names."""
        if isinstance(self.outcome_code, int):
            return REGIME_OF_OUTCOME[self.outcome_code]
        return _REGIME_NAMES[self.regime_code]


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
    with np.errstate(all='ignore'):
        columns = in_blocks(partial(_judge, bearing), v, n)
    points = Points(v, n, *columns)
    v, n, code, hopf, fold = (restore(column, shape) for column in points)
    return Assessment(v, n, code, hopf, fold, bearing, points)


def _judge(bearing: Bearing, speed: Array, load: Array) -> tuple[NDArray[Any], ...]:
    """Outcome, Hopf and fold speed of flat arrays."""
    law, solver = bearing.friction, kbm(bearing.friction)
    magnitude = np.abs(speed)
    size = magnitude * load
    ordinary = bool(((size > 0.0) & (size < np.inf)).all())
    q = bearing.damping / load if ordinary else damping_per_load(bearing, load)
    hopf, fold = solver.boundaries(law, q)
    code = np.where(fold != fold, NO_BOUNDARY, NO_CYCLE)
    code = np.where(solver.has_cycle(law, magnitude, q, fold), BISTABLE, code)
    code = np.where(solver.equilibrium_is_unstable(law, magnitude, q, hopf), STICK_SLIP, code)
    if ordinary:
        return code, hopf, fold
    # 0, or nan where an input is not finite.
    missing = (speed - speed) + (load - load)
    code = np.where(load <= 0.0, NO_CONTACT, code)
    code = np.where(magnitude == 0.0, AT_REST, code)
    code = np.where(missing == 0.0, code, NOT_FINITE)
    return code, hopf + missing, fold + missing
