# SPDX-License-Identifier: Apache-2.0
"""The verdict of the models on operating points: regime, margins, loads, amplitudes.

An :class:`Assessment` is of one point, of Python numbers, :class:`Assessments` are of many, of arrays
of one shape. Inputs and boundaries are stored, the rest is computed at the first access.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, IndexArray, flatten, in_blocks, mapped, restore
from stickslip_monitor.monitor import record_fields
from stickslip_monitor.monitor.severity import WordEnum
from stickslip_monitor.physics import averages_closed_form, averaging
from stickslip_monitor.physics.bearing import Bearing, damping_per_load
from stickslip_monitor.physics.boundary_table import BoundaryTable, boundary_table
from stickslip_monitor.physics.cycles import exact_amplitude, exact_fold_speed
from stickslip_monitor.physics.deciding_load import deciding_load
from stickslip_monitor.physics.folds import deciding_fold
from stickslip_monitor.physics.lubrication import as_measured, load_over_speed
from stickslip_monitor.physics.probability import Belief

COVER = 1.01
"""So far beyond all boundaries none of eight laws has a cycle (nor at 1.0001): more than a table's error."""
# Points from which on a table of the exact fold pays.
_FEW = 64


class Regime(WordEnum):
    """Regimes of an operating point, in rising order of trouble."""

    STABLE = 'stable'
    BISTABLE = 'bistable'
    UNSTABLE = 'unstable'
    UNDETERMINED = 'undetermined'


class Outcome(WordEnum):
    """Reasons for the verdict of an assessment, each with the regime that it means."""

    regime: Regime
    sentence: str

    NO_CYCLE = (
        'no_cycle',
        Regime.STABLE,
        'Beyond the fold: no stick-slip cycle exists at this speed and load.',
    )
    BISTABLE = (
        'bistable',
        Regime.BISTABLE,
        'Steady sliding and stick-slip are both stable: which one runs depends on the history.',
    )
    STICK_SLIP = ('stick_slip', Regime.UNSTABLE, 'Steady sliding is unstable: stick-slip starts by itself.')
    NO_BOUNDARY = (
        'no_boundary',
        Regime.STABLE,
        'Friction does not fall fast enough with speed to overcome the damping at this load:'
        ' no speed has stick-slip.',
    )
    NO_CONTACT = ('no_contact', Regime.STABLE, 'The bearing carries no load: there is no friction.')
    AT_REST = 'at_rest', Regime.UNDETERMINED, 'The shaft is at rest: nothing slides.'
    NOT_FINITE = 'not_finite', Regime.UNDETERMINED, 'Speed or load is not a finite number.'
    BELOW = (
        'below_the_range',
        Regime.STABLE,
        'Below the range of stick-slip: friction still rises with the speed, no cycle exists.',
    )


REGIMES, OUTCOMES = tuple(Regime), tuple(Outcome)
_REGIME_CODES = np.array([REGIMES.index(outcome.regime) for outcome in OUTCOMES], np.int8)
NO_CYCLE, BISTABLE, STICK_SLIP, NO_BOUNDARY, NO_CONTACT, AT_REST, NOT_FINITE, BELOW = map(
    np.int8, range(len(OUTCOMES))
)
BELIEFS = tuple(item.name for item in record_fields.NUMBERS if item.needs == record_fields.BELIEF)
"""What tolerances or a calibration add to an assessment; ``nan`` without them."""


_STORED = ('speed', 'load', 'outcome_code', 'hopf_speed', 'fold_speed', 'fold_speed_kbm')
_Number = TypeVar('_Number', float, FloatArray)


def margin(speed: FloatArray, boundary: FloatArray) -> FloatArray:
    """Return ``V/V_b - 1`` of speeds ``V`` >= 0, with the sign of ``V - V_b`` to the last bit.

    A boundary may be ``nan`` where there is none, which gives ``inf``, or ``inf``, which gives -1.
    """
    value = (speed - boundary) / boundary
    unbounded = value != value
    if unbounded.any():
        value = np.where(unbounded, np.where(boundary == np.inf, -1.0, np.inf), value)
    return value


