# SPDX-License-Identifier: Apache-2.0
"""Taking single operating points out of an assessment of arrays."""

from __future__ import annotations

from dataclasses import fields

from stickslip_monitor.monitor.assessment import Assessment

_NAMES = tuple(field.name for field in fields(Assessment))


def at_index(points: Assessment, index: int) -> Assessment:
    """The assessment of scalars at an index of a one-dimensional assessment."""
    return Assessment(**{name: getattr(points, name)[index].item() for name in _NAMES})
