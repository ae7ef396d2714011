# SPDX-License-Identifier: Apache-2.0
"""What a check finds of each bag: one record, from which JSON, text and report are made.

Plain values in and out, so that a bag can be checked in another process or on another machine.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor.bags.reader import Bag
from stickslip_monitor.errors import CalibrationError, StickslipError, plural
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.ladder import Level
from stickslip_monitor.monitor.messages import event_record, number
from stickslip_monitor.offline.check import (
    BearingReport,
    CheckReport,
    check_bag,
    scan_whole,
)
from stickslip_monitor.offline.input_check import InputReport

if TYPE_CHECKING:
    from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource
    from stickslip_monitor.report.page import RecordingPart

Progress = Callable[[str, int, int | None], None]
SCHEMA = 'stickslip_monitor/check/1'


@dataclass(frozen=True, slots=True)
class Task:
    """What is wanted of every bag."""

    config: MonitorConfig
    report: str | None = None  # the ending of the report, if one is wanted
    mcap: str | None = None  # where to write the recording of verdicts, if at all
    clips: str | None = None  # the folder to write clips into, if at all
    learn: EvidenceSource | None = None  # who tells when the bearings vibrated, to learn from

    @property
    def is_drawn(self) -> bool:
        """Whether the report has pictures."""
        return self.report not in (None, '.json')


@dataclass(frozen=True, slots=True)
class Found:
    """What came of one bag: without its samples, which may be many."""

    document: dict[str, Any]  # what `check --json` prints of it
    part: RecordingPart | None = None  # its part of the report, where one is wanted
    clips: int | None = None  # how many were written, where they were wanted
    # What it tells of each bearing, or why it tells nothing, where that is wanted.
    evidence: dict[str, Evidence | str] = field(default_factory=dict)
    faulty: bool = False  # whether it could not be checked by a fault of the program

    @property
    def code(self) -> int:
        """The exit code of this bag alone."""
        if 'error' in self.document:
            return 3 if self.faulty else 2
        if self.unjudged:
            return 2
        return int(
            any(
                any(event['level'] != 'OK' for event in item['events'])
                or any(each['source_faults'] for each in item['inputs'].values())
                for item in self.document['bearings'].values()
            )
        )

    @property
    def unjudged(self) -> list[str]:
        """The bearings of which the recording gave no operating point: silence is not health."""
        bearings = self.document.get('bearings', {})
        return [name for name, item in bearings.items() if not item['evaluations']]


def attempt(task: Task, bag: Path, progress: Progress | None = None) -> Found:
    """Check one bag; why it cannot be checked is told by the result.

    Args:
        task: What is wanted.
        bag: The bag.
        progress: Called with what is being done, and how much of how much of it is done.
    """
    show = progress or (lambda text, done, total: None)
    try:
        checked = check_bag(
            bag,
            task.config,
            lambda done, total: show(str(bag), done, total),
            outlined=task.is_drawn,
        )
        document, part, clips = to_json(checked), None, None
        if task.mcap is not None:
            from stickslip_monitor.offline.verdict_bag import write_verdicts

            def told(count: int) -> None:
                show(f'{count} messages written', count, None)

            write_verdicts(checked, task.config, task.mcap, told)
        if task.clips is not None:
            from stickslip_monitor.offline.clips import ClipFolder, write_clips

            store = ClipFolder(replace(task.config.clips, directory=task.clips))
            clips = write_clips(checked, task.config, store)
        if task.is_drawn:
            from stickslip_monitor.report.page import recording_part

            is_page = task.report == '.html'
            part = recording_part(document, checked, task.config, with_pages=is_page)
        return Found(document, part, clips, _evidence(task, checked))
    except StickslipError as error:
        return failed(task, bag, str(error))


def failed(task: Task, bag: Path, text: str, *, faulty: bool = False) -> Found:
    """What came of a bag that could not be checked."""
    document, part = {'schema': SCHEMA, 'path': str(bag), 'error': text}, None
    if task.is_drawn:
        from stickslip_monitor.report.page import missing_part

        part = missing_part(document)
    return Found(document, part, faulty=faulty)


def _evidence(task: Task, checked: CheckReport) -> dict[str, Evidence | str]:
    found: dict[str, Evidence | str] = {}
    if task.learn is None:
        return found
    whole = scan_whole(checked.bag.path, task.config)
    for config in task.config.bearings:
        try:
            found[config.name] = task.learn.of_recording(whole, config)
        except CalibrationError as error:
            found[config.name] = str(error)
    return found


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as a JSON object."""
    return {
        'schema': SCHEMA,
        **bag_record(report.bag),
        'bearings': {name: _bearing_record(item) for name, item in report.bearings.items()},
    }


