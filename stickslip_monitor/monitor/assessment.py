# SPDX-License-Identifier: Apache-2.0
"""The verdict of the models on operating points: regime, margins, loads, amplitudes.

An :class:`Assessment` is of one point, of Python numbers, or of many, of arrays of one shape. What
a verdict rests on is stored, the rest is worked out when it is first asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, flatten, in_blocks, restore
from stickslip_monitor.physics.averaging import boundaries
from stickslip_monitor.physics.belief import Belief
from stickslip_monitor.physics.boundary_table import BoundaryTable, known_table
from stickslip_monitor.physics.cycle.cycles import exact_amplitude, exact_fold_speed
from stickslip_monitor.physics.oscillator import Bearing, damping_per_load

# Points from which on a table of the exact fold pays.
_FEW = 64

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
        return np.asarray(exact_amplitude(bearing, points.speed, points.load))

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


class _Column:
    """What is worked out when it is first asked for, under the attribute's name."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, points: Assessment, owner: type) -> Any:
        if self._name not in points._known:
            points._known.update(_worked_out(self._name, points))
        return points._known[self._name]


def _worked_out(name: str, points: Assessment) -> dict[str, Any]:
    """A column and what comes with it, of the shape of the points."""
    if name in BELIEFS:
        return _believed(name, points)
    flat = column(name, points._bearing, points._points())
    return {name: restore(flat, np.shape(points.outcome_code))}


def _believed(name: str, points: Assessment) -> dict[str, Any]:
    """One of :data:`BELIEFS` and what comes with it, of the shape of the points."""
    if points._belief is None:
        return {name: points.speed * np.nan}
    if name == 'probability_runs':  # without a memory it is what starts by itself
        return {name: points.probability_will}
    belief, speed, load, share = points._belief, points.speed, points.load, fold_share(points)
    if name.startswith('fold'):
        return dict(zip(BELIEFS[3:], belief.fold_margins(speed * share, load), strict=True))
    return dict(zip(BELIEFS[:2], belief.probabilities(speed, load, share), strict=True))


