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

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, plural
from stickslip_monitor.lab.calibration.calibrate import Calibration, Evidence, calibrate, read_levels
from stickslip_monitor.lab.calibration.evidence import (
    TRUTH_TOLERANCE,
    TRUTH_TRUST,
    TelemetryBins,
    VibrationReport,
    alternating,
    course_of,
)
from stickslip_monitor.lab.calibration.level import LevelBins, level_over_speed
from stickslip_monitor.lab.calibration.posterior import Prior
from stickslip_monitor.lab.truth import has_truth, read_truth
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.signals import Input, Status, Stream
from stickslip_monitor.offline.check import Kept
from stickslip_monitor.physics.averaging import fold_speed
from stickslip_monitor.physics.probability import QUANTILES

_LEAST = 1e-20


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
        if not self._hears(config):
            return _true_evidence(kept, config)
        level = level_of(config, kept.stream(config.name), scan)
        return Evidence(name, courses_of(name, scan), level=level)

    def _reports_of(self, config: BearingConfig) -> tuple[VibrationReport, ...]:
        return tuple(report for report in self.reports or () if report.bearing == config.name)

    def _hears(self, config: BearingConfig) -> bool:
        """Whether the bearing's level is the source."""
        return config.level is not None and self.reports is None and not self.true

    def calibrated(
        self,
        config: BearingConfig,
        found: Sequence[Evidence],
        prior: Prior | None = None,
        forget: float = 0.0,
        known: Sequence[str] = (),
    ) -> Calibration:
        """What all recordings together give of a bearing; see :func:`.calibrate`.

        Raises:
            CalibrationError: They give nothing; the text says why.
        """
        _require_inside(self._reports_of(config), found)
        if self._hears(config):
            found = read_levels(config.name, found)
        onsets = self.reports is None
        given = config.bearing, config.tolerance
        return calibrate(found, *given, prior, forget, onsets, known)


def courses_of(name: str, scan: Scan) -> tuple[TelemetryBins, ...]:
    """Speed and load of a recording between two jumps of the clock."""
    begins = np.append(np.flatnonzero(np.diff(scan.stretch, prepend=-1)), scan.time_ns.size)
    return tuple(
        course_of(name, scan.time_ns[a:b], scan.speed[a:b], scan.load[a:b])
        for a, b in pairwise(begins)
        if b > a
    )


def level_of(config: BearingConfig, stream: Stream, scan: Scan) -> LevelBins:
    """The valid values of a bearing's level, over the speed."""
    assert config.level is not None
    rows = (stream.inputs == Input.LEVEL) & (scan.status == Status.ACCEPTED)
    value: FloatArray = stream.value[rows]
    if config.level.unit != 'dB':
        value = 20.0 * np.log10(np.maximum(np.abs(value), _LEAST))
    # On the monitor's clock, as the points are.
    time, points = scan.now_ns[rows] / 1e9, scan.time_ns / 1e9
    return level_over_speed(time, value, points, scan.speed)


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
    reports = alternating(config.name, span, truth.episodes, TRUTH_TOLERANCE, TRUTH_TRUST, source)
    return Evidence(name, courses_of(name, scan), tuple(reports))


def _require_inside(reports: Sequence[VibrationReport], found: Sequence[Evidence]) -> None:
    spans = [(int(c.time_ns[0]), int(c.time_ns[-1])) for one in found for c in one.courses]
    for report in reports:
        if not any(report.end_ns > a and report.start_ns < b for a, b in spans):
            raise CalibrationError(
                f'{report.source}: the report lies outside the recordings: give the bag that it is about'
            )


def learned(
    config: BearingConfig, source: EvidenceSource, found: Sequence[Evidence | str], command: str
) -> list[str]:
    """What the recordings teach of a bearing, a sentence each.

    Each has given its evidence, or why there is none; the command is what would calibrate it.
    """
    known = [one for one in found if isinstance(one, Evidence)]
    try:
        if not known:
            raise CalibrationError(next(str(one) for one in found))
        result = source.calibrated(config, known)
    except CalibrationError as error:
        return [f'{config.name}: nothing is learned: {error}']
    texts = (_proposal(config, result, command), *result.warnings)
    return [f'{config.name}: {text}' for text in texts]


def _proposal(config: BearingConfig, result: Calibration, command: str) -> str:
    """How the fold from the evidence lies to the one that is predicted."""
    load = math.sqrt(result.loads[0] * result.loads[1])
    rpm = config.bearing.speed.factor('rpm')
    low, middle, high = (float(result.belief.fold_speed(load, p)) / rpm for p in QUANTILES)
    predicted = float(fold_speed(config.bearing, load)) / rpm
    count = len(result.edges.seen)
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
