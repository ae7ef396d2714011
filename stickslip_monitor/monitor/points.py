# SPDX-License-Identifier: Apache-2.0
"""Taking single operating points out of an assessment of arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import Assessment


def at_indices(points: Assessment, rows: NDArray[np.intp]) -> Assessment:
    """The assessment of arrays at some indices of a one-dimensional assessment."""
    return _picked(points, lambda column: column[rows])


def at_index(points: Assessment, index: int) -> Assessment:
    """The assessment of scalars at an index of a one-dimensional assessment."""
    return _picked(points, lambda column: column[index].item())


def joined(points: Sequence[Assessment]) -> Assessment:
    """Assessments of scalars, at least one and all of one bearing, as one of arrays."""
    return Assessment(
        np.array([point.speed for point in points]),
        np.array([point.load for point in points]),
        np.array([point.outcome_code for point in points]),
        np.array([point.hopf_speed for point in points]),
        np.array([point.fold_speed for point in points]),
        points[0]._bearing,
    )


def _picked(points: Assessment, pick: Callable[[NDArray[Any]], Any]) -> Assessment:
    return Assessment(
        pick(points.speed),
        pick(points.load),
        pick(points.outcome_code),
        pick(points.hopf_speed),
        pick(points.fold_speed),
        points._bearing,
        _known={name: pick(column) for name, column in points._known.items()},
    )
