# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from stickslip_monitor import MonitorConfig
from stickslip_monitor.monitor.ladder import (
    LADDER,
    AlarmTrack,
    Condition,
    ConditionChange,
    LastSample,
)

SECOND = 10**9
STICK = LADDER.index(Condition.STICK_SLIP)
STALE, NORMAL, SLIPPING = Condition.INPUT_STALE, Condition.NORMAL, Condition.STICK_SLIP
NOTHING = [None, None]
Configure = Callable[..., MonitorConfig]


@pytest.fixture
def track(configure: Configure) -> AlarmTrack:
    return AlarmTrack(configure(speed__timeout=3.0, load__timeout=4.0).bearing('aft'))


def _heard(speed: float, load: float) -> list[LastSample | None]:
    """Inputs heard at these seconds, with the timeouts of the fixture."""
    return [
        LastSample(round(speed * SECOND), round((speed + 3) * SECOND)),
        LastSample(round(load * SECOND), round((load + 4) * SECOND)),
    ]


def test_inputs_never_heard_are_lost_after_their_timeout(track: AlarmTrack) -> None:
    assert track.lost(0, NOTHING) == {}
    assert track.advance(5 * SECOND, NOTHING) == []
    assert track.advance(8 * SECOND, NOTHING) == []
    assert not track.stale
    raised = track.advance(20 * SECOND, NOTHING)
    assert raised == [ConditionChange(8 * SECOND, NORMAL, STALE, {'speed': math.inf})]
    assert track.condition is STALE
    assert track.lost(20 * SECOND, NOTHING) == {'speed': math.inf, 'load': math.inf}


def test_lost_at_its_deadline_with_its_age(track: AlarmTrack) -> None:
    track.advance(0, NOTHING)
    inputs = _heard(speed=10.0, load=8.5)
    assert track.advance(round(12.5 * SECOND), inputs) == []
    assert track.lost(round(12.5 * SECOND) - 1, inputs) == {}
    (raised,) = track.advance(round(12.5 * SECOND) + 1, inputs)
    assert raised == ConditionChange(round(12.5 * SECOND), NORMAL, STALE, {'load': 4.0})
    assert track.lost(14 * SECOND, inputs) == {'speed': 4.0, 'load': 5.5}


def test_both_lost_at_one_instant(track: AlarmTrack) -> None:
    track.advance(0, NOTHING)
    (raised,) = track.advance(60 * SECOND, _heard(speed=10.0, load=9.0))
    assert (raised.time_ns, raised.lost) == (13 * SECOND, {'speed': 3.0, 'load': 4.0})


def test_lost_only_once(track: AlarmTrack) -> None:
    track.advance(0, NOTHING)
    assert len(track.advance(60 * SECOND, NOTHING)) == 1
    assert track.advance(90 * SECOND, NOTHING) == []


def test_recovers_with_the_next_point(track: AlarmTrack) -> None:
    track.advance(0, NOTHING)
    assert track.apply(STICK, 0) == [ConditionChange(0, NORMAL, SLIPPING)]
    assert track.apply(STICK, SECOND) == []
    (raised,) = track.advance(9 * SECOND, _heard(0.0, 0.0))
    assert (raised.before, raised.after) == (SLIPPING, STALE)
    assert track.apply(STICK, 9 * SECOND) == [ConditionChange(9 * SECOND, STALE, SLIPPING)]
    assert track.apply(0, 10 * SECOND) == [ConditionChange(10 * SECOND, SLIPPING, NORMAL)]


def test_restart_waits_anew(track: AlarmTrack) -> None:
    track.advance(100 * SECOND, NOTHING)
    track.restart(0)
    assert track.advance(3 * SECOND, NOTHING) == []
    (raised,) = track.advance(50 * SECOND, NOTHING)
    assert raised.time_ns == 3 * SECOND


def test_restart_while_lost_stays_lost(track: AlarmTrack) -> None:
    track.advance(0, NOTHING)
    track.advance(60 * SECOND, NOTHING)
    track.restart(0)
    assert track.condition is STALE
    assert track.apply(0, SECOND) == [ConditionChange(SECOND, STALE, NORMAL)]


def test_shorter_timeout_of_an_input_never_heard_ends_no_earlier_than_now(
    track: AlarmTrack, configure: Configure
) -> None:
    track.advance(0, NOTHING)
    track.advance(2 * SECOND, NOTHING)
    track.retune(configure(speed__timeout=1.0, load__timeout=9.0).bearing('aft'))
    (raised,) = track.advance(30 * SECOND, NOTHING)
    assert (raised.time_ns, raised.lost) == (2 * SECOND, {'speed': math.inf})
