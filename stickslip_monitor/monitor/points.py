# SPDX-License-Identifier: Apache-2.0
"""Taking single operating points out of an assessment of arrays."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import Assessment

_NAMES = tuple(field.name for field in fields(Assessment))


def at_indices(points: Assessment, rows: NDArray[np.intp]) -> Assessment:
    """The assessment of arrays at some indices of a one-dimensional assessment."""
    return Assessment(**{name: getattr(points, name)[rows] for name in _NAMES})


def at_index(points: Assessment, index: int) -> Assessment:
    """The assessment of scalars at an index of a one-dimensional assessment."""
    return Assessment(**{name: getattr(points, name)[index].item() for name in _NAMES})
