# SPDX-License-Identifier: Apache-2.0
"""Events and assessments as plain records for JSON, the same live and offline."""

from __future__ import annotations

import math
from typing import Any

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
    'threshold_amplitude',
)


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
