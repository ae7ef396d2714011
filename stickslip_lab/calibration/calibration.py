# SPDX-License-Identifier: Apache-2.0
"""Calibrates a bearing: infers its boundaries from recordings, as another bearing with its uncertainty.

The evidence is an operator's list, the bearing's level of vibration, or the truth in a simulated
recording; never the monitor's own verdict, which would be circular.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_lab.calibration.edges import Edges, End, Reference, find_edges
from stickslip_lab.calibration.evidence import TelemetryBins, VibrationReport, bin_telemetry, true_reports
from stickslip_lab.calibration.level_reports import LevelBins, bin_level, level_reports, threshold_of
from stickslip_lab.calibration.posterior import Grid, Posterior, Spreads, infer, wrong_report_probability
from stickslip_lab.scenes.truth_topics import has_truth, read_truth
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, plural
from stickslip_monitor.monitor.calibration_file import CALIBRATION_SCHEMA, sensor_record
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_over_arrays import Scan
from stickslip_monitor.monitor.sample_types import Input, Status, Stream
from stickslip_monitor.monitor.statements import rounded_text
from stickslip_monitor.offline.check import RecordingBuffer
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import LAWS, Coulomb, Tabulated
from stickslip_monitor.physics.lubrication import reference_point
from stickslip_monitor.physics.probability import QUANTILES, UNKNOWN_FALL, Belief, Tolerance, move_boundaries

FLOOR = 0.01
"""Relative error of a boundary's speed that no evidence takes away: the model's own."""
# Least scatter of ln V between ends, and of a passage's own boundary.
_MIN_SCATTER = 0.02
FRAGMENT_MARK = b'Made by stickslip calibrate'
"""Marks a fragment among the files of others."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Evidence of one recording about a bearing."""

    name: str  # of the recording
    courses: tuple[TelemetryBins, ...]  # speed and load of each part between two steps of the clock
    reports: tuple[VibrationReport, ...] = ()  # when it vibrated and when it was quiet
    level: LevelBins | None = None  # the level that reports are read from; None: they are given
    knocks: tuple[VibrationReport, ...] = ()  # vibrations too short to be episodes


def read_levels(bearing: str, evidence: Sequence[Evidence]) -> list[Evidence]:
    """Return the evidence, in its order, with the reports and knocks of its levels, all by one threshold.

    Evidence without a level comes back as it is.

    Args:
        bearing: Name of the bearing, for the reports.
        evidence: One for each recording.

    Raises:
        NoTwoModes: The levels have no two modes, or no evidence has a level.
    """
    threshold = threshold_of([one.level for one in evidence if one.level is not None])
    read = []
    for one in evidence:
        if one.level is not None:
            reports, knocks = level_reports(bearing, one.level, threshold, one.name)
            one = replace(one, reports=tuple(reports), knocks=tuple(knocks))
        read.append(one)
    return read


def prior_covariance(bearing: Bearing, tolerance: Tolerance) -> FloatArray:
    """Return the covariance of ``(ln r, ln q)`` by a configuration, shape (2, 2).

    They are the logarithms of the factors by which the boundaries move, in speed and in load. Tolerances
    that are 0 are taken as 40 % of the damping, 30 % of the decay and 25 % of ``mu_s - mu_k``.
    """
    completed = replace(tolerance, damping=tolerance.damping or 0.40, decay=tolerance.decay or 0.30)
    without_fall = tolerance.of_fall(bearing.friction) == 0.0
    return completed.covariance(bearing.friction) + np.diag([0.0, without_fall * UNKNOWN_FALL**2])


