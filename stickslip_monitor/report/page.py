# SPDX-License-Identifier: Apache-2.0
"""A report on recordings: one HTML page without network, script or further files, or a picture.

What is said of one recording comes from another process, with the outlines that pictures are drawn
of. Of an archive the bearings that need a look most are drawn, whatever its size.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_monitor import __version__
from stickslip_monitor.drawing import canvas
from stickslip_monitor.drawing.map import draw_map, track_of_scan
from stickslip_monitor.drawing.timeline import Timeline, draw_timeline, marked_events
from stickslip_monitor.errors import ReportError
from stickslip_monitor.monitor.bearing_records import finite_or_none
from stickslip_monitor.monitor.input_faults import fault_text
from stickslip_monitor.monitor.parameter_file import load_parameters
from stickslip_monitor.monitor.parameters import (
    BEARING_PARAMETERS,
    NODE_PARAMETERS,
    InputConfig,
    MonitorConfig,
)
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter
from stickslip_monitor.offline.check import BearingReport, CheckReport
from stickslip_monitor.offline.extremes import condition_intervals
from stickslip_monitor.offline.input_report import InputReport
from stickslip_monitor.report import summary
from stickslip_monitor.report.summary import Course, Fact, Finding, facts, judge_all, judge_bearing
from stickslip_monitor.safe_files import printable

MAX_EVENTS = 400
"""Events of a bearing that its table has room for: the most severe."""
# Topics of a recording that its table has room for.
_MAX_TOPICS = 100
_GRADES = {'OK': 'clear', 'WARN': 'warning', 'ERROR': 'alarm'}
_CONDITIONS = {condition.value: name for condition, name in canvas.CONDITION_NAMES.items()}
_ORDER = tuple(_GRADES)
_FILTERS = ('clock', 'count', 'date', 'duration', 'grouped', 'iso', 'share', 'time_of_day')
# A phone shows an inch of the narrow ones on a hundred pixels, so that letters can be read.
_WIDE, _NARROW = canvas.WIDTH, 3.6
# Sizes of the map on a screen and on a phone, where its legend takes more rows [inch].
_MAP_WIDE, _MAP_NARROW = (_WIDE, canvas.HEIGHT), (_NARROW, 5.4)
# A page with more bearings takes minutes to make, and nobody reads it to the end.
MAX_DRAWN = 12
_NOT_DRAWN = (
    f'Not drawn: pictures are of the {MAX_DRAWN} bearings that need a look most.'
    ' `stickslip map --track BAG --bearing NAME` draws the map of this one.'
)
_MAP_CAPTION = (
    'Smoothed track of the operating point over the regions of the model, from start'
    ' (ring) to end (square); raw measurements in grey. Marks show where the alarm changed.'
    ' Numbers on lines are amplitudes of exact stick-slip cycles.'
)
_SPEED_CAPTION = (
    'Speed lies in the red region where stick-slip starts by itself, in the amber one where a'
    ' disturbance can start it, in the yellow one within the caution margin. Long recordings are'
    ' drawn by their envelope: every extreme is there.'
)
_FEW_MARKED = (
    ' Of so many events only the alarms are marked, or none; the band at the bottom shows'
    ' the worst of each stretch.'
)


class Picture(NamedTuple):
    """A picture as inline SVG: for a wide page, for a narrow one, and what it shows in words."""

    wide: str
    narrow: str
    caption: str


@dataclass(frozen=True, slots=True)
class BearingPart:
    """The text and pictures on one bearing in one recording."""

    anchor: str  # a word for it alone on a page
    finding: Finding
    # By quantity, what a reader wants to know of an input beside its record.
    inputs: Mapping[str, Mapping[str, Any]]
    facts: tuple[Fact, ...] = ()
    map: Picture | None = None
    timeline: Picture | None = None
    note: str = ''  # why nothing is drawn


@dataclass(frozen=True, slots=True)
class RecordingPart:
    """The text and pictures on one recording."""

    anchor: str
    name: str
    document: Mapping[str, Any]  # what ``check --json`` prints of it
    findings: tuple[Finding, ...]  # the verdicts on its bearings, or that there is none
    bearings: Mapping[str, BearingPart] = field(default_factory=dict)  # empty in a row of a table
    courses: tuple[Course, ...] = ()  # what can be drawn


def recording_part(document: Mapping[str, Any], checked: CheckReport | None = None) -> RecordingPart:
    """Make the part on a recording from its record and, if it was checked, from its outlines.

    It has no bearings yet; without a check (``None``) the finding is the record's error.
    """
    # A path may be no text.
    anchor = f'bag-{hashlib.sha256(os.fsencode(document["path"])).hexdigest()[:12]}'
    name = printable(os.path.basename(os.path.realpath(document['path'])))  # noqa: PTH119
    if checked is None:
        text = f'this recording could not be checked: {document["error"]}'
        return RecordingPart(anchor, name, document, (Finding('unknown', (text,)),))
    courses = tuple(_course_of(checked, item) for item in checked.bearings.values())
    findings = tuple(map(judge_bearing, courses))
    return RecordingPart(anchor, name, document, findings, courses=courses)


class Archive:
    """The parts of a report on many recordings.

    Outlines are kept of the recordings whose bearings need a look most, so that memory and page
    grow with the others by a row each.
    """

    def __init__(self) -> None:
        self.parts: list[RecordingPart] = []
        """All of them, in the order in which they were added."""
        self._urgent: list[tuple[int, int, int]] = []

    def add(self, part: RecordingPart) -> None:
        """Add a part; drop the outlines of recordings that are no longer among the most urgent.

        These have the :data:`MAX_DRAWN` most urgent bearings.
        """
        number = len(self.parts)
        self.parts.append(part)
        entries = [(-finding.rank, number, k) for k, finding in enumerate(part.findings)]
        ranked = sorted([*self._urgent, *entries[: len(part.courses)]])
        self._urgent = ranked[:MAX_DRAWN]
        still_urgent = {n for _, n, _ in self._urgent}
        for n in {n for _, n, _ in ranked[MAX_DRAWN:]} - still_urgent:
            self.parts[n] = replace(self.parts[n], courses=())

    def shown(self) -> Iterator[RecordingPart]:
        """Yield the parts with texts on each kept bearing, and pictures (drawn here) for the most urgent.

        Raises:
            DrawingError: matplotlib is not installed.
        """
        urgent = {(n, k) for _, n, k in self._urgent}
        for n, part in enumerate(self.parts):
            bearings: dict[str, BearingPart] = {}
            for k, (course, finding) in enumerate(zip(part.courses, part.findings, strict=False)):
                anchor = f'{part.anchor}-{course.name}'
                bearings[course.name] = _bearing_part(anchor, course, finding, (n, k) in urgent)
            yield replace(part, bearings=bearings)


def _course_of(checked: CheckReport, item: BearingReport) -> Course:
    """Return configuration, intervals, doubts and questions of one bearing of a report."""
    bearing = checked.config.bearing(item.name)
    doubts = [
        f'{report.quantity} on {report.topic}: {text}'
        for report, source in zip(item.inputs, bearing.inputs.values(), strict=True)
        for text in dict.fromkeys(fault_text(fault, source) for fault in report.sources)
    ]
    questions = [
        f'{report.quantity} on {report.topic} {q}' for report in item.inputs for q in report.questions
    ]
    intervals = condition_intervals(item.events, checked.start_ns or 0, checked.end_ns or 0)
    return Course(bearing, item, intervals, doubts, questions)


def _bearing_part(anchor: str, course: Course, finding: Finding, is_drawn: bool) -> BearingPart:
    """Make the part of one bearing: its finding and inputs, then facts, and pictures if ``is_drawn``.

    Without a verdict it has neither facts nor pictures; where none are drawn, a note says why. ``anchor`` is
    its ID in the page.

    Raises:
        DrawingError: matplotlib is not installed, and pictures are drawn.
    """
    inputs = zip(course.item.inputs, course.config.inputs.values(), strict=True)
    input_facts = {report.quantity: _input_facts(report, source) for report, source in inputs}
    part = BearingPart(anchor, finding, input_facts)
    if not course.item.evaluations:
        return part
    part = replace(part, facts=facts(course))
    if not is_drawn:
        return replace(part, note=_NOT_DRAWN)
    return replace(part, map=_map_picture(part, course), timeline=_timeline_picture(part, course))


def _map_picture(part: BearingPart, course: Course) -> Picture:
    """Return the picture of the stability map of a bearing, drawn wide and narrow.

    It has the track of the recording, and marks of its first 60 events.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    track = track_of_scan(course.scan)
    track = replace(track, events=track.events[:60])
    text = (
        f'Stability map of {course.name} over shaft speed and bearing load, with the recorded'
        f' operating points on it. {part.finding.sentences[0]}'
    )
    wide, narrow = (
        canvas.inline_svg(draw_map(course.config, track=track, size=size), f'{part.anchor}-{key}', text)
        for key, size in (('m', _MAP_WIDE), ('n', _MAP_NARROW))
    )
    return Picture(wide, narrow, _MAP_CAPTION)


