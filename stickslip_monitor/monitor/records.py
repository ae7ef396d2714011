# SPDX-License-Identifier: Apache-2.0
"""Events and verdicts as what is published and written, the same live and offline."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from stickslip_monitor.monitor.assessment import Assessment
from stickslip_monitor.monitor.points import joined
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
# Fewer than make a surface of cycles worth building: that would take a second, and let what one
# recording's numbers are, in the seventh digit, depend on those checked before it.
_TOGETHER = 2048
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
    return _point_record(point, [getattr(point, name) for name in _POINT_FIELDS])


def _point_record(point: Assessment, numbers: Sequence[float]) -> dict[str, Any]:
    return {
        'regime': point.regime.value,
        'outcome': point.outcome.value,
        **{name: number(value) for name, value in zip(_POINT_FIELDS, numbers, strict=True)},
    }


def event_record(event: Event) -> dict[str, Any]:
    """One event; the fields are documented in docs/interfaces.md."""
    return _event_record(event, point_record(event.assessment))


def event_records(events: Sequence[Event]) -> list[dict[str, Any]]:
    """Events of one bearing; their numbers are worked out together."""
    known = [event.assessment for event in events if event.assessment is not None]
    rows = (
        row
        for start in range(0, len(known), _TOGETHER)
        for row in _numbers(joined(known[start : start + _TOGETHER]))
    )
    records = []
    for event in events:
        point = event.assessment
        own = point_record(None) if point is None else _point_record(point, next(rows))
        records.append(_event_record(event, own))
    return records


def _numbers(points: Assessment) -> Iterator[Sequence[float]]:
    """The numbers of each point of an assessment of arrays."""
    return zip(*(getattr(points, name).tolist() for name in _POINT_FIELDS), strict=True)


def _event_record(event: Event, point: dict[str, Any]) -> dict[str, Any]:
    return {
        'schema': WARNING_SCHEMA,
        'bearing': event.bearing,
        'time': event.time_ns,
        'from': event.before.value,
        'to': event.after.value,
        'level': event.after.level.name,
        'reason': event.after.value,
        'sticking': event.sticking,
        **point,
        'input_age': {name: number(age) for name, age in event.lost.items()},
        'text': event.text,
    }


def event_json(event: Event) -> str:
    """One event as the text of a message."""
    return json.dumps(event_record(event), allow_nan=False)
