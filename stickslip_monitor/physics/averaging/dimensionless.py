# SPDX-License-Identifier: Apache-2.0
"""KBM averages of the exponential Stribeck law in closed form, in dimensionless groups.

With ``Delta = mu_s - mu_k`` and the damping left after the viscous rise ``c + N nu``:
``v = beta V``, ``alpha = beta a``, ``kappa = (c + N nu) / (N Delta beta)``, ``r = mu_k / Delta``.
Below the sliding limit the average is a modified Bessel function, so the Hopf and fold speeds and
the unstable amplitude each follow from one function of one variable,

    ``growth(alpha) = ln(2 I1(alpha) / alpha)``,

inverted here by one step of Newton's method from a table so close to the root that it ends at
the last digit. So an element's value never depends on what else is in the array. A single number
goes the same way in Python, where only logarithm, exponential and Bessel functions are numpy's and
scipy's: those give one number the bits that it has in an array.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics.averaging.quadrature import unit_gauss
from stickslip_monitor.physics.bessel import i0e, i1e
from stickslip_monitor.physics.roots import newton_on_bracket

_SERIES_LIMIT = 0.5
_FAR = 1e6
_TABLE_SIZE = 2**14
_NODES, _WEIGHTS = (np.array(column) for column in zip(*unit_gauss(14), strict=True))
_START_LOGS = np.linspace(math.log(1e-4), math.log(1e8), 321)
# Close to zero damping the amplitude changes fastest.
_START_SHARES = np.linspace(0.0, 1.0, 41) ** 2
_FIRST_LOG = float(_START_LOGS[0])
_PER_LOG = float(1.0 / (_START_LOGS[1] - _START_LOGS[0]))
# The four neighbours that a point between two of the grid is interpolated from, by the first.
_ROW_CELL, _COLUMN_CELL = (
    np.clip(np.arange(grid.size) - 1, 0, grid.size - 4) for grid in (_START_SHARES, _START_LOGS)
)
# Squares of the nodes, and what is left of them, for the balance in terms of sin(theta).
_FEW_NODES, _FEW_WEIGHTS = (np.array(column) for column in zip(*unit_gauss(10), strict=True))
_SQUARES, _REST = _FEW_NODES**2, (1.0 - _FEW_NODES) * (1.0 + _FEW_NODES)


def _bessel_excess(alpha: Any) -> Any:
    """``2 I1(alpha)/alpha - 1`` from its power series, for ``alpha <= 0.5``."""
    quarter = 0.25 * alpha * alpha
    total = 0.0
    for k in range(8, 0, -1):
        total = (total + 1.0) * quarter / (k * (k + 1.0))
    return total


def _joined(alpha: Any, series: Callable[[Any], Any], bessel: Callable[[Any], Any]) -> Any:
    """The series for small arguments, Bessel functions for the others; of numbers or arrays."""
    if isinstance(alpha, float):
        return series(alpha) if alpha <= _SERIES_LIMIT else bessel(alpha)
    result = bessel(np.maximum(alpha, _SERIES_LIMIT))
    small = alpha <= _SERIES_LIMIT
    if small.any():
        result[small] = series(alpha[small])
    return result


def growth(alpha: Any) -> Any:
    """``ln(2 I1(alpha)/alpha)`` for ``alpha`` >= 0, to full relative precision."""
    return _joined(
        alpha,
        lambda small: np.log1p(_bessel_excess(small)),
        lambda large: np.log(2.0 * i1e(large) / large) + large,
    )


def decline(v: Any) -> Any:
    """``-ln(2 exp(-v) I1(v)/v) = v - growth(v)``: rises from 0 with ``v``."""
    return _joined(
        v,
        lambda small: small - np.log1p(_bessel_excess(small)),
        lambda large: np.log(0.5 * large / i1e(large)),
    )


def _growth_slope(alpha: Any) -> Any:
    """``d growth / d alpha = I2(alpha)/I1(alpha)``, as precise as Newton's method needs it."""
    return _joined(
        alpha,
        lambda small: small / 4.0 * (1.0 - small * small / 24.0),
        lambda large: i0e(large) / i1e(large) - 2.0 / large,
    )


def _decline_slope(v: FloatArray) -> FloatArray:
    # I2/I1 tends to 1 - 1.5/v; past _FAR the difference from 1 has no digits left.
    return np.where(v < _FAR, 1.0 - _growth_slope(np.minimum(v, _FAR)), 1.5 / np.maximum(v, 1.0))


