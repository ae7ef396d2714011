# SPDX-License-Identifier: Apache-2.0
"""Attacks on the decision: senders that stall, copy and stamp oddly, and sequences that mislead.

Each is a way in which an earlier rule failed, with other bearings and rates than those it was
found with. Fold and Hopf speeds are those of the averaged model's closed forms, to 0.1 rpm.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from sequences import BEARINGS, NAME, SECOND

from stickslip_monitor import Monitor, MonitorConfig, Sample, build_config
from stickslip_monitor.monitor.ladder import Unknown
from stickslip_monitor.monitor.rule_state import State
from stickslip_monitor.monitor.signals import Input
from stickslip_monitor.monitor.verdict import Event

# One message: when it arrives [s], of what, its stamp [s], its number.
Message = tuple[float, str, float, float]
Number = float | Callable[[float], float]
STICKING = ('stick_slip', 'amplitude_limit')


def _config(bearing: str, **changes: Any) -> MonitorConfig:
    values = {
        **BEARINGS[bearing][0],
        'speed.topic': '/n',
        'speed.unit': 'rpm',
        'load.topic': '/f',
        'load.unit': 'N',
        **{key.replace('__', '.'): value for key, value in changes.items()},
    }
    return build_config(
        {'bearings': [NAME]} | {f'{NAME}.{key}': value for key, value in values.items()}
    )


def _every(
    quantity: str, period: float, end: float, number: Number, begin: float = 0.0
) -> list[Message]:
    """Messages of one sender, each stamped as it is sent."""
    times = np.arange(begin, end, period).tolist()
    return [(t, quantity, t, number(t) if callable(number) else number) for t in times]


class Heard:
    """What a monitor says of some messages.

    Attributes:
        monitor: The monitor, as it is after the last message.
        events: Its events.
        statuses: What became of each message.
    """

    def __init__(self, config: MonitorConfig, messages: Iterable[Message]) -> None:
        self.monitor = Monitor(config)
        self.events: list[Event] = []
        self.statuses: list[str] = []
        self._conditions: list[tuple[float, str]] = []
        self.take(messages)

    def take(self, messages: Iterable[Message]) -> None:
        """Take more messages, in the order of their arrival."""
        for arrival, quantity, stamp, number in sorted(messages, key=lambda m: m[0]):
            came = round(arrival * SECOND)
            sample = Sample(NAME, quantity, round(stamp * SECOND), number, came)
            update = self.monitor.update(sample)
            self.events += update.events
            self.statuses.append(update.status.name)
            self._conditions.append((arrival, str(self.monitor.condition(NAME))))

    def seconds(self, conditions: Iterable[str], begin: float = 0.0) -> float:
        """For how long one of some conditions stood, by arrival [s]."""
        own = set(conditions)
        times = [*self._conditions, (self._conditions[-1][0], '')]
        return sum(
            after - max(at, begin)
            for (at, condition), (after, _) in pairwise(times)
            if condition in own and after > begin
        )

    def first(self, conditions: Iterable[str]) -> float:
        """When one of some conditions first stood, by arrival [s]; ``inf`` for never."""
        own = set(conditions)
        return next((at for at, condition in self._conditions if condition in own), math.inf)

    @property
    def onsets(self) -> list[float]:
        """When stick-slip was announced [s]."""
        return [e.time_ns / SECOND for e in self.events if e.onset]


def _rpm(bearing: str, share: float) -> float:
    return share * BEARINGS[bearing][1]


def _nominal(bearing: str, share: float = 1.0) -> float:
    return share * BEARINGS[bearing][2]


def _loaded(bearing: str, end: float, period: float = 0.25, begin: float = 0.0) -> list[Message]:
    return _every('load', period, end, _nominal(bearing), begin)


MILLIMETRES = {'level__topic': '/v', 'level__unit': 'mm/s'}
DECIBELS = {'level__topic': '/v', 'level__unit': 'dB', 'level__threshold': 34.0}


def _ramps(times: list[float], shares: list[float]) -> Callable[[float], float]:
    """Shares of the fold speed, linear between some times [s]."""
    return lambda t: float(np.interp(t, times, shares))


def _speed(bearing: str, period: float, end: float, share: Number) -> list[Message]:
    """Speeds as shares of the fold speed."""
    return _every(
        'speed', period, end, lambda t: _rpm(bearing, share(t) if callable(share) else share)
    )


def _hear(
    bearing: str,
    end: float,
    share: Number,
    level: Number | None = None,
    period: float = 0.5,
    load_period: float = 0.25,
    **changes: Any,
) -> Heard:
    """A monitor of a speed, the nominal load and perhaps a level twice a second."""
    messages = _speed(bearing, period, end, share) + _loaded(bearing, end, load_period)
    if level is not None:
        messages += _every('level', 0.5, end, level)
    return Heard(_config(bearing, **changes), messages)


def _with_odd(messages: list[Message], rows: Iterable[int], number: float) -> list[Message]:
    """The same messages, some with another number."""
    return [(*m[:3], number) if k in set(rows) else m for k, m in enumerate(messages)]


@pytest.mark.parametrize('copies', [2, 5, 20])
@pytest.mark.parametrize('stamped', ['at the source', 'on arrival', 'alike'])
@pytest.mark.parametrize(('bearing', 'period'), [('viscous', 1.0), ('ship', 2.0)])
def test_speeds_in_bursts_count_like_any(
    bearing: str, period: float, stamped: str, copies: int
) -> None:
    """A stalled executor or a serial gateway hands several values over within milliseconds."""
    messages = _loaded(bearing, 60.0)
    for k in range(int(60.0 / period)):
        for copy in range(copies):
            at = k * period + copy * 0.001
            stamp = {
                'on arrival': at,
                'at the source': (k - 1 + (copy + 1) / copies) * period,
                'alike': k * period,
            }[stamped]
            messages.append((at, 'speed', stamp, _rpm(bearing, 0.4)))
    heard = Heard(_config(bearing), messages)
    assert heard.first(STICKING) < 10.0
    assert heard.seconds(STICKING) > 48.0
    assert 'input_stale' not in {str(e.after) for e in heard.events}


@pytest.mark.parametrize('off', [-3600.0, -7.0, 4.8, 6.0, 3600.0])
@pytest.mark.parametrize('every', [7, 20])
def test_odd_stamps_hide_no_stick_slip(off: float, every: int) -> None:
    speed = [
        (at, quantity, stamp + (off if k % every == 3 else 0.0), number)
        for k, (at, quantity, stamp, number) in enumerate(_speed('ship', 0.2, 300.0, 0.5))
    ]
    heard = Heard(_config('ship'), _loaded('ship', 300.0, 0.2) + speed)
    assert heard.first(STICKING) < 10.0
    assert heard.seconds(STICKING) > 285.0
    assert len(heard.events) < 10
    times = [e.time_ns for e in heard.events]
    assert times == sorted(times)


@pytest.mark.parametrize('off', [-3600.0, -8.0, 8.0, 3600.0])
@pytest.mark.parametrize('several', [1, 2])
@pytest.mark.parametrize('timeout', [2.0, 15.0])
def test_one_or_two_odd_stamps_lose_two_values_at_most(
    off: float, several: int, timeout: float
) -> None:
    """Older ones are refused; after newer ones those that follow are, until a second is over."""
    speed = _speed('steep', 0.5, 120.0, 2.0)
    for row in range(100, 100 + several):
        at, quantity, stamp, number = speed[row]
        speed[row] = (at, quantity, stamp + off, number)
    heard = Heard(_config('steep', speed__timeout=timeout), speed + _loaded('steep', 120.0, 0.5))
    found = [s for s in heard.statuses if s != 'ACCEPTED']
    assert set(found) <= {'OUT_OF_ORDER'}
    assert len(found) <= 2
    assert heard.events == []


@pytest.mark.parametrize(('bearing', 'high', 'low'), [('steep', 2.0, 0.4), ('viscous', 1.8, 0.5)])
def test_each_of_several_episodes_ends_and_is_announced(
    bearing: str, high: float, low: float
) -> None:
    begins = [60.0, 360.0, 660.0, 960.0]
    times = [begin + after for begin in begins for after in (0.0, 20.0, 50.0, 70.0)]
    heard = _hear(bearing, 1260.0, _ramps(times, [high, low, low, high] * 4), None, 0.2, 0.2)
    assert len(heard.onsets) == len(begins)
    for begin, onset in zip(begins, heard.onsets, strict=True):
        assert begin < onset < begin + 30.0
    # What has come back within a minute of being cleared may stand for a minute, here nothing.
    assert heard.seconds(STICKING) < 4 * 70.0
    for begin in begins:
        assert heard.seconds(STICKING, begin + 90.0) == heard.seconds(STICKING, begin + 280.0)


@pytest.mark.parametrize('loud', [8.0, 25.0])
def test_a_genset_outside_the_fold_is_no_stick_slip(loud: float) -> None:
    def level(t: float) -> float:
        return (loud if t > 400.0 else 2.0) * (1.0 + 0.02 * math.sin(7.0 * t))

    assert _hear('ship', 900.0, 1.13, level, **MILLIMETRES).seconds(STICKING) == 0.0


def _bistable_and_sticking(bearing: str) -> Heard:
    """A monitor in an episode that began below the Hopf speed and goes on above it."""
    share = _ramps([0, 20, 40, 60], [1.5, 0.4, 0.4, 0.9])
    heard = _hear(bearing, 120.0, share, period=0.25)
    assert heard.monitor.condition(NAME) == 'stick_slip'
    return heard


def test_without_a_memory_nobody_knows_whether_a_bistable_bearing_vibrates() -> None:
    heard = _hear('steep', 60.0, 0.9, period=0.25)
    assert str(heard.monitor.condition(NAME)) == 'bistable'
    assert not heard.monitor.bearings[NAME].state.known
    assert 'Vibration state unknown.' in heard.events[-1].text


@pytest.mark.parametrize('dither', [0.0, 0.04])
def test_a_limit_cycle_is_constant_and_no_stuck_level(dither: float) -> None:
    """A knock in the bistable range at 400 s, in decibels."""

    def level(t: float) -> float:
        if t < 400.0:
            return 21.0 + 0.7 * math.sin(3.0 * t)
        return 44.0 + dither * math.copysign(1.0, math.sin(5.0 * t))

    heard = _hear('viscous', 600.0, 0.9, level, **DECIBELS)
    assert 400.0 < heard.first(STICKING) < 406.0
    assert heard.monitor.condition(NAME) == 'stick_slip'


@pytest.mark.parametrize('lasting', [2.0, 3.5, 8.0])
def test_bursts_of_vibration_hide_no_episode_and_make_few(lasting: float) -> None:
    """Something else is loud for seconds each minute; at 1000 s stick-slip begins and goes on."""

    def level(t: float) -> float:
        loud = t % 60.0 < lasting or t > 1000.0
        return (60.0 if loud else 3.0) * (1.0 + 0.02 * math.sin(9.0 * t))

    heard = _hear('viscous', 1100.0, 0.9, level, level__threshold=20.0, **MILLIMETRES)
    # The first of them cannot be told from a blow, and ends after the off-delay.
    assert sum(onset < 1000.0 for onset in heard.onsets) <= 1
    assert next(o for o in heard.onsets if o > 1000.0) < 1020.0
    assert heard.monitor.condition(NAME) == 'stick_slip'


def test_vibration_outside_the_fold_is_told_and_is_no_stick_slip() -> None:
    """A worn bearing sticks at 1.1 times the fold of its parameters, which say caution there."""
    heard = _hear(
        'ship', 600.0, 1.1, lambda t: (60.0 if t > 400.0 else 3.0) + 0.1 * math.sin(t),
        level__threshold=20.0, **MILLIMETRES,
    )  # fmt: skip
    assert heard.onsets == []
    assert heard.monitor.condition(NAME) == 'caution'
    assert 'Vibration is measured where none is predicted' in heard.monitor.bearings[NAME].text()


BISTABLE_AGAIN = _ramps([0, 300, 320, 900, 930], [1.6, 1.6, 0.4, 0.4, 0.9])
"""Cruise, ten minutes of stick-slip, then the bistable range."""


@pytest.mark.parametrize('period', [0.1, 2.0])
@pytest.mark.parametrize('bearing', ['viscous', 'ship'])
def test_the_knock_of_a_crash_manoeuvre_is_found_in_seconds(bearing: str, period: float) -> None:
    """It begins as the shaft falls past the fold, before caution is raised, and goes on."""
    share, passed = _ramps([0, 100, 102], [1.6, 1.6, 0.93]), 101.8
    heard = _hear(
        bearing, 160.0, share, lambda t: 46.0 if t > passed else 22.0, period, **DECIBELS
    )
    assert passed < heard.first(STICKING) < 130.0


@pytest.mark.parametrize('begin', [0.9, 1.6])
def test_an_engine_order_that_is_loud_from_the_start_is_no_stick_slip(begin: float) -> None:
    """The voyage begins in the bistable range, or comes there after a minute of it elsewhere."""
    share = _ramps([0, 60, 80], [begin, begin, 0.9])
    heard = _hear('ship', 900.0, share, lambda t: 46.0 + math.sin(t), **DECIBELS)
    assert heard.seconds(STICKING) == 0.0


@pytest.mark.parametrize(('beat', 'low'), [(6.0, 29.0), (8.0, 33.0), (12.0, 32.0)])
def test_a_knock_that_beats_is_found_after_one_loud_sample_elsewhere(
    beat: float, low: float
) -> None:
    """The swell takes it below its threshold for a third of the time."""

    def level(t: float) -> float:
        if t >= 200.0:
            return 46.0 if t % beat < 0.7 * beat else low
        return 36.0 if 50.0 <= t < 50.5 else 22.0

    share = _ramps([0, 100, 120], [1.6, 1.6, 0.92])
    heard = _hear('viscous', 300.0, share, level, 0.2, **DECIBELS)
    assert 200.0 < heard.first(STICKING) < 232.0


@pytest.mark.parametrize('after', [0.5, 3.0])
@pytest.mark.parametrize('bearing', ['viscous', 'ship'])
def test_the_end_of_an_episode_is_no_other_vibration(bearing: str, after: float) -> None:
    """The shaft leaves quickly, and the lining rings for some seconds beyond the fold."""
    share = _ramps([0, 100, 105, 200, 206], [1.8, 1.8, 0.4, 0.4, 1.8])

    def level(t: float) -> float:
        return 46.0 if 103.0 <= t < 202.6 + after else 22.0

    heard = _hear(bearing, 300.0, share, level, 0.2, **DECIBELS)
    assert len(heard.onsets) == 1
    assert heard.first(['vibration']) == math.inf
    assert heard.monitor.condition(NAME) == 'normal'


@pytest.mark.parametrize('lasting', [3.5, 5.5])
@pytest.mark.parametrize('bearing', ['viscous', 'ship'])
@pytest.mark.parametrize('rises', [True, False])
def test_bursts_are_remembered_over_an_episode_and_prove_no_hearing(
    bearing: str, lasting: float, rises: bool
) -> None:
    """Bursts each five minutes, outside and in the bistable range; the level hears, or is deaf."""

    def level(t: float) -> float:
        loud = 100.0 <= t % 300.0 < 100.0 + lasting or (rises and 320.0 < t < 920.0)
        return (60.0 if loud else 3.0) * (1.0 + 0.02 * math.sin(9.0 * t))

    heard = _hear(bearing, 1500.0, BISTABLE_AGAIN, level, level__threshold=20.0, **MILLIMETRES)
    assert [300.0 < onset < 400.0 for onset in heard.onsets] == [True]
    # One that has risen with stick-slip tells that it has ended; of another nobody knows.
    assert heard.monitor.condition(NAME) == ('bistable' if rises else 'stick_slip')


@pytest.mark.parametrize('period', [3.0, 10.0])
def test_a_level_that_is_slower_than_its_time_out_is_heard(period: float) -> None:
    """As a speed or a load is: a value stands for 2.5 of its gaps."""
    level = _every('level', period, 600.0, lambda t: (44.0 if t > 400.0 else 22.0) + math.sin(t))
    own = _speed('viscous', 0.5, 600.0, 0.9) + _loaded('viscous', 600.0) + level
    heard = Heard(_config('viscous', level__timeout=2.0, **DECIBELS), own)
    assert 400.0 < heard.first(STICKING) <= 401.0 + 3.0 * period
    assert heard.monitor.condition(NAME) == 'stick_slip'
    assert heard.monitor.bearings[NAME].unknown is None
    assert not heard.monitor.bearings[NAME].is_lost(Input.LEVEL)


def test_the_blow_after_one_that_rang_down_is_found_as_it_goes_on() -> None:
    """Two blows in the bistable range: after the first, what is short is not used."""

    def level(t: float) -> float:
        ringing = 20.0 * math.exp(-(t - 200.0) / 5.0) if 200.0 <= t < 260.0 else 0.0
        return 44.0 if t >= 260.0 else 22.0 + ringing

    heard = _hear('viscous', 300.0, 0.9, level, **DECIBELS)
    assert [onset for onset in heard.onsets if onset < 260.0] == []
    assert 260.0 < heard.first(STICKING) <= 276.0


def test_a_dead_level_ends_no_running_alarm() -> None:
    """A sensor that has fallen off has one bit of dither: it is quiet and has never risen."""
    share = _ramps([0, 60, 80, 120, 140], [1.5, 1.5, 0.4, 0.4, 0.9])
    dead = MILLIMETRES | {'level__threshold': 40.0}
    with_level, without = (
        _hear('ship', 600.0, share, level, 0.2, 0.2, **changes)
        for level, changes in ((lambda t: 1.0 + 0.01 * (round(2 * t) % 2), dead), (None, {}))
    )
    assert without.monitor.condition(NAME) == 'stick_slip'
    assert with_level.monitor.condition(NAME) == 'stick_slip'
    assert with_level.onsets == without.onsets


@pytest.mark.parametrize('odd', ['speed', 'load'])
def test_one_odd_sample_makes_no_stick_slip_of_vibration(odd: str) -> None:
    speed, load = _speed('ship', 0.2, 600.0, 1.75), _loaded('ship', 600.0, 0.2)
    rows = range(500, 3000, 500)
    if odd == 'speed':
        speed = _with_odd(speed, rows, _rpm('ship', 0.9))
    else:
        load = _with_odd(load, rows, _nominal('ship', 30.0))
    level = _every('level', 0.5, 600.0, lambda t: 90.0 + math.sin(t))
    config = _config('ship', level__threshold=40.0, **MILLIMETRES)
    assert Heard(config, speed + load + level).seconds(STICKING) == 0.0


def test_values_as_slow_as_the_time_out_are_not_lost() -> None:
    late = [(t + 0.02 * (k % 2)) for k, t in enumerate(np.arange(0.0, 600.0, 4.0).tolist())]
    messages = [(t, 'speed', t, _rpm('viscous', 2.0)) for t in late]
    config = _config('viscous', speed__timeout=4.0, load__timeout=4.0)
    heard = Heard(config, messages + _loaded('viscous', 600.0, 0.5))
    # The second value is 20 ms later than the time-out, and the rhythm not known yet.
    assert heard.seconds(['input_stale'], 10.0) == 0.0


@pytest.mark.parametrize('period', [1.0, 4.0])
def test_a_slow_load_delays_no_onset(period: float) -> None:
    """The speed falls at once to a third of the fold speed; the load comes seldom."""
    heard = _hear('steep', 60.0, lambda t: 2.0 if t < 21.0 else 0.3, None, 0.1, period)
    assert 21.0 < heard.onsets[0] < 23.0


@pytest.mark.parametrize('lost', ['speed', 'load'])
def test_a_short_dropout_to_zero_ends_no_episode(lost: str) -> None:
    heard = _bistable_and_sticking('steep')
    for quantity, number in (('speed', _rpm('steep', 0.9)), ('load', _nominal('steep'))):
        values = _every(quantity, 0.2, 180.0, number, 120.1)
        zero = [k for k, m in enumerate(values) if quantity == lost and 130.0 < m[0] < 131.4]
        heard.take(_with_odd(values, zero, 0.0))
    assert heard.monitor.condition(NAME) == 'stick_slip'
    assert len(heard.onsets) == 1


def test_the_amplitude_limit_is_that_of_the_exact_cycle() -> None:
    """At six times the load the averaged amplitude is 0.55 mm, the exact one 0.94 mm."""
    load = _every('load', 0.2, 60.0, _nominal('reference', 6.0))
    config = _config('reference', alarm__amplitude_limit=0.8e-3)
    heard = Heard(config, _speed('reference', 0.2, 60.0, 0.5) + load)
    assert heard.monitor.condition(NAME) == 'amplitude_limit'


def test_a_speed_that_is_steady_again_falls_no_more() -> None:
    share = _ramps([30, 50, 70], [1.5, 1.08, 1.12])
    heard = _hear('viscous', 300.0, share, alarm__caution_margin=0.1)
    assert 'Slowing' in ' '.join(e.text for e in heard.events)
    assert 'Slowing' not in heard.monitor.bearings[NAME].text()


@pytest.mark.parametrize('bearing', BEARINGS)
def test_a_stopped_shaft_does_not_stick(bearing: str) -> None:
    """A tachometer that shows 0.04 rpm."""
    share = 0.04 / BEARINGS[bearing][1]
    assert _hear(bearing, 120.0, share, period=1.0).events == []


@pytest.mark.parametrize('offset', [-7.0, 0.4, 7.0])
def test_a_second_publisher_hides_no_stick_slip(offset: float) -> None:
    """Half of the speeds are of a simulator that runs far outside, by a clock of its own."""
    other = [
        (t + 0.23, 'speed', t + 0.23 + offset, _rpm('ship', 0.6))
        for t in np.arange(0.0, 120.0, 0.5).tolist()
    ]
    own = _speed('ship', 0.5, 120.0, 0.4)
    heard = Heard(_config('ship'), own + other + _loaded('ship', 120.0))
    assert heard.seconds(STICKING) > 100.0


@pytest.mark.parametrize('step', [1.0, 4.0])
def test_quantised_speeds_stick_all_the_same(step: float) -> None:
    fine, fold = _ramps([0, 120], [2.0, 0.3]), BEARINGS['steep'][1]
    heard = _hear('steep', 150.0, lambda t: step * round(fine(t) * fold / step) / fold, None, 0.2)
    assert len(heard.onsets) == 1
    assert heard.monitor.condition(NAME) == 'stick_slip'


@pytest.mark.parametrize('times', [2, 6])
def test_copies_change_nothing(times: int) -> None:
    share = _ramps([0, 60, 90, 150], [1.6, 0.5, 0.5, 1.6])
    messages = _speed('table', 0.25, 180.0, share) + _loaded('table', 180.0)
    once = Heard(_config('table'), messages)
    copied = [(t + 0.001 * k, *rest) for t, *rest in messages for k in range(times)]
    often = Heard(_config('table'), copied)
    assert len(once.onsets) == 1
    told = [[replace(e, assessment=None) for e in heard.events] for heard in (once, often)]
    assert told[0] == told[1]


def _sent_twice(messages: list[Message]) -> list[Message]:
    return [message for message in messages for _ in range(2)]


def _swapped_in_pairs(messages: list[Message]) -> list[Message]:
    """The second of each two, with the first one's arrival, comes before it."""
    pairs = zip(messages[::2], messages[1::2], strict=True)
    return [swapped for a, b in pairs for swapped in ((a[0], *b[1:]), (b[0], *a[1:]))]


