# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from stickslip_monitor import MonitorConfig
from stickslip_monitor.monitor.signals import (
    STATUS_SENTENCES,
    SampleValidator,
    Status,
    to_si,
    value_faults,
)

SECOND = 10**9
SPEED, LOAD = 0, 1
Configure = Callable[..., MonitorConfig]


@pytest.mark.parametrize(
    ('unit', 'number', 'surface'),
    [
        # A journal of 0.1 m: once round is 0.1 pi m.
        ('rpm', 60.0, 0.1 * math.pi),
        ('Hz', 1.0, 0.1 * math.pi),
        ('rad/s', 2.0 * math.pi, 0.1 * math.pi),
        ('m/s', 0.25, 0.25),
        ('rpm', -30.0, -0.05 * math.pi),
    ],
)
@pytest.mark.parametrize(('scale', 'offset'), [(1.0, 0.0), (0.5, 3.0), (-2.0, -1.0)])
def test_speed_units(
    configure: Configure, unit: str, number: float, surface: float, scale: float, offset: float
) -> None:
    config = configure(speed__unit=unit, speed__scale=scale, speed__offset=offset).bearing('aft')
    raw = (number - offset) / scale
    assert to_si(config.speed, np.array([raw]))[0] == pytest.approx(surface, rel=1e-14)


@pytest.mark.parametrize(
    ('unit', 'number', 'newton'), [('N', 1500.0, 1500.0), ('kN', 1.5, 1500.0), ('kN', -2.0, -2e3)]
)
@pytest.mark.parametrize(('scale', 'offset'), [(1.0, 0.0), (0.25, -0.5)])
def test_load_units(
    configure: Configure, unit: str, number: float, newton: float, scale: float, offset: float
) -> None:
    config = configure(load__unit=unit, load__scale=scale, load__offset=offset).bearing('aft')
    raw = (number - offset) / scale
    assert to_si(config.load, np.array([raw]))[0] == pytest.approx(newton, rel=1e-14)


def test_deadband_of_the_speed_only(configure: Configure) -> None:
    config = configure(speed__unit='m/s', alarm__minimum_speed=0.01).bearing('aft')
    below, edge = math.nextafter(0.01, 0.0), 0.01
    given = np.array([0.0, below, -below, edge, -edge, 0.5])
    assert to_si(config.speed, given).tolist() == [0.0, 0.0, 0.0, edge, -edge, 0.5]
    assert to_si(config.load, np.array([1e-6])).tolist() == [1e-6]


def test_deadband_is_in_surface_speed(configure: Configure) -> None:
    config = configure(alarm__minimum_speed=0.1 * math.pi / 60.0 * 2.0).bearing('aft')
    assert to_si(config.speed, np.array([1.99, 2.01]))[0] == 0.0
    assert to_si(config.speed, np.array([1.99, 2.01]))[1] > 0.0


def test_faults_of_values(configure: Configure) -> None:
    config = configure(speed__unit='m/s', speed__maximum=2.0, speed__scale=1e10).bearing('aft')
    above = math.nextafter(2e-10, 1.0)
    given = np.array([2e-10, -2e-10, above, -above, math.nan, math.inf, -math.inf, 1e300])
    faults = value_faults(config.speed, to_si(config.speed, given))
    assert [Status(fault) for fault in faults] == [
        Status.ACCEPTED,
        Status.ACCEPTED,
        Status.IMPLAUSIBLE,
        Status.IMPLAUSIBLE,
        Status.NOT_FINITE,
        Status.NOT_FINITE,
        Status.NOT_FINITE,
        Status.NOT_FINITE,
    ]


def test_every_rejection_has_a_sentence() -> None:
    assert set(STATUS_SENTENCES) == set(Status) - {Status.ACCEPTED}
    assert [s for s in Status if s.believed] == [Status.ACCEPTED, Status.CLOCK_JUMP]


def test_gate_judges_the_stamps_of_each_input(configure: Configure) -> None:
    gate = SampleValidator(configure(speed__timeout=3.0, load__timeout=5.0).bearing('aft'))
    script = [
        (SPEED, 10 * SECOND, Status.ACCEPTED),
        (LOAD, 2 * SECOND, Status.ACCEPTED),
        (SPEED, 10 * SECOND, Status.REPEATED),
        (SPEED, 7 * SECOND, Status.OUT_OF_ORDER),
        (SPEED, 10 * SECOND + 1, Status.ACCEPTED),
        (SPEED, 7 * SECOND + 1, Status.OUT_OF_ORDER),
        (LOAD, -3 * SECOND, Status.OUT_OF_ORDER),
        (LOAD, -3 * SECOND - 1, Status.CLOCK_JUMP),
        # The jump holds for both inputs: the speed may start again anywhere.
        (SPEED, -100 * SECOND, Status.ACCEPTED),
        (SPEED, -100 * SECOND, Status.REPEATED),
    ]
    for is_load, time_ns, status in script:
        assert gate.admit(is_load, time_ns, 0) is status
    assert gate.counts[SPEED].tolist() == [3, 0, 0, 0, 2, 2]
    assert gate.counts[LOAD].tolist() == [1, 1, 0, 0, 0, 1]


def test_a_fault_goes_before_the_stamp_and_leaves_it(configure: Configure) -> None:
    gate = SampleValidator(configure().bearing('aft'))
    assert gate.admit(SPEED, 5, Status.NOT_FINITE) is Status.NOT_FINITE
    assert gate.admit(SPEED, 5, Status.IMPLAUSIBLE) is Status.IMPLAUSIBLE
    assert gate.admit(SPEED, 5, 0) is Status.ACCEPTED
    assert gate.admit(SPEED, 5, Status.NOT_FINITE) is Status.NOT_FINITE
    assert gate.counts[SPEED].tolist() == [1, 0, 2, 1, 0, 0]
