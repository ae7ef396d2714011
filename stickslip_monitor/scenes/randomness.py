# SPDX-License-Identifier: Apache-2.0
"""Random streams by name: what one effect draws never changes what another draws."""

from __future__ import annotations

import hashlib

import numpy as np


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
