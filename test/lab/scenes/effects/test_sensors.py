# SPDX-License-Identifier: Apache-2.0
"""What becomes of samples: closed forms, counts by the binomial law, and a plain loop."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.telemetry import Messages

MakeScene = Callable[..., Scene]
MessagesOf = Callable[..., dict[str, Messages]]
SPEED, LOAD = '/shaft/speed', '/bearing/aft/load'
RATES = {'speed': {'rate': 100.0}, 'load': {'rate': 100.0}}
TIME = np.arange(10_001) / 100.0
RAMP = {'speed_profile': {'unit': 'rpm', 'points': [[0, 60], [100, 20]]}}
RPM = 60.0 - 0.4 * TIME
STEADY = {'load_profile': {'unit': 'N', 'points': [[0, 1000]]}}


@pytest.fixture
def send(make_scene: MakeScene, messages_of: MessagesOf) -> Callable[..., Any]:
    """The numbers that the two sensors send."""

    def numbers(*effects: dict[str, Any], length: float = 60.0) -> Any:
        scene = make_scene(effects=list(effects), telemetry=RATES)
        sent = messages_of(scene, length)
        return sent[SPEED].raw, sent[LOAD].raw

    return numbers


def test_bias_drifts_by_the_hour(send: Callable[..., Any]) -> None:
    load = {'bias': -0.02, 'drift': 0.36, 'unit': 'kN'}
    speed, found = send(RAMP, STEADY, {'bias': {'load': load}})
    np.testing.assert_allclose(found, 980.0 + 0.1 * TIME, rtol=1e-12)
    np.testing.assert_allclose(speed, RPM, rtol=1e-12)
    speed, _ = send(RAMP, {'bias': {'speed': {'bias': 0.5, 'unit': 'rpm'}}})
    np.testing.assert_allclose(speed, RPM + 0.5, rtol=1e-12)


def test_quantised_numbers_are_the_nearest_multiples(send: Callable[..., Any]) -> None:
    speed, _ = send(RAMP, {'quantisation': {'speed': {'step': 0.25, 'unit': 'rpm'}}})
    steps = speed / 0.25
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.abs(speed - RPM).max() <= 0.125 + 1e-9
    # The error of a ramp is uniform: a twelfth of the step squared.
    assert (speed - RPM).var() == pytest.approx(0.25**2 / 12.0, rel=1e-2)


def test_quantisation_comes_after_the_noise(send: Callable[..., Any]) -> None:
    noise = {'sensor_noise': {'load': {'standard_deviation': 7.0, 'unit': 'N'}}}
    _, found = send({'quantisation': {'load': {'step': 4, 'unit': 'N'}}}, noise, STEADY)
    np.testing.assert_allclose(found / 4.0, np.rint(found / 4.0), atol=1e-9)
    assert found.std() == pytest.approx(math.sqrt(7.0**2 + 4.0**2 / 12.0), rel=0.04)


def test_spikes_are_as_many_and_as_large_as_stated(send: Callable[..., Any]) -> None:
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
def test_stuck_sensor_repeats_its_last_value(send: Callable[..., Any], length: float) -> None:
    windows = [[0, 3], [20, 61.5], [61.5, 70], [99, 100]]
    speed, _ = send(RAMP, {'stuck': {'speed': {'windows': windows}}}, length=length)
    expected: list[float] = []
    for time, value in zip(TIME.tolist(), RPM.tolist(), strict=True):
        stuck = any(start <= time < end for start, end in windows)
        expected.append(expected[-1] if stuck and expected else value)
    np.testing.assert_allclose(speed, expected, rtol=1e-12)
    assert len(set(speed[2000:7000].tolist())) == 1


def test_nan_comes_where_it_is_asked_for(send: Callable[..., Any]) -> None:
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


def only(name: str, **settings: Any) -> dict[str, Any]:
    return {name: {'load': settings}}


@pytest.mark.parametrize(
    ('effect', 'sentence'),
    [
        (only('bias', unit='N'), "key 'bias.load.bias' is missing: a number [N]"),
        (
            only('bias', bias=1, drift='much', unit='N'),
            "bias.load.drift = 'much' must be a number",
        ),
        (
            only('quantisation', step=0, unit='N'),
            'quantisation.load.step = 0 must be a number [N] not below',
        ),
        (
            only('spikes', size=1, unit='N'),
            'spikes.load must have windows, a share of the samples',
        ),
        (
            only('stuck', windows=[]),
            'stuck.load.windows = [] must be a list of windows [start in s',
        ),
        (
            only('stuck', windows=[[0, 30], [20, 40]]),
            'stuck.load.windows: window 2 = [20, 40] overlaps or precedes window 1 = [0, 30];'
            ' windows must follow one another',
        ),
        (
            only('stuck', windows=[[50, 60], [0, 9]]),
            'window 2 = [0, 9] overlaps or precedes window',
        ),
        (only('stuck', windows=[[5, 5]]), 'window 1 = [5, 5] must start before it ends, within'),
        (
            only('stuck', windows=[[5, 101]]),
            'window 1 = [5, 101] must start before it ends, within',
        ),
        (only('stuck', windows=[[-1, 5]]), 'window 1 = [-1, 5] must start before it ends, within'),
        (
            only('stuck', windows=[5, 6]),
            'window 1 = 5 must be a pair of numbers, [start in s, end',
        ),
        (
            only('not_a_number', share=0),
            'not_a_number.load.share = 0 must be a number [-] above 0',
        ),
        (
            only('dropout', share=1.1),
            'dropout.load.share = 1.1 must be a number [-] above 0 and not',
        ),
        (only('dropout'), 'dropout.load must have windows, a share of the samples, or both'),
        (
            only('clock_jitter', standard_deviation=-1),
            'clock_jitter.load.standard_deviation = -1 must be a number [s] not below 0',
        ),
        ({'cut_off': {'time': 0}}, 'cut_off.time = 0 must be a number [s] above 0'),
        (
            {'cut_off': {'time': 101}},
            'cut_off.time = 101 must be a number [s] above 0 and not abov',
        ),
        (
            {'clock_jump': {'jumps': [[5, -40]]}},
            'topic /shaft/speed is std_msgs/msg/Float64, without a time stamp: its clock can only'
            ' jump forward; use geometry_msgs/msg/TwistStamped or geometry_msgs/msg/WrenchStamped',
        ),
        (
            {'clock_jump': {'jumps': [[5, 0]]}},
            'clock_jump.jumps: jump 1 is by 0 s, which must not',
        ),
        (
            {'clock_jump': {'jumps': [[5, 1], [4, 1]]}},
            'clock_jump.jumps: jump 2 is at 4 s, but times must rise',
        ),
        (
            only('out_of_order', delay=1, share=0.1),
            'topic /bearing/aft/load is std_msgs/msg/Float64, without a time stamp: none of its',
        ),
    ],
)
def test_wrong_settings_are_named(
    make_scene: MakeScene, effect: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(effects=[effect])
    name = next(iter(effect))
    with pytest.raises(SceneError, match=f"unknown key 'sped' = 1 in {name}"):
        make_scene(effects=[{name: {'sped': 1}}])
