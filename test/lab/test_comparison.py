# SPDX-License-Identifier: Apache-2.0
"""Measuring: references, errors, times by fake clocks, the front, and the CSV round trip."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import mpmath as mp
import pytest
import taylor

from stickslip_lab.accuracy import comparison as measurement
from stickslip_lab.accuracy.comparison import (
    BASE,
    CASES,
    Effort,
    Row,
    columns,
    measure,
    pareto,
    read_rows,
    summarise,
    time_call,
)
from stickslip_lab.commands.accuracy import markdown_table
from stickslip_monitor.drawing.canvas import write_csv
from stickslip_monitor.errors import ConfigurationError

DOCS = Path(__file__).parents[2] / 'docs'
TINY = Effort(budget=0.0, sample=1e-9, min_samples=1, max_samples=1)


@pytest.mark.parametrize('name', ['38 rpm', '20 rpm', 'eta = 5'])
def test_stored_references_are_those_of_40_digits(name):
    (case,) = (case for case in CASES if case.name == name)
    b, law, speed = case.bearing, case.bearing.friction, mp.mpf(case.speed)
    omega = mp.sqrt(mp.mpf(b.stiffness) / b.mass)
    force = mp.mpf(case.load) / (b.mass * omega * speed)
    zeta = mp.mpf(b.damping) / (2 * b.mass * omega)
    static, kinetic = (force * mp.mpf(mu) for mu in (law.static, law.kinetic))
    amplitude, _, _ = taylor.stick_slip(zeta, static, kinetic, mp.mpf(law.decay) * speed)
    assert case.reference == pytest.approx(float(amplitude * speed / omega), rel=3e-16)


class Clocks:
    """A wall clock and a process clock that a call pushes on."""

    def __init__(self, steps):
        self.wall = self.cpu = 0.0
        self.steps = itertools.cycle(steps)

    def call(self):
        wall, cpu = next(self.steps)
        self.wall += wall
        self.cpu += cpu


@pytest.mark.parametrize(
    ('steps', 'effort', 'seconds', 'samples', 'disturbed'),
    [
        # A quiet machine is timed by the wall clock until the budget is spent.
        ([(0.010, 0.0099)], Effort(0.1, 1e-3, 3, 50), 0.010, range(3, 11), False),
        # Short calls are repeated within a sample.
        ([(1e-6, 1e-6)], Effort(0.0, 1e-3, 2, 2), 1e-6, [2], False),
        # Disturbed samples do not count.
        ([(0.01, 0.01)] * 3 + [(0.5, 0.01)], Effort(0.0, 1e-3, 8, 8), 0.01, [6], False),
        # A busy machine is timed by the process clock.
        ([(0.5, 0.01)], Effort(0.0, 1e-3, 5, 5), 0.01, [5], True),
    ],
)
def test_the_median_of_undisturbed_samples_counts(steps, effort, seconds, samples, disturbed):
    clocks = Clocks(steps)
    measured, count, busy = time_call(clocks.call, effort, lambda: clocks.wall, lambda: clocks.cpu)
    assert measured == pytest.approx(seconds, rel=1e-6)
    assert (count in samples, busy) == (True, disturbed)
    assert clocks.wall > effort.sample * effort.min_samples


def make_row(method='KBM', case='a', error=0.1, seconds=1.0, outcome='cycle', points=1) -> Row:
    return Row(method, method, case, 1.0, error, outcome, 3, points, seconds, 5, False)


def test_summary_of_a_method():
    rows = [
        make_row(case='a', error=-0.3, seconds=2.0),
        make_row(case='b', error=0.1, seconds=4.0),
        make_row('other', 'a', 0.01, 20.0),
        make_row('other', 'b', math.nan, 80.0, 'not_converged'),
        make_row('third', 'a', math.nan, math.nan, 'refused'),
        make_row('third', 'b', math.nan, math.nan, 'refused'),
    ]
    base, second, third = summarise(rows, 'KBM')
    assert (base.worst, base.middle, base.ratio) == (0.3, 0.2, 1.0)
    assert (second.worst, second.ratio, second.answered) == (math.inf, 15.0, 1)
    assert third.refused == 2
    assert math.isnan(third.seconds)
    assert math.isnan(third.worst)


@pytest.mark.parametrize(
    ('seconds', 'errors', 'front'),
    [
        ([1.0, 2.0, 3.0, 4.0, 0.5, 5.0], [1e-1, 1e-1, 1e-3, 1e-2, math.inf, 1e-12], [0, 2, 5]),
        # Errors below rounding are equal.
        ([1.0, 2.0, math.nan], [3e-15, 0.0, 0.0], [0]),
        ([], [], []),
    ],
)
def test_the_front_is_what_nothing_beats(seconds, errors, front):
    assert pareto(seconds, errors) == front


def test_a_measurement_has_the_time_of_a_point_unless_refused(monkeypatch):
    monkeypatch.setattr(measurement, 'time_call', lambda *_: (8.0, 3, False))
    measured = measure(replace(BASE, points=4), CASES[1], TINY)
    assert (measured.outcome, measured.seconds, measured.samples) == ('cycle', 2.0, 3)
    refused = measure(replace(BASE, applies=lambda _: False), CASES[1], TINY)
    assert (refused.outcome, math.isnan(refused.seconds)) == ('refused', True)


def test_csv_round_trip_to_the_last_bit(tmp_path):
    rows = [make_row(error=1 / 3), make_row('other', 'b, c', math.nan, math.nan, 'refused')]
    rows.append(replace(rows[0], method='third', disturbed=True))
    write_csv(columns(rows), tmp_path / 'a.csv')
    stored = read_rows(tmp_path / 'a.csv')
    assert repr(stored) == repr(rows)


@pytest.mark.parametrize(
    ('text', 'words'),
    [('', 'is not a measurement'), ('a,b\n1,2\n', 'is not a measurement'), (None, 'not a number')],
)
def test_a_file_without_measurements_is_refused(tmp_path, text, words):
    write_csv(columns([make_row()]), tmp_path / 'a.csv')
    if text is None:
        text = (tmp_path / 'a.csv').read_text().replace('0.1', 'much')
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(ConfigurationError, match=words):
        read_rows(tmp_path / 'a.csv')
    with pytest.raises(ConfigurationError, match='cannot be read'):
        read_rows(tmp_path / 'missing.csv')


def _table_cells(lines):
    """Return the cells of a table in Markdown, by method and case."""
    head, _, *rows = ([cell.strip() for cell in line.strip('|').split('|')] for line in lines)
    return {(row[0], case): cell for row in rows for case, cell in zip(head[1:], row[1:], strict=True)}


def test_the_page_shows_the_stored_measurement():
    """Compare with the page, which leaves some methods and cases out."""
    page = (DOCS / 'accuracy.md').read_text('utf-8')
    mark = '<!-- of: stickslip accuracy --from docs/accuracy.csv --markdown -->\n'
    shown = _table_cells(page.partition(mark)[2].partition('\n\n')[0].splitlines())
    assert len(shown) >= 40
    stored = _table_cells(markdown_table(read_rows(DOCS / 'accuracy.csv')).splitlines())
    assert {key: stored[key] for key in shown} == shown
