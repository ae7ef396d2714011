# SPDX-License-Identifier: Apache-2.0
"""What a measured level of vibration says of the lining, and why it says nothing."""

from __future__ import annotations

from typing import Any

from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.assessment import SentenceEnum
from stickslip_monitor.monitor.rule_state import NEVER


class Measured(SentenceEnum):
    """What the level says of the lining."""

    UNKNOWN = 'unknown', 'Whether the lining vibrates is not known.'
    QUIET = 'quiet', 'No vibration is measured.'
    VIBRATING = 'vibrating', 'Vibration is measured.'


MEASURED = tuple(Measured)


class Unknown(SentenceEnum):
    """Why the level says nothing; each member carries its clause."""

    NOTHING = 'nothing', 'no level has come'
    LOST = 'lost', 'the level is lost'
    STUCK = 'stuck', 'the level never changes: its sensor is stuck'
    LOUD = 'loud', 'the level is high where no stick-slip can exist: it tells something else'
    ONE_MODE = 'one_mode', 'no threshold is configured, and none has been learned yet'
    SHORT = 'short', 'the level has not been above or below its threshold for long enough'


def why_unknown(s: Any, c: Any) -> Unknown | None:
    """Why the level of a bearing says nothing; ``None`` where it does.

    Args:
        s: The memory.
        c: The settings.
    """
    stamp = s.stamp[rule.LEVEL]
    if stamp == NEVER:
        return Unknown.NOTHING
    if abs(s.now - stamp) > c.timeout[rule.LEVEL]:
        return Unknown.LOST
    if stamp - s.moved > rule.STUCK:
        return Unknown.STUCK
    if s.loud > rule.LOUD:
        return Unknown.LOUD
    if s.vibrating != rule.UNKNOWN:
        return None
    learning = c.threshold != c.threshold and s.watched < rule.LEARNED
    return Unknown.ONE_MODE if learning else Unknown.SHORT