def bag_record(bag: Bag) -> dict[str, Any]:
    """What a recording holds, whatever it is checked for."""
    start, end = bag.start_ns, bag.end_ns
    return {
        'path': str(bag.path),
        'start': start,
        'end': end,
        'duration': None if start is None or end is None else (end - start) * 1e-9,
        'messages': bag.message_count,
        'topics': {
            name: {'type': topic.type, 'messages': topic.count, 'problem': topic.problem or None}
            for name, topic in bag.topics.items()
        },
        'cuts': [
            {'file': str(cut.path), 'offset': cut.offset, 'size': cut.size, 'text': cut.text}
            for cut in bag.cuts
        ],
        'warnings': list(bag.warnings),
    }


def _bearing_record(item: BearingReport) -> dict[str, Any]:
    return {
        'events': [event_record(event) for event in item.events],
        'seconds': {regime.value: seconds for regime, seconds in item.seconds.items()},
        'worst': {
            name: {'time': extreme.time_ns, 'value': number(extreme.value)}
            | {
                k: number(getattr(extreme.point, k))
                for k in ('speed', 'load', 'amplitude_exact')
                if k != 'amplitude_exact' or name == 'amplitude'
            }
            for name, extreme in item.worst.items()
        },
        **({} if item.measured is None else {'measured': item.measured}),
        'evaluations': item.evaluations,
        'data': item.complaints,
        'inputs': {each.quantity: _input(each) for each in item.inputs},
    }


def _input(item: InputReport) -> dict[str, Any]:
    return {
        'topic': item.topic,
        'messages': item.messages,
        'used': item.used,
        'share': item.used / item.messages if item.messages else None,
        'span': [number(value) for value in item.span],
        'si_span': [number(value) for value in item.si_span],
        'rate': number(item.gaps.rate),
        'gaps': item.gaps.count,
        'longest_gaps': [
            {'time': gap.start_ns, 'seconds': gap.seconds} for gap in item.gaps.longest
        ],
        'source_faults': [
            {'fault': fault.kind.value, 'since': fault.since_ns, 'raised': fault.raised_ns}
            for fault in item.sources
        ],
        'questions': list(item.questions),
        'fault': item.fault or None,
    }


_GREEN, _YELLOW, _RED, _BOLD, _END = (f'\x1b[{code}m' for code in (32, 33, 31, 1, 0))
_OF_LEVEL = {Level.OK.name: _GREEN, Level.WARN.name: _YELLOW, Level.ERROR.name: _RED}
_WORST = {'hopf_margin': 'Hopf margin', 'fold_margin': 'fold margin', 'amplitude': 'amplitude'}
# On a narrower screen an event is a block of lines, not one.
_NARROW = 90
Paint = Callable[[str, str], str]


def to_text(document: Mapping[str, Any], coloured: bool, width: int | None = None) -> str:
    """The text of one bag.

    Args:
        document: What ``check --json`` prints of it.
        coloured: Whether it goes to a terminal that knows colours.
        width: Letters on a line; any number if None.
    """

    def paint(colour: str, text: str) -> str:
        return f'{colour}{text}{_END}' if coloured else text

    # Those of events, which are indented, are broken as a table.
    return ''.join(
        f'{line if line.startswith(" ") else wrapped(line, width)}\n'
        for line in _lines(document, paint, width)
    )