@dataclass(frozen=True)
class Calibration:
    """Result of a calibration."""

    reference: Reference  # the bearing that is configured
    prior: FloatArray  # covariance of (ln r, ln q) before the evidence, shape (2, 2)
    tolerance: Tolerance  # of the configuration
    spreads: Spreads  # the other uncertainties
    edges: Edges  # the edges of vibration in the evidence
    posterior: Posterior  # of both factors, after
    evidence: tuple[Evidence, ...] = ()  # of each recording
    repeated: tuple[str, ...] = ()  # names of recordings that repeat one, which do not count

    @property
    def episodes(self) -> int:
        """Number of vibrations in slow passages, including those that only bound the fold."""
        return len(self.edges.ends)

    @property
    def loads(self) -> tuple[float, float]:
        """Least and greatest load of the slow passages [N]."""
        return self.edges.loads

    @cached_property
    def factors(self) -> tuple[float, float]:
        """``(ln r, ln q)``, of speeds and of loads, by the ends, at the middle of their grid."""
        return self._middle_factors(self.posterior.by_ends)

    def _middle_factors(self, grid: Grid) -> tuple[float, float]:
        """Return ``(ln r, ln q)`` at :attr:`.Grid.middle`, where ``u`` is turned into ``ln r``."""
        u, log_q = grid.middle
        log_fold_there, log_fold_here = self.reference.fold(np.array([grid.load + log_q, grid.load]))
        return u - float(log_fold_there - log_fold_here), log_q

    def _factor_covariance(self, grid: Grid) -> FloatArray:
        """Return the covariance of ``(ln r, ln q)``, shape (2, 2), to first order about its middle."""
        _, log_q = grid.middle
        by = np.array([[1.0, -self.reference.slope(grid.load + log_q)], [0.0, 1.0]])
        covariance: FloatArray = by @ grid.covariance @ by.T
        return covariance

    @property
    def spread(self) -> FloatArray:
        """Standard deviations of :attr:`factors`, shape (2,)."""
        return np.asarray(np.sqrt(np.diag(self._factor_covariance(self.posterior.by_ends))))

    def _scale_bearing(self, factors: tuple[float, float]) -> Bearing:
        """Return the configured bearing with its boundaries moved by the factors ``(ln r, ln q)``.

        Raises:
            PhysicsError: The law cannot be moved so far (:func:`.move_boundaries`).
        """
        return move_boundaries(self.reference.bearing, *map(math.exp, factors))

    @cached_property
    def bearing(self) -> Bearing:
        """The bearing that alarms are raised by: the configured one moved by :attr:`factors`, by ends alone.

        The onset of stick-slip depends on how noisy the ship is. With onsets too the Hopf speed was 2 % low
        in voyages noisier than those calibrated on, and alarms came late.

        Raises:
            PhysicsError: The law cannot be moved so far (:func:`.move_boundaries`).
        """
        return self._scale_bearing(self.factors)

    @property
    def floor(self) -> float:
        """Relative error of a boundary that no evidence takes away."""
        return self.tolerance.model_error or FLOOR

    @cached_property
    def belief(self) -> Belief:
        """The belief by all evidence, onsets too, without the scatter of single passages.

        Raises:
            PhysicsError: The law cannot be moved so far (:func:`.move_boundaries`).
        """
        grid = self.posterior.by_all
        middle = self._scale_bearing(self._middle_factors(grid))
        return Belief(middle, self._factor_covariance(grid), self.floor, 0.0, self.loads, True)

    @cached_property
    def before(self) -> Belief:
        """The belief before the evidence, by the configuration alone."""
        return Belief(self.reference.bearing, self.prior, self.floor)

    def hopf_speeds(self, load: float) -> list[float]:
        """Return the Hopf speed [m/s] at a load > 0 [N] for each of :data:`QUANTILES`, widened by the floor.

        Unlike those of :attr:`belief` they need not lie evenly about the middle. Without a Hopf speed they
        are about 1e-9 m/s.
        """
        grid = self.posterior.by_all
        hopf = grid.log_r + self.reference.hopf(math.log(load) + grid.log_q)
        low, middle, high = grid.quantiles(hopf, QUANTILES)
        more = 1.6449 * 1.5 * self.floor  # the 95 % quantile of 1.5 times the floor
        span = math.hypot(middle - low, more), math.hypot(high - middle, more)
        return [math.exp(middle - span[0]), math.exp(middle), math.exp(middle + span[1])]

    def boundaries(self) -> list[list[float]]:
        """Return rows of load [N], then Hopf speeds, then fold speeds [m/s], three each at :data:`QUANTILES`.

        The loads, up to five, rise evenly over :attr:`loads`. Hopf speeds are about
        1e-9 m/s where there is none, fold speeds 0.

        Raises:
            PhysicsError: The law cannot be moved so far (:func:`.move_boundaries`).
        """
        fold = self.belief.fold_speed
        return [
            [load, *self.hopf_speeds(load), *(float(fold(load, p)) for p in QUANTILES)]
            for load in np.unique(np.linspace(*self.loads, 5)).tolist()
        ]

    @cached_property
    def doubts(self) -> list[tuple[End, float]]:
        """Ends and bounds that are probably wrong reports, by time, each with that probability (> 0.5)."""
        log_r, log_q = self.factors
        count, probabilities = len(self.edges.ends), []
        for k, end in enumerate(self.edges.ends):
            moved_on = self.spreads.forget * math.sqrt(count - 1 - k)
            spread = math.hypot(_MIN_SCATTER, self.spreads.load, moved_on)
            probabilities.append((end, wrong_report_probability(end, self.reference, log_r, log_q, spread)))
        return [(end, p) for end, p in probabilities if p > 0.5]

    @property
    def warnings(self) -> list[str]:
        """Clauses on what makes the result less reliable; empty if nothing does."""
        texts, seen = [], self.edges.seen
        if not self.episodes:
            texts.append('no episode was seen: quiet bounds the Hopf speed, and says little of the fold')
        elif not seen:
            texts.append(
                'no vibration was seen to end while the speed rose, so that the fold is only'
                ' bounded: record a passage from stick-slip to faster speeds'
            )
        elif len(seen) == 1:
            texts.append(
                f'all rests on one end of vibration ({seen[0].report.source}): one more episode'
                ' would confirm it'
            )
        for end, p in self.doubts:
            one = end.report
            texts.append(
                f'{one.source}: vibration for {one.seconds:.0f} s until {one.end_ns / 1e9:.0f} s'
                f' ({end.recording}) fits nothing else: worthless with {p:.0%}'
            )
        if self.has_changed:
            texts.append(
                'the last episodes end elsewhere than those before: the bearing may have changed;'
                ' calibrate with --forget 0.03, or with the newest recordings alone'
            )
        return texts

    @property
    def has_changed(self) -> bool:
        """Whether the fold moved: the last three ends differ from those before, or all have a trend.

        Either counts only above three standard deviations, by the scatter of the ends; False with fewer than
        five ends.
        """
        ends, last = sorted(self.edges.seen, key=lambda end: end.time), 3
        if len(ends) < 5:
            return False
        log_r, log_q = self.factors
        speed, load = np.log([end.middle for end in ends]).T
        spread = np.hypot(_MIN_SCATTER, [end.timing for end in ends])
        off = np.clip(speed - (log_r + self.reference.fold(load + log_q)), -4.0 * spread, 4.0 * spread)
        least_scatter = math.hypot(_MIN_SCATTER, self.spreads.load)
        size = max(float(np.std(np.diff(off)) / math.sqrt(2.0)), least_scatter)
        place = np.arange(off.size) - 0.5 * (off.size - 1)
        trend = float(place @ off) / math.sqrt(float(place @ place)) / size
        small_sample = math.sqrt(1.0 / last + 1.0 / (off.size - last))
        step = float(off[-last:].mean() - off[:-last].mean()) / (size * small_sample)
        return max(abs(trend), abs(step)) > 3.0  # so none of 40 steady ships has changed

    @property
    def remarks(self) -> list[str]:
        """Clauses on the evidence that are no warnings; empty without any.

        They name the offset of the ends from the configured fold, repeated recordings, the knocks that were
        left out, and a narrow range of loads.
        """
        (low, high), texts = self.loads, []
        if off := [speed_over_fold(end, self.reference) for end in self.edges.seen]:
            middle = 100.0 * (float(np.median(off)) - 1.0)
            count = '1 episode ends' if len(off) == 1 else f'{len(off)} episodes end'
            side = 'above' if middle >= 0.0 else 'below'
            texts.append(f'{count} {abs(middle):.1f} % {side} the configured fold')
        texts += [f'{name} was given before and counts once' for name in self.repeated]
        if knocks := [knock for one in self.evidence for knock in one.knocks]:
            texts.append(
                f'{plural(len(knocks), "vibration")} of less than 10 s left out as knocks,'
                f' the first at {knocks[0].start_ns / 1e9:.0f} s ({knocks[0].source})'
            )
        if high < 1.1 * low:
            texts.append(
                f'all evidence is at {rounded_text(low, 4)} to {rounded_text(high, 4)} N: beyond a fifth from'
                ' there the boundaries are known less well'
            )
        return texts


