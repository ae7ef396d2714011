# SPDX-License-Identifier: Apache-2.0
"""Measuring: references, errors, times by fake clocks, the front, and the CSV round trip."""

from __future__ import annotations

import importlib.util
import itertools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from stickslip_monitor.commands.accuracy import markdown
from stickslip_monitor.drawing.canvas import write_csv
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.lab.accuracy import measurement
from stickslip_monitor.lab.accuracy.cases import BASE, CASES, METHODS, TYPICAL
from stickslip_monitor.lab.accuracy.measurement import (
    Effort,
    Row,
    columns,
    measure,
    pareto,
    read_rows,
    relative_error,
    summarise,
    time_call,
)

DOCS = Path(__file__).parents[3] / 'docs'
TINY = Effort(budget=0.0, sample=1e-9, fewest=1, most=1)

_spec = importlib.util.spec_from_file_location(
    'accuracy_reference', Path(__file__).with_name('accuracy_reference.py')
)
assert _spec is not None
assert _spec.loader is not None
taylor = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(taylor)


@pytest.mark.parametrize('name', ['38 rpm', '20 rpm', 'viscous', 'eta = 5', 'cubic law'])
def test_stored_references_are_those_of_40_digits(name):
    (case,) = (case for case in CASES if case.name == name)
    assert case.reference == pytest.approx(float(taylor.reference(case)), rel=3e-16)


def test_cases_are_named_once_and_some_are_quick():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert TYPICAL in [case.name for case in CASES if case.quick]


class Clocks:
    """A wall clock and a process clock that a call pushes on."""

    def __init__(self, steps):
        self.wall = self.cpu = 0.0
        self.steps = itertools.cycle(steps)

    def call(self):
        wall, cpu = next(self.steps)
        self.wall += wall
        self.cpu += cpu


def timing(steps, effort):
    clocks = Clocks(steps)
    return time_call(clocks.call, effort, lambda: clocks.wall, lambda: clocks.cpu)


def test_a_quiet_machine_is_timed_by_the_wall_clock():
    found = timing([(0.010, 0.0099)], Effort(budget=0.1, sample=1e-3, fewest=3, most=50))
    assert found.seconds == pytest.approx(0.010)
    assert not found.disturbed
    assert 3 <= found.samples <= 10


def test_short_calls_are_repeated_within_a_sample():
    clocks = Clocks([(1e-6, 1e-6)])
    found = time_call(
        clocks.call, Effort(0.0, 1e-3, 2, 2), lambda: clocks.wall, lambda: clocks.cpu
    )
    assert found.seconds == pytest.approx(1e-6, rel=1e-6)
    assert clocks.wall > 2e-3


def test_disturbed_samples_do_not_count():
    steps = [(0.01, 0.01), (0.01, 0.01), (0.01, 0.01), (0.50, 0.01)]
    found = timing(steps, Effort(0.0, 1e-3, 8, 8))
    assert found.seconds == pytest.approx(0.01)
    assert (found.samples, found.disturbed) == (6, False)


def test_a_busy_machine_is_timed_by_the_process_clock_and_said_to_be_busy():
    found = timing([(0.5, 0.01)], Effort(0.0, 1e-3, 5, 5))
    assert found.seconds == pytest.approx(0.01)
    assert found.disturbed


def test_relative_error_keeps_its_sign():
    assert relative_error(0.99, 1.0) == pytest.approx(-0.01)
    assert math.isnan(relative_error(math.nan, 1.0))


def row(method='KBM', case='a', error=0.1, seconds=1.0, outcome='cycle', points=1) -> Row:
    return Row(method, method, case, 1.0, error, outcome, 3, points, seconds, 5, False)


def test_summary_of_a_method():
    rows = [
        row(case='a', error=-0.3, seconds=2.0),
        row(case='b', error=0.1, seconds=4.0),
        row('other', 'a', 0.01, 20.0),
        row('other', 'b', math.nan, 80.0, 'not_converged'),
        row('third', 'a', math.nan, math.nan, 'refused'),
        row('third', 'b', math.nan, math.nan, 'refused'),
    ]
    base, other, third = summarise(rows, 'KBM')
    assert (base.worst, base.middle, base.ratio) == (0.3, 0.2, 1.0)
    assert (other.worst, other.ratio, other.answered) == (math.inf, 15.0, 1)
    assert third.refused == 2
    assert math.isnan(third.seconds)
    assert math.isnan(third.worst)


def test_the_front_is_what_nothing_beats():
    seconds = [1.0, 2.0, 3.0, 4.0, 0.5, 5.0]
    errors = [1e-1, 1e-1, 1e-3, 1e-2, math.inf, 1e-12]
    assert pareto(seconds, errors) == [0, 2, 5]


def test_on_the_front_errors_below_rounding_are_equal():
    assert pareto([1.0, 2.0, math.nan], [3e-15, 0.0, 0.0]) == [0]
    assert pareto([], []) == []


def test_a_measurement_with_no_assertion_on_its_time():
    (other,) = (method for method in METHODS if method.name == 'Thomsen and Fidlin')
    rows = [measure(m, case, TINY) for m in (BASE, other) for case in (CASES[0], CASES[-1])]
    assert [r.outcome for r in rows] == ['cycle', 'cycle', 'refused', 'cycle']
    assert rows[0].seconds > 0.0
    assert math.isnan(rows[2].seconds)


def test_time_is_shared_among_points(monkeypatch):
    @dataclass(frozen=True)
    class Fixed:
        seconds: float = 8.0
        samples: int = 3
        disturbed: bool = False

    monkeypatch.setattr(measurement, 'time_call', lambda *_: Fixed())
    assert measure(replace(BASE, points=4), CASES[1], TINY).seconds == 2.0


def test_csv_round_trip_to_the_last_bit(tmp_path):
    rows = [row(error=1 / 3), row('other', 'b, c', math.nan, math.nan, 'refused')]
    rows.append(replace(rows[0], method='third', disturbed=True))
    write_csv(columns(rows), tmp_path / 'a.csv')
    again = read_rows(tmp_path / 'a.csv')
    assert repr(again) == repr(rows)


@pytest.mark.parametrize('text', ['', 'a,b\n1,2\n'])
def test_another_csv_is_refused(tmp_path, text):
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(ConfigurationError, match='is no measurement'):
        read_rows(tmp_path / 'a.csv')


def test_a_broken_cell_and_a_missing_file_are_refused(tmp_path):
    write_csv(columns([row()]), tmp_path / 'a.csv')
    text = (tmp_path / 'a.csv').read_text().replace('0.1', 'much')
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(ConfigurationError, match='no number'):
        read_rows(tmp_path / 'a.csv')
    with pytest.raises(ConfigurationError, match='cannot be read'):
        read_rows(tmp_path / 'missing.csv')


def test_the_page_shows_the_stored_measurement():
    table = markdown(read_rows(DOCS / 'accuracy.csv'))
    command = 'stickslip accuracy --from docs/accuracy.csv --markdown'
    assert table in (DOCS / 'accuracy.md').read_text('utf-8'), f'paste `{command}` into the page'
