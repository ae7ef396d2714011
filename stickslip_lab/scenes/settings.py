# SPDX-License-Identifier: Apache-2.0
"""Reads a mapping of a scene file key by key: values, profiles over time, and numbers that vary by seed.

Whatever breaks a rule raises a SceneError, here and in all of this room, that names key, value and
rule.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_lab import MAX_TABLE_BYTES
from stickslip_logs.tables.small_table import read_table
from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.errors import ConfigurationError, SceneError, StickslipError, did_you_mean
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter, refused, shown

MAX_NUMBER = 1e15
"""Largest size of a number of a scene: far beyond every sensor and sea; products of a few are still
finite."""


class Settings:
    """The keys and values of one mapping of a scene file, by keys that are known.

    Args:
        name: Its name in error texts; '' for the scene itself.
        content: The parsed value.
        keys: The keys that it may have; none is required.

    Raises:
        SceneError: The content is not a mapping, or has another key.
    """

    def __init__(self, name: str, content: Any, keys: Iterable[str]) -> None:
        self.name = name
        if not isinstance(content, Mapping):
            raise refused(name or 'the scene', content, 'a mapping of keys', SceneError)
        self._content = content
        allowed = list(keys)
        for key, value in content.items():
            if key not in allowed:
                where = f' in {self.name}' if self.name else ''
                hint = suggestion(key, allowed)
                raise SceneError(f"unknown key '{key}' = {shown(value)}{where}; {hint}")

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def label(self, key: str) -> str:
        """Return the key's full name, with that of the mapping before it."""
        return f'{self.name}.{key}' if self.name else key

    def value(self, key: str, meaning: str) -> Any:
        """Return the value as it stands in the file; ``meaning`` says in the error what is missing.

        Raises:
            SceneError: The key is missing.
        """
        if key not in self._content:
            raise SceneError(f"key '{self.label(key)}' is missing: {meaning}")
        return self._content[key]

    def text(self, key: str, meaning: str) -> str:
        """Return a text that is not blank, unchanged; ``meaning`` says in the error what it is.

        Raises:
            SceneError: The key is missing, or its value is not such a text.
        """
        value = self.value(key, meaning)
        if not isinstance(value, str) or not value.strip():
            raise self.value_error(key, f'a text: {meaning}')
        return value

    def choice(self, key: str, options: Sequence[str]) -> str:
        """Return a text that must be one of the options.

        Raises:
            SceneError: The key is missing, or its value is not one of them.
        """
        value = self.value(key, f'one of {", ".join(options)}')
        self._check_value(key, Parameter(key, 'str', REQUIRED, '', choices=tuple(options)))
        return str(value)

    def number(
        self,
        key: str,
        unit: str,
        above: float = -math.inf,
        minimum: float = -math.inf,
        maximum: float = math.inf,
    ) -> float:
        """Return a number within bounds, of a size up to :data:`MAX_NUMBER`.

        Args:
            key: The key.
            unit: Its unit, for the error; '-' without one.
            above: Lower bound that is not allowed itself.
            minimum: Lower bound that is allowed.
            maximum: Upper bound that is allowed.

        Raises:
            SceneError: The key is missing, or its value is not such a number.
        """
        low, is_open = max(above, minimum), above > minimum
        row = Parameter(key, 'float', REQUIRED, '', unit.strip('-'), low, maximum, above_minimum=is_open)
        value = self.value(key, row.rule())
        if size_clause(value):
            row = replace(row, minimum=max(row.minimum, -MAX_NUMBER), maximum=min(maximum, MAX_NUMBER))
        return float(self._check_value(key, row))

    def whole(self, key: str, meaning: str, minimum: int, maximum: float = math.inf) -> int:
        """Return a whole number within inclusive bounds; ``meaning`` says in the error what it is.

        Raises:
            SceneError: The key is missing, or its value is not such a number.
        """
        self.value(key, meaning)
        return int(
            self._check_value(key, Parameter(key, 'int', REQUIRED, '', minimum=minimum, maximum=maximum))
        )

    def _check_value(self, key: str, row: Parameter) -> Any:
        """Return the value of a key that is there, converted as the rule ``row`` has it.

        Raises:
            SceneError: It breaks the rule; the text names key, value and rule.
        """
        try:
            return row.checked(self.label(key), {self.label(key): self._content[key]})
        except ConfigurationError as error:
            raise SceneError(str(error)) from None

    def rows(self, key: str, name: str, meaning: str) -> list[tuple[str, Any]]:
        """Return the entries of a list that is not empty, each as a name for errors and the unchecked entry.

        Args:
            key: The key.
            name: Word for an entry, before its number in the name.
            meaning: Description of the list, for the error.

        Raises:
            SceneError: The key is missing, or its value is not such a list.
        """
        listed = self.value(key, meaning)
        if not isinstance(listed, list) or not listed:
            raise self.value_error(key, meaning)
        return [(f'{self.label(key)}: {name} {k}', row) for k, row in enumerate(listed, 1)]

    def section(self, key: str, keys: Iterable[str], meaning: str) -> Settings:
        """Return the mapping under a key; ``meaning`` says in the error what is missing.

        Args:
            key: The key.
            keys: The keys that the mapping may have.
            meaning: Description of the mapping.

        Raises:
            SceneError: The key is missing, or its value is no mapping or has another key.
        """
        return Settings(self.label(key), self.value(key, meaning), keys)

    def value_error(self, key: str, rule: str) -> StickslipError:
        """Return the SceneError for the value of a key that breaks a rule; the rule follows 'must be'.

        Raises:
            KeyError: The key is missing.
        """
        return refused(self.label(key), self._content[key], rule, SceneError)


