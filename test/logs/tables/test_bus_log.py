# SPDX-License-Identifier: Apache-2.0
"""Logs of a bus last as long as its senders go on, also where none of them sends a number."""

from __future__ import annotations

import json
from datetime import datetime, timezone
from pathlib import Path

from nasty_logs import nmea_sentence

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.tables.bus_log import canboat_rows, nmea_rows, signalk_rows

SECOND = 10**9
START = 1_780_000_000


def make_delta(second: int, path: str, value: object) -> str:
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
    # The position goes on for 40 s behind the last speed; what a server knew before it began is older.
    numbers = [make_delta(second, 'propulsion.0.revolutions', 1.0) for second in range(20)]
    old = make_delta(-3600, 'navigation.state', 'moored')
    silent = [make_delta(second, 'navigation.position', {'latitude': 54.0}) for second in range(20, 60)]
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


def test_half_a_sentence_is_damaged_wherever_it_stands_in_its_line() -> None:
    """Cut a sentence of three at each letter before its checksum, with the line end and without."""
    stamps = [f'2026-05-04T06:00:0{second}Z ' for second in range(3)]
    whole = [stamp + nmea_sentence('ERRPM,S,1,30.0,,A') for stamp in stamps]
    for size in range(len(stamps[1]) + 7, len(whole[1]) - 2):
        for end in ('\n', ''):
            text = f'{whole[0]}\n{whole[1][:size]}{end}{whole[2]}\n'
            rows = list(nmea_rows(iter(text.splitlines())))
            assert [row[0] for row in rows if row] == [stamps[0].strip(), stamps[2].strip()]
            assert rows.count(None) == 1
    lines = [f'{whole[0]} {whole[1][-20:-3]}', f'{whole[2]} $ERRPM,S', 'another instrument']
    assert list(nmea_rows(iter(lines)))[1:] == [next(nmea_rows(iter(whole[2:]))), None, ()]


def test_numbers_behind_a_clock_that_fell_silent_have_no_time() -> None:
    """Two came between two times: up to 3 (2 + 1) are of the last one, until there is a clock again."""
    clock = [nmea_sentence(f'GPZDA,0600{second:02}.00,04,05,2026,00,00') for second in range(60)]
    speed = nmea_sentence('ERRPM,S,1,30.0,,A')
    lines = [line for time in clock[:5] for line in (time, speed, speed)] + [speed] * 38 + [clock[50], speed]
    rows = list(nmea_rows(iter(lines)))[1:]  # behind that of the first time
    assert [row[0][11:19] if row else None for row in rows] == [
        *[f'06:00:0{second}' for second in range(5) for _ in range(2)],
        *['06:00:04'] * 7,
        *[None] * 31,
        '06:00:50',
    ]


def test_lines_whose_times_cannot_be_read_any_more_have_none() -> None:
    """Read no lines of a clock that lost its date, say, as lines of the last second that had one."""
    body = nmea_sentence('ERRPM,S,1,30.0,,A')
    heads = [f'2026-05-04T06:00:{second:02}Z' for second in range(10)] + ['2026-05-04T06-00:10'] * 20
    rows = list(nmea_rows(iter([f'{head} {body}' for head in heads])))
    assert [row is None for row in rows] == [False] * 15 + [True] * 15


def test_the_own_vessel_may_be_called_by_its_name_later() -> None:
    """Rename the vessel as a server that is updated does; a delta of nobody is damaged."""
    lines = [make_delta(second, 'propulsion.0.revolutions', 1.0) for second in range(5)]
    for second, context in ((1, 'vessels.urn:mrn:imo:mmsi:257000000'), (2, 'vessels.urn:other'), (4, '')):
        lines[second] = lines[second].replace('vessels.self', context)
    values = [row and row[2] for row in signalk_rows(iter(lines))]
    assert values == ['1.0', '1.0', '1.0', None]


def test_other_vessels_go_on_where_the_own_one_falls_silent(tmp_path: Path) -> None:
    numbers = [make_delta(second, 'propulsion.0.revolutions', 1.0) for second in range(20)]
    other_vessel = [
        make_delta(second, 'navigation.speedOverGround', 5.0).replace(
            'vessels.self', 'vessels.urn:mrn:imo:mmsi:1'
        )
        for second in range(20, 60)
    ]
    assert span_of(tmp_path / 'a.log', [*numbers, *other_vessel]) == (0.0, 59.0)


def engine_message(second: int, **fields: object) -> str:
    """Return a line of canboat of the speed of an engine, or of another PGN without fields."""
    message = {'timestamp': f'2026-05-04T06:00:{second:02}Z', 'src': 16, 'pgn': 127488 if fields else 127489}
    return json.dumps(message | {'fields': {'Instance': 0, **fields}})


def test_a_field_of_canboat_that_knows_no_number_any_more_is_no_end_of_the_log() -> None:
    lines = [engine_message(0, Speed=60.0, Word='OK'), engine_message(1, Speed=None, Word='OK')]
    lines += [engine_message(2, Speed='Unknown'), engine_message(3)]
    assert list(canboat_rows(iter(lines))) == [
        ('2026-05-04T06:00:00Z', '127488.engine.0.Speed', '60.0', 'rpm', '16'),
        ('2026-05-04T06:00:01Z', '127488.engine.0.Speed', 'null', 'rpm', '16'),
        ('2026-05-04T06:00:02Z', '127488.engine.0.Speed', "'Unknown'", 'rpm', '16'),
        ('2026-05-04T06:00:03Z', '', '', '', ''),
    ]


def test_a_path_of_signal_k_that_had_numbers_has_none_where_its_value_is_no_number() -> None:
    speed, lines = 'propulsion.0.revolutions', [make_delta(0, 'navigation.state', 'moored')]
    lines += [
        make_delta(second, speed, value) for second, value in enumerate((1.0, {'value': 0.1}, '0.1'), 1)
    ]
    assert [row[1:3] for row in signalk_rows(iter(lines)) if row] == [
        (speed, '1.0'),
        (speed, "'{'value': 0.1}'"),
        (speed, "'0.1'"),
    ]


def test_zero_bytes_before_datagrams_are_no_damage(tmp_path: Path) -> None:
    """Record datagrams of IEC 61162-450, up to more than a piece of what is read; damage one."""
    for count in (20, 21_000, 21_001):
        bodies = ['VDZDA,100000.00,04,05,2026,00,00', *['VDRPM,S,1,100.0,,A'] * count]
        text = ''.join(f'UdPbC\0{nmea_sentence(body)}\r\n' for body in bodies)
        (tmp_path / 'voyage.log').write_text(text)
        assert not open_bag(tmp_path / 'voyage.log').losses
        (tmp_path / 'voyage.log').write_text(text.replace(',04,', ',0\0' + '4,'))
        assert 'the file has 1 zero byte' in open_bag(tmp_path / 'voyage.log').losses[0]
