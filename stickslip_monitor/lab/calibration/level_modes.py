# SPDX-License-Identifier: Apache-2.0
"""The level that tells vibration from quiet, from one that has shown both.

Two Gaussians, quiet and loud, are fitted to the level's logarithms by expectation maximisation;
the threshold is where their density is least between the two. Modes that are not apart have none.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.arrays import FloatArray

APART = 3.0
"""Modes closer than this many standard deviations cannot be told apart."""
_ROUNDS = 200


def two_modes(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (rising), standard deviations and shares of two Gaussians.

    Args:
        x: The values, shape (n,), not all the same.
    """
    size = float(x.size)
    loud = (x > 0.5 * (x.min() + x.max())).astype(float)
    least = 1e-3 * float(np.ptp(x))
    for _ in range(_ROUNDS):
        belongs = np.stack([1.0 - loud, loud])
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