class _Inverse(NamedTuple):
    """A table of the inverse of a rising function, evenly spaced in the logarithm of its value.

    Attributes:
        low: The least value of the table.
        high: The highest.
        begin: Logarithm of the least value.
        per_log: Rows to a unit of the logarithm.
        rows: ``ln x``, ``d ln x / d ln value`` and what is added to either up to the next row,
            shape (_TABLE_SIZE, 4).
    """

    low: float
    high: float
    begin: float
    per_log: float
    rows: FloatArray

    def look_up(self, value: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``x``, off by 1e-7 at most, and ``d ln x / d value`` at some values of the table."""
        place = (np.log(value) - self.begin) * self.per_log
        i = np.fmin(np.fmax(place, 0.0), _TABLE_SIZE - 2.0).astype(np.intp)
        log_x, more, slope, steeper = self.rows[i].T
        share = place - i
        return np.exp(log_x + share * more), (slope + share * steeper) / value

    def look_up_number(self, value: float) -> tuple[float, float]:
        """:meth:`look_up` of one number."""
        place = (float(np.log(value)) - self.begin) * self.per_log
        i = int(min(max(place, 0.0), _TABLE_SIZE - 2.0))
        log_x, more, slope, steeper = self.rows[i].tolist()
        share = place - i
        return float(np.exp(log_x + share * more)), (slope + share * steeper) / value


@cache
def _inverse(
    function: Callable[[FloatArray], FloatArray], slope: Callable[[FloatArray], FloatArray]
) -> _Inverse:
    x = np.geomspace(1e-3, 1e5, _TABLE_SIZE)
    values = function(x)
    d = np.exp(np.linspace(math.log(values[0]), math.log(values[-1]), _TABLE_SIZE))
    x = np.exp(np.interp(np.log(d), np.log(values), np.log(x)))
    for _ in range(3):
        x = x * np.exp((d - function(x)) / (x * slope(x)))
    rows = np.stack([np.log(x), d / (x * slope(x))], axis=1)
    more = np.diff(rows, axis=0, append=rows[-1:])
    rows = np.stack([rows[:, 0], more[:, 0], rows[:, 1], more[:, 1]], axis=1)
    low, high = float(d[0]), float(d[-1])
    begin = math.log(low)
    return _Inverse(low, high, begin, (_TABLE_SIZE - 1.0) / (math.log(high) - begin), rows)


def amplitude_for_growth(d: FloatArray) -> FloatArray:
    """The ``alpha`` > 0 at which ``growth(alpha) = d``, for finite ``d`` > 0."""
    table = _inverse(growth, _growth_slope)
    alpha, per_value = table.look_up(d)
    outside = (d < table.low) | (d > table.high)
    if outside.any():
        log_d = np.log(np.maximum(d, table.high))
        far = d + 1.5 * log_d + math.log(math.sqrt(math.pi / 2))
        alpha = np.where(outside, np.where(d < table.low, np.sqrt(8.0 * d), far), alpha)
        per_value = np.where(outside, 1.0 / (alpha * _growth_slope(alpha)), per_value)
    return alpha + alpha * ((d - growth(alpha)) * per_value)


def speed_for_decline(decrement: FloatArray) -> FloatArray:
    """The ``v`` > 0 at which ``decline(v) = decrement``, for finite ``decrement`` > 0."""
    table = _inverse(decline, _decline_slope)
    v, per_value = table.look_up(decrement)
    outside = (decrement < table.low) | (decrement > table.high)
    if outside.any():
        near = np.minimum(decrement, table.low)
        far = np.exp((2.0 / 3.0) * (decrement + math.log(2.0 / math.sqrt(2.0 * math.pi))))
        v = np.where(outside, np.where(decrement < 1.0, near + near * near / 8.0, far), v)
        per_value = np.where(outside, 1.0 / (v * _decline_slope(v)), per_value)
    # In ln v the curve is almost straight, from v << 1 (slope v) to v >> 1 (slope 1.5).
    return v * np.exp((decrement - decline(v)) * per_value)


def speed_for_decline_of_number(decrement: float) -> float:
    """:func:`speed_for_decline` of one number."""
    table = _inverse(decline, _decline_slope)
    if not table.low <= decrement <= table.high:
        return float(speed_for_decline(np.array([decrement]))[0])
    v, per_value = table.look_up_number(decrement)
    return v * float(np.exp((decrement - float(decline(v))) * per_value))


def _beyond_limit(
    theta: FloatArray, v: FloatArray, kappa: FloatArray, r: float
) -> tuple[FloatArray, FloatArray]:
    """Balance ``S/Delta - kappa alpha/2`` at ``alpha = v / cos(theta)`` and its slope in theta.

    ``S/Delta = exp(-v) I1(alpha)
    - (2/pi) integral_0^theta (cosh(alpha cos t - v) + r) cos t dt``; the angle removes the
    square root with which the average starts at the sliding limit.
    """
    cos_theta, sin_theta = np.cos(theta), np.sin(theta)
    half = np.sin(0.5 * theta)
    alpha = v / cos_theta
    scale = np.exp(2.0 * v * half * half / cos_theta)
    cos_t = np.cos(theta[:, None] * _NODES)
    rise = np.exp(alpha[:, None] * (cos_t - cos_theta[:, None]))
    weighted = _WEIGHTS * cos_t
    # cosh and sinh from one exponential; a row's sum does not depend on the other rows.
    loss = np.add.reduce(weighted * (rise + 1.0 / rise), axis=1)
    loss_slope = np.add.reduce(weighted * cos_t * (rise - 1.0 / rise), axis=1)
    i1 = i1e(alpha) * scale
    drag = 0.5 * kappa * alpha
    balance = i1 - drag - (2.0 * r * sin_theta + theta * loss) / np.pi
    feed = alpha * i0e(alpha) * scale - i1 - drag
    slope = (sin_theta * feed - alpha * sin_theta * theta * loss_slope / np.pi) / cos_theta - (
        2.0 / np.pi
    ) * (r + 1.0) * cos_theta
    return balance, slope


def harmonic_beyond_limit(v: FloatArray, theta: FloatArray, r: float) -> FloatArray:
    """``S/Delta`` at ``alpha = v / cos(theta)``, shape of ``v``; for ``alpha`` up to ``v + 2``.

    Past that the two terms cancel and quadrature on each side of the reversal does better.
    """
    return _beyond_limit(theta, v, np.zeros_like(v), r)[0]


def _balance(sine: Any, v: Any, kappa: Any, r: float) -> tuple[Any, Any]:
    """:func:`_beyond_limit` of moderate angles, and its slope, in terms of ``sin(theta)``.

    With ``sin t = x sin(theta)`` as the variable of integration nothing is left but square roots
    and exponentials. At the stable cycle ``theta`` is below 0.5.
    """
    square = sine * sine
    cosine = np.sqrt(1.0 - square)
    alpha = v / cosine
    scale = np.exp(alpha * square / (1.0 + cosine))
    wide = square[..., None]
    cos_t = np.sqrt(1.0 - _SQUARES * wide)
    # alpha (cos t - cos theta) without its cancellation.
    rise = np.exp((alpha * square)[..., None] * _REST / (cos_t + cosine[..., None]))
    fall = 1.0 / rise
    loss = np.add.reduce((rise + fall) * _FEW_WEIGHTS, axis=-1)
    loss_slope = np.add.reduce((rise - fall) * (cos_t * _FEW_WEIGHTS), axis=-1)
    i1 = i1e(alpha) * scale
    half = 0.5 * kappa
    balance = i1 - half * alpha - (sine * (2.0 * r + loss)) * (1.0 / np.pi)
    stretch = alpha * sine / (cosine * cosine)
    feed = i0e(alpha) * scale - i1 / alpha - half - sine * loss_slope * (1.0 / np.pi)
    return balance, stretch * feed - (2.0 / np.pi) * (r + 1.0)


def _balance_of_number(sine: float, v: float, kappa: float, r: float) -> tuple[float, float]:
    """:func:`_balance` of one point: the same operations, of numbers but for the nodes."""
    square = sine * sine
    cosine = math.sqrt(1.0 - square)
    alpha = v / cosine
    scale = float(np.exp(alpha * square / (1.0 + cosine)))
    cos_t = np.sqrt(1.0 - _SQUARES * square)
    rise = np.exp(alpha * square * _REST / (cos_t + cosine))
    fall = 1.0 / rise
    loss = float(np.add.reduce((rise + fall) * _FEW_WEIGHTS))
    loss_slope = float(np.add.reduce((rise - fall) * (cos_t * _FEW_WEIGHTS)))
    i1 = float(i1e(alpha)) * scale
    half = 0.5 * kappa
    balance = i1 - half * alpha - (sine * (2.0 * r + loss)) * (1.0 / math.pi)
    stretch = alpha * sine / (cosine * cosine)
    feed = float(i0e(alpha)) * scale - i1 / alpha - half - sine * loss_slope * (1.0 / math.pi)
    return balance, stretch * feed - (2.0 / math.pi) * (r + 1.0)


def _tangent(limit: Any, share: Any, r: float) -> Any:
    """``sin(theta)`` of the stable cycle to first order about the sliding limit."""
    return (0.5 * np.pi / (1.0 + r)) * (limit * (1.0 - share))


def _cubic_cells(values: FloatArray) -> FloatArray:
    """Cubics through four neighbours along the first axis: powers, highest first.

    Args:
        values: Shape (n, ...).

    Returns:
        Coefficients in the distance from the first of the four, shape (n - 3, 4, ...).
    """
    powers = np.linalg.inv(np.vander(np.arange(4.0)))
    four = np.stack([values[k : values.shape[0] - 3 + k] for k in range(4)], axis=1)
    return np.einsum('pk,nk...->np...', powers, four)


@lru_cache(maxsize=64)
def _start_table(r: float) -> FloatArray:
    """``sin(theta)`` of the stable cycle over its first-order estimate, as bicubics.

    On a grid of ``ln v`` and the root of ``kappa``, this relative to its value at the fold, so
    the ratio goes to 1 on that side.

    Returns:
        Coefficients, shape (cells of the root, cells of ln v, powers of either).
    """
    v, share = (grid.ravel() for grid in np.meshgrid(np.exp(_START_LOGS), _START_SHARES[:-1]))
    limit = i1e(v)
    start = _tangent(limit, share, r)
    upper = np.sqrt(1.0 - (v / (v + 2.0)) ** 2)
    sine = newton_on_bracket(
        lambda x, vv, kk: _balance(x, vv, kk, r),
        np.zeros_like(v),
        upper,
        np.minimum(start, upper),
        (v, share * 2.0 * limit / v),
    ).value
    ratio = (sine / start).reshape(_START_SHARES.size - 1, _START_LOGS.size)
    ratio = np.vstack([ratio, np.ones(_START_LOGS.size)])
    cells = _cubic_cells(np.moveaxis(_cubic_cells(ratio), 2, 0))
    return np.ascontiguousarray(np.transpose(cells, (2, 0, 3, 1)))


def stable_amplitude(v: FloatArray, kappa: FloatArray, r: float) -> FloatArray:
    """The ``alpha`` >= v of the stable stick-slip cycle, for points below the fold.

    There is exactly one: the balance is positive at the sliding limit, falls with infinite slope
    in ``alpha`` there and is negative at ``alpha = v + 2`` for every ``kappa, r >= 0``. Newton's
    method starts from a table so close to the root that one step suffices.

    Args:
        v: ``beta V`` > 0, shape (n,).
        kappa: Damping number >= 0 with ``2 I1e(v)/v >= kappa``, shape of ``v``.
        r: ``mu_k/Delta`` >= 0.

    Returns:
        ``alpha`` >= v, shape of ``v``; exactly ``v`` where rounding leaves no room above it.
    """
    sine = _start(v, kappa, r)
    balance, slope = _balance(sine, v, kappa, r)
    sine = np.maximum(sine - balance / slope, 0.0)
    result: FloatArray = v / np.sqrt(1.0 - sine * sine)
    return result


def stable_amplitude_of_number(v: float, kappa: float, r: float) -> float:
    """:func:`stable_amplitude` of one point."""
    sine = _start_of_number(v, kappa, r)
    balance, slope = _balance_of_number(sine, v, kappa, r)
    sine = max(sine - balance / slope, 0.0)
    return v / math.sqrt(1.0 - sine * sine)


def _start(v: FloatArray, kappa: FloatArray, r: float) -> FloatArray:
    limit = i1e(v)
    share = np.minimum(0.5 * kappa * v / limit, 1.0)
    column = (np.log(v) - _START_LOGS[0]) * _PER_LOG
    column = np.minimum(np.maximum(column, 0.0), _START_LOGS.size - 1.0)
    row = np.sqrt(share) * (_START_SHARES.size - 1.0)
    i, j = _ROW_CELL[row.astype(np.intp)], _COLUMN_CELL[column.astype(np.intp)]
    # Powers of ln v first, then those of kappa, then the points.
    a, b, c, d = _start_table(r)[i, j].T
    x = column - j
    a, b, c, d = ((a * x + b) * x + c) * x + d
    x = row - i
    return _tangent(limit, share, r) * (((a * x + b) * x + c) * x + d)


def _start_of_number(v: float, kappa: float, r: float) -> float:
    """:func:`_start` of one point."""
    limit = float(i1e(v))
    share = min(0.5 * kappa * v / limit, 1.0)
    column = (float(np.log(v)) - _FIRST_LOG) * _PER_LOG
    column = min(max(column, 0.0), _START_LOGS.size - 1.0)
    row = math.sqrt(share) * (_START_SHARES.size - 1.0)
    i, j = int(_ROW_CELL[int(row)]), int(_COLUMN_CELL[int(column)])
    x = column - j
    cubics: list[list[float]] = _start_table(r)[i, j].tolist()
    a, b, c, d = (((p * x + q) * x + s) * x + t for p, q, s, t in cubics)
    x = row - i
    return _tangent(limit, share, r) * (((a * x + b) * x + c) * x + d)