@dataclass(frozen=True, eq=False)
class _Assessed(Generic[_Number]):
    """Results of the models at operating points: the basis is stored, the rest computed on demand."""

    speed: _Number  # of the journal's surface as given, negative astern [m/s]
    load: _Number  # as given [N]
    outcome_code: NDArray[np.int8]  # index into OUTCOMES; a plain number of one point
    hopf_speed: _Number  # highest unstable speed at this load [m/s]; nan without one
    fold_speed: _Number  # which decides: above it no vibration lasts [m/s]; nan without one
    fold_speed_kbm: _Number  # by first-order KBM averaging [m/s]; nan without one
    bearing: Bearing = field(repr=False)
    belief: Belief | None = field(default=None, repr=False)
    temperature: _Number | None = None  # of the water [C]; None: that of the bearing

    @cached_property
    def scale(self) -> _Number:
        """``s`` of :mod:`stickslip_monitor.physics.lubrication`: 1 where friction depends on speed alone."""
        lubrication = self.bearing.lubrication
        factor: Any = 1.0 if lubrication is None else lubrication.scale(self.load, self.temperature)
        return factor

    @property
    def _reference(self) -> tuple[Bearing, _Number, _Number]:
        """The bearing with friction as measured, with the reference speeds and loads."""
        if self.bearing.lubrication is None:
            return self.bearing, self.speed, self.load
        with np.errstate(all='ignore'):
            return as_measured(self.bearing), self.speed / self.scale, self.load / self.scale

    def _apply_flat(self, function: Callable[..., FloatArray], *columns: ArrayLike) -> _Number:
        """Apply a function of flat arrays to columns that broadcast, in blocks of rows; return the result.

        It has the broadcast shape of the columns; it is a number for numbers. Floating-point warnings are
        silenced.
        """
        shape, flat = flatten(*columns)
        with np.errstate(all='ignore'):
            return restore(in_blocks(lambda *parts: (function(*parts),), *flat)[0], shape)

    def _margin_to(self, boundary: _Number) -> _Number:
        """Return :func:`margin` ``|V|/V_b - 1`` of the points to a boundary ``V_b`` [m/s].

        ``nan`` where a point is not finite.
        """

        def finite_margin(speed: FloatArray, limit: FloatArray, code: FloatArray) -> FloatArray:
            """Return the margin of flat columns, ``nan`` where a point is not finite."""
            return np.where(code == NOT_FINITE, np.nan, margin(np.abs(speed), limit))

        return self._apply_flat(finite_margin, self.speed, boundary, self.outcome_code)

    def _cycle_amplitude(
        self, solve: Callable[[Bearing, FloatArray, FloatArray], FloatArray], *codes: np.int8
    ) -> _Number:
        """Return an amplitude under averaging [m] at the points of some outcomes; ``nan`` elsewhere.

        It is ``nan``, too, beyond the averaged fold.

        Args:
            solve: Returns amplitudes for the bearing as measured, with speeds and loads of shape (n,).
            *codes: Those outcomes, as indices into :data:`OUTCOMES`.
        """
        reference, *point = self._reference

        def solved(speed: FloatArray, load: FloatArray, code: FloatArray, fold: FloatArray) -> FloatArray:
            """Return the amplitudes of flat columns as measured [m], ``nan`` for other outcomes."""
            size, result = np.abs(speed), np.full(speed.shape, np.nan)
            # Where only the exact model has a cycle averaging has no amplitude.
            rows = np.flatnonzero(np.isin(code, codes) & (size < fold))
            if rows.size:
                result[rows] = solve(reference, size[rows], load[rows])
            return result

        amplitude = self._apply_flat(solved, *point, self.outcome_code, self.fold_speed_kbm / self.scale)
        return amplitude * self.scale

    def _load_of(self, boundary: Callable[[Bearing, ArrayLike], Any]) -> _Number:
        """Return the load of a boundary [N] at the speed of each point; ``nan`` without one.

        ``boundary`` returns the load for a bearing and surface speeds [m/s].
        """
        lubrication = self.bearing.lubrication
        if lubrication is None or self.temperature is None:
            return mapped(lambda v, _: boundary(self.bearing, v), self.speed, self.load)
        reference, ratio = as_measured(self.bearing), lubrication.ratio_at(self.temperature)
        load = load_over_speed(lubrication, partial(boundary, reference), self.speed, ratio)
        return load + 0.0 * self.load

    @property
    def lower_end(self) -> _Number:
        """Speed below which friction that first rises leaves no cycle [m/s]; 0 for none.

        It is read from the bearing's table of boundaries, which the first access makes and caches.
        """
        reference, _, load = self._reference
        return boundary_table(reference).lower_end(load) * self.scale

    @property
    def fold_share(self) -> _Number:
        """The averaged fold as a share of the one that decides; 1 where either is missing or infinite."""

        def share(kbm: FloatArray, fold: FloatArray) -> FloatArray:
            """Return ``kbm / fold`` of flat columns; 1 where either is missing or infinite."""
            has_both = (kbm > 0.0) & (kbm < np.inf) & (fold > 0.0) & (fold < np.inf)
            return np.divide(kbm, fold, out=np.ones(fold.shape), where=has_both)

        return self._apply_flat(share, self.fold_speed_kbm, self.fold_speed)

    @cached_property
    def hopf_margin(self) -> _Number:
        """``|V|/V_H - 1`` [-]: ``inf`` without a Hopf speed, ``nan`` where speed or load is not finite."""
        return self._margin_to(self.hopf_speed)

    @cached_property
    def fold_margin(self) -> _Number:
        """``|V|/V_F - 1`` [-]: ``inf`` without a fold that decides, ``nan`` where an input is not finite."""
        return self._margin_to(self.fold_speed)

    @cached_property
    def fold_margin_kbm(self) -> _Number:
        """Margin to the averaged fold [-], which does not decide; ``inf`` and ``nan`` as ``fold_margin``."""
        return self._margin_to(self.fold_speed_kbm)

    @property
    def stability_margin(self) -> _Number:
        """The fold margin by its name in version 0.3 [-]."""
        return self.fold_margin

    @cached_property
    def hopf_load(self) -> _Number:
        """Load at which this speed turns unstable [N]; ``nan`` without one."""
        return self._load_of(averaging.hopf_load)

    @cached_property
    def fold_load(self) -> _Number:
        """Load from which a vibration can last at this speed [N]; ``nan`` without one."""
        return self._load_of(deciding_load)

    @cached_property
    def growth_rate(self) -> _Number:
        """Growth rate of a small disturbance of steady sliding [1/s]; negative where it dies out."""
        return averaging.growth_rate(*self._reference)

    @cached_property
    def amplitude(self) -> _Number:
        """Displacement amplitude of the stick-slip cycle under averaging [m]; ``nan`` for none."""
        return self._cycle_amplitude(averaging.stable_amplitude, BISTABLE, STICK_SLIP)

    @cached_property
    def threshold_amplitude(self) -> _Number:
        """Amplitude of the unstable cycle [m]; ``nan`` outside the bistable range.

        There a larger disturbance starts stick-slip. Where averaging has no such cycle, as under
        Coulomb's law, it is the sliding limit ``V/omega``: what reaches the journal's speed sticks.
        """
        limit = self._apply_flat(np.abs, self.speed) / self.bearing.natural_frequency

        def limit_if_missing(amplitude: FloatArray, limit: FloatArray, code: FloatArray) -> FloatArray:
            """Return the amplitudes, in the bistable range the limit for one that is ``nan``."""
            return np.where(np.isnan(amplitude) & (code == BISTABLE), limit, amplitude)

        amplitude = self._cycle_amplitude(averaging.threshold_amplitude, BISTABLE)
        return self._apply_flat(limit_if_missing, amplitude, limit, self.outcome_code)

    @cached_property
    def amplitude_exact(self) -> _Number:
        """Amplitude of the exact stick-slip cycle [m]; ``nan`` for none."""
        end = np.fmax(self.hopf_speed, self.fold_speed)
        # Beyond every boundary none is looked for, which takes as long. All at once, as many cycles are
        # followed together.
        near = np.isnan(self.fold_speed) | (np.abs(self.speed) <= COVER * end)
        bearing, speed, load = self._reference
        return exact_amplitude(bearing, np.where(near, speed, np.nan), load) * self.scale

    @property
    def amplitude_error(self) -> _Number:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]; ``nan`` without both."""
        return self.amplitude / self.amplitude_exact - 1.0

    @cached_property
    def _chances(self) -> tuple[_Number, _Number]:
        """The probabilities that a cycle exists, and that it starts by itself; ``nan`` without a belief."""
        if self.belief is None:
            return (self.speed * np.nan,) * 2
        return self.belief.probabilities(*self._reference[1:], self.fold_share)

    @cached_property
    def _fold_margins(self) -> tuple[_Number, _Number]:
        """The 5 % and the 95 % quantile of the margin to the fold that decides; ``nan`` without a belief."""
        if self.belief is None:
            return (self.speed * np.nan,) * 2
        _, speed, load = self._reference
        return self.belief.fold_margins(speed * self.fold_share, load)

    @cached_property
    def probability_can(self) -> _Number:
        """Probability that a stick-slip cycle exists; ``nan`` without a belief."""
        return self._chances[0]

    @cached_property
    def probability_will(self) -> _Number:
        """Probability that stick-slip starts by itself; ``nan`` without a belief."""
        return self._chances[1]

    @cached_property
    def probability_runs(self) -> _Number:
        """Probability that stick-slip runs, by the memory of the bistable range; ``nan`` without a belief.

        A point that is assessed by itself has no memory: there it is that of starting by itself.
        """
        return self.probability_will

    @property
    def fold_margin_low(self) -> _Number:
        """5 % quantile of the fold margin [-]; ``nan`` without a belief."""
        return self._fold_margins[0]

    @property
    def fold_margin_high(self) -> _Number:
        """95 % quantile of the fold margin [-]; ``nan`` without a belief."""
        return self._fold_margins[1]

    @property
    def has_belief(self) -> bool:
        """Whether tolerances or a calibration make probabilities."""
        return self.belief is not None


class Assessment(_Assessed[float]):
    """The verdict of the models on one operating point, of Python numbers.

    See :func:`assess`. The inputs and boundaries are stored; the rest is computed at the first access,
    and cached.
    """

    @property
    def outcome(self) -> Outcome:
        """Reason for the verdict."""
        return OUTCOMES[int(self.outcome_code)]

    @property
    def regime(self) -> Regime:
        """Regime of the point."""
        return self.outcome.regime

    @property
    def regime_code(self) -> int:
        """Index into :data:`REGIMES`."""
        return REGIMES.index(self.regime)


class Assessments(_Assessed[FloatArray]):
    """Verdicts of the models on many operating points, as arrays of one shape."""

    @property
    def outcome(self) -> NDArray[np.str_]:
        """Names of the :class:`Outcome` of each."""
        return np.array(OUTCOMES, dtype=str)[self.outcome_code]

    @property
    def regime(self) -> NDArray[np.str_]:
        """Names of the :class:`Regime` of each."""
        return np.array(REGIMES, dtype=str)[self.regime_code]

    @property
    def regime_code(self) -> NDArray[np.int8]:
        """Indices into :data:`REGIMES`."""
        return _REGIME_CODES[self.outcome_code]

    @overload
    def at(self, rows: int) -> Assessment: ...

    @overload
    def at(self, rows: IndexArray | slice) -> Assessments: ...

    def at(self, rows: int | IndexArray | slice) -> Assessment | Assessments:
        """Return some of the points of one-dimensional arrays, with all that is computed of them already.

        An :class:`Assessment` for the index of one, else :class:`Assessments`.
        """
        single = isinstance(rows, int | np.integer)
        columns = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        columns_at = {name: value[rows].item() if single else value[rows] for name, value in columns.items()}
        stored = [columns_at.pop(name) for name in _STORED]
        assessment = _KINDS[single](*stored, self.bearing, self.belief, self.temperature)
        vars(assessment).update(columns_at)
        return assessment


_KINDS: dict[bool, Callable[..., Assessment | Assessments]] = {True: Assessment, False: Assessments}


@overload
def assess(
    bearing: Bearing,
    speed: float,
    load: float,
    belief: Belief | None = None,
    table: BoundaryTable | None = None,
    chances: Iterable[float] = (),
    temperature: float | None = None,
) -> Assessment: ...


@overload
def assess(
    bearing: Bearing,
    speed: ArrayLike,
    load: ArrayLike,
    belief: Belief | None = None,
    table: BoundaryTable | None = None,
    chances: Iterable[Any] = (),
    temperature: ArrayLike | None = None,
) -> Assessments: ...


def assess(
    bearing: Bearing,
    speed: ArrayLike,
    load: ArrayLike,
    belief: Belief | None = None,
    table: BoundaryTable | None = None,
    chances: Iterable[Any] = (),
    temperature: ArrayLike | None = None,
) -> Assessment | Assessments:
    """Assess operating points of a bearing by its Hopf speed and its exact fold.

    Steady sliding is unstable where ``-N mu'(V) > c``, up to the Hopf speed; from there to the fold
    it is bistable (Krylov and Bogoliubov; docs/physics.md has the equations).

    Args:
        bearing: The bearing.
        speed: Journal surface speed ``V`` [m/s]; negative astern.
        load: Bearing load ``N`` [N]; broadcasts with ``speed``.
        belief: What probabilities are computed from; with ``None`` they are ``nan``.
        table: The bearing's boundaries over the load, where they are known. With ``None`` more than 64
            points make and cache one, and fewer are solved one by one.
        chances: The probabilities by which the rule decided, in the order of :data:`BELIEFS`; they replace
            those that the belief would give, and are ignored without one.
        temperature: Of the water [C], of the shape of the points; ``None`` for that of the bearing. Ignored
            where friction depends on speed alone.

    Returns:
        An :class:`Assessment` for numbers, else :class:`Assessments` of the broadcast shape. It
        never raises for a number: an input that is not finite has its own outcome.

    >>> point = assess(bearing, 0.18, 1000.0)
    >>> print(point.regime, round(point.hopf_speed, 7), round(point.fold_speed, 7))
    bistable 0.1609438 0.2131982
    >>> round(point.fold_margin, 3)
    -0.156
    >>> assess(bearing, [0.1, 0.18, 0.3], 1000.0).regime.tolist()
    ['unstable', 'bistable', 'stable']
    """
    shape, (v, n) = flatten(speed, load)
    if table is None and v.size > _FEW:
        table = boundary_table(bearing)
    lubrication, water = bearing.lubrication, None
    if lubrication is not None and temperature is not None:
        water = np.broadcast_to(np.asarray(temperature, float), shape).reshape(-1)
    with np.errstate(all='ignore'):
        scale = 1.0 if lubrication is None else lubrication.scale(n, water)
        code, *limits = in_blocks(partial(_judge_points, as_measured(bearing), table), v / scale, n / scale)
        columns = (code, *(limit * scale for limit in limits))
    stored = (restore(part, shape) for part in (v, n, *columns))
    assessment = _KINDS[not shape](*stored, bearing, belief, None if water is None else restore(water, shape))
    if belief is not None:
        vars(assessment).update(zip(BELIEFS, chances, strict=False))
    return assessment


def _judge_points(
    bearing: Bearing, table: BoundaryTable | None, speed: FloatArray, load: FloatArray
) -> tuple[NDArray[Any], ...]:
    """Judge flat arrays of points, each of shape (n,).

    Args:
        bearing: The bearing, with friction as measured.
        table: Its boundaries over the load; ``None`` to compute them at each load.
        speed: Surface speed, negative astern [m/s].
        load: Load [N].

    Returns:
        Outcome as index, Hopf speed, the fold that decides and the averaged fold [m/s], shape (n,) each;
        the speeds are ``nan`` where there is no boundary or an input is not finite.
    """
    law = bearing.friction
    solver = averaging.averages_of(law)
    size = np.abs(speed)
    q = damping_per_load(bearing.damping, load)
    # Speed and load come in turns as a rule, so that a load is met twice.
    first = np.append(0, np.flatnonzero(load[1:] != load[:-1]) + 1)[: load.size]
    # What is no closed form costs milliseconds a load.
    if table is not None and solver is not averages_closed_form:
        hopf, kbm = solver.hopf_speed(law, q[first]), table.fold_kbm(load[first])
    else:
        hopf, kbm = solver.boundaries(law, q[first])
    if table is None:
        loads = load[first]
        fold = deciding_fold(exact_fold_speed(bearing, loads), kbm, averaging.sticking_end(bearing, loads))
    else:
        fold = table.fold(load[first])
    times = np.diff(np.append(first, load.size))
    hopf, kbm, fold = (np.repeat(limit, times) for limit in (hopf, kbm, fold))
    code = np.where(fold != fold, NO_BOUNDARY, NO_CYCLE)
    # A law with several ranges of speed is quiet between them, as averaging finds.
    cycle = (size < fold) & (solver.has_cycle(law, size, q, kbm) | ~(size < kbm))
    code = np.where((code == NO_CYCLE) & (size < fold), BELOW, code)
    code = np.where(cycle, BISTABLE, code)
    code = np.where(solver.is_unstable(law, size, q, hopf), STICK_SLIP, code)
    # 0, or nan where an input is not finite.
    missing = (speed - speed) + (load - load)
    code = np.where(load <= 0.0, NO_CONTACT, code)
    code = np.where(size == 0.0, AT_REST, code)
    code = np.where(missing == 0.0, code, NOT_FINITE)
    return code, hopf + missing, fold + missing, kbm + missing
