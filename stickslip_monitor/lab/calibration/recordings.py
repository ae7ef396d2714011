# SPDX-License-Identifier: Apache-2.0
"""The evidence in recordings of a bearing: its speed and load, and when it vibrated.

The evidence is an operator's list, the bearing's level of vibration, or the truth in a simulated
recording; never the verdict of the monitor itself, which would be a circle. :func:`learned`
says in a sentence what a calibration would change, which changes nothing by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stickslip_monitor.errors import CalibrationError, plural
from stickslip_monitor.lab.calibration.calibrate import (
    FLOOR,
    Calibration,
    calibrate,
    dip_limit,
)
from stickslip_monitor.lab.calibration.evidence import (
    LEVEL_TOLERANCE,
    TRUST,
    TRUTH_TOLERANCE,
    Dip,
    TelemetryBins,
    VibrationReport,
    alternating,
    course_of,
    cut_dips,
)
from stickslip_monitor.lab.calibration.posterior import Prior, Progress, prior_of
from stickslip_monitor.lab.truth import has_truth, read_truth
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.rule_level import UNKNOWN, VIBRATING
from stickslip_monitor.offline.check import Kept
from stickslip_monitor.physics.averaging.boundaries import fold_speed
from stickslip_monitor.physics.belief import QUANTILES


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The evidence of one recording on a bearing."""

    name: str  # of the recording
    courses: tuple[TelemetryBins, ...]  # speed and load between two jumps of the clock
    reports: tuple[VibrationReport, ...] = ()  # when it vibrated and when it did not


def courses_of(name: str, scan: Scan) -> tuple[TelemetryBins, ...]:
    """Speed and load of a recording between two jumps of the clock."""
    begins = np.append(np.flatnonzero(np.diff(scan.stretch, prepend=-1)), scan.time_ns.size)
    speed, load = scan.speed, scan.load
    return tuple(
        course_of(name, scan.time_ns[a:b], speed[a:b], load[a:b])
        for a, b in pairwise(begins)
        if b > a
    )


@dataclass(frozen=True, slots=True)
class EvidenceSource:
    """The source of when a bearing vibrated.

    Where nobody is named it is the level that is configured for the bearing, or else the truth in
    a simulated recording.
    """

    reports: tuple[VibrationReport, ...] | None = None  # an operator's reports
    true: bool = False  # whether it is the truth, and nothing else

    def of_recording(self, kept: Kept, config: BearingConfig) -> Evidence:
        """The evidence of one recording.

        Raises:
            CalibrationError: It has no truth, and there is no other source.
        """
        name, scan = kept.bag.path.name, kept.scan(config.name)
        if self.reports is not None:
            return Evidence(name, courses_of(name, scan), self._reports_of(config))
        if (topic := self._level_of(config)) is None:
            return _true_evidence(kept, config)
        reports = measured_reports(config, scan, f'{topic} in {name}')
        return Evidence(name, courses_of(name, scan), reports)

    def _reports_of(self, config: BearingConfig) -> tuple[VibrationReport, ...]:
        return tuple(report for report in self.reports or () if report.bearing == config.name)

    def _level_of(self, config: BearingConfig) -> str | None:
        """The topic of the level that is the source, if one is."""
        if config.level is None or self.reports is not None or self.true:
            return None
        return config.level.topic

    def dips(self, config: BearingConfig, prior: Prior, found: Sequence[Evidence]) -> list[Dip]:
        """The dips of all recordings of which something was reported.

        Raises:
            CalibrationError: There are none, a report is about no recording, or the level does
                not separate vibration from quiet.
        """
        _require_inside(self._reports_of(config), found)
        topic = self._level_of(config)
        if topic is not None and not any(one.reports for one in found):
            raise CalibrationError(
                f'the level on {topic} never says whether {config.name} vibrates: it is lost,'
                ' never changes, or has one mode only'
            )
        limit = dip_limit(prior)
        timeout = max(config.speed.timeout_ns, config.load.timeout_ns)
        dips = [
            dip
            for one in found
            for course in one.courses
            for dip in cut_dips(course, one.reports, limit, prior.viscous, timeout)
        ]
        if not dips:
            raise CalibrationError(
                f'there is no evidence on {config.name}: no report is about a time in which the'
                ' shaft turned slowly enough for stick-slip; record a slow passage with reports'
            )
        return dips


