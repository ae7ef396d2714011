# SPDX-License-Identifier: Apache-2.0
"""What the recorder gets: which messages, when, and with which stamps."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from stickslip_monitor.bags.reader import Request, open_bag
from stickslip_monitor.commands.simulate import write_bag
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.telemetry import Messages
from stickslip_monitor.monitor.signals import Status
from stickslip_monitor.offline.follow import scan_whole

MakeScene = Callable[..., Scene]
MessagesOf = Callable[..., dict[str, Messages]]
SPEED, LOAD = '/shaft/speed', '/bearing/aft/load'
START = 1_700_000_000_000_000_000
STAMPED = {
    'aft': {
        'speed': {'type': 'geometry_msgs/msg/TwistStamped', 'field': 'twist.angular.x'},
        'load': {'type': 'geometry_msgs/msg/WrenchStamped', 'field': 'wrench.force.z'},
    }
}
# A number that tells when it was measured: the load in newton is the time in seconds.
CLOCK = {'load_profile': {'unit': 'N', 'points': [[0, 0], [100, 100]]}}
NS = 10**9


def load_of(
    make_scene: MakeScene, messages_of: MessagesOf, *effects: Any, **more: Any
) -> Messages:
    rates = {'speed': {'rate': 1.0}, 'load': {'rate': more.pop('rate', 10.0)}}
    scene = make_scene(more.pop('bearings', STAMPED), effects=[CLOCK, *effects], telemetry=rates)
    return messages_of(scene, *more.values())[LOAD]


@pytest.mark.parametrize('length', [60.0, 7.3])
def test_dropped_messages_are_those_of_the_windows(
    make_scene: MakeScene, messages_of: MessagesOf, length: float
) -> None:
    drop = {'dropout': {'load': {'windows': [[10, 20], [50.05, 70]]}}}
    found = load_of(make_scene, messages_of, drop, length=length)
    tenths = [k for k in range(1001) if not (100 <= k < 200 or 501 <= k < 700)]
    assert found.log_time_ns.tolist() == [START + k * 10**8 for k in tenths]
    assert found.stamp_ns is not None
    assert found.stamp_ns.tolist() == found.log_time_ns.tolist()
    np.testing.assert_allclose(found.raw, np.array(tenths) / 10.0, atol=1e-9)


def test_share_of_the_messages_is_lost_or_comes_twice(
    make_scene: MakeScene, messages_of: MessagesOf
) -> None:
    repeat = {'repeated_stamps': {'load': {'share': 0.3}}}
    drop = {'dropout': {'load': {'share': 0.1}}}
    n, rate = 100_001, 1000.0
    twice = load_of(make_scene, messages_of, repeat, rate=rate).log_time_ns
    stamps, counts = np.unique(twice, return_counts=True)
    assert (stamps.size, set(counts.tolist())) == (n, {1, 2})
    assert np.all(np.diff(twice) >= 0)
    assert abs((counts == 2).sum() - 0.3 * n) < 5.0 * math.sqrt(0.21 * n)
    left = load_of(make_scene, messages_of, drop, rate=rate).log_time_ns
    assert abs(left.size - 0.9 * n) < 5.0 * math.sqrt(0.09 * n)
    # Both together hit the same messages as each alone.
    both = load_of(make_scene, messages_of, drop, repeat, rate=rate).log_time_ns
    assert both.tolist() == twice[np.isin(twice, left)].tolist()


@pytest.mark.parametrize('bearings', [{'aft': {}}, STAMPED])
def test_jitter_scatters_the_stamps_alone(
    make_scene: MakeScene, messages_of: MessagesOf, bearings: dict[str, Any]
) -> None:
    jitter = {'clock_jitter': {'load': {'standard_deviation': 0.02}}}
    clean = load_of(make_scene, messages_of, bearings=bearings, rate=100.0)
    found = load_of(make_scene, messages_of, jitter, bearings=bearings, rate=100.0)
    assert found.raw.tolist() == clean.raw.tolist()
    stamps = found.log_time_ns if found.stamp_ns is None else found.stamp_ns
    if found.stamp_ns is not None:
        assert found.log_time_ns.tolist() == clean.log_time_ns.tolist()
    off = (stamps - clean.log_time_ns) / 0.02e9
    n = off.size
    assert abs(off.mean()) < 5.0 / math.sqrt(n)
    assert abs(off.std() - 1.0) < 5.0 / math.sqrt(2 * n)
    assert abs((off[1:] * off[:-1]).mean()) < 5.0 / math.sqrt(n)
    # None comes to lie before 1970.
    jitter['clock_jitter']['load']['standard_deviation'] = 9
    early = messages_of(make_scene(bearings, effects=[jitter], start=0))[LOAD]
    assert (early.log_time_ns if early.stamp_ns is None else early.stamp_ns).min() == 0


def test_clock_jumps_add_up(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    jumps = {'clock_jump': {'jumps': [[30, -40], [60, 3600.5]]}}
    found = load_of(make_scene, messages_of, jumps)
    time = np.arange(1001) / 10.0
    shift = np.where(time >= 60.0, 3560.5, np.where(time >= 30.0, -40.0, 0.0))
    assert found.stamp_ns is not None
    expected = START + np.rint((time + shift) * 1e9)
    np.testing.assert_array_equal(found.stamp_ns, expected.astype(np.int64))
    np.testing.assert_array_equal(found.log_time_ns, START + np.arange(1001) * 10**8)
    np.testing.assert_allclose(found.raw, time, atol=1e-9)
    # A recorder's own clock can jump forward.
    jumps = {'clock_jump': {'jumps': [[30, 40]], 'bearing': 'aft'}}
    found = load_of(make_scene, messages_of, jumps, bearings={'aft': {}})
    steps = [NS // 10] * 299 + [401 * NS // 10] + [NS // 10] * 700
    assert np.diff(found.log_time_ns).tolist() == steps


def test_late_messages_come_behind_younger_ones(
    make_scene: MakeScene, messages_of: MessagesOf
) -> None:
    late = {'out_of_order': {'load': {'delay': 0.25, 'share': 0.1}}}
    found = load_of(make_scene, messages_of, late, rate=100.0)
    stamps = START + np.arange(10_001) * 10**7
    assert found.stamp_ns is not None
    assert found.stamp_ns.tolist() == stamps.tolist()
    delay = found.log_time_ns - stamps
    assert set(delay.tolist()) == {0, 250_000_000}
    assert abs((delay > 0).sum() - 1000.1) < 5.0 * math.sqrt(900)
    # A delay that overtakes nothing is refused.
    with pytest.raises(SceneError, match=r'delay = 0.25 must be a number \[s\] above 0.25'):
        load_of(make_scene, messages_of, late, rate=4.0)


def test_another_reader_finds_stamps_and_order_in_the_bag(
    make_scene: MakeScene, tmp_path: Path
) -> None:
    late = {'out_of_order': {'load': {'delay': 1.1, 'windows': [[40, 40.1]]}}}
    jump = {'clock_jump': {'jumps': [[60, -40]]}}
    rates = {'speed': {'rate': 2.0}, 'load': {'rate': 2.0}}
    scene = make_scene(STAMPED, effects=[CLOCK, late, jump], telemetry=rates)
    assert sum(write_bag(scene, tmp_path / 'bag').values()) == 402
    store = get_typestore(Stores.ROS2_JAZZY)
    rows = []
    with Reader(tmp_path / 'bag') as reader:
        wanted = [c for c in reader.connections if c.topic == LOAD]
        for connection, log_time, data in reader.messages(wanted):
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
            rows.append((log_time - START, stamp - START, message.wrench.force.z))
    expected = [
        (k * NS // 2, k * NS // 2 - (40 * NS if k >= 120 else 0), k / 2) for k in range(201)
    ]
    expected[80] = (expected[80][0] + 11 * NS // 10, *expected[80][1:])
    assert rows == [(t, s, pytest.approx(v)) for t, s, v in sorted(expected)]


def test_monitor_counts_every_kind_of_bad_message(make_scene: MakeScene, tmp_path: Path) -> None:
    """What the scene put in is what the monitor complains of, kind by kind."""
    effects = [
        {'speed_profile': {'unit': 'rpm', 'points': [[0, 60]]}},
        {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}},
        {'not_a_number': {'load': {'windows': [[10, 12]]}}},
        {'spikes': {'load': {'size': 1e9, 'unit': 'N', 'windows': [[20, 21]]}}},
        {'repeated_stamps': {'load': {'windows': [[30, 33]]}}},
        {'out_of_order': {'load': {'delay': 1.0, 'windows': [[40, 40.5]]}}},
        {'clock_jump': {'jumps': [[60, -50]]}},
    ]
    rates = {'speed': {'rate': 4.0}, 'load': {'rate': 4.0}}
    scene = make_scene(STAMPED, effects=effects, telemetry=rates)
    write_bag(scene, tmp_path / 'bag')
    counts = scan_whole(tmp_path / 'bag', scene.config).bearings['aft'].scan.counts
    load = {status: int(counts[1, status]) for status in Status}
    assert load[Status.NOT_FINITE] == 8
    assert load[Status.IMPLAUSIBLE] == 4
    assert load[Status.REPEATED] == 12
    # Two late ones, and two in which the clock is 50 s behind before that is taken for a jump.
    assert load[Status.OUT_OF_ORDER] == 2 + 2
    # The speed's clock jumps in the same instant and is heard first.
    assert counts[:, Status.CLOCK_JUMP].tolist() == [1, 0, 0]
    assert sum(load.values()) == 401 + 12


@pytest.mark.slow
@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_recording_cut_in_mid_write(make_scene: MakeScene, tmp_path: Path, name: str) -> None:
    noise = {'sensor_noise': {'load': {'standard_deviation': 1.0, 'unit': 'N'}}}
    rates = {'speed': {'rate': 1.0}, 'load': {'rate': 1000.0}}
    effects = [CLOCK, noise]
    write_bag(make_scene(effects=effects, telemetry=rates), tmp_path / 'whole')
    cut = make_scene(effects=[*effects, {'cut_off': {'time': 70.0}}], telemetry=rates)
    assert list(write_bag(cut, tmp_path / name).values()) == [70, 70_000]
    request = Request(LOAD, 'data')
    whole = open_bag(tmp_path / 'whole').read([request])[request]
    bag = open_bag(tmp_path / name)
    left = bag.read([request])[request]
    assert len(bag.cuts) == 1
    # Two whole chunks of a megabyte at 43 bytes a message, and something of the third.
    assert 2 * (1 << 20) // 43 < left.value.size < 70_000
    assert left.value.tolist() == whole.value[: left.value.size].tolist()
    assert left.log_time_ns.tolist() == whole.log_time_ns[: left.value.size].tolist()
    assert not (tmp_path / name / 'metadata.yaml').exists()
