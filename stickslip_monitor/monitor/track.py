# SPDX-License-Identifier: Apache-2.0
"""The course of one bearing's alarm in time: the ladder, and inputs that are lost and return."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from stickslip_monitor.monitor.alarm import LADDER, Alarm, Condition, Step
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.signals import QUANTITIES


class Heard(NamedTuple):
    """The last believed sample of an input: its stamp, and until when it counts [ns]."""

    time_ns: int
    until_ns: int


Inputs = Sequence[Heard | None]


@dataclass(frozen=True, slots=True)
class Change:
    """One change of condition.

    Attributes:
        time_ns: When it fell due [ns].
        before: The condition before.
        after: The condition from then on.
        lost: The inputs that are lost, with their ages [s]; ``inf`` for one never received.
    """

    time_ns: int
    before: Condition
    after: Condition
    lost: dict[str, float] = field(default_factory=dict)


class AlarmTrack:
    """Alarm and staleness of one bearing; the stamps of its inputs are arguments."""

    def __init__(self, config: BearingConfig) -> None:
        self.alarm = Alarm(config.alarm)
        self.start_ns: int | None = None
        self.stale = False
        self.retune(config)

    def retune(self, config: BearingConfig) -> None:
        """Take over new delays and timeouts; the state stays."""
        self.alarm.config = config.alarm
        self.timeouts = (config.speed.timeout_ns, config.load.timeout_ns)

    @property
    def condition(self) -> Condition:
        """What the alarm says now."""
        return Condition.INPUT_STALE if self.stale else LADDER[self.alarm.rung]

    def restart(self, time_ns: int) -> None:
        """The clock jumped to a time: everything that was waiting on time starts anew."""
        self.start_ns = time_ns
        self.alarm.restart()

    def _deadlines(self, inputs: Inputs) -> list[int]:
        """Until when each input counts; one not yet received counts from the start."""
        assert self.start_ns is not None
        return [
            self.start_ns + timeout if heard is None else heard.until_ns
            for heard, timeout in zip(inputs, self.timeouts, strict=True)
        ]

    def lost(self, time_ns: int, inputs: Inputs) -> dict[str, float]:
        """The inputs whose deadline has come, with their ages [s]."""
        if self.start_ns is None:
            return {}
        return {
            name: math.inf if heard is None else (time_ns - heard.time_ns) / 1e9
            for name, heard, deadline in zip(
                QUANTITIES, inputs, self._deadlines(inputs), strict=True
            )
            if time_ns >= deadline
        }

    def advance(self, time_ns: int, inputs: Inputs) -> list[Change]:
        """Let time pass: what fell due strictly before now happens, in its order."""
        if self.start_ns is None:
            self.start_ns = time_ns
        if self.stale:
            return []
        passed = [deadline for deadline in self._deadlines(inputs) if deadline < time_ns]
        until = self.alarm.not_past(min(passed, default=time_ns))
        changes = _changes(self.alarm.advance(until))
        if passed:
            before = self.condition
            self.stale = True
            self.alarm.restart()
            lost = self.lost(until, inputs)
            changes.append(Change(until, before, Condition.INPUT_STALE, lost))
        return changes

    def apply(self, rung: int, time_ns: int) -> list[Change]:
        """Take the rung of an operating point measured now."""
        changes = []
        if self.stale:
            self.stale = False
            changes.append(Change(time_ns, Condition.INPUT_STALE, self.condition))
        return changes + _changes(self.alarm.step(rung, time_ns))


def _changes(steps: list[Step]) -> list[Change]:
    return [Change(step.time_ns, LADDER[step.before], LADDER[step.after]) for step in steps]
