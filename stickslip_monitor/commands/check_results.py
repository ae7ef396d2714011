# SPDX-License-Identifier: Apache-2.0
"""What a check found as the documented JSON object; the printed text is made from it too.

What a check found as text: a line for each event, so that a day of them is written at once.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stickslip_monitor.errors import plural
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.ladder import Level
from stickslip_monitor.monitor.messages import event_records, number
from stickslip_monitor.offline.check import BearingReport, CheckReport, InputReport

SCHEMA = 'stickslip_monitor/check/1'


def to_json(report: CheckReport) -> dict[str, Any]:
    """The report as a JSON object."""
    bag = report.bag
    start, end = bag.start_ns, bag.end_ns
    return {
        'schema': SCHEMA,
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
        'bearings': {name: _bearing_record(item) for name, item in report.bearings.items()},
    }


def error_json(path: Path, text: str) -> dict[str, Any]:
    """What stands in the place of a bag that could not be checked."""
    return {'schema': SCHEMA, 'path': str(path), 'error': text}


def _bearing_record(item: BearingReport) -> dict[str, Any]:
    return {
        'events': event_records(item.events),
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
        if self.width is None:
            return line
        # The last column stays free: not every terminal breaks behind it.
        # A path that is cut in two cannot be copied.
        return textwrap.fill(
            line, max(self.width - 1, 20), subsequent_indent=' ' * indent,
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
