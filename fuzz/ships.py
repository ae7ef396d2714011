# SPDX-License-Identifier: Apache-2.0
"""Random ships and voyages over a bus, judged as they come (``watch``) and from their log (``check``).

Bearings share shafts and transducers, or have a load that is assumed; each input has its time-out, and
perhaps lets values stand. Senders come in several paces, fall silent, freeze, or know no number.
"""

from __future__ import annotations

import itertools
import json
import random
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime, timedelta, timezone
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_monitor.commands.watch import load_watch
from stickslip_monitor.errors import BagError
from stickslip_monitor.host import HostClock
from stickslip_monitor.links.live_monitor import TICK, LiveMonitor
from stickslip_monitor.links.nmea import NmeaInputs, SentenceStream
from stickslip_monitor.links.signalk import SignalKInputs
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.session import NoLog, Sink
from stickslip_monitor.monitor.statements import Event
from stickslip_monitor.offline.check import CheckReport, check_recording

T0 = datetime(2026, 5, 4, 6, 0, tzinfo=timezone.utc)
T0_NS = int(T0.timestamp()) * 10**9
OWN_VESSEL = 'vessels.urn:mrn:imo:mmsi:257000000'
BEARING = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction': {'law': 'stribeck', 'static': 0.3, 'kinetic': 0.1, 'decay': 10.0},
}
LISTEN = {
    'nmea': {'nmea.listen': 'udp://127.0.0.1:10110'},
    'signalk': {'signalk.url': 'http://127.0.0.1:3000'},
}
LATE_NS = 700_000_000
"""Live the passing of time is passed on half a second late, at the next tick."""
_TALKERS = ('II', 'ER', 'VD', 'SN')
_LOADS = 'no', 'no', 'constant', 'over_speed'

Document = dict[str, Any]
"""What a parameter file holds."""
Lines = Sequence[tuple[float, str]]
"""Seconds since the beginning, and the line of a log."""


class Signal(NamedTuple):
    """A number on a bus: the speed of a shaft, or the load that a transducer measures."""

    is_load: bool
    number: int

    @property
    def column(self) -> dict[str, str]:
        """Its name in a log of each bus."""
        if self.is_load:
            return {'nmea': f'LOAD{self.number}', 'signalk': f'propulsion.{self.number}.shaft.load'}
        return {'nmea': f'RPM S {self.number + 1}', 'signalk': f'propulsion.{self.number}.revolutions'}

    def link(self, bus: str) -> dict[str, Any]:
        """Return the parameters of the input that it is."""
        if bus == 'signalk':
            return {'from': bus, 'path': self.column[bus]}
        if self.is_load:
            return {'from': bus, 'sentence': 'XDR', 'kind': 'N', 'name': self.column[bus]}
        return {'from': bus, 'sentence': 'RPM', 'kind': 'S', 'number': self.number + 1}


class Sample(NamedTuple):
    """A number that a source sends, in rpm or N; None for one that it does not know."""

    time: float
    source: str
    signal: Signal
    value: float | None


class Events(Sink):
    """Keeps the events of a session."""

    def __init__(self) -> None:
        self.found: list[Event] = []

    def take_event(self, event: Event) -> None:
        """Keep an event."""
        self.found.append(event)


def random_ship(rng: random.Random, bus: str) -> tuple[Document, list[Signal]]:
    """Return the parameters of a ship of up to three bearings, and the signals that they need."""
    names = ['aft', 'mid', 'fore'][: rng.choice((1, 1, 2, 3))]
    shafts = rng.choice((1, 1, 2))
    bearings, links, signals = dict[str, Any](), dict[str, Any](LISTEN[bus]), list[Signal]()
    unit, turn = ('rpm', 1.0) if bus == 'nmea' else ('Hz', 60.0)
    for k, name in enumerate(names):
        signals_of_bearing = {'speed': Signal(False, k % shafts)}
        inputs: dict[str, dict[str, Any]] = {'speed': {'unit': unit}, 'load': {'unit': 'N'}}
        match rng.choice(_LOADS):
            case 'constant':
                inputs['load']['constant'] = 1000.0
            case 'over_speed':
                inputs['load']['over_speed'] = [[0.0, 1500.0], [60.0 / turn, 1000.0], [150.0 / turn, 700.0]]
            case _:
                signals_of_bearing['load'] = Signal(True, k if rng.random() < 0.8 else 0)
        for quantity, signal in signals_of_bearing.items():
            links[f'{name}.{quantity}'] = signal.link(bus)
            inputs[quantity]['column'] = signal.column[bus]
            if rng.random() < 0.3:
                inputs[quantity]['timeout'] = rng.choice((2.0, 8.0, 15.0))
            if rng.random() < 0.15:
                inputs[quantity]['hold'] = rng.choice((20.0, 60.0, 600.0))
        signals += signals_of_bearing.values()
        bearings[name] = {**BEARING, **inputs}
    document = {
        '/**': {'ros__parameters': {'bearings': names, **bearings}},
        '/stickslip_links': {'ros__parameters': links},
    }
    return document, list(dict.fromkeys(signals))


