# SPDX-License-Identifier: Apache-2.0
"""What varies from seed to seed, and what makes a scene fit any bearing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.telemetry import Channel, nominal_load
from stickslip_monitor.lab.scenes.variation import as_believed, drawn
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.physics.friction import Coulomb

CONFIG = (
    load_config(Path(__file__).parents[3] / 'launch_configs' / 'reference_bearing.yaml')
).bearings[0]


def test_numbers_are_drawn_evenly_and_each_from_its_own_stream() -> None:
    one = {'speed_steps': {'rise': {'between': [2.0, 4.0]}}}
    other = {'bias': {'load': {'bias': {'between': [0, 1]}}}}
    values = [drawn({'effects': [one]}, seed)['effects'][0] for seed in range(400)]
    rises = np.array([value['speed_steps']['rise'] for value in values])
    assert rises.min() >= 2.0
    assert rises.max() <= 4.0
    # The mean of 400 has a standard deviation of 2 / sqrt(12 * 400) = 0.029.
    assert rises.mean() == pytest.approx(3.0, abs=0.12)
    # Another effect before it changes nothing; the same number in another place is another draw.
    assert drawn({'effects': [other, one]}, 7)['effects'][1] == values[7]
    twice = drawn({'effects': [one, one]}, 7)['effects']
    assert twice[0] == values[7] != twice[1]
    assert drawn([[1, 'a'], {'b': None, 'c': 2}], 0) == [[1, 'a'], {'b': None, 'c': 2}]


def test_parameters_are_off_by_no_more_than_is_said() -> None:
    errors = {'damping': 0.1, 'friction.static': 0.05, 'load.scale': 0.02}
    believed = [as_believed(CONFIG, errors, seed) for seed in range(200)]
    for name, most, values in (
        ('damping', 0.1, [b.bearing.damping / 400.0 for b in believed]),
        ('static', 0.05, [b.bearing.friction.static / 0.3 for b in believed]),  # type: ignore[attr-defined]
        ('scale', 0.02, [b.load.scale for b in believed]),
    ):
        off = np.abs(np.array(values) - 1.0)
        assert 0.9 * most < off.max() <= most * (1.0 + 1e-12), name
    assert {b.bearing.mass for b in believed} == {50.0}
    assert as_believed(CONFIG, errors, 3) == believed[3]
    assert as_believed(CONFIG, {}, 3) == CONFIG


def test_a_parameter_that_the_law_does_not_have_is_named() -> None:
    bearing = replace(CONFIG.bearing, friction=Coulomb(0.3, 0.1))
    with pytest.raises(SceneError, match=r'parameter_error of bearing aft_stern: .*decay'):
        as_believed(replace(CONFIG, bearing=bearing), {'friction.decay': 0.1}, 0)
    with pytest.raises(SceneError, match='say nothing about bearing aft_stern'):
        nominal_load(replace(CONFIG, bearing=bearing))


def test_units_of_the_reference_bearing() -> None:
    """200 N = c / (beta (mu_s - mu_k)) is the least unstable load; 40.72 rpm as in the docs."""
    load = Channel('load', (CONFIG,), 1.0)
    speed = Channel('speed', (CONFIG,), 1.0)
    assert load.factor('nominal') == pytest.approx(5.0 * 400.0 / (10.0 * 0.2))
    assert speed.factor('fold') / speed.factor('rpm') == pytest.approx(40.72, abs=0.005)
