# SPDX-License-Identifier: Apache-2.0
"""The truth in a recording, from bags written by hand; and verdicts on the recorder's clock.

These are held against the monitor fed with one message after the other.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_monitor.bags.encode import encode_string
from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.errors import BagError
from stickslip_monitor.lab.truth import TruthRecord, has_truth, on_recorder_clock, read_truth
from stickslip_monitor.monitor.bulk import Scan
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.monitor import BearingMonitor, Monitor
from stickslip_monitor.monitor.signals import Input, Stream
from stickslip_monitor.monitor.verdict import Event

SECOND = 1_000_000_000
EVENTS = '/truth/aft/events'


def event(name: str, second: float, **more: Any) -> str:
    record = {'schema': 'stickslip_monitor/truth/1', 'bearing': 'aft', 'event': name}
    return json.dumps(record | {'time': round(second * SECOND)} | more)


def write(
    path: Path, events: Sequence[tuple[float, str]], kind: str = 'std_msgs/msg/String'
) -> Path:
    """A bag of 100 s with events told at some seconds, and speed on a topic of its own."""
    with BagWriter(path) as writer:
        writer.add_topic('/shaft/speed', 'std_msgs/msg/Float64')
        writer.add_topic(EVENTS, kind)
        writer.write_float64s({'/shaft/speed': ([0, 100 * SECOND], [1.0, 2.0])})
        for second, text in events:
            writer.write(EVENTS, round(second * SECOND), encode_string(text))
    return path


def read(path: Path) -> TruthRecord:
    return read_truth(open_bag(path), 'aft')


SPAN = [(0, event('start', 0)), (90, event('end', 90))]
FIRST = [
    (11, event('first_stick', 10.5)),
    (21, event('last_stick', 20.25, sticks=7, sticking=0.3)),
]


@pytest.mark.parametrize(
    ('told', 'end', 'episodes'),
    [
        ([*SPAN, *FIRST, (50, event('first_stick', 49)), (60, event('last_stick', 59.5))], 90.0,
         [(10.5, 20.25), (49.0, 59.5)]),
        # An episode that goes on ends with the truth; of a recording that was cut, at its end.
        ([*SPAN, FIRST[0]], 90.0, [(10.5, 90.0)]),
        ([SPAN[0], FIRST[0]], 100.0, [(10.5, 100.0)]),
    ],
)  # fmt: skip
def test_episodes_and_span(
    tmp_path: Path, told: Any, end: float, episodes: list[tuple[float, float]]
) -> None:
    truth = read(write(tmp_path / 'a.mcap', sorted(told)))
    assert (truth.start_ns, truth.end_ns) == (0, end * SECOND)
    assert truth.episodes == tuple((a * SECOND, b * SECOND) for a, b in episodes)
    assert truth.amplitude.value.size == truth.fold_margin.time_ns.size == 0


def test_each_number_is_read_from_its_topic(tmp_path: Path) -> None:
    columns = {'hopf_margin': [np.inf, 0.3], 'fold_margin': [0.1, -0.2], 'amplitude': [0.0, 3e-4]}
    path = tmp_path / 'a.mcap'
    with BagWriter(path) as writer:
        writer.add_topic(EVENTS, 'std_msgs/msg/String')
        writer.write(EVENTS, 5, encode_string(event('start', 0)))
        for name, column in columns.items():
            writer.add_topic(f'/truth/aft/{name}', 'std_msgs/msg/Float64')
            writer.write_float64s({f'/truth/aft/{name}': ([5, 9], column)})
    truth = read(path)
    for name, column in columns.items():
        assert getattr(truth, name).time_ns.tolist() == [5, 9]
        assert getattr(truth, name).value.tolist() == column


def test_no_truth_is_named(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.mcap', [(0, event('start', 0))])
    assert not has_truth(open_bag(path), 'fore')
    with pytest.raises(BagError) as caught:
        read_truth(open_bag(path), 'fore')
    assert str(caught.value) == (
        f"bag '{path}' holds no truth about fore: topic '/truth/fore/events' is not in it; it is"
        ' about aft'
    )


@pytest.mark.parametrize(
    'text', ['', 'no json', '[]', '{}', '{"schema": "stickslip_monitor/truth/2"}',
             '{"schema": "stickslip_monitor/truth/1", "event": "start", "time": null}']
)  # fmt: skip
def test_events_of_another_kind_are_named(tmp_path: Path, text: str) -> None:
    path = write(tmp_path / 'a.mcap', [(0, text)])
    with pytest.raises(BagError) as caught:
        read(path)
    assert str(caught.value) == (
        f"topic '{EVENTS}' of bag '{path}' holds an event that is no stickslip_monitor/truth/1"
    )


def test_events_of_another_type_are_named(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.mcap', [], 'std_msgs/msg/Float64')
    with pytest.raises(BagError, match=r'is no std_msgs/msg/String$'):
        read(path)


# Verdicts on the recorder's clock.
ROOT = Path(__file__).resolve().parents[2]
CONFIG = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml')
BEARING = CONFIG.bearings[0]
START = 1_700_000_000 * SECOND
IntArray = NDArray[np.int64]


def recording(shift_s: NDArray[np.float64]) -> tuple[Stream, IntArray]:
    """Speed and load of 1 kN once a second each, at sine-like speeds across the bistable range.

    Args:
        shift_s: By how much the sensors' clock is off in each second [s].
    """
    second = np.repeat(np.arange(shift_s.size), 2)
    log = START + second * SECOND + np.tile([0, 200_000_000], shift_s.size)
    inputs = np.tile([Input.SPEED, Input.LOAD], shift_s.size)
    speed = np.interp(second % 120, [0, 20, 60, 80, 120], [60.0, 60.0, 25.0, 25.0, 60.0])
    stamp = log + np.rint(np.repeat(shift_s, 2) * SECOND).astype(np.int64)
    return Stream(stamp, inputs, np.where(inputs == Input.LOAD, 1000.0, speed)), log


def shifted(jumps: dict[int, float], seconds: int) -> NDArray[np.float64]:
    """What the clock is off by in each second, by the second of each change."""
    shift = np.zeros(seconds)
    for second, by in jumps.items():
        shift[second:] = by
    return shift


def scanned(stream: Stream, start_ns: int = START, end_ns: int | None = None) -> Scan:
    return Monitor(CONFIG).scan({BEARING.name: stream}, start_ns, end_ns)[BEARING.name]


def heard(stream: Stream, log: IntArray) -> list[tuple[Event, int, int]]:
    """Each event of the monitor's other door, with when the message before it and its own came."""
    monitor = BearingMonitor(BEARING)
    monitor.advance(START)
    found, before = [], START
    rows = zip(stream.inputs, stream.time_ns.tolist(), stream.value.tolist(), log, strict=True)
    for *sample, now in rows:
        found += [(event, before, int(now)) for event in monitor.update(*sample).events]
        before = int(now)
    return found