@pytest.mark.parametrize('spoilt', [_sent_twice, _swapped_in_pairs])
@pytest.mark.parametrize('step', [-3600.0, -3.0, 0.0, 3.0, 600.0])
@pytest.mark.parametrize(('bearing', 'period'), [('ship', 0.1), ('steep', 1.0)])
def test_after_a_clock_step_or_a_gap_an_untidy_sender_is_heard_again(
    bearing: str, period: float, step: float, spoilt: Callable[[list[Message]], list[Message]]
) -> None:
    """Each stamp comes twice, or after its successor; ten seconds are missing, too."""
    speed = _speed(bearing, period, 160.0, lambda t: 2.0 if t < 100.0 else 0.4)
    given = spoilt(speed) + spoilt(_loaded(bearing, 160.0, period))
    heard = Heard(
        _config(bearing),
        [(t, q, s + step * (t > 50.0), n) for t, q, s, n in given if not 40.0 <= t < 50.0],
    )
    assert len(heard.onsets) == 1
    assert 100.0 < heard.first(STICKING) < 115.0 + 8.0 * period


def test_a_numpy_number_is_a_number() -> None:
    monitor = Monitor(_config('ship', level__threshold=40.0, **MILLIMETRES))
    for time, kind in enumerate((np.float32, np.float64, np.int32, int)):
        assert monitor.update(Sample(NAME, 'level', time * SECOND, kind(3))).status.valid


