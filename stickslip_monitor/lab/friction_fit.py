# SPDX-License-Identifier: Apache-2.0
"""Fits the Stribeck law to a measured friction curve, or refuses one that cannot identify it.

``mu(v) = mu_k + (mu_s - mu_k) exp(-beta v) [+ nu v]``. For a given decay the law is linear, so a
scan of all decades of the decay finds the start (variable projection: Golub and Pereyra, SIAM J.
Numer. Anal. 10, 1973). From there ``scipy.optimize.least_squares`` minimises Cauchy's loss, in
which a residual far from the others counts little.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.optimize import brentq, least_squares, minimize_scalar

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.errors import FitError, require_positive
from stickslip_monitor.lab.curve_file import FrictionCurve
from stickslip_monitor.physics import closed_form
from stickslip_monitor.physics.friction import Stribeck

UNITS = {'static': '', 'kinetic': '', 'decay': 's/m', 'viscous': 's/m'}
"""The coefficients of the law, with their units."""
PLAIN, RISING = ('static', 'kinetic', 'decay'), tuple(UNITS)
"""The free coefficients without and with the viscous slope."""
CONFIDENCE = 0.95
CAUCHY = 2.385
"""A residual of so many scales counts half; on clean data 95 % efficient (Rey 1983)."""
FALL_LEVEL, VISCOUS_LEVEL, SHAPE_LEVEL = 0.001, 0.01, 0.01
MOST_CORRELATION = 0.999
SPARE_POINTS = 2
FARTHEST = 5.0
"""Of decay times lowest speed: beyond it all points lie where the fall has ended."""
ASIDE = 0.1
"""A point of a smaller weight lies on no curve with the others."""
_MANY_OUTLIERS, _MUCH_LEVERAGE = 0.2, 0.9
_MAD = 1.482602218505602
# The median of few residuals scatters: this keeps it from setting good points aside.
_SMALL_SAMPLE = 2.0
_FLOOR, _SINGULAR, _ROUNDING = 1e-14, 1e-12, 1e3
_UNUSUAL_COEFFICIENT, _UNUSUAL_SPEED = 3.0, 30.0
_SHUFFLES = 4000

Viscous = Literal['auto', 'yes', 'no']
Loss = Literal['soft_l1', 'cauchy']


@dataclass(frozen=True, slots=True)
class ViscousTest:
    """The F-test of a viscous slope, at the weights of the law that has it."""

    slope: float  # the slope that fits best, of either sign [s/m]
    f_value: float  # what it takes from the weighted squares, by their variance [-]
    p_value: float  # probability of a larger one without any slope [-]

    @property
    def demands_slope(self) -> bool:
        """The criterion of ``auto``: the slope is positive and significant at 1 %."""
        return self.slope > 0.0 and self.p_value < VISCOUS_LEVEL


@dataclass(frozen=True, eq=False)
class StribeckFit:
    """A fitted law with its uncertainty."""

    curve: FrictionCurve  # the points
    names: tuple[str, ...]  # the k free coefficients, in the order of ``UNITS``
    # The drop of the decaying part at the lowest speed [-], ``mu_k`` [-], ``ln beta`` [ln s/m] and
    # ``nu`` [s/m], shape (4,).
    values: FloatArray
    median_scale: float  # standard deviation by the median residual that the weights go by [-]
    viscous_test: ViscousTest | None = None  # None with too few points for it

    @property
    def decay(self) -> float:
        """``beta`` [s/m]."""
        return math.exp(self.values[2])

    @property
    def law(self) -> Stribeck:
        """The fitted law."""
        kinetic, viscous = (max(float(value), 0.0) for value in self.values[[1, 3]])
        fall = float(self.values[0] * np.exp(self.decay * self.curve.speed.min()))
        return Stribeck(kinetic + fall, kinetic, self.decay, viscous)

    @property
    def estimate(self) -> FloatArray:
        """The free coefficients, shape (k,)."""
        return np.array([getattr(self.law, name) for name in self.names])

    @cached_property
    def residual(self) -> FloatArray:
        """Measured minus fitted coefficient, shape (n,) [-]."""
        return self.curve.coefficient - _law(self.values, self.curve)

    @property
    def weight(self) -> FloatArray:
        """Cauchy's weight of each point, ``1/(1 + (r/(2.385 s))^2)``, shape (n,)."""
        return 1.0 / (1.0 + (self.residual / (CAUCHY * self.median_scale * self.curve.std)) ** 2)

    @property
    def outliers(self) -> IndexArray:
        """Indices of the points that count less than half, in the curve's order."""
        return np.flatnonzero(self.weight < 0.5)

    @property
    def degrees_of_freedom(self) -> float:
        """The sum of the weights less k."""
        return float(self.weight.sum()) - len(self.names)

    @cached_property
    def variance(self) -> float:
        """``s^2`` with which ``s^2 (J'WJ)^-1`` is the covariance; exact data keep a floor.

        Huber and Ronchetti, Robust Statistics, 2nd ed., eq. (7.81).
        """
        n, p = self.weight.size, len(self.names)
        slope = self.weight**2 * (2.0 - 1.0 / self.weight)
        mean = max(float(slope.mean()), 0.1)
        correction = 1.0 + p / n * float(slope.var()) / mean**2
        influence = float(np.sum((self.weight * self.residual / self.curve.std) ** 2)) / (n - p)
        spread = correction**2 * influence / mean**2 * float(self.weight.mean())
        return max(spread, _floor(self.curve) ** 2)

    @property
    def scale(self) -> float:
        """Standard deviation of a point, in units of its ``std`` [-]."""
        return math.sqrt(self.variance)

    @property
    def squares(self) -> float:
        """Weighted sum of the squared residuals."""
        return float(np.sum(self.weight * (self.residual / self.curve.std) ** 2))

    @property
    def t_quantile(self) -> float:
        """How many standard errors make a 95 % interval."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.degrees_of_freedom))

    @property
    def leverage(self) -> FloatArray:
        """Diagonal of the weighted hat matrix, shape (n,)."""
        return np.sum(self._decomposed[0] ** 2, axis=1)

    @property
    def covariance(self) -> FloatArray:
        """``s^2 (J'WJ)^-1`` of the free coefficients, (k, k); ``inf`` where it is singular."""
        inverse = self._decomposed[1]
        return self.variance * (inverse @ inverse.T)

    @property
    def standard_error(self) -> FloatArray:
        """Standard error of each estimate, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the estimates, shape (k, k)."""
        return self.covariance / np.outer(self.standard_error, self.standard_error)

    @property
    def intervals(self) -> FloatArray:
        """95 % intervals, that of ``decay`` by profile, shape (k, 2)."""
        reach = self.t_quantile * self.standard_error
        both = np.stack([self.estimate - reach, self.estimate + reach], axis=1)
        both[self.names.index('decay')] = self.decay_interval
        return both

    def band(self, speed: ArrayLike) -> FloatArray:
        """Half width of the curve's pointwise 95 % confidence band at speeds >= 0 [-]."""
        gradient = self._gradient(np.asarray(speed, dtype=float))
        variance = np.einsum('ni,ij,nj->n', gradient, self.covariance, gradient)
        return self.t_quantile * np.sqrt(np.maximum(variance, 0.0))

    @cached_property
    def decay_interval(self) -> tuple[float, float]:
        """95 % profile interval of ``beta`` [s/m]; 0 or ``inf`` where it has no end.

        Bates and Watts, Nonlinear Regression Analysis, ch. 6.
        """
        level = self.squares + self.variance * self.t_quantile**2

        def above(log_decay: float) -> float:
            return _linear(self.curve, self.names, math.exp(log_decay), self.weight)[1] - level

        grid = np.log(_decays(self.curve))
        inside = [at for at in grid if above(at) <= 0.0] + [self.values[2]]

        def end(outside: FloatArray, within: float, without_end: float) -> float:
            if not outside.size:
                return without_end
            # On exact data rounding may leave nothing within.
            if above(within) < 0.0:
                within = float(brentq(above, outside[0], within, xtol=1e-14))
            return math.exp(within)

        low, high = min(inside), max(inside)
        return end(grid[grid < low][::-1], low, 0.0), end(grid[grid > high], high, math.inf)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know before using the fit, one sentence each."""
        return tuple(_warnings(self))

    def _gradient(self, speed: FloatArray) -> FloatArray:
        """Derivatives of the law at speeds, shape (n,), by the free coefficients, (n, k)."""
        left = np.exp(-self.decay * speed)
        by_decay = -self.values[0] * speed * np.exp(self.decay * (self.curve.speed.min() - speed))
        columns = {'static': left, 'kinetic': 1.0 - left, 'decay': by_decay, 'viscous': speed}
        return np.stack([columns[name] for name in self.names], axis=1)

    @cached_property
    def _decomposed(self) -> tuple[FloatArray, FloatArray]:
        """``Q`` (n, k) and ``R^-1`` (k, k) of the weighted gradient; ``inf`` if it is singular."""
        root = np.sqrt(self.weight) / self.curve.std
        rows = self._gradient(self.curve.speed) * root[:, None]
        size = np.linalg.norm(rows, axis=0)
        orthogonal, triangle = np.linalg.qr(rows / size)
        if np.abs(np.diag(triangle)).min() > _SINGULAR:
            return orthogonal, np.linalg.inv(triangle) / size[:, None]
        return orthogonal, np.full((size.size, size.size), np.inf)


def _law(values: FloatArray, curve: FrictionCurve) -> FloatArray:
    drop, kinetic, log_decay, viscous = values
    return (
        kinetic
        + drop * np.exp(-np.exp(log_decay) * (curve.speed - curve.speed.min()))
        + viscous * curve.speed
    )


def _floor(curve: FrictionCurve) -> float:
    """The least scale: what rounding leaves of exact data."""
    return _FLOOR * max(float(np.max(np.abs(curve.coefficient / curve.std))), _FLOOR)


def _decays(curve: FrictionCurve) -> FloatArray:
    """Decays [s/m] from a straight line to a step at the lowest speed, ten a decade."""
    place = np.unique(curve.speed - curve.speed.min())
    top = min(math.log10(40.0 * place[-1] / place[1]), 12.0)
    return np.logspace(-4.0, top, math.ceil((top + 4.0) * 10) + 1) / place[-1]


def _linear(
    curve: FrictionCurve, names: tuple[str, ...], decay: float, weight: FloatArray
) -> tuple[FloatArray, float]:
    """The best law of a decay, as values, and its weighted squares."""
    path = curve.speed - curve.speed.min()
    size = -np.expm1(-decay * path.max())
    # A fall measured from its end stays apart from a constant however slow it is.
    fall = np.exp(-decay * path) if 'kinetic' not in names else np.expm1(-decay * path) / size
    columns = {'static': fall, 'kinetic': np.ones_like(path), 'viscous': curve.speed}
    used = [name for name in names if name != 'decay']
    root = np.sqrt(weight) / curve.std
    scale = np.array([float(np.abs(columns[name]).max()) for name in used])
    left = np.stack([columns[name] for name in used], axis=1) / scale * root[:, None]
    target = root * curve.coefficient
    found = np.linalg.lstsq(left, target, rcond=_SINGULAR)[0]
    squares = float(np.sum((target - left @ found) ** 2))
    own = dict(zip(used, found / scale, strict=True))
    drop, kinetic = own['static'], own.get('kinetic', 0.0)
    if 'kinetic' in names:
        drop, kinetic = drop / size, kinetic - drop / size
    return np.array([drop, kinetic, math.log(decay), own.get('viscous', 0.0)]), squares


def _solve(curve: FrictionCurve, names: tuple[str, ...]) -> StribeckFit:
    """The robust fit with some coefficients free, whether or not it makes sense."""
    even = np.ones(curve.speed.size)
    start = min((_linear(curve, names, decay, even) for decay in _decays(curve)), key=lambda found: found[1])[
        0
    ]
    found = StribeckFit(curve, names, start, 1.0)
    # Nearly absolute residuals first, which outliers move little; their median makes the scale.
    steps: tuple[tuple[Loss, float], ...]
    steps = (('soft_l1', 0.1), ('soft_l1', 0.1), ('cauchy', CAUCHY))
    for loss, at in steps:
        scale = _robust_scale(found)
        found = replace(found, median_scale=scale, values=_descend(found, scale, loss, at))
    return found


def _descend(fit: StribeckFit, scale: float, loss: Loss, at: float) -> FloatArray:
    """The values that fit best, from those on, by a loss of the residuals over the scale."""
    curve = fit.curve
    free = np.array([name in fit.names for name in UNITS])
    root = 1.0 / (scale * curve.std)

    def whole(part: FloatArray) -> FloatArray:
        full = fit.values.copy()
        full[free] = part
        full[2] = min(full[2], 300.0)
        return full

    def misfit(part: FloatArray) -> FloatArray:
        return root * (_law(whole(part), curve) - curve.coefficient)

    def gradient(part: FloatArray) -> FloatArray:
        drop, _, log_decay, _ = whole(part)
        path = np.exp(log_decay) * (curve.speed - curve.speed.min())
        left = np.exp(-path)
        rows = [left, np.ones_like(path), -drop * path * left, curve.speed]
        return root[:, None] * np.stack(rows, axis=1)[:, free]

    options: dict[str, Any] = {'ftol': 1e-15, 'xtol': 1e-15, 'gtol': 1e-15, 'max_nfev': 200}
    found = least_squares(misfit, fit.values[free], gradient, x_scale='jac', loss=loss, f_scale=at, **options)
    return whole(found.x)


def _robust_scale(fit: StribeckFit) -> float:
    """Standard deviation from the median absolute residual.

    k residuals are small by construction, so the smallest k - 1 are left out (Street, Carroll and
    Ruppert 1988).
    """
    ordered, k = np.sort(np.abs(fit.residual / fit.curve.std)), len(fit.names)
    caution = 1.0 + _SMALL_SAMPLE / (ordered.size - k)
    return max(_MAD * caution * float(np.median(ordered[k - 1 :])), _floor(fit.curve))


def fit_stribeck(curve: FrictionCurve, viscous: Viscous = 'auto') -> StribeckFit:
    """Fit the Stribeck law to a measured curve.

    It has a viscous slope with ``'yes'``, where one that is negative by chance is held at 0, and
    with ``'auto'`` where the F-test wants it.

    Raises:
        FitError: The curve cannot identify the law.
    """
    asked = ' '.join(_questions(curve))
    try:
        with np.errstate(all='ignore'):
            return _identified(_chosen(curve, viscous))
    except FitError as error:
        raise FitError(f'{error}. {asked}' if asked else str(error)) from error
    except (ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError) as error:
        raise FitError(
            f'the {curve.speed.size} points do not determine a Stribeck law in numbers that a'
            f' computer holds ({error}): speeds from {curve.speed.min():.3g} to'
            f' {curve.speed.max():.3g} m/s, coefficients from {curve.coefficient.min():.3g} to'
            f' {curve.coefficient.max():.3g}{". " if asked else ""}{asked}'
        ) from error


def _chosen(curve: FrictionCurve, viscous: Viscous) -> StribeckFit:
    """The fit with or without a viscous slope."""
    if lack := _lack_of_points(curve, RISING if viscous == 'yes' else PLAIN):
        raise FitError(lack)
    if _lack_of_points(curve, RISING):
        return _solve(curve, PLAIN)
    full = _solve(curve, RISING)
    test = _viscous_test(full)
    if viscous == 'yes' and test.slope < 0.0 and test.p_value < 1.0 - CONFIDENCE:
        raise FitError(
            f'viscous = {test.slope:.4g} s/m (F = {test.f_value:.3g}) must not be negative: the'
            ' curve has no viscous rise; leave it out with --viscous no'
        )
    wanted = test.slope >= 0.0 if viscous == 'yes' else viscous == 'auto' and test.demands_slope
    return replace(full if wanted else _solve(curve, PLAIN), viscous_test=test)


def _viscous_test(full: StribeckFit) -> ViscousTest:
    """Compare with the best law without a slope at the weights of the full one."""
    grid = np.log(_decays(full.curve))

    def squares(log_decay: float) -> float:
        return _linear(full.curve, PLAIN, math.exp(log_decay), full.weight)[1]

    best = min(grid, key=squares)
    found = minimize_scalar(
        squares, bounds=(best - 0.3, best + 0.3), method='bounded', options={'xatol': 1e-10}
    )
    # What a slope takes from exact data is rounding.
    variance = max(full.variance, (_ROUNDING * _floor(full.curve)) ** 2)
    f_value = max(float(found.fun) - full.squares, 0.0) / variance
    p_value = float(stats.f.sf(f_value, 1.0, max(full.degrees_of_freedom, 1.0)))
    return ViscousTest(float(full.values[3]), f_value, p_value)


def _identified(free: StribeckFit) -> StribeckFit:
    """The fit, if the curve identifies it.

    Raises:
        FitError: It does not; the text says what is missing.
    """
    _require_kept(free)
    _require_fall(free)
    _require_decay(free)
    best = free
    if free.values[1] < 0.0:
        names = tuple(name for name in free.names if name != 'kinetic')
        best = replace(_solve(free.curve, names), viscous_test=free.viscous_test)
    _require_distinct(best)
    return best


def _lack_of_points(curve: FrictionCurve, names: tuple[str, ...]) -> str:
    """Whether there are too few points or too few different speeds, as a sentence."""
    n, k = curve.speed.size, len(names)
    coefficients = f'{k} coefficients ({", ".join(names)})'
    if n < k + SPARE_POINTS:
        return (
            f'points = {n} must be at least {k + SPARE_POINTS}: {coefficients} and'
            f' {SPARE_POINTS} more to judge them by'
        )
    distinct = np.unique(curve.speed).size
    return f'different speeds = {distinct} must be at least {k}: {coefficients}' * (distinct < k)


def _require_kept(fit: StribeckFit) -> None:
    """Refuse a curve most of which lies far from the law."""
    kept, least = int(np.sum(fit.weight > ASIDE)), len(fit.names) + SPARE_POINTS
    if kept < least:
        raise FitError(
            f'points on one curve = {kept} must be at least {least}: the other'
            f' {fit.weight.size - kept} lie far from it, so no Stribeck law describes the'
            ' measurement'
        )


def _require_fall(fit: StribeckFit) -> None:
    """Refuse a fall that is none, or that a constant explains as well (F-test at 0.1 %)."""
    if not fit.values[0] > 0.0:
        raise FitError(
            f'static - kinetic = {fit.values[0]:.3g} must be above 0: the curve has no falling'
            ' part that levels off, as the Stribeck law has'
        )
    columns = [np.ones_like(fit.curve.speed)]
    columns += [fit.curve.speed] if 'viscous' in fit.names else []
    root = np.sqrt(fit.weight) / fit.curve.std
    left, target = np.stack(columns, axis=1) * root[:, None], root * fit.curve.coefficient
    level = np.linalg.lstsq(left, target, rcond=None)[0]
    gain = float(np.sum((target - left @ level) ** 2)) - fit.squares
    f_value = gain / 2.0 / fit.variance
    least = float(stats.f.isf(FALL_LEVEL, 2.0, fit.degrees_of_freedom))
    if not f_value > least:
        raise FitError(
            f'F = {f_value:.3g} of the falling part must be above {least:.3g} (0.1 % level): no'
            f' falling part stands out of the scatter of {fit.scale:.2g}'
        )


def _require_decay(fit: StribeckFit) -> None:
    """Refuse speeds that do not hold the decay between them."""
    low, high = fit.decay_interval
    slowest, fastest = float(fit.curve.speed.min()), float(fit.curve.speed.max())
    if not math.isfinite(high):
        raise FitError(
            f'decay has no upper limit (95 % interval from {low:.3g} s/m): all speeds but the'
            f' lowest, {slowest:.3g} m/s, may lie beyond the decay; measure at lower speeds'
        )
    if (reach := fit.decay * slowest) > FARTHEST:
        raise FitError(
            f'decay * lowest speed = {fit.decay:.3g} s/m * {slowest:.3g} m/s = {reach:.3g}'
            f' must not be above {FARTHEST:g}: all speeds lie beyond the decay; measure at lower'
            ' speeds'
        )
    if not low > 0.0:
        raise FitError(
            f'decay has no lower limit (95 % interval up to {high:.3g} s/m): up to the highest'
            f' speed, {fastest:.3g} m/s, the fall does not bend towards a level; measure at higher'
            ' speeds'
        )


def _require_distinct(fit: StribeckFit) -> None:
    """Refuse coefficients of which the curve knows only a combination."""
    if not np.all(np.isfinite(fit.covariance)):
        raise FitError(
            f'decay = {fit.decay:.3g} s/m: the covariance of the coefficients must be finite, and'
            ' it is singular'
        )
    correlation = np.abs(fit.correlation) - np.eye(len(fit.names))
    i, j = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    if correlation[i, j] > MOST_CORRELATION:
        raise FitError(
            f'correlation of {fit.names[i]} and {fit.names[j]} = {correlation[i, j]:.6f} must not'
            f' be above {MOST_CORRELATION:g}: the curve knows only a combination of the two'
        )


def _questions(curve: FrictionCurve) -> list[str]:
    """What a user is asked about numbers that look like another unit, one question each."""
    found = []
    top = int(np.argmax(np.abs(curve.coefficient))) if curve.coefficient.size else 0
    if curve.coefficient.size and abs(curve.coefficient[top]) > _UNUSUAL_COEFFICIENT:
        found.append(
            f'a coefficient of {curve.coefficient[top]:.3g} (line {curve.line[top]}) is unusual:'
            ' is it in percent, 30 for 0.30?'
        )
    fastest = float(curve.speed.max(initial=0.0))
    if curve.unit == 'm/s' and fastest > _UNUSUAL_SPEED:
        found.append(f'a sliding speed of {fastest:.3g} m/s is unusual: is it in rpm (--speed-unit rpm)?')
    return found


def _warnings(fit: StribeckFit) -> Iterator[str]:
    curve = fit.curve
    yield from _questions(curve)
    share = fit.outliers.size / fit.weight.size
    if share > _MANY_OUTLIERS:
        yield f'{share:.0%} of the points count less than half: the law may not be the right one'
    if 'kinetic' not in fit.names:
        yield 'kinetic would be negative and is held at 0, without a standard error'
    yield from _lack_of_fit(fit)
    test = fit.viscous_test
    if test is not None and test.slope < 0.0 and test.p_value < VISCOUS_LEVEL:
        yield (
            f'the curve goes on falling at high speeds, by {-test.slope:.2g} s/m (p ='
            f' {test.p_value:.1g}): it has another shape than the Stribeck law, so that errors'
            ' and intervals are too small'
        )
    if (reach := fit.law.decay * float(curve.speed.min())) > 1.0:
        yield (
            f'static is extrapolated: at the lowest speed, {curve.speed.min():.3g} m/s, the'
            f' fall has gone down to {math.exp(-reach):.0%} of it'
        )


def unchecked(fit: StribeckFit) -> str:
    """The point that no other checks, as a sentence; '' for none."""
    leverage = fit.leverage
    top = int(np.argmax(leverage))
    if leverage[top] <= _MUCH_LEVERAGE:
        return ''
    return (
        f'the point of line {fit.curve.line[top]}, {fit.curve.speed[top]:.3g} m/s, is not checked'
        f' by any other (leverage {leverage[top]:.2f}): repeat it'
    )


def _lack_of_fit(fit: StribeckFit) -> Iterator[str]:
    """Whether neighbours are too much alike: along the speeds, and in the order of measurement."""
    if fit.scale <= _ROUNDING * _floor(fit.curve):
        return
    along = np.argsort(fit.curve.speed, kind='stable')
    taken = np.arange(along.size)
    if (alike := _likeness(fit, along)) < SHAPE_LEVEL:
        yield (
            f'neighbours along the speeds lie on one side of the law more often than by chance (p'
            f' = {alike:.1g}): the curve has another shape than the Stribeck law, so that errors'
            ' and intervals are too small'
        )
    elif (alike := _likeness(fit, taken)) < SHAPE_LEVEL:
        yield (
            'points measured one after the other lie on one side of the law more often than by'
            f' chance (p = {alike:.1g}): friction changed during the measurement, as by running in'
            ' or between rising and falling speed; fit the branches apart'
        )


def _likeness(fit: StribeckFit, order: IndexArray) -> float:
    """Probability of residuals whose neighbours are as much alike, if the law is right.

    The serial correlation of Durbin and Watson (Biometrika 37, 1950), by simulation: scatter
    without correlation leaves residuals that the fit has correlated, and of few points strongly.
    """
    root = np.sqrt(fit.weight)
    hat = fit._decomposed[0]
    noise = np.random.default_rng(0).standard_normal((_SHUFFLES, order.size))
    drawn = noise - (noise @ hat) @ hat.T
    own = root * fit.residual / fit.curve.std

    def serial(rows: FloatArray) -> FloatArray:
        sorted_rows = rows[:, order]
        products = np.sum(sorted_rows[:, 1:] * sorted_rows[:, :-1], axis=1)
        return products / np.sum(sorted_rows**2, axis=1)

    reached = np.sum(serial(drawn) >= serial(own[None, :])[0])
    return float((reached + 1) / (_SHUFFLES + 1))


@dataclass(frozen=True, slots=True)
class Spread:
    """What the fit's uncertainty leaves of a quantity that follows from the law."""

    estimate: float  # at the fitted law
    median: float  # of the drawn laws
    low: float  # 2.5 % quantile of the drawn laws
    high: float  # 97.5 % quantile of the drawn laws


@dataclass(frozen=True, slots=True)
class BoundarySpread:
    """Spread of the boundaries of a bearing; 0 m/s stands for a bearing without a boundary."""

    hopf_speed: Spread  # [m/s]
    fold_speed: Spread  # [m/s]
    without: float  # share of the drawn laws that have no boundary at this load [-]
    # V/V_H - 1 and V/V_F - 1 at a speed, inf without a boundary; None without speed.
    hopf_margin: Spread | None = None
    fold_margin: Spread | None = None
    # Shares of the drawn laws that are unstable, bistable and stable at that speed.
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

    ``V_H = d/beta`` with ``d = ln(Delta beta/(c/N + nu))``, and ``V_F`` follows from the same
    ``d``. Laws are those of :func:`drawn_laws`.

    Args:
        fit: The fitted law.
        damping: ``c`` > 0 [N s/m].
        load: ``N`` > 0 [N].
        speed: Surface speed > 0 for margins and regimes [m/s].
        draws: How many laws are drawn.
        seed: Seed of the draws.

    Raises:
        PhysicsError: A quantity breaks its rule.
    """
    require_positive('damping', damping, 'N s/m')
    require_positive('load', load, 'N')
    require_positive('draws', draws)
    best = _boundaries(_as_row(fit.law), damping / load)
    drawn = _boundaries(drawn_laws(fit, draws, seed), damping / load)
    hopf, fold = (_spread(float(one[0]), many) for one, many in zip(best, drawn, strict=True))
    result = BoundarySpread(hopf, fold, float(np.mean(drawn[1] == 0.0)))
    if speed is None:
        return result
    require_positive('speed', speed, 'm/s')
    with np.errstate(divide='ignore'):
        margins = [
            _spread(speed / float(one[0]) - 1.0 if one[0] else math.inf, speed / many - 1.0)
            for one, many in zip(best, drawn, strict=True)
        ]
    unstable, within = (float(np.mean(speed < each)) for each in drawn)
    shares = {'unstable': unstable, 'bistable': within - unstable, 'stable': 1.0 - within}
    return replace(result, hopf_margin=margins[0], fold_margin=margins[1], regimes=shares)


def drawn_laws(fit: StribeckFit, draws: int, seed: int) -> FloatArray:
    """Laws that the curve does not rule out: static, kinetic, decay, viscous; shape (draws, 4).

    They are drawn from the multivariate t distribution of (mu_s, mu_k, ln beta, nu), so that no
    decay is negative; a negative slope counts as 0.
    """
    scaling = np.where(np.array(fit.names) == 'decay', 1.0 / fit.law.decay, 1.0)
    freedom: Any = fit.degrees_of_freedom  # scipy's types want a whole number
    shape = fit.covariance * np.outer(scaling, scaling)
    distribution = stats.multivariate_t(shape=shape, df=freedom, allow_singular=True, seed=seed)
    off = np.zeros((draws, len(UNITS)))
    off[:, [list(UNITS).index(name) for name in fit.names]] = distribution.rvs(draws)
    laws = _as_row(fit.law) + off
    with np.errstate(over='ignore'):
        laws[:, 2] = fit.law.decay * np.exp(off[:, 2])
    laws[:, 3] = np.maximum(laws[:, 3], 0.0)
    return laws


def _as_row(law: Stribeck) -> FloatArray:
    return np.array([[getattr(law, name) for name in UNITS]])


def _boundaries(laws: FloatArray, q: float) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold speed of many laws at ``q = c/N`` [s/m]; 0 where there is no boundary."""
    static, kinetic, decay, viscous = laws.T
    with np.errstate(invalid='ignore', divide='ignore'):
        decline = np.log(np.maximum(static - kinetic, 0.0) * decay / (q + viscous))
    bounded = np.isfinite(decline) & (decline > 0.0)
    hopf, fold = np.zeros_like(decay), np.zeros_like(decay)
    hopf[bounded] = decline[bounded] / decay[bounded]
    fold[bounded] = closed_form.speed_for_decline(decline[bounded]) / decay[bounded]
    return hopf, fold


def _spread(estimate: float, drawn: FloatArray) -> Spread:
    tail = 50.0 * (1.0 - CONFIDENCE)
    # Quantiles without interpolation, which inf would spoil.
    low, median, high = np.percentile(drawn, [tail, 50.0, 100.0 - tail], method='nearest')
    return Spread(estimate, float(median), float(low), float(high))