def _timeline_picture(part: BearingPart, course: Course) -> Picture:
    """Return the picture of the course of a bearing over time, drawn wide and narrow.

    Raises:
        DrawingError: matplotlib is not installed.
    """
    timeline, events = Timeline(course.config, course.scan, course.intervals), course.item.events
    text = (
        f'Shaft speed between its stability boundaries, bearing load, margins, predicted'
        f' amplitude and alarm of {course.name} over time, with'
        f' {summary.format_count(len(events), "event")} marked. The table of events has the numbers.'
    )
    wide, narrow = (
        canvas.inline_svg(draw_timeline(timeline, width), f'{part.anchor}-{key}', text)
        for key, width in (('t', _WIDE), ('u', _NARROW))
    )
    caption = _SPEED_CAPTION
    if len(marked_events(events)) < len(events):
        caption += _FEW_MARKED
    if not timeline.has_cycle:
        caption += ' No amplitude is drawn, because no stick-slip cycle existed at any time.'
    return Picture(wide, narrow, caption)


def _input_facts(item: InputReport, source: InputConfig) -> dict[str, Any]:
    """Return the facts of an input that its record lacks: field, type, limit [s], what is wrong or asked."""
    return {
        'field': source.field_text,
        'type': source.type,
        'limit': source.stands_ns * 1e-9,
        'wrong': (
            *(f'{summary.format_grouped(f.count)} \N{MULTIPLICATION SIGN} {f.text}' for f in item.faults),
            *(f'{item.quantity} {text}' for text in item.questions),
            *([item.fault] if item.fault else ()),
        ),
    }


