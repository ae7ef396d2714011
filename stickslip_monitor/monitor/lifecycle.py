# SPDX-License-Identifier: Apache-2.0
"""The life of one alarm: states, what can happen, and one table of transitions.

The states are those of ANSI/ISA-18.2 and IEC 62682, whose letters they carry, but for one: an
alarm that latches and is not yet acknowledged waits as returned-unacknowledged, so that a latched
alarm is always an acknowledged one.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from stickslip_monitor.monitor.word import Word


class State(str, Enum):
    """Where an alarm is in its life."""

    letter: str
    sentence: str

    def __new__(cls, name: str, letter: str, sentence: str) -> State:
        """Make a member from its name, its letter in ISA-18.2 and its sentence."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.letter = letter
        member.sentence = sentence
        return member

    NORMAL = 'normal', 'A', 'The cause is absent, and nothing waits for anybody.'
    UNACKNOWLEDGED = 'unacknowledged', 'B', 'The cause is there and nobody has acknowledged it.'
    ACKNOWLEDGED = 'acknowledged', 'C', 'The cause is there and somebody knows.'
    RETURNED = (
        'returned_unacknowledged',
        'D, E',
        'The cause came and went and nobody has acknowledged it.',
    )
    LATCHED = 'latched', 'F', 'The cause is gone and acknowledged; the alarm waits for its reset.'
    SHELVED = 'shelved', 'G', 'Put aside by somebody until a set time.'
    SUPPRESSED = 'suppressed', 'H', 'Kept quiet by design: here the cause means nothing.'
    OUT_OF_SERVICE = 'out_of_service', 'I', 'Taken out of service until somebody restores it.'

    def __str__(self) -> str:
        return self.value


class Trigger(Word):
    """What can happen to an alarm; each member carries its sentence."""

    RAISE = 'raise', 'the cause has come'
    CLEAR = 'clear', 'the cause has gone'
    SUPPRESS = 'suppress', 'a reason for suppression holds'
    UNSUPPRESS = 'unsuppress', 'no reason for suppression holds any longer'
    ACKNOWLEDGE = 'acknowledge', 'somebody has taken note'
    RESET = 'reset', 'somebody has released the latch'
    SHELVE = 'shelve', 'somebody has put it aside'
    UNSHELVE = 'unshelve', 'somebody has taken it back, or its time has passed'
    REMOVE = 'remove', 'somebody has taken it out of service'
    RESTORE = 'restore', 'somebody has returned it to service'


class Facts(NamedTuple):
    """What a transition may depend on.

    Attributes:
        suppressed: A reason for suppression by design holds.
        covered: The cause is there, and a worse alarm of the same ladder is there and on show.
        active: The cause is there.
        held: The alarm latches, and its cause has been there since its last reset.
    """

    suppressed: bool = False
    covered: bool = False
    active: bool = False
    held: bool = False


Choice = tuple[str, State]
ALWAYS = ''

_AGAIN: tuple[Choice, ...] = (
    ('covered', State.ACKNOWLEDGED),
    ('active', State.UNACKNOWLEDGED),
)
_ASIDE: tuple[Choice, ...] = (('suppressed', State.SUPPRESSED),)
_HELD: tuple[Choice, ...] = (('held', State.RETURNED),)
_BACK: tuple[Choice, ...] = ((ALWAYS, State.NORMAL),)
_COME: tuple[Choice, ...] = (
    ('covered', State.ACKNOWLEDGED),
    (ALWAYS, State.UNACKNOWLEDGED),
)
_DONE: tuple[Choice, ...] = (('held', State.LATCHED), (ALWAYS, State.NORMAL))
_SHELF: tuple[Choice, ...] = ((ALWAYS, State.SHELVED),)
_AWAY: tuple[Choice, ...] = ((ALWAYS, State.OUT_OF_SERVICE),)

# State and trigger lead to the first choice whose fact holds. What is not in the table does not
# change the state, and a person's action that is not in it is refused.
#
# Suppression takes no alarm away that waits for somebody, whether unacknowledged or latched; but
# while it holds, none of them is raised.
TABLE: dict[tuple[State, Trigger], tuple[Choice, ...]] = {
    (State.NORMAL, Trigger.RAISE): _COME,
    (State.NORMAL, Trigger.SUPPRESS): ((ALWAYS, State.SUPPRESSED),),
    (State.NORMAL, Trigger.SHELVE): _SHELF,
    (State.NORMAL, Trigger.REMOVE): _AWAY,
    (State.UNACKNOWLEDGED, Trigger.CLEAR): ((ALWAYS, State.RETURNED),),
    (State.UNACKNOWLEDGED, Trigger.ACKNOWLEDGE): ((ALWAYS, State.ACKNOWLEDGED),),
    (State.UNACKNOWLEDGED, Trigger.SHELVE): _SHELF,
    (State.UNACKNOWLEDGED, Trigger.REMOVE): _AWAY,
    (State.ACKNOWLEDGED, Trigger.CLEAR): _DONE,
    (State.ACKNOWLEDGED, Trigger.SUPPRESS): (
        ('held', State.ACKNOWLEDGED),
        (ALWAYS, State.SUPPRESSED),
    ),
    (State.ACKNOWLEDGED, Trigger.SHELVE): _SHELF,
    (State.ACKNOWLEDGED, Trigger.REMOVE): _AWAY,
    (State.RETURNED, Trigger.RAISE): (
        ('suppressed', State.RETURNED),
        (ALWAYS, State.UNACKNOWLEDGED),
    ),
    (State.RETURNED, Trigger.UNSUPPRESS): (('active', State.UNACKNOWLEDGED),),
    (State.RETURNED, Trigger.ACKNOWLEDGE): _DONE,
    (State.RETURNED, Trigger.SHELVE): _SHELF,
    (State.RETURNED, Trigger.REMOVE): _AWAY,
    (State.LATCHED, Trigger.RAISE): (('suppressed', State.LATCHED), *_COME),
    (State.LATCHED, Trigger.UNSUPPRESS): _AGAIN,
    (State.LATCHED, Trigger.RESET): _BACK,
    (State.LATCHED, Trigger.REMOVE): _AWAY,
    (State.SHELVED, Trigger.UNSHELVE): (*_ASIDE, *_AGAIN, *_HELD, *_BACK),
    (State.SHELVED, Trigger.REMOVE): _AWAY,
    (State.SUPPRESSED, Trigger.UNSUPPRESS): (*_AGAIN, *_BACK),
    (State.SUPPRESSED, Trigger.SHELVE): _SHELF,
    (State.SUPPRESSED, Trigger.REMOVE): _AWAY,
    (State.OUT_OF_SERVICE, Trigger.RESTORE): (*_ASIDE, *_AGAIN, *_BACK),
}


def follow(state: State, trigger: Trigger, facts: Facts) -> State:
    """The state after something happened; the same one where the table has no row for it."""
    for fact, target in TABLE.get((state, trigger), ()):
        if fact == ALWAYS or getattr(facts, fact):
            return target
    return state
