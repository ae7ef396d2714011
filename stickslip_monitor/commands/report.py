# SPDX-License-Identifier: Apache-2.0
"""The report of ``stickslip check``: results and pictures in one file."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from stickslip_monitor import __version__
from stickslip_monitor.commands.check_results import SCHEMA
from stickslip_monitor.commands.output import json_text
from stickslip_monitor.drawing.canvas import MARKS as PICTURE_MARKS
from stickslip_monitor.drawing.canvas import Pixels, drawn, heading, inline_svg, sheet, variable
from stickslip_monitor.drawing.map import draw_map
from stickslip_monitor.drawing.palette import ON_DARK
from stickslip_monitor.drawing.timeline import Timeline, draw_timeline, marked_events
from stickslip_monitor.drawing.track import Track, thinned, track_of_scan
from stickslip_monitor.errors import ReportError
from stickslip_monitor.files import printable, write_whole
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import load_parameters
from stickslip_monitor.monitor.source_faults import fault_text
from stickslip_monitor.offline.check import BearingReport, CheckReport, InputReport
from stickslip_monitor.offline.intervals import condition_intervals
from stickslip_monitor.report import formatting
from stickslip_monitor.report.document import (
    BagPart,
    BearingPart,
    Fact,
    Finding,
    InputRow,
    Picture,
    Report,
    TopicRow,
)
from stickslip_monitor.report.page import render
from stickslip_monitor.report.parts import event_rows, facts, parameter_groups, shares
from stickslip_monitor.report.summary import GRADES, Course, finding_of, overall

MARKS = {
    '.html': b'<meta name="generator" content="stickslip_monitor">',
    '.png': PICTURE_MARKS['.png'],
    '.json': f'"schema": "{SCHEMA}"'.encode(),
}
"""By what a report of ours is known when it is to be replaced."""
SUFFIXES = tuple(MARKS)
# A phone shows an inch of the narrow ones on a hundred pixels, so that letters can be read.
_WIDE, _NARROW = 9.0, 3.6
_MAP_WIDE, _MAP_NARROW = (9.0, 5.6), (3.6, 4.4)
_TRACK_WIDE, _TRACK_NARROW = 600, 300
_MARKS = 60
_MOST_TOPICS = 100
_MOST_ON_SHEET = 12
# Of a recording; a page with more takes minutes to make and nobody looks at them all.
_MOST_DRAWN = 12
_DRAWING = threading.Lock()
_NOT_DRAWN = (
    f'Not drawn: pictures are of the {_MOST_DRAWN} bearings of a recording that need a look most.'
    ' `stickslip map --track BAG --bearing NAME` draws the map of this one.'
)
SPEED_CAPTION = (
    'Speed lies in the red region where stick-slip starts by itself, in the amber one where a'
    ' disturbance can start it, in the yellow one within the caution margin.'
)


@dataclass(frozen=True, slots=True)
class _Case:
    """One bearing in one recording, with what is to be drawn of it."""

    bag: str
    config: BearingConfig
    course: Course
    finding: Finding


@dataclass(frozen=True, slots=True)
class ReportPart:
    """What a report says of one recording: text and pictures, without its samples."""

    findings: tuple[tuple[str, Finding], ...]
    bag: BagPart | None = None
    figures: tuple[Pixels, ...] = ()


class ReportFile:
    """A report that takes recordings one after the other and is written at the end.

    Args:
        path: Where to; its ending chooses the format.
        config: The configuration.
        config_path: The file it was read from.
        force: Whether a file that is no report of ours is replaced.

    Raises:
        ReportError: The ending is none of those that can be written.
    """

    def __init__(
        self, path: str, config: MonitorConfig, config_path: str, force: bool = False
    ) -> None:
        self.path = Path(path)
        self.suffix = self.path.suffix.lower()
        if self.suffix not in SUFFIXES:
            raise ReportError(
                f"report '{path}' must end in one of {', '.join(SUFFIXES)}: the ending chooses"
                ' the format'
            )
        self._config, self._config_path, self._force = config, config_path, force
        self._bags: list[BagPart] = []
        self._documents: list[dict[str, Any]] = []
        self._figures: list[Pixels] = []
        self._findings: list[tuple[str, Finding]] = []

    def add(self, part: ReportPart | None, document: dict[str, Any]) -> None:
        """Take up one recording.

        Args:
            part: What is drawn and said of it; nothing where the file is for programs.
            document: What the check found, as JSON.

        Raises:
            ReportError: It is more than fits on one picture.
        """
        self._documents.append(document)
        if part is None:
            return
        self._findings += part.findings
        self._figures += part.figures
        if len(self._figures) > 3 * _MOST_ON_SHEET:
            raise ReportError(
                f"report '{self.path}': a picture holds {_MOST_ON_SHEET} bearings at most;"
                ' write a .html instead, or fewer bags'
            )
        if part.bag is not None:
            self._bags.append(part.bag)

    def write(self, made: datetime, listed: bool) -> None:
        """Write the report, all of it or nothing.

        Args:
            made: The time to be named as that of its making.
            listed: Whether JSON is a list, for several bags.

        Raises:
            ReportError: It cannot be written.
        """
        if self.suffix == '.json':
            text = json_text(self._documents if listed else self._documents[0])
            data = text.encode()
        elif self.suffix == '.png':
            verdict = overall(self._findings)
            words_above = heading(f'{verdict.word}: {verdict.sentences[0]}', verdict.sentences[1:])
            data = sheet([drawn(words_above), *self._figures])
        else:
            data = render(self._report(made)).encode(errors='replace')
        try:
            write_whole(self.path, data, MARKS[self.suffix], self._force)
        except OSError as error:
            raise ReportError(
                f"'{self.path}' cannot be written: {error.strerror or error}"
            ) from error

    def _report(self, made: datetime) -> Report:
        raw = Path(self._config_path).read_bytes()
        names = [bearing.name for bearing in self._config.bearings]
        return Report(
            finding=overall(self._findings),
            made=f'{made.astimezone(timezone.utc):%Y-%m-%d %H:%M} UTC',
            version=__version__,
            bags=tuple(self._bags),
            config_path=self._config_path,
            config_digest=hashlib.sha256(raw).hexdigest(),
            parameters=parameter_groups(load_parameters(self._config_path), names),
            colours={variable(light): (light, dark) for light, dark in ON_DARK.items()},
        )


def make_part(
    suffix: str, config: MonitorConfig, checked: CheckReport, anchor: str
) -> ReportPart | None:
    """Say and draw what there is to one recording.

    Args:
        suffix: The ending of the report; one for programs has no such part.
        config: The configuration.
        checked: What the check found, with outlines.
        anchor: A word that tells this recording from the others on a page.
    """
    if suffix == '.json':
        return None
    name = _name(checked.bag.path)
    cases = [_case(name, config, checked, item) for item in checked.bearings.values()]
    findings = tuple((name, case.finding) for case in cases)
    # matplotlib's settings belong to the process, not to one of its threads.
    with _DRAWING:
        if suffix == '.html':
            return ReportPart(findings, bag=_bag_part(anchor, checked, cases))
        return ReportPart(
            findings, figures=tuple(drawn(f) for case in cases for f in _headed(case))
        )


def missing_part(path: Path, text: str, anchor: str) -> ReportPart:
    """The part of a report for a recording that could not be checked."""
    name = _name(path)
    finding = Finding('unknown', 'No verdict', (f'this recording could not be checked: {text}',))
    part = BagPart(
        anchor, name, printable(str(path)), 'It could not be checked.', '', '', (text,), (), '', ()
    )
    return ReportPart(((name, finding),), part)


def _name(path: Path) -> str:
    """A recording's name for people."""
    return printable(Path(os.path.realpath(path)).name)


