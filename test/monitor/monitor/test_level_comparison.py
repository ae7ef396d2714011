# SPDX-License-Identifier: Apache-2.0
"""Levels of several bearings: which one vibrates, and which only hears it; live as over a recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from sending import SECOND, T0, every, stream_of
from shared import REFERENCE

from stickslip_monitor import Monitor, MonitorConfig, Sample, Stream, build_config
from stickslip_monitor.monitor.level_comparison import LevelComparison
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.monitor.rule_state import DOUBT, State
from stickslip_monitor.monitor.sample_types import INPUTS, Input, Status
from stickslip_monitor.monitor.severity import Condition, Measured, Unknown
from stickslip_monitor.offline.check import RecordingBuffer, check_recording

TIMEOUT = 5.0
Rows = list[tuple[int, int, float]]
"""Of successive levels the bearing's index, the arrival [ns] and the number."""


def ship(**thresholds: float) -> MonitorConfig:
    """Build bearings with a level each, by name their thresholds [mm/s], nan for none."""
    values: dict[str, object] = {'bearings': [*thresholds]}
    for name, threshold in thresholds.items():
        values |= {f'{name}.{key}': value for key, value in REFERENCE.items()}
        values |= {f'{name}.speed.topic': '/speed', f'{name}.load.topic': f'/{name}/load'}
        values |= {f'{name}.level.topic': f'/{name}/level', f'{name}.level.unit': 'mm/s'}
        values |= {f'{name}.level.timeout': TIMEOUT}
        if threshold == threshold:
            values[f'{name}.level.threshold'] = threshold
    return build_config(values)


def rivals_live(bearings: tuple[BearingConfig, ...], rows: Rows) -> list[float]:
    comparison = LevelComparison(bearings)
    return [comparison.take(bearings[row].name, arrival, number) for row, arrival, number in rows]


def expected_rivals(thresholds: list[float], rows: Rows) -> list[float]:
    """Return the same by looking back from each level over all before, inputs without a limit or scale."""
    expected = []
    for k, (row, arrival, _) in enumerate(rows):
        excesses = [math.nan]
        for other_row in set(range(len(thresholds))) - {row}:
            valid = [(t, v) for r, t, v in rows[:k] if r == other_row and 0.0 <= v < 1e9]
            if not valid:
                continue
            (came, value), gap = valid[-1], valid[-1][0] - valid[-2][0] if len(valid) > 1 else 0
            same = next((i for i, (_, v) in enumerate(reversed(valid)) if v != value), len(valid))
            limit = max(TIMEOUT * SECOND, min(2.5 * gap, 300 * SECOND))
            if abs(arrival - came) <= limit and came - valid[-same][0] <= 600 * SECOND:
                excesses.append(
                    20.0 * math.log10(max(value, 1e-20)) - 20.0 * math.log10(thresholds[other_row])
                )
        expected.append(float(np.fmax.reduce(excesses)))
    return expected


def drawn_rows(seed: int, bearings: int) -> Rows:
    """Return levels at random times, some at one time or after the clock was set, held, or no value."""
    rng = np.random.default_rng(seed)
    gaps = rng.choice([0.0, 0.5, 1.0, 5.0, 5.0 + 1e-9, 12.0, 90.0, 400.0, -30.0], 400)
    arrivals = T0 + np.cumsum(np.rint(gaps * SECOND)).astype(np.int64)
    numbers = rng.choice([0.0, 0.5, 1.0, 2.0, 4.0, 4.0, 4.0, math.nan, -1.0, 65535.0 * 1e10], 400)
    rows = rng.integers(bearings, size=400)
    rows[rng.random(400) < 0.5] = 0
    return list(zip(rows.tolist(), arrivals.tolist(), numbers.tolist(), strict=True))


@pytest.mark.parametrize('seed', range(12))
def test_the_loudest_other_level_counts_live_in_blocks_and_compiled(seed: int) -> None:
    thresholds = {'a': 1.0, 'b': 2.0, 'c': math.nan} if seed % 2 else {'a': 1.0, 'b': 0.5}
    bearings = ship(**thresholds).bearings
    rows = drawn_rows(seed, len(bearings))
    live = rivals_live(bearings, rows)
    np.testing.assert_allclose(live, expected_rivals(list(thresholds.values()), rows), rtol=0, atol=1e-9)
    assert 20 < np.isfinite(live).sum() < 400
    for long in (False, True):
        comparison = LevelComparison(bearings, long=long)
        joined = np.full(len(rows), -math.inf)
        edges = [0, 7, 7, 200, len(rows)]
        for begin, end in pairwise(edges):
            of = np.array([row for row, *_ in rows[begin:end]], int)
            place = np.arange(begin, end)
            columns = {}
            for k, bearing in enumerate(bearings):
                at = place[of == k]
                arrivals, numbers = ([rows[i][part] for i in at] for part in (1, 2))
                columns[bearing.name] = at, np.array(arrivals, np.int64), np.array(numbers, float)
            block = comparison.take_columns(columns)
            for k, bearing in enumerate(bearings):
                joined[place[of == k]] = block[bearing.name]
        assert joined.tobytes() == np.array(live).tobytes()