def measured_reports(
    config: BearingConfig, scan: Scan, source: str
) -> tuple[VibrationReport, ...]:
    """What the configured level shows in a recording; nothing where it was not known."""
    state, time = scan.measured, scan.time_ns
    if state is None or not time.size:
        return ()
    edges = np.flatnonzero((np.diff(state) != 0) | (np.diff(scan.stretch) != 0)) + 1
    begins, ends = [0, *edges.tolist()], [*edges.tolist(), time.size - 1]
    return tuple(
        VibrationReport(
            config.name, int(time[a]), int(time[b]), bool(state[a] == VIBRATING),
            LEVEL_TOLERANCE, TRUST, f'{source}, {k + 1}',
        )
        for k, (a, b) in enumerate(zip(begins, ends, strict=True))
        if state[a] != UNKNOWN and time[b] > time[a]
    )  # fmt: skip


def _true_evidence(kept: Kept, config: BearingConfig) -> Evidence:
    bag = kept.bag
    if not has_truth(bag, config.name):
        raise CalibrationError(
            f"bag '{bag.path}' holds no truth about {config.name}, as those of a simulation do:"
            ' give --reports, or configure its level'
        )
    truth = read_truth(bag, config.name)
    scan = kept.scan(config.name)
    name, span = bag.path.name, (truth.start_ns, truth.end_ns)
    source = f'truth of {name}'
    reports = alternating(config.name, span, truth.episodes, TRUTH_TOLERANCE, TRUST, source)
    return Evidence(name, courses_of(name, scan), tuple(reports))


def _require_inside(reports: Sequence[VibrationReport], found: Sequence[Evidence]) -> None:
    spans = [(int(c.time_ns[0]), int(c.time_ns[-1])) for one in found for c in one.courses]
    for report in reports:
        if not any(report.end_ns > a and report.start_ns < b for a, b in spans):
            raise CalibrationError(
                f'{report.source}: the report lies outside the recordings: give the bag that it'
                ' is about'
            )


def learned(
    config: BearingConfig,
    source: EvidenceSource,
    found: Sequence[Evidence | str],
    command: str,
    progress: Progress | None = None,
) -> list[str]:
    """What the recordings teach of a bearing, a sentence each.

    Each has given its evidence, or why there is none; the command is what would calibrate it.
    """
    known = [one for one in found if isinstance(one, Evidence)]
    try:
        if not known:
            raise CalibrationError(next(str(one) for one in found))
        prior = prior_of(config.bearing, config.tolerance)
        floor = config.tolerance.model_error or FLOOR
        dips = source.dips(config, prior, known)
        result = calibrate(dips, prior, floor, progress=progress)
    except CalibrationError as error:
        return [f'{config.name}: nothing is learned: {error}']
    return [
        f'{config.name}: {text}' for text in (_proposal(config, result, command), *result.warnings)
    ]


def _proposal(config: BearingConfig, result: Calibration, command: str) -> str:
    """How the fold from the evidence lies to the one that is predicted."""
    load = math.sqrt(result.loads[0] * result.loads[1])
    rpm = config.bearing.speed.factor('rpm')
    belief = result.belief()
    low, middle, high = (belief.fold_speed(load, p) / rpm for p in QUANTILES)
    predicted = fold_speed(config.bearing, load) / rpm
    count = result.episodes
    which = plural(count, 'episode')
    seen = f'{low:.1f} to {high:.1f} rpm at {load:.4g} N'
    if not count or low <= predicted <= high:
        does = 'agrees' if count == 1 else 'agree'
        return f'{which} {does} with the predicted fold of {predicted:.1f} rpm ({seen})'
    if math.isnan(predicted):
        return f'{which} where no fold was predicted ({seen}): calibrate with `{command}`'
    side, does = 'above' if middle > predicted else 'below', 'ends' if count == 1 else 'end'
    return (
        f'{which} {does} {abs(middle / predicted - 1.0):.0%} {side} the predicted fold ({seen},'
        f' predicted {predicted:.1f} rpm): calibrate with `{command}`'
    )
