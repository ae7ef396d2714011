# SPDX-License-Identifier: Apache-2.0
"""The figures for Prometheus: names end in base units, as its conventions ask.

They are read from the board when somebody scrapes. Of a monitor without data the figures are
left out rather than repeated, so that nobody takes an old value for a new one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from stickslip_monitor.dashboard.seen_monitors import NOT_MONITORING, DashboardState, WatchedMonitor
from stickslip_monitor.monitor import record_fields
from stickslip_monitor.monitor.alarm_states import AlarmState
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.bearing_records import WITHOUT_CYCLE
from stickslip_monitor.monitor.severity import MEASURED, Condition

GAUGES = {item.name: (item.metric, item.help) for item in record_fields.BEARING if item.metric}
"""Of each number of a bearing its metric, without the prefix, and what it means."""
PREFIX = 'stickslip_'
_UP = 'Whether the monitor, every bearing and its list of alarms send data (1) or not (0).'
_TO_REACH = 'Speed that the order in the text of the bearing names, negative astern.'
_SPACE = ['namespace']
_BEARING = ['namespace', 'bearing']
_CONDITIONS = ('waiting', 'unreliable', NOT_MONITORING, *(condition.value for condition in Condition))
_REGIMES = tuple(regime.value for regime in Regime)
_LEVELS = tuple(state.value for state in MEASURED)
_STATES = (
    ('condition', 'condition', 'reason', _CONDITIONS, 'Whether the bearing is in this condition.'),
    ('regime', 'regime', 'regime', _REGIMES, 'Whether its operating point is in this regime.'),
    ('measured', 'state', 'measured', _LEVELS, 'Whether this is the state of the measured vibration.'),
)
"""Metric, label, key in the record of a bearing, values, and what it means."""


class Metrics(Collector):
    """Reads the board; ``nan`` is never exposed: what has no value is left out.

    Args:
        board: What is read.
        readers: The pages that are open, whose number is a metric.
    """

    def __init__(self, board: DashboardState, readers: Sized) -> None:
        self._board, self._readers = board, readers
        self._registry = CollectorRegistry()
        self._registry.register(self)

    def text(self, accept: str) -> tuple[bytes, str]:
        """Return the present metrics, encoded as an ``Accept`` header asks, and their content type."""
        encode, kind = choose_encoder(accept)
        return encode(self._registry), kind

    def describe(self) -> Iterable[Metric]:
        """Return nothing: the names are known when they are collected."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """Yield every metric of the board as it is now; of monitors without data only that they have none."""
        board = self._board
        yield _make_metric('dashboard_readers', 'Pages that are open.', [], [([], len(self._readers))])
        if board.links:
            text, links = "Whether a link to the ship's buses works.", board.links.items()
            yield _make_metric('link_up', text, ['link'], [([name], up) for name, up in links])
        missing = {key for monitor in board.monitors for key in monitor.missing_bearings()}
        yield from _presence_metrics(board, missing)
        receiving = [m for m in board.monitors if m.is_receiving and not board.finished]
        records = [
            ((m.namespace, name), bearing.record)
            for m in receiving
            for name, bearing in m.bearings.items()
            if bearing.key not in missing and bearing.record is not None
        ]
        yield from _bearing_metrics(records)
        yield from _alarm_metrics(receiving)


def _presence_metrics(board: DashboardState, missing: set[str]) -> Iterator[Metric]:
    """Yield whether each monitor and bearing sends data, and for how long a monitor was silent.

    ``missing`` are the keys of the bearings without data.
    """
    monitors = board.monitors
    ups = [((m.namespace,), not (m.faults() or board.finished)) for m in monitors]
    yield _make_metric('monitor_up', _UP, _SPACE, ups)
    silences = [((m.namespace,), m.silent_for) for m in monitors]
    yield _make_metric(
        'monitor_silence_seconds', 'Time since the last message from the monitor.', _SPACE, silences
    )
    bearing_ups = [
        ((m.namespace, name), b.key not in missing) for m in monitors for name, b in m.bearings.items()
    ]
    yield _make_metric(
        'bearing_up', 'Whether there is data on the bearing (1) or not (0).', _BEARING, bearing_ups
    )


# Of each bearing with data its labels (namespace and name), and its record.
_Known = list[tuple[tuple[str, str], dict[str, Any]]]


def _bearing_metrics(records: _Known) -> Iterator[Metric]:
    """Yield numbers, order, condition and inputs of the bearings with data.

    Where no cycle exists, a missing number that :data:`.WITHOUT_CYCLE` has gets that value.
    """
    for key, (name, text) in GAUGES.items():
        none = WITHOUT_CYCLE.get(key)
        # The record of a monitor of another version may lack a field.
        numbers = [(names, record.get(key), record['regime']) for names, record in records]
        values = [(names, none if n is None and regime else n) for names, n, regime in numbers]
        yield _make_metric(name, text, _BEARING, values)
    orders = [((*n, r['order']), r['speed_to_reach']) for n, r in records if r['order'] is not None]
    yield _make_metric('speed_to_reach_rpm', _TO_REACH, [*_BEARING, 'order'], orders)
    for name, text, held in (
        ('predicted', 'Whether stick-slip is predicted now; one that is only held is not.', False),
        ('held', 'Whether the condition is over, and held for its off-delay.', True),
    ):
        flags = [(n, r['held_until'] is not None if held else r['sticking']) for n, r in records]
        yield _make_metric(name, text, _BEARING, flags)
    for name, label, key, states, text in _STATES:
        state_flags = [((*n, s), r[key] == s) for n, r in records for s in states if r[key] is not None]
        yield _make_metric(name, text, [*_BEARING, label], state_flags)
    yield from _input_metrics(
        [((*n, name), input_record) for n, r in records for name, input_record in r['inputs'].items()]
    )


def _input_metrics(inputs: list[tuple[tuple[str, str, str], dict[str, Any]]]) -> Iterator[Metric]:
    """Yield age, rate and counts of samples; ``inputs`` has namespace, bearing and input, and the record."""
    for name, key, text in (
        ('sample_age_seconds', 'age', 'Time since the last sample that was used.'),
        ('sample_rate_hertz', 'rate', 'Samples a second that are used.'),
    ):
        values = [(labels, record[key]) for labels, record in inputs]
        yield _make_metric(name, text, [*_BEARING, 'input'], values)
    counter = CounterMetricFamily(
        f'{PREFIX}samples',
        'Samples received, by what was done with them.',
        labels=[*_BEARING, 'input', 'status'],
    )
    for labels, record in inputs:
        for kind, count in record['counts'].items():
            counter.add_metric([*labels, kind], count)
    yield counter


_OF_ALARMS: dict[str, tuple[str, Callable[[dict[str, Any]], float]]] = {
    'alarms_unacknowledged': ('Alarms that wait for an acknowledgement.', lambda r: r['unacknowledged']),
    'alarms_sounding': ('Whether any alarm sounds.', lambda r: r['sounding']),
    'alarms_recent': ('Alarms of the last ten minutes.', lambda r: r['flood']['alarms_10min']),
    'alarm_flood': ('Whether there is a flood of alarms.', lambda r: r['flood']['flooding']),
}


def _alarm_metrics(monitors: list[WatchedMonitor]) -> Iterator[Metric]:
    """Yield the state of each alarm, and the totals of each monitor; of one without a list, neither."""
    labels = [*_BEARING, 'alarm', 'priority']
    records = [(m, m.alarms) for m in monitors if m.alarms is not None]
    alarms = [
        ((m.namespace, a['bearing'].rpartition('/')[2], a['alarm'], a['priority']), a)
        for m, record in records
        for a in record['alarms']
    ]
    active = [(names, a['active']) for names, a in alarms]
    yield _make_metric('alarm_active', 'Whether the alarm is active.', labels, active)
    states = [((*names, s.value), a['state'] == s.value) for names, a in alarms for s in AlarmState]
    yield _make_metric('alarm_state', 'Whether the alarm is in this state.', [*labels, 'state'], states)
    for name, (text, value) in _OF_ALARMS.items():
        yield _make_metric(name, text, _SPACE, [((m.namespace,), value(r)) for m, r in records])


def _make_metric(name: str, text: str, labels: Sequence[str], values: Iterable[tuple[Any, Any]]) -> Metric:
    """Make a gauge.

    Args:
        name: Its name without :data:`PREFIX`.
        text: What it means.
        labels: Names of its labels.
        values: Pairs of label values and number; one whose number is ``None`` is left out.
    """
    family = GaugeMetricFamily(f'{PREFIX}{name}', text, labels=labels)
    for names, value in values:
        if value is not None:
            family.add_metric(list(names), float(value))
    return family