def fold_share(points: Assessment) -> Any:
    """The averaged fold as a share of the one that decides, which may be the exact model's."""
    fold, limit = np.asarray(points.fold_speed), np.asarray(points.stability_limit)
    share = np.divide(fold, limit, out=np.ones(limit.shape), where=np.less(fold, limit))
    return restore(share.reshape(-1), limit.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """The verdict on operating points: numbers for one, arrays of one shape for many.

    Attributes:
        speed: Journal surface speed as given, negative astern [m/s].
        load: Bearing load as given [N].
        outcome_code: Index into :data:`OUTCOMES`.
        hopf_speed: Highest unstable speed at this load [m/s]; ``nan`` without one.
        fold_speed: Highest speed with a stick-slip cycle at this load under first-order KBM
            averaging [m/s]; ``nan`` without one.
        exact_fold_speed: The same of the exact model, which does not average.
        hopf_load: Load at which this speed turns unstable [N]; ``nan`` without one.
        fold_load: Load from which a stick-slip cycle exists at this speed [N]; ``nan`` without.
        hopf_margin: ``|V|/V_H - 1`` [-]; negative inside, ``inf`` where there is no Hopf speed.
        fold_margin: The same of the averaged fold.
        exact_fold_margin: The same of the exact fold.
        stability_margin: The smaller of the two fold margins [-], which decides: not negative only
            where neither the averaged nor the exact model has a cycle.
        growth_rate: Growth rate of a small disturbance of steady sliding [1/s].
        amplitude: Displacement amplitude of the stick-slip cycle under averaging [m]; ``nan``
            where none exists.
        threshold_amplitude: That of the unstable cycle [m]: in the bistable range a larger
            disturbance starts stick-slip; ``nan`` elsewhere.
        amplitude_exact: That of the exact stick-slip cycle [m]; ``nan`` for none.
        probability_can: Probability that a stick-slip cycle exists; ``nan`` without a belief, as
            all below.
        probability_will: Probability that stick-slip starts by itself.
        probability_runs: Probability that stick-slip runs, with the memory of the bistable range.
        fold_margin_low: 5 % quantile of the fold margin [-].
        fold_margin_high: 95 % quantile of the fold margin [-].
    """

    speed: Any
    load: Any
    outcome_code: Any
    hopf_speed: Any
    fold_speed: Any
    exact_fold_speed: Any
    _bearing: Bearing = field(repr=False)
    _known: dict[str, Any] = field(default_factory=dict, repr=False)
    _belief: Belief | None = field(default=None, repr=False)

    hopf_margin = _Column()
    fold_margin = _Column()
    exact_fold_margin = _Column()
    stability_margin = _Column()
    hopf_load = _Column()
    fold_load = _Column()
    growth_rate = _Column()
    amplitude = _Column()
    threshold_amplitude = _Column()
    amplitude_exact = _Column()
    probability_can = _Column()
    probability_will = _Column()
    probability_runs = _Column()
    fold_margin_low = _Column()
    fold_margin_high = _Column()

    def _stored(self) -> tuple[Any, ...]:
        found = self.hopf_speed, self.fold_speed, self.exact_fold_speed
        return self.speed, self.load, self.outcome_code, *found

    def _points(self) -> Points:
        return Points(*(np.reshape(part, -1) for part in self._stored()))

    def __eq__(self, other: object) -> bool:
        """Whether both are of the same points, with the same verdict."""
        if not isinstance(other, Assessment):
            return NotImplemented
        pairs = zip(self._stored(), other._stored(), strict=True)
        return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)

    __hash__ = None  # type: ignore[assignment]

    @property
    def stability_limit(self) -> Any:
        """The higher of the two fold speeds [m/s]; ``nan`` without either."""
        limit = np.fmax(self.fold_speed, self.exact_fold_speed)
        return limit if np.ndim(limit) else float(limit)

    @property
    def amplitude_error(self) -> Any:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]."""
        return self.amplitude / self.amplitude_exact - 1.0

    @property
    def has_belief(self) -> bool:
        """Whether tolerances or a calibration make probabilities."""
        return self._belief is not None

    def remember_runs(self, runs: Any) -> None:
        """Take over the probabilities that stick-slip runs, which the rule has followed."""
        if self._belief is not None:
            self._known['probability_runs'] = runs

    @property
    def outcome(self) -> Any:
        """Why the verdict says what it says: an :class:`Outcome`, or names of many."""
        code = self.outcome_code
        return _OUTCOME_NAMES[code] if np.ndim(code) else OUTCOMES[code]

    @property
    def regime_code(self) -> Any:
        """Index into :data:`REGIMES`."""
        code = _REGIME_CODES[self.outcome_code]
        return code if np.ndim(code) else int(code)

    @property
    def regime(self) -> Any:
        """What can happen at the point: a :class:`Regime`, or names of many."""
        code = self.outcome_code
        return _REGIME_NAMES[self.regime_code] if np.ndim(code) else REGIME_OF_OUTCOME[code]


Assessments = Assessment
"""An assessment of arrays."""


def assess(
    bearing: Bearing,
    speed: ArrayLike,
    load: ArrayLike,
    belief: Belief | None = None,
    table: BoundaryTable | None = None,
) -> Assessment:
    """Assess operating points of a bearing by first-order KBM averaging and the exact fold.

    Args:
        bearing: The bearing.
        speed: Journal surface speed ``V`` [m/s]; negative astern.
        load: Bearing load ``N`` [N]; broadcasts with ``speed``.
        belief: What makes probabilities of them, if anything does.
        table: The bearing's boundaries over the load, where they are known; many points take one.

    Returns:
        The assessment, of numbers for numbers, else of arrays of the broadcast shape. It never
        raises for a number: an input that is not finite has its own outcome.
    """
    shape, (v, n) = flatten(speed, load)
    if table is None and v.size > _FEW:
        table = known_table(bearing)
    with np.errstate(all='ignore'):
        columns = in_blocks(partial(_judge, bearing, table), v, n)
    return _of_columns((restore(part, shape) for part in (v, n, *columns)), bearing, {}, belief)


def _of_columns(
    parts: Iterable[Any], bearing: Bearing, known: dict[str, Any], belief: Belief | None
) -> Assessment:
    speed, load, code, hopf, fold, exact = parts
    return Assessment(speed, load, code, hopf, fold, exact, bearing, known, belief)


def _judge(
    bearing: Bearing, table: BoundaryTable | None, speed: FloatArray, load: FloatArray
) -> tuple[NDArray[Any], ...]:
    """Outcome, Hopf speed and both fold speeds of flat arrays."""
    law = bearing.friction
    solver = boundaries.averaged(law)
    size = np.abs(speed)
    q = damping_per_load(bearing.damping, load)
    # Speed and load come in turns as a rule, so that a load is met twice.
    first = np.append(0, np.flatnonzero(load[1:] != load[:-1]) + 1)[: load.size]
    hopf, fold = solver.boundaries(law, q[first])
    exact = exact_fold_speed(bearing, load[first]) if table is None else table.exact(load[first])
    times = np.diff(np.append(first, load.size))
    hopf, fold, exact = (np.repeat(limit, times) for limit in (hopf, fold, exact))
    code = np.where((fold != fold) & (exact != exact), NO_BOUNDARY, NO_CYCLE)
    # A law with several ranges of speed is quiet between them, as averaging tells.
    cycle = solver.has_cycle(law, size, q, fold) | ((size < exact) & ~(size < fold))
    code = np.where(cycle, BISTABLE, code)
    code = np.where(solver.is_unstable(law, size, q, hopf), STICK_SLIP, code)
    # 0, or nan where an input is not finite.
    missing = (speed - speed) + (load - load)
    code = np.where(load <= 0.0, NO_CONTACT, code)
    code = np.where(size == 0.0, AT_REST, code)
    code = np.where(missing == 0.0, code, NOT_FINITE)
    return code, hopf + missing, fold + missing, exact + missing


def at_indices(points: Assessment, rows: Any) -> Assessment:
    """Some of the points of one-dimensional assessments; one of them for a number."""
    parts: Any = (part[rows] for part in points._stored())
    if not np.ndim(rows) and not isinstance(rows, slice):
        parts = (part.item() for part in parts)
        known = {name: column[rows].item() for name, column in points._known.items()}
    else:
        known = {name: column[rows] for name, column in points._known.items()}
    return _of_columns(parts, points._bearing, known, points._belief)


at_index = at_indices


def joined(points: Sequence[Assessment]) -> Assessment:
    """Assessments of points, at least one and all of one bearing."""
    columns: Any = (
        np.array(column) for column in zip(*(p._stored() for p in points), strict=True)
    )
    known = {name: np.array([getattr(p, name) for p in points]) for name in BELIEFS}
    return _of_columns(columns, points[0]._bearing, known, points[0]._belief)
