# SPDX-License-Identifier: Apache-2.0
"""Logs as ships, yards and historians write them: every number and every time is judged.

The expected values are worked out by hand from the text of each file, times with
``datetime``; speeds are in rpm and loads in N, as the reference bearing is configured.
"""

from __future__ import annotations

import gzip
import math
import random
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import pytest

from stickslip_monitor.bags.reader import open_bag
from stickslip_monitor.bags.recording import Request
from stickslip_monitor.cli import main
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.parameter_file import load_config

CONFIG = Path(__file__).resolve().parents[2] / 'launch_configs/reference_bearing.yaml'
NAN = math.nan
T0 = datetime(2026, 4, 13, 10, 0, tzinfo=timezone.utc)


def ns(time: datetime) -> int:
    return (time - datetime(1970, 1, 1, tzinfo=timezone.utc)) // timedelta(microseconds=1) * 1000


def after(*seconds: float) -> list[int]:
    return [ns(T0) + round(s * 1e9) for s in seconds]


def since(*seconds: float) -> list[int]:
    return [round(s * 1e9) for s in seconds]


class Log(NamedTuple):
    data: str | bytes
    times: list[int]
    speed: Sequence[float]
    load: Sequence[float]
    says: str = ''
    lost: str = ''


LOGS = {
    'comma, units in brackets': Log(
        'time,speed [rpm],load [kN]\n2026-04-13T10:00:00Z,30,1.5\n2026-04-13T10:00:01Z,31,1.6\n',
        after(0, 1),
        [30, 31],
        [1500, 1600],
        "column 'load [kN]' in kN, by its heading",
    ),
    'tab': Log(
        'time\tspeed\tload\n2026-04-13T10:00:00Z\t30\t900\n2026-04-13T10:00:01Z\t31\t901\n',
        after(0, 1),
        [30, 31],
        [900, 901],
        'as aft_stern.speed.unit says',
    ),
    'semicolon, decimal comma, German dates': Log(
        'Zeit;Drehzahl (1/min);Last (kN)\n13.04.2026 10:00:00;30,25;1,5\n13.04.2026 10:00:01;31,5;0,5\n',
        after(0, 1),
        [30.25, 31.5],
        [1500, 500],
        'no zone: taken as UTC',
    ),
    'decimal comma and points of thousands': Log(
        'Zeit;n (1/min);Last (N)\n2026-04-13 10:00:00;30,5;1.234,5\n2026-04-13 10:00:01;31;999,5\n',
        after(0, 1),
        [30.5, 31],
        [1234.5, 999.5],
    ),
    'commas of thousands in quotation marks': Log(
        'time,speed [rpm],load [N]\n2026-04-13T10:00:00Z,30.5,"1,234.5"\n'
        '2026-04-13T10:00:01Z,31.0,"12,345"\n',
        after(0, 1),
        [30.5, 31],
        [1234.5, 12345],
    ),
    'units in a row of their own': Log(
        'Timestamp,n,Force\n-,rpm,kN\n2026-04-13T10:00:00Z,30,1.5\n2026-04-13T10:00:01Z,31,1.6\n',
        after(0, 1),
        [30, 31],
        [1500, 1600],
    ),
    'units behind underscores': Log(
        'ts,ME1_RPM,brg_kN\n2026-04-13T10:00:00Z,30,1.5\n2026-04-13T10:00:01Z,31,1.6\n',
        after(0, 1),
        [30, 31],
        [1500, 1600],
    ),
    'Hz is turned into rpm': Log(
        'time,n [Hz],load [N]\n2026-04-13T10:00:00Z,0.5,900\n2026-04-13T10:00:01Z,0.75,901\n',
        after(0, 1),
        [30, 45],
        [900, 901],
        'in Hz, by its heading',
    ),
    'epoch in s with nanoseconds': Log(
        'time,speed,load\n1776074400.000000001,30,900\n1776074401.123456789,31,901\n',
        [ns(T0) + 1, ns(T0) + 1_123_456_789],
        [30, 31],
        [900, 901],
        's since 1970',
    ),
    'epoch in ms': Log(
        'time,speed,load\n1776074400000,30,900\n1776074400250,31,901\n',
        after(0, 0.25),
        [30, 31],
        [900, 901],
        'ms since 1970',
    ),
    'epoch in us': Log(
        'time,speed,load\n1776074400000000,30,900\n1776074400000250,31,901\n',
        [ns(T0), ns(T0) + 250_000],
        [30, 31],
        [900, 901],
        'us since 1970',
    ),
    'epoch in ns': Log(
        'time,speed,load\n1776074400000000000,30,900\n1776074400000000003,31,901\n',
        [ns(T0), ns(T0) + 3],
        [30, 31],
        [900, 901],
        'ns since 1970',
    ),
    # 2026-04-13 is day 46125 of a spreadsheet: 1899-12-30 and 46,125 days.
    'days of a spreadsheet': Log(
        'Date;n [rpm];F [N]\n46125,5;30;900\n46125,75;31;901\n',
        after(2 * 3600, 8 * 3600),
        [30, 31],
        [900, 901],
        'days of a spreadsheet',
    ),
    'seconds': Log(
        't,speed,load\n0,30,900\n0.1,31,901\n0.2,32,902\n',
        since(0, 0.1, 0.2),
        [30, 31, 32],
        [900, 901, 902],
        's since the start',
    ),
    'milliseconds by the heading': Log(
        'time [ms],speed,load\n0,30,900\n100,31,901\n',
        since(0, 0.1),
        [30, 31],
        [900, 901],
        'ms since the start',
    ),
    'no heading': Log(
        '2026-04-13 10:00:00,30,900\n2026-04-13 10:00:01,31,901\n', after(0, 1), [30, 31], [900, 901]
    ),
    'date and time apart': Log(
        'Date,Time,speed,load\n13/04/2026,10:00:00,30,900\n13/04/2026,10:00:01.5,31,901\n',
        after(0, 1.5),
        [30, 31],
        [900, 901],
    ),
    'month first, with a half of the day': Log(
        'time,speed,load\n04/13/2026 10:00:00 AM,30,900\n04/13/2026 01:00:00 PM,31,901\n',
        after(0, 3 * 3600),
        [30, 31],
        [900, 901],
    ),
    'day or month first, told by the last line': Log(
        'time,speed,load\n12/04/2026 10:00:00,30,900\n13/04/2026 10:00:00,31,901\n',
        after(-86400, 0),
        [30, 31],
        [900, 901],
    ),
    'name of the month': Log(
        'time,speed,load\n13-Apr-2026 10:00:00,30,900\n13-Apr-2026 10:00:01,31,901\n',
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'a zone': Log(
        'time,speed,load\n2026-04-13T12:00:00+02:00,30,900\n2026-04-13T12:00:01+02:00,31,901\n',
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'times of the day': Log(
        'Uhrzeit;n [rpm];F [N]\n10:00:00;30;900\n10:00:01;31;901\n',
        since(36000, 36001),
        [30, 31],
        [900, 901],
        'of the day, without a date',
    ),
    'words and empty cells': Log(
        'time,speed [rpm],load [N]\n2026-04-13T10:00:00Z,30,900\n2026-04-13T10:00:01Z,Bad,901\n'
        '2026-04-13T10:00:02Z,I/O Timeout,902\n2026-04-13T10:00:03Z,---,903\n',
        after(0, 1, 2, 3),
        [30, NAN, NAN, NAN],
        [900, 901, 902, 903],
    ),
    'the first line of numbers has a word': Log(
        'time,speed [rpm],load [N]\n2026-04-13T10:00:00Z,No Data,900\n2026-04-13T10:00:01Z,31,901\n',
        after(0, 1),
        [NAN, 31],
        [900, 901],
    ),
    'a preamble': Log(
        'Vessel: Example\nExported by historian 4.2\n\nTime;RPM [rpm];Load [kN]\n'
        '2026-04-13 10:00:00;30;1.5\n2026-04-13 10:00:01;31;1.6\n',
        after(0, 1),
        [30, 31],
        [1500, 1600],
    ),
    'comments': Log(
        '# made by hand\n# time,speed,load\n0,30,900\n1,31,901\n', since(0, 1), [30, 31], [900, 901]
    ),
    'the separator named for spreadsheets': Log(
        'sep=;\ntime;speed;load\n2026-04-13 10:00:00;30;900\n2026-04-13 10:00:01;31;901\n',
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'newest first': Log(
        'time,speed,load\n2026-04-13T10:00:02Z,32,902\n2026-04-13T10:00:01Z,31,901\n'
        '2026-04-13T10:00:00Z,30,900\n',
        after(0, 1, 2),
        [30, 31, 32],
        [900, 901, 902],
        'newest line comes first',
    ),
    'UTF-16 with its mark': Log(
        'time\tspeed\tload\r\n2026-04-13T10:00:00Z\t30\t900\r\n2026-04-13T10:00:01Z\t31\t901\r\n'.encode(
            'utf-16'
        ),
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'UTF-16 without its mark': Log(
        'time\tspeed\tload\r\n2026-04-13T10:00:00Z\t30\t900\r\n2026-04-13T10:00:01Z\t31\t901\r\n'.encode(
            'utf-16-le'
        ),
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'Windows-1252': Log(
        'Zeit;Wellendrehzahl, rückwärts [rpm];Last [N]\n2026-04-13 10:00:00;30;900\n'
        '2026-04-13 10:00:01;31;901\n'.encode('cp1252'),
        after(0, 1),
        [30, 31],
        [900, 901],
        'Windows-1252',
    ),
    'gzip': Log(gzip.compress(b'time,speed,load\n0,30,900\n1,31,901\n'), since(0, 1), [30, 31], [900, 901]),
    'long, names in turn': Log(
        'time,tag,value\n2026-04-13T10:00:00Z,speed,30\n2026-04-13T10:00:00Z,load,900\n'
        '2026-04-13T10:00:01Z,speed,31\n2026-04-13T10:00:01Z,load,901\n',
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'long, one name after the other': Log(
        'time,tag,value,unit\n2026-04-13T10:00:00Z,n,30,rpm\n2026-04-13T10:00:01Z,n,31,rpm\n'
        '2026-04-13T10:00:00Z,F,0.9,kN\n2026-04-13T10:00:01Z,F,1.1,kN\n',
        after(0, 1),
        [30, 31],
        [900, 1100],
    ),
    'InfluxDB, annotated': Log(
        '#group,false,false,true,true,false,false,true\r\n'
        '#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string\r\n'
        '#default,_result,,,,,,\r\n,result,table,_start,_stop,_time,_value,_field\r\n'
        ',,0,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,2026-04-13T10:00:00Z,30,speed\r\n'
        ',,0,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,2026-04-13T10:00:01Z,31,speed\r\n'
        ',,1,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,2026-04-13T10:00:00Z,900,load\r\n'
        ',,1,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,2026-04-13T10:00:01Z,901,load\r\n',
        after(0, 1),
        [30, 31],
        [900, 901],
    ),
    'long, a name with hundreds of lines after another': Log(
        'time,tag,value\n'
        + ''.join(
            f'{second},{tag},{first + second}\n'
            for tag, first in (('speed', 30), ('load', 900))
            for second in range(300)
        ),
        since(*range(300)),
        range(30, 330),
        range(900, 1200),
    ),
    'long, a clock that is set back': Log(
        'time,tag,value\n'
        + ''.join(
            f'{second},{tag},{second}\n' for second in (100, 101, 102, 2, 3, 4) for tag in ('speed', 'load')
        ),
        since(*range(100, 106)),
        [100, 101, 102, 2, 3, 4],
        [100, 101, 102, 2, 3, 4],
        'set back once',
    ),
    'the mark of a comment before blanks and headings': Log(
        '# t[s]  n[1/min]   F[kN]\n  0.0   30.0   0.9\n  1.0   31.0   1.1\n',
        since(0, 1),
        [30, 31],
        [900, 1100],
    ),
    'knots beside a load in small letters': Log(
        'time,speed (kn),shaft_rpm,load_kn\n0,12,30,0.9\n1,12,31,1.1\n', since(0, 1), [30, 31], [900, 1100]
    ),
    'NMEA 0183': Log(
        '2026-04-13T10:00:00.000Z $IIRPM,S,1,30.0,,A*5D\n'
        '2026-04-13T10:00:00Z $IIXDR,N,900.0,N,LOAD*6F\n'
        '2026-04-13T10:00:01.000Z $IIRPM,S,1,31.0,,V*4B\n'
        '2026-04-13T10:00:01Z $IIXDR,N,901.0,N,LOAD*6E\n',
        after(0, 1),
        [30, NAN],
        [900, 901],
    ),
    'Signal K': Log(
        '{"updates":[{"timestamp":"2026-04-13T10:00:00.000Z","values":['
        '{"path":"propulsion.port.revolutions","value":0.5},'
        '{"path":"propulsion.port.shaft.load","value":900}]}]}\n'
        '{"updates":[{"timestamp":"2026-04-13T10:00:01.000Z","values":['
        '{"path":"propulsion.port.revolutions","value":0.75},'
        '{"path":"propulsion.port.shaft.load","value":901}]}]}\n',
        after(0, 1),
        [30, 45],
        [900, 901],
    ),
    'blanks': Log(
        '  0.0   30.0   900\n  1.0   31.0   901\n  2.0   32.0   902\n',
        since(0, 1, 2),
        [30, 31, 32],
        [900, 901, 902],
    ),
    'a zero byte': Log(
        b'time,speed,load\n0,30,900\n1,3\x001,901\n', since(0, 1), [30, 31], [900, 901], lost='1 zero byte'
    ),
    'a second heading': Log(
        'time,speed,load\n0,30,900\ntime,speed,load\n1,31,901\n',
        since(0, 1),
        [30, 31],
        [900, 901],
        'the headings come 1 time more in the middle',
    ),
    'a line without a time': Log(
        'time,speed,load\n0,30,900\n?,31,901\n2,32,902\n',
        since(0, 2),
        [30, 32],
        [900, 902],
        lost="1 line without a time was not used, the first '?'",
    ),
    'a last line that is cut': Log(
        'time,speed,load\n0,30,900\n1,31,901\n2,32',
        since(0, 1),
        [30, 31],
        [900, 901],
        lost='1 line damaged or of too few cells was not used',
    ),
    'a clock that is set back': Log(
        'time,speed,load\n100,30,900\n101,31,901\n102,32,902\n2,33,903\n3,34,904\n4,35,905\n',
        since(100, 101, 102, 103, 104, 105),
        range(30, 36),
        range(900, 906),
        'set back once, by 100 s',
    ),
}
# Columns that nothing names are given.
COLUMNS = {
    'no heading': ('#2', '#3'),
    'blanks': ('#2', '#3'),
    'comments': ('speed', 'load'),
    'long, one name after the other': ('n', 'F'),
}


@pytest.mark.parametrize('name', LOGS)
def test_every_number_and_every_time(name: str, tmp_path: Path) -> None:
    log, path, text = LOGS[name], tmp_path / 'voyage.csv', CONFIG.read_text()
    path.write_bytes(log.data if isinstance(log.data, bytes) else log.data.encode())
    speed, load = COLUMNS.get(name, ('', ''))
    text = text.replace('speed: {topic', f"speed: {{column: '{speed}', topic")
    (tmp_path / 'ship.yaml').write_text(text.replace('load: {topic', f"load: {{column: '{load}', topic"))
    recording = open_bag(path)
    bound = recording.bound(load_config(tmp_path / 'ship.yaml'))
    assert bound.absent == {}
    found = recording.read([Request(i.topic, 'data') for i in bound.config.bearings[0].inputs.values()])
    for series, expected in zip(found.values(), (log.speed, log.load), strict=True):
        assert series.stamp_ns.tolist() == log.times
        assert series.value.tolist() == pytest.approx(list(expected), rel=1e-12, nan_ok=True)
    assert log.says in ' | '.join(recording.warnings)
    assert log.lost in ' | '.join(recording.losses)
    assert bool(recording.losses) == bool(log.lost)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Data with some bytes changed, put in, taken out or cut off."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        k = rng.randrange(len(found) + 1)
        put = rng.choice([b'"', b',', b'\n', bytes(20), b'-', b'9' * 30, b'1e999', b'nan', b'\r'])
        taken = rng.choice([0, 0, 1, 20, len(found)])
        found[k : k + taken] = put if rng.random() < 0.7 else b''
    return bytes(found)


def test_damaged_tables_are_read_or_refused_in_a_sentence(tmp_path: Path) -> None:
    config, path, rng = load_config(CONFIG), tmp_path / 'a.csv', random.Random(1)
    logs = [log.data if isinstance(log.data, bytes) else log.data.encode() for log in LOGS.values()]
    refused = []
    for _ in range(400):
        path.write_bytes(damaged(rng.choice(logs), rng))
        try:
            recording = open_bag(path)
            bound = recording.bound(config)
            inputs = bound.config.bearings[0].inputs.values()
            if not bound.absent:
                recording.read([Request(source.topic, 'data') for source in inputs])
        except BagError as error:
            refused.append(str(error))
    assert len(refused) < 300
    assert [text for text in refused if not text.strip()] == []


@pytest.mark.parametrize(
    'text',
    [
        'time,Shaft RPM,Speed over ground (kn)\n0,30,12\n1,31,12\n',
        'time,Shaft RPM,load [t]\n0,30,1.2\n1,31,1.2\n',
        'time,Shaft RPM,load\ns,rpm,t\n0,30,1.2\n1,31,1.2\n',
        'time,tag,value,unit\n0,n,30,rpm\n0,load,1.2,t\n1,n,31,rpm\n1,load,1.2,t\n',
    ],
    ids=['knots', 'tons in the heading', 'tons in a row', 'tons in a column'],
)
def test_a_column_of_another_unit_is_no_load(text: str, tmp_path: Path) -> None:
    """12 knots or 1.2 t, taken for 12 kN or 1.2 N, would be judged stable."""
    path = tmp_path / 'voyage.csv'
    path.write_text(text)
    bound = open_bag(path).bound(load_config(CONFIG))
    assert list(bound.absent) == [('aft_stern', 'load')]
    assert 'write aft_stern.load.column' in bound.absent['aft_stern', 'load']


def test_the_end_of_a_log_of_many_short_lines_is_known(tmp_path: Path) -> None:
    """More lines than are looked at of a head, in fewer bytes than a head has."""
    path = tmp_path / 'voyage.csv'
    path.write_text('time,rpm,kN\n' + ''.join(f'{t},30,1\n' for t in range(6000)))
    assert (open_bag(path).start_ns, open_bag(path).end_ns) == (0, 5999 * 10**9)


def test_a_recording_starts_with_its_first_line_though_the_clock_was_set_back(tmp_path: Path) -> None:
    path = tmp_path / 'voyage.csv'
    path.write_text('time,speed,load\n' + ''.join(f'{t},30,900\n' for t in (100, 101, 2, 3)))
    recording = open_bag(path)
    assert (recording.start_ns, recording.end_ns) == (100 * 10**9, 101 * 10**9)
    recording.read([Request('speed', 'data')])
    # The usual gap of a second takes the place of the step.
    assert (recording.start_ns, recording.end_ns) == (100 * 10**9, 103 * 10**9)


def test_a_column_that_says_another_unit_is_asked_about(tmp_path: Path) -> None:
    path, text = tmp_path / 'voyage.csv', CONFIG.read_text()
    own = text.replace('load, unit: N,', "load, unit: N, column: 'Load [klbf]',")
    assert own != text
    (tmp_path / 'own.yaml').write_text(own)
    path.write_text('time,rpm,Load [klbf]\n0,30,1.2\n1,31,1.2\n')
    recording = open_bag(path)
    assert not recording.bound(load_config(tmp_path / 'own.yaml')).absent
    assert any(
        "column 'Load [klbf]' in N, as aft_stern.load.unit says: is that right? Its heading says"
        " 'klbf'" in said
        for said in recording.warnings
    )


def test_lines_far_apart_are_told_and_a_value_counts_for_three_of_them(tmp_path: Path) -> None:
    path = tmp_path / 'voyage.csv'
    path.write_text('time,rpm,kN\n' + ''.join(f'{20 * k},30,1\n' for k in range(30)))
    recording = open_bag(path)
    (bearing,) = recording.bound(load_config(CONFIG)).config.bearings
    assert bearing.speed.timeout_ns == bearing.load.timeout_ns == 60 * 10**9
    said = ' '.join(recording.warnings)
    assert said.count('lines are 20 s apart, so its timeout is 60 s here') == 2
    assert 'lines are 20 s apart: stick-slip shorter than some minutes cannot be seen' in said


def test_a_log_is_not_played_and_a_way_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'voyage.csv').write_text('time,speed,load\n0,30,900\n1,31,901\n')
    assert main(['play', str(tmp_path / 'voyage.csv')]) == 2
    assert 'make a bag of it by stickslip check with' in capsys.readouterr().err
