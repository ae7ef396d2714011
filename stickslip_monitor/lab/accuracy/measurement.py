# SPDX-License-Identifier: Apache-2.0
"""What accuracy costs in time: every method on every case, its error and its time.

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
from stickslip_monitor.lab.accuracy.cases import Case
from stickslip_monitor.lab.accuracy.method import Method, MethodOutcome

Clock = Callable[[], float]

_DISTURBED = 1.2
_FLOOR = 1e-14
_LARGEST = 16 << 20


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to measure."""

    budget: float = 0.5  # time to spend on one method at one case [s]
    sample: float = 2e-3  # shortest sample; faster calls are repeated within it [s]
    fewest: int = 5  # fewest samples
    most: int = 101  # most samples


QUICK = Effort(budget=0.02, sample=1e-3, fewest=3, most=15)


@dataclass(frozen=True, slots=True)
class Timing:
    """How long a call takes."""

    # Median of the undisturbed samples; of process time where most were disturbed [s].
    seconds: float
    samples: int  # number of samples that count
    disturbed: bool  # whether most samples were disturbed


def time_call(
    call: Callable[[], object],
    effort: Effort,
    wall: Clock = time.perf_counter,
    cpu: Clock = time.process_time,
) -> Timing:
    """Measure a call that has been made before, and so is warm, by two clocks [s]."""
    start = wall()
    call()
    once = max(wall() - start, 1e-9)
    inner = max(1, math.ceil(effort.sample / once))
    samples: list[tuple[float, float]] = []
    while len(samples) < effort.fewest or (
        len(samples) < effort.most and wall() - start < effort.budget
    ):
        wall_begin, cpu_begin = wall(), cpu()
        for _ in range(inner):
            call()
        samples.append(((wall() - wall_begin) / inner, (cpu() - cpu_begin) / inner))
    quiet = [w for w, c in samples if w <= _DISTURBED * c]
    if 2 * len(quiet) >= len(samples):
        return Timing(median(quiet), len(quiet), disturbed=False)
    return Timing(median(c for _, c in samples), len(samples), disturbed=True)


@dataclass(frozen=True, slots=True)
class Row:
    """A method at a case."""

    method: str  # name of the method
    family: str  # its family
    case: str  # name of the case
    amplitude: float  # what it says [m]; ``nan`` for nothing
    error: float  # relative error of the amplitude, with its sign [-]; ``nan`` without one
    outcome: str  # name of its :class:`MethodOutcome`, in lower case
    evaluations: int  # evaluations of the friction law; -1 where they are not counted
    points: int  # operating points solved in one call
    seconds: float  # time per operating point [s]; ``nan`` where it was refused
    samples: int  # samples behind that time
    disturbed: bool  # whether the machine was busy with something else


def measure(method: Method, case: Case, effort: Effort) -> Row:
    """Error and time of a method at a case; the first call warms it up."""
    result = method.solve(case.bearing, case.speed, case.load)
    timing = Timing(math.nan, 0, disturbed=False)
    if result.outcome is not MethodOutcome.REFUSED:
        timing = time_call(lambda: method.amplitude(case.bearing, case.speed, case.load), effort)
    return Row(
        method=method.name,
        family=method.family,
        case=case.name,
        amplitude=result.amplitude,
        # Free of cancellation.
        error=(result.amplitude - case.reference) / case.reference,
        outcome=result.outcome.value,
        evaluations=-1 if result.evaluations is None else result.evaluations,
        points=method.points,
        seconds=timing.seconds / method.points,
        samples=timing.samples,
        disturbed=timing.disturbed,
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
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.method, []).append(row)
    return [_summary(group, unit) for group in groups.values()]


def _summary(group: list[Row], unit: dict[str, float]) -> Summary:
    used = [row for row in group if row.outcome != 'refused']
    errors = [abs(row.error) if math.isfinite(row.error) else math.inf for row in used]
    ratios = [row.seconds / unit[row.case] for row in used if row.case in unit]
    return Summary(
        method=group[0].method,
        family=group[0].family,
        points=group[0].points,
        seconds=median(row.seconds for row in used) if used else math.nan,
        ratio=median(ratios) if ratios else math.nan,
        worst=max(errors, default=math.nan),
        middle=median(errors) if errors else math.nan,
        answered=sum(math.isfinite(error) for error in errors),
        refused=len(group) - len(used),
    )


def pareto(seconds: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Which points no other point beats in time and error together, by rising time.

    Points that are not finite take no part; errors below rounding are equal.
    """
    usable = [i for i, (t, e) in enumerate(zip(seconds, errors, strict=True))
              if math.isfinite(t) and math.isfinite(e)]  # fmt: skip
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
        return [_parsed(line) for line in lines]
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f'{path} has a cell that is no number: {error}') from error


def _parsed(line: dict[str, str]) -> Row:
    values = {field.name: _PARSERS[str(field.type)](line[field.name]) for field in fields(Row)}
    # Each value was parsed by the type of its field, which the type checker cannot follow.
    return Row(**values)  # type: ignore[arg-type]