def _case(bag: str, config: MonitorConfig, checked: CheckReport, item: BearingReport) -> _Case:
    assert item.outline is not None
    start, end = checked.start_ns or 0, checked.end_ns or 0
    own = config.bearing(item.name)
    parts = condition_intervals(item.events, start, end)
    doubts = [
        f'{each.quantity} on {each.topic}: {text}'
        for each, source in zip(item.inputs, own.inputs.values(), strict=True)
        for text in dict.fromkeys(fault_text(fault, source) for fault in each.sources)
    ]
    asked = [
        f'{each.quantity} on {each.topic} {q}' for each in item.inputs for q in each.questions
    ]
    course = Course(own, item.outline, parts, item.seconds, item.worst, doubts, asked)
    return _Case(bag, own, course, finding_of(course))


def _track(case: _Case, most: int) -> Track:
    track = thinned(track_of_scan(case.course.scan), most)
    return Track(track.time, track.speed, track.load, track.events[:_MARKS])


def _timeline(case: _Case) -> Timeline:
    return Timeline(case.config, case.course.scan, case.course.spells)


def _headed(case: _Case) -> Iterator[Any]:
    yield heading(f'{case.bag}, {case.config.name}', case.finding.sentences)
    yield from _figures(case)


def _figures(case: _Case) -> Iterator[Any]:
    if case.course.scan.time_ns.size:
        yield draw_map(case.config, track=_track(case, _TRACK_WIDE))
        yield draw_timeline(_timeline(case), _WIDE)


