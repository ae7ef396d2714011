# SPDX-License-Identifier: Apache-2.0
"""Signals and the operating point as functions of time, random streams, and what varies."""

from __future__ import annotations

import datetime as dt
import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from own_law import OwnLaw

from benchmarks.voyages import with_parameter_errors
from stickslip_lab.scenes.portable_math import cos_turns, exp
from stickslip_lab.scenes.scene import Scene
from stickslip_lab.scenes.settings import draw_numbers
from stickslip_lab.scenes.telemetry import Channel, Messages, nominal_load
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.physics.friction import Coulomb, Stretched, Tabulated

MakeScene = Callable[..., Scene]
MessagesOf = Callable[..., dict[str, Messages]]
SPEED, LOAD = '/shaft/speed', '/bearing/aft/load'
START = 1_700_000_000_000_000_000
SURFACE = math.pi * 0.1 / 60.0  # m/s of one rpm
NOISE = {
    'speed': {'standard_deviation': 0.1, 'unit': 'rpm'},
    'load': {'standard_deviation': 0.005, 'unit': 'kN'},
}
NOON_NS = 1_777_896_000 * 10**9
CONFIG = load_config(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')
BEARING = CONFIG.bearings[0]


@pytest.mark.parametrize(
    'start', [NOON_NS, '2026-05-04T14:00:00+02:00', '2026-05-04 12:00:00', dt.datetime(2026, 5, 4, 12)]
)
def test_start_is_a_time_or_nanoseconds(make_scene: MakeScene, start: Any) -> None:
    assert make_scene(start=start).start_ns == NOON_NS


def test_profile_is_linear_between_points_and_held_beyond(
    make_scene: MakeScene, messages_of: MessagesOf
) -> None:
    """However it is listed; what is not listed is zero."""
    flat = {'effect': 'speed_profile', 'unit': 'rpm', 'points': [[10, 60], [50, 20]]}
    time = np.arange(1001) / 10.0
    for effects in ([flat], [{'speed_profile': {k: flat[k] for k in ('unit', 'points')}}]):
        messages = messages_of(make_scene(effects=effects))
        stamps = messages[SPEED].log_time_ns.tolist()
        assert stamps == [START + k * 100_000_000 for k in range(1001)]
        expected = np.clip(60.0 - (time - 10.0), 20.0, 60.0)  # one rpm a second
        np.testing.assert_allclose(messages[SPEED].raw, expected, rtol=1e-14)
        assert messages[LOAD].log_time_ns.tolist() == [START + k * 250_000_000 for k in range(401)]
        assert not messages[LOAD].raw.any()


def test_numbers_are_what_the_sensor_sends(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    """Send by a 4 to 20 mA load cell of 0 to 5 kN and a tachometer with 60 pulses a turn, in all units."""
    telemetry = {
        'speed': {'unit': 'Hz', 'scale': 1.0 / 60.0},
        'load': {'unit': 'kN', 'scale': 5.0 / 16.0, 'offset': -1.25},
    }
    messages = messages_of(make_scene({'aft': telemetry}))
    np.testing.assert_allclose(messages[SPEED].raw[0], 60.0, rtol=1e-14)
    np.testing.assert_allclose(messages[LOAD].raw, 4.0 + 16.0 / 5.0, rtol=1e-14)
    units = {'rpm': 1.0, 'rad/s': 30.0 / math.pi, 'Hz': 60.0, 'm/s': 1.0 / SURFACE}
    for unit, rpm in units.items():
        effect = {'speed_profile': {'unit': unit, 'points': [[0, 3.0]]}}
        raw = messages_of(make_scene(effects=[effect]))[SPEED].raw
        np.testing.assert_allclose(raw, 3.0 * rpm, rtol=1e-14)


def test_noise_is_white_and_depends_on_its_seed_alone(make_scene: MakeScene, messages_of: MessagesOf) -> None:
    n = 50_000
    noisy = {'rate': 500.0, 'effects': [{'sensor_noise': NOISE}]}
    scene = make_scene(**noisy)
    alone = messages_of(scene)
    for topic, deviation in ((SPEED, 0.1), (LOAD, 5.0)):
        noise = alone[topic].raw / deviation
        # Five standard errors of mean, deviation, kurtosis and autocorrelation.
        assert abs(noise.mean()) < 5.0 / math.sqrt(n)
        assert abs(noise.std() - 1.0) < 5.0 / math.sqrt(2 * n)
        assert abs((noise**4).mean() - 3.0) < 5.0 * math.sqrt(96.0 / n)
        assert abs((noise[1:] * noise[:-1]).mean()) < 5.0 / math.sqrt(n)
    pair = np.corrcoef(alone[SPEED].raw, alone[LOAD].raw)[0, 1]
    assert abs(pair) < 5.0 / math.sqrt(n)
    reseeded = messages_of(replace(scene, seed=8))
    assert not any(np.any(reseeded[topic].raw == alone[topic].raw) for topic in alone)
    noisy['effects'] = [{'sensor_noise': {'load': NOISE['load']}}]
    assert messages_of(make_scene(**noisy))[LOAD].raw.tolist() == alone[LOAD].raw.tolist()


def test_numbers_are_drawn_evenly_and_each_from_its_own_stream() -> None:
    rise_effect = {'speed_steps': {'rise': {'between': [2.0, 4.0]}}}
    extra_effect = {'bias': {'load': {'bias': {'between': [0, 1]}}}}
    values = [draw_numbers({'effects': [rise_effect]}, seed)['effects'][0] for seed in range(400)]
    rises = np.array([value['speed_steps']['rise'] for value in values])
    assert rises.min() >= 2.0
    assert rises.max() <= 4.0
    # The mean of 400 has a standard deviation of 2 / sqrt(12 * 400) = 0.029.
    assert rises.mean() == pytest.approx(3.0, abs=0.12)
    # Another effect before it changes nothing; the same number in another place is another draw.
    assert draw_numbers({'effects': [extra_effect, rise_effect]}, 7)['effects'][1] == values[7]
    twice = draw_numbers({'effects': [rise_effect, rise_effect]}, 7)['effects']
    assert twice[0] == values[7] != twice[1]
    assert draw_numbers([[1, 'a'], {'b': None, 'c': 2}], 0) == [[1, 'a'], {'b': None, 'c': 2}]


def test_parameters_are_off_by_no_more_than_the_scene_states() -> None:
    errors = {'damping': 0.1, 'friction.static': 0.05, 'load.scale': 0.02}
    believed = [with_parameter_errors(BEARING, errors, seed) for seed in range(200)]
    for name, max_value, values in (
        ('damping', 0.1, [b.bearing.damping / 400.0 for b in believed]),
        ('static', 0.05, [b.bearing.friction.static / 0.3 for b in believed]),
        ('scale', 0.02, [b.load.scale for b in believed]),
    ):
        off = np.abs(np.array(values) - 1.0)
        assert 0.9 * max_value < off.max() <= max_value * (1.0 + 1e-12), name
    assert {b.bearing.mass for b in believed} == {50.0}
    assert with_parameter_errors(BEARING, errors, 3) == believed[3]
    assert with_parameter_errors(BEARING, {}, 3) == BEARING
    coulomb = replace(BEARING, bearing=replace(BEARING.bearing, friction=Coulomb(0.3, 0.1)))
    with pytest.raises(SceneError, match=r'parameter_error of bearing aft_stern: .*decay'):
        with_parameter_errors(coulomb, {'friction.decay': 0.1}, 0)
    with pytest.raises(SceneError, match='say nothing about bearing aft_stern'):
        nominal_load(coulomb)
    # The static coefficient of a table is its first value, and none that could be off alone.
    table = replace(BEARING, bearing=replace(BEARING.bearing, friction=Tabulated([0, 1], [1, 0])))
    with pytest.raises(SceneError, match='a tabulated law has no static'):
        with_parameter_errors(table, {'friction.static': 0.1}, 0)
    assert with_parameter_errors(table, {'damping': 0.1}, 3).bearing.damping != 400.0


def test_units_of_the_reference_bearing() -> None:
    # 200 N = c / (beta (mu_s - mu_k)) is the least unstable load; 40.72 rpm as in the docs.
    load, speed = (Channel(quantity, (BEARING,), 1.0) for quantity in ('load', 'speed'))
    assert load.factor('nominal') == pytest.approx(5.0 * 400.0 / (10.0 * 0.2))
    assert speed.factor('fold') / speed.factor('rpm') == pytest.approx(40.72, abs=0.005)
    # A Gaussian curve begins flat: it falls fastest at 1/(beta sqrt(2)).
    gaussian = replace(BEARING.bearing, friction=Stretched(0.3, 0.1, 10.0, exponent=2.0))
    steepest = 0.2 * 10.0 * math.sqrt(2.0 / math.e)
    load_of_gaussian = nominal_load(replace(BEARING, bearing=gaussian))
    assert load_of_gaussian == pytest.approx(5.0 * 400.0 / steepest, rel=1e-9)


# Exponential and cosine with the same bits on every machine.
RANDOM = np.random.default_rng(3)
CODE = """
import hashlib
import numpy as np
from stickslip_lab.scenes.portable_math import cos_turns, exp
x = np.random.default_rng(3).uniform(-40.0, 0.0, 20_000)
print(hashlib.sha256(exp(x).tobytes() + cos_turns(x * 1e4).tobytes()).hexdigest())
"""


def test_functions_are_right_and_the_same_with_other_vector_instructions() -> None:
    """Forbid numpy in another process the vector instructions that it finds here."""
    x = np.concatenate([RANDOM.uniform(-reach, reach, 300) for reach in (1e-8, 0.4, 30.0, 690.0)])
    x = np.concatenate([x, np.arange(-8, 9) / 8.0])
    with mpmath.workdps(40):
        right = np.array([float(mpmath.exp(v)) for v in x.tolist()])
        cosine = [float(mpmath.cos(2 * mpmath.pi * mpmath.mpf(v))) for v in x.tolist()]
    assert np.all(np.abs(exp(x) - right) <= 1.5 * np.spacing(right))
    assert exp(np.array([-1e9, -np.inf])).tolist() == [exp(np.array([-700.0]))[0]] * 2
    np.testing.assert_allclose(cos_turns(x), cosine, rtol=0.0, atol=4e-16)
    for function in (exp, cos_turns):
        # An element does not see its neighbours.
        alone = [float(function(x[k : k + 1])[0]) for k in range(x.size)]
        assert alone == function(x).tolist() == function(x[::-1])[::-1].tolist()
    x = np.random.default_rng(3).uniform(-40.0, 0.0, 20_000)
    digest = hashlib.sha256(exp(x).tobytes() + cos_turns(x * 1e4).tobytes()).hexdigest()
    # What show_config tells, but that of numpy 1.23 only prints it.
    simd = getattr(np, '_core', None) or np.core
    has = simd._multiarray_umath.__cpu_features__
    features = [name for name in simd._multiarray_umath.__cpu_dispatch__ if has[name]]
    done = subprocess.run(
        [sys.executable, '-W', 'ignore', '-c', CODE],
        env=os.environ | {'NPY_DISABLE_CPU_FEATURES': ' '.join(features)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == digest


class Unnamed(OwnLaw):
    breakpoints = ()


def test_a_law_that_names_no_breakpoints_has_a_nominal_load() -> None:
    """Twice the load range of the map, as of the same law that names them: 5 times the onset of 200 N."""
    config = replace(BEARING, bearing=replace(BEARING.bearing, friction=Unnamed(0.3, 0.1, 10.0)))
    assert nominal_load(config) == pytest.approx(1000.0, rel=1e-9)
