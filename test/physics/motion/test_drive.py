# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.motion.integrator import Drive

TIME = [0.0, 1.0, 3.0, 4.5]
SPEED = [0.1, 0.3, -0.2, 0.0]
LOAD = [1000.0, 0.0, 500.0, 200.0]


def evaluate(drive: Drive, pieces: np.ndarray, t: float) -> float:
    i = min(int(np.searchsorted(drive.time, t, side='right')) - 1, len(pieces) - 1)
    return float(np.polyval(pieces[i, ::-1], t - drive.time[i]))


@pytest.mark.parametrize('t', [0.0, 0.4, 1.0, 2.2, 4.4])
def test_rules(t: float) -> None:
    linear, cubic = Drive.sampled(TIME, SPEED, LOAD), Drive.sampled(TIME, SPEED, LOAD, 'cubic')
    assert evaluate(linear, linear.speed, t) == pytest.approx(np.interp(t, TIME, SPEED))
    assert evaluate(linear, linear.load, t) == pytest.approx(np.interp(t, TIME, LOAD))
    assert evaluate(cubic, cubic.load, t) == pytest.approx(PchipInterpolator(TIME, LOAD)(t))
    held = Drive.sampled(TIME, SPEED, LOAD, load_rule='hold')
    assert evaluate(held, held.load, t) == LOAD[int(np.searchsorted(TIME, t, side='right')) - 1]


def test_constant() -> None:
    drive = Drive.constant(0.1, 1000.0, 2.0, start=3.0)
    assert (drive.start, drive.end, drive.largest_load) == (3.0, 5.0, 1000.0)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'time': [0.0, 1.0, 1.0, 2.0]}, r'drive time\[2\] = 1 s does not exceed time\[1\] = 1 s'),
        ({'load': [1.0, -2.0, 1.0, 1.0]}, r'drive load\[1\] = -2 N must not be negative'),
        ({'speed': [0.1, np.nan, 0.1, 0.1]}, r'drive speed\[1\] = nan must be a finite number'),
        ({'speed': [0.1]}, r'shape \(4,\), speeds of \(1,\)'),
        ({'rule': 'hold'}, 'a shaft cannot jump'),
        ({'load_rule': 'spline'}, "load_rule = 'spline' is not one of linear, cubic, hold"),
    ],
)
def test_bad_drives_are_named(changes: dict[str, Any], message: str) -> None:
    values: dict[str, Any] = {'time': TIME, 'speed': SPEED, 'load': LOAD}
    with pytest.raises(PhysicsError, match=message):
        Drive.sampled(**(values | changes))


def test_one_sample_is_too_few() -> None:
    with pytest.raises(PhysicsError, match='drive has 1 samples: give at least two'):
        Drive.sampled([0.0], [0.1], [1.0])
