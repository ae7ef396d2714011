# SPDX-License-Identifier: Apache-2.0
"""What is published keeps the installed schemas, and docs/interfaces.md names the keys."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import kit
import pytest

from stickslip_monitor import Monitor, Sample, build_config
from stickslip_monitor.commands import assess as assess_command
from stickslip_monitor.monitor.alarm_list import Action, Annunciator
from stickslip_monitor.monitor.alarm_records import ActionRequest, alarms_record, request_record
from stickslip_monitor.monitor.bearing_records import (
    BearingState,
    bearings_json,
    diagnostic_record,
    event_record,
)
from stickslip_monitor.monitor.input_faults import InputState

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'interfaces.md'
SCHEMAS = resources.files('stickslip_monitor') / 'schemas'
KINDS: dict[str, tuple[type, ...]] = {
    'string': (str,),
    'integer': (int,),
    'number': (int, float),
    'boolean': (bool,),
    'object': (dict,),
    'array': (list,),
    'null': (type(None),),
}


def wrong(schema: dict[str, Any], value: Any, path: str = '') -> Iterator[str]:
    """Where a document breaks a schema, or has a field that the schema does not tell of."""
    if 'const' in schema and value != schema['const']:
        yield f'{path} = {value!r}'
    if 'enum' in schema and value not in schema['enum']:
        yield f'{path} = {value!r}'
    kinds = schema.get('type', [])
    allowed = [k for kind in ([kinds] if isinstance(kinds, str) else kinds) for k in KINDS[kind]]
    if allowed and (type(value) not in allowed):
        yield f'{path} is a {type(value).__name__}'
    if isinstance(value, list):
        for item in value:
            yield from wrong(schema.get('items', {}), item, f'{path}[]')
    if isinstance(value, dict):
        own, more = schema.get('properties'), schema.get('additionalProperties', {})
        yield from (f'{path} lacks {name}' for name in schema.get('required', ()) if name not in value)
        for name, item in value.items():
            if own is not None and name not in own:
                yield f'{path} has {name}'
            yield from wrong((own or {}).get(name, more), item, f'{path}.{name}')


def complaints(name: str, document: Any) -> list[str]:
    """What is wrong with a document by an installed schema."""
    schema = json.loads((SCHEMAS / f'{name}.json').read_text('utf-8'))
    return list(wrong(schema, json.loads(json.dumps(document, allow_nan=False))))


@pytest.fixture
def monitor() -> Monitor:
    """A monitor that has warned."""
    monitor = Monitor(build_config(kit.parameters({'alarm.on_delay': 0.0})))
    monitor.update(Sample('aft', 'speed', 1, 20.0))
    return monitor


def test_every_schema_is_named_on_the_page() -> None:
    files = {file.name for file in SCHEMAS.iterdir()}
    assert files == set(re.findall(r'schemas/([a-z]+-\d\.json)', PAGE.read_text()))
    for name in files:
        schema = json.loads((SCHEMAS / name).read_text('utf-8'))
        assert schema['properties']['schema']['const'] == schema['$id']


def test_a_warning_and_the_alarms_keep_their_schemas(monitor: Monitor) -> None:
    annunciator = Annunciator(monitor.config)
    changes = []
    for event in monitor.update(Sample('aft', 'load', 2, 1000.0)).events:
        assert complaints('warning-2', event_record(event)) == []
        changes += annunciator.take_event(event)
    assert changes
    record = alarms_record(annunciator, changes, 2, 1, notes=[{'time': 1, 'what': 'node', 'text': 'x'}])
    assert complaints('alarm-1', record) == []
    # A schema that takes anything would be none.
    assert complaints('alarm-1', record | {'time': 'now', 'more': 1}) == ['.time is a str', ' has more']


def test_the_bearings_keep_their_schema(monitor: Monitor) -> None:
    bearing = monitor.bearings['aft']
    inputs = {'load': InputState(fault='nobody publishes', age=7.0, rate=2.0)}
    for _ in range(2):
        document = json.loads(bearings_json([BearingState(bearing, inputs)], 5))
        assert complaints('bearings-3', document) == []
        monitor.update(Sample('aft', 'load', 2, 1000.0))


def test_an_assessment_and_an_action_keep_their_schemas(monitor: Monitor) -> None:
    verdict = monitor.update(Sample('aft', 'load', 2, 1000.0)).verdict
    document = assess_command.to_json('aft', verdict.assessment)
    assert complaints('assessment-1', document) == []
    for action in Action:
        request = ActionRequest(action, 'Ada', reason='new oil')
        assert complaints('action-1', request_record(request)) == []
    (example,) = re.findall(r'```json\n(.*?)```', PAGE.read_text(), flags=re.DOTALL)
    assert complaints('action-1', json.loads(example)) == []


def fields(title: str) -> list[str]:
    """The names in the first column of a section's table."""
    (text,) = [part for part in PAGE.read_text().split('\n## ') if part.startswith(title)]
    rows = re.findall(r'^\| (`[^|]*) \|', text, flags=re.MULTILINE)
    return [name for row in rows for name in re.findall(r'`([^`]+)`', row)]


def test_the_services() -> None:
    pytest.importorskip('rclpy', reason='ROS 2 is not installed')
    from stickslip_monitor.ros.running import SWITCHES, TRIGGERS

    assert fields('Services') == [*TRIGGERS, *SWITCHES]


def test_keys_of_diagnostics(monitor: Monitor) -> None:
    monitor.update(Sample('aft', 'load', 2, 1000.0))
    monitor.advance(10**12)
    inputs = dict.fromkeys(('speed', 'load'), InputState(fault='nobody publishes'))
    state = BearingState(monitor.bearings['aft'], inputs)
    keys = diagnostic_record('monitor', state).values
    named = {name.replace('... ', 'speed samples ') for name in fields('Diagnostics')}
    assert named <= set(keys)
    assert {name for name in keys if name.startswith('speed samples')} <= named
