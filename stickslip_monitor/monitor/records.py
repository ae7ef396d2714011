# SPDX-License-Identifier: Apache-2.0
"""Events and verdicts as what is published and written, the same live and offline."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from stickslip_monitor.monitor.assessment import Assessment
from stickslip_monitor.monitor.verdict import Event

WARNING_SCHEMA = 'stickslip_monitor/warning/1'
_POINT_FIELDS = (
    'speed',
    'load',
    'hopf_speed',
    'fold_speed',
    'hopf_margin',
    'fold_margin',
    'growth_rate',
    'amplitude',
    'amplitude_exact',
    'amplitude_error',
    'threshold_amplitude',
)
VERDICT_NUMBERS = ('amplitude', 'amplitude_exact', 'hopf_margin', 'fold_margin')
"""The numbers of a verdict that have a topic of their own, by the topic's last part."""


def output_topics(bearings: Iterable[str], node: str) -> dict[str, str]:
    """The topics of a node of that full name, with their message types, in order.

    Args:
        bearings: Names of the bearings.
        node: The node's full name, ``/stickslip_monitor`` say.
    """
    topics: dict[str, str] = {}
    for bearing in bearings:
        topics |= {f'{node}/{bearing}/{name}': 'std_msgs/msg/Float64' for name in VERDICT_NUMBERS}
        topics[f'{node}/{bearing}/regime'] = 'std_msgs/msg/String'
    return topics | {
        f'{node}/warnings': 'std_msgs/msg/String',
        '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    }


def verdict_numbers(point: Assessment) -> dict[str, Any]:
    """What the topics of :data:`VERDICT_NUMBERS` say, in their order.

    Args:
        point: An assessment of scalars, or of arrays.

    Returns:
        Numbers of the assessment's shape by topic; an amplitude is 0 where no cycle exists.
    """
    amplitudes = (np.where(np.isnan(a), 0.0, a) for a in (point.amplitude, point.amplitude_exact))
    numbers = (*amplitudes, point.hopf_margin, point.fold_margin)
    return dict(zip(VERDICT_NUMBERS, numbers, strict=True))


def number(value: float) -> float | None:
    """A float for JSON, which has no infinity and no NaN."""
    return value if math.isfinite(value) else None


def point_record(point: Assessment | None) -> dict[str, Any]:
    """Regime, outcome and numbers of an assessment of scalars; all ``None`` without one."""
    if point is None:
        return dict.fromkeys(('regime', 'outcome', *_POINT_FIELDS))
    return {
        'regime': point.regime.value,
        'outcome': point.outcome.value,
        **{name: number(getattr(point, name)) for name in _POINT_FIELDS},
    }


def event_record(event: Event) -> dict[str, Any]:
    """One event; the fields are documented in docs/interfaces.md."""
    return {
        'schema': WARNING_SCHEMA,
        'bearing': event.bearing,
        'time': event.time_ns,
        'from': event.before.value,
        'to': event.after.value,
        'level': event.after.level.name,
        'reason': event.after.value,
        'sticking': event.sticking,
        **point_record(event.assessment),
        'input_age': {name: number(age) for name, age in event.lost.items()},
        'text': event.text,
    }


def event_json(event: Event) -> str:
    """One event as the text of a message."""
    return json.dumps(event_record(event), allow_nan=False)
