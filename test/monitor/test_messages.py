# SPDX-License-Identifier: Apache-2.0
"""Events as they are published and written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stickslip_monitor.monitor import messages
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.messages import event_record, event_records
from stickslip_monitor.offline.check import check_bag

ROOT = Path(__file__).parents[2]


def test_events_together_are_what_each_is_by_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config = load_config(ROOT / 'launch_configs' / 'reference_bearing.yaml')
    found = [
        event
        for name in ('coast_down', 'sensor_values', 'manoeuvring')
        for event in check_bag(ROOT / 'bags' / name, config).bearings['aft_stern'].events
    ]
    assert len(found) > 20
    # An input may be lost before there is any operating point.
    found[5:5] = [replace(found[0], assessment=None)] * 2
    alone = [event_record(event) for event in found]
    for together in (3, 1000):
        monkeypatch.setattr(messages, '_TOGETHER', together)
        # To the last bit, and without an assessment where there was none.
        assert event_records(found) == alone
    assert event_records([]) == []
