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


def plain(text: str) -> str:
    return text.replace('\N{NO-BREAK SPACE}', ' ').replace('\N{NARROW NO-BREAK SPACE}', ' ')


@pytest.mark.parametrize(
    ('seconds', 'text'),
    [
        (0.0, '0.0 s'),
        (4.23, '4.2 s'),
        (9.96, '10 s'),
        (59.4, '59 s'),
        (59.6, '1 min'),
        (130.0, '2 min 10 s'),
        (3600.0, '1 h'),
        (3900.0, '1 h 5 min'),
        (90_000.0, '1 d 1 h'),
        (math.inf, 'for ever'),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert plain(formatting.duration(seconds)) == text


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
    finally:
        monkeypatch.undo()
        time.tzset()


def test_tenths_carry_over_midnight() -> None:
    at = ns('2026-05-04T23:59:59') + 960 * 10**6
    assert formatting.clock(at) == '00:00:00.0'


def test_a_clock_that_counts_from_a_start_has_no_date() -> None:
    assert not formatting.is_dated(90 * NS)
    assert formatting.clock(90 * NS) == '90.0 s'
    assert formatting.date(90 * NS) == formatting.iso(90 * NS) == ''


@pytest.mark.parametrize(
    ('part', 'whole', 'text'),
    [
        (0.0, 5.0, '0 %'),
        (1e-9, 5.0, 'below 0.1 %'),
        (0.05, 1.0, '5.0 %'),
        (1.0, 1.0, '100 %'),
        (1.0, 0.0, '0 %'),
    ],
)
def test_a_small_share_is_not_nothing(part: float, whole: float, text: str) -> None:
    assert plain(formatting.share(part, whole)) == text


def test_quantities() -> None:
    assert plain(formatting.margin(-0.0512)) == '\N{MINUS SIGN}5.1 %'
    assert formatting.margin(math.inf) == 'no boundary'
    assert plain(formatting.millimetres(0.00106249)) == '1.06 mm'
    assert [plain(formatting.load(n)) for n in (998.4, 25_000.0)] == ['0.9984 kN', '25 kN']
    assert plain(formatting.rpm(-20.04)) == '\N{MINUS SIGN}20.0 rpm'
    assert plain(formatting.count(1, 'event')) == '1 event'
    assert plain(formatting.count(1250, 'event')) == '1 250 events'
