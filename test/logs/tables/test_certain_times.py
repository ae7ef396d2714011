# SPDX-License-Identifier: Apache-2.0
"""Times are guessed only where a file makes them certain; else they are asked for, or refused.

Each file is of lines one second apart from 2026-05-14T06:00:00Z on, or from a start; expected times by
``datetime``.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from nasty_logs import epoch_ns, open_log

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.recording import Request

T0 = datetime(2026, 5, 14, 6, 0, tzinfo=timezone.utc)
EVERY = timedelta(seconds=1)


def log_of(head: str, row: Callable[[datetime], str], every: timedelta = EVERY, count: int = 90) -> str:
    """Return a log with a speed and a load in the last columns."""
    rows = (f'{row(T0 + k * every)},{30 + k % 3},900\n' for k in range(count))
    return f'{head},rpm,load\n{"".join(rows)}'


def times_of(tmp_path: Path, text: str) -> tuple[list[int], str]:
    """Return the times [ns] of the speeds of a log, and what is asked of them."""
    recording = open_log(tmp_path, text)
    (series,) = recording.read([Request('rpm', 'data')]).values()
    return series.stamp_ns.tolist(), recording.table.clocks[0].question


@pytest.mark.parametrize(
    'every', [EVERY, timedelta(milliseconds=100), timedelta(hours=7), timedelta(minutes=1)]
)
@pytest.mark.parametrize(
    ('head', 'form'),
    [
        ('year,month,day,hour,minute,second', '{0.year},{0.month},{0.day},{0.hour},{0.minute},{1}'),
        ('YYYY,MM,DD,hh,mm,ss', '{0:%Y,%m,%d,%H,%M},{1:04.1f}'),
        (
            'Jahr,Monat,Tag,Stunde,Minute,Sekunde',
            '{0.year}.0,{0.month}.0,{0.day}.0,{0.hour}.0,{0.minute}.0,{1}',
        ),
        ('day,month,year,hour,minute,second', '{0:%d,%m,%Y,%H,%M},{1}'),
        ('Year,Month,Day,Time', '{0:%Y,%m,%d,%H:%M:%S.%f}'),
        ('year,jday,hour,min,sec', '{0:%Y,%j,%H,%M},{1}'),
        ('date,hour,min,sec', '{0:%d.%m.%Y},{0.hour},{0.minute},{1}'),
        ('n,year,month,day,hour,minute,second', '7,{0.year},{0.month},{0.day},{0.hour},{0.minute},{1}'),
    ],
)
def test_parts_of_a_date_in_columns_of_their_own_are_joined(
    head: str, form: str, every: timedelta, tmp_path: Path
) -> None:
    text = log_of(head, lambda t: form.format(t, t.second + t.microsecond / 1e6), every)
    assert times_of(tmp_path, text) == ([epoch_ns(T0 + k * every) for k in range(90)], '')


@pytest.mark.parametrize('zone', ['+05:30', '-03:30', '+0545', '-09', '+01:00', 'Z'])
def test_times_are_of_the_zone_that_is_written(zone: str, tmp_path: Path) -> None:
    """Half and quarter hours are the law of India, Newfoundland and Nepal."""
    text = log_of('time', lambda t: f'{t:%Y-%m-%d %H:%M:%S}{zone}', count=3)
    sign, digits = -1 if zone[0] == '-' else 1, zone.replace(':', '')[1:].ljust(4, '0')
    behind = sign * timedelta(hours=int(digits[:2]), minutes=int(digits[2:]))
    assert times_of(tmp_path, text) == ([epoch_ns(T0 + k * EVERY - behind) for k in range(3)], '')


@pytest.mark.parametrize('share', [2, 10, 45])
def test_times_without_a_zone_among_times_with_one_are_damaged(share: int, tmp_path: Path) -> None:
    """Two hours lie between +02:00 and nothing, which was taken as UTC."""
    zones = ['+02:00', ''] if share < 45 else ['', '+02:00']
    rows = log_of('time', lambda t: f'{t:%Y-%m-%dT%H:%M:%S}{zones[(t - T0).seconds % share == 0]}')
    recording = open_log(tmp_path, rows)
    (series,) = recording.read([Request('rpm', 'data')]).values()
    if share < 45:
        expected = [epoch_ns(T0 + k * EVERY - timedelta(hours=2)) for k in range(90) if k % share]
        assert series.stamp_ns.tolist() == expected
        assert f'{90 // share} lines without a time were not used' in recording.losses[0]
    else:
        assert series.value.size == 90
        assert 'times have no zone: taken as UTC' in recording.warnings


@pytest.mark.parametrize(
    ('heading', 'minutes'),
    [('Time (UTC+2)', 120), ('time UTC-03:30', -210), ('GMT+0545', 345), ('Time, GMT +02:00', 120)],
)
def test_times_are_of_the_zone_in_their_heading(heading: str, minutes: int, tmp_path: Path) -> None:
    text = log_of(f'"{heading}"', lambda t: f'{t + timedelta(minutes=minutes):%Y-%m-%d %H:%M:%S}', count=3)
    assert times_of(tmp_path, text) == ([epoch_ns(T0 + k * EVERY) for k in range(3)], '')


def test_a_last_line_without_an_end_is_read(tmp_path: Path) -> None:
    text = log_of('time', lambda t: f'{t:%Y-%m-%dT%H:%M:%SZ}', count=4)
    expected = [epoch_ns(T0 + k * EVERY) for k in range(4)]
    assert times_of(tmp_path, text.rstrip())[0] == expected
    assert times_of(tmp_path, text.removesuffix(',900\n'))[0] == expected[:3]


def test_a_day_or_a_month_of_parts_raises_a_question(tmp_path: Path) -> None:
    text = log_of('a,b,c,d,e,f', lambda t: f'5,4,2026,{t:%H,%M,%S}')
    assert 'month first' in times_of(tmp_path, text)[1]


def test_minutes_in_parts_leave_the_column_beside_them(tmp_path: Path) -> None:
    """Revolutions below 60 look like seconds."""
    text = log_of('year,month,day,hour,minute', lambda t: f'{t:%Y,%m,%d,%H,%M}', timedelta(minutes=1))
    assert times_of(tmp_path, text)[0] == [epoch_ns(T0 + k * timedelta(minutes=1)) for k in range(90)]


@pytest.mark.parametrize(
    'head', ['year,month,day,hour,minute,second', 'Year,Month,Day,Time', 'date,hour,min,sec']
)
def test_one_row_of_parts_is_a_time(head: str, tmp_path: Path) -> None:
    form = {'y': '{:%Y,%m,%d,%H,%M,%S}', 'Y': '{:%Y,%m,%d,%H:%M:%S}', 'd': '{:%Y-%m-%d,%H,%M,%S}'}[head[0]]
    assert times_of(tmp_path, log_of(head, form.format, count=1)) == ([epoch_ns(T0)], '')


def test_days_between_the_ends_tell_month_and_day(tmp_path: Path) -> None:
    """Head and tail, some 6,000 and 400 lines here, are of 1 May and of 6 June."""
    first, last = (
        [datetime(2026, m, d) + k * EVERY for k in range(n)] for m, d, n in ((5, 1, 12_000), (6, 5, 1000))
    )
    between = [datetime(2026, 5, day, 12) for day in range(2, 32)]
    rows = ''.join(f'{time:%m/%d/%Y %H:%M:%S},30,900\n' for time in (*first, *between, *last))
    times, question = times_of(tmp_path, f'time,rpm,load\n{rows}')
    assert (times[-1], question) == (epoch_ns(last[-1].replace(tzinfo=timezone.utc)), '')


@pytest.mark.parametrize('rate', [12, 24, 48, 96, 144, 288])
@pytest.mark.parametrize('digits', [4, 6, 9])
def test_a_rate_that_is_so_many_lines_a_day_raises_a_question(rate: int, digits: int, tmp_path: Path) -> None:
    """24 Hz since a start of hours ago are one line an hour in days of a spreadsheet."""
    text = 'time,rpm\n' + ''.join(f'{30000 + k / rate:.{digits}f},{30 + k % 3}\n' for k in range(90))
    assert 'days of a spreadsheet or s since the start' in times_of(tmp_path, text)[1]


@pytest.mark.parametrize('first', [0, 15_000])
def test_seconds_before_any_day_of_a_spreadsheet_are_no_days(first: int, tmp_path: Path) -> None:
    text = 'time,rpm\n' + ''.join(f'{first + 3600 * k},{30 + k % 3}\n' for k in range(20))
    assert times_of(tmp_path, text)[0] == [(first + 3600 * k) * 10**9 for k in range(20)]


@pytest.mark.parametrize(
    ('head', 'gap', 'is_asked'),
    [('time', 100, True), ('time [s]', 100, False), ('time', 5, True), ('time', 1, True)],
)
def test_milliseconds_or_seconds_raise_a_question(
    head: str, gap: int, is_asked: bool, tmp_path: Path
) -> None:
    """0, 1, 2, ... are 1 Hz, 1 kHz, or numbers of lines."""
    times = times_of(tmp_path, log_of(head, lambda t: f'{(t - T0).seconds * gap}'))
    assert times == ([k * gap * 10**9 for k in range(90)], times[1] if is_asked else '')
    assert ("head them 'time [s]', 'time [min]'" in times[1]) == is_asked


@pytest.mark.parametrize('form', ['{:%H%M%S}', '{0.hour}{0:%M%S}', '{:%H%M}', '{0.hour}{0:%M}'])
@pytest.mark.parametrize('every', [EVERY, timedelta(seconds=20), timedelta(minutes=1)])
@pytest.mark.parametrize('day', ['', '{:%d.%m.%Y},', '{:%Y-%m-%d},'])
def test_digits_of_a_time_of_the_day_raise_a_question(
    form: str, every: timedelta, day: str, tmp_path: Path
) -> None:
    """060059 is one second before 060100, or 41 s in seconds."""
    text = log_of('date,time' if day else 'time', lambda t: day.format(t) + form.format(t), every)
    assert 'or write 060000 as 06:00:00' in times_of(tmp_path, text)[1]


def test_speeds_beside_digits_of_a_time_are_no_times(tmp_path: Path) -> None:
    """30.010 rpm are not 00:00:30.010."""
    text = 'time,rpm,load\n' + ''.join(
        f'{int(f"{T0 + k * EVERY:%H%M%S}")},{30 + 0.01 * k:.3f},900\n' for k in range(90)
    )
    assert [column.heading for column in open_log(tmp_path, text).all_columns] == ['rpm', 'load']


@pytest.mark.parametrize('rate', [4, 10])
@pytest.mark.parametrize(
    ('head', 'form'),
    [
        ('time,ms', '{0:%Y-%m-%d %H:%M:%S},{1}'),
        ('Date,Time,Milliseconds', '{0:%d.%m.%Y},{0:%H:%M:%S},{1}'),
        ('Time,n,msec', '{0:%Y-%m-%d %H:%M:%S},7,{1:03d}'),
        ('timestamp,usec', '{0:%Y-%m-%d %H:%M:%S},{0.microsecond}'),
        ('ts,millis', '{2},{1}'),
        ('Time,Millis', '{2},{1}'),
        ('time,sec', '{0:%Y-%m-%d %H:%M},{0:%S.%f}'),
        ('time,frac [s]', '{0:%Y-%m-%d %H:%M:%S},0.{0:%f}'),
    ],
)
def test_a_column_of_milliseconds_belongs_to_times_to_the_second(
    head: str, form: str, rate: int, tmp_path: Path
) -> None:
    every = EVERY / rate
    text = log_of(head, lambda t: form.format(t, t.microsecond // 1000, int(t.timestamp())), every)
    assert times_of(tmp_path, text) == ([epoch_ns(T0 + k * every) for k in range(90)], '')


@pytest.mark.parametrize('ms', ['7', '{0}', '{1}', '-{2}'])
def test_other_numbers_beside_a_time_are_no_fractions_of_it(ms: str, tmp_path: Path) -> None:
    """Write a constant, a value that falls within a second, a counter, and negative ones."""
    every = timedelta(milliseconds=250)

    def row(time: datetime) -> str:
        part = time.microsecond // 1000
        return f'{time:%Y-%m-%d %H:%M:%S},' + ms.format(999 - part, (time - T0) // every, part)

    seconds = [epoch_ns((T0 + k * every).replace(microsecond=0)) for k in range(90)]
    assert times_of(tmp_path, log_of('time,ms', row, every))[0] == seconds


@pytest.mark.parametrize('time', ['0 days 06:00:00', '14th May 2026 06:00:00', '4 of 90', '1e300'])
def test_a_number_before_other_digits_is_no_time(time: str, tmp_path: Path) -> None:
    with pytest.raises(BagError, match=f"write times such as 2026-05-04T06:00:00Z, not as '{time}'"):
        times_of(tmp_path, log_of('time', lambda _: time))


@pytest.mark.parametrize('time', ['2026年05月14日 06時', '1778738400:0'])
def test_a_line_without_a_time_is_shown(time: str, tmp_path: Path) -> None:
    with pytest.raises(
        BagError, match=f"a time such as 2026-05-04T06:00:00Z in each line, not as '{time} up'"
    ):
        times_of(tmp_path, 'when,state\n' + f'{time},up\n' * 9)


def test_a_log_of_one_value_a_line_without_headings_has_its_seconds_since_1970(tmp_path: Path) -> None:
    rows = ''.join(
        f'{(T0 + k * EVERY).timestamp():.3f} rpm 30\n{(T0 + k * EVERY).timestamp():.3f} load 900\n'
        for k in range(60)
    )
    (series,) = open_log(tmp_path, rows).read([Request('#3', 'data')]).values()
    assert series.stamp_ns[::2].tolist() == [epoch_ns(T0 + k * EVERY) for k in range(60)]


def test_numbers_of_lines_raise_a_question(tmp_path: Path) -> None:
    for form in ('{}', '{}.00'):
        text = log_of('No', lambda t, form=form: form.format((t - T0).seconds))
        assert 'without a unit, 1 apart' in times_of(tmp_path, text)[1]


@pytest.mark.parametrize('step', [10 / 86_400, 60 / 86_400, 0.01])
def test_more_lines_a_second_than_a_log_has_are_another_unit(step: float, tmp_path: Path) -> None:
    """124.25 and so on are days of the year; they were a voyage of a tenth of a second."""
    text = 'time,rpm\n' + ''.join(f'{124.25 + k * step:.6f},{30 + k % 3}\n' for k in range(90))
    assert "or 'time [d]'" in times_of(tmp_path, text)[1]


@pytest.mark.parametrize(
    ('form', 'step'),
    [
        ('{:.2f}', 5.0),  # minutes, or seconds
        ('{:.5f}', 5 / 1440),  # days of the year, or 288 Hz
        ('{:.4f}', 5 / 60),  # hours, or 12 Hz
        ('{:.4f}', 1 / 60),  # minutes of seconds, or 60 Hz
        ('{:.3f}', 1.003),
        ('{:.1f}', 0.1),  # minutes of 6 s, or 10 Hz
        ('{:.1f}', 0.5),
        ('{:.6f}', 1 / 256),
    ],
)
@pytest.mark.parametrize('first', [0, 124.25])
def test_numbers_without_a_unit_are_asked(form: str, step: float, first: float, tmp_path: Path) -> None:
    rows = [f'{form.format(first + k * step)},{30 + k % 3}\n' for k in range(90)]
    assert "head them 'time [s]'" in times_of(tmp_path, f'time,rpm\n{"".join(rows)}')[1]
    for heading, unit in (('time [s]', 1), ('time_min', 60), ('hours', 3600)):
        times, question = times_of(tmp_path, f'{heading},rpm\n{"".join(rows)}')
        assert question == ''
        assert times[-1] - times[0] == pytest.approx(89 * step * unit * 10**9, abs=unit * 2 * 10**8)


@pytest.mark.parametrize(
    ('zone', 'heading', 'minutes'),
    [
        ('+02:00', 'x', 120),
        ('UTC+2', 'x', 120),
        ('GMT-0330', 'x', -210),
        ('Z', 'x', 0),
        ('+0545', 'zone', 345),
        ('-03', 'tz', -180),
        ('CEST', 'Time zone', None),
        ('Europe/Berlin', 'TZ', None),
        ('2', 'UTC offset', None),
    ],
)
@pytest.mark.parametrize('head', ['time', 'date,time'])
def test_a_zone_in_a_column_of_its_own_counts(
    zone: str, heading: str, minutes: int | None, head: str, tmp_path: Path
) -> None:
    # What only a zone is needs no heading; a name of one has no distance from UTC in the file.
    form = f'{{:%Y-%m-%d{" ,"[len(head) > 4]}%H:%M:%S}},{zone}'
    local = log_of(f'{head},{heading}', lambda t: form.format(t + timedelta(minutes=minutes or 0)))
    times, question = times_of(tmp_path, local)
    assert times == [epoch_ns(T0 + k * EVERY) for k in range(90)]
    assert (f"column '{heading}' with '{zone}', which was not used" in question) == (minutes is None)


@pytest.mark.parametrize(
    ('first', 'heading', 'step', 'is_of_day', 'is_asked'),
    [
        (21_600, 'seconds', 1, False, True),
        (21_600_000, 'elapsed_ms', 1000, False, False),
        (21_600, 'time of day [s]', 1, True, False),
        (0, 'seconds', 1, False, False),  # of a start
        (86_395.5, 'time of day [s]', 1, True, False),  # they fall at midnight
    ],
)
def test_dates_belong_to_seconds_of_the_day(
    first: float, heading: str, step: int, is_of_day: bool, is_asked: bool, tmp_path: Path
) -> None:
    midnight, day = T0.replace(hour=0), 86_400 * step
    numbers = [first + k * step for k in range(90)]
    rows = [f'{midnight + timedelta(days=n // day):%d.%m.%Y},{n % day},{30 + n % 3}\n' for n in numbers]
    times, question = times_of(tmp_path, f'date,{heading},rpm\n{"".join(rows)}')
    zero = epoch_ns(midnight) if is_of_day else 0
    assert times == [zero + round(n / step * 10**9) for n in numbers]
    assert ('from midnight or from a start' in question) == is_asked == bool(question)


def test_twelve_digits_are_no_milliseconds_of_1978(tmp_path: Path) -> None:
    """260514060000 is 06:00 on 14 May 2026 to who wrote it; ms since 1970 are of 2000 and later."""
    assert times_of(tmp_path, log_of('time', '{:%y%m%d%H%M%S}'.format))[1]


@pytest.mark.parametrize('every', [EVERY, 20 * EVERY, timedelta(minutes=20)])
@pytest.mark.parametrize(
    ('head', 'form'),
    [
        ('hour,min,sec', '{0.hour},{0.minute},{0.second}'),
        ('d,h,min,s', '{0.day},{0.hour},{0.minute},{0.second}.0'),
    ],
)
def test_parts_of_a_time_without_a_date_are_added(
    head: str, form: str, every: timedelta, tmp_path: Path
) -> None:
    # The seconds alone were a clock that is set back each minute, and a pause of minutes was none.
    times, question = times_of(tmp_path, log_of(head, form.format, every))
    assert ([time - times[0] for time in times], question) == (
        [k * every // timedelta(microseconds=1) * 1000 for k in range(90)],
        '',
    )


def test_a_draught_and_a_height_are_no_parts_of_a_time(tmp_path: Path) -> None:
    text = 'd,h,time,rpm\n' + ''.join(f'{8 - k % 3},{k % 5},{k}.25,30\n' for k in range(60))
    assert times_of(tmp_path, text)[0][:2] == [250_000_000, 1_250_000_000]


def test_julian_days(tmp_path: Path) -> None:
    """2461174.75 is 06:00 on 14 May 2026 (U.S. Naval Observatory)."""
    text = 'time,rpm\n' + ''.join(f'{2461174.75 + k / 86_400:.8f},{30 + k % 3}\n' for k in range(90))
    times, question = times_of(tmp_path, text)
    assert times == pytest.approx([epoch_ns(T0 + k * EVERY) for k in range(90)], abs=10**6)
    assert question == ''


def test_one_row_of_days_of_a_spreadsheet_is_a_time(tmp_path: Path) -> None:
    """46156.25 is 06:00 on 14 May 2026: 46,156 days behind 1899-12-30."""
    assert times_of(tmp_path, 'date,rpm\n46156.25,30\n') == ([epoch_ns(T0)], '')


@pytest.mark.parametrize(('head', 'is_asked'), [('time', True), ('date,time', False)])
def test_times_of_two_parts_raise_a_question(head: str, is_asked: bool, tmp_path: Path) -> None:
    """06:30 may be minutes and seconds, as a spreadsheet shows them."""
    text = log_of(head, lambda t: f'{t:%Y-%m-%d,%H:%M}'[11 * is_asked :], 60 * EVERY)
    assert ('write 06:00:00, or 00:06:00' in times_of(tmp_path, text)[1]) == is_asked


@pytest.mark.parametrize('cell', ['', 'NaN', '-'])
@pytest.mark.parametrize('head', ['Time', 'No,Time', 'Time,Date'])
def test_a_time_that_is_empty_is_not_replaced_by_another_column(head: str, cell: str, tmp_path: Path) -> None:
    cells = {'No': '{0}', 'Time': cell, 'Date': cell}
    row = ','.join(cells[name] for name in head.split(','))
    with pytest.raises(BagError, match=r"column 'Time' is empty in the first 90 lines: leave these out"):
        times_of(tmp_path, log_of(head, lambda t: row.format((t - T0).seconds)))


def test_dates_alone_are_no_times(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="column 'Date' has dates without a time of the day"):
        times_of(tmp_path, log_of('Date', lambda t: f'{t:%Y-%m-%d}', timedelta(days=1)))


@pytest.mark.parametrize('form', ['%y%m%d %H%M%S', '%y%m%d,%H%M%S', '%y%m%d_%H%M%S.%f'])
@pytest.mark.parametrize('every', [EVERY, timedelta(hours=7)])
def test_digits_of_two_of_the_year_are_asked_unless_days_tell(
    form: str, every: timedelta, tmp_path: Path
) -> None:
    head = 'date,time' if ',' in form else 'time'
    times, question = times_of(tmp_path, log_of(head, lambda t: f'{t:{form}}', every))
    if every == EVERY:
        assert 'the year first?' in question
    else:
        assert (times, question) == ([epoch_ns(T0 + k * every) for k in range(90)], '')


DAY = 86_400


@pytest.mark.parametrize(
    ('head', 'form'), [('time', '{:%H:%M:%S}'), ('hour,min,sec', '{0.hour},{0.minute},{0.second}')]
)
@pytest.mark.parametrize('is_newest_first', [False, True])
@pytest.mark.parametrize('pause', [0, 8 * 3600])
@pytest.mark.parametrize('every', [20, 1700])
def test_times_of_the_day_go_on_over_midnight(
    head: str, form: str, is_newest_first: bool, pause: int, every: int, tmp_path: Path
) -> None:
    """Begin at 23:40, with a pause over midnight or without: 20 minutes, or over two midnights."""
    start = T0.replace(hour=23, minute=40)
    seconds = [k * every + pause * (k > 30) for k in range(90)]
    rows = [f'{form.format(start + k * EVERY)},{30 + n},900\n' for n, k in enumerate(seconds)]
    recording = open_log(tmp_path, f'{head},rpm,load\n{"".join(rows[:: -1 if is_newest_first else 1])}')
    (series,) = recording.read([Request('rpm', 'data')]).values()
    first = 23 * 3600 + 40 * 60
    assert (series.log_time_ns // 10**9).tolist() == [first + k for k in seconds]
    assert series.value.tolist() == [30 + n for n in range(90)]
    assert recording.start_ns == first * 10**9
    assert 'set back' not in ' '.join(recording.warnings)


def test_rows_that_are_late_over_midnight_are_sorted(tmp_path: Path) -> None:
    order = [*range(20), *range(21, 27), 20, *range(27, 60)]
    start = T0.replace(hour=23, minute=59, second=36)
    text = 'time,rpm,load\n' + ''.join(f'{start + k * EVERY:%H:%M:%S},{30 + k},900\n' for k in order)
    recording = open_log(tmp_path, text)
    (series,) = recording.read([Request('rpm', 'data')]).values()
    assert (series.log_time_ns // 10**9 - DAY).tolist() == list(range(-24, 36))
    assert series.value.tolist() == list(range(30, 90))


@pytest.mark.parametrize('head', ['year,month,day,hour,minute,second', 'date,hour,min,sec'])
def test_parts_of_a_date_may_come_newest_first(head: str, tmp_path: Path) -> None:
    form = {'y': '{:%Y,%m,%d,%H,%M,%S}', 'd': '{:%Y-%m-%d,%H,%M,%S}'}[head[0]]
    rows = log_of(head, form.format).splitlines(keepends=True)
    assert times_of(tmp_path, rows[0] + ''.join(rows[:0:-1]))[0] == [
        epoch_ns(T0 + k * EVERY) for k in range(90)
    ]


def test_an_hour_that_comes_again_without_a_date_is_a_clock_set_back(tmp_path: Path) -> None:
    text = log_of('time', lambda t: f'{t - timedelta(hours=t.second >= 30):%H:%M:%S}', count=60)
    times, _ = times_of(tmp_path, text)
    assert times[-1] - times[0] == 59 * 10**9


@pytest.mark.parametrize('damaged', ['04/15/2026', '04/06/2026', '00/05/2026'])
def test_one_damaged_date_does_not_tell_the_order_of_the_others(damaged: str, tmp_path: Path) -> None:
    text = log_of('time', lambda t: f'04/05/2026 {t:%H:%M:%S}')
    assert 'month first' in times_of(tmp_path, text.replace('04/05/2026', damaged, 1))[1]


@pytest.mark.parametrize('damaged', ['0.05.2026', '04.15.2026'])
def test_a_date_with_points_has_the_day_first(damaged: str, tmp_path: Path) -> None:
    text = log_of('time', lambda t: f'04.05.2026 {t:%H:%M:%S}', count=9)
    times_ns, question = times_of(tmp_path, text.replace('04.05.2026', damaged, 1))
    first_ns = epoch_ns(T0 - timedelta(days=10))
    assert times_ns == [first_ns + k * 10**9 for k in range(1, 9)]
    assert not question


@pytest.mark.parametrize('place', [0, 7, 89])
@pytest.mark.parametrize(
    ('form', 'damaged'),
    [
        (
            lambda t: f'{(t - datetime(1899, 12, 30, tzinfo=timezone.utc)) / timedelta(days=1):.8f}',
            '4615625.7',
        ),
        (lambda t: f'{t.timestamp():.0f}', '1778738400123'),
        (lambda t: f'{t.timestamp() * 1000:.0f}', '1778738400'),
    ],
)
def test_one_damaged_number_does_not_tell_what_the_other_times_are(
    form: Callable[[datetime], str], damaged: str, place: int, tmp_path: Path
) -> None:
    text = log_of('time', form)
    sound = open_log(tmp_path, text).table.clocks[0]
    lines = text.splitlines(keepends=True)
    lines[place + 1] = f'{damaged},30,900\n'
    clock = open_log(tmp_path, ''.join(lines)).table.clocks[0]
    assert (clock.remarks, clock.question) == (sound.remarks, '')
