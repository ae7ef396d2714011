# SPDX-License-Identifier: Apache-2.0
"""The verdict in sentences: what happened to a bearing, and to all of them.

Below it times, durations and quantities as a person reads them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import NamedTuple

import numpy as np

from stickslip_logs.time_order import DATES_FROM_NS, EPOCH
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.check import BearingReport
from stickslip_monitor.offline.extremes import ConditionInterval, Extreme, Verdicts, join_intervals

STICKING = (Condition.STICK_SLIP, Condition.AMPLITUDE)
_WORDS = {'clear': 'Clear', 'unknown': 'No verdict', 'warning': 'Warning', 'alarm': 'Alarm'}
GRADES = tuple(_WORDS)
"""The grades of a finding, the worst last."""
# Keeps a number and its unit on one line.
_SPACE = '\N{NO-BREAK SPACE}'


@dataclass(frozen=True, slots=True)
class Finding:
    """The verdict on a bearing, or on everything."""

    grade: str
    sentences: tuple[str, ...]  # the first is the verdict, the others add to it

    @property
    def word(self) -> str:
        """The grade as people read it."""
        return _WORDS[self.grade]

    @property
    def rank(self) -> int:
        """Severity of the grade, from 0: its place in :data:`GRADES`."""
        return GRADES.index(self.grade)


class Fact(NamedTuple):
    """One figure that matters: its name, its value, and when and where it was."""

    name: str
    value: str
    note: str = ''


@dataclass(frozen=True, slots=True)
class Course:
    """Course of one bearing in one recording."""

    config: BearingConfig
    item: BearingReport  # what the check found, with an outline
    intervals: Sequence[ConditionInterval]  # the alarm's conditions from start to end
    sources: Sequence[str] = ()  # faults of the inputs' sources, a clause for each
    questions: Sequence[str] = ()  # the same where inputs look like another unit or topic

    @property
    def name(self) -> str:
        """Name of the bearing."""
        return self.config.name

    @property
    def scan(self) -> Verdicts:
        """The outline of its verdicts."""
        assert self.item.outline is not None
        return self.item.outline

    @property
    def span(self) -> float:
        """Duration of the recording [s]."""
        return max(0, self.intervals[-1].end_ns - self.intervals[0].start_ns) * 1e-9


def facts(course: Course) -> tuple[Fact, ...]:
    """Return the key figures: time in stick-slip, worst margins, amplitude, probability, vibration.

    Those without a value are absent, except the first.
    """
    sticking = _total_seconds(join_intervals(course.intervals, STICKING))
    note = f'{format_share(sticking, course.span)} of the time' if sticking else ''
    facts_found = [Fact('stick-slip predicted', format_duration(sticking) if sticking else 'never', note)]
    for name, title, shown in (
        ('fold_margin', 'least fold margin', format_margin),
        ('hopf_margin', 'least Hopf margin', format_margin),
        ('amplitude', 'greatest amplitude', format_millimetres),
    ):
        if name in course.item.worst:
            extreme = course.item.worst[name]
            note = f'{format_time_of_day(extreme.time_ns)}, at {format_point(course, extreme)}'
            facts_found.append(Fact(title, shown(extreme.value), note))
    point, measured = course.scan.assessment, course.item.measured
    if point.has_belief:
        can, will = (np.nanmax(p, initial=0.0) for p in (point.probability_can, point.probability_will))
        note = f'that it starts by itself: at most {will:.0%}'
        facts_found.append(Fact('greatest probability of stick-slip', f'{can:.0%}', note))
    if measured is not None:
        vibrating, quiet, unknown = (
            format_duration(measured[key]) for key in ('vibrating', 'quiet', 'unknown')
        )
        facts_found.append(Fact('vibration measured', vibrating, f'quiet for {quiet}, unknown for {unknown}'))
    return tuple(facts_found)


def format_point(course: Course, extreme: Extreme) -> str:
    """Return the operating point of an extreme as words: shaft speed and load."""
    speed = float(course.config.bearing.speed.from_surface(extreme.point.speed, 'rpm'))
    return f'{format_rpm(speed)} and {format_load(extreme.point.load)}'


def judge_bearing(course: Course) -> Finding:
    """Return grade and sentences on one bearing: the verdict first, doubts and questions last.

    The grade is 'unknown' in place of 'clear' where an input has two sources.
    """
    finding = _judge_course(course)
    # With two mixed sources, "clear" cannot be trusted.
    grade = 'unknown' if course.sources and finding.grade == 'clear' else finding.grade
    doubts = [f'In doubt: {text}.' for text in course.sources]
    questions = (text[:1].upper() + text[1:] for text in course.questions)
    return _make_finding(grade, *finding.sentences, *doubts, *questions)


def _judge_course(course: Course) -> Finding:
    """Grade a bearing by its conditions, without doubts and questions.

    'alarm' for stick-slip, else 'warning' for its neighbourhood. Without both 'unknown' if there is no
    operating point or inputs were missing for over half of the time, 'warning' if for less, else 'clear'.
    """
    name = course.config.name
    if not course.scan.time_ns.size:
        text = f'{name}: no verdict: the recording has no usable operating point.'
        return _make_finding('unknown', text, _lost_input_sentence(course))
    sticking = join_intervals(course.intervals, STICKING)
    near = join_intervals(course.intervals, (Condition.CAUTION, Condition.BISTABLE))
    if sticking:
        return _make_finding(
            'alarm',
            _stick_slip_sentence(course, sticking),
            _amplitude_sentence(course),
            _lost_input_sentence(course),
        )
    if near:
        return _make_finding(
            'warning',
            _margin_sentence(course, near),
            _least_margin_sentence(course),
            _lost_input_sentence(course),
        )
    lost = _lost_input_sentence(course)
    limits = ' while the inputs were valid' if lost else ''
    clear = f'{name}: no stick-slip was predicted, and the bearing kept clear of it{limits}.'
    grade = 'unknown' if _lost_seconds(course) > 0.5 * course.span else 'clear'
    return _make_finding(
        'warning' if lost and grade == 'clear' else grade, clear, _least_margin_sentence(course), lost
    )


def _make_finding(grade: str, *sentences: str) -> Finding:
    """Return a finding of those sentences that are not empty."""
    return Finding(grade, tuple(text for text in sentences if text))


def _total_seconds(parts: Iterable[ConditionInterval]) -> float:
    """Return the summed duration of intervals [s]."""
    return sum(interval.seconds for interval in parts)


def _format_times(parts: Sequence[ConditionInterval]) -> str:
    """Return when the intervals were, one at least and in order of time, as the end of a sentence."""
    first, last = parts[0].start_ns, parts[-1].end_ns
    day, last_day = format_date(first), format_date(last)
    zone = ' UTC' if day else ''
    if len(parts) == 1 and day == last_day:
        return f'from {format_time_of_day(first)} to {format_time_of_day(last)}{zone}' + _on_date(day)
    later = f'{format_time_of_day(last)}{zone}{_on_date(last_day)}'
    earlier = (
        format_time_of_day(first) if day == last_day else f'{format_time_of_day(first)}{zone}{_on_date(day)}'
    )
    return f'between {earlier} and {later}'


def _on_date(day: str) -> str:
    """Return a date as the end of a sentence; '' for none."""
    return f' on {day}' if day else ''


def _stick_slip_sentence(course: Course, sticking: Sequence[ConditionInterval]) -> str:
    """Return the sentence on one interval or more of stick-slip: how long, how often and when."""
    total = format_duration(_total_seconds(sticking))
    often = '' if len(sticking) == 1 else f' in {len(sticking)} spells'
    return f'{course.config.name}: stick-slip was predicted for {total}{often}, {_format_times(sticking)}.'


def _amplitude_sentence(course: Course) -> str:
    """Return the sentence on the greatest amplitude and its limit; '' without an amplitude."""
    extreme = course.item.worst.get('amplitude')
    if extreme is None:
        return ''
    amplitude, where = format_millimetres(extreme.value), format_point(course, extreme)
    text = f'The greatest predicted amplitude was {amplitude}, at {where}'
    limit = course.config.alarm.amplitude_limit
    above = join_intervals(course.intervals, (Condition.AMPLITUDE,))
    if above:
        active = format_duration(_total_seconds(above))
        text += f'; the alarm for the limit of {format_millimetres(limit)} was active for {active}'
    elif math.isfinite(limit):
        below = 'below' if extreme.value <= limit else 'and not for long above'
        text += f', {below} the limit of {format_millimetres(limit)}'
    return f'{text}.'


def _margin_sentence(course: Course, near: Sequence[ConditionInterval]) -> str:
    """Return the sentence on one interval or more ``near`` the stick-slip region, without stick-slip."""
    inside = _total_seconds(join_intervals(course.intervals, (Condition.BISTABLE,)))
    text = f'{course.config.name}: no stick-slip was predicted, but the bearing was'
    if inside:
        text += f' for {format_duration(inside)} where a disturbance could have started it, and'
    text += f' within the caution margin or closer for {format_duration(_total_seconds(near))}'
    return f'{text}, {_format_times(near)}.'


def _least_margin_sentence(course: Course) -> str:
    """Return the sentence on the least fold margin, or that no recorded load has a cycle."""
    extreme = course.item.worst.get('fold_margin')
    if extreme is None:
        return 'At no recorded load does any speed have a stick-slip cycle.'
    lowest = format_margin(extreme.value)
    return f'The least fold margin was {lowest}, at {format_point(course, extreme)}.'


def _lost_seconds(course: Course) -> float:
    """Return for how long an input was missing [s]."""
    return _total_seconds(join_intervals(course.intervals, (Condition.INPUT_STALE,)))


def _lost_input_sentence(course: Course) -> str:
    """Return the sentence on the time with a missing input; '' without any."""
    seconds = _lost_seconds(course)
    if not seconds:
        return ''
    missing = f'{format_duration(seconds)} ({format_share(seconds, course.span)} of the time)'
    return f'An input was missing for {missing}: there is no verdict for that time.'


def judge_all(parts: Sequence[tuple[str, Finding]]) -> Finding:
    """Return the verdict over all bearings, naming the first ten that are not clear.

    ``parts`` has the recording's name and the finding of each bearing, of one at least; the finding of
    a single one is returned as it is.
    """
    if len(parts) == 1:
        return parts[0][1]
    grade = max((finding for _, finding in parts), key=lambda finding: finding.rank).grade
    counts = {g: sum(finding.grade == g for _, finding in parts) for g in GRADES}
    of = f'of {len(parts)} {_counted_noun(parts)}'
    if counts['alarm']:
        text = f'Stick-slip was predicted in {counts["alarm"]} {of}.'
    elif counts['warning']:
        text = f'No stick-slip was predicted; {counts["warning"]} {of} gave warnings.'
    elif counts['unknown']:
        text = f'No stick-slip was predicted, but {counts["unknown"]} {of} have no sound verdict.'
    else:
        text = f'No stick-slip was predicted in any {of}.'
    worst = [f'{name}, {finding.sentences[0]}' for name, finding in parts if finding.grade != 'clear']
    return _make_finding(grade, text, *worst[:10])


def _counted_noun(parts: Sequence[tuple[str, Finding]]) -> str:
    """Return the plural of what the report counts: recordings, bearings or bearings in recordings."""
    recordings = len({name for name, _ in parts})
    if recordings == len(parts):
        return 'recordings'
    return 'bearings' if recordings == 1 else 'bearings in recordings'


# --- times, durations and quantities -----------------------------------------------------------


def is_dated(time_ns: int) -> bool:
    """Return whether a time [ns] is a date (:data:`.DATES_FROM_NS` or later), not a count from some start."""
    return time_ns >= DATES_FROM_NS


def _round_time(time_ns: int, step_ns: int) -> datetime:
    """Return a time [ns since 1970] in UTC, rounded to a step of whole microseconds."""
    return EPOCH + timedelta(microseconds=round(time_ns / step_ns) * (step_ns // 1000))


def format_date(time_ns: int) -> str:
    """Format the date in UTC as ``2026-05-04``; empty for a time without one."""
    return f'{_round_time(time_ns, 1000):%Y-%m-%d}' if is_dated(time_ns) else ''


def format_clock(time_ns: int) -> str:
    """Format the time of day in UTC to a tenth of a second; seconds for a time without a date."""
    return (
        f'{_round_time(time_ns, 10**8):%H:%M:%S.%f}'[:-5] if is_dated(time_ns) else f'{time_ns * 1e-9:.1f} s'
    )


def format_time_of_day(time_ns: int) -> str:
    """Format the time of day in UTC to the second; whole seconds for a time without a date."""
    return f'{_round_time(time_ns, 10**9):%H:%M:%S}' if is_dated(time_ns) else f'{time_ns * 1e-9:.0f} s'


def format_iso(time_ns: int) -> str:
    """Format a time as ISO 8601 in UTC, for machines; empty for a time without a date."""
    return f'{_round_time(time_ns, 1000):%Y-%m-%dT%H:%M:%S.%fZ}' if is_dated(time_ns) else ''


def format_duration(seconds: float) -> str:
    """Format a duration [s] in at most two units: ``1 h 5 min``, ``2 min 10 s``, ``4.2 s``.

    With no-break spaces. The smaller unit is cut, not rounded. A duration that is not finite is 'for ever'.
    """
    if not math.isfinite(seconds):
        return 'for ever'
    if seconds < 9.95:
        return f'{seconds:.1f}{_SPACE}s'
    whole = round(seconds)
    for size, unit, smaller, small_unit in (
        (86_400, 'd', 3600, 'h'),
        (3600, 'h', 60, 'min'),
        (60, 'min', 1, 's'),
    ):
        if whole >= size:
            rest = whole % size // smaller
            more = f'{_SPACE}{rest}{_SPACE}{small_unit}' if rest else ''
            return f'{whole // size}{_SPACE}{unit}{more}'
    return f'{whole}{_SPACE}s'


def format_share(part: float, whole: float) -> str:
    """Format a part of a whole in per cent; 'below 0.1 %' for less, '0 %' for none or of none."""
    if whole <= 0.0 or part <= 0.0:
        return f'0{_SPACE}%'
    percent = 100.0 * part / whole
    if percent < 0.1:
        return f'below 0.1{_SPACE}%'
    return f'{percent:.1f}{_SPACE}%' if percent < 10.0 else f'{percent:.0f}{_SPACE}%'


def format_margin(value: float) -> str:
    """Format a margin (0.1 is '+10.0 %') with its sign; 'no boundary' if infinite."""
    if math.isinf(value):
        return 'no boundary'
    return f'{100.0 * value:+.1f}{_SPACE}%'.replace('-', '\N{MINUS SIGN}')


def format_millimetres(metres: float) -> str:
    """Format an amplitude [m] in millimetres, to three digits."""
    return f'{metres * 1e3:.3g}{_SPACE}mm'


def format_rpm(value: float) -> str:
    """Format a shaft speed [rpm] to a tenth."""
    return f'{value:.1f}{_SPACE}rpm'.replace('-', '\N{MINUS SIGN}')


def format_load(newtons: float) -> str:
    """Format a load [N] in kN, as in the sentences of alarms."""
    return f'{newtons / 1e3:.4g}{_SPACE}kN'


def format_count(number: int, noun: str) -> str:
    """Return a number with its noun, which takes an s: ``1 event``, ``1 250 events``."""
    return f'{format_grouped(number)} {noun}{"" if number == 1 else "s"}'


def format_grouped(number: int) -> str:
    """Format a whole number with narrow spaces between its thousands."""
    return f'{number:,}'.replace(',', '\N{NARROW NO-BREAK SPACE}')
