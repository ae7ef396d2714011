# SPDX-License-Identifier: Apache-2.0
"""The words of the monitor: severities, conditions, and what a measured level says."""

from __future__ import annotations

from enum import Enum, IntEnum
from inspect import get_annotations
from typing import TypeVar

NOT_MONITORING = 'Not monitoring: the node is not active.'

_Word = TypeVar('_Word', bound='WordEnum')


class WordEnum(str, Enum):
    """A word; each member carries what its class declares, its sentence as a rule."""

    def __new__(cls: type[_Word], word: str, *facts: object) -> _Word:
        """Make a member from its word and its facts."""
        member = str.__new__(cls, word)
        member._value_ = word
        for fact, value in zip(get_annotations(cls), facts, strict=True):
            setattr(member, fact, value)
        return member

    def __str__(self) -> str:
        return str(self.value)


class Severity(IntEnum):
    """Severity, with the values of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


class Condition(WordEnum):
    """Conditions of a bearing."""

    severity: Severity
    sentence: str

    NORMAL = 'normal', Severity.OK, 'No stick-slip predicted.'
    VIBRATION = (
        'vibration',
        Severity.WARN,
        'Vibration is measured where none is predicted: the parameters may have changed, it is'
        ' something else, or the threshold is too low.',
    )
    CAUTION = 'caution', Severity.WARN, 'Near the stick-slip boundary.'
    BISTABLE = ('bistable', Severity.WARN, 'In the bistable range: a shock can start stick-slip.')
    STICK_SLIP = 'stick_slip', Severity.ERROR, 'Stick-slip predicted.'
    AMPLITUDE = 'amplitude_limit', Severity.ERROR, 'Stick-slip predicted above the amplitude limit.'
    INPUT_STALE = 'input_stale', Severity.ERROR, 'An input is lost: nothing can be predicted.'


CONDITIONS = tuple(Condition)
"""The conditions as the rule numbers them."""
# Vibration that the model does not explain hides nothing that the model says.
LADDER = CONDITIONS[:-1]
"""Those of the operating point, in rising order of trouble."""


class Measured(WordEnum):
    """Verdict of the level on the lining."""

    UNKNOWN = 'unknown'
    QUIET = 'quiet'
    VIBRATING = 'vibrating'


MEASURED = tuple(Measured)


class Unknown(WordEnum):
    """Reasons why the level says nothing, each as a clause."""

    sentence: str

    NOTHING = 'nothing', 'no level has come'
    LOST = 'lost', 'the level is lost'
    STUCK = 'stuck', 'the level never changes: its sensor is stuck'
    LOUD = 'loud', 'the level is high where no stick-slip can exist: it shows something else'
    OTHER = 'other', 'another bearing vibrates more: it is what is heard'
    SHORT = 'short', 'the level has not been above or below its threshold for long enough'