@pytest.mark.parametrize('dropping', ['speed', 'load'])
@pytest.mark.parametrize('bearing', ['reference', 'ship', 'viscous'])
def test_an_input_that_drops_out_half_of_the_time_keeps_no_episode_alive(
    bearing: str, dropping: str
) -> None:
    """Neither at rest nor beyond the fold is there a cycle that could go on."""
    speed = _speed(bearing, 0.1, 200.0, lambda t: 2.0 if t > 40.0 else 0.4)
    load = _loaded(bearing, 200.0, 0.1)
    gone = [k for k, (t, *_) in enumerate(speed) if t > 40.0 and t % 1.0 < 0.5]
    if dropping == 'speed':
        speed = _with_odd(speed, gone, 0.0)
    else:
        load = _with_odd(load, gone, 0.0)
    heard = Heard(_config(bearing), speed + load)
    assert len(heard.onsets) == 1
    assert heard.seconds(STICKING, 70.0) == 0.0


@pytest.mark.parametrize('period', [2.0, 60.0])
def test_a_slow_speed_holds_no_alarm_for_long(period: float) -> None:
    """Two episodes, then an hour at twice the fold speed."""

    def share(t: float) -> float:
        return 0.4 if t % 600.0 < 300.0 and t < 1200.0 else 2.0

    heard = _hear('ship', 4500.0, share, None, period, 1.0, speed__timeout=30.0)
    assert len(heard.onsets) == 2
    assert str(heard.monitor.condition(NAME)) == 'normal'
    assert heard.seconds([*STICKING, 'bistable', 'caution'], 900.0 + 300.0 + 4 * period) == 0.0


