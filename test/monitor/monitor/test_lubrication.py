# SPDX-License-Identifier: Apache-2.0
"""Friction at its load and temperature, through the monitor: held against laws written out for them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sending import Ship, configured
from shared import CONFIG, RPM

from stickslip_monitor import Assessments, Monitor, Sample, Stream, assess, exact_fold_speed
from stickslip_monitor.cli import main
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config_questions import questions
from stickslip_monitor.monitor.rule_over_arrays import BearingScan
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.physics.lubrication import viscosity

LOAD = 2500.0
MEASURED = {'friction__at_load': 1000.0, 'friction__load_exponent': 0.8, 'friction__at_temperature': 15.0}
HERE: dict[str, Any] = {**MEASURED, 'water_temperature__constant': 5.0}
SCALE = (LOAD / 1000.0) ** 0.8 * viscosity(15.0) / viscosity(5.0)
WRITTEN_OUT = {'friction__decay': 10.0 / SCALE}
ALL = [
    *('hopf_speed', 'fold_speed', 'fold_speed_kbm', 'hopf_margin', 'fold_margin', 'fold_margin_kbm'),
    *('stability_margin', 'growth_rate', 'amplitude', 'threshold_amplitude', 'amplitude_exact', 'lower_end'),
    'fold_share',
]


def both_bearings(**changes: Any) -> list[Any]:
    return [configured(**changes, **parameters).bearings[0] for parameters in (HERE, WRITTEN_OUT)]


def hour_of_speeds() -> Stream:
    """Return an hour of speeds from 200 to 20 rpm and back at one load."""
    seconds = np.arange(3600)
    rpm = 110.0 + 90.0 * np.cos(2.0 * np.pi * seconds / 3600.0)
    time = np.repeat(seconds * 10**9, 2)
    values = np.column_stack([np.full(3600, LOAD), rpm]).ravel()
    return Stream(time, np.tile([1, 0], 3600), values)


@pytest.mark.parametrize('points', [10, 200])
def test_an_assessment_equals_that_of_the_law_written_out(points: int) -> None:
    lubricated, written_out = both_bearings()
    speed = np.linspace(5.0, 250.0, points) * RPM
    actual, expected = (assess(config.bearing, speed, LOAD) for config in (lubricated, written_out))
    assert actual.regime.tolist() == expected.regime.tolist()
    assert len(set(actual.regime.tolist())) == 3
    for name in ALL:
        # The two boundaries' tables are of two laws, each right to 1e-7.
        close = 1e-12 if points < 64 else 1e-6
        columns = (getattr(config, name) for config in (actual, expected))
        assert np.allclose(*columns, rtol=close, atol=1e-300 + 1e-6 * (points > 64), equal_nan=True), name
    single = assess(lubricated.bearing, float(speed[3]), LOAD)
    for name in ALL:
        assert getattr(single, name) == pytest.approx(getattr(actual, name)[3], rel=1e-6, nan_ok=True), name


def test_loads_of_an_assessment_lie_on_the_boundaries() -> None:
    bearing = configured(**HERE).bearings[0].bearing
    speed = np.array([40.0, 90.0]) * RPM
    point = assess(bearing, speed, LOAD)
    assert np.allclose(assess(bearing, speed, point.fold_load).fold_margin, 0.0, atol=1e-7)
    assert np.allclose(assess(bearing, speed, point.hopf_load).hopf_margin, 0.0, atol=1e-12)


def test_temperatures_of_points_are_those_of_the_bearing() -> None:
    bearing = configured(**HERE).bearings[0].bearing
    speed, water = np.linspace(20.0, 150.0, 7) * RPM, np.linspace(0.0, 30.0, 7)
    together = assess(bearing, speed, LOAD, temperature=water)
    assert isinstance(together, Assessments)
    for k in range(7):
        alone = assess(bearing.at_temperature(float(water[k])), float(speed[k]), LOAD)
        for name in (*ALL, 'hopf_load', 'fold_load'):
            expected = getattr(alone, name)
            assert getattr(together, name)[k] == pytest.approx(expected, rel=1e-11, nan_ok=True), name
            assert getattr(together.at(k), name) == pytest.approx(expected, rel=1e-11, nan_ok=True), name


def test_changes_of_condition_are_those_of_the_law_written_out() -> None:
    for changes in ({}, {'tolerance__decay': 0.1, 'tolerance__damping': 0.2, 'tolerance__static': 0.05}):
        scans = [
            BearingScan(config, 0, long=long).finish(hour_of_speeds(), None)
            for config, long in zip(
                [*both_bearings(**changes), both_bearings(**changes)[0]], (False, False, True), strict=True
            )
        ]
        events = [
            [(e.time_ns, e.before, e.after, e.text.replace(', water at 5 C', '')) for e in scan.events]
            for scan in scans
        ]
        assert all(', water at 5 C' in event.text for event in scans[0].events)
        assert len(events[0]) > 4
        assert events[0] == events[1] == events[2]
        if changes:
            assert np.allclose(scans[0].chances, scans[1].chances, atol=2e-3)


def test_an_error_of_the_load_moves_speed_and_load_together() -> None:
    # At g = 1 a boundary is in proportion to the load: its error is one of the speed.
    parameters = {**MEASURED, 'friction__load_exponent': 1.0, 'tolerance__load': 0.1}
    by_load = configured(**parameters).bearings[0].belief
    by_speed = configured(**MEASURED, tolerance__speed=0.1).bearings[0].belief
    assert by_load is not None
    assert by_speed is not None
    for p in (0.05, 0.5, 0.95):
        assert by_load.fold_speed(1000.0, p) == pytest.approx(by_speed.fold_speed(1000.0, p), rel=1e-9)


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'friction__load_exponent': 1.0}, "parameter 'aft.friction.at_load' is missing"),
        ({'water_temperature__constant': 5.0}, "parameter 'aft.friction.at_temperature' is missing"),
        ({'water_temperature__constant': 288.0}, 'must be a finite number between -2 and 60 C'),
        ({'friction__load_exponent': 2.0, 'friction__at_load': 1.0}, 'and 1'),
    ],
)
def test_missing_parameters_and_values_out_of_range_are_refused(
    parameters: dict[str, float], text: str
) -> None:
    with pytest.raises(ConfigurationError, match=text):
        configured(**parameters)


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'friction__at_load': 1000.0}, 'without friction.load_exponent'),
        ({'friction__at_temperature': 15.0}, 'without water_temperature.constant or .topic'),
    ],
)
def test_parameters_without_effect_are_noted(parameters: dict[str, float], text: str) -> None:
    (note,) = configured(**parameters).notes
    assert text in note


def test_the_water_may_be_fresh_where_friction_was_measured() -> None:
    parameters = {**MEASURED, 'friction__at_salinity': 0.0, 'water_temperature__constant': 15.0}
    lubrication = configured(**parameters).bearings[0].bearing.lubrication
    assert lubrication is not None
    expected = viscosity(15.0) / viscosity(15.0, 0.0)
    assert math.isclose(lubrication.viscosity_ratio, expected, rel_tol=1e-15)


def test_the_temperature_may_change_while_the_monitor_runs() -> None:
    """Keep the memory of the lining and compute no belief again."""
    tolerant = {**HERE, 'tolerance__decay': 0.1}
    monitor = Monitor(configured(**tolerant))
    for quantity, value in (('load', LOAD), ('speed', 100.0)):
        update = monitor.update(Sample('aft', quantity, 10**9, value))
    assert update.verdict is not None
    cold = update.verdict.assessment.fold_speed
    warm = configured(**{**tolerant, 'water_temperature__constant': 25.0})
    assert warm.bearings[0].belief is monitor.config.bearings[0].belief
    monitor.retune(warm)
    update = monitor.update(Sample('aft', 'speed', 2 * 10**9, 100.0))
    assert update.verdict is not None
    expected = exact_fold_speed(configured(**WRITTEN_OUT).bearings[0].bearing, LOAD)
    assert cold == pytest.approx(expected, rel=1e-7)
    assert update.verdict.assessment.fold_speed > 1.05 * cold  # thinner water, in which friction falls later


def test_blades_raise_a_question_where_they_meet_the_lining() -> None:
    config = configured(stiffness=2.0e4).bearings[0]  # 3.18 Hz: four blades at 47.7 rpm
    (clause,) = [text for text in questions(config, 1000.0)['load'] if 'blades' in text]
    assert '3.18 Hz' in clause
    assert '47.7 rpm of 4' in clause
    assert not any('blades' in text for text in questions(configured().bearings[0], 1000.0)['load'])


def test_propellers_of_three_to_seven_blades_raise_a_question() -> None:
    """At 2.757 Hz the blades meet the lining at 165.4 rpm over their number."""
    config = configured(stiffness=1.5e4).bearings[0]
    (clause,) = [text for text in questions(config, 1000.0)['load'] if 'blades' in text]
    assert '(55.1 rpm of 3, 41.3 rpm of 4, 33.1 rpm of 5, 27.6 rpm of 6, 23.6 rpm of 7)' in clause


WATERED: dict[str, Any] = {**MEASURED, 'water_temperature__topic': '/water'}


def add_water(stream: Stream, celsius: Any, every: int = 60) -> Stream:
    """Add a temperature of the water before every so many samples of a voyage."""
    rows = np.arange(0, stream.time_ns.size, every)
    values = np.broadcast_to(np.asarray(celsius, float), rows.shape)
    time = np.insert(stream.time_ns, rows, stream.time_ns[rows])
    inputs = np.insert(stream.inputs, rows, Input.WATER_TEMPERATURE)
    return Stream(time, inputs, np.insert(stream.value, rows, values))


def scan_events(config: Any, stream: Stream, *, long: bool) -> tuple[Any, list[Any]]:
    scan = BearingScan(config, 0, long=long).finish(stream, None)
    return scan, [(e.time_ns, e.before, e.after, e.text) for e in scan.events]


@pytest.mark.parametrize('more', [{}, {'tolerance__decay': 0.1, 'tolerance__damping': 0.2}])
def test_a_measured_temperature_is_the_same_one_configured(more: dict[str, Any]) -> None:
    # Sample by sample, over a recording, and compiled; in kelvin, too.
    (constant,) = configured(**HERE, **more).bearings
    expected, expected_events = scan_events(constant, hour_of_speeds(), long=False)
    assert len(expected_events) > 4
    for parameters, number in ((WATERED, 5.0), (WATERED | {'water_temperature__unit': 'K'}, 278.15)):
        (config,) = configured(**parameters, **more).bearings
        stream = add_water(hour_of_speeds(), number)
        for long in (False, True):
            scan, actual_events = scan_events(config, stream, long=long)
            assert actual_events == expected_events
            np.testing.assert_allclose(scan.water, 5.0, rtol=1e-12)
            for name in ('speed', 'load', 'rung', 'sticking'):
                assert getattr(scan, name).tolist() == getattr(expected, name).tolist()
            points, expected_points = scan.assessment, expected.assessment
            np.testing.assert_allclose(
                points.fold_margin, expected_points.fold_margin, rtol=1e-6, equal_nan=True
            )
        monitor = Monitor(configured(**parameters, **more))
        rows = zip(stream.inputs.tolist(), stream.time_ns.tolist(), stream.value.tolist(), strict=True)
        events = [e for row in rows for e in monitor.bearings['aft'].update(*row).events]
        assert [(e.time_ns, e.before, e.after, e.text) for e in events] == expected_events
        counts = monitor.bearings['aft'].counts
        assert counts.sum(axis=1).tolist() == [3600, 3600, 0, 120]


def test_water_that_warms_up_moves_the_boundaries_with_it() -> None:
    # Each point has the boundaries of its own water; compiled and interpreted are equal.
    (config,) = configured(**WATERED).bearings
    stream = add_water(hour_of_speeds(), np.linspace(0.0, 30.0, 120))
    scan, events = scan_events(config, stream, long=False)
    compiled, compiled_events = scan_events(config, stream, long=True)
    assert (events, scan.water.tolist()) == (compiled_events, compiled.water.tolist())
    assert (scan.water[0], scan.water[-1]) == (0.0, 30.0)
    for k in (0, 1800, 3599):
        bearing = config.bearing.at_temperature(float(scan.water[k]))
        expected = exact_fold_speed(bearing, LOAD)
        assert scan.assessment.fold_speed[k] == pytest.approx(expected, rel=1e-6)
        assert scan.fold_speed(np.array([k])) == pytest.approx(expected, rel=1e-6)
    # The rule goes by it, too: colder water alone changes what is told.
    cold = scan_events(config, add_water(hour_of_speeds(), 0.0), long=False)[1]
    assert [event[0] for event in cold] != [event[0] for event in events]


@pytest.mark.parametrize(
    ('more', 'text'),
    [
        ({}, 'water at 15 C (not measured yet, as where friction was measured)'),
        ({'water_temperature__constant': 5.0}, 'water at 5 C (not measured yet, as configured)'),
    ],
)
def test_water_that_is_not_measured_is_no_all_clear(more: dict[str, Any], text: str) -> None:
    ship = Ship(configured(**WATERED, **more, water_temperature__timeout=60.0))
    assert text in ship.sail(10.0, 200.0)['text']
    ship.take('aft', Input.WATER_TEMPERATURE, 12.0)
    record = ship.sail(10.0, 200.0)
    assert 'water at 12 C, ' in record['text']
    assert (record['severity'], record['inputs']['water_temperature']['lost']) == ('OK', False)
    record = ship.sail(90.0, 200.0)
    assert 'water at 12 C (not measured for ' in record['text']
    assert (record['severity'], record['inputs']['water_temperature']['lost']) == ('WARN', True)
    assert 'No messages on /water.' in record['text']
    ship.take('aft', Input.WATER_TEMPERATURE, 99.0)  # no water of a stern tube
    assert 'water at 12 C' in ship.sail(5.0, 200.0)['text']
    ship.take('aft', Input.WATER_TEMPERATURE, 13.0)
    record = ship.sail(10.0, 200.0)
    assert 'water at 13 C, ' in record['text']
    assert record['severity'] == 'OK'


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'water_temperature__topic': '/water'}, "parameter 'aft.friction.at_temperature' is missing"),
        (MEASURED | {'water_temperature__scale': 2.0}, "parameter 'aft.water_temperature.topic' is missing"),
        (MEASURED | {'water_temperature__topic': '/shaft/speed'}, 'is read from the same field as the speed'),
        (MEASURED | {'water_temperature__unit': 'F'}, 'must be one of C, K'),
    ],
)
def test_requirements_of_a_measured_temperature(parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        configured(**parameters)


def test_a_column_of_a_log_may_have_the_temperature(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, log = tmp_path / 'ship.yaml', tmp_path / 'a.csv'
    text = CONFIG.read_text('utf-8')
    water = "decay: 10.0, at_temperature: 15.0}\n      water_temperature: {column: 'SST [C]', timeout: 100.0}"
    config.write_text(text.replace('decay: 10.0}', water), 'utf-8')
    rows = ''.join(f'{t},{136 - 0.05 * t:.2f},1000,{5 + 0.01 * t if t < 300 else ""}\n' for t in range(600))
    log.write_text('time,speed [rpm],load [N],SST [C]\n' + rows, 'utf-8')
    main(['check', str(log), '--config', str(config), '--json', '--report', str(tmp_path / 'r.html')])
    document = json.loads(capsys.readouterr().out)
    (bearing,) = document['bearings'].values()
    water = bearing['inputs']['water_temperature']
    assert (water['messages'], water['used'], water['values']) == (300, 300, '5 to 7.99 C')
    assert any('is in doubt at the end: not measured for 5' in text for text in water['questions'])
