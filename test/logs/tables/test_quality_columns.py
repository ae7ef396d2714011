# SPDX-License-Identifier: Apache-2.0
"""Which numbers count, by a column of their quality."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from nasty_logs import open_log

from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_columns import SourceColumn
from stickslip_logs.tables.quality_columns import find_bad_mark_test


@pytest.mark.parametrize(
    ('heading', 'good', 'bad'),
    [
        # OPC UA Part 6, StatusCode.csv: Good, Uncertain, BadCommunicationError, BadNotConnected; signed, too.
        ('StatusCode', '0', '2147483648'),
        ('StatusCode', '0', '1073741824'),
        ('quality', '0', '-2147155968'),
        ('rpm_status', '0x00000000', '0x80050000'),
        ('status', '00000000', '808A0000'),
        ('StatusCode', 'Good', 'BadCommunicationError'),
        ('StatusCode', 'GoodClamped', 'UncertainLastUsableValue'),
        ('StatusCode', '0x00000000 (Good)', '0x80310000 (BadNoCommunication)'),
        # OPC DA 3.00, 6.8: good 192 and 216 (local override), bad 24 (comm failure), uncertain 68.
        ('quality', '192', '24'),
        ('rpm_quality', '216', '68'),
        ('Quality', '192.0', '0'),
        # Wonderware's detail of 65536, no data stored, is beyond the 16 bits of OPC DA.
        ('QualityDetail', '192', '65536'),
        ('rpm valid', '1', '0'),
        ('rpm_valid', 'TRUE', 'FALSE'),
        # No code of either, and one beyond 32 bits.
        ('rpm_quality', '0x00000000', '0xZZ'),
        ('rpm_status', '0', '17179869184'),
        ('rpm_quality', 'Good', 'Held'),
        # QARTOD flags: 1 pass, 4 fail.
        ('rpm_qc', '1', '4'),
    ],
)
def test_marks_of_quality(heading: str, good: str, bad: str, tmp_path: Path) -> None:
    recording = open_log(tmp_path, f'time,rpm,{heading},load\n@0,30,{good},900\n@1,31,{bad},901\n')
    recording.deliver({'/n': SourceColumn(recording.all_columns[0])})
    request = Request('/n', 'data')
    values = recording.read([request])[request].value
    assert (values[0], values[1] != values[1]) == (30, True)
    assert any(f"count where '{heading}' says so" in text for text in recording.warnings)


@pytest.mark.parametrize(
    ('heading', 'row', 'used'),
    [
        ('time,rpm,load,quality', '{0},{1},900,{2}', [30.0, 32.0]),
        ('time,valid,rpm,load', '{0},{2},{1},900', [30.0, 32.0]),
        ('time,longitude,valid,rpm,load', '{0},10.5,{2},{1},900', [30.0, 31.0, 32.0]),
        ('time,rpm,load,status', '{0},{1},900,{3}', [30.0, 31.0, 32.0]),
    ],
)
def test_known_marks_at_an_end_of_all_lines_are_of_all_numbers(
    heading: str, row: str, used: list[float], tmp_path: Path
) -> None:
    rows = [
        row.format(f'@{k}', 30 + k, 'Bad' if k == 1 else 'Good', 'astern' if k == 1 else 'ahead')
        for k in range(3)
    ]
    recording = open_log(tmp_path, '\n'.join([heading, *rows, '']))
    recording.deliver({'/n': SourceColumn(next(c for c in recording.all_columns if c.heading == 'rpm'))})
    (series,) = recording.read([Request('/n', 'data')]).values()
    assert series.value[series.value == series.value].tolist() == used


def test_a_quality_beside_a_longer_name_is_of_it(tmp_path: Path) -> None:
    text = 'time,speed.PV,speed.Q,load.PV,load.Q\n@0,30,Good,900,Good\n@1,31,Bad,901,Good\n'
    recording = open_log(tmp_path, text)
    speed, _, load, _ = recording.all_columns
    recording.deliver({'/n': SourceColumn(speed), '/f': SourceColumn(load)})
    marks = [recording.by_topic[topic].status for topic in ('/n', '/f')]
    assert [status[0] for status in marks if status] == [2, 4]


@pytest.mark.parametrize('good_word', ['Good', '192', 'Bad'])
def test_a_word_that_is_not_known_does_not_count_beside_known_ones(good_word: str) -> None:
    is_bad = find_bad_mark_test('quality', [good_word])
    assert is_bad is not None
    assert [is_bad(mark) for mark in ('Good', 'Schlecht', '')] == [False, True, False]


def test_words_of_which_only_the_bad_one_is_known_are_no_quality() -> None:
    """Ask which of the unknown words is good."""
    assert find_bad_mark_test('quality', ['Bad', 'Gut', 'Schlecht']) is None


@pytest.mark.parametrize(
    ('heading', 'is_known'),
    [('StatusCode', True), ('rpm status code', True), ('status', False), ('code', False)],
)
def test_a_heading_says_that_small_codes_are_of_opc_ua(heading: str, is_known: bool) -> None:
    """OPC UA Part 4, 7.39: the two highest bits are the severity, 0x400 only says of what the others are."""
    is_bad = find_bad_mark_test(heading, ['0', '1024'])
    assert (is_bad is not None) == is_known
    assert not is_bad or [is_bad(mark) for mark in ('1024', '2147483648')] == [False, True]


@pytest.mark.parametrize(('heading', 'marks'), [('status', '123'), ('rpm_qc', ['128', '28']), ('valid', '2')])
def test_codes_of_no_known_kind_are_no_quality(heading: str, marks: Sequence[str]) -> None:
    assert find_bad_mark_test(heading, marks) is None


def test_a_bad_code_after_the_head_of_a_file_of_zeros_counts() -> None:
    is_bad = find_bad_mark_test('quality', ['0'])
    assert is_bad is not None
    assert [is_bad(mark) for mark in ('0', '2147483648')] == [False, True]


@pytest.mark.parametrize(
    ('marks', 'question'),
    [('100 0', ['100', '0']), ('1 1', None), ('192 0', None), (' '.join(map(str, range(120))), None)],
)
def test_numbers_of_a_quality_without_a_meaning_raise_a_question(
    marks: str, question: list[str] | None, tmp_path: Path
) -> None:
    """Take the share of a historian that is good as a question; many numbers are a measurement."""
    rows = ''.join(f'{k}.5,30,{mark},900\n' for k, mark in enumerate(marks.split() * 3))
    recording = open_log(tmp_path, f'time,rpm,rpm quality,load\n{rows}')
    assert recording.unknown_marks(recording.all_columns[0]) == (question and ('rpm quality', question))


def test_words_beside_a_column_without_headings_raise_a_question(tmp_path: Path) -> None:
    rows = ''.join(f'@{k},30,{"SUSPECT" if k == 7 else "OK"},900\n' for k in range(10))
    recording = open_log(tmp_path, rows)
    questions = [recording.unknown_marks(column) for column in recording.all_columns]
    assert questions == [('#3', ['OK', 'SUSPECT']), None, None]
