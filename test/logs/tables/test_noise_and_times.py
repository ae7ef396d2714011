# SPDX-License-Identifier: Apache-2.0
"""Noise in a log, and times that may be read in two ways; expected times by ``datetime``."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from nasty_logs import epoch_ns, nmea_sentence, open_log

from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_recording import TableRecording

T0 = datetime(2026, 5, 4, 6, 0, tzinfo=timezone.utc)
SPREADSHEET = datetime(1899, 12, 30, tzinfo=timezone.utc)


def equal_steps(every: timedelta, count: int = 30) -> list[datetime]:
    return [T0 + k * every for k in range(count)]


def csv_text(times: Sequence[object], head: str = 'time,rpm') -> str:
    return f'{head}\n' + ''.join(f'{time},{30 + k % 3}\n' for k, time in enumerate(times))


def read_column(recording: TableRecording, name: str = 'rpm') -> tuple[list[int], list[float]]:
    (series,) = recording.read([Request(name, 'data')]).values()
    return series.stamp_ns.tolist(), series.value.tolist()


CLEAN = [f'{time:%Y-%m-%dT%H:%M:%SZ}' for time in equal_steps(timedelta(seconds=1))]


def insert_line(line: str, at: int = 10) -> str:
    lines = csv_text(CLEAN).splitlines(keepends=True)
    return ''.join([*lines[:at], line, *lines[at:]])


@pytest.mark.parametrize(
    ('text', 'lost'),
    [
        ('# \x02 logger 4\n' + csv_text(CLEAN), ''),
        (''.join(f'\x02{line}\x03\n' for line in csv_text(CLEAN).splitlines()), ''),
        (csv_text(CLEAN) + '\x1a', ''),
        (insert_line('\x18\x06\x1b\x7f\n'), '1 line damaged, or of too few or too many cells was not used'),
        (insert_line('\ufeff'), ''),
        (csv_text(CLEAN[:15]) + '\ufeff' + csv_text(CLEAN[15:]), ''),
        (insert_line('\x02A,325\x03\n'), "1 line without a time was not used, the first 'A'"),
    ],
)
def test_noise_makes_no_other_format(text: str, lost: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, text)
    assert read_column(recording)[0] == [epoch_ns(time) for time in equal_steps(timedelta(seconds=1))]
    assert recording.losses == ((lost,) if lost else ())


@pytest.mark.parametrize(('columns', 'filled'), [(5, 3), (4, 3), (9, 5)])
def test_a_line_that_ends_early_lacks_its_last_values(tmp_path: Path, columns: int, filled: int) -> None:
    """Read a line that reaches behind half of the headings; a shorter one is damaged."""
    names = ['time', 'rpm', *'abcdef'[: columns - 3], 'load']
    rows = [[time, '30', *['1'] * (columns - 2)] for time in CLEAN]
    rows[4], rows[7] = rows[4][:filled], rows[7][: filled - 1]
    recording = open_log(tmp_path, '\n'.join(map(','.join, [names, *rows])))
    series_by_request = recording.read([Request('rpm', 'data'), Request('load', 'data')])
    stamps = {request.topic: series.stamp_ns.tolist() for request, series in series_by_request.items()}
    expected = [epoch_ns(time) for time in equal_steps(timedelta(seconds=1))]
    assert stamps['rpm'] == expected[:7] + expected[8:]
    assert stamps['load'] == expected[:4] + expected[5:7] + expected[8:]
    assert recording.losses == ('1 line damaged, or of too few or too many cells was not used',)


def test_a_control_character_in_a_number_makes_it_a_word(tmp_path: Path) -> None:
    """Flip a bit, which makes of a digit a control character; the rest is another number."""
    recording = open_log(tmp_path, csv_text(CLEAN).replace(',31\n', ',3\x11\n', 1))
    series_by_request = recording.read([Request('rpm', 'data')])
    ((fault,),) = (series.faults for series in series_by_request.values())
    assert fault.count == 1


def test_lines_between_sentences_are_counted(tmp_path: Path) -> None:
    spoken = [f'{time} {nmea_sentence("IIRPM,S,1,30.0,30.0,A")}' for time in CLEAN]
    text = '\r\n'.join(
        [*spoken[:9], '\x02A,325,009.31,M\x03', *spoken[9:20], '\x18\x06\x1b\x7f', *spoken[20:]]
    )
    recording = open_log(tmp_path, text + '\r\n')
    assert len(read_column(recording, 'RPM S 1')[0]) == len(CLEAN)
    assert '2 lines without a sentence were not used' in recording.warnings
    assert recording.losses == ()


PACES = [0.1, 1, 2, 5, 10, 30, 60, 90, 180, 300, 600, 900, 1800, 3600, 7200, 17 * 60, 287]


@pytest.mark.parametrize('pace', PACES)
@pytest.mark.parametrize('digits', [8, 10, 12])
def test_days_of_a_spreadsheet_are_known_at_any_pace(pace: float, digits: int, tmp_path: Path) -> None:
    times = equal_steps(timedelta(seconds=pace))
    days = [f'{(time - SPREADSHEET) / timedelta(days=1):.{digits}f}' for time in times]
    read_times = read_column(open_log(tmp_path, csv_text(days)))[0]
    # Half of the last digit of a day.
    assert (
        np.abs(np.array(read_times) - [epoch_ns(time) for time in times]).max()
        <= 86_400e9 * 0.51 * 10.0**-digits + 8e3
    )


@pytest.mark.parametrize('rate', [1, 2, 2.5, 5, 7, 10, 20, 25, 50, 100, 128, 500, 1000])
@pytest.mark.parametrize('digits', [3, 4, 6])
def test_seconds_since_a_start_of_hours_ago_are_seconds(rate: float, digits: int, tmp_path: Path) -> None:
    if 1 / rate < 10.0**-digits:
        digits = 6
    times = [f'{46146.25 + k / rate:.{digits}f}' for k in range(60)]
    recording = open_log(tmp_path, csv_text(times))
    assert 's since the start' in recording.table.clocks[0].question
    # Four decimals of 1/128 s show no whole rate.
    if (rate, digits) != (128, 4):
        assert read_column(recording)[0] == [round(float(time) * 1e9) for time in times]


@pytest.mark.parametrize('gap', [1.0, 0.25, 0.125, 0.1, 0.001])
def test_times_in_days_or_seconds_raise_a_question(gap: float, tmp_path: Path) -> None:
    recording = open_log(tmp_path, csv_text([round(46146.25 + k * gap, 6) for k in range(30)]))
    assert 's since the start or days of a spreadsheet' in recording.table.clocks[0].question


@pytest.mark.parametrize(
    ('heading', 'unit_ns'),
    [
        *(
            ('ms', 10**6),
            ('millis', 10**6),
            ('time [ms]', 10**6),
            ('t_ms', 10**6),
            ('elapsed time ms', 10**6),
        ),
        *(('micros', 10**3), ('us', 10**3), ('Time (microseconds)', 10**3), ('uptime_ms', 10**6)),
        *(('time', 10**9), ('time_min', 60 * 10**9), ('time of day', 10**9)),
    ],
)
def test_the_unit_of_times_is_that_of_the_heading(heading: str, unit_ns: int, tmp_path: Path) -> None:
    read_times = read_column(open_log(tmp_path, csv_text(range(0, 3000, 100), f'{heading},rpm')))[0]
    assert read_times == [k * 100 * unit_ns for k in range(30)]


def test_milliseconds_are_the_time_behind_a_counter(tmp_path: Path) -> None:
    text = 'n,millis,rpm\n' + ''.join(f'{k},{k * 100},30\n' for k in range(30))
    assert read_column(open_log(tmp_path, text))[0] == [k * 10**8 for k in range(30)]


def test_an_underscore_is_no_digit(tmp_path: Path) -> None:
    recording = open_log(tmp_path, csv_text([*range(10), '1_0', *range(11, 20)]))
    assert read_column(recording)[0] == [k * 10**9 for k in range(20) if k != 10]
    assert recording.losses == ("1 line without a time was not used, the first '1_0'",)


YEAR_FIRST = (
    "the log has times such as '26-05-04 06:00:00', read day first: or is the year first? Write 4 May as"
    ' 2026-05-04'
)


@pytest.mark.parametrize(
    ('form', 'every', 'question', 'right'),
    [
        ('%y-%m-%d %H:%M:%S', timedelta(seconds=1), YEAR_FIRST, False),
        ('%y/%m/%d %H:%M:%S', timedelta(hours=6), '', True),
        ('%y-%m-%d %H:%M:%S', timedelta(hours=6), '', True),
        ('%d/%m/%y %H:%M:%S', timedelta(hours=6), '', True),
        ('%m/%d/%y %H:%M:%S', timedelta(hours=6), '', True),
        ('%d.%m.%y %H:%M:%S', timedelta(seconds=1), '', True),
        ('%d/%m/%Y %H:%M:%S', timedelta(hours=6), '', True),
    ],
)
def test_a_year_of_two_digits_in_front_raises_a_question(
    form: str, every: timedelta, question: str, right: bool, tmp_path: Path
) -> None:
    times = equal_steps(every)
    recording = open_log(tmp_path, csv_text([time.strftime(form) for time in times]))
    assert (read_column(recording)[0] == [epoch_ns(time) for time in times]) == right
    questions = [text for text in recording.warnings if 'day first' in text]
    assert questions == ([question] if question else [])


@pytest.mark.parametrize(
    'form',
    [
        '{:%Y-%m-%dT%H:%M:%S.%f} ',
        '[{:%Y-%m-%d %H:%M:%S.%f}] ',
        '{:%m/%d/%Y,%H:%M:%S.%f},',
        '{:%d-%b-%Y %H:%M:%S.%f}\t',
        '{:%d. %b %Y %H:%M:%S.%f} ',
        '{:%Y%m%dT%H%M%S.%f}Z ',
        '{:%Y:%j:%H:%M:%S.%f} ',
        'shaft {:%Y:%j:%H:%M:%S.%f} ',
        '{:%Y-%jT%H:%M:%S.%f}Z,',
    ],
)
def test_times_that_loggers_write_before_sentences(form: str, tmp_path: Path) -> None:
    """Write several days, so that the day of 05/04/2026 is known."""
    times = equal_steps(timedelta(hours=7, milliseconds=125))
    spoken = [f'{form.format(time)}{nmea_sentence("IIRPM,S,1,30.0,30.0,A")}\r\n' for time in times]
    assert read_column(open_log(tmp_path, ''.join(spoken)), 'RPM S 1')[0] == [
        epoch_ns(time) for time in times
    ]


def test_days_of_a_year_that_do_not_exist_are_no_times(tmp_path: Path) -> None:
    times = [
        '2026:124:06:00:00',
        '2026:366:06:00:00',
        '2026:000:06:00:00',
        '0000:001:06:00:00',
        '2026:125:06:00:00',
    ]
    recording = open_log(tmp_path, csv_text(times))
    assert read_column(recording)[0] == [epoch_ns(T0), epoch_ns(T0 + timedelta(days=1))]
    assert recording.losses == ("3 lines without a time were not used, the first '2026:366:06:00:00'",)


@pytest.mark.parametrize(
    'form',
    [
        '%a %b %d %H:%M:%S %Y',
        '%a %b %d %H:%M:%S UTC %Y',
        '%b %d %H:%M:%S %Y',
        '%Y%m%d,%H%M%S',
        '%Y%m%d,%H%M%S.%f',
    ],
)
def test_dates_of_c_and_of_digits_alone(form: str, tmp_path: Path) -> None:
    times = equal_steps(timedelta(seconds=1))
    head = 'date,time,rpm' if ',' in form else 'time,rpm'
    assert read_column(open_log(tmp_path, csv_text([time.strftime(form) for time in times], head)))[0] == [
        epoch_ns(time) for time in times
    ]


@pytest.mark.parametrize('form', ['{},0', '{}.0 N', '{},5 kN'])
def test_numbers_of_few_kinds_tell_no_rows_apart(form: str, tmp_path: Path) -> None:
    text = 'time;rpm;load\n' + ''.join(
        f'{time};30,5;{form.format(900 + 5 * k % 7)}\n' for k, time in enumerate(CLEAN)
    )
    recording = open_log(tmp_path, text)
    speed = next(column for column in recording.all_columns if column.heading == 'rpm')
    assert recording.find_unchosen_key(speed) is None
