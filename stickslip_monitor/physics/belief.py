# SPDX-License-Identifier: Apache-2.0
"""How probable stick-slip is at an operating point, given what is not known of the bearing.

With the decay ``beta`` of the Stribeck law, ``Delta = mu_s - mu_k`` and ``N0 = c/(Delta beta)``
the averaged model's two boundaries follow from ``v = beta V`` and
``d = ln(N/N0) - ln(1 + nu N/c)``:

    stick-slip starts by itself:  ``d > v``        (below the Hopf speed)
    a stick-slip cycle exists:    ``d > D(v)``     (below the fold), ``D(v) = -ln(2 I1e(v)/v)``

A belief is a set of weighted points ``(ln beta, ln N0)``, each with Gaussian uncertainties of the
friction level, the load and the speed to first order, so that

    ``P = sum_k w_k Phi((d_k - D(v_k)) / sd_k)``
    ``sd_k^2 = level^2 + (c/(c + nu N))^2 load^2 + (D'(v_k) v_k)^2 (speed_k^2 + beyond(N)^2)``

and the same with ``D(v) = v`` for the Hopf speed. Given ``beta`` this is exact for logarithmic
normal damping, friction and load. A look-up takes the probits from a table over ``d`` and the
distance from the nominal boundary in units of its spread, in which they are almost straight lines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray, flatten, in_blocks, restore
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.averaging.dimensionless import decline, speed_for_decline
from stickslip_monitor.physics.bessel import i0e, i1e, ndtr, ndtri
from stickslip_monitor.physics.friction import Stribeck, require_not_negative
from stickslip_monitor.physics.oscillator import Bearing

_REACH = 5.5
# Nodes over beta: more where its spread is wider than what else is uncertain.
_FEW_NODES, _MANY_NODES = 61, 201
# Rows and columns of a table: fewer where its values rest on random draws.
_FINE, _COARSE = (64, 192), (64, 96)
_WIDEST = 8.2
_LEAST_SPREAD = 1e-9
_HIGHEST_D = 6.0
_SMALL = 0.5
_BLOCK = 2**16
_BEYOND, _PER_OCTAVE, _MOST_BEYOND = 1.2, 0.2, 0.5
QUANTILES = (0.05, 0.5, 0.95)
"""The quantiles of a boundary that are told beside a probability."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Relative standard deviations of what a bearing's configuration states.

    Args:
        damping: Of ``c``.
        static: Of ``mu_s``.
        kinetic: Of ``mu_k``.
        decay: Of ``beta``.
        speed: Of the measured speed.
        load: Of the measured load.
        model_error: Of a boundary's speed, for what the averaged model leaves out.
        scatter: Of a boundary's speed from one passage to the next.

    Raises:
        PhysicsError: One of them is negative or not finite.
    """

    damping: float = 0.0
    static: float = 0.0
    kinetic: float = 0.0
    decay: float = 0.0
    speed: float = 0.0
    load: float = 0.0
    model_error: float = 0.0
    scatter: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            require_not_negative(f'tolerance.{item.name}', getattr(self, item.name))

    @property
    def is_exact(self) -> bool:
        """Whether nothing is uncertain."""
        return not any(getattr(self, item.name) for item in fields(self))

    @property
    def of_speed(self) -> float:
        """What is uncertain of a boundary's speed on every passage."""
        return math.hypot(self.speed, self.model_error, self.scatter)


EXACT = Tolerance()
"""Nothing is uncertain."""


class BoundaryPoints(NamedTuple):
    """Weighted points of what is believed of the two boundaries.

    Attributes:
        log_beta: ``ln beta`` [ln s/m], shape (k,).
        log_load: ``ln N0`` [ln N], shape (k,).
        weight: Adds up to 1, shape (k,).
        speed: Relative standard deviation of the boundary's speed, shape (k,).
        level: Standard deviation of ``d`` at any load.
        load: Standard deviation of ``d`` that the viscous rise makes smaller.
        viscous: ``nu/c`` [1/N].
        smoothing: Distance of neighbouring points in ``ln beta``; 0 for random ones.
        loads: The loads that the points are known at [N]; beyond them they are less so.
    """

    log_beta: FloatArray
    log_load: FloatArray
    weight: FloatArray
    speed: FloatArray
    level: float = 0.0
    load: float = 0.0
    viscous: float = 0.0
    smoothing: float = 0.0
    loads: tuple[float, float] = (0.0, math.inf)

    def decrement(self, load: FloatArray) -> FloatArray:
        """``ln(N/(1 + nu N/c))`` of loads > 0 [N]."""
        return np.log(load / (1.0 + self.viscous * load))

    def beyond(self, load: FloatArray) -> FloatArray:
        """What is uncertain of a boundary's speed at loads that no evidence covers."""
        low, high = self.loads
        ratio = np.maximum(low / load, load / high)
        return np.minimum(_PER_OCTAVE * np.log2(np.maximum(ratio / _BEYOND, 1.0)), _MOST_BEYOND)


