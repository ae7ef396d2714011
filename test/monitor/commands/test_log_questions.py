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
    ('head', 'form', 'every', 'asked'),
    [
        (HEAD, '{:%Y-%m-%d %H:%M:%S}', 1, ''),
        (HEAD, '{:%d/%m/%Y %H:%M:%S}', 1, 'or is the month first?'),
        (HEAD, '{:%d/%m/%Y %H:%M:%S}', 40_000, ''),
        (HEAD, '{:%y-%m-%d %H:%M:%S}', 1, 'or is the year first?'),
        (HEAD, '{1}', 1, 'may be s since the start or days of a spreadsheet'),
        (HEAD, '{2:.6f}', 1, 'may be days of a spreadsheet or s since the start'),
        ('No,rpm,load [N]', '{3}', 1, 'may number the lines only'),
        (f'n,{HEAD}', '{3},{0:%Y-%m-%dT%H:%M:%SZ}', 1, ''),
        ('Date,Time,rpm,load [N]', '{:%Y-%m-%d,%H:%M}', 86_400, 'has a value each 8.64e+04 s'),
    ],
)
def test_a_question_about_times_is_no_all_clear(
    head: str, form: str, every: int, asked: str, tmp_path: Path, stickslip: Stickslip
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
    assert any(asked in line for line in questions) if asked else not questions
    assert result.code == int(bool(asked) or every > 1)


@pytest.mark.parametrize(('filler', 'code'), [('-99', 1), ('-9999', 0)])
def test_a_filler_that_is_not_known_is_asked(
    filler: str, code: int, tmp_path: Path, stickslip: Stickslip
) -> None:
    """-99 rpm are turns astern; -9999 means no value wherever it comes."""
    rows = (f'{k},{filler if k % 20 == 7 else 80},{900 + k % 3}\n' for k in range(60))
    path = tmp_path / 'voyage.csv'
    path.write_text('time [s],rpm,load [N]\n' + ''.join(rows))
    result = stickslip('check', path, '--config', CONFIG)
    assert result.code == code
    assert ('has -99 far from all other values' in result.out) == (code == 1)
