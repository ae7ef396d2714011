# SPDX-License-Identifier: Apache-2.0
"""Words that the monitor speaks in: names with the sentence that explains each.

The words of a verdict: regime and outcome.

The columns of an assessment that are worked out when they are asked for.

The verdict of the averaged model on an operating point: regime, margins, amplitudes.

Taking single operating points out of an assessment of arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, flatten, in_blocks, restore
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.averaging.boundaries import averaged_solver, damping_per_load
from stickslip_monitor.physics.belief import Belief, probability_runs
from stickslip_monitor.physics.cycle.fold import fold_curve
from stickslip_monitor.physics.cycle.surface import exact_amplitude
from stickslip_monitor.physics.oscillator import Bearing

_SentenceEnum = TypeVar('_SentenceEnum', bound='SentenceEnum')


class SentenceEnum(str, Enum):
    """A name; each member carries its sentence."""

    sentence: str

    def __new__(cls: type[_SentenceEnum], name: str, sentence: str) -> _SentenceEnum:
        """Make a member from its name and its sentence."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.sentence = sentence
        return member

    def __str__(self) -> str:
        return str(self.value)


class Regime(str, Enum):
    """What can happen at an operating point, in rising order of trouble."""

    STABLE = 'stable'
    BISTABLE = 'bistable'
    UNSTABLE = 'unstable'
    UNDETERMINED = 'undetermined'

    def __str__(self) -> str:
        return self.value


class Outcome(SentenceEnum):
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

NO_CYCLE, BISTABLE, STICK_SLIP, NO_BOUNDARY, NO_CONTACT, AT_REST, NOT_FINITE = (
    np.int8(OUTCOMES.index(outcome))
    for outcome in (
        Outcome.NO_CYCLE,
        Outcome.BISTABLE,
        Outcome.STICK_SLIP,
        Outcome.NO_BOUNDARY,
        Outcome.NO_CONTACT,
        Outcome.AT_REST,
        Outcome.NOT_FINITE,
    )
)


class Points(NamedTuple):
    """What an assessment stores, each of shape (n,)."""

    speed: FloatArray
    load: FloatArray
    code: NDArray[np.int8]
    hopf: FloatArray
    fold: FloatArray
    exact_fold: FloatArray


def column(name: str, bearing: Bearing, points: Points) -> FloatArray:
    """A column of :data:`ON_DEMAND` of some operating points, shape (n,)."""
    if name == 'amplitude_exact':
        return exact_amplitude(bearing, points.speed, points.load, points.fold)

    def part(*columns: NDArray[Any]) -> tuple[FloatArray]:
        return (_AVERAGED[name](bearing, Points(*columns)),)

    with np.errstate(all='ignore'):
        (result,) = in_blocks(part, *points)
    return result


def margin(speed: FloatArray, boundary: FloatArray) -> FloatArray:
    """``V/V_b - 1``, with the sign of ``V - V_b`` to the last bit.

    Args:
        speed: ``V`` >= 0, shape (n,) [m/s].
        boundary: Hopf or fold speed, shape (n,) [m/s]; ``nan`` without one, ``inf`` where there is
            no end to it.
    """
    value = (speed - boundary) / boundary
    unbounded = value != value
    if unbounded.any():
        value = np.where(unbounded, np.where(boundary == np.inf, -1.0, np.inf), value)
    return value


def margin_of_number(speed: float, boundary: float, code: int) -> float:
    """The margin of an operating point: the same operations in Python."""
    if 0.0 < boundary < math.inf:
        return (abs(speed) - boundary) / boundary
    if code == NOT_FINITE:
        return math.nan
    return -1.0 if boundary == math.inf else math.inf


def _margin(points: Points, boundary: FloatArray) -> FloatArray:
    return np.where(points.code == NOT_FINITE, np.nan, margin(np.abs(points.speed), boundary))


def _hopf_load(bearing: Bearing, points: Points) -> FloatArray:
    load: FloatArray = boundaries.hopf_load(bearing, points.speed)
    return load + (points.load - points.load)


def _fold_load(bearing: Bearing, points: Points) -> FloatArray:
    load: FloatArray = boundaries.fold_load(bearing, points.speed)
    return load + (points.load - points.load)


def _growth_rate(bearing: Bearing, points: Points) -> FloatArray:
    rate: FloatArray = boundaries.growth_rate(bearing, points.speed, points.load)
    return rate


def _amplitude(bearing: Bearing, points: Points) -> FloatArray:
    inside = (points.code == BISTABLE) | (points.code == STICK_SLIP)
    # Where only the exact model has a cycle averaging has no amplitude.
    inside &= np.abs(points.speed) < points.fold
    return _only(inside, boundaries.stable_amplitude, bearing, points)


def _threshold(bearing: Bearing, points: Points) -> FloatArray:
    inside = (points.code == BISTABLE) & (np.abs(points.speed) < points.fold)
    return _only(inside, boundaries.threshold_amplitude, bearing, points)


