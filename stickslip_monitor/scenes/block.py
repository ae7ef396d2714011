# SPDX-License-Identifier: Apache-2.0
"""What effects work on, stretch by stretch of time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import sampling
from .shaft import Shaft
from .signals import FloatArray, Signal
from .truth import Column


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A stretch of a scene; effects change its signals or put others in their place.

    Attributes:
        start: Its begin since the scene's start [s].
        end: Its end [s].
        duration: Duration of the scene [s].
        shaft: The operating point as it is, at any instant.
        signals: What the sensor of each topic sends.
        truth: What no sensor tells; a topic that may have messages is there even without any.
    """

    start: float
    end: float
    duration: float
    shaft: Shaft
    signals: dict[str, Signal]
    truth: list[Column] = field(default_factory=list)

    def instants(self, rate: float) -> FloatArray:
        """The regular instants of this block at a rate [Hz], shape (n,) [s].

        Those of all blocks together are ``k / rate`` from 0 to the scene's end, each once.
        """
        return np.array(sampling.numbers(rate, self.start, self.end, self.duration)) / rate
