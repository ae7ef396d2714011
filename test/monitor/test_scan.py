# SPDX-License-Identifier: Apache-2.0
"""Batch and stream are one thing: scan() and update() agree to the last bit on any recording."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_monitor import Assessment, Monitor, MonitorConfig, Sample, Stream, build_config
from stickslip_monitor.monitor.assessment import COLUMNS
from stickslip_monitor.monitor.scan import BearingScan
from stickslip_monitor.monitor.signals import NO_LEVELS, QUANTITIES, Levels, Status

SECOND = 10**9
_PARAMETERS = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction.static': 0.3,
    'friction.kinetic': 0.1,
    'friction.decay': 10.0,
    'speed.topic': '/n',
    'speed.unit': 'rpm',
    'speed.timeout': 3.0,
    'speed.maximum': 2.0,
    'load.topic': '/f',
    'load.unit': 'N',
    'load.timeout': 4.0,
    'alarm.on_delay': 1.5,
    'alarm.off_delay': 2.5,
    'alarm.amplitude_limit': 0.8e-3,
    'alarm.minimum_speed': 1e-3,
}


def _config(**changes: Any) -> MonitorConfig:
    values = _PARAMETERS | {key.replace('__', '.'): value for key, value in changes.items()}
    return build_config({'bearings': ['b']} | {f'b.{k}': v for k, v in values.items()})


_steps = st.sampled_from([0, 1, SECOND // 10, SECOND // 2, SECOND, 2 * SECOND, 5 * SECOND])
_back = st.sampled_from([0, 0, 0, 0, 0, SECOND // 2, SECOND, 6 * SECOND, 100 * SECOND])
_rpm = st.sampled_from([0.0, 0.1, 20.0, 29.0, 32.0, 35.0, 40.0, 41.0, 44.5, 46.0, -20.0, 60.0])
_odd = st.sampled_from([math.nan, math.inf, 1e6, -math.inf])
_load = st.sampled_from([1000.0, 1000.0, 1000.0, 700.0, 400.0, 0.0, -5.0])


@st.composite
def _recordings(draw: Any) -> Stream:
    n = draw(st.integers(0, 40))
    now, times, loads, values = 0, [], [], []
    for _ in range(n):
        now += draw(_steps)
        is_load = draw(st.booleans())
        value = draw(_load if is_load else _rpm)
        if draw(st.integers(0, 15)) == 0:
            value = draw(_odd)
        back = draw(_back)
        times.append(now - back)
        if back > 4 * SECOND and draw(st.booleans()):
            now -= back
        loads.append(is_load)
        values.append(value)
    return Stream(np.array(times, np.int64), np.array(loads, bool), np.array(values, float))


@st.composite
def _voyages(draw: Any) -> Stream:
    """Minutes of telemetry that moves about the boundaries, with odd values and jumps."""
    period = draw(st.sampled_from([SECOND // 10, SECOND // 3, SECOND, 5 * SECOND // 2]))
    lag = draw(st.sampled_from([0, period // 3]))
    levels = draw(st.lists(st.sampled_from([15.0, 25.0, 30.0, 34.0, 42.0, 60.0]), min_size=2))
    count = draw(st.integers(20, 150))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    speed = np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(levels)), levels)
    odd = rng.random((2, count)) < draw(st.sampled_from([0.0, 0.03, 0.3]))
    speed = np.where(odd[0], rng.choice([0.0, 60.0, 20.0, np.nan], count), speed)
    load = 1000.0 + draw(st.sampled_from([0.0, 300.0])) * rng.standard_normal(count)
    load = np.where(odd[1], rng.choice([0.0, 2500.0], count), load)
    time = np.arange(count) * period
    times = np.stack([time, time + lag], axis=1).reshape(-1)
    if draw(st.booleans()):
        # A replay that starts over, and a gap.
        times[count:] -= draw(st.sampled_from([200, -7])) * SECOND
    values = np.stack([speed, load], axis=1).reshape(-1)
    return Stream(times.astype(np.int64), np.arange(2 * count) % 2 == 1, values)


@st.composite
def _levels(draw: Any, stream: Stream) -> Stream:
    """A measured level among the samples: noisy, stuck, lost, late, or of another clock."""
    n, rng = stream.time_ns.size, np.random.default_rng(draw(st.integers(0, 999)))
    m = draw(st.integers(0, 600))
    place = np.sort(rng.integers(0, n + 1, m))
    near = np.append(stream.time_ns, stream.time_ns[-1:] if n else 0)[place]
    within = np.arange(m) - np.searchsorted(place, place)
    step = draw(st.sampled_from([SECOND // 50, SECOND // 5, SECOND]))
    spread = draw(st.sampled_from([0, 0, SECOND // 10, 20 * SECOND]))
    late = draw(st.sampled_from([0, 0, -SECOND, 10 * SECOND, -10 * SECOND]))
    time = near + late + within * step + rng.integers(0, spread + 1, m)
    block = draw(st.sampled_from([20, 100]))
    loud = np.repeat(rng.random(m // block + 1) < 0.5, block)[:m]
    noise = 10.0 ** (draw(st.sampled_from([0.0, 0.02, 0.3])) * rng.standard_normal(m))
    value = np.where(loud, 1.0, 0.05) * noise
    odd = rng.random(m) < draw(st.sampled_from([0.0, 0.0, 0.1]))
    value = np.where(odd, rng.choice([math.nan, -1.0, 0.0, 1e30, 0.8, math.inf], m), value)
    if draw(st.booleans()):
        value[m // 2 :] = value[m // 2 : m // 2 + 1]
    return replace(stream, level=Levels(time.astype(np.int64), value, place))


def _bits(value: float) -> bytes:
    return np.float64(value).tobytes()


def _same_point(left: Assessment, right: Assessment) -> bool:
    return all(_bits(getattr(left, name)) == _bits(getattr(right, name)) for name in COLUMNS)


def _cut(stream: Stream, a: int, b: int, last: bool) -> Stream:
    """The samples from one to before another, and what came of the level among them."""
    found = Stream(stream.time_ns[a:b], stream.is_load[a:b], stream.value[a:b])
    if stream.level is None:
        return found
    own = stream.level
    rows = slice(*np.searchsorted(own.place, [a, stream.time_ns.size + 1 if last else b]))
    return replace(found, level=Levels(own.time_ns[rows], own.value[rows], own.place[rows] - a))


def _in_order(stream: Stream) -> Iterator[Sample]:
    """The samples as they come."""
    levels = stream.level or NO_LEVELS
    vibration = list(zip(levels.place.tolist(), levels.time_ns, levels.value, strict=True))
    for k in range(stream.time_ns.size + 1):
        while vibration and vibration[0][0] == k:
            _, time_ns, value = vibration.pop(0)
            yield Sample('b', 'level', int(time_ns), float(value))
        if k < stream.time_ns.size:
            quantity = QUANTITIES[int(stream.is_load[k])]
            yield Sample('b', quantity, int(stream.time_ns[k]), float(stream.value[k]))


@settings(max_examples=400, deadline=None)
@given(
    stream=_recordings() | _voyages() | (_recordings() | _voyages()).flatmap(_levels),
    delays=st.sampled_from(
        [{}, {'alarm__on_delay': 0.0, 'alarm__off_delay': 0.0}, {'alarm__onset_growth': 0.0}]
    ),
    level=st.sampled_from([{'level__threshold': 0.3}, {'level__timeout': 2.5}]),
    start=st.sampled_from([None, -20 * SECOND, -SECOND]),
    tail=st.sampled_from([0, SECOND, 60 * SECOND]),
)
def test_scan_equals_update(
    stream: Stream, delays: dict[str, Any], level: dict[str, Any], start: int | None, tail: int
) -> None:
    levels = stream.level
    config = _config(**delays, **({} if levels is None else {'level__topic': '/v', **level}))
    live = Monitor(config)
    if start is not None:
        live.advance(start)
    verdicts, events = [], []
    for sample in _in_order(stream):
        update = live.update(sample)
        events += update.events
        if update.verdict is not None:
            verdicts.append(update.verdict)
    now = live.bearings['b'].now_ns
    end = (now if now is not None else 0) + tail
    events += live.advance(end)
    scan = live.scan({'b': stream}, start, end)['b']

    assert scan.time_ns.tolist() == [v.time_ns for v in verdicts]
    assert scan.condition == [v.condition for v in verdicts]
    assert [repr(scan.course.at(k)) for k in range(len(verdicts))] == [
        repr(v.standing) for v in verdicts
    ]
    tracker = live.bearings['b'].level
    if tracker is not None:
        assert scan.level is not None
        assert scan.level.counts.tolist() == tracker.counts.tolist()
    for name in COLUMNS:
        column = getattr(scan.assessment, name)
        assert [_bits(x) for x in column] == [_bits(getattr(v.assessment, name)) for v in verdicts]
    assert scan.counts.tolist() == live.bearings['b'].gate.counts.tolist()
    assert [(e.time_ns, e.before, e.after, e.lost, e.sticking, e.text) for e in scan.events] == [
        (e.time_ns, e.before, e.after, e.lost, e.sticking, e.text) for e in events
    ]
    for batch, single in zip(scan.events, events, strict=False):
        assert (batch.assessment is None) == (single.assessment is None)
        if batch.assessment is not None and single.assessment is not None:
            assert _same_point(batch.assessment, single.assessment)


@settings(max_examples=400, deadline=None)
@given(
    stream=_recordings() | _voyages() | (_recordings() | _voyages()).flatmap(_levels),
    cuts=st.lists(st.integers(0, 300), max_size=6),
    delays=st.sampled_from(
        [{}, {'alarm__on_delay': 0.0, 'alarm__off_delay': 0.0}, {'alarm__onset_growth': 0.0}]
    ),
    level=st.sampled_from([{'level__threshold': 0.3}, {'level__timeout': 2.5}]),
    start=st.sampled_from([None, -20 * SECOND, -SECOND]),
)
def test_any_cut_into_blocks_gives_the_same_scan(
    stream: Stream,
    cuts: list[int],
    delays: dict[str, Any],
    level: dict[str, Any],
    start: int | None,
) -> None:
    own = {} if stream.level is None else {'level__topic': '/v', **level}
    (config,) = _config(**delays, **own).bearings
    end = int(stream.time_ns.max(initial=0)) + 60 * SECOND
    whole = BearingScan(config, start).finish(stream, end)
    edges = [0, *sorted(min(cut, stream.time_ns.size) for cut in cuts), stream.time_ns.size]
    blocks = [_cut(stream, a, b, last=k == len(cuts)) for k, (a, b) in enumerate(pairwise(edges))]
    scan = BearingScan(config, start)
    parts = [*map(scan.take, blocks[:-1]), scan.finish(blocks[-1], end)]

    for name in ('time_ns', 'until_ns', 'first', 'rung', 'sticking', 'status'):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert joined.tobytes() == getattr(whole, name).tobytes(), name
    for name in COLUMNS:
        joined = np.concatenate([getattr(part.assessment, name) for part in parts])
        assert joined.tobytes() == getattr(whole.assessment, name).tobytes(), name
    standings = [repr(p.course.at(k)) for p in parts for k in range(p.time_ns.size)]
    assert standings == [repr(whole.course.at(k)) for k in range(whole.time_ns.size)]
    assert sum(part.counts for part in parts).tolist() == whole.counts.tolist()
    if whole.level is not None:
        told = [part.level for part in parts if part.level is not None]
        for name in ('time_ns', 'changed_ns', 'code', 'status'):
            joined = np.concatenate([getattr(part, name) for part in told])
            assert joined.tobytes() == getattr(whole.level, name).tobytes(), name
    assert [repr(e) for part in parts for e in part.events] == [repr(e) for e in whole.events]


def test_counts_every_sample_under_its_status() -> None:
    times = np.array([0, 1, 1, 0, 2, 3, 4, -9 * SECOND], np.int64)
    value = np.array([20.0, math.nan, 20.0, 20.0, 1e9, 20.0, 20.0, 20.0])
    stream = Stream(times, np.zeros(8, bool), value)
    counts = Monitor(_config()).scan({'b': stream})['b'].counts[0]
    assert {status.name: int(counts[status]) for status in Status} == {
        'ACCEPTED': 4,
        'NOT_FINITE': 1,
        'IMPLAUSIBLE': 1,
        'OUT_OF_ORDER': 1,
        'REPEATED': 0,
        'CLOCK_JUMP': 1,
    }


def test_until_ends_where_an_input_is_lost() -> None:
    stream = Stream(
        np.array([0, 0, 2 * SECOND, 4 * SECOND], np.int64),
        np.array([False, True, False, False]),
        np.array([50.0, 1000.0, 50.0, 50.0]),
    )
    scan = Monitor(_config()).scan({'b': stream}, 0, 9 * SECOND)['b']
    # The speed of t = 4 s counts for 3 s, but the load of t = 0 only for 4 s.
    assert scan.time_ns.tolist() == [0, 2 * SECOND, 4 * SECOND]
    assert scan.until_ns.tolist() == [2 * SECOND, 4 * SECOND, 4 * SECOND]


def test_stream_columns_must_match() -> None:
    with pytest.raises(ValueError, match='one length'):
        Stream(np.zeros(2, np.int64), np.zeros(3, bool), np.zeros(2))
