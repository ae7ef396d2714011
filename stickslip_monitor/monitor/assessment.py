# SPDX-License-Identifier: Apache-2.0
"""The verdict of the models on operating points: regime, margins, loads, amplitudes.

An :class:`Assessment` is of one point, of Python numbers, or of many, of arrays of one shape. What
a verdict rests on is stored, the rest is worked out when it is first asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, flatten, in_blocks, restore
from stickslip_monitor.monitor.severity import SentenceEnum
from stickslip_monitor.physics import averaging, closed_form
from stickslip_monitor.physics.bearing import Bearing, damping_per_load
from stickslip_monitor.physics.boundary_table import BoundaryTable, known_table
from stickslip_monitor.physics.cycles import exact_amplitude, exact_fold_speed
from stickslip_monitor.physics.probability import Belief

TABLE_ERROR = 1e-6
"""More than the error of a table of Stribeck's averaged fold, which is 1e-8 at most."""
# Points from which on a table of the exact fold pays.
_FEW = 64


class Regime(str, Enum):
    """What can happen at an operating point, in rising order of trouble."""

    STABLE = 'stable'
    BISTABLE = 'bistable'
    UNSTABLE = 'unstable'
    UNDETERMINED = 'undetermined'

    def __str__(self) -> str:
        return self.value


class Outcome(SentenceEnum):
    """Why an assessment says what it says, with the regime that it means."""

    regime: Regime

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
BELIEFS = ('probability_can', 'probability_will', 'probability_runs', 'fold_margin_low', 'fold_margin_high')
"""What tolerances or a calibration add to an assessment; ``nan`` without them."""


_STORED = ('speed', 'load', 'outcome_code', 'hopf_speed', 'fold_speed', 'exact_fold_speed')


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


def _margin(points: Assessment, boundary: FloatArray) -> FloatArray:
    return np.where(points.outcome_code == NOT_FINITE, np.nan, margin(np.abs(points.speed), boundary))


def _amplitude(
    solve: Callable[[Bearing, FloatArray, FloatArray], FloatArray], codes: list[np.int8], points: Assessment
) -> FloatArray:
    """An amplitude under averaging at the points of some outcomes, ``nan`` elsewhere."""
    speed = np.abs(points.speed)
    # Where only the exact model has a cycle averaging has no amplitude.
    rows = np.flatnonzero(np.isin(points.outcome_code, codes) & (speed < points.fold_speed))
    result = np.full(speed.shape, np.nan)
    if rows.size:
        result[rows] = solve(points._bearing, speed[rows], points.load[rows])
    return result


_ON_DEMAND: dict[str, Callable[[Assessment], FloatArray]] = {
    'hopf_margin': lambda p: _margin(p, p.hopf_speed),
    'fold_margin': lambda p: _margin(p, p.fold_speed),
    'exact_fold_margin': lambda p: _margin(p, p.exact_fold_speed),
    'stability_margin': lambda p: _margin(p, p.stability_limit),
    'hopf_load': lambda p: averaging.hopf_load(p._bearing, p.speed) + (p.load - p.load),
    'fold_load': lambda p: averaging.fold_load(p._bearing, p.speed) + (p.load - p.load),
    'growth_rate': lambda p: averaging.growth_rate(p._bearing, p.speed, p.load),
    'amplitude': partial(_amplitude, averaging.stable_amplitude, [BISTABLE, STICK_SLIP]),
    'threshold_amplitude': partial(_amplitude, averaging.threshold_amplitude, [BISTABLE]),
    'amplitude_exact': lambda p: np.asarray(exact_amplitude(p._bearing, p.speed, p.load)),
}


COLUMNS = (*_STORED, *_ON_DEMAND)
"""The names of the numbers of every operating point."""


