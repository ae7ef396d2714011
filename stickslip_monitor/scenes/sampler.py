# SPDX-License-Identifier: Apache-2.0
"""At which instants a motion is looked at, and what windows of it tell."""

from __future__ import annotations

import math

import numpy as np

from . import sampling
from .signals import FloatArray

PERIODS = 4
"""Natural periods in a window that an amplitude is taken from."""
_STEPS = 16 * PERIODS


class Regular:
    """The instants ``k / rate`` of a scene, handed out in order.

    Args:
        rate: Instants per second [Hz].
        duration: Duration of the scene [s].
    """

    def __init__(self, rate: float, duration: float) -> None:
        self._rate = rate
        self._count = sampling.count(rate, duration)
        self._next = 0

    def until(self, end: float) -> FloatArray:
        """The next instants, up to and with ``end`` [s]."""
        guess = min(self._count, math.floor(end * self._rate) + 2)
        time = np.arange(self._next, max(guess, self._next)) / self._rate
        time = time[: np.searchsorted(time, end, 'right')]
        self._next += time.size
        return time


class Windows:
    """The amplitude of a motion in a short window before each instant ``k / rate``, ``k > 0``.

    Args:
        rate: Windows per second, not above :meth:`highest_rate` [Hz].
        period: Natural period [s].
        duration: Duration of the scene [s].
    """

    def __init__(self, rate: float, period: float, duration: float) -> None:
        self._rate, self._period = rate, period
        self._count = sampling.count(rate, duration)
        self._next = _STEPS + 1  # the window before the scene's start is not there
        self._step = PERIODS * period / _STEPS
        self._kept = np.empty((2, 0))

    @staticmethod
    def highest_rate(period: float) -> float:
        """Rate at which windows would touch [Hz]."""
        return 1.0 / (PERIODS * period)

    def until(self, end: float) -> FloatArray:
        """The next instants to look at, up to and with ``end`` [s]."""
        last = min(self._count, math.floor((end + PERIODS * self._period) * self._rate) + 2)
        number = np.arange(self._next, max(last * (_STEPS + 1), self._next))
        window, place = np.divmod(number, _STEPS + 1)
        time = window / self._rate - (_STEPS - place) * self._step
        time = time[: np.searchsorted(time, end, 'right')]
        self._next += time.size
        return time

    def amplitudes(
        self, displacement: FloatArray, velocity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Half the peak to peak of each window that is now complete.

        Args:
            displacement: At the instants handed out last, shape (n,) [m].
            velocity: The same [m/s].

        Returns:
            The instants at the windows' ends [s], and the amplitudes [m], both of shape (m,).
        """
        kept = np.concatenate([self._kept, [displacement, velocity]], axis=1)
        begin = self._next - kept.shape[1]
        whole = kept.shape[1] // (_STEPS + 1)
        cut = whole * (_STEPS + 1)
        self._kept = kept[:, cut:]
        x, v = kept[:, :cut].reshape(2, whole, _STEPS + 1)
        numbers = begin // (_STEPS + 1) + np.arange(whole)
        return numbers / self._rate, half_peak_to_peak(x, v, self._step)


def half_peak_to_peak(x: FloatArray, v: FloatArray, step: float) -> FloatArray:
    """Half of the largest less the smallest displacement of sampled motions.

    Between two samples the motion is taken for the cubic through their displacements and
    velocities, which sixteen samples in a period of a harmonic motion follow to 6e-5.

    Args:
        x: Displacements, shape (m, n) [m].
        v: Velocities, shape (m, n) [m/s].
        step: Time between samples [s].

    Returns:
        Shape (m,) [m].
    """
    before, after = step * v[:, :-1], step * v[:, 1:]
    rise = np.diff(x, axis=1)
    turns = before * after < 0.0
    # The cubic's derivative is a s^2 + b s + c, with s from 0 to 1.
    a = 3.0 * (before + after - 2.0 * rise)
    b = 2.0 * (3.0 * rise - 2.0 * before - after)
    q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4.0 * a * before, 0.0)), b))
    with np.errstate(divide='ignore', invalid='ignore'):
        first, second = before / q, q / a
    s = np.where(turns, np.where((first >= 0.0) & (first <= 1.0), first, second), 0.0)
    turning = x[:, :-1] + s * (before + s * (b / 2.0 + s * a / 3.0))
    highest = np.maximum(x.max(axis=1), turning.max(axis=1))
    lowest = np.minimum(x.min(axis=1), turning.min(axis=1))
    amplitude: FloatArray = 0.5 * (highest - lowest)
    return amplitude