def random_voyage(rng: random.Random, signals: Iterable[Signal]) -> list[Sample]:
    """Return what the senders of some signals send in two to five minutes, in the order of time."""
    end = rng.choice((90.0, 120.0, 300.0))
    course = [rng.choice((136.0, 20.0, 45.0, 0.0, 60.0, 8.0)) for _ in range(13)]
    is_gradual = rng.random() < 0.5
    samples = list[Sample]()
    for signal in signals:
        period = rng.choice((0.1, 0.5, 0.5, 1.0, 1.0, 3.0, 8.0))
        for name in rng.sample(_TALKERS, rng.choice((1, 1, 2, 3))):
            samples += _random_sender(rng, name, signal, period, end, course, is_gradual)
    for _ in range(rng.choice((0, 0, 1, 2))):
        begin, length = rng.uniform(0, end), rng.choice((2, 4, 6, 20, 60))
        samples = [sample for sample in samples if not begin <= sample.time < begin + length]
    return sorted(samples, key=lambda sample: sample.time)


def _random_sender(
    rng: random.Random,
    name: str,
    signal: Signal,
    period: float,
    end: float,
    course: Sequence[float],
    is_gradual: bool,
) -> Iterator[Sample]:
    """Yield what one sender sends: values, none known, a frozen value, odd ones, or for a while nothing.

    Args:
        rng: Source of chance.
        name: Its talker or source.
        signal: The number.
        period: Usual time between two [s].
        end: When the voyage ends [s].
        course: Speeds of the shaft over the voyage [rpm].
        is_gradual: Whether the speed goes from one to the next, in place of steps.
    """
    state, time, jitter = (
        rng.choice(('silent', *['values'] * 4, 'none')),
        rng.random() * period,
        rng.choice((0, 0.3)),
    )
    value = 0.0
    while time < end:
        if rng.random() < 0.02:
            state = rng.choice(('silent', *['values'] * 4, 'none', 'frozen'))
        if state != 'frozen':
            k, share = divmod(time / end * (len(course) - 1), 1.0)
            low, high = course[int(k) : int(k) + 2]
            value = 1000.0 + rng.choice((0.0, rng.gauss(0, 20)))
            if not signal.is_load:
                value = low + (high - low) * share * is_gradual + 0.5 * _TALKERS.index(name)
                value = value * (1.0 - 0.1 * signal.number) + rng.choice((0.0, rng.gauss(0, 0.3)))
            if rng.random() < 0.005:
                value = rng.choice((1e9, -1e9, 65535.0, 32767.0, -value))
        if state != 'silent':
            yield Sample(round(time, 3), name, signal, None if state == 'none' else value)
        time += period * (1 + jitter * rng.uniform(-1, 1))


def stamp_of(time: float) -> str:
    """Return the stamp of a time since the beginning [s]."""
    return f'{T0 + timedelta(seconds=time):%Y-%m-%dT%H:%M:%S.%f}'[:-3] + 'Z'


def sentence_line(time: float, body: str) -> tuple[float, str]:
    """Return a time [s] and the line of a sentence of NMEA 0183, as a logger stamps it."""
    return time, f'{stamp_of(time)} ${body}*{reduce(xor, body.encode()):02X}\r\n'


def greeting() -> tuple[float, str]:
    """Return the first line of a log of Signal K: the greeting of the server."""
    hello = {'name': 's', 'version': '2.24.0', 'self': OWN_VESSEL, 'timestamp': stamp_of(0)}
    return 0.0, json.dumps(hello) + '\n'


def delta_line(time: float, source: str, path: str, value: float | None) -> tuple[float, str]:
    """Return a time [s] and the line of a delta of Signal K with one value."""
    update = {'$source': source, 'timestamp': stamp_of(time), 'values': [{'path': path, 'value': value}]}
    return time, json.dumps({'context': OWN_VESSEL, 'updates': [update]}) + '\n'


def lines_of(bus: str, samples: Iterable[Sample]) -> Lines:
    """Return the log of some samples."""
    lines = [greeting()] if bus == 'signalk' else []
    for time, source, signal, value in samples:
        if bus == 'signalk':
            number = value if signal.is_load or value is None else value / 60.0
            lines.append(delta_line(time, source, signal.column[bus], number))
            continue
        text = '' if value is None else f'{value:.2f}'
        status = 'V' if value is None else 'A'
        body = f'{source}RPM,S,{signal.number + 1},{text},30.0,{status}'
        if signal.is_load:
            body = f'{source}XDR,N,{text},N,{signal.column[bus]}'
        lines.append(sentence_line(time, body))
    return lines


