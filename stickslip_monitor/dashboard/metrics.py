# SPDX-License-Identifier: Apache-2.0
"""The figures for Prometheus: names end in base units, as its conventions ask.

They are read from the board when somebody scrapes. Of a monitor that is not heard the figures are
left out rather than repeated, so that nobody takes an old value for a new one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from stickslip_monitor.dashboard.received import NOT_MONITORING, BearingStatus
from stickslip_monitor.dashboard.state import DashboardState
from stickslip_monitor.monitor.alarms.lifecycle import AlarmState
from stickslip_monitor.monitor.ladder import Condition

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
        yield _single('monitor_up', _UP, board.there)
        yield _single('dashboard_readers', 'Pages that are open.', len(board.hub.readers))
        if board.links:
            text, links = "Whether a link to the ship's buses works.", board.links.items()
            yield _family('link_up', text, ['link'], [([name], up) for name, up in links])
        silent = board.silent_for
        if silent is not None:
            text = 'Time since anything was heard of the monitor.'
            yield _single('monitor_silence_seconds', text, silent)
        missing = set(board.unheard())
        yield _family(
            'bearing_up',
            'Whether the bearing is heard (1) or not (0).',
            ['bearing'],
            [([name], name not in missing) for name in board.bearings],
        )
        if board.heard:
            heard = [name for name in board.bearings if name not in missing]
            known = [(name, board.status(name)) for name in heard]
            yield from self._bearings([(name, s) for name, s in known if s is not None])
            if board.alarms is not None:
                yield from _alarms(board.alarms)

    def _bearings(self, known: list[tuple[str, BearingStatus]]) -> Iterator[Metric]:
        for key, (name, text) in GAUGES.items():
            values = [(n, s.numbers[key]) for n, s in known if key in s.numbers]
            if key in _ZERO_WITHOUT_A_CYCLE:
                values = [(n, 0.0 if math.isnan(value) else value) for n, value in values]
            # An infinite margin is a value, beyond every limit; NaN is none.
            values = [(n, value) for n, value in values if not math.isnan(value)]
            yield _family(name, text, ['bearing'], [([n], value) for n, value in values])
        yield _family(
            'predicted',
            'Whether stick-slip is predicted.',
            ['bearing'],
            [([n], s.sticking) for n, s in known if s.sticking is not None],
        )
        yield _family(
            'condition',
            'Whether the condition of the bearing is this one.',
            ['bearing', 'condition'],
            [([n, c], s.words.get('reason') == c) for n, s in known for c in _CONDITIONS],
        )
        yield self._ages(known)
        counter = CounterMetricFamily(
            f'{PREFIX}samples',
            'Samples by what became of them.',
            labels=['bearing', 'input', 'status'],
        )
        for name, status in known:
            for quantity, counts in status.counts.items():
                for kind, count in counts.items():
                    counter.add_metric([name, quantity, kind], count)
        yield counter

    def _ages(self, known: list[tuple[str, BearingStatus]]) -> Metric:
        ages = [
            ([name, quantity], self._board.sample_age(name, quantity))
            for name, status in known
            for quantity in status.counts
        ]
        return _family(
            'sample_age_seconds',
            'Time since the last sample that was used, as the monitor told of it.',
            ['bearing', 'input'],
            [(labels, age) for labels, age in ages if age is not None],
        )


def _alarms(record: dict[str, Any]) -> Iterator[Metric]:
    labels = ['bearing', 'alarm', 'priority']
    alarms = [((a['bearing'], a['alarm'], a['priority']), a) for a in record['alarms']]
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
    flood = record['flood']
    yield _single('alarms_unacknowledged', 'Alarms that wait.', record['unacknowledged'])
    yield _single('alarms_sounding', 'Whether any alarm sounds.', record['sounding'])
    yield _single('alarms_recent', 'Alarms of the last ten minutes.', flood.get('alarms_10min', 0))
    yield _single('alarm_flood', 'Whether there is a flood.', flood.get('flooding', False))


def _single(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f'{PREFIX}{name}', text, value=float(value))


def _family(name: str, text: str, labels: list[str], values: Iterable[tuple[Any, Any]]) -> Metric:
    family = GaugeMetricFamily(f'{PREFIX}{name}', text, labels=labels)
    for names, value in values:
        family.add_metric(list(names), float(value))
    return family
