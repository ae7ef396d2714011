# SPDX-License-Identifier: Apache-2.0
"""Fits the Stribeck law to a measured friction curve, and says how well the curve knows it.

``mu(v) = mu_k + (mu_s - mu_k) exp(-beta v) [+ nu v]``. For a given ``beta`` the law is linear, so
``beta`` is searched over all its decades first (variable projection: Golub and Pereyra, SIAM J.
Numer. Anal. 10, 1973) with the sum of absolute residuals, and no start value is asked for. From
there Tukey's biweight is iterated to convergence (Beaton and Tukey, Technometrics 16, 1974) with
the scale from the median absolute residual. Covariance: Huber and Ronchetti, Robust Statistics,
2nd ed., eq. (7.81). Profile interval: Bates and Watts, Nonlinear Regression Analysis, ch. 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.optimize import brentq
from scipy.special import ive

from stickslip_monitor.errors import StickslipError
from stickslip_monitor.physics import stribeck
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.rules import require_positive
from stickslip_monitor.study.curve_file import FrictionCurve

Array = NDArray[np.float64]
Viscous = Literal['auto', 'yes', 'no']

UNITS = {'static': '', 'kinetic': '', 'decay': 's/m', 'viscous': 's/m'}
CONFIDENCE = 0.95
VISCOUS_LEVEL = 0.01
FALL_LEVEL = 0.001
MOST_CORRELATION = 0.999
SPARE_POINTS = 2
TUKEY = 4.685
"""Residuals beyond this many scales count nothing; on clean data 95 % efficient."""

_MAD = 1.482602218505602
_FLOOR = 1e-14
_PER_DECADE = 10
_STEPS = 400
_SMALL_SAMPLE = 4.0
_SUBSETS = 60
_MEDIAN_POINTS = 200
_TOLERANCE = 1e-11


class FitError(StickslipError, ValueError):
    """The measured curve cannot identify the law; the text says what is missing."""


@dataclass(frozen=True, slots=True)
class ViscousTest:
    """The comparison of the law with and without its viscous slope, at the same weights.

    Attributes:
        slope: The slope that fits best, of either sign [s/m].
        t_value: The slope by its standard error [-].
        f_value: What it takes from the weighted squares, by their variance [-].
        p_value: Probability of a larger ``f_value`` without any slope [-].
        aicc_gain: By how much it lowers the corrected Akaike criterion; negative if it does not.
    """

    slope: float
    t_value: float
    f_value: float
    p_value: float
    aicc_gain: float

    @property
    def demands_slope(self) -> bool:
        """The criterion of ``auto``: the slope is positive and significant at 1 %."""
        return self.slope > 0.0 and self.p_value < VISCOUS_LEVEL


@dataclass(frozen=True, slots=True, eq=False)
class StribeckFit:
    """A fitted law with its uncertainty.

    Attributes:
        law: The fitted law.
        curve: What it was fitted to.
        names: The estimated coefficients, k of ``static``, ``kinetic``, ``decay``, ``viscous``.
        estimate: Their values, shape (k,).
        covariance: Their covariance matrix, shape (k, k).
        decay_interval: 95 % profile interval of ``decay`` [s/m].
        weight: Tukey's weight of each point, 1 counts fully, 0 not at all, shape (n,).
        residual: Measured minus fitted coefficient, shape (n,) [-].
        scale: Standard deviation of a point, in units of its ``std`` [-].
        degrees_of_freedom: Sum of the weights less k.
        viscous_test: The test of the viscous slope; ``None`` with too few points for it.
    """

    law: Stribeck
    curve: FrictionCurve
    names: tuple[str, ...]
    estimate: Array
    covariance: Array
    decay_interval: tuple[float, float]
    weight: Array
    residual: Array
    scale: float
    degrees_of_freedom: float
    viscous_test: ViscousTest | None = None

    @property
    def standard_error(self) -> Array:
        """Standard error of each estimate, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates, shape (k, k)."""
        return _correlation(self.covariance)

    @property
    def t_quantile(self) -> float:
        """How many standard errors make a 95 % interval."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.degrees_of_freedom))

    @property
    def intervals(self) -> Array:
        """95 % intervals, that of ``decay`` by profile, shape (k, 2)."""
        reach = self.t_quantile * self.standard_error
        both = np.stack([self.estimate - reach, self.estimate + reach], axis=1)
        both[self.names.index('decay')] = self.decay_interval
        return both

    @property
    def outliers(self) -> NDArray[np.intp]:
        """Indices of the points that count less than half, in the curve's order."""
        return np.flatnonzero(self.weight < 0.5)

    @property
    def kinetic_at_bound(self) -> bool:
        """Whether ``kinetic`` would be negative and was held at 0."""
        return 'kinetic' not in self.names

    def band(self, speed: ArrayLike) -> Array:
        """Half width of the curve's pointwise 95 % confidence band at speeds >= 0 [-]."""
        v = np.asarray(speed, dtype=float)
        fall = self.law.static - self.law.kinetic
        gradient = _gradient(fall, self.law.decay, v, self.names)
        variance = np.einsum('ni,ij,nj->n', gradient, self.covariance, gradient)
        return self.t_quantile * np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True, slots=True)
