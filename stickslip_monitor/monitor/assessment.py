# SPDX-License-Identifier: Apache-2.0
"""The verdict of the models on operating points: regime, margins, loads, amplitudes.

A single point is an :class:`Assessment` of Python numbers, many are :class:`Assessments` of
arrays; both have the same names. What a verdict rests on is stored, the rest is worked out when it
is first asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray, flatten, in_blocks
from stickslip_monitor.physics.averaging import boundaries, closed_form
from stickslip_monitor.physics.averaging.solver import averaged_solver, damping_per_load
from stickslip_monitor.physics.belief import Belief, probability_runs
from stickslip_monitor.physics.cycle.fold import fold_curve
from stickslip_monitor.physics.cycle.surface import exact_amplitude, exact_amplitude_of_number
from stickslip_monitor.physics.friction import Stribeck, computes_as
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


class _Number:
    """A number that is worked out when it is first asked for, under the attribute's name."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, point: Assessment, owner: type) -> float:
        value = point._known.get(self._name)
        if value is None:
            if self._name in BELIEFS:
                point._known.update(_believed(self._name, point))
            else:
                point._known[self._name] = _worked_out(self._name, point)
            value = point._known[self._name]
        return value


def _worked_out(name: str, point: Assessment) -> float:
    """A column's number at one point; what every sample asks for without arrays."""
    if name == 'amplitude_exact' and point.outcome_code != NOT_FINITE:
        folds = point.fold_speed, point.exact_fold_speed
        return exact_amplitude_of_number(point._bearing, point.speed, point.load, *folds)
    bearing, solver = point._bearing, _number_solver(point._bearing)
    if solver is not None and point.outcome_code != NOT_FINITE:
        if name == 'growth_rate':
            return boundaries.growth_rate_of_number(bearing, solver.law, point.speed, point.load)
        if name == 'amplitude':
            return _amplitude_of_number(point, solver.law)
    return float(column(name, bearing, point._points())[0])


def _amplitude_of_number(point: Assessment, law: Stribeck) -> float:
    """:func:`_amplitude` of one point."""
    bearing, speed, load = point._bearing, abs(point.speed), point.load
    if point.outcome_code not in (BISTABLE, STICK_SLIP) or not speed < point.fold_speed:
        return math.nan
    try:
        velocity = closed_form.stable_amplitude_of_number(law, speed, bearing.damping / load)
    except ArithmeticError:
        # What Python's numbers refuse is nan or infinite in arrays.
        return float(column('amplitude', bearing, point._points())[0])
    return velocity / bearing.natural_frequency


class _Column:
    """An array that is worked out when it is first asked for, under the attribute's name."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, points: Assessments, owner: type) -> FloatArray:
        value = points._known.get(self._name)
        if value is None:
            if self._name in BELIEFS:
                points._known.update(_believed(self._name, points))
            else:
                flat = column(self._name, points._bearing, points._points())
                points._known[self._name] = flat.reshape(points.outcome_code.shape)
            value = points._known[self._name]
        return value


def _believed(name: str, points: Assessment | Assessments) -> dict[str, Any]:
    """One of :data:`BELIEFS` and what comes with it, of the shape of the points."""
    if points._belief is None:
        return {name: points.speed * np.nan}
    if name == 'probability_runs':  # without a memory it is what starts by itself
        return {name: points.probability_will}
    belief, speed, load, share = points._belief, points.speed, points.load, fold_share(points)
    if name.startswith('fold'):
        return dict(zip(BELIEFS[3:], belief.fold_margins(speed * share, load), strict=True))
    return dict(zip(BELIEFS[:2], belief.probabilities(speed, load, share), strict=True))


def fold_share(points: Assessment | Assessments) -> Any:
    """The averaged fold as a share of the one that decides, which may be the exact model's."""
    fold, limit = points.fold_speed, points.stability_limit
    if isinstance(points, Assessment):
        return fold / limit if fold < limit else 1.0
    return np.divide(fold, limit, out=np.ones(np.shape(limit)), where=np.less(fold, limit))


