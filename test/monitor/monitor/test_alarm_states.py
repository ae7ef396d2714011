# SPDX-License-Identifier: Apache-2.0
"""The table of an alarm's life, held to what ISA-18.2 asks of any."""

from __future__ import annotations

from itertools import product

import pytest

from stickslip_monitor.monitor.alarm_states import TABLE, AlarmState, Facts, Trigger, next_state

EVERY_FACTS = [Facts(*values) for values in product((False, True), repeat=len(Facts._fields))]
CAUSES = (Trigger.RAISE, Trigger.CLEAR, Trigger.SUPPRESS, Trigger.UNSUPPRESS)
WAITING = (AlarmState.UNACKNOWLEDGED, AlarmState.RETURNED)


def test_every_row_ends_with_a_choice_that_always_holds_or_leaves_the_state() -> None:
    for (state, trigger), choices in TABLE.items():
        facts = [fact for fact, _ in choices]
        assert len(set(facts)) == len(facts), (state, trigger)
        assert {*facts} <= {'', *Facts._fields}
        assert '' not in facts[:-1], (state, trigger)


def test_only_a_person_takes_an_unacknowledged_alarm_away() -> None:
    for facts in EVERY_FACTS:
        for state, trigger in product(WAITING, CAUSES):
            assert next_state(state, trigger, facts) in WAITING


def test_only_a_reset_or_removal_takes_a_latch_away() -> None:
    triggers = {
        trigger
        for trigger, facts in product(Trigger, EVERY_FACTS)
        if not facts.active and next_state(AlarmState.LATCHED, trigger, facts) is not AlarmState.LATCHED
    }
    # 'raise' and 'covered' come with an active cause.
    assert triggers - {Trigger.RAISE, Trigger.UNSUPPRESS} == {Trigger.RESET, Trigger.REMOVE}


def test_nothing_but_a_cause_gives_an_alarm_and_none_while_suppressed() -> None:
    for state, trigger, facts in product(AlarmState, Trigger, EVERY_FACTS):
        if state is AlarmState.NORMAL and facts.suppressed:
            continue  # Never normal while suppressed: it is suppressed at once.
        if next_state(state, trigger, facts) is AlarmState.UNACKNOWLEDGED is not state:
            assert facts.active or trigger is Trigger.RAISE
            assert not facts.suppressed or trigger is Trigger.UNSUPPRESS


# ANSI/ISA-18.2-2016, figure of alarm state transitions, and IEC 62682: the standard's letters.
PUBLISHED = """
A raise B, B acknowledge C, B clear D, C clear A, D acknowledge A, D raise B, A shelve G, B
shelve G, C shelve G, G unshelve A, A suppress H, C suppress H, H unsuppress A, A remove I, B
remove I, C remove I, I restore A, F reset A, F raise B
"""


def test_the_published_transitions() -> None:
    # One state serves as D and E.
    by_letter = {letter: state for state in AlarmState for letter in state.letter.split(', ')}
    for row in PUBLISHED.split(','):
        old, trigger, new = row.split()
        assert next_state(by_letter[old], Trigger(trigger), Facts()) is by_letter[new], row


@pytest.mark.parametrize(
    ('state', 'trigger'),
    [
        (AlarmState.SHELVED, Trigger.UNSHELVE),
        (AlarmState.SUPPRESSED, Trigger.UNSUPPRESS),
        (AlarmState.OUT_OF_SERVICE, Trigger.RESTORE),
    ],
)
def test_a_returning_alarm_with_its_cause_is_raised_again(state: AlarmState, trigger: Trigger) -> None:
    assert next_state(state, trigger, Facts(active=True)) is AlarmState.UNACKNOWLEDGED
    assert next_state(state, trigger, Facts(active=True, covered=True)) is AlarmState.ACKNOWLEDGED
