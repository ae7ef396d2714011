# SPDX-License-Identifier: Apache-2.0
"""Alarms by probability: what an operating point counts as, given how much is not known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import OUTCOMES, Outcome

Bools = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

_CLEAR = 0.5
_NO_CYCLE, _BISTABLE, _STICK_SLIP, _NO_BOUNDARY = (
    OUTCOMES.index(outcome)
    for outcome in (Outcome.NO_CYCLE, Outcome.BISTABLE, Outcome.STICK_SLIP, Outcome.NO_BOUNDARY)
)


@dataclass(frozen=True, slots=True)
class Thresholds:
    """From which probability on an operating point counts as something.

    If a missed episode costs ``L`` times a false alarm, ``1/(1 + L)`` costs least. Each is left
    below half of it.

    Attributes:
        can: That stick-slip can happen, for bistable.
        runs: That it starts by itself, for stick-slip.
        caution: That it can happen, for caution.
    """

    can: float = 0.5
    runs: float = 0.5
    caution: float = 0.05


class Held(NamedTuple):
    """Which thresholds an operating point is held above."""

    can: bool = False
    runs: bool = False
    caution: bool = False


NOTHING_HELD = Held()


def decided_codes(
    code: NDArray[np.int8],
    can: FloatArray,
    will: FloatArray,
    thresholds: Thresholds,
    before: Held = NOTHING_HELD,
) -> tuple[NDArray[np.int8], Bools, Held]:
    """Outcome codes by probability, for what decides by outcome codes.

    Args:
        code: Outcome codes of the assessments, shape (n,), n >= 1, in order of time. Those
            without an operating point or without contact stay as they are.
        can: Probability that stick-slip can happen, shape (n,).
        will: Probability that it starts by itself, shape (n,).
        thresholds: Where it counts.
        before: What held before the first.

    Returns:
        The codes and whether caution is due, each shape (n,); and what holds after the last.
    """
    judged = np.isin(code, (_NO_CYCLE, _BISTABLE, _STICK_SLIP, _NO_BOUNDARY))
    sources = (can, will, can)
    limits = (thresholds.can, thresholds.runs, thresholds.caution)
    possible, runs, caution = (
        _held(np.where(judged, p, 0.0), limit, held)
        for p, limit, held in zip(sources, limits, before, strict=True)
    )
    quiet = np.where(code == _NO_BOUNDARY, _NO_BOUNDARY, _NO_CYCLE)
    decided = np.select([runs, possible], [_STICK_SLIP, _BISTABLE], quiet)
    after = Held(bool(possible[-1]), bool(runs[-1]), bool(caution[-1]))
    return np.where(judged, decided, code).astype(np.int8), caution, after


def _held(p: FloatArray, limit: float, before: bool) -> Bools:
    """Set above a limit, cleared below half of it."""
    on = p > limit
    place = np.maximum.accumulate(np.where(on | (p < _CLEAR * limit), np.arange(p.size), -1))
    return np.where(place >= 0, on[place], before)
