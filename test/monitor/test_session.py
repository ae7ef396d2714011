# SPDX-License-Identifier: Apache-2.0
"""A session in the test's own time: what it tells of samples, silence and mostly dead sensors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from stickslip_monitor import MonitorConfig
from stickslip_monitor.monitor.input_watch import Graph
from stickslip_monitor.monitor.messages import BearingState, bearing_record
from stickslip_monitor.monitor.session import Moment, NoLog, Session, Sink
from stickslip_monitor.monitor.verdict import Event, Verdict

SECOND = 10**9
T0 = 1_700_000_000 * SECOND


class Shown(Sink):
    """What was told."""

    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []
        self.events: list[Event] = []
        self.states: list[BearingState] = []

    def take_verdict(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    def take_event(self, event: Event) -> None:
        self.events.append(event)

    def take_states(self, states: list[BearingState], whole: bool) -> None:
        self.states = states


class Ship:
    """A session that is fed five times a second."""

    def __init__(self, config: MonitorConfig) -> None:
        self.shown, self.now_ns = Shown(), 0
        self.session = Session(config, self.shown, NoLog(), lambda: T0, None, Graph())
        self.session.begin()

    @property
    def now(self) -> Moment:
        return Moment(self.now_ns, T0 + self.now_ns)

    def sail(self, seconds: float, rpm: Any = 60.0, load: Any = 1000.0) -> dict[str, Any]:
        """So long with samples (``None`` for none); the record at the end."""
        for number in range(round(5 * seconds)):
            self.now_ns += SECOND // 5
            for place, value in enumerate((rpm, load)):
                given = value(number) if callable(value) else value
                if given is not None:
                    self.session.take('aft', place, self.now.time_ns, given, self.now)
            self.session.pass_time('aft', self.now.time_ns - SECOND // 2, self.now)
            self.session.tick(self.now, self.now_ns)
        self.session.show(self.now)
        return bearing_record(self.shown.states[0])


@pytest.fixture
def ship(configure: Callable[..., MonitorConfig]) -> Ship:
    return Ship(configure(speed__timeout=2.0, load__timeout=2.0))


def test_the_record_of_a_bearing_has_numbers(ship: Ship) -> None:
    record = ship.sail(20.0, rpm=20.0)
    assert (record['reason'], record['sticking'], record['level']) == ('stick_slip', True, 'ERROR')
    assert record['rpm'] == pytest.approx(20.0)
    # Fold speed 40.7231 rpm of this bearing at 1000 N (docs/physics.md).
    assert record['fold_margin'] == pytest.approx(20.0 / 40.7231 - 1.0, abs=1e-4)
    assert record['inputs']['speed']['rate'] == pytest.approx(5.0)
    assert record['inputs']['load']['age'] == 0.0
    assert record['inputs']['load']['counts']['accepted'] == 100


def test_a_mostly_dead_sensor_is_told_with_its_share(ship: Ship) -> None:
    assert ship.sail(20.0, rpm=lambda k: 60.0 if k % 10 else math.nan)['level'] == 'OK'
    record = ship.sail(60.0, rpm=lambda k: math.nan if k % 5 else 60.0)
    assert record['level'] == 'WARN'
    assert '80% of the samples on /shaft/speed are refused, most because: not a' in record['text']
    assert ship.sail(60.0)['level'] == 'OK'


def test_time_in_which_nobody_could_listen_loses_no_input(ship: Ship) -> None:
    ship.sail(5.0)
    ship.now_ns += 10 * SECOND
    ship.session.excuse(10 * SECOND)
    ship.sail(1.0)
    assert ship.shown.events == []
    ship.sail(4.0, rpm=None)
    assert [event.after.value for event in ship.shown.events] == ['input_stale']
    assert 'no valid value on /shaft/speed' in ship.shown.events[0].text


def test_verdicts_are_told_at_most_once_a_period_but_for_changes(
    configure: Callable[..., MonitorConfig],
) -> None:
    ship = Ship(replace(configure(), publish_period=1.0))
    ship.sail(10.0)
    assert len(ship.shown.verdicts) in (10, 11)
    told = len(ship.shown.verdicts)
    ship.sail(10.0, rpm=20.0)
    changes = len(ship.shown.events)
    assert told + 10 <= len(ship.shown.verdicts) <= told + 10 + 2 * changes
    assert changes >= 1
