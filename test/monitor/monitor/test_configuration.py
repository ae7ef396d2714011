# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import contextlib
import copy
import json
import os
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sending import configured, points
from shared import REFERENCE, REFERENCE_BEARING, RPM

from stickslip_monitor import Monitor, build_config, fold_speed
from stickslip_monitor.errors import ConfigurationError, StickslipError
from stickslip_monitor.monitor.calibration_file import sensor_record
from stickslip_monitor.monitor.config_questions import questions

SENSOR = {'field': 'data', 'scale': 1.0, 'offset': 0.0}
SENSORS: dict[str, dict[str, Any]] = {
    'speed': SENSOR | {'topic': '/shaft/speed', 'unit': 'rpm'},
    'load': SENSOR | {'topic': '/bearing/aft/load', 'unit': 'N'},
}
LAW = {'static': 0.3, 'kinetic': 0.1, 'decay': 10.0, 'law': 'stribeck'}
RESULT: dict[str, Any] = {
    'schema': 'stickslip_monitor/calibration/2',
    'bearing': 'aft',
    'inputs': SENSORS,
    'parameters': {'damping': 400.0} | {f'friction.{name}': value for name, value in LAW.items()},
    'factors': {'speeds': 1.1, 'loads': 0.9},
    'covariance': [[1e-3, -1e-3], [-1e-3, 2e-3]],
    'loads': [500.0, 1500.0],
    'floor': 0.01,
}
ODD = (None, True, 'x', '', [], {}, [[]], -1, 0, 1e308, float('nan'), float('inf'), 10**400)


def mutate(document: Any, source: random.Random) -> Any:
    """Return a copy with one value, at any depth, replaced or left out."""
    result = copy.deepcopy(document)
    place, parent = None, result
    while isinstance(parent, dict | list) and parent and (place is None or source.random() < 0.7):
        keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))
        place = (parent, source.choice(keys))
        parent = parent[place[1]]
    assert place is not None
    container, key = place
    if source.random() < 0.3:
        del container[key]
    else:
        container[key] = copy.deepcopy(source.choice(ODD))
    return result


def test_a_damaged_result_is_refused_in_a_sentence(tmp_path: Path) -> None:
    source, path, read = random.Random(1), tmp_path / 'result.json', 0
    for _ in range(150):
        path.write_text(json.dumps(mutate(RESULT, source)))
        with contextlib.suppress(StickslipError):
            configured(calibration=str(path))
            read += 1
    assert 0 < read < 150


@pytest.mark.parametrize('kind', ['pipe', 'device', 'nested'])
def test_a_pipe_or_device_as_a_file_of_results_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / 'given'
    if kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'device':
        path.symlink_to('/dev/zero')
    else:
        path.write_text('[' * 100_000)
    with pytest.raises(ConfigurationError, match=r'it is a pipe|it is a device|nested too deeply'):
        configured(calibration=str(path))


@pytest.fixture
def calibration_path(tmp_path: Path) -> str:
    """Return the path of a file with the result of a calibration."""
    path = tmp_path / 'aft.calibration.json'
    path.write_text(json.dumps(RESULT))
    return str(path)


def test_a_calibration_takes_the_place_of_tolerances(calibration_path: str) -> None:
    aft = configured(damping=900.0, calibration=calibration_path).bearing('aft')
    belief = aft.belief
    assert belief is not None
    assert belief.fold_speed(1000.0, 0.5) / RPM == pytest.approx(40.723, rel=1e-4)
    # So regime and margins are those of its middle.
    assert fold_speed(aft.bearing, 1000.0) / RPM == pytest.approx(40.723091, rel=1e-6)


def test_evidence_of_onsets_moves_the_belief_and_no_alarm(calibration_path: str) -> None:
    law = {f'friction.{name}': value for name, value in (LAW | {'decay': 2.0 * LAW['decay']}).items()}
    Path(calibration_path).write_text(json.dumps(RESULT | {'believed': {'damping': 400.0} | law}))
    aft = configured(damping=900.0, calibration=calibration_path).bearing('aft')
    assert aft.belief is not None
    # A law of twice the decay has all boundaries at half the speed, by the scale of v in mu(v).
    ratio = aft.belief.fold_speed(1000.0, 0.5) / fold_speed(aft.bearing, 1000.0)
    assert ratio == pytest.approx(
        fold_speed(aft.belief.bearing, 1000.0) / fold_speed(REFERENCE_BEARING, 1000.0), rel=1e-3
    )
    assert 0.4 < ratio < 0.9


