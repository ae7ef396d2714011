# SPDX-License-Identifier: Apache-2.0
"""Starts the fit without a start value: the rate of decay is searched over all its decades.

For a given rate the law is linear (variable projection: Golub and Pereyra, SIAM J. Numer. Anal.
10, 1973). Two criteria that outliers hardly move choose among the rates: the least sum, and the
least median, of absolute residuals.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.study.curve_file import FrictionCurve
from stickslip_monitor.study.fit_solution import FLOOR, Model

Array = NDArray[np.float64]

_PER_DECADE = 10
_SUBSETS = 60
_MEDIAN_POINTS = 200


def rates(curve: FrictionCurve) -> Array:
    """``beta`` times the range of speeds: from a straight line to a step at the lowest speed."""
    place = np.unique(_place(curve))
    top = min(math.log10(40.0 / place[1]), 12.0)
    return np.logspace(-4.0, top, math.ceil((top + 4.0) * _PER_DECADE) + 1)


def _place(curve: FrictionCurve) -> Array:
    """Speeds from 0 for the lowest to 1 for the highest."""
    return (curve.speed - curve.speed.min()) / np.ptp(curve.speed)


def columns_of(curve: FrictionCurve, model: Model, rate: Array) -> Array:
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


def least_absolute(curve: FrictionCurve, model: Model) -> tuple[float, Array]:
    """The rate with the least sum of absolute residuals, and those residuals by their std."""
    rate = rates(curve)
    for _ in range(3):
        residual = _absolute_fits(curve, columns_of(curve, model, rate))
        best = int(np.argmin(np.abs(residual).sum(axis=1)))
        chosen = float(rate[best]), residual[best]
        low, high = rate[max(best - 1, 0)], rate[min(best + 1, rate.size - 1)]
        rate = np.geomspace(low, high, 2 * _PER_DECADE + 1)
    return chosen


def _absolute_fits(curve: FrictionCurve, columns: Array) -> Array:
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
        solved = np.linalg.solve(normal + ridge * size, right[..., None])
        residual = target - np.squeeze(scaled @ solved, axis=2)
    return residual


def least_median(curve: FrictionCurve, model: Model) -> tuple[float, Array]:
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
    solved = np.linalg.solve(square + ridge, target[picks][..., None])[..., 0]
    misfit = np.abs(target - np.einsum('bnk,bsk->bsn', columns, solved)) / curve.std[few]
    middle = np.partition(misfit, (few.size + columns.shape[2]) // 2, axis=2)
    median = middle[:, :, (few.size + columns.shape[2]) // 2]
    i, j = np.unravel_index(int(np.argmin(median)), median.shape)
    fitted = columns_of(curve, model, rate[i : i + 1])[0] @ solved[i, j]
    return float(rate[i]), (curve.coefficient - fitted) / curve.std
