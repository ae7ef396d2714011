# SPDX-License-Identifier: Apache-2.0
"""What a check found as text: a line for each event, so that a day of them is written at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from stickslip_monitor.monitor.alarm import Level

_GREEN, _YELLOW, _RED, _BOLD, _END = (f'\x1b[{code}m' for code in (32, 33, 31, 1, 0))
_OF_LEVEL = {Level.OK.name: _GREEN, Level.WARN.name: _YELLOW, Level.ERROR.name: _RED}
_WORST = (('hopf_margin', ''), ('fold_margin', ''), ('amplitude', ' m'))


def to_text(document: Mapping[str, Any], coloured: bool) -> str:
    """The text of one bag.

    Args:
        document: What ``check --json`` prints of it.
        coloured: Whether it goes to a terminal that knows colours.
    """
    return ''.join(f'{line}\n' for line in _lines(document, _Paint(coloured)))


class _Paint:
    """Colours, or none."""

    def __init__(self, coloured: bool) -> None:
        self._coloured = coloured

    def __call__(self, colour: str, text: str) -> str:
        return f'{colour}{text}{_END}' if self._coloured else text


def plain(text: str) -> str:
    """A text without what would do something to a terminal."""
    return ''.join(c if c.isprintable() else '\N{REPLACEMENT CHARACTER}' for c in text)


def _lines(document: Mapping[str, Any], paint: _Paint) -> Iterator[str]:
    seconds = document['duration'] or 0.0
    path = paint(_BOLD, plain(document['path']))
    yield f'{path}: {document["messages"]} messages in {seconds:.1f} s'
    data = paint(_YELLOW, 'data:')
    for text in (*(cut['text'] for cut in document['cuts']), *document['warnings']):
        yield f'{data} {plain(text)}'
    for name, topic in document['topics'].items():
        if topic['problem']:
            text = f'topic {name} not readable: {topic["problem"]}'
            yield f'{data} {plain(text)}'
    for name, item in document['bearings'].items():
        yield from _bearing(name, item, document['start'] or 0, paint)


def _bearing(name: str, item: Mapping[str, Any], start: int, paint: _Paint) -> Iterator[str]:
    for text in item['data']:
        yield f'{paint(_YELLOW, "data:")} {plain(text)}'
    events = item['events']
    yield f'{name}: {len(events) or "no"} events'
    if events:
        yield paint(_BOLD, f'  {"time [s]":>10}  {"from":<15}  {"to":<15}  what')
    for event in events:
        seconds = (event['time'] - start) * 1e-9
        after = paint(_OF_LEVEL[event['level']], f'{event["to"]:<15}')
        text = plain(event['text'].removeprefix(f'{name}: '))
        yield f'  {seconds:>10.2f}  {event["from"]:<15}  {after}  {text}'
    spent = ', '.join(f'{regime} {seconds:.1f} s' for regime, seconds in item['seconds'].items())
    yield f'time in each regime: {spent}'
    for quantity, unit in _WORST:
        if quantity in item['worst']:
            yield _worst(quantity, unit, item['worst'][quantity], start)


def _worst(quantity: str, unit: str, extreme: Mapping[str, Any], start: int) -> str:
    exact = extreme.get('amplitude_exact')
    beside = '' if exact is None else f' (exact cycle: {exact:.4g} m)'
    return (
        f'worst {quantity.replace("_", " ")}: {extreme["value"]:.4g}{unit}{beside}'
        f' at {(extreme["time"] - start) * 1e-9:.2f} s'
    )
