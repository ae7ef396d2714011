# SPDX-License-Identifier: Apache-2.0
"""One alarm: its kinds and priority, its states, and one table of transitions.

The states are those of ANSI/ISA-18.2 and IEC 62682, whose letters they carry, but for one: an
alarm that latches and is not yet acknowledged waits as returned-unacknowledged, so that a latched
alarm is always an acknowledged one.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from stickslip_monitor.monitor.severity import LADDER, Condition, WordEnum


class Priority(IntEnum):
    """Urgency of an alarm, in the words of IEC 62923; a caution makes no sound."""

    CAUTION = 1
    WARNING = 2
    ALARM = 3


class AlarmKind(WordEnum):
    """Matter that an alarm of a bearing is about."""

    priority: Priority

    AMPLITUDE_LIMIT = 'amplitude_limit', Priority.ALARM
    STICK_SLIP = 'stick_slip', Priority.ALARM
    BISTABLE = 'bistable', Priority.WARNING
    MARGIN_LOW = 'margin_low', Priority.CAUTION
    INPUT_LOST = 'input_lost', Priority.WARNING
    INPUT_IMPLAUSIBLE = 'input_implausible', Priority.CAUTION
    VIBRATION = 'vibration', Priority.WARNING


RUNG_OF = {
    AlarmKind.AMPLITUDE_LIMIT: LADDER.index(Condition.AMPLITUDE),
    AlarmKind.STICK_SLIP: LADDER.index(Condition.STICK_SLIP),
    AlarmKind.BISTABLE: LADDER.index(Condition.BISTABLE),
    AlarmKind.MARGIN_LOW: LADDER.index(Condition.CAUTION),
}
"""The alarms of the ladder, worst first, and the rung from which each has its cause."""
SUPPRESSIBLE = (*RUNG_OF, AlarmKind.VIBRATION)
"""The alarms that mean nothing at rest and while the shaft starts to turn."""
LATCHING = (AlarmKind.AMPLITUDE_LIMIT, AlarmKind.STICK_SLIP)
"""The alarms of stick-slip itself: they latch where it is configured."""


class AlarmState(WordEnum):
    """State of an alarm, with its letter in ISA-18.2."""

    letter: str

    NORMAL = 'normal', 'A'  # not active, nothing to acknowledge
    UNACKNOWLEDGED = 'unacknowledged', 'B'
    ACKNOWLEDGED = 'acknowledged', 'C'
    RETURNED = 'returned_unacknowledged', 'D, E'  # cleared, not acknowledged
    LATCHED = 'latched', 'F'  # cleared and acknowledged, waits for its reset
    SHELVED = 'shelved', 'G'  # by a person, until a set time
    SUPPRESSED = 'suppressed', 'H'  # by design: the condition has no meaning now
    OUT_OF_SERVICE = 'out_of_service', 'I'  # until a person restores it


class Trigger(WordEnum):
    """Events that change an alarm: its cause, a reason to suppress it, a person, or a timer."""

    RAISE = 'raise'
    RECUR = 'recur'  # stick-slip began anew while its alarm was active
    CLEAR = 'clear'
    SUPPRESS = 'suppress'  # a reason for suppression holds
    UNSUPPRESS = 'unsuppress'
    ACKNOWLEDGE = 'acknowledge'
    RESET = 'reset'
    SHELVE = 'shelve'
    UNSHELVE = 'unshelve'  # by a person, or its time was up
    REMOVE = 'remove'  # out of service
    RESTORE = 'restore'


class Facts(NamedTuple):
    """Facts that a transition may depend on."""

    suppressed: bool = False  # a reason for suppression by design holds
    covered: bool = False  # the cause is there, and a worse alarm of its ladder or a known manoeuvre
    active: bool = False  # the cause is there
    latching: bool = False  # the alarm latches, and its cause has been there since its last reset


# Suppression takes no alarm away that waits for somebody, whether unacknowledged or latched; but
# while it holds, none of them is raised.
LIFE = """\
normal | raise | acknowledged if covered, else unacknowledged
normal | suppress | suppressed
unacknowledged | clear | returned_unacknowledged
unacknowledged | acknowledge | acknowledged
acknowledged | recur | acknowledged if suppressed, unacknowledged if active
acknowledged | clear | latched if latching, else normal
acknowledged | suppress | acknowledged if latching, else suppressed
returned_unacknowledged | raise | returned_unacknowledged if suppressed, else unacknowledged
returned_unacknowledged | unsuppress | unacknowledged if active
returned_unacknowledged | acknowledge | latched if latching, else normal
latched | raise | latched if suppressed, acknowledged if covered, else unacknowledged
latched | unsuppress | acknowledged if covered, unacknowledged if active
latched | reset | normal
shelved | unshelve | suppressed if suppressed, acknowledged if covered, unacknowledged if active, \
returned_unacknowledged if latching, else normal
suppressed | unsuppress | acknowledged if covered, unacknowledged if active, else normal
out_of_service | restore | suppressed if suppressed, acknowledged if covered, unacknowledged if active, \
else normal
normal, unacknowledged, acknowledged, returned_unacknowledged, suppressed | shelve | shelved
normal, unacknowledged, acknowledged, returned_unacknowledged, latched, shelved, suppressed | remove | \
out_of_service
"""
"""States, what happens in them, and what each becomes: the first state whose fact holds. What is not
in the table changes nothing, and a person's action that is not in it is refused."""


def _parse_choices(text: str) -> Iterator[tuple[str, AlarmState]]:
    """Yield fact and state of each choice of a row of :data:`LIFE`, "" for a choice that always holds."""
    for choice in text.split(', '):
        state, _, fact = choice.removeprefix('else ').partition(' if ')
        yield fact, AlarmState(state)


TABLE = {
    (AlarmState(state), Trigger(trigger)): tuple(_parse_choices(choices))
    for states, trigger, choices in (row.split(' | ') for row in LIFE.splitlines())
    for state in states.split(', ')
}
"""The choices of :data:`LIFE`, each a fact of :class:`Facts` and a state; without a fact always."""


def next_state(state: AlarmState, trigger: Trigger, facts: Facts) -> AlarmState:
    """Return the state of an alarm after a trigger, by :data:`TABLE`; the same state without a row there."""
    for fact, target in TABLE.get((state, trigger), ()):
        if not fact or getattr(facts, fact):
            return target
    return state
