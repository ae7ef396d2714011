# SPDX-License-Identifier: Apache-2.0
"""The lining's motion in a scene: against the exact cycle, linear theory, reference numbers.

The reference bearing at 1000 N has its Hopf speed at 30.738 rpm, the exact fold at 40.718 rpm, and
at 34 rpm an exact threshold of 0.592815 mm.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.scene import Scene, simulate
from stickslip_monitor.physics.motion import integrator

MASS, DAMPING, STIFFNESS, OMEGA = 50.0, 400.0, 2.0e6, 200.0
DROP, DECAY, KINETIC = 0.2, 10.0, 0.1
RPM = math.pi * 0.1 / 60.0

Make = Callable[..., Scene]


def effects(
    speed: list[list[float]], load: float = 1000.0, deviation: float = 1.0, **motion: Any
) -> list[dict[str, Any]]:
    disturbance = {'standard_deviation': deviation, 'unit': 'N'}
    return [
        {'speed_profile': {'unit': 'rpm', 'points': speed}},
        {'load_profile': {'unit': 'N', 'points': [[0.0, load]]}},
        {'lining_motion': {'disturbance': disturbance} | motion},
    ]


def told(scene: Scene, block_length: float = 60.0) -> dict[str, tuple[NDArray[Any], list[Any]]]:
    """Times and values of each truth topic of the bearing, by the topic's last part."""
    found: dict[str, tuple[list[float], list[Any]]] = {}
    for block in simulate(scene, block_length):
        for column in block.truth:
            times, values = found.setdefault(column.topic.rpartition('/')[2], ([], []))
            assert np.all(column.time >= block.start)
            assert np.all(column.time < block.end) or block.end == scene.duration
            times += column.time.tolist()
            values += list(column.values)
    return {name: (np.array(times), values) for name, (times, values) in found.items()}


def events(
    found: dict[str, tuple[NDArray[Any], list[Any]]], scene: Scene
) -> dict[str, list[float]]:
    """Seconds of each kind of event."""
    kinds: dict[str, list[float]] = {}
    for text in found['events'][1]:
        event = json.loads(text)
        assert event['schema'] == 'stickslip_monitor/truth/1'
        kinds.setdefault(event['event'], []).append((event['time'] - scene.start_ns) / 1e9)
    return kinds


def growth(speed: NDArray[np.float64], load: float = 1000.0) -> NDArray[np.float64]:
    """Growth rate of a small disturbance, in closed form."""
    return (load * DROP * DECAY * np.exp(-DECAY * speed) - DAMPING) / (2.0 * MASS)


@pytest.mark.parametrize(
    ('rpm', 'amplitude'), [(10.0, 0.296953e-3), (20.0, 0.556755e-3), (30.0, 0.804800e-3)]
)
def test_the_cycle_reaches_its_exact_amplitude(
    make_scene: Make, rpm: float, amplitude: float
) -> None:
    """From rest in a second; amplitudes of the exact cycle from the reference table."""
    scene = make_scene(
        effects=effects([[0, 0], [1, rpm]], deviation=0.0, amplitude={'rate': 2.0}), duration=12.0
    )
    times, values = told(scene)['amplitude']
    assert np.array_equal(times, np.arange(1, 25) / 2.0)
    assert values[-4:] == pytest.approx([amplitude] * 4, rel=1e-4)


def test_sticks_have_the_length_and_distance_of_the_exact_cycle(make_scene: Make) -> None:
    """At 20 rpm the period is 31.5903 ms."""
    scene = make_scene(effects=effects([[0, 0], [1, 20]], deviation=0.0), duration=10.0)
    ends, lengths = told(scene)['stick']
    assert np.diff(ends[-20:]) == pytest.approx(31.5903e-3, rel=1e-5)
    # All but the first stick, in which the shaft breaks away, are shorter than a period.
    assert max(lengths[1:]) < 31.6e-3
    assert lengths[0] > 1e-2