class _Model:
    """Which coefficients are free besides the drop and the decay."""

    viscous: bool
    kinetic: bool = True

    @property
    def size(self) -> int:
        return 2 + self.kinetic + self.viscous

    @property
    def names(self) -> tuple[str, ...]:
        free = {'static': True, 'kinetic': self.kinetic, 'decay': True, 'viscous': self.viscous}
        return tuple(name for name in UNITS if free[name])


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """The best curve of a model; ``drop`` is that of the decaying part at the lowest speed."""

    curve: FrictionCurve
    model: _Model
    drop: float
    kinetic: float
    decay: float
    viscous: float
    residual: Array
    weight: Array
    scale: float

    @property
    def row_weight(self) -> Array:
        """Weights of the squared residuals: Tukey's, by the variance of each point."""
        return self.weight / self.curve.std**2

    @property
    def freedom(self) -> float:
        return float(self.weight.sum()) - self.model.size

    @property
    def squares(self) -> float:
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
        return max(spread, _scale_floor(self.curve) ** 2)


def fit_stribeck(curve: FrictionCurve, viscous: Viscous = 'auto') -> StribeckFit:
    """Fit the Stribeck law to a measured curve.

    Args:
        curve: The curve.
        viscous: Whether the law has a viscous slope; ``'auto'`` where the F-test wants it.

    Returns:
        The law with its uncertainty.

    Raises:
        FitError: The curve cannot identify the law.
    """
    _require_points(curve, _Model(viscous=viscous == 'yes'))
    test = None
    if viscous == 'yes' or _has_points(curve, _Model(viscous=True)):
        full = _solve(curve, _Model(viscous=True))
        test = _viscous_test(full)
        if viscous == 'yes' or (viscous == 'auto' and test.demands_slope):
            if full.viscous < 0.0:
                raise FitError(
                    f'viscous = {full.viscous:.4g} s/m must not be negative: the curve has no'
                    ' viscous rise; leave it out with --viscous no'
                )
            return _identified(full, test)
    return _identified(_solve(curve, _Model(viscous=False)), test)


def _has_points(curve: FrictionCurve, model: _Model) -> bool:
    enough = curve.speed.size >= model.size + SPARE_POINTS
    return enough and np.unique(curve.speed).size >= model.size


def _require_points(curve: FrictionCurve, model: _Model) -> None:
    n, k = curve.speed.size, model.size
    coefficients = f'{k} coefficients ({", ".join(model.names)})'
    if n < k + SPARE_POINTS:
        raise FitError(
            f'points = {n} must be at least {k + SPARE_POINTS}: {coefficients} and'
            f' {SPARE_POINTS} more to judge them by'
        )
    distinct = np.unique(curve.speed).size
    if distinct < k:
        raise FitError(f'different speeds = {distinct} must be at least {k}: {coefficients}')


