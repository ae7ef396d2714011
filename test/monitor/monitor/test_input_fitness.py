# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from sending import configured

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.bearing_monitor import Monitor
from stickslip_monitor.monitor.config_questions import questions
from stickslip_monitor.monitor.input_faults import Graph, InputWatch
from stickslip_monitor.monitor.input_fitness import FitnessWatch, _is_regular, explained_share
from stickslip_monitor.monitor.sample_types import Input

SPEED, LOAD, LEVEL = Input.SPEED, Input.LOAD, Input.LEVEL
SECOND = 10**9
TIMES = np.arange(0.0, 1200.0, 0.1)
"""Twenty minutes at 10 Hz [s]."""


def load_in_swell(time: FloatArray) -> FloatArray:
    """Return a load in waves of 8.3 s, whose height comes and goes [N]."""
    return np.asarray(1000.0 + 200.0 * np.sin(0.757 * time) * (1.0 + 0.3 * np.sin(0.031 * time)))


def clause_of(time: FloatArray, value: FloatArray, place: int = LOAD, part: int = 997) -> str:
    """Return what is reported of an input after its values, taken in parts."""
    watch, time_ns = FitnessWatch(), np.rint(time * SECOND).astype(np.int64)
    for k in range(0, time.size, part):
        watch.take_values(place, time_ns[k : k + part], value[k : k + part])
    return watch.clause(place)


@pytest.mark.parametrize('part', [1, 64, 100_000])
@pytest.mark.parametrize('place', [SPEED, LOAD])
def test_a_value_that_is_held_in_a_fast_message_is_named(place: int, part: int) -> None:
    held = load_in_swell(10.0 * np.floor(TIMES[:3000] / 10.0))
    assert clause_of(TIMES[:3000], held, place, part) == (
        'has a new value only every 10 s, though 10 messages a second come: have its sender pass on each'
        ' measurement, at least one a second'
    )


def test_slow_values_of_a_swell_are_named() -> None:
    slow = np.arange(0.0, 1200.0, 8.0)
    clause = clause_of(slow, load_in_swell(slow))
    assert clause.startswith('has a value only every 8 s and changes by ')
    assert clause.endswith(
        ', so that a swell seems to last for minutes: have its sender pass on at least one a second'
    )


@pytest.mark.parametrize(
    ('off', 'even', 'is_regular'), [(2, 6, True), (3, 6, False), (2, 7, False), (0, 0, False)]
)
def test_a_slow_sensor_has_a_regular_pace_and_uneven_steps(off: int, even: int, is_regular: bool) -> None:
    # At least 10 of 12 intervals must be alike, and 6 changes half as large again as the least; equal changes
    # are a ramp.
    gap = np.array([[1.5] * off + [1.0] * (10 - off) + [2.0] * 2])
    step = np.where(np.arange(12) < (even or 12), 1.0, 1.5)[None]
    assert _is_regular(gap, step).tolist() == [is_regular]


@pytest.mark.parametrize('part', [1, 5, 1000])
@pytest.mark.parametrize(('gap', 'named'), [(60.0, '60'), (3.0, '3'), (2.9, ''), (0.5, '')])
@pytest.mark.parametrize('swing', [0.0, 1.0])
def test_a_level_that_comes_slowly_is_named(gap: float, named: str, swing: float, part: int) -> None:
    # Thirteen values end a dozen intervals, whatever they are: a quiet level may stand still.
    time = gap * np.arange(13)
    level = -40.0 + swing * np.sin(time)
    clause = (
        f'has a value only every {named} s, and a vibration shows by two of them: have its sender pass on at'
        ' least one a second'
    )
    assert clause_of(time, level, LEVEL, part) == (clause if named else '')
    assert clause_of(time[:12], level[:12], LEVEL, part) == ''


RANDOM = np.random.default_rng(7)
HONEST = {
    'each measurement': (TIMES, load_in_swell(TIMES)),
    'steady': (TIMES, np.full(TIMES.size, 60.0)),
    'a slow ramp of whole revolutions': (TIMES, np.round(60.0 - TIMES / 40.0)),
    'noise in whole revolutions': (TIMES, np.round(60.0 + 0.4 * RANDOM.standard_normal(TIMES.size))),
    'slow, and steady but for a thousandth': (TIMES[::100], 1e3 + RANDOM.standard_normal(TIMES[::100].size)),
    'slow, and falling': (TIMES[::100], 1000.0 - TIMES[::100] / 2.0),
    # Orders of the telegraph: steps of any size at any time.
    'steps now and then': (
        TIMES,
        RANDOM.uniform(20.0, 90.0, 60)[np.searchsorted(np.cumsum(RANDOM.exponential(25.0, 59)), TIMES)],
    ),
}


@pytest.mark.parametrize('name', HONEST)
def test_honest_values_are_not_named(name: str) -> None:
    assert clause_of(*HONEST[name]) == ''


