# SPDX-License-Identifier: Apache-2.0
"""A calibration: another bearing with its uncertainty, and what its evidence is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import CalibrationError, plural
from stickslip_monitor.lab.calibration.edges import Edges, End, Reference, edges_of
from stickslip_monitor.lab.calibration.evidence import TelemetryBins, VibrationReport
from stickslip_monitor.lab.calibration.level import LevelBins, level_reports, modes_of
from stickslip_monitor.lab.calibration.posterior import Posterior, Prior, Spreads, doubt, infer
from stickslip_monitor.physics.bearing import Bearing
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