# --- the best curve -----------------------------------------------------------------------------


def _solve(curve: FrictionCurve, model: _Model) -> _Solution:
    """The robust fit of a model, whether or not it makes sense.

    Absolute residuals yield to outliers at both of the lowest speeds, which have all the leverage;
    the median does not. Where points are in doubt both starts are tried, and the one that ends
    with the smaller scale counts.
    """
    solution = _biweight(curve, model, *_least_absolute(curve, model))
    if np.all(solution.weight > 0.5):
        return solution
    other = _biweight(curve, model, *_least_median(curve, model))
    return min(solution, other, key=lambda found: found.scale)


def _rates(curve: FrictionCurve) -> Array:
    """``beta`` times the range of speeds: from a straight line to a step at the lowest speed."""
    place = np.unique(_place(curve))
    top = min(math.log10(40.0 / place[1]), 12.0)
    return np.logspace(-4.0, top, math.ceil((top + 4.0) * _PER_DECADE) + 1)


def _place(curve: FrictionCurve) -> Array:
    """Speeds from 0 for the lowest to 1 for the highest."""
    return (curve.speed - curve.speed.min()) / np.ptp(curve.speed)


def _columns(curve: FrictionCurve, model: _Model, rate: Array) -> Array:
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


def _least_absolute(curve: FrictionCurve, model: _Model) -> tuple[float, Array]:
    """The rate with the least sum of absolute residuals, and those residuals by their std."""
    rate = _rates(curve)
    for _ in range(3):
        residual = _absolute_fits(curve, _columns(curve, model, rate))
        best = int(np.argmin(np.abs(residual).sum(axis=1)))
        chosen = float(rate[best]), residual[best]
        low, high = rate[max(best - 1, 0)], rate[min(best + 1, rate.size - 1)]
        rate = np.geomspace(low, high, 2 * _PER_DECADE + 1)
    return chosen


def _absolute_fits(curve: FrictionCurve, columns: Array) -> Array:
    """Residuals, by their std, of approximate least absolute fits (Schlossmacher 1973)."""
    scaled, target = columns / curve.std[:, None], curve.coefficient / curve.std
    least = 1e-5 * max(float(np.ptp(target)), _FLOOR)
    residual = np.ones(columns.shape[:2])
    ridge = 1e-13 * np.eye(columns.shape[2])
    for _ in range(15):
        weighted = scaled / np.maximum(np.abs(residual), least)[..., None]
        normal = np.einsum('bni,bnj->bij', weighted, scaled)
        right = np.einsum('bni,n->bi', weighted, target)
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        solved = np.linalg.solve(normal + ridge * size, right[..., None])
        residual = target - np.squeeze(scaled @ solved, axis=2)
    return residual


