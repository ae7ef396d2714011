# SPDX-License-Identifier: Apache-2.0
"""Sensors with a memory: closed forms of what a lag and a mean make of ramps and ripple."""

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
RATES = {'speed': {'rate': 1.0}, 'load': {'rate': 4.0}}
# 60 rpm, then from 20 s on 0.5 rpm/s down.
RAMP = {'speed_profile': {'unit': 'rpm', 'points': [[20, 60], [100, 20]]}}
# 14.85 Hz at 90 rpm: sampled once a second it would look like something slow.
BLADES = {'blade_ripple': {'blades': 9, 'amplitude': 0.1}}
STEADY = {'speed_profile': {'unit': 'rpm', 'points': [[0, 99]]}}


def filtering(**time_constant: float) -> dict[str, Any]:
    return {'filtering': {q: {'time_constant': t} for q, t in time_constant.items()}}


def averaging(**window: float) -> dict[str, Any]:
    return {'averaging': {q: {'window': w} for q, w in window.items()}}


def speed(
    make_scene: MakeScene, messages_of: MessagesOf, *effects: Any, length: float = 60.0
) -> Any:
    scene = make_scene(effects=list(effects), telemetry=RATES)
    return messages_of(scene, length)['/shaft/speed'].raw


TIME = np.arange(101.0)


@pytest.mark.parametrize('tau', [0.003, 0.7, 12.0])
def test_filter_lags_behind_a_ramp(
    make_scene: MakeScene, messages_of: MessagesOf, tau: float
) -> None:
    """y = 60 - 0.5 (s - tau (1 - exp(-s/tau))), s the time since the ramp began."""
    since = np.maximum(TIME - 20.0, 0.0)
    expected = 60.0 - 0.5 * (since - tau * (1.0 - np.exp(-since / tau)))
    found = speed(make_scene, messages_of, RAMP, filtering(speed=tau))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_filter_weakens_and_delays_ripple(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    """By 1/sqrt(1 + (omega tau)^2) and atan(omega tau), settled from the first sample on."""
    tau, omega = 0.05, 2.0 * math.pi * 99.0 / 60.0 * 9.0
    factor = 1.0 / math.hypot(1.0, omega * tau)
    phase = omega * TIME - math.atan(omega * tau)
    expected = 99.0 * (1.0 + 0.1 * factor * np.cos(phase))
    found = speed(make_scene, messages_of, STEADY, BLADES, filtering(speed=tau))
    # The grid of 400 Hz takes the ripple for linear between its instants: (omega h)^2 / 12.
    np.testing.assert_allclose(found, expected, atol=9.9 * factor * (omega / 400.0) ** 2 / 10.0)


@pytest.mark.parametrize('window', [0.0123, 1.0, 2.5, 17.3])
def test_mean_follows_a_ramp(
    make_scene: MakeScene, messages_of: MessagesOf, window: float
) -> None:
    """The mean of a corner: the ramp's integral is a quarter rpm times the time squared."""
    late, early = np.maximum(TIME - 20.0, 0.0), np.maximum(TIME - window - 20.0, 0.0)
    expected = 60.0 - 0.25 * (late**2 - early**2) / window
    found = speed(make_scene, messages_of, RAMP, averaging(speed=window))
    np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize('window', [0.1, 0.5, 2.0])
def test_mean_averages_ripple_instead_of_aliasing_it(
    make_scene: MakeScene, messages_of: MessagesOf, window: float
) -> None:
    """By sin(x)/x with x = omega window / 2, about the middle of the window."""
    omega = 2.0 * math.pi * 99.0 / 60.0 * 9.0
    x = 0.5 * omega * window
    ripple = 9.9 * np.cos(omega * TIME)
    expected = 99.0 + 9.9 * math.sin(x) / x * np.cos(omega * TIME - x)
    found = speed(make_scene, messages_of, STEADY, BLADES, averaging(speed=window))
    rate = max(100.0, 20.0 / window)
    np.testing.assert_allclose(found, expected, atol=3.0 * (omega / rate) ** 2 / x)
    assert np.abs(found - 99.0).max() < 0.5 * np.abs(ripple).max()


def test_filter_comes_before_the_mean_whatever_the_file_says(
    make_scene: MakeScene, messages_of: MessagesOf
) -> None:
    """On a long ramp the lag of both together: tau + window/2."""
    both = [filtering(speed=2.0), averaging(speed=3.0)]
    one = speed(make_scene, messages_of, RAMP, *both)
    other = speed(make_scene, messages_of, *reversed(both), RAMP)
    assert one.tolist() == other.tolist()
    np.testing.assert_allclose(one[60:], 60.0 - 0.5 * (TIME[60:] - 20.0 - 3.5), rtol=1e-7)


@pytest.mark.parametrize('length', [0.9, 7.3, 1000.0])
def test_blocks_do_not_change_a_bit(
    make_scene: MakeScene, messages_of: MessagesOf, length: float
) -> None:
    effects = [RAMP, BLADES, filtering(speed=0.3), averaging(speed=2.7)]
    whole = speed(make_scene, messages_of, *effects, length=60.0)
    assert speed(make_scene, messages_of, *effects, length=length).tolist() == whole.tolist()


def test_load_that_lifts_off_is_averaged_as_it_is(
    make_scene: MakeScene, messages_of: MessagesOf
) -> None:
    """100 cos, cut off below zero, has the mean 100/pi over a turn."""
    bent = {'misalignment': {'amplitude': 100.0, 'unit': 'N'}}
    scene = make_scene(
        effects=[
            {'speed_profile': {'unit': 'Hz', 'points': [[0, 0.5]]}},
            bent,
            averaging(load=2.0),
        ]
    )
    found = messages_of(scene)['/bearing/aft/load'].raw
    np.testing.assert_allclose(found, 100.0 / math.pi, rtol=1e-3)


@pytest.mark.parametrize(
    ('effect', 'sentence'),
    [
        (
            filtering(speed=0),
            'filtering.speed.time_constant = 0 must be a number [s] not below 0.001',
        ),
        (averaging(load=-1), 'averaging.load.window = -1 must be a number [s] not below 0.001'),
        (
            averaging(load=601),
            'window = 601 must be a number [s] not below 0.001 and not above 600',
        ),
        ({'averaging': {}}, 'averaging must name speed, load or both'),
        ({'averaging': {'speed': {}}}, "key 'averaging.speed.window' is missing: a number [s]"),
    ],
)
def test_wrong_memory_is_named(
    make_scene: MakeScene, effect: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(sentence)):
        make_scene(effects=[effect])