def speed_over_fold(end: End, reference: Reference) -> float:
    """Return the speed at an end over the configured fold speed at its load."""
    speed, load = end.middle
    return speed / math.exp(float(reference.fold(np.array([math.log(load)]))[0]))


def calibrate(
    evidence: Sequence[Evidence],
    bearing: Bearing,
    tolerance: Tolerance,
    forget: float = 0.0,
    onsets: bool = True,
) -> Calibration:
    """Infer a bearing's boundaries.

    Whether the friction law can be moved so far shows only where the result is used: see
    :attr:`.Calibration.bearing`.

    Args:
        evidence: The recordings, with their reports; a course that is given twice counts once.
        bearing: The bearing that is configured.
        tolerance: The uncertainties that its configuration states; those that are 0 are taken as in
            :func:`prior_covariance`, and 3 % of the load.
        forget: Standard deviation by which ``ln q`` may drift before each recording, as the lining wears.
        onsets: Whether the times of onsets count; ``False`` for a person's list.

    Raises:
        CalibrationError: No report is about a slow passage, most ends are worthless as of another bearing,
            or the configured bearing has no fold.
    """
    reference = Reference(bearing)
    pairs, repeated = _drop_repeated(evidence)
    edges = find_edges(pairs, reference, onsets)
    if not edges.tracks or not edges.loads[0] > 0.0:
        raise CalibrationError(
            'there is no evidence: no report is about a time in which the shaft turned slowly'
            ' enough for stick-slip; record a slow passage with a level or reports'
        )
    prior, spreads = prior_covariance(bearing, tolerance), Spreads(tolerance.load or 0.03, forget)
    posterior = infer(edges, reference, prior, spreads)
    result = Calibration(reference, prior, tolerance, spreads, edges, posterior, tuple(evidence), repeated)
    wrong = [end for end, _ in result.doubts if not end.is_bound]
    if len(edges.seen) > 1 and 2 * len(wrong) > len(edges.seen):
        over = [speed_over_fold(end, reference) for end in wrong]
        raise CalibrationError(
            f'{len(wrong)} of {len(edges.seen)} episodes end at {min(over):.2g} to'
            f' {max(over):.2g} times the configured fold speed, where the rest does not, or where'
            ' this bearing cannot: is the level that of another bearing, or a unit wrong?'
        )
    return result