def test_no_value_stands_for_hours() -> None:
    """The load comes once an hour: it is lost in between, however slow it has been."""
    heard = _hear('ship', 5 * 3600.0, 1.6, None, 5.0, 3600.0)
    assert heard.seconds(['input_stale']) > 0.85 * 5 * 3600.0


def _set_back(messages: Iterable[Message]) -> list[Message]:
    """All clocks go back by an hour at 200 s."""
    return [(t, q, s - (3600.0 if t > 200.0 else 0.0), n) for t, q, s, n in messages]


def test_a_burst_before_the_clocks_are_set_back_is_not_forgotten() -> None:
    """A burst outside shows that the level tells of something else; the one inside is it again."""

    def level(t: float) -> float:
        loud = 100.0 <= t < 104.0 or 240.0 <= t < 244.5
        return (44.0 if loud else 22.0) + 0.1 * math.sin(t)

    speed = _speed('viscous', 0.5, 300.0, _ramps([150.0, 180.0], [1.6, 0.9]))
    own = speed + _every('level', 0.5, 300.0, level)
    heard = Heard(_config('viscous', **DECIBELS), _set_back(own + _loaded('viscous', 300.0)))
    assert 'OUT_OF_ORDER' in heard.statuses
    assert heard.onsets == []


def test_a_level_that_is_stuck_when_the_clocks_are_set_back_is_stuck_afterwards() -> None:
    level = _every('level', 0.5, 780.0, lambda t: 3.0 + 0.1 * math.sin(t) * (t <= 150.0))
    own = _speed('ship', 0.5, 780.0, 1.6) + level + _loaded('ship', 780.0)
    heard = Heard(_config('ship', level__threshold=40.0, **MILLIMETRES), _set_back(own))
    assert heard.monitor.bearings[NAME].unknown is Unknown.STUCK


