# SPDX-License-Identifier: Apache-2.0
"""The robust fit of a model: Tukey's biweight, iterated to convergence from robust starts.

Beaton and Tukey, Technometrics 16, 1974, with the scale from the median absolute residual.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.study.curve_file import FrictionCurve
from stickslip_monitor.study.fit_solution import TUKEY, Model, Solution, scale_floor
from stickslip_monitor.study.fit_start import least_absolute, least_median

Array = NDArray[np.float64]

_MAD = 1.482602218505602
_STEPS = 400
_SMALL_SAMPLE = 2.0
_NORMAL_SHARE = 0.8281
_TOLERANCE = 1e-11


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


def _biweight(curve: FrictionCurve, model: Model, rate: float, residual: Array) -> Solution:
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
    curve: FrictionCurve, values: Array, free: NDArray[np.bool_], scale: float | None
) -> tuple[Array, Array]:
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
    curve: FrictionCurve, values: Array, root: Array, free: NDArray[np.bool_]
) -> Array:
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


def curve_of(curve: FrictionCurve, values: Array) -> Array:
    """The law at the points, by drop, kinetic, ln decay and viscous, shape (n,) [-]."""
    drop, kinetic, log_decay, viscous = values
    decayed = np.exp(-np.exp(log_decay) * (curve.speed - curve.speed.min()))
    return kinetic + drop * decayed + viscous * curve.speed


def _tukey(residual: Array, scale: float) -> Array:
    return np.maximum(1.0 - (residual / (scale * TUKEY)) ** 2, 0.0) ** 2


def _scale(curve: FrictionCurve, residual: Array, parameters: int) -> float:
    """Standard deviation from the median absolute residual.

    k residuals are small by construction, so the smallest k - 1 are left out (Street, Carroll and
    Ruppert 1988). The median of few residuals scatters: the last factor, 1 for many, keeps it
    from setting good points aside.
    """
    ordered = np.sort(np.abs(residual))[parameters - 1 :]
    caution = _caution(residual.size, parameters)
    return max(_MAD * caution * float(np.median(ordered)), scale_floor(curve))


def _sharper_scale(curve: FrictionCurve, residual: Array, parameters: int) -> float:
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
