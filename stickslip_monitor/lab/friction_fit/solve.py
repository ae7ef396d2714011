# SPDX-License-Identifier: Apache-2.0
"""The robust fit of a model to a curve, without a start value.

For a given rate of decay the law is linear (variable projection: Golub and Pereyra, SIAM J. Numer.
Anal. 10, 1973), so the rate is searched over all its decades by two criteria that outliers hardly
move: the least sum, and the least median, of absolute residuals. From there Tukey's biweight
(Beaton and Tukey, Technometrics 16, 1974) is iterated to convergence, with the scale from the
median absolute residual.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.friction_fit.curve_file import FrictionCurve

UNITS = {'static': '', 'kinetic': '', 'decay': 's/m', 'viscous': 's/m'}
TUKEY = 4.685
"""Residuals beyond this many scales count nothing; on clean data 95 % efficient."""
FLOOR = 1e-14
"""Exact data keep a scatter of this share of the largest coefficient."""
_PER_DECADE = 10
_SUBSETS = 60
_MEDIAN_POINTS = 200
_MAD = 1.482602218505602
_STEPS = 400
_SMALL_SAMPLE = 2.0
_NORMAL_SHARE = 0.8281
_TOLERANCE = 1e-11


@dataclass(frozen=True, slots=True)
class Model:
    """Which coefficients are free besides the drop and the decay."""

    viscous: bool
    kinetic: bool = True

    @property
    def size(self) -> int:
        """Number of free coefficients, k."""
        return 2 + self.kinetic + self.viscous

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free coefficients, in the order of ``UNITS``."""
        free = {'static': True, 'kinetic': self.kinetic, 'decay': True, 'viscous': self.viscous}
        return tuple(name for name in UNITS if free[name])


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The best curve of a model; ``drop`` is that of the decaying part at the lowest speed."""

    curve: FrictionCurve
    model: Model
    drop: float
    kinetic: float
    decay: float
    viscous: float
    residual: FloatArray
    weight: FloatArray
    scale: float

    @property
    def row_weight(self) -> FloatArray:
        """Weights of the squared residuals: Tukey's, by the variance of each point."""
        return self.weight / self.curve.std**2

    @property
    def freedom(self) -> float:
        """Degrees of freedom: the sum of the weights less k."""
        return float(self.weight.sum()) - self.model.size

    @property
    def squares(self) -> float:
        """Weighted sum of the squared residuals."""
        return float(np.sum(self.row_weight * self.residual**2))

    @property
    def variance(self) -> float:
        """``s^2`` with which ``s^2 (J'WJ)^-1`` is Huber's covariance; exact data keep a floor."""
        n, p = self.weight.size, self.model.size
        ratio = (self.residual / (self.scale * self.curve.std * TUKEY)) ** 2
        inside = ratio < 1.0
        slope = np.where(inside, (1.0 - ratio) * (1.0 - 5.0 * ratio), 0.0)
        mean = max(float(slope.mean()), 0.1)
        correction = 1.0 + p / n * float(slope.var()) / mean**2
        influence = float(np.sum((self.weight * self.residual / self.curve.std) ** 2)) / (n - p)
        spread = correction**2 * influence / mean**2 * float(self.weight.mean())
        return max(spread, scale_floor(self.curve) ** 2)


def scale_floor(curve: FrictionCurve) -> float:
    """The least scale: what rounding leaves of exact data."""
    return FLOOR * max(float(np.max(np.abs(curve.coefficient / curve.std))), FLOOR)


def rates(curve: FrictionCurve) -> FloatArray:
    """``beta`` times the range of speeds: from a straight line to a step at the lowest speed."""
    place = np.unique(_place(curve))
    top = min(math.log10(40.0 / place[1]), 12.0)
    return np.logspace(-4.0, top, math.ceil((top + 4.0) * _PER_DECADE) + 1)


def _place(curve: FrictionCurve) -> FloatArray:
    """Speeds from 0 for the lowest to 1 for the highest."""
    return (curve.speed - curve.speed.min()) / np.ptp(curve.speed)


