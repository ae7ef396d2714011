# SPDX-License-Identifier: Apache-2.0
"""docs/interfaces.md names the fields and keys that there are."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor import Monitor, Sample, build_config
from stickslip_monitor.commands import assess as assess_command
from stickslip_monitor.monitor.alarms.alarm_records import alarms_record
from stickslip_monitor.monitor.alarms.annunciator import Action, Annunciator
from stickslip_monitor.monitor.alarms.requests import ActionRequest, request_record
from stickslip_monitor.monitor.messages import diagnostic_values, event_record, state_of

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'interfaces.md'


def section(title: str) -> str:
    (found,) = [part for part in PAGE.read_text().split('\n## ') if part.startswith(title)]
    return found


def fields(text: str) -> list[str]:
    """The names in the first column of a section's table."""
    rows = re.findall(r'^\| (`.*?`) \|', text, flags=re.MULTILINE)
    return [name for row in rows for name in re.findall(r'`([^`]+)`', row)]


def example(text: str) -> dict[str, Any]:
    (found,) = re.findall(r'```json\n(.*?)```', text, flags=re.DOTALL)
    return dict(json.loads(found))


@pytest.fixture
def monitor(kit: Any) -> Monitor:
    """A monitor that has warned."""
    monitor = Monitor(build_config(kit.parameters({'alarm.on_delay': 0.0})))
    monitor.update(Sample('aft', 'speed', 1, 20.0))
    return monitor


def test_fields_of_a_warning(monitor: Monitor) -> None:
    (event,) = monitor.update(Sample('aft', 'load', 2, 1000.0)).events
    text = section('Warnings')
    assert fields(text) == list(event_record(event))
    assert list(example(text)) == list(event_record(event))


def test_fields_of_the_alarms(monitor: Monitor) -> None:
    annunciator = Annunciator(monitor.config)
    for event in monitor.update(Sample('aft', 'load', 2, 1000.0)).events:
        changes = annunciator.take_event(event)
    record = alarms_record(annunciator, changes, 2, 1)
    note = {'time': 0, 'what': '', 'text': ''}
    expected = [record, record['changes'][0], note, record['alarms'][0]]
    assert fields(section('Alarms')) == [name for part in expected for name in part]


def test_the_services() -> None:
    pytest.importorskip('rclpy', reason='ROS 2 is not installed')
    from stickslip_monitor.ros.actions import SWITCHES, TRIGGERS

    assert fields(section('Services')) == [*TRIGGERS, *SWITCHES]


def test_fields_of_an_assessment(monitor: Monitor) -> None:
    verdict = monitor.update(Sample('aft', 'load', 2, 1000.0)).verdict
    assert verdict is not None
    text = section('`stickslip assess')
    document = assess_command.to_json('aft', verdict.assessment)
    assert set(fields(text)) == set(document)
    assert set(example(text)) == set(document)
    assert example(text)['amplitude'] == document['amplitude']


def test_keys_of_diagnostics(monitor: Monitor) -> None:
    monitor.update(Sample('aft', 'load', 2, 1000.0))
    monitor.advance(10**12)
    faults = dict.fromkeys(('speed', 'load'), 'Nobody publishes on it.')
    keys = diagnostic_values(state_of(monitor.bearings['aft'], faults))
    named = fields(section('Diagnostics'))
    counts = [name.removeprefix('...') for name in named if name.startswith('...')]
    named = [name for name in named if not name.startswith('...')]
    named += [f'{quantity}{fault}' for quantity in ('speed', 'load') for fault in counts]
    assert set(named) == set(keys)


def test_fields_of_an_action() -> None:
    text = section('Actions')
    request = ActionRequest(Action.SHELVE, 'Ada', reason='new oil')
    assert fields(text) == list(request_record(request))
    (row,) = [line for line in text.splitlines() if line.startswith('| `action`')]
    assert re.findall(r'`([a-z]+)`', row)[1:] == [action.value for action in Action]