@dataclass(frozen=True, slots=True)
class Assessment:
    """The verdict on one operating point.

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
        growth_rate: Growth rate of a small disturbance of steady sliding [1/s].
        amplitude: Displacement amplitude of the stick-slip cycle under averaging [m]; ``nan``
            where none exists.
        threshold_amplitude: That of the unstable cycle [m]: in the bistable range a larger
            disturbance starts stick-slip; ``nan`` elsewhere.
        amplitude_exact: That of the exact stick-slip cycle, to 1e-6 [m]; ``nan`` for none. See
            :func:`stickslip_monitor.physics.cycle.surface.exact_amplitude`.
        probability_can: Probability that a stick-slip cycle exists; ``nan`` without a belief, as
            all below.
        probability_will: Probability that stick-slip starts by itself.
        probability_runs: Probability that stick-slip runs, with the memory of the bistable range.
        fold_margin_low: 5 % quantile of the fold margin [-].
        fold_margin_high: 95 % quantile of the fold margin [-].
    """

    speed: float
    load: float
    outcome_code: int
    hopf_speed: float
    fold_speed: float
    exact_fold_speed: float
    _bearing: Bearing = field(repr=False, compare=False)
    _known: dict[str, float] = field(default_factory=dict, repr=False, compare=False)
    _belief: Belief | None = field(default=None, repr=False, compare=False)

    hopf_load = _Number()
    fold_load = _Number()
    growth_rate = _Number()
    amplitude = _Number()
    threshold_amplitude = _Number()
    amplitude_exact = _Number()
    probability_can = _Number()
    probability_will = _Number()
    probability_runs = _Number()
    fold_margin_low = _Number()
    fold_margin_high = _Number()

    def _points(self) -> Points:
        return Points(*(np.array([value]) for value in self._stored()))

    def _stored(self) -> tuple[float, ...]:
        found = self.hopf_speed, self.fold_speed, self.exact_fold_speed
        return self.speed, self.load, self.outcome_code, *found

    @property
    def hopf_margin(self) -> float:
        """``|V|/V_H - 1`` [-]; negative inside, ``inf`` where there is no Hopf speed."""
        return margin_of_number(self.speed, self.hopf_speed, self.outcome_code)

    @property
    def fold_margin(self) -> float:
        """``|V|/V_F - 1`` [-]; negative inside, ``inf`` where there is no fold."""
        return margin_of_number(self.speed, self.fold_speed, self.outcome_code)

    @property
    def exact_fold_margin(self) -> float:
        """``|V|/V_F - 1`` [-] with the exact fold speed; negative inside, ``inf`` without one."""
        return margin_of_number(self.speed, self.exact_fold_speed, self.outcome_code)

    @property
    def stability_limit(self) -> float:
        """The higher of the two fold speeds [m/s]; ``nan`` without either."""
        fold, exact = self.fold_speed, self.exact_fold_speed
        # A speed that does not exist is less than any.
        return exact if exact > fold or fold != fold else fold

    @property
    def stability_margin(self) -> float:
        """The smaller of the two fold margins [-], which decides.

        Not negative only where neither the averaged nor the exact model has a cycle.
        """
        return margin_of_number(self.speed, self.stability_limit, self.outcome_code)

    @property
    def amplitude_error(self) -> float:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]."""
        return self.amplitude / self.amplitude_exact - 1.0

    @property
    def has_belief(self) -> bool:
        """Whether tolerances or a calibration make probabilities."""
        return self._belief is not None

    def remember_runs(self, before: float) -> float:
        """Work out the probability that stick-slip runs, from that before this point."""
        if self._belief is None:
            return before
        can, will = np.array([self.probability_can]), np.array([self.probability_will])
        runs: float = probability_runs(can, will, before).item()
        self._known['probability_runs'] = runs
        return runs

    @property
    def outcome(self) -> Outcome:
        """Why the verdict says what it says."""
        return OUTCOMES[self.outcome_code]

    @property
    def regime_code(self) -> int:
        """Index into :data:`REGIMES`."""
        return int(_REGIME_CODES[self.outcome_code])

    @property
    def regime(self) -> Regime:
        """What can happen at the point."""
        return REGIME_OF_OUTCOME[self.outcome_code]


@dataclass(frozen=True, slots=True, eq=False)
class Assessments:
    """The verdicts on many operating points: arrays of one shape, named as in :class:`Assessment`.

    Attributes:
        outcome: Outcome names.
        regime: Regime names.
    """

    speed: FloatArray
    load: FloatArray
    outcome_code: NDArray[np.int8]
    hopf_speed: FloatArray
    fold_speed: FloatArray
    exact_fold_speed: FloatArray
    _bearing: Bearing = field(repr=False)
    _known: dict[str, FloatArray] = field(default_factory=dict, repr=False)
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

    def _points(self) -> Points:
        return Points(
            self.speed.reshape(-1),
            self.load.reshape(-1),
            self.outcome_code.reshape(-1),
            self.hopf_speed.reshape(-1),
            self.fold_speed.reshape(-1),
            self.exact_fold_speed.reshape(-1),
        )

    @property
    def stability_limit(self) -> FloatArray:
        """See :class:`Assessment`."""
        return np.fmax(self.fold_speed, self.exact_fold_speed)

    @property
    def amplitude_error(self) -> FloatArray:
        """See :class:`Assessment`."""
        return self.amplitude / self.amplitude_exact - 1.0

    @property
    def has_belief(self) -> bool:
        """See :class:`Assessment`."""
        return self._belief is not None

    def remember_runs(self, before: float) -> float:
        """Work out the probabilities that stick-slip runs, in order of time.

        Args:
            before: That before the first of the points.

        Returns:
            That after the last.
        """
        if self._belief is None:
            return before
        runs = probability_runs(self.probability_can, self.probability_will, before)
        self._known['probability_runs'] = runs
        return float(runs[-1]) if runs.size else before

    @property
    def outcome(self) -> NDArray[np.str_]:
        """See :class:`Assessment`."""
        return _OUTCOME_NAMES[self.outcome_code]

    @property
    def regime_code(self) -> NDArray[np.int8]:
        """See :class:`Assessment`."""
        return _REGIME_CODES[self.outcome_code]

    @property
    def regime(self) -> NDArray[np.str_]:
        """See :class:`Assessment`."""
        return _REGIME_NAMES[self.regime_code]


Values = NDArray[Any] | Sequence[float]


@overload
def assess(
    bearing: Bearing, speed: float, load: float, belief: Belief | None = None
) -> Assessment: ...


@overload
def assess(
    bearing: Bearing, speed: Values, load: float | Values, belief: Belief | None = None
) -> Assessments: ...


@overload
def assess(
    bearing: Bearing, speed: float, load: Values, belief: Belief | None = None
) -> Assessments: ...


def assess(
    bearing: Bearing, speed: ArrayLike, load: ArrayLike, belief: Belief | None = None
) -> Assessment | Assessments:
    """Assess operating points of a bearing by first-order KBM averaging and the exact fold.

    Args:
        bearing: The bearing.
        speed: Journal surface speed ``V`` [m/s]; negative astern.
        load: Bearing load ``N`` [N]; broadcasts with ``speed``.
        belief: What makes probabilities of them, if anything does.

    Returns:
        The assessment of one point for numbers, else those of arrays of the broadcast shape. It
        never raises for a number: an input that is not finite has its own outcome.
    """
    if isinstance(speed, float) and isinstance(load, float):
        solver = _number_solver(bearing)
        if solver is not None and 0.0 < abs(speed) * load < math.inf:
            return _assess_number(bearing, solver, float(speed), float(load), belief)
    shape, (v, n) = flatten(speed, load)
    with np.errstate(all='ignore'):
        columns = in_blocks(partial(_judge, bearing), v, n)
    if not shape:
        v1, n1, code, hopf, fold, exact = (flat[0].item() for flat in (v, n, *columns))
        return Assessment(v1, n1, code, hopf, fold, exact, bearing, _belief=belief)
    v, n, codes, hopfs, folds, exacts = (flat.reshape(shape) for flat in (v, n, *columns))
    return Assessments(v, n, codes, hopfs, folds, exacts, bearing, _belief=belief)


class _NumberSolver:
    """The boundaries of a bearing with Stribeck's law at one load after another."""

    __slots__ = ('_bearing', '_curve', '_known', 'law')

    def __init__(self, bearing: Bearing, law: Stribeck) -> None:
        self._bearing, self.law, self._curve = bearing, law, fold_curve(bearing)
        self._known = 0.0, (math.nan, math.nan, math.nan)

    def boundaries(self, load: float) -> tuple[float, float, float]:
        """Hopf, fold and exact fold speed at a load [m/s]: the next speed often has the same."""
        last, found = self._known
        if last != load:
            hopf, fold = closed_form.boundaries_of_number(self.law, self._bearing.damping / load)
            found = hopf, fold, self._curve.speed_of_number(load, fold)
            self._known = load, found
        return found