def test_a_calibrated_bearing_alarms_as_if_it_were_configured(calibration_path: str) -> None:
    scans = [
        Monitor(config).scan({'aft': points(20.0 + 0.4 * np.abs(np.arange(200) - 100), 1000.0)})['aft']
        for config in (configured(damping=900.0, calibration=calibration_path), configured())
    ]
    calibrated_events, configured_events = ([(e.time_ns, e.after) for e in scan.events] for scan in scans)
    assert calibrated_events == configured_events
    assert len(calibrated_events) > 3
    assert np.nanmax(scans[0].assessment.probability_runs) > 0.9


@pytest.mark.parametrize(
    ('damage', 'changes', 'words'),
    [
        ({'bearing': 'fore'}, {}, "a calibration of 'fore' and not of 'aft'"),
        ({'schema': 'x/1'}, {}, "schema 'x/1' and must have"),
        (
            {'loads': [0.0, 1.0]},
            {},
            r'is damaged: loads = \[0.0, 1.0\] must be a list of finite numbers above 0',
        ),
        ({'loads': [2.0, 1.0]}, {}, 'is damaged: its covariance must be finite, and its loads rise'),
        ({'covariance': [[0.01]]}, {}, 'is damaged: its covariance'),
        ({'covariance': [[200.0, 0.0], [0.0, 0.01]]}, {}, 'is damaged: its covariance'),
        ({'floor': 1.5}, {}, 'is damaged: floor = 1.5 must be a finite number between 0 and 1'),
        (
            {'schema': 'stickslip_monitor/calibration/1'},
            {},
            'made by an earlier version.*with `stickslip calibrate BAG',
        ),
        ({'parameters': {'damping': 1.0}}, {}, 'is damaged'),
        (None, {}, 'is not JSON'),
        ({}, {'speed__scale': 1.1}, 'made with speed.scale = 1.0, and it'),
        ({}, {'load__topic': '/other'}, "made with load.topic = '/bearing"),
    ],
)
def test_a_bad_calibration_or_one_of_other_sensors_is_refused(
    calibration_path: str, damage: dict[str, Any] | None, changes: dict[str, Any], words: str
) -> None:
    Path(calibration_path).write_text('{' if damage is None else json.dumps(RESULT | damage))
    with pytest.raises(ConfigurationError, match=words):
        configured(calibration=calibration_path, **changes)


@pytest.mark.parametrize('content', [None, b'', bytes(999), b'{"schema": "stickslip_monitor/calibration/1"}'])
def test_a_ship_is_monitored_without_a_calibration_that_cannot_be_read(
    tmp_path: Path, content: bytes | None
) -> None:
    path = tmp_path / 'aft.calibration.json'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigurationError):
        configured(calibration=str(path))
    config = configured(is_live=True, calibration=str(path))
    assert config == configured()
    assert len(config.faults) == 1
    assert config.faults[0].startswith('aft: the calibration is damaged or missing')


def test_a_calibration_holds_with_what_stands_for_a_load(tmp_path: Path) -> None:
    """Accept a calibration with a constant load; refuse it with another table, or another gear."""
    values = {'bearings': ['aft']} | {f'aft.{name}': value for name, value in REFERENCE.items()}
    del values['aft.load.topic']
    values |= {'aft.calibration': str(tmp_path / 'aft.json'), 'aft.load.over_speed': [0, 2, 60, 1]}
    plain = build_config({name: value for name, value in values.items() if name != 'aft.calibration'})
    config = plain.bearing('aft')
    inputs = {'speed': sensor_record(config.speed), 'load': sensor_record(config.load)}
    (tmp_path / 'aft.json').write_text(json.dumps(RESULT | {'inputs': inputs}), 'utf-8')
    assert build_config(values).bearing('aft').belief is not None
    for name, value in (('load.over_speed', [0.0, 2.0, 60.0, 1.5]), ('speed.gear', 4.2)):
        with pytest.raises(ConfigurationError, match=f'was made with {name} = .* and it is .* now'):
            build_config(values | {f'aft.{name}': value})


def test_a_calibration_of_another_bearing_is_refused_live_too(calibration_path: str) -> None:
    Path(calibration_path).write_text(json.dumps(RESULT | {'bearing': 'fore'}))
    with pytest.raises(ConfigurationError, match="a calibration of 'fore' and not of 'aft'"):
        configured(is_live=True, calibration=calibration_path)


def ask_questions(load: float = 1000.0, **changes: object) -> list[str]:
    (bearing,) = configured(**changes).bearings
    by_subject = questions(bearing, load)
    return [f'{name} {clause}' for name, clauses in by_subject.items() for clause in clauses]


def test_nothing_is_asked_of_a_right_bearing() -> None:
    assert ask_questions() == []
    assert ask_questions(load=0.0) == []
    assert ask_questions(alarm__minimum_speed=0.02) == []


