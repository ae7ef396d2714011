# SPDX-License-Identifier: Apache-2.0
"""The lining's motion in a scene: against the exact cycle, linear theory, reference numbers.

The reference bearing at 1000 N has its Hopf speed at 30.738 rpm, the exact fold at 40.718 rpm, and
at 34 rpm an exact threshold of 0.592815 mm. Also here: episodes from sticks laid out by hand,
windows of motions known in closed form, and friction that moves in time.
"""

from __future__ import annotations

import json
import math
import tracemalloc
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from shared import RPM

from stickslip_lab.scenes.lining import (
    PER_PERIOD,
    EpisodeEvent,
    Episodes,
    Samples,
    drifting_parameters,
    half_peak_to_peak,
    replace_parameters,
)
from stickslip_lab.scenes.scene import Scene, simulate
from stickslip_monitor.physics import integrator
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated

MASS, DAMPING, STIFFNESS, OMEGA = 50.0, 400.0, 2.0e6, 200.0
DROP, DECAY, KINETIC = 0.2, 10.0, 0.1

Make = Callable[..., Scene]


def lining_effects(
    speed: list[list[float]], load: float = 1000.0, deviation: float = 1.0, **motion: Any
) -> list[dict[str, Any]]:
    disturbance = {'standard_deviation': deviation, 'unit': 'N'}
    return [
        {'speed_profile': {'unit': 'rpm', 'points': speed}},
        {'load_profile': {'unit': 'N', 'points': [[0.0, load]]}},
        {'lining_motion': {'disturbance': disturbance} | motion},
    ]


def truth_by_topic(scene: Scene, block_length: float = 60.0) -> dict[str, tuple[NDArray[Any], list[Any]]]:
    """Times and values of each truth topic of the bearing, by the topic's last part."""
    series: dict[str, tuple[list[float], list[Any]]] = {}
    for block in simulate(scene, block_length):
        for column in block.truth:
            times, values = series.setdefault(column.topic.rpartition('/')[2], ([], []))
            assert np.all(column.time >= block.start)
            assert np.all(column.time < block.end) or block.end == scene.duration
            times += column.time.tolist()
            values += list(column.values)
    return {name: (np.array(times), values) for name, (times, values) in series.items()}


def event_times(truth: dict[str, tuple[NDArray[Any], list[Any]]], scene: Scene) -> dict[str, list[float]]:
    """Seconds of each kind of event."""
    kinds: dict[str, list[float]] = {}
    for text in truth['events'][1]:
        event = json.loads(text)
        assert event['schema'] == 'stickslip_monitor/truth/1'
        kinds.setdefault(event['event'], []).append((event['time'] - scene.start_ns) / 1e9)
    return kinds


def test_the_cycle_is_the_exact_one(make_scene: Make) -> None:
    """Start at rest and reach 20 rpm in a second; the reference table gives the exact cycle."""
    scene = make_scene(
        effects=lining_effects([[0, 0], [1, 20]], deviation=0.0, amplitude={'rate': 2.0}), duration=12.0
    )
    truth = truth_by_topic(scene)
    times, values = truth['amplitude']
    assert np.array_equal(times, np.arange(1, 25) / 2.0)
    assert values[-4:] == pytest.approx([0.556755e-3] * 4, rel=1e-4)
    ends, lengths = truth['stick']
    assert np.diff(ends[-20:]) == pytest.approx(31.5903e-3, rel=1e-5)
    # All but the first stick, in which the shaft breaks away, are shorter than a period.
    assert max(lengths[1:]) < 31.6e-3
    assert lengths[0] > 1e-2


