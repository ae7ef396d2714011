# SPDX-License-Identifier: Apache-2.0
"""Compares methods by accuracy and time: the methods, the cases, and the error and time of each at each.

Time is measured warm and repeatedly; the median counts. A sample whose wall time is far above its process
time was disturbed by another process and is left out.

The reference amplitudes are Taylor series in 40 digits by mpmath, which share no code with any
method; a test computes some of them again.
"""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from stickslip_lab import MAX_TABLE_BYTES
from stickslip_lab.accuracy.methods import (
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
from stickslip_monitor.errors import ConfigurationError, cause
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.safe_files import read_file

Clock = Callable[[], float]


@dataclass(frozen=True, slots=True)
class Method:
    """A way to compute the amplitude of the stable cycle."""

    name: str  # short and unique
    family: str  # common name of variants that differ in accuracy only
    # Solves an operating point: bearing, surface speed ``V`` > 0 [m/s], load ``N`` > 0 [N].
    amplitude: Callable[[Bearing, float, float], MethodResult]
    applies: Callable[[Bearing], bool] = lambda _: True  # whether it is made for a bearing's law
    points: int = 1  # operating points solved together in one call; its time is shared among them
    slow: bool = False  # whether a quick look leaves it out

    def solve(self, bearing: Bearing, speed: float, load: float) -> MethodResult:
        """Return the result at a surface speed > 0 [m/s] and load > 0 [N].

        It is ``nan`` and ``REFUSED`` if the method does not apply.
        """
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
    """Effort of a measurement."""

    budget: float = 0.5  # time to spend on one method at one case [s]
    sample: float = 2e-3  # shortest sample; faster calls are repeated within it [s]
    min_samples: int = 5
    max_samples: int = 101


QUICK = Effort(budget=0.02, min_samples=3)
"""Effort of a quick look, which shows the order of the methods."""


def time_call(
    call: Callable[[], object],
    effort: Effort,
    wall: Clock = time.perf_counter,
    cpu: Clock = time.process_time,
) -> tuple[float, int, bool]:
    """Time repeated calls by two clocks, ``wall`` and ``cpu`` [s].

    The first, untimed call decides how many calls make a sample.

    Returns:
        The median wall time of a call [s] over the undisturbed samples, their number, and False; or, where
        most were disturbed, the median process time over all samples, their number, and True. A sample is
        disturbed if its wall time is above 1.2 times its process time.
    """
    start = wall()
    call()
    inner = max(1, math.ceil(effort.sample / max(wall() - start, 1e-9)))
    samples: list[tuple[float, float]] = []
    while len(samples) < effort.min_samples or (
        len(samples) < effort.max_samples and wall() - start < effort.budget
    ):
        wall_begin, cpu_begin = wall(), cpu()
        for _ in range(inner):
            call()
        samples.append(((wall() - wall_begin) / inner, (cpu() - cpu_begin) / inner))
    quiet = [w for w, c in samples if w <= 1.2 * c]
    if 2 * len(quiet) >= len(samples):
        return median(quiet), len(quiet), False
    return median(c for _, c in samples), len(samples), True


@dataclass(frozen=True, slots=True)
class Row:
    """A method at a case."""

    method: str  # name of the method
    family: str  # its family
    case: str  # name of the case
    amplitude: float  # its amplitude [m]; ``nan`` without a cycle
    error: float  # relative error of the amplitude, with its sign [-]; ``nan`` without one
    outcome: str  # as of :class:`.MethodResult`
    evaluations: int  # evaluations of the friction law; -1 where they are not counted
    points: int  # operating points solved in one call
    seconds: float  # time per operating point [s]; ``nan`` where it was refused
    samples: int  # samples behind that time
    disturbed: bool  # whether the machine was busy with something else


def measure(method: Method, case: Case, effort: Effort) -> Row:
    """Measure the relative error and the time of a method at a case; the first call warms it up.

    Returns:
        The row, with the time of one operating point [s]. A method that refuses the case is not timed: its
        amplitude, error and seconds are ``nan``. Evaluations are -1 if they are not counted.
    """
    point = case.bearing, case.speed, case.load
    result = method.solve(*point)
    seconds, samples, disturbed = math.nan, 0, False
    if result.outcome != REFUSED:
        seconds, samples, disturbed = time_call(partial(method.amplitude, *point), effort)
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
    seconds: float  # median time per operating point [s]; ``nan`` if it refused all cases
    ratio: float  # median of its time over that of the base method at the same case [-]
    # Largest absolute relative error; ``inf`` where it found no cycle at a case that it did not refuse.
    worst: float
    middle: float  # median absolute relative error, a failure counting as infinite
    answered: int  # number of cases at which it found a cycle
    refused: int  # number of cases that it refused


def summarise(rows: Sequence[Row], base: str) -> list[Summary]:
    """Return one summary for each method, in the order of their first rows.

    Args:
        rows: Measured rows.
        base: Name of the method to whose times the ``ratio`` refers.

    Returns:
        The summaries. Refused cases are only counted. A case without an amplitude has an infinite
        error; numbers of a method without any case, or without one of ``base``, are ``nan``.
    """
    unit = {row.case: row.seconds for row in rows if row.method == base}
    summaries = []
    for name in dict.fromkeys(row.method for row in rows):
        group = [row for row in rows if row.method == name]
        used = [row for row in group if row.outcome != REFUSED]
        errors = [abs(row.error) if math.isfinite(row.error) else math.inf for row in used]
        ratios = [row.seconds / unit[row.case] for row in used if row.case in unit]
        summaries.append(
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
    return summaries


def pareto(seconds: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Return the indexes of the points that no other beats in time and error together, by rising time.

    Points that are not finite take no part; errors up to 1e-14 are rounding, and count as equal. Of points
    with equal time and error the first counts. Both sequences have equal lengths.
    """
    errors = [max(error, 1e-14) for error in errors]
    is_finite = [math.isfinite(t) and math.isfinite(e) for t, e in zip(seconds, errors, strict=True)]
    usable = [i for i, is_known in enumerate(is_finite) if is_known]
    front: list[int] = []
    least_error = math.inf
    for i in sorted(usable, key=lambda i: (seconds[i], errors[i])):
        if errors[i] < least_error:
            least_error = errors[i]
            front.append(i)
    return front


def columns(rows: Sequence[Row]) -> dict[str, list[object]]:
    """Return the measurement as columns by heading, for a CSV file."""
    return {field.name: [getattr(row, field.name) for row in rows] for field in fields(Row)}


_PARSERS: dict[str, Callable[[str], object]] = {
    'str': str,
    'int': int,
    'bool': lambda text: text == 'True',
    'float': lambda text: float(text) if text else math.nan,
}


def read_rows(path: str | Path) -> list[Row]:
    """Return the rows of a measurement from the CSV file that ``stickslip accuracy`` wrote; empty is ``nan``.

    Raises:
        ConfigurationError: The file cannot be read, is too large, is no measurement, or has a cell that is no
            number.
    """
    try:
        text = read_file(path, MAX_TABLE_BYTES).decode()
        lines = list(csv.DictReader(io.StringIO(text, newline='')))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f'{path} cannot be read: {cause(error)}') from error
    if not lines or list(lines[0]) != [field.name for field in fields(Row)]:
        raise ConfigurationError(
            f"{path} is not a measurement: give a table that 'stickslip accuracy --output' wrote"
        )
    try:
        parsers = {field.name: _PARSERS[str(field.type)] for field in fields(Row)}
        rows: Any = ({name: parse(line[name]) for name, parse in parsers.items()} for line in lines)
        return [Row(**row) for row in rows]
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f'{path} has a cell that is not a number: {error}') from error


AT_ONCE = 1000
"""Operating points that a method in bulk solves in one call."""
HARMONICS = tuple(2**k - 1 for k in range(1, 7))
"""Numbers of harmonics to compare: each is the next step of the one before."""
WIDTHS = (1e-3, 1e-4, 1e-5)
"""Widths of regularised friction to compare [m/s]."""


def _single_and_bulk(
    name: str, amplitude: Callable[[int, Bearing, float, float], MethodResult]
) -> tuple[Method, Method]:
    """Return a method for one operating point, and one for ``AT_ONCE`` copies of it in one call.

    ``amplitude`` takes the number of copies before the operating point; ``name`` is also the family.
    """
    bulk = Method(f'{name}, {AT_ONCE} at once', name, partial(amplitude, AT_ONCE), points=AT_ONCE)
    return Method(name, name, partial(amplitude, 1)), bulk


def _smoothed_method(width: float, tight: bool) -> Method:
    """Return the method of :func:`.smoothed` with a width [m/s]; slow where that is narrow and tight."""
    name = f'tanh {width:.0e} m/s, {"tight" if tight else "default"}'.replace('e-0', 'e-')
    solve = partial(smoothed, width, tight)
    return Method(name, 'tanh friction, LSODA', solve, slow=tight and width < 5e-5)


def _switching_method(name: str, tight: bool, longest: float = math.inf) -> Method:
    """Return the method of :func:`.switching` with ``tight`` and ``longest``, which ``name`` describes."""
    return Method(f'switching, {name}', 'switching, solve_ivp', partial(switching, tight, longest))


def _harmonic_balance_method(harmonics: int) -> Method:
    """Return the method of :func:`.harmonic_balance` with some harmonics; slow with more than 31."""
    name, solve = f'harmonic balance, H = {harmonics}', partial(harmonic_balance, harmonics)
    return Method(name, 'harmonic balance', solve, has_resolvent, slow=harmonics > 31)


BASE, _AVERAGING_IN_BULK = _single_and_bulk('KBM', averaging)
"""The method whose time others are compared with, and the same in bulk."""
METHODS = (
    BASE,
    _AVERAGING_IN_BULK,
    *map(_harmonic_balance_method, HARMONICS),
    *(_smoothed_method(width, tight) for tight in (False, True) for width in WIDTHS),
    _switching_method('default', False),
    _switching_method('tight', True),
    _switching_method('tight, bounded step', True, 0.1),
    Method('event-driven integrator', 'event-driven integrator', event_driven),
    *_single_and_bulk('exact cycle', exact),
)
"""All methods, in the order of the tables."""

_FRICTION = Stribeck(static=0.30, kinetic=0.10, decay=10.0)
REFERENCE = Bearing(50.0, 400.0, 2.0e6, _FRICTION, journal_diameter=0.100)
"""The test-bench bearing of the docs."""
_RPM = REFERENCE.speed.factor('rpm')


def _bench_case(
    name: str, rpm: float, reference: float, load: float = 1000.0, quick: bool = False, **changes: Any
) -> Case:
    """Return a case of :data:`REFERENCE` with changed fields, at a speed [rpm] and a load [N].

    ``reference`` is its amplitude [m]; it and ``quick`` are as of :class:`Case`.
    """
    return Case(name, replace(REFERENCE, **changes), rpm * _RPM, load, reference, quick)


CASES = (
    # eta = 0.002: almost harmonic, overtakes the belt.
    _bench_case('weak friction', 30.0, 0.0007870856429556819, load=10.0, damping=4.0),
    # Near the fold at 40.7 rpm; just below the Hopf speed; in the middle of the unstable range;
    # sticks for an eighth of the cycle; crawls, far from harmonic.
    _bench_case('38 rpm', 38.0, 0.001000211996591925, quick=True),
    _bench_case('30 rpm', 30.0, 0.0008048004753024688),
    _bench_case('20 rpm', 20.0, 0.0005567552520338237, quick=True),
    _bench_case('10 rpm', 10.0, 0.0002969526471492934, quick=True),
    _bench_case('2 rpm', 2.0, 6.520669876360655e-05),
    # Grazes the belt: event location misses it.
    _bench_case('40 rpm', 40.0, 0.001048880117242072, quick=True),
    # nu = 0.05 s/m: friction rises again.
    _bench_case('viscous', 20.0, 0.0005525388009365229, friction=replace(_FRICTION, viscous=0.05)),
    # eta = 3: strongly damped, strongly driven.
    _bench_case('zeta = 0.3', 20.0, 0.000978449202489445, load=15000.0, damping=6000.0),
    # zeta = 0.02: a relaxation oscillation, sticks for 70 % of the cycle.
    _bench_case('eta = 5', 20.0, 0.0026514206849174407, load=25000.0),
)
"""Operating points of the reference bearing, easy ones first."""

TYPICAL = '20 rpm'
"""The case that stands for common use."""
