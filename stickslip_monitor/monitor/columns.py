# SPDX-License-Identifier: Apache-2.0
"""The columns of an assessment that are worked out when they are asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.outcome import OUTCOMES, Outcome
from stickslip_monitor.physics import bifurcation
from stickslip_monitor.physics.arrays import in_blocks
from stickslip_monitor.physics.cycle_surface import exact_amplitude
from stickslip_monitor.physics.oscillator import Bearing

FloatArray = NDArray[np.float64]

NO_CYCLE, BISTABLE, STICK_SLIP, NO_BOUNDARY, NO_CONTACT, AT_REST, NOT_FINITE = (
    np.int8(OUTCOMES.index(outcome))
    for outcome in (
        Outcome.NO_CYCLE,
        Outcome.BISTABLE,
        Outcome.STICK_SLIP,
        Outcome.NO_BOUNDARY,
        Outcome.NO_CONTACT,
        Outcome.AT_REST,
        Outcome.NOT_FINITE,
    )
)


class Points(NamedTuple):
    """What an assessment stores, each of shape (n,)."""

    speed: FloatArray
    load: FloatArray
    code: NDArray[np.int8]
    hopf: FloatArray
    fold: FloatArray


def column(name: str, bearing: Bearing, points: Points) -> FloatArray:
    """A column of :data:`ON_DEMAND` of some operating points, shape (n,)."""
    if name == 'amplitude_exact':
        return exact_amplitude(bearing, points.speed, points.load, points.fold)

    def part(*columns: NDArray[Any]) -> tuple[FloatArray]:
        return (_AVERAGED[name](bearing, Points(*columns)),)

    with np.errstate(all='ignore'):
        (result,) = in_blocks(part, *points)
    return result


def margin(speed: FloatArray, boundary: FloatArray) -> FloatArray:
    """``V/V_b - 1``, with the sign of ``V - V_b`` to the last bit.

    Args:
        speed: ``V`` >= 0, shape (n,) [m/s].
        boundary: Hopf or fold speed, shape (n,) [m/s]; ``nan`` without one, ``inf`` where there is
            no end to it.
    """
    value = (speed - boundary) / boundary
    unbounded = value != value
    if unbounded.any():
        value = np.where(unbounded, np.where(boundary == np.inf, -1.0, np.inf), value)
    return value


def margin_of_number(speed: float, boundary: float, code: int) -> float:
    """The margin of an operating point: the same operations in Python."""
    if 0.0 < boundary < math.inf:
        return (abs(speed) - boundary) / boundary
    if code == NOT_FINITE:
        return math.nan
    return -1.0 if boundary == math.inf else math.inf


def _margin(points: Points, boundary: FloatArray) -> FloatArray:
    return np.where(points.code == NOT_FINITE, np.nan, margin(np.abs(points.speed), boundary))


def _hopf_load(bearing: Bearing, points: Points) -> FloatArray:
    load: FloatArray = bifurcation.hopf_load(bearing, points.speed)
    return load + (points.load - points.load)


def _fold_load(bearing: Bearing, points: Points) -> FloatArray:
    load: FloatArray = bifurcation.fold_load(bearing, points.speed)
    return load + (points.load - points.load)


def _growth_rate(bearing: Bearing, points: Points) -> FloatArray:
    rate: FloatArray = bifurcation.growth_rate(bearing, points.speed, points.load)
    return rate


def _amplitude(bearing: Bearing, points: Points) -> FloatArray:
    inside = (points.code == BISTABLE) | (points.code == STICK_SLIP)
    return _only(inside, bifurcation.stable_amplitude, bearing, points)


def _threshold(bearing: Bearing, points: Points) -> FloatArray:
    return _only(points.code == BISTABLE, bifurcation.threshold_amplitude, bearing, points)


def _only(
    where: NDArray[np.bool_],
    function: Callable[[Bearing, FloatArray, FloatArray], FloatArray],
    bearing: Bearing,
    points: Points,
) -> FloatArray:
    """A function of speed and load at some points, ``nan`` elsewhere."""
    rows = np.flatnonzero(where)
    if 0 < rows.size == where.size:
        return function(bearing, np.abs(points.speed), points.load)
    result = np.full(where.shape, np.nan)
    if rows.size:
        result[rows] = function(bearing, np.abs(points.speed[rows]), points.load[rows])
    return result


_AVERAGED: dict[str, Callable[[Bearing, Points], FloatArray]] = {
    'hopf_margin': lambda _, points: _margin(points, points.hopf),
    'fold_margin': lambda _, points: _margin(points, points.fold),
    'hopf_load': _hopf_load,
    'fold_load': _fold_load,
    'growth_rate': _growth_rate,
    'amplitude': _amplitude,
    'threshold_amplitude': _threshold,
}
AVERAGED = tuple(_AVERAGED)
"""Those that averaging gives, in order."""
