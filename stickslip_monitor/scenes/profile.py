# SPDX-License-Identifier: Apache-2.0
"""A quantity that follows a table in time, piecewise linearly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_monitor.errors import SceneError

from .settings import Settings, is_number
from .signals import FloatArray


@dataclass(frozen=True, slots=True)
class Profile:
    """A piecewise linear table; before its first and after its last point the value is held.

    Attributes:
        times: Rising times since the scene's start [s].
        values: The value at each, in ``unit``.
        unit: Their unit.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    unit: str

    def at(self, time: FloatArray) -> FloatArray:
        """Values at some times [s], of their shape."""
        return np.interp(time, self.times, self.values)


def read_profile(settings: Settings, units: Sequence[str], duration: float) -> Profile:
    """Read ``points`` and ``unit`` of an effect.

    Args:
        settings: The effect's settings.
        units: The units allowed.
        duration: The scene's duration [s].

    Raises:
        SceneError: A point is no pair of numbers, times do not rise, or lie outside the scene.
    """
    unit = settings.choice('unit', units)
    what = f'a list of points [time in s, value in {unit}]'
    points = settings.value('points', what)
    if not isinstance(points, list) or not points:
        raise settings.broken('points', f'must be {what}')
    label = settings.label('points')
    for number, point in enumerate(points, 1):
        _check_point(f'{label}: point {number}', point, duration)
    times = tuple(float(point[0]) for point in points)
    for number, (before, after) in enumerate(pairwise(times), 2):
        if after <= before:
            raise SceneError(
                f'{label}: point {number} is at {after:g} s, but times must rise and the point'
                f' before it is at {before:g} s'
            )
    return Profile(times, tuple(float(point[1]) for point in points), unit)


def _check_point(name: str, point: Any, duration: float) -> None:
    if not isinstance(point, list) or len(point) != 2 or not all(map(is_number, point)):
        raise SceneError(f'{name} = {point!r} must be a pair of numbers, [time in s, value]')
    if not 0.0 <= point[0] <= duration:
        raise SceneError(
            f'{name} is at {point[0]:g} s, outside the scene, which lasts from 0 to {duration:g} s'
        )
