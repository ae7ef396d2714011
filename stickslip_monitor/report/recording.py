# SPDX-License-Identifier: Apache-2.0
"""What a report says and draws of one recording, beside the record that a check makes of it.

Texts and pictures only, without samples, so that a part can come from another process.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stickslip_monitor.drawing.canvas import Pixels, drawn, heading, inline_svg
from stickslip_monitor.drawing.map import draw_map
from stickslip_monitor.drawing.timeline import Timeline, draw_timeline, marked_events
from stickslip_monitor.drawing.track import Track, track_of_scan
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.config import InputConfig, MonitorConfig
from stickslip_monitor.monitor.source_faults import fault_text
from stickslip_monitor.offline.check import BearingReport, CheckReport, InputReport
from stickslip_monitor.offline.intervals import condition_intervals
from stickslip_monitor.report import formatting
from stickslip_monitor.report.summary import GRADES, Course, Fact, Finding, facts, finding_of

# A phone shows an inch of the narrow ones on a hundred pixels, so that letters can be read.
_WIDE, _NARROW = 9.0, 3.6
_MAP_WIDE, _MAP_NARROW = (9.0, 5.6), (3.6, 5.4)
_MARKS = 60
# Of a recording; a page with more takes minutes to make and nobody looks at them all.
_MOST_DRAWN = 12
_DRAWING = threading.Lock()
_NOT_DRAWN = (
    f'Not drawn: pictures are of the {_MOST_DRAWN} bearings of a recording that need a look most.'
    ' `stickslip map --track BAG --bearing NAME` draws the map of this one.'
)
_MAP_CAPTION = (
    'The course of the operating point over the regions of the averaged model, from the ring'
    ' (start, where the line is wide) to the square (end, where it is narrow), without the'
    ' scatter of the measurements, which is drawn faint. Marks show where the alarm changed.'
    ' Lines with a number are stick-slip amplitudes.'
)
_SPEED_CAPTION = (
    'Speed lies in the red region where stick-slip starts by itself, in the amber one where a'
    ' disturbance can start it, in the yellow one within the caution margin. Long recordings are'
    ' drawn by their envelope: every extreme is there.'
)


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as inline SVG: for a wide page, for a narrow one, and what it shows in words."""

    wide: str
    narrow: str
    caption: str


@dataclass(frozen=True, slots=True)
class BearingPart:
    """What is said and drawn of one bearing in one recording.

    Attributes:
        anchor: A word that tells it from all others on a page.
        finding: The verdict.
        facts: The figures that matter most.
        map: Its track over the stability map, if drawn.
        timeline: Its course in time, if drawn.
        note: Why nothing is drawn.
        inputs: Of each input what a reader wants to know beside the record, by quantity.
    """

    anchor: str
    finding: Finding
    facts: tuple[Fact, ...]
    map: Picture | None
    timeline: Picture | None
    note: str
    inputs: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class RecordingPart:
    """What is said and drawn of one recording.

    Attributes:
        anchor: A word that tells it from all others on a page.
        name: Its name for people.
        document: What ``check --json`` prints of it.
        findings: The verdict on each bearing, or that there is none.
        bearings: What is said of each bearing, by name, for a page.
        figures: Words and pictures below each other, for a picture.
    """

    anchor: str
    name: str
    document: Mapping[str, Any]
    findings: tuple[Finding, ...]
    bearings: Mapping[str, BearingPart]
    figures: tuple[Pixels, ...] = ()


def recording_part(
    document: Mapping[str, Any], checked: CheckReport, config: MonitorConfig, *, with_pages: bool
) -> RecordingPart:
    """Say and draw what there is to one recording.

    Args:
        document: What ``check --json`` prints of it.
        checked: What the check found, with outlines.
        config: The configuration.
        with_pages: Whether it is for a page, and not for a picture.
    """
    anchor, name = _anchor(document), _name(document)
    courses = [_course(config, checked, item) for item in checked.bearings.values()]
    findings = tuple(finding_of(course) for course in courses)
    # matplotlib's settings belong to the process, not to one of its threads.
    with _DRAWING:
        if not with_pages:
            figures = [
                drawn(figure)
                for course, finding in zip(courses, findings, strict=True)
                for figure in _figures(name, course, finding)
            ]
            return RecordingPart(anchor, name, document, findings, {}, tuple(figures))
        urgent = sorted(range(len(courses)), key=lambda k: -GRADES.index(findings[k].grade))
        parts = {
            course.name: _bearing_part(
                f'{anchor}-{course.name}', course, findings[k], k in urgent[:_MOST_DRAWN]
            )
            for k, course in enumerate(courses)
        }
    return RecordingPart(anchor, name, document, findings, parts)


