# SPDX-License-Identifier: Apache-2.0
"""What sensors make of the shaft: closed forms of lag and mean, counts by the binomial law."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.telemetry import Messages

MakeScene = Callable[..., Scene]
MessagesOf = Callable[..., dict[str, Messages]]
Send = Callable[..., tuple[Any, Any]]
SPEED, LOAD = '/shaft/speed', '/bearing/aft/load'


@pytest.fixture
def send(make_scene: MakeScene, messages_of: MessagesOf) -> Send:
    """The numbers that the two sensors send, at some rate [Hz]."""

    def numbers(
        *effects: dict[str, Any], rate: float = 100.0, length: float = 60.0
    ) -> tuple[Any, Any]:
        rates = {'speed': {'rate': rate}, 'load': {'rate': rate}}
        scene = make_scene(effects=list(effects), telemetry=rates)
        sent = messages_of(scene, length)
        return sent[SPEED].raw, sent[LOAD].raw

    return numbers


# 60 rpm, then from 20 s on 0.5 rpm/s down.
CORNER = {'speed_profile': {'unit': 'rpm', 'points': [[20, 60], [100, 20]]}}
# 14.85 Hz at 99 rpm: sampled once a second it would look like something slow.
BLADES = {'blade_ripple': {'blades': 9, 'amplitude': 0.1}}
FAST = {'speed_profile': {'unit': 'rpm', 'points': [[0, 99]]}}
SECONDS = np.arange(101.0)


def filtering(**time_constant: float) -> dict[str, Any]:
    return {'filtering': {q: {'time_constant': t} for q, t in time_constant.items()}}


def averaging(**window: float) -> dict[str, Any]:
    return {'averaging': {q: {'window': w} for q, w in window.items()}}


@pytest.mark.parametrize('tau', [0.003, 0.7, 12.0])
def test_filter_lags_behind_a_ramp(send: Send, tau: float) -> None:
    """y = 60 - 0.5 (s - tau (1 - exp(-s/tau))), s the time since the ramp began."""
    since = np.maximum(SECONDS - 20.0, 0.0)
    expected = 60.0 - 0.5 * (since - tau * (1.0 - np.exp(-since / tau)))
    found, _ = send(CORNER, filtering(speed=tau), rate=1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_filter_weakens_and_delays_ripple(send: Send) -> None:
    """By 1/sqrt(1 + (omega tau)^2) and atan(omega tau), settled from the first sample on."""
    tau, omega = 0.05, 2.0 * math.pi * 99.0 / 60.0 * 9.0
    factor = 1.0 / math.hypot(1.0, omega * tau)
    phase = omega * SECONDS - math.atan(omega * tau)
    expected = 99.0 * (1.0 + 0.1 * factor * np.cos(phase))
    found, _ = send(FAST, BLADES, filtering(speed=tau), rate=1.0)
    # The grid of 400 Hz takes the ripple for linear between its instants: (omega h)^2 / 12.
    np.testing.assert_allclose(found, expected, atol=9.9 * factor * (omega / 400.0) ** 2 / 10.0)


@pytest.mark.parametrize('window', [0.0123, 1.0, 2.5, 17.3])
def test_mean_follows_a_ramp(send: Send, window: float) -> None:
    """The mean of a corner: the ramp's integral is a quarter rpm times the time squared."""
    late, early = (np.maximum(SECONDS - back - 20.0, 0.0) for back in (0.0, window))
    expected = 60.0 - 0.25 * (late**2 - early**2) / window
    found, _ = send(CORNER, averaging(speed=window), rate=1.0)
    np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize('window', [0.1, 0.5, 2.0])
def test_mean_averages_ripple_instead_of_aliasing_it(send: Send, window: float) -> None:
    """By sin(x)/x with x = omega window / 2, about the middle of the window."""
    omega = 2.0 * math.pi * 99.0 / 60.0 * 9.0
    x = 0.5 * omega * window
    expected = 99.0 + 9.9 * math.sin(x) / x * np.cos(omega * SECONDS - x)
    found, _ = send(FAST, BLADES, averaging(speed=window), rate=1.0)
    rate = max(100.0, 20.0 / window)
    np.testing.assert_allclose(found, expected, atol=3.0 * (omega / rate) ** 2 / x)