def test_the_clause_on_held_values_is_withdrawn() -> None:
    watch, time_ns = FitnessWatch(), (TIMES * SECOND).astype(np.int64)
    watch.take_values(LOAD, time_ns, load_in_swell(10.0 * np.floor(TIMES / 10.0)))
    assert watch.clause(LOAD)
    watch.take_values(LOAD, time_ns + time_ns[-1] + 1, load_in_swell(TIMES))
    assert watch.clause(LOAD) == ''


def revisiting_speed(time: FloatArray) -> FloatArray:
    """Return a speed that passes the same values again and again, never at one pace [m/s]."""
    return np.asarray(0.2 + 0.08 * np.sin(0.011 * time) + 0.06 * np.sin(0.0043 * time + 1.0))


def test_a_load_that_follows_from_the_speed_alone_is_named() -> None:
    time = np.arange(0.0, 1100.0, 0.5)
    watch = FitnessWatch()
    watch.take_points(
        (time * SECOND).astype(np.int64), revisiting_speed(time), 20000.0 * revisiting_speed(time) ** 2
    )
    assert watch.clause(SPEED) == ''
    assert watch.clause(LOAD) == (
        'follows from the speed alone, so it is computed and does not show what the bearing carries: connect'
        ' a measured load, or give the largest one as load.constant'
    )


@pytest.mark.parametrize(
    ('load', 'share'),
    [
        # Its own course, in like speeds: little is explained.
        (lambda time, _: 1000.0 + 200.0 * np.sin(0.05 * time), (0.0, 0.5)),
        # A straight line of the speed: all of it.
        (lambda _, speed: 1000.0 * (0.3 + speed), (0.999999, 1.0)),
        (lambda _, speed: np.full(speed.size, 1000.0), None),
    ],
)
def test_the_share_of_a_load_that_the_speed_explains(
    load: Callable[[FloatArray, FloatArray], FloatArray], share: tuple[float, float] | None
) -> None:
    time = np.arange(0.0, 1024.0, 2.0)
    explained = explained_share(
        np.column_stack([time, revisiting_speed(time), load(time, revisiting_speed(time))])
    )
    assert (
        (explained is None)
        if share is None
        else (explained is not None and share[0] <= explained <= share[1])
    )


def test_one_passage_is_no_evidence() -> None:
    # A load that falls while the speed falls: both are courses of the time.
    time = np.arange(0.0, 1024.0, 2.0)
    assert explained_share(np.column_stack([time, 1.0 - time / 2000.0, 1000.0 - time / 3.0])) is None


def test_a_slow_load_is_reported_live_and_no_verdict_changes() -> None:
    monitor = Monitor(configured())
    bearing = monitor.bearings['aft']
    watch, texts = InputWatch(monitor.bearings, Graph()), list[str]()
    for k, time in enumerate(TIMES[:3000].tolist()):
        now_ns = round(time * SECOND)
        for place, value in ((SPEED, 0.5), (LOAD, float(load_in_swell(np.array(10.0 * (time // 10.0)))))):
            bearing.update(place, now_ns, value)
            assert watch.take('aft', place, value, now_ns, 0, valid=True) is None
        if k % 10 == 9:
            faults = watch.check_inputs(now_ns, without_clock=False)
            texts += [text for _, text, is_over in faults if not is_over]
    assert len(texts) == 1
    assert texts[0].startswith('The load on /')
    assert 'has a new value only every 10 s' in texts[0]
    assert bearing.condition == 'normal'


def test_a_slow_level_is_reported_live() -> None:
    monitor = Monitor(configured(level__topic='/level'))
    watch, texts = InputWatch(monitor.bearings, Graph()), list[str]()
    for k in range(900):
        for place, value in ((SPEED, 0.5), (LOAD, 1000.0), (LEVEL, 0.01 + 1e-6 * k))[: 2 + (k % 60 == 0)]:
            monitor.bearings['aft'].update(place, k * SECOND, value)
            watch.take('aft', place, value, k * SECOND, 0, valid=True)
        faults = watch.check_inputs(k * SECOND, without_clock=False)
        texts += [text for _, text, is_over in faults if 'level' in text and not is_over]
    # Until its pace is known it is lost now and then.
    assert [text for text in texts if text != 'No messages on /level.'] == [
        'The level on /level has a value only every 60 s, and a vibration shows by two of them: have its'
        ' sender pass on at least one a second.'
    ]


@pytest.mark.parametrize(
    ('topic', 'named'),
    [('/shaft/speed_avg', 'avg'), ('/Mean/speed', 'Mean'), ('/meander', ''), ('/shaft/speed', '')],
)
def test_a_name_that_says_average_raises_a_question(topic: str, named: str) -> None:
    (bearing,) = configured(speed__topic=topic).bearings
    texts = [text for text in questions(bearing, 0.0)['speed'] if 'average' in text]
    assert [f"'{named}'" in text for text in texts] == [True] * bool(named)
