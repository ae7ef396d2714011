# SPDX-License-Identifier: Apache-2.0
"""Every state the stick-slip alarm can get into, by trying everything in each of them."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from stickslip_monitor import MonitorConfig
from stickslip_monitor.monitor.alarms import annunciator as module
from stickslip_monitor.monitor.alarms.annunciator import Action, Annunciator, LiveAlarm
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.alarms.lifecycle import TABLE, AlarmState, Facts, Trigger, follow
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.verdict import Event

NORMAL, STICK_SLIP, AMPLITUDE = Condition.NORMAL, Condition.STICK_SLIP, Condition.AMPLITUDE
Row = tuple[AlarmState, Trigger, str]
Key = tuple[object, ...]


def _alarms(annunciator: Annunciator) -> tuple[LiveAlarm, LiveAlarm]:
    own = annunciator.alarms['aft']
    return own[AlarmKind.STICK_SLIP], own[AlarmKind.AMPLITUDE_LIMIT]


def _key(annunciator: Annunciator, condition: Condition) -> Key:
    facts = [(a.state, a.active, a.occurred, a.suppressed_by) for a in _alarms(annunciator)]
    return (condition, *facts)


def _moves(
    annunciator: Annunciator, condition: Condition
) -> Iterator[tuple[Annunciator, Condition]]:
    """All that can happen next: the cause, the shaft's lock, and what people do."""
    for after in (NORMAL, STICK_SLIP, AMPLITUDE):
        # The same condition once more is a new onset while it stands.
        if after is not condition or after is not NORMAL:
            twin = copy.deepcopy(annunciator)
            onset = after is condition
            twin.take_event(Event('aft', 0, condition, after, None, False, {}, '', onset=onset))
            yield twin, after
    for action in Action:
        if action is not Action.SILENCE:
            twin = copy.deepcopy(annunciator)
            twin.act(action, 0, 'Ada', 'aft', AlarmKind.STICK_SLIP)
            yield twin, condition
    for action in (Action.ACKNOWLEDGE, Action.SHELVE):
        twin = copy.deepcopy(annunciator)
        twin.act(action, 0, 'Ada', 'aft', AlarmKind.AMPLITUDE_LIMIT)
        yield twin, condition


def _reached(begin: Annunciator) -> list[Annunciator]:
    """One annunciator in each of the states that any course of moves leads to."""
    found = {_key(begin, NORMAL): begin}
    open_ends = [(begin, NORMAL)]
    while open_ends:
        for twin, condition in _moves(*open_ends.pop()):
            if (key := _key(twin, condition)) not in found:
                found[key] = twin
                open_ends.append((twin, condition))
    return list(found.values())


@pytest.mark.slow
def test_every_state_and_every_choice_of_the_table_is_there_for_something(
    configure: Callable[..., MonitorConfig], monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: set[Row] = set()

    def noted(state: AlarmState, trigger: Trigger, facts: Facts) -> AlarmState:
        for fact, _ in TABLE.get((state, trigger), ()):
            if not fact or getattr(facts, fact):
                taken.add((state, trigger, fact))
                break
        return follow(state, trigger, facts)

    monkeypatch.setattr(module, 'follow', noted)
    for latch in (False, True):
        config = configure(alarm__latch=latch)
        reached = _reached(Annunciator(replace(config, shelve_time_ns=1, silence_time_ns=1)))
        assert len(reached) > 100
        states = {_alarms(annunciator)[0].state for annunciator in reached}
        assert states == set(AlarmState) - (set() if latch else {AlarmState.LATCHED})
    every = {(*place, fact) for place, choices in TABLE.items() for fact, _ in choices}
    assert taken == every
