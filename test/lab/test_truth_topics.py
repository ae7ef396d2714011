# SPDX-License-Identifier: Apache-2.0
"""The truth in a recording, from bags written by hand; and verdicts on the recorder's clock.

These are held against the monitor fed with one message after the other.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_lab.scenes.truth_topics import TruthRecord, has_truth, read_truth
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.writer import BagWriter, encode_string
from stickslip_monitor.errors import BagError

SECOND = 1_000_000_000
EVENTS = '/truth/aft/events'


def truth_event(name: str, second: float, **more: Any) -> str:
    record = {'schema': 'stickslip_monitor/truth/1', 'bearing': 'aft', 'event': name}
    return json.dumps(record | {'time': round(second * SECOND)} | more)


def write_truth_bag(
    path: Path, events: Sequence[tuple[float, str]], kind: str = 'std_msgs/msg/String'
) -> Path:
    """Write a bag of 100 s with events at some seconds, and speed on a topic of its own."""
    with BagWriter(path) as writer:
        writer.add_topic('/shaft/speed', 'std_msgs/msg/Float64')
        writer.add_topic(EVENTS, kind)
        writer.write_float64s({'/shaft/speed': ([0, 100 * SECOND], [1.0, 2.0])})
        for second, text in events:
            writer.write(EVENTS, round(second * SECOND), encode_string(text))
    return path


def read_truth_bag(path: Path) -> TruthRecord:
    return read_truth(open_bag(path), 'aft')


SPAN = [(0, truth_event('start', 0)), (90, truth_event('end', 90))]
FIRST = [
    (11, truth_event('first_stick', 10.5)),
    (21, truth_event('last_stick', 20.25, sticks=7, sticking=0.3)),
]


@pytest.mark.parametrize(
    ('rows', 'end', 'episodes'),
    [
        (
            [*SPAN, *FIRST, (50, truth_event('first_stick', 49)), (60, truth_event('last_stick', 59.5))],
            90.0,
            [(10.5, 20.25), (49.0, 59.5)],
        ),
        # An episode that goes on ends with the truth; of a recording that was cut, at its end.
        ([*SPAN, FIRST[0]], 90.0, [(10.5, 90.0)]),
        ([SPAN[0], FIRST[0]], 100.0, [(10.5, 100.0)]),
    ],
)
def test_episodes_and_span(
    tmp_path: Path, rows: Any, end: float, episodes: list[tuple[float, float]]
) -> None:
    truth = read_truth_bag(write_truth_bag(tmp_path / 'a.mcap', sorted(rows)))
    assert (truth.start_ns, truth.end_ns) == (0, end * SECOND)
    assert truth.episodes == tuple((a * SECOND, b * SECOND) for a, b in episodes)
    assert truth.amplitude.value.size == truth.fold_margin.time_ns.size == 0


def test_each_number_is_read_from_its_topic(tmp_path: Path) -> None:
    columns = {'hopf_margin': [np.inf, 0.3], 'fold_margin': [0.1, -0.2], 'amplitude': [0.0, 3e-4]}
    path = tmp_path / 'a.mcap'
    with BagWriter(path) as writer:
        writer.add_topic(EVENTS, 'std_msgs/msg/String')
        writer.write(EVENTS, 5, encode_string(truth_event('start', 0)))
        for name, column in columns.items():
            writer.add_topic(f'/truth/aft/{name}', 'std_msgs/msg/Float64')
            writer.write_float64s({f'/truth/aft/{name}': ([5, 9], column)})
    truth = read_truth_bag(path)
    for name, column in columns.items():
        assert getattr(truth, name).time_ns.tolist() == [5, 9]
        assert getattr(truth, name).value.tolist() == column


def test_no_truth_is_named(tmp_path: Path) -> None:
    path = write_truth_bag(tmp_path / 'a.mcap', [(0, truth_event('start', 0))])
    assert not has_truth(open_bag(path), 'fore')
    with pytest.raises(BagError) as caught:
        read_truth(open_bag(path), 'fore')
    assert str(caught.value) == (
        f"bag '{path}' holds no truth about fore: topic '/truth/fore/events' is not in it; it is about aft"
    )


@pytest.mark.parametrize(
    'text',
    [
        '',
        'no json',
        '[]',
        '{}',
        '{"schema": "stickslip_monitor/truth/2"}',
        '{"schema": "stickslip_monitor/truth/1", "event": "start", "time": null}',
    ],
)
def test_events_of_another_kind_are_named(tmp_path: Path, text: str) -> None:
    path = write_truth_bag(tmp_path / 'a.mcap', [(0, text)])
    with pytest.raises(BagError) as caught:
        read_truth_bag(path)
    assert str(caught.value) == (
        f"topic '{EVENTS}' of bag '{path}' holds an event that is not of schema stickslip_monitor/truth/1"
    )


def test_events_of_another_type_are_named(tmp_path: Path) -> None:
    path = write_truth_bag(tmp_path / 'a.mcap', [], 'std_msgs/msg/Float64')
    with pytest.raises(BagError, match=r'not std_msgs/msg/String$'):
        read_truth_bag(path)
