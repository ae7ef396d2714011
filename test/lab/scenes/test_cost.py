# SPDX-License-Identifier: Apache-2.0
"""The stopwatch on a clock of the test's own, and what it says of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from stickslip_monitor.lab.scenes.cost import REST, Stopwatch
from stickslip_monitor.lab.scenes.effects.effect import Effect
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.lab.scenes.simulator import simulate


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def pass_(self, seconds: float) -> float:
        self.now += seconds
        return seconds


def test_time_goes_to_the_innermost_name() -> None:
    clock = Clock()
    watch = Stopwatch(clock)

    class Inner:
        name = 'a sea'

        def at(self, seconds: float) -> float:
            return clock.pass_(seconds)

    inner = watch.watch('inner', Inner())

    class Outer:
        def apply(self, block: float) -> None:
            clock.pass_(2.0)
            assert inner.at(block) == block
            clock.pass_(1.0)

    outer = watch.watch('outer', Outer())
    assert isinstance(outer, Effect)
    assert inner.name == 'a sea'
    clock.pass_(0.5)
    outer.apply(10.0)
    outer.apply(20.0)
    inner.at(100.0)
    assert watch.spent == {REST: 0.5, 'inner': 130.0, 'outer': 6.0}


def test_time_of_a_failure_is_counted_too() -> None:
    clock = Clock()
    watch = Stopwatch(clock)

    def fail() -> None:
        with watch.of('it'):
            clock.pass_(3.0)
            raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011
        fail()
    clock.pass_(1.0)
    assert watch.spent == {REST: 1.0, 'it': 3.0}


def test_steps_give_what_happens_between_them_to_others() -> None:
    clock = Clock()
    watch = Stopwatch(clock)

    def blocks() -> Iterator[int]:
        for number in range(3):
            clock.pass_(2.0)
            yield number
        clock.pass_(5.0)

    for number in watch.steps('blocks', blocks()):
        clock.pass_(number)
    assert watch.spent == {REST: 3.0, 'blocks': 11.0}


def test_watched_scene_is_the_same_and_names_its_effects(make_scene: Callable[..., Scene]) -> None:
    effects: list[dict[str, Any]] = [
        {'speed_profile': {'unit': 'rpm', 'points': [[0, 60]]}},
        {'load_steps': {'unit': 'N', 'steps': [[0, 900]], 'rise': 1.0}},
        {'blade_ripple': {'blades': 4, 'amplitude': 0.02}},
        {'averaging': {'speed': {'window': 2.0}}},
        {'sensor_noise': {'load': {'standard_deviation': 3.0, 'unit': 'N'}}},
        {'cut_off': {'time': 90.0}},
    ]
    scene = make_scene(effects=effects)
    watch = Stopwatch()
    plain = [s.raw for block in simulate(scene) for s in block.signals.values()]
    timed = simulate(scene, run=scene.build(watch))
    watched = [s.raw for block in timed for s in block.signals.values()]
    assert [a.tolist() for a in watched] == [a.tolist() for a in plain]
    assert np.concatenate(plain).size == 900 + 360
    acting = [name for effect in effects for name in effect if name != 'cut_off']
    assert sorted(watch.spent) == sorted([REST, *acting])
    assert all(seconds > 0.0 for seconds in watch.spent.values())
