# SPDX-License-Identifier: Apache-2.0
"""What is published of a bearing has the declared fields, keeps the installed schemas, and its keys."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sending import configured, feed
from shared import SCHEMAS, schema_complaints

from stickslip_monitor import Monitor
from stickslip_monitor.monitor.assessment import Assessments
from stickslip_monitor.monitor.bearing_records import (
    BearingState,
    NodeHealth,
    bearing_record,
    bearings_json,
    diagnostic_record,
    event_record,
    health_record,
    output_topics,
)
from stickslip_monitor.monitor.input_faults import InputState
from stickslip_monitor.monitor.record_fields import ASSESSMENT, BEARING, NUMBERS, WARNING
from stickslip_monitor.monitor.severity import Severity

LEVEL = {'level__topic': '/level', 'level__unit': 'mm/s', 'level__threshold': 2.0}
# As docs/interfaces.md has them.
POINT_KEYS = {
    *('regime', 'outcome', 'stick-slip predicted', 'growth [e-folds]', 'clears in [s]', 'raised lately'),
    *('shaft speed [rpm]', 'speed [m/s]', 'load [N]', 'hopf speed [m/s]', 'fold speed [m/s]', 'hopf margin'),
    *('fold margin', 'growth rate [1/s]', 'amplitude [m]', 'amplitude of the exact cycle [m]'),
    *('error of the amplitude', 'threshold amplitude [m]'),
}
SAMPLES = ('accepted', 'not finite', 'no value', 'implausible', 'below minimum', 'repeated', 'out of order')


@pytest.fixture
def monitor() -> Monitor:
    """Return a monitor that has a speed, and warns at the first load."""
    monitor = Monitor(configured(alarm__on_delay=0.0))
    feed(monitor, 0.0, 'speed', 20.0)
    return monitor


def test_a_warning_keeps_its_schema_and_has_the_declared_fields(monitor: Monitor) -> None:
    (event,) = feed(monitor, 0.1, 'load', 1000.0).events
    record = event_record(event)
    assert schema_complaints('warning-3', record) == []
    assert list(record) == ['schema', *(item.name for item in WARNING if item.name != 'measured')]


def test_the_bearings_keep_their_schema_and_have_the_declared_fields(monitor: Monitor) -> None:
    inputs = {'load': InputState(fault='nobody publishes', age=7.0, rate=2.0)}
    for _ in range(2):
        state = BearingState(monitor.bearings['aft'], inputs)
        assert schema_complaints('bearings-4', json.loads(bearings_json([state], 5))) == []
        assert list(bearing_record(state)) == [*(item.name for item in BEARING), 'inputs']
        feed(monitor, 0.1, 'load', 1000.0)


@pytest.mark.parametrize(
    ('name', 'place', 'fields'),
    [
        ('assessment-2', ('properties',), ASSESSMENT),
        ('warning-3', ('properties',), WARNING),
        ('bearings-4', ('properties', 'bearings', 'items', 'properties'), BEARING),
    ],
)
def test_the_installed_schemas_equal_the_fields(name: str, place: tuple[str, ...], fields: Any) -> None:
    """Compare the files, which ``make docs`` writes, with the fields."""
    schema = json.loads((SCHEMAS / f'{name}.json').read_text('utf-8'))
    for key in place:
        schema = schema[key]
    expected = {item.name: item.schema for item in fields}
    assert {key: schema[key] for key in expected} == expected
    assert set(schema) - set(expected) <= {'schema', 'inputs'}


def test_raised_tells_a_condition_that_came_back() -> None:
    # Back within six times the off-delay it is 2, after 1 the first time; 0 in between.
    monitor = Monitor(configured(alarm__on_delay=0.0, alarm__off_delay=3.0))
    changes = []
    for k in range(300):
        rpm = 20.0 if k % 200 < 60 else 70.0
        for quantity, value in (('load', 1000.0), ('speed', rpm)):
            changes += [
                (event.before.value, event.after.value, event_record(event)['raised'])
                for event in feed(monitor, 0.1 * k, quantity, value).events
            ]
    assert [raised for old, _, raised in changes if old == 'normal'] == [1, 2]
    assert {raised for _, new, raised in changes if new == 'normal'} == {0}


def test_no_two_fields_are_published_under_one_name() -> None:
    for form in ('key', 'metric', 'path'):
        forms = [getattr(item, form) for item in BEARING if getattr(item, form)]
        assert len(forms) == len(set(forms))
    assert {item.name for item in NUMBERS} < {item.name for item in BEARING} & {item.name for item in WARNING}


def test_a_topic_is_of_what_an_assessment_or_a_level_has() -> None:
    """Topics are written from the assessments of many points at once, which have no other fields."""
    without = [item.name for item in BEARING if item.topic and not hasattr(Assessments, item.name)]
    assert without == ['measured'], 'leave out the topic, or make it a number of an operating point'


def values_of(monitor: Monitor) -> dict[str, str]:
    """Return the diagnostic values of the bearing."""
    return diagnostic_record('ship/monitor', BearingState(monitor.bearings['aft'])).values


def test_keys_of_a_bearing_without_a_level(monitor: Monitor) -> None:
    samples = {f'{name} samples {key}' for name in ('speed', 'load') for key in SAMPLES}
    assert set(values_of(monitor)) == {'reason'} | samples
    feed(monitor, 0.1, 'load', 1000.0)
    values = values_of(monitor)
    assert set(values) == {'reason'} | samples | POINT_KEYS
    assert values['shaft speed [rpm]'] == '20'
    assert values['speed [m/s]'] == '0.104719755'  # pi D n, D = 0.1 m
    assert (values['load [N]'], values['load samples accepted']) == ('1000', '1')


def test_diagnostics_of_a_level() -> None:
    """Quiet while stick-slip is predicted, then lost, is what the three keys tell apart."""
    monitor = Monitor(configured(alarm__on_delay=0.0, **LEVEL))
    for k in range(31):
        feed(monitor, k, 'load', 1000.0)
        feed(monitor, k, 'level', 0.5)
        feed(monitor, k + 0.1, 'speed', 20.0)
    values = values_of(monitor)
    assert set(values) >= POINT_KEYS
    assert (values['measured'], values['measured unknown']) == ('quiet', '')
    # Stick-slip is predicted within the first seconds.
    assert 20.0 < float(values['predicted but not measured for [s]']) < 31.0
    assert [values[f'level samples {key}'] for key in SAMPLES] == ['31', '0', '0', '0', '0', '0', '0']
    for k in range(31, 50):
        feed(monitor, k, 'load', 1000.0)
        feed(monitor, k + 0.1, 'speed', 20.0)
    values = values_of(monitor)
    assert values['measured'] == 'unknown'
    assert values['measured unknown'] != ''


def test_water_in_use_is_published_with_its_viscosity() -> None:
    """Before the first temperature that of the friction measurement counts.

    Fresh water has 1.002 mPa s at 20 C and 0.547 at 50 C (Kestin, Sokolov and Wakeham, 1978).
    """
    water = {'friction__at_temperature': 20.0, 'water_temperature__salinity': 0.0}
    monitor = Monitor(configured(water_temperature__topic='/water', water_temperature__unit='C', **water))
    feed(monitor, 0.0, 'speed', 20.0)
    feed(monitor, 0.1, 'load', 1000.0)
    values = values_of(monitor)
    assert (values['water temperature [C]'], values['viscosity ratio']) == ('20', '1')
    feed(monitor, 0.2, 'water_temperature', 50.0)
    values = values_of(monitor)
    assert values['water temperature [C]'] == '50'
    assert float(values['viscosity ratio']) == pytest.approx(0.547 / 1.002, rel=0.015)


def test_a_configured_water_is_published() -> None:
    water = {'friction__at_temperature': 20.0, 'water_temperature__constant': 50.0}
    monitor = Monitor(configured(**water))
    record = bearing_record(BearingState(monitor.bearings['aft']))
    assert record['water_temperature'] == 50.0
    assert 0.5 < record['viscosity_ratio'] < 0.6
    dry = bearing_record(BearingState(Monitor(configured()).bearings['aft']))
    assert (dry['water_temperature'], dry['viscosity_ratio']) == (None, None)


def test_topics_of_a_bearing() -> None:
    # docs/interfaces.md names them; the amplitudes, which take longest, come first.
    numbers = ('amplitude', 'amplitude_exact', 'hopf_margin', 'fold_margin')
    page = (Path(__file__).resolve().parents[3] / 'docs' / 'interfaces.md').read_text()
    topics = output_topics(configured(**LEVEL, tolerance__damping=0.1).bearings, '/m')
    names = [topic.removeprefix('/m/aft/') for topic in topics if topic.startswith('/m/aft/')]
    assert tuple(names[:4]) == numbers
    assert names[-2:] == ['regime', 'measured']
    assert [name for name in names if f'/{name}`' not in page] == []


def test_a_healthy_node_says_so_in_every_value() -> None:
    record = health_record('port/stickslip_monitor', NodeHealth(monitoring=True))
    head = Severity.OK, 'port/stickslip_monitor: the node', 'port/stickslip_monitor', 'Monitoring.'
    assert (record.level, record.name, record.hardware_id, record.message) == head
    assert list(record.values.values()) == ['active', '0', 'none', '0', '0', '0', '0', 'none', 'fine', 'fine']


def test_the_node_names_its_losses_and_changes() -> None:
    health = NodeHealth(monitoring=True, lost=1, left_out=2, losing=True)
    health.record_change('aft.mass', 50.0, 60.0)
    health.record_change('aft.mass', 60.0, 70.0)
    assert health.severity is Severity.WARN
    assert health.message == (
        '1 message lost on the way to the node, 2 messages left out while the node was too busy, some in the'
        ' last minute. Changed over ROS and not acknowledged: aft.mass from 50.0 to 70.0.'
    )
    health.record_change('aft.mass', 70.0, 50.0)
    assert health.changed == {}


@pytest.mark.parametrize(
    ('counter', 'severity'),
    [('failures', Severity.ERROR), ('lost', Severity.WARN), ('left_out', Severity.WARN)],
)
def test_a_failure_or_a_loss_counts_for_a_minute(counter: str, severity: Severity) -> None:
    health, severities = NodeHealth(monitoring=True, last_failure='x'), []
    for second, count in ((40, 0), (100, 1), (159, 1), (161, 1), (170, 3), (229, 3), (231, 3)):
        setattr(health, counter, count)
        severities.append((health.update(second * 10**9), health.severity))
    losses = [counter != 'failures' and second in (100, 170) for second in (40, 100, 159, 161, 170, 229, 231)]
    minute = [Severity.OK, severity, severity, Severity.OK, severity, severity, Severity.OK]
    assert severities == list(zip(losses, minute, strict=True))


def test_a_node_that_is_configured_anew_has_lost_nothing() -> None:
    health = NodeHealth(monitoring=True, lost=5)
    health.update(0)
    health.lost = 0
    assert (health.update(10**9), health.losing) == (False, False)
    health.lost = 2
    assert (health.update(2 * 10**9), health.losing) == (True, True)
