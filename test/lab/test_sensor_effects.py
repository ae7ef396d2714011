# SPDX-License-Identifier: Apache-2.0
"""What sensors make of the shaft, and which messages the recorder gets, when, with which stamps.

Closed forms of lag and mean, counts by the binomial law.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_lab.scenes.scene import Scene, write_bag
from stickslip_lab.scenes.telemetry import Messages
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.sample_types import Status
from stickslip_monitor.offline.check import RecordingBuffer, check_recording

MakeScene = Callable[..., Scene]
MessagesOf = Callable[..., dict[str, Messages]]
Send = Callable[..., tuple[Any, Any]]
SPEED, LOAD = '/shaft/speed', '/bearing/aft/load'


@pytest.fixture
def send(make_scene: MakeScene, messages_of: MessagesOf) -> Send:
    """Return a function that gives the numbers of the two sensors at some rate [Hz]."""

    def numbers(*effects: dict[str, Any], rate: float = 100.0, length: float = 60.0) -> tuple[Any, Any]:
        sent = messages_of(make_scene(effects=list(effects), rate=rate), length)
        return sent[SPEED].raw, sent[LOAD].raw

    return numbers


# 60 rpm, then from 20 s on 0.5 rpm/s down.
CORNER = {'speed_profile': {'unit': 'rpm', 'points': [[20, 60], [100, 20]]}}
# 14.85 Hz at 99 rpm: sampled once a second it would look like something slow.
BLADES = {'blade_ripple': {'blades': 9, 'amplitude': 0.1}}
FAST = {'speed_profile': {'unit': 'rpm', 'points': [[0, 99]]}}
SECONDS = np.arange(101.0)


def filtering_effect(**time_constant: float) -> dict[str, Any]:
    return {'filtering': {q: {'time_constant': t} for q, t in time_constant.items()}}


def averaging_effect(**window: float) -> dict[str, Any]:
    return {'averaging': {q: {'window': w} for q, w in window.items()}}


@pytest.mark.parametrize('tau', [0.003, 0.7, 12.0])
def test_filter_lags_behind_a_ramp(send: Send, tau: float) -> None:
    """y = 60 - 0.5 (s - tau (1 - exp(-s/tau))), s the time since the ramp began."""
    since = np.maximum(SECONDS - 20.0, 0.0)
    expected = 60.0 - 0.5 * (since - tau * (1.0 - np.exp(-since / tau)))
    filtered, _ = send(CORNER, filtering_effect(speed=tau), rate=1.0)
    np.testing.assert_allclose(filtered, expected, rtol=1e-9)


@pytest.mark.parametrize('window', [0.1, 0.5, 2.0])
def test_mean_averages_ripple_instead_of_aliasing_it(send: Send, window: float) -> None:
    """Expect sin(x)/x with x = omega window / 2, about the middle of the window."""
    omega = 2.0 * math.pi * 99.0 / 60.0 * 9.0
    x = 0.5 * omega * window
    expected = 99.0 + 9.9 * math.sin(x) / x * np.cos(omega * SECONDS - x)
    averaged, _ = send(FAST, BLADES, averaging_effect(speed=window), rate=1.0)
    rate = max(100.0, 20.0 / window)
    np.testing.assert_allclose(averaged, expected, atol=3.0 * (omega / rate) ** 2 / x)


def test_filter_comes_before_the_mean_and_both_see_no_blocks(send: Send) -> None:
    """Expect the lag of both together on a long ramp, tau + window/2."""
    effects = [filtering_effect(speed=2.0), averaging_effect(speed=3.0)]
    in_order, _ = send(CORNER, *effects, rate=1.0)
    swapped, _ = send(*reversed(effects), CORNER, rate=1.0, length=7.3)
    assert in_order.tolist() == swapped.tolist()
    np.testing.assert_allclose(in_order[60:], 60.0 - 0.5 * (SECONDS[60:] - 20.0 - 3.5), rtol=1e-7)


TIME = np.arange(10_001) / 100.0
RAMP = {'speed_profile': {'unit': 'rpm', 'points': [[0, 60], [100, 20]]}}
RPM = 60.0 - 0.4 * TIME
STEADY = {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}}


def test_bias_drifts_by_the_hour(send: Send) -> None:
    load = {'bias': -0.02, 'drift': 0.36, 'unit': 'kN'}
    speed, biased = send(RAMP, STEADY, {'bias': {'load': load}})
    np.testing.assert_allclose(biased, 980.0 + 0.1 * TIME, rtol=1e-12)
    np.testing.assert_allclose(speed, RPM, rtol=1e-12)
    speed, _ = send(RAMP, {'bias': {'speed': {'bias': 0.5, 'unit': 'rpm'}}})
    np.testing.assert_allclose(speed, RPM + 0.5, rtol=1e-12)


def test_quantised_numbers_are_the_nearest_multiples(send: Send) -> None:
    speed, _ = send(RAMP, {'quantisation': {'speed': {'step': 0.25, 'unit': 'rpm'}}})
    steps = speed / 0.25
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.abs(speed - RPM).max() <= 0.125 + 1e-9
    # The error of a ramp is uniform: a twelfth of the step squared.
    assert (speed - RPM).var() == pytest.approx(0.25**2 / 12.0, rel=1e-2)


@pytest.mark.parametrize('length', [60.0, 7.3, 0.05])
def test_stuck_sensor_repeats_its_last_value(send: Send, length: float) -> None:
    windows = [[0, 3], [20, 61.5], [61.5, 70], [99, 100]]
    speed, _ = send(RAMP, {'stuck': {'speed': {'windows': windows}}}, length=length)
    expected: list[float] = []
    for time, value in zip(TIME.tolist(), RPM.tolist(), strict=True):
        stuck = any(start <= time < end for start, end in windows)
        expected.append(expected[-1] if stuck and expected else value)
    np.testing.assert_allclose(speed, expected, rtol=1e-12)
    assert len(set(speed[2000:7000].tolist())) == 1


# The recorder.
START = 1_700_000_000_000_000_000
# A number that tells when it was measured: the load in newton is the time in seconds.
CLOCK = {'load_profile': {'unit': 'N', 'points': [[0, 0], [100, 100]]}}
NS = 10**9


def load_of(make_scene: MakeScene, messages_of: MessagesOf, *effects: Any, **more: Any) -> Messages:
    bearings, rate = more.pop('bearings', 'stamped'), more.pop('rate', 10.0)
    scene = make_scene(bearings, rate, effects=[CLOCK, *effects])
    return messages_of(scene, *more.values())[LOAD]


@pytest.mark.parametrize('bearings', [{'aft': {}}, 'stamped'])
def test_jitter_scatters_the_stamps_alone(
    make_scene: MakeScene, messages_of: MessagesOf, bearings: Any
) -> None:
    jitter = {'clock_jitter': {'load': {'standard_deviation': 0.02}}}
    clean = load_of(make_scene, messages_of, bearings=bearings, rate=100.0)
    loads = load_of(make_scene, messages_of, jitter, bearings=bearings, rate=100.0)
    assert loads.raw.tolist() == clean.raw.tolist()
    stamps = loads.log_time_ns if loads.stamp_ns is None else loads.stamp_ns
    if loads.stamp_ns is not None:
        assert loads.log_time_ns.tolist() == clean.log_time_ns.tolist()
    off = (stamps - clean.log_time_ns) / 0.02e9
    n = off.size
    assert abs(off.mean()) < 5.0 / math.sqrt(n)
    assert abs(off.std() - 1.0) < 5.0 / math.sqrt(2 * n)


def test_clock_jumps_add_up(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    jumps = {'clock_jump': {'jumps': [[30, -40], [60, 3600.5]]}}
    loads = load_of(make_scene, messages_of, jumps)
    time = np.arange(1001) / 10.0
    shift = np.where(time >= 60.0, 3560.5, np.where(time >= 30.0, -40.0, 0.0))
    assert loads.stamp_ns is not None
    expected = START + np.rint((time + shift) * 1e9)
    np.testing.assert_array_equal(loads.stamp_ns, expected.astype(np.int64))
    np.testing.assert_array_equal(loads.log_time_ns, START + np.arange(1001) * 10**8)
    np.testing.assert_allclose(loads.raw, time, atol=1e-9)
    # A recorder's own clock can jump forward.
    jumps = {'clock_jump': {'jumps': [[30, 40]], 'bearing': 'aft'}}
    loads = load_of(make_scene, messages_of, jumps, bearings={'aft': {}})
    steps = [NS // 10] * 299 + [401 * NS // 10] + [NS // 10] * 700
    assert np.diff(loads.log_time_ns).tolist() == steps


@pytest.mark.parametrize(
    ('effect', 'share'), [('dropout', 0.1), ('repeated_stamps', 0.3), ('not_a_number', 0.2), ('spikes', 0.05)]
)
def test_shares_and_windows_choose_the_messages(
    make_scene: MakeScene, messages_of: MessagesOf, effect: str, share: float
) -> None:
    """Expect as many as the binomial law has; windows choose among them and change none."""
    settings = {'share': share} | ({'size': 300, 'unit': 'N'} if effect == 'spikes' else {})
    windows = {'windows': [[10, 20], [50.05, 70]]}
    counts = []
    for chosen in (settings, settings | windows, settings | windows | {'share': 1.0}):
        loads = load_of(make_scene, messages_of, {effect: {'load': chosen}}, rate=100.0)
        assert loads.stamp_ns is not None
        assert loads.stamp_ns.tolist() == loads.log_time_ns.tolist()
        tick = (loads.log_time_ns - START) // 10**7
        counts_by_tick = np.bincount(tick, minlength=10_001)
        if effect == 'spikes':
            counts_by_tick[tick[abs(loads.raw - tick / 100.0) > 299.0]] = 9
        elif effect == 'not_a_number':
            counts_by_tick[tick[np.isnan(loads.raw)]] = 9
        counts.append(counts_by_tick != 1)
    unlimited, limited, everywhere = counts
    assert abs(unlimited.sum() - share * 10_001) < 5.0 * math.sqrt(share * (1.0 - share) * 10_001)
    time = np.arange(10_001) / 100.0
    inside = ((time >= 10.0) & (time < 20.0)) | ((time >= 50.05) & (time < 70.0))
    assert everywhere.tolist() == inside.tolist()
    assert limited.tolist() == (unlimited & inside).tolist()


def test_late_messages_come_behind_younger_ones(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    delay_effect = {'out_of_order': {'load': {'delay': 0.25, 'share': 0.1}}}
    loads = load_of(make_scene, messages_of, delay_effect, rate=100.0)
    stamps = START + np.arange(10_001) * 10**7
    assert loads.stamp_ns is not None
    assert loads.stamp_ns.tolist() == stamps.tolist()
    delay = loads.log_time_ns - stamps
    assert set(delay.tolist()) == {0, 250_000_000}
    assert abs((delay > 0).sum() - 1000.1) < 5.0 * math.sqrt(900)
    # A delay that overtakes nothing is refused.
    with pytest.raises(SceneError, match=r'delay = 0\.25 must be a finite number above 0\.25'):
        load_of(make_scene, messages_of, delay_effect, rate=4.0)


def test_monitor_counts_every_kind_of_bad_message(make_scene: MakeScene, tmp_path: Path) -> None:
    """Compare the monitor's counts, kind by kind, with what the scene put in."""
    effects = [
        {'speed_profile': {'unit': 'rpm', 'points': [[0, 60]]}},
        {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}},
        {'not_a_number': {'load': {'windows': [[10, 12]]}}},
        {'spikes': {'load': {'size': 1e9, 'unit': 'N', 'windows': [[20, 21]]}}},
        {'repeated_stamps': {'load': {'windows': [[30, 33]]}}},
        {'out_of_order': {'load': {'delay': 1.0, 'windows': [[40, 40.5]]}}},
        {'clock_jump': {'jumps': [[0, -2], [60, -50]]}},
    ]
    scene = make_scene('stamped', 4.0, effects=effects)
    write_bag(scene, tmp_path / 'bag')
    buffer = RecordingBuffer()
    check_recording(tmp_path / 'bag', scene.config, [buffer])
    counts = buffer.scan('aft').counts
    load = {status: int(counts[1, status]) for status in Status}
    assert load[Status.NOT_FINITE] == 8
    assert load[Status.IMPLAUSIBLE] == 4
    assert load[Status.REPEATED] == 12
    # Two late ones, and a second in which the clock is 50 s behind before it was set.
    assert load[Status.OUT_OF_ORDER] == 2 + 3
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
    complete = open_bag(tmp_path / 'whole').read([request])[request]
    bag = open_bag(tmp_path / name)
    remaining = bag.read([request])[request]
    assert len(bag.cuts) == 1
    # Two whole chunks of a megabyte at 43 bytes a message, and something of the third.
    assert 2 * (1 << 20) // 43 < remaining.value.size < 70_000
    assert remaining.value.tolist() == complete.value[: remaining.value.size].tolist()
    assert remaining.log_time_ns.tolist() == complete.log_time_ns[: remaining.value.size].tolist()
    assert not (tmp_path / name / 'metadata.yaml').exists()
