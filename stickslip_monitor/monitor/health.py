# SPDX-License-Identifier: Apache-2.0
"""The state of the node itself, and the words for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from stickslip_monitor.errors import plural
from stickslip_monitor.monitor.ladder import Level

NOT_MONITORING = 'Not monitoring: the node is not active.'
DOUBLE = 'Another node has the same full name: services and parameters reach either of them.'
CLOCKS = 'Several nodes publish /clock, so time jumps to and fro:'
FAILURE_PERIOD = 60.0
"""For so long [s] a failure is what the node has to say."""
NODE_STATUS = 'the node'
"""Stands for the bearing in the name of the node's own status."""


@dataclass(frozen=True, slots=True)
class DiagnosticRecord:
    """The fields of a ``diagnostic_msgs/DiagnosticStatus``, without ROS."""

    level: Level
    name: str
    hardware_id: str
    message: str
    values: dict[str, str]


@dataclass(slots=True)
class NodeHealth:
    """How the node itself is."""

    monitoring: bool = False  # it is active
    failures: int = 0  # callbacks that failed and were survived
    last_failure: str = ''  # the text of the last of them, with its time
    failing: bool = False  # it was within the last minute
    lost: int = 0  # messages that are missing by the numbers of their publishers
    left_out: int = 0  # messages that came to nothing because the node was held up or busy
    losing: bool = False  # the last of these was within a minute
    double: bool = False  # another node has the same full name
    clocks: str = ''  # who publishes simulated time, where it is more than one
    delays: int = 0  # how often the node was held up
    longest_delay: float = 0.0  # for how long at most [s]
    state_file_fault: str = ''  # why the alarms are not kept
    clip_fault: str = ''  # why the last event clip is lost
    changed: dict[str, tuple[Any, Any]] = field(default_factory=dict)
    """What was changed over ROS and not acknowledged: value before and now, by parameter."""
    _failed_at: float = math.inf
    _failures_seen: int = 0

    def age(self, steady: float) -> None:
        """Let time pass, once a second: a failure that has passed is no standing error [s]."""
        if self.failures > self._failures_seen:
            self._failures_seen, self._failed_at = self.failures, steady
        self.failing = bool(self.failures) and steady - self._failed_at < FAILURE_PERIOD

    def change(self, name: str, before: Any, after: Any) -> None:
        """Take note that a parameter was changed; one that is as it was needs no attention."""
        before = self.changed.pop(name, (before,))[0]
        if before != after:
            self.changed[name] = before, after

    @property
    def level(self) -> Level:
        """ERROR where something is not done that was asked for."""
        if self.failing or self.state_file_fault or self.clip_fault:
            return Level.ERROR
        doubtful = self.losing or self.double or self.clocks or self.changed
        return Level.WARN if doubtful or not self.monitoring else Level.OK

    @property
    def losses(self) -> str:
        """What came to nothing, and whose fault it is; empty where nothing has."""
        parts = (
            f'{plural(self.lost, "message")} lost on the way to the node' if self.lost else '',
            f'{plural(self.left_out, "message")} left out while the node was too busy'
            if self.left_out
            else '',
        )
        return ', '.join(part for part in parts if part)

    @property
    def message(self) -> str:
        """What there is to say, the worst first."""
        failures = f'{plural(self.failures, "callback")} failed, last {self.last_failure}'
        sentences = [
            failures if self.failing else '',
            self.state_file_fault,
            self.clip_fault,
            '' if self.monitoring else NOT_MONITORING,
            DOUBLE if self.double else '',
            self.clocks and f'{CLOCKS} {self.clocks}.',
            f'{self.losses}, some in the last minute.' if self.losing else '',
            f'Changed over ROS and not acknowledged: {self.changes}.' if self.changed else '',
        ]
        return ' '.join(text for text in sentences if text) or 'Monitoring.'

    @property
    def changes(self) -> str:
        """What was changed over ROS and not acknowledged."""
        items = self.changed.items()
        return ', '.join(f'{name} from {before!r} to {now!r}' for name, (before, now) in items)


def health_record(node: str, health: NodeHealth) -> DiagnosticRecord:
    """The diagnostic status of the node of that full name, without the leading slash."""
    return DiagnosticRecord(
        level=health.level,
        name=f'{node}: {NODE_STATUS}',
        hardware_id=node,
        message=health.message,
        values={
            'state': 'active' if health.monitoring else 'inactive',
            'callbacks failed': str(health.failures),
            'last failure': health.last_failure or 'none',
            'messages lost on the way': str(health.lost),
            'messages left out': str(health.left_out),
            'times held up': str(health.delays),
            'longest time held up [s]': f'{health.longest_delay:.3g}',
            'parameters changed': health.changes or 'none',
            'state file': health.state_file_fault or 'fine',
            'event clips': health.clip_fault or 'fine',
        },
    )
