# SPDX-License-Identifier: Apache-2.0
"""What accuracy costs in time: methods, cases, and the error and the time of each on each.

``python -m benchmarks.accuracy`` measures, some minutes (``--quick``: seconds), and prints the table;
``-o`` keeps it as CSV, ``--from`` shows a stored one, ``--picture`` draws it. Time is measured warm
and repeatedly; the median counts. A sample in which the wall clock runs well ahead of the process'
own time was disturbed by another process and is left out.

The reference amplitudes are Taylor series in 40 digits by mpmath, which share no code with any
method; a test computes some of them again.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.methods import (
    REFUSED,
    MethodResult,
    averaging,
    event_driven,
    exact,
    harmonic_balance,
    has_resolvent,
    smoothed,
    switching,
)
from benchmarks.reference import bearing
from stickslip_monitor.drawing.canvas import save_figure, write_csv
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.files import read_file
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck

Clock = Callable[[], float]

_DISTURBED = 1.2
_FLOOR = 1e-14
_LARGEST = 16 << 20


@dataclass(frozen=True, slots=True)
class Method:
    """A way to compute the amplitude of the stable cycle."""

    name: str  # short and unique
    family: str  # what it shares with its variants, which differ in accuracy only
    # Solves an operating point: bearing, surface speed ``V`` > 0 [m/s], load ``N`` > 0 [N].
    amplitude: Callable[[Bearing, float, float], MethodResult]
    applies: Callable[[Bearing], bool] = lambda _: True  # whether it is made for a bearing's law
    points: int = 1  # operating points solved together in one call; its time is shared among them
    slow: bool = False  # whether a quick look leaves it out

    def solve(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """Apply it where it applies."""
        if not self.applies(bearing):
            return MethodResult(math.nan, REFUSED, None)
        return self.amplitude(bearing, speed, load)


@dataclass(frozen=True, slots=True)
class Case:
    """An operating point with the amplitude of its stable cycle."""

    name: str  # short and unique
    bearing: Bearing
    speed: float  # surface speed ``V`` [m/s]
    load: float  # load ``N`` [N]
    reference: float  # amplitude to 15 digits or more [m]
    quick: bool = False  # whether a quick look has it


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to measure."""

    budget: float = 0.5  # time to spend on one method at one case [s]
    sample: float = 2e-3  # shortest sample; faster calls are repeated within it [s]
    fewest: int = 5  # fewest samples
    most: int = 101  # most samples


QUICK = Effort(budget=0.02, sample=1e-3, fewest=3, most=15)


def time_call(
    call: Callable[[], object],
    effort: Effort,
    wall: Clock = time.perf_counter,
    cpu: Clock = time.process_time,
) -> tuple[float, int, bool]:
    """Measure a call that has been made before, and so is warm, by two clocks [s].

    Returns:
        The median of the undisturbed samples, how many count, and whether most were disturbed:
        then all count, by process time [s].
    """
    start = wall()
    call()
    once = max(wall() - start, 1e-9)
    inner = max(1, math.ceil(effort.sample / once))
    samples: list[tuple[float, float]] = []
    while len(samples) < effort.fewest or (len(samples) < effort.most and wall() - start < effort.budget):
        wall_begin, cpu_begin = wall(), cpu()
        for _ in range(inner):
            call()
        samples.append(((wall() - wall_begin) / inner, (cpu() - cpu_begin) / inner))
    quiet = [w for w, c in samples if w <= _DISTURBED * c]
    if 2 * len(quiet) >= len(samples):
        return median(quiet), len(quiet), False
    return median(c for _, c in samples), len(samples), True


@dataclass(frozen=True, slots=True)
class Row:
    """A method at a case."""

    method: str  # name of the method
    family: str  # its family
    case: str  # name of the case
    amplitude: float  # what it says [m]; ``nan`` for nothing
    error: float  # relative error of the amplitude, with its sign [-]; ``nan`` without one
    outcome: str  # how it ended
    evaluations: int  # evaluations of the friction law; -1 where they are not counted
    points: int  # operating points solved in one call
    seconds: float  # time per operating point [s]; ``nan`` where it was refused
    samples: int  # samples behind that time
    disturbed: bool  # whether the machine was busy with something else


def measure(method: Method, case: Case, effort: Effort) -> Row:
    """Error and time of a method at a case; the first call warms it up."""
    result = method.solve(case.bearing, case.speed, case.load)
    seconds, samples, disturbed = math.nan, 0, False
    if result.outcome != REFUSED:
        seconds, samples, disturbed = time_call(
            lambda: method.amplitude(case.bearing, case.speed, case.load), effort
        )
    return Row(
        method=method.name,
        family=method.family,
        case=case.name,
        amplitude=result.amplitude,
        # Free of cancellation.
        error=(result.amplitude - case.reference) / case.reference,
        outcome=result.outcome,
        evaluations=-1 if result.evaluations is None else result.evaluations,
        points=method.points,
        seconds=seconds / method.points,
        samples=samples,
        disturbed=disturbed,
    )


