# SPDX-License-Identifier: Apache-2.0
"""A quantity that follows a table in time, piecewise linearly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.errors import SceneError

from .settings import Settings, is_number
from .signals import FloatArray

KEYS = ('bearing', 'unit', 'points', 'table')


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A piecewise linear table; before its first and after its last point the value is held.

    Attributes:
        times: Rising times since the scene's start, none before it, shape (n,) [s].
        values: The value at each, in ``unit``, shape (n,).
        ways: The integral from the scene's start to each, shape (n,).
        unit: Their unit.
    """

    times: FloatArray
    values: FloatArray
    ways: FloatArray
    unit: str

    @classmethod
    def of(cls, points: Sequence[tuple[float, float]], unit: str) -> Profile:
        """The profile through some points (time, value)."""
        times, values = np.array(points, float).T.copy()
        pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(times)
        return cls(times, values, np.cumsum([times[0] * values[0], *pieces]), unit)

    def at(self, time: FloatArray) -> FloatArray:
        """Values at some times [s], of their shape."""
        return np.interp(time, self.times, self.values)

    def integral(self, time: FloatArray) -> FloatArray:
        """Integral from the scene's start to some times [s], of their shape."""
        inside = np.clip(time, self.times[0], self.times[-1])
        piece = np.searchsorted(self.times, inside, side='right') - 1
        value = self.at(inside)
        way = self.ways[piece] + 0.5 * (self.values[piece] + value) * (inside - self.times[piece])
        return way + value * (time - inside)


def read_profile(
    settings: Settings, units: Sequence[str], duration: float, folder: Path
) -> Profile:
    """Read ``unit`` and ``points``, or in its place ``table``, of an effect.

    Args:
        settings: The effect's settings.
        units: The units allowed.
        duration: The scene's duration [s].
        folder: The folder that the table's path counts from.

    Raises:
        SceneError: A point is no pair of numbers, times do not rise, or lie outside the scene, or
            the table cannot be read.
    """
    unit = settings.choice('unit', units)
    return read_values(settings, unit, duration, folder)


def read_values(settings: Settings, unit: str, duration: float, folder: Path) -> Profile:
    """Read ``points`` or ``table`` of an effect as numbers in a unit; see :func:`read_profile`."""
    if 'table' in settings and 'points' in settings:
        raise SceneError(f'{settings.name} has points and a table: give one of them')
    if 'table' in settings:
        # Only a scene with a table pays for reading one.
        from .table_file import read_table

        rows = read_table(folder / settings.text('table', 'the path of a CSV file'))
    else:
        rows = _points(settings, unit)
    return Profile.of(check_points(rows, duration), unit)


def _points(settings: Settings, unit: str) -> list[tuple[str, Any]]:
    what = f'a list of points [time in s, value in {unit}]'
    points = settings.value('points', what)
    if not isinstance(points, list) or not points:
        raise settings.broken('points', f'must be {what}')
    label = settings.label('points')
    return [(f'{label}: point {number}', point) for number, point in enumerate(points, 1)]


def check_points(rows: Sequence[tuple[str, Any]], duration: float) -> list[tuple[float, float]]:
    """Points (time, value) that rise in time and lie within the scene.

    Args:
        rows: What each is called in sentences, and what it is.
        duration: The scene's duration [s].

    Raises:
        SceneError: A point is no pair of numbers, or its time breaks a rule.
    """
    for name, point in rows:
        _check_point(name, point, duration)
    for (_, (before, _)), (name, (after, _)) in pairwise(rows):
        if after <= before:
            raise SceneError(
                f'{name} is at {after:g} s, but times must rise and the point before it is at'
                f' {before:g} s'
            )
    return [(float(time), float(value)) for _, (time, value) in rows]


def _check_point(name: str, point: Any, duration: float) -> None:
    if not isinstance(point, list) or len(point) != 2 or not all(map(is_number, point)):
        raise SceneError(f'{name} = {point!r} must be a pair of numbers, [time in s, value]')
    if not 0.0 <= point[0] <= duration:
        raise SceneError(
            f'{name} is at {point[0]:g} s, outside the scene, which lasts from 0 to {duration:g} s'
        )