@pytest.mark.parametrize(('unit', 'of_amplitude'), [('um', 1e6), ('mm/s', 1e3 * OMEGA), ('m/s^2', OMEGA**2)])
def test_a_level_is_the_effective_value_of_the_exact_cycle(
    make_scene: Make, messages_of: Callable[..., Any], unit: str, of_amplitude: float
) -> None:
    """Expect that of a harmonic motion with half the peak to peak, 0.556755 mm at 20 rpm."""
    bearings = {'aft': {'level': {'topic': '/aft/level', 'unit': unit}}}
    rates = {name: {'rate': 2.0} for name in ('speed', 'load', 'level')}
    listed = lining_effects([[0, 0], [1, 20]], deviation=0.0)
    sent = messages_of(make_scene(bearings, effects=listed, duration=8.0, telemetry=rates))['/aft/level'].raw
    assert sent[-4:] == pytest.approx([0.556755e-3 * of_amplitude / math.sqrt(2.0)] * 4, rel=1e-4)


def test_steady_sliding_trembles_as_linear_theory_says(make_scene: Make) -> None:
    """White noise on a grid, joined linearly, has density ``sigma^2 dt sinc^4(omega dt/2)``."""
    rpm, sigma = 60.0, 5.0
    scene = make_scene(
        effects=lining_effects([[0, rpm]], deviation=sigma, motion={'rate': 50.0}), duration=80.0
    )
    speed = rpm * RPM
    truth = truth_by_topic(scene)
    x = np.array(truth['displacement'][1])
    mu = KINETIC + DROP * math.exp(-DECAY * speed)
    step = 1.0 / 128.0
    damping = DAMPING - 1000.0 * DROP * DECAY * math.exp(-DECAY * speed)

    def density(omega: float) -> float:
        force = (sigma * mu) ** 2 * step * np.sinc(omega * step / (2.0 * np.pi)) ** 4
        stiff = STIFFNESS - MASS * omega * omega
        return float(force / (stiff * stiff + (damping * omega) ** 2) / np.pi)

    variance = sum(quad(density, a, b, limit=500)[0] for a, b in ((0, 190), (190, 210), (210, 2000)))
    assert x.mean() == pytest.approx(1000.0 * mu / STIFFNESS, rel=1e-3)
    # Some 80 s * sigma = 3 per second of independent energy: 10 % in the standard deviation.
    assert x.std() == pytest.approx(math.sqrt(variance), rel=0.2)
    assert event_times(truth, scene) == {'start': [0.0], 'end': [80.0]}
    assert truth['stick'][1] == []


@pytest.mark.parametrize(('part', 'sticks'), [(0.97, False), (1.03, True)])
def test_a_knock_beyond_the_threshold_starts_stick_slip(make_scene: Make, part: float, sticks: bool) -> None:
    """At 34 rpm the unstable cycle's amplitude is 0.592815 mm; a blow J gives ``J/(m omega)``."""
    impulse = part * 0.592815e-3 * MASS * OMEGA
    scene = make_scene(
        effects=lining_effects([[0, 34]], deviation=0.0, knocks=[[1.005, impulse]]), duration=8.0
    )
    kinds = event_times(truth_by_topic(scene), scene)
    assert ('first_stick' in kinds) is sticks
    assert 'last_stick' not in kinds


def test_a_shaft_at_rest_is_no_stick_slip(make_scene: Make) -> None:
    # It stops with the lining stuck to it, which is sticking, not an episode.
    scene = make_scene(
        effects=lining_effects([[0, 60], [4, 60], [5, 0], [8, 0]], motion={'rate': 10.0}), duration=8.0
    )
    truth = truth_by_topic(scene)
    ends, lengths = truth['stick']
    assert ends[-1] == 8.0
    assert lengths[-1] == pytest.approx(3.0, abs=0.1)
    assert truth['sticking'][1][-20:] == [True] * 20
    kinds = event_times(truth, scene)
    if 'first_stick' in kinds:  # the last cycles before the stop, which is at 5 s
        assert kinds['last_stick'][0] <= 5.0


def assert_same(actual: dict[str, Any], expected: dict[str, Any]) -> None:
    assert actual.keys() == expected.keys()
    for name, (times, values) in expected.items():
        assert np.array_equal(times, actual[name][0]), name
        assert values == actual[name][1], name


