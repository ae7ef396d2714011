# SPDX-License-Identifier: Apache-2.0
"""Episodes of stick-slip from sticks laid out by hand, with a gap of one second allowed."""

from __future__ import annotations

import pytest

from stickslip_monitor.lab.scenes.lining import EpisodeEvent, Episodes


def watch(
    *sticks: tuple[float, float], until: float = 100.0
) -> list[tuple[str, float, float, int]]:
    """Name, when known, when it was, and number of sticks of each event."""
    episodes = Episodes(1.0)
    events: list[EpisodeEvent] = []
    for start, end in sticks:
        events += episodes.stick(start)
        episodes.release(end)
    events += episodes.passed(until)
    return [(e.name, e.known, e.time, e.sticks) for e in events]


def test_sticks_with_short_gaps_are_one_episode() -> None:
    assert watch((10.0, 10.2), (11.0, 11.2), (12.2, 12.3)) == [
        ('first_stick', 11.0, 10.0, 1),
        ('last_stick', 13.3, 12.3, 3),
    ]


def test_a_longer_gap_parts_two_episodes() -> None:
    found = watch((10.0, 10.2), (11.0, 11.25), (12.5, 12.75), (13.0, 13.5))
    assert found == [
        ('first_stick', 11.0, 10.0, 1),
        ('last_stick', 12.25, 11.25, 2),
        ('first_stick', 13.0, 12.5, 1),
        ('last_stick', 14.5, 13.5, 2),
    ]


def test_a_single_stick_is_none() -> None:
    assert watch((10.0, 10.2), (20.0, 20.2), (30.0, 30.2)) == []


def test_an_episode_is_not_over_before_the_gap() -> None:
    sticks = ((10.0, 10.2), (11.0, 11.5))
    assert [e[0] for e in watch(*sticks, until=12.5)] == ['first_stick']
    assert [e[0] for e in watch(*sticks, until=12.6)] == ['first_stick', 'last_stick']


def test_a_stick_that_lasts_keeps_the_episode_open() -> None:
    episodes = Episodes(1.0)
    for start, end in ((10.0, 10.2), (11.0, 11.2)):
        episodes.stick(start)
        episodes.release(end)
    assert episodes.stick(12.0) == []
    assert episodes.passed(50.0) == []
    episodes.release(60.0)
    (last,) = episodes.passed(70.0)
    assert (last.time, last.sticks) == (60.0, 3)
    assert last.sticking == pytest.approx(0.2 + 0.2 + 48.0)
