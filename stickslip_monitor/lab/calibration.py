# SPDX-License-Identifier: Apache-2.0
"""A calibration: another bearing with its uncertainty, and what its evidence is worth.

A calibration as the documented JSON object, and the prior that an earlier one makes.

The evidence in recordings of a bearing: its speed and load, and when it vibrated.

The evidence is an operator's list, the bearing's level of vibration, or the truth in a simulated
recording; never the verdict of the monitor itself, which would be a circle. :func:`learned`
says in a sentence what a calibration would change, which changes nothing by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, PhysicsError, plural
from stickslip_monitor.lab.edges import Edges, End, Reference, edges_of
from stickslip_monitor.lab.evidence import (
    TRUTH_TOLERANCE,
    TRUTH_TRUST,
    LevelBins,
    TelemetryBins,
    VibrationReport,
    alternating,
    course_of,
    level_over_speed,
    level_reports,
    modes_of,
)
from stickslip_monitor.lab.posterior import Posterior, Prior, Spreads, doubt, infer
from stickslip_monitor.lab.truth import has_truth, read_truth
from stickslip_monitor.monitor.configuration import CALIBRATION_SCHEMA, INPUT_KEYS
from stickslip_monitor.monitor.over_arrays import Scan
from stickslip_monitor.monitor.parameters import BearingConfig, InputConfig
from stickslip_monitor.monitor.signals import Input, Status, Stream
from stickslip_monitor.offline.check import Kept
from stickslip_monitor.physics.averaging import fold_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.probability import QUANTILES, UNKNOWN_FALL, Belief, Tolerance, moved

FLOOR = 0.01
"""Relative error of a boundary's speed that no evidence takes away: the model's own."""
DAMPING, _DECAY, LOAD = 0.40, 0.30, 0.03
"""Deviations where the configuration has none."""
_DOUBTFUL = 0.5
_MOST_ROWS, _ONE_LOAD = 5, 1.1
# Ends of which the last three are compared with those before, and how far apart in deviations
# both that difference and the trend must be.
_FEWEST_ENDS, _LAST, _CHANGED = 5, 3, 3.0
_LEAST_SCATTER = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What one recording tells of a bearing."""

    name: str  # of the recording
    courses: tuple[TelemetryBins, ...]  # speed and load between two jumps of the clock
    reports: tuple[VibrationReport, ...] = ()  # when it vibrated and when it did not
    level: LevelBins | None = None  # what the reports are to be read from
    knocks: tuple[VibrationReport, ...] = ()  # vibrations too short to be episodes


def read_levels(bearing: str, found: Sequence[Evidence]) -> list[Evidence]:
    """The evidence with the reports that its levels give, all by one threshold.

    Raises:
        CalibrationError: The levels have no two modes.
    """
    threshold = modes_of([one.level for one in found if one.level is not None]).threshold
    read = []
    for one in found:
        if one.level is not None:
            reports, knocks = level_reports(bearing, one.level, threshold, one.name)
            one = replace(one, reports=tuple(reports), knocks=tuple(knocks))
        read.append(one)
    return read


def prior_of(bearing: Bearing, tolerance: Tolerance) -> Prior:
    """The prior that a configuration makes.

    Tolerances that are 0 are taken as 40 % of the damping, 30 % of the decay and 25 % of
    ``mu_s - mu_k``.
    """
    fall = tolerance.of_fall(bearing.friction) or UNKNOWN_FALL
    decay, damping = tolerance.decay or _DECAY, tolerance.damping or DAMPING
    other = damping**2 + fall**2
    return Prior(np.zeros(2), np.array([[decay**2, -(decay**2)], [-(decay**2), decay**2 + other]]))