def missing_part(document: Mapping[str, Any]) -> RecordingPart:
    """The part of a report for a recording that could not be checked."""
    text = f'this recording could not be checked: {document["error"]}'
    finding = Finding('unknown', 'No verdict', (text,))
    return RecordingPart(_anchor(document), _name(document), document, (finding,), {})


def _anchor(document: Mapping[str, Any]) -> str:
    return f'bag-{hashlib.sha256(document["path"].encode()).hexdigest()[:12]}'


def _name(document: Mapping[str, Any]) -> str:
    return printable(Path(os.path.realpath(document['path'])).name)


def _course(config: MonitorConfig, checked: CheckReport, item: BearingReport) -> Course:
    own = config.bearing(item.name)
    doubts = [
        f'{each.quantity} on {each.topic}: {text}'
        for each, source in zip(item.inputs, own.inputs.values(), strict=True)
        for text in dict.fromkeys(fault_text(fault, source) for fault in each.sources)
    ]
    asked = [
        f'{each.quantity} on {each.topic} {q}' for each in item.inputs for q in each.questions
    ]
    spells = condition_intervals(item.events, checked.start_ns or 0, checked.end_ns or 0)
    return Course(own, item, spells, doubts, asked)


def _track(course: Course) -> Track:
    track = track_of_scan(course.scan)
    return Track(track.time, track.speed, track.load, track.events[:_MARKS])


def _timeline(course: Course) -> Timeline:
    return Timeline(course.config, course.scan, course.spells)


def _figures(bag: str, course: Course, finding: Finding) -> Iterator[Any]:
    yield heading(f'{finding.word}: {bag}, {course.name}', finding.sentences)
    if course.scan.time_ns.size:
        yield draw_map(course.config, track=_track(course))
        yield draw_timeline(_timeline(course), _WIDE)


def _bearing_part(anchor: str, course: Course, finding: Finding, is_drawn: bool) -> BearingPart:
    known = course.item.evaluations > 0
    inputs = zip(course.item.inputs, course.config.inputs.values(), strict=True)
    return BearingPart(
        anchor=anchor,
        finding=finding,
        facts=facts(course) if known else (),
        map=_map_picture(anchor, course, finding) if known and is_drawn else None,
        timeline=_timeline_picture(anchor, course) if known and is_drawn else None,
        note=_NOT_DRAWN if known and not is_drawn else '',
        inputs={report.quantity: _input(report, source) for report, source in inputs},
    )


def _map_picture(anchor: str, course: Course, finding: Finding) -> Picture:
    text = (
        f'Stability map of {course.name} over shaft speed and bearing load, with the recorded'
        f' operating points on it. {finding.sentences[0]}'
    )
    wide, narrow = (
        inline_svg(draw_map(course.config, track=_track(course), size=size), f'{anchor}-{k}', text)
        for k, size in (('m', _MAP_WIDE), ('n', _MAP_NARROW))
    )
    return Picture(wide, narrow, _MAP_CAPTION)


def _timeline_picture(anchor: str, course: Course) -> Picture:
    timeline, events = _timeline(course), course.item.events
    text = (
        f'Shaft speed between its stability boundaries, bearing load, margins, predicted'
        f' amplitude and alarm of {course.name} over time, with'
        f' {formatting.count(len(events), "event")} marked. The table of events has the numbers.'
    )
    wide, narrow = (
        inline_svg(draw_timeline(timeline, width), f'{anchor}-{key}', text)
        for key, width in (('t', _WIDE), ('u', _NARROW))
    )
    caption = _SPEED_CAPTION
    if len(marked_events(events)) < len(events):
        caption += (
            ' Of so many events only the alarms are marked, or none; the band at the bottom shows'
            ' the worst of each stretch.'
        )
    if not timeline.has_cycle:
        caption += ' No amplitude is drawn, because no stick-slip cycle existed at any time.'
    return Picture(wide, narrow, caption)


def _input(item: InputReport, source: InputConfig) -> dict[str, Any]:
    """What a reader wants to know of an input beside its record."""
    return {
        'field': source.field_text,
        'type': source.type,
        'limit': source.timeout_ns * 1e-9,
        'wrong': _wrong(item),
    }


def _wrong(item: InputReport) -> Sequence[str]:
    times = '\N{MULTIPLICATION SIGN}'
    return (
        *(f'{formatting.grouped(f.count)} {times} {f.text}' for f in item.faults),
        *(f'{item.quantity} {text}' for text in item.questions),
        *([item.fault] if item.fault else ()),
    )
