# SPDX-License-Identifier: Apache-2.0
"""Random recordings of the node's topics, judged message by message as the node's session does, and in bulk.

Messages are late by some jitter, have stamps of other clocks or none, repeat, are out of order, or are no
numbers; senders fall silent.
"""

from __future__ import annotations

import itertools
import random
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from fuzz.ships import BEARING, LATE_NS, Events, event_text
from stickslip_logs.recordings.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.configuration import build_config
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.sample_types import INPUTS
from stickslip_monitor.monitor.session import Moment, NoLog, Session
from stickslip_monitor.offline.check import check_recording

START_NS = 1_777_874_400 * 10**9
TICK_NS, BEHIND_NS = 10**8, 5 * 10**8
"""Time between two looks of the node, and how late it passes time on [ns]."""
_FORCE, _NUMBER = 'geometry_msgs/msg/WrenchStamped', 'std_msgs/msg/Float64'
_FIELDS = {_FORCE: 'wrench.force.z', _NUMBER: 'data'}


class Sent(NamedTuple):
    """A number on its way: when it comes and is recorded, and its stamp [ns]."""

    log_ns: int
    stamp_ns: int
    place: int
    value: float


def random_config(rng: random.Random) -> tuple[MonitorConfig, list[str]]:
    """Return a bearing whose inputs have random types and time-outs, and the types by input."""
    names = ['speed', 'load', *rng.choice(((), (), ('level',), ('water_temperature',)))]
    kinds = [rng.choice((_FORCE, _NUMBER)) for _ in names]
    values: dict[str, object] = {}
    for key, value in BEARING.items():
        values |= {f'{key}.{k}': v for k, v in value.items()} if isinstance(value, dict) else {key: value}
    for name, kind in zip(names, kinds, strict=True):
        values |= {f'{name}.topic': f'/{name}', f'{name}.type': kind, f'{name}.field': _FIELDS[kind]}
        if rng.random() < 0.3:
            values[f'{name}.timeout'] = rng.choice((2.0, 8.0, 15.0))
        if rng.random() < 0.2 and name in ('speed', 'load'):
            values[f'{name}.hold'] = rng.choice((20.0, 60.0, 600.0))
    if 'level' in names:
        values['level.threshold'] = 6.0
        values['level.unit'] = 'dB'
    if 'water_temperature' in names:
        values['friction.at_temperature'] = 12.0
    values |= {'speed.unit': 'rpm', 'load.unit': 'N'}
    named = {f'aft.{key}': value for key, value in values.items()}
    return build_config({'bearings': ['aft'], **named}), kinds


def random_messages(rng: random.Random, kinds: Sequence[str], places: Sequence[int]) -> list[Sent]:
    """Return what is recorded in two to five minutes, in the order in which it comes."""
    end = rng.choice((90.0, 120.0, 300.0))
    course = [rng.choice((136.0, 20.0, 45.0, 0.0, 60.0, 8.0)) for _ in range(13)]
    is_gradual = rng.random() < 0.5
    rows = list[tuple[float, float, int, float]]()  # when it comes and was measured [s], of what, the number
    for kind, place in zip(kinds, places, strict=True):
        period, jitter = rng.choice((0.1, 0.5, 1.0, 1.0, 3.0)), rng.choice((0.0, 0.3))
        delay, spread = rng.choice(((0.0, 0.0), (0.0, 0.05), (0.3, 0.3), (0.2, 1.5)))
        ahead = rng.choice((0.0, 0.0, 0.0, -3600.0, 3600.0, 0.4))  # of the sender's clock [s]
        state, time, value = 'values', rng.random() * period, 0.0
        while time < end:
            if rng.random() < 0.02:
                state = rng.choice(('silent', *['values'] * 5, 'none', 'frozen', 'twice'))
            if state != 'frozen':
                value = _random_number(rng, place, time / end, course, is_gradual)
            sent = [] if state == 'silent' else [float('nan') if state == 'none' else value]
            for number in sent * (1 + (state == 'twice')):
                comes = time + delay + abs(rng.gauss(0, spread))
                rows.append((comes, time + ahead if kind == _FORCE else comes, place, number))
            time += period * (1 + jitter * rng.uniform(-1, 1))
    rows.sort()
    recorded = [(place, value, *(START_NS + round(t * 1e9) for t in (c, s))) for c, s, place, value in rows]
    return [Sent(comes_ns, stamp_ns, place, value) for place, value, comes_ns, stamp_ns in recorded]


