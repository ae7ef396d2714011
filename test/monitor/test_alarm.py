# SPDX-License-Identifier: Apache-2.0
"""The alarm machine against a reference that knows nothing but four timers and a fine clock."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_monitor.monitor.config import AlarmConfig
from stickslip_monitor.monitor.ladder import LADDER, Alarm, Condition, Level, LevelChange

TICK = 10**8
TOP = len(LADDER) - 1
Samples = dict[int, list[int]]


def _config(on: int, off: int) -> AlarmConfig:
    return AlarmConfig(
        caution_margin=0.1,
        hysteresis=0.0,
        amplitude_limit=1.0,
        on_delay_ns=on * TICK,
        off_delay_ns=off * TICK,
    )


class OneTimer:
    """An on- and off-delay of one rung, as a relay counts them: tick by tick."""

    def __init__(self, on: int, off: int) -> None:
        self.on, self.off = on, off
        self.given = self.out = False
        self.elapsed = 0

    def tick(self) -> None:
        self.elapsed += 1

    def take(self, given: bool) -> None:
        if given != self.given:
            self.given, self.elapsed = given, 0
        self.look()

    def look(self) -> None:
        if self.given != self.out and self.elapsed >= (self.on if self.given else self.off):
            self.out = self.given


def _reference(samples: Samples, end: int, on: int, off: int) -> list[tuple[int, int, int]]:
    """Walk every tick; return (tick, rung before, rung after) of each change."""
    timers = [OneTimer(on, off) for _ in range(TOP)]
    changes, rung = [], 0
    for now in range(end):
        for timer in timers:
            timer.tick()
        for asked in samples.get(now, [None]):
            for k, timer in enumerate(timers, start=1):
                if asked is None:
                    timer.look()
                else:
                    timer.take(asked >= k)
            raised = max((k for k, t in enumerate(timers, start=1) if t.out), default=0)
            if raised != rung:
                changes.append((now, rung, raised))
                rung = raised
    return changes


def _steps(steps: list[LevelChange]) -> list[tuple[int, int, int]]:
    assert all(step.time_ns % TICK == 0 for step in steps)
    return [(step.time_ns // TICK, step.before, step.after) for step in steps]


@st.composite
def _courses(draw: st.DrawFn) -> tuple[Samples, int]:
    samples: Samples = {}
    now = 0
    for _ in range(draw(st.integers(0, 25))):
        now += draw(st.sampled_from([0, 1, 1, 2, 3, 5, 8, 30]))
        samples.setdefault(now, []).append(draw(st.integers(0, TOP)))
    return samples, now + draw(st.integers(1, 40))


@settings(max_examples=1500, deadline=None)
@given(course=_courses(), on=st.integers(0, 9), off=st.integers(0, 9), ticks=st.data())
def test_alarm_does_what_one_timer_a_rung_does(
    course: tuple[Samples, int], on: int, off: int, ticks: st.DataObject
) -> None:
    samples, end = course
    alarm, found = Alarm(_config(on, off)), []
    # Time may be told at any instants besides those of the samples, or at none.
    told = ticks.draw(st.sets(st.integers(0, end - 1), max_size=8))
    for now in sorted(set(samples) | told):
        if now in told:
            found += alarm.advance(now * TICK)
        for asked in samples.get(now, []):
            found += alarm.step(asked, now * TICK)
    found += alarm.advance(end * TICK)
    assert _steps(found) == _reference(samples, end, on, off)


def test_raised_after_the_on_delay_at_its_own_instant() -> None:
    alarm = Alarm(_config(20, 50))
    assert alarm.step(3, 0) == []
    assert alarm.advance(20 * TICK) == []
    assert alarm.advance(20 * TICK + 1) == [LevelChange(20 * TICK, 0, 3)]
    assert alarm.rung == 3


def test_a_sample_at_the_instant_decides() -> None:
    still = Alarm(_config(20, 50))
    still.step(3, 0)
    assert still.step(3, 20 * TICK) == [LevelChange(20 * TICK, 0, 3)]
    gone = Alarm(_config(20, 50))
    gone.step(3, 0)
    assert gone.step(0, 20 * TICK) == []
    assert gone.advance(1000 * TICK) == []


def test_an_interruption_starts_the_delay_anew() -> None:
    alarm = Alarm(_config(20, 50))
    for time, rung in ((0, 3), (19, 0), (20, 3), (39, 3)):
        assert alarm.step(rung, time * TICK) == []
    assert alarm.step(3, 40 * TICK) == [LevelChange(40 * TICK, 0, 3)]


def test_a_higher_rung_keeps_the_time_of_the_lower_one() -> None:
    alarm = Alarm(_config(20, 50))
    assert alarm.step(1, 0) == []
    assert alarm.step(3, 15 * TICK) == []
    assert alarm.advance(100 * TICK) == [
        LevelChange(20 * TICK, 0, 1),
        LevelChange(35 * TICK, 1, 3),
    ]


def test_falls_rung_by_rung() -> None:
    alarm = Alarm(_config(0, 50))
    assert alarm.step(4, 0) == [LevelChange(0, 0, 4)]
    assert alarm.step(2, 10 * TICK) == []
    assert alarm.step(0, 30 * TICK) == []
    assert alarm.advance(100 * TICK) == [
        LevelChange(60 * TICK, 4, 2),
        LevelChange(80 * TICK, 2, 0),
    ]


def test_without_delays_every_change_is_at_once() -> None:
    alarm = Alarm(_config(0, 0))
    assert [alarm.step(r, 7) for r in (0, 4, 1, 1)] == [
        [],
        [LevelChange(7, 0, 4)],
        [LevelChange(7, 4, 1)],
        [],
    ]


def test_restart_keeps_the_rung_and_forgets_the_time() -> None:
    alarm = Alarm(_config(20, 50))
    alarm.step(3, 0)
    alarm.advance(25 * TICK)
    alarm.step(0, 30 * TICK)
    alarm.restart()
    assert alarm.advance(1000 * TICK) == []
    assert alarm.rung == 3
    # Time may also have gone back.
    alarm.restart()
    assert alarm.step(0, -500 * TICK) == []
    assert alarm.advance(0) == [LevelChange(-450 * TICK, 3, 0)]


@pytest.mark.parametrize('seen', [8, 30])
def test_a_delay_made_shorter_while_it_runs_ends_no_earlier_than_now(seen: int) -> None:
    alarm = Alarm(_config(100, 100))
    alarm.step(3, 0)
    alarm.advance(seen * TICK)
    alarm.config = _config(2, 2)
    assert alarm.advance(40 * TICK) == [LevelChange(seen * TICK, 0, 3)]


def test_a_delay_made_longer_while_it_runs() -> None:
    alarm = Alarm(_config(20, 20))
    alarm.step(3, 0)
    alarm.advance(15 * TICK)
    alarm.config = _config(50, 20)
    assert alarm.advance(49 * TICK) == []
    assert alarm.advance(51 * TICK) == [LevelChange(50 * TICK, 0, 3)]


def test_conditions() -> None:
    assert [c.level for c in LADDER] == [
        Level.OK,
        Level.WARN,
        Level.WARN,
        Level.ERROR,
        Level.ERROR,
    ]
    assert Condition.INPUT_STALE not in LADDER
    assert Condition.INPUT_STALE.level is Level.ERROR
    assert str(Condition.STICK_SLIP) == Condition.STICK_SLIP.value == 'stick_slip'
    assert Condition('caution') is Condition.CAUTION
    # diagnostic_msgs/DiagnosticStatus: OK=0, WARN=1, ERROR=2
    assert [int(level) for level in Level] == [0, 1, 2]