def test_the_outcome_does_not_depend_on_the_blocks(make_scene: Make) -> None:
    """Compare bit for bit, with a disturbance, a knock, a drift, and an end off every grid."""
    listed = lining_effects(
        [[0, 40], [4, 24], [9, 46]],
        knocks=[[5.0, 0.5], [6.123, -0.3]],
        amplitude={'rate': 3.0},
        motion={'rate': 31.0},
    )
    listed.append({'friction_drift': {'parameter': 'static', 'points': [[1, 0.3], [8, 0.34]]}})
    listed.append({'operating_point': {'rate': 3.0}})
    scene = make_scene(effects=listed, duration=9.777)
    expected = truth_by_topic(scene, 100.0)
    for length in (60.0, 7.3, 0.37):
        assert_same(truth_by_topic(scene, length), expected)


@pytest.mark.skipif(find_spec('numba') is None, reason='compares with numba')
def test_with_and_without_numba_the_bits_are_the_same(
    make_scene: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = lining_effects([[0, 30], [8, 20]], motion={'rate': 100.0}, amplitude={'rate': 2.0})
    listed.append({'friction_drift': {'parameter': 'decay', 'points': [[0, 10], [8, 14]]}})
    scene = make_scene(effects=listed, duration=8.0)
    compiled = truth_by_topic(scene)
    monkeypatch.setattr(integrator, 'should_compile', lambda _: False)
    plain = truth_by_topic(scene)
    assert len(plain['stick'][1]) > 50
    assert_same(compiled, plain)


# Episodes, with a gap of one second allowed.


def episodes_of(*sticks: tuple[float, float], until: float = 100.0) -> list[EpisodeEvent]:
    episodes = Episodes(1.0)
    events: list[EpisodeEvent] = []
    for start, end in sticks:
        events += episodes.add_stick(start)
        if math.isfinite(end):
            episodes.release(end)
    return events + episodes.advance(until)


def last_stick_event(last_time: float, time: float, sticks: int, sticking: float) -> EpisodeEvent:
    return EpisodeEvent(last_time, 'last_stick', time, {'sticks': sticks, 'sticking': sticking})


@pytest.mark.parametrize(
    ('sticks', 'until', 'expected'),
    [
        # Sticks with short gaps are one episode.
        (
            [(10.0, 10.25), (11.0, 11.25), (12.25, 12.5)],
            100.0,
            [(11.0, 'first_stick', 10.0, {}), last_stick_event(13.5, 12.5, 3, 0.75)],
        ),
        # A longer gap parts two.
        (
            [(10.0, 10.25), (11.0, 11.25), (12.5, 12.75), (13.0, 13.5)],
            100.0,
            [
                (11.0, 'first_stick', 10.0, {}),
                last_stick_event(12.25, 11.25, 2, 0.5),
                (13.0, 'first_stick', 12.5, {}),
                last_stick_event(14.5, 13.5, 2, 0.75),
            ],
        ),
        # Single sticks are none.
        ([(10.0, 10.2), (20.0, 20.2), (30.0, 30.2)], 100.0, []),
        # It is not over before the gap, nor while a stick lasts.
        ([(10.0, 10.25), (11.0, 11.5)], 12.5, [(11.0, 'first_stick', 10.0, {})]),
        ([(10.0, 10.25), (11.0, math.inf)], 50.0, [(11.0, 'first_stick', 10.0, {})]),
    ],
)
def test_sticks_are_joined_to_episodes(
    sticks: list[tuple[float, float]], until: float, expected: list[Any]
) -> None:
    assert episodes_of(*sticks, until=until) == expected


# Instants and windows of a motion.
PERIOD = 0.03


def test_windows_give_the_amplitude_of_a_motion_that_grows() -> None:
    """``x = e t + A exp(t/5) sin(omega t)``: half the peak to peak over the last four periods."""
    omega, windows = 2.0 * np.pi / PERIOD, Samples(2.0, 10.0, PERIOD)
    t = windows.take_next_times(10.0)
    grown = 1e-3 * np.exp(t / 5.0)
    x = 1e-6 * t + grown * np.sin(omega * t)
    v = 1e-6 + grown * (np.sin(omega * t) / 5.0 + omega * np.cos(omega * t))
    windows.add(np.stack([x, v, x, v]))
    time, motion = windows.pop_due()
    amplitude = half_peak_to_peak(motion[0], motion[1], PERIOD / PER_PERIOD)
    assert np.array_equal(time, np.arange(1, 21) / 2.0)
    # The last maximum and minimum lie within the last period.
    assert amplitude == pytest.approx(1e-3 * np.exp((time - 0.5 * PERIOD) / 5.0), rel=4e-3)


def test_memory_does_not_grow_with_the_duration(make_scene: Make) -> None:
    """Simulate a scene block by block, as it is written."""
    peaks = []
    for duration in (300.0, 1200.0):
        parts = lining_effects([[0.0, 60.0], [100.0, 50.0]], amplitude={'rate': 5.0})
        scene = make_scene(effects=parts, duration=duration)
        tracemalloc.start()
        for _ in simulate(scene):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_peaks_between_samples_are_found_to_the_order_of_the_cubic() -> None:
    """Exact for a cubic: ``x = s^3 - s`` has its turning points at 1/sqrt(3)."""
    s = np.linspace(-1.1, 1.1, 8)
    amplitude = half_peak_to_peak((s**3 - s)[None], (3 * s * s - 1)[None], float(s[1] - s[0]))
    assert amplitude == pytest.approx(2.0 / 3.0 / np.sqrt(3.0), rel=1e-12)


# Friction that moves in time.
SPEEDS = np.linspace(-0.5, 0.5, 11)


def drift_effect(parameter: str, points: list[list[float]], **more: Any) -> dict[str, Any]:
    return {'friction_drift': {'parameter': parameter, 'points': points} | more}


@pytest.mark.parametrize(
    'law', [Stribeck(0.3, 0.1, 10.0, 0.02), Coulomb(0.3, 0.1), Tabulated([0.0, 0.1, 0.3], [0.3, 0.2, 0.1])]
)
def test_the_factor_multiplies_the_whole_coefficient(law: Any) -> None:
    scaled = replace_parameters(law, {'factor': 1.3})
    assert type(scaled) is type(law)
    assert scaled.static == pytest.approx(1.3 * law.static)
    assert scaled.coefficient(SPEEDS) == pytest.approx(1.3 * law.coefficient(SPEEDS))
    assert scaled.slope(SPEEDS) == pytest.approx(1.3 * law.slope(SPEEDS))
    parameters = ['static', 'kinetic', 'decay', 'viscous'] if isinstance(law, Stribeck) else []
    parameters = ['static', 'kinetic'] if isinstance(law, Coulomb) else parameters
    assert drifting_parameters(law) == (*parameters, 'factor')


def test_the_true_margins_follow_the_friction_there_is(make_scene: Make) -> None:
    """Halve beta and double the drop: ``v_H = -ln(kappa)`` stays, and ``V_H`` doubles."""
    listed = [
        *lining_effects([[0, 0], [1, 60]])[:2],
        {'operating_point': {'rate': 2.0}},
        drift_effect('decay', [[4, 10], [5, 5]]),
        drift_effect('static', [[4, 0.3], [5, 0.5]]),
    ]
    scene = make_scene(effects=listed, duration=10.0)
    truth = {name: values for name, (_, values) in truth_by_topic(scene, 3.3).items()}
    assert {len(values) for values in truth.values()} == {21}
    # The fold that decides is exact: averaging's is at 40.7231 rpm.
    hopf, fold = 30.7380, 40.7179
    assert np.array(truth['hopf_margin'])[[4, 12, 20]] == pytest.approx(
        [60 / hopf - 1, 60 / (2 * hopf) - 1, 60 / (2 * hopf) - 1], rel=1e-4
    )
    assert np.array(truth['fold_margin'])[[4, 12, 20]] == pytest.approx(
        [60 / fold - 1, 60 / (2 * fold) - 1, 60 / (2 * fold) - 1], rel=2e-5
    )
    assert truth['speed'][20] == pytest.approx(60 * np.pi * 0.1 / 60)
    assert truth['load'][20] == 1000.0