def test_steady_sliding_trembles_as_linear_theory_says(make_scene: Make) -> None:
    """White noise on a grid, joined linearly, has density ``sigma^2 dt sinc^4(omega dt/2)``."""
    rpm, sigma = 60.0, 5.0
    scene = make_scene(
        effects=effects([[0, rpm]], deviation=sigma, motion={'rate': 50.0}), duration=80.0
    )
    speed = rpm * RPM
    found = told(scene)
    x = np.array(found['displacement'][1])
    mu = KINETIC + DROP * math.exp(-DECAY * speed)
    step = 1.0 / 128.0
    damping = DAMPING - 1000.0 * DROP * DECAY * math.exp(-DECAY * speed)

    def density(omega: float) -> float:
        force = (sigma * mu) ** 2 * step * np.sinc(omega * step / (2.0 * np.pi)) ** 4
        stiff = STIFFNESS - MASS * omega * omega
        return float(force / (stiff * stiff + (damping * omega) ** 2) / np.pi)

    variance = sum(
        quad(density, a, b, limit=500)[0] for a, b in ((0, 190), (190, 210), (210, 2000))
    )
    assert x.mean() == pytest.approx(1000.0 * mu / STIFFNESS, rel=1e-3)
    # Some 80 s * sigma = 3 per second of independent energy: 10 % in the standard deviation.
    assert x.std() == pytest.approx(math.sqrt(variance), rel=0.2)
    assert events(found, scene) == {'start': [0.0], 'end': [80.0]}
    assert found['stick'][1] == []


def test_onset_is_delayed_by_the_growth_that_it_needs(make_scene: Make) -> None:
    """Through Hopf at 1 rpm/s: the amplitude grows by ``exp(integral sigma dt)``, then sticks."""
    scene = make_scene(
        effects=effects([[0, 34], [16, 18]], amplitude={'rate': 4.0}, deviation=0.2), duration=16.0
    )
    found = told(scene)
    time, values = found['amplitude'][0], np.array(found['amplitude'][1])
    (first,) = events(found, scene)['first_stick']
    # Far above the disturbance, far below the limit: the linear range of the growth.
    linear = (values > 2e-5) & (values < 1e-4) & (time < first)
    assert linear.sum() >= 3
    fine = np.linspace(0.0, 16.0, 16001)
    gained = np.cumsum(growth((34.0 - fine) * RPM)) * 1e-3
    expected = np.interp(time[linear], fine, gained)
    assert np.diff(np.log(values[linear])) == pytest.approx(np.diff(expected), rel=0.03)
    # At Hopf (3.26 s) the amplitude is a small part of the sliding limit, V/omega = 0.8 mm.
    assert first > 3.26 + 3.0
    needed = np.interp(time[linear][0], fine, gained) + np.log(7e-4 / values[linear][0])
    assert first == pytest.approx(np.interp(needed, gained[4000:], fine[4000:]), abs=0.6)


@pytest.mark.parametrize(('part', 'sticks'), [(0.97, False), (1.03, True)])
def test_a_knock_beyond_the_threshold_starts_stick_slip(
    make_scene: Make, part: float, sticks: bool
) -> None:
    """At 34 rpm the unstable cycle's amplitude is 0.592815 mm; a blow J gives ``J/(m omega)``."""
    impulse = part * 0.592815e-3 * MASS * OMEGA
    scene = make_scene(
        effects=effects([[0, 34]], deviation=0.0, knocks=[[1.005, impulse]]), duration=8.0
    )
    kinds = events(told(scene), scene)
    assert ('first_stick' in kinds) is sticks
    assert 'last_stick' not in kinds


def test_a_knock_gives_the_lining_its_impulse(make_scene: Make) -> None:
    """Of 2 N s at 1.5 s: 0.04 m/s more, in the direction in which the shaft turns ahead."""
    listed = effects([[0, 60]], deviation=0.0, knocks=[[1.5, 2.0]], motion={'rate': 100_000.0})
    found = told(make_scene(effects=listed, duration=1.501))
    time, values = found['velocity']
    before, after = values[150_000], values[150_001]
    assert time[150_000] == 1.5
    assert after - before == pytest.approx(2.0 / MASS, rel=1e-3)


def test_a_knock_rings_down_above_the_fold(make_scene: Make) -> None:
    """At 60 rpm: ``J/(m omega) exp(sigma t)`` with the growth rate sigma < 0."""
    scene = make_scene(
        effects=effects([[0, 60]], deviation=0.0, knocks=[[1.0, 1.0]], amplitude={'rate': 5.0}),
        duration=3.0,
    )
    time, values = told(scene)['amplitude']
    sigma = float(growth(np.array([60 * RPM]))[0])
    late = time > 1.3
    since = time[late] - 1.0 - 3.5 * 2.0 * np.pi / OMEGA
    expected = 1.0 / (MASS * OMEGA) * np.exp(sigma * since)
    assert np.array(values)[late] == pytest.approx(expected, rel=0.03)


