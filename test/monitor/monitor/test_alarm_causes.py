# SPDX-License-Identifier: Apache-2.0
"""The causes of alarms over a restart."""

from __future__ import annotations

from sending import configured

from stickslip_monitor.monitor.alarm_causes import Causes
from stickslip_monitor.monitor.alarm_states import AlarmKind


def test_a_cause_that_waits_for_the_end_of_a_mix_keeps_restored_causes() -> None:
    causes = Causes(configured().bearings[0], {AlarmKind.INPUT_LOST})
    causes.recall({AlarmKind.STICK_SLIP}, 0)
    assert causes.recalled == {AlarmKind.INPUT_LOST, AlarmKind.STICK_SLIP}
    causes.advance(3600 * 10**9)
    assert not causes.recalled
