# SPDX-License-Identifier: Apache-2.0
"""Logs whose lines are of several shafts, ships or devices."""

from __future__ import annotations

from pathlib import Path

import pytest
from nasty_logs import open_log

from stickslip_logs.errors import BagError
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_columns import SourceColumn
from stickslip_logs.recordings.table_recording import TableRecording


def log_of_two(head: str, form: str, count: int = 12) -> str:
    """Return a log of two things; ``form`` makes the lines of a second, 20 rpm and 136 rpm."""
    rows = (
        form.format(at=f'2026-04-13T10:00:{k:02}', slow=20 + k % 2, fast=136 + k % 2) for k in range(count)
    )
    return f'{head}\n{"".join(rows)}'


SEVERAL = {
    'shafts': log_of_two('time,shaft,rpm', '{at}Z,port,{slow}\n{at}Z,stbd,{fast}\n'),
    'devices with times of their own': log_of_two('time,device,rpm', '{at}.0Z,a,{slow}\n{at}.4Z,b,{fast}\n'),
    'one value a line': log_of_two('time,device,name,value', '{at}Z,a,rpm,{slow}\n{at}Z,b,rpm,{fast}\n'),
    'one after the other': log_of_two('time,ship,rpm', '{at}Z,A,{slow}\n')
    + log_of_two('', '{at}Z,B,{fast}\n')[1:],
    'words behind digits': log_of_two('time,shaft,rpm', '{at}Z,5s,{slow}\n{at}Z,7s,{fast}\n'),
    'engines': log_of_two('time,engine,rpm', '{at}Z,1ME,{slow}\n{at}Z,2ME,{fast}\n'),
    'one at a fifth of the pace of the other': ''.join(
        f'{t},{"b" if t % 6 == 5 else "a"},{(20, 136)[t % 6 == 5] + t // 6 % 2}\n' for t in range(60)
    ).join(['time,device,rpm\n', '']),
    'one seldom reports': 'time,ship,rpm\n'
    + ''.join(f'{t},a,{20 + t % 2}\n' + f'{t},b,{136 + t // 30}\n' * (t % 30 == 0) for t in range(60)),
    'one is slower': log_of_two('time,shaft,rpm', '{at}.0Z,p,{slow}\n{at}.5Z,p,{slow}\n{at}.0Z,s,{fast}\n'),
}
NUMBERED = {
    'ships': log_of_two('time,imo,rpm', '{at}Z,9074729,{slow}\n{at}Z,9319466,{fast}\n'),
    'one value a line': log_of_two('time,unit,name,value', '{at}Z,1,rpm,{slow}\n{at}Z,2,rpm,{fast}\n'),
    'times of their own': log_of_two('time,device,rpm', '{at}.0Z,101,{slow}\n{at}.4Z,102,{fast}\n'),
    'paces of their own': log_of_two(
        'time,device,rpm', '{at}.0Z,1,{slow}\n{at}.4Z,2,{fast}\n{at}.5Z,1,{slow}\n'
    ),
}
ONE = {
    'per cent and limits': log_of_two('time,power,rpm', '{at}.0Z,7{slow}.5%,{slow}\n{at}.4Z,<1,{slow}\n'),
    'a state that comes and goes': 'time,fix,rpm\n'
    + ''.join(f'{t},{"V" if t in (3, 19, 22, 40, 58) else "A"},20\n' for t in range(60)),
    'a state that lasts': 'time,valve,rpm\n' + ''.join(f'{t},{"ab"[t // 5 % 2]},20\n' for t in range(60)),
    'a state': log_of_two('time,state,rpm', '{at}Z,ahead,{slow}\n') + '2026-04-13T10:01:00Z,astern,20\n' * 2,
    'parts of a second': log_of_two(
        'time,ms,rpm', '{at}Z,0,{slow}\n{at}Z,250,{slow}\n{at}Z,500,{slow}\n{at}Z,750,{slow}\n'
    ),
    'words that change now and then': log_of_two('time,remark,rpm', '{at}Z,a,{slow}\n{at}.5Z,a,{slow}\n')
    + '2026-04-13T10:01:00Z,b,20\n',
    'a remark beside some lines': log_of_two('time,remark,rpm', '{at}Z,a,{slow}\n{at}.5Z,,{slow}\n'),
    'the quality of another signal': log_of_two(
        'time,load_quality,rpm,load', '{at}Z,Good,{slow},1\n{at}.5Z,Bad,{slow},1\n'
    ),
    'numbers that say what the speed is': log_of_two('time,order,rpm', '{at}.0Z,1,20\n{at}.4Z,1,20\n')
    + '2026-04-13T10:01:00Z,2,136\n2026-04-13T10:01:07Z,2,136\n2026-04-13T10:01:20Z,1,20\n',
    'another source of the load': log_of_two('time,source,rpm,load', '{at}Z,a,{slow},\n{at}Z,b,,900\n'),
}