def test_the_same_speed_sticks_or_not_by_its_history(make_scene: Make) -> None:
    """36 rpm is bistable: from above it stays quiet, from below it goes on to stick."""
    for start, sticks in ((60.0, False), (15.0, True)):
        speed = [[0.0, start], [2.0, start], [6.0, 36.0]]
        scene = make_scene(effects=effects(speed, deviation=5.0), duration=12.0)
        found = told(scene)
        late = found['stick'][0] > 10.0
        assert late.any() == sticks
        assert ('first_stick' in events(found, scene)) is sticks
        assert 'last_stick' not in events(found, scene)


def test_stick_slip_ends_at_the_exact_fold(make_scene: Make) -> None:
    """Upwards at 0.5 rpm/s: at 40.718 rpm but for the few cycles that the end takes."""
    scene = make_scene(effects=effects([[0, 0], [1, 38], [9, 42]], deviation=0.0), duration=10.0)
    found = told(scene)
    last = events(found, scene)['last_stick'][-1]
    assert 38.0 + 0.5 * (last - 1.0) == pytest.approx(40.718, abs=0.12)
    assert last == pytest.approx(found['stick'][0][-1], abs=1e-9)


def test_a_shaft_at_rest_is_no_stick_slip(make_scene: Make) -> None:
    """It stops with the lining stuck to it, and that is told as sticking, not as an episode."""
    scene = make_scene(
        effects=effects([[0, 60], [4, 60], [5, 0], [8, 0]], motion={'rate': 10.0}), duration=8.0
    )
    found = told(scene)
    ends, lengths = found['stick']
    assert ends[-1] == 8.0
    assert lengths[-1] == pytest.approx(3.0, abs=0.1)
    assert found['sticking'][1][-20:] == [True] * 20
    kinds = events(found, scene)
    if 'first_stick' in kinds:  # the last cycles before the stop, which is at 5 s
        assert kinds['last_stick'][0] <= 5.0


def test_the_wait_before_the_first_turn_is_no_stick_slip(make_scene: Make) -> None:
    """At rest for 3 s, then to 25 rpm in 1 s: 0.003 m/s, where the shaft turns, at 3.023 s."""
    scene = make_scene(effects=effects([[3, 0], [4, 25]]), duration=8.0)
    found = told(scene)
    (first,) = events(found, scene)['first_stick']
    assert first > 3.023
    # The interval of sticking is told as it was, from the scene's start to the breaking away.
    assert found['stick'][1][0] == pytest.approx(found['stick'][0][0], abs=1e-9)


def test_samples_tell_one_motion(make_scene: Make) -> None:
    """Velocity and acceleration against differences of the displacement; ``x' = V`` in sticks."""
    scene = make_scene(
        effects=effects([[0, 0], [1, 20]], deviation=0.0, motion={'rate': 4000.0}), duration=4.0
    )
    found = told(scene)
    time = found['displacement'][0]
    assert np.array_equal(time, np.arange(16001) / 4000.0)
    x, v, a = (np.array(found[n][1]) for n in ('displacement', 'velocity', 'acceleration'))
    stuck = np.array(found['sticking'][1])
    whole = stuck[2:] == stuck[:-2]
    assert (x[2:] - x[:-2])[whole] * 2000.0 == pytest.approx(v[1:-1][whole], abs=2e-4)
    assert (v[2:] - v[:-2])[whole] * 2000.0 == pytest.approx(a[1:-1][whole], abs=0.5)
    running = stuck & (time > 1.0)
    assert v[running] == pytest.approx(20 * RPM, rel=1e-12)
    in_sticks = [np.any((e - d <= t) & (t <= e)) for t, e, d in
                 ((t, *map(np.array, found['stick'])) for t in time[::37])]  # fmt: skip
    assert in_sticks == stuck[::37].tolist()


@pytest.mark.parametrize('length', [60.0, 7.3, 0.37])
def test_the_outcome_does_not_depend_on_the_blocks(make_scene: Make, length: float) -> None:
    """Bit for bit, with a disturbance, a knock, a drift, and an end off every grid."""
    listed = effects(
        [[0, 40], [4, 24], [9, 46]],
        knocks=[[5.0, 0.5], [6.123, -0.3]],
        amplitude={'rate': 3.0},
        motion={'rate': 31.0},
    )
    listed.append({'friction_drift': {'parameter': 'static', 'points': [[1, 0.3], [8, 0.34]]}})
    listed.append({'operating_point': {'rate': 3.0}})
    scene = make_scene(effects=listed, duration=9.777)
    whole, cut = told(scene, 100.0), told(scene, length)
    assert whole.keys() == cut.keys()
    for name, (times, values) in whole.items():
        assert np.array_equal(times, cut[name][0]), name
        assert values == cut[name][1], name


