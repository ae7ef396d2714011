# SPDX-License-Identifier: Apache-2.0
"""Taking single operating points out of an assessment of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import COLUMNS, Assessment


def at_indices(points: Assessment, rows: NDArray[np.intp]) -> Assessment:
    """The assessment of arrays at some indices of a one-dimensional assessment."""
    columns = {name: getattr(points, name)[rows] for name in COLUMNS}
    return Assessment(**columns, _bearing=points._bearing)


def at_index(points: Assessment, index: int) -> Assessment:
    """The assessment of scalars at an index of a one-dimensional assessment."""
    numbers = {name: getattr(points, name)[index].item() for name in COLUMNS}
    return Assessment(**numbers, _bearing=points._bearing)