class _Boundary(NamedTuple):
    """``D`` and ``D'(v) v`` of one boundary at ``v = beta V``."""

    value: FloatArray
    slope: FloatArray


def _fold(v: FloatArray) -> _Boundary:
    """Extended to negative ``v``, where nothing slides, so that no table has an edge at rest."""
    size = np.maximum(np.abs(v), 1e-9)
    i1 = i1e(size)
    value = np.log(0.5 * size / i1)
    ratio = i0e(size) / i1 - 2.0 / size
    if (v > 0.0).all():
        return _Boundary(value, (1.0 - ratio) * v)
    ahead = v > 0.0
    return _Boundary(
        np.where(ahead, value, value - 2.0 * size), np.where(ahead, 1.0 - ratio, 1.0 + ratio) * v
    )


def _hopf(v: FloatArray) -> _Boundary:
    return _Boundary(v, v)


_BOUNDARIES = (_fold, _hopf)


def _spread(points: BoundaryPoints, slope: FloatArray, load: FloatArray) -> FloatArray:
    """``sd_k``; arrays whose last axis is the points'."""
    share = 1.0 / (1.0 + points.viscous * load)
    speed = points.speed**2 + points.beyond(load) ** 2
    known = points.level**2 + (points.load * share) ** 2 + slope * slope * speed
    # A kernel as wide as the points are apart: else a sum over them would be a staircase.
    least = (0.75 * points.smoothing * (1.0 - slope)) ** 2
    return np.sqrt(np.maximum(np.maximum(known, least), _LEAST_SPREAD**2))