def wrapped(line: str, width: int | None, indent: int = 2) -> str:
    """A line, broken at a number of letters; whole if that is None."""
    if width is None:
        return line
    # The last column stays free: not every terminal breaks behind it.
    # A path that is cut in two cannot be copied.
    return textwrap.fill(
        line, max(width - 1, 20), subsequent_indent=' ' * indent,
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _lines(document: Mapping[str, Any], paint: Paint, width: int | None) -> Iterator[str]:
    seconds = document['duration'] or 0.0
    path = paint(_BOLD, printable(document['path']))
    yield f'{path}: {plural(document["messages"], "message")} in {seconds:.1f} s'
    faults = [*(cut['text'] for cut in document['cuts']), *document['warnings']]
    faults += (
        f'topic {name} not readable: {topic["problem"]}'
        for name, topic in document['topics'].items()
        if topic['problem']
    )
    for text in faults:
        yield f'{paint(_YELLOW, "data:")} {printable(text)}'
    for name, item in document['bearings'].items():
        yield from _bearing_lines(name, item, document['start'] or 0, paint, width)


def _bearing_lines(
    name: str, item: Mapping[str, Any], start: int, paint: Paint, width: int | None
) -> Iterator[str]:
    for text in item['data']:
        yield f'{paint(_YELLOW, "data:")} {printable(text)}'
    for quantity, each in item['inputs'].items():
        place = printable(f'{quantity} on {each["topic"]}')
        yield f'{place}: {_input_text(quantity, each)}'
        for text in each['questions']:
            yield f'{paint(_YELLOW, "question:")} {place} {printable(text)}'
    events = item['events']
    yield f'{name}: {plural(len(events), "event") if events else "no events"}'
    if events and (width is None or width >= _NARROW):
        yield paint(_BOLD, f'  {"time [s]":>10}  {"from":<15}  {"to":<15}  what')
    for event in events:
        text = printable(event['text'].removeprefix(f'{name}: '))
        yield from _event_lines(event, text, start, paint, width)
    for title, spent in (('time in each regime', 'seconds'), ('measured vibration', 'measured')):
        if spent in item:
            said = ', '.join(f'{state} {seconds:.1f} s' for state, seconds in item[spent].items())
            yield f'{title}: {said}'
    for quantity, called in _WORST.items():
        if quantity in item['worst']:
            extreme = item['worst'][quantity]
            value, seconds = extreme['value'], (extreme['time'] - start) * 1e-9
            shown = f'{value * 1e3:.4g} mm' if quantity == 'amplitude' else f'{value:+.1%}'
            yield f'worst {called}: {shown} at {seconds:.2f} s'


def _event_lines(
    event: Mapping[str, Any], text: str, start: int, paint: Paint, width: int | None
) -> Iterator[str]:
    seconds, to, colour = (event['time'] - start) * 1e-9, event['to'], _OF_LEVEL[event['level']]
    if width is not None and width < _NARROW:
        change = wrapped(f'  {seconds:.2f} s: {event["from"]} to {to}', width, 4)
        yield f'{change.removesuffix(to)}{paint(colour, to)}'
        yield wrapped(f'    {text}', width, 4)
    else:
        # Of the finished line, as colours take room in a text but none on the screen.
        head = f'  {seconds:>10.2f}  {event["from"]:<15}  {to:<15}  '
        line = wrapped(f'{head}{text}', width, len(head))
        yield line.replace(head, f'{head[:-17]}{paint(colour, head[-17:-2])}  ', 1)


def _input_text(quantity: str, item: Mapping[str, Any]) -> str:
    """What came of an input: the range of its numbers, its rate, and the share used."""
    if not item['used']:
        return f'{plural(item["messages"], "message")}, none used'
    (low, high), (si_low, si_high) = item['span'], item['si_span']
    unit = 'm/s' if quantity == 'speed' else 'N'
    si = '' if quantity == 'level' else f' ({si_low:.4g} to {si_high:.4g} {unit})'
    rate = '' if item['rate'] is None else f', {item["rate"]:.3g} a second'
    return f'{low:.4g} to {high:.4g} in the messages{si}{rate}, {item["share"]:.1%} used'