def _only(
    where: NDArray[np.bool_],
    function: Callable[[Bearing, FloatArray, FloatArray], FloatArray],
    bearing: Bearing,
    points: Points,
) -> FloatArray:
    """A function of speed and load at some points, ``nan`` elsewhere."""
    rows = np.flatnonzero(where)
    if 0 < rows.size == where.size:
        return function(bearing, np.abs(points.speed), points.load)
    result = np.full(where.shape, np.nan)
    if rows.size:
        result[rows] = function(bearing, np.abs(points.speed[rows]), points.load[rows])
    return result


_AVERAGED: dict[str, Callable[[Bearing, Points], FloatArray]] = {
    'hopf_margin': lambda _, points: _margin(points, points.hopf),
    'fold_margin': lambda _, points: _margin(points, points.fold),
    'exact_fold_margin': lambda _, points: _margin(points, points.exact_fold),
    'stability_margin': lambda _, points: _margin(points, np.fmax(points.fold, points.exact_fold)),
    'hopf_load': _hopf_load,
    'fold_load': _fold_load,
    'growth_rate': _growth_rate,
    'amplitude': _amplitude,
    'threshold_amplitude': _threshold,
}
AVERAGED = tuple(_AVERAGED)
"""Those that averaging gives, in order."""

__all__ = ['COLUMNS', 'OUTCOMES', 'REGIMES', 'Assessment', 'Outcome', 'Regime', 'assess', 'margin']

_REGIME_NAMES = np.array([regime.value for regime in REGIMES])
_OUTCOME_NAMES = np.array([outcome.value for outcome in OUTCOMES])
_REGIME_CODES = np.array([REGIMES.index(regime) for regime in REGIME_OF_OUTCOME], np.int8)
COLUMNS = (
    'speed',
    'load',
    'outcome_code',
    'hopf_speed',
    'fold_speed',
    'exact_fold_speed',
    *AVERAGED,
)
"""The names of what is told of every operating point."""