def _bag_part(anchor: str, checked: CheckReport, cases: Sequence[_Case]) -> BagPart:
    bag = checked.bag
    troubles = [cut.text for cut in bag.cuts] + list(bag.warnings)
    topics = sorted(bag.topics.values(), key=lambda topic: topic.name)
    left = len(topics) - _MOST_TOPICS
    by_urgency = sorted(cases, key=lambda case: -GRADES.index(case.finding.grade))
    drawn_ones = {case.config.name for case in by_urgency[:_MOST_DRAWN]}
    return BagPart(
        anchor=anchor,
        name=_name(bag.path),
        path=printable(str(bag.path)),
        span=_span(checked),
        duration=_lasting(checked),
        messages=formatting.count(bag.message_count, 'message') + ' on all topics',
        troubles=tuple(troubles),
        topics=tuple(
            TopicRow(topic.name, topic.type, formatting.grouped(topic.count), topic.problem)
            for topic in topics[:_MOST_TOPICS]
        ),
        topics_note=f'{formatting.count(left, "topic")} more are not listed.' if left > 0 else '',
        bearings=tuple(
            _bearing_part(
                f'{anchor}-{case.config.name}',
                checked.bearings[case.config.name],
                case,
                is_drawn=case.config.name in drawn_ones,
            )
            for case in cases
        ),
    )


def _span(checked: CheckReport) -> str:
    start, end = checked.start_ns, checked.end_ns
    if start is None or end is None:
        return 'No messages'
    if not formatting.is_dated(start):
        return (
            f'From {formatting.clock(start)} to {formatting.clock(end)} on a clock without dates'
        )
    return (
        f'From {formatting.date(start)} {formatting.clock(start)} to {formatting.date(end)}'
        f' {formatting.clock(end)} UTC'
    )


def _lasting(checked: CheckReport) -> str:
    if checked.start_ns is None or checked.end_ns is None:
        return 'no time'
    return formatting.duration((checked.end_ns - checked.start_ns) * 1e-9)


def _bearing_part(anchor: str, item: BearingReport, case: _Case, *, is_drawn: bool) -> BearingPart:
    rows, note = event_rows(item.events)
    known = item.evaluations > 0
    return BearingPart(
        anchor=anchor,
        name=item.name,
        finding=case.finding,
        facts=(*facts(case.course), *_measured(item)) if known else (),
        shares=shares(case.course) if known else (),
        map=_map_picture(anchor, case) if known and is_drawn else None,
        timeline=_timeline_picture(anchor, case) if known and is_drawn else None,
        pictures_note=_NOT_DRAWN if known and not is_drawn else '',
        events=rows,
        events_note=note,
        inputs=_input_rows(item, case.config),
    )