def _dies(t: float) -> float:
    """Risen in the first episode, one bit of dither in the second."""
    return 50.0 + math.sin(t) if 82.0 < t < 205.0 else 1.0 + 0.01 * (round(2 * t) % 2)


def _dies_with_pauses(t: float) -> float:
    """The same, and the cable breaks for 6 s in 30."""
    if t > 210.0:
        return math.nan if t % 30.0 < 6.0 else 21.0 + 0.1 * (round(4.0 * t) % 2)
    return 50.0 + math.sin(t) if 82.0 < t < 205.0 else 22.0 + 0.1 * math.sin(t)


def _rises(t: float, later: float) -> float:
    if not (82.0 < t < 205.0 or t > 412.0):
        return 22.0 + 0.1 * math.sin(t)
    return 50.0 + math.sin(t) if t < 300.0 else later


def _with_the_shaft(t: float) -> float:
    """Above its threshold in both episodes, rising and falling with the shaft."""
    return _rises(t, 40.0 + 5.0 * math.sin(2.0 * math.pi * t / 3.5))


def _loose_contact(t: float) -> float:
    """Above its threshold in both episodes but for one value in four."""
    return _rises(t, 10.0 if round(4.0 * t) % 4 == 0 else 50.0)


@pytest.mark.parametrize(
    ('level', 'ramp', 'left', 'end'),
    [
        (_dies, 20.0, 520.0, 900.0),
        (_dies_with_pauses, 20.0, 620.0, 900.0),
        (_with_the_shaft, 10.0, 430.0, 700.0),
        (_loose_contact, 10.0, 430.0, 700.0),
    ],
)
def test_a_level_that_is_not_quiet_ends_no_second_episode(
    level: Callable[[float], float], ramp: float, left: float, end: float
) -> None:
    """It goes on in the bistable range from ``left + ramp`` on [s]."""
    times = [60, 80, 200, 220, 400, 400 + ramp, left, left + ramp]
    share = _ramps(times, [1.5, 0.4, 0.4, 1.5, 1.5, 0.4, 0.4, 0.9])
    levels = [m for m in _every('level', 0.25, end, level) if not math.isnan(m[3])]
    both = _speed('ship', 0.2, end, share) + _loaded('ship', end, 0.2)
    heard = Heard(_config('ship', **DECIBELS), both + levels)
    assert len(heard.onsets) == 2
    assert heard.monitor.condition(NAME) == 'stick_slip'