@lru_cache(maxsize=32)
def _number_solver(bearing: Bearing) -> _NumberSolver | None:
    """What assesses single points without arrays, for bearings where that is known."""
    law = bearing.friction
    return _NumberSolver(bearing, law) if computes_as(law, Stribeck) else None


def _assess_number(
    bearing: Bearing, solver: _NumberSolver, speed: float, load: float, belief: Belief | None
) -> Assessment:
    """:func:`assess` of one ordinary point: the same operations, so the same bits."""
    hopf, fold, exact = solver.boundaries(load)
    size, code = abs(speed), NO_CYCLE
    if size < hopf:
        code = STICK_SLIP
    elif size < fold or size < exact:
        code = BISTABLE
    elif fold != fold and exact != exact:
        code = NO_BOUNDARY
    return Assessment(speed, load, int(code), hopf, fold, exact, bearing, _belief=belief)


def _judge(bearing: Bearing, speed: FloatArray, load: FloatArray) -> tuple[NDArray[Any], ...]:
    """Outcome, Hopf speed and both fold speeds of flat arrays."""
    solver = averaged_solver(bearing.friction)
    magnitude = np.abs(speed)
    size = magnitude * load
    ordinary = bool(((size > 0.0) & (size < np.inf)).all())
    q = bearing.damping / load if ordinary else damping_per_load(bearing.damping, load)
    curve = fold_curve(bearing)
    # Speed and load come in turns as a rule, so that a load is met twice.
    first = np.append(0, np.flatnonzero(load[1:] != load[:-1]) + 1)[: load.size]
    shared = 4 * first.size < 3 * load.size
    loads = load[first] if shared else load
    hopf, fold = solver.boundaries(q[first] if shared else q)
    exact = curve.speed(loads, fold)
    if shared:
        times = np.diff(np.append(first, load.size))
        hopf, fold, exact = (np.repeat(limit, times) for limit in (hopf, fold, exact))
    code = np.where((fold != fold) & (exact != exact), NO_BOUNDARY, NO_CYCLE)
    averaged = solver.has_cycle(magnitude, q, fold)
    code = np.where(curve.has_cycle(magnitude, load, fold, exact, averaged), BISTABLE, code)
    code = np.where(solver.is_unstable(magnitude, q, hopf), STICK_SLIP, code)
    if ordinary:
        return code, hopf, fold, exact
    # 0, or nan where an input is not finite.
    missing = (speed - speed) + (load - load)
    code = np.where(load <= 0.0, NO_CONTACT, code)
    code = np.where(magnitude == 0.0, AT_REST, code)
    code = np.where(missing == 0.0, code, NOT_FINITE)
    return code, hopf + missing, fold + missing, exact + missing


