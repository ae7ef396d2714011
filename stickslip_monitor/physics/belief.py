# SPDX-License-Identifier: Apache-2.0
"""How probable stick-slip is at an operating point of a bearing with uncertain parameters.

With the decay ``beta`` of the Stribeck law, ``Delta = mu_s - mu_k`` and ``N0 = c/(Delta beta)``
the averaged model's two boundaries follow from ``v = beta V`` and
``d = ln(N/N0) - ln(1 + nu N/c)``:

    stick-slip starts by itself:  ``d > v``        (below the Hopf speed)
    a stick-slip cycle exists:    ``d > D(v)``     (below the fold), ``D(v) = -ln(2 I1e(v)/v)``

A belief is a set of weighted points ``(ln beta, ln N0)``, each with Gaussian uncertainties of the
friction level, the load and the speed to first order, so that

    ``P = sum_k w_k Phi((d_k - D(v_k)) / sd_k)``
    ``sd_k^2 = level_k^2 + (c/(c + nu N))^2 load^2 + (D'(v_k) v_k)^2 (speed_k^2 + beyond(N)^2)``

and the same with ``D(v) = v`` for the Hopf speed. Given ``beta`` this is exact for logarithmic
normal damping, friction and load. The sums are tabulated once, as probits over ``d`` and the
distance from the nominal boundary in units of its spread, in which they are almost straight lines.
The look-ups are plain functions of numbers and one flat table: they run as they stand for single
points, and compiled for long recordings.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import i0e, i1e, ndtr, ndtri

from stickslip_monitor import jit
from stickslip_monitor.arrays import FloatArray, flatten, restore
from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics import chances
from stickslip_monitor.physics.averaging.closed_form import decline, speed_for_decline
from stickslip_monitor.physics.chances import (
    CURVE_FIRST,
    CURVE_LAST,
    CURVE_SIZE,
    CURVE_STEP,
    FOLD,
    HEAD,
    HOPF,
    WIDEST,
)
from stickslip_monitor.physics.friction import Stribeck, as_stribeck
from stickslip_monitor.physics.oscillator import Bearing
from stickslip_monitor.physics.quantities import require_not_negative

QUANTILES = (0.05, 0.5, 0.95)
"""The quantiles of a boundary that are shown beside a probability."""

_REACH = 5.5
# Nodes over beta: more where its spread is wider than what else is uncertain, fewer where those
# over mu_s - mu_k smooth the sum.
_FEW_NODES, _MANY_NODES, _SMOOTHED_NODES = 61, 201, 25
# A relative spread of mu_s - mu_k up to which its logarithm is taken as normal; beyond, mu_s and
# mu_k are, by nodes this far apart that are smoothed by a normal distribution this wide.
_NORMAL_LEVEL, _LEVEL_STEP, _LEVEL_WIDTH, _LEAST_LEVEL = 0.081, 0.5, 0.35, 0.02
# Rows and columns of a table: fewer where it sums over many points.
_FINE, _COARSE = (64, 192), (64, 96)
_LEAST_SPREAD = 1e-9
_HIGHEST_D = 8.0
_BLOCK = 2**16
_BEYOND, _PER_OCTAVE, _MOST_BEYOND = 1.2, 0.2, 0.5
# From this many points on compiling repays its time.
_MANY_POINTS = 100_000


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

    def of_fall(self, law: Stribeck) -> float:
        """Relative standard deviation of ``mu_s - mu_k``."""
        both = math.hypot(self.static * law.static, self.kinetic * law.kinetic)
        return both / (law.static - law.kinetic)


EXACT = Tolerance()
"""Nothing is uncertain."""


class BoundaryPoints(NamedTuple):
    """Weighted points of the distribution of the two boundaries.

    Attributes:
        log_beta: ``ln beta`` [ln s/m], shape (k,).
        log_load: ``ln N0`` [ln N], shape (k,).
        weight: Adds up to 1, shape (k,).
        speed: Relative standard deviation of the boundary's speed, shape (k,).
        level: Standard deviation of ``d`` at any load, shape (k,).
        load: Standard deviation of ``d`` that the viscous rise makes smaller.
        viscous: ``nu/c`` [1/N].
        smoothing: Distance of neighbouring points in ``ln beta``; 0 for random ones.
        loads: The loads that the points are known at [N]; beyond them they are less so.
    """

    log_beta: FloatArray
    log_load: FloatArray
    weight: FloatArray
    speed: FloatArray
    level: FloatArray
    load: float = 0.0
    viscous: float = 0.0
    smoothing: float = 0.0
    loads: tuple[float, float] = (0.0, math.inf)

    def spread(self, slope: FloatArray, load: FloatArray) -> FloatArray:
        """``sd_k`` where ``D'(v) v`` is ``slope``; arrays whose last axis is the points'."""
        low, high = self.loads
        ratio = np.maximum(low / load, load / high)
        beyond = _PER_OCTAVE * np.log2(np.maximum(ratio / _BEYOND, 1.0))
        speed = self.speed**2 + np.minimum(beyond, _MOST_BEYOND) ** 2
        share = 1.0 / (1.0 + self.viscous * load)
        known = self.level**2 + (self.load * share) ** 2 + slope * slope * speed
        # A kernel as wide as the points are apart: else a sum over them would be a staircase.
        least = (0.75 * self.smoothing * (1.0 - slope)) ** 2
        return np.sqrt(np.maximum(np.maximum(known, least), _LEAST_SPREAD**2))

    def probits(self, which: int, speed: FloatArray, load: FloatArray) -> FloatArray:
        """``z`` with ``P = Phi(z)`` without a table, of flat arrays of loads > 0.

        Below a speed of 0, where nothing slides, ``D`` is continued by a straight line.
        """
        result = np.empty(speed.shape)
        rows = max(1, _BLOCK // self.weight.size)
        for start in range(0, speed.size, rows):
            part = slice(start, start + rows)
            n = load[part, None]
            value, slope = _boundary(which, speed[part, None] * np.exp(self.log_beta))
            d = np.log(n / (1.0 + self.viscous * n)) - self.log_load
            z = (d - value) / self.spread(slope, n)
            result[part] = z[:, 0] if z.shape[1] == 1 else _mixture_probit(z, self.weight)
        return result


def _boundary(which: int, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``D`` and ``D'(v) v`` of a boundary."""
    if which == HOPF:
        return v, v
    size = np.maximum(v, 1e-9)
    ahead = v > 0.0
    slope = (1.0 - (i0e(size) / i1e(size) - 2.0 / size)) * v
    return np.where(ahead, decline(size), v), np.where(ahead, slope, v)


