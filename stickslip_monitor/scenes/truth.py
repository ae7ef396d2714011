# SPDX-License-Identifier: Apache-2.0
"""The truth of a scene: what no sensor of a ship could tell, on topics that no monitor reads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .signals import FloatArray, IntArray

ROOT = '/truth'
EVENT_SCHEMA = 'stickslip_monitor/truth/1'
FLOAT64 = 'std_msgs/msg/Float64'
BOOL = 'std_msgs/msg/Bool'
STRING = 'std_msgs/msg/String'


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """Messages of one truth topic over a stretch of time.

    Attributes:
        topic: The topic.
        type: Its message type: of a number, a truth value or a text.
        time: When, not falling, shape (n,) [s since the scene's start].
        values: What, n of them.
    """

    topic: str
    type: str
    time: FloatArray
    values: Sequence[Any] | FloatArray

    def stamps(self, start_ns: int) -> IntArray:
        """Log times [ns] in a scene that starts at ``start_ns``."""
        return start_ns + np.rint(self.time * 1e9).astype(np.int64)


def topic(bearing: str, name: str) -> str:
    """The truth topic of a bearing."""
    return f'{ROOT}/{bearing}/{name}'


def event_text(bearing: str, event: str, time_ns: int, **more: float) -> str:
    """An event of the lining as JSON; docs/interfaces.md has the schema."""
    record = {'schema': EVENT_SCHEMA, 'bearing': bearing, 'event': event, 'time': time_ns}
    return json.dumps(record | more)