@pytest.mark.parametrize(
    ('shift', 'least'),
    [
        (shifted({100: -30.0}, 240), 3),
        (shifted({50: 3600.0, 90: -3600.0, 200: 0.0}, 240), 3),
        (shifted({40: -3.0, 41: -40.0, 42: -80.0}, 240), 3),
        (shifted({0: -1e6}, 240), 3),
        # A clock that runs slow or fast.
        (-0.1 * np.arange(240), 3),
        (0.1 * np.arange(240), 3),
        # Delays and time-outs end at all distances from the jump, some of them just before it.
        *((shifted({second: -25.0}, 90), 1) for second in range(24, 62, 3)),
    ],
    ids=lambda value: '' if isinstance(value, np.ndarray) else None,
)
def test_events_come_with_the_message_that_brings_them(
    shift: NDArray[np.float64], least: int
) -> None:
    stream, log = recording(shift)
    moved = on_recorder_clock(stream, log, scanned(stream))
    expected = heard(stream, log)
    assert len(moved.events) == len(expected) >= least
    for event, (told, before, now) in zip(moved.events, expected, strict=True):
        assert replace(event, time_ns=told.time_ns) == told
        assert before <= event.time_ns <= now
    assert all(a.time_ns <= b.time_ns for a, b in pairwise(moved.events))
    # Points are taken when a message completes them: they bear its time.
    assert np.isin(moved.time_ns, log).all()
    assert np.all(np.diff(moved.time_ns) >= 0)
    assert np.all(moved.until_ns[:-1] <= moved.time_ns[1:])


def test_a_constant_error_of_the_clock_is_none_of_the_recorder() -> None:
    right, log = recording(np.zeros(240))
    wrong, _ = recording(np.full(240, -12.3))
    scan = scanned(right)
    assert on_recorder_clock(right, log, scan) is scan
    moved = on_recorder_clock(wrong, log, scanned(wrong, int(wrong.time_ns[0])))
    assert [e.time_ns for e in moved.events] == [e.time_ns for e in scan.events]
    np.testing.assert_array_equal(moved.time_ns, scan.time_ns)
    np.testing.assert_array_equal(moved.until_ns, scan.until_ns)


def test_a_gap_lasts_as_long_as_the_clocks_agree() -> None:
    """Load silent from 60.2 to 90.2 s: lost 5 s later by its timeout, told between messages."""
    stream, log = recording(np.full(120, 2.0))
    kept = ~(
        (stream.inputs == Input.LOAD) & (log > START + 61 * SECOND) & (log < START + 90 * SECOND)
    )
    stream = Stream(stream.time_ns[kept], stream.inputs[kept], stream.value[kept])
    moved = on_recorder_clock(stream, log[kept], scanned(stream))
    (lost,) = [e for e in moved.events if e.lost]
    last_load = START + 60 * SECOND + 200_000_000
    assert lost.time_ns == last_load + BEARING.load.timeout_ns
    gap = np.flatnonzero(moved.until_ns[:-1] < moved.time_ns[1:])
    assert moved.until_ns[gap].tolist() == [last_load + BEARING.load.timeout_ns]


def test_nothing_believed_has_no_clock() -> None:
    stream, log = recording(np.full(20, 2.0))
    silent = Stream(stream.time_ns, stream.inputs, np.full(stream.value.shape, np.nan))
    scan = scanned(silent, end_ns=START + 20 * SECOND)
    assert scan.events
    assert on_recorder_clock(silent, log, scan).events == scan.events
