# SPDX-License-Identifier: Apache-2.0
"""The conditions of an alarm, in rising order of trouble."""

from __future__ import annotations

from enum import Enum, IntEnum


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
    VIBRATION = (
        'vibration',
        Level.WARN,
        'Vibration is measured where no stick-slip is possible: the model does not explain it.',
    )
    CAUTION = 'caution', Level.WARN, 'Close to the stick-slip region.'
    BISTABLE = (
        'bistable',
        Level.WARN,
        'Inside the bistable range: a disturbance can start stick-slip.',
    )
    STICK_SLIP = 'stick_slip', Level.ERROR, 'Stick-slip predicted.'
    AMPLITUDE = 'amplitude_limit', Level.ERROR, 'Stick-slip predicted above the amplitude limit.'
    INPUT_STALE = 'input_stale', Level.ERROR, 'An input is lost: nothing can be predicted.'

    def __str__(self) -> str:
        return str(self.value)


# Vibration that the model does not explain hides nothing that the model says.
LADDER = (
    Condition.NORMAL,
    Condition.VIBRATION,
    Condition.CAUTION,
    Condition.BISTABLE,
    Condition.STICK_SLIP,
    Condition.AMPLITUDE,
)
CONDITIONS = (*LADDER, Condition.INPUT_STALE)
"""The conditions as the rule numbers them."""
