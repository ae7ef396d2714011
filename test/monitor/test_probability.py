# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_monitor import Monitor, MonitorConfig, Sample, Stream, assess, fold_speed
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.assessment import BELIEFS, OUTCOMES, Outcome
from stickslip_monitor.monitor.messages import event_records, output_topics
from stickslip_monitor.monitor.probability import Held, Thresholds, decided_codes

Configure = Callable[..., MonitorConfig]
TOLERANCE = {'tolerance__damping': 0.3, 'tolerance__decay': 0.2, 'tolerance__scatter': 0.02}
CODE = {outcome: OUTCOMES.index(outcome) for outcome in Outcome}


def passage() -> Stream:
    """Down from 60 rpm to 20 and up again at 1 kN, a speed and a load a second."""
    second = np.arange(200)
    rpm = 20.0 + 0.4 * np.abs(second - 100)
    time = np.repeat(second * 10**9, 2)
    is_load = np.tile([False, True], 200)
    return Stream(time, is_load, np.where(is_load, 1000.0, np.repeat(rpm, 2)))


def test_live_and_batch_say_the_same_to_the_last_bit(configure: Configure) -> None:
    config, stream = configure(**TOLERANCE), passage()
    scan = Monitor(config).scan({'aft': stream})['aft']
    live = Monitor(config)
    verdicts, events = [], []
    for time, is_load, value in zip(stream.time_ns, stream.is_load, stream.value, strict=True):
        quantity = 'load' if is_load else 'speed'
        update = live.update(Sample('aft', quantity, int(time), float(value)))
        events += update.events
        if update.verdict is not None:
            verdicts.append(update.verdict.assessment)
    for name in BELIEFS:
        batch = getattr(scan.assessment, name)
        assert [getattr(point, name) for point in verdicts] == batch.tolist()
    assert event_records(events) == event_records(scan.events)
    assert all(event['probability_can'] > 0.0 for event in event_records(events))
    assert 'Stick-slip can happen with' in events[0].text


def test_memory_holds_what_began(configure: Configure) -> None:
    point = Monitor(configure(**TOLERANCE)).scan({'aft': passage()})['aft'].assessment
    down, up = point.speed.argmin() - 60, point.speed.argmin() + 60
    assert point.speed[down] == pytest.approx(point.speed[up], rel=0.02)
    assert point.probability_runs[down] == pytest.approx(point.probability_will[down])
    assert point.probability_runs[up] == pytest.approx(
        min(point.probability_can[up], point.probability_will.max()), rel=1e-9
    )


def test_without_tolerances_nothing_is_said(configure: Configure) -> None:
    config = configure()
    assert config.bearing('aft').belief is None
    point = assess(config.bearing('aft').bearing, [0.1, 0.2], 1000.0)
    assert all(np.isnan(getattr(point, name)).all() for name in BELIEFS)
    (first, *_) = Monitor(config).scan({'aft': passage()})['aft'].events
    (record,) = event_records([first])
    assert [record[name] for name in BELIEFS] == [None] * len(BELIEFS)
    assert 'can happen' not in record['text']
    topics = [set(output_topics(c.bearings, '/m')) for c in (config, configure(**TOLERANCE))]
    assert topics[1] - topics[0] == {f'/m/aft/{name}' for name in BELIEFS}


def test_thresholds_of_a_half_are_the_regime(configure: Configure) -> None:
    bearing = configure(tolerance__damping=1e-6).bearing('aft')
    random = np.random.default_rng(1)
    speed, load = random.uniform(0.0, 0.4, 500), random.uniform(-100.0, 2000.0, 500)
    speed[::50] = 0.0
    point = assess(bearing.bearing, speed, load, bearing.belief)
    # Each point by itself: what is held is tested below.
    found = [
        decided_codes(
            point.outcome_code[k : k + 1],
            point.probability_can[k : k + 1],
            point.probability_will[k : k + 1],
            Thresholds(),
        )[0][0]
        for k in range(500)
    ]
    stable = {CODE[Outcome.NO_BOUNDARY]: CODE[Outcome.NO_CYCLE]}
    known = [stable.get(code, code) for code in point.outcome_code.tolist()]
    assert [stable.get(int(code), int(code)) for code in found] == known