def _measured(item: BearingReport) -> tuple[Fact, ...]:
    if item.measured is None:
        return ()
    lasting = {state: formatting.duration(seconds) for state, seconds in item.measured.items()}
    note = f'quiet for {lasting["quiet"]}, unknown for {lasting["unknown"]}'
    return (Fact('vibration measured', lasting['vibrating'], note),)


def _input_rows(item: BearingReport, config: BearingConfig) -> tuple[InputRow, ...]:
    return tuple(
        _input_row(report, source)
        for report, source in zip(item.inputs, config.inputs.values(), strict=True)
    )


def _map_picture(anchor: str, case: _Case) -> Picture:
    name = case.config.name
    text = (
        f'Stability map of {name} over shaft speed and bearing load, with the recorded operating'
        f' points on it. {case.finding.sentences[0]}'
    )
    wide, narrow = (
        inline_svg(
            draw_map(case.config, track=_track(case, most), size=size), f'{anchor}-{k}', text
        )
        for k, size, most in (('m', _MAP_WIDE, _TRACK_WIDE), ('n', _MAP_NARROW, _TRACK_NARROW))
    )
    caption = (
        'The course of the operating point over the regions of the averaged model, from the ring'
        ' (start, where the line is wide) to the square (end, where it is narrow), without the'
        ' scatter of the measurements, which is drawn faint. Marks show where the alarm changed.'
        ' Lines with a number are stick-slip amplitudes.'
    )
    return Picture(wide, narrow, caption)


def _timeline_picture(anchor: str, case: _Case) -> Picture:
    timeline = _timeline(case)
    events = formatting.count(len(case.course.scan.events), 'event')
    text = (
        f'Shaft speed between its stability boundaries, bearing load, margins, predicted'
        f' amplitude and alarm of {case.config.name} over time, with {events} marked. The table'
        ' of events has the numbers.'
    )
    wide, narrow = (
        inline_svg(draw_timeline(timeline, width), f'{anchor}-{key}', text)
        for key, width in (('t', _WIDE), ('u', _NARROW))
    )
    caption = SPEED_CAPTION + (
        ' Long recordings are drawn by their envelope: every extreme is there.'
    )
    if len(marked_events(case.course.scan.events)) < len(case.course.scan.events):
        caption += (
            ' Of so many events only the alarms are marked, or none; the band at the bottom shows'
            ' the worst of each stretch.'
        )
    if not timeline.has_cycle:
        caption += ' No amplitude is drawn, because no stick-slip cycle existed at any time.'
    return Picture(wide, narrow, caption)


def _input_row(item: InputReport, source: InputConfig) -> InputRow:
    gaps, limit = item.gaps, source.timeout_ns * 1e-9
    if gaps.count:
        longest = ', '.join(
            f'{formatting.duration(gap.seconds)} from {formatting.minute(gap.start_ns)}'
            for gap in gaps.longest
        )
        shown = f'{gaps.count} longer than {formatting.duration(limit)}; longest: {longest}'
    else:
        shown = f'none longer than {formatting.duration(limit)}'
    return InputRow(
        what=item.quantity.capitalize(),
        topic=item.topic,
        field=source.field_text,
        type=source.type,
        messages=formatting.grouped(item.messages),
        used=f'{formatting.grouped(item.used)} ({formatting.share(item.used, item.messages)})',
        span=_number_span(item),
        rate=f'{gaps.rate:.3g} a second' if gaps.rate == gaps.rate else 'unknown',
        gaps=shown,
        faults=(
            *(
                f'{formatting.grouped(f.count)} \N{MULTIPLICATION SIGN} {f.text}'
                for f in item.faults
            ),
            *(f'{item.quantity} {text}' for text in item.questions),
            *([item.fault] if item.fault else ()),
        ),
    )


def _number_span(item: InputReport) -> str:
    """The range of an input's numbers."""
    if not item.used:
        return 'none'
    unit = 'm/s' if item.quantity == 'speed' else 'N'
    low, high = item.span
    si_low, si_high = item.si_span
    return f'{low:.4g} to {high:.4g} in the messages, {si_low:.4g} to {si_high:.4g} {unit}'
