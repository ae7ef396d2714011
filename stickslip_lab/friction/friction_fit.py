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
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.optimize import least_squares

from stickslip_lab.friction.curve_file import FrictionCurve
from stickslip_monitor.arrays import FloatArray, IndexArray
from stickslip_monitor.errors import FitError
from stickslip_monitor.physics.bearing import SPEED_UNITS, Bearing
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.lubrication import Lubrication, reference_point, speed_over_load
from stickslip_monitor.physics.probability import Belief

UNITS = {'static': '', 'kinetic': '', 'decay': 's/m', 'viscous': 's/m'}
"""The coefficients of the law, with their units."""
PLAIN, RISING = ('static', 'kinetic', 'decay'), tuple(UNITS)
"""The free coefficients without and with the viscous slope."""
CONFIDENCE = 0.95
"""Probability with which intervals and bands hold."""
CAUCHY = 2.385
"""A residual of so many scales counts half; on clean data 95 % efficient (Rey 1983)."""
FALL_LEVEL = 0.001
"""Level of significance of the fall."""
VISCOUS_LEVEL = SHAPE_LEVEL = 0.01
"""Level of significance of a viscous slope, and of residuals that are not independent."""
MAX_CORRELATION = 0.999
"""Two coefficients that are correlated more than this are known only together."""
SPARE_POINTS = 2
"""Points needed beyond the number of coefficients, to judge the fit by."""
MAX_REACH = 5.0
"""Largest decay times lowest speed: beyond it all points lie where the fall has ended."""
MAX_DECAY_FACTOR = 4.0
"""A decay whose 95 % interval reaches farther than this factor either way is not known."""
ASIDE = 0.1
"""A point of a smaller weight lies on no curve with the others."""
SEVERAL_LOADS = (
    'the load or the temperature of the water may be the reason, if the points are of several: give each its'
    ' load and temperature in columns of these names'
)
"""Advice where points scatter as curves of several loads do: friction depends on speed times viscosity over
load."""
# Residuals of exact data, as a share of the coefficients; and a pivot, as a share of 1, that is singular.
_ROUNDING = 1e-12

Viscous = Literal['auto', 'yes', 'no']