@dataclass(frozen=True)
class Calibration:
    """What the evidence gives of a bearing."""

    reference: Reference  # the bearing that is configured
    prior: Prior  # of both factors, before
    tolerance: Tolerance  # of the configuration
    spreads: Spreads  # what else was taken as uncertain
    edges: Edges  # the evidence
    posterior: Posterior  # of both factors, after
    evidence: tuple[Evidence, ...] = ()  # the recordings
    repeated: tuple[str, ...] = ()  # recordings that were given before, which count once

    @property
    def episodes(self) -> int:
        """Vibrations in slow passages."""
        return len(self.edges.ends)

    @property
    def loads(self) -> tuple[float, float]:
        """Least and greatest load of the slow passages [N]."""
        return self.edges.loads

    @cached_property
    def factors(self) -> tuple[float, float]:
        """``ln r`` and ``ln q`` in the middle."""
        u, log_q = self.posterior.fold.middle
        return u - self._bend(log_q), log_q

    def _bend(self, log_q: float) -> float:
        n = self.posterior.load
        there, here = self.reference.fold(np.array([n + log_q, n]))
        return float(there - here)

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of ``(ln r, ln q)``, shape (2, 2), to first order about the middle."""
        slope = self.reference.slope(self.posterior.load + self.factors[1])
        by = np.array([[1.0, -slope], [0.0, 1.0]])
        found: FloatArray = by @ self.posterior.fold.covariance @ by.T
        return found

    @cached_property
    def bearing(self) -> Bearing:
        """The bearing whose boundaries these are."""
        log_r, log_q = self.factors
        return moved(self.reference.bearing, math.exp(log_r), math.exp(log_q))

    @property
    def floor(self) -> float:
        """Relative error of a boundary that no evidence takes away."""
        return self.tolerance.model_error or FLOOR

    @cached_property
    def belief(self) -> Belief:
        """The boundaries themselves, without what single passages scatter."""
        return Belief(self.bearing, self.covariance, self.floor, 0.0, self.loads, True)

    @cached_property
    def before(self) -> Belief:
        """The same before the evidence."""
        return Belief(self.reference.bearing, self.prior.covariance, self.floor)

    def hopf_from_onsets(self, load: float) -> list[float]:
        """The Hopf speed at a load by the onsets too, at :data:`QUANTILES` [m/s]."""
        both = self.posterior.both
        hopf = both.log_r + self.reference.hopf(math.log(load) + both.log_q)
        low, middle, high = both.quantiles(hopf, QUANTILES)
        more = 1.6449 * 1.5 * self.floor
        span = math.hypot(middle - low, more), math.hypot(high - middle, more)
        return [math.exp(middle - span[0]), math.exp(middle), math.exp(middle + span[1])]

    def boundaries(self) -> list[list[float]]:
        """Rows of load, Hopf speed by the onsets at :data:`QUANTILES`, fold speed at the same."""
        rows = []
        for load in np.unique(np.linspace(*self.loads, _MOST_ROWS)).tolist():
            fold = [float(self.belief.fold_speed(load, p)) for p in QUANTILES]
            rows.append([load, *self.hopf_from_onsets(load), *fold])
        return rows

    @cached_property
    def doubts(self) -> list[tuple[End, float]]:
        """Ends and bounds that are more likely worthless than not, with that probability."""
        log_r, log_q = self.factors
        each = []
        for later, end in enumerate(reversed(self.edges.ends)):
            moved_on = self.spreads.forget * math.sqrt(later)
            spread = math.hypot(0.02, self.spreads.load, moved_on)
            each.append((end, doubt(end, self.reference, log_r, log_q, spread)))
        return [(end, p) for end, p in reversed(each) if p > _DOUBTFUL]

    def misses(self) -> list[tuple[float, float, float]]:
        """Of each end its time [s], how far ``ln V`` is off the fold, and the spread of that."""
        log_r, log_q = self.factors
        found = []
        for end in self.edges.seen:
            speed, load = np.log(end.middle)
            fold = log_r + float(self.reference.fold(np.array([load + log_q]))[0])
            found.append((end.time, float(speed) - fold, math.hypot(0.02, end.timing)))
        return found

    @property
    def warnings(self) -> list[str]:
        """What makes the result worth less, a sentence each."""
        found = []
        if not self.episodes:
            found.append('no episode was seen: quiet bounds the Hopf speed, and says little of the fold')
        elif not self.edges.seen:
            found.append(
                'no vibration was seen to end while the speed rose, so that the fold is only'
                ' bounded: record a passage from stick-slip to faster speeds'
            )
        elif len(self.edges.seen) == 1:
            found.append(
                f'all rests on one end of vibration ({self.edges.seen[0].report.source}): one'
                ' more episode would confirm it'
            )
        for end, p in self.doubts:
            one = end.report
            found.append(
                f'{one.source}: vibration for {one.seconds:.0f} s until {one.end_ns / 1e9:.0f} s'
                f' ({end.recording}) fits nothing else: worthless with {p:.0%}'
            )
        if self.has_changed:
            found.append(
                'the last episodes end elsewhere than those before: the bearing may have changed;'
                ' calibrate with --forget 0.03, or with the newest recordings alone'
            )
        return found

    @property
    def has_changed(self) -> bool:
        """Whether the last ends differ from those before, or all have a trend."""
        rows = sorted(self.misses())
        if len(rows) < _FEWEST_ENDS:
            return False
        off, spread = np.array([[miss, s] for _, miss, s in rows]).T
        off = np.clip(off, -4.0 * spread, 4.0 * spread)
        least = math.hypot(_LEAST_SCATTER, self.spreads.load)
        size = max(float(np.std(np.diff(off)) / math.sqrt(2.0)), least)
        place = np.arange(off.size) - 0.5 * (off.size - 1)
        trend = float(place @ off) / math.sqrt(float(place @ place)) / size
        few = math.sqrt(1.0 / _LAST + 1.0 / (off.size - _LAST))
        step = float(off[-_LAST:].mean() - off[:-_LAST].mean()) / (size * few)
        return max(abs(trend), abs(step)) > _CHANGED

    @property
    def remarks(self) -> list[str]:
        """What else is to be known, a sentence each."""
        (low, high), found = self.loads, []
        if text := self.ends_text:
            found.append(text)
        found += [f'{name} was given before and counts once' for name in self.repeated]
        knocks = [knock for one in self.evidence for knock in one.knocks]
        if knocks:
            first = knocks[0]
            found.append(
                f'{plural(len(knocks), "vibration")} of less than 10 s left out as knocks,'
                f' the first at {first.start_ns / 1e9:.0f} s ({first.source})'
            )
        if high < _ONE_LOAD * low:
            found.append(
                f'all evidence is at {low:.4g} to {high:.4g} N: beyond a fifth from there the'
                ' boundaries are known less well'
            )
        return found

    @property
    def ends_text(self) -> str:
        """How the ends of the episodes lie to the configured fold."""
        off = [track_over(end, self.reference) for end in self.edges.seen]
        if not off:
            return ''
        middle = 100.0 * (float(np.median(off)) - 1.0)
        count = '1 episode ends' if len(off) == 1 else f'{len(off)} episodes end'
        return f'{count} {abs(middle):.1f} % {"above" if middle >= 0.0 else "below"} the configured fold'


def track_over(end: End, reference: Reference) -> float:
    """Speed at an end over the configured fold speed."""
    speed, load = end.middle
    return speed / math.exp(float(reference.fold(np.array([math.log(load)]))[0]))


def calibrate(
    found: Sequence[Evidence],
    bearing: Bearing,
    tolerance: Tolerance,
    prior: Prior | None = None,
    forget: float = 0.0,
    onsets: bool = True,
    known: Sequence[str] = (),
) -> Calibration:
    """Infer a bearing's boundaries.

    Args:
        found: The recordings, with their reports.
        bearing: The bearing that is configured.
        tolerance: What its configuration states of it.
        prior: In place of the tolerances', that of an earlier result.
        forget: Standard deviation that ``ln q`` is given anew before each recording: it wears.
        onsets: Whether the times of onsets are worth something; ``False`` for a person's list.
        known: Fingerprints of the courses that the prior rests on.

    Raises:
        CalibrationError: The evidence is none, known already, or of another bearing.
    """
    reference = Reference(bearing)
    pairs, repeated = _once(found, known)
    edges = edges_of(pairs, reference, onsets)
    if repeated and not edges.tracks:
        raise CalibrationError(
            f'{", ".join(repeated)} is in the earlier result already: give other recordings'
        )
    if not edges.tracks or not edges.loads[0] > 0.0:
        raise CalibrationError(
            'there is no evidence: no report is about a time in which the shaft turned slowly'
            ' enough for stick-slip; record a slow passage with a level or reports'
        )
    own = prior_of(bearing, tolerance) if prior is None else prior
    spreads = Spreads(tolerance.load or LOAD, forget)
    posterior = infer(edges, reference, own, spreads)
    result = Calibration(reference, own, tolerance, spreads, edges, posterior, tuple(found), repeated)
    _require_own(result)
    return result


def _once(
    found: Sequence[Evidence], known: Sequence[str]
) -> tuple[list[tuple[TelemetryBins, Sequence[VibrationReport]]], tuple[str, ...]]:
    """Each course once with its reports, and the names of recordings that repeat one."""
    kept: dict[str, tuple[TelemetryBins, Sequence[VibrationReport]]] = {}
    repeated: dict[str, None] = {}
    for one in found:
        for course in one.courses:
            mark = course.fingerprint
            if mark in kept or mark in known:
                repeated[course.name] = None
            else:
                kept[mark] = course, one.reports
    return list(kept.values()), tuple(repeated)


def _require_own(found: Calibration) -> None:
    """Refuse what this bearing cannot have done, however wrong its drawing is."""
    wrong = [end for end, _ in found.doubts if not end.is_bound]
    if len(found.edges.seen) > 1 and 2 * len(wrong) > len(found.edges.seen):
        over = [track_over(end, found.reference) for end in wrong]
        raise CalibrationError(
            f'{len(wrong)} of {len(found.edges.seen)} episodes end at {min(over):.2g} to'
            f' {max(over):.2g} times the configured fold speed, where the rest does not, or where'
            ' this bearing cannot: is the level that of another bearing, or a unit wrong?'
        )


FRAGMENT_MARK = b'Made by stickslip calibrate'
"""Marks a fragment among the files of others."""
_DIGITS = 6
_LARGEST = 100.0


def inputs_of(config: BearingConfig) -> dict[str, dict[str, Any]]:
    """What a calibration remembers of the sensors: it holds in their own readings only."""
    return {'speed': _input(config.speed), 'load': _input(config.load)}


def _input(source: InputConfig) -> dict[str, Any]:
    values = (source.topic, source.field_text, source.scale, source.offset, source.unit)
    return dict(zip(INPUT_KEYS, values, strict=True))


def parameters_of_law(bearing: Bearing) -> dict[str, Any]:
    """The damping and the law of a bearing as parameters of a configuration."""
    law = bearing.friction
    own: dict[str, Any] = {'damping': _rounded(bearing.damping)}
    if isinstance(law, Tabulated):
        return own | {
            'friction.law': 'tabulated',
            'friction.speed': _rounded(law.speed),
            'friction.coefficient': _rounded(law.values),
        }
    names = ['static', 'kinetic']
    if isinstance(law, Stribeck | Stretched):
        names += ['decay', 'viscous'] + ['exponent'] * isinstance(law, Stretched)
    kind = 'stribeck' if len(names) > 2 else 'coulomb'
    return own | {
        'friction.law': kind,
        **{f'friction.{name}': _rounded(getattr(law, name)) for name in names},
    }


def to_document(
    config: BearingConfig, found: Calibration, earlier: Mapping[str, Any] | None, created: str, version: str
) -> dict[str, Any]:
    """The calibration as the documented JSON object, added to an earlier one if any."""
    past, (low, high) = earlier or {}, found.loads
    before = past.get('loads', (low, high))
    log_r, log_q = found.factors
    marks = [track.course.fingerprint for track in found.edges.tracks]
    return {
        'schema': CALIBRATION_SCHEMA,
        'bearing': config.name,
        'inputs': inputs_of(config),
        'parameters': parameters_of_law(found.bearing),
        'covariance': _rounded(found.covariance),
        'loads': _rounded([min(low, before[0]), max(high, before[1])]),
        'floor': found.floor,
        'factors': {'speeds': _rounded(math.exp(log_r)), 'loads': _rounded(math.exp(log_q))},
        'configured': parameters_of_law(found.reference.bearing),
        'boundaries': _rounded(found.boundaries()),
        'recordings': [*past.get('recordings', []), *dict.fromkeys(marks)],
        'ends': _ends(found),
        'warnings': found.warnings,
        'remarks': found.remarks,
        'created': created,
        'version': version,
    }


def _rounded(values: Any) -> Any:
    return np.vectorize(lambda x: float(f'{x:.{_DIGITS}g}'))(np.asarray(values, float)).tolist()


def _ends(found: Calibration) -> list[dict[str, Any]]:
    doubtful = {id(end): p for end, p in found.doubts}
    return [
        {
            'recording': end.recording,
            'source': end.report.source,
            'time': round(end.time * 1e9),
            'speed': _rounded(end.middle[0]),
            'load': _rounded(end.middle[1]),
            'bound': end.is_bound,
            'worthless': _rounded(doubtful.get(id(end), 0.0)),
        }
        for end in found.edges.ends
    ]


def prior_from(path: str, document: Mapping[str, Any], bearing: Bearing) -> Prior:
    """The result of an earlier calibration as a prior for the bearing that is configured.

    Raises:
        CalibrationError: It was made with another bearing's parameters, or is damaged.
    """
    if document.get('configured') != parameters_of_law(bearing):
        raise CalibrationError(
            f'{path} was made with other damping or friction than are configured now, so nothing'
            ' can be added to it: calibrate with all recordings together'
        )
    try:
        factors = [float(document['factors'][name]) for name in ('speeds', 'loads')]
        covariance = np.array(document['covariance'], dtype=float)
        np.linalg.cholesky(covariance)
        if not all(1.0 / _LARGEST < factor < _LARGEST for factor in factors):
            raise ValueError(f'factors must be between {1.0 / _LARGEST:g} and {_LARGEST:g}')
        return Prior(np.log(factors), covariance)
    except (KeyError, TypeError, ValueError, OverflowError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f'{path} is damaged: {error}') from error


def known_recordings(path: str, document: Mapping[str, Any]) -> list[str]:
    """Fingerprints of what an earlier result rests on.

    Raises:
        CalibrationError: The object is damaged.
    """
    marks = document.get('recordings', [])
    if not isinstance(marks, list) or not all(isinstance(mark, str) for mark in marks):
        raise CalibrationError(f'{path} is damaged: its recordings must be texts')
    return marks


def prior_with_bench(bearing: Bearing, tolerance: Tolerance, path: str, document: Mapping[str, Any]) -> Prior:
    """A bearing's prior with the law of ``stickslip fit --json``; the damping stays.

    Raises:
        CalibrationError: The document is none of these, or the bearing's law is another.
    """
    law = bearing.friction
    if not isinstance(law, Stribeck):
        raise CalibrationError('--bench needs the friction law stribeck without an exponent')
    try:
        if document['schema'] != 'stickslip_monitor/fit/2':
            raise ValueError(f"its schema is '{document['schema']}'")
        told = document['friction']
        fitted = Stribeck(*(float(told[name]) for name in ('static', 'kinetic', 'decay')))
        names = list(document['estimated'])
        covariance = np.array(document['covariance'], dtype=float)
        rows = np.zeros((2, len(names)))
        fall = fitted.static - fitted.kinetic
        rows[0, names.index('decay')] = 1.0 / fitted.decay
        rows[1, names.index('static')], rows[1, names.index('kinetic')] = 1.0 / fall, -1.0 / fall
        if not np.isfinite(covariance).all():
            raise ValueError('its covariance must be finite')
        (of_beta, both), (_, of_fall) = rows @ covariance @ rows.T
        if not (of_beta > 0.0 and of_fall > 0.0):
            raise ValueError('its covariance must be positive')
    except (LookupError, TypeError, ValueError, ArithmeticError, PhysicsError) as error:
        raise CalibrationError(
            f'{path} must be what stickslip fit --json printed of a Stribeck law: {error}'
        ) from error
    # ln r = -ln beta, ln q = ln(mu_s - mu_k) + ln beta, against those configured.
    of_damping = (tolerance.damping or DAMPING) ** 2
    log_beta = math.log(fitted.decay / law.decay)
    log_fall = math.log(fall / (law.static - law.kinetic))
    return Prior(
        np.array([-log_beta, log_fall + log_beta]),
        np.array(
            [[of_beta, -of_beta - both], [-of_beta - both, of_damping + of_fall + of_beta + 2.0 * both]]
        ),
    )


def fragment(config: BearingConfig, found: Calibration) -> str:
    """The law and the damping that have the calibrated boundaries, as configuration."""
    rows = parameters_of_law(found.bearing)
    damping = rows.pop('damping')
    law = ', '.join(f'{key.removeprefix("friction.")}: {value}' for key, value in rows.items())
    return (
        f'# {FRAGMENT_MARK.decode()}: {config.name} has these boundaries; no measurement of'
        ' friction.\n'
        f'damping: {damping:.6g}\n'
        f'friction: {{{law}}}\n'
    )


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
