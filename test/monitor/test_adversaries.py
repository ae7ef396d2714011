# SPDX-License-Identifier: Apache-2.0
"""Attacks on the decision, each a row: what comes of a bearing, and what is to be told of it.

Each is a way in which an earlier rule failed, with other bearings and rates than those it was
found with. Fold and Hopf speeds are those of the averaged model's closed forms, to 0.1 rpm; speeds
are shares of the fold speed, and loads of the nominal load. A share of 0.3 to 0.5 is below the
Hopf speed of every bearing here, one of 0.9 in the bistable range.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from sending import SECOND, Message, Number, brief, configured, every, feed, number_at, ramps
from sequences import BEARINGS, NAME

from stickslip_monitor import Monitor, MonitorConfig
from stickslip_monitor.monitor.rule_state import State
from stickslip_monitor.monitor.signals import INPUTS, Input
from stickslip_monitor.monitor.verdict import Event

STICKING = ('stick_slip', 'amplitude_limit')
MILLIMETRES = {'level__topic': '/v', 'level__unit': 'mm/s'}
DECIBELS = {'level__topic': '/v', 'level__unit': 'dB', 'level__threshold': 34.0}
Messages = list[Message]
Spoil = Callable[[Messages], Messages]
Span = tuple[float, float]


@dataclass(frozen=True)
class Sent:
    """What comes: a bearing, for how long [s], its speed; times are those of arrival [s]."""

    bearing: str = 'ship'
    end: float = 120.0
    share: Number = 2.0  # speed in shares of the fold speed
    load: Number = 1.0  # in shares of the nominal load
    level: Number | None = None
    period: float = 0.5  # of the speed
    load_period: float | None = None  # that of the speed
    level_period: float = 0.5
    spoilt: Spoil = list  # what becomes of the messages on their way
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def config(self) -> MonitorConfig:
        return configured(NAME, BEARINGS[self.bearing][0], **self.settings)

    def messages(self) -> Messages:
        """What comes, in the order of its arrival."""
        _, fold, nominal = BEARINGS[self.bearing]
        sent = every(Input.SPEED, self.period, self.end, scaled(self.share, fold))
        sent += every(Input.LOAD, self.load_period or self.period, self.end, scaled(self.load, nominal))
        if self.level is not None:
            sent += every(Input.LEVEL, self.level_period, self.end, self.level)
        kept = [message for message in sent if not math.isnan(message.value)]
        return sorted(self.spoilt(kept), key=lambda message: message.arrival)


@dataclass(frozen=True, kw_only=True)
class Told:
    """What is to be told of it."""

    first: Span | None = None  # when stick-slip, first
    onsets: tuple[Span, ...] | None = None  # when each onset
    seconds: Mapping[str, Span] = field(default_factory=dict)  # for how long which condition,
    since: float = 0.0  # counted from here on
    ends: str = ''
    events: int | None = None  # how many at most
    used: float = 0.0  # share of the samples that is used, at least
    says: str = ''  # in the last text


class Case(NamedTuple):
    """A row: what it is, what comes, and what is to be told."""

    what: str
    sent: Sent
    told: Told


def scaled(number: Number, by: float) -> Number:
    return lambda t: by * number_at(number, t)


class Heard:
    """What a monitor says of messages."""

    def __init__(self, config: MonitorConfig, messages: Iterable[Message]) -> None:
        self.monitor = Monitor(config)
        self.events: list[Event] = []
        self.used: list[bool] = []
        self._conditions: list[tuple[float, str]] = []
        self.take(messages)

    def take(self, messages: Iterable[Message]) -> None:
        """Take more messages, in their order."""
        for arrival, place, stamp, value in messages:
            update = feed(self.monitor, stamp, INPUTS[place], value, NAME, arrival)
            self.events += update.events
            self.used.append(update.status.valid)
            self._conditions.append((arrival, str(self.monitor.condition(NAME))))

    def seconds(self, conditions: Iterable[str], begin: float = 0.0) -> float:
        """For how long one of some conditions stood [s]."""
        own = set(conditions)
        times = [*self._conditions, (self._conditions[-1][0], '')]
        return sum(
            after - max(at, begin)
            for (at, condition), (after, _) in pairwise(times)
            if condition in own and after > begin
        )

    def first(self) -> float:
        """When stick-slip was first told [s]; ``inf`` for never."""
        return next((at for at, told in self._conditions if told in STICKING), math.inf)

    @property
    def onsets(self) -> list[float]:
        """When stick-slip was announced [s]."""
        return [e.time_ns / SECOND for e in self.events if e.onset]

    @property
    def condition(self) -> str:
        return str(self.monitor.condition(NAME))


# --- What becomes of messages on their way -------------------------------------------------------


def of(place: Input, spoilt: Callable[[int, Message], Message | None]) -> Spoil:
    """Something becomes of the messages of one input, by their number; ``None``: it is lost."""

    def spoil(sent: Messages) -> Messages:
        own = [m for m in sent if m.place is place]
        kept = (spoilt(k, m) for k, m in enumerate(own))
        return [m for m in sent if m.place is not place] + [m for m in kept if m is not None]

    return spoil


def stamped(off: float, every_nth: int, first: int = 0, last: int = 10**9) -> Spoil:
    """Stamps of the speed are off [s]."""
    return of(
        Input.SPEED,
        lambda k, m: m._replace(stamp=m.stamp + off) if first <= k < last and k % every_nth == 0 else m,
    )


def valued(place: Input, value: float, rows: Callable[[int, float], bool]) -> Spoil:
    """Some have another value, by number and time."""
    return of(place, lambda k, m: m._replace(value=value) if rows(k, m.stamp) else m)


def in_bursts(period: float, copies: int, stamped_at: str) -> Spoil:
    """A stalled executor or a gateway hands several speeds over within milliseconds."""

    def spoil(sent: Messages) -> Messages:
        own = [m for m in sent if m.place is Input.SPEED]
        found = [m for m in sent if m.place is not Input.SPEED]
        for m in own:
            for copy in range(copies):
                at = m.stamp + copy * 0.001
                stamp = {
                    'on arrival': at,
                    'at the source': m.stamp + ((copy + 1) / copies - 1) * period,
                    'alike': m.stamp,
                }[stamped_at]
                found.append(m._replace(arrival=at, stamp=stamp))
        return found

    return spoil


def set_by(step: float, at: float) -> Spoil:
    """All stamps are of clocks that are set at a time."""
    return lambda sent: [m._replace(stamp=m.stamp + (step if m.arrival > at else 0.0)) for m in sent]


def twice(sent: Messages) -> Messages:
    return [m for m in sent for _ in range(2)]


def swapped(sent: Messages) -> Messages:
    """Of each input the second of each two comes before the first, when that one should."""
    found = []
    for place in Input:
        own = [m for m in sent if m.place is place]
        for a, b in zip(own[::2], own[1::2], strict=False):
            found += [b._replace(arrival=a.arrival), a._replace(arrival=b.arrival)]
    return found


def together(*spoils: Spoil) -> Spoil:
    """One after the other."""

    def spoil(sent: Messages) -> Messages:
        for each in spoils:
            sent = each(sent)
        return sent

    return spoil


def besides(period: float, ahead: float, value: float, begin: float = 0.0) -> Spoil:
    """A second publisher of the speed, by a clock of its own."""

    def spoil(sent: Messages) -> Messages:
        other = every(Input.SPEED, period, sent[-1].arrival, value, begin)
        return sent + [m._replace(stamp=m.stamp + ahead) for m in other]

    return spoil


def rpm(bearing: str, share: float) -> float:
    return share * BEARINGS[bearing][1]


# --- Levels --------------------------------------------------------------------------------------


def loud(begin: float, end: float = math.inf, high: float = 44.0, low: float = 22.0) -> Number:
    """Loud between two times [s]."""
    return lambda t: (high if begin <= t < end else low) + 0.1 * math.sin(3.0 * t)


def bursts(lasting: float, each: float = 60.0, from_then_on: float = math.inf) -> Number:
    """Something else is loud for seconds each so often; from some time on it goes on."""

    def level(t: float) -> float:
        high = t % each < lasting or t > from_then_on
        return (60.0 if high else 3.0) * (1.0 + 0.02 * math.sin(9.0 * t))

    return level


def _ringing(t: float) -> float:
    """A blow rings down; another goes on."""
    ringing = 20.0 * math.exp(-(t - 200.0) / 5.0) if 200.0 <= t < 260.0 else 0.0
    return 44.0 if t >= 260.0 else 22.0 + ringing


def _dies(t: float) -> float:
    """Risen in the first episode, one bit of dither in the second."""
    return 50.0 + math.sin(t) if 82.0 < t < 205.0 else 1.0 + 0.01 * (round(2 * t) % 2)


def _dies_with_pauses(t: float) -> float:
    """The same, and the cable breaks for 6 s in 30."""
    if t > 210.0:
        return math.nan if t % 30.0 < 6.0 else 21.0 + 0.1 * (round(4.0 * t) % 2)
    return 50.0 + math.sin(t) if 82.0 < t < 205.0 else 22.0 + 0.1 * math.sin(t)


def _again(later: Callable[[float], float], t: float) -> float:
    """Risen in both episodes, in the second as given."""
    if not (82.0 < t < 205.0 or t > 412.0):
        return 22.0 + 0.1 * math.sin(t)
    return 50.0 + math.sin(t) if t < 300.0 else later(t)


_SECOND = {
    'dies': (_dies, 20.0, 520.0, 900.0),
    'dies, with pauses': (_dies_with_pauses, 20.0, 620.0, 900.0),
    'beats with the shaft': (
        partial(_again, lambda t: 40.0 + 5.0 * math.sin(2.0 * math.pi * t / 3.5)),
        10.0,
        430.0,
        700.0,
    ),
    'has a loose contact': (
        partial(_again, lambda t: 10.0 if round(4.0 * t) % 4 == 0 else 50.0),
        10.0,
        430.0,
        700.0,
    ),
}
# --- The rows ------------------------------------------------------------------------------------

NEVER, ALWAYS = (0.0, 0.0), (0.0, math.inf)
AGAIN = ramps([0, 300, 320, 900, 930], [1.6, 1.6, 0.4, 0.4, 0.9])
"""Cruise, ten minutes of stick-slip, then the bistable range."""
_BEGINS = (60.0, 360.0, 660.0, 960.0)


def _stamps() -> Iterable[Case]:
    for bearing, period in (('viscous', 1.0), ('ship', 2.0)):
        for copies in (2, 5, 20):
            for at in ('at the source', 'on arrival', 'alike'):
                yield Case(
                    f'bursts of {copies}, stamped {at}, {bearing}',
                    Sent(bearing, 60.0, 0.4, period=period, spoilt=in_bursts(period, copies, at)),
                    Told(first=(0.0, 10.0), seconds={'stick_slip': (48.0, 60.0), 'input_stale': NEVER}),
                )
    for off in (-3600.0, -7.0, 4.8, 6.0, 3600.0):
        for nth in (7, 20):
            yield Case(
                f'one stamp in {nth} off by {off} s',
                Sent('ship', 300.0, 0.5, period=0.2, spoilt=stamped(off, nth)),
                Told(
                    first=(0.0, 10.0),
                    events=9,
                    used=0.999 if off > 0.0 else 0.9,
                    seconds={'stick_slip': (285.0, 300.0)},
                ),
            )
        yield Case(
            f'two stamps off by {off} s',
            Sent('steep', spoilt=stamped(off, 1, 100, 102)),
            Told(events=0, used=1.0 if off > 0.0 else 0.99),
        )


def _clocks() -> Iterable[Case]:
    for period in (2.0, 3.0, 4.8):
        yield Case(
            f'values in pairs, {period} s apart',
            Sent(
                'ship',
                200.0,
                ramps([0, 100, 101], [2.0, 2.0, 0.4]),
                period=period,
                spoilt=lambda sent: (
                    sent + [m._replace(arrival=m.arrival + 0.1, stamp=m.stamp + 0.1) for m in sent]
                ),
            ),
            Told(used=0.95, first=(100.0, 112.0), seconds={'input_stale': NEVER}),
        )
    for bearing, period in (('ship', 0.1), ('steep', 1.0)):
        for step in (-3600.0, -3.0, 0.0, 3.0, 600.0):
            for spoil in (twice, swapped):
                yield Case(
                    f'clock set by {step} s in a gap, {spoil.__name__}, {bearing}',
                    Sent(
                        bearing,
                        160.0,
                        lambda t: 2.0 if t < 100.0 else 0.4,
                        period=period,
                        spoilt=together(
                            lambda sent: [m for m in sent if not 40.0 <= m.arrival < 50.0],
                            spoil,
                            set_by(step, 50.0),
                        ),
                    ),
                    Told(onsets=((100.0, 115.0 + 8.0 * period),), first=(100.0, 115.0 + 8.0 * period)),
                )
    for period in (10.0, 20.0):
        for step in (-3600.0, -120.0):
            yield Case(
                f'values each {period} s, the clock set by {step} s at once',
                Sent('table', 900.0, 0.4, period=period, spoilt=set_by(step, 25.0)),
                Told(used=0.95, ends='stick_slip'),
            )
    for step in (-50.0, 0.0):
        yield Case(
            f'clock set by {step} s within a long time-out',
            Sent(
                'ship',
                200.0,
                lambda t: 2.0 if t < 105.0 else 0.4,
                period=0.2,
                spoilt=set_by(step, 100.0),
                settings={'speed__timeout': 60.0, 'load__timeout': 60.0},
            ),
            Told(first=(105.0, 109.0)),
        )
    for ahead in (-7.0, 0.4, 7.0):
        yield Case(
            f'a second publisher far outside, its clock {ahead} s off',
            Sent('ship', 120.0, 0.4, spoilt=besides(0.5, ahead, rpm('ship', 0.6), 0.23)),
            Told(seconds={'stick_slip': (100.0, 120.0)}),
        )


def _values() -> Iterable[Case]:
    for bearing, period, nth in (('steep', 0.05, 7), ('ship', 0.1, 4)):
        for place, share in ((Input.SPEED, 0.05), (Input.LOAD, 20.0)):
            value = share * BEARINGS[bearing][1 + place]
            yield Case(
                f'one odd {INPUTS[place]} in {nth} far outside',
                Sent(
                    bearing,
                    period=period,
                    spoilt=valued(place, value, lambda k, _, n=nth: k >= 9 and (k - 9) % n == 0),
                ),
                Told(onsets=(), seconds={'bistable': NEVER}),
            )
    for place, share in ((Input.SPEED, 0.9), (Input.LOAD, 30.0)):
        value = share * BEARINGS['ship'][1 + place]
        yield Case(
            f'one odd {INPUTS[place]} and a vibration',
            Sent(
                'ship',
                600.0,
                1.75,
                period=0.2,
                level=lambda t: 90.0 + math.sin(t),
                spoilt=valued(place, value, lambda k, _: 500 <= k < 3000 and k % 500 == 0),
                settings=MILLIMETRES | {'level__threshold': 40.0},
            ),
            Told(seconds={'stick_slip': NEVER}),
        )
    for bearing in ('reference', 'ship', 'viscous'):
        for place in (Input.SPEED, Input.LOAD):
            yield Case(
                f'{INPUTS[place]} drops out half of the time, {bearing}',
                Sent(
                    bearing,
                    200.0,
                    lambda t: 2.0 if t > 40.0 else 0.4,
                    period=0.1,
                    spoilt=valued(place, 0.0, lambda _, t: t > 40.0 and t % 1.0 < 0.5),
                ),
                Told(onsets=(ALWAYS,), seconds={'stick_slip': NEVER}, since=70.0),
            )
    for place in (Input.SPEED, Input.LOAD):
        yield Case(
            f'{INPUTS[place]} drops to zero for 1.4 s in an episode',
            Sent(
                'steep',
                180.0,
                ramps([0, 20, 40, 60], [1.5, 0.4, 0.4, 0.9]),
                period=0.2,
                spoilt=valued(place, 0.0, lambda _, t: 130.0 < t < 131.4),
            ),
            Told(onsets=(ALWAYS,), ends='stick_slip'),
        )
    for period in (0.1, 1.0):
        yield Case(
            f'the filter of a tachometer starts at zero, each {period} s',
            Sent('reference', 60.0, lambda t: 2.0 if t else 0.05, period=period, load_period=0.1),
            Told(onsets=()),
        )
    for bearing, (_, fold, _) in BEARINGS.items():
        yield Case(
            f'a stopped shaft whose tachometer shows 0.04 rpm, {bearing}',
            Sent(bearing, 120.0, 0.04 / fold, period=1.0),
            Told(events=0),
        )
    for step in (1.0, 4.0):
        of_rpm, fine = step / BEARINGS['steep'][1], ramps([0, 120], [2.0, 0.3])
        yield Case(
            f'speeds in steps of {step} rpm',
            Sent('steep', 150.0, lambda t, s=of_rpm, f=fine: s * round(f(t) / s), load_period=0.2),
            Told(onsets=(ALWAYS,), ends='stick_slip'),
        )


def _paces() -> Iterable[Case]:
    yield Case(
        'values as slow as the time-out, every second 20 ms late',
        Sent(
            'viscous',
            600.0,
            period=4.0,
            load_period=0.5,
            spoilt=of(
                Input.SPEED, lambda k, m: Message(*(m[0] + k % 2 * 0.02, m[1]), m[2] + k % 2 * 0.02, m[3])
            ),
            settings={'speed__timeout': 4.0, 'load__timeout': 4.0},
        ),
        Told(since=10.0, seconds={'input_stale': NEVER}),
    )
    for period in (6.0, 30.0):
        yield Case(
            f'values slower than the time-out, each {period} s',
            Sent('ship', 1800.0, 0.4, period=period),
            Told(used=0.9, ends='stick_slip'),
        )
    for period in (1.0, 4.0):
        yield Case(
            f'a load each {period} s delays no onset',
            Sent('steep', 60.0, lambda t: 2.0 if t < 21.0 else 0.3, period=0.1, load_period=period),
            Told(first=(21.0, 23.0)),
        )
    for period in (2.0, 60.0):
        yield Case(
            f'two episodes, then an hour outside, a speed each {period} s',
            Sent(
                'ship',
                4500.0,
                lambda t: 0.4 if t % 600.0 < 300.0 and t < 1200.0 else 2.0,
                period=period,
                load_period=1.0,
                settings={'speed__timeout': 30.0},
            ),
            Told(
                onsets=(ALWAYS, ALWAYS),
                since=1200.0 + 4 * period,
                ends='normal',
                seconds=dict.fromkeys(('stick_slip', 'bistable', 'caution'), NEVER),
            ),
        )
    for apart in (50.0, 110.0, 250.0):
        last = 100.0 + 2.0 * apart
        yield Case(
            f'two single speeds {apart} s apart are no slow sensor',
            Sent(
                'ship',
                last + 60.0,
                period=0.1,
                spoilt=of(
                    Input.SPEED,
                    lambda _, m, a=apart, b=last: (
                        m
                        if (m.stamp < 100.0 or min(abs(m.stamp - 100.0 - a), abs(m.stamp - b)) < 0.04)
                        else None
                    ),
                ),
            ),
            Told(since=last, seconds={'normal': (0.0, 15.0)}, ends='input_stale'),
        )
    yield Case(
        'a load that comes once an hour is lost in between',
        Sent('ship', 5 * 3600.0, 1.6, period=5.0, load_period=3600.0),
        Told(seconds={'input_stale': (0.85 * 5 * 3600.0, math.inf)}),
    )


def _courses() -> Iterable[Case]:
    for bearing, high, low in (('steep', 2.0, 0.4), ('viscous', 1.8, 0.5)):
        times = [begin + after for begin in _BEGINS for after in (0.0, 20.0, 50.0, 70.0)]
        yield Case(
            f'each of four episodes ends and is announced, {bearing}',
            Sent(bearing, 1260.0, ramps(times, [high, low, low, high] * 4), period=0.2),
            Told(
                onsets=tuple((begin, begin + 30.0) for begin in _BEGINS),
                seconds={'stick_slip': (0.0, 4 * 70.0)},
                ends='normal',
            ),
        )
    yield Case(
        'nothing is known of a bearing that starts in the bistable range',
        Sent('steep', 60.0, 0.9, period=0.25),
        Told(ends='bistable', says='Vibration state unknown.'),
    )
    yield Case(
        'the amplitude limit is that of the exact cycle: 0.94 mm, averaged 0.55',
        Sent('reference', 60.0, 0.5, period=0.2, load=6.0, settings={'alarm__amplitude_limit': 0.8e-3}),
        Told(ends='amplitude_limit'),
    )


def _levels() -> Iterable[Case]:
    for high in (8.0, 25.0):
        yield Case(
            f'a genset outside the fold, {high} mm/s',
            Sent(
                'ship',
                900.0,
                1.13,
                level=lambda t, h=high: (h if t > 400.0 else 2.0) * (1.0 + 0.02 * math.sin(7.0 * t)),
                settings=MILLIMETRES,
            ),
            Told(seconds={'stick_slip': NEVER}),
        )
    for dither in (0.0, 0.04):
        yield Case(
            f'a limit cycle is constant to {dither} dB, and no stuck level',
            Sent(
                'viscous',
                600.0,
                0.9,
                settings=DECIBELS,
                level=lambda t, d=dither: (
                    44.0 + d * math.copysign(1.0, math.sin(5.0 * t))
                    if t >= 400.0
                    else 21.0 + 0.7 * math.sin(3.0 * t)
                ),
            ),
            Told(first=(400.0, 406.0), ends='stick_slip'),
        )
    for lasting in (2.0, 3.5, 8.0):
        # Beyond the fold a vibration is never taken for stick-slip; caution stands there anyway.
        for bearing, share, ends in (('viscous', 0.9, 'stick_slip'), ('ship', 1.1, 'caution')):
            yield Case(
                f'bursts of {lasting} s, then one that goes on, at {share}',
                Sent(
                    bearing,
                    1100.0,
                    share,
                    level=bursts(lasting, from_then_on=1000.0),
                    settings=MILLIMETRES | {'level__threshold': 20.0},
                ),
                Told(ends=ends, onsets=((1000.0, 1020.0),) if ends == 'stick_slip' else ()),
            )
    for bearing in ('viscous', 'ship'):
        for period in (0.1, 2.0):
            yield Case(
                f'the knock of a crash manoeuvre, {bearing}, a speed each {period} s',
                Sent(
                    bearing,
                    160.0,
                    ramps([0, 100, 102], [1.6, 1.6, 0.93]),
                    level=loud(101.8),
                    period=period,
                    settings=DECIBELS,
                ),
                Told(first=(101.8, 130.0)),
            )
    for begin in (0.9, 1.6):
        yield Case(
            f'an engine order that is loud from the start, at {begin}',
            Sent(
                'ship',
                900.0,
                ramps([0, 60, 80], [begin, begin, 0.9]),
                level=loud(0.0, high=46.0),
                settings=DECIBELS,
            ),
            Told(seconds={'stick_slip': NEVER}),
        )


def _level_knocks() -> Iterable[Case]:
    for beat, low in ((6.0, 29.0), (8.0, 33.0), (12.0, 32.0)):
        yield Case(
            f'a knock that beats each {beat} s, after one loud sample elsewhere',
            Sent(
                'viscous',
                300.0,
                ramps([0, 100, 120], [1.6, 1.6, 0.92]),
                level=lambda t, b=beat, w=low: (
                    (46.0 if t % b < 0.7 * b else w) if t >= 200.0 else 36.0 if 50.0 <= t < 50.5 else 22.0
                ),
                load_period=0.2,
                settings=DECIBELS,
            ),
            Told(first=(200.0, 232.0)),
        )
    for bearing in ('viscous', 'ship'):
        for after in (0.5, 3.0):
            yield Case(
                f'the lining rings {after} s after an episode, {bearing}',
                Sent(
                    bearing,
                    300.0,
                    ramps([0, 100, 105, 200, 206], [1.8, 1.8, 0.4, 0.4, 1.8]),
                    level=loud(103.0, 202.6 + after, 46.0),
                    period=0.2,
                    settings=DECIBELS,
                ),
                Told(onsets=(ALWAYS,), seconds={'vibration': NEVER}, ends='normal'),
            )
        for lasting in (3.5, 5.5):
            for rises in (True, False):
                yield Case(
                    f'bursts of {lasting} s, then an episode with{"" if rises else "out"} a rise, {bearing}',
                    Sent(
                        bearing,
                        1500.0,
                        AGAIN,
                        level=lambda t, n=lasting, r=rises: (
                            (60.0 if 100.0 <= t % 300.0 < 100.0 + n or (r and 320.0 < t < 920.0) else 3.0)
                            * (1.0 + 0.02 * math.sin(9.0 * t))
                        ),
                        settings=MILLIMETRES | {'level__threshold': 20.0},
                    ),
                    Told(onsets=((300.0, 400.0),), ends='bistable' if rises else 'stick_slip'),
                )


def _level_episodes() -> Iterable[Case]:
    for period in (3.0, 10.0):
        yield Case(
            f'a level each {period} s is slower than its time-out',
            Sent(
                'viscous',
                600.0,
                0.9,
                level=lambda t: (44.0 if t > 400.0 else 22.0) + math.sin(t),
                level_period=period,
                settings=DECIBELS | {'level__timeout': 2.0},
            ),
            Told(first=(400.0, 401.0 + 3.0 * period), ends='stick_slip'),
        )
    yield Case(
        'a worn bearing sticks where its parameters say caution',
        Sent(
            'ship',
            600.0,
            1.1,
            level=loud(400.0, high=60.0, low=3.0),
            settings=MILLIMETRES | {'level__threshold': 20.0},
        ),
        Told(onsets=(), ends='caution', says='Vibration is measured where none is predicted'),
    )
    yield Case(
        'a blow that goes on, after one that rang down',
        Sent('viscous', 300.0, 0.9, level=_ringing, settings=DECIBELS),
        Told(onsets=((260.0, 277.0),)),
    )
    for what, (level, ramp, left, end) in _SECOND.items():
        times = [60, 80, 200, 220, 400, 400 + ramp, left, left + ramp]
        yield Case(
            f'a level that {what} ends no second episode',
            Sent(
                'ship',
                end,
                ramps(times, [1.5, 0.4, 0.4, 1.5, 1.5, 0.4, 0.4, 0.9]),
                period=0.2,
                level=level,
                level_period=0.25,
                settings=DECIBELS,
            ),
            Told(onsets=(ALWAYS, ALWAYS), ends='stick_slip'),
        )
    yield Case(
        'a dead level ends no running alarm',
        Sent(
            'ship',
            600.0,
            ramps([0, 60, 80, 120, 140], [1.5, 1.5, 0.4, 0.4, 0.9]),
            period=0.2,
            level=lambda t: 1.0 + 0.01 * (round(2 * t) % 2),
            settings=MILLIMETRES | {'level__threshold': 40.0},
        ),
        Told(onsets=(ALWAYS,), ends='stick_slip'),
    )
    yield Case(
        'a burst outside, the clocks set back, and the same inside',
        Sent(
            'viscous',
            300.0,
            ramps([150.0, 180.0], [1.6, 0.9]),
            spoilt=set_by(-3600.0, 200.0),
            level=lambda t: (44.0 if 100.0 <= t < 104.0 or 240.0 <= t < 244.5 else 22.0) + 0.1 * math.sin(t),
            settings=DECIBELS,
        ),
        Told(onsets=(), used=0.99),
    )
    yield Case(
        'a level that shows an episode from the start, without a threshold',
        Sent('ship', 200.0, 0.4, level=lambda t: 90.0 + math.sin(t), settings=MILLIMETRES),
        Told(ends='stick_slip', says='does its sensor reach the bearing?'),
    )


ROWS = (_stamps, _clocks, _values, _paces, _courses, _levels, _level_knocks, _level_episodes)
CASES = [case for rows in ROWS for case in rows()]


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.what)
def test_what_is_told(case: Case) -> None:
    what, sent, told = case
    heard = Heard(sent.config, sent.messages())
    if told.first is not None:
        assert told.first[0] <= heard.first() <= told.first[1]
    if told.onsets is not None:
        assert len(heard.onsets) == len(told.onsets), heard.onsets
        for onset, (begin, end) in zip(heard.onsets, told.onsets, strict=True):
            assert begin <= onset <= end
    for condition, (least, most) in told.seconds.items():
        conditions = STICKING if condition == 'stick_slip' else (condition,)
        assert least <= heard.seconds(conditions, told.since) <= most, condition
    assert told.ends in ('', heard.condition)
    assert told.events is None or len(heard.events) <= told.events
    assert sum(heard.used) >= told.used * len(heard.used)
    times = [event.time_ns for event in heard.events]
    assert times == sorted(times) or 'set by' in what or 'set back' in what
    assert told.says in heard.monitor.bearings[NAME].text()


@pytest.mark.parametrize('times', [2, 6])
def test_copies_change_nothing(times: int) -> None:
    share = ramps([0, 60, 90, 150], [1.6, 0.5, 0.5, 1.6])
    case = Sent('table', 180.0, share, period=0.25)
    # A stamp is the sender's own if the message comes later.
    sent = [m._replace(arrival=m.arrival + 0.01) for m in case.messages()]
    copied = [m for m in sent for _ in range(times)]
    once, often = (Heard(case.config, given) for given in (sent, copied))
    assert len(once.onsets) == 1
    told = [[(brief(e), e.text) for e in heard.events] for heard in (once, often)]
    assert told[0] == told[1]


def test_a_speed_that_is_steady_again_falls_no_more() -> None:
    share, settings = ramps([30, 50, 70], [1.5, 1.08, 1.12]), {'alarm__caution_margin': 0.1}
    case = Sent('viscous', 300.0, share, settings=settings)
    heard = Heard(case.config, case.messages())
    assert 'Slowing' in ' '.join(e.text for e in heard.events)
    assert 'Slowing' not in heard.monitor.bearings[NAME].text()


def test_a_steady_speed_near_a_doubtful_fold_does_not_fall() -> None:
    """Half above the fold, a tolerance of a half asks for caution, and no trend does."""
    share, settings = ramps([0], [1.5]), {'tolerance__damping': 0.5}
    case = Sent('viscous', 60.0, share, settings=settings)
    heard = Heard(case.config, case.messages())
    assert [str(e.after) for e in heard.events] == ['caution']
    assert 'Slowing' not in ' '.join(e.text for e in heard.events)


@pytest.mark.parametrize('pause', [-3600.0, 5.0, 60.0, 200.0])
def test_a_restart_in_an_episode_goes_on_and_blames_no_input(pause: float) -> None:
    share = ramps([0, 20, 40, 60], [1.5, 0.4, 0.4, 0.9])
    case = Sent('steep', 120.0, share, period=0.25)
    heard = Heard(case.config, case.messages())
    kept = json.loads(json.dumps(heard.monitor.bearings[NAME].state.record()))
    heard.monitor, before = Monitor(case.config, {NAME: State.of_record(kept)}), heard.events
    heard.events, begin = [], 120.0 + pause
    after = replace(case, share=0.9, end=60.0).messages()
    heard.take(m._replace(arrival=m.arrival + begin, stamp=m.stamp + begin) for m in after)
    assert before
    assert heard.events == []
    assert heard.condition == 'stick_slip'
    # Of inputs that stay away the time-out counts from the restart.
    dead = Monitor(case.config, {NAME: State.of_record(kept)})
    assert dead.advance(round((begin + 4.0) * SECOND)) == []
    assert dead.advance(round((begin + 8.0) * SECOND)) == []
    assert [str(e.after) for e in dead.advance(round((begin + 10.0) * SECOND))] == ['input_stale']


def test_a_hold_up_before_the_first_message_is_no_time() -> None:
    monitor = Monitor(Sent().config)
    monitor.bearings[NAME].excuse(5 * SECOND)
    assert monitor.advance(10**18) == []


def test_a_numpy_number_is_a_number() -> None:
    settings = MILLIMETRES | {'level__threshold': 40.0}
    monitor = Monitor(Sent(settings=settings).config)
    for time, kind in enumerate((np.float32, np.float64, np.int32, int)):
        assert feed(monitor, time, 'level', kind(3), NAME).status.valid


@pytest.mark.parametrize(
    ('before', 'back', 'expected'),
    [
        (1.2, 1.75, 'normal'),
        (1.2, 0.9, 'bistable'),
        (40.0, 1.75, 'normal'),
        # What ran goes on in the bistable range until the fold has been passed.
        (40.0, 0.9, 'stick_slip'),
    ],
)
def test_what_was_before_a_gap_of_a_quarter_of_an_hour_begins_nothing_after_it(
    before: float, back: float, expected: str
) -> None:
    """In the middle of a growth, or of stick-slip, both inputs go, and come back elsewhere."""
    left = 60.0 + before
    case = Sent(
        'ship',
        1000.0,
        lambda t: 1.5 if t < 60.0 else 0.5 if t < 900.0 else back,
        period=0.1,
        spoilt=lambda sent: [m for m in sent if not left <= m.arrival < 960.0],
    )
    heard = Heard(case.config, case.messages())
    assert len(heard.onsets) == (before > 2.0)
    assert heard.condition == expected


def test_a_load_that_steps_is_one_onset_with_a_tolerance_too() -> None:
    """The probability follows the load by a lag of 4 s; growth does not."""
    case = Sent('ship', 60.0, 0.5, period=0.1, load=lambda t: 0.0 if t < 12.0 else 1.0)
    believing = replace(case, settings={'tolerance__load': 0.02})
    found = [Heard(each.config, each.messages()) for each in (case, believing)]
    assert found[0].onsets == found[1].onsets
    (onset,) = (event for event in found[1].events if event.onset)
    assert 'possible with' not in onset.text
