# SPDX-License-Identifier: Apache-2.0
"""The state of the node itself, and the words for it."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.errors import plural
from stickslip_monitor.monitor.ladder import Level

NOT_MONITORING = 'Not monitoring: the node is not active.'
DOUBLE = 'Another node has the same full name: services and parameters reach either of them.'
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
    last_failure: str = ''  # the text of the last of them
    lost: int = 0  # messages that the middleware reports as lost
    missing: int = 0  # messages missing by the stamps of senders whose period is known
    thinned: int = 0  # messages left out because too many waited
    losing: bool = False  # the last of these came to nothing within a minute
    double: bool = False  # another node has the same full name
    delays: int = 0  # how often the node was held up
    longest_delay: float = 0.0  # for how long at most [s]
    state_file_fault: str = ''  # why the alarms are not kept
    clip_fault: str = ''  # why the last event clip is lost

    @property
    def level(self) -> Level:
        """ERROR where something is not done that was asked for."""
        if self.failures or self.state_file_fault or self.clip_fault:
            return Level.ERROR
        doubtful = self.losing or self.double or not self.monitoring
        return Level.WARN if doubtful else Level.OK

    @property
    def gone(self) -> int:
        """Messages that came to nothing."""
        return self.lost + self.missing + self.thinned

    @property
    def message(self) -> str:
        """What there is to say, the worst first."""
        sentences = [
            f'{plural(self.failures, "callback")} failed, last: {self.last_failure}'
            if self.failures
            else '',
            self.state_file_fault,
            self.clip_fault,
            '' if self.monitoring else NOT_MONITORING,
            DOUBLE if self.double else '',
            f'{plural(self.gone, "message")} lost, some in the last minute.'
            if self.losing
            else '',
        ]
        return ' '.join(text for text in sentences if text) or 'Monitoring.'


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
            'messages lost by the middleware': str(health.lost),
            'messages missing by their stamps': str(health.missing),
            'messages left out in a flood': str(health.thinned),
            'times held up': str(health.delays),
            'longest time held up [s]': f'{health.longest_delay:.3g}',
            'state file': health.state_file_fault or 'fine',
            'event clips': health.clip_fault or 'fine',
        },
    )