@dataclass(frozen=True, slots=True)
class Summary:
    """A method over the cases that it was given."""

    method: str
    family: str  # its family
    points: int  # operating points solved in one call
    seconds: float  # median time per operating point [s]; ``nan`` if it was refused everywhere
    ratio: float  # median of its time over that of the base method at the same case [-]
    # Largest absolute relative error; ``inf`` where it found nothing at some case that it did
    # not refuse.
    worst: float
    middle: float  # median absolute relative error, a failure counting as infinite
    answered: int  # number of cases at which it found a cycle
    refused: int  # number of cases at which it was refused


def summarise(rows: Sequence[Row], base: str) -> list[Summary]:
    """One summary a method, in the order of their first rows; times over those of ``base``."""
    unit = {row.case: row.seconds for row in rows if row.method == base}
    found = []
    for name in dict.fromkeys(row.method for row in rows):
        group = [row for row in rows if row.method == name]
        used = [row for row in group if row.outcome != REFUSED]
        errors = [abs(row.error) if math.isfinite(row.error) else math.inf for row in used]
        ratios = [row.seconds / unit[row.case] for row in used if row.case in unit]
        found.append(
            Summary(
                method=name,
                family=group[0].family,
                points=group[0].points,
                seconds=median(row.seconds for row in used) if used else math.nan,
                ratio=median(ratios) if ratios else math.nan,
                worst=max(errors, default=math.nan),
                middle=median(errors) if errors else math.nan,
                answered=sum(math.isfinite(error) for error in errors),
                refused=len(group) - len(used),
            )
        )
    return found