def at_indices(points: Assessments, rows: IndexArray | slice) -> Assessments:
    """Some of the points of one-dimensional assessments."""
    return Assessments(
        points.speed[rows],
        points.load[rows],
        points.outcome_code[rows],
        points.hopf_speed[rows],
        points.fold_speed[rows],
        points.exact_fold_speed[rows],
        points._bearing,
        {name: column[rows] for name, column in points._known.items()},
        points._belief,
    )


def at_index(points: Assessments, index: int) -> Assessment:
    """One of the points of one-dimensional assessments."""
    return Assessment(
        points.speed[index].item(),
        points.load[index].item(),
        points.outcome_code[index].item(),
        points.hopf_speed[index].item(),
        points.fold_speed[index].item(),
        points.exact_fold_speed[index].item(),
        points._bearing,
        {name: column[index].item() for name, column in points._known.items()},
        points._belief,
    )


def joined(points: Sequence[Assessment]) -> Assessments:
    """Assessments of points, at least one and all of one bearing."""
    columns = zip(*(point._stored() for point in points), strict=True)
    speed, load, code, hopf, fold, exact = (np.array(column) for column in columns)
    known = {name: np.array([getattr(p, name) for p in points]) for name in BELIEFS}
    first = points[0]
    return Assessments(speed, load, code, hopf, fold, exact, first._bearing, known, first._belief)
