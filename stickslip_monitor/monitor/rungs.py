# SPDX-License-Identifier: Apache-2.0
"""From an assessment to a rung of the alarm's ladder: branch memory and deadbands.

In the bistable range the averaged model has two answers. Stick-slip that has started goes on until
the fold; a bearing that came down from above stays quiet until the Hopf speed. A monitor that
starts inside the range, with no history to go by, takes the bearing to be quiet.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.alarm import LADDER, Condition
from stickslip_monitor.monitor.assessment import OUTCOMES, Assessment, Outcome
from stickslip_monitor.monitor.config import AlarmConfig

_STICK_SLIP = OUTCOMES.index(Outcome.STICK_SLIP)
_BISTABLE = OUTCOMES.index(Outcome.BISTABLE)
_AT_REST = OUTCOMES.index(Outcome.AT_REST)
_CAUTION_RUNG, _BISTABLE_RUNG, _STICK_RUNG, _AMPLITUDE_RUNG = (
    LADDER.index(condition)
    for condition in (
        Condition.CAUTION,
        Condition.BISTABLE,
        Condition.STICK_SLIP,
        Condition.AMPLITUDE,
    )
)

Bools = NDArray[np.bool_]


def latched(on: Any, off: Any, before: bool) -> Any:
    """A latch over time: set where ``on``, else cleared where ``off``, else as it was.

    Args:
        on: Shape (n,) bool.
        off: Shape (n,) bool.
        before: The state before the first element.

    Returns:
        The state after each element, shape (n,) bool.
    """
    place = np.maximum.accumulate(np.where(on | off, np.arange(on.size), -1))
    return np.where(place >= 0, on[place], before)


class Bands:
    """The three memories between an assessment and the alarm, for one bearing."""

    def __init__(self, config: AlarmConfig) -> None:
        self.config = config
        self.sticking = False
        self._near = False
        self._over = False

    def rungs(self, point: Assessment) -> tuple[NDArray[np.int8], Bools]:
        """Rungs and stick-slip predictions of successive assessments; remembers the last.

        Args:
            point: Assessment of arrays, shape (n,) with n >= 1, in order of time.

        Returns:
            The rung of the alarm's ladder and whether stick-slip is predicted, each shape (n,).
        """
        code, margin = point.outcome_code, point.fold_margin
        resting = code == _AT_REST
        clear_margin = self.config.caution_margin + self.config.hysteresis

        unstable = code == _STICK_SLIP
        sticking = latched(unstable, ~unstable & (code != _BISTABLE), self.sticking)
        close = ~resting & (margin < self.config.caution_margin)
        near = latched(close, resting | (margin > clear_margin), self._near)
        over = self._oversized(point, sticking)

        self.sticking, self._near, self._over = bool(sticking[-1]), bool(near[-1]), bool(over[-1])
        rung = np.select(
            [sticking & over, sticking, code == _BISTABLE, near],
            [_AMPLITUDE_RUNG, _STICK_RUNG, _BISTABLE_RUNG, _CAUTION_RUNG],
            0,
        )
        return rung.astype(np.int8), sticking

    def _oversized(self, point: Assessment, sticking: Bools) -> Bools:
        limit = self.config.amplitude_limit
        if limit == math.inf or not sticking.any():
            return np.zeros_like(sticking)
        amplitude = point.amplitude
        small = amplitude < limit * (1.0 - self.config.hysteresis)
        over: Bools = latched(sticking & (amplitude > limit), ~sticking | small, self._over)
        return over

    def rung(self, point: Assessment) -> tuple[int, bool]:
        """:meth:`rungs` of an assessment of scalars."""
        config, code, margin = self.config, point.outcome_code, point.fold_margin
        if code == _STICK_SLIP:
            self.sticking = True
        elif code != _BISTABLE:
            self.sticking = False
        if code != _AT_REST and margin < config.caution_margin:
            self._near = True
        elif code == _AT_REST or margin > config.caution_margin + config.hysteresis:
            self._near = False
        if not self.sticking:
            self._over = False
            quiet = _CAUTION_RUNG if self._near else 0
            return (_BISTABLE_RUNG if code == _BISTABLE else quiet), False
        if config.amplitude_limit == math.inf:
            self._over = False
        elif point.amplitude > config.amplitude_limit:
            self._over = True
        elif point.amplitude < config.amplitude_limit * (1.0 - config.hysteresis):
            self._over = False
        return (_AMPLITUDE_RUNG if self._over else _STICK_RUNG), True