def _probits(
    points: BoundaryPoints, which: int, speed: FloatArray, load: FloatArray
) -> FloatArray:
    """``z`` with ``P = Phi(z)``, of flat arrays; negative speeds are extrapolated."""
    result = np.empty(speed.shape)
    rows = max(1, _BLOCK // points.weight.size)
    beta = np.exp(points.log_beta)
    for start in range(0, speed.size, rows):
        part = slice(start, start + rows)
        n = load[part, None]
        boundary = _BOUNDARIES[which](speed[part, None] * beta)
        excess = points.decrement(n) - points.log_load - boundary.value
        z = excess / _spread(points, boundary.slope, n)
        result[part] = z[:, 0] if z.shape[1] == 1 else _mixture_probit(z, points.weight)
    return result


def _mixture_probit(z: FloatArray, weight: FloatArray) -> FloatArray:
    """The probit of an average of probabilities."""
    p = ndtr(z) @ weight
    return ndtri(np.minimum(np.maximum(p, np.finfo(float).tiny), 1.0 - np.finfo(float).epsneg))


class _Table(NamedTuple):
    """Probits over ``d`` (rows) and the distance from the boundary in spreads (columns).

    Attributes:
        first: The least nominal ``d``.
        per_row: Rows for each unit of ``d``.
        per_column: Columns for each spread.
        spread: Spread of ``d - D`` of each row, shape (rows,).
        probit: Shape (rows, columns).
        lists: ``spread`` and ``probit`` as lists, for single points.
    """

    first: float
    per_row: float
    per_column: float
    spread: FloatArray
    probit: FloatArray
    lists: tuple[list[float], list[list[float]]]

    def look_up(self, d: FloatArray, value: FloatArray) -> FloatArray:
        """Probits at nominal ``d`` within the table and ``D`` there, each shape (n,)."""
        rows, columns = self.probit.shape
        place = np.clip((d - self.first) * self.per_row, 0.0, rows - 1.000001)
        row = place.astype(np.intp)
        place -= row
        spread = self.spread[row]
        spread += (self.spread[1:] - self.spread[:-1])[row] * place
        along = np.clip(((value - d) / spread + _WIDEST) * self.per_column, 0, columns - 1.000001)
        column = along.astype(np.intp)
        along -= column
        flat, at = self.probit.reshape(-1), row * columns + column
        low, high = flat[at], flat[at + columns]
        low += (flat[at + 1] - low) * along
        high += (flat[at + columns + 1] - high) * along
        high -= low
        high *= place
        high += low
        return high

    def look_up_one(self, d: float, value: float) -> float:
        """:meth:`look_up` of one point, to the last bit, without the cost of arrays."""
        spreads, probits = self.lists
        place = min(max((d - self.first) * self.per_row, 0.0), len(spreads) - 1.000001)
        row = int(place)
        share = place - row
        spread = spreads[row] + (spreads[row + 1] - spreads[row]) * share
        one, two = probits[row], probits[row + 1]
        along = ((value - d) / spread + _WIDEST) * self.per_column
        along = min(max(along, 0.0), len(one) - 1.000001)
        column = int(along)
        part = along - column
        low = one[column] + (one[column + 1] - one[column]) * part
        high = two[column] + (two[column + 1] - two[column]) * part
        return low + (high - low) * share


def _value_of_one(v: float) -> float:
    """``D(v)`` of a number > 0, to the last bit that of an array."""
    if v > _SMALL:
        return float(np.log(0.5 * v / i1e(v)))
    quarter, total = 0.25 * v * v, 0.0
    for k in range(8, 0, -1):
        total = (total + 1.0) * quarter / (k * (k + 1.0))
    return float(v - np.log1p(total))


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is believed of a bearing's boundaries, as probabilities and quantiles.

    Speeds are magnitudes of the journal's surface speed [m/s]; loads are in N. A probability is 0
    without load, and ``nan`` where the shaft is at rest or an input is not finite.

    Attributes:
        points: The weighted points that everything is worked out from.
    """

    points: BoundaryPoints
    _beta: float = field(init=False, repr=False)
    _log_load: float = field(init=False, repr=False)
    _top: float = field(init=False, repr=False)
    _tables: tuple[_Table, _Table] = field(init=False, repr=False)
    _bands: tuple[FloatArray, FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = self.points
        centre = points.log_beta @ points.weight, points.log_load @ points.weight
        object.__setattr__(self, '_beta', math.exp(centre[0]))
        object.__setattr__(self, '_log_load', float(centre[1]))
        limit = math.inf if points.viscous == 0.0 else -math.log(points.viscous) - centre[1]
        first = -_WIDEST * max(self._deviation(), _LEAST_SPREAD) - 0.1
        top = float(max(min(_HIGHEST_D, limit - 1e-6), first + 0.1))
        object.__setattr__(self, '_top', top)
        tables = tuple(self._table(which, first, top) for which in range(2))
        object.__setattr__(self, '_tables', tables)
        object.__setattr__(self, '_bands', self._quantile_bands())

    @classmethod
    def from_tolerance(cls, bearing: Bearing, tolerance: Tolerance) -> Belief:
        """The belief that a bearing's nominal values and their tolerances make.

        Args:
            bearing: With the Stribeck law, damping > 0 and ``mu_s > mu_k``.
            tolerance: Relative standard deviations.

        Raises:
            PhysicsError: The bearing is another; the text says which rule it breaks.
        """
        law = _stribeck(bearing)
        fall = law.static - law.kinetic
        level = math.hypot(tolerance.static * law.static, tolerance.kinetic * law.kinetic) / fall
        wide = tolerance.decay > math.hypot(level, tolerance.damping, tolerance.load)
        nodes = (_MANY_NODES if wide else _FEW_NODES) if tolerance.decay else 1
        reach = np.linspace(-_REACH, _REACH, nodes) if nodes > 1 else np.zeros(1)
        weight = np.exp(-0.5 * reach * reach)
        log_beta = math.log(law.decay) + tolerance.decay * reach
        return cls(
            BoundaryPoints(
                log_beta,
                math.log(bearing.damping / fall) - log_beta,
                weight / weight.sum(),
                np.full(reach.size, tolerance.of_speed),
                level,
                math.hypot(tolerance.damping, tolerance.load),
                law.viscous / bearing.damping,
                tolerance.decay * 2.0 * _REACH / max(nodes - 1, 1),
            )
        )

    @classmethod
    def from_draws(
        cls,
        draws: ArrayLike,
        floor: float,
        viscous: float = 0.0,
        loads: tuple[float, float] = (0.0, math.inf),
        tolerance: Tolerance | None = None,
    ) -> Belief:
        """The belief that a calibration has left.

        Args:
            draws: Of ``ln beta``, ``ln N0`` and ``ln s``, equally probable, shape (k, 3).
            floor: Relative error of a boundary's speed that no evidence takes away.
            viscous: ``nu/c`` [1/N].
            loads: The loads that the evidence covers [N].
            tolerance: What is uncertain of the measured speed and load besides.
        """
        log_beta, log_load, log_scatter = np.asarray(draws, dtype=float).T
        sensors = tolerance or Tolerance()
        return cls(
            BoundaryPoints(
                log_beta,
                log_load,
                np.full(log_beta.size, 1.0 / log_beta.size),
                np.sqrt(np.exp(2.0 * log_scatter) + floor**2 + sensors.speed**2),
                load=sensors.load,
                viscous=viscous,
                loads=loads,
            )
        )

    def nominal(self, bearing: Bearing) -> Bearing:
        """A bearing with the same ``mu_s`` and ``mu_k`` that has the middle's boundaries.

        Raises:
            PhysicsError: Its law is not Stribeck's, or rises with speed.
        """
        law = _stribeck(bearing)
        damping = math.exp(self._log_load) * (law.static - law.kinetic) * self._beta
        viscous = self.points.viscous * damping
        friction = replace(law, decay=self._beta, viscous=viscous)
        return replace(bearing, damping=damping, friction=friction)

    def lean(self, p: float) -> float:
        """Factor of ``N/N0`` that takes the middle to where it starts with the probability ``p``.

        To first order, at the load whose Hopf speed is ``1/beta``; 1 for ``p = 0.5``.
        """
        d = np.ones(1)
        spread = float(self._first_order_spread(1, d, self._load_at(d))[0])
        return math.exp(-spread * float(ndtri(min(max(p, 1e-9), 1.0 - 1e-9))))

    def can(self, speed: ArrayLike, load: ArrayLike) -> Any:
        """The probability that a stick-slip cycle exists; inputs broadcast."""
        return self.probabilities(speed, load)[0]

    def will(self, speed: ArrayLike, load: ArrayLike) -> Any:
        """The probability that stick-slip starts by itself; inputs broadcast."""
        return self.probabilities(speed, load)[1]

    def probabilities(
        self, speed: ArrayLike, load: ArrayLike, share: ArrayLike = 1.0
    ) -> tuple[Any, Any]:
        """:meth:`can` and :meth:`will`.

        Args:
            speed: Surface speed [m/s].
            load: Load [N]; broadcasts with ``speed``.
            share: Of the averaged fold in the one that counts, at most 1; broadcasts.
        """
        if isinstance(speed, float) and isinstance(load, float) and isinstance(share, float):
            return self._probabilities_of_one(abs(speed), load, share)
        shape, (v, n, part) = flatten(speed, load, share)
        known = np.isfinite(v) & np.isfinite(n) & (v != 0.0)
        moved = known & (n > 0.0)
        can, will = (np.where(known, 0.0, np.nan) for _ in range(2))
        with np.errstate(all='ignore'):
            found = in_blocks(self._looked_up, np.abs(v[moved]), n[moved], part[moved])
        can[moved], will[moved] = found
        return restore(can, shape), restore(will, shape)

    def fold_speed(self, load: ArrayLike, p: float) -> Any:
        """The ``p`` quantile of the fold speed at a load [m/s]; 0 where there is none."""
        return self._quantile(0, load, p)

    def hopf_speed(self, load: ArrayLike, p: float) -> Any:
        """The ``p`` quantile of the Hopf speed at a load [m/s]; 0 where there is none."""
        return self._quantile(1, load, p)

    def exact_probabilities(self, speed: ArrayLike, load: ArrayLike) -> tuple[Any, Any]:
        """:meth:`probabilities` without the table, for speeds and loads > 0."""
        shape, (v, n) = flatten(speed, load)
        can, will = (ndtr(_probits(self.points, which, v, n)) for which in range(2))
        return restore(can, shape), restore(np.minimum(will, can), shape)

    def fold_margins(self, speed: ArrayLike, load: ArrayLike) -> tuple[Any, Any]:
        """5 % and 95 % quantile of the fold margin ``V/V_F - 1``; inputs broadcast.

        ``inf`` where that share of the belief has no fold, ``nan`` without a probability.
        """
        shape, (v, n) = flatten(speed, load)
        known = np.isfinite(v) & np.isfinite(n) & (v != 0.0)
        margins = []
        for share in (2, 0):
            fold = self._band(np.where(known & (n > 0.0), n, 1.0), share)
            there = (fold > 0.0) & (n > 0.0)
            margin = np.where(there, np.abs(v) / np.where(there, fold, 1.0) - 1.0, np.inf)
            margins.append(restore(np.where(known, margin, np.nan), shape))
        return margins[0], margins[1]

    def fold_band(self, load: float) -> tuple[float, float, float]:
        """The :data:`QUANTILES` of the fold speed at a load > 0 [m/s], looked up."""
        n = np.array([load])
        low, middle, high = (float(self._band(n, share)[0]) for share in range(3))
        return low, middle, high

    def _band(self, load: FloatArray, share: int) -> FloatArray:
        log_loads, speeds = self._bands
        found = np.interp(np.log(load), log_loads, speeds[share])
        far = np.flatnonzero(np.log(load) > log_loads[-1])
        if far.size:
            found[far] = self.fold_speed(load[far], QUANTILES[share])
        return found

    def _probabilities_of_one(self, v: float, n: float, share: float) -> tuple[float, float]:
        if not (0.0 < v < math.inf and math.isfinite(n)):
            return math.nan, math.nan
        if n <= 0.0:
            return 0.0, 0.0
        d = float(np.log(n / (1.0 + self.points.viscous * n))) - self._log_load
        if d > self._top:
            can, will = (
                self.exact_probabilities(v * share, n)[0],
                self.exact_probabilities(v, n)[1],
            )
            return can, min(will, can)
        v *= self._beta
        fold, hopf = self._tables
        can = float(ndtr(fold.look_up_one(d, _value_of_one(v * share))))
        will = float(ndtr(hopf.look_up_one(d, v)))
        return can, min(will, can)

    def _looked_up(
        self, v: FloatArray, n: FloatArray, share: FloatArray
    ) -> tuple[NDArray[Any], ...]:
        d = self.points.decrement(n) - self._log_load
        scaled = self._beta * v
        can = ndtr(self._tables[0].look_up(d, decline(scaled * share)))
        will = np.minimum(ndtr(self._tables[1].look_up(d, scaled)), can)
        far = np.flatnonzero(d > self._top)
        if far.size:
            can[far] = self.exact_probabilities((v * share)[far], n[far])[0]
            will[far] = np.minimum(self.exact_probabilities(v[far], n[far])[1], can[far])
        return can, will

    def _deviation(self) -> float:
        """Standard deviation of ``d`` where the speed does not matter."""
        points = self.points
        off = points.log_load - self._log_load
        return math.sqrt(float(points.weight @ off**2) + points.level**2 + points.load**2)

    def _table(self, which: int, first: float, top: float) -> _Table:
        rows, columns = _FINE if self.points.weight.size <= _MANY_NODES else _COARSE
        d = np.linspace(first, top, rows)
        load = self._load_at(d)
        spread = self._first_order_spread(which, d, load)
        value = d[:, None] + np.linspace(-_WIDEST, _WIDEST, columns) * spread[:, None]
        v = value if which else _inverse_fold(value)
        loads = np.broadcast_to(load[:, None], value.shape)
        z = _probits(self.points, which, v.ravel() / self._beta, loads.ravel())
        probit = np.minimum.accumulate(z.reshape(value.shape), axis=1)
        return _Table(
            first,
            (rows - 1.0) / (top - first),
            (columns - 1.0) / (2.0 * _WIDEST),
            spread,
            probit,
            (spread.tolist(), probit.tolist()),
        )

    def _load_at(self, d: FloatArray) -> FloatArray:
        share = np.exp(d + self._log_load)
        return share / (1.0 - self.points.viscous * share)

    def _first_order_spread(self, which: int, d: FloatArray, load: FloatArray) -> FloatArray:
        """Spread of ``d - D`` over all points at the nominal boundary, shape of ``d``."""
        points = self.points
        v = d if which else _inverse_fold(d)
        slope = _BOUNDARIES[which](v).slope
        off_beta = points.log_beta - math.log(self._beta)
        off = (points.log_load - self._log_load) + slope[:, None] * off_beta
        own = _spread(points, slope[:, None], load[:, None])
        return np.maximum(np.sqrt((off**2 + own**2) @ points.weight), _LEAST_SPREAD)

    def _quantile_bands(self) -> tuple[FloatArray, FloatArray]:
        """Logarithms of loads, and the :data:`QUANTILES` of the fold speed there."""
        table = self._tables[0]
        rows, columns = table.probit.shape
        d, nodes = np.linspace(table.first, self._top, rows), np.linspace(-1.0, 1.0, columns)
        # Probits fall along a row, and the p quantile is where 1 - p are above.
        off = [
            np.interp(ndtri(QUANTILES), -z, nodes) * (_WIDEST * s)
            for z, s in zip(table.probit, table.spread, strict=True)
        ]
        fine = np.linspace(table.first, self._top, 1024)
        value = np.stack([np.interp(fine, d, d + column) for column in np.transpose(off)])
        speeds = np.where(value > 0.0, _inverse_fold(np.maximum(value, 1e-12)) / self._beta, 0.0)
        return np.log(self._load_at(fine)), speeds

    def _quantile(self, which: int, load: ArrayLike, p: float) -> Any:
        if not 0.0 < p < 1.0:
            raise PhysicsError(f'p = {p:g} must be between 0 and 1')
        shape, (n,) = flatten(load)
        wanted = -float(ndtri(p))
        log_v = np.stack([np.full(n.shape, -12.0), np.full(n.shape, 12.0)])
        loaded = np.where(n > 0.0, n, 1.0)
        for _ in range(60):
            middle = 0.5 * (log_v[0] + log_v[1])
            v = np.exp(middle) / self._beta
            above = _probits(self.points, which, v, loaded) > wanted
            log_v = np.where(above, np.stack([middle, log_v[1]]), np.stack([log_v[0], middle]))
        none = (log_v[0] <= -12.0) | ~(n > 0.0)
        return restore(np.where(none, 0.0, np.exp(log_v[0]) / self._beta), shape)


def _inverse_fold(value: FloatArray) -> FloatArray:
    """The ``v`` at which ``D(v)`` has a value; continued to negative ones."""
    v = np.where(value > 0.0, 0.0, value)
    ahead = value > 0.0
    v[ahead] = speed_for_decline(np.minimum(value[ahead], 300.0))
    behind = ~ahead
    if behind.any():
        # d D / d v lies between 1 and 2 there.
        wanted, guess = value[behind], 0.6 * value[behind]
        for _ in range(30):
            boundary = _fold(np.minimum(guess, -1e-9))
            guess = guess - (boundary.value - wanted) / (boundary.slope / np.minimum(guess, -1e-9))
        v[behind] = guess
    return v


def _stribeck(bearing: Bearing) -> Stribeck:
    law = bearing.friction
    if not isinstance(law, Stribeck):
        raise PhysicsError(
            'a tolerance needs the friction law stribeck, and this is'
            f' {type(law).__name__.lower()}'
        )
    if not bearing.damping > 0.0:
        raise PhysicsError('damping = 0 N s/m must be greater than 0 where a tolerance is given')
    if not law.static > law.kinetic:
        raise PhysicsError(
            f'static = {law.static:g} must be above kinetic = {law.kinetic:g} where a tolerance is'
            ' given'
        )
    return law


def probability_runs(can: FloatArray, will: FloatArray, before: float = 0.0) -> FloatArray:
    """The probability that stick-slip runs, by thresholds with the memory of the bistable range.

    Whoever starts at a probability ``will`` and ends at ``can`` runs with ``r <- min(max(r, will),
    can)`` afterwards, if the points of the belief pass their boundaries in one order.

    Args:
        can: Shape (n,), in order of time; ``nan`` changes nothing.
        will: Shape (n,).
        before: The probability before the first.

    Returns:
        The probability after each, shape (n,).
    """
    low = np.where(np.isnan(will), 0.0, will)
    high = np.where(np.isnan(can), 1.0, can)
    step = 1
    while step < low.size:
        # The clip of the last `step` points after the clip of those before them.
        earlier = low[:-step], high[:-step]
        both = [np.minimum(np.maximum(e, low[step:]), high[step:]) for e in earlier]
        low[step:], high[step:] = both
        step *= 2
    result: FloatArray = np.minimum(np.maximum(before, low), high)
    return result
