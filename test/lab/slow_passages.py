# SPDX-License-Identifier: Apache-2.0
"""Evidence of slow passages, as sensors would tell it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from shared import REFERENCE_BEARING

from stickslip_lab.calibration.calibration import Evidence
from stickslip_lab.calibration.evidence import VibrationReport, bin_telemetry
from stickslip_lab.calibration.level_reports import bin_level

RPM = REFERENCE_BEARING.speed.factor('rpm')
# Where vibration begins on a slow passage, below the Hopf speed of 30.74 rpm, and the fold speed,
# both at 1 kN and by the averaged model in closed form (docs/physics.md).
ONSET, FOLD = 26.0, 40.7231


def slow_passage(
    number: int = 0, rate: float = 0.2, *, by: float = 1.0, level: bool = True, knocks: tuple[float, ...] = ()
) -> Evidence:
    """Return the passage at a rate [rpm/s], all speeds ``by`` a factor, with knocks at seconds."""
    half = 40.0 / rate
    time = np.arange(0.0, 2.0 * half, 0.2)
    rpm = 20.0 + rate * np.abs(time - half)
    on, off = (60.0 - ONSET) / rate, half + (FOLD - 20.0) / rate
    begin = 1e4 * (number + 1)
    stamps = np.round((begin + time) * 1e9).astype(np.int64)
    speed = by * rpm * RPM
    course = bin_telemetry(f'bag {number}', stamps, speed, np.full(time.size, 1000.0))
    if not level:
        edges = [round(1e9 * (begin + t)) for t in (0.0, on, off, 2.0 * half)]
        return Evidence(course.name, (course,), alternating_reports(edges, 'list'))
    noise = np.random.default_rng(number).standard_normal(time.size)
    loud = (time >= on) & (time <= off)
    for knock in knocks:
        loud |= (time >= knock) & (time <= knock + 6.0)
    decibels = 20.0 * np.log10(np.where(loud, speed, 0.05 * FOLD * RPM)) + noise
    level_bins = bin_level(begin + time, decibels, begin + time, speed)
    return Evidence(course.name, (course,), level=level_bins)


def alternating_reports(edges: list[int], source: str, tolerance: float = 2.0) -> tuple[VibrationReport, ...]:
    """Quiet, vibration, quiet ... between some times [ns]."""
    return tuple(
        VibrationReport('aft', a, b, bool(k % 2), tolerance, 0.9, f'{source}, line {k + 1}')
        for k, (a, b) in enumerate(pairwise(edges))
    )