def columns_of(curve: FrictionCurve, model: Model, rate: FloatArray) -> FloatArray:
    """Columns that span the law at given rates, well scaled at any, shape (rates, n, k - 1)."""
    x, rate = _place(curve), rate[:, None]
    if not model.kinetic:
        columns = [np.exp(-rate * x)]
    else:
        columns = [np.ones((rate.size, x.size)), np.expm1(-rate * x) / np.expm1(-rate)]
    if model.viscous and model.kinetic:
        columns = [columns[0], (columns[1] - x) * (1.0 + 8.0 / rate)]
    if model.viscous:
        speed = x if model.kinetic else curve.speed / curve.speed.max()
        columns.append(np.broadcast_to(speed, columns[0].shape))
    return np.stack(columns, axis=2)


def least_absolute(curve: FrictionCurve, model: Model) -> tuple[float, FloatArray]:
    """The rate with the least sum of absolute residuals, and those residuals by their std."""
    rate = rates(curve)
    for _ in range(3):
        residual = _absolute_fits(curve, columns_of(curve, model, rate))
        best = int(np.argmin(np.abs(residual).sum(axis=1)))
        chosen = float(rate[best]), residual[best]
        low, high = rate[max(best - 1, 0)], rate[min(best + 1, rate.size - 1)]
        rate = np.geomspace(low, high, 2 * _PER_DECADE + 1)
    return chosen


def _absolute_fits(curve: FrictionCurve, columns: FloatArray) -> FloatArray:
    """Residuals, by their std, of approximate least absolute fits (Schlossmacher 1973)."""
    scaled, target = columns / curve.std[:, None], curve.coefficient / curve.std
    least = 1e-5 * max(float(np.ptp(target)), FLOOR)
    residual = np.ones(columns.shape[:2])
    ridge = 1e-13 * np.eye(columns.shape[2])
    for _ in range(15):
        weighted = scaled / np.maximum(np.abs(residual), least)[..., None]
        normal = np.einsum('bni,bnj->bij', weighted, scaled)
        right = np.einsum('bni,n->bi', weighted, target)
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        solved = _solved(normal + ridge * size, right[..., None])
        residual = target - np.squeeze(scaled @ solved, axis=2)
    return residual


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of many small systems; the shortest ones where points coincide."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=float)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix) @ right, dtype=float)