def test_bearings_with_one_level_are_not_compared() -> None:
    a, b = ship(a=1.0, b=4.0).bearings
    assert a.level is not None
    assert b.level is not None
    shared = a, replace(b, level=replace(b.level, topic=a.level.topic))
    assert np.isnan(rivals_live(shared, [(0, T0, 9.0), (1, T0, 9.0), (0, T0 + 1, 9.0)])).all()
    # A third one that hears for itself is compared with both, and they with it.
    (third,) = ship(c=1.0).bearings
    rivals = rivals_live((*shared, third), [(0, T0, 10.0), (1, T0, 10.0), (2, T0, 1.0), (0, T0, 10.0)])
    assert rivals == pytest.approx([math.nan, math.nan, 20.0, 0.0], nan_ok=True)


@pytest.mark.parametrize(
    ('after', 'held', 'counts'), [(5.0, 0.0, True), (5.1, 0.0, False), (1.0, 600.1, False)]
)
def test_a_level_that_is_silent_or_stuck_decides_nothing(after: float, held: float, counts: bool) -> None:
    times = np.arange(0.0, held + 0.1, 0.1)
    rows = [(1, T0 + round(t * SECOND), 10.0) for t in times.tolist()]
    rival = rivals_live(ship(a=1.0, b=1.0).bearings, [*rows, (0, rows[-1][1] + round(after * SECOND), 1.0)])[
        -1
    ]
    assert (rival == pytest.approx(20.0)) is counts
    assert held == 0.0 or held * SECOND > DOUBT


def level_in(quiet: float, loud: float, begin: float, end: float) -> Callable[[float], float]:
    """Return a level that is loud for some time [s], with a ripple, as that of a sensor is never the same."""
    return lambda t: (loud if begin <= t < end else quiet) * (1.0 + 0.01 * math.sin(7.0 * t))


def sail(config: MonitorConfig, levels: dict[str, Callable[[float], float]], end: float) -> dict[str, Stream]:
    """Return ten minutes of quiet at a fast shaft, then a slowing down into the bistable range to stay."""

    def rpm(time: float) -> float:
        return float(np.interp(time, [700.0, 760.0], [80.0, 37.0]))

    streams = {}
    for name, level in levels.items():
        messages = [
            *every(Input.SPEED, 0.5, end, rpm),
            *every(Input.LOAD, 0.5, end, 1000.0, begin=0.1),
            *every(Input.LEVEL, 0.5, end, level, begin=0.2),
        ]
        streams[name] = stream_of(sorted(messages), T0)
    return streams


def sail_live(config: MonitorConfig, streams: dict[str, Stream]) -> Monitor:
    """Send all samples to a monitor in order of arrival, at one time in that of the bearings."""
    monitor = Monitor(config)
    samples = [
        Sample(name, INPUTS[place], stamp, value, arrival)
        for name, s in streams.items()
        for stamp, place, value, arrival in zip(
            s.time_ns.tolist(), s.inputs.tolist(), s.value.tolist(), s.arrival_ns.tolist(), strict=True
        )
    ]
    for sample in sorted(samples, key=lambda sample: sample.arrival_ns or 0):
        monitor.update(sample)
    return monitor


def conditions_of(monitor: Monitor, streams: dict[str, Stream]) -> dict[str, list[Condition]]:
    scans = monitor.scan(streams)
    return {name: [event.after for event in scan.events] for name, scan in scans.items()}


KNOCKED = level_in(1.0, 100.0, 850.0, 1e9)
"""Stick-slip by a shock in the bistable range, at the level of a cycle."""


def test_only_the_bearing_that_vibrates_is_in_stick_slip() -> None:
    # The one hears half of what the other does: by its level alone it would be in stick-slip as well.
    config = ship(aft=40.0, fore=40.0)
    levels = {'aft': KNOCKED, 'fore': level_in(1.0, 50.0, 850.0, 1e9)}
    streams = sail(config, levels, 1000.0)
    conditions = conditions_of(Monitor(config), streams)
    assert Condition.STICK_SLIP in conditions['aft']
    assert Condition.STICK_SLIP not in conditions['fore']
    alone = replace(config, bearings=config.bearings[1:])
    assert Condition.STICK_SLIP in conditions_of(Monitor(alone), {'fore': streams['fore']})['fore']
    live = sail_live(config, streams).bearings
    assert live['aft'].condition is Condition.STICK_SLIP
    assert (live['fore'].condition, live['fore'].measured) == (Condition.BISTABLE, Measured.UNKNOWN)
    assert (live['aft'].unknown, live['fore'].unknown) == (None, Unknown.OTHER)


