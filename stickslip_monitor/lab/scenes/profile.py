# SPDX-License-Identifier: Apache-2.0
"""Quantities given over time: by points, by steps, or by a table in a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.files import read_file
from stickslip_monitor.lab.scenes.settings import Settings, is_number, too_large

# A table of a million rows [bytes].
_LARGEST_TABLE = 32 << 20
PROFILE_KEYS = ('bearing', 'unit', 'points', 'table')


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
        rows = read_table(folder / settings.text('table', 'the path of a CSV file'))
        return Profile.of(check_points(rows, duration), unit)
    return Profile.of(read_rows(settings, 'points', 'point', unit, duration), unit)


def read_rows(
    settings: Settings, key: str, name: str, unit: str, duration: float
) -> list[tuple[float, float]]:
    """Read a list of points (time, value).

    Args:
        settings: The effect's settings.
        key: The list's key.
        name: What one of them is called.
        unit: The unit of their values.
        duration: The scene's duration [s].

    Raises:
        SceneError: It is no list, or :func:`check_points` refuses.
    """
    what = f'a list of {key} [time in s, value in {unit}]'
    listed = settings.value(key, what)
    if not isinstance(listed, list) or not listed:
        raise settings.broken(key, f'must be {what}')
    label = settings.label(key)
    return check_points(
        [(f'{label}: {name} {k}', row) for k, row in enumerate(listed, 1)], duration
    )


def check_points(rows: Sequence[tuple[str, Any]], duration: float) -> list[tuple[float, float]]:
    """Points (time, value) that rise in time and lie within the scene.

    Args:
        rows: What each is called in sentences, and what it is.
        duration: The scene's duration [s].

    Raises:
        SceneError: A point is no pair of numbers, or its time breaks a rule.
    """
    for name, point in rows:
        if not isinstance(point, list) or len(point) != 2 or not all(map(is_number, point)):
            size = too_large(*point) if isinstance(point, list) else ''
            raise SceneError(
                f'{name} = {point!r} must be a pair of numbers, [time in s, value]{size}'
            )
    check_times([(name, time) for name, (time, _) in rows], duration)
    return [(float(time), float(value)) for _, (time, value) in rows]


def check_times(rows: Sequence[tuple[str, Any]], duration: float) -> None:
    """Check that times rise and lie within the scene.

    Args:
        rows: What each is called in sentences, and the time [s].
        duration: The scene's duration [s].

    Raises:
        SceneError: They do not.
    """
    for name, time in rows:
        if not is_number(time) or not 0.0 <= time <= duration:
            raise SceneError(
                f'{name} is at {time:g} s, outside the scene, which lasts from 0 to {duration:g} s'
                if is_number(time)
                else f'{name} is at {time!r}, which is no time in s'
            )
    for (_, before), (name, after) in pairwise(rows):
        if after <= before:
            raise SceneError(
                f'{name} is at {after:g} s, but times must rise and the one before is at'
                f' {before:g} s'
            )


STEP_KEYS = ('bearing', 'unit', 'steps', 'rise')


def read_steps(settings: Settings, units: Sequence[str], duration: float) -> Profile:
    """Read ``unit``, ``steps`` and ``rise`` of an effect.

    Each step [time in s, level] begins at its time and takes ``rise`` [s]: neither a shaft nor
    the load on a bearing jumps. The first level holds from the scene's start.

    Args:
        settings: The effect's settings.
        units: The units allowed.
        duration: The scene's duration [s].

    Raises:
        SceneError: A step is no pair of numbers, its time breaks a rule, or it begins before the
            one before it has ended.
    """
    unit = settings.choice('unit', units)
    rise = settings.number('rise', 's', above=0.0)
    steps = read_rows(settings, 'steps', 'step', unit, duration)
    points, label = [steps[0]], settings.label('steps')
    for number, ((_, before), (time, level)) in enumerate(pairwise(steps), 2):
        if time < points[-1][0]:
            raise SceneError(
                f'{label}: step {number} is at {time:g} s, but the one before takes'
                f' until {points[-1][0]:g} s'
            )
        points += [(time, before)] if time > points[-1][0] else []
        points.append((time + rise, level))
    return Profile.of(points, unit)


HEADER = ['time', 'value']


def read_table(path: Path) -> list[tuple[str, list[float]]]:
    """Read a table.

    Args:
        path: The file. Its first line is ``time,value``; empty lines and lines that begin with
            ``#`` are skipped.

    Returns:
        For each row what it is called in sentences, and time [s] and value.

    Raises:
        SceneError: The file cannot be read, has no rows, or a line is not two numbers.
    """
    try:
        lines = read_file(path, _LARGEST_TABLE).decode('utf-8-sig').splitlines()
    except OSError as error:
        raise SceneError(f"table '{path}' cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SceneError(f"table '{path}' cannot be read: it is not UTF-8 text") from error
    cells = [
        (number, [cell.strip() for cell in next(csv.reader([line]))])
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith('#')
    ]
    if not cells or cells[0][1] != HEADER:
        raise SceneError(f"table '{path}' must begin with a line 'time,value'")
    if len(cells) == 1:
        raise SceneError(f"table '{path}' has no rows")
    return [
        (f"table '{path}' line {number}", _numbers(path, number, row)) for number, row in cells[1:]
    ]


def _numbers(path: Path, number: int, row: list[str]) -> list[float]:
    try:
        time, value = map(float, row)
    except ValueError:
        text = ','.join(row)
        raise SceneError(
            f"table '{path}' line {number} = '{text}' must be two numbers: time in s, value"
        ) from None
    return [time, value]
