# SPDX-License-Identifier: Apache-2.0
"""A voyage that was recorded from a bus is judged as it was live, source by source."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from stickslip_monitor.commands.watch import load_watch
from stickslip_monitor.host import HostClock
from stickslip_monitor.links.buses import TICK, LiveMonitor
from stickslip_monitor.links.nmea import NmeaInputs, SentenceStream
from stickslip_monitor.links.signalk import SignalKInputs
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.session import NoLog, Sink
from stickslip_monitor.monitor.signals import Input
from stickslip_monitor.monitor.statements import Event
from stickslip_monitor.offline.check import check_recording

T0 = datetime(2026, 5, 4, 6, 0, tzinfo=timezone.utc)
T0_NS = int(T0.timestamp()) * 10**9
BEARING = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction': {'law': 'stribeck', 'static': 0.3, 'kinetic': 0.1, 'decay': 10.0},
    'load': {'unit': 'N'},
}
NMEA = {
    'nmea.listen': 'udp://127.0.0.1:10110',
    'aft.speed': {'from': 'nmea', 'sentence': 'RPM', 'kind': 'S'},
    'aft.load': {'from': 'nmea', 'sentence': 'XDR', 'kind': 'N', 'name': 'AFTLOAD'},
}
SIGNALK = {
    'signalk.url': 'http://127.0.0.1:3000',
    'aft.speed': {'from': 'signalk', 'path': 'propulsion.port.revolutions'},
    'aft.load': {'from': 'signalk', 'path': 'propulsion.port.shaft.load'},
}
COLUMNS = {
    'nmea': ('RPM S 1', 'AFTLOAD'),
    'signalk': ('propulsion.port.revolutions', 'propulsion.port.shaft.load'),
}
# Live the passing of time is passed on half a second late, at the next tick.
LATE_NS = 700_000_000


class Sample(NamedTuple):
    """A number that a source sends; None for one that it does not know."""

    time: float
    source: str
    place: Input
    value: float | None


def voyage(rename_at: float = 60.0, both: float = 0.0) -> list[Sample]:
    """Quiet at 136 rpm, from 60 s on stick-slip at 20 rpm; a spare sender takes over the speed."""
    found = []
    for k in range(240):
        t, value = 0.5 * k, 136.0 if k < 120 else 20.0
        found += [Sample(t, 'II', Input.SPEED, value)] * (t < rename_at)
        found += [Sample(t, 'ER', Input.SPEED, value + 0.5)] * (t >= rename_at - both)
        found.append(Sample(t, 'II', Input.LOAD, 1000.0 + k % 7))
    return found


def random_voyage(seed: int) -> list[Sample]:
    """Two or three senders of each number, each silent or without a number for some stretches."""
    chance = random.Random(seed)
    names = ['II', 'ER', 'VD'][: chance.choice((2, 3))]
    speed = [chance.choice((136.0, 20.0, 45.0, 0.0)) for _ in range(12)]
    states = {(name, place): chance.choice('sssnv') for name in names for place in (Input.SPEED, Input.LOAD)}
    found = []
    for k in range(600):
        for key, state in states.items():
            if chance.random() < 0.02:
                state = states[key] = chance.choice('ssvvvn')  # silent, values, or none known
            name, place = key
            value = speed[k // 50] + names.index(name) if place is Input.SPEED else 1000.0 + k % 7
            if state != 's':
                found.append(Sample(0.5 * k, name, place, value if state == 'v' else None))
    return found


def stamp(t: float) -> str:
    return f'{T0 + timedelta(seconds=t):%Y-%m-%dT%H:%M:%S.%f}'[:-3] + 'Z'


def nmea_lines(samples: list[Sample]) -> Iterator[tuple[float, str]]:
    for t, source, place, value in samples:
        number = '' if value is None else f'{value:.2f}'
        body = f'{source}RPM,S,1,{number},30.0,{"V" if value is None else "A"}'
        if place is Input.LOAD:
            body = f'{source}XDR,N,{number},N,AFTLOAD'
        yield t, f'{stamp(t)} ${body}*{reduce(xor, body.encode()):02X}\r\n'


def signalk_lines(samples: list[Sample]) -> Iterator[tuple[float, str]]:
    own = 'vessels.urn:mrn:imo:mmsi:257000000'
    yield 0.0, json.dumps({'name': 's', 'version': '2.24.0', 'self': own, 'timestamp': stamp(0)}) + '\n'
    for t, source, place, value in samples:
        number = value if place is Input.LOAD or value is None else value / 60.0
        values = [{'path': COLUMNS['signalk'][place is Input.LOAD], 'value': number}]
        update = {'$source': source, 'timestamp': stamp(t), 'values': values}
        yield t, json.dumps({'context': own, 'updates': [update]}) + '\n'


def rough_nmea_lines(seed: int, samples: list[Sample]) -> Iterator[tuple[float, str]]:
    """Sentences as rough wires bring them: damaged, joined, without a unit, of other kinds between them."""
    chance = random.Random(seed)
    for t, line in nmea_lines(samples):
        head, _, text = line.rstrip().partition(' ')
        talker, fields = text[1:3], text[3:-3].split(',')
        bodies = {
            'exponent': [*fields[: 1 if 'XDR' in fields else 3], '1e2', '30.0', 'A'],
            'leading zero': [*fields[:2], f'0{fields[2]}', *fields[3:]] if fields[0] == 'RPM' else fields,
            'no unit': [*fields[:3], '', *fields[4:]] if fields[0] == 'XDR' else fields,
            'pressure': ['XDR', 'P', '3.1', 'B', 'AFTLOAD'],
            'engine': ['RPM', 'E', '1', '500.0', '', 'A'],
            'position': ['GGA', '1', '2', '3'],
            'twice': [*fields, 'N', '1700.0', 'N', 'AFTLOAD'] if fields[0] == 'XDR' else fields,
        }
        kind = chance.choice([*bodies, *['plain'] * 20])
        body = talker + ','.join(bodies.get(kind, fields))
        text = f'${body}*{reduce(xor, body.encode()):02X}'
        cut = chance.randrange(1, len(text))
        text = chance.choice([text] * 20 + [text[:cut], text.replace('*', '', 1), text + text])
        yield t, f'{head} {text}\r\n'


def rough_signalk_lines(seed: int, samples: list[Sample]) -> Iterator[tuple[float, str]]:
    """Deltas of several kinds: other vessels, words, nameless values, damaged lines, sources as objects."""
    chance = random.Random(seed)
    for t, line in signalk_lines(samples):
        frame = json.loads(line)
        if 'updates' in frame and chance.random() < 0.3:
            (update,) = frame['updates']
            (value,) = update['values']
            kind = chance.randrange(6)
            frame |= {'context': 'vessels.urn:mrn:imo:mmsi:1'} if kind == 0 else {}
            frame |= {'context': 'vessels.self'} if kind == 1 else {}
            value['value'] = chance.choice(['12', True, [1]]) if kind == 2 else value['value']
            update['values'] += [{'path': '', 'value': 3.0}] * (kind == 3)
            if kind == 4:
                update['source'] = {'label': update.pop('$source')}
            line = json.dumps(frame) + '\n'
            line = line[: len(line) // 2] + '\n' if kind == 5 else line
        yield t, line


class Events(Sink):
    def __init__(self) -> None:
        self.found: list[Event] = []

    def take_event(self, event: Event) -> None:
        self.found.append(event)


def ship_file(folder: Path, bus: str, column: bool) -> str:
    unit, links = ('rpm', NMEA) if bus == 'nmea' else ('Hz', SIGNALK)
    speed, load = ({'column': name} if column else {} for name in COLUMNS[bus])
    own = BEARING | {'speed': {'unit': unit, **speed}, 'load': {'unit': 'N', **load}}
    if not column:
        own['speed'] |= {'topic': '/speed'}
        own['load'] |= {'topic': '/load'}
    document = {
        '/**': {'ros__parameters': {'bearings': ['aft'], 'aft': own}},
        '/stickslip_links': {'ros__parameters': links},
    }
    path = folder / f'ship_{column}.yaml'
    path.write_text(yaml.safe_dump(document))
    return str(path)


def live_events(folder: Path, bus: str, lines: list[tuple[float, str]], said: list[str]) -> list[Event]:
    """What `stickslip watch` would have found, its clock being that of the log."""
    config, links = load_watch(ship_file(folder, bus, True), None)
    # The greeting of a server has the first place, and no number.
    begin_ns = T0_NS + round(lines[int(bus == 'signalk')][0] * 1e9)
    now_ns, sink = [begin_ns], Events()
    clock = HostClock(lambda: now_ns[0], lambda: now_ns[0])
    live = LiveMonitor(config, sink, NoLog(), clock=clock)
    live.begin()
    stream, nmea, signalk = SentenceStream(), NmeaInputs(links.of('nmea'), said.append), None
    tick_ns = begin_ns
    for t, line in lines:
        at_ns = T0_NS + round(t * 1e9)
        while (tick_ns := tick_ns + round(TICK * 1e9)) <= at_ns:
            now_ns[0] = tick_ns
            live.tick()
        tick_ns -= round(TICK * 1e9)
        now_ns[0] = at_ns
        if bus == 'nmea':
            # What stands before a sentence is the logger's.
            for found in stream.take(line.partition(' ')[2].encode()):
                for sample in nmea.take(found, t):
                    live.take(*sample)
            continue
        try:
            frame: Any = json.loads(line)
        except ValueError:
            continue
        if signalk is None:
            signalk = SignalKInputs(links.of('signalk'), said.append)
            signalk.greet(frame, t)
            continue
        for own in signalk.take(frame, t):
            live.take(*own)
    return sink.found


def events_of(found: list[Event]) -> list[tuple[str, int]]:
    return [(event.after.name, event.time_ns) for event in found]


def compare(folder: Path, bus: str, samples: list[Sample]) -> tuple[list[tuple[str, int]], str, str]:
    """Check that both give the same; return the events, and what each says of the sources."""
    return compare_lines(folder, bus, list((nmea_lines if bus == 'nmea' else signalk_lines)(samples)))


def compare_lines(
    folder: Path, bus: str, lines: list[tuple[float, str]]
) -> tuple[list[tuple[str, int]], str, str]:
    """Check that both give the same of some lines, as :func:`compare` does."""
    (folder / 'a.log').write_text(''.join(line for _, line in lines), newline='')
    said: list[str] = []
    live = events_of(live_events(folder, bus, lines, said))
    report = check_recording(folder / 'a.log', load_config(ship_file(folder, bus, True)))
    (bearing,) = report.bearings.values()
    checked = events_of(list(bearing.events))
    assert [name for name, _ in checked] == [name for name, _ in live]
    assert all(abs(a - b) <= LATE_NS for (_, a), (_, b) in zip(checked, live, strict=True))
    offline = [text for text in report.bag.warnings if ': source ' in text]
    assert {*offline} == {re.sub('^(NMEA XDR|NMEA|Signal K) ', '', text) for text in said if 'source' in text}
    return checked, ' | '.join(offline), ' | '.join(said)


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
@pytest.mark.parametrize('make', [voyage, lambda: voyage(30.0), lambda: voyage(80.0, both=40.0)])
def test_a_spare_sender_takes_over(bus: str, make: Callable[[], list[Sample]], tmp_path: Path) -> None:
    events, offline, live = compare(tmp_path, bus, make())
    assert 'STICK_SLIP' in {name for name, _ in events}
    assert "source 'ER' is used; 'II' has sent no number for " in offline
    assert "source 'ER' is used; 'II' has sent no number for " in live


def in_other_units(lines: list[tuple[float, str]], since: float) -> Iterator[tuple[float, str]]:
    """Yield lines with meta data from a time [s] on by which speeds are in rpm and loads in kN."""
    units = dict(zip(COLUMNS['signalk'], (('rpm', 60.0), ('kN', 1e-3)), strict=True))
    meta = [{'path': path, 'value': {'units': unit}} for path, (unit, _) in units.items()]
    yield lines[0]
    has_begun = False
    for t, line in lines[1:]:
        delta = json.loads(line)
        if t >= since:
            if not has_begun:
                has_begun = True
                update = {'timestamp': stamp(t), 'meta': meta}
                yield t, json.dumps({'context': delta['context'], 'updates': [update]}) + '\n'
            (item,) = delta['updates'][0]['values']
            item['value'] *= units[item['path']][1]
        yield t, json.dumps(delta) + '\n'


@pytest.mark.parametrize('since', [0.0, 30.0, 90.0])
def test_units_of_meta_data_are_converted(since: float, tmp_path: Path) -> None:
    lines = list(signalk_lines(voyage()))
    events, _, _ = compare_lines(tmp_path, 'signalk', lines)
    converted, _, live = compare_lines(tmp_path, 'signalk', list(in_other_units(lines, since)))
    assert converted == events
    assert "its unit is 'kN', converted to N" in live


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
@pytest.mark.parametrize('seed', range(4))
@pytest.mark.slow
def test_random_voyages(bus: str, seed: int, tmp_path: Path) -> None:
    compare(tmp_path, bus, random_voyage(seed))


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
@pytest.mark.parametrize('seed', range(100, 104))
@pytest.mark.slow
def test_rough_random_voyages(bus: str, seed: int, tmp_path: Path) -> None:
    rough = rough_nmea_lines if bus == 'nmea' else rough_signalk_lines
    compare_lines(tmp_path, bus, list(rough(seed, random_voyage(seed))))


@pytest.mark.parametrize('every', [3.0, 8.0])
def test_a_slow_bus_is_lost_as_live(every: float, tmp_path: Path) -> None:
    """A value each 8 s is older than 5 s, on board and in the log."""
    samples = [
        Sample(every * k, 'II', place, 900.0 if place else 136.0) for k in range(30) for place in (0, 1)
    ]
    samples = [sample._replace(place=Input(sample.place)) for sample in samples]
    events, _, _ = compare(tmp_path, 'nmea', samples)
    assert ('INPUT_STALE' in {name for name, _ in events}) == (every > 5.0)


def test_a_bus_goes_on_where_its_speed_and_load_end(tmp_path: Path) -> None:
    lines = list(nmea_lines([sample for sample in voyage() if sample.time < 50.0]))
    body = 'GPGGA,1,2,3'
    lines += [(t, f'{stamp(t)} ${body}*{reduce(xor, body.encode()):02X}\r\n') for t in range(50, 100)]
    events, _, _ = compare_lines(tmp_path, 'nmea', lines)
    assert [name for name, _ in events] == ['INPUT_STALE']


@pytest.mark.parametrize('bus', ['nmea', 'signalk'])
def test_the_other_sender_is_no_second_column(bus: str, tmp_path: Path) -> None:
    lines = (nmea_lines if bus == 'nmea' else signalk_lines)(voyage())
    (tmp_path / 'a.log').write_text(''.join(line for _, line in lines), newline='')
    report = check_recording(tmp_path / 'a.log', load_config(ship_file(tmp_path, bus, False)))
    (bearing,) = report.bearings.values()
    assert 'STICK_SLIP' in {event.after.name for event in bearing.events}
