# SPDX-License-Identifier: Apache-2.0
"""Puts the monitor's verdicts on the recorder's clock, which is that of the truth.

The monitor's time is that of the samples, and a sensor's clock may be wrong or jump. For a lead
it counts when a warning could be noticed: a change at a sample came when the recorder got that
sample; one that fell due between two samples came as long before the second as the samples' clock
says, and not before the first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip_monitor.arrays import IntArray
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.signals import Stream
from stickslip_monitor.offline.follow import WholeBag


def scan_on_recorder_clock(whole: WholeBag, config: BearingConfig) -> Scan:
    """The verdicts on one bearing of a bag, with times of the recorder."""
    own = whole.bearings[config.name]
    return on_recorder_clock(own.stream, own.arrival_ns, own.scan)


def on_recorder_clock(stream: Stream, log_time_ns: IntArray, scan: Scan) -> Scan:
    """The verdicts of a scan of a whole recording, with times of the recorder.

    Args:
        stream: The samples that were scanned, m of them.
        log_time_ns: When the recorder got each, not falling, shape (m,) [ns].
        scan: Their scan.

    Returns:
        The scan with other ``time_ns``, ``until_ns`` and times of events; where the samples bear
        the recorder's time already, it itself.
    """
    if np.array_equal(stream.time_ns, log_time_ns):
        return scan
    time = log_time_ns[scan.sample]
    until = time + (scan.until_ns - scan.time_ns)
    # A point that held until the next one still does.
    joined = scan.until_ns[:-1] == scan.time_ns[1:]
    until[:-1] = np.where(joined, time[1:], np.minimum(until[:-1], time[1:]))
    events = [
        replace(event, time_ns=_log_time(event.time_ns, k, log_time_ns, scan))
        for event, k in zip(scan.events, scan.at, strict=True)
    ]
    return replace(scan, time_ns=time, until_ns=until, events=events)


def _log_time(time_ns: int, k: int, log_time_ns: IntArray, scan: Scan) -> int:
    """When the recorder's clock said what the monitor's time was, about sample ``k`` [ns]."""
    there = int(log_time_ns[k]) + time_ns - int(scan.now_ns[k])
    return max(there, int(log_time_ns[k - 1])) if k else there