def suggestion(key: Any, candidates: Sequence[str]) -> str:
    """Return the hint on an unknown name for an error: the similar candidate, if there is one, else all."""
    return did_you_mean(key, candidates).removeprefix('; ') or f'there are: {", ".join(candidates)}'


def is_number(value: Any) -> bool:
    """Return whether a value of a YAML file is a number, not a bool, of a size up to :data:`MAX_NUMBER`."""
    return _is_numeric(value) and -MAX_NUMBER <= value <= MAX_NUMBER


def size_clause(*values: Any) -> str:
    """Return ', of a size up to ...' where the size of a number exceeds :data:`MAX_NUMBER`, else ''."""
    beyond = any(_is_numeric(value) and abs(value) > MAX_NUMBER for value in values)
    return f', of a size up to {MAX_NUMBER:g}' if beyond else ''


def _is_numeric(value: Any) -> bool:
    """Return whether a value is an int or a float and not a bool."""
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A piecewise linear table; before its first and after its last point the value is held."""

    times: FloatArray  # rising times since the scene's start, >= 0, shape (n,) [s]
    values: FloatArray  # the value at each, shape (n,)
    integrals: FloatArray  # the integral from the scene's start to each, shape (n,)

    @classmethod
    def of(cls, points: Sequence[tuple[float, float]]) -> Profile:
        """Make the profile through points (time [s], value), one or more, with rising times."""
        times, values = np.array(points, float).T.copy()
        pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(times)
        return cls(times, values, np.cumsum([times[0] * values[0], *pieces]))

    def at(self, time: FloatArray) -> FloatArray:
        """Return the values at some times [s], of their shape."""
        return np.interp(time, self.times, self.values)

    def integral(self, time: FloatArray) -> FloatArray:
        """Return the integral from the scene's start to times [s], of their shape; also back before it."""
        inside = np.clip(time, self.times[0], self.times[-1])
        piece = np.searchsorted(self.times, inside, side='right') - 1
        value = np.interp(inside, self.times, self.values)
        until = self.integrals[piece] + 0.5 * (self.values[piece] + value) * (inside - self.times[piece])
        return until + value * (time - inside)


def read_profile(settings: Settings, unit: str, duration: float, folder: Path) -> Profile:
    """Read the profile of an effect: its ``points`` or, in their place, its ``table``.

    Args:
        settings: Settings of the effect.
        unit: Unit of the numbers, for errors; they are not converted.
        duration: Duration of the scene [s].
        folder: Folder of the scene file, from which the table's path counts.

    Raises:
        SceneError: Both or neither is given, the table cannot be read, or a point breaks a rule.
    """
    if 'table' in settings and 'points' in settings:
        raise SceneError(f'{settings.name} has points and a table: give one of them')
    if 'table' in settings:
        rows = _table_rows(folder / settings.text('table', 'the path of a CSV file'))
    else:
        rows = settings.rows('points', 'point', f'a list of points [time in s, value in {unit}]')
    return Profile.of(check_points(rows, duration))


