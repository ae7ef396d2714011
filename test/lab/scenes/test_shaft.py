# SPDX-License-Identifier: Apache-2.0
"""The operating point is a function of time: the same bits for whoever asks."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from stickslip_monitor.lab.scenes.scene import Scene, simulate

SURFACE = math.pi * 0.1 / 60.0  # m/s of one rpm
POINTS = [[10, 60], [50, 20], [51, 20], [73, -35]]
SPEED = {'speed_profile': {'unit': 'rpm', 'points': POINTS}}
LOAD = {'load_profile': {'unit': 'N', 'points': [[0, 1000], [50, -500]]}}


def test_telemetry_and_finer_instants_agree_bit_for_bit(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene(effects=[SPEED, LOAD])
    for length in (100.0, 7.3):
        for block in simulate(scene, length):
            for topic, signal in block.signals.items():
                finer = block.instants(signal.channel.rate * 8)
                value = block.shaft.value(topic, finer)
                at = np.flatnonzero(np.isin(finer, signal.time))
                assert value[at].tolist() == signal.value.tolist()


@pytest.mark.parametrize('length', [100.0, 7.3, 0.1])
def test_instants_of_all_blocks_are_every_instant_once(
    make_scene: Callable[..., Scene], length: float
) -> None:
    blocks = list(simulate(make_scene(effects=[]), length))
    instants = np.concatenate([block.instants(50.0) for block in blocks])
    assert instants.tolist() == (np.arange(5001) / 50.0).tolist()


def test_turns_are_the_integral_of_the_speed(make_scene: Callable[..., Scene]) -> None:
    """Against adaptive quadrature of the points, and before the begin by the first value held."""
    shaft = make_scene(effects=[SPEED]).build().shaft
    knots = [p[0] for p in POINTS]

    def frequency(time: float) -> float:
        return float(np.interp(time, *np.transpose(POINTS))) / 60.0

    for time in (0.0, 3.0, 10.0, 33.3, 50.5, 73.0, 99.0):
        inner = [k for k in knots if 0.0 < k < time]
        expected = quad(frequency, 0.0, time, points=inner or None)[0]
        turns = shaft.turns('aft', np.array([time]))[0]
        assert turns == pytest.approx(expected, rel=1e-10, abs=1e-12)
    assert shaft.turns('aft', np.array([-5.0]))[0] == pytest.approx(-5.0)


def test_load_of_a_journal_that_lifts_off_is_zero(make_scene: Callable[..., Scene]) -> None:
    shaft = make_scene(effects=[LOAD]).build().shaft
    time = np.linspace(0.0, 60.0, 61)
    expected = [max(0.0, 1000.0 - 30.0 * t) for t in time]
    np.testing.assert_allclose(shaft.load('aft', time), expected, atol=1e-9)


def test_each_bearing_of_a_shaft_has_its_own_surface_speed(
    make_scene: Callable[..., Scene],
) -> None:
    two = {'aft': {}, 'fwd': {'journal_diameter': 0.25, 'load': {'topic': '/fwd'}}}
    shaft = make_scene(two, effects=[SPEED]).build().shaft
    time = np.array([0.0, 30.0])
    np.testing.assert_allclose(shaft.speed('aft', time), [60.0 * SURFACE, 40.0 * SURFACE])
    np.testing.assert_allclose(shaft.speed('fwd', time), [150.0 * SURFACE, 100.0 * SURFACE])
    np.testing.assert_allclose(shaft.turns('fwd', time), shaft.turns('aft', time))
