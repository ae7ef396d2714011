# SPDX-License-Identifier: Apache-2.0
"""The shipped dashboards: what they ask for is what a recording of the node's topics has.

Series have the names that PlotJuggler gives them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from shared import ROOT

from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.offline.check import check_recording
from stickslip_monitor.offline.verdict_messages import VerdictWriter

FOLDER = ROOT / 'launch_configs' / 'dashboards'
Recording = dict[str, list[Any]]


@pytest.fixture(scope='module')
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Return the messages of each topic of the recorded coast-down and of the verdicts on it."""
    from rosbags.highlevel import AnyReader

    config = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml')
    path = tmp_path_factory.mktemp('replay') / 'out.mcap'
    with VerdictWriter(path) as writer:
        check_recording(ROOT / 'bags' / 'coast_down', config, [writer])
    recording: Recording = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            recording.setdefault(connection.topic, []).append(message)
    return recording


# --- Foxglove ----------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def foxglove() -> dict[str, Any]:
    return dict(json.loads((FOLDER / 'foxglove.json').read_text('utf-8')))


def values_at_path(path: str, recording: Recording) -> list[Any]:
    """Return the values of a message path, with its fields and filters, in all messages of its topic."""
    match = re.fullmatch(r'(/[\w/]+)((?:\.\w+(?:\[:\])?(?:\{\w+=="[^"]*"\})?)+)', path)
    assert match, f'{path} is no message path'
    values = list(recording[match[1]])
    for name, every, key, key_value in re.findall(r'\.(\w+)(\[:\])?(?:\{(\w+)=="([^"]*)"\})?', match[2]):
        values = [getattr(item, name) for item in values]
        if every:
            values = [item for items in values for item in items]
        if key:
            values = [item for item in values if getattr(item, key) == key_value]
    return values


def foxglove_paths(layout: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for name, settings in layout['configById'].items():
        panel = name.partition('!')[0]
        for series in settings.get('paths', []):
            yield panel, series['value']
        for key in ('path', 'topicPath', 'topicToRender'):
            if key in settings:
                yield panel, settings[key]


def test_foxglove_shows_every_topic_by_paths_that_lead_to_values(
    foxglove: dict[str, Any], recording: Recording
) -> None:
    paths = list(foxglove_paths(foxglove))
    joined = ' '.join(path for _, path in paths)
    assert all(topic in joined for topic in recording)
    (alarm,) = [path for _, path in paths if '"reason"' in path]
    assert {'normal', 'caution', 'bistable', 'stick_slip'} <= set(values_at_path(alarm, recording))
    for panel, path in paths:
        if panel == 'DiagnosticSummary':
            assert path in recording
        elif path != '0':  # a plot's line at a number
            values = values_at_path(path, recording)
            assert values, path
            kind = str if panel in ('StateTransitions', 'RawMessages') else (int, float)
            assert all(isinstance(item, kind) for item in values), path


# --- PlotJuggler -------------------------------------------------------------------------------


def series_names(recording: Recording) -> set[str]:
    """Names of the numeric series as PlotJuggler makes them from these messages."""
    names = set()
    for topic, messages in recording.items():
        for message in messages:
            for status in getattr(message, 'status', ()):
                prefix = f'{topic}/{status.hardware_id}/{status.name}'
                names.add(f'{prefix}/level')
                numeric = (p.key for p in status.values if re.match(r'[-+0-9]', p.value))
                names |= {f'{prefix}/{key}' for key in numeric}
            if isinstance(getattr(message, 'data', None), float):
                names.add(f'{topic}/data')
    return names


def test_plotjuggler_curves_exist(recording: Recording) -> None:
    root = ElementTree.parse(FOLDER / 'plotjuggler.xml').getroot()
    curves = [str(curve.get('name')) for curve in root.iter('curve')]
    assert len(curves) == len(set(curves)) == 9
    assert set(curves) <= series_names(recording)


# --- diagnostic_aggregator ---------------------------------------------------------------------


def test_the_aggregator_finds_every_status(recording: Recording) -> None:
    document = yaml.safe_load((FOLDER / 'diagnostic_aggregator.yaml').read_text('utf-8'))
    parameters = document['analyzers']['ros__parameters']
    (analyzer,) = [value for value in parameters.values() if isinstance(value, dict)]
    assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
    names = {status.name for message in recording['/diagnostics'] for status in message.status}
    (part,) = analyzer['contains']
    assert all(part in name for name in names)
    assert set(analyzer['expected']) == names
    # Twin screws: both are found, and no prefix is removed by which they would become one item.
    twins = {f'{side}/{name}' for side in ('port', 'starboard') for name in names}
    assert all(part in name for name in twins)
    assert not {'remove_prefix', 'find_and_remove_prefix'} & set(analyzer)
    # The node says something every second.
    assert analyzer['timeout'] > 2.0