def test_filter_comes_before_the_mean_and_both_see_no_blocks(send: Send) -> None:
    """On a long ramp the lag of both together: tau + window/2."""
    both = [filtering(speed=2.0), averaging(speed=3.0)]
    one, _ = send(CORNER, *both, rate=1.0)
    other, _ = send(*reversed(both), CORNER, rate=1.0, length=7.3)
    assert one.tolist() == other.tolist()
    np.testing.assert_allclose(one[60:], 60.0 - 0.5 * (SECONDS[60:] - 20.0 - 3.5), rtol=1e-7)


def test_load_that_lifts_off_is_averaged_as_it_is(send: Send) -> None:
    """100 cos, cut off below zero, has the mean 100/pi over a turn."""
    bent = {'misalignment': {'amplitude': 100.0, 'unit': 'N'}}
    turning = {'speed_profile': {'unit': 'Hz', 'points': [[0, 0.5]]}}
    _, found = send(turning, bent, averaging(load=2.0), rate=4.0)
    np.testing.assert_allclose(found, 100.0 / math.pi, rtol=1e-3)


TIME = np.arange(10_001) / 100.0
RAMP = {'speed_profile': {'unit': 'rpm', 'points': [[0, 60], [100, 20]]}}
RPM = 60.0 - 0.4 * TIME
STEADY = {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}}


def test_bias_drifts_by_the_hour(send: Send) -> None:
    load = {'bias': -0.02, 'drift': 0.36, 'unit': 'kN'}
    speed, found = send(RAMP, STEADY, {'bias': {'load': load}})
    np.testing.assert_allclose(found, 980.0 + 0.1 * TIME, rtol=1e-12)
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


def test_spikes_are_as_many_and_as_large_as_stated(send: Send) -> None:
    spikes = {'spikes': {'load': {'size': 0.3, 'unit': 'kN', 'share': 0.05}}}
    _, found = send(STEADY, spikes)
    off = np.rint(found - 1000.0)
    assert set(off.tolist()) == {-300.0, 0.0, 300.0}
    count, n = np.count_nonzero(off), off.size
    assert abs(count - 0.05 * n) < 5.0 * math.sqrt(0.05 * 0.95 * n)
    assert abs(np.count_nonzero(off > 0) - count / 2) < 5.0 * math.sqrt(count) / 2.0
    inside = spikes['spikes']['load'] | {'windows': [[10, 20], [30, 45]]}
    _, windowed = send(STEADY, {'spikes': {'load': inside}})
    hold = ((TIME >= 10) & (TIME < 20)) | ((TIME >= 30) & (TIME < 45))
    # Windows choose among the spikes and do not change them.
    assert windowed.tolist() == np.where(hold, found, 1000.0).tolist()


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


def test_nan_comes_where_it_is_asked_for(send: Send) -> None:
    speed, load = send(
        {
            'not_a_number': {
                'speed': {'windows': [[1, 2.5]]},
                'load': {'share': 0.2, 'windows': [[50, 100]]},
            }
        }
    )
    assert np.isnan(speed).tolist() == ((TIME >= 1.0) & (TIME < 2.5)).tolist()
    count = np.isnan(load).sum()
    assert abs(count - 1000.0) < 5.0 * math.sqrt(5000 * 0.16)
    assert not np.isnan(load[:5000]).any()


def test_effect_may_be_for_one_bearing(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    two: dict[str, Any] = {'aft': {}, 'fwd': {'load': {'topic': '/fwd'}}}
    bias = {'bearing': 'fwd', 'load': {'bias': 5, 'unit': 'N'}}
    sent = messages_of(make_scene(two, effects=[STEADY, {'bias': bias}]))
    assert set(sent['/fwd'].raw.tolist()) == {1005.0}
    assert set(sent[LOAD].raw.tolist()) == {1000.0}