def _random_number(
    rng: random.Random, place: int, share: float, course: Sequence[float], is_gradual: bool
) -> float:
    """Return a number of an input at a share of the voyage: of the course, or rarely an odd one."""
    if rng.random() < 0.005:
        return rng.choice((1e9, -1e9, 65535.0, -1.0, float('inf')))
    k, remainder = divmod(share * (len(course) - 1), 1.0)
    low, high = course[int(k) : int(k) + 2]
    speed = low + (high - low) * remainder * is_gradual + rng.choice((0.0, rng.gauss(0, 0.3)))
    usual = (speed, 1000.0 + rng.gauss(0, 20), rng.choice((40.0, 55.0)) + rng.gauss(0, 1), 12.0)
    return usual[place]


def write_bag(path: Path, kinds: Sequence[str], places: Sequence[int], messages: Sequence[Sent]) -> None:
    """Write a recording of messages."""
    kind_of = dict(zip(places, kinds, strict=True))
    with BagWriter(path) as bag:
        for place, kind in kind_of.items():
            bag.add_topic(f'/{INPUTS[place]}', kind)
        for sent in messages:
            data = b'\0\1\0\0' + struct.pack('<d', sent.value)
            if kind_of[sent.place] == _FORCE:
                head = struct.pack('<iIIxxxx', *divmod(sent.stamp_ns, 10**9), 1)
                data = b'\0\1\0\0' + head + struct.pack('<6d', 0, 0, sent.value, 0, 0, 0)
            bag.write(f'/{INPUTS[sent.place]}', sent.log_ns, data)


def session_events(config: MonitorConfig, messages: Sequence[Sent]) -> Events:
    """Return what a session finds that takes messages one by one, and looks ten times a second."""
    sink = Events()
    session = Session(config, sink, NoLog(), lambda: 0)
    session.begin()
    tick_ns = messages[0].log_ns
    session.advance('aft', tick_ns, Moment(tick_ns, tick_ns))
    for sent in messages:
        while tick_ns + TICK_NS <= sent.log_ns:
            tick_ns += TICK_NS
            session.advance('aft', tick_ns - BEHIND_NS, Moment(tick_ns, tick_ns))
        now = Moment(sent.log_ns, sent.log_ns)
        session.take('aft', sent.place, sent.stamp_ns, sent.value, now)
    end_ns = messages[-1].log_ns
    session.advance('aft', end_ns, Moment(end_ns, end_ns))
    return sink


def random_difference(folder: Path, seed: int) -> str:
    """Return how the events of a random recording differ between session and check; empty if they do not."""
    rng = random.Random(seed)
    config, kinds = random_config(rng)
    places = [INPUTS.index(name) for name in config.bearings[0].inputs]
    messages = random_messages(rng, kinds, places)
    path = folder / f'{seed}.mcap'
    write_bag(path, kinds, places, messages)
    try:
        (bearing,) = check_recording(path, config).bearings.values()
    except BagError as error:
        return str(error)
    pairs = list(itertools.zip_longest(bearing.events, session_events(config, messages).found))
    if all(a and b and a.after is b.after and abs(a.time_ns - b.time_ns) <= LATE_NS for a, b in pairs):
        return ''
    event_texts = [
        ', '.join(event_text(event, START_NS) for event in side if event) for side in zip(*pairs, strict=True)
    ]
    return f'check {event_texts[0]}; session {event_texts[1]}'
