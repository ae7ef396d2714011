# SPDX-License-Identifier: Apache-2.0
"""The figures for Prometheus: names end in base units, as its conventions ask.

They are read from the board when somebody scrapes. Of a monitor that is not heard the figures are
left out rather than repeated, so that nobody takes an old value for a new one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from stickslip_monitor.dashboard.received import NOT_MONITORING, BearingStatus
from stickslip_monitor.dashboard.state import DashboardState
from stickslip_monitor.dashboard.watched import Watched, WatchedMonitor
from stickslip_monitor.monitor.alarms.lifecycle import AlarmState
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.level import MEASURED

GAUGES = {
    'speed': ('speed_meters_per_second', 'Surface speed of the journal, negative astern.'),
    'load': ('load_newtons', 'Load of the bearing.'),
    'hopf_speed': ('hopf_speed_meters_per_second', 'Surface speed at the Hopf boundary.'),
    'fold_speed': ('fold_speed_meters_per_second', 'Surface speed at the fold.'),
    'hopf_margin': ('hopf_margin_ratio', 'Margin to the Hopf boundary, negative inside.'),
    'fold_margin': ('fold_margin_ratio', 'Margin to the fold, negative inside.'),
    'growth_rate': ('growth_rate_hertz', 'Growth rate of a small disturbance (1/s).'),
    'amplitude': (
        'amplitude_meters',
        'Amplitude of the stick-slip cycle by averaging (KBM); 0 without one.',
    ),
    'amplitude_exact': (
        'exact_amplitude_meters',
        'Amplitude of the exact stick-slip cycle; 0 without one.',
    ),
    'threshold_amplitude': (
        'threshold_amplitude_meters',
        'In the bistable range a larger disturbance starts stick-slip.',
    ),
    'probability_can': ('can_probability_ratio', 'Probability that stick-slip can happen.'),
    'probability_will': ('will_probability_ratio', 'Probability that it starts by itself.'),
    'probability_runs': ('runs_probability_ratio', 'Probability that stick-slip runs.'),
}
"""Of each number of an operating point its metric, without the prefix, and what it means."""
PREFIX = 'stickslip_'
_UP = 'Whether the monitor, every bearing and its list of alarms are heard (1) or not (0).'
_SPACE = ['namespace']
_BEARING = ['namespace', 'bearing']
_ZERO_WITHOUT_A_CYCLE = ('amplitude', 'amplitude_exact')
_CONDITIONS = ('waiting', NOT_MONITORING, *(condition.value for condition in Condition))


class Metrics(Collector):
    """Reads the board; ``nan`` is never exposed: what has no value is left out."""

    def __init__(self, board: DashboardState) -> None:
        self._board = board
        self._registry = CollectorRegistry()
        self._registry.register(self)

    def text(self, accept: str) -> tuple[bytes, str]:
        """The exposition and its content type, in the form that the scraper asks for."""
        encode, kind = choose_encoder(accept)
        return encode(self._registry), kind

    def describe(self) -> Iterable[Metric]:
        """Nothing: the names are known when they are collected."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """Every metric."""
        board = self._board
        yield _single('dashboard_readers', 'Pages that are open.', len(board.hub.readers))
        if board.links:
            text, links = "Whether a link to the ship's buses works.", board.links.items()
            yield _family('link_up', text, ['link'], [([name], up) for name, up in links])
        missing = {key for monitor in board.monitors for key in monitor.unheard()}
        yield from _presence(board, missing)
        heard = [m for m in board.monitors if m.heard and not board.finished]
        known = [
            _Known((m.namespace, name), own, m)
            for m in heard
            for name, own in m.bearings.items()
            if own.key not in missing and own.status is not None
        ]
        yield from _bearings(known)
        yield from _alarms(heard)


def _presence(board: DashboardState, missing: set[str]) -> Iterator[Metric]:
    monitors = board.monitors
    ups = [(_space(m), m.there and not board.finished) for m in monitors]
    yield _family('monitor_up', _UP, _SPACE, ups)
    yield _family(
        'monitor_silence_seconds',
        'Time since anything was heard of the monitor.',
        _SPACE,
        [(_space(m), m.silent_for) for m in monitors if m.silent_for is not None],
    )
    pairs = [(m, name, own.key) for m in monitors for name, own in m.bearings.items()]
    yield _family(
        'bearing_up',
        'Whether the bearing is heard (1) or not (0).',
        _BEARING,
        [((m.namespace, name), key not in missing) for m, name, key in pairs],
    )


@dataclass(frozen=True, slots=True)
class _Known:
    """A bearing that is heard: its labels, what is known of it, and its monitor."""

    labels: tuple[str, str]
    own: Watched
    monitor: WatchedMonitor

    @property
    def status(self) -> BearingStatus:
        assert self.own.status is not None
        return self.own.status


def _space(monitor: WatchedMonitor) -> tuple[str]:
    return (monitor.namespace,)


def _bearings(known: list[_Known]) -> Iterator[Metric]:
    for key, (name, text) in GAUGES.items():
        values = [(k.labels, k.status.numbers[key]) for k in known if key in k.status.numbers]
        if key in _ZERO_WITHOUT_A_CYCLE:
            values = [(n, 0.0 if math.isnan(value) else value) for n, value in values]
        # An infinite margin is a value, beyond every limit; NaN is none.
        yield _family(name, text, _BEARING, [(n, v) for n, v in values if not math.isnan(v)])
    yield _family(
        'predicted',
        'Whether stick-slip is predicted.',
        _BEARING,
        [(k.labels, k.status.sticking) for k in known if k.status.sticking is not None],
    )
    yield _family(
        'condition',
        'Whether the condition of the bearing is this one.',
        [*_BEARING, 'condition'],
        [((*k.labels, c), k.status.words.get('reason') == c) for k in known for c in _CONDITIONS],
    )
    yield _family(
        'measured',
        'Whether this is what the measured vibration says.',
        [*_BEARING, 'state'],
        [
            ((*k.labels, state.value), k.status.words['measured'] == state.value)
            for k in known
            if 'measured' in k.status.words
            for state in MEASURED
        ],
    )
    yield from _inputs(known)


def _inputs(known: list[_Known]) -> Iterator[Metric]:
    inputs = [(k, quantity) for k in known for quantity in k.status.counts]
    ages = [
        ((*k.labels, quantity), k.monitor.sample_age(k.labels[1], quantity))
        for k, quantity in inputs
    ]
    yield _family(
        'sample_age_seconds',
        'Time since the last sample that was used, as the monitor told of it.',
        [*_BEARING, 'input'],
        [(labels, age) for labels, age in ages if age is not None],
    )
    counter = CounterMetricFamily(
        f'{PREFIX}samples',
        'Samples by what became of them.',
        labels=[*_BEARING, 'input', 'status'],
    )
    for k, quantity in inputs:
        for kind, count in k.status.counts[quantity].items():
            counter.add_metric([*k.labels, quantity, kind], count)
    yield counter


_OF_ALARMS: dict[str, tuple[str, Callable[[dict[str, Any]], float]]] = {
    'alarms_unacknowledged': ('Alarms that wait.', lambda r: r['unacknowledged']),
    'alarms_sounding': ('Whether any alarm sounds.', lambda r: r['sounding']),
    'alarms_recent': ('Alarms of the last ten minutes.', lambda r: r['flood']['alarms_10min']),
    'alarm_flood': ('Whether there is a flood.', lambda r: r['flood']['flooding']),
}


def _alarms(monitors: list[WatchedMonitor]) -> Iterator[Metric]:
    labels = [*_BEARING, 'alarm', 'priority']
    records = [(m, m.alarms) for m in monitors if m.alarms is not None]
    alarms = [
        ((m.namespace, a['bearing'].rpartition('/')[2], a['alarm'], a['priority']), a)
        for m, record in records
        for a in record['alarms']
    ]
    yield _family(
        'alarm_active',
        'Whether the cause of the alarm is there.',
        labels,
        [(names, a['active']) for names, a in alarms],
    )
    yield _family(
        'alarm_state',
        'Whether the alarm is in this state.',
        [*labels, 'state'],
        [((*names, s.value), a['state'] == s.value) for names, a in alarms for s in AlarmState],
    )
    for name, (text, value) in _OF_ALARMS.items():
        yield _family(name, text, _SPACE, [(_space(m), value(r)) for m, r in records])


def _single(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f'{PREFIX}{name}', text, value=float(value))


def _family(
    name: str, text: str, labels: Sequence[str], values: Iterable[tuple[Any, Any]]
) -> Metric:
    family = GaugeMetricFamily(f'{PREFIX}{name}', text, labels=labels)
    for names, value in values:
        family.add_metric(list(names), float(value))
    return family
