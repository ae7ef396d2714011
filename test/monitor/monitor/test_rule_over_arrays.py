# SPDX-License-Identifier: Apache-2.0
"""One rule: sample by sample, over a recording in any blocks, interpreted and compiled."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from sending import points
from sequences import COUNT, NAME, SECOND, Bits, Messages, sequence
from shared import CONFIG, REFERENCE

from stickslip_monitor import Monitor, Stream, build_config
from stickslip_monitor.monitor import rule_state
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.rule_over_arrays import BearingScan, Scan
from stickslip_monitor.monitor.sample_types import Status

# Every kind of sequence in turn; 16 and 5 have no common divisor with the number of kinds.
NUMBERS = range(3, COUNT, 16)
COMPILED = range(1, COUNT, 5)
COLUMNS = ('time_ns', 'until_ns', 'speed', 'load', 'chances', 'rung', 'sticking', 'sample', 'status')


def stream_of_messages(messages: Messages) -> Stream:
    return Stream(messages.time_ns, messages.quantity, messages.value, arrival_ns=messages.arrival_ns)


def comparable_events(events: list[Any]) -> list[Any]:
    return [(e.time_ns, e.before, e.after, e.standing.sticking, e.lost, e.onset, e.text) for e in events]


def _require_same(actual: Scan, expected: Scan) -> None:
    for name in COLUMNS:
        assert getattr(actual, name).tobytes() == getattr(expected, name).tobytes(), name
    assert actual.counts.tolist() == expected.counts.tolist()
    assert (actual.measured is None) == (expected.measured is None)
    if actual.measured is not None and expected.measured is not None:
        assert actual.measured.tolist() == expected.measured.tolist()
    assert (actual.at, actual.unknown) == (expected.at, expected.unknown)
    assert comparable_events(actual.events) == comparable_events(expected.events)


@pytest.mark.parametrize('number', NUMBERS)
def test_sample_by_sample_equals_a_recording(number: int) -> None:
    case = sequence(number)
    monitor = Monitor(case.config)
    events = [] if case.start_ns is None else monitor.advance(case.start_ns)
    statuses, points = [], []
    for sample in case.samples():
        update = monitor.update(sample)
        events += update.events
        statuses.append(int(update.status))
        if update.verdict is not None:
            points.append((update.verdict.time_ns, monitor.bearings[NAME].rung))
    events += monitor.advance(case.end_ns)
    scan = monitor.scan({NAME: stream_of_messages(case.messages)}, case.start_ns, case.end_ns)[NAME]
    assert scan.status.tolist() == statuses
    assert list(zip(scan.time_ns.tolist(), scan.rung.tolist(), strict=True)) == points
    assert scan.counts.tolist() == monitor.bearings[NAME].counts.tolist()
    assert comparable_events(scan.events) == comparable_events(events)


@pytest.mark.parametrize('number', COMPILED)
def test_compiled_equals_interpreted(number: int) -> None:
    case = sequence(number)
    (config,) = case.config.bearings
    interpreted, compiled = (
        BearingScan(config, case.start_ns, long=long).finish(stream_of_messages(case.messages), case.end_ns)
        for long in (False, True)
    )
    _require_same(interpreted, compiled)


@pytest.mark.slow
def test_compiled_amplitudes_raise_the_same_alarm() -> None:
    # At 38 rpm and 1000 N the lining vibrates by 1.0002 mm (test_cycles), and 0.9 mm are allowed.
    (config,) = load_config(CONFIG).bearings
    stream = points([20.0] * 60 + [38.0] * 40, 1000.0)
    interpreted, compiled = (BearingScan(config, 0, long=long).finish(stream, None) for long in (False, True))
    assert [str(event.after) for event in interpreted.events][-1] == 'amplitude_limit'
    _require_same(interpreted, compiled)


@pytest.mark.parametrize('number', NUMBERS)
def test_any_cut_into_blocks_is_the_same(number: int) -> None:
    case, bits = sequence(number), Bits(number + 1000)
    (config,) = case.config.bearings
    size = case.messages.value.size
    unsplit = BearingScan(config, case.start_ns).finish(stream_of_messages(case.messages), case.end_ns)
    edges = [0, *sorted(bits.below(size + 1) for _ in range(5)), 1, size]
    scan = BearingScan(config, case.start_ns)
    blocks = [stream_of_messages(case.messages[a:b]) for a, b in pairwise(sorted(edges))]
    parts = [*map(scan.take, blocks[:-1]), scan.finish(blocks[-1], case.end_ns)]
    for name in COLUMNS:
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert joined.tobytes() == getattr(unsplit, name).tobytes(), name
    assert sum(part.counts for part in parts).tolist() == unsplit.counts.tolist()
    assert [at for part in parts for at in part.at] == unsplit.at
    assert comparable_events([e for part in parts for e in part.events]) == comparable_events(unsplit.events)


def test_inputs_that_never_come_are_lost_by_the_end() -> None:
    case = sequence(0)
    scan = Monitor(case.config).scan({NAME: stream_of_messages(case.messages[:0])}, 0, 60 * SECOND)[NAME]
    (event,) = scan.events
    inputs = {'speed': case.config.bearings[0].speed, 'load': case.config.bearings[0].load}
    # As it is when the first of them is lost.
    first = min(channel.timeout_ns for channel in inputs.values())
    assert (str(event.after), event.time_ns) == ('input_stale', first)
    assert set(event.lost) == {n for n, channel in inputs.items() if channel.timeout_ns == first}


def test_an_index_of_the_rule_is_a_plain_number() -> None:
    """numba takes an enumeration as an index from some version after 0.60 on; 0.57 is supported."""
    assert {type(place) for place in (rule_state.SPEED, rule_state.LOAD, rule_state.LEVEL)} == {int}


def test_a_load_from_a_table_is_interpolated_at_each_speed() -> None:
    # Expected by numpy's interpolation, live and compiled; a number that is no speed brings no load.
    rng, table = np.random.default_rng(50), [[0, 3], [20, 2.5], [60, 0.8], [120, 0.4]]
    values = {'bearings': ['aft']} | {f'aft.{name}': value for name, value in REFERENCE.items()}
    del values['aft.load.topic']
    values |= {'aft.load.over_speed': table, 'aft.load.unit': 'kN', 'aft.speed.scale': -2.0}
    (config,) = build_config(values).bearings
    numbers = np.concatenate([rng.uniform(-80.0, 80.0, 400), [0.0, 1e9, math.nan, 10.0, -30.0]])
    count = np.arange(numbers.size)
    stream = Stream(
        np.repeat(count * SECOND, 2), np.tile([0, 1], count.size).astype(np.int8), np.repeat(numbers, 2)
    )
    interpreted, compiled = (BearingScan(config, 0, long=long).finish(stream, None) for long in (False, True))
    _require_same(interpreted, compiled)
    status = interpreted.status.reshape(-1, 2)
    assert (status[:, 0] == status[:, 1]).all()  # implausible, not finite: the load is as valid as the speed
    assert set(status[:, 0].tolist()) == {Status.ACCEPTED, Status.IMPLAUSIBLE, Status.NOT_FINITE}
    # Each valid speed makes one point, with the load there.
    speeds = np.abs(-2.0 * numbers[status[:, 0] == Status.ACCEPTED])
    speeds[speeds * config.speed.factor < config.speed.deadband] = 0.0
    assert np.abs(interpreted.speed) == pytest.approx(speeds * config.speed.factor, rel=1e-12)
    rpm, table_load = np.array(table).T
    assert interpreted.load == pytest.approx(1e3 * np.interp(speeds, rpm, table_load), rel=1e-12)
