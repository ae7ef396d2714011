# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from stickslip_monitor.monitor.ladder import LADDER, Condition, Level


def test_conditions() -> None:
    assert [c.level for c in LADDER] == [
        Level.OK,
        Level.WARN,
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
