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
from stickslip_monitor.monitor.signals import Status, Stream
from stickslip_monitor.offline.follow import WholeBag


def scan_on_recorder_clock(whole: WholeBag, config: BearingConfig) -> Scan:
    """The verdicts on one bearing of a bag, with times of the recorder."""
    own = whole.bearings[config.name]
    return on_recorder_clock(own.stream, own.arrival_ns, own.scan)


def on_recorder_clock(stream: Stream, log_time_ns: IntArray, scan: Scan) -> Scan:
    """The verdicts of a scan of a whole recording, with times of the recorder.

    The recorder got sample k of the stream at ``log_time_ns[k]``, which does not fall. Where the
    samples bear its time already, the scan itself is returned.
    """
    if np.array_equal(stream.time_ns, log_time_ns):
        return scan
    time = log_time_ns[scan.sample]
    until = time + (scan.until_ns - scan.time_ns)
    # A point that held until the next one still does.
    joined = scan.until_ns[:-1] == scan.time_ns[1:]
    until[:-1] = np.where(joined, time[1:], np.minimum(until[:-1], time[1:]))
    believed = np.array([status.believed for status in Status])[scan.status]
    # Until a sample is believed, the monitor's time is that of the start, by the recorder.
    first = int(np.argmax(believed)) if believed.any() else believed.size
    events = [
        event
        if k < first
        else replace(event, time_ns=_log_time(event.time_ns, k, log_time_ns, scan))
        for event, k in zip(scan.events, scan.at, strict=True)
    ]
    return replace(scan, time_ns=time, until_ns=until, events=events)


def _log_time(time_ns: int, k: int, log_time_ns: IntArray, scan: Scan) -> int:
    """When the recorder's clock said what the monitor's time was, about sample ``k`` [ns]."""
    there = int(log_time_ns[k]) + time_ns - int(scan.now_ns[k])
    return max(there, int(log_time_ns[k - 1])) if k else there