@pytest.mark.parametrize('odd', ['speed', 'load'])
@pytest.mark.parametrize(('bearing', 'period', 'every'), [('steep', 0.05, 7), ('ship', 0.1, 4)])
def test_odd_values_far_outside_add_up_to_no_stick_slip(
    bearing: str, period: float, every: int, odd: str
) -> None:
    """The median is right all the time."""
    speed, load = _speed(bearing, period, 120.0, 2.0), _loaded(bearing, 120.0, period)
    rows = range(9, len(speed), every)
    if odd == 'speed':
        speed = _with_odd(speed, rows, _rpm(bearing, 0.05))
    else:
        load = _with_odd(load, rows, _nominal(bearing, 20.0))
    heard = Heard(_config(bearing), speed + load)
    assert heard.onsets == []
    assert heard.seconds(['bistable']) == 0.0


@pytest.mark.parametrize('period', [0.1, 1.0])
def test_a_first_speed_that_is_odd_makes_no_stick_slip(period: float) -> None:
    """A filter of a tachometer starts at zero."""
    assert _hear('reference', 60.0, lambda t: 2.0 if t else 0.05, None, period, 0.1).onsets == []


@pytest.mark.parametrize('period', [10.0, 20.0])
@pytest.mark.parametrize('step', [-3600.0, -120.0])
def test_slow_inputs_are_heard_though_the_clock_is_set_back_at_once(
    period: float, step: float
) -> None:
    """In a recording, before anything is known of their pace."""
    own = _speed('table', period, 900.0, 0.4) + _loaded('table', 900.0, period)
    heard = Heard(_config('table'), [(t, q, s + step * (t > 25.0), n) for t, q, s, n in own])
    assert heard.statuses[-20:] == ['ACCEPTED'] * 20
    assert heard.monitor.condition(NAME) == 'stick_slip'


