# SPDX-License-Identifier: Apache-2.0
"""Logs as ships, yards and historians write them, and what is read of each.

The expected values are worked out by hand from the text of each file, times with
``datetime``; speeds are in rpm and loads in N, as the reference bearing is configured.
"""

from __future__ import annotations

import gzip
import math
import re
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from functools import reduce
from operator import xor
from pathlib import Path
from typing import NamedTuple

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.table_recording import TableRecording

NAN = math.nan
T0 = datetime(2026, 4, 13, 10, 0, tzinfo=timezone.utc)


def epoch_ns(time: datetime) -> int:
    return (time - datetime(1970, 1, 1, tzinfo=timezone.utc)) // timedelta(microseconds=1) * 1000


def times_after_start(*seconds: float) -> list[int]:
    return [epoch_ns(T0) + round(s * 1e9) for s in seconds]


def times_since_start(*seconds: float) -> list[int]:
    return [round(s * 1e9) for s in seconds]


def nmea_sentence(body: str) -> str:
    """Return a sentence of NMEA 0183 with its checksum, the exclusive or of its characters."""
    return f'${body}*{reduce(xor, body.encode()):02X}'


class Log(NamedTuple):
    """A log and what is read of it; '@0' stands for 2026-04-13T10:00:00Z, '~1' for 2026-04-13 10:00:01."""

    data: str | bytes
    times: Sequence[int] = times_after_start(0, 1)
    speed: Sequence[float] = (30, 31)
    load: Sequence[float] = (900, 901)
    says: str = ''
    lost: str = ''
    encoding: str = 'utf-8'

    @property
    def raw(self) -> bytes:
        if isinstance(self.data, bytes):
            return self.data
        text = re.sub(r'@(\d)', r'2026-04-13T10:00:0\1Z', self.data)
        return re.sub(r'~(\d)', r'2026-04-13 10:00:0\1', text).encode(self.encoding)


