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
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
import pytest
from sending import SECOND, Message, Number, brief, configured, every, feed, number_at, ramps
from sequences import BEARINGS, NAME

from stickslip_monitor import Monitor, MonitorConfig
from stickslip_monitor.monitor.rule_state import State
from stickslip_monitor.monitor.sample_types import INPUTS, Input
from stickslip_monitor.monitor.statements import Event

STICKING = ('stick_slip', 'amplitude_limit')
Messages = list[Message]
Spoil = Callable[[Messages], Messages]
Span = tuple[float, float]


@dataclass(frozen=True)
class Scenario:
    """Messages to one bearing, with the faults on their way; times are those of arrival [s]."""

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
    unit: str = 'dB'  # of the level
    threshold: float = 34.0  # of the level; nan for none

    @property
    def config(self) -> MonitorConfig:
        level_parameters = {'level__topic': '/v', 'level__unit': self.unit}
        level_parameters |= {} if math.isnan(self.threshold) else {'level__threshold': self.threshold}
        return configured(
            NAME, BEARINGS[self.bearing][0], **(level_parameters if self.level else {}), **self.settings
        )

    def messages(self) -> Messages:
        """Return the messages as they arrive, in that order."""
        _, fold, nominal = BEARINGS[self.bearing]
        messages = every(Input.SPEED, self.period, self.end, scale_number(self.share, fold))
        messages += every(
            Input.LOAD, self.load_period or self.period, self.end, scale_number(self.load, nominal)
        )
        if self.level is not None:
            messages += every(Input.LEVEL, self.level_period, self.end, self.level)
        finite = [message for message in messages if not math.isnan(message.value)]
        return sorted(self.spoilt(finite), key=lambda message: message.arrival)


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Report that a monitor must give of a scenario."""

    first: Span | None = None  # when stick-slip, first
    onsets: tuple[Span, ...] | None = None  # when each onset
    seconds: Mapping[str, Span] = field(default_factory=dict)  # for how long which condition,
    since: float = 0.0  # counted from here on
    ends: str = ''
    events: int | None = None  # how many at most
    used: float = 0.0  # share of the samples that is used, at least
    says: str = ''  # in the last text


class Case(NamedTuple):
    """A scenario with its title and what must be reported."""

    title: str
    scenario: Scenario
    expected: Expectation


def make_case(title: str, scenario: Scenario, **expected: Any) -> Case:
    return Case(title, scenario, Expectation(**expected))


def step_number(at: float, before: float, after: float) -> Number:
    """Return a number that steps from one value to another at a time [s]."""
    return lambda t: before if t < at else after


def scale_number(number: Number, factor: float) -> Number:
    return lambda t: factor * number_at(number, t)


class MonitorRun:
    """A monitor that takes messages, and what it reports of them."""

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

    def seconds_in(self, conditions: Iterable[str], begin: float = 0.0) -> float:
        """Return for how long one of some conditions stood [s]."""
        wanted = set(conditions)
        times = [*self._conditions, (self._conditions[-1][0], '')]
        return sum(
            after - max(at, begin)
            for (at, condition), (after, _) in pairwise(times)
            if condition in wanted and after > begin
        )

    def first_sticking(self) -> float:
        """Return when stick-slip was first reported [s]; ``inf`` for never."""
        return next((at for at, condition in self._conditions if condition in STICKING), math.inf)

    @property
    def onsets(self) -> list[float]:
        """Times at which stick-slip was announced [s]."""
        return [e.time_ns / SECOND for e in self.events if e.onset]

    @property
    def condition(self) -> str:
        return str(self.monitor.condition(NAME))


# --- What becomes of messages on their way -------------------------------------------------------


def spoil_input(place: Input, spoilt: Callable[[int, Message], Message | None]) -> Spoil:
    """Return a fault that replaces the messages of one input, by their number; ``None`` loses a message."""

    def spoil(messages: Messages) -> Messages:
        before = [m for m in messages if m.place is place]
        after = (spoilt(k, m) for k, m in enumerate(before))
        return [m for m in messages if m.place is not place] + [m for m in after if m is not None]

    return spoil


def offset_stamps(off: float, every_nth: int, first: int = 0, last: int = 10**9) -> Spoil:
    """Stamps of the speed are off [s]."""
    return spoil_input(
        Input.SPEED,
        lambda k, m: m._replace(stamp=m.stamp + off) if first <= k < last and k % every_nth == 0 else m,
    )


def replace_values(place: Input, value: float, rows: Callable[[int, float], bool]) -> Spoil:
    """Return a fault that gives some rows, by number and time, another value."""
    return spoil_input(place, lambda k, m: m._replace(value=value) if rows(k, m.stamp) else m)


def deliver_in_bursts(period: float, copies: int, stamped_at: str) -> Spoil:
    """Return a fault that delivers several speeds at once, as a stalled executor or gateway does."""

    def spoil(received: Messages) -> Messages:
        speeds = [m for m in received if m.place is Input.SPEED]
        messages = [m for m in received if m.place is not Input.SPEED]
        for m in speeds:
            for copy in range(copies):
                at = m.stamp + copy * 0.001
                stamp = {
                    'on arrival': at,
                    'at the source': m.stamp + ((copy + 1) / copies - 1) * period,
                    'alike': m.stamp,
                }[stamped_at]
                messages.append(m._replace(arrival=at, stamp=stamp))
        return messages

    return spoil


def step_clocks(step: float, at: float) -> Spoil:
    """Return a fault that sets all clocks by a step [s] at a time [s]."""
    return lambda messages: [m._replace(stamp=m.stamp + (step if m.arrival > at else 0.0)) for m in messages]


def drop_between(begin: float, end: float) -> Spoil:
    """Nothing arrives between two times [s]."""
    return lambda messages: [m for m in messages if not begin <= m.arrival < end]


def drop_load_before(time: float) -> Spoil:
    """Return a fault that loses the load before a time [s]."""
    return spoil_input(Input.LOAD, lambda _, m: m if m.stamp >= time else None)


def delay_speed(seconds: Callable[[int], float]) -> Spoil:
    """Return a fault that delays the speed and its stamps [s], by number."""
    return spoil_input(
        Input.SPEED, lambda k, m: m._replace(arrival=m.arrival + seconds(k), stamp=m.stamp + seconds(k))
    )


def repeat_later(messages: Messages) -> Messages:
    """Return each value twice, the copy a tenth of a second later."""
    return messages + [m._replace(arrival=m.arrival + 0.1, stamp=m.stamp + 0.1) for m in messages]


def send_twice(messages: Messages) -> Messages:
    return [m for m in messages for _ in range(2)]


def swap_pairs(messages: Messages) -> Messages:
    """Return the messages of each input with each two swapped."""
    swapped = []
    for place in Input:
        inputs = [m for m in messages if m.place is place]
        for a, b in zip(inputs[::2], inputs[1::2], strict=False):
            swapped += [b._replace(arrival=a.arrival), a._replace(arrival=b.arrival)]
    return swapped


def apply_all(*spoils: Spoil) -> Spoil:
    """Return a fault that applies several in order."""

    def spoil(messages: Messages) -> Messages:
        for spoil_one in spoils:
            messages = spoil_one(messages)
        return messages

    return spoil


def add_publisher(period: float, ahead: float, value: float, begin: float = 0.0) -> Spoil:
    """Return a fault that adds a second publisher of the speed, by a clock of its own."""

    def spoil(messages: Messages) -> Messages:
        added = every(Input.SPEED, period, messages[-1].arrival, value, begin)
        return messages + [m._replace(stamp=m.stamp + ahead) for m in added]

    return spoil


def rpm_of_share(bearing: str, share: float) -> float:
    return share * BEARINGS[bearing][1]


# --- Levels --------------------------------------------------------------------------------------


def after_shock(begin: float, late: float = 5.0) -> Span:
    """Return when stick-slip that a shock began at a time [s] is predicted: after 75 s, to a few levels."""
    return begin + 75.0 - late, begin + 75.0 + late


def loud_between(begin: float, end: float = math.inf, high: float = 44.0, low: float = 22.0) -> Number:
    """Loud between two times [s]."""
    return lambda t: (high if begin <= t < end else low) + 0.1 * math.sin(3.0 * t)


def loud_when(when: Callable[[float], bool]) -> Number:
    """Something else is loud at times."""
    return lambda t: (60.0 if when(t) else 3.0) * (1.0 + 0.02 * math.sin(9.0 * t))


def knock_that_beats(beat: float, low: float) -> Number:
    """Return a level with one loud sample at 50 s, and from 200 s on a knock that beats."""

    def level(t: float) -> float:
        if t < 200.0:
            return 36.0 if 50.0 <= t < 50.5 else 22.0
        return 46.0 if t % beat < 0.7 * beat else low

    return level


def ringing_blow(t: float) -> float:
    """Return a level in which a blow rings down, and another goes on."""
    ringing = 20.0 * math.exp(-(t - 200.0) / 5.0) if 200.0 <= t < 260.0 else 0.0
    return 44.0 if t >= 260.0 else 22.0 + ringing


def second_episode(later: Callable[[float], float]) -> Number:
    """Risen in the first episode; from 300 s on as given."""
    return lambda t: later(t) if t > 300.0 else 50.0 + math.sin(t) if 82.0 < t < 205.0 else 22.0


def two_bursts(t: float) -> float:
    """Two bursts of four seconds."""
    return (44.0 if 100.0 <= t < 104.0 or 240.0 <= t < 244.5 else 22.0) + 0.1 * math.sin(t)


def dithering_level_with_pauses(t: float) -> float:
    """Return a level of one bit of dither, whose cable breaks for 6 s in 30."""
    return math.nan if t % 30.0 < 6.0 else 21.0 + 0.1 * (round(4.0 * t) % 2)


def beating_level(t: float) -> float:
    return 40.0 + 5.0 * math.sin(2.0 * math.pi * t / 3.5) if t > 412.0 else 22.0


def loose_contact(t: float) -> float:
    return (10.0 if round(4.0 * t) % 4 == 0 else 50.0) if t > 412.0 else 22.0


# --- The rows ------------------------------------------------------------------------------------

NEVER, ALWAYS = (0.0, 0.0), (0.0, math.inf)
AGAIN = ramps([0, 300, 320, 900, 930], [1.6, 1.6, 0.4, 0.4, 0.9])
"""Cruise, ten minutes of stick-slip, then the bistable range."""
EPISODE = ramps([0, 20, 40, 60], [1.5, 0.4, 0.4, 0.9])
"""Into stick-slip, then into the bistable range."""
QUANTITIES = (Input.SPEED, Input.LOAD)


def stamp_cases() -> Iterable[Case]:
    for copies, at in product((2, 20), ('at the source', 'on arrival', 'alike')):
        scenario = Scenario('ship', 60.0, 0.4, period=2.0, spoilt=deliver_in_bursts(2.0, copies, at))
        seconds = {'stick_slip': (48.0, 60.0), 'input_stale': NEVER}
        yield make_case(f'bursts of {copies}, stamped {at}', scenario, first=(0.0, 10.0), seconds=seconds)
    for off in (-3600.0, -7.0, 4.8, 6.0, 3600.0):
        scenario, used = (
            Scenario('ship', 300.0, 0.5, period=0.2, spoilt=offset_stamps(off, 7)),
            0.9 + 0.099 * (off > 0.0),
        )
        seconds = {'stick_slip': (285.0, 300.0)}
        title = f'one stamp in seven off by {off} s'
        yield make_case(title, scenario, first=(0.0, 10.0), events=9, used=used, seconds=seconds)
        scenario, used = Scenario('steep', spoilt=offset_stamps(off, 1, 100, 102)), 0.99 + 0.01 * (off > 0.0)
        yield make_case(f'two stamps off by {off} s', scenario, events=0, used=used)


def clock_cases() -> Iterable[Case]:
    for period in (2.0, 4.8):
        scenario = Scenario(
            'ship', 200.0, ramps([0, 100, 101], [2.0, 2.0, 0.4]), period=period, spoilt=repeat_later
        )
        expected = {'used': 0.95, 'first': (100.0, 112.0), 'seconds': {'input_stale': NEVER}}
        yield make_case(f'values in pairs, {period} s apart', scenario, **expected)
    for (bearing, period), by, spoil in product(
        (('ship', 0.1), ('steep', 1.0)), (-3600.0, -3.0, 3.0, 600.0), (send_twice, swap_pairs)
    ):
        spoilt = apply_all(drop_between(40.0, 50.0), spoil, step_clocks(by, 50.0))
        scenario = Scenario(bearing, 160.0, step_number(100.0, 2.0, 0.4), period=period, spoilt=spoilt)
        onset = (100.0, 115.0 + 8.0 * period)
        title = f'clock set by {by} s in a gap, {spoil.__name__}, {bearing}'
        yield make_case(title, scenario, onsets=(onset,), first=onset)
    for period, by in ((10.0, -3600.0), (20.0, -120.0)):
        scenario = Scenario('table', 900.0, 0.4, period=period, spoilt=step_clocks(by, 25.0))
        title = f'values each {period} s, the clock set by {by} s at once'
        yield make_case(title, scenario, used=0.95, ends='stick_slip')
    timeouts = {'speed__timeout': 60.0, 'load__timeout': 60.0}
    share, spoilt = step_number(105.0, 2.0, 0.4), step_clocks(-50.0, 100.0)
    scenario = Scenario('ship', 200.0, share, period=0.2, spoilt=spoilt, settings=timeouts)
    yield make_case('clock set by -50 s within a long time-out', scenario, first=(105.0, 109.0))
    for ahead in (-7.0, 0.4, 7.0):
        scenario = Scenario(
            'ship', 120.0, 0.4, spoilt=add_publisher(0.5, ahead, rpm_of_share('ship', 0.6), 0.23)
        )
        title = f'a second publisher far outside, its clock {ahead} s off'
        yield make_case(title, scenario, seconds={'stick_slip': (100.0, 120.0)})


def value_cases() -> Iterable[Case]:
    for (bearing, period, nth), place in product((('steep', 0.05, 7), ('ship', 0.1, 4)), QUANTITIES):
        value = (0.05, 20.0)[place] * BEARINGS[bearing][1 + place]
        spoilt = replace_values(place, value, lambda k, _, n=nth: k >= 9 and (k - 9) % n == 0)
        title = f'one odd {INPUTS[place]} in {nth} far outside'
        yield make_case(
            title, Scenario(bearing, period=period, spoilt=spoilt), onsets=(), seconds={'bistable': NEVER}
        )
    for place in QUANTITIES:
        value = (0.9, 30.0)[place] * BEARINGS['ship'][1 + place]
        spoilt = replace_values(place, value, lambda k, _: 500 <= k < 3000 and k % 500 == 0)
        level = {'level': loud_between(0.0, high=90.0), 'unit': 'mm/s', 'threshold': 40.0}
        scenario = Scenario('ship', 600.0, 1.75, period=0.2, spoilt=spoilt, **level)
        yield make_case(f'one odd {INPUTS[place]} and a vibration', scenario, seconds={'stick_slip': NEVER})
        spoilt = replace_values(place, 0.0, lambda _, t: 130.0 < t < 131.4)
        scenario = Scenario('steep', 180.0, EPISODE, period=0.2, spoilt=spoilt)
        title = f'{INPUTS[place]} drops to zero for 1.4 s in an episode'
        yield make_case(title, scenario, onsets=(ALWAYS,), ends='stick_slip')
    for bearing, place in product(('reference', 'viscous'), QUANTITIES):
        spoilt = replace_values(place, 0.0, lambda _, t: t > 40.0 and t % 1.0 < 0.5)
        scenario = Scenario(bearing, 200.0, step_number(40.0, 0.4, 2.0), period=0.1, spoilt=spoilt)
        title = f'{INPUTS[place]} drops out half of the time, {bearing}'
        yield make_case(title, scenario, onsets=(ALWAYS,), seconds={'stick_slip': NEVER}, since=70.0)
    for period in (0.1, 1.0):
        scenario = Scenario('reference', 60.0, step_number(0.01, 0.05, 2.0), period=period, load_period=0.1)
        yield make_case(f'the filter of a tachometer starts at zero, each {period} s', scenario, onsets=())
    for bearing, (_, fold, _) in BEARINGS.items():
        scenario = Scenario(bearing, 120.0, 0.04 / fold, period=1.0)
        yield make_case(f'a stopped shaft whose tachometer shows 0.04 rpm, {bearing}', scenario, events=0)
    for size in (1.0, 4.0):
        fine, share = ramps([0, 120], [2.0, 0.3]), size / BEARINGS['steep'][1]
        scenario = Scenario('steep', 150.0, lambda t, s=share, f=fine: s * round(f(t) / s), load_period=0.2)
        yield make_case(f'speeds in steps of {size} rpm', scenario, onsets=(ALWAYS,), ends='stick_slip')


def pace_cases() -> Iterable[Case]:
    slow, lag = {'speed__timeout': 4.0, 'load__timeout': 4.0}, delay_speed(lambda k: k % 2 * 0.02)
    scenario = Scenario('viscous', 600.0, period=4.0, load_period=0.5, spoilt=lag, settings=slow)
    title = 'values as slow as the time-out, every second 20 ms late'
    yield make_case(title, scenario, since=10.0, seconds={'input_stale': NEVER})
    for period in (6.0, 30.0):
        title = f'values slower than the time-out, each {period} s'
        yield make_case(title, Scenario('ship', 1800.0, 0.4, period=period), used=0.9, ends='stick_slip')
    for period in (1.0, 4.0):
        scenario = Scenario('steep', 60.0, step_number(21.0, 2.0, 0.3), period=0.1, load_period=period)
        yield make_case(f'a load each {period} s delays no onset', scenario, first=(21.0, 23.0))
    for period in (2.0, 60.0):
        scenario = Scenario(
            'ship',
            4500.0,
            lambda t: 0.4 if t % 600.0 < 300.0 and t < 1200.0 else 2.0,
            period=period,
            load_period=1.0,
            settings={'speed__timeout': 30.0},
        )
        expected = {'onsets': (ALWAYS, ALWAYS), 'since': 1200.0 + 4 * period, 'ends': 'normal'}
        seconds = dict.fromkeys(('stick_slip', 'bistable', 'caution'), NEVER)
        title = f'two episodes, then an hour outside, a speed each {period} s'
        yield make_case(title, scenario, seconds=seconds, **expected)
    for apart in (50.0, 250.0):
        last, single_times = 100.0 + 2.0 * apart, (100.0 + apart, 100.0 + 2.0 * apart)
        spoilt = spoil_input(
            Input.SPEED,
            lambda _, m, times=single_times: (
                m if m.stamp < 100.0 or min(abs(m.stamp - at) for at in times) < 0.04 else None
            ),
        )
        scenario = Scenario('ship', last + 60.0, period=0.1, spoilt=spoilt)
        title = f'two single speeds {apart} s apart are no slow sensor'
        yield make_case(title, scenario, since=last, seconds={'normal': (0.0, 15.0)}, ends='input_stale')
    scenario = Scenario('ship', 5 * 3600.0, 1.6, period=5.0, load_period=3600.0)
    lost = {'input_stale': (0.85 * 5 * 3600.0, math.inf)}
    yield make_case('a load that comes once an hour is lost in between', scenario, seconds=lost)


def course_cases() -> Iterable[Case]:
    for bearing, high, low in (('steep', 2.0, 0.4), ('viscous', 1.8, 0.5)):
        begins = (60.0, 360.0, 660.0, 960.0)
        times = [begin + after for begin in begins for after in (0.0, 20.0, 50.0, 70.0)]
        scenario = Scenario(bearing, 1260.0, ramps(times, [high, low, low, high] * 4), period=0.2)
        onsets, seconds = tuple((begin, begin + 30.0) for begin in begins), {'stick_slip': (0.0, 4 * 70.0)}
        title = f'each of four episodes ends and is announced, {bearing}'
        yield make_case(title, scenario, onsets=onsets, seconds=seconds, ends='normal')
    title = 'nothing is known of a bearing that starts in the bistable range'
    yield make_case(
        title, Scenario('steep', 60.0, 0.9, period=0.25), ends='bistable', says='Vibration state unknown.'
    )
    limit = {'alarm__amplitude_limit': 0.8e-3}
    scenario = Scenario('reference', 60.0, 0.5, period=0.2, load=6.0, settings=limit)
    title = 'the amplitude limit is that of the exact cycle: 0.94 mm, averaged 0.55'
    yield make_case(title, scenario, ends='amplitude_limit')


def level_cases() -> Iterable[Case]:
    for high in (8.0, 25.0):
        level = {'level': loud_between(400.0, high=high, low=2.0), 'unit': 'mm/s', 'threshold': math.nan}
        scenario = Scenario('ship', 900.0, 1.13, **level)
        yield make_case(f'a genset outside the fold, {high} mm/s', scenario, seconds={'stick_slip': NEVER})
    for dither in (0.0, 0.04):
        scenario = Scenario(
            'viscous',
            600.0,
            0.9,
            level=lambda t, d=dither: (
                44.0 + d * math.copysign(1.0, math.sin(5.0 * t))
                if t >= 400.0
                else 21.0 + 0.7 * math.sin(3.0 * t)
            ),
        )
        title = f'a limit cycle is constant to {dither} dB, and no stuck level'
        yield make_case(title, scenario, first=after_shock(400.0), ends='stick_slip')
    # Beyond the fold a vibration is never taken for stick-slip; caution stands there anyway.
    inside, beyond = ('viscous', 0.9, 'stick_slip'), ('ship', 1.1, 'caution')
    for lasting, (bearing, share, ends) in product((2.0, 8.0), (inside, beyond)):
        level = loud_when(lambda t, n=lasting: t % 60.0 < n or t > 1000.0)
        scenario = Scenario(bearing, 1100.0, share, level=level, unit='mm/s', threshold=20.0)
        onsets = (after_shock(1000.0),) if ends == 'stick_slip' else ()
        yield make_case(
            f'bursts of {lasting} s, then one that goes on, at {share}', scenario, ends=ends, onsets=onsets
        )
    for bearing, period in product(('viscous', 'ship'), (0.1, 2.0)):
        share = ramps([0, 100, 102], [1.6, 1.6, 0.93])
        scenario = Scenario(bearing, 240.0, share, level=loud_between(101.8), period=period)
        title = f'the knock of a crash manoeuvre, {bearing}, a speed each {period} s'
        yield make_case(title, scenario, first=after_shock(101.8))
    for begin in (0.9, 1.6):
        share = ramps([0, 60, 80], [begin, begin, 0.9])
        scenario = Scenario('ship', 900.0, share, level=loud_between(0.0, high=46.0))
        title = f'an engine order that is loud from the start, at {begin}'
        yield make_case(title, scenario, seconds={'stick_slip': NEVER})

    # A sensor's floor, or 0 of an amplifier that is off, is no background of a shaft under way.
    for floor in (0.0, 0.01):
        share = ramps([0, 400, 405, 415, 445], [0.0, 0.0, 1.6, 1.6, 0.9])
        level = {'level': step_number(400.0, floor, 2.0), 'unit': 'mm/s', 'threshold': math.nan}
        scenario = Scenario('ship', 800.0, share, period=0.25, **level)
        yield make_case(
            f'under way from a berth where the level was {floor}', scenario, onsets=((400.0, 402.0),)
        )

    # For three seconds in thirty the amplifier says nothing.
    scenario = Scenario(
        'ship', 300.0, 0.9, level=lambda t: 0.0 if t % 30.0 < 3.0 else 2.0, unit='mm/s', threshold=math.nan
    )
    yield make_case('a level with drop-outs to 0 in the bistable range', scenario, ends='bistable', onsets=())


def _level_knocks() -> Iterable[Case]:
    for beat, low in ((6.0, 29.0), (8.0, 33.0), (12.0, 32.0)):
        share = ramps([0, 100, 120], [1.6, 1.6, 0.92])
        scenario = Scenario('viscous', 300.0, share, level=knock_that_beats(beat, low), load_period=0.2)
        title = f'a knock that beats each {beat} s, after one loud sample elsewhere'
        yield make_case(title, scenario, first=after_shock(200.0))
    for bearing, after in product(('viscous', 'ship'), (0.5, 3.0)):
        share = ramps([0, 100, 105, 200, 206], [1.8, 1.8, 0.4, 0.4, 1.8])
        scenario = Scenario(bearing, 300.0, share, level=loud_between(103.0, 202.6 + after, 46.0), period=0.2)
        title = f'the lining rings {after} s after an episode, {bearing}'
        yield make_case(title, scenario, onsets=(ALWAYS,), seconds={'vibration': NEVER}, ends='normal')
    pump = loud_when(lambda t: 400.0 <= t < 440.0 or 500.0 <= t < 590.0)
    for share, onsets in ((step_number(450.0, 1.6, 0.9), ()), (0.9, (after_shock(500.0),))):
        scenario = Scenario('ship', 600.0, share, level=pump, unit='mm/s', threshold=20.0)
        title = f'a pump for 40 s and for 90 s, {"always inside" if onsets else "first beyond"} the fold'
        yield make_case(title, scenario, onsets=onsets, ends='stick_slip' if onsets else 'bistable')
    scenario = Scenario('ship', 430.0, 0.9, level=pump, unit='mm/s', threshold=20.0)
    says = 'Bistable: vibration is measured, and if it goes on it is stick-slip.'
    yield make_case('a vibration inside the fold, so far', scenario, onsets=(), ends='bistable', says=says)
    # The end of an episode beyond the fold is nothing else that vibrates, nor is what a lost level said last.
    share = ramps([0, 100, 105, 200, 206, 300, 306], [1.8, 1.8, 0.4, 0.4, 1.8, 1.8, 0.9])
    for silent in (False, True):
        level = loud_when(lambda t: 103.0 <= t < 205.6 or t >= 550.0)
        measured = (
            (
                lambda t, level_until_lost=level: (
                    math.nan if 190.0 <= t < 300.0 else number_at(level_until_lost, t)
                )
            )
            if silent
            else level
        )
        scenario = Scenario('ship', 700.0, share, level=measured, unit='mm/s', threshold=20.0)
        title = f'a shock after an episode whose end was {"not " * silent}heard'
        yield make_case(title, scenario, onsets=(ALWAYS, after_shock(550.0)), ends='stick_slip')
    for lasting, rises in product((3.5, 5.5), (True, False)):
        level = loud_when(
            lambda t, n=lasting, r=rises: 100.0 <= t % 300.0 < 100.0 + n or (r and 320.0 < t < 920.0)
        )
        scenario = Scenario('ship', 1500.0, AGAIN, level=level, unit='mm/s', threshold=20.0)
        title = f'bursts of {lasting} s, then an episode with{"" if rises else "out"} a rise'
        yield make_case(title, scenario, onsets=((300.0, 400.0),), ends='bistable' if rises else 'stick_slip')


def _level_episodes() -> Iterable[Case]:
    for period in (3.0, 10.0):
        level, short = loud_between(400.0), {'level__timeout': 2.0}
        scenario = Scenario('viscous', 600.0, 0.9, level=level, level_period=period, settings=short)
        title = f'a level each {period} s is slower than its time-out'
        yield make_case(title, scenario, first=after_shock(400.0, 3.0 * period), ends='stick_slip')
    level = loud_between(400.0, high=60.0, low=3.0)
    scenario = Scenario('ship', 600.0, 1.1, level=level, unit='mm/s', threshold=20.0)
    says = 'Vibration is measured where none is predicted'
    yield make_case(
        'a worn bearing sticks where its parameters say caution',
        scenario,
        onsets=(),
        ends='caution',
        says=says,
    )
    expected = {'onsets': (), 'seconds': {'bistable': NEVER}}
    scenario = replace(scenario, settings={'tolerance__damping': 0.2})
    yield make_case('the same of a bearing with tolerances', scenario, **expected)
    scenario = Scenario('viscous', 400.0, 0.9, level=ringing_blow)
    yield make_case('a blow that goes on, after one that rang down', scenario, onsets=(after_shock(260.0),))
    for title, later, ramp, end_of_sticking, end in (
        ('dies', lambda t: 1.0 + 0.01 * (round(2 * t) % 2), 20.0, 520.0, 900.0),
        ('dies, with pauses', dithering_level_with_pauses, 20.0, 620.0, 900.0),
        ('beats with the shaft', beating_level, 10.0, 430.0, 700.0),
        ('has a loose contact', loose_contact, 10.0, 430.0, 700.0),
    ):
        times = [60, 80, 200, 220, 400, 400 + ramp, end_of_sticking, end_of_sticking + ramp]
        share = ramps(times, [1.5, 0.4, 0.4, 1.5, 1.5, 0.4, 0.4, 0.9])
        scenario = Scenario('ship', end, share, period=0.2, level=second_episode(later), level_period=0.25)
        title = f'a level that {title} ends no second episode'
        yield make_case(title, scenario, onsets=(ALWAYS, ALWAYS), ends='stick_slip')
    share, level = ramps([0, 60, 80, 120, 140], [1.5, 1.5, 0.4, 0.4, 0.9]), step_number(0.0, 1.0, 1.0)
    scenario = Scenario('ship', 600.0, share, period=0.2, level=level, unit='mm/s', threshold=40.0)
    yield make_case('a dead level ends no running alarm', scenario, onsets=(ALWAYS,), ends='stick_slip')
    share, spoilt = ramps([150.0, 180.0], [1.6, 0.9]), step_clocks(-3600.0, 200.0)
    scenario = Scenario('viscous', 300.0, share, spoilt=spoilt, level=two_bursts)
    title = 'a burst outside, the clocks set back, and the same inside'
    yield make_case(title, scenario, onsets=(), used=0.99)
    level = loud_between(0.0, high=90.0)
    scenario = Scenario('ship', 200.0, 0.4, level=level, unit='mm/s', threshold=math.nan)
    title = 'a level that shows an episode from the start, without a threshold'
    yield make_case(title, scenario, ends='stick_slip', says='does its sensor reach the bearing?')


ROWS = (
    stamp_cases,
    clock_cases,
    value_cases,
    pace_cases,
    course_cases,
    level_cases,
    _level_knocks,
    _level_episodes,
)
CASES = [case for rows in ROWS for case in rows()]


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.title)
def test_report_of_a_scenario(case: Case) -> None:
    title, scenario, expected = case
    run = MonitorRun(scenario.config, scenario.messages())
    if expected.first is not None:
        assert expected.first[0] <= run.first_sticking() <= expected.first[1]
    if expected.onsets is not None:
        assert len(run.onsets) == len(expected.onsets), run.onsets
        for onset, (begin, end) in zip(run.onsets, expected.onsets, strict=True):
            assert begin <= onset <= end
    for condition, (min_seconds, max_seconds) in expected.seconds.items():
        conditions = STICKING if condition == 'stick_slip' else (condition,)
        assert min_seconds <= run.seconds_in(conditions, expected.since) <= max_seconds, condition
    assert expected.ends in ('', run.condition)
    assert expected.events is None or len(run.events) <= expected.events
    assert sum(run.used) >= expected.used * len(run.used)
    times = [event.time_ns for event in run.events]
    assert times == sorted(times) or 'set by' in title or 'set back' in title
    assert expected.says in run.monitor.bearings[NAME].text()


@pytest.mark.parametrize('times', [2, 6])
def test_copies_change_nothing(times: int) -> None:
    share = ramps([0, 60, 90, 150], [1.6, 0.5, 0.5, 1.6])
    case = Scenario('table', 180.0, share, period=0.25)
    # A stamp is the sender's own if the message comes later.
    messages = [m._replace(arrival=m.arrival + 0.01) for m in case.messages()]
    copied = [m for m in messages for _ in range(times)]
    plain, repeated = (MonitorRun(case.config, received) for received in (messages, copied))
    assert len(plain.onsets) == 1
    texts = [[(brief(e), e.text) for e in run.events] for run in (plain, repeated)]
    assert texts[0] == texts[1]


def test_a_speed_that_is_steady_again_is_no_longer_called_slowing() -> None:
    share, settings = ramps([30, 50, 70], [1.5, 1.08, 1.12]), {'alarm__caution_margin': 0.1}
    case = Scenario('viscous', 300.0, share, settings=settings)
    run = MonitorRun(case.config, case.messages())
    assert 'Slowing' in ' '.join(e.text for e in run.events)
    assert 'Slowing' not in run.monitor.bearings[NAME].text()


def test_a_steady_speed_near_a_doubtful_fold_is_not_called_slowing() -> None:
    # Half above the fold a tolerance of a half asks for caution, although no trend does.
    share, settings = ramps([0], [1.5]), {'tolerance__damping': 0.5}
    case = Scenario('viscous', 60.0, share, settings=settings)
    run = MonitorRun(case.config, case.messages())
    assert [str(e.after) for e in run.events] == ['caution']
    assert 'Slowing' not in ' '.join(e.text for e in run.events)


@pytest.mark.parametrize('pause', [-3600.0, 5.0, 60.0, 200.0])
def test_after_a_restart_an_episode_goes_on_and_no_input_is_blamed(pause: float) -> None:
    case = Scenario('steep', 120.0, EPISODE, period=0.25)
    run = MonitorRun(case.config, case.messages())
    memory = json.loads(json.dumps(run.monitor.bearings[NAME].state.record()))
    run.monitor, earlier_events = Monitor(case.config, {NAME: State.of_record(memory)}), run.events
    run.events, begin = [], 120.0 + pause
    run.events += run.monitor.advance(round(begin * SECOND))
    later_messages = replace(case, share=0.9, end=60.0, spoilt=drop_load_before(1.0)).messages()
    run.take(m._replace(arrival=m.arrival + begin, stamp=m.stamp + begin) for m in later_messages)
    assert earlier_events
    assert run.events == []
    assert run.condition == 'stick_slip'
    # Of inputs that stay away the time-out counts from the restart.
    dead = Monitor(case.config, {NAME: State.of_record(memory)})
    assert dead.advance(round((begin + 4.0) * SECOND)) == []
    assert dead.advance(round((begin + 8.0) * SECOND)) == []
    assert [str(e.after) for e in dead.advance(round((begin + 10.0) * SECOND))] == ['input_stale']


def test_a_hold_up_before_the_first_message_is_no_time() -> None:
    monitor = Monitor(Scenario().config)
    monitor.bearings[NAME].discount_stall(5 * SECOND)
    assert monitor.advance(10**18) == []


def test_a_numpy_number_is_a_number() -> None:
    monitor = Monitor(Scenario(level=loud_between(0.0), unit='mm/s').config)
    for time, kind in enumerate((np.float32, np.float64, np.int32, int)):
        assert feed(monitor, time, 'level', kind(3), NAME).status.valid


@pytest.mark.parametrize(
    ('duration', 'back', 'expected'),
    [
        (1.2, 1.75, 'normal'),
        (1.2, 0.9, 'bistable'),
        (40.0, 1.75, 'normal'),
        # What ran goes on in the bistable range until the fold has been passed.
        (40.0, 0.9, 'stick_slip'),
    ],
)
def test_a_growth_before_a_long_gap_starts_no_alarm_after_it(
    duration: float, back: float, expected: str
) -> None:
    # Both inputs go away in the middle of a growth, or of stick-slip, and come back elsewhere.
    gap_start = 60.0 + duration
    case = Scenario(
        'ship',
        1000.0,
        lambda t: 1.5 if t < 60.0 else 0.5 if t < 900.0 else back,
        period=0.1,
        spoilt=drop_between(gap_start, 960.0),
    )
    run = MonitorRun(case.config, case.messages())
    assert len(run.onsets) == (duration > 2.0)
    assert run.condition == expected


def test_a_load_that_steps_is_one_onset_with_a_tolerance_too() -> None:
    # The probability follows the load by a lag of 4 s; growth does not.
    case = Scenario('ship', 60.0, 0.5, period=0.1, load=lambda t: 0.0 if t < 12.0 else 1.0)
    with_belief = replace(case, settings={'tolerance__load': 0.02})
    runs = [MonitorRun(scenario.config, scenario.messages()) for scenario in (case, with_belief)]
    assert runs[0].onsets == runs[1].onsets
    (onset,) = (event for event in runs[1].events if event.onset)
    assert 'possible with' not in onset.text
