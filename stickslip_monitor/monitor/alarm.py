# SPDX-License-Identifier: Apache-2.0
"""The alarm: from the verdict on an operating point to a condition that is raised and cleared.

The conditions form a ladder. Each rung is raised when the operating point has been on it or above
for ``on_delay``, and cleared when it has been below for ``off_delay``; the alarm stands on the
highest rung raised. Time is an argument: a delay ends at its own instant, whenever the next
sample or tick comes to notice it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from stickslip_monitor.monitor.config import AlarmConfig


class Level(IntEnum):
    """Severity, with the values of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


class Condition(str, Enum):
    """What the alarm of a bearing says."""

    level: Level
    sentence: str

    def __new__(cls, name: str, level: Level, sentence: str) -> Condition:
        """Make a member from its name, level and sentence."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.level = level
        member.sentence = sentence
        return member

    NORMAL = 'normal', Level.OK, 'No stick-slip predicted.'
    CAUTION = 'caution', Level.WARN, 'Close to the stick-slip region.'
    BISTABLE = (
        'bistable',
        Level.WARN,
        'Inside the bistable range: quiet now, but a disturbance can start stick-slip.',
    )
    STICK_SLIP = 'stick_slip', Level.ERROR, 'Stick-slip predicted.'
    AMPLITUDE = 'amplitude_limit', Level.ERROR, 'Stick-slip predicted above the amplitude limit.'
    INPUT_STALE = 'input_stale', Level.ERROR, 'An input is lost: nothing can be predicted.'

    def __str__(self) -> str:
        return str(self.value)


LADDER = (
    Condition.NORMAL,
    Condition.CAUTION,
    Condition.BISTABLE,
    Condition.STICK_SLIP,
    Condition.AMPLITUDE,
)

_SETTLED: list[int | None] = [None] * len(LADDER)


@dataclass(frozen=True, slots=True)
class Step:
    """A change of rung at an instant."""

    time_ns: int
    before: int
    after: int


class Alarm:
    """The ladder's state: the rung it stands on and how long each rung has disagreed with it."""

    def __init__(self, config: AlarmConfig) -> None:
        self.config = config
        self.rung = 0
        self._asked = 0
        self._seen_ns: int | None = None
        self._since = _SETTLED.copy()

    def restart(self) -> None:
        """Forget how long anything has lasted; the rung stays."""
        self._since = _SETTLED.copy()
        self._seen_ns = None

    def not_past(self, time_ns: int) -> int:
        """An instant that fell due, but never before the latest time seen.

        A delay or timeout that is made shorter while it runs may have ended by then.
        """
        return time_ns if self._seen_ns is None else max(time_ns, self._seen_ns)

    def step(self, rung: int, time_ns: int) -> list[Step]:
        """Report the rung the operating point is on; return the changes up to and at that time."""
        steps = self._settle(time_ns, at_end=False)
        self._asked = rung
        for k in range(1, len(LADDER)):
            if (rung >= k) == (self.rung >= k):
                self._since[k] = None
            elif self._since[k] is None:
                self._since[k] = time_ns
        return steps + self._settle(time_ns, at_end=True)

    def advance(self, time_ns: int) -> list[Step]:
        """Let time pass; return the changes that fell due before it."""
        return self._settle(time_ns, at_end=False)

    def _settle(self, time_ns: int, at_end: bool) -> list[Step]:
        steps = []
        while (due := self._next_due()) is not None and (
            due < time_ns or (at_end and due == time_ns)
        ):
            steps.append(self._change(due))
        self._seen_ns = time_ns
        return steps

    def _due(self, k: int) -> int | None:
        since = self._since[k]
        if since is None:
            return None
        rising = self._asked >= k
        delay = self.config.on_delay_ns if rising else self.config.off_delay_ns
        return self.not_past(since + delay)

    def _next_due(self) -> int | None:
        if self._since == _SETTLED:
            return None
        dues = [due for k in range(1, len(LADDER)) if (due := self._due(k)) is not None]
        return min(dues, default=None)

    def _change(self, due: int) -> Step:
        ripe = [k for k in range(1, len(LADDER)) if self._due(k) == due]
        before = self.rung
        self.rung = max(ripe) if self._asked >= max(ripe) else min(ripe) - 1
        for k in ripe:
            self._since[k] = None
        return Step(due, before, self.rung)
