# SPDX-License-Identifier: Apache-2.0
"""What a check finds of one bag: one record, from which JSON, text and report are made.

Plain values in and out, so that a bag can be checked in another process or on another machine.
"""

from __future__ import annotations

import pickle
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_monitor import __version__
from stickslip_monitor.bags.reader import Bag
from stickslip_monitor.errors import CalibrationError, StickslipError, plural
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.ladder import Level
from stickslip_monitor.monitor.messages import event_record, number
from stickslip_monitor.offline.archive import Stamp
from stickslip_monitor.offline.check import BearingReport, CheckReport, InputReport, check_bag
from stickslip_monitor.offline.follow import scan_whole

if TYPE_CHECKING:
    from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource
    from stickslip_monitor.report.recording import RecordingPart

Progress = Callable[[str, int, int | None], None]
SCHEMA = 'stickslip_monitor/check/1'


@dataclass(frozen=True, slots=True)
class Task:
    """What is wanted of every bag.

    Attributes:
        config: The configuration.
        report: The ending of the report, ``None`` for no report.
        mcap: Where to write the recording of verdicts, if at all.
        clips: The folder to write clips into, if at all.
        learn: Who tells when the bearings vibrated, where that is to be learned from.
    """

    config: MonitorConfig
    report: str | None = None
    mcap: str | None = None
    clips: str | None = None
    learn: EvidenceSource | None = None

    @property
    def is_drawn(self) -> bool:
        """Whether the report shows pictures."""
        return self.report not in (None, '.json')


@dataclass(frozen=True, slots=True)
class Found:
    """What came of one bag: without its samples, which may be many.

    Attributes:
        document: What ``check --json`` prints of it.
        part: Its part of the report, where one is wanted.
        clips: How many clips were written, ``None`` where none were wanted.
        evidence: What it tells of each bearing, or why it tells nothing, where that is wanted.
        faulty: Whether it could not be checked by a fault of the program.
    """

    document: dict[str, Any]
    part: RecordingPart | None = None
    clips: int | None = None
    evidence: dict[str, Evidence | str] = field(default_factory=dict)
    faulty: bool = False

    @property
    def code(self) -> int:
        """The exit code of this bag alone."""
        if self.error is not None:
            return 3 if self.faulty else 2
        if self.unjudged:
            return 2
        return int(self.warned)

    @property
    def unjudged(self) -> list[str]:
        """The bearings of which the recording gave no operating point: silence is not health."""
        bearings = self.document.get('bearings', {})
        return [name for name, item in bearings.items() if not item['evaluations']]

    @property
    def error(self) -> str | None:
        """Why the bag could not be checked."""
        return self.document.get('error')

    @property
    def warned(self) -> bool:
        """Whether any event raised a warning or an alarm, or an input has a wrong source."""
        bearings = self.document.get('bearings', {}).values()
        return any(
            any(event['level'] != 'OK' for event in item['events'])
            or any(each['source_faults'] for each in item['inputs'].values())
            for item in bearings
        )


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
        return _found(task, checked, show)
    except StickslipError as error:
        return failed(task, bag, str(error))


def _found(task: Task, checked: CheckReport, show: Progress) -> Found:
    document, part, clips = to_json(checked), None, None
    if task.mcap is not None:
        from stickslip_monitor.offline.verdict_bag import write_verdicts

        told = lambda n: show(f'{n} messages written', n, None)  # noqa: E731
        write_verdicts(checked, task.config, task.mcap, told)
    if task.clips is not None:
        from stickslip_monitor.offline.clips import ClipFolder, write_clips

        store = ClipFolder(replace(task.config.clips, directory=task.clips))
        clips = write_clips(checked, task.config, store)
    if task.is_drawn:
        from stickslip_monitor.report.recording import recording_part

        part = recording_part(document, checked, task.config, with_pages=task.report == '.html')
    return Found(document, part, clips, _evidence(task, checked))


def failed(task: Task, bag: Path, text: str, *, faulty: bool = False) -> Found:
    """What came of a bag that could not be checked."""
    document, part = {'schema': SCHEMA, 'path': str(bag), 'error': text}, None
    if task.is_drawn:
        from stickslip_monitor.report.recording import missing_part

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


def key_of(task: Task, bag: Path, stamp: Stamp) -> str:
    """A name for checking a bag, as it is now, in this way: equal names, equal results."""
    content = pickle.dumps((__version__, task, str(bag), stamp))
    return f'check-{sha256(content).hexdigest()[:32]}'


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
            | {k: number(getattr(extreme.point, k)) for k in _OF_WORST[name]}
            for name, extreme in item.worst.items()
        },
        **({} if item.measured is None else {'measured': item.measured}),
        'evaluations': item.evaluations,
        'data': item.complaints,
        'inputs': {each.quantity: _input(each) for each in item.inputs},
    }