def live_events(ship: Path, bus: str, lines: Lines, log: Callable[[str], object]) -> list[Event]:
    """Return what ``stickslip watch`` finds as the lines of a log come, its clock being that of the log.

    Args:
        ship: The parameter file.
        bus: The bus.
        lines: The lines.
        log: Takes what is said of sources.
    """
    config, links = load_watch(str(ship), None)
    # The greeting of a server has the first place, and no number.
    begin_ns = T0_NS + round(lines[int(bus == 'signalk')][0] * 1e9)
    now_ns, sink = [begin_ns], Events()
    clock = HostClock(lambda: now_ns[0], lambda: now_ns[0])
    live = LiveMonitor(config, sink, NoLog(), clock=clock)
    live.begin()
    stream, nmea, signalk = SentenceStream(), NmeaInputs(links.of('nmea'), log), None
    tick_ns = begin_ns
    for time, line in lines:
        at_ns = T0_NS + round(time * 1e9)
        while (tick_ns := tick_ns + round(TICK * 1e9)) <= at_ns:
            now_ns[0] = tick_ns
            live.tick()
        tick_ns -= round(TICK * 1e9)
        now_ns[0] = at_ns
        if bus == 'nmea':
            # What stands before a sentence is the logger's.
            for text in stream.take(line.partition(' ')[2].encode()):
                for sample in nmea.take(text, time):
                    live.take(*sample)
            continue
        try:
            frame: Any = json.loads(line)
        except ValueError:
            continue
        if signalk is None:
            signalk = SignalKInputs(links.of('signalk'), log)
            signalk.greet(frame, time)
            continue
        for bus_sample in signalk.take(frame, time):
            live.take(*bus_sample)
    end_ns = now_ns[0]
    while now_ns[0] < end_ns + LATE_NS:
        now_ns[0] += round(TICK * 1e9)
        live.tick()
    return [event for event in sink.found if event.time_ns <= end_ns]


def differences(folder: Path, ship: Path, bus: str, lines: Lines) -> tuple[list[str], CheckReport, list[str]]:
    """Compare what ``watch`` and ``check`` find in the same lines.

    Events are equal where their conditions are, and their times but for :data:`LATE_NS`; what is said of
    sources is equal but for how long they were silent. A bearing without an input counts in neither.

    Args:
        folder: Takes the log.
        ship: The parameter file.
        bus: The bus.
        lines: The lines.

    Returns:
        A sentence for each difference, the report of the check, and what was said live.

    Raises:
        BagError: The log cannot be checked.
    """
    log, texts, result = folder / 'bus.log', list[str](), list[str]()
    log.write_text(''.join(line for _, line in lines), newline='')
    events = live_events(ship, bus, lines, texts.append)
    report = check_recording(log, load_config(str(ship)))
    for name, bearing in report.bearings.items():
        if any(item.fault and not item.messages for item in bearing.inputs):
            continue
        live = [event for event in events if event.bearing == name]
        pairs = list(itertools.zip_longest(bearing.events, live))
        if not all(
            a and b and a.after is b.after and abs(a.time_ns - b.time_ns) <= LATE_NS for a, b in pairs
        ):
            event_texts = [', '.join(map(event_text, side)) for side in (bearing.events, live)]
            result.append(f'{name}: check {event_texts[0]}; watch {event_texts[1]}')
    checked = {_plain_text(text) for text in report.bag.warnings if ': source ' in text}
    watched = {_plain_text(text) for text in texts if ': source ' in text}
    result += [f'only one says: {text}' for text in sorted(checked ^ watched)]
    return result, report, texts


def event_text(event: Event, start_ns: int = T0_NS) -> str:
    """Return the condition that an event leads to, and its time since a start [ns]."""
    return f'{event.after.name} {(event.time_ns - start_ns) * 1e-9:.2f} s'


def _plain_text(text: str) -> str:
    """Return a sentence on a source without the name of its bus, and how long another was silent."""
    return re.sub('^(NMEA XDR|NMEA|Signal K) | for [0-9.e+]+ s', '', text)


def random_differences(folder: Path, bus: str, seed: int) -> list[str]:
    """Return a sentence for each difference between ``watch`` and ``check`` of a random ship and voyage."""
    rng = random.Random(seed)
    document, signals = random_ship(rng, bus)
    samples = random_voyage(rng, signals)
    if not samples:
        return []
    lines = lines_of(bus, samples)
    ship = folder / 'ship.yaml'
    ship.write_text(json.dumps(document))
    try:
        return differences(folder, ship, bus, lines)[0]
    except BagError as error:
        # Nothing is known of any bearing: live, all of them wait for their inputs.
        events = live_events(ship, bus, lines, str)
        return [str(error)] if any(event.after.name != 'INPUT_STALE' for event in events) else []
