# SPDX-License-Identifier: Apache-2.0
"""The monitor beside the buses, in the test's time: what a link that dies does and does not."""

from __future__ import annotations

import logging
from typing import Any

from stickslip_monitor import build_config
from stickslip_monitor.links.live_monitor import LiveMonitor
from stickslip_monitor.monitor.alarms.annunciator import Action
from stickslip_monitor.monitor.alarms.requests import ActionRequest
from stickslip_monitor.monitor.signals import Input

SECOND = 10**9


class Ship:
    """A sink, and the time."""

    def __init__(self) -> None:
        values = {
            'mass': 50.0,
            'damping': 400.0,
            'stiffness': 2.0e6,
            'journal_diameter': 0.1,
            'friction.law': 'stribeck',
            'friction.static': 0.3,
            'friction.kinetic': 0.1,
            'friction.decay': 10.0,
            'speed.topic': 'NMEA/RPM',
            'speed.unit': 'rpm',
            'load.topic': 'NMEA/XDR',
            'load.unit': 'N',
            'speed.timeout': 2.0,
            'load.timeout': 2.0,
            'alarm.on_delay': 1.0,
            'alarm.off_delay': 1.0,
        }
        names = {'bearings': ['aft']} | {f'aft.{key}': value for key, value in values.items()}
        self.now_ns = 7 * SECOND
        self.record: dict[str, Any] = {}
        self.state: dict[str, Any] = {}
        log = logging.getLogger('ship')
        self.live = LiveMonitor(build_config(names), self, log, clock=lambda: self.now_ns)
        self.live.begin()

    def take_record(self, record: dict[str, Any]) -> None:
        self.state = record

    def take_alarms(self, record: dict[str, Any]) -> None:
        self.record = record

    def sail(self, rpm: float | None, load: float | None, seconds: float) -> dict[str, str]:
        """So long with samples five times a second; ``None`` for none. The states that matter."""
        for _ in range(round(5 * seconds)):
            for _ in range(2):
                self.now_ns += SECOND // 10
                self.live.tick()
            for which, value in ((Input.SPEED, rpm), (Input.LOAD, load)):
                if value is not None:
                    self.live.take('aft', which, value)
        alarms = self.record.get('alarms', ())
        return {a['alarm']: a['state'] for a in alarms if a['state'] != 'normal'}


STUCK = {'stick_slip': 'unacknowledged', 'bistable': 'acknowledged', 'margin_low': 'acknowledged'}


def test_a_link_that_dies_loses_the_input_and_clears_nothing() -> None:
    ship = Ship()
    assert ship.sail(60.0, 1000.0, 5.0) == {}
    assert ship.sail(20.0, 1000.0, 3.0) == STUCK
    assert ship.sail(None, None, 1.9) == STUCK
    lost = STUCK | {'input_lost': 'unacknowledged'}
    assert ship.sail(None, None, 2.0) == lost
    assert ship.state['reason'] == 'input_stale'
    assert ship.sail(None, None, 600.0) == lost
    back = ship.sail(20.0, 1000.0, 63.0)
    assert back == STUCK | {'input_lost': 'returned_unacknowledged'}


def test_inputs_that_never_come_are_lost_and_people_can_act() -> None:
    ship = Ship()
    ship.live.tick()
    assert ship.sail(None, None, 4.0) == {'input_lost': 'unacknowledged'}
    ship.live.act(ActionRequest(Action.ACKNOWLEDGE, 'Ada'))
    assert ship.sail(None, None, 1.0) == {'input_lost': 'acknowledged'}
    assert ship.record['alarms'][4]['by'] == 'Ada'
