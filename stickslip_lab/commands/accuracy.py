# SPDX-License-Identifier: Apache-2.0
"""Show what accuracy costs in time: every method for the stick-slip amplitude on a set of cases.

Each method, from averaging to the exact cycle, solves operating points from easy to hard. Errors
are against references of 40 digits; times are medians of repeated, warm calls. For steady times
keep the machine quiet and set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console

from stickslip_lab.accuracy.comparison import (
    BASE,
    CASES,
    METHODS,
    QUICK,
    TYPICAL,
    Effort,
    Row,
    Summary,
    columns,
    measure,
    pareto,
    read_rows,
    summarise,
)
from stickslip_lab.drawing.studies import MethodMark, draw_pareto
from stickslip_monitor.commands import options, output
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.bearing_records import finite_or_none

SCHEMA = 'stickslip_monitor/accuracy/1'
_WORDS = {'refused': '-', 'no_cycle': 'none', 'not_converged': 'fails'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('--quick', action='store_true', help='a few cases, done in seconds')
    options.add_file(
        parser, '--from', dest='source', metavar='FILE', help='show an earlier result (.csv); measure nothing'
    )
    text = '.csv: one row for each method and case'
    options.add_file(parser, '--output', '-o', marks=options.TABLE, help=text)
    options.add_picture(parser, 'error over time')
    parser.add_argument('--markdown', action='store_true', help='print the table in Markdown')
    options.add_shared(parser, '--force', '--json')


def run(args: argparse.Namespace) -> int:
    """Make a measurement or read it from a file; write the outputs asked for, print the result and return 0.

    Raises:
        ConfigurationError: ``--from`` and ``--quick`` are both given, or the file cannot be read or is no
            measurement.
        DrawingError, OutputError: An output cannot be made or written.
    """
    if args.source and args.quick:
        raise ConfigurationError('--from shows what was measured: it does not go with --quick')
    rows = read_rows(args.source) if args.source else measure_all(quick=args.quick)
    output.write_outputs(
        args,
        output=lambda: columns(rows),
        picture=lambda: draw_pareto(method_panels(rows), footnote_text(rows)),
    )
    if args.json:
        output.print_json(to_json(rows))
    elif args.markdown:
        sys.stdout.write(markdown_table(rows))
    else:
        _print_rows(output.console(), rows)
    return 0


def measure_all(*, quick: bool) -> list[Row]:
    """Measure all methods at all cases; show progress, and return the rows, method by method.

    ``quick`` skips slow methods and all but the quick cases, and spends the effort ``QUICK``.
    """
    cases = [case for case in CASES if case.quick or not quick]
    steps = [(m, case) for m in METHODS if not (quick and m.slow) for case in cases]
    rows = []
    with output.ProgressBar() as bar:
        for done, (method, case) in enumerate(steps):
            bar.show(f'{method.name}, {case.name}', done, len(steps))
            rows.append(measure(method, case, QUICK if quick else Effort()))
    return rows


def to_json(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the measurement as the documented JSON object."""
    return {
        'schema': SCHEMA,
        'base': BASE.name,
        'rows': [_to_plain_values(row) for row in rows],
        'methods': [_to_plain_values(summary) for summary in summarise(rows, BASE.name)],
    }


def _to_plain_values(record: Row | Summary) -> dict[str, object]:
    """Return the fields of a record by name, ``None`` for a number that is not finite."""
    return {k: finite_or_none(v) if isinstance(v, float) else v for k, v in asdict(record).items()}


