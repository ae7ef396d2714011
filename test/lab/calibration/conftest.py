# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stickslip_monitor.lab.calibration.evidence import BIN_NS, TelemetryBins, VibrationReport
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
RPM = BEARING.speed.factor('rpm')
# The reference lining at 1 kN begins below its Hopf speed of 30.7 rpm, and ends at 40.7.
ONSET, END = 26.0, 41.0


@pytest.fixture
def coast() -> Callable[..., tuple[TelemetryBins, list[VibrationReport]]]:
    """A slow passage from 60 rpm to 20 and back, and what a level says of it."""

    def make(number: int = 0, load: float = 1000.0) -> tuple[TelemetryBins, list[VibrationReport]]:
        second = np.arange(400)
        rpm = 20.0 + 0.2 * np.abs(second - 200)
        time = number * 10**12 + second * BIN_NS + BIN_NS // 2
        # At other loads the same curves of the reference bearing, roughly.
        scale = (load / 1000.0) ** 0.75
        course = TelemetryBins(f'bag {number}', time, rpm * scale * RPM, np.full(400, load))
        begin, end = (int(time[0]), int(time[-1]))
        on = int(time[round((60.0 - ONSET) / 0.2)])
        off = int(time[round(200 + (END - 20.0) / 0.2)])
        edges = [(begin, on, False), (on, off, True), (off, end, False)]
        return course, [
            VibrationReport('aft', a, b, squeal, 2.0, 0.99, f'report {number}.{k}')
            for k, (a, b, squeal) in enumerate(edges)
        ]

    return make
