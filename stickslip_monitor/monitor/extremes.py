# SPDX-License-Identifier: Apache-2.0
"""The worst moments of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import Assessment
from stickslip_monitor.monitor.points import at_index
from stickslip_monitor.monitor.scan import Scan


@dataclass(frozen=True, slots=True)
class Extreme:
    """The worst value of a quantity in a recording, and the operating point it came from."""

    time_ns: int
    value: float
    point: Assessment


def worst(scan: Scan) -> dict[str, Extreme]:
    """The least Hopf and fold margin, and the greatest amplitude while stick-slip is predicted.

    Args:
        scan: The verdicts on one bearing.

    Returns:
        The moments by name; a quantity that never had a value is absent.
    """
    point = scan.assessment
    sticking_amplitude = np.where(scan.sticking, point.amplitude, np.nan)
    columns: dict[str, NDArray[np.float64]] = {
        'hopf_margin': np.where(np.isfinite(point.hopf_margin), point.hopf_margin, np.nan),
        'fold_margin': np.where(np.isfinite(point.fold_margin), point.fold_margin, np.nan),
        'amplitude': -sticking_amplitude,
    }
    found = {}
    for name, column in columns.items():
        if not np.all(np.isnan(column)):
            i = int(np.nanargmin(column))
            value = float(abs(column[i]) if name == 'amplitude' else column[i])
            found[name] = Extreme(int(scan.time_ns[i]), value, at_index(point, i))
    return found