def method_panels(rows: Sequence[Row]) -> dict[str, list[MethodMark]]:
    """Return the marks of the picture by title of a panel: the typical case, and the worst of all cases.

    Refused methods have no mark in the first; in the second, those that found no cycle at all or were refused
    at more than one case.
    """
    typical = [row for row in rows if row.case == TYPICAL and row.outcome != 'refused']
    one = [(row.family, row.points, row.seconds, abs(row.error)) for row in typical]
    every = [
        (s.family, s.points, s.seconds, s.worst)
        for s in summarise(rows, BASE.name)
        if s.answered and s.refused <= 1
    ]
    count = len({row.case for row in rows if row.method == BASE.name})
    return {
        f'{TYPICAL}: the middle of the unstable range': _method_marks(one),
        f'worst of {count} cases, median time': _method_marks(every),
    }


def _method_marks(points: list[tuple[str, int, float, float]]) -> list[MethodMark]:
    """Return the marks of methods, each given as family, points in one call, seconds and absolute error.

    An error that is not finite becomes ``inf``. Only methods of one point a call may be on the front.
    """
    errors = [e if math.isfinite(e) else math.inf for *_, e in points]
    front = pareto([t if count == 1 else math.nan for _, count, t, _ in points], errors)
    return [
        MethodMark(family, seconds, errors[i], i in front, count > 1)
        for i, (family, count, seconds, _) in enumerate(points)
    ]


def footnote_text(rows: Sequence[Row]) -> str:
    """Return the caveats below the picture, with the number of disturbed times, if any."""
    disturbed = sum(row.disturbed for row in rows)
    text = 'median of warm calls; errors against 40-digit references, drawn at 1e-16 if below'
    return text + (f'; {disturbed} of {len(rows)} times disturbed' if disturbed else '')


def error_text(row: Row | None) -> str:
    """Return a relative error as a cell of a table, without its sign: '-', 'none' or 'fails' without a cycle.

    '' where ``row`` is ``None``.
    """
    if row is None:
        return ''
    if row.outcome in _WORDS:
        return _WORDS[row.outcome]
    text = f'{abs(row.error):.0e}'.replace('e-0', 'e-').replace('e+0', 'e')
    return text if row.error else '0'


def time_text(seconds: float) -> str:
    """Return a time [s] as a table's cell in s, ms or us; '-' where it is not finite."""
    for unit, factor in (('s', 1.0), ('ms', 1e3)):
        if seconds * factor >= 1.0:
            return f'{seconds * factor:.3g} {unit}'
    return f'{seconds * 1e6:.3g} us' if math.isfinite(seconds) else '-'


def table_cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Return the headings of the table of methods and cases, and the cells of each method's line."""
    cases = list(dict.fromkeys(row.case for row in rows))
    at = {(row.method, row.case): row for row in rows}
    lines = [
        [
            s.method,
            *(error_text(at.get((s.method, case))) for case in cases),
            time_text(s.seconds),
            f'{s.ratio:.3g}' if math.isfinite(s.ratio) else '-',
        ]
        for s in summarise(rows, BASE.name)
    ]
    return ['method', *cases, 'time', '/ KBM'], lines


def markdown_table(rows: Sequence[Row]) -> str:
    """Return the table of methods and cases in Markdown."""
    headings, lines = table_cells(rows)
    rule = ['---', *['--:'] * (len(headings) - 1)]
    return ''.join(f'| {" | ".join(line)} |\n' for line in [headings, rule, *lines])


def _print_rows(out: Console, rows: Sequence[Row]) -> None:
    """Print the table of methods and cases, and a warning where times were disturbed.

    Sets the width of ``out`` to hold the whole table where no terminal limits it.
    """
    headings, lines = table_cells(rows)
    caption = (
        '-: does not apply; none: finds no cycle; fails: does not converge. time: median per operating point.'
    )
    title = 'Relative error of the stick-slip amplitude'
    table = output.make_table(title, '; '.join(headings), caption=caption)
    for line in lines:
        table.add_row(*line)
    if output.line_width() is None:
        out.width = 220
    out.print(table)
    disturbed = sum(row.disturbed for row in rows)
    if disturbed:
        out.print(
            f'[yellow]warning:[/] {disturbed} of {len(rows)} times were disturbed by other'
            ' processes; process time is given for them'
        )
