# SPDX-License-Identifier: Apache-2.0
"""Times, durations and quantities in words; expected values by the calendar and by hand."""

from __future__ import annotations

import math
from datetime import datetime, timezone

import pytest

from stickslip_monitor.report import formatting

NS = 10**9


def ns(text: str) -> int:
    return int(datetime.fromisoformat(text).replace(tzinfo=timezone.utc).timestamp()) * NS


@pytest.mark.parametrize(
    ('shown', 'text'),
    [
        (formatting.duration(0.0), '0.0 s'),
        (formatting.duration(9.96), '10 s'),
        (formatting.duration(59.6), '1 min'),
        (formatting.duration(130.0), '2 min 10 s'),
        (formatting.duration(3900.0), '1 h 5 min'),
        (formatting.duration(90_000.0), '1 d 1 h'),
        (formatting.duration(math.inf), 'for ever'),
        (formatting.share(0.0, 5.0), '0 %'),
        (formatting.share(1e-9, 5.0), 'below 0.1 %'),
        (formatting.share(0.05, 1.0), '5.0 %'),
        (formatting.share(1.0, 1.0), '100 %'),
        (formatting.share(1.0, 0.0), '0 %'),
        (formatting.margin(-0.0512), '\N{MINUS SIGN}5.1 %'),
        (formatting.margin(math.inf), 'no boundary'),
        (formatting.millimetres(0.00106249), '1.06 mm'),
        (formatting.load(998.4), '0.9984 kN'),
        (formatting.load(25_000.0), '25 kN'),
        (formatting.rpm(-20.04), '\N{MINUS SIGN}20.0 rpm'),
        (formatting.count(1, 'event'), '1 event'),
        (formatting.count(1250, 'event'), '1 250 events'),
    ],
)
def test_quantities(shown: str, text: str) -> None:
    spaces = ('\N{NO-BREAK SPACE}', '\N{NARROW NO-BREAK SPACE}')
    assert shown.replace(spaces[0], ' ').replace(spaces[1], ' ') == text


def test_times_are_utc_whatever_the_machine_says(monkeypatch: pytest.MonkeyPatch) -> None:
    import time

    monkeypatch.setenv('TZ', 'Asia/Tokyo')
    time.tzset()
    try:
        at = ns('2026-05-04T06:01:27') + 49 * 10**6
        assert formatting.date(at) == '2026-05-04'
        assert formatting.clock(at) == '06:01:27.0'
        assert formatting.minute(at) == '06:01:27'
        assert formatting.iso(at) == '2026-05-04T06:01:27.049000Z'
        # Tenths carry over midnight.
        assert formatting.clock(ns('2026-05-04T23:59:59') + 960 * 10**6) == '00:00:00.0'
    finally:
        monkeypatch.undo()
        time.tzset()


def test_a_clock_that_counts_from_a_start_has_no_date() -> None:
    assert not formatting.is_dated(90 * NS)
    assert formatting.clock(90 * NS) == '90.0 s'
    assert formatting.date(90 * NS) == formatting.iso(90 * NS) == ''
