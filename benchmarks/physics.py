# SPDX-License-Identifier: Apache-2.0
"""What the physics costs for a point: in bulk, alone, and inside the monitor.

Processor time, the best of some turns; beside each the time of ``numpy.exp`` over an array of that
size in the same run, which tells a slow machine from slow code.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count

import numpy as np

from benchmarks.table import Table, duration, ratio
from stickslip_monitor import Assessment, Bearing, Monitor, Sample, Stribeck, Tabulated, assess, build_config

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
_SPEEDS = np.linspace(0.0, 0.6, 15)
MEASURED = Bearing(50.0, 400.0, 2.0e6, Tabulated(_SPEEDS, 0.1 + 0.2 * np.exp(-10.0 * _SPEEDS)), 0.100)
CLOSED = ('hopf_margin', 'fold_margin', 'hopf_load', 'fold_load', 'growth_rate')
THRESHOLD, STABLE, EXACT = 'threshold_amplitude', 'amplitude', 'amplitude_exact'
_TURNS = 5
_SETTINGS = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction.static': 0.3,
    'friction.kinetic': 0.1,
    'friction.decay': 10.0,
    'speed.topic': '/shaft/speed',
    'speed.unit': 'm/s',
    'load.topic': '/load',
    'load.unit': 'N',
    'alarm.amplitude_limit': 0.8e-3,
}


def run(quick: bool = False) -> Table:
    """Measure and lay out."""
    many, few = (100_000, 2_000) if quick else (1_000_000, 20_000)
    bulk = {
        'boundaries and regime': (BEARING, many, ()),
        '+ margins, loads, growth rate, threshold': (BEARING, many, (*CLOSED, THRESHOLD)),
        '+ the exact amplitude': (BEARING, many, (*CLOSED, THRESHOLD, EXACT)),
        'boundaries, regime, stable KBM amplitude': (BEARING, many, (STABLE,)),
        'measured table: boundaries and regime': (MEASURED, few, ()),
        'measured table: + stable KBM amplitude': (MEASURED, few, (STABLE,)),
    }
    rows = [_bulk(name, *case) for name, case in bulk.items()]
    single = {
        'one point: boundaries and regime': lambda: assess(BEARING, 0.1, 1000.0),
        'one point: + stable KBM amplitude': lambda: _ask(assess(BEARING, 0.1, 1000.0), STABLE),
        'one point: + exact amplitude': lambda: _ask(assess(BEARING, 0.1, 1000.0), EXACT),
        'one point of a measured table': lambda: assess(MEASURED, 0.1, 1000.0),
        '`Monitor.update`, stick-slip and an amplitude limit': _updates(0.1),
        '`Monitor.update`, no stick-slip': _updates(0.3),
    }
    one = np.full(1, 0.5)
    for name, call in single.items():
        seconds, reference = _best(call, 200), _best(lambda: np.exp(one), 2000)
        rows.append(_row(name, 1, seconds, reference))
    return Table(
        title='Physics',
        text=(
            f'Operating points around the boundaries of the reference bearing, {many:,} in an'
            f' array ({few:,} where friction is a measured table of 15 points), and one by one.'
            ' Processor time on one core; the ratio is to `numpy.exp` over as many numbers in the'
            ' same run.'
        ),
        columns=('what', 'points a second', 'a point takes', 'ratio to exp'),
        rows=rows,
    )


def _ask(point: Assessment, *names: str) -> None:
    for name in names:
        getattr(point, name)


def _bulk(name: str, bearing: Bearing, size: int, columns: tuple[str, ...]) -> list[str]:
    rng = np.random.default_rng(1)
    speed, load = rng.uniform(0.02, 0.25, size), rng.uniform(500.0, 1500.0, size)
    _ask(assess(bearing, speed[:10], load[:10]), *columns)  # builds what a law needs
    seconds = _best(lambda: _ask(assess(bearing, speed, load), *columns))
    return _row(name, size, seconds, _best(lambda: np.exp(speed)))


def _updates(speed: float) -> Callable[[], None]:
    values = {f'aft.{key}': value for key, value in _SETTINGS.items()}
    monitor = Monitor(build_config({'bearings': ['aft']} | values))
    clock, loads = count(1), count(1000.0, 1e-3)

    def update() -> None:
        time_ns = next(clock) * 50_000_000
        load = time_ns % 100_000_000 == 0
        monitor.update(Sample('aft', 'load' if load else 'speed', time_ns, next(loads) if load else speed))

    update()
    return update


def _best(call: Callable[[], object], times: int = 1) -> float:
    """Processor time of one call [s]: the best of some turns of so many calls."""
    best = np.inf
    for _ in range(_TURNS):
        begin = time.process_time()
        for _ in range(times):
            call()
        best = min(best, (time.process_time() - begin) / times)
    return float(best)


def _row(name: str, size: int, seconds: float, reference: float) -> list[str]:
    each = seconds / size
    return [name, f'{1.0 / each:,.0f}', duration(each), ratio(seconds / reference)]


if __name__ == '__main__':
    print(run().markdown())