def test_a_threshold_is_left_below_half_of_it() -> None:
    can = np.array([0.04, 0.06, 0.3, 0.6, 0.3, 0.24, 0.03, 0.024])
    will = np.array([0.0, 0.0, 0.0, 0.2, 0.09, 0.0, 0.0, 0.0])
    code = np.full(8, CODE[Outcome.NO_CYCLE], np.int8)
    decided, caution, after = decided_codes(code, can, will, Thresholds(0.5, 0.1, 0.05))
    names = [OUTCOMES[k].value for k in decided]
    assert names == [
        'no_cycle', 'no_cycle', 'no_cycle', 'stick_slip', 'stick_slip', 'no_cycle', 'no_cycle',
        'no_cycle',
    ]  # fmt: skip
    assert caution.tolist() == [False, True, True, True, True, True, True, False]
    assert after == Held()
    held = decided_codes(code[:1], can[2:3], will[:1], Thresholds(), Held(can=True))
    assert (OUTCOMES[held[0][0]], held[2]) == (Outcome.BISTABLE, Held(True, False, True))
    resting = np.array([CODE[Outcome.AT_REST]], np.int8)
    nan = np.array([math.nan])
    assert decided_codes(resting, nan, nan, Thresholds(), Held(True))[0] == resting


def calibration(**changes: Any) -> dict[str, Any]:
    sensor = {'field': 'data', 'scale': 1.0, 'offset': 0.0}
    return {
        'schema': 'stickslip_monitor/calibration/1',
        'bearing': 'aft',
        'inputs': {
            'speed': sensor | {'topic': '/shaft/speed', 'unit': 'rpm'},
            'load': sensor | {'topic': '/bearing/aft/load', 'unit': 'N'},
        },
        'parameters': ['ln_beta', 'ln_n0', 'ln_tau', 'ln_tau_e', 'ln_lambda', 'ln_s'],
        'draws': [[math.log(10.0), math.log(200.0), 0.0, 0.0, 0.0, -6.0]] * 8,
        'viscous': 0.0,
        'loads': [500.0, 1500.0],
        'floor': 0.01,
    } | changes


def test_a_calibration_takes_the_place_of_tolerances(configure: Configure, tmp_path: Path) -> None:
    path = tmp_path / 'aft.calibration.json'
    path.write_text(json.dumps(calibration()))
    aft = configure(damping=900.0, calibration=str(path)).bearing('aft')
    belief = aft.belief
    assert belief is not None
    rpm = math.pi * 0.1 / 60.0
    assert belief.fold_speed(1000.0, 0.5) / rpm == pytest.approx(40.723, rel=1e-4)
    # So regime and margins are those of its middle.
    assert fold_speed(aft.bearing, 1000.0) / rpm == pytest.approx(40.723091, rel=1e-6)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'speed__scale': 1.1}, r'made with speed.scale = 1.0, and it is 1.1 now'),
        ({'load__topic': '/other'}, r"made with load.topic = '/bearing/aft/load'"),
    ],
)
def test_a_calibration_of_other_sensors_is_refused(
    configure: Configure, tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    path = tmp_path / 'c.json'
    path.write_text(json.dumps(calibration()))
    with pytest.raises(ConfigurationError, match=words):
        configure(calibration=str(path), **changes)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (json.dumps(calibration(bearing='fore')), "a calibration of 'fore' and not of 'aft'"),
        (json.dumps(calibration(schema='x/1')), "schema 'x/1' and must have"),
        (json.dumps(calibration(draws=[])), 'is damaged'),
        (json.dumps(calibration(loads=[0.0, 1.0])), 'is damaged: its draws, loads'),
        ('{', 'is not JSON'),
        (None, 'No such file'),
    ],
)
def test_a_bad_calibration_is_refused(
    configure: Configure, tmp_path: Path, text: str | None, words: str
) -> None:
    path = tmp_path / 'c.json'
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigurationError, match=words):
        configure(calibration=str(path))


def test_a_tolerance_needs_a_law_with_boundaries(configure: Configure) -> None:
    with pytest.raises(ConfigurationError, match='aft: a tolerance needs the friction law'):
        configure(friction__law='coulomb', tolerance__damping=0.1)
    with pytest.raises(ConfigurationError, match=r'tolerance\.damping = -0\.1 must be'):
        configure(tolerance__damping=-0.1)