def _drop_repeated(
    evidence: Sequence[Evidence],
) -> tuple[list[tuple[TelemetryBins, Sequence[VibrationReport]]], tuple[str, ...]]:
    """Return each distinct course with its reports, and the names of recordings that repeat one, in order.

    Courses are equal where their times, speeds and loads are; the reports of the first one count.
    """
    courses: dict[bytes, tuple[TelemetryBins, Sequence[VibrationReport]]] = {}
    repeated: dict[str, None] = {}
    for one in evidence:
        for course in one.courses:
            contents = b''.join(x.tobytes() for x in (course.time_ns, course.speed, course.load))
            if contents in courses:
                repeated[course.name] = None
            else:
                courses[contents] = course, one.reports
    return list(courses.values()), tuple(repeated)


def law_parameters(bearing: Bearing) -> dict[str, Any]:
    """Return the damping and the law of a bearing as parameters of a configuration, rounded to six digits.

    Their names are ``damping``, ``friction.law`` and ``friction.`` with each parameter of the law.
    """
    law, kind = bearing.friction, 'stribeck'
    values = {name: getattr(law, name) for name in LAWS[kind][1] if hasattr(law, name)}
    if isinstance(law, Tabulated):
        kind, values = 'tabulated', {'speed': law.speed, 'coefficient': law.values}
    elif isinstance(law, Coulomb):
        kind = 'coulomb'
    written = {f'friction.{name}': _round_values(value) for name, value in values.items()}
    return {'damping': _round_values(bearing.damping), 'friction.law': kind, **written}