@pytest.mark.parametrize('louder', [1.0, 1.3])
def test_bearings_that_vibrate_at_once_are_both_heard(louder: float) -> None:
    config = ship(aft=40.0, fore=40.0)
    streams = sail(config, {'aft': KNOCKED, 'fore': level_in(1.0, 100.0 * louder, 850.0, 1e9)}, 1000.0)
    conditions = conditions_of(Monitor(config), streams)
    assert all(Condition.STICK_SLIP in events for events in conditions.values())


def test_a_bearing_is_heard_again_when_the_other_has_stopped() -> None:
    # What it heard of the other one has taught it no background.
    config = ship(aft=40.0, fore=40.0)

    def fore(time: float) -> float:
        return level_in(1.0, 50.0, 200.0, 650.0)(time) if time < 700.0 else KNOCKED(time)

    conditions = conditions_of(
        Monitor(config), sail(config, {'aft': level_in(1.0, 100.0, 200.0, 650.0), 'fore': fore}, 1000.0)
    )
    assert Condition.STICK_SLIP in conditions['fore']


@pytest.mark.parametrize('threshold', [math.nan, 400.0])
def test_without_a_threshold_or_with_a_higher_one_the_other_decides_nothing(threshold: float) -> None:
    config = ship(aft=threshold, fore=40.0)
    streams = sail(config, {'aft': KNOCKED, 'fore': level_in(1.0, 50.0, 850.0, 1e9)}, 1000.0)
    assert Condition.STICK_SLIP in conditions_of(Monitor(config), streams)['fore']


def test_a_new_threshold_counts_from_the_next_level_on() -> None:
    config = ship(a=1.0, b=1.0)
    comparison = LevelComparison(config.bearings)
    comparison.take('b', T0, 10.0)
    comparison.retune(ship(a=1.0, b=10.0).bearings)
    assert comparison.take('a', T0, 1.0) == pytest.approx(0.0)


def test_a_lead_survives_a_restart() -> None:
    state = State()
    state.rival, state.lead = 12.5, 7.25
    restored = State.of_record(state.record())
    assert (restored.rival, restored.lead) == (12.5, 7.25)


@pytest.mark.parametrize('long', [False, True])
def test_a_recording_gives_what_came_live(long: bool, tmp_path: Path) -> None:
    # Rows of one time, of both bearings; levels that are lost, and of which some are no value.
    config = ship(aft=40.0, fore=40.0)
    rng = np.random.default_rng(11)
    streams = sail(config, {'aft': KNOCKED, 'fore': level_in(1.0, 50.0, 850.0, 1e9)}, 1100.0)
    for name, stream in streams.items():
        is_level = stream.inputs == Input.LEVEL
        seconds = (stream.arrival_ns - T0) / SECOND
        values = np.where(is_level & (rng.random(seconds.size) < 0.05), -1.0, stream.value)
        keep = ~(is_level & (name == 'aft') & (seconds > 950.0) & (seconds < 1040.0))
        columns = (column[keep] for column in (stream.time_ns, stream.inputs, values, stream.arrival_ns))
        streams[name] = Stream(*columns)
    rows, topics = [], {'speed': '/speed', 'load': '/{}/load', 'level': '/{}/level'}
    for order, (name, stream) in enumerate(streams.items()):
        for time, place, value in zip(stream.arrival_ns.tolist(), stream.inputs, stream.value, strict=True):
            if order == 0 or place != Input.SPEED:
                topic = topics[INPUTS[place]].format(name)
                rows.append((time, order, f'{time},{topic},{float(value)!r}'))
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join(['time,tag,value', *(text for *_, text in sorted(rows)), '']))
    buffer = RecordingBuffer()
    check_recording(path, config, [buffer], long=long)
    live = sail_live(config, streams)
    whole = live.scan(streams)
    for name in streams:
        scan = buffer.scan(name)
        assert np.array(scan.measured).tolist() == np.array(whole[name].measured).tolist()
        assert [event.text for event in scan.events] == [event.text for event in whole[name].events]
        assert live.bearings[name].condition is scan.events[-1].after
        assert (np.array(scan.status) == Status.BELOW_MINIMUM).sum() > 20
    # Without the louder one's level the other is taken for stick-slip: nobody else is heard.
    assert Condition.STICK_SLIP in [event.after for event in buffer.scan('fore').events]