def read_steps(settings: Settings, unit: str, duration: float) -> Profile:
    """Return the ``steps`` and the ``rise`` of an effect as a profile.

    Each step [time in s, level] begins at its time and takes ``rise`` > 0 [s], which must be given: neither
    a shaft nor the load on a bearing jumps. The first level holds from the scene's start.

    Args:
        settings: Settings of the effect.
        unit: Unit of the levels, for errors; they are not converted.
        duration: Duration of the scene [s].

    Raises:
        SceneError: A step breaks a rule, or begins before the one before it has ended.
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
    """Return points of a scene as (time [s], value); check that the times rise within the scene.

    Args:
        rows: For each point its name, for errors, and the point as the file has it.
        duration: Duration of the scene [s].

    Raises:
        SceneError: A point is not a list of two numbers, or a time breaks a rule of :func:`check_times`.
    """
    for name, point in rows:
        _check_pair(name, point, '[time in s, value]')
    check_times([(name, time) for name, (time, _) in rows], duration)
    return [(float(time), float(value)) for _, (time, value) in rows]


def _is_pair(value: Any) -> bool:
    """Return whether a value is a list of two numbers."""
    return isinstance(value, list) and len(value) == 2 and all(map(is_number, value))


def _check_pair(name: str, pair: Any, meaning: str) -> None:
    """Raise SceneError unless a value is a list of two numbers, which ``meaning`` describes."""
    if not _is_pair(pair):
        size = size_clause(*pair) if isinstance(pair, list) else ''
        raise refused(name, pair, f'a pair of numbers, {meaning}{size}', SceneError)


def check_times(rows: Sequence[tuple[str, Any]], duration: float) -> None:
    """Check that times of a scene [s] are numbers that rise strictly, from 0 to its duration.

    Args:
        rows: For each time its name, for errors, and its value.
        duration: Duration of the scene [s].

    Raises:
        SceneError: A time is not a number, lies outside the scene, or does not rise above the one before.
    """
    for name, time in rows:
        if not is_number(time):
            raise SceneError(f'{name} is at {time!r}: a time must be a number of seconds')
        if not 0.0 <= time <= duration:
            outside = f'outside the scene, which lasts from 0 to {duration:g} s'
            raise SceneError(f'{name} is at {time:g} s, {outside}')
    for (_, before), (name, after) in pairwise(rows):
        if after <= before:
            rise = f'but times must rise and the one before is at {before:g} s'
            raise SceneError(f'{name} is at {after:g} s, {rise}')


def _table_rows(path: Path) -> list[tuple[str, Any]]:
    """Read a table headed ``time,value``; return a name for errors and [time, value] of each row.

    Raises:
        SceneError: The file cannot be read, has other headings, no rows, or a row that is not two numbers.
    """
    rows, _ = read_table(path, MAX_TABLE_BYTES, SceneError, ['time', 'value'].__eq__)
    if not rows or rows[0].cells != ['time', 'value']:
        raise SceneError(f"table '{path}' must begin with a line 'time,value'")
    if len(rows) == 1:
        raise SceneError(f"table '{path}' has no rows")
    named = []
    for line, cells in rows[1:]:
        name = f"table '{path}' line {line}"
        try:
            time, value = map(float, cells)
        except ValueError:
            raise refused(name, ','.join(cells), 'two numbers: time in s, value', SceneError) from None
        named.append((name, [time, value]))
    return named


Hit = Callable[[FloatArray], BoolArray]
"""Function of the times of the next samples [s], shape (n,): whether each is hit."""


def read_windows(settings: Settings, duration: float) -> Hit:
    """Return the function that picks samples by their times [s]: those in the ``windows`` [start, end).

    Raises:
        SceneError: There are none, one does not lie within the scene, or they overlap or are out of order.
    """
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
    """Return the function that picks samples by their times [s]: by ``windows``, a random ``share`` or both.

    With both it picks those of the share that lie in a window. For a share each call takes a number for each
    sample from ``random``.

    Raises:
        SceneError: Neither is given, or one breaks its rule.
    """
    if 'windows' not in settings and 'share' not in settings:
        raise SceneError(f'{settings.name} must have windows, a share of the samples, or both')
    windows = read_windows(settings, duration) if 'windows' in settings else None
    if 'share' not in settings:
        assert windows is not None  # one of both is there
        return windows
    share = settings.number('share', '-', above=0.0, maximum=1.0)

    def hit(time: FloatArray) -> BoolArray:
        # One draw for each sample, in a window or not: windows do not change the draws.
        hit: BoolArray = random.random(time.size) < share
        return hit if windows is None else hit & windows(time)

    return hit


BETWEEN = 'between'
"""Key of the mapping that stands for a number to draw."""
# The parameters of a bearing that ``parameter_error`` may list.
PARAMETERS = (
    *('mass', 'damping', 'stiffness'),
    *(f'friction.{name}' for name in ('static', 'kinetic', 'decay', 'viscous')),
    *('speed.scale', 'load.scale'),
)


def random_stream(seed: int, *names: str) -> np.random.Generator:
    """Return a new random stream that depends on the seed and the names alone, on every machine."""
    digest = hashlib.sha256('\0'.join(names).encode()).digest()
    key = tuple(int.from_bytes(digest[k : k + 4], 'little') for k in range(0, 16, 4))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def draw_numbers(document: Any, seed: int, place: str = '') -> Any:
    """Return a copy of a parsed scene with a drawn number in place of each ``{between: [low, high]}``.

    Each is drawn evenly from a random stream of its own, named after its place in the file.

    Args:
        document: Mappings, lists and values, as YAML gives them.
        seed: Seed of the scene.
        place: Where the document stands in the file, for the name of the streams.

    Raises:
        SceneError: Limits are not two numbers, the lower first; the text names the place.
    """
    if isinstance(document, Mapping):
        if list(document) == [BETWEEN]:
            return _draw_between(document[BETWEEN], seed, place)
        return {key: draw_numbers(value, seed, f'{place}.{key}') for key, value in document.items()}
    if isinstance(document, list):
        names = _number_repeated(document)
        return [
            draw_numbers(value, seed, f'{place}.{name}') for name, value in zip(names, document, strict=True)
        ]
    return document


def _draw_between(limits: Any, seed: int, place: str) -> float:
    """Draw a number evenly between two limits from the random stream of a place in the file.

    Raises:
        SceneError: They are not two numbers, the lower first.
    """
    if not _is_pair(limits) or limits[0] > limits[1]:
        rule = 'two numbers, the lower first'
        raise refused(f'{place.lstrip(".")}.{BETWEEN}', limits, rule, SceneError)
    low, high = map(float, limits)
    share = float(random_stream(seed, BETWEEN, place).random())
    return low + (high - low) * share


def _number_repeated(entries: list[Any]) -> list[str]:
    """Return a name for each entry of a list: an effect's name and count, else the position; both from 0.

    An effect keeps its name, and so its random stream, when others are added to the list.
    """
    seen: Counter[str] = Counter()
    unique = []
    for number, entry in enumerate(entries):
        is_effect = isinstance(entry, Mapping) and ('effect' in entry or len(entry) == 1)
        name = str(entry.get('effect', next(iter(entry)))) if is_effect else ''
        unique.append(f'{name}{seen[name]}' if name else str(number))
        seen[name] += 1
    return unique


def read_parameter_error(settings: Settings) -> dict[str, float]:
    """Return the largest relative error of each parameter in ``parameter_error``; empty without the section.

    Raises:
        SceneError: A parameter is not one of :data:`PARAMETERS`, or an error is not from 0 to 0.9.
    """
    if 'parameter_error' not in settings:
        return {}
    error_settings = settings.section('parameter_error', PARAMETERS, 'the largest relative errors')
    return {
        name: error_settings.number(name, '-', minimum=0.0, maximum=0.9)
        for name in PARAMETERS
        if name in error_settings
    }