BELIEFS = (
    'probability_can',
    'probability_will',
    'probability_runs',
    'fold_margin_low',
    'fold_margin_high',
)
"""What tolerances or a calibration add to an assessment; ``nan`` without them."""


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
        exact_fold_speed: The same of the exact model, which does not average.
    """

    speed: Any
    load: Any
    outcome_code: Any
    hopf_speed: Any
    fold_speed: Any
    exact_fold_speed: Any
    _bearing: Bearing = field(repr=False, compare=False)
    _points: Points | None = field(default=None, repr=False, compare=False)
    _known: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    _belief: Belief | None = field(default=None, repr=False, compare=False)

    def _column(self, name: str) -> Any:
        value = self._known.get(name)
        if value is None:
            value = self._known[name] = self._work_out(name)
        return value

    def _work_out(self, name: str) -> Any:
        points = self._points
        if points is None:
            stored = (
                self.speed,
                self.load,
                self.outcome_code,
                self.hopf_speed,
                self.fold_speed,
                self.exact_fold_speed,
            )
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
    def exact_fold_margin(self) -> Any:
        """``|V|/V_F - 1`` [-] with the exact fold speed; negative inside, ``inf`` without one."""
        if isinstance(self.outcome_code, int):
            return margin_of_number(self.speed, self.exact_fold_speed, self.outcome_code)
        return self._column('exact_fold_margin')

    @property
    def stability_limit(self) -> Any:
        """The higher of the two fold speeds [m/s]; ``nan`` without either."""
        if isinstance(self.outcome_code, int):
            # A speed that does not exist is less than any.
            fold, exact = self.fold_speed, self.exact_fold_speed
            return exact if exact > fold or fold != fold else fold
        return np.fmax(self.fold_speed, self.exact_fold_speed)

    @property
    def stability_margin(self) -> Any:
        """The smaller of the two fold margins [-], which decides.

        Not negative only where neither the averaged nor the exact model has a cycle.
        """
        if isinstance(self.outcome_code, int):
            # A margin that does not exist is infinite in both.
            return min(self.fold_margin, self.exact_fold_margin)
        return self._column('stability_margin')

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

        See :func:`stickslip_monitor.physics.cycle.surface.exact_amplitude`.
        """
        return self._column('amplitude_exact')

    @property
    def amplitude_error(self) -> Any:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]."""
        return np.divide(self.amplitude, self.amplitude_exact) - 1.0

    @property
    def has_belief(self) -> bool:
        """Whether tolerances or a calibration make probabilities."""
        return self._belief is not None

    @property
    def probability_can(self) -> Any:
        """Probability that a stick-slip cycle exists; ``nan`` without a belief, as all below."""
        return self._believed('probability_can')

    @property
    def probability_will(self) -> Any:
        """Probability that stick-slip starts by itself."""
        return self._believed('probability_will')

    @property
    def probability_runs(self) -> Any:
        """Probability that stick-slip runs, with the memory of the bistable range."""
        return self._believed('probability_runs')

    @property
    def fold_margin_low(self) -> Any:
        """5 % quantile of the fold margin [-]."""
        return self._believed('fold_margin_low')

    @property
    def fold_margin_high(self) -> Any:
        """95 % quantile of the fold margin [-]."""
        return self._believed('fold_margin_high')

    def remember_runs(self, before: float) -> float:
        """Work out the probability that stick-slip runs.

        Args:
            before: That before this point, or before the first of the points.

        Returns:
            That after the last.
        """
        if self._belief is None:
            return before
        can, will = (np.atleast_1d(x) for x in (self.probability_can, self.probability_will))
        runs = probability_runs(can, will, before)
        scalar = isinstance(self.outcome_code, int)
        self._known['probability_runs'] = runs.item() if scalar else runs
        return float(runs[-1]) if runs.size else before

    def _believed(self, name: str) -> Any:
        if name not in self._known:
            self._known[name] = self._of_belief(name)
        return self._known[name]

    def _of_belief(self, name: str) -> Any:
        if self._belief is None:
            return np.multiply(self.speed, np.nan)[()]
        if name == 'probability_runs':  # without a memory it is what starts by itself
            return self.probability_will
        margins = name.startswith('fold')
        ask = self._belief.fold_margins if margins else self._belief.probabilities
        names = BELIEFS[3:] if margins else BELIEFS[:2]
        self._known.update(zip(names, ask(self.speed, self.load), strict=True))
        return self._known[name]

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


def assess(
    bearing: Bearing, speed: ArrayLike, load: ArrayLike, belief: Belief | None = None
) -> Assessment:
    """Assess operating points of a bearing by first-order KBM averaging and the exact fold.

    Args:
        bearing: The bearing.
        speed: Journal surface speed ``V`` [m/s]; negative astern.
        load: Bearing load ``N`` [N]; broadcasts with ``speed``.
        belief: What makes probabilities of them, if anything does.

    Returns:
        The assessment, of scalars for scalar inputs, else of arrays of the broadcast shape. It
        never raises for a number: an input that is not finite has its own outcome.
    """
    shape, (v, n) = flatten(speed, load)
    with np.errstate(all='ignore'):
        columns = in_blocks(partial(_judge, bearing), v, n)
    points = Points(v, n, *columns)
    v, n, code, hopf, fold, exact = (restore(column, shape) for column in points)
    return Assessment(v, n, code, hopf, fold, exact, bearing, points, _belief=belief)


def _judge(bearing: Bearing, speed: FloatArray, load: FloatArray) -> tuple[NDArray[Any], ...]:
    """Outcome, Hopf speed and both fold speeds of flat arrays."""
    law, solver = bearing.friction, averaged_solver(bearing.friction)
    magnitude = np.abs(speed)
    size = magnitude * load
    ordinary = bool(((size > 0.0) & (size < np.inf)).all())
    q = bearing.damping / load if ordinary else damping_per_load(bearing, load)
    hopf, fold = solver.boundaries(law, q)
    curve = fold_curve(bearing)
    exact = curve.speed(load, fold)
    code = np.where((fold != fold) & (exact != exact), NO_BOUNDARY, NO_CYCLE)
    averaged = solver.has_cycle(law, magnitude, q, fold)
    code = np.where(curve.has_cycle(magnitude, load, fold, exact, averaged), BISTABLE, code)
    code = np.where(solver.equilibrium_is_unstable(law, magnitude, q, hopf), STICK_SLIP, code)
    if ordinary:
        return code, hopf, fold, exact
    # 0, or nan where an input is not finite.
    missing = (speed - speed) + (load - load)
    code = np.where(load <= 0.0, NO_CONTACT, code)
    code = np.where(magnitude == 0.0, AT_REST, code)
    code = np.where(missing == 0.0, code, NOT_FINITE)
    return code, hopf + missing, fold + missing, exact + missing


def at_indices(points: Assessment, rows: NDArray[np.intp]) -> Assessment:
    """The assessment of arrays at some indices of a one-dimensional assessment."""
    return _picked(points, lambda column: column[rows])


def at_index(points: Assessment, index: int) -> Assessment:
    """The assessment of scalars at an index of a one-dimensional assessment."""
    return _picked(points, lambda column: column[index].item())


def joined(points: Sequence[Assessment]) -> Assessment:
    """Assessments of scalars, at least one and all of one bearing, as one of arrays."""
    return Assessment(
        np.array([point.speed for point in points]),
        np.array([point.load for point in points]),
        np.array([point.outcome_code for point in points]),
        np.array([point.hopf_speed for point in points]),
        np.array([point.fold_speed for point in points]),
        np.array([point.exact_fold_speed for point in points]),
        points[0]._bearing,
        _known={name: np.array([getattr(p, name) for p in points]) for name in BELIEFS},
        _belief=points[0]._belief,
    )


def _picked(points: Assessment, pick: Callable[[NDArray[Any]], Any]) -> Assessment:
    return Assessment(
        pick(points.speed),
        pick(points.load),
        pick(points.outcome_code),
        pick(points.hopf_speed),
        pick(points.fold_speed),
        pick(points.exact_fold_speed),
        points._bearing,
        _known={name: pick(column) for name, column in points._known.items()},
        _belief=points._belief,
    )