LOGS = {
    'comma, units in brackets': Log(
        'time,speed [rpm],load [kN]\n@0,30,1.5\n@1,31,1.6\n',
        load=[1500, 1600],
        says="column 'load [kN]' in kN, by its heading",
    ),
    'tab': Log('time\tspeed\tload\n@0\t30\t900\n@1\t31\t901\n', says='as aft_stern.speed.unit says'),
    'semicolon, decimal comma, German dates': Log(
        'Zeit;Drehzahl (1/min);Last (kN)\n13.04.2026 10:00:00;30,25;1,5\n13.04.2026 10:00:01;31,5;0,5\n',
        speed=[30.25, 31.5],
        load=[1500, 500],
        says='no zone: taken as UTC',
    ),
    'decimal comma and points of thousands': Log(
        'Zeit;n (1/min);Last (N)\n~0;30,5;1.234,5\n~1;31;999,5\n', speed=[30.5, 31], load=[1234.5, 999.5]
    ),
    'commas of thousands in quotation marks': Log(
        'time,speed [rpm],load [N]\n@0,30.5,"1,234.5"\n@1,31.0,"12,345"\n',
        speed=[30.5, 31],
        load=[1234.5, 12345],
    ),
    'units in a row of their own': Log(
        'Timestamp,n,Force\n-,rpm,kN\n@0,30,1.5\n@1,31,1.6\n', load=[1500, 1600]
    ),
    'units behind underscores': Log('ts,ME1_RPM,brg_kN\n@0,30,1.5\n@1,31,1.6\n', load=[1500, 1600]),
    'meganewtons': Log('time,rpm,Load MN\n@0,30,0.5\n@1,31,0.25\n', load=[5e5, 2.5e5]),
    'tonnes-force': Log('time,rpm,bearing [tf]\n@0,30,0.5\n@1,31,2\n', load=[4903.325, 19613.3]),
    'tonnes, beside a load': Log('time,rpm,Load (t)\n@0,30,0.5\n@1,31,2\n', load=[4903.325, 19613.3]),
    'a heading that is a unit, below words': Log('a,b,c\ntime,rpm,load [N]\n@0,30,900\n@1,31,901\n'),
    'tonnes in a row of units': Log('time,rpm,load\ns,rpm,t\n@0,30,0.5\n@1,31,2\n', load=[4903.325, 19613.3]),
    'tonnes, of cargo, and pounds': Log(
        'time,rpm,Cargo [t],load_lbf\n@0,30,9000,100\n@1,31,9000,200\n',
        load=[444.82216152605, 889.6443230521],
    ),
    'Hz is turned into rpm': Log(
        'time,n [Hz],load [N]\n@0,0.5,900\n@1,0.75,901\n', speed=[30, 45], says='in Hz, by its heading'
    ),
    'epoch in s with nanoseconds': Log(
        'time,speed,load\n1776074400.000000001,30,900\n1776074401.123456789,31,901\n',
        times=[epoch_ns(T0) + 1, epoch_ns(T0) + 1_123_456_789],
        says='s since 1970',
    ),
    'epoch in ms': Log(
        'time,speed,load\n1776074400000,30,900\n1776074400250,31,901\n',
        times=times_after_start(0, 0.25),
        says='ms since 1970',
    ),
    'epoch in us': Log(
        'time,speed,load\n1776074400000000,30,900\n1776074400000250,31,901\n',
        times=[epoch_ns(T0), epoch_ns(T0) + 250_000],
        says='us since 1970',
    ),
    'epoch in ns': Log(
        'time,speed,load\n1776074400000000000,30,900\n1776074400000000003,31,901\n',
        times=[epoch_ns(T0), epoch_ns(T0) + 3],
        says='ns since 1970',
    ),
    # 2026-04-13 is day 46125 of a spreadsheet: 1899-12-30 and 46,125 days.
    'days of a spreadsheet': Log(
        'Date;n [rpm];F [N]\n46125,5;30;900\n46125,75;31;901\n',
        times=times_after_start(2 * 3600, 8 * 3600),
        says='days of a spreadsheet',
    ),
    'days of a spreadsheet under another heading, a line a second': Log(
        'Time,speed,load\n46125.5,30,900\n46125.5000115741,31,901\n',
        times=[epoch_ns(T0) + 7200 * 10**9, epoch_ns(T0) + 7_201_000_002_240],
        says='days of a spreadsheet',
    ),
    'a line a minute in days': Log(
        'Time,speed,load\n46125.5,30,900\n46125.500694444,31,901\n',
        times=[epoch_ns(T0) + 7200 * 10**9, epoch_ns(T0) + 7_259_999_961_600],
        says='days of a spreadsheet',
    ),
    'seconds of the day, 1000 lines each': Log(
        't,speed,load\n36000.000,30,900\n36000.001,31,901\n', times=times_since_start(36_000, 36_000.001)
    ),
    'microseconds since the start, after some minutes': Log(
        'time [us],speed,load\n150000000,30,900\n150010000,31,901\n',
        times=times_since_start(150, 150.01),
        says='us since the start',
    ),
    # datenum('1970-01-01') is 719529.
    'days of MATLAB': Log(
        'datenum,speed,load\n740085.5,30,900\n740085.75,31,901\n',
        times=times_after_start(2 * 3600, 8 * 3600),
        says='days of MATLAB',
    ),
    # 134,774 days, 719,162 days and 24,107 days before 1970.
    'file times of Windows': Log(
        f'time,speed,load\n{(epoch_ns(T0) // 100 + 134_774 * 864 * 10**9)},30,900\n'
        f'{(epoch_ns(T0) // 100 + 134_774 * 864 * 10**9) + 10**7},31,901\n',
        says='100 ns since 1601',
    ),
    'ticks of .NET': Log(
        f'time,speed,load\n{(epoch_ns(T0) // 100 + 719_162 * 864 * 10**9)},30,900\n'
        f'{(epoch_ns(T0) // 100 + 719_162 * 864 * 10**9) + 10**7},31,901\n',
        says='100 ns since the year 1',
    ),
    'seconds of LabVIEW': Log(
        f'time,speed,load\n{epoch_ns(T0) // 10**9 + 24_107 * 86_400},30,900\n'
        f'{epoch_ns(T0) // 10**9 + 24_107 * 86_400 + 1},31,901\n',
        says='s since 1904',
    ),
    'a leap second in many lines': Log(
        'time,speed,load\n2016-12-31T23:59:60Z,30,900\n' + '2017-01-01T00:00:00Z,31,901\n' * 600,
        times=[epoch_ns(datetime(2017, 1, 1, tzinfo=timezone.utc))] * 601,
        speed=[30] + [31] * 600,
        load=[900] + [901] * 600,
        lost='601 lines share 1 time',
    ),
    'seconds in a column of their own': Log(
        'date,time,s,speed,load\n' + ''.join(f'2026-04-13,10:0{k // 5},{k % 5},30,900\n' for k in range(10)),
        times=times_after_start(*range(5), *range(60, 65)),
        speed=[30] * 10,
        load=[900] * 10,
        says="'s' has the s of the times",
    ),
    'the newest first, with minutes alone': Log(
        'time,speed,load\n' + '2026-04-13 10:01,31,901\n' * 3 + '2026-04-13 10:00,30,900\n' * 3,
        times=times_after_start(0, 0, 0, 60, 60, 60),
        speed=[30] * 3 + [31] * 3,
        load=[900] * 3 + [901] * 3,
        lost='6 lines share 2 times',
    ),
    'a line for each number': Log(
        'time,speed,load,oil,air\n'
        + ''.join(f'{t},30,,,\n{t},,900,,\n{t},,,40,\n{t},,,,20\n' for t in (0, 10, 20)),
        times=times_since_start(0, 10, 20),
        speed=[30] * 3,
        load=[900] * 3,
    ),
    'before and behind a change': Log(
        'time,speed,load\n0,30,900\n60,30,900\n60,31,901\n120,31,901\n120,32,902\n',
        times=times_since_start(0, 60, 60, 120, 120),
        speed=[30, 30, 31, 31, 32],
        load=[900, 900, 901, 901, 902],
    ),
    'days of a spreadsheet under Date/Time': Log(
        'Date/Time,speed,load\n46125.5,30,900\n46125.500125,31,901\n',
        times=times_after_start(7200, 7210.8),
        says='days of a spreadsheet',
    ),
    'units behind commas without quotation marks': Log(
        'time,Shaft Speed, rpm,Oil temperature,Load, kN\n@0,30,55,1.2\n@1,31,55,1.3\n',
        speed=[30, 31],
        load=[1200, 1300],
    ),
    'points and commas in one number alone': Log(
        'time;speed;load\n2026-04-13 10:00:00;30;44.658,5\n2026-04-13 10:00:01;31;44.659,5\n',
        load=[44658.5, 44659.5],
    ),
    'blanks and commas in one number alone': Log(
        'time;speed;load\n2026-04-13 10:00:00;30;44\u00a0658,5\n2026-04-13 10:00:01;31;44\u00a0659,5\n',
        load=[44658.5, 44659.5],
    ),
    'points beside quoted commas that part thousands': Log(
        'time,speed,load\n@0,30.125,"28,013"\n@1,31.125,"28,014"\n',
        speed=[30.125, 31.125],
        load=[28013, 28014],
    ),
    'the arrival, the file and the hours of an engine beside the time': Log(
        'Running hours,ETA UTC,file,t,speed,load\n'
        '1234:15:00,2026-04-20 00:00:00,20260413_100000,0,30,900\n'
        '1234:15:01,2026-04-20 00:00:00,20260413_100000,1,31,901\n',
        times=times_since_start(0, 1),
    ),
    'words beside dates with blanks': Log(
        'Zeit;Alarm;Remarks;speed;load\n'
        '13.04.2026 10:00:00 AM;No;Good;30;900\n13.04.2026 10:00:01 AM;No;Good;31;901\n'
    ),
    'an arrival that changes seldom': Log(
        'Time,ETA UTC,speed,load\n'
        + ''.join(f'~{k},2026-04-2{k // 5} 00:00:00,{30 + k},{900 + k}\n' for k in range(10)),
        times=times_after_start(*range(10)),
        speed=range(30, 40),
        load=range(900, 910),
    ),
    'sets, rates of revolution and pitch propellers': Log(
        'time,"Set 1, rate of revolution, pitch propeller [rpm]",load\n@0,30,900\n@1,31,901\n'
    ),
    'an element of an array, by its number': Log('time,speed,Load(10)\ns,rpm,kN\n@0,30,0.9\n@1,31,0.901\n'),
    'a state of an engine': Log('time,speed,Status,load\n@0,30,Not running,900\n@1,31,Not ready,901\n'),
    'NMEA 0183: ZDA, and another receiver with a date of 1024 weeks ago': Log(
        ''.join(
            f'{line}\n'
            for k in (0, 1)
            for line in (
                nmea_sentence(f'GPZDA,10000{k}.00,13,04,2026,00,00'),
                nmea_sentence(f'IIRPM,S,1,{30 + k}.0,,A'),
                nmea_sentence(f'GNRMC,10000{k}.00,A,5300.0,N,00800.0,E,5.0,90.0,270806,,,A'),
                nmea_sentence(f'IIXDR,N,{900 + k}.0,N,LOAD'),
            )
        )
    ),
    'Signal K: odd meta data': Log(
        ''.join(
            f'{{"updates": [{{"timestamp": "@{k}", "meta": {meta}, "values": ['
            f'{{"path": "speed", "value": {30 + k}}}, {{"path": "load", "value": {900 + k}}}]}}]}}\n'
            for k, meta in enumerate(('null', '[{"path": "speed"}, {"path": "load", "value": null}, 5]'))
        )
    ),
    'commas that may part thousands': Log(
        'time;speed;load\n2026-04-13 10:00:00;30;28,013\n2026-04-13 10:00:01;31;28,014\n',
        load=[28.013, 28.014],
    ),
    'words of quality': Log(
        'time,speed [rpm],speed.Status,load [N],load.Status\n@0,30,Bad,900,Good\n@1,31,Good,901,Uncertain\n',
        speed=[NAN, 31],
        load=[900, NAN],
        says="numbers of 'speed [rpm]' count where 'speed.Status' says so",
    ),
    'words of quality beside columns by their places': Log(
        'time,a,Quality,b,Quality\n2026-04-13T10:00:00Z,30,Bad,900,Good\n'
        '2026-04-13T10:00:01Z,31,Good,901,Good\n',
        speed=[NAN, 31],
    ),
    'codes of OPC, one value a line': Log(
        'time,tag,value,quality\n@0,speed,30,192\n@0,load,900,192\n@1,speed,31,0\n@1,load,901,216\n',
        speed=[30, NAN],
    ),
    'WinCC': Log(
        'VarName;TimeString;VarValue;Validity\nspeed;13.04.2026 10:00:00;30;0\n'
        'load;13.04.2026 10:00:00;900;1\nspeed;13.04.2026 10:00:01;31;1\nload;13.04.2026 10:00:01;901;1\n',
        speed=[NAN, 31],
    ),
    'Wonderware': Log(
        'DateTime,TagName,Value,QualityDetail\n2026-04-13 10:00:00,speed,30,192\n'
        '2026-04-13 10:00:00,load,900,192\n2026-04-13 10:00:01,speed,31,24\n'
        '2026-04-13 10:00:01,load,901,192\n',
        speed=[30, NAN],
    ),
    'a flag of validity': Log('time,speed,valid,load\n@0,30,0,900\n@1,31,1,901\n', speed=[NAN, 31]),
    'a flow Q beside': Log('time,speed,Q,load\n@0,30,100,900\n@1,31,200,901\n'),
    'ISO 8601 without separators': Log('time,speed,load\n20260413T100000Z,30,900\n20260413T100001Z,31,901\n'),
    'digits alone, milliseconds behind': Log(
        'time,speed,load\n20260413100000250,30,900\n20260413100001500,31,901\n',
        times=times_after_start(0.25, 1.5),
    ),
    'a statistic above the headings': Log(
        'Statistic,speed,load\nMin,29,899\nMax,31,901\n\ntime,speed,load\n@0,30,900\n@1,31,901\n'
    ),
    'fourteen digits': Log('time,speed,load\n20260413100000,30,900\n20260413100001,31,901\n'),
    'local time beside that of UTC': Log(
        'Local time,Time UTC,speed,load\n2026-04-13 18:00:00,~0,30,900\n2026-04-13 18:00:01,~1,31,901\n'
    ),
    'hours since a start, beyond a day': Log(
        'Elapsed,speed,load\n23:59:59.5,30,900\n24:00:00.5,31,901\n100:00:00.5,32,902\n',
        times=times_since_start(86_399.5, 86_400.5, 360_000.5),
        speed=[30, 31, 32],
        load=[900, 901, 902],
    ),
    'before a trigger': Log(
        'time [s],speed,load\n-1,30,900\n0,31,901\n',
        times=times_since_start(0, 1),
        says='counted from the first one',
    ),
    'a clock that was set after the start': Log(
        'time,speed,load\n1899-12-30 00:00:00,30,900\n~0,30,900\n~1,31,901\n',
        lost="1 line without a time was not used, the first '1899-12-30 00:00:00'",
    ),
    'a time of day as Access has it': Log(
        'time,speed,load\n30/12/1899 06:00:00,30,900\n30/12/1899 06:00:01,31,901\n',
        times=times_since_start(0, 1),
        says='counted from the first one',
    ),
    'a set point, and a unit without brackets': Log(
        'time,n ref [1/min],n 1/min,load [N]\n@0,60,30,900\n@1,60,31,901\n'
    ),
    'revolutions in a second, in superscript': Log(
        'time,n [s⁻¹],load\n@0,0.5,900\n@1,0.55,901\n', speed=[30, 33]
    ),
    'a minus of a Swedish locale': Log(
        'time;speed;load\n0;\u221230,5;900\n1;31;901\n', times=times_since_start(0, 1), speed=[-30.5, 31]
    ),
    'seconds': Log(
        't,speed,load\n0,30,900\n0.1,31,901\n0.2,32,902\n',
        times=times_since_start(0, 0.1, 0.2),
        speed=[30, 31, 32],
        load=[900, 901, 902],
        says='s since the start',
    ),
    'milliseconds by the heading': Log(
        'time [ms],speed,load\n0,30,900\n100,31,901\n',
        times=times_since_start(0, 0.1),
        says='ms since the start',
    ),
    'milliseconds by their name': Log(
        't_ms,n_rpm,load_kN\n0,30,0.9\n100,31,0.901\n',
        times=times_since_start(0, 0.1),
        says='ms since the start',
    ),
    'no heading': Log('~0,30,900\n~1,31,901\n'),
    'date and time apart': Log(
        'Date,Time,speed,load\n13/04/2026,10:00:00,30,900\n13/04/2026,10:00:01.5,31,901\n',
        times=times_after_start(0, 1.5),
    ),
    'month first, with a half of the day': Log(
        'time,speed,load\n04/13/2026 10:00:00 AM,30,900\n04/13/2026 01:00:00 PM,31,901\n',
        times=times_after_start(0, 3 * 3600),
    ),
    'day or month first, told by the last line': Log(
        'time,speed,load\n12/04/2026 10:00:00,30,900\n13/04/2026 10:00:00,31,901\n',
        times=times_after_start(-86400, 0),
    ),
    'name of the month': Log('time,speed,load\n13-Apr-2026 10:00:00,30,900\n13-Apr-2026 10:00:01,31,901\n'),
    'a zone': Log('time,speed,load\n2026-04-13T12:00:00+02:00,30,900\n2026-04-13T12:00:01+02:00,31,901\n'),
    'a zone in the west, by cells of one width and of two': Log(
        'time,speed,load\n2026-04-13T06:30:00-03:30,30,900\n2026-04-13T06:30:01.00-03:30,31,901\n'
    ),
    'times of the day': Log(
        'Uhrzeit;n [rpm];F [N]\n10:00:00;30;900\n10:00:01;31;901\n',
        times=times_since_start(36000, 36001),
        says='of the day, without a date',
    ),
    'words and empty cells': Log(
        'time,speed [rpm],load [N]\n@0,30,900\n@1,Bad,901\n@2,I/O Timeout,902\n@3,---,903\n',
        times=times_after_start(0, 1, 2, 3),
        speed=[30, NAN, NAN, NAN],
        load=[900, 901, 902, 903],
    ),
    'the first line of numbers has a word': Log(
        'time,speed [rpm],load [N]\n@0,No Data,900\n@1,31,901\n', speed=[NAN, 31]
    ),
    'a preamble': Log(
        'Vessel: Example\nExported by historian 4.2\n\nTime;RPM [rpm];Load [kN]\n~0;30;1.5\n~1;31;1.6\n',
        load=[1500, 1600],
    ),
    'a line of numbers above the headings': Log(
        '7,250,3\ntime,speed,load\n0,30,900\n1,31,901\n', times=times_since_start(0, 1)
    ),
    'lines of another table above the headings': Log(
        ''.join(f'{k},1,2\n' for k in range(5, 10)) + 'time,speed,load\n0,30,900\n1,31,901\n',
        times=times_since_start(0, 1),
        lost="5 lines of another table above were not read, the first '5 1 2'",
    ),
    'a line whose time is a year ahead': Log(
        'time,speed,load\n' + ''.join(f'{k + 31536000 * (k == 3)},{30 + k},{900 + k}\n' for k in range(6)),
        times=times_since_start(*range(6)),
        speed=range(30, 36),
        load=range(900, 906),
        says='the clock of the lines leapt ahead and back: 1 time taken from those beside',
    ),
    'in no order of time': Log(
        'time,speed,load\n' + ''.join(f'{10 * k},{k},{900 + k}\n' for k in (3, 0, 5, 9, 1, 7, 4, 8, 2, 6)),
        times=times_since_start(*range(0, 100, 10)),
        speed=range(10),
        load=range(900, 910),
        says='the lines are in no order of time: sorted by time',
    ),
    'comments': Log('# made by hand\n# time,speed,load\n0,30,900\n1,31,901\n', times=times_since_start(0, 1)),
    'the separator named for spreadsheets': Log('sep=;\ntime;speed;load\n~0;30;900\n~1;31;901\n'),
    'newest first': Log(
        'time,speed,load\n@2,32,902\n@1,31,901\n@0,30,900\n',
        times=times_after_start(0, 1, 2),
        speed=[30, 31, 32],
        load=[900, 901, 902],
        says='the lines are in no order of time: sorted by time',
    ),
    'UTF-16 with its mark': Log('time\tspeed\tload\r\n@0\t30\t900\r\n@1\t31\t901\r\n', encoding='utf-16'),
    'UTF-16 without its mark': Log(
        'time\tspeed\tload\r\n@0\t30\t900\r\n@1\t31\t901\r\n',
        lost='the file has 75 zero bytes, which are no text',
        encoding='utf-16-le',
    ),
    'UTF-16 of the other order': Log(
        '\ufefftime\tspeed\tload\n@0\t30\t900\n@1\t31\t901\n', encoding='utf-16-be'
    ),
    'Windows-1252': Log(
        'Zeit;Wellendrehzahl, rückwärts [rpm];Last [N]\n~0;30;900\n~1;31;901\n',
        says='Windows-1252',
        encoding='cp1252',
    ),
    'gzip': Log(gzip.compress(b'time,speed,load\n0,30,900\n1,31,901\n'), times=times_since_start(0, 1)),
    'long, names in turn': Log('time,tag,value\n@0,speed,30\n@0,load,900\n@1,speed,31\n@1,load,901\n'),
    'long, one name after the other': Log(
        'time,tag,value,unit\n@0,n,30,rpm\n@1,n,31,rpm\n@0,F,0.9,kN\n@1,F,1.1,kN\n', load=[900, 1100]
    ),
    'one value a line, one in a unit of something else': Log(
        'time,tag,value,unit\n@0,n,30,rpm\n@0,F,0.9,kN\n@1,n,31,rpm\n@1,F,5,bar\n',
        load=[900, NAN],
        says="'F' changes its unit: lines in bar are left out",
    ),
    'one value a line, units that change': Log(
        'time,tag,value,unit\n@0,n,30,rpm\n@0,F,0.9,kN\n@1,n,0.5,Hz\n@1,F,1100,N\n@2,n,31,rpm\n@2,F,2,\n',
        times=times_after_start(0, 1, 2),
        speed=[30, 30, 31],
        load=[900, 1100, 2000],
        says="'F' changes its unit: lines in N are converted to kN",
    ),
    'InfluxDB, annotated': Log(
        '#group,false,false,true,true,false,false,true\r\n'
        '#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string\r\n'
        '#default,_result,,,,,,\r\n,result,table,_start,_stop,_time,_value,_field\r\n'
        ',,0,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,@0,30,speed\r\n'
        ',,0,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,@1,31,speed\r\n'
        ',,1,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,@0,900,load\r\n'
        ',,1,2026-04-13T09:00:00Z,2026-04-13T11:00:00Z,@1,901,load\r\n'
    ),
    'long, a name with hundreds of lines after another': Log(
        'time,tag,value\n'
        + ''.join(
            f'{second},{tag},{first + second}\n'
            for tag, first in (('speed', 30), ('load', 900))
            for second in range(300)
        ),
        times=times_since_start(*range(300)),
        speed=range(30, 330),
        load=range(900, 1200),
    ),
    'long, a clock that is set back': Log(
        'time,tag,value\n'
        + ''.join(
            f'{second},{tag},{second}\n' for second in (100, 101, 102, 2, 3, 4) for tag in ('speed', 'load')
        ),
        times=times_since_start(*range(100, 106)),
        speed=[100, 101, 102, 2, 3, 4],
        load=[100, 101, 102, 2, 3, 4],
        says='set back once',
    ),
    'the mark of a comment before blanks and headings': Log(
        '# t[s]  n[1/min]   F[kN]\n  0.0   30.0   0.9\n  1.0   31.0   1.1\n',
        times=times_since_start(0, 1),
        load=[900, 1100],
    ),
    'knots beside a load in small letters': Log(
        'time,speed (kn),shaft_rpm,load_kn\n0,12,30,0.9\n1,12,31,1.1\n',
        times=times_since_start(0, 1),
        load=[900, 1100],
    ),
    'NMEA 0183': Log(
        '2026-04-13T10:00:00.000Z $IIRPM,S,1,30.0,,A*5D\n'
        '@0 $IIXDR,N,900.0,N,LOAD*6F\n'
        '2026-04-13T10:00:01.000Z $IIRPM,S,1,31.0,,V*4B\n'
        '@1 $IIXDR,N,901.0,N,LOAD*6E\n',
        speed=[30, NAN],
    ),
    'NMEA 0183: without the pitch, and without a status': Log(
        '@0 $IIRPM,S,1,30.0,A*71\n'
        '@0 $IIXDR,N,900.0,N,LOAD*6F\n'
        '@1 $IIRPM,S,1,31.0,V*67\n'
        '@1 $IIXDR,N,901.0,N,LOAD*6E\n'
        '@2 $IIRPM,S,1,32.0*1E\n'
        '@2 $IIXDR,N,902.0,N,LOAD*6D\n',
        times=times_after_start(0, 1, 2),
        speed=[30, NAN, NAN],
        load=[900, 901, 902],
    ),
    'Signal K': Log(
        '{"updates":[{"timestamp":"2026-04-13T10:00:00.000Z","values":['
        '{"path":"propulsion.port.revolutions","value":0.5},'
        '{"path":"propulsion.port.shaft.load","value":900}]}]}\n'
        '{"updates":[{"timestamp":"2026-04-13T10:00:01.000Z","values":['
        '{"path":"propulsion.port.revolutions","value":0.75},'
        '{"path":"propulsion.port.shaft.load","value":901}]}]}\n',
        speed=[30, 45],
    ),
    'blanks': Log(
        '  0.0   30.0   900\n  1.0   31.0   901\n  2.0   32.0   902\n',
        times=times_since_start(0, 1, 2),
        speed=[30, 31, 32],
        load=[900, 901, 902],
    ),
    'a zero byte': Log(
        b'time,speed,load\n0,30,900\n1,3\x001,901\n', times=times_since_start(0, 1), lost='1 zero byte'
    ),
    'a second heading': Log(
        'time,speed,load\n0,30,900\ntime,speed,load\n1,31,901\n',
        times=times_since_start(0, 1),
        says='the headings come 1 time more in the middle',
    ),
    'a line without a time': Log(
        'time,speed,load\n0,30,900\n?,31,901\n2,32,902\n',
        times=times_since_start(0, 2),
        speed=[30, 32],
        load=[900, 902],
        lost="1 line without a time was not used, the first '?'",
    ),
    'a last line that is cut': Log(
        'time,speed,load\n0,30,900\n1,31,901\n2,32',
        times=times_since_start(0, 1),
        lost='1 line damaged, or of too few or too many cells was not used',
    ),
    'a clock that is set back': Log(
        'time,speed,load\n100,30,900\n101,31,901\n102,32,902\n2,33,903\n3,34,904\n4,35,905\n',
        times=times_since_start(100, 101, 102, 103, 104, 105),
        speed=range(30, 36),
        load=range(900, 906),
        says='set back once, by 101 s',
    ),
    'Campbell TOA5: rows of units and of what was averaged': Log(
        '"TOA5","Stern","CR1000X","1234","OS5","CPU:s.CR1X","61234","Fast"\n'
        '"TIMESTAMP","RECORD","ShaftRPM_Avg","Brg_Avg"\n"TS","RN","rpm","kN"\n"","","Avg","Avg"\n'
        '"~0",0,30,1.5\n"~1",1,31,1.6\n',
        load=[1500, 1600],
    ),
    'LabVIEW LVM: numbers in its preamble': Log(
        'LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n'
        'Samples\t2\t2\t\nDate\t2026/04/13\t2026/04/13\t\nTime\t10:00:00.0\t10:00:00.0\t\nY_Unit_Label\trpm\tkN\t\n'
        'X_Dimension\tTime\tTime\t\nX0\t0.0E+0\t0.0E+0\t\nDelta_X\t1.0\t1.0\t\n***End_of_Header***\t\t\t\n'
        'X_Value\tShaft speed\tBearing load\tComment\n0.0\t30.0\t1.5\t\n1.0\t31.0\t1.6\t\n',
        times=times_since_start(0, 1),
        load=[1500, 1600],
    ),
    'one heading above a date and its time': Log(
        'time       rpm  torque load\n~0  30.0  5  900\n~1  31.0  5  901\n'
    ),
    'blanks in place of a cell': Log(
        'time       rpm  torque load\n~0  30.0  5  900\n~1  31.0  5  901\n~2  5  902\n~3  32.0  5  903\n',
        times=times_after_start(0, 1, 3),
        speed=(30, 31, 32),
        load=(900, 901, 903),
        lost='1 line damaged, or of too few or too many cells was not used',
    ),
    'SQL Server: a line below the headings': Log('time,rpm,load\n----,---,----\n~0,30,900\n~1,31,901\n'),
    'Markdown': Log('| time | rpm | load |\n|---|---|---|\n| ~0 | 30 | 900 |\n| ~1 | 31 | 901 |\n'),
    'LabVIEW LVM: rows without the remark': Log(
        'LabVIEW Measurement\t\nX_Columns\tOne\nDate\t2026/04/13\n***End_of_Header***\t\t\t\n'
        'Channels\t2\t\t\nSamples\t9\t9\t\nDate\t2026/04/13\t2026/04/13\t\nTime\t10:00:00\t10:00:00\t\n'
        'X_Dimension\tTime\tTime\t\nX0\t0.0\t0.0\t\nDelta_X\t1.0\t1.0\t\n***End_of_Header***\t\t\t\n'
        'X_Value\tSpeed\tLoad\tComment\n' + ''.join(f'{k}.00\t{30 + k}.0\t{900 + k}.0\n' for k in range(9)),
        times=times_since_start(*range(9)),
        speed=range(30, 39),
        load=range(900, 909),
        says='4 headings stand above 3 cells',
    ),
    'LabVIEW LVM: a remark in the last column, decimal commas': Log(
        'LabVIEW Measurement\t\nDate\t2026/04/13\n***End_of_Header***\t\t\t\nChannels\t2\t\t\n'
        'Samples\t2\t2\t\nDate\t2026/04/13\t2026/04/13\t\nTime\t10:00:00,5\t10:00:00,5\t\nX_Dimension\tTime\tTime\t\nX0\t0,0\t0,0\t\n'
        'Delta_X\t0,5\t0,5\t\n***End_of_Header***\t\t\t\nX_Value\tShaft speed [rpm]\tLoad [N]\tComment\n'
        '0,0\t30,0\t900,0\t\n0,5\t31,0\t901,0\t\n',
        times=times_since_start(0, 0.5),
    ),
    'MATLAB: the mark of a comment before the headings, and units': Log(
        '% test 4\n% time rpm load\n% s rpm kN\n0 30 0.9\n1 31 0.901\n', times=times_since_start(0, 1)
    ),
    'HOBO: units behind commas, the zone in the heading': Log(
        '\ufeff"Plot Title: Stern"\n"#","Date Time, GMT+02:00","Shaft Speed, RPM (LGR S/N: 2)",'
        '"Load, kN (LGR S/N: 2)","Stopped (LGR S/N: 2)"\n1,04/13/26 12:00:00 PM,30,1.5,\n'
        '2,04/13/26 12:00:01 PM,31,1.6,\n3,04/13/26 12:00:02 PM,,,Logged\n',
        load=[1500, 1600],
    ),
    'Graphtec: names of channels, blanks behind signs': Log(
        'Model,GL840\nStart time,2026-04-13,10:00:00\nCH,Signal,Input,Range,Filter,Span\n'
        'CH1,RPM,DC,10V,0.0,100.0,rpm\nCH2,Load,DC,10V,0.0,100.0,kN\nLogic,Off\n'
        'Number,Date&Time,ms,CH1,CH2,Alarm\nNO.,Time,ms,rpm,kN,A12\n'
        '1,~0,0,+ 30.0,+ 1.5,LLL\n2,~1,0,+ 31.0,+ 1.6,LLL\n',
        load=[1500, 1600],
    ),
    'WinCC: names and values, status lines': Log(
        '"VarName";"TimeString";"VarValue";"Validity"\n'
        '"Shaft_RPM";"13.04.2026 10:00:00";30,0;1\n"Brg_kN";"13.04.2026 10:00:00";1,5;1\n'
        '"Shaft_RPM";"13.04.2026 10:00:01";31,0;1\n"Brg_kN";"13.04.2026 10:00:01";1,6;1\n'
        '"$RT_OFF$";"13.04.2026 10:00:02";0;2\n"$RT_COUNT$";5;;\n',
        load=[1500, 1600],
    ),
    **{
        name: Log(
            '\n'.join(
                [heading]
                + [
                    row.format(time=f'@{k}', n=f'{quantity}{unit}', value=value)
                    for k in (0, 1)
                    for quantity, unit, value in (('speed', ' rpm', 30 + k), ('load', ' N', 900 + k))
                ]
                + ['']
            )
        )
        for name, heading, row in (
            ('PI Web API', 'Name,Timestamp,UnitsAbbreviation,Good,Value', '{n},{time},,True,{value}'),
            ('PONTOS', 'time,parameter_id,value', '{time},{n},{value}'),
            ('a historian of tags', 'DateTime,TagName,TagVal,TagQuality', '{time},{n},{value},Good'),
            ('K-Chief', 'Time;Tag;Description;Value;State', '{time};{n};SHAFT;{value};NORMAL'),
            ('Home Assistant', 'entity_id,state,last_changed', '{n},{value},{time}'),
            ('Prometheus', 'series,timestamp,value', '{n},{time},{value}'),
            ('MQTT', 'time;topic;payload', '{time};{n};{value}'),
        )
    },
    'Grafana: units behind numbers': Log(
        '"Time","Shaft","Bearing"\n~0,30 rpm,1.5 kN\n~1,31 rpm,1.6 kN\n', load=[1500, 1600]
    ),
    'MATLAB timetable: a unit behind times': Log(
        'Time,Speed_rpm,Load_kN\n0 sec,30,1.5\n1 sec,31,1.6\n',
        times=times_since_start(0, 1),
        load=[1500, 1600],
    ),
    'PlotJuggler: fields behind topics': Log(
        '"__time","/shaft/speed/data","/bearing/aft_stern/load/data"\n'
        '1776074400.0,30,\n1776074400.0,,900\n1776074401.0,31,\n1776074401.0,,901\n'
    ),
    'Swiss thousands': Log(
        "time;speed;load\n~0;30.0;1'234.5\n~1;31.5;12'345.0\n", speed=[30, 31.5], load=[1234.5, 12345]
    ),
    'points that may part thousands': Log('time;speed;load\n~0;30;1.234\n~1;31;1.235\n', load=[1.234, 1.235]),
    'a position north is no load': Log(
        'time,rpm,lat,kN\n@0,30,51.5 N,1.5\n@1,31,51.5 N,1.6\n', load=[1500, 1600]
    ),
    'lines that end in three ways': Log('time,speed,load\r\n@0,30,900\r@1,31,901\n'),
    'no heading, a line without a time': Log(
        '@0,30,900\nrestarted,,\n@1,31,901\n',
        lost="1 line without a time was not used, the first 'restarted'",
    ),
    'words without a heading behind the last cell': Log(
        'time,speed,load\n0,30,900,ok\n10,31,901,ok\n', times=times_since_start(0, 10)
    ),
    'such words behind whole seconds': Log(
        'time,speed,load\n0,31,901,ok\n1,30,900,ok\n',
        times=times_since_start(0, 1),
        speed=[31, 30],
        load=[901, 900],
    ),
    'a number in the heading that is no factor': Log(
        'time,Aux 10 shaft [rpm],Max 10 min load [kN]\n0,30,0.9\n1,31,0.901\n', times=times_since_start(0, 1)
    ),
    'a delimiter behind the last cell of each row': Log(
        'time,speed,load\n0,30,900,\n1,31,901,\n', times=times_since_start(0, 1)
    ),
    'more headings than cells': Log(
        'time,speed,load,by,to\n' + ''.join(f'{k},{30 + k},{900 + k}\n' for k in range(9)),
        times=times_since_start(*range(9)),
        speed=range(30, 39),
        load=range(900, 909),
        says='5 headings stand above 3 cells: they were matched from the left',
    ),
    'K-Chief: a preamble filled up, with the times of the export': Log(
        'Trend export;;;\nVessel;Test;;\nFrom;13.04.2026 10:00:00;;\nTo;13.04.2026 10:00:01;;\n;;;\n'
        'Time;SPEED;LOAD;PITCH\n;rpm;kN;%\n'
        '13.04.2026 10:00:00;30,0;0,9;72,5\n13.04.2026 10:00:01;31,0;0,901;72,5\n'
    ),
    'DIAdem: the form of the time among the units': Log(
        'Time;Shaft_Speed;Load\nyyyy-mm-dd hh:nn:ss.fff;1/min;kN\n~0.000;30,0;0,9\n~1.000;31,0;0,901\n'
    ),
    'NMEA 0183 between the names of instruments': Log(
        ''.join(
            f'NAV 2026/04/13 10:00:0{k}.000 SHAFT {nmea_sentence(f"ERRPM,S,1,{30 + k},0,A")}\n'
            f'NAV 2026/04/13 10:00:0{k}.000 BRG {nmea_sentence(f"ERXDR,N,{900 + k},N,LOAD")}\n'
            for k in range(2)
        )
    ),
    'NMEA 0183 behind cells in quotation marks': Log(
        ''.join(
            f'"13/04/2026 10:00:0{k}";"COM3";"{nmea_sentence(body)}"\n'
            for k in range(2)
            for body in (f'ERRPM,S,1,{30 + k},0,A', f'ERXDR,N,{900 + k},N,LOAD')
        )
    ),
    'no heading, a status in words': Log(
        '@0,RUN,30\n@1,RUN,31\n@2,STOP,32\n@3,STOP,33\n',
        times=times_after_start(0, 1, 2, 3),
        speed=[30, 31, 32, 33],
        load=[30, 31, 32, 33],
    ),
    'names and states beside columns of numbers': Log(
        'time,name,state,speed,load\n0,ME1,RUN,30,900\n1,ME1,RUN,31,901\n', times=times_since_start(0, 1)
    ),
    'letters in a preamble at which no line ends': Log(
        'Made by\x0cLogger\u2028of\x85Works,1\ntime,speed,load\n0,30,900\n1,31,901\n2,32,902\n',
        times=times_since_start(0, 1, 2),
        speed=[30, 31, 32],
        load=[900, 901, 902],
    ),
    'a second logger with other columns behind the first': Log(
        'time,speed [rpm],load [kN]\n0,30,1.5\n1,31,1.6\ntime,temp,load [kN],speed [rpm]\n2,9,1.7,32\n',
        times=times_since_start(0, 1, 2),
        speed=[30, 31, 32],
        load=[1500, 1600, 1700],
        says='the headings come 1 time more',
    ),
    'a second logger with the load in another unit': Log(
        'time,speed [rpm],load [kN]\n0,30,1.5\n1,31,1.6\ntime,speed [rpm],load [lbf]\n2,32,9\n3,33,9\n',
        times=times_since_start(0, 1),
        load=[1500, 1600],
        lost="2 lines under other headings ('time, speed [rpm], load [lbf]') were not used",
    ),
    'another logger with another delimiter before the last': Log(
        'Date;Drehzahl rpm;Last (kN)\n'
        + ''.join(f'2026-04-13T10:00:0{k};{k};1,5\n' for k in range(5))
        + 'time,speed [rpm],load [kN]\n'
        + ''.join(f'{k},{30 + k},1.5\n' for k in range(20)),
        times=times_since_start(*range(20)),
        speed=range(30, 50),
        load=[1500] * 20,
        lost="5 lines of another table above were not read, the first '2026-04-13T10:00:00 0 1,5'",
    ),
    'ISO 19848: local IDs, a turbocharger beside': Log(
        'TimeStamp,/dnv-v2/vis-3-4a/411.1/C101.663i/C663/meta/qty-rotational.frequency,'
        '/dnv-v2/vis-3-4a/411.1/C101.31/meta/qty-rotational.frequency,/dnv-v2/vis-3-4a/412.7/C322/meta/qty-force\n'
        '2026-04-13T10:00:00.000Z,9000,30,900\n2026-04-13T10:00:01.000Z,9001,31,901\n',
        says='as aft_stern.speed.unit says',
    ),
    'NMEA 0183: the times of RMC': Log(
        '$GPRMC,100000.00,A,5300.0,N,01000.0,E,12.0,90.0,130426,,,A*50\n'
        '$IIRPM,S,1,30.0,,A*5D\n'
        '$IIXDR,N,900.0,N,LOAD*6F\n'
        '$GPRMC,100000.00,V,,,,,,,060180,,,N*73\n'
        '$GPRMC,100001.00,A,5300.0,N,01000.0,E,12.0,90.0,130426,,,A*51\n'
        '$IIRPM,S,1,31.0,,A*5C\n'
        '$IIXDR,N,901.0,N,LOAD*6E\n'
    ),
    'NMEA 0183: times of the day alone': Log(
        ''.join(
            f'10:00:0{k}.000 {nmea_sentence(f"IIRPM,S,0,{30 + k},,A")}\n'
            f'10:00:0{k}.000 {nmea_sentence(f"IIXDR,N,{900 + k},N,load")}\n'
            for k in (0, 1)
        ),
        times=times_since_start(36000, 36001),
    ),
    'NMEA 0183: times of two kinds': Log(
        '@0 $ERRPM,S,1,30,10.5,A*4E\n@0 $ERXDR,N,900,N,load*66\n'
        '@1 $ERRPM,S,1,31,10.5,A*4F\n@1 $ERXDR,N,901,N,load*67\n'
        '1776074402 $ERRPM,S,1,32,10.5,A*4C\n',
        lost='1 line damaged, or without a time was not used',
    ),
    'Signal K: units by the meta data': Log(
        '{"updates":[{"meta":[{"path":"shaft.load","value":{"units":"kN"}},{"path":"x","value":{}}]}]}\n'
        + ''.join(
            f'{{"updates": [{{"timestamp": "2026-04-13T10:00:0{k}Z", "values": ['
            f'{{"path": "shaft.revolutions", "value": 0.5}}, {{"path": "shaft.load", "value": 1.{k}}}]}}]}}\n'
            for k in range(2)
        ),
        speed=[30, 30],
        load=[1000, 1100],
    ),
    'Signal K: a time that is a number': Log(
        ''.join(
            f'{{"updates": [{{"timestamp": {time}, "values": [{{"path": "shaft.revolutions", "value": {n}}},'
            f' {{"path": "shaft.load", "value": {load}}}]}}]}}\n'
            for time, n, load in (('"@0"', 0.5, 900), (1776074400, 0.75, 9), ('"@1"', 0.52, 901))
        ),
        speed=[30, 31.2],
        lost='1 line damaged, or without a time was not used',
    ),
}
# Columns that nothing names are given.
COLUMNS = {
    'no heading': ('#2', '#3'),
    'words of quality beside columns by their places': ('#2', '#4'),
    'sets, rates of revolution and pitch propellers': ('#2', ''),
    'Windows-1252': ('#2', ''),
    'units behind underscores': ('ME1_RPM', ''),
    'Graphtec: names of channels, blanks behind signs': ('CH1', 'CH2'),
    'a number in the heading that is no factor': ('#2', '#3'),
    'ISO 19848: local IDs, a turbocharger beside': (
        '/dnv-v2/vis-3-4a/411.1/C101.31/meta/qty-rotational.frequency',
        '/dnv-v2/vis-3-4a/412.7/C322/meta/qty-force',
    ),
    'no heading, a line without a time': ('#2', '#3'),
    'no heading, a status in words': ('#3', '#3'),
    'blanks': ('#2', '#3'),
    'comments': ('speed', 'load'),
    'NMEA 0183: ZDA, and another receiver with a date of 1024 weeks ago': ('RPM S 01', 'LOAD'),
    'long, one name after the other': ('n', 'F'),
}


def open_log(folder: Path, data: str | bytes) -> TableRecording:
    """Open a log of some text."""
    (folder / 'voyage.csv').write_bytes(Log(data).raw)
    recording = open_bag(folder / 'voyage.csv')
    assert isinstance(recording, TableRecording)
    return recording
