# SPDX-License-Identifier: Apache-2.0
"""Logs of a bus last as long as its senders go on, also where none of them sends a number."""

from __future__ import annotations

import json
from datetime import datetime, timezone
from pathlib import Path

from nasty_logs import nmea_sentence

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.tables.bus_log import nmea_rows

SECOND = 10**9
START = 1_780_000_000


def delta(second: int, path: str, value: object) -> str:
    """Return a line of Signal K with one value."""
    stamp = datetime.fromtimestamp(START + second, timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')
    update = {'$source': 'n2k.1', 'timestamp': stamp, 'values': [{'path': path, 'value': value}]}
    return json.dumps({'context': 'vessels.self', 'updates': [update]})


def span_of(path: Path, lines: list[str]) -> tuple[float, float]:
    """Return the first and the last time of a log of one speed, after it was read [s from the start]."""
    path.write_text('\n'.join([*lines, '']), 'utf-8')
    recording = open_bag(path)
    recording.read([Request('propulsion.0.revolutions', 'data')])
    assert recording.start_ns is not None
    assert recording.end_ns is not None
    assert not recording.losses
    return recording.start_ns / SECOND - START, recording.end_ns / SECOND - START


def test_deltas_without_numbers_tell_how_long_an_input_is_silent(tmp_path: Path) -> None:
    """The position goes on for 40 s behind the last speed; what a server knew before it began is older."""
    numbers = [delta(second, 'propulsion.0.revolutions', 1.0) for second in range(20)]
    old = delta(-3600, 'navigation.state', 'moored')
    silent = [delta(second, 'navigation.position', {'latitude': 54.0}) for second in range(20, 60)]
    assert span_of(tmp_path / 'a.log', [old, *numbers, *silent]) == (0.0, 59.0)
    assert span_of(tmp_path / 'b.log', [*numbers, *silent, *numbers[-1:]]) == (0.0, 19.0)
    assert span_of(tmp_path / 'c.log', [*numbers, old]) == (0.0, 19.0)


def test_the_time_of_a_tag_block_may_stand_behind_its_source() -> None:
    """NMEA 0183 4.00, section 7: parameters of a tag block are in any order."""
    lines = [
        f'\\{tag}*00\\{nmea_sentence("ERRPM,S,1,30.0,,A")}\n'
        for tag in ('s:ER1,c:1776074400', 'g:1-1-7,s:ER1,n:4,c:1776074401500', 'c:1776074402,s:ER1')
    ]
    assert [row[0] for row in nmea_rows(iter(lines)) if row] == ['1776074400', '1776074401.500', '1776074402']
