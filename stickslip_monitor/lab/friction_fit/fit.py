# SPDX-License-Identifier: Apache-2.0
"""Fits the Stribeck law to a measured friction curve, or refuses one that cannot identify it.

``mu(v) = mu_k + (mu_s - mu_k) exp(-beta v) [+ nu v]``. The robust fit with its errors is that of
``solve``; here it is decided what they are worth: whether the curve demands a viscous slope, a
refusal with what is missing, or the law with warnings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import stats
from scipy.special import ndtr

from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.errors import FitError
from stickslip_monitor.lab.friction_fit.curve_file import FrictionCurve
from stickslip_monitor.lab.friction_fit.solve import (
    PLAIN,
    RISING,
    TUKEY,
    Solution,
    scale_floor,
    solve,
)
from stickslip_monitor.physics.friction import Stribeck

FALL_LEVEL, VISCOUS_LEVEL = 0.001, 0.01
MOST_CORRELATION = 0.999
SPARE_POINTS = 2

_FARTHEST = 5.0
# Above these a number looks like percent, or like revolutions a minute.
_UNUSUAL_COEFFICIENT, _UNUSUAL_SPEED = 3.0, 30.0
_MANY_OUTLIERS, _MUCH_LEVERAGE = 0.2, 0.9
# Residuals of so few floors of scatter are rounding.
_ROUNDING, _LACK_LEVEL = 1e3, 0.02
_SIGNIFICANT = 2.0

Viscous = Literal['auto', 'yes', 'no']


@dataclass(frozen=True, slots=True)
class ViscousTest:
    """The comparison of the law with and without its viscous slope, at the same weights."""

    slope: float  # the slope that fits best, of either sign [s/m]
    t_value: float  # the slope by its standard error [-]
    f_value: float  # what it takes from the weighted squares, by their variance [-]
    p_value: float  # probability of a larger ``f_value`` without any slope [-]
    # By how much it lowers the corrected Akaike criterion; negative if it does not.
    aicc_gain: float

    @property
    def demands_slope(self) -> bool:
        """The criterion of ``auto``: the slope is positive and significant at 1 %."""
        return self.slope > 0.0 and self.p_value < VISCOUS_LEVEL


@dataclass(frozen=True, eq=False)
class StribeckFit(Solution):
    """A fitted law with its uncertainty."""

    # The test of the viscous slope; ``None`` with too few points for it.
    viscous_test: ViscousTest | None = None

    @property
    def law(self) -> Stribeck:
        """The fitted law."""
        kinetic, viscous = (max(float(value), 0.0) for value in self.values[[1, 3]])
        return Stribeck(kinetic + self.fall, kinetic, self.decay, viscous)

    @property
    def estimate(self) -> FloatArray:
        """Their values, shape (k,)."""
        return np.array([getattr(self.law, name) for name in self.names])

    @property
    def standard_error(self) -> FloatArray:
        """Standard error of each estimate, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the estimates, shape (k, k)."""
        return _correlation(self.covariance)

    @property
    def intervals(self) -> FloatArray:
        """95 % intervals, that of ``decay`` by profile, shape (k, 2)."""
        reach = self.t_quantile * self.standard_error
        both = np.stack([self.estimate - reach, self.estimate + reach], axis=1)
        both[self.names.index('decay')] = self.decay_interval
        return both

    @property
    def outliers(self) -> IndexArray:
        """Indices of the points that count less than half, in the curve's order."""
        return np.flatnonzero(self.weight < 0.5)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know before using the fit, one sentence each."""
        curve, found = self.curve, _questions(self.curve)
        share = self.outliers.size / self.weight.size
        if share > _MANY_OUTLIERS:
            found.append(
                f'{share:.0%} of the points count less than half: the law may not be the right one'
            )
        if 'kinetic' not in self.names:
            found.append('kinetic would be negative and is held at 0, without a standard error')
        found += self._lack_of_fit()
        test = self.viscous_test
        if test is not None and test.slope < 0.0 and test.p_value < VISCOUS_LEVEL:
            found.append(
                f'the curve goes on falling at high speeds, by {-test.slope:.2g} s/m (p ='
                f' {test.p_value:.1g}): it has another shape than the Stribeck law, so that errors'
                ' and intervals are too small'
            )
        reach = self.law.decay * float(curve.speed.min())
        if reach > 1.0:
            found.append(
                f'static is extrapolated: at the lowest speed, {curve.speed.min():.3g} m/s, the'
                f' fall has gone down to {math.exp(-reach):.0%} of it'
            )
        leverage = self.leverage
        top = int(np.argmax(leverage))
        if leverage[top] > _MUCH_LEVERAGE:
            found.append(
                f'the point of line {curve.line[top]}, {curve.speed[top]:.3g} m/s, is not checked'
                f' by any other (leverage {leverage[top]:.2f}): repeat it'
            )
        return tuple(found)

    def _lack_of_fit(self) -> list[str]:
        """What the residuals say against the law: runs of one sign along the speeds.

        Too few changes of sign (the runs test of Wald and Wolfowitz), or neighbours that are too
        much alike (their serial correlation, without the size of outliers), are another shape.
        """
        if self.scale <= _ROUNDING * scale_floor(self.curve):
            return []
        order = np.argsort(self.curve.speed, kind='stable')
        size = (self.residual / (self.scale * self.curve.std))[order]
        size, n = np.clip(size, -TUKEY, TUKEY), order.size
        alike = math.sqrt(n) * float(size[1:] @ size[:-1] / (size @ size))
        above = size > 0.0
        runs, pairs = 1 + int(np.sum(np.diff(above))), 2.0 * above.sum() * (n - above.sum())
        spread = math.sqrt(max(pairs * (pairs - n), 1.0) / (n * n * (n - 1.0)))
        few = (runs + 0.5 - 1.0 - pairs / n) / spread
        p_value = 2.0 * float(ndtr(min(few, -alike)))
        if p_value > _LACK_LEVEL:
            return []
        return [
            f'the residuals change sign {runs - 1} times along the speeds, about {pairs / n:.0f}'
            f' times by chance, and neighbours are alike (p = {p_value:.1g}): the curve has'
            ' another shape than the Stribeck law, so that errors and intervals are too small'
        ]


def fit_stribeck(curve: FrictionCurve, viscous: Viscous = 'auto') -> StribeckFit:
    """Fit the Stribeck law to a measured curve.

    It has a viscous slope with ``'yes'``, where one that is negative by chance is held at 0, and
    with ``'auto'`` where the F-test wants it.

    Raises:
        FitError: The curve cannot identify the law.
    """
    questions = ''.join(f' {question}' for question in _questions(curve))
    try:
        with np.errstate(all='ignore'):
            return _fitted(curve, viscous)
    except FitError as error:
        raise FitError(f'{error}{"." if questions else ""}{questions}') from error
    except (ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError) as error:
        raise FitError(
            f'the {curve.speed.size} points do not determine a Stribeck law in numbers that a'
            f' computer holds ({error}): speeds from {curve.speed.min():.3g} to'
            f' {curve.speed.max():.3g} m/s, coefficients from {curve.coefficient.min():.3g} to'
            f' {curve.coefficient.max():.3g}{"." if questions else ""}{questions}'
        ) from error


def _fitted(curve: FrictionCurve, viscous: Viscous) -> StribeckFit:
    """The fit of a curve of sound numbers."""
    lack = _lack_of_points(curve, RISING if viscous == 'yes' else PLAIN)
    if lack:
        raise FitError(lack)
    test = None
    if not _lack_of_points(curve, RISING):
        full = solve(curve, RISING)
        test = _viscous_test(full)
        if viscous == 'yes' and test.t_value < -_SIGNIFICANT:
            raise FitError(
                f'viscous = {test.slope:.4g} s/m (t = {test.t_value:.3g}) must not be negative:'
                ' the curve has no viscous rise; leave it out with --viscous no'
            )
        if (viscous == 'yes' and test.slope >= 0.0) or (viscous == 'auto' and test.demands_slope):
            return _identified(full, test)
    return _identified(solve(curve, PLAIN), test)


def _identified(free: Solution, test: ViscousTest | None) -> StribeckFit:
    """The fit, if the curve identifies it."""
    _require_kept(free)
    _require_fall(free)
    _require_decay(free)
    best = free
    if free.values[1] < 0.0:
        best = solve(free.curve, tuple(name for name in free.names if name != 'kinetic'))
        _require_kept(best)
    _require_distinct(best)
    numbers = (best.curve, best.names, best.values, best.weight, best.median_scale)
    return StribeckFit(*numbers, test)


def _viscous_test(full: Solution) -> ViscousTest:
    """Compare with the best plain law at the weights of the full one."""
    plain = replace(full, names=PLAIN).started().descended()
    gain = max(plain.squares - full.squares, 0.0)
    f_value, error = gain / full.variance, math.sqrt(full.covariance[3, 3])
    p_value = float(stats.f.sf(f_value, 1.0, max(full.degrees_of_freedom, 1.0)))
    count = float(full.weight.sum())
    floor = count * scale_floor(full.curve) ** 2
    lower = count * math.log(max(full.squares + gain, floor) / max(full.squares, floor))
    # What the corrected Akaike criterion asks for a law of k coefficients and a scatter.
    with_slope, without = (2.0 * k * count / max(count - k - 1.0, 1e-9) for k in (5, 4))
    slope = float(full.values[3])
    return ViscousTest(slope, slope / error, f_value, p_value, lower - with_slope + without)


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
        found.append(
            f'a sliding speed of {fastest:.3g} m/s is unusual: is it in rpm (--speed-unit rpm)?'
        )
    return found


def _lack_of_points(curve: FrictionCurve, names: Sequence[str]) -> str:
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


def _require_kept(solution: Solution) -> None:
    """Refuse a curve most of which was set aside as outliers."""
    kept, least = int(np.sum(solution.weight > 0.0)), len(solution.names) + SPARE_POINTS
    if kept < least:
        raise FitError(
            f'points on one curve = {kept} must be at least {least}: the other'
            f' {solution.weight.size - kept} lie far from it, so no Stribeck law describes the'
            ' measurement'
        )


def _require_fall(solution: Solution) -> None:
    """Refuse a fall that is none, or that a constant explains as well (F-test at 0.1 %)."""
    if not solution.values[0] > 0.0:
        raise FitError(
            f'static - kinetic = {solution.fall:.3g} must be above 0: the curve has no falling'
            ' part that levels off, as the Stribeck law has'
        )
    constant = np.ones((1, solution.weight.size, 1))
    if 'viscous' in solution.names:
        constant = np.concatenate([constant, solution.curve.speed[None, :, None]], axis=2)
    gain = solution.least_squares_of(constant)[0] - solution.squares
    f_value = gain / 2.0 / solution.variance
    least = float(stats.f.isf(FALL_LEVEL, 2.0, solution.degrees_of_freedom))
    if not f_value > least:
        raise FitError(
            f'F = {f_value:.3g} of the falling part must be above {least:.3g} (0.1 % level): no'
            f' falling part stands out of the scatter of {solution.scale:.2g}'
        )


def _require_decay(solution: Solution) -> None:
    """Refuse speeds that do not hold the decay between them."""
    low, high = solution.decay_interval
    slowest, fastest = solution.curve.speed.min(), solution.curve.speed.max()
    if not math.isfinite(high):
        raise FitError(
            f'decay has no upper limit (95 % interval from {low:.3g} s/m): all speeds but the'
            f' lowest, {slowest:.3g} m/s, may lie beyond the decay; measure at lower speeds'
        )
    reach = solution.decay * float(slowest)
    if reach > _FARTHEST:
        raise FitError(
            f'decay * lowest speed = {solution.decay:.3g} s/m * {slowest:.3g} m/s = {reach:.3g}'
            f' must not be above {_FARTHEST:g}: all speeds lie beyond the decay; measure at lower'
            ' speeds'
        )
    if not low > 0.0:
        raise FitError(
            f'decay has no lower limit (95 % interval up to {high:.3g} s/m): up to the highest'
            f' speed, {fastest:.3g} m/s, the fall does not bend towards a level; measure at higher'
            ' speeds'
        )


def _require_distinct(solution: Solution) -> None:
    """Refuse coefficients of which the curve knows only a combination."""
    covariance = solution.covariance
    if not np.all(np.isfinite(covariance)):
        raise FitError(
            f'decay = {solution.decay:.3g} s/m: the covariance of the coefficients must be finite,'
            ' and it is singular'
        )
    correlation = np.abs(_correlation(covariance)) - np.eye(len(covariance))
    i, j = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    if correlation[i, j] > MOST_CORRELATION:
        names = solution.names
        raise FitError(
            f'correlation of {names[i]} and {names[j]} = {correlation[i, j]:.6f} must not be above'
            f' {MOST_CORRELATION:g}: the curve knows only a combination of the two'
        )


def _correlation(covariance: FloatArray) -> FloatArray:
    error = np.sqrt(np.diag(covariance))
    matrix: FloatArray = covariance / np.outer(error, error)
    np.fill_diagonal(matrix, 1.0)
    return matrix
