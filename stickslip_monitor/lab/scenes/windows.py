# SPDX-License-Identifier: Apache-2.0
"""When an effect acts: windows in time, a share of the samples, or both; and its random stream."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IntArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.settings import Settings, is_number


def random_stream(seed: int, *names: str) -> np.random.Generator:
    """The random stream of a name.

    Args:
        seed: The scene's seed, not negative.
        names: Who draws: the effect, and within it the topic.

    Returns:
        A generator that depends on the seed and the names alone, on every machine.
    """
    digest = hashlib.sha256('\0'.join(names).encode()).digest()
    key = tuple(int.from_bytes(digest[k : k + 4], 'little') for k in range(0, 16, 4))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


WINDOW_KEYS = ('windows', 'share')


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Stretches of time that do not overlap.

    Attributes:
        starts: Their starts, rising, shape (n,) [s].
        ends: Their ends, which do not belong to them, shape (n,) [s].
    """

    starts: FloatArray
    ends: FloatArray

    def hold(self, time: FloatArray) -> BoolArray:
        """Whether some times [s] lie in a window."""
        return self.number(time) >= 0

    def number(self, time: FloatArray) -> IntArray:
        """The window, counted from 0, that each of some times [s] lies in, else -1."""
        window = np.searchsorted(self.starts, time, side='right') - 1
        return np.where((window >= 0) & (time < self.ends[window]), window, -1)


def read_windows(settings: Settings, duration: float) -> Windows:
    """Read ``windows``: pairs [start, end] in s, in order of time.

    Args:
        settings: What has them.
        duration: The scene's duration [s].

    Raises:
        SceneError: A window is no pair, ends before it starts, leaves the scene or overlaps the
            one before.
    """
    what = 'a list of windows [start in s, end in s]'
    listed = settings.value('windows', what)
    if not isinstance(listed, list) or not listed:
        raise settings.broken('windows', f'must be {what}')
    label = settings.label('windows')
    for number, window in enumerate(listed, 1):
        _check(f'{label}: window {number}', window, duration)
    for number, (before, after) in enumerate(pairwise(listed), 2):
        if after[0] < before[1]:
            raise SceneError(
                f'{label}: window {number} = {after} overlaps or precedes window {number - 1} ='
                f' {before}; windows must follow one another'
            )
    starts, ends = np.array(listed, float).T.copy()
    return Windows(starts, ends)


def _check(name: str, window: Any, duration: float) -> None:
    if not isinstance(window, list) or len(window) != 2 or not all(map(is_number, window)):
        raise SceneError(f'{name} = {window!r} must be a pair of numbers, [start in s, end in s]')
    if not 0.0 <= window[0] < window[1] <= duration:
        raise SceneError(
            f'{name} = {window} must start before it ends, within the scene, which lasts from 0'
            f' to {duration:g} s'
        )


@dataclass(frozen=True, slots=True, eq=False)
class SampleMask:
    """Which samples an effect changes.

    Attributes:
        windows: Where it acts; None: everywhere.
        share: The probability that a sample there is hit, each by itself.
        random: Its random stream, None where the share is 1.
    """

    windows: Windows | None
    share: float
    random: np.random.Generator | None

    def hit(self, time: FloatArray) -> BoolArray:
        """Whether the next samples, at some times [s], are hit."""
        hit = np.ones(time.size, np.bool_) if self.windows is None else self.windows.hold(time)
        if self.random is not None:
            # One draw for each sample, in a window or not: windows do not change the draws.
            hit &= self.random.random(time.size) < self.share
        return hit


def read_sample_mask(
    settings: Settings, duration: float, random: np.random.Generator
) -> SampleMask:
    """Read ``windows`` and ``share``, of which at least one is there.

    Args:
        settings: What has them.
        duration: The scene's duration [s].
        random: The effect's random stream, drawn from only where there is a share.

    Raises:
        SceneError: There is neither, or one breaks its rule.
    """
    if 'windows' not in settings and 'share' not in settings:
        raise SceneError(f'{settings.name} must have windows, a share of the samples, or both')
    windows = read_windows(settings, duration) if 'windows' in settings else None
    if 'share' not in settings:
        return SampleMask(windows, 1.0, None)
    return SampleMask(windows, settings.number('share', '-', above=0.0, most=1.0), random)
