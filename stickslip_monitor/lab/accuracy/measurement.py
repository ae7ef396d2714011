# SPDX-License-Identifier: Apache-2.0
"""What accuracy costs in time: methods, cases, and the error and the time of each on each.

Time is measured warm and repeatedly; the median counts. A sample in which the wall clock runs
well ahead of the process' own time was disturbed by another process and is left out.
"""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from statistics import median

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.files import read_file
from stickslip_monitor.physics.bearing import Bearing

Clock = Callable[[], float]

_DISTURBED = 1.2
_FLOOR = 1e-14
_LARGEST = 16 << 20


CYCLE, NO_CYCLE, NOT_CONVERGED, REFUSED = 'cycle', 'no_cycle', 'not_converged', 'refused'
"""How a method can end; refused is a bearing whose law it is not made for."""


@dataclass(frozen=True, slots=True)
class MethodResult:
    """What a method says of one operating point."""

    amplitude: float  # half the peak-to-peak displacement of the stable cycle [m]; ``nan`` without
    outcome: str
    # How often the friction law was asked, an array of speeds counting once; ``None`` where it
    # is not counted.
    evaluations: int | None


def found(amplitude: float, evaluations: int | None = None) -> MethodResult:
    """A result: a cycle where the amplitude is a number, none where it is ``nan``."""
    return MethodResult(amplitude, CYCLE if math.isfinite(amplitude) else NO_CYCLE, evaluations)


def not_converged(evaluations: int | None = None) -> MethodResult:
    """A result of a method that gave up within its allowed number of steps."""
    return MethodResult(math.nan, NOT_CONVERGED, evaluations)


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
        raise ConfigurationError(f"{path} is no measurement of 'stickslip accuracy'")
    try:
        # Each value is parsed by the type of its field, which the type checker cannot follow.
        return [
            Row(**{f.name: _PARSERS[str(f.type)](line[f.name]) for f in fields(Row)})  # type: ignore[arg-type]
            for line in lines
        ]
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f'{path} has a cell that is no number: {error}') from error
