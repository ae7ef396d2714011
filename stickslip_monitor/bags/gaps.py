# SPDX-License-Identifier: Apache-2.0
"""How regularly the messages of an input came, and where they did not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .values import IntArray

_MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class Gap:
    """A time without messages: the last stamp before it [ns] and how long it lasted [s]."""

    start_ns: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Gaps:
    """The rhythm of a topic.

    Attributes:
        rate: Messages a second between the gaps [1/s]; ``nan`` for fewer than two.
        count: Gaps, that is, intervals longer than the limit.
        longest: The longest of them, longest first, at most five.
    """

    rate: float
    count: int
    longest: tuple[Gap, ...]


def find_gaps(stamp_ns: IntArray, limit_ns: int) -> Gaps:
    """Find the intervals between messages that are longer than a limit.

    Args:
        stamp_ns: Stamps in order of arrival, shape (n,) [ns]; steps back count as no time.
        limit_ns: The longest interval that is no gap [ns].

    Returns:
        The gaps and the rate apart from them.
    """
    interval = np.diff(stamp_ns)
    long = np.flatnonzero(interval > limit_ns)
    lasting = interval[long]
    regular = interval.size - long.size
    passed = float(np.maximum(interval, 0).sum() - lasting.sum()) * 1e-9
    order = np.argsort(-lasting, kind='stable')[:_MOST_NAMED]
    named = [Gap(int(stamp_ns[long[i]]), float(lasting[i]) / 1e9) for i in order]
    return Gaps(regular / passed if passed > 0.0 else np.nan, int(long.size), tuple(named))
