# SPDX-License-Identifier: Apache-2.0
"""Finds the edges of vibrations, which show a bearing's boundaries.

* An *end* with quiet after it, while speed over the believed fold was rising, was at the fold.
* Any other vibration only says that the fold is not below it: a *bound*.
* An *onset* after quiet: a disturbance of steady sliding had grown by the usual number of e-folds
  along the passage until then; a passage without one is censored: it had not grown so far.

The configured bearing is a unit of speed here, not a truth: nothing asks whether a vibration
agrees with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stickslip_lab.calibration.evidence import TelemetryBins, VibrationReport
from stickslip_lab.calibration.level_reports import EDGE, FOOT, SLOWEST_FALL
from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.physics import averaging
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.lubrication import as_measured

LAGS = (-0.75, 0.0, 0.75, 1.5, 2.25)
"""Delays of the speed against the vibration that are considered, the same for all edges [s]."""
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the time for which an undisturbed cycle outlives the fold: noise or a swell ends it sooner."""
# Speeds farther above the fold than by this factor are no slow passage.
_MAX_RATIO = 3.0


class Reference:
    """Both boundaries of a configured bearing over the load, as units of speed and load.

    Where friction depends on the load they are those of friction as measured, at reference points.

    Args:
        bearing: The bearing, as configured.

    Raises:
        CalibrationError: It has no fold.

    Attributes:
        bearing: The bearing with friction as measured, without lubrication.
        log_load: Loads with a fold, ascending, shape (n,) [ln N].
        log_fold: Fold speed there, the one that decides [ln m/s].
        log_hopf: Hopf speed there; far below where there is none [ln m/s].
    """

    def __init__(self, bearing: Bearing) -> None:
        bearing = as_measured(bearing)
        table = boundary_table(bearing)
        if not (bearing.damping > 0.0 and math.isfinite(table.first)):
            raise CalibrationError(
                'a calibration needs a bearing with a fold: damping above 0, and a friction law'
                ' that falls with speed'
            )
        self.bearing = bearing
        self.log_load = table.first + table.step * np.arange(1, len(table.pieces[0]) + 1)
        load = np.exp(self.log_load)
        with np.errstate(all='ignore'):
            fold = table.fold(load)
            hopf = np.asarray(averaging.hopf_speed(bearing, load))
        is_known = np.isfinite(fold) & (fold > 0.0)
        self.log_load = self.log_load[is_known]
        self.log_fold = np.log(fold[is_known])
        self.log_hopf = np.log(np.where(hopf > 0.0, hopf, 1e-9))[is_known]

    def fold(self, log_load: FloatArray) -> FloatArray:
        """Return ``ln V_F`` [ln m/s] at loads ``ln N``, of their shape.

        Beyond the known loads it is that of the nearest.
        """
        return np.interp(log_load, self.log_load, self.log_fold)

    def hopf(self, log_load: FloatArray) -> FloatArray:
        """Return ``ln V_H`` [ln m/s] at loads ``ln N``, of their shape; far below where there is none.

        Beyond the known loads it is that of the nearest.
        """
        return np.interp(log_load, self.log_load, self.log_hopf)

    def slope(self, log_load: float) -> float:
        """Return ``d ln V_F / d ln N`` at ``ln N``."""
        above, below = self.fold(np.array([log_load + 0.02, log_load - 0.02]))
        return float(above - below) / 0.04


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """The end of a vibration, at which the fold is; or a bound: a point that the fold is not below."""

    report: VibrationReport  # the vibration
    recording: str  # name of the recording
    time: float  # when [s]
    # Possible surface speeds [m/s] and loads [N] at the fold: for each of SHARES each of LAGS, shape (25, 2);
    # of a bound shape (1, 2).
    points: FloatArray
    timing: float  # standard deviation of ln V/V_F by the tolerance of the time; 0 for a bound

    @property
    def is_bound(self) -> bool:
        """Whether the fold is only known not to be below the point."""
        return len(self.points) == 1

    @property
    def middle(self) -> tuple[float, float]:
        """Speed [m/s] and load [N] in the middle of what is possible."""
        speed, load = self.points[len(self.points) // 2]
        return float(speed), float(load)


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """Quiet up to an onset of vibration, or to the end of the report of quiet: n bins."""

    time: float  # the end of the quiet [s]
    bin_time: FloatArray  # times of the bins, ascending, shape (n,) [s]
    speed: FloatArray  # of the surface, shape (n,) [m/s]
    load: FloatArray  # shape (n,) [N]
    began: bool  # whether a vibration began at its end
    tolerance: float  # how far that time may be off [s]
    trust: float  # probability that the reports are right


@dataclass(slots=True, eq=False)
class Edges:
    """Ends, passages and courses of all recordings, each in order of time."""

    ends: list[End] = field(default_factory=list)  # with bounds
    passages: list[Passage] = field(default_factory=list)
    tracks: list[ReportedCourse] = field(default_factory=list)

    @property
    def seen(self) -> list[End]:
        """The ends that were at the fold, without bounds."""
        return [end for end in self.ends if not end.is_bound]

    @property
    def loads(self) -> tuple[float, float]:
        """Least and greatest load below three times the fold speed [N]; (0, 0) if nothing was as slow."""
        slow = [one.load[one.over < _MAX_RATIO] for one in self.tracks]
        loads = np.concatenate([np.empty(0), *slow])
        return (float(loads.min()), float(loads.max())) if loads.size else (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ReportedCourse:
    """A course against the configured fold, with the reports about it: n bins."""

    name: str  # the recording
    reports: tuple[VibrationReport, ...]  # in order of time
    time: FloatArray  # while there was an operating point, shape (n,) [s]
    speed: FloatArray  # of the surface, shape (n,) [m/s]
    load: FloatArray  # shape (n,) [N]
    over: FloatArray  # speed over the configured fold speed, shape (n,)

    def at(self, time: float) -> tuple[float, float]:
        """Return mean speed [m/s] and load [N] within 1 s of a time [s]; interpolated if no bin is there."""
        near = np.abs(self.time - time) <= 1.0
        if near.any():
            return float(self.speed[near].mean()), float(self.load[near].mean())
        return float(np.interp(time, self.time, self.speed)), float(np.interp(time, self.time, self.load))


def reported_course(
    course: TelemetryBins, reports: Sequence[VibrationReport], reference: Reference
) -> ReportedCourse | None:
    """Return the bins of a course in which the shaft turned under load, and the reports about them.

    Reports shorter than twice their tolerance are left out.

    Returns:
        The course; ``None`` where fewer than ten bins, or no reports, are left.
    """
    used = (course.speed > 0.0) & (course.load > 0.0)
    if np.count_nonzero(used) < 10:
        return None
    time = course.time_ns[used] / 1e9
    speed, load = course.speed[used], course.load[used]
    # A report shorter than its two ends are uncertain is no evidence.
    about = tuple(
        one
        for one in reports
        if one.end_ns > time[0] * 1e9 and one.start_ns < time[-1] * 1e9 and one.seconds >= 2.0 * one.tolerance
    )
    over = speed / np.exp(reference.fold(np.log(load)))
    return ReportedCourse(course.name, about, time, speed, load, over) if about else None


def find_edges(
    courses: Sequence[tuple[TelemetryBins, Sequence[VibrationReport]]],
    reference: Reference,
    onsets: bool = True,
) -> Edges:
    """Return the edges of vibration in the reports about some courses, in order of time.

    Args:
        courses: Courses of at least one bin, each with the reports about it; those that
            :func:`reported_course` returns ``None`` for are skipped.
        reference: The configured bearing.
        onsets: Whether to return passages as well: ``False`` for a person's list, as people hear late.
    """
    edges = Edges()
    for course, reports in sorted(courses, key=lambda one: int(one[0].time_ns[0])):
        track = reported_course(course, reports, reference)
        if track is not None:
            edges.tracks.append(track)
            _read_track(edges, track, reference, onsets)
    return edges


def _read_track(edges: Edges, track: ReportedCourse, reference: Reference, onsets: bool) -> None:
    """Add the ends of a course, and with ``onsets`` its passages, to ``edges``."""
    first, last = float(track.time[0]), float(track.time[-1])
    begin = first
    for one, after in zip(track.reports, [*track.reports[1:], None], strict=True):
        a, b = max(one.start_ns / 1e9, first), min(one.end_ns / 1e9, last)
        if after and (after.squeal == one.squeal or after.start_ns / 1e9 - b > one.tolerance + 1.0):
            after = None  # they do not meet
        if one.squeal:
            end = _find_end(track, one, a, b, after is not None, reference)
            edges.ends += [end] if end else []
            # Where it ended inside it is not known how far a disturbance has grown.
            begin = b if end and not end.is_bound else math.inf
        else:
            passage = _find_passage(track, one, begin, b, after)
            edges.passages += [passage] if passage and onsets else []
            begin = b


def _find_passage(
    track: ReportedCourse, report: VibrationReport, begin: float, b: float, onset: VibrationReport | None
) -> Passage | None:
    """Return the quiet between two times as a passage, with or without an onset at its end.

    An onset while the speed changes by a factor e in less than 25 s tells nothing: a second by which a
    tachometer lags is 4 % of the Hopf speed then. In 20 ships with ramps of 15 to 60 s such onsets made it
    5.5 % too high, and its 90 % interval held in 14.

    Args:
        track: The course.
        report: The report of quiet.
        begin: First time [s]; ``inf`` where it is unknown how far a disturbance has grown.
        b: End of the quiet [s]; before an onset the bins go on by the tolerance and the longest lag.
        onset: The vibration that follows at once; ``None`` for none.

    Returns:
        The passage; ``None`` if it has fewer than four bins, stays three times above the fold, or its speed
        changes too fast at the onset.
    """
    late = report.tolerance + LAGS[-1] if onset else 0.0
    rows = (track.time >= begin) & (track.time <= b + late)
    if np.count_nonzero(rows) < 4 or track.over[rows].min() >= _MAX_RATIO:
        return None
    time, speed = track.time[rows], track.speed[rows]
    if onset and _log_speed_rate(time, speed, b) > 1.0 / 25.0:
        return None
    trust = min(report.trust, onset.trust) if onset else report.trust
    return Passage(b, time, speed, track.load[rows], onset is not None, report.tolerance, trust)


def _log_speed_rate(time: FloatArray, speed: FloatArray, at: float) -> float:
    """Return the absolute rate of ``ln V`` about a time [1/s].

    Args:
        time: Times of the bins [s], shape (n,).
        speed: Surface speed in them, above 0 [m/s].
        at: The time [s]; bins within 4 s of it count. Fewer than two of them give 0.
    """
    near = np.abs(time - at) <= 4.0
    if np.count_nonzero(near) < 2:
        return 0.0
    return float(abs(np.polyfit(time[near] - at, np.log(speed[near]), 1)[0]))


def _find_end(
    track: ReportedCourse, report: VibrationReport, a: float, b: float, meets: bool, reference: Reference
) -> End | None:
    """Return the end of a vibration: at the fold where it ``meets`` quiet while V/V_F rises, else a bound.

    Args:
        track: The course.
        report: The report of the vibration.
        a: When it begins in the course [s].
        b: When it ends there [s].
        meets: Whether a report of quiet follows at once.
        reference: The configured bearing.

    Returns:
        The end; ``None`` where no bin of the course lies in the vibration, less its tolerance at both ends.
    """
    off = report.tolerance
    whole = time_beyond_fold(track, b, reference) if meets and report.rings else 0.0
    middle = b - 0.5 * whole
    inside = (track.time >= a + off) & (track.time <= max(middle - off, a + off))
    if not inside.any():
        return None
    if meets and _is_rising(track, middle, inside):
        points = [track.at(b - share * whole + lag) for share in SHARES for lag in LAGS]
        off /= 2.0 if off > 3.0 else 1.0  # a deviation: nobody errs by all of a long tolerance
        (v0, n0), (v1, n1) = track.at(middle - off), track.at(middle + off)
        slope = reference.slope(math.log(n0))
        timing = 0.5 * abs(math.log(v1 / v0) - slope * math.log(n1 / n0))
        return End(report, track.name, b, np.array(points), timing)
    return End(report, track.name, *_find_farthest(track, inside), 0.0)


def _is_rising(track: ReportedCourse, time: float, inside: BoolArray) -> bool:
    """Return whether V/V_F has risen 3 % above its least ``inside`` by a time [s], and stays so for 3 s.

    A shaft that stops does not. The ratio is averaged over nine bins. ``inside`` has shape (n,), at least one
    of them true.
    """
    wide = _moving_average(track.over, 9)
    after = (track.time > time) & (track.time <= time + 3.0)
    least_ratio = 1.03 * wide[inside].min()
    return bool(
        np.interp(time, track.time, wide) > least_ratio
        and after.any()
        and track.over[after].mean() > least_ratio
    )


def _find_farthest(track: ReportedCourse, inside: BoolArray) -> tuple[float, FloatArray]:
    """Return the point at which V/V_F, averaged over three bins, was highest among the bins ``inside``.

    At least one bin must be inside.

    Returns:
        Its time [s], and its speed [m/s] and load [N] in an array of shape (1, 2).
    """
    rows = np.flatnonzero(inside)
    time = float(track.time[rows[np.argmax(_moving_average(track.over, 3)[rows])]])
    return time, np.array([track.at(time)])


def _moving_average(values: FloatArray, width: int) -> FloatArray:
    """Return means over ``width`` neighbours, an odd number, shape (n,); end values are repeated outside."""
    padded = np.pad(values, width // 2, 'edge')
    return np.convolve(padded, np.full(width, 1.0 / width), 'valid')


def time_beyond_fold(track: ReportedCourse, end: float, reference: Reference) -> float:
    """Return how long an undisturbed cycle has outlived its fold when its level ends [s]: 0 to 30.

    With ``y = a/V``, 1 inside, ``d ln y/dt = (c/2m) (N/N_b(y) - 1)``, where ``ln N_b`` goes from
    that of the Hopf speed at ``y = 0`` to that of the fold at ``y = 1`` as ``y^2`` does. For each
    time at which the fold may have been passed the amplitude is followed, and the end of its level found as
    in a measured one. The fold counts as passed at the first time from which on the level lasts to ``end``.

    Args:
        track: The course.
        end: When the level ends [s].
        reference: The configured bearing.
    """
    step = 0.25
    clock = np.arange(end - 30.0, end + 10.0, step)
    passed = clock[(clock <= end) & (clock >= track.time[0])]
    if not passed.size:
        return 0.0
    ratio = np.log(np.interp(passed, track.time, track.over))[:, None]
    speed = np.log(np.interp(clock, track.time, track.speed)) - ratio
    load = np.log(np.interp(clock, track.time, track.load))
    # At the fold's own scale of speed: the loads from which on there is a cycle, and it is unstable; far
    # below where it is so at every load.
    fold, hopf = (
        np.interp(speed, np.maximum.accumulate(boundary), reference.log_load, left=-50.0)
        for boundary in (reference.log_fold, reference.log_hopf)
    )
    rate = reference.bearing.damping / (2.0 * reference.bearing.mass)
    y = np.ones((passed.size, clock.size))
    for k in range(1, clock.size):
        square = y[:, k - 1] ** 2
        bound = hopf[:, k] * (1.0 - square) + fold[:, k] * square
        drive = np.exp(np.minimum(load[k] - bound, 3.0))
        grown = np.minimum(y[:, k - 1] * np.exp((drive - 1.0) * rate * step), 1.0)
        y[:, k] = np.where(clock[k] > passed, grown, 1.0)
    edge, foot = (_first_true(y < 10.0 ** (-below / 20.0), clock) for below in (EDGE, FOOT))
    with np.errstate(invalid='ignore'):
        rings = foot - edge <= SLOWEST_FALL
        seen = np.where(rings, edge - (foot - edge) * EDGE / (FOOT - EDGE), edge)
    # The last stretch of times that explain the end: those before are of the way down.
    early = np.flatnonzero(np.maximum(seen, passed) < end)
    first = int(early[-1]) + 1 if early.size else 0
    return float(end - passed[first]) if first < passed.size else 0.0


def _first_true(is_true: BoolArray, clock: FloatArray) -> FloatArray:
    """Return the first of n times ``clock`` at which each row of (rows, n) is true; ``inf`` for never."""
    return np.where(is_true.any(axis=1), clock[np.argmax(is_true, axis=1)], np.inf)