@pytest.mark.parametrize(
    ('changes', 'clause'),
    [
        (
            {'alarm__minimum_speed': 0.5},
            # 0.5/0.2132 = 2.3; 0.5 m/s on a journal of 0.1 m are 95.5 rpm.
            'speed counts as rest up to 0.5 m/s (95.5 rpm), 2.3 times the fold speed',
        ),
        ({'journal_diameter': 100.0}, 'speed turns a journal of 100 m'),
        ({'stiffness': 2.0}, 'at 0.0318 Hz: are mass and stiffness'),  # with 20 times critical damping
        ({'damping': 4e5}, 'with 20 times its critical damping'),
        # sqrt(2e5/5000) rad/s = 6.32; so lightly damped the fold is averaging's: 0.2132/6.32 m.
        ({'stiffness': 2e5, 'mass': 5000.0}, 'would move the lining by 0.0337 m'),
        # sqrt(2e6/1e-5)/(2 pi) Hz.
        ({'mass': 1.0e-5, 'damping': 1.0}, 'at 7.12e+04 Hz'),
        ({'alarm__amplitude_limit': 0.9}, 'load may move the lining by 0.9 m'),
        ({'friction__static': 0.1, 'friction__kinetic': 0.3}, 'are static and kinetic swapped?'),
        (
            {
                'friction__law': 'tabulated',
                'friction__speed': [0.0, 0.01, 0.1],
                'friction__coefficient': [0.01, 0.25, 0.1],
            },
            'begins with 0.01, far below its next value 0.25',
        ),
        (
            {
                'friction__law': 'tabulated',
                'friction__speed': [0.0, 0.05, 0.1],
                'friction__coefficient': [0.3, 0.25, 0.2],
            },
            # 0.05/0.05 s/m; c/N = 400/1000 s/m; 0.1 m/s of a 0.1 m journal are 19.1 rpm.
            'highest measured speed, 0.1 m/s (19.1 rpm), by 1 s/m, and 0.4 s/m are enough',
        ),
    ],
)
def test_a_slip_raises_a_question(changes: dict[str, object], clause: str) -> None:
    assert any(clause in text for text in ask_questions(**changes)), ask_questions(**changes)


def test_a_retired_parameter_has_no_effect_and_a_sentence() -> None:
    # A file of the last version is not refused for it.
    (note,) = configured(alarm__trend_window='whatever').notes
    assert note.startswith('aft.alarm.trend_window has no effect and will be refused in a later version')


@pytest.mark.parametrize(
    ('law', 'parameter', 'value', 'has_no_effect'),
    [
        ({'law': 'coulomb'}, 'decay', 10.0, True),
        ({'law': 'coulomb'}, 'speed', [0.0, 1.0], True),
        ({'law': 'tabulated', 'speed': [0.0, 0.2], 'coefficient': [0.3, 0.2]}, 'viscous', 0.1, True),
        ({'law': 'coulomb'}, 'viscous', 0.0, False),  # as all that are declared over ROS are given
        ({'law': 'coulomb'}, 'coefficient', [], False),
        ({'law': 'stribeck'}, 'viscous', 0.1, False),
    ],
)
def test_a_parameter_that_a_law_does_not_take_is_named(
    law: Any, parameter: str, value: Any, has_no_effect: bool
) -> None:
    parameters = law | {parameter: value}
    config = configured('aft', {f'friction.{key}': value for key, value in parameters.items()})
    named = [note for note in config.notes if note.startswith(f'aft.friction.{parameter} = ')]
    assert bool(named) == has_no_effect
    assert all(f'has no effect: the law {law["law"]} takes ' in note for note in named)


@pytest.mark.parametrize(('more', 'has_no_effect'), [({}, True), ({'tolerance__damping': 0.1}, False)])
def test_a_probability_without_tolerances_is_named(more: dict[str, float], has_no_effect: bool) -> None:
    notes = configured(alarm__can_probability=0.4, **more).notes
    named = [note for note in notes if note.startswith('aft.alarm.can_probability = 0.4 has no effect: ')]
    assert len(notes) == len(named) == has_no_effect


@pytest.mark.parametrize(('more', 'has_no_effect'), [({}, False), ({'tolerance__damping': 0.1}, True)])
def test_a_margin_of_caution_beside_tolerances_is_named(more: dict[str, float], has_no_effect: bool) -> None:
    notes = configured(alarm__caution_margin=5.0, **more).notes
    named = [note for note in notes if 'goes by alarm.caution_probability' in note]
    assert len(notes) == len(named) == has_no_effect