def to_document(
    config: BearingConfig, calibration: Calibration, created: str, version: str
) -> dict[str, Any]:
    """Return the calibration as the JSON object of the file that ``calibration:`` names in a configuration.

    ``created`` is the time in ISO 8601, ``version`` that of the program.

    Raises:
        PhysicsError: The law cannot be moved so far.
    """
    log_r, log_q = calibration.factors
    doubtful = {id(end): p for end, p in calibration.doubts}
    return {
        'schema': CALIBRATION_SCHEMA,
        'bearing': config.name,
        'inputs': {
            name: sensor_record(input_config)
            for name, input_config in (('speed', config.speed), ('load', config.load))
        },
        'parameters': law_parameters(calibration.bearing),
        'believed': law_parameters(calibration.belief.bearing),
        'covariance': _round_values(calibration.belief.covariance),
        'loads': _round_values(calibration.loads),
        'floor': calibration.floor,
        'factors': {'speeds': _round_values(math.exp(log_r)), 'loads': _round_values(math.exp(log_q))},
        'boundaries': _round_values(calibration.boundaries()),
        'ends': [
            {
                'recording': end.recording,
                'source': end.report.source,
                'time': round(end.time * 1e9),
                'speed': _round_values(end.middle[0]),
                'load': _round_values(end.middle[1]),
                'bound': end.is_bound,
                'worthless': _round_values(doubtful.get(id(end), 0.0)),
            }
            for end in calibration.edges.ends
        ],
        'warnings': calibration.warnings,
        'remarks': calibration.remarks,
        'created': created,
        'version': version,
    }


def _round_values(values: Any) -> Any:
    """Return a number as a float, or nested numbers as lists, rounded to six significant digits."""
    return np.vectorize(lambda x: float(f'{x:.6g}'))(np.asarray(values, float)).tolist()


def yaml_fragment(config: BearingConfig, calibration: Calibration) -> str:
    """Return damping and friction law of the calibrated boundaries as YAML of a bearing's entry.

    Raises:
        PhysicsError: The law cannot be moved so far.
    """
    rows = law_parameters(calibration.bearing)
    damping = rows.pop('damping')
    law = ', '.join(f'{key.removeprefix("friction.")}: {value}' for key, value in rows.items())
    return (
        f'# {FRAGMENT_MARK.decode()}: {config.name} has these boundaries; no measurement of'
        ' friction.\n'
        f'damping: {damping:.6g}\n'
        f'friction: {{{law}}}\n'
    )


