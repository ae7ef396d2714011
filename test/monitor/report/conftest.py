# SPDX-License-Identifier: Apache-2.0
"""Courses of a bearing for the tests of what a report says of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from made_logs import START
from sending import points
from shared import CONFIG as REFERENCE_FILE

from stickslip_monitor import Monitor
from stickslip_monitor.monitor.assessment import REGIMES
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.offline.check import BearingReport
from stickslip_monitor.offline.extremes import Extremes, condition_intervals
from stickslip_monitor.report.summary import Course

CONFIG = load_config(REFERENCE_FILE)


@pytest.fixture
def course() -> Callable[..., Course]:
    """Makes the course of shaft speeds [rpm] at one sample a second and 1000 N."""

    def make(speeds: Sequence[float], seconds: int | None = None) -> Course:
        stream = points(speeds, 1000.0, start_ns=START)
        end = START + (len(speeds) if seconds is None else seconds) * 10**9
        scan = Monitor(CONFIG).scan({'aft_stern': stream}, START, end)['aft_stern']
        parts, extremes = condition_intervals(scan.events, START, end), Extremes()
        extremes.take(scan)
        totals = dict(zip(REGIMES, (extremes.lasting_ns * 1e-9).tolist(), strict=True))
        item = BearingReport(
            'aft_stern', scan.events, scan.time_ns.size, totals, extremes.worst, (), outline=scan
        )
        return Course(CONFIG.bearings[0], item, parts)

    return make