@pytest.mark.parametrize('apart', [50.0, 110.0, 250.0])
def test_a_loose_contact_is_no_slow_sensor(apart: float) -> None:
    """Two single values after a speed ten times a second; then it is dead."""
    last = 100.0 + 2.0 * apart
    messages = _every('speed', 0.1, 100.0, _rpm('ship', 2.0)) + _loaded('ship', last + 60.0, 0.1)
    messages += [(t, 'speed', t, _rpm('ship', 2.0)) for t in (100.0 + apart, last)]
    heard = Heard(_config('ship'), messages)
    assert heard.monitor.condition(NAME) == 'input_stale'
    assert heard.seconds(['normal'], last) < 15.0


@pytest.mark.parametrize('period', [2.0, 3.0, 4.8])
def test_values_in_pairs_are_no_odd_stamps(period: float) -> None:
    """Two of each input, 0.1 s apart, less often than once a second, as in a recording."""
    share, messages = _ramps([0, 100, 101], [2.0, 2.0, 0.4]), []
    for begin in (0.0, 0.1):
        messages += _every('speed', period, 200.0, lambda t: _rpm('ship', share(t)), begin)
        messages += _every('load', period, 200.0, _nominal('ship'), begin)
    heard = Heard(_config('ship'), messages)
    assert heard.statuses.count('ACCEPTED') > 0.95 * len(heard.statuses)
    assert heard.seconds(['input_stale']) == 0.0
    assert 100.0 < heard.first(STICKING) < 112.0


