# SPDX-License-Identifier: Apache-2.0
"""What is published keeps the installed schemas, and docs/interfaces.md names the keys."""

from __future__ import annotations

import json
import re
from pathlib import Path

import kit
import pytest
from shared import SCHEMAS, schema_complaints

from stickslip_monitor import Monitor, Sample, build_config
from stickslip_monitor.commands import assess as assess_command
from stickslip_monitor.monitor.alarm_list import Action
from stickslip_monitor.monitor.alarm_records import ActionRequest, request_record
from stickslip_monitor.monitor.bearing_records import BearingState, diagnostic_record
from stickslip_monitor.monitor.input_faults import InputState
from stickslip_monitor.monitor.record_fields import BEARING

PAGE = Path(__file__).resolve().parents[3] / 'docs' / 'interfaces.md'


@pytest.fixture
def monitor() -> Monitor:
    """Return a monitor that has warned."""
    monitor = Monitor(build_config(kit.node_parameters({'alarm.on_delay': 0.0})))
    monitor.update(Sample('aft', 'speed', 1, 20.0))
    return monitor


def test_every_schema_is_named_on_the_page() -> None:
    files = {file.name for file in SCHEMAS.iterdir()}
    assert files == set(re.findall(r'schemas/([a-z]+-\d\.json)', PAGE.read_text()))
    for name in files:
        schema = json.loads((SCHEMAS / name).read_text('utf-8'))
        assert schema['properties']['schema']['const'] == schema['$id']


def test_an_assessment_and_an_action_keep_their_schemas(monitor: Monitor) -> None:
    verdict = monitor.update(Sample('aft', 'load', 2, 1000.0)).verdict
    document = assess_command.to_json('aft', verdict.assessment)
    assert schema_complaints('assessment-2', document) == []
    for action in Action:
        request = ActionRequest(action, 'Ada', reason='new oil')
        assert schema_complaints('action-1', request_record(request)) == []
    (example,) = re.findall(r'```json\n(.*?)```', PAGE.read_text(), flags=re.DOTALL)
    assert schema_complaints('action-1', json.loads(example)) == []


def documented_fields(title: str) -> list[str]:
    """Return the names in the first column of a section's table."""
    (text,) = [part for part in PAGE.read_text().split('\n## ') if part.startswith(title)]
    rows = re.findall(r'^\| (`[^|]*) \|', text, flags=re.MULTILINE)
    return [name for row in rows for name in re.findall(r'`([^`]+)`', row)]


def test_the_services() -> None:
    pytest.importorskip('rclpy', reason='ROS 2 is not installed')
    from stickslip_monitor.ros.actions import SWITCHES, TRIGGERS

    assert documented_fields('Services') == [*TRIGGERS, *SWITCHES]


def test_keys_of_diagnostics(monitor: Monitor) -> None:
    monitor.update(Sample('aft', 'load', 2, 1000.0))
    monitor.advance(10**12)
    inputs = dict.fromkeys(('speed', 'load'), InputState(fault='nobody publishes'))
    state = BearingState(monitor.bearings['aft'], inputs)
    keys = diagnostic_record('monitor', state).values
    named = {name.replace('... ', 'speed samples ') for name in documented_fields('Diagnostics')}
    optional = {row.key for row in BEARING if row.key and row.needs}
    # The list of a bearing's own keys is made of these.
    named |= {row.key for row in BEARING if row.key}
    assert named - optional <= set(keys)
    assert {name for name in keys if name.startswith('speed samples')} <= named
