# SPDX-License-Identifier: Apache-2.0
"""The life of one alarm: states, what can happen, and one table of transitions.

The states are those of ANSI/ISA-18.2 and IEC 62682, whose letters they carry, but for one: an
alarm that latches and is not yet acknowledged waits as returned-unacknowledged, so that a latched
alarm is always an acknowledged one.
"""

from __future__ import annotations

from typing import NamedTuple

from stickslip_monitor.monitor.ladder import SentenceEnum


class AlarmState(SentenceEnum):
    """Where an alarm is in its life, with its letter in ISA-18.2."""

    letter: str

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


class Trigger(SentenceEnum):
    """What can happen to an alarm."""

    RAISE = 'raise', 'the cause has come'
    RECUR = 'recur', 'stick-slip has begun anew while its alarm stands'
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
    """What a transition may depend on."""

    suppressed: bool = False  # a reason for suppression by design holds
    covered: bool = False  # the cause and a worse alarm of the same ladder are there, on show
    active: bool = False  # the cause is there
    held: bool = False  # the alarm latches, and its cause has been there since its last reset


Choice = tuple[str, AlarmState]
ALWAYS = ''

_AGAIN = (('covered', AlarmState.ACKNOWLEDGED), ('active', AlarmState.UNACKNOWLEDGED))
_ASIDE = (('suppressed', AlarmState.SUPPRESSED),)
_HELD = (('held', AlarmState.RETURNED),)
_BACK = ((ALWAYS, AlarmState.NORMAL),)
_COME = (('covered', AlarmState.ACKNOWLEDGED), (ALWAYS, AlarmState.UNACKNOWLEDGED))
_DONE = (('held', AlarmState.LATCHED), (ALWAYS, AlarmState.NORMAL))
_SHELF = ((ALWAYS, AlarmState.SHELVED),)
_AWAY = ((ALWAYS, AlarmState.OUT_OF_SERVICE),)

# State and trigger lead to the first choice whose fact holds. What is not in the table does not
# change the state, and a person's action that is not in it is refused.
#
# Suppression takes no alarm away that waits for somebody, whether unacknowledged or latched; but
# while it holds, none of them is raised.
TABLE: dict[tuple[AlarmState, Trigger], tuple[Choice, ...]] = {
    (AlarmState.NORMAL, Trigger.RAISE): _COME,
    (AlarmState.NORMAL, Trigger.SUPPRESS): ((ALWAYS, AlarmState.SUPPRESSED),),
    (AlarmState.NORMAL, Trigger.SHELVE): _SHELF,
    (AlarmState.NORMAL, Trigger.REMOVE): _AWAY,
    (AlarmState.UNACKNOWLEDGED, Trigger.CLEAR): ((ALWAYS, AlarmState.RETURNED),),
    (AlarmState.UNACKNOWLEDGED, Trigger.ACKNOWLEDGE): ((ALWAYS, AlarmState.ACKNOWLEDGED),),
    (AlarmState.UNACKNOWLEDGED, Trigger.SHELVE): _SHELF,
    (AlarmState.UNACKNOWLEDGED, Trigger.REMOVE): _AWAY,
    (AlarmState.ACKNOWLEDGED, Trigger.RECUR): (
        ('suppressed', AlarmState.ACKNOWLEDGED),
        ('active', AlarmState.UNACKNOWLEDGED),
    ),
    (AlarmState.ACKNOWLEDGED, Trigger.CLEAR): _DONE,
    (AlarmState.ACKNOWLEDGED, Trigger.SUPPRESS): (
        ('held', AlarmState.ACKNOWLEDGED),
        (ALWAYS, AlarmState.SUPPRESSED),
    ),
    (AlarmState.ACKNOWLEDGED, Trigger.SHELVE): _SHELF,
    (AlarmState.ACKNOWLEDGED, Trigger.REMOVE): _AWAY,
    (AlarmState.RETURNED, Trigger.RAISE): (
        ('suppressed', AlarmState.RETURNED),
        (ALWAYS, AlarmState.UNACKNOWLEDGED),
    ),
    (AlarmState.RETURNED, Trigger.UNSUPPRESS): (('active', AlarmState.UNACKNOWLEDGED),),
    (AlarmState.RETURNED, Trigger.ACKNOWLEDGE): _DONE,
    (AlarmState.RETURNED, Trigger.SHELVE): _SHELF,
    (AlarmState.RETURNED, Trigger.REMOVE): _AWAY,
    (AlarmState.LATCHED, Trigger.RAISE): (('suppressed', AlarmState.LATCHED), *_COME),
    (AlarmState.LATCHED, Trigger.UNSUPPRESS): _AGAIN,
    (AlarmState.LATCHED, Trigger.RESET): _BACK,
    (AlarmState.LATCHED, Trigger.REMOVE): _AWAY,
    (AlarmState.SHELVED, Trigger.UNSHELVE): (*_ASIDE, *_AGAIN, *_HELD, *_BACK),
    (AlarmState.SHELVED, Trigger.REMOVE): _AWAY,
    (AlarmState.SUPPRESSED, Trigger.UNSUPPRESS): (*_AGAIN, *_BACK),
    (AlarmState.SUPPRESSED, Trigger.SHELVE): _SHELF,
    (AlarmState.SUPPRESSED, Trigger.REMOVE): _AWAY,
    (AlarmState.OUT_OF_SERVICE, Trigger.RESTORE): (*_ASIDE, *_AGAIN, *_BACK),
}


def follow(state: AlarmState, trigger: Trigger, facts: Facts) -> AlarmState:
    """The state after something happened; the same one where the table has no row for it."""
    for fact, target in TABLE.get((state, trigger), ()):
        if fact == ALWAYS or getattr(facts, fact):
            return target
    return state
