# SPDX-License-Identifier: Apache-2.0
"""The annunciator against a bookkeeper who knows no states, only what people have been told.

The bookkeeper notes for each alarm whether its cause is there, whether it was given to people and
not acknowledged since, and whether somebody put it away. That is enough to say when an alarm is
lost, or given without a cause.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from sending import change as sent_change
from sending import configured, verdict_at

from stickslip_monitor.monitor.alarm_list import ON_SHOW, Action, AlarmChange, Annunciator, LiveAlarm
from stickslip_monitor.monitor.alarm_records import alarms_record, recall_state, state_record
from stickslip_monitor.monitor.alarm_states import LATCHING, RUNG_OF, AlarmKind, AlarmState
from stickslip_monitor.monitor.severity import LADDER, Condition

SECOND = 10**9
WAITING = {AlarmState.UNACKNOWLEDGED, AlarmState.RETURNED}
LADDER_KINDS = list(RUNG_OF)  # worst first


class Life(RuleBasedStateMachine):
    @initialize(latch=st.booleans(), inhibit=st.sampled_from([0.0, 20.0]))
    def begin(self, latch: bool, inhibit: float) -> None:
        delays = {'alarm.on_delay': 2.0, 'alarm.off_delay': 5.0, 'alarm.input_off_delay': 4.0}
        parameters = {'alarm.latch': latch, 'alarm.startup_inhibit': inhibit, 'level.topic': '/v'}
        config = configured('b', delays | parameters)
        config = replace(config, shelve_time_ns=60 * SECOND, silence_time_ns=30 * SECOND)
        self.config = config
        self.annunciator = Annunciator(config)
        self.now = 0
        self.condition = Condition.NORMAL
        self.rung = 0
        self.waiting: set[AlarmKind] = set()
        self.changes: list[AlarmChange] = []

    def alarms(self) -> dict[AlarmKind, LiveAlarm]:
        return self.annunciator.alarms['b']

    def take_changes(self, changes: list[AlarmChange]) -> None:
        self.changes += changes
        for change in changes:
            alarm = self.alarms()[change.kind]
            if change.what == 'raise':
                # No alarm without a cause; and none while the cause means nothing.
                assert alarm.active
                assert not (change.raised and alarm.suppressed_by)
            if change.raised:
                assert alarm.active
                self.waiting.add(change.kind)
            if change.what in ('acknowledge', 'shelve', 'remove'):
                self.waiting.discard(change.kind)

    @rule(seconds=st.sampled_from([0.0, 0.5, 1.0, 4.0, 5.0, 20.0, 61.0, -30.0]))
    def time_passes(self, seconds: float) -> None:
        self.now += round(seconds * SECOND)
        self.take_changes(self.annunciator.advance(self.now, self.now))

    @rule(condition=st.sampled_from(Condition))
    def condition_changes(self, condition: Condition) -> None:
        if condition is self.condition:
            return
        event = sent_change(self.now, self.condition, condition, bearing='b')
        self.condition = condition
        rung, self.rung = self.rung, LADDER.index(condition) if condition in LADDER else self.rung
        old_states = {kind: alarm.state for kind, alarm in self.alarms().items()}
        changes = self.annunciator.take_event(event)
        self.take_changes(changes)
        raised = [c.kind for c in changes if c.raised and c.what == 'raise' and c.kind in RUNG_OF]
        if self.rung <= rung:
            # Easing gives nothing, and of several rungs at once only the worst on show is given.
            assert raised == []
        assert len(raised) <= 1
        # No cause is lost: whoever is in service gets the worst alarm that has come.
        free = [
            kind
            for kind in LADDER_KINDS
            if rung < RUNG_OF[kind] <= self.rung
            and old_states[kind] in (AlarmState.NORMAL, AlarmState.LATCHED)
            and not self.alarms()[kind].suppressed_by
            and not self.annunciator.causes['b'].recalled
        ]
        worse = {k for k in LADDER_KINDS if self.alarms()[k].state is AlarmState.UNACKNOWLEDGED}
        assert not free or worse & set(LADDER_KINDS[: LADDER_KINDS.index(free[0]) + 1])

    @rule(place=st.integers(0, 1))
    def absurd_value(self, place: int) -> None:
        self.take_changes(self.annunciator.take_fault('b', place, 'values are odd', self.now))

    @rule(speed=st.sampled_from([0.0, 0.1]))
    def operating_point(self, speed: float) -> None:
        self.take_changes(self.annunciator.take_verdict(verdict_at(self.now, speed, 'b')))

    @rule(
        action=st.sampled_from(Action),
        kind=st.one_of(st.none(), st.sampled_from(AlarmKind)),
        bearing=st.sampled_from([None, 'b']),
    )
    def person_acts(self, action: Action, kind: AlarmKind | None, bearing: str | None) -> None:
        changes = self.annunciator.act(action, self.now, 'Ada', bearing, kind)
        assert {change.by for change in changes} <= {'Ada'}
        self.take_changes(changes)

    @precondition(lambda self: self.condition in (Condition.STICK_SLIP, Condition.AMPLITUDE))
    @rule()
    def stick_slip_restarts(self) -> None:
        condition = self.condition
        event = sent_change(self.now, condition, condition, onset=True, bearing='b')
        self.take_changes(self.annunciator.take_event(event))
        latching = [self.alarms()[kind] for kind in LATCHING]
        free = [a for a in latching if a.active and not a.suppressed_by and a.state in ON_SHOW]
        # A person has silenced it, for 30 s.
        free = [a for a in free if not a.silenced or a.recurring]
        # No onset without a sound, unless it was put away, or has sounded within ten minutes.
        lately = [a for a in latching if a.sounded_ns is not None and self.now - a.sounded_ns < 600 * SECOND]
        assert self.annunciator.sounding or not free or lately

    @precondition(lambda self: self.now > 0)
    @rule(down=st.sampled_from([0, 10 * SECOND, 1000 * SECOND, -(10**18)]))
    def node_restarts(self, down: int) -> None:
        document = state_record(self.annunciator, self.now)
        fresh = Annunciator(self.config)
        recall_state(fresh, document, self.now + down)
        for kind, alarm in self.alarms().items():
            restored = fresh.alarms['b'][kind]
            assert (restored.state, restored.since_ns, restored.by) == (alarm.state, alarm.since_ns, alarm.by)
        self.annunciator, self.now = fresh, 0
        self.condition, self.rung = Condition.NORMAL, 0

    @invariant()
    def no_alarm_is_lost(self) -> None:
        if hasattr(self, 'annunciator'):
            waits = {kind for kind, alarm in self.alarms().items() if alarm.state in WAITING}
            assert self.waiting <= waits
            # What waits was given, or lay with its latch on the shelf.
            assert all(self.alarms()[kind].occurred for kind in waits)

    @invariant()
    def what_is_on_show_has_its_cause(self) -> None:
        if hasattr(self, 'annunciator'):
            for alarm in self.annunciator:
                if alarm.state in (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED):
                    assert alarm.active
                if alarm.state is AlarmState.NORMAL:
                    assert not alarm.active
                    assert not alarm.suppressed_by
                if alarm.state in (AlarmState.RETURNED, AlarmState.LATCHED):
                    assert not alarm.active or alarm.suppressed_by
                if alarm.state is AlarmState.SUPPRESSED:
                    assert alarm.suppressed_by
                assert alarm.sounding <= (alarm.state is AlarmState.UNACKNOWLEDGED)

    @invariant()
    def memory_is_bounded(self) -> None:
        if hasattr(self, 'annunciator'):
            record: dict[str, Any] = alarms_record(self.annunciator, [], self.now, 0)
            assert len(record['alarms']) == len(AlarmKind)
            assert len(self.annunciator.flood._times) <= 1000
            raised_count = sum(alarm.count for alarm in self.annunciator)
            assert record['flood']['alarms_10min'] <= record['flood']['most_10min'] <= raised_count


TestLife = Life.TestCase
TestLife.pytestmark = [pytest.mark.slow]
TestLife.settings = settings(max_examples=200, stateful_step_count=50, deadline=None)
