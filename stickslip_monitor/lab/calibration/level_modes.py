# SPDX-License-Identifier: Apache-2.0
"""The level that tells vibration from quiet: learned from a level that has shown both.

The level's decibels are of two modes, quiet and loud. Two Gaussians are fitted to them by
expectation maximisation; the threshold is where their density is least between the two. It takes
a number of values, and modes that lie apart, or there is none.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray

APART = 3.0
"""Modes closer than this many standard deviations cannot be told apart."""
APART_DB = 6.0
"""Nor can modes closer than this [dB]: the deadband must fit between them."""
LEAST_SHARE = 5
"""Values of which each mode must consist."""
SECOND = 10**9
_ROUNDS = 200
_LOWEST_DB, _STEP_DB, _BINS = -240.0, 0.5, 961
_FIRST_FIT, _GROWS = 30, 20
_STRANGE = 5


def decibels(value: float) -> float:
    """A level in decibels; what is not above 0 is the lowest that there is."""
    return max(20.0 * math.log10(value), _LOWEST_DB) if value > 0.0 else _LOWEST_DB


def two_modes(
    x: FloatArray, weight: FloatArray | float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (rising), standard deviations and shares of two Gaussians.

    Args:
        x: The values, shape (n,), not all the same.
        weight: How often each was seen, shape (n,).
    """
    often = np.broadcast_to(np.asarray(weight, float), x.shape)
    size = float(often.sum())
    loud = (x > 0.5 * (x.min() + x.max())).astype(float)
    least = 1e-3 * float(np.ptp(x))
    for _ in range(_ROUNDS):
        belongs = np.stack([1.0 - loud, loud]) * often
        share = np.maximum(belongs.sum(axis=1) / size, 1e-12)
        mean = belongs @ x / (share * size)
        off = (x - mean[:, None]) ** 2
        spread = np.sqrt(np.maximum((belongs * off).sum(axis=1) / (share * size), least**2))
        density = np.log(share / spread)[:, None] - 0.5 * off / spread[:, None] ** 2
        before = loud
        loud = 1.0 / (1.0 + np.exp(np.clip(density[0] - density[1], -50, 50)))
        if np.max(np.abs(loud - before)) < 1e-6:
            break
    order = np.argsort(mean)
    return mean[order], spread[order], share[order]


def are_apart(mean: FloatArray, spread: FloatArray) -> bool:
    """Whether two modes can be told from each other."""
    return bool(mean[1] - mean[0] >= APART * math.hypot(*spread) / math.sqrt(2.0))


def least_between(mean: FloatArray, spread: FloatArray, share: FloatArray) -> float:
    """Where the density of two modes is least between them."""
    between = np.linspace(mean[0], mean[1], 1001)
    one, two = (
        np.log(p / s) - 0.5 * ((between - m) / s) ** 2
        for m, s, p in zip(mean, spread, share, strict=True)
    )
    return float(between[np.argmin(np.logaddexp(one, two))])


class LearnedThreshold:
    """Learns the threshold from one value a second, at constant memory.

    Attributes:
        threshold: The threshold [dB]; ``nan`` as long as only one mode has been seen.
    """

    def __init__(self) -> None:
        self.threshold = math.nan
        self._counts: IntArray = np.zeros(_BINS, np.int64)
        self._next_ns: int | None = None
        self._count = 0
        self._next_fit = self._spacing = _FIRST_FIT
        self._known = (_BINS, -1)
        self._strange = 0

    def restart(self) -> None:
        """The clock jumped; what was learned stays."""
        self._next_ns = None

    def add(self, time_ns: int, level: float) -> None:
        """Take a level [dB]; times do not fall."""
        if self._next_ns is not None and time_ns < self._next_ns:
            return
        self._next_ns = time_ns + SECOND
        place = round((min(max(level, _LOWEST_DB), -_LOWEST_DB) - _LOWEST_DB) / _STEP_DB)
        self._counts[place] += 1
        self._count += 1
        self._strange += not self._known[0] <= place <= self._known[1]
        late = self._count >= self._next_fit
        if late or (self._strange >= _STRANGE and self._count >= _FIRST_FIT):
            self._fit()

    def _fit(self) -> None:
        seen = np.flatnonzero(self._counts)
        # Anew when there is a twentieth more to learn from; soon when another mode shows.
        most = max(_FIRST_FIT, self._count // _GROWS)
        shows = self._strange >= _STRANGE
        self._spacing = _FIRST_FIT if shows else min(2 * self._spacing, most)
        self._next_fit = self._count + self._spacing
        margin = round(APART_DB / _STEP_DB)
        self._known = int(seen[0]) - margin, int(seen[-1]) + margin
        self._strange = 0
        if seen.size < 2:
            return
        level: FloatArray = _LOWEST_DB + _STEP_DB * seen.astype(np.float64)
        mean, spread, share = two_modes(level, self._counts[seen].astype(np.float64))
        apart = are_apart(mean, spread) and mean[1] - mean[0] >= APART_DB
        if apart and float(share.min()) * self._count >= LEAST_SHARE - 0.5:
            self.threshold = least_between(mean, spread, share)