@pytest.mark.parametrize('name', SEVERAL)
def test_the_column_that_tells_lines_apart_is_found(name: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, SEVERAL[name])
    column = next(listed for listed in recording.all_columns if listed.heading == 'rpm')
    key_and_texts = recording.find_unchosen_key(column)
    assert key_and_texts is not None
    key, texts = key_and_texts
    values = [values_of(recording, {key: text}) for text in texts]
    assert sorted(map(max, values)) == [21, 137]
    assert recording.find_unchosen_key(recording.choose_rows(column, {key: texts[0]})) is None


def test_names_without_headings_are_chosen_by_their_place(tmp_path: Path) -> None:
    """Read what a client of MQTT prints: time, topic and payload."""
    recording = open_log(tmp_path, log_of_two('', '{at}Z port/rpm {slow}\n{at}Z stbd/rpm {fast}\n'))
    (column,) = (listed for listed in recording.all_columns if listed.heading == '#3')
    assert recording.find_unchosen_key(column) == ('#2', ['port/rpm', 'stbd/rpm'])


@pytest.mark.parametrize('name', NUMBERED)
def test_things_with_numbers_are_told_apart_by_their_values(name: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, NUMBERED[name])
    column = next(listed for listed in recording.all_columns if listed.heading == 'rpm')
    ((place, is_numbered),) = recording.find_keys(column)
    key = recording.table.names[place]
    assert is_numbered
    with pytest.raises(
        BagError, match=rf"column '{key}' has '(\w+)', '\w+' beside .* where: {{'{key}': '\1'}}"
    ):
        recording.read([Request('rpm', 'data')])
    texts = dict.fromkeys(row[recording.table.names.index(key)] for row in recording.table.head)
    assert sorted(max(values_of(recording, {key: text})) for text in texts) == [21, 137]


@pytest.mark.parametrize('name', ONE)
def test_lines_of_one_thing_are_not_told_apart(name: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, ONE[name])
    column = next(listed for listed in recording.all_columns if listed.heading == 'rpm')
    assert recording.find_unchosen_key(column) is None


def values_of(recording: TableRecording, selection: dict[str, str]) -> list[float]:
    column = next(listed for listed in recording.all_columns if listed.heading == 'rpm')
    recording.deliver({'/n': SourceColumn(recording.choose_rows(column, selection))})
    request = Request('/n', 'data')
    return recording.read([request])[request].value.tolist()


def test_numbers_of_things_may_be_written_in_several_ways(tmp_path: Path) -> None:
    recording = open_log(tmp_path, 'time,shaft,rpm\n@0,01,20\n@0,02,136\n@1, 1,21\n@1,02,137\n')
    assert values_of(recording, {'shaft': '1'}) == [20, 21]
    assert values_of(recording, {'#2': '2'}) == [136, 137]


def test_all_lines_may_be_of_one_thing(tmp_path: Path) -> None:
    recording = open_log(tmp_path, SEVERAL['shafts'])
    column = recording.choose_rows(
        next(listed for listed in recording.all_columns if listed.heading == 'rpm'), {'shaft': '*'}
    )
    assert recording.find_unchosen_key(column) is None
    assert len(values_of(recording, {'shaft': '*'})) == SEVERAL['shafts'].count('\n') - 1


def test_files_one_after_the_other_may_be_of_one_thing(tmp_path: Path) -> None:
    # A logger writes the name of its file into each line, and its clock was set back.
    rows = ''.join(f'{t},{file},{20 + t % 7}\n' for file in 'ab' for t in range(3000))
    recording = open_log(tmp_path, f'time,file,rpm\n{rows}')
    assert len(values_of(recording, {'file': '*'})) == 6000


def test_a_thing_that_is_not_there_is_named(tmp_path: Path) -> None:
    recording = open_log(tmp_path, SEVERAL['shafts'])
    with pytest.raises(BagError, match=r"no line with 'prt' in column 'shaft': it has 'port', 'stbd'; did"):
        values_of(recording, {'shaft': 'prt'})
    with pytest.raises(BagError, match=r"no column 'shft' to choose rows by; did you mean 'shaft'\?"):
        values_of(recording, {'shft': 'port'})


def test_ships_one_after_the_other_in_a_long_log_are_not_a_clock_that_was_set_back(tmp_path: Path) -> None:
    # The head of the file has one ship only, its tail the other.
    rows = ''.join(f'{t},{ship},{n}\n' for ship, n in (('A', 20), ('B', 136)) for t in range(3000))
    recording = open_log(tmp_path, f'time,ship,rpm\n{rows}')
    with pytest.raises(BagError, match=r"column 'ship' has 'A', 'B' one after the other, .* \{'ship': 'A'\}"):
        recording.read([Request('rpm', 'data')])
    assert set(values_of(recording, {'ship': 'B'})) == {136}
    assert recording.start_ns == 0


