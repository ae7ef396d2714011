# SPDX-License-Identifier: Apache-2.0
"""Logs as ships, yards and historians write them: what a log says of itself."""

from __future__ import annotations

import contextlib
import re
import sqlite3
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nasty_logs import T0, epoch_ns, open_log

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_logs.tables.dialect import unit_of


@pytest.mark.parametrize('order', [('speed', 'load'), ('load', 'speed')])
def test_the_cells_of_a_line_count_from_left_to_right(order: tuple[str, str], tmp_path: Path) -> None:
    """Whatever is asked for first: a set of requests has no order, and verdicts must not go by it."""
    recording = open_log(tmp_path, 'time,speed,load\n0,30,900\n1,31,901\n')
    series = recording.read([Request(name, 'data') for name in order])
    assert series[Request('speed', 'data')].sequence.tolist() == [0, 2]
    assert series[Request('load', 'data')].sequence.tolist() == [1, 3]


def test_of_two_dates_in_parquet_that_of_the_lines_counts(tmp_path: Path) -> None:
    path = tmp_path / 'voyage.parquet'
    dates = {'created': pa.array([T0] * 3), 'time': pa.array([T0 + timedelta(seconds=k) for k in range(3)])}
    pq.write_table(pa.table(dates | {'speed': [30.0, 31.0, 32.0]}), path)
    assert open_bag(path).end_ns == epoch_ns(T0) + 2_000_000_000


def test_a_damaged_page_of_parquet_is_named(tmp_path: Path) -> None:
    path = tmp_path / 'voyage.parquet'
    pq.write_table(pa.table({'time': [0.0, 1.0], 'speed [rpm]': [30.0, 31.0]}), path)
    data = bytearray(path.read_bytes())
    data[4:40] = bytes(36)
    path.write_bytes(data)
    with pytest.raises(BagError, match=r"voyage\.parquet' cannot be read as Parquet: "):
        open_bag(path)