@functools.cache
def curve_of_decline() -> FloatArray:
    """The beginning of every table: its head, left empty, and the curve of ``D``."""
    v = np.exp(np.linspace(CURVE_FIRST, CURVE_LAST, CURVE_SIZE))
    value, slope = _boundary(FOLD, v)
    return np.concatenate([np.zeros(HEAD), value, slope * CURVE_STEP])


def _mixture_probit(z: FloatArray, weight: FloatArray) -> FloatArray:
    """The probit of an average of probabilities."""
    p = ndtr(z) @ weight
    return ndtri(np.clip(p, np.finfo(float).tiny, 1.0 - np.finfo(float).epsneg))


def _speed_at(which: int, value: FloatArray) -> FloatArray:
    """The ``v`` at which a boundary's ``D`` has a value."""
    if which == HOPF:
        return value
    v = speed_for_decline(np.clip(value, 1e-9, 300.0))
    return np.where(value > 0.0, v, value)


def _loop(plain: Callable[..., None], size: int) -> Callable[..., None]:
    """A loop over points as it stands, or compiled where there are many."""
    many = size >= _MANY_POINTS and jit.has_compiler()
    return jit.compiled(plain.__name__, chances) if many else plain


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """The distribution of a bearing's boundaries, as probabilities and quantiles.

    Speeds are magnitudes of the journal's surface speed [m/s]; loads are in N. A probability is 0
    without load, and ``nan`` where the shaft is at rest or an input is not finite.

    Attributes:
        points: The weighted points that everything is worked out from.
        log_beta: ``ln beta`` in the middle of them.
        log_load: ``ln N0`` in the middle of them.
        table: What :func:`probit` and :func:`boundary_speed` look up.
    """

    points: BoundaryPoints
    log_beta: float
    log_load: float
    table: FloatArray = field(init=False, repr=False)
    _numbers: list[float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'table', self._tabulated())
        object.__setattr__(self, '_numbers', self.table.tolist())

    @classmethod
    def from_tolerance(cls, bearing: Bearing, tolerance: Tolerance) -> Belief:
        """The belief that a bearing's nominal values and their tolerances make.

        Args:
            bearing: With the Stribeck law, damping > 0 and ``mu_s > mu_k``.
            tolerance: Relative standard deviations.

        Raises:
            PhysicsError: The bearing is another; the text says which rule it breaks.
        """
        law = require_stribeck(bearing)
        level = tolerance.of_fall(law)
        other = math.hypot(tolerance.damping, tolerance.load)
        log_fall, level_weight, levels = _fall_nodes(level)
        nodes = _MANY_NODES if tolerance.decay > math.hypot(level, other) else _FEW_NODES
        nodes = _SMOOTHED_NODES if levels.size > 1 else nodes
        reach = np.linspace(-_REACH, _REACH, nodes) if tolerance.decay else np.zeros(1)
        beta, fall = (grid.ravel() for grid in np.meshgrid(tolerance.decay * reach, log_fall))
        weight = np.outer(level_weight, np.exp(-0.5 * reach * reach)).ravel()
        log_beta = math.log(law.decay)
        log_load = math.log(bearing.damping / (law.static - law.kinetic)) - log_beta
        points = BoundaryPoints(
            log_beta + beta,
            log_load - fall - beta,
            weight / weight.sum(),
            np.full(beta.size, tolerance.of_speed),
            np.repeat(levels, reach.size),
            other,
            law.viscous / bearing.damping,
            tolerance.decay * 2.0 * _REACH / (nodes - 1),
        )
        return cls(points, log_beta, log_load)

    @classmethod
    def from_draws(
        cls,
        draws: ArrayLike,
        floor: float,
        viscous: float = 0.0,
        loads: tuple[float, float] = (0.0, math.inf),
        tolerance: Tolerance = EXACT,
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
        points = BoundaryPoints(
            log_beta,
            log_load,
            np.full(log_beta.size, 1.0 / log_beta.size),
            np.sqrt(np.exp(2.0 * log_scatter) + floor**2 + tolerance.speed**2),
            np.zeros(log_beta.size),
            tolerance.load,
            viscous,
            loads=loads,
        )
        return cls(points, float(log_beta.mean()), float(log_load.mean()))

    def nominal(self, bearing: Bearing) -> Bearing:
        """A bearing with the same ``mu_s`` and ``mu_k`` that has the middle's boundaries.

        Raises:
            PhysicsError: Its law is not Stribeck's, or rises with speed.
        """
        law = require_stribeck(bearing)
        decay = math.exp(self.log_beta)
        damping = math.exp(self.log_load) * (law.static - law.kinetic) * decay
        friction = replace(law, decay=decay, viscous=self.points.viscous * damping)
        return replace(bearing, damping=damping, friction=friction)

    def lean(self, p: float) -> float:
        """Factor of ``N/N0`` that takes the middle to where it starts with the probability ``p``.

        To first order, at the load whose Hopf speed is ``1/beta``; 1 for ``p = 0.5``.
        """
        spread = float(self._first_order_spread(HOPF, np.ones(1))[0])
        return math.exp(-spread * float(ndtri(min(max(p, 1e-9), 1.0 - 1e-9))))

    def probabilities(
        self, speed: ArrayLike, load: ArrayLike, share: ArrayLike = 1.0
    ) -> tuple[Any, Any]:
        """The probabilities that a stick-slip cycle exists, and that it starts by itself.

        Of surface speeds [m/s] and loads [N]; ``share`` is that of the averaged fold in the one
        that counts, at most 1. Inputs broadcast.
        """
        if isinstance(speed, float) and isinstance(load, float) and isinstance(share, float):
            return chances.chances(self._numbers, abs(speed), load, share)
        shape, (v, n, part) = flatten(speed, load, share)
        points, out = np.column_stack([np.abs(v), n, part]), np.empty((v.size, 2))
        _loop(chances.fill_chances, v.size)(self.table, points, out)
        return restore(out[:, 0], shape), restore(out[:, 1], shape)

    def fold_speed(self, load: ArrayLike, p: float) -> Any:
        """The ``p`` quantile of the fold speed at a load [m/s]; 0 where there is none."""
        return self._quantile(FOLD, load, p)

    def hopf_speed(self, load: ArrayLike, p: float) -> Any:
        """The ``p`` quantile of the Hopf speed at a load [m/s]; 0 where there is none."""
        return self._quantile(HOPF, load, p)

    def _quantile(self, which: int, load: ArrayLike, p: float) -> Any:
        if not 0.0 < p < 1.0:
            raise PhysicsError(f'p = {p:g} must be between 0 and 1')
        z = float(ndtri(p))
        if isinstance(load, float):
            return chances.boundary_speed(self._numbers, which, load, z)
        shape, (n,) = flatten(load)
        out = np.empty(n.size)
        _loop(chances.fill_speeds, n.size)(self.table, which, n, z, out)
        return restore(out, shape)

    def fold_margins(self, speed: ArrayLike, load: ArrayLike) -> tuple[Any, Any]:
        """5 % and 95 % quantile of the fold margin ``V/V_F - 1``; inputs broadcast.

        ``inf`` where that share of the belief has no fold, ``nan`` without a probability.
        """
        shape, (v, n) = flatten(speed, load)
        known = np.isfinite(v) & np.isfinite(n) & (v != 0.0)
        margins = []
        for p in (QUANTILES[2], QUANTILES[0]):
            fold = np.asarray(self.fold_speed(np.where(known, n, 0.0), p))
            margin = np.full(v.size, np.inf)
            np.divide(np.abs(v), fold, out=margin, where=fold > 0.0)
            margins.append(restore(np.where(known, margin - 1.0, np.nan), shape))
        return margins[0], margins[1]

    def _tabulated(self) -> FloatArray:
        points = self.points
        rows, columns = _FINE if points.weight.size <= _MANY_NODES else _COARSE
        off = points.log_load - self.log_load
        deviation = math.sqrt(float(points.weight @ (off**2 + points.level**2)) + points.load**2)
        first = -WIDEST * max(deviation, _LEAST_SPREAD) - 0.1
        most = -math.log(points.viscous) - self.log_load - 1e-6 if points.viscous else math.inf
        d = np.linspace(first, max(min(_HIGHEST_D, most), first + 0.1), rows)
        head = (self.log_beta, self.log_load, points.viscous, first, 1.0 / (d[1] - d[0]))
        parts = [part for which in (FOLD, HOPF) for part in self._rows(which, d, columns)]
        return np.concatenate([[*head, rows, columns], curve_of_decline()[HEAD:], *parts])

    def _rows(self, which: int, d: FloatArray, columns: int) -> tuple[FloatArray, FloatArray]:
        """Spread of each row, and their probits one row after the other."""
        spread = self._first_order_spread(which, d)
        value = d[:, None] + np.linspace(-WIDEST, WIDEST, columns) * spread[:, None]
        speed = _speed_at(which, value.ravel()) / math.exp(self.log_beta)
        z = self.points.probits(which, speed, np.repeat(self._load_at(d), columns))
        return spread, np.minimum.accumulate(z.reshape(value.shape), axis=1).ravel()

    def _load_at(self, d: FloatArray) -> FloatArray:
        share = np.exp(d + self.log_load)
        return share / (1.0 - self.points.viscous * share)

    def _first_order_spread(self, which: int, d: FloatArray) -> FloatArray:
        """Spread of ``d - D`` over all points at the nominal boundary, shape of ``d``."""
        points = self.points
        _, slope = _boundary(which, _speed_at(which, d)[:, None])
        off = points.log_load - self.log_load + slope * (points.log_beta - self.log_beta)
        own = points.spread(slope, self._load_at(d)[:, None])
        return np.maximum(np.sqrt((off**2 + own**2) @ points.weight), _LEAST_SPREAD)


def _fall_nodes(level: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``ln`` of ``mu_s - mu_k`` by its nominal value: nodes, weights and spread about each.

    Args:
        level: Relative standard deviation of ``mu_s - mu_k``.
    """
    if level <= _NORMAL_LEVEL:
        return np.zeros(1), np.ones(1), np.full(1, level)
    node = np.arange(-3.5, 3.51, _LEVEL_STEP)
    weight = np.exp(-0.5 * node**2 / (1.0 - _LEVEL_WIDTH**2))
    # Where mu_s is not above mu_k nothing sticks: as with a fall that is next to nothing.
    fall = np.maximum(1.0 + level * node, _LEAST_LEVEL)
    spread = level * _LEVEL_WIDTH / np.maximum(fall, level)
    return np.log(fall) - 0.5 * spread**2, weight, spread


def require_stribeck(bearing: Bearing, what: str = 'a tolerance') -> Stribeck:
    """The law of a bearing that has the two boundaries.

    Raises:
        PhysicsError: Its law is not Stribeck's, or neither damped nor falling.
    """
    law = as_stribeck(bearing.friction, what)
    if not bearing.damping > 0.0:
        raise PhysicsError(f'damping = 0 N s/m must be greater than 0 where {what} is given')
    if not law.static > law.kinetic:
        raise PhysicsError(
            f'static = {law.static:g} must be above kinetic = {law.kinetic:g} where {what} is'
            ' given'
        )
    return law


def probability_runs(can: FloatArray, will: FloatArray, before: float = 0.0) -> FloatArray:
    """:func:`runs_after` each of some points in order of time, shape (n,); ``nan`` changes none.

    ``before`` is the probability before the first.
    """
    result = np.empty(can.size)
    _loop(chances.fill_runs, can.size)(can, will, before, result)
    return result