class ParameterRow(NamedTuple):
    """One parameter in force."""

    name: str
    value: str
    unit: str
    given: bool  # and not the default


def html_page(
    parts: Sequence[RecordingPart],
    config: MonitorConfig,
    config_path: str,
    made: datetime,
    node: str | None = None,
) -> bytes:
    """Render the report as UTF-8 HTML.

    Every text is escaped; only the pictures are inserted as they are. Of more than :data:`MAX_DRAWN`
    recordings those without bearings to show are rows of a table; of the topics of one the first
    :data:`_MAX_TOPICS` are listed.

    Args:
        parts: The recordings, at least one.
        config: The configuration.
        config_path: Its file, which is read again for parameters and digest.
        made: The time printed as that of the report; aware.
        node: The node whose parameters are listed, if the file has several; else ``None``.

    Raises:
        ReportError: Jinja2 is not installed.
        ConfigurationError: The file of the configuration cannot be read any more; so also OSError.
    """
    is_drawn = len(parts) <= MAX_DRAWN
    whole = [part for part in parts if is_drawn or part.bearings]
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
    except ImportError as error:
        raise ReportError(
            f'a report needs Jinja2, which cannot be imported ({error}): install the extra'
            " 'report', e.g. pip install 'stickslip_monitor[report]'"
        ) from error
    rules: dict[str, Any] = {'autoescape': True, 'undefined': StrictUndefined, 'trim_blocks': True}
    loader = PackageLoader('stickslip_monitor.report', '.')
    environment = Environment(loader=loader, lstrip_blocks=True, **rules)
    environment.filters |= {name: getattr(summary, f'format_{name}') for name in _FILTERS}
    environment.filters |= {'grade': _GRADES.__getitem__, 'condition': _CONDITIONS.__getitem__}
    page = environment.get_template('page.html').render(
        parts=whole,
        others=[part for part in parts if not (is_drawn or part.bearings)],
        finding=judge_all([(part.name, finding) for part in parts for finding in part.findings]),
        made=f'{made.astimezone(timezone.utc):%Y-%m-%d %H:%M} UTC',
        version=__version__,
        shown_events=shown_events,
        max_topics=_MAX_TOPICS,
        is_dated=summary.is_dated,
        config_path=config_path,
        config_digest=hashlib.sha256(Path(config_path).read_bytes()).hexdigest(),
        parameters=parameter_groups(load_parameters(config_path, node), [b.name for b in config.bearings]),
        colours={canvas.css_variable(light): (light, dark) for light, dark in canvas.ON_DARK.items()},
    )
    return f'{page}\n'.encode(errors='replace')