def pareto(seconds: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Which points no other point beats in time and error together, by rising time.

    Points that are not finite take no part; errors below rounding are equal.
    """
    usable = [
        i
        for i, (t, e) in enumerate(zip(seconds, errors, strict=True))
        if math.isfinite(t) and math.isfinite(e)
    ]
    front: list[int] = []
    least = math.inf
    for i in sorted(usable, key=lambda i: (seconds[i], errors[i])):
        if max(errors[i], _FLOOR) < least:
            least = max(errors[i], _FLOOR)
            front.append(i)
    return front


def columns(rows: Sequence[Row]) -> dict[str, list[object]]:
    """The measurement as columns for a CSV file."""
    table = [astuple(row) for row in rows]
    return {field.name: [line[i] for line in table] for i, field in enumerate(fields(Row))}


_PARSERS: dict[str, Callable[[str], object]] = {
    'str': str,
    'int': int,
    'bool': lambda text: text == 'True',
    'float': lambda text: float(text) if text else math.nan,
}


def read_rows(path: str | Path) -> list[Row]:
    """Read a measurement back from its CSV file.

    Raises:
        ConfigurationError: The file cannot be read or is no measurement.
    """
    try:
        text = read_file(path, _LARGEST).decode()
        lines = list(csv.DictReader(io.StringIO(text, newline='')))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ConfigurationError(f'{path} cannot be read: {reason}') from error
    if not lines or list(lines[0]) != [field.name for field in fields(Row)]:
        raise ConfigurationError(f'{path} is no measurement of benchmarks.accuracy')
    try:
        # Each value is parsed by the type of its field, which the type checker cannot follow.
        return [
            Row(**{f.name: _PARSERS[str(f.type)](line[f.name]) for f in fields(Row)})  # type: ignore[arg-type]
            for line in lines
        ]
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f'{path} has a cell that is no number: {error}') from error


AT_ONCE = 1000
HARMONICS = (1, 3, 7, 15, 31, 63)
WIDTHS = (1e-3, 1e-4, 1e-5)


def _single_and_bulk(
    name: str, amplitude: Callable[[int, Bearing, float, float], MethodResult]
) -> tuple[Method, Method]:
    """A method for one operating point, and for many in one call."""
    bulk = Method(f'{name}, {AT_ONCE} at once', name, partial(amplitude, AT_ONCE), points=AT_ONCE)
    return Method(name, name, partial(amplitude, 1)), bulk


def _smoothed(width: float, tight: bool) -> Method:
    tolerance = 'tight' if tight else 'default'
    name = f'tanh {width:.0e} m/s, {tolerance}'.replace('e-0', 'e-')
    slow = tight and width < 5e-5
    return Method(name, 'tanh friction, LSODA', partial(smoothed, width, tight), slow=slow)


def _switching(name: str, tight: bool, longest: float = math.inf) -> Method:
    solve = partial(switching, tight, longest)
    return Method(f'switching, {name}', 'switching, solve_ivp', solve)


BASE, _AVERAGING_IN_BULK = _single_and_bulk('KBM', averaging)
"""The first is the method whose time others are compared with."""
METHODS = (
    BASE,
    _AVERAGING_IN_BULK,
    *(
        Method(
            f'harmonic balance, H = {harmonics}',
            'harmonic balance',
            partial(harmonic_balance, harmonics),
            has_resolvent,
            slow=harmonics > 31,
        )
        for harmonics in HARMONICS
    ),
    *(_smoothed(width, tight) for tight in (False, True) for width in WIDTHS),
    _switching('default', False),
    _switching('tight', True),
    _switching('tight, bounded step', True, 0.1),
    Method('event-driven integrator', 'event-driven integrator', event_driven),
    *_single_and_bulk('exact cycle', exact),
)
"""All methods, in the order of the tables."""

REFERENCE = bearing()
_RPM = REFERENCE.speed.factor('rpm')


def _bench(name: str, rpm: float, load: float, reference: float, quick: bool = False, **changes: Any) -> Case:
    return Case(name, replace(REFERENCE, **changes), rpm * _RPM, load, reference, quick)


CASES = (
    # eta = 0.002: almost harmonic, overtakes the belt.
    _bench('weak friction', 30.0, 10.0, 0.0007870856429556819, damping=4.0),
    # Near the fold at 40.7 rpm; just below the Hopf speed; in the middle of the unstable range;
    # sticks for an eighth of the cycle; crawls, far from harmonic.
    _bench('38 rpm', 38.0, 1000.0, 0.001000211996591925, quick=True),
    _bench('30 rpm', 30.0, 1000.0, 0.0008048004753024688),
    _bench('20 rpm', 20.0, 1000.0, 0.0005567552520338237, quick=True),
    _bench('10 rpm', 10.0, 1000.0, 0.0002969526471492934, quick=True),
    _bench('2 rpm', 2.0, 1000.0, 6.520669876360655e-05),
    # Grazes the belt: event location misses it.
    _bench('40 rpm', 40.0, 1000.0, 0.001048880117242072, quick=True),
    # nu = 0.05 s/m: friction rises again.
    _bench('viscous', 20.0, 1000.0, 0.0005525388009365229, friction=Stribeck(0.30, 0.10, 10.0, 0.05)),
    # eta = 3: strongly damped, strongly driven.
    _bench('zeta = 0.3', 20.0, 15000.0, 0.000978449202489445, damping=6000.0),
    # zeta = 0.02: a relaxation oscillation, sticks for 70 % of the cycle.
    _bench('eta = 5', 20.0, 25000.0, 0.0026514206849174407),
)
"""Operating points of the reference bearing, easy ones first."""

TYPICAL = '20 rpm'
"""The case that stands for common use."""


_WORDS = {'refused': '-', 'no_cycle': 'none', 'not_converged': 'fails'}


def footnote(rows: Sequence[Row]) -> str:
    """What the picture should be read with."""
    disturbed = sum(row.disturbed for row in rows)
    text = 'median of warm calls; errors against 40-digit references, drawn at 1e-16 if below'
    return text + (f'; {disturbed} of {len(rows)} times disturbed' if disturbed else '')


def error_text(row: Row | None) -> str:
    """An error in a table's cell."""
    if row is None:
        return ''
    if row.outcome in _WORDS:
        return _WORDS[row.outcome]
    text = f'{abs(row.error):.0e}'.replace('e-0', 'e-').replace('e+0', 'e')
    return text if row.error else '0'


def time_text(seconds: float) -> str:
    """A time in a table's cell."""
    for unit, factor in (('s', 1.0), ('ms', 1e3)):
        if seconds * factor >= 1.0:
            return f'{seconds * factor:.3g} {unit}'
    return f'{seconds * 1e6:.3g} us' if math.isfinite(seconds) else '-'


def table_cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the table method x case."""
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


def markdown(rows: Sequence[Row]) -> str:
    """The table in Markdown."""
    headings, lines = table_cells(rows)
    rule = ['---', *['--:'] * (len(headings) - 1)]
    return ''.join(f'| {" | ".join(line)} |\n' for line in [headings, rule, *lines])


def measured(quick: bool) -> list[Row]:
    """Measure every method on every case, or a few."""
    cases = [case for case in CASES if case.quick or not quick]
    rows = []
    for method in METHODS:
        if not (quick and method.slow):
            print(method.name, file=sys.stderr)
            rows += [measure(method, case, QUICK if quick else Effort()) for case in cases]
    return rows


def main(argv: Sequence[str] | None = None) -> None:
    """Measure or read, show and keep."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.accuracy', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='a few cases, done in seconds')
    parser.add_argument('--from', dest='source', metavar='FILE', help='show an earlier result (.csv)')
    parser.add_argument('--output', '-o', metavar='FILE', help='.csv: a row for each method and case')
    parser.add_argument('--picture', metavar='FILE', help='error over time, .png or .svg')
    args = parser.parse_args(argv)
    rows = read_rows(args.source) if args.source else measured(args.quick)
    if args.output:
        write_csv(columns(rows), args.output, force=True)
    if args.picture:
        from benchmarks.accuracy_picture import draw_accuracy

        save_figure(draw_accuracy(rows), args.picture, force=True)
    sys.stdout.write(markdown(rows))


if __name__ == '__main__':
    main()