def _worked_out(name: str, points: Assessment) -> dict[str, Any]:
    """A column and what comes with it, of the shape of the points."""
    if name in BELIEFS:
        return _believed(name, points)
    flat = [np.reshape(part, -1) for part in points._stored()]

    def worked_out(*columns: NDArray[Any]) -> tuple[FloatArray]:
        return (_ON_DEMAND[name](_of(columns, points._bearing)),)

    if name == 'amplitude_exact':  # many together pay for a compiled loop
        (found,) = worked_out(*flat)
    else:
        with np.errstate(all='ignore'):
            (found,) = in_blocks(worked_out, *flat)
    return {name: restore(found, np.shape(points.outcome_code))}


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
        exact_fold_speed: Highest speed at which the lining sticks in the exact model, which does
            not average [m/s]; a vibration that never sticks ends at about the averaged fold.
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

    def __getattr__(self, name: str) -> Any:
        """What is worked out when it is first asked for, and then kept."""
        if name not in _ON_DEMAND and name not in BELIEFS:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute '{name}'")
        if name not in self._known:
            self._known.update(_worked_out(name, self))
        return self._known[name]

    def __dir__(self) -> list[str]:
        """All names, also of what is not worked out yet."""
        return sorted({*object.__dir__(self), *_ON_DEMAND, *BELIEFS})

    def _stored(self) -> Iterator[Any]:
        return (getattr(self, name) for name in _STORED)

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
    def lower_end(self) -> Any:
        """Speed below which friction that first rises leaves no cycle [m/s]; 0 for none."""
        return known_table(self._bearing).lower_end(self.load)

    @property
    def amplitude_error(self) -> Any:
        """Error of averaging's amplitude, ``amplitude / amplitude_exact - 1`` [-]."""
        return self.amplitude / self.amplitude_exact - 1.0

    @property
    def has_belief(self) -> bool:
        """Whether tolerances or a calibration make probabilities."""
        return self._belief is not None

    def remember_chances(self, chances: Iterable[Any]) -> None:
        """Take over the probabilities by which the rule decided, the first three beliefs."""
        if self._belief is not None:
            self._known.update(zip(BELIEFS[:3], chances, strict=True))

    @property
    def outcome(self) -> Any:
        """Why the verdict says what it says: an :class:`Outcome`, or names of many."""
        code = self.outcome_code
        return np.array(OUTCOMES, dtype=str)[code] if np.ndim(code) else OUTCOMES[code]

    @property
    def regime_code(self) -> Any:
        """Index into :data:`REGIMES`."""
        code = _REGIME_CODES[self.outcome_code]
        return code if np.ndim(code) else int(code)

    @property
    def regime(self) -> Any:
        """What can happen at the point: a :class:`Regime`, or names of many."""
        code = self.outcome_code
        return np.array(REGIMES, dtype=str)[self.regime_code] if np.ndim(code) else REGIMES[self.regime_code]


def _of(stored: Iterable[Any], bearing: Bearing, **more: Any) -> Assessment:
    return Assessment(**dict(zip(_STORED, stored, strict=True)), _bearing=bearing, **more)


Assessments = Assessment
"""An assessment of arrays."""


def assess(
    bearing: Bearing,
    speed: ArrayLike,
    load: ArrayLike,
    belief: Belief | None = None,
    table: BoundaryTable | None = None,
    *,
    sums: bool = False,
) -> Assessment:
    """Assess operating points of a bearing by first-order KBM averaging and the exact fold.

    Args:
        bearing: The bearing.
        speed: Journal surface speed ``V`` [m/s]; negative astern.
        load: Bearing load ``N`` [N]; broadcasts with ``speed``.
        belief: What makes probabilities of them, if anything does.
        table: The bearing's boundaries over the load, where they are known; many points take one.
        sums: Whether only sums over the points are wanted: outcomes are the same, but the averaged
            fold of Stribeck's law is read off the table, to 1e-8 in place of the last bit.

    Returns:
        The assessment, of numbers for numbers, else of arrays of the broadcast shape. It never
        raises for a number: an input that is not finite has its own outcome.
    """
    shape, (v, n) = flatten(speed, load)
    if table is None and v.size > _FEW:
        table = known_table(bearing)
    with np.errstate(all='ignore'):
        columns = in_blocks(partial(_judge, bearing, table, sums), v, n)
    stored = (restore(part, shape) for part in (v, n, *columns))
    return _of(stored, bearing, _belief=belief)


def _judge(
    bearing: Bearing, table: BoundaryTable | None, sums: bool, speed: FloatArray, load: FloatArray
) -> tuple[NDArray[Any], ...]:
    """Outcome, Hopf speed and both fold speeds of flat arrays."""
    law = bearing.friction
    solver = averaging.averaged(law)
    size = np.abs(speed)
    q = damping_per_load(bearing.damping, load)
    # Speed and load come in turns as a rule, so that a load is met twice.
    first = np.append(0, np.flatnonzero(load[1:] != load[:-1]) + 1)[: load.size]
    read = sums and table is not None and solver is closed_form
    if read and table is not None:
        hopf, fold = solver.hopf_speed(law, q[first]), table.averaged(load[first])
    else:
        hopf, fold = solver.boundaries(law, q[first])
    exact = exact_fold_speed(bearing, load[first]) if table is None else table.exact(load[first])
    times = np.diff(np.append(first, load.size))
    hopf, fold, exact = (np.repeat(limit, times) for limit in (hopf, fold, exact))
    if read:
        near = np.flatnonzero(np.abs(size - fold) <= TABLE_ERROR * fold)
        fold[near] = solver.boundaries(law, q[near])[1]
    code = np.where((fold != fold) & (exact != exact), NO_BOUNDARY, NO_CYCLE)
    # A law with several ranges of speed is quiet between them, as averaging finds.
    cycle = solver.has_cycle(law, size, q, fold) | ((size < exact) & ~(size < fold))
    below = (code == NO_CYCLE) & (size < np.fmax(fold, exact))
    code = np.where(below, BELOW, code)
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
    single = not np.ndim(rows) and not isinstance(rows, slice)

    def picked(column: Any) -> Any:
        return column[rows].item() if single else column[rows]

    known = {name: picked(column) for name, column in points._known.items()}
    stored = map(picked, points._stored())
    return _of(stored, points._bearing, _known=known, _belief=points._belief)