def shown_events(events: Sequence[Mapping[str, Any]]) -> list[tuple[int, Mapping[str, Any]]]:
    """Return up to ``MAX_EVENTS`` events with their numbers from 1: the most severe, in their own order."""
    order = sorted(enumerate(events, 1), key=lambda numbered: -_ORDER.index(numbered[1]['severity']))
    return sorted(order[:MAX_EVENTS], key=lambda numbered: numbered[0])


def parameter_groups(
    values: Mapping[str, Any], bearings: Iterable[str]
) -> list[tuple[str, list[ParameterRow]]]:
    """Return the parameters in force, those given first: groups with their headings.

    ``values`` are those given, by full name; of the others it is the default.
    """
    bearing_groups = [
        (f'Bearing {name}', _parameter_rows(BEARING_PARAMETERS, values, f'{name}.')) for name in bearings
    ]
    return [('Monitor', _parameter_rows(NODE_PARAMETERS, values, '')), *bearing_groups]


def _parameter_rows(table: Iterable[Parameter], values: Mapping[str, Any], prefix: str) -> list[ParameterRow]:
    """List the parameters of a table that have a value, the given ones first.

    Args:
        table: The parameters, whose names lack the prefix.
        values: The values given, by full name; of the others it is the default.
        prefix: Goes before a name in ``values``, as ``aft.``.
    """
    rows = []
    for row in table:
        given = f'{prefix}{row.name}' in values
        value = values.get(f'{prefix}{row.name}', row.default)
        # A number that only another friction law takes has no default.
        if not (value is REQUIRED or value == () or value != value):
            rows.append(ParameterRow(row.name, _value_text(value), row.unit, given))
    return sorted(rows, key=lambda row: not row.given)


def _value_text(value: Any) -> str:
    """Format a parameter's value: 'none' if not finite, a dash for an empty text.

    The items of a list have commas between.
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float | int):
        return f'{value:.12g}' if finite_or_none(float(value)) is not None else 'none'
    if isinstance(value, str):
        return value or '\N{EM DASH}'
    return ', '.join(_value_text(item) for item in value)
