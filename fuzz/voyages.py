# SPDX-License-Identifier: Apache-2.0
"""A voyage with stick-slip in every format, and how much of it a mutant still holds.

A mutant that holds the stick-slip and whose check is an all-clear has lost its warnings without a word.
"""

from __future__ import annotations

import functools
import io
import json
import math
import struct
import tempfile
from codecs import BOM_UTF16
from collections import defaultdict
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
import zstandard

from fuzz.files import DEFINITIONS, MAGIC, START, TOPICS, Piece, file, message
from fuzz.logs import database_of, sentence_of
from fuzz.oracle import messages_of, rows_of
from fuzz.rewriting import pack_in_all_ways, unpack_text

_SECOND = 10**9
_LOAD_N = 1000.0
# Of 30 s the last 20 at 6 rpm, far below the fold of the reference bearing; more would take longer.
_COUNT, _QUIET = 30, 10
STICKING_RPM = [60.0 + 0.01 * k if k < _QUIET else 6.0 + 0.001 * k for k in range(_COUNT)]
_STAMPS = [
    datetime.fromtimestamp(START // _SECOND + k, timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')
    for k in range(_COUNT)
]
QUIET_RPM = [60.0 + 0.01 * k for k in range(_COUNT)]
"""Speeds of the same voyage without stick-slip, whose check is an all-clear."""


class Sample(NamedTuple):
    """A number of an input (0 speed, 1 load): its time and its tenths."""

    place: int
    time_ns: int
    tenths: int


def _make_tables(speeds: Sequence[float]) -> list[bytes]:
    wide = 'time,shaft speed [rpm],bearing load [N]\n' + ''.join(
        f'{t},{v:.3f},{_LOAD_N}\n' for t, v in zip(_STAMPS, speeds, strict=True)
    )
    long = 'time,name,value,unit\n' + ''.join(
        f'{t},shaft speed,{v:.3f},rpm\n{t},bearing load,{_LOAD_N},N\n'
        for t, v in zip(_STAMPS, speeds, strict=True)
    )
    german = 'Zeit;Öltemperatur [°C];Wellendrehzahl [1/min];Lagerkraft [kN]\n' + ''.join(
        f'{t[8:10]}.{t[5:7]}.{t[:4]} {t[11:19]};40,5;{v:.3f};{_LOAD_N / 1e3:.3f}\n'.replace('.', ',').replace(
            ',', '.', 2
        )
        for t, v in zip(_STAMPS, speeds, strict=True)
    )
    # Days of a spreadsheet, and seconds since 1970: no damaged one tells what the others are.
    days, seconds = (
        'time;shaft speed [rpm];bearing load [N]\n'
        + ''.join(f'{form(k)};{v:.3f};{_LOAD_N}\n' for k, v in enumerate(speeds))
        for form in (lambda k: f'{46146.25 + k / 86_400:.9f}', lambda k: str(START // _SECOND + k))
    )
    texts = (
        wide,
        wide.replace(',', ';').replace('.', ','),
        long,
        german,
        wide.replace(',', '\t'),
        days,
        seconds,
    )
    return [*(text.encode() for text in (*texts, days, seconds)), wide.encode('utf-16')]


def _make_parquets(speeds: Sequence[float]) -> list[bytes]:
    times = pa.array([START + k * _SECOND for k in range(_COUNT)], pa.timestamp('ns', 'UTC'))
    table = pa.table({'time': times, 'shaft speed [rpm]': speeds, 'bearing load [N]': [_LOAD_N] * _COUNT})
    files = []
    for size in (_COUNT, 8):
        out = io.BytesIO()
        pq.write_table(table, out, row_group_size=size)
        files.append(out.getvalue())
    return files


def _nmea_logs(speeds: Sequence[float]) -> list[bytes]:
    bodies = [(f'ERRPM,S,1,{v:.3f},10.5,A', f'IIXDR,N,{_LOAD_N},N,bearing load') for v in speeds]
    iso = [f'{t} {sentence_of(body)}' for t, pair in zip(_STAMPS, bodies, strict=True) for body in pair]
    zda = [
        sentence_of(body)
        for t, pair in zip(_STAMPS, bodies, strict=True)
        for body in (f'GPZDA,{t[11:13]}{t[14:16]}{t[17:19]}.00,{t[8:10]},{t[5:7]},{t[:4]},00,00', *pair)
    ]
    tagged = [
        f'\\c:{START // _SECOND + k}*00\\{sentence_of(body)}'
        for k, pair in enumerate(bodies)
        for body in pair
    ]
    return ['\r\n'.join([*lines, '']).encode() for lines in (iso, zda, tagged)]


def _signalk_logs(speeds: Sequence[float]) -> list[bytes]:
    def delta(stamp: str, path: str, value: float) -> str:
        update = {'$source': 'n2k.1', 'timestamp': stamp, 'values': [{'path': path, 'value': value}]}
        return json.dumps({'context': 'vessels.self', 'updates': [update]})

    lines = [
        text
        for t, v in zip(_STAMPS, speeds, strict=True)
        for text in (
            delta(t, 'propulsion.0.revolutions', round(v / 60, 6)),
            delta(t, 'propulsion.0.bearing.load', _LOAD_N),
        )
    ]
    logged = [f'{START // 10**6 + k // 2 * 1000};N;{line}' for k, line in enumerate(lines)]
    return ['\n'.join([*texts, '']).encode() for texts in (lines, logged)]


def _canboat_logs(speeds: Sequence[float]) -> list[bytes]:
    lines = [
        json.dumps(
            {
                'timestamp': t,
                'prio': 2,
                'src': 16,
                'dst': 255,
                'pgn': 127488,
                'description': 'Engine Parameters, Rapid Update',
                'fields': {'Instance': 0, 'Speed': round(v, 3)},
            }
        )
        for t, v in zip(_STAMPS, speeds, strict=True)
    ]
    return ['\n'.join([*lines, '']).encode()]


def _make_databases(speeds: Sequence[float]) -> list[bytes]:
    rows = [
        (START + k * _SECOND, number, value)
        for k, v in enumerate(speeds)
        for number, value in ((1, v), (2, _LOAD_N))
    ]
    return [database_of(page, rows) for page in (512, 4096)]


def _make_mcaps(speeds: Sequence[float]) -> list[bytes]:
    records = [
        message(number, START + k * _SECOND, value)
        for k, v in enumerate(speeds)
        for number, value in ((1, v), (2, _LOAD_N))
    ]
    return [
        file(
            [
                Piece([*DEFINITIONS, *records[:20]], packing),
                *(Piece(records[k : k + 10], packing) for k in (20, 30, 40, 50)),
            ],
            summary=summary,
        )
        for packing in ('', 'zstd', 'lz4')
        for summary in (True, False)
    ]


def _pack_voyages(speeds: Sequence[float]) -> list[bytes]:
    plain = _make_tables(speeds)[0], _make_mcaps(speeds)[0], _make_databases(speeds)[0]
    # Of recordings a whole file is packed by zstd only.
    return [*pack_in_all_ways(plain[0]), *map(zstandard.compress, plain[1:])]


def _candump_logs(speeds: Sequence[float]) -> list[bytes]:
    """Frames of NMEA 2000 of an engine, as candump, a gateway and canboat log them."""
    frames = [b'\0' + round(4 * v).to_bytes(2, 'little') + b'\xff' * 5 for v in speeds]
    lines = [
        (
            f'({START // _SECOND + k}.000000) can0 09F20010#{frame.hex().upper()}',
            f'{t[11:19]}.000 R 09F20010 {frame.hex(" ").upper()}',
            f'{t[:19]}.000Z,2,127488,16,255,8,{frame.hex(",")}',
        )
        for k, (t, frame) in enumerate(zip(_STAMPS, frames, strict=True))
    ]
    return ['\n'.join([*texts, '']).encode() for texts in zip(*lines, strict=True)]


VOYAGES: dict[str, Callable[[Sequence[float]], list[bytes]]] = {
    'mcap': _make_mcaps,
    'db3': _make_databases,
    'csv': _make_tables,
    'parquet': _make_parquets,
    'nmea': _nmea_logs,
    'signalk': _signalk_logs,
    'canboat': _canboat_logs,
    'candump': _candump_logs,
    'packed': _pack_voyages,
}
"""Makers of a voyage of 30 speeds [rpm], one a second, in several writings; by the ending of their names."""


def samples_in(path: Path, kind: str, speeds: Sequence[float]) -> tuple[set[Sample], float]:
    """Return the samples of a voyage that a mutant holds as they were, and how many others it may hold.

    Another reader tells. In a text its lines do; none do where its heading is not as it was.
    """
    data, samples = path.read_bytes(), samples_of(speeds)
    if kind == 'packed':
        data, _ = unpack_text(data)
        with tempfile.NamedTemporaryFile() as plain:
            plain.write(data)
            plain.flush()
            inner = 'mcap' if data.startswith(MAGIC) else 'db3' if data.startswith(b'SQLite') else 'csv'
            return samples_in(Path(plain.name), inner, speeds)
    if kind in ('mcap', 'db3'):
        counts = messages_of(data) if kind == 'mcap' else rows_of(path)
        numbers = [
            Sample(TOPICS.index(topic), time_ns, number_key(*struct.unpack('<d', cdr[4:])))
            for topic, time_ns, cdr in counts
            if topic in TOPICS and cdr[:4] == b'\0\1\0\0' and len(cdr) == 12
        ]
        return samples.intersection(numbers), math.inf
    if kind == 'parquet':
        return samples & _samples_of_parquet(data), math.inf
    return max(
        (_samples_of_lines(data, lines) for lines in _sample_lines(kind, tuple(speeds))),
        key=lambda result: len(result[0]),
    )


def sticking_share(samples: set[Sample]) -> float:
    """Return how much of the stick-slip is among samples, from 0 to 1."""
    sticking = {sample for sample in samples_of(STICKING_RPM) if sample.time_ns >= START + _QUIET * _SECOND}
    return len(sticking & samples) / len(sticking)


def number_key(value: float) -> int:
    """Return the tenths of a number, the same for what rounding did to one of three digits."""
    return math.floor(10 * value + 0.003) if abs(value) < 1e15 else -1


def samples_of(speeds: Sequence[float]) -> set[Sample]:
    """Return the samples of a voyage of speeds [rpm]."""
    return {
        Sample(place, START + k * _SECOND, number_key(value))
        for k, speed in enumerate(speeds)
        for place, value in enumerate((speed, _LOAD_N))
    }


def _samples_of_parquet(data: bytes) -> set[Sample]:
    try:
        table = pq.read_table(io.BytesIO(data))
        times = table['time'].cast(pa.int64()).to_pylist()
        columns = (table['shaft speed [rpm]'].to_pylist(), table['bearing load [N]'].to_pylist())
    except Exception:  # What it raises on damage is not ours to judge.
        return set()
    return {
        Sample(place, time, number_key(value))
        for place, column in enumerate(columns)
        for time, value in zip(times, column, strict=True)
        if time is not None and value is not None
    }


class SampleLines(NamedTuple):
    """The lines of a text: its heading, and by line the second and the samples of each place of it.

    A line without samples gives the second of those behind it, if they have none of their own.
    """

    heading: bytes
    has_clock: bool
    samples: dict[bytes, list[tuple[int, list[Sample]]]]


@functools.cache
def _sample_lines(kind: str, speeds: tuple[float, ...]) -> list[SampleLines]:
    """Return the lines of the sources of a kind."""
    result = []
    for source in VOYAGES[kind](speeds):
        lines = source.split(b'\n')[:-1]
        has_heading, of_second = bool(len(lines) % _COUNT), len(lines) // _COUNT
        # Of a second one line has both numbers, or there is one for each, perhaps behind one with the time.
        places = {1: [(0, 1) if has_heading else (0,)], 2: [(0,), (1,)], 3: [(), (0,), (1,)]}[of_second]
        samples = defaultdict[bytes, list[tuple[int, list[Sample]]]](list)
        for number, line in enumerate(lines[has_heading:]):
            k, within = divmod(number, of_second)
            values = speeds[k], _LOAD_N
            samples[line].append(
                (k, [Sample(p, START + k * _SECOND, number_key(values[p])) for p in places[within]])
            )
        result.append(SampleLines(lines[0] if has_heading else b'', of_second == 3, samples))
    return result


def _samples_of_lines(text: bytes, source: SampleLines) -> tuple[set[Sample], float]:
    """Return the samples of the lines of a source in a text, and how many its other lines may have."""
    lines = text.split(b'\n')
    if source.heading and lines[0] != source.heading:
        return set(), math.inf
    # One byte more or less in UTF-16 makes other letters of what follows.
    if text.startswith(BOM_UTF16) and max(text.decode('utf-16', 'replace')) > '\u2fff':
        return set(), math.inf
    samples_held, other_count, clock = set[Sample](), 0, -1
    for line in lines:
        is_other = bool(line.strip()) and line != source.heading
        for second, samples in source.samples.get(line, ()):
            # A line without a time of its own may be of any second.
            if not source.has_clock or second == clock or not samples:
                is_other, clock = False, second
                samples_held.update(samples)
        # A line that was changed may still have a time.
        clock = -1 if is_other else clock
        other_count += is_other
    return samples_held, 2 * other_count