def least_median(curve: FrictionCurve, model: Model) -> tuple[float, FloatArray]:
    """The rate with the least median absolute residual (Rousseeuw 1984), and its residuals.

    At every rate the law is laid through the same sets of as few points as it takes.
    """
    order = np.argsort(curve.speed, kind='stable')
    few = order[np.linspace(0, order.size - 1, min(order.size, _MEDIAN_POINTS)).astype(int)]
    rate = rates(curve)
    columns, target = columns_of(curve, model, rate)[:, few], curve.coefficient[few]
    generator = np.random.Generator(np.random.PCG64(0))
    picks = generator.random((_SUBSETS, few.size)).argsort(axis=1)[:, : columns.shape[2]]
    square = columns[:, picks]
    ridge = 1e-13 * np.eye(columns.shape[2])
    solved = _solved(square + ridge, target[picks][..., None])[..., 0]
    misfit = np.abs(target - np.einsum('bnk,bsk->bsn', columns, solved)) / curve.std[few]
    middle = np.partition(misfit, (few.size + columns.shape[2]) // 2, axis=2)
    median = middle[:, :, (few.size + columns.shape[2]) // 2]
    i, j = np.unravel_index(int(np.argmin(median)), median.shape)
    fitted = columns_of(curve, model, rate[i : i + 1])[0] @ solved[i, j]
    return float(rate[i]), (curve.coefficient - fitted) / curve.std


def solve(curve: FrictionCurve, model: Model) -> Solution:
    """The robust fit of a model, whether or not it makes sense.

    Absolute residuals yield to outliers at both of the lowest speeds, which have all the leverage;
    the median does not. Where points are in doubt both starts are tried, and the one that ends
    with the smaller scale counts.
    """
    solution = _biweight(curve, model, *least_absolute(curve, model))
    if np.all(solution.weight > 0.5):
        return solution
    other = _biweight(curve, model, *least_median(curve, model))
    return min(solution, other, key=lambda found: found.scale)


def _biweight(curve: FrictionCurve, model: Model, rate: float, residual: FloatArray) -> Solution:
    """Iteratively reweighted Gauss-Newton steps, in two rounds.

    In the first the scale follows from the median absolute residual, which no outlier moves but
    which scatters by itself; in the second it is held at what the points that count say.
    """
    values = np.array([0.0, 0.0, math.log(rate / np.ptp(curve.speed)), 0.0])
    free = np.array([True, model.kinetic, True, model.viscous])
    values = gauss_newton_step(
        curve, values, np.sqrt(_tukey(residual, _scale(curve, residual, model.size))),
        free & [True, True, False, True],
    )  # fmt: skip
    values, _ = _reweighted(curve, values, free, None)
    residual = (curve.coefficient - curve_of(curve, values)) / curve.std
    scale = _sharper_scale(curve, residual, model.size)
    values, residual = _reweighted(curve, values, free, scale)
    drop, kinetic, log_decay, viscous = values.tolist()
    return Solution(
        curve, model, drop, kinetic, math.exp(log_decay), viscous, residual * curve.std,
        _tukey(residual, scale), scale,
    )  # fmt: skip


def _reweighted(
    curve: FrictionCurve, values: FloatArray, free: NDArray[np.bool_], scale: float | None
) -> tuple[FloatArray, FloatArray]:
    """Steps until nothing moves; without a scale it follows for the first half of them."""
    held = scale or 0.0
    for step in range(_STEPS):
        residual = (curve.coefficient - curve_of(curve, values)) / curve.std
        if scale is None and step < _STEPS // 2:
            held = _scale(curve, residual, int(free.sum()))
        moved = gauss_newton_step(curve, values, np.sqrt(_tukey(residual, held)), free)
        change = np.abs(curve_of(curve, moved) - curve_of(curve, values)) / curve.std
        values = moved
        if np.max(change) <= _TOLERANCE * held:
            break
    return values, (curve.coefficient - curve_of(curve, values)) / curve.std


def gauss_newton_step(
    curve: FrictionCurve, values: FloatArray, root: FloatArray, free: NDArray[np.bool_]
) -> FloatArray:
    """One Gauss-Newton step of the free values, halved while it makes the fit worse."""
    path = math.exp(values[2]) * (curve.speed - curve.speed.min())
    decayed = np.exp(-path)
    columns = [decayed, np.ones_like(path), -values[0] * path * decayed, curve.speed]
    rows = root / curve.std
    jacobian = np.stack(columns, axis=1)[:, free] * rows[:, None]
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    left = rows * (curve.coefficient - curve_of(curve, values))
    change = np.zeros(4)
    change[free] = np.linalg.lstsq(jacobian / size, left, rcond=None)[0] / size
    change[2] = np.clip(change[2], -1.0, 1.0)
    for _ in range(12):
        moved = values + change
        if np.sum((rows * (curve.coefficient - curve_of(curve, moved))) ** 2) <= left @ left:
            return moved
        change = change / 2.0
    return values


def curve_of(curve: FrictionCurve, values: FloatArray) -> FloatArray:
    """The law at the points, by drop, kinetic, ln decay and viscous, shape (n,) [-]."""
    drop, kinetic, log_decay, viscous = values
    decayed = np.exp(-np.exp(log_decay) * (curve.speed - curve.speed.min()))
    return kinetic + drop * decayed + viscous * curve.speed


def _tukey(residual: FloatArray, scale: float) -> FloatArray:
    return np.maximum(1.0 - (residual / (scale * TUKEY)) ** 2, 0.0) ** 2


def _scale(curve: FrictionCurve, residual: FloatArray, parameters: int) -> float:
    """Standard deviation from the median absolute residual.

    k residuals are small by construction, so the smallest k - 1 are left out (Street, Carroll and
    Ruppert 1988). The median of few residuals scatters: the last factor, 1 for many, keeps it
    from setting good points aside.
    """
    ordered = np.sort(np.abs(residual))[parameters - 1 :]
    caution = _caution(residual.size, parameters)
    return max(_MAD * caution * float(np.median(ordered)), scale_floor(curve))


def _sharper_scale(curve: FrictionCurve, residual: FloatArray, parameters: int) -> float:
    """Standard deviation from the weighted squares of the points that count.

    On normal scatter these are 0.83 of the squares that their weights would have.
    """
    rough = _scale(curve, residual, parameters)
    weight = _tukey(residual, rough)
    freedom = float(weight.sum()) - parameters
    if freedom <= 1.0:
        return rough
    sharp = math.sqrt(float(np.sum(weight * residual**2)) / freedom / _NORMAL_SHARE)
    return max(sharp * _caution(residual.size, parameters), scale_floor(curve))


def _caution(points: int, parameters: int) -> float:
    return 1.0 + _SMALL_SAMPLE / (points - parameters)
