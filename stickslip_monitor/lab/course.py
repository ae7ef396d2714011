# SPDX-License-Identifier: Apache-2.0
"""What a scene gives over time: profiles, steps, tables, windows in which effects act, and friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.files import read_table
from stickslip_monitor.lab.settings import Settings, is_number, too_large
from stickslip_monitor.physics.friction import FrictionLaw, Tabulated

# A table of a million rows [bytes].
_LARGEST_TABLE = 32 << 20
HEADER = ['time', 'value']


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A piecewise linear table; before its first and after its last point the value is held."""

    times: FloatArray  # rising times since the scene's start, none before it, shape (n,) [s]
    values: FloatArray  # the value at each, shape (n,)
    ways: FloatArray  # the integral from the scene's start to each, shape (n,)

    @classmethod
    def of(cls, points: Sequence[tuple[float, float]]) -> Profile:
        """The profile through some points (time, value)."""
        times, values = np.array(points, float).T.copy()
        pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(times)
        return cls(times, values, np.cumsum([times[0] * values[0], *pieces]))

    def at(self, time: FloatArray) -> FloatArray:
        """Values at some times [s], of their shape."""
        return np.interp(time, self.times, self.values)

    def integral(self, time: FloatArray) -> FloatArray:
        """Integral from the scene's start to some times [s], of their shape."""
        inside = np.clip(time, self.times[0], self.times[-1])
        piece = np.searchsorted(self.times, inside, side='right') - 1
        value = np.interp(inside, self.times, self.values)
        way = self.ways[piece] + 0.5 * (self.values[piece] + value) * (inside - self.times[piece])
        return way + value * (time - inside)


def read_profile(settings: Settings, unit: str, duration: float, folder: Path) -> Profile:
    """The ``points`` or, in its place, the ``table`` of an effect, with numbers in a unit.

    The table's path counts from the folder of the scene file.
    """
    if 'table' in settings and 'points' in settings:
        raise SceneError(f'{settings.name} has points and a table: give one of them')
    if 'table' in settings:
        rows: Sequence[tuple[str, Any]] = _read_table(
            folder / settings.text('table', 'the path of a CSV file')
        )
    else:
        what = f'a list of points [time in s, value in {unit}]'
        rows = settings.rows('points', 'point', what)
    return Profile.of(check_points(rows, duration))


def read_steps(settings: Settings, unit: str, duration: float) -> Profile:
    """The ``steps`` and ``rise`` of an effect, with levels in a unit.

    Each step [time in s, level] begins at its time and takes ``rise`` [s]: neither a shaft nor
    the load on a bearing jumps. The first level holds from the scene's start.
    """
    rise = settings.number('rise', 's', above=0.0)
    rows = settings.rows('steps', 'step', f'a list of steps [time in s, value in {unit}]')
    steps = check_points(rows, duration)
    points = [steps[0]]
    for (name, _), (_, before), (time, level) in zip(rows[1:], steps, steps[1:], strict=False):
        if time < points[-1][0]:
            until = f'but the one before takes until {points[-1][0]:g} s'
            raise SceneError(f'{name} is at {time:g} s, {until}')
        points += [(time, before)] if time > points[-1][0] else []
        points.append((time + rise, level))
    return Profile.of(points)


def check_points(rows: Sequence[tuple[str, Any]], duration: float) -> list[tuple[float, float]]:
    """Points (time, value) that must rise in time and lie within the scene.

    Each row is what a point is called in sentences, and what it is.
    """
    for name, point in rows:
        _check_pair(name, point, '[time in s, value]')
    check_times([(name, time) for name, (time, _) in rows], duration)
    return [(float(time), float(value)) for _, (time, value) in rows]


def _check_pair(name: str, pair: Any, what: str) -> None:
    if not isinstance(pair, list) or len(pair) != 2 or not all(map(is_number, pair)):
        size = too_large(*pair) if isinstance(pair, list) else ''
        raise SceneError(f'{name} = {pair!r} must be a pair of numbers, {what}{size}')


def check_times(rows: Sequence[tuple[str, Any]], duration: float) -> None:
    """Refuse times [s] that do not rise or lie outside the scene."""
    for name, time in rows:
        if not is_number(time):
            raise SceneError(f'{name} is at {time!r}, which is no time in s')
        if not 0.0 <= time <= duration:
            outside = f'outside the scene, which lasts from 0 to {duration:g} s'
            raise SceneError(f'{name} is at {time:g} s, {outside}')
    for (_, before), (name, after) in pairwise(rows):
        if after <= before:
            rise = f'but times must rise and the one before is at {before:g} s'
            raise SceneError(f'{name} is at {after:g} s, {rise}')


