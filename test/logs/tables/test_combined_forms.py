# SPDX-License-Identifier: Apache-2.0
"""Logs of every combination of forms are read right, asked about or refused; never read wrong without a word.

The values and times are those from which each text is written.
"""

from __future__ import annotations

import random
import re
from datetime import datetime, timedelta, timezone
from math import sin
from pathlib import Path

import numpy as np
import pytest
from nasty_logs import open_log

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.recording import Request

STARTS = [datetime(2026, 5, 4, 6), datetime(2026, 5, 14, 23, 58), datetime(2026, 12, 31, 23, 59, 30)]
DAY_ZERO = datetime(1899, 12, 30)
# Cells of a time, by their headings: of the date and time, and of the seconds since the first one.
TIMES = {
    'iso': ('time', lambda t, s: f'{t:%Y-%m-%dT%H:%M:%S.%f}Z'),
    'german': ('Zeit', lambda t, s: f'{t:%d.%m.%Y %H:%M:%S.%f}'),
    'english': ('Time', lambda t, s: f'{t:%d/%m/%Y %H:%M:%S.%f}'),
    'american': ('Time', lambda t, s: f'{t:%m/%d/%Y %I:%M:%S.%f %p}'),
    'short': ('Time', lambda t, s: f'{t:%y-%m-%d %H:%M:%S.%f}'),
    'month': ('Timestamp', lambda t, s: f'{t:%d-%b-%Y %H:%M:%S.%f}'),
    'digits': ('time', lambda t, s: f'{t:%Y%m%d%H%M%S.%f}'),
    'day of year': ('time', lambda t, s: f'{t:%Y:%j:%H:%M:%S.%f}'),
    'of the day': ('time', lambda t, s: f'{t:%H:%M:%S.%f}'),
    'since 1970': ('Timestamp', lambda t, s: f'{t.replace(tzinfo=timezone.utc).timestamp():.3f}'),
    'milliseconds': ('time_ms', lambda t, s: f'{s * 1000:.0f}'),
    'seconds': ('t', lambda t, s: f'{s:.3f}'),
    'seconds of hours ago': ('Timestamp', lambda t, s: f'{30_000 + s:.3f}'),
    'days': ('Time', lambda t, s: f'{(t - DAY_ZERO) / timedelta(days=1):.10f}'),
    'parts': ('year,month,day,hour,minute,second', lambda t, s: f'{t:%Y,%m,%d,%H,%M,%S.%f}'),
    'parts of a year': ('year,jday,hour,min,sec', lambda t, s: f'{t:%Y,%j,%H,%M,%S.%f}'),
    'two columns': ('date,time', lambda t, s: f'{t:%d.%m.%Y,%H:%M:%S.%f}'),
}
UNITS = [('rpm', 1.0), ('Hz', 1 / 60), ('kN', 1e-3), ('MN', 1e-6)]


def write_number(value: float, decimal: str, group: str, digits: int) -> str:
    text = f'{value:,.{digits}f}'
    return text.replace(',', '\0').replace('.', decimal).replace('\0', group)


def write_log(seed: int) -> tuple[str, list[float], list[tuple[float, float]]]:
    """Return a log, and the seconds and the values [rpm, N] that it holds."""
    draw = random.Random(seed)
    heading, write_time = TIMES[draw.choice([*TIMES])]
    delimiter, every = draw.choice(',;\t|'), draw.choice([0.02, 0.05, 0.1, 0.5, 1, 2, 10, 60])
    decimal = '.' if delimiter == ',' else draw.choice('.,')
    group = draw.choice(['', '', ' ', "'", ',' if decimal == '.' else '.'])
    (turns, per_rpm), (force, per_newton) = draw.choice(UNITS[:2]), draw.choice(UNITS[2:])
    digits, base = draw.choice([2, 3, 4]), draw.choice([900.0, 12_345.0, 234_567.0])
    names, units = [*heading.split(','), 'speed', 'load'], ['', turns, force]
    lines = draw.choice([[], ['Logger 4711'], ['# export', '']])
    if draw.random() < 0.5:
        names[-2:] = f'speed [{turns}]', f'load [{force}]'
        lines.append(delimiter.join(names))
    else:
        lines += [delimiter.join(names), delimiter.join(units[:1] * (len(names) - 2) + units[1:])]
    start, seconds, values = draw.choice(STARTS), [], []
    for k in range(draw.choice([30, 130, 700])):
        turning = write_number((80 + 5 * sin(k / 50)) * per_rpm, '.', '', digits + 1)
        loaded = write_number(base * (1 + 0.02 * sin(k / 7)) * per_newton, '.', '', digits + 4)
        cells = write_time(start + timedelta(seconds=every * k), every * k).split(',')
        if decimal == ',':
            cells = [re.sub(r'^(\d+)\.(\d+)$', r'\1,\2', cell) for cell in cells]
        cells += [write_number(float(turning), decimal, group, digits + 1)]
        cells += [write_number(float(loaded), decimal, group, digits + 4)]
        lines.append(delimiter.join(f'"{cell}"' if delimiter in cell else cell for cell in cells))
        seconds.append(every * k)
        values.append((float(turning) / per_rpm, float(loaded) / per_newton))
    return '\n'.join(lines) + '\n', seconds, values


@pytest.mark.parametrize('seed', range(100))
def test_no_combination_is_misread_without_a_warning(seed: int, tmp_path: Path) -> None:
    text, seconds, values = write_log(seed)
    try:
        recording = open_log(tmp_path, text)
    except BagError:
        return
    columns = [c for c in recording.all_columns if c.heading.startswith(('speed', 'load'))]
    series = [*recording.read([Request(c.heading, 'data') for c in columns]).values()]
    factors = [1 / dict(UNITS)[column.unit or ''] for column in columns]
    is_right = all(column_series.value.size == len(seconds) for column_series in series) and all(
        np.allclose(column_series.value * factor, [pair[k] for pair in values], rtol=1e-9)
        and np.abs((column_series.stamp_ns - column_series.stamp_ns[0]) * 1e-9 - seconds).max() < 2e-3
        for k, (column_series, factor) in enumerate(zip(series, factors, strict=True))
    )
    assert is_right or recording.table.clocks[0].question or recording.losses
