# SPDX-License-Identifier: Apache-2.0
"""A log that does not make its times certain is asked about, and exits with 1: never with 0."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import pytest
from shared import CONFIG, Stickslip

T0 = datetime(2026, 5, 4, 6, 0)
HEAD = 'time,rpm,load [N]'


@pytest.mark.parametrize(
    ('head', 'form', 'every', 'question'),
    [
        (HEAD, '{:%Y-%m-%d %H:%M:%S}', 1, ''),
        (HEAD, '{:%d/%m/%Y %H:%M:%S}', 1, 'or is the month first?'),
        (HEAD, '{:%d/%m/%Y %H:%M:%S}', 40_000, ''),
        (HEAD, '{:%y-%m-%d %H:%M:%S}', 1, 'or is the year first?'),
        (HEAD, '{1}', 1, 'may be s since the start or days of a spreadsheet'),
        (HEAD, '{2:.6f}', 1, 'may be days of a spreadsheet or s since the start'),
        ('No,rpm,load [N]', '{3}', 1, "head them 'time [s]'"),
        (f'n,{HEAD}', '{3},{0:%Y-%m-%dT%H:%M:%SZ}', 1, ''),
        ('Date,Time,rpm,load [N]', '{:%Y-%m-%d,%H:%M}', 86_400, 'has a value each 8.64e+04 s'),
        ('Date,Time,rpm,load [N]', '{:%Y-%m-%d,%H:%M}', 1_800, 'has a value each 1800 s'),
    ],
)
def test_a_question_about_times_is_no_all_clear(
    head: str, form: str, every: int, question: str, tmp_path: Path, stickslip: Stickslip
) -> None:
    times = [(T0 + k * timedelta(seconds=every), 40_000 + k, 40_000 + k / 24, k) for k in range(60)]
    path = tmp_path / 'voyage.csv'
    path.write_text(
        f'{head}\n' + ''.join(f'{form.format(*time)},{80 + k % 3},900\n' for k, time in enumerate(times))
    )
    result = stickslip('check', path, '--config', CONFIG)
    questions = [line for line in result.out.splitlines() if line.startswith('question: ')]
    if every == 40_000:
        questions = [line for line in questions if 'which cannot judge' not in line]
    assert any(question in line for line in questions) if question else not questions
    assert result.code == int(bool(question) or every > 1)


@pytest.mark.parametrize(
    ('filler', 'code'),
    [('-99', 1), ('999.9', 1), ('9999.0', 1), ('-9999', 0), ('1e20', 0), ('82', 0), ('-50', 0)],
)
@pytest.mark.parametrize('first', [0, 3000])
def test_a_filler_that_is_not_known_raises_a_question(
    filler: str, code: int, first: int, tmp_path: Path, stickslip: Stickslip
) -> None:
    """-99 rpm are turns astern; -9999 means no value wherever it comes, and so it is of the whole log."""
    rows = (f'{k},{filler if k >= first and k % 20 == 7 else 80},{900 + k % 3}\n' for k in range(first + 60))
    path = tmp_path / 'voyage.csv'
    path.write_text('time [s],rpm,load [N]\n' + ''.join(rows) + f'{first + 60},80,900\n' * (first > 0))
    result = stickslip('check', path, '--config', CONFIG)
    assert f'has {float(filler):g} far from all other values' in result.out or not code
    assert code or 'far from all' not in result.out


@pytest.mark.parametrize(
    ('filler', 'is_asked'),
    [('-555', True), ('555', True), ('-1', True), ('0', False), ('40', False), ('81.5', False)],
)
def test_a_number_that_stands_far_from_those_of_a_sensor_raises_a_question(
    filler: str, is_asked: bool, tmp_path: Path, stickslip: Stickslip
) -> None:
    # A sensor has noise, which a filler has not; a shaft at rest, or a slower one, is none.
    rows = (f'{k},{filler if 100 <= k < 150 else f"{80 + k % 13 / 10}"},{900 + k % 3}\n' for k in range(600))
    path = tmp_path / 'voyage.csv'
    path.write_text('time [s],rpm,load [N]\n' + ''.join(rows))
    assert ('far from all other values' in stickslip('check', path, '--config', CONFIG).out) == is_asked


@pytest.mark.parametrize(
    ('load', 'is_asked'), [('60,000', True), ('60.000', True), ('0,900', False), ('60,00', False)]
)
def test_thousands_or_decimals_raise_a_question(
    load: str, is_asked: bool, tmp_path: Path, stickslip: Stickslip
) -> None:
    path = tmp_path / 'voyage.csv'
    path.write_text('time [s];rpm;load [N]\n' + ''.join(f'{k};{80 + k % 3};{load}\n' for k in range(60)))
    result = stickslip('check', path, '--config', CONFIG)
    question = f"load on /bearing/aft_stern/load has '{load}', read with decimals: write {load}0 or 60000"
    assert (question in result.out) == is_asked
    assert result.code == 1 or not is_asked


def test_a_column_of_an_average_raises_a_question(tmp_path: Path, stickslip: Stickslip) -> None:
    path = tmp_path / 'voyage.csv'
    path.write_text(
        'time [s],rpm_min,rpm_max,rpm_avg,load [N]\n' + ''.join(f'{k},79,81,80,900\n' for k in range(60))
    )
    result = stickslip('check', path, '--config', CONFIG)
    assert "question: speed on /shaft/speed is called 'avg'" in result.out
    assert result.code == 1
    # The messages of an assumed load are those of the speed, whose name is not its own.
    config, text = tmp_path / 'ship.yaml', CONFIG.read_text().replace('/shaft/speed,', '/a, column: rpm_avg,')
    config.write_text(text.replace('load: {topic: /bearing/aft_stern/load', 'load: {constant: 900.0'))
    assert stickslip('check', path, '--config', config).out.count("is called 'avg'") == 1


def test_unknown_words_of_a_quality_raise_a_question(tmp_path: Path, stickslip: Stickslip) -> None:
    """They are asked about wherever they come, and answered by a line of the configuration."""
    rows = (f'{k},80,{"schlecht" if 4000 < k < 4100 else "gut"},900\n' for k in range(6000))
    path, config = tmp_path / 'voyage.csv', tmp_path / 'ship.yaml'
    path.write_text('time [s],Drehzahl [rpm],Drehzahl Qualität,load [N]\n' + ''.join(rows))
    result = stickslip('check', path, '--config', CONFIG)
    assert result.code == 1
    assert "with 'gut', 'schlecht': write the lines that count, as in where: {'Drehzahl Qualit" in result.out
    config.write_text(CONFIG.read_text().replace('unit: rpm', 'unit: rpm, where: {Drehzahl Qualität: gut}'))
    assert 'schlecht' not in stickslip('check', path, '--config', config).out


@pytest.mark.parametrize(
    ('heading', 'flags', 'answer'),
    [
        ('rpm fault', '01', "{rpm fault: '*'}"),
        ('rpm gueltig', ('ja', 'nein'), "{rpm gueltig: '*'}"),
        ('rpm set', ('80', '90'), ''),  # a number
        ('rpm fault', '00', ''),
        ('load fault', '01', ''),  # of a load that has another name
    ],
)
def test_flags_named_after_a_signal_raise_a_question(
    heading: str, flags: tuple[str, str], answer: str, tmp_path: Path, stickslip: Stickslip
) -> None:
    path, config = tmp_path / 'voyage.csv', tmp_path / 'ship.yaml'
    rows = ''.join(f'{k},80,{flags[4000 < k < 4100]},900\n' for k in range(6000))
    path.write_text(f'time [s],rpm,{heading},Bearing load [N]\n{rows}')
    result = stickslip('check', path, '--config', CONFIG)
    assert (result.code, f"column '{heading}' with '{flags[0]}'" in result.out) == (
        int(answer != ''),
        answer != '',
    )
    config.write_text(CONFIG.read_text().replace('unit: rpm', f'unit: rpm, where: {answer or {}}'))
    assert stickslip('check', path, '--config', config).code == 0


@pytest.mark.parametrize(
    ('head', 'every', 'rare_word', 'is_asked'),
    [
        ('state', '', 'HI', True),
        ('message', 'Normal', 'High limit exceeded', True),
        ('message', '', '{k}', False),  # numbers are a measurement
        ('area', 'ER', 'ER', False),
        ('id', 'e-{k}', 'e-{k}', False),
    ],
)
def test_words_beside_lines_of_a_tag_raise_a_question(
    head: str, every: str, rare_word: str, is_asked: bool, tmp_path: Path, stickslip: Stickslip
) -> None:
    """Write the events of a tag among its values, as a historian does; another tag has words of its own."""
    path, config, rows = tmp_path / 'voyage.csv', tmp_path / 'ship.yaml', ''
    for k in range(3000):
        rows += f'{k},rpm,80,rpm,{every.format(k=k)}\n{k},load,900,N,{("", "x")[k % 2]}\n'
        rows += f'{k}.5,rpm,81,rpm,{rare_word.format(k=k)}\n' if k in (1500, 1600) else ''
    path.write_text(f'time [s],tag,value,unit,{head}\n{rows}')
    config.write_text(CONFIG.read_text().replace('unit: N', f"unit: N, where: {{{head}: '*'}}"))
    result = stickslip('check', path, '--config', config)
    answer = f"where: {{'{head}': '{every}'}}"
    assert (result.code, answer in result.out) == (int(is_asked), is_asked)
    config.write_text(config.read_text().replace('unit: rpm', f'unit: rpm, {answer}') if is_asked else '')
    assert not is_asked or stickslip('check', path, '--config', config).code == 0


@pytest.mark.parametrize(
    ('zone', 'first', 'exit_code'), [('', '01:58', 1), ('Z', '01:58', 0), ('', '01:28', 0)]
)
def test_an_hour_that_summer_time_may_leave_out_raises_a_question(
    zone: str, first: str, exit_code: int, tmp_path: Path, stickslip: Stickslip
) -> None:
    """On 29 March 2026 clocks went from 02:00 to 03:00; a pause from 01:30 on is none of summer time."""
    start = datetime.fromisoformat(f'2026-03-29T{first}')
    times = [start + timedelta(seconds=k + 3600 * (k >= 120)) for k in range(240)]
    path = tmp_path / 'voyage.csv'
    path.write_text(
        HEAD + '\n' + ''.join(f'{t:%Y-%m-%d %H:%M:%S}{zone},{80 + t.second % 3},900\n' for t in times)
    )
    result = stickslip('check', path, '--config', CONFIG)
    assert ('as when summer time begins' in result.out) == bool(exit_code)


@pytest.mark.parametrize(
    ('zone', 'first', 'count', 'exit_code'),
    [('', '02:50', 60, 1), ('Z', '02:50', 60, 0), ('', '02:20', 45, 0), ('', '02:50', 90, 0)],
)
def test_an_hour_within_which_summer_time_may_end_raises_a_question(
    zone: str, first: str, count: int, exit_code: int, tmp_path: Path, stickslip: Stickslip
) -> None:
    """On 25 October 2026 clocks went from 03:00 to 02:00; a log of that hour is one of a ring buffer, too."""
    start = datetime.fromisoformat(f'2026-10-25T{first}')
    times = [start + timedelta(minutes=k) for k in range(count)]
    times = [t - timedelta(hours=1) if t.hour > 2 else t for t in times]
    path = tmp_path / 'voyage.csv'
    path.write_text(
        HEAD + '\n' + ''.join(f'{t:%Y-%m-%d %H:%M:%S}{zone},{80 + t.minute % 3},900\n' for t in times)
    )
    result = stickslip('check', path, '--config', CONFIG)
    assert (result.code, 'as where summer time ended' in result.out) == (exit_code, bool(exit_code))
