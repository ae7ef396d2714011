# SPDX-License-Identifier: Apache-2.0
"""Why an input brings nothing, or what is doubtful about it: one sentence for each fault.

The facts are gathered by whoever has them (the node from the ROS graph, a check from a recording);
the sentences are the same everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stickslip_monitor.monitor.signals import STATUS_SENTENCES, Status


@dataclass(frozen=True, slots=True)
class Publisher:
    """Somebody who publishes on an input's topic.

    Attributes:
        node: Full name of its node.
        type: Its message type.
        qos_fault: Why its quality of service does not match; empty where it does.
    """

    node: str
    type: str
    qos_fault: str = ''


@dataclass(frozen=True, slots=True)
class InputFacts:
    """What is known of one input of one bearing.

    Attributes:
        topic: Its topic, as resolved.
        type: The message type that is configured.
        timeout: Its timeout [s].
        lost: Whether it counts as lost, or has not come yet.
        publishers: Who publishes on the topic; ``None`` where nobody can know.
        heard: Whether believed samples come.
        refused: Why the latest samples were refused; ``None`` where some were believed.
        share: The share of the samples of the last while that were refused.
        reason: Why most of these were; ``None`` where none was.
        without_clock: Whether time follows ``/clock``, which has said nothing yet.
        behind: How far its stamps are behind the other input's [s].
        other: The other input's topic.
        stuck: Whether its value has not changed for minutes, which only a level may not.
        source: What its samples tell of their source; see :mod:`.source_faults`.
    """

    topic: str
    type: str
    timeout: float
    lost: bool
    publishers: Sequence[Publisher] | None = ()
    heard: bool = False
    refused: Status | None = None
    share: float = 0.0
    reason: Status | None = None
    without_clock: bool = False
    behind: float = 0.0
    other: str = ''
    stuck: bool = False
    source: str = ''


MOSTLY = 1.0 / 3.0
"""From this share of refused samples on it is told."""


def input_fault(facts: InputFacts) -> str:
    """The sentence on an input, the most fundamental fault first; empty where there is none."""
    if facts.without_clock:
        return 'use_sim_time is set, but nothing comes on /clock: no sample can be used.'
    if facts.lost and (fault := _sender_fault(facts)):
        return fault
    if facts.heard and facts.behind > facts.timeout:
        return (
            f'Stamps on {facts.topic} are {facts.behind:.3g} s behind those on {facts.other},'
            f" which is more than the timeout of {facts.timeout:g} s: the senders' clocks differ."
        )
    if facts.share >= MOSTLY and facts.reason is not None:
        return (
            f'{facts.share:.0%} of the samples on {facts.topic} are refused, most because:'
            f' {STATUS_SENTENCES[facts.reason]}.'
        )
    if facts.lost and not facts.heard:
        return _silence(facts)
    if facts.stuck:
        return f'The level on {facts.topic} never changes: its sensor is stuck.'
    if len(facts.publishers or ()) > 1:
        return _mixed(facts.publishers or (), facts.topic)
    return f'On {facts.topic}, {facts.source}.' if facts.source else ''


def _silence(facts: InputFacts) -> str:
    if not facts.publishers:
        return f'Nothing arrives of {facts.topic}.'
    return f'{facts.publishers[0].node} publishes on {facts.topic}, but nothing arrives.'


def _mixed(publishers: Sequence[Publisher], topic: str) -> str:
    names = ', '.join(sorted({publisher.node for publisher in publishers}))
    return f'{len(publishers)} publishers send on {topic} ({names}): their values are mixed.'


def _sender_fault(facts: InputFacts) -> str:
    """Why nothing believable can come from those who publish on the topic."""
    topic = facts.topic
    if facts.publishers is None:
        return _all_refused(facts)
    if not facts.publishers:
        return f'Nobody publishes on {topic}.'
    right = [publisher for publisher in facts.publishers if publisher.type == facts.type]
    if not right:
        wrong = facts.publishers[0]
        return f'{wrong.node} publishes {wrong.type} on {topic}, but {facts.type} is configured.'
    if all(publisher.qos_fault for publisher in right):
        return (
            f'The quality of service of {right[0].node} on {topic} does not match:'
            f' {right[0].qos_fault}.'
        )
    return _all_refused(facts)


def _all_refused(facts: InputFacts) -> str:
    if facts.refused is None:
        return ''
    return f'Every sample on {facts.topic} is refused: {STATUS_SENTENCES[facts.refused]}.'


@dataclass(slots=True)
class StampGaps:
    """Counts the messages missing from a sender that stamps them at a steady period.

    The period is known once eight intervals lie within 20 % of one another. A gap counts when the
    old period is seen again after it: a sender that has changed its rate has lost nothing.

    Attributes:
        longest_ns: Longer gaps are an outage, not missing messages [ns].
        missing: Messages missing so far.
    """

    longest_ns: int
    missing: int = 0
    _last_ns: int = 0
    _period_ns: int = 0
    _least_ns: int = 0
    _most_ns: int = 0
    _steady: int = 0
    _suspected: int = 0

    def add(self, time_ns: int) -> None:
        """Take the stamp of the next message."""
        step, self._last_ns = time_ns - self._last_ns, time_ns
        if 0 < step <= self.longest_ns:
            self._learn(step)
        else:
            self._steady = self._suspected = 0
        if not self._period_ns:
            return
        if 2 * step > 3 * self._period_ns:
            if step <= self.longest_ns:
                self._suspected += round(step / self._period_ns) - 1
        elif 2 * step > self._period_ns:
            self.missing += self._suspected
            self._suspected = 0

    def _learn(self, step: int) -> None:
        least, most = min(self._least_ns, step), max(self._most_ns, step)
        if self._steady and 5 * most <= 6 * least:
            self._least_ns, self._most_ns = least, most
            self._steady += 1
        else:
            self._least_ns = self._most_ns = step
            self._steady = 1
        if self._steady >= _KNOWN:
            period = (self._least_ns + self._most_ns) // 2
            if 5 * abs(period - self._period_ns) > self._period_ns:
                self._suspected = 0
            self._period_ns, self._steady = period, 0


_KNOWN = 8