def _read_table(path: Path) -> list[tuple[str, list[float]]]:
    """For each row of a table what it is called in sentences, and time [s] and value.

    Its headings are ``time`` and ``value``.
    """
    rows, _ = read_table(path, _LARGEST_TABLE, SceneError)
    if not rows or rows[0].cells != HEADER:
        raise SceneError(f"table '{path}' must begin with a line 'time,value'")
    if len(rows) == 1:
        raise SceneError(f"table '{path}' has no rows")
    named = [(f"table '{path}' line {row.line}", row.cells) for row in rows[1:]]
    return [(name, _numbers(name, cells)) for name, cells in named]


def _numbers(name: str, row: list[str]) -> list[float]:
    try:
        time, value = map(float, row)
    except ValueError:
        raise SceneError(f"{name} = '{','.join(row)}' must be two numbers: time in s, value") from None
    return [time, value]


Hit = Callable[[FloatArray], BoolArray]
"""Whether the next samples, at some times [s], are hit."""


def read_windows(settings: Settings, duration: float) -> Hit:
    """The ``windows``: pairs [start, end) in s, in order of time."""
    rows = settings.rows('windows', 'window', 'a list of windows [start in s, end in s]')
    for name, window in rows:
        _check_pair(name, window, '[start in s, end in s]')
        if not 0.0 <= window[0] < window[1] <= duration:
            raise SceneError(
                f'{name} = {window} must start before it ends, within the scene, which lasts from'
                f' 0 to {duration:g} s'
            )
    for number, ((_, before), (name, after)) in enumerate(pairwise(rows), 1):
        if after[0] < before[1]:
            raise SceneError(
                f'{name} = {after} overlaps or precedes window {number} = {before}; windows must'
                ' follow one another'
            )
    starts, ends = np.array([window for _, window in rows], float).T.copy()

    def hold(time: FloatArray) -> BoolArray:
        window = np.searchsorted(starts, time, side='right') - 1
        held: BoolArray = (window >= 0) & (time < ends[window])
        return held

    return hold


def read_sample_mask(settings: Settings, duration: float, random: np.random.Generator) -> Hit:
    """The ``windows`` and the ``share`` of samples, of which at least one is there.

    The random stream is drawn from only where there is a share.
    """
    if 'windows' not in settings and 'share' not in settings:
        raise SceneError(f'{settings.name} must have windows, a share of the samples, or both')
    windows = read_windows(settings, duration) if 'windows' in settings else None
    if 'share' not in settings:
        assert windows is not None  # one of both is there
        return windows
    share = settings.number('share', '-', above=0.0, most=1.0)

    def hit(time: FloatArray) -> BoolArray:
        # One draw for each sample, in a window or not: windows do not change the draws.
        hit: BoolArray = random.random(time.size) < share
        return hit if windows is None else hit & windows(time)

    return hit


FACTOR = 'factor'
# Of the parameters of all laws, those that a common factor multiplies.
_COEFFICIENTS = ('static', 'kinetic', 'viscous')
STEP = 1.0


def parameters_of(law: FrictionLaw) -> tuple[str, ...]:
    """What may move: the law's own numbers, and a factor on the whole coefficient."""
    # The protocol does not say that a law is a dataclass; those a configuration can name are.
    own = () if isinstance(law, Tabulated) else tuple(f.name for f in fields(law))  # type: ignore[arg-type]
    return (*own, FACTOR)


def with_parameters(law: FrictionLaw, values: dict[str, float]) -> FrictionLaw:
    """A law with some parameters replaced, and then multiplied by the factor."""
    own = {name: value for name, value in values.items() if name != FACTOR}
    # A dataclass, as above.
    changed: Any = replace(law, **own) if own else law  # type: ignore[type-var]
    factor = values.get(FACTOR, 1.0)
    if isinstance(changed, Tabulated):
        return Tabulated(changed.speed, [factor * value for value in changed.values])
    names = [f.name for f in fields(changed) if f.name in _COEFFICIENTS]
    scaled: FrictionLaw = replace(changed, **{n: factor * getattr(changed, n) for n in names})
    return scaled


@dataclass(slots=True)
class FrictionCourse:
    """The friction law of one bearing over time.

    It moves in steps of one second, each with the values at its start, so that the integrator has
    one law at a time; the steps are too small to affect the motion.
    """

    law: FrictionLaw  # the law of the configuration
    drifts: dict[str, Profile] = field(default_factory=dict)  # by parameter, how it moves

    def at(self, time: float, *, scaled: bool = True) -> FrictionLaw:
        """The law at a time since the scene's start [s], with or without its common factor."""
        step = np.array([time // STEP * STEP])
        moved = {name: own for name, own in self.drifts.items() if scaled or name != FACTOR}
        values = {name: float(drift.at(step)[0]) for name, drift in moved.items()}
        return with_parameters(self.law, values) if values else self.law

    def factor(self, time: FloatArray) -> FloatArray:
        """The common factor at some times [s], of their shape: as much as one on the load."""
        drift = self.drifts.get(FACTOR)
        return np.ones_like(time) if drift is None else drift.at(time // STEP * STEP)