@dataclass(frozen=True, slots=True)
class EvidenceSource:
    """The source that says when a bearing vibrated.

    Without ``reports`` it is the level that is configured for the bearing, or without one the truth in a
    simulated recording.
    """

    reports: tuple[VibrationReport, ...] | None = None  # an operator's reports

    def of_recording(self, outline: RecordingBuffer, config: BearingConfig) -> Evidence:
        """Return the evidence of one recording: all reports of the operator, else the level, else the truth.

        A level is read into reports by :meth:`calibrated`, over all recordings together.

        Args:
            outline: The recording after a check, with the scan of the bearing.
            config: The bearing.

        Raises:
            CalibrationError: It has no truth, and there is no other source.
            BagError: Its truth cannot be read, or is not of the schema that this version knows.
        """
        bag, scan = outline.bag, outline.scan(config.name)
        name, courses = bag.path.name, bin_courses(bag.path.name, scan)
        if self.reports is not None:
            return Evidence(name, courses, self._reports_of(config))
        if self._is_level_source(config):
            return Evidence(name, courses, level=accepted_level(config, outline.stream(config.name), scan))
        if not has_truth(bag, config.name):
            raise CalibrationError(
                f"bag '{bag.path}' holds no truth about {config.name}, as those of a simulation do:"
                ' give --reports, or configure its level'
            )
        return Evidence(name, courses, true_reports(config.name, read_truth(bag, config.name), name))

    def _reports_of(self, config: BearingConfig) -> tuple[VibrationReport, ...]:
        """Return an operator's reports on a bearing; none without a list of them."""
        return tuple(report for report in self.reports or () if report.bearing == config.name)

    def _is_level_source(self, config: BearingConfig) -> bool:
        """Return whether the bearing's level is the source."""
        return config.level is not None and self.reports is None

    def calibrated(
        self, config: BearingConfig, evidence: Sequence[Evidence], forget: float = 0.0
    ) -> Calibration:
        """Return the calibration of a bearing by all recordings together; see :func:`.calibrate`.

        ``forget`` is the deviation by which ``ln q`` may drift before each recording.

        Raises:
            CalibrationError: A report lies outside the recordings, the level has no two modes
                (:class:`.NoTwoModes`), there is no evidence, or most of it is of another bearing; or the
                bearing has no fold.
        """
        spans = [(int(c.time_ns[0]), int(c.time_ns[-1])) for one in evidence for c in one.courses]
        for report in self._reports_of(config):
            if not any(report.end_ns > a and report.start_ns < b for a, b in spans):
                raise CalibrationError(
                    f'{report.source}: the report lies outside the recordings: give the bag that it is about'
                )
        if self._is_level_source(config):
            evidence = read_levels(config.name, evidence)
        return calibrate(evidence, config.bearing, config.tolerance, forget, self.reports is None)


def bin_courses(name: str, scan: Scan) -> tuple[TelemetryBins, ...]:
    """Return speed and load of a recording in bins, as reference points of friction as measured.

    Returns:
        One course for each part between two steps back of the clock; empty without operating points.
    """
    water = None if scan.config.water_temperature is None else scan.water
    speed, load, _ = reference_point(scan.config.bearing, scan.speed, scan.load, water)
    begins = np.append(np.flatnonzero(np.diff(scan.clock_part, prepend=-1)), scan.time_ns.size)
    return tuple(
        bin_telemetry(name, scan.time_ns[a:b], speed[a:b], load[a:b]) for a, b in pairwise(begins) if b > a
    )


def accepted_level(config: BearingConfig, stream: Stream, scan: Scan) -> LevelBins:
    """Return the accepted values of a bearing's level in dB, binned, less ``20 lg`` of the surface speed.

    The bearing must have a level. Values in another unit become dB over one of it; 0 becomes -400 dB.
    """
    assert config.level is not None
    rows = (stream.inputs == Input.LEVEL) & (scan.status == Status.ACCEPTED)
    value: FloatArray = stream.value[rows]
    if config.level.unit != 'dB':
        value = 20.0 * np.log10(np.maximum(np.abs(value), 1e-20))
    # On the monitor's clock, as the points are.
    return bin_level(scan.now_ns[rows] / 1e9, value, scan.time_ns / 1e9, scan.speed)