@pytest.mark.parametrize('kind', ['csv', 'parquet'])
def test_a_table_that_goes_before_it_is_read_is_an_error(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f'voyage.{kind}'
    columns = {'time [s]': [0.0, 1.0], 'speed [rpm]': [30.0, 31.0]}
    if kind == 'csv':
        path.write_text('time [s],speed [rpm]\n0,30\n1,31\n')
    else:
        pq.write_table(pa.table(columns), path)
    recording = open_bag(path)
    path.unlink()
    with pytest.raises(FileNotFoundError):
        recording.read([Request('speed [rpm]', 'data')])


def test_times_that_a_spreadsheet_rounded_away_are_a_loss(tmp_path: Path) -> None:
    """1.77787E+09 in each line: in no time nothing can be predicted, and nothing was judged."""
    rows = '1.77787E+09,20,1\n' * 5000 + '1.77788E+09,20,1\n' * 5000
    recording = open_log(tmp_path, f'time,rpm,kN\n{rows}')
    recording.read([Request('rpm', 'data')])
    assert any('10000 lines share 2 times' in text for text in recording.losses)


OTHERS_FIRST = (
    '{"context": "vessels.urn:mrn:imo:mmsi:3", "updates": [{"$source": "ais", "timestamp":'
    ' "2026-04-13T10:00:00Z", "values": [{"path": "navigation.speedOverGround", "value": 5.0}]}]}\n'
    '{"context": "meteo.urn:mrn:imo:mmsi:4", "updates": [{"timestamp": "2026-04-13T10:00:00Z", "values":'
    ' [{"path": "environment.water.temperature", "value": 280.0}]}]}\n'
)
"""What a log may begin with that was cut from a longer one."""


@pytest.mark.parametrize(
    ('first', 'later_names'),
    [('{"name": "s", "self": "vessels.urn:mrn:imo:mmsi:1"}\n', ['urn:mrn:imo:mmsi:2']), (OTHERS_FIRST, [])],
    ids=['hello', 'cut'],
)
def test_of_signal_k_one_source_of_the_own_vessel_counts(
    first: str, later_names: list[str], tmp_path: Path
) -> None:
    # As live: another vessel's speed, or a simulator's, mixed with the own one hides stick-slip.
    lines = []
    for second in range(3):
        for context, source, value in (
            *((later, 'ais', 9.0) for later in later_names),
            ('urn:mrn:imo:mmsi:1', 'n2k', 0.5),
            ('urn:mrn:imo:mmsi:1', 'sim', 2.0),
        ):
            item = f'{{"path": "propulsion.port.revolutions", "value": {value}}}'
            lines.append(
                f'{{"context": "vessels.{context}", "updates": [{{"$source": "{source}",'
                f' "timestamp": "2026-04-13T10:00:0{second}Z", "values": [{item}]}}]}}\n'
            )
    recording = open_log(tmp_path, first + ''.join(lines))
    assert [column.heading for column in recording.all_columns] == [
        'propulsion.port.revolutions',
        'propulsion.port.revolutions from sim',
    ]
    request = Request('propulsion.port.revolutions', 'data')
    assert recording.read([request])[request].value.tolist() == [0.5] * 3


def test_a_second_talker_has_a_name_of_its_own(tmp_path: Path) -> None:
    recording = open_log(
        tmp_path,
        '@0 $IIRPM,S,1,30.0,,A*5D\n@0 $ERRPM,S,1,99.0,,A*49\n@0 $IIXDR,N,900.0,N,LOAD*6F\n'
        '@1 $ERRPM,S,1,99.0,,A*49\n@1 $IIRPM,S,01,31.0,,A*6C\n@1 $IIXDR,N,901.0,N,LOAD*6E\n',
    )
    request = Request('RPM S 1', 'data')
    assert recording.read([request])[request].value.tolist() == [30, 31]
    assert 'RPM S 1 from ER' in recording.topics


def test_the_end_of_a_log_of_many_short_lines_is_known(tmp_path: Path) -> None:
    """More lines than are looked at of a head, in fewer bytes than a head has."""
    recording = open_log(tmp_path, 'time,rpm,kN\n' + ''.join(f'{t},30,1\n' for t in range(6000)))
    assert (recording.start_ns, recording.end_ns) == (0, 5999 * 10**9)


def test_a_recording_starts_with_its_first_line_though_the_clock_was_set_back(tmp_path: Path) -> None:
    recording = open_log(tmp_path, 'time,speed,load\n' + ''.join(f'{t},30,900\n' for t in (100, 101, 2, 3)))
    # The usual gap of a second takes the place of the step.
    assert (recording.start_ns, recording.end_ns) == (100 * 10**9, 103 * 10**9)


def test_a_line_of_more_cells_than_others_is_not_used(tmp_path: Path) -> None:
    # A line that was not ended runs into the next one, whose speed was the load.
    lines = [f'@{k},{30 + k},{900 + k}\n' for k in range(9)]
    lines[4:6] = [lines[4].rstrip() + lines[5]]
    recording = open_log(tmp_path, 'time,rpm,load\n' + ''.join(lines))
    (series,) = recording.read([Request('load', 'data')]).values()
    assert series.value.tolist() == [900, 901, 902, 903, 906, 907, 908]
    assert recording.losses == ('1 line damaged, or of too few or too many cells was not used',)


@pytest.mark.parametrize(
    'text',
    [
        'time,rpm,load\n@0,30,1,005\n@1,31,1,006\n',  # a load of 1,005 that is not quoted is two cells
        'time,rpm,load\n0,30,900,901\n1,31,901,902\n',  # seconds, or the numbers of rows that R writes
        '"time","rpm","load"\n"row1",@0,30,900\n"row2",@1,31,901\n',  # names of rows, by R, too
    ],
)
def test_numbers_without_a_heading_make_no_heading_certain(text: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, text)
    assert {column.heading for column in recording.all_columns} >= {'#3', '#4'}
    assert 'the 3 headings were not used: below are 4 columns, ' in recording.losses[0]


@pytest.mark.parametrize('second_unit', ['2.5', '1776074400.500'])
def test_commas_are_not_guessed_to_part_thousands_by_the_points_of_a_column(
    second_unit: str, tmp_path: Path
) -> None:
    """30,125 and 28,013 are as many thousands as some loggers write decimals."""
    path = tmp_path / 'voyage.csv'
    path.write_text(f'time;speed;load;other\n0;30,125;28,013;{second_unit}\n1;30,126;28,014;{second_unit}\n')
    with pytest.raises(
        BagError, match=r"'30,125' may be 30.125 or 30125: write it with a decimal point alone"
    ):
        open_bag(path)


def test_a_package_of_a_standard_is_refused_with_the_way_to_read_it(tmp_path: Path) -> None:
    (tmp_path / 'voyage.json').write_text('{"Package": {"TimeSeriesData": [{"TabularData": []}]}}')
    with pytest.raises(BagError, match=r"is JSON: write it as CSV with jq -r '\.Package\.TimeSeriesData"):
        open_bag(tmp_path / 'voyage.json')


@pytest.mark.parametrize(
    ('written', 'unit'),
    [('m/s²', 'm/s^2'), ('[\u03bcm]', 'um'), ('\u00b5m', 'um'), ('r.p.m.', 'rpm'), ('t', None)],
)
def test_units_as_they_are_written(written: str, unit: str | None) -> None:
    assert unit_of(written) == unit


@pytest.mark.parametrize(
    ('line', 'remedy'),
    [
        ('(1716800000.123456) can0 09F20023#00FF20FFFFFFFFFF', r'candump2analyzer < .*log \| analyzer -json'),
        ('17:33:21.107 R 09F20023 00 FF 20 FF FF FF FF FF', 'frames of NMEA 2000: .* analyzer -json < '),
        ('2016-04-09T16:41:39.628Z,2,127488,16,255,8,00,ff,20,ff,7f,ff,ff,ff', 'analyzer -json < '),
        (
            '2016-04-09-16:41:39.628 2  16 255 127488 Engine Parameters, Rapid Update:  Speed = 136.0 rpm',
            'analyzer -json < RAW',
        ),
        # As candump shows them, with times of -t a, A, d and none; CAN FD; and as ASC and TRC files.
        (' (1436509052.249713)  can0  09F20023   [8]  00 FF 20 FF FF FF FF FF', 'with candump -L,'),
        (' (2016-04-09 16:41:39.628123)  can0  09F20023   [8]  00 FF 20 FF FF FF FF FF', 'with candump -L,'),
        (' (000.001)  can0  09F20023   [8]  00 FF 20 FF FF FF FF FF', 'with candump -L,'),
        ('  can0  7FF   [2]  00 FF', 'frames of a CAN bus in a form that nothing converts'),
        ('(1716800000.123456) can0 09F20023##100FF20FFFFFFFFFF', 'with candump -L,'),
        ('   0.001000 1  09F20023x       Rx   d 8 00 FF 20 FF FF FF FF FF', 'with candump -L,'),
        ('      1)       1.5  Rx     09F20023  8  00 FF 20 FF FF FF FF FF', 'with candump -L,'),
    ],
)
def test_a_refused_format_is_named_with_its_converter(line: str, remedy: str, tmp_path: Path) -> None:
    (tmp_path / 'ship.log').write_text(f'{line}\n' * 9)
    with pytest.raises(BagError, match=remedy):
        TableRecording(tmp_path / 'ship.log')


@pytest.mark.parametrize(
    ('content', 'command'),
    [
        ('(1716800000.123456) can0 09F20023#00FF20FFFFFFFFFF\n' * 9, "analyzer -json > 'my ship'.json"),
        ('17:33:21.107 R 09F20023 00 FF 20 FF FF FF FF FF\n' * 9, "analyzer -json < '{}' > 'my ship'.json"),
        ('PK\3\4' + '\0' * 40, "unzip '{}' -d NEW"),
    ],
)
def test_a_command_to_copy_holds_for_a_name_with_a_blank(content: str, command: str, tmp_path: Path) -> None:
    path = tmp_path / 'my ship.log'
    path.write_text(content)
    with pytest.raises(BagError, match=re.escape(command.format(path))):
        open_bag(path)


def test_a_database_that_is_no_recording_is_named(tmp_path: Path) -> None:
    with contextlib.closing(sqlite3.connect(tmp_path / 'home.db')) as database:
        database.execute('CREATE TABLE states (id INTEGER, state TEXT)')
    with pytest.raises(
        BagError, match=r"no recording of ROS 2: it has the tables states; .*'SELECT \* FROM states'"
    ):
        open_bag(tmp_path / 'home.db')


def test_a_damaged_unit_of_the_first_line_is_that_of_no_other(tmp_path: Path) -> None:
    lines = ''.join(f'{k},speed,{30 + k},rpm\n{k},load,900,N\n' for k in range(20))
    (tmp_path / 'a.csv').write_text('time,name,value,unit\n' + lines.replace('rpm', 'r?m', 1))
    recording = open_bag(tmp_path / 'a.csv')
    series_by_request = recording.read([Request('speed', 'data')])
    (series,) = series_by_request.values()
    assert series.value[1:].tolist() == [31.0 + k for k in range(19)]
    assert "'speed' changes its unit: lines in r?m are left out" in recording.warnings


@pytest.mark.parametrize(
    ('line', 'count'),
    [('2026-05-04T06:01:{:02},000;30,0;1,5\n', 0), ('2026-05-04T06:01:{:02},speed,30,1e17\n', 10)],
)
def test_lines_with_a_number_in_place_of_a_unit_have_no_speed(line: str, count: int, tmp_path: Path) -> None:
    """Let the log last to its end, so that the speed is lost, where lines with decimal commas follow."""
    rows = ''.join(f'2026-05-04T06:00:{k:02},speed,{30 + k},rpm\n' for k in range(20))
    text = f'time,name,value,unit\n{rows}' + ''.join(map(line.format, range(10)))
    recording = open_log(tmp_path, text)
    assert [column.heading for column in recording.all_columns] == ['speed']
    (series,) = recording.read([Request('speed', 'data')]).values()
    assert series.value[:20].tolist() == [30.0 + k for k in range(20)]
    assert np.isnan(series.value[20:]).all()
    assert sum(fault.count for fault in series.faults) == series.value.size - 20 == count
    assert recording.end_ns == epoch_ns(datetime(2026, 5, 4, 6, 1, 9, tzinfo=timezone.utc))


@pytest.mark.parametrize('count', [1, 9])
@pytest.mark.parametrize('delimiter', ['\t', ';'])
@pytest.mark.parametrize('damaged', ['6,0', '1.234,5'])
def test_few_damaged_cells_do_not_tell_the_decimal_sign_of_the_others(
    count: int, damaged: str, delimiter: str, tmp_path: Path
) -> None:
    """Write speeds of three decimals, which may be thousands, and loads of one, which may not."""
    rows = [f'2026-05-04T06:00:{k:02}Z,{30 + k / 1e3:.3f},1000.5' for k in range(20)]
    text = '\n'.join(['time,speed,load', *rows, '']).replace(',', delimiter)
    recording = open_log(tmp_path, text.replace('1000.5', damaged, count))
    series = recording.read([Request('speed', 'data'), Request('load', 'data')])
    assert series[Request('speed', 'data')].value.tolist() == [30 + k / 1e3 for k in range(20)]
    load = series[Request('load', 'data')]
    assert load.value[count:].tolist() == [1000.5] * (20 - count)
    assert sum(fault.count for fault in load.faults) == count


def test_lines_with_numbers_in_place_of_a_name_are_no_signals(tmp_path: Path) -> None:
    """Read lines with decimal commas behind a table without units as lines without a speed."""
    rows = ''.join(f'2026-05-04 06:00:{k:02},speed{" " * (k % 2)},{30 + k}\n' for k in range(20))
    rows += ''.join(f'2026-05-04 06:01:{k:02},000;30,5\n' for k in range(10))
    recording = open_log(tmp_path, f'time,name,value\n{rows}')
    (column,) = recording.all_columns  # blanks behind a name are no part of it
    (series,) = recording.read([Request(column.heading, 'data')]).values()
    assert series.value.tolist() == [30.0 + k for k in range(20)]
    assert recording.end_ns == epoch_ns(datetime(2026, 5, 4, 6, 1, 9, tzinfo=timezone.utc))


def test_one_damaged_cell_does_not_tell_that_points_are_of_thousands(tmp_path: Path) -> None:
    rows = [f'2026-05-04T06:00:{k:02};{30 + k / 1e3:.3f};{1 + k / 1e3:.3f}' for k in range(12)]
    text = '\n'.join(['time;speed;load', *rows, ''])
    assert open_log(tmp_path, text.replace('1.005', '1,5')).table.thousands == '.'
    assert open_log(tmp_path, text).table.thousands == '.'


def test_a_word_before_the_headings_is_not_taken_for_the_first(tmp_path: Path) -> None:
    """Write a table as Hioki's recorders do: times were read as speeds."""
    rows = ''.join(f'{k}.0, {30 + k % 3}, {900 + k}\n' for k in range(9))
    recording = open_log(tmp_path, f'"SIGNAL", "TIME", "CH1", "CH2"\n{rows}')
    assert (
        '4 headings stand above 3 cells: they were matched from the left, so that no' in recording.losses[0]
    )


def test_lines_behind_the_mark_of_a_remark_are_counted(tmp_path: Path) -> None:
    rows = [f'{"#" * (k in (7, 8))}@{k},{30 + k},900\n' for k in range(9)]
    recording = open_log(tmp_path, 'time,speed,load\n# of the day\n' + ''.join(rows) + '# the end\n')
    (series,) = recording.read([Request('speed', 'data')]).values()
    assert series.value.size == 7
    assert recording.losses == ("2 lines without a time were not used, the first '#2026-04-13T10:00:07Z'",)