@pytest.mark.skipif(find_spec('numba') is None, reason='compares with numba')
def test_with_and_without_numba_the_bits_are_the_same(
    make_scene: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = effects([[0, 30], [8, 20]], motion={'rate': 100.0}, amplitude={'rate': 2.0})
    listed.append({'friction_drift': {'parameter': 'decay', 'points': [[0, 10], [8, 14]]}})
    scene = make_scene(effects=listed, duration=8.0)
    compiled = told(scene)
    monkeypatch.setattr(integrator, 'is_compiled', lambda _: False)
    plain = told(scene)
    assert len(plain['stick'][1]) > 50
    for name, (times, values) in compiled.items():
        assert np.array_equal(times, plain[name][0]), name
        assert values == plain[name][1], name


def test_its_random_numbers_are_its_own(make_scene: Make) -> None:
    """Other effects draw what they drew without it, and it what it drew without them."""
    noise = {'sensor_noise': {'speed': {'standard_deviation': 0.1, 'unit': 'rpm'}}}
    alone = effects([[0, 45]], motion={'rate': 50.0})
    both = told(make_scene(effects=[*alone, noise], duration=5.0))
    assert (
        told(make_scene(effects=alone, duration=5.0))['displacement'][1] == both['displacement'][1]
    )
    speeds = [
        next(iter(simulate(make_scene(effects=listed, duration=5.0))))
        .signals['/shaft/speed']
        .value
        for listed in ([*alone, noise], [*alone[:2], noise])
    ]
    assert np.array_equal(speeds[0], speeds[1])


def test_two_bearings_move_each_for_itself(make_scene: Make) -> None:
    """The one with thrice the load sticks; each draws its own disturbance."""
    bearings = {'aft': {}, 'fore': {'load': {'topic': '/bearing/fore/load'}}}
    listed = [
        {'speed_profile': {'unit': 'rpm', 'points': [[0, 0], [1, 25]]}},
        {'load_profile': {'unit': 'N', 'points': [[0, 1000.0]], 'bearing': 'aft'}},
        {'load_profile': {'unit': 'N', 'points': [[0, 300.0]], 'bearing': 'fore'}},
        {'lining_motion': {'disturbance': {'standard_deviation': 0.001, 'unit': 'kN'}}},
    ]
    found: dict[str, list[float]] = {}
    for block in simulate(make_scene(bearings, effects=listed, duration=8.0)):
        for column in block.truth:
            if column.topic.endswith('stick'):
                found.setdefault(column.topic, []).extend(column.time.tolist())
    late = {topic: sum(t > 4.0 for t in times) for topic, times in found.items()}
    assert late == {'/truth/aft/stick': pytest.approx(126, abs=2), '/truth/fore/stick': 0}


BAD: dict[str, list[dict[str, Any]]] = {
    "effect 'lining_motion' is listed twice for bearing aft": [{}, {}],
    "key 'lining_motion.disturbance' is missing": [{'disturbance': None}],
    "lining_motion.knocks = []": [{'knocks': []}],
    'lining_motion.knocks: blow 2 is at 3 s, but times must rise and the one before':
        [{'knocks': [[4, 1.0], [3, 1.0]]}],
    'lining_motion.knocks: no blow can follow at 100 s, where the scene ends':
        [{'knocks': [[100, 1.0]]}],
    'lining_motion.amplitude.rate = 9.0 must be a number [Hz] above 0 and not above 7.95775':
        [{'amplitude': {'rate': 9.0}}],
    'lining_motion.motion.rate = -1.0 must be': [{'motion': {'rate': -1.0}}],
    "unknown key 'knock' = 3 in lining_motion; did you mean 'knocks'?": [{'knock': 3}],
    'lining_motion.disturbance.standard_deviation = -1 must be':
        [{'disturbance': {'standard_deviation': -1, 'unit': 'N'}}],
    "lining_motion.bearing = 'stern' must be one of aft": [{'bearing': 'stern'}],
}  # fmt: skip


@pytest.mark.parametrize('words', BAD)
def test_wrong_settings_are_named(make_scene: Make, words: str) -> None:
    usual = {'disturbance': {'standard_deviation': 1.0, 'unit': 'N'}}
    listed = effects([[0, 60]])[:2]
    for changes in BAD[words]:
        settings = {k: v for k, v in (usual | changes).items() if v is not None}
        listed.append({'lining_motion': settings})
    with pytest.raises(SceneError) as caught:
        make_scene(effects=listed)
    assert words in str(caught.value)
