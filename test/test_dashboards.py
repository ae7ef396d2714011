# SPDX-License-Identifier: Apache-2.0
"""The shipped dashboards: what they ask for is what a recording of the node's topics has.

The panels' settings are those in the sources of Lichtblick, the open continuation of Foxglove
Studio; the elements of a layout and the names of series those in PlotJuggler's; the parameters of
an analyzer those in diagnostic_aggregator's.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.offline.check import check_bag
from stickslip_monitor.offline.verdict_bag import write_verdicts

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / 'launch_configs' / 'dashboards'
Recording = dict[str, list[Any]]


@pytest.fixture(scope='module')
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """The messages of each topic of the recorded coast-down and of the verdicts on it."""
    from rosbags.highlevel import AnyReader

    config = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml')
    path = tmp_path_factory.mktemp('replay') / 'out.mcap'
    write_verdicts(check_bag(ROOT / 'bags' / 'coast_down', config), config, path)
    found: Recording = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


# --- Foxglove ----------------------------------------------------------------------------------

_SERIES = {'value', 'enabled', 'color', 'label', 'timestampMethod', 'showLine', 'lineSize'}
_TITLE = 'foxglovePanelTitle'
# Settings of each panel: those it must have, and those it may have.
PANELS: dict[str, tuple[set[str], set[str]]] = {
    'Plot': (
        {
            'paths',
            'showLegend',
            'legendDisplay',
            'showPlotValuesInLegend',
            'showXAxisLabels',
            'showYAxisLabels',
            'isSynced',
            'xAxisVal',
            'sidebarDimension',
        },
        {'minXValue', 'maxXValue', 'minYValue', 'maxYValue', 'followingViewWidth', 'xAxisPath'},
    ),
    'StateTransitions': (
        {'isSynced', 'paths'},
        {'xAxisMaxValue', 'xAxisMinValue', 'xAxisRange', 'showPoints'},
    ),
    'Gauge': (
        {'colorMap', 'colorMode', 'gradient', 'maxValue', 'minValue', 'path', 'reverse'},
        set(),
    ),
    'Indicator': ({'fallbackColor', 'fallbackLabel', 'path', 'rules', 'style'}, set()),
    'RawMessages': (
        {'diffEnabled', 'diffMethod', 'diffTopicPath', 'showFullMessageForDiff', 'topicPath'},
        {'expansion', 'fontSize'},
    ),
    'DiagnosticSummary': (
        {'minLevel', 'pinnedIds', 'topicToRender', 'hardwareIdFilter'},
        {'sortByLevel', 'secondsUntilStale'},
    ),
}


@pytest.fixture(scope='module')
def foxglove() -> dict[str, Any]:
    return dict(json.loads((FOLDER / 'foxglove.json').read_text('utf-8')))


def leaves(node: Any) -> Iterator[str]:
    """The panels of a mosaic of rows and columns."""
    if isinstance(node, str):
        yield node
        return
    assert set(node) == {'direction', 'first', 'second', 'splitPercentage'}
    assert node['direction'] in ('row', 'column')
    assert 0 < node['splitPercentage'] < 100
    yield from leaves(node['first'])
    yield from leaves(node['second'])


def test_foxglove_layout_has_the_parts_of_an_exported_one(foxglove: dict[str, Any]) -> None:
    assert set(foxglove) == {
        'configById',
        'globalVariables',
        'userNodes',
        'playbackConfig',
        'layout',
    }
    shown = list(leaves(foxglove['layout']))
    assert len(shown) == len(set(shown))
    assert set(shown) == set(foxglove['configById'])


def test_foxglove_panels_have_the_settings_they_know(foxglove: dict[str, Any]) -> None:
    for name, settings in foxglove['configById'].items():
        must, may = PANELS[name.partition('!')[0]]
        assert must <= set(settings) <= must | may | {_TITLE}, name
        for series in settings.get('paths', []):
            assert {'value', 'enabled', 'timestampMethod'} <= set(series) <= _SERIES
            assert series['timestampMethod'] in ('receiveTime', 'headerStamp')
        for rule in settings.get('rules', []):
            assert set(rule) == {'color', 'label', 'operator', 'rawValue'}


def values(path: str, recording: Recording) -> list[Any]:
    """What a message path, with its fields and filters, leads to in all messages of its topic."""
    match = re.fullmatch(r'(/[\w/]+)((?:\.\w+(?:\[:\])?(?:\{\w+=="[^"]*"\})?)+)', path)
    assert match, f'{path} is no message path'
    found = list(recording[match[1]])
    for name, every, key, wanted in re.findall(
        r'\.(\w+)(\[:\])?(?:\{(\w+)=="([^"]*)"\})?', match[2]
    ):
        found = [getattr(item, name) for item in found]
        if every:
            found = [item for items in found for item in items]
        if key:
            found = [item for item in found if getattr(item, key) == wanted]
    return found


def foxglove_paths(layout: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for name, settings in layout['configById'].items():
        panel = name.partition('!')[0]
        for series in settings.get('paths', []):
            yield panel, series['value']
        for key in ('path', 'topicPath', 'topicToRender'):
            if key in settings:
                yield panel, settings[key]


def test_foxglove_paths_lead_to_values(foxglove: dict[str, Any], recording: Recording) -> None:
    paths = list(foxglove_paths(foxglove))
    assert len(paths) > 8
    for panel, path in paths:
        if panel == 'DiagnosticSummary':
            assert path in recording
        elif path != '0':  # a plot's line at a number
            found = values(path, recording)
            assert found, path
            kind = str if panel in ('StateTransitions', 'RawMessages') else (int, float)
            assert all(isinstance(item, kind) for item in found), path


def test_foxglove_shows_every_number_and_condition(
    foxglove: dict[str, Any], recording: Recording
) -> None:
    asked = ' '.join(path for _, path in foxglove_paths(foxglove))
    for topic in recording:
        assert topic in asked
    (alarm,) = [p for _, p in foxglove_paths(foxglove) if '"reason"' in p]
    assert {'normal', 'caution', 'bistable', 'stick_slip'} <= set(values(alarm, recording))


# --- PlotJuggler -------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def plotjuggler() -> ElementTree.Element:
    return ElementTree.parse(FOLDER / 'plotjuggler.xml').getroot()


def series(recording: Recording) -> set[str]:
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


def test_plotjuggler_curves_exist(plotjuggler: ElementTree.Element, recording: Recording) -> None:
    curves = [curve.get('name') for curve in plotjuggler.iter('curve')]
    assert len(curves) == len(set(curves)) == 9
    assert set(curves) <= series(recording)


def test_plotjuggler_layout_has_the_elements_that_are_loaded(
    plotjuggler: ElementTree.Element,
) -> None:
    assert plotjuggler.tag == 'root'
    (tabs,) = plotjuggler.findall('tabbed_widget')
    assert tabs.get('parent') == 'main_window'
    for splitter in plotjuggler.iter('DockSplitter'):
        assert splitter.get('orientation') in ('-', '|')
        sizes = [float(size) for size in str(splitter.get('sizes')).split(';')]
        assert int(str(splitter.get('count'))) == len(list(splitter)) == len(sizes)
        assert sum(sizes) == pytest.approx(1.0)
        assert {child.tag for child in splitter} <= {'DockArea', 'DockSplitter'}
    for plot in plotjuggler.iter('plot'):
        assert plot.get('mode') == 'TimeSeries'
        assert plot.get('style') in ('Lines', 'Steps')
        assert plot.get('line_width') in ('1.0', '1.5', '2.0', '3.0')


# --- diagnostic_aggregator ---------------------------------------------------------------------

_ANALYZER = {
    'path': str,
    'type': str,
    'find_and_remove_prefix': list,
    'remove_prefix': list,
    'startswith': list,
    'contains': list,
    'expected': list,
    'regex': list,
    'timeout': float,
    'num_items': int,
    'discard_stale': bool,
}
_AGGREGATOR = {
    'path': str,
    'pub_rate': float,
    'critical': bool,
    'other_as_errors': bool,
    'history_depth': int,
}


def test_the_aggregator_finds_every_status(recording: Recording) -> None:
    document = yaml.safe_load((FOLDER / 'diagnostic_aggregator.yaml').read_text('utf-8'))
    parameters = document['analyzers']['ros__parameters']
    groups = {name: value for name, value in parameters.items() if isinstance(value, dict)}
    for name, value in parameters.items():
        assert name in groups or type(value) is _AGGREGATOR[name], name
    (analyzer,) = groups.values()
    assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
    for name, value in analyzer.items():
        assert type(value) is _ANALYZER[name], name
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