def log_of_twins(noise: int, begin: int, count: int = 4000) -> str:
    """Return a log of two numbered shafts at 90 rpm, of which one is at 15 rpm from a second on.

    Both change by up to ``noise``.
    """
    lines = []
    for t in range(count):
        slow = 15 if begin <= t < count - 1500 else 90
        lines.append(f'{t},1,{90 + t % (noise + 1)}\n{t},2,{slow + 7 * t % (noise + 1)}\n')
    return 'time,shaft,rpm\n' + ''.join(lines)


def test_shafts_that_turn_alike_at_the_ends_of_a_log_are_told_apart_by_its_middle(tmp_path: Path) -> None:
    recording = open_log(tmp_path, log_of_twins(noise=1, begin=1500))
    column = next(listed for listed in recording.all_columns if listed.heading == 'rpm')
    assert recording.find_unchosen_key(column) is None
    with pytest.raises(BagError, match=r"'shaft' has '1', '2' beside values .* where: \{'shaft': '1'\}"):
        recording.read([Request('rpm', 'data')])
    assert min(values_of(recording, {'shaft': '2'})) == 15
    assert min(values_of(recording, {'shaft': '1'})) == 90
    assert len(values_of(recording, {'shaft': '*'})) == 8000


def test_columns_that_are_read_tell_no_rows_apart(tmp_path: Path) -> None:
    """Read a load of two whole numbers in turns beside a speed that rises."""
    lines = [f'{k},{20 + 0.1 * k:.1f},{900 + k % 2}\n' for k in range(900)]
    log = open_log(tmp_path, ''.join(['time [s],/speed,/load\n', *lines]))
    series = log.read([Request('/speed', 'data'), Request('/load', 'data')])
    assert [item.value.size for item in series.values()] == [900, 900]


@pytest.mark.parametrize(
    'text',
    [
        log_of_twins(noise=3, begin=10_000),
        # Samples of one shaft in a second that slows down, and one number of each of many things.
        'time,ms,rpm\n' + ''.join(f'{k // 4},{k % 4 * 250},{90 - k // 50}\n' for k in range(4000)),
        # A load in whole numbers that comes and goes at a steady pace.
        'time,load,rpm\n' + ''.join(f'{k},{900 + 5 * k % 13},{90 + k % 3}\n' for k in range(600)),
        'time,n,rpm\n'
        + ''.join(f'{k // 2},{k % 4},{90}\n' for k in range(300))
        + ''.join(f'{k // 2},{k},{90 - 70 * (k % 2)}\n' for k in range(300, 3000)),
    ],
    ids=['alike to the end', 'samples of one', 'a signal', 'too many'],
)
def test_numbered_rows_of_alike_values_are_read(text: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, text)
    inputs = [column for column in recording.all_columns if column.heading in ('load', 'rpm')]
    recording.deliver({column.heading: SourceColumn(column) for column in inputs})
    for request, series in recording.read([Request(c.heading, 'data') for c in inputs]).items():
        assert series.value.size == text.count('\n') - 1, request


@pytest.mark.parametrize('names', ['rpm,oil,fuel', 'oil,rpm,fuel', 'oil,fuel,rpm'])
def test_blocks_of_other_signals_are_no_clock_that_was_set_back(names: str, tmp_path: Path) -> None:
    # Exports of historians have one signal after the other.
    blocks = [''.join(f'{t},{name},{t % 7}\n' for t in range(3000)) for name in names.split(',')]
    recording = open_log(tmp_path, 'time,name,value\n' + ''.join(blocks))
    series = recording.read([Request('rpm', 'data')])[Request('rpm', 'data')]
    assert (series.value == [t % 7 for t in range(3000)]).all()
    assert (recording.start_ns, recording.end_ns) == (0, 2999 * 10**9)
    assert not any('set back' in text for text in recording.warnings), recording.warnings


@pytest.mark.parametrize('ship', ['A', 'B', 'C'])
def test_blocks_of_other_ships_are_no_clock_that_was_set_back(ship: str, tmp_path: Path) -> None:
    rows = ''.join(f'{t},{name},{ord(name)}\n' for name in 'ABC' for t in range(3000))
    recording = open_log(tmp_path, f'time,ship,rpm\n{rows}')
    assert set(values_of(recording, {'ship': ship})) == {ord(ship)}
    assert (recording.start_ns, recording.end_ns) == (0, 2999 * 10**9)
    assert not any('set back' in text for text in recording.warnings), recording.warnings
