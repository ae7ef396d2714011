# SPDX-License-Identifier: Apache-2.0
"""The alarms of a session, on time, log and store of the test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from stickslip_monitor import MonitorConfig
from stickslip_monitor.errors import AlarmStateError
from stickslip_monitor.monitor.alarms.annunciator import Action
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.alarms.requests import ActionRequest
from stickslip_monitor.monitor.session import HEARTBEAT_NS, Moment, Session, Sink

SECOND = 10**9
T0 = 1_700_000_000 * SECOND
Configure = Callable[..., MonitorConfig]


class Ship(Sink):
    """Clock, log, store and publisher in one."""

    path = 'state.json'

    def __init__(self, config: MonitorConfig, document: Any = None) -> None:
        self.now_ns, self.document, self.full = 0, document, ''
        self.published: list[dict[str, Any]] = []
        self.take_alarms = self.published.append  # type: ignore[method-assign]
        self.lines: list[str] = []
        self.info = self.warning = self.error = self.lines.append
        self.session = Session(config, self, self, lambda: T0 + self.now_ns, self)
        self.session.begin()

    @property
    def now(self) -> Moment:
        return Moment(self.now_ns, T0 + self.now_ns)

    def read(self) -> Any:
        if isinstance(self.document, str):
            raise AlarmStateError('it is not JSON')
        return self.document

    def write(self, document: Any) -> None:
        if self.full:
            raise OSError(self.full)
        self.document = document

    def set_aside(self) -> str:
        return 'state.json.damaged'

    def sail(self, rpm: float, load: float, seconds: int = 1) -> None:
        for _ in range(seconds):
            self.now_ns += SECOND
            for place, value in enumerate((rpm, load)):
                self.session.take('aft', place, T0 + self.now_ns, value, self.now)
            self.session.tick(self.now, self.now_ns)

    def drift(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now_ns += SECOND
            self.session.pass_time('aft', T0 + self.now_ns, self.now)
            self.session.tick(self.now, self.now_ns)

    def does(self, action: Action, kind: AlarmKind | None = None) -> list[Any]:
        return self.session.act(ActionRequest(action, 'Ada', 'aft' if kind else None, kind))

    def states(self) -> dict[str, str]:
        alarms = self.published[-1]['alarms']
        return {a['alarm']: a['state'] for a in alarms if a['state'] != 'normal'}


def test_samples_time_and_people_change_the_list_and_the_store(configure: Configure) -> None:
    ship = Ship(configure())
    ship.sail(20.0, 1000.0, 5)  # deep in the stick-slip range
    assert ship.states()['stick_slip'] == 'unacknowledged'
    assert ship.states()['bistable'] == 'acknowledged'
    assert not any(' by ' in line for line in ship.lines)  # the monitor's own changes are events
    changes = ship.does(Action.ACKNOWLEDGE, AlarmKind.STICK_SLIP)
    assert [change.by for change in changes] == ['Ada']
    assert ship.lines[-1] == 'aft/stick_slip: acknowledge by Ada, unacknowledged -> acknowledged'
    ship.drift(10)  # nothing more is heard: lost, and what stood stands
    assert ship.states()['input_lost'] == 'unacknowledged'
    assert ship.states()['stick_slip'] == 'acknowledged'
    after = Ship(configure(), ship.document)  # a restart
    assert after.states()['stick_slip'] == 'acknowledged'
    sequence = [record['sequence'] for record in ship.published]
    assert sequence == list(range(1, len(sequence) + 1))


def test_the_list_is_published_once_a_minute_without_any_change(configure: Configure) -> None:
    ship = Ship(configure())
    ship.session.tick(ship.now, HEARTBEAT_NS - 1)
    assert len(ship.published) == 1
    ship.session.tick(ship.now, HEARTBEAT_NS)
    ship.session.tick(ship.now, HEARTBEAT_NS + 1)
    assert [record['changes'] for record in ship.published] == [[], []]


def test_a_store_that_fails_is_told_once_for_each_outage(configure: Configure) -> None:
    ship = Ship(configure())
    ship.sail(20.0, 1000.0, 5)
    told = []
    for full in ('disk full', 'disk full', '', 'disk full'):
        ship.full = full
        for action in (Action.SHELVE, Action.UNSHELVE):
            ship.does(action)
        told.append(sum('not kept' in line for line in ship.lines))
    assert told == [1, 1, 1, 2]


def test_a_damaged_store_starts_fresh(configure: Configure) -> None:
    ship = Ship(configure(), 'rubbish')
    assert ship.states() == {}
    assert ship.lines == [
        'state_file state.json cannot be used: it is not JSON; it is now state.json.damaged,'
        ' and the alarms start fresh'
    ]


@pytest.mark.parametrize('value', [float('nan'), 1e9])
def test_values_that_cannot_be_raise_input_implausible(configure: Configure, value: float) -> None:
    ship = Ship(configure())
    ship.sail(60.0, 1000.0, 3)
    ship.sail(value, 1000.0, 5)
    assert ship.states()['input_implausible'] == 'unacknowledged'