def _least_median(curve: FrictionCurve, model: _Model) -> tuple[float, Array]:
    """The rate with the least median absolute residual (Rousseeuw 1984), and its residuals.

    At every rate the law is laid through the same sets of as few points as it takes.
    """
    order = np.argsort(curve.speed, kind='stable')
    few = order[np.linspace(0, order.size - 1, min(order.size, _MEDIAN_POINTS)).astype(int)]
    rate = _rates(curve)
    columns, target = _columns(curve, model, rate)[:, few], curve.coefficient[few]
    generator = np.random.Generator(np.random.PCG64(0))
    picks = generator.random((_SUBSETS, few.size)).argsort(axis=1)[:, : columns.shape[2]]
    square = columns[:, picks]
    ridge = 1e-13 * np.eye(columns.shape[2])
    solved = np.linalg.solve(square + ridge, target[picks][..., None])[..., 0]
    misfit = np.abs(target - np.einsum('bnk,bsk->bsn', columns, solved)) / curve.std[few]
    middle = np.partition(misfit, (few.size + columns.shape[2]) // 2, axis=2)
    median = middle[:, :, (few.size + columns.shape[2]) // 2]
    i, j = np.unravel_index(int(np.argmin(median)), median.shape)
    fitted = _columns(curve, model, rate[i : i + 1])[0] @ solved[i, j]
    return float(rate[i]), (curve.coefficient - fitted) / curve.std


def _scale_floor(curve: FrictionCurve) -> float:
    return _FLOOR * max(float(np.max(np.abs(curve.coefficient / curve.std))), _FLOOR)


def _scale(curve: FrictionCurve, residual: Array, parameters: int) -> float:
    """Standard deviation from the median absolute residual.

    k residuals are small by construction, so the smallest k - 1 are left out (Street, Carroll and
    Ruppert 1988). The median of few residuals scatters: the last factor, 1 for many, keeps it
    from setting good points aside.
    """
    ordered = np.sort(np.abs(residual))[parameters - 1 :]
    caution = 1.0 + _SMALL_SAMPLE / (residual.size - parameters)
    return max(_MAD * caution * float(np.median(ordered)), _scale_floor(curve))


def _tukey(residual: Array, scale: float) -> Array:
    return np.maximum(1.0 - (residual / (scale * TUKEY)) ** 2, 0.0) ** 2


def _biweight(curve: FrictionCurve, model: _Model, rate: float, residual: Array) -> _Solution:
    """Iteratively reweighted Gauss-Newton steps; the scale follows for the first half of them."""
    values = np.array([0.0, 0.0, math.log(rate / np.ptp(curve.speed)), 0.0])
    free = np.array([True, model.kinetic, True, model.viscous])
    linear = free & [True, True, False, True]
    for step in range(_STEPS):
        if step < _STEPS // 2:
            scale = _scale(curve, residual, model.size)
        weight = _tukey(residual, scale)
        moved = _step(curve, values, np.sqrt(weight), free if step else linear)
        change = _curve_of(curve, moved) - _curve_of(curve, values)
        values = moved
        residual = (curve.coefficient - _curve_of(curve, values)) / curve.std
        if step and np.max(np.abs(change / curve.std)) <= _TOLERANCE * scale:
            break
    weight = _tukey(residual, scale)
    drop, kinetic, log_decay, viscous = values.tolist()
    return _Solution(
        curve, model, drop, kinetic, math.exp(log_decay), viscous, residual * curve.std,
        weight, scale,
    )  # fmt: skip


def _curve_of(curve: FrictionCurve, values: Array) -> Array:
    drop, kinetic, log_decay, viscous = values
    decayed = np.exp(-np.exp(log_decay) * (curve.speed - curve.speed.min()))
    return kinetic + drop * decayed + viscous * curve.speed


def _step(curve: FrictionCurve, values: Array, root: Array, free: NDArray[np.bool_]) -> Array:
    """One Gauss-Newton step of the free values, halved while it makes the fit worse."""
    path = math.exp(values[2]) * (curve.speed - curve.speed.min())
    decayed = np.exp(-path)
    columns = [decayed, np.ones_like(path), -values[0] * path * decayed, curve.speed]
    rows = root / curve.std
    jacobian = np.stack(columns, axis=1)[:, free] * rows[:, None]
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    left = rows * (curve.coefficient - _curve_of(curve, values))
    change = np.zeros(4)
    change[free] = np.linalg.lstsq(jacobian / size, left, rcond=None)[0] / size
    change[2] = np.clip(change[2], -1.0, 1.0)
    for _ in range(12):
        moved = values + change
        if np.sum((rows * (curve.coefficient - _curve_of(curve, moved))) ** 2) <= left @ left:
            return moved
        change = change / 2.0
    return values


# --- what the curve knows -----------------------------------------------------------------------


def _profile(solution: _Solution, rate: Array) -> Array:
    """Least weighted squares at each rate, the other coefficients being free, shape (rates,)."""
    return _squares_of(solution, _columns(solution.curve, solution.model, rate))


def _squares_of(solution: _Solution, columns: Array) -> Array:
    """Least weighted squares of linear models with columns of shape (models, n, k); (models,)."""
    root = np.sqrt(solution.row_weight)
    left, size, _ = np.linalg.svd(columns * root[:, None], full_matrices=False)
    target = root * solution.curve.coefficient
    seen = np.einsum('bnk,n->bk', left, target) * (size > 1e-12 * size[:, :1])
    return np.sum((target - np.einsum('bnk,bk->bn', left, seen)) ** 2, axis=1)


def _decay_interval(solution: _Solution) -> tuple[float, float]:
    """95 % profile interval of ``beta`` [s/m]; 0 or ``inf`` where it has no end."""
    span = float(np.ptp(solution.curve.speed))
    level = solution.squares + solution.variance * float(
        stats.t.ppf(0.5 + 0.5 * CONFIDENCE, solution.freedom) ** 2
    )

    def above(log_rate: float) -> float:
        return float(_profile(solution, np.exp([log_rate]))[0]) - level

    best = math.log(solution.decay * span)
    grid = np.log(_rates(solution.curve))
    inside = grid[_profile(solution, np.exp(grid)) <= level]
    reach = np.append(inside, best)
    low, high = float(reach.min()), float(reach.max())
    below, beyond = grid[grid < low], grid[grid > high]
    ends = [0.0, math.inf]
    if below.size:
        ends[0] = math.exp(brentq(above, below[-1], low, xtol=1e-14)) / span
    if beyond.size:
        ends[1] = math.exp(brentq(above, high, beyond[0], xtol=1e-14)) / span
    return ends[0], ends[1]


def _viscous_test(full: _Solution) -> ViscousTest:
    """Compare with the best plain law at the weights of the full one."""
    plain = replace(full, model=replace(full.model, viscous=False))
    rate = _rates(full.curve)
    for _ in range(4):
        profile = _profile(plain, rate)
        best = int(np.argmin(profile))
        low, high = rate[max(best - 1, 0)], rate[min(best + 1, rate.size - 1)]
        rate = np.geomspace(low, high, 2 * _PER_DECADE + 1)
    gain = max(float(profile[best]) - full.squares, 0.0)
    f_value = gain / full.variance
    p_value = float(stats.f.sf(f_value, 1.0, max(full.freedom, 1.0)))
    index = full.model.names.index('viscous')
    error = math.sqrt(float(_covariance(full)[index, index]))
    count = float(full.weight.sum())
    floor = count * _scale_floor(full.curve) ** 2
    lower = count * math.log(max(full.squares + gain, floor) / max(full.squares, floor))
    price = _aicc_price(count, full.model.size)
    return ViscousTest(full.viscous, full.viscous / error, f_value, p_value, lower - price)


def _aicc_price(count: float, size: int) -> float:
    """What the corrected Akaike criterion asks for the last of ``size`` coefficients."""

    def penalty(k: int) -> float:
        return 2.0 * k * count / max(count - k - 1.0, 1e-9)

    return penalty(size + 1) - penalty(size)


def _gradient(fall: float, decay: float, speed: Array, names: tuple[str, ...]) -> Array:
    """Derivatives of ``mu(v)`` by the named coefficients, ``fall`` being mu_s - mu_k; (n, k)."""
    decayed = np.exp(-decay * speed)
    by_name = {
        'static': decayed,
        'kinetic': 1.0 - decayed,
        'decay': -fall * speed * decayed,
        'viscous': speed,
    }
    return np.stack([by_name[name] for name in names], axis=-1)


def _fall(solution: _Solution) -> float:
    """``mu_s - mu_k``: the drop, extrapolated from the lowest speed to 0."""
    with np.errstate(over='ignore'):
        rise = np.exp(solution.decay * solution.curve.speed.min())
    return float(solution.drop * rise)


def _covariance(solution: _Solution) -> Array:
    """``s^2 (J'WJ)^-1`` of the coefficients, shape (k, k); ``inf`` where it is singular."""
    names, root = solution.model.names, np.sqrt(solution.row_weight)
    with np.errstate(invalid='ignore'):
        gradient = _gradient(_fall(solution), solution.decay, solution.curve.speed, names)
        size = np.linalg.norm(gradient * root[:, None], axis=0)
    singular = np.full((len(names), len(names)), np.inf)
    if not np.all(np.isfinite(size) & (size > 0.0)):
        return singular
    triangle = np.linalg.qr(gradient * root[:, None] / size, mode='r')
    if np.min(np.abs(np.diag(triangle))) < 1e-12:
        return singular
    inverse = np.linalg.inv(triangle) / size[:, None]
    return solution.variance * (inverse @ inverse.T)


def _correlation(covariance: Array) -> Array:
    error = np.sqrt(np.diag(covariance))
    return covariance / np.outer(error, error)


def _identified(free: _Solution, test: ViscousTest | None) -> StribeckFit:
    """The fit, if the curve identifies it."""
    _require_kept(free)
    _require_fall(free)
    _require_decay(free, _decay_interval(free))
    solution = free
    if free.kinetic < 0.0:
        solution = _solve(free.curve, replace(free.model, kinetic=False))
        _require_kept(solution)
    covariance = _covariance(solution)
    _require_distinct(solution, covariance)
    kinetic, viscous = max(solution.kinetic, 0.0), max(solution.viscous, 0.0)
    law = Stribeck(kinetic + _fall(solution), kinetic, solution.decay, viscous)
    names = solution.model.names
    return StribeckFit(
        law=law,
        curve=solution.curve,
        names=names,
        estimate=np.array([getattr(law, name) for name in names]),
        covariance=covariance,
        decay_interval=_decay_interval(solution),
        weight=solution.weight,
        residual=solution.residual,
        scale=solution.scale,
        degrees_of_freedom=solution.freedom,
        viscous_test=test,
    )


def _require_kept(solution: _Solution) -> None:
    kept, least = int(np.sum(solution.weight > 0.0)), solution.model.size + SPARE_POINTS
    if kept < least:
        raise FitError(
            f'points on one curve = {kept} must be at least {least}: the other'
            f' {solution.weight.size - kept} lie far from it, so no Stribeck law describes the'
            ' measurement'
        )


def _require_fall(solution: _Solution) -> None:
    if not solution.drop > 0.0:
        raise FitError(
            f'static - kinetic = {_fall(solution):.3g} must be above 0: the curve has no falling'
            ' part that levels off, as the Stribeck law has'
        )
    straight = replace(solution.model, kinetic=False)
    constant = np.ones((1, solution.weight.size, 1))
    if straight.viscous:
        constant = np.concatenate([constant, solution.curve.speed[None, :, None]], axis=2)
    gain = _squares_of(solution, constant)[0] - solution.squares
    f_value = gain / 2.0 / solution.variance
    least = float(stats.f.isf(FALL_LEVEL, 2.0, solution.freedom))
    if not f_value > least:
        raise FitError(
            f'F = {f_value:.3g} of the falling part must be above {least:.3g} (0.1 % level): no'
            f' falling part stands out of the scatter of {solution.scale:.2g}'
        )


def _require_decay(solution: _Solution, interval: tuple[float, float]) -> None:
    low, high = interval
    slowest, fastest = solution.curve.speed.min(), solution.curve.speed.max()
    if not math.isfinite(high):
        raise FitError(
            f'decay has no upper limit (95 % interval from {low:.3g} s/m): all speeds but the'
            f' lowest, {slowest:.3g} m/s, may lie beyond the decay; measure at lower speeds'
        )
    if not low > 0.0:
        raise FitError(
            f'decay has no lower limit (95 % interval up to {high:.3g} s/m): up to the highest'
            f' speed, {fastest:.3g} m/s, the fall does not bend towards a level; measure at higher'
            ' speeds'
        )


def _require_distinct(solution: _Solution, covariance: Array) -> None:
    if not np.all(np.isfinite(covariance)):
        raise FitError(
            f'decay = {solution.decay:.3g} s/m: the covariance of the coefficients must be finite,'
            ' and it is singular'
        )
    correlation = np.abs(_correlation(covariance)) - np.eye(len(covariance))
    i, j = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    if correlation[i, j] > MOST_CORRELATION:
        names = solution.model.names
        raise FitError(
            f'correlation of {names[i]} and {names[j]} = {correlation[i, j]:.6f} must not be above'
            f' {MOST_CORRELATION:g}: the curve knows only a combination of the two'
        )


# --- what the uncertainty means -----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Spread:
    """What the fit's uncertainty leaves of a quantity that follows from the law.

    Attributes:
        estimate: At the fitted law.
        delta_error: Standard error by the delta method; ``nan`` where that does not apply.
        median: Of the drawn laws.
        low: 2.5 % quantile of the drawn laws.
        high: 97.5 % quantile of the drawn laws.
    """

    estimate: float
    delta_error: float
    median: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class BoundarySpread:
    """Spread of the boundaries of a bearing; 0 m/s stands for a bearing without a boundary.

    Attributes:
        hopf_speed: Hopf speed [m/s].
        fold_speed: Fold speed [m/s].
        without: Share of the drawn laws that have no boundary at this load [-].
        hopf_margin: ``V/V_H - 1`` at a speed, ``inf`` without a boundary; ``None`` without speed.
        fold_margin: ``V/V_F - 1``, likewise.
        regimes: Shares of the drawn laws that are unstable, bistable and stable at that speed.
    """

    hopf_speed: Spread
    fold_speed: Spread
    without: float
    hopf_margin: Spread | None = None
    fold_margin: Spread | None = None
    regimes: dict[str, float] | None = None


def boundary_spread(
    fit: StribeckFit,
    damping: float,
    load: float,
    speed: float | None = None,
    draws: int = 20000,
    seed: int = 0,
) -> BoundarySpread:
    """What the fit's uncertainty means for a bearing.

    Laws are drawn from the multivariate t distribution of (mu_s, mu_k, ln beta, nu) with the fit's
    covariance and degrees of freedom. ``V_H = d/beta`` with ``d = ln(Delta beta/(c/N + nu))``, and
    ``V_F`` follows from the same ``d``. The delta method takes the gradient in closed form.

    Args:
        fit: The fit.
        damping: ``c`` > 0 of the bearing [N s/m].
        load: ``N`` > 0 [N].
        speed: Surface speed > 0 for the margins [m/s].
        draws: Number of laws drawn.
        seed: Of the random generator; the same seed gives the same answer.

    Raises:
        PhysicsError: A quantity breaks its rule.
    """
    require_positive('damping', damping, 'N s/m')
    require_positive('load', load, 'N')
    require_positive('draws', draws)
    laws = drawn_laws(fit, draws, seed)
    hopf, fold = _boundaries(laws, damping / load)
    best = _boundaries(_as_row(fit.law), damping / load)
    errors = _delta_errors(fit, damping / load)
    spreads = [
        _spread(float(at[0]), error, drawn)
        for at, error, drawn in zip(best, errors, (hopf, fold), strict=True)
    ]
    result = BoundarySpread(spreads[0], spreads[1], float(np.mean(fold == 0.0)))
    if speed is None:
        return result
    require_positive('speed', speed, 'm/s')
    with np.errstate(divide='ignore'):
        margins = [
            _spread(
                float(speed / at[0] - 1.0) if at[0] else math.inf,
                speed * error / float(at[0]) ** 2 if at[0] else math.nan,
                speed / drawn - 1.0,
            )
            for at, error, drawn in zip(best, errors, (hopf, fold), strict=True)
        ]
    unstable, within = float(np.mean(speed < hopf)), float(np.mean(speed < fold))
    shares = {'unstable': unstable, 'bistable': within - unstable, 'stable': 1.0 - within}
    return replace(result, hopf_margin=margins[0], fold_margin=margins[1], regimes=shares)


def _as_row(law: Stribeck) -> Array:
    return np.array([[law.static, law.kinetic, law.decay, law.viscous]])


def drawn_laws(fit: StribeckFit, draws: int, seed: int) -> Array:
    """Laws that the curve does not rule out: columns static, kinetic, decay, viscous; (draws, 4).

    They are drawn in ``ln beta``, so that no decay is negative; a negative slope counts as 0.
    """
    generator = np.random.Generator(np.random.PCG64(seed))
    place = fit.names.index('decay')
    scaling = np.ones(len(fit.names))
    scaling[place] = 1.0 / fit.law.decay
    factor = np.linalg.cholesky(fit.correlation) * (fit.standard_error * scaling)[:, None]
    freedom = fit.degrees_of_freedom
    normal = generator.standard_normal((draws, len(fit.names)))
    wide = np.sqrt(freedom / generator.chisquare(freedom, draws))
    drawn = (normal @ factor.T) * wide[:, None]
    laws = np.repeat(_as_row(fit.law), draws, axis=0)
    for column, name in enumerate(fit.names):
        laws[:, list(UNITS).index(name)] += drawn[:, column] * (name != 'decay')
    with np.errstate(over='ignore'):
        laws[:, 2] *= np.exp(drawn[:, place])
    laws[:, 3] = np.maximum(laws[:, 3], 0.0)
    return laws


def _boundaries(laws: Array, q: float) -> tuple[Array, Array]:
    """Hopf and fold speed of many laws at ``q = c/N`` [s/m]; 0 where there is no boundary."""
    static, kinetic, decay, viscous = laws.T
    with np.errstate(invalid='ignore', divide='ignore'):
        number = np.log(np.maximum(static - kinetic, 0.0) * decay / (q + viscous))
    bounded = np.isfinite(number) & (number > 0.0)
    hopf, fold = np.zeros_like(decay), np.zeros_like(decay)
    hopf[bounded] = number[bounded] / decay[bounded]
    fold[bounded] = stribeck.speed_for_decline(number[bounded]) / decay[bounded]
    return hopf, fold


def _delta_errors(fit: StribeckFit, q: float) -> tuple[float, float]:
    """Standard errors of Hopf and fold speed by the delta method [m/s]."""
    gradients = boundary_gradients(fit.law, q)
    if gradients is None:
        return math.nan, math.nan
    free = [list(UNITS).index(name) for name in fit.names]
    hopf, fold = (g[free] for g in gradients)
    return math.sqrt(hopf @ fit.covariance @ hopf), math.sqrt(fold @ fit.covariance @ fold)


def boundary_gradients(law: Stribeck, q: float) -> tuple[Array, Array] | None:
    """Derivatives of Hopf and fold speed by static, kinetic, decay, viscous at ``q = c/N``.

    ``dv_F/dd = 1/(1 - I2(v_F)/I1(v_F))`` by ``2 I1(v) exp(-v)/v = exp(-d)`` and
    ``I0 - I2 = 2 I1/v``.

    Returns:
        Two arrays of shape (4,) [m/s for each unit]; ``None`` where there is no boundary.
    """
    fall, decay = law.static - law.kinetic, law.decay
    hopf, fold = (float(at[0]) for at in _boundaries(_as_row(law), q))
    if hopf == 0.0:
        return None
    by_fall, by_viscous = 1.0 / fall, -1.0 / (q + law.viscous)
    number = np.array([by_fall, -by_fall, 1.0 / decay, by_viscous])
    stretch = np.array([0.0, 0.0, 1.0 / decay, 0.0])
    v = fold * decay
    steep = 1.0 / (1.0 - float(ive(2, v) / ive(1, v)))
    return number / decay - hopf * stretch, steep * number / decay - fold * stretch


def _spread(estimate: float, delta_error: float, drawn: Array) -> Spread:
    tail = 50.0 * (1.0 - CONFIDENCE)
    # Quantiles without interpolation, which inf would spoil.
    low, median, high = np.percentile(drawn, [tail, 50.0, 100.0 - tail], method='nearest')
    return Spread(estimate, delta_error, float(median), float(low), float(high))