_OF_WORST = {
    'hopf_margin': ('speed', 'load'),
    'fold_margin': ('speed', 'load'),
    'amplitude': ('speed', 'load', 'amplitude_exact'),
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


def to_text(document: Mapping[str, Any], coloured: bool, width: int | None = None) -> str:
    """The text of one bag.

    Args:
        document: What ``check --json`` prints of it.
        coloured: Whether it goes to a terminal that knows colours.
        width: Letters on a line; any number if None.
    """
    return ''.join(f'{line}\n' for line in _lines(document, _Paint(coloured, width)))


@dataclass(frozen=True, slots=True)
class _Paint:
    """Colours, or none, and the width of the screen."""

    coloured: bool
    width: int | None

    @property
    def narrow(self) -> bool:
        """Whether there is no room for columns."""
        return self.width is not None and self.width < _NARROW

    def __call__(self, colour: str, text: str) -> str:
        return f'{colour}{text}{_END}' if self.coloured else text

    def wrapped(self, line: str, indent: int = 2) -> str:
        """A line, broken where the screen ends."""
        return wrapped(line, self.width, indent)


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


def _lines(document: Mapping[str, Any], paint: _Paint) -> Iterator[str]:
    seconds = document['duration'] or 0.0
    path = paint(_BOLD, printable(document['path']))
    yield paint.wrapped(f'{path}: {plural(document["messages"], "message")} in {seconds:.1f} s')
    data = paint(_YELLOW, 'data:')
    for text in (*(cut['text'] for cut in document['cuts']), *document['warnings']):
        yield paint.wrapped(f'{data} {printable(text)}')
    for name, topic in document['topics'].items():
        if topic['problem']:
            text = f'topic {name} not readable: {topic["problem"]}'
            yield paint.wrapped(f'{data} {printable(text)}')
    for name, item in document['bearings'].items():
        yield from _bearing_lines(name, item, document['start'] or 0, paint)


def _bearing_lines(name: str, item: Mapping[str, Any], start: int, paint: _Paint) -> Iterator[str]:
    for text in item['data']:
        yield paint.wrapped(f'{paint(_YELLOW, "data:")} {printable(text)}')
    for quantity, each in item['inputs'].items():
        yield paint.wrapped(printable(_input_line(quantity, each)))
        for text in each['questions']:
            asked = printable(f'{quantity} on {each["topic"]} {text}')
            yield paint.wrapped(f'{paint(_YELLOW, "question:")} {asked}')
    events = item['events']
    yield f'{name}: {plural(len(events), "event") if events else "no events"}'
    if events and not paint.narrow:
        yield paint(_BOLD, f'  {"time [s]":>10}  {"from":<15}  {"to":<15}  what')
    for event in events:
        yield from _event_lines(
            event, printable(event['text'].removeprefix(f'{name}: ')), start, paint
        )
    spent = ', '.join(f'{regime} {seconds:.1f} s' for regime, seconds in item['seconds'].items())
    yield paint.wrapped(f'time in each regime: {spent}')
    if 'measured' in item:
        said = ', '.join(f'{state} {seconds:.1f} s' for state, seconds in item['measured'].items())
        yield paint.wrapped(f'measured vibration: {said}')
    for quantity in _WORST:
        if quantity in item['worst']:
            yield paint.wrapped(_worst(quantity, item['worst'][quantity], start))


def _event_lines(event: Mapping[str, Any], text: str, start: int, paint: _Paint) -> Iterator[str]:
    seconds, colour = (event['time'] - start) * 1e-9, _OF_LEVEL[event['level']]
    if paint.narrow:
        change = paint.wrapped(f'  {seconds:.2f} s: {event["from"]} to {event["to"]}', 4)
        yield f'{change.removesuffix(event["to"])}{paint(colour, event["to"])}'
        yield paint.wrapped(f'    {text}', 4)
    else:
        # Of the finished line, as colours take room in a text but none on the screen.
        head = f'  {seconds:>10.2f}  {event["from"]:<15}  {event["to"]:<15}  '
        line = paint.wrapped(f'{head}{text}', len(head))
        yield line.replace(head, f'{head[:-17]}{paint(colour, head[-17:-2])}  ', 1)


def _input_line(quantity: str, item: Mapping[str, Any]) -> str:
    """What came of an input: the range of its numbers, its rate, and the share used."""
    place = f'{quantity} on {item["topic"]}'
    if not item['used']:
        return f'{place}: {plural(item["messages"], "message")}, none used'
    (low, high), (si_low, si_high) = item['span'], item['si_span']
    unit = 'm/s' if quantity == 'speed' else 'N'
    si = '' if quantity == 'level' else f' ({si_low:.4g} to {si_high:.4g} {unit})'
    rate = '' if item['rate'] is None else f', {item["rate"]:.3g} a second'
    return f'{place}: {low:.4g} to {high:.4g} in the messages{si}{rate}, {item["share"]:.1%} used'


def _worst(quantity: str, extreme: Mapping[str, Any], start: int) -> str:
    value, exact = extreme['value'], extreme.get('amplitude_exact')
    shown = f'{value * 1e3:.4g} mm' if quantity == 'amplitude' else f'{value:+.1%}'
    beside = '' if exact is None else f' (exact cycle: {exact * 1e3:.4g} mm)'
    seconds = (extreme['time'] - start) * 1e-9
    return f'worst {_WORST[quantity]}: {shown}{beside} at {seconds:.2f} s'
