# SPDX-License-Identifier: Apache-2.0
"""Regular instants: ``k / rate`` for whole numbers ``k``, cut into stretches of time."""

from __future__ import annotations

import math


def count(rate: float, duration: float) -> int:
    """Instants from 0 to ``duration`` [s], both inclusive, at ``rate`` [Hz]."""
    return math.floor(duration * rate * (1.0 + 1e-12)) + 1


def numbers(rate: float, start: float, end: float, duration: float) -> range:
    """The ``k`` of the instants from ``start`` to before ``end``.

    Stretches that join cover every instant of the scene once, and the last one, which ends at
    ``duration``, has the instant at its end too.

    Args:
        rate: Instants per second [Hz].
        start: Begin of the stretch [s].
        end: Its end [s].
        duration: Duration of the scene [s].
    """
    whole = count(rate, duration)
    stop = whole if end == duration else min(whole, math.ceil(end * rate))
    return range(min(stop, math.ceil(start * rate)), stop)