@dataclass(frozen=True, slots=True)
class ViscousTest:
    """The F-test of a viscous slope: its square over its variance."""

    slope: float  # the slope that fits best, of either sign [s/m]
    f_value: float
    p_value: float  # probability of a larger one without any slope [-]

    @property
    def demands_slope(self) -> bool:
        """Whether ``auto`` takes a slope: it is positive and significant at 1 %."""
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
    def points(self) -> FrictionCurve:
        """The points as measured."""
        return self.curve

    @property
    def free_count(self) -> int:
        """Number of fitted coefficients."""
        return len(self.names)

    @property
    def law(self) -> Stribeck:
        """The fitted law; a kinetic coefficient or slope that is negative by chance becomes 0.

        Raises:
            PhysicsError: The static coefficient is negative, or a coefficient is not finite.
        """
        kinetic, viscous = (max(float(value), 0.0) for value in self.values[[1, 3]])
        decay = math.exp(self.values[2])
        fall = float(self.values[0] * np.exp(decay * self.curve.speed.min()))
        return Stribeck(kinetic + fall, kinetic, decay, viscous)

    @property
    def estimate(self) -> FloatArray:
        """Values of the free coefficients, in the order of :attr:`names`, shape (k,)."""
        return np.array([getattr(self.law, name) for name in self.names])

    @cached_property
    def residual(self) -> FloatArray:
        """Measured minus fitted coefficient, shape (n,) [-]."""
        return self.curve.coefficient - _evaluate_law(self.values, self.curve)

    @cached_property
    def weight(self) -> FloatArray:
        """Cauchy's weight of each point, ``1/(1 + (r/(2.385 s))^2)``, shape (n,)."""
        return 1.0 / (1.0 + (self.residual / (CAUCHY * self.median_scale * self.curve.std)) ** 2)

    @property
    def outliers(self) -> IndexArray:
        """Indices of the points that count less than half, in the curve's order."""
        return np.flatnonzero(self.weight < 0.5)

    @property
    def degrees_of_freedom(self) -> float:
        """Sum of the weights less the number of fitted coefficients."""
        return float(self.weight.sum()) - self.free_count

    @cached_property
    def scale(self) -> float:
        """Standard deviation ``s`` of a point, in units of its ``std`` [-]; exact data keep a floor.

        With it ``s^2 (J'WJ)^-1`` is the covariance: Huber and Ronchetti, Robust Statistics, 2nd
        ed., eq. (7.81).
        """
        n, p = self.weight.size, self.free_count
        slope = self.weight**2 * (2.0 - 1.0 / self.weight)
        mean = max(float(slope.mean()), 0.1)
        correction = 1.0 + p / n * float(slope.var()) / mean**2
        influence = float(np.sum((self.weight * self.residual / self.curve.std) ** 2)) / (n - p)
        spread = correction**2 * influence / mean**2 * float(self.weight.mean())
        return max(math.sqrt(spread), _rounding_scale(self.curve))

    @property
    def t_quantile(self) -> float:
        """Number of standard errors in a 95 % interval."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.degrees_of_freedom))

    @property
    def leverage(self) -> FloatArray:
        """Diagonal of the weighted hat matrix, shape (n,)."""
        return np.sum(self.decomposed[0] ** 2, axis=1)

    @property
    def covariance(self) -> FloatArray:
        """``s^2 (J'WJ)^-1`` of the free coefficients, (k, k); ``inf`` where it is singular."""
        inverse = self.decomposed[1]
        return self.scale**2 * (inverse @ inverse.T)

    @property
    def full_covariance(self) -> FloatArray:
        """Covariance of all fitted numbers: here of the free coefficients, shape (k, k)."""
        return self.covariance

    @property
    def lubrication(self) -> Lubrication | None:
        """The conditions of the measurement as a bearing has them; ``None``: as those of the ship."""
        return None

    @property
    def standard_error(self) -> FloatArray:
        """Standard error of each estimate, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the estimates, shape (k, k)."""
        return self.covariance / np.outer(self.standard_error, self.standard_error)

    @property
    def decay_factor(self) -> float:
        """Factor by which the decay may be higher or lower at 95 %; ``decay`` must be free."""
        of_log = self.standard_error[self.names.index('decay')] / self.law.decay
        return math.exp(min(self.t_quantile * float(of_log), 700.0))

    @property
    def intervals(self) -> FloatArray:
        """95 % intervals (low, high) of the free coefficients, (k, 2); of ``decay`` by its logarithm."""
        reach = self.t_quantile * self.standard_error
        ends = np.stack([self.estimate - reach, self.estimate + reach], axis=1)
        decay, factor = self.law.decay, self.decay_factor
        ends[self.names.index('decay')] = decay / factor, decay * factor
        return ends

    def band(self, speed: ArrayLike) -> FloatArray:
        """Return the half width of the pointwise 95 % band [-] at speeds >= 0 [m/s], shape (n,) each."""
        gradient = self._law_gradient(np.asarray(speed, dtype=float))
        variance = np.einsum('ni,ij,nj->n', gradient, self.covariance, gradient)
        return self.t_quantile * np.sqrt(np.maximum(variance, 0.0))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Clauses on doubts about the fit; empty without any."""
        return tuple(_fit_warnings(self))

    def _law_gradient(self, speed: FloatArray) -> FloatArray:
        """Return derivatives of the law at speeds (n,) [m/s] by the coefficients in :attr:`names`, (n, k)."""
        decay = math.exp(self.values[2])
        left = np.exp(-decay * speed)
        by_decay = -self.values[0] * speed * np.exp(decay * (self.curve.speed.min() - speed))
        columns = {'static': left, 'kinetic': 1.0 - left, 'decay': by_decay, 'viscous': speed}
        return np.stack([columns[name] for name in self.names], axis=1)

    @cached_property
    def decomposed(self) -> tuple[FloatArray, FloatArray]:
        """``Q`` (n, k) and ``R^-1`` (k, k) of the weighted gradient; ``R^-1`` is ``inf`` if singular."""
        root = np.sqrt(self.weight) / self.curve.std
        rows = self._law_gradient(self.curve.speed) * root[:, None]
        size = np.linalg.norm(rows, axis=0)
        orthogonal, triangle = np.linalg.qr(rows / size)
        if np.abs(np.diag(triangle)).min() > _ROUNDING:
            return orthogonal, np.linalg.inv(triangle) / size[:, None]
        return orthogonal, np.full((size.size, size.size), np.inf)


def _evaluate_law(values: FloatArray, curve: FrictionCurve) -> FloatArray:
    """Return friction by :attr:`StribeckFit.values` at the speeds of a curve, shape (n,) [-]."""
    drop, kinetic, log_decay, viscous = values
    path = curve.speed - curve.speed.min()
    return np.asarray(kinetic + drop * np.exp(-np.exp(log_decay) * path) + viscous * curve.speed)


def _rounding_scale(curve: FrictionCurve) -> float:
    """Return the scale that rounding gives the residuals of exact data, in units of ``std``."""
    return _ROUNDING * float(np.max(np.abs(curve.coefficient / curve.std), initial=1e-14))


def fit_stribeck(curve: FrictionCurve, viscous: Viscous = 'auto') -> StribeckFit:
    """Fit the Stribeck law to a measured curve.

    Args:
        curve: The curve; its loads and temperatures are not used.
        viscous: ``'yes'`` for a viscous slope, where one that is negative by chance is held at 0; ``'no'``
            for none; ``'auto'`` for one where the F-test wants it.

    Raises:
        FitError: The curve cannot identify the law.
    """
    with explained_fit_errors(curve):
        return _require_identified(_choose_fit(curve, viscous))


@contextmanager
def explained_fit_errors(curve: FrictionCurve) -> Iterator[None]:
    """Raise numerical errors of the block as a FitError, and add questions on units to any FitError.

    Floating-point warnings are silenced within it.

    Raises:
        FitError: The block raised one, or an ArithmeticError, ValueError, IndexError or LinAlgError.
    """
    questions = ' '.join(_unit_questions(curve))
    try:
        with np.errstate(all='ignore'):
            yield
    except FitError as error:
        raise FitError(f'{error}. {questions}' if questions else str(error)) from error
    except (ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError) as error:
        raise FitError(
            f'the {curve.speed.size} points do not determine a Stribeck law in numbers that a'
            f' computer holds ({error}): speeds from {curve.speed.min():.3g} to'
            f' {curve.speed.max():.3g} m/s, coefficients from {curve.coefficient.min():.3g} to'
            f' {curve.coefficient.max():.3g}{". " if questions else ""}{questions}'
        ) from error


def _choose_fit(curve: FrictionCurve, viscous: Viscous) -> StribeckFit:
    """Return the fit with or without a viscous slope; it has the test of the slope if the points allow one.

    With 'yes' a slope that is negative by chance is left out; 'auto' takes a slope that the F-test demands,
    'no' takes none.

    Raises:
        FitError: There are too few points, or ``viscous`` is 'yes' and the slope clearly negative.
    """
    if lack := lack_of_points(curve, RISING if viscous == 'yes' else PLAIN):
        raise FitError(lack)
    if lack_of_points(curve, RISING):
        return solve_law(curve, PLAIN)
    full = solve_law(curve, RISING)
    f_value = float(full.values[3] ** 2 / full.covariance[3, 3])
    p_value = float(stats.f.sf(f_value, 1.0, max(full.degrees_of_freedom, 1.0)))
    test = ViscousTest(float(full.values[3]), f_value, p_value)
    if viscous == 'yes' and test.slope < 0.0 and test.p_value < 1.0 - CONFIDENCE:
        raise FitError(
            f'viscous = {test.slope:.4g} s/m (F = {test.f_value:.3g}) must not be negative: the'
            ' curve has no viscous rise; leave it out with --viscous no'
        )
    wanted = test.slope >= 0.0 if viscous == 'yes' else viscous == 'auto' and test.demands_slope
    return replace(full if wanted else solve_law(curve, PLAIN), viscous_test=test)


def solve_law(curve: FrictionCurve, names: tuple[str, ...], scale: float = 0.0) -> StribeckFit:
    """Compute the robust fit with some coefficients free, whether or not the curve identifies them.

    Where numbers overflow or all speeds are equal, errors of numpy pass through
    (:func:`explained_fit_errors`).

    Args:
        curve: The curve.
        names: The free coefficients; the others are 0.
        scale: Standard deviation of the residuals, in units of each point's ``std``; 0 for one by their
            median.
    """
    fit, given = StribeckFit(curve, names, _start_values(curve, names), 1.0), scale
    # Nearly absolute residuals first, which outliers move little; their median makes the scale.
    for loss, loss_scale in (('soft_l1', 0.1), ('soft_l1', 0.1), ('cauchy', CAUCHY)):
        scale = given or _robust_scale(fit)
        fit = replace(fit, median_scale=scale, values=_minimise_loss(fit, scale, loss, loss_scale))
    return fit


def _start_values(curve: FrictionCurve, names: tuple[str, ...]) -> FloatArray:
    """Return the values of least squares over a scan of the decay, ten to a decade.

    The scan goes from a straight line to a step at the lowest speed. The values are as
    :attr:`StribeckFit.values`; those that are not in ``names`` are 0, but for the decay.
    """
    path = curve.speed - curve.speed.min()
    place = np.unique(path)
    top = min(math.log10(40.0 * place[-1] / place[1]), 12.0)
    root = 1.0 / curve.std
    best, start = math.inf, np.zeros(4)
    free = [k for k, name in enumerate(UNITS) if name in names and name != 'decay']
    for decay in np.logspace(-2.0, top, math.ceil((top + 2.0) * 10) + 1) / place[-1]:
        columns = np.stack([np.exp(-decay * path), np.ones_like(path), path, curve.speed])[free].T
        size = np.abs(columns).max(axis=0)
        left, right = columns / size * root[:, None], root * curve.coefficient
        solved = np.linalg.lstsq(left, right, rcond=_ROUNDING)[0]
        squares = float(np.sum((right - left @ solved) ** 2))
        if squares < best:
            best, start = squares, np.zeros(4)
            start[free], start[2] = solved / size, math.log(decay)
    return start


def _minimise_loss(fit: StribeckFit, scale: float, loss: str, loss_scale: float) -> FloatArray:
    """Return the values of least loss, from those of a fit as the start.

    Args:
        fit: The start; coefficients that are not in its ``names`` keep their values.
        scale: Standard deviation by which residuals are divided, in units of each point's ``std``.
        loss: Name of a loss of ``scipy.optimize.least_squares``.
        loss_scale: Its ``f_scale``: the divided residual from which on points count less.

    Returns:
        All values, as :attr:`StribeckFit.values`.

    Raises:
        ValueError: The law overflows at the start.
    """
    free = np.array([name in fit.names for name in UNITS])

    def complete(part: FloatArray) -> FloatArray:
        """Return all values, shape (4,), of the type of ``part``, which has the free ones, shape (k,)."""
        full = fit.values.astype(part.dtype)
        full[free] = part
        return full

    def misfit(part: FloatArray) -> FloatArray:
        """Return the divided residuals for values of the free coefficients, shape (n,)."""
        return (_evaluate_law(complete(part), fit.curve) - fit.curve.coefficient) / (scale * fit.curve.std)

    exactly: Any = dict.fromkeys(('ftol', 'xtol', 'gtol'), 1e-15)
    how: Any = {'x_scale': 'jac', 'loss': loss, 'f_scale': loss_scale, 'max_nfev': 200}
    return complete(least_squares(misfit, fit.values[free], 'cs', **how, **exactly).x)


def _robust_scale(fit: StribeckFit) -> float:
    """Estimate the standard deviation from the median absolute residual, in units of ``std``.

    It is raised for few points, of which there must be more than free coefficients, and not below a hundredth
    of the rounding error. Since k residuals are small by construction, the smallest k - 1 are left out
    (Street, Carroll and Ruppert 1988).
    """
    ordered, k = np.sort(np.abs(fit.residual / fit.curve.std)), len(fit.names)
    # The median of few residuals scatters: this keeps it from setting good points aside.
    caution = 1.0 + 2.0 / (ordered.size - k)
    # Standard deviation of a normal distribution over its median absolute deviation.
    ratio = 1.482602218505602
    return max(ratio * caution * float(np.median(ordered[k - 1 :])), 0.01 * _rounding_scale(fit.curve))


def lack_of_points(curve: FrictionCurve, names: tuple[str, ...]) -> str:
    """Return a clause on the rule that too few points or different speeds break; '' if there are enough."""
    n, k = curve.speed.size, len(names)
    coefficients = f'{k} coefficients ({", ".join(names)})'
    if n < k + SPARE_POINTS:
        return (
            f'points = {n} must be at least {k + SPARE_POINTS}: {coefficients} and'
            f' {SPARE_POINTS} more to judge them by'
        )
    distinct = np.unique(curve.speed).size
    return f'different speeds = {distinct} must be at least {k}: {coefficients}' * (distinct < k)


def _require_identified(free: StribeckFit) -> StribeckFit:
    """Return the fit if the curve identifies it, fitted anew with a ``mu_k`` of 0 where that is negative.

    Raises:
        FitError: It does not: too few points lie on one curve, friction does not fall, the decay is open, or
            two coefficients are known only together.
    """
    used_count, required_count = int(np.sum(free.weight > ASIDE)), len(free.names) + SPARE_POINTS
    if used_count < required_count:
        raise FitError(
            f'points on one curve = {used_count} must be at least {required_count}: the other'
            f' {free.weight.size - used_count} lie far from it, so no Stribeck law describes the'
            f' measurement; {SEVERAL_LOADS}'
        )
    _require_fall(free)
    _require_decay(free)
    best = free
    if free.values[1] < 0.0:
        names = tuple(name for name in free.names if name != 'kinetic')
        best = replace(solve_law(free.curve, names), viscous_test=free.viscous_test)
    correlation = np.abs(best.correlation) - np.eye(len(best.names))
    i, j = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    if not correlation[i, j] <= MAX_CORRELATION:
        raise FitError(
            f'correlation of {best.names[i]} and {best.names[j]} = {correlation[i, j]:.6f} must'
            f' not be above {MAX_CORRELATION:g}: the curve knows only a combination of the two'
        )
    return best


def _require_fall(fit: StribeckFit) -> None:
    """Raise FitError unless friction falls, and significantly so (F-test at 0.1 %).

    The law is compared with a constant, or with a straight line if the fit has a viscous slope.
    """
    if not fit.values[0] > 0.0:
        raise FitError(
            f'static - kinetic = {fit.values[0]:.3g} must be above 0: the curve has no falling'
            ' part that levels off, as the Stribeck law has'
        )
    # A constant, and a slope where the fit has one.
    powers = np.arange(2 if 'viscous' in fit.names else 1)
    root = np.sqrt(fit.weight) / fit.curve.std
    left, target = fit.curve.speed[:, None] ** powers * root[:, None], root * fit.curve.coefficient
    level = np.linalg.lstsq(left, target, rcond=None)[0]
    gain = np.sum((target - left @ level) ** 2) - np.sum((root * fit.residual) ** 2)
    f_value = float(gain) / 2.0 / fit.scale**2
    critical = float(stats.f.isf(FALL_LEVEL, 2.0, fit.degrees_of_freedom))
    if not f_value > critical:
        raise FitError(
            f'F = {f_value:.3g} of the falling part must be above {critical:.3g} (0.1 % level): no'
            f' falling part stands out of the scatter of {fit.scale:.2g}'
        )


def _require_decay(fit: StribeckFit) -> None:
    """Raise FitError unless the measured speeds show where friction falls.

    They do not if all of them lie beyond the fall, if all but the lowest may, or if the fall has not levelled
    off at the highest.
    """
    slowest, fastest = float(fit.curve.speed.min()), float(fit.curve.speed.max())
    decay, factor = fit.law.decay, fit.decay_factor
    if (reach := decay * slowest) > MAX_REACH:
        raise FitError(
            f'decay * lowest speed = {decay:.3g} s/m * {slowest:.3g} m/s = {reach:.3g}'
            f' must not be above {MAX_REACH:g}: all speeds lie beyond the decay; measure at lower'
            ' speeds'
        )
    second = float(np.unique(fit.curve.speed)[1])
    left = fit.values[0] * math.exp(-decay * (second - slowest))
    ended = left < fit.t_quantile * fit.scale * float(np.median(fit.curve.std))
    if factor <= MAX_DECAY_FACTOR and not ended:
        return
    if not ended and decay * (fastest - slowest) < 3.0:
        raise FitError(
            f'decay = {decay:.3g} s/m is known to a factor of {factor:.2g} only: up to the highest'
            f' speed, {fastest:.3g} m/s, the fall does not bend towards a level; measure at higher'
            ' speeds'
        )
    raise FitError(
        f'decay = {decay:.3g} s/m has no upper limit: all speeds but the lowest, {slowest:.3g} m/s,'
        ' may lie beyond the decay; measure at lower speeds'
    )


def _unit_questions(curve: FrictionCurve) -> list[str]:
    """Return a question for each quantity whose numbers look like another unit; an empty list for none.

    Coefficients above 3 and sliding speeds above 30 m/s do.
    """
    questions = []
    top = int(np.argmax(np.abs(curve.coefficient))) if curve.coefficient.size else 0
    if curve.coefficient.size and abs(curve.coefficient[top]) > 3.0:
        questions.append(
            f'a coefficient of {curve.coefficient[top]:.3g} (line {curve.line[top]}) is unusual:'
            ' is it in percent, 30 for 0.30?'
        )
    fastest = float(curve.speed.max(initial=0.0))
    if fastest > 30.0:
        advice = 'is the diameter in metres' if curve.unit in SPEED_UNITS else 'is its unit right'
        advice = 'is it in rpm (--speed-unit rpm)' if curve.unit == 'm/s' else advice
        questions.append(f'a sliding speed of {fastest:.3g} m/s is unusual: {advice}?')
    return questions


def _fit_warnings(fit: StribeckFit) -> Iterator[str]:
    """Yield a clause on each doubt about a fit that was accepted; none where there is no doubt."""
    curve = fit.curve
    yield from _unit_questions(curve)
    share = fit.outliers.size / fit.weight.size
    if share > 0.2:
        yield f'{share:.0%} of the points count less than half: the law may not be the right one'
    if 'kinetic' not in fit.names:
        yield 'kinetic would be negative and is held at 0, without a standard error'
    lacking = list(_lack_of_fit(fit))
    yield from lacking
    if lacking and curve.load is None:
        yield SEVERAL_LOADS
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


def unchecked_point(fit: StribeckFit) -> str:
    """Return a clause on the point that no other checks, as its leverage is above 0.9; '' without one."""
    leverage = fit.leverage
    top = int(np.argmax(leverage))
    if leverage[top] <= 0.9:
        return ''
    return (
        f'the point of line {fit.curve.line[top]}, {fit.curve.speed[top]:.3g} m/s, is not checked'
        f' by any other (leverage {leverage[top]:.2f}): repeat it'
    )


def _lack_of_fit(fit: StribeckFit) -> Iterator[str]:
    """Yield a clause, at most one, on residuals that are not independent.

    Neighbours along the speeds or in the order of measurement may be alike, or the scatter may grow
    with the slope of the law. Residuals within the rounding of the data are not judged.
    """
    if fit.scale <= _rounding_scale(fit.curve):
        return
    along = np.argsort(fit.curve.speed, kind='stable')
    if (alike := _neighbour_probability(fit, along)) < SHAPE_LEVEL:
        yield (
            f'neighbours along the speeds lie on one side of the law more often than by chance (p'
            f' = {alike:.1g}): the curve has another shape than the Stribeck law, so that errors'
            ' and intervals are too small'
        )
    elif (alike := _neighbour_probability(fit, np.arange(along.size))) < SHAPE_LEVEL:
        yield (
            'points measured one after the other lie on one side of the law more often than by'
            f' chance (p = {alike:.1g}): friction changed during the measurement, as by running in'
            ' or between rising and falling speed; fit the branches apart'
        )
    else:
        # Curves at other loads or temperatures are the same one at other speeds: they part where it falls.
        fall = fit.curve.speed * np.abs(fit.law.slope(fit.curve.speed))
        size = np.abs(fit.residual / fit.curve.std)
        spread = float(stats.spearmanr(fall, size, alternative='greater').pvalue)
        if spread < SHAPE_LEVEL:
            yield (
                'points scatter more where friction falls than where it is level (p ='
                f' {spread:.1g}): several curves lie one beside the other'
            )


def _neighbour_probability(fit: StribeckFit, order: IndexArray) -> float:
    """Return the probability that neighbouring residuals are at least as much alike, if the law is right.

    The serial correlation of Durbin and Watson (Biometrika 37, 1950), by simulation, always with the same
    random numbers: scatter without correlation leaves residuals that the fit has correlated, and of few
    points strongly.

    Args:
        fit: The fit.
        order: Indices of the points in the order in which neighbours stand, shape (n,).
    """
    hat = fit.decomposed[0]
    # By 4000 simulated curves p = 0.01 is known to 0.0016.
    noise = np.random.default_rng(0).standard_normal((4000, order.size))
    scaled = np.sqrt(fit.weight) * fit.residual / fit.curve.std
    rows = np.vstack([scaled, noise - (noise @ hat) @ hat.T])[:, order]
    serial = np.sum(rows[:, 1:] * rows[:, :-1], axis=1) / np.sum(rows**2, axis=1)
    return float(np.mean(serial >= serial[0]))


def boundary_belief(fit: StribeckFit, bearing: Bearing, load: float) -> Belief:
    """Return the belief of a bearing with the fitted law, by the fit's uncertainty alone.

    Speeds of boundaries go with ``r = 1/beta``, and loads with ``kappa = (c/N + nu)/((mu_s - mu_k) beta)``;
    both to first order in the coefficients. The covariance is widened by Student's t over the normal
    quantile.

    Args:
        fit: The fit.
        bearing: The bearing, with damping above 0; its friction and lubrication give way to those of the fit.
        load: Load > 0 at which the effect of ``nu`` and of the exponent counts [N].
    """
    law, fitted = fit.law, replace(bearing, friction=fit.law, lubrication=fit.lubrication)
    fall, damping = law.static - law.kinetic, bearing.damping / float(reference_point(fitted, 0.0, load)[1])
    of_r = {'decay': -1.0 / law.decay}
    of_q = {
        'static': 1.0 / fall,
        'kinetic': -1.0 / fall,
        'decay': 1.0 / law.decay,
        'viscous': -1.0 / (damping + law.viscous),
    }
    rows = np.array([[of.get(name, 0.0) for name in fit.names] for of in (of_r, of_q)])
    # A load moves c/N only.
    rows[1] *= (damping + law.viscous) / damping
    if fit.lubrication is not None:  # what is uncertain of the exponent moves the reference point
        log_load = math.log(load / fit.lubrication.load)
        rows = np.column_stack([rows, [log_load, -log_load]])
    wider = fit.t_quantile / stats.norm.ppf(0.5 + 0.5 * CONFIDENCE)
    return Belief(fitted, wider**2 * rows @ fit.full_covariance @ rows.T)


def boundary_quantiles(belief: Belief, load: float) -> dict[str, list[float]]:
    """Return quantiles of both boundary speeds [m/s] at a load [N], by name: 2.5, 50 and 97.5 %; 0 for none.

    The names are ``hopf_speed`` and ``fold_speed``.
    """
    functions = {'hopf_speed': belief.hopf_speed, 'fold_speed': belief.fold_speed}
    return {
        name: [float(speed_over_load(belief.bearing, partial(of, p=p), load)) for p in (0.025, 0.5, 0.975)]
        for name, of in functions.items()
    }
