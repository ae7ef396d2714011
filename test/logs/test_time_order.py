# SPDX-License-Identifier: Apache-2.0
"""One voyage with faults of time: the rule gives each row the time at which it happened."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stickslip_logs.arrays import IntArray
from stickslip_logs.time_order import Sorter, TimeCourse, TimeOrder

SECOND = 10**9
START = 1_780_000_000 * SECOND
COUNT = 1200
Rows = list[tuple[float, float, int]]
"""Time that was written and true time [s], and the source."""


def two_sources() -> Rows:
    """Ten minutes of two sources, one of them 1 ms later, twice a second."""
    return [(k / 2 + source / 1000, k / 2 + source / 1000, source) for k in range(COUNT) for source in (0, 1)]


def under_clock(clock: Callable[[float], float]) -> Rows:
    """Return the voyage under another clock."""
    return [(clock(time), time, source) for _, time, source in two_sources()]


def write_rows_late(begin: int, count: int, by: int) -> Rows:
    """Return the voyage with some rows written so many rows later."""
    rows = two_sources()
    delayed = rows[begin : begin + count]
    return [*rows[:begin], *rows[begin + count : begin + count + by], *delayed, *rows[begin + count + by :]]


def put_ahead(number: int, seconds: float) -> Rows:
    """Return the voyage with one message ahead."""
    rows = two_sources()
    time, true, source = rows[number]
    return [*rows[:number], (time + seconds, true, source), *rows[number + 1 :]]


def write_disordered(seconds: float) -> Rows:
    """Return the voyage, each row written up to some time late."""
    order = np.random.default_rng(5).uniform(0.0, seconds, 2 * COUNT)
    return [
        row for _, row in sorted(zip(order + [row[0] for row in two_sources()], two_sources(), strict=True))
    ]


def judge_rows(rows: Rows) -> tuple[TimeCourse, IntArray, IntArray]:
    """Judge rows in batches; return the course, and the times and true times in the order that results."""
    time_ns, true_ns = (np.array([START + round(row[k] * SECOND) for row in rows]) for k in (0, 1))
    source, place = np.array([row[2] for row in rows]), np.arange(len(rows)) * 7
    order = TimeOrder()
    for begin in range(0, len(rows), 500):
        batch = slice(begin, begin + 500)
        order.add(time_ns[batch], source[batch], place[batch])
    course = order.judge()
    sorter, parts = Sorter(course.wait_ns), []
    for begin in range(0, len(rows), 300):
        batch = slice(begin, begin + 300)
        follow = course.correct_times(time_ns[batch], source[batch], place[batch])
        parts += sorter.add((follow, true_ns[batch]))
    parts += sorter.rest()
    return course, np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


SET_BACK = 'the clock of it was set back {}, by {} s at most'
SORTED = 'they are in no order of time'
FAULTS: dict[str, tuple[Rows, str, float]] = {
    'none': (two_sources(), '', 0.0),
    **{
        f'set back by {back} s': (
            under_clock(lambda t, back=back: t - back * (t >= 300)),
            SET_BACK.format('once', back),
            0.0,
        )
        for back in (3, 200, 3600)
    },
    'set back by half a second': (under_clock(lambda t: t - 0.5 * (t >= 300)), '', 0.5),
    'set back twice': (
        under_clock(lambda t: t - 200 * (t >= 200) - 200 * (t >= 400)),
        SET_BACK.format('2 times', 200),
        0.0,
    ),
    'an hour ahead, and right again': (
        under_clock(lambda t: t + 3600 * (250 <= t < 350)),
        'the clock of it leapt ahead and back: 400 times',
        0.0,
    ),
    'one message late': (write_rows_late(400, 1, 25), '', 0.0),
    'one moment late': (write_rows_late(400, 2, 24), '', 0.0),
    'ten moments late': (write_rows_late(400, 20, 24), '', 0.0),
    **{
        f'message {number} ahead by {days} days': (
            put_ahead(number, days * 86_400),
            'the clock of it leapt ahead and back: 1 time taken from those beside',
            0.25,
        )
        for number in (0, 1, 400)
        for days in (1 / 24, 365)
    },
    'set back behind the first messages': (
        under_clock(lambda t: t - 3600 * (t >= 0.5)),
        'the clock of it leapt ahead and back: 2 times taken from those beside',
        3600.0,
    ),
    'set back behind the third message': (
        [(t - 3600 * (k >= 3), true, source) for k, (t, true, source) in enumerate(two_sources())],
        SET_BACK.format('once', 3600),
        0.0,
    ),
    'newest first': (two_sources()[::-1], SORTED, 0.0),
    'source by source': (sorted(two_sources(), key=lambda row: row[2]), SORTED, 0.0),
    'blocks reversed': (
        [row for begin in range(2 * COUNT - 240, -1, -240) for row in two_sources()[begin : begin + 240]],
        SORTED,
        0.0,
    ),
    'unordered within 2 s': (write_disordered(2.0), '', 0.0),
    'unordered within half a second': (write_disordered(0.5), '', 0.0),
}


@pytest.mark.parametrize('name', FAULTS)
def test_each_row_has_the_time_at_which_it_happened(name: str) -> None:
    rows, says, error = FAULTS[name]
    course, time_ns, true_ns = judge_rows(rows)
    assert (np.diff(time_ns) >= 0).all()
    assert time_ns.size == 2 * COUNT
    assert np.abs(time_ns - true_ns).max() <= error * SECOND + 2 * 10**6
    assert (course.start_ns, course.end_ns) == (time_ns[0], time_ns[-1])
    notes = ' | '.join(course.notes('they are', 'of it'))
    assert says in notes
    if name != 'unordered within 2 s':
        assert bool(notes) == bool(says)


@pytest.mark.parametrize('rate', [1, 2, 10])
@pytest.mark.parametrize('late_count', [1, 2, 5, 10])
@pytest.mark.parametrize('by', [1, 6, 30])
@pytest.mark.parametrize('lost', ['', 'before', 'ahead'])
def test_late_moments_are_sorted_in_silence_at_any_rate(
    rate: int, late_count: int, by: int, lost: str
) -> None:
    # The row beside them may be lost, too.
    every, ahead = [k / rate for k in range(600 * rate)], max(by * rate, 2)
    begin, end = 200 * rate, 200 * rate + late_count
    lost_time = {'': None, 'before': every[begin - 1], 'ahead': every[end]}[lost]
    order = [*every[:begin], *every[end : end + ahead], *every[begin:end], *every[end + ahead :]]
    course, time_ns, true_ns = judge_rows(
        [(t, t, source) for t in order if t != lost_time for source in (0, 1)]
    )
    np.testing.assert_array_equal(time_ns, true_ns)
    assert list(course.notes('they are', 'of it')) == []


def test_rows_that_are_put_in_order_elsewhere_are_kept_by_blocks() -> None:
    """Add an hour of two sources in one block: one segment each, and their overlap is no disorder."""
    order, time_ns = TimeOrder(is_in_blocks=True), START + np.arange(3600) * SECOND
    for source in (0, 1):
        order.add_to(source, time_ns, np.arange(3600) * 40 + source, offset=1 << 32)
    assert [source_rows.segments[:, 0].tolist() for source_rows in order._sources.values()] == [
        [1 << 32],
        [(1 << 32) + 1],
    ]
    assert list(order.judge().notes('they are', 'of it')) == []
    order.add_to(0, time_ns - 3400 * SECOND, np.arange(3600) * 40, offset=2 << 32)
    assert order.judge().steps_ns == [7000 * SECOND]


def test_the_clock_of_one_sender_shifts_its_rows_only() -> None:
    rows = [(t - 200 * (s == 1 and t >= 300), t, s) for _, t, s in two_sources()]
    course, time_ns, true_ns = judge_rows(rows)
    np.testing.assert_array_equal(time_ns, true_ns)
    assert course.steps_ns == [200 * SECOND]


@pytest.mark.parametrize('silent', [(295.0, 302.0), (299.6, 333.0), (200.0, 310.0), (299.6, 510.0)])
@pytest.mark.parametrize('back', [30, 200, 3600])
def test_a_source_that_is_silent_meanwhile_is_under_the_same_clock(
    silent: tuple[float, float], back: int
) -> None:
    # Its own times step back by less, or not at all.
    rows = [
        row
        for row in under_clock(lambda t: t - back * (t >= 300))
        if not (row[2] and silent[0] < row[1] < silent[1])
    ]
    course, time_ns, true_ns = judge_rows(rows)
    np.testing.assert_array_equal(time_ns, true_ns)
    assert course.steps_ns == [back * SECOND]
    assert (course.late_count, course.is_unordered) == (0, False)


def test_rows_behind_a_pause_are_not_late_where_another_source_saw_the_clock_set() -> None:
    """Set back by 30 s and silent from 25 s later on, it goes on where it had been."""
    rows = [
        row for row in under_clock(lambda t: t - 30 * (t >= 300)) if not (row[2] and 325.0 < row[1] < 330.0)
    ]
    course, time_ns, true_ns = judge_rows(rows)
    np.testing.assert_array_equal(time_ns, true_ns)
    assert course.steps_ns == [30 * SECOND]


def test_a_slow_source_that_cannot_show_the_step_is_shifted_too() -> None:
    rows = [(t, t, s) for _, t, s in two_sources() if s == 0 or (int(t) % 60 == 5 and t % 1 < 0.1)]
    course, time_ns, true_ns = judge_rows([(t - 30 * (u >= 300), u, s) for t, u, s in rows])
    np.testing.assert_array_equal(time_ns, true_ns)
    assert course.steps_ns == [30 * SECOND]


def test_long_recordings_take_no_memory_for_their_rows() -> None:
    """Join the segments of a week at 1 Hz with a step in its middle, which is still exact."""
    order, count = TimeOrder(), 7 * 86_400
    time_ns = START + np.arange(count) * SECOND
    time_ns[count // 2 :] -= 200 * SECOND
    source, place = np.zeros(count, np.int64), np.arange(count)
    for begin in range(0, count, 10_000):
        batch = slice(begin, begin + 10_000)
        order.add(time_ns[batch], source[batch], place[batch])
    course = order.judge()
    assert course.steps_ns == [200 * SECOND]
    np.testing.assert_array_equal(
        course.correct_times(time_ns, source, place), START + np.arange(count) * SECOND
    )
    (source_rows,) = order._sources.values()
    assert len(source_rows.segments) < count // 50


@pytest.mark.parametrize(('at', 'days'), [(-1, 365.0), (0, -365.0)])
def test_one_time_read_wrong_at_an_end_is_reported(at: int, days: float) -> None:
    rows = [(k / 2, k / 2, 0) for k in range(COUNT)]
    rows[at] = (rows[at][0] + days * 86_400, *rows[at][1:])
    course = judge_rows(rows)[0]
    text = f'a gap of {abs(days):.4g} days, and last {(COUNT - 2) / 2:.4g} s without it: one may be wrong'
    assert list(course.notes('the lines are', 'of the lines')) == [f'the times of the lines have {text}']


@pytest.mark.parametrize('unset', [1, 2, 400])
@pytest.mark.parametrize('boot', [0.0, 1e-3, 3600.0])
def test_a_clock_that_is_set_to_a_date_begins_before_it(unset: int, boot: float) -> None:
    # A recorder without a battery counts from its start until a satellite gives the date.
    rows = [(k / 2 if k >= unset else k / 2 + boot - START / SECOND, k / 2, 0) for k in range(COUNT)]
    course, time_ns, true_ns = judge_rows(rows)
    np.testing.assert_allclose(time_ns, true_ns, rtol=0, atol=1000)
    (note,) = course.notes('the lines are', 'of the lines')
    assert note.startswith('the clock of the lines began at zero and was set to a date')
    assert course.undated_count == unset


def test_clocks_that_begin_at_zero_again_and_again_lead_up_to_dates() -> None:
    # Each of two power cuts sets the clock to zero; the times between the dates are kept.
    rows = [(k / 2 - START / SECOND * (k % 400 < 60), k / 2, k % 2) for k in range(COUNT)]
    course, time_ns, true_ns = judge_rows(rows)
    assert np.abs(time_ns - true_ns).max() <= SECOND
    assert course.undated_count == 180


def test_one_date_among_seconds_is_one_wrong_time() -> None:
    rows = [(k / 2 - START / SECOND * (k != 400), k / 2, 0) for k in range(1, COUNT)]
    course, time_ns, true_ns = judge_rows(rows)
    assert (course.ahead_count, course.undated_count) == (1, 0)
    np.testing.assert_allclose(np.diff(time_ns), np.diff(true_ns), atol=SECOND)


def test_a_pause_of_some_days_between_voyages_of_days_is_not_reported() -> None:
    times = [*range(0, 400_000, 10), *range(1_000_000, 1_400_000, 10)]
    assert judge_rows([(time, time, 0) for time in times])[0].gap_ns == 0
