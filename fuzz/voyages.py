# SPDX-License-Identifier: Apache-2.0
"""A voyage with stick-slip in every format, and how much of it a mutant still holds.

A mutant that holds the stick-slip and whose check is an all-clear has lost its warnings without a word.
"""

from __future__ import annotations

import io
import json
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from fuzz.files import DEFINITIONS, START, TOPICS, Piece, file, message
from fuzz.logs import database_of, sentence_of
from fuzz.oracle import messages_of, rows_of
from fuzz.rewriting import pack_in_all_ways, unpack_text

_SECOND = 10**9
_LOAD_N = 1000.0
# Of 60 s the last 40 at 6 rpm, far below the fold of the reference bearing.
STICKING_RPM = [60.0 + 0.01 * k if k < 20 else 6.0 + 0.001 * k for k in range(60)]
_STICKS = range(20, 60)
_STAMPS = [
    datetime.fromtimestamp(START // _SECOND + k, timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')
    for k in range(60)
]
QUIET_RPM = [60.0 + 0.01 * k for k in range(60)]
"""Speeds of the same voyage without stick-slip, whose check is an all-clear."""


def _with_packed(texts: list[bytes]) -> list[bytes]:
    """Return texts, and the first of them packed in each way."""
    return [*texts, *pack_in_all_ways(texts[0])]


def _make_tables(speeds: Sequence[float]) -> list[bytes]:
    wide = 'time,shaft speed [rpm],bearing load [N]\n' + ''.join(
        f'{t},{v:.3f},{_LOAD_N}\n' for t, v in zip(_STAMPS, speeds, strict=True)
    )
    long = 'time,name,value,unit\n' + ''.join(
        f'{t},shaft speed,{v:.3f},rpm\n{t},bearing load,{_LOAD_N},N\n'
        for t, v in zip(_STAMPS, speeds, strict=True)
    )
    texts = wide, wide.replace(',', ';').replace('.', ','), long
    return _with_packed([text.encode() for text in texts])


def _make_parquets(speeds: Sequence[float]) -> list[bytes]:
    times = pa.array([START + k * _SECOND for k in range(60)], pa.timestamp('ns', 'UTC'))
    table = pa.table({'time': times, 'shaft speed [rpm]': speeds, 'bearing load [N]': [_LOAD_N] * 60})
    files = []
    for size in (60, 15):
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
    return _with_packed(['\r\n'.join([*lines, '']).encode() for lines in (iso, zda)])


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
    return _with_packed(['\n'.join([*lines, '']).encode()])


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
    return _with_packed(['\n'.join([*lines, '']).encode()])


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
                Piece([*DEFINITIONS, *records[:40]], packing),
                *(Piece(records[k : k + 20], packing) for k in (40, 60, 80, 100)),
            ],
            summary=summary,
        )
        for packing in ('', 'zstd', 'lz4')
        for summary in (True, False)
    ]


VOYAGES: dict[str, Callable[[Sequence[float]], list[bytes]]] = {
    'mcap': _make_mcaps,
    'db3': _make_databases,
    'csv': _make_tables,
    'parquet': _make_parquets,
    'nmea': _nmea_logs,
    'signalk': _signalk_logs,
    'canboat': _canboat_logs,
}
"""Makers of a voyage of 60 speeds [rpm], one a second, in several writings; by the ending of their names."""


def sticking_share(path: Path, kind: str) -> float:
    """Return how much of the stick-slip a mutant holds as it was written, from 0 to 1.

    Another reader tells, or in a text the lines: 0 where its heading is not as it was.
    """
    data = path.read_bytes()
    if kind in ('mcap', 'db3'):
        samples = messages_of(data) if kind == 'mcap' else rows_of(path)
        sticking_samples = [
            (topic, START + k * _SECOND, b'\0\1\0\0' + struct.pack('<d', value))
            for k in _STICKS
            for topic, value in zip(TOPICS, (STICKING_RPM[k], _LOAD_N), strict=True)
        ]
        return sum(sample in samples for sample in sticking_samples) / len(sticking_samples)
    if kind == 'parquet':
        return _share_of_parquet(data)
    text, _ = unpack_text(data)
    return max(_share_of_lines(text, unpack_text(source)[0]) for source in VOYAGES[kind](STICKING_RPM))


def _share_of_parquet(data: bytes) -> float:
    try:
        table = pq.read_table(io.BytesIO(data))
        columns = (table['time'].cast(pa.int64()), table['shaft speed [rpm]'], table['bearing load [N]'])
        rows = set(zip(*(column.to_pylist() for column in columns), strict=True))
    except Exception:  # What it raises on damage is not ours to judge.
        return 0.0
    sticking_rows = [(START + k * _SECOND, STICKING_RPM[k], _LOAD_N) for k in _STICKS]
    return sum(row in rows for row in sticking_rows) / len(sticking_rows)


def _share_of_lines(text: bytes, source: bytes) -> float:
    lines, source_lines = Counter(text.splitlines()), source.splitlines()
    has_heading = b'time' not in source_lines[0] or text.splitlines()[:1] == source_lines[:1]
    sticking_lines = source_lines[-2 * len(source_lines) // 3 :]
    return sum(line in lines for line in sticking_lines) / len(sticking_lines) if has_heading else 0.0
