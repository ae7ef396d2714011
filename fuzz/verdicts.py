# SPDX-License-Identifier: Apache-2.0
"""What a mutant of a voyage must not change in silence: its samples as they were, and the verdict on them."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

from fuzz.voyages import QUIET_RPM, STICKING_RPM, Sample, number_key, samples_in, samples_of, sticking_share
from stickslip_logs.recordings.reader import open_bag
from stickslip_monitor.commands.check import CheckResult, Task, check_one
from stickslip_monitor.errors import StickslipError
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.sample_types import QUANTITIES
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.check import requests_of
from stickslip_monitor.offline.input_binding import bind_at_least_one

ENOUGH = 0.5
"""Share of a voyage's stick-slip from which on there has to be a warning."""
# A line may have two samples.
_OF_LINE = 2
_LINES = re.compile(r'(\d+) lines?\b|zero byte')
_REFUSED = re.compile(r'(\d+) x ')
# Notes on samples that are at other times than written, and that are left out as of another sender or unit.
_MOVED = re.compile(r'was set back|leapt ahead')
_LEFT_OUT = re.compile(r'source .* is left out|lines in .* are left out')


class Reading(NamedTuple):
    """The samples that are read of a mutant, and what is said of them.

    Attributes:
        samples: The samples.
        is_told: Whether something costs exit code 0.
        most_missing: How many samples may be missing by what is said.
        is_moved: Whether samples may be at other times than written.
        count: How many samples there are, of one time or not.
    """

    samples: set[Sample]
    is_told: bool
    most_missing: float
    is_moved: bool
    count: int


def read_voyage(path: Path, config: MonitorConfig) -> Reading:
    """Read the inputs of a bearing.

    Raises:
        StickslipError: There are none, which is said.
    """
    bag = open_bag(path)
    bound = bind_at_least_one(bag, config)
    bearing, absent = bound.config.bearings[0], {of for _, of in bound.absent}
    # What is assumed has the messages of the speed.
    wanted = {
        request: QUANTITIES.index(of)
        for request, (of, source) in zip(requests_of(bearing), bearing.inputs.items(), strict=True)
        if of not in absent and not source.is_assumed
    }
    series_by_request = bag.read(wanted)
    samples, lost = set[Sample](), 0
    for request, series in series_by_request.items():
        rows = zip(series.log_time_ns.tolist(), series.value.tolist(), strict=True)
        # Days have their last digit at some microseconds.
        samples |= {Sample(wanted[request], round(time_ns, -6), number_key(value)) for time_ns, value in rows}
        lost += sum(fault.count for fault in series.faults)
    counts = [_LINES.search(text) for text in bag.losses]
    lost += _OF_LINE * sum(int(match[1] or 0) for match in counts if match)
    is_told = bool(lost or counts or bound.absent or bound.questions)
    is_open = bool(bound.absent or bound.questions) or not all(counts)
    is_open = is_open or any(map(_LEFT_OUT.search, bag.warnings))
    most_missing = math.inf if is_open else lost
    count = sum(series.value.size for series in series_by_request.values())
    return Reading(samples, is_told, most_missing, any(map(_MOVED.search, bag.warnings)), count)


def voyage_fault(path: Path, kind: str, config: MonitorConfig, is_quiet: bool) -> str:
    """Return what is wrong with how a mutant of a voyage is read and judged; empty if nothing is."""
    speeds = QUIET_RPM if is_quiet else STICKING_RPM
    try:
        samples, is_told, most_missing, is_moved, count = read_voyage(path, config)
    except StickslipError:
        return ''
    if kind == 'candump':
        return 'frames of NMEA 2000 are read as something else'
    expected, other_count = samples_in(path, kind, speeds)
    missing, foreign = len(expected - samples), len(samples - samples_of(speeds))
    missing = min(missing, len(expected) - count) if is_moved else missing
    if missing > most_missing and missing > most_missing + _refused_count(check_one(Task(config), path)):
        return f'{missing} of {len(expected)} samples are missing, and at most {most_missing} are told of'
    if foreign > other_count and not (is_told or is_moved or most_missing):
        return f'{foreign} samples are of no line, and {other_count} may be of lines that were changed'
    if is_told or samples == samples_of(speeds):
        return ''
    # The check takes most of the time: it is run where these samples may be judged as they must not be.
    if is_quiet and 0 < foreign <= 2 * _OF_LINE and _has_stick_slip(check_one(Task(config), path)):
        return 'it has stick-slip without a word on its input'
    is_sticking = not (is_quiet or foreign) and sticking_share(samples) >= ENOUGH
    is_clear = is_sticking and check_one(Task(config), path).code == 0
    return 'its stick-slip is an all-clear' if is_clear else ''


def _refused_count(result: CheckResult) -> float:
    """Return how many samples a check refuses, as words or implausible; inf if an input is lost."""
    bearings = result.document.get('bearings', {}).values()
    if any(event['to'] == Condition.INPUT_STALE for item in bearings for event in item['events']):
        return math.inf
    return sum(int(count) for item in bearings for count in _REFUSED.findall(' '.join(item['data'])))


def _has_stick_slip(result: CheckResult) -> bool:
    """Return whether stick-slip is predicted anywhere in a recording."""
    bearings = result.document.get('bearings', {}).values()
    sticking = Condition.STICK_SLIP, Condition.AMPLITUDE
    return any(event['to'] in sticking for bearing in bearings for event in bearing['events'])