@pytest.mark.parametrize('period', [6.0, 30.0])
def test_values_slower_than_the_time_out_are_taken_without_a_clock(period: float) -> None:
    """Half an hour of both inputs, each later than the time-out of 5 s, as in a recording."""
    heard = _hear('ship', 1800.0, 0.4, None, period, period)
    assert heard.statuses.count('ACCEPTED') > 0.9 * len(heard.statuses)
    assert heard.monitor.condition(NAME) == 'stick_slip'


def test_a_level_without_a_threshold_ends_no_episode_that_it_began_in() -> None:
    """Its background is that of the episode: it is quiet, and has never risen."""
    heard = _hear('ship', 200.0, 0.4, lambda t: 90.0 + math.sin(t), **MILLIMETRES)
    bearing = heard.monitor.bearings[NAME]
    assert heard.monitor.condition(NAME) == 'stick_slip'
    assert 'does its sensor reach the bearing?' in bearing.text()


def test_a_level_that_is_always_loud_is_named_where_all_seems_well() -> None:
    loud = MILLIMETRES | {'level__threshold': 10.0}
    heard = _hear('ship', 600.0, 2.0, lambda t: 30.0 + math.sin(t), **loud)
    text = heard.monitor.bearings[NAME].text()
    assert 'The level is high where no stick-slip can exist' in text


@pytest.mark.parametrize('pause', [-3600.0, 5.0, 60.0, 200.0])
def test_a_restart_in_an_episode_goes_on_and_blames_no_input(pause: float) -> None:
    heard = _bistable_and_sticking('steep')
    kept = json.loads(json.dumps(heard.monitor.bearings[NAME].state.record()))
    heard.monitor, before = Monitor(_config('steep'), {NAME: State.of_record(kept)}), heard.events
    heard.events, begin = [], 120.0 + pause
    heard.take(
        _every('speed', 0.25, begin + 60.0, _rpm('steep', 0.9), begin)
        + _loaded('steep', begin + 60.0, begin=begin)
    )
    assert before
    assert heard.events == []
    assert heard.monitor.condition(NAME) == 'stick_slip'
    # Of inputs that stay away the time-out counts from the restart.
    dead = Monitor(_config('steep'), {NAME: State.of_record(kept)})
    assert dead.advance(round((begin + 4.0) * SECOND)) == []
    assert dead.advance(round((begin + 8.0) * SECOND)) == []
    assert [str(e.after) for e in dead.advance(round((begin + 10.0) * SECOND))] == ['input_stale']


def test_a_clock_set_back_by_less_than_a_long_time_out_delays_nothing() -> None:
    speed = _speed('ship', 0.2, 200.0, lambda t: 2.0 if t < 105.0 else 0.4)
    messages = speed + _loaded('ship', 200.0, 0.2)
    back = [(t, q, s - (50.0 if t > 100.0 else 0.0), n) for t, q, s, n in messages]
    config = _config('ship', speed__timeout=60.0, load__timeout=60.0)
    first = [Heard(config, given).first(STICKING) for given in (back, messages)]
    assert first[0] == pytest.approx(first[1], abs=1.0)


def test_a_hold_up_before_the_first_message_is_no_time() -> None:
    monitor = Monitor(_config('ship'))
    monitor.bearings[NAME].excuse(5 * SECOND)
    assert monitor.advance(10**18) == []


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
    left, again = 60.0 + before, 960.0
    heard = Heard(
        _config('ship'),
        _every('speed', 0.1, 60.0, _rpm('ship', 1.5))
        + _every('speed', 0.1, left, _rpm('ship', 0.5), begin=60.0)
        + _loaded('ship', left, 0.1),
    )
    onsets = len(heard.onsets)
    heard.take(
        _every('speed', 0.1, again + 40.0, _rpm('ship', back), begin=again)
        + _loaded('ship', again + 40.0, 0.1, begin=again)
    )
    assert len(heard.onsets) == onsets
    assert heard.monitor.condition(NAME) == expected


def test_a_load_that_steps_is_one_onset_with_a_tolerance_too() -> None:
    """The probability follows the load by a lag of 4 s; growth does not."""

    def load(t: float) -> float:
        return 0.0 if t < 12.0 else _nominal('ship')

    messages = _every('speed', 0.1, 60.0, _rpm('ship', 0.5)) + _every('load', 0.1, 60.0, load)
    plain, believing = (
        Heard(_config('ship', **tolerance), messages)
        for tolerance in ({}, {'tolerance__load': 0.02})
    )
    assert believing.onsets == plain.onsets
    (onset,) = (event for event in believing.events if event.onset)
    assert 'possible with' not in onset.text
