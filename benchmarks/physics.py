# SPDX-License-Identifier: Apache-2.0
"""What the physics costs for a point, in bulk, alone and inside the monitor, and for a bearing's boundaries.

Processor time, the best of some turns; beside each the time of ``numpy.exp`` over an array of that
size in the same run, which tells a slow machine from slow code.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.table import Table, duration, ratio
from stickslip_monitor import Assessment, Bearing, Monitor, Sample, Stribeck, Tabulated, assess, build_config
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.drawing.diagram import bifurcation_diagram
from stickslip_monitor.physics.averages_by_quadrature import average_curve, steady_slope_table
from stickslip_monitor.physics.boundary_table import boundary_table
from stickslip_monitor.physics.cycles import exact_amplitude
from stickslip_monitor.physics.fold_curve import fold_curve
from stickslip_monitor.physics.friction import FrictionLaw, Stretched

BEARING = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.30, 0.10, 10.0), 0.100)
_SPEEDS = np.linspace(0.0, 0.6, 15)
MEASURED = Bearing(50.0, 400.0, 2.0e6, Tabulated(_SPEEDS, 0.1 + 0.2 * np.exp(-10.0 * _SPEEDS)), 0.100)
_CLOSE = np.linspace(0.0, 0.6, 100)


@dataclass(frozen=True)
class Rational:
    """A law of one's own, by its methods alone: ``mu_k + gap / (1 + v / v_0)``."""

    static: float = 0.3
    gap: float = 0.2
    scale: float = 0.1
    breakpoints: tuple[float, ...] = ()

    def coefficient(self, speed: ArrayLike) -> FloatArray:
        """Return ``mu`` at relative speeds [m/s]."""
        v = np.asarray(speed, dtype=float)
        return np.where(v < 0.0, -1.0, 1.0) * (self.static - self.gap + self._falling_part(v))

    def slope(self, speed: ArrayLike) -> FloatArray:
        """Return ``d mu / d|v|`` at relative speeds [m/s]."""
        v = np.asarray(speed, dtype=float)
        return -self._falling_part(v) / (self.scale + np.abs(v))

    def _falling_part(self, v: FloatArray) -> FloatArray:
        return self.gap * self.scale / (self.scale + np.abs(v))


LAWS: dict[str, tuple[FrictionLaw, float]] = {
    'Stribeck': (Stribeck(0.30, 0.10, 10.0), 1.0),
    'Gaussian': (Stretched(0.30, 0.10, 10.0), 2.0),
    'a table of 100': (Tabulated(_CLOSE.tolist(), (0.1 + 0.2 * np.exp(-10.0 * _CLOSE)).tolist()), 4.0),
    "a law of one's own": (Rational(), 2.0),
}
"""Laws with the processor time that the exact amplitudes of a day may take [s]."""
DIAGRAMS = {'Stribeck': 0.1, 'a table of 100': 0.5}
"""The same for a diagram [s]."""
CLOSED = ('hopf_margin', 'fold_margin', 'hopf_load', 'fold_load', 'growth_rate')
THRESHOLD, STABLE, EXACT = 'threshold_amplitude', 'amplitude', 'amplitude_exact'
_TURNS = 5
_CACHED = fold_curve, boundary_table, average_curve, steady_slope_table
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
    many, table_size = (100_000, 2_000) if quick else (1_000_000, 20_000)
    bulk = {
        'boundaries and regime': (BEARING, many, ()),
        '+ margins, loads, growth rate, threshold': (BEARING, many, (*CLOSED, THRESHOLD)),
        '+ the exact amplitude': (BEARING, many, (*CLOSED, THRESHOLD, EXACT)),
        'boundaries, regime, stable KBM amplitude': (BEARING, many, (STABLE,)),
        'measured table: boundaries and regime': (MEASURED, table_size, ()),
        'measured table: + stable KBM amplitude': (MEASURED, table_size, (STABLE,)),
    }
    rows = [_measure_array(name, *case) for name, case in bulk.items()]
    single = {
        'one point: boundaries and regime': lambda: assess(BEARING, 0.1, 1000.0),
        'one point: + stable KBM amplitude': lambda: _compute_columns(assess(BEARING, 0.1, 1000.0), STABLE),
        'one point: + exact amplitude': lambda: _compute_columns(assess(BEARING, 0.1, 1000.0), EXACT),
        'one point of a measured table': lambda: assess(MEASURED, 0.1, 1000.0),
        '`Monitor.update`, stick-slip and an amplitude limit': _make_update(0.1),
        '`Monitor.update`, no stick-slip': _make_update(0.3),
    }
    rows += [_measure_day(name, law, limit, quick) for name, (law, limit) in LAWS.items()]
    rows += [_measure_diagram(name, LAWS[name][0], limit) for name, limit in DIAGRAMS.items()]
    single_number = np.full(1, 0.5)
    for name, call in single.items():
        seconds, reference = _best_time(call, 200), _best_time(lambda: np.exp(single_number), 2000)
        rows.append(_format_row(name, 1, seconds, reference))
    for name, law in _make_laws().items():
        table = partial(boundary_table, replace(BEARING, friction=law))
        table()  # compiles the law's loops
        seconds = _best_time(table, clear=True)
        rows.append(
            _format_row(
                f'boundaries over the load: {name}',
                1,
                seconds,
                _best_time(lambda: np.exp(single_number), 2000),
            )
        )
    return Table(
        title='Physics',
        text=(
            f'Operating points around the boundaries of the reference bearing, {many:,} in an'
            f' array ({table_size:,} where friction is a measured table of 15 points), and one by one.'
            ' Processor time on one core; the ratio is to `numpy.exp` over as many numbers in the'
            ' same run.'
        ),
        columns=('what', 'points a second', 'a point takes', 'ratio to exp'),
        rows=rows,
    )


def _make_laws() -> dict[str, FrictionLaw]:
    """Return the laws whose boundaries are tabulated, by name; the scatter of a table is seeded."""
    laws: dict[str, FrictionLaw] = {"Stribeck's law": BEARING.friction}
    for points, scatter in ((100, 0.0), (100, 0.002), (1000, 0.001)):
        speed = np.append(0.0, np.geomspace(0.005, 1.0, points - 1))
        noise = scatter * np.random.default_rng(1).standard_normal(points)
        name = f'a table of {points:,} points' + (f' that scatters by {scatter:g}' if scatter else '')
        laws[name] = Tabulated(speed, 0.1 + 0.2 * np.exp(-10.0 * speed) + noise)
    return laws


def _compute_columns(point: Assessment, *names: str) -> None:
    for name in names:
        getattr(point, name)


def _measure_array(name: str, bearing: Bearing, size: int, columns: tuple[str, ...]) -> list[str]:
    rng = np.random.default_rng(1)
    speed, load = rng.uniform(0.02, 0.25, size), rng.uniform(500.0, 1500.0, size)
    _compute_columns(assess(bearing, speed[:10], load[:10]), *columns)  # builds what a law needs
    seconds = _best_time(lambda: _compute_columns(assess(bearing, speed, load), *columns))
    return _format_row(name, size, seconds, _best_time(lambda: np.exp(speed)))


def _measure_day(name: str, law: FrictionLaw, limit: float, quick: bool) -> list[str]:
    """Time the exact amplitudes of a day, one a second, beside their limit [s]."""
    size, bearing = 8_640 if quick else 86_400, replace(BEARING, friction=law)
    rng = np.random.default_rng(2)
    speed, load = rng.uniform(0.02, 0.25, size), rng.uniform(500.0, 1500.0, size)
    exact_amplitude(bearing, speed[:500], load[:500])  # builds what a law needs, and compiles
    seconds = _best_time(lambda: exact_amplitude(bearing, speed, load))
    label = f'exact amplitudes of a day, {name} (limit {duration(limit / 86_400)})'
    return _format_row(label, size, seconds, _best_time(lambda: np.exp(speed)))


def _measure_diagram(name: str, law: FrictionLaw, limit: float) -> list[str]:
    """Time a diagram of 400 speeds, beside its limit [s]."""
    bearing, speeds = replace(BEARING, friction=law), (0.02, 0.3)
    bifurcation_diagram(bearing, 1000.0, speeds)
    loads = count(1001.0)  # each is new: what is cached must not count
    seconds = _best_time(lambda: bifurcation_diagram(bearing, next(loads), speeds))
    label = f'diagram of 400 speeds, {name} (limit {duration(limit / 400)})'
    return _format_row(label, 400, seconds, _best_time(lambda: np.exp(np.full(400, 0.5)), 100))


def _make_update(speed: float) -> Callable[[], None]:
    values = {f'aft.{key}': value for key, value in _SETTINGS.items()}
    monitor = Monitor(build_config({'bearings': ['aft']} | values))
    clock, loads = count(1), count(1000.0, 1e-3)

    def update() -> None:
        time_ns = next(clock) * 50_000_000
        load = time_ns % 100_000_000 == 0
        monitor.update(Sample('aft', 'load' if load else 'speed', time_ns, next(loads) if load else speed))

    update()
    return update


def _best_time(call: Callable[[], object], times: int = 1, clear: bool = False) -> float:
    """Return the processor time of one call [s]: the best of some turns of ``times`` calls.

    ``clear`` forgets before each turn what the physics keeps of laws and bearings.
    """
    best = np.inf
    for _ in range(_TURNS):
        for function in _CACHED if clear else ():
            function.cache_clear()
        begin = time.process_time()
        for _ in range(times):
            call()
        best = min(best, (time.process_time() - begin) / times)
    return float(best)


def _format_row(name: str, size: int, seconds: float, reference: float) -> list[str]:
    seconds_per_point = seconds / size
    return [name, f'{1.0 / seconds_per_point:,.0f}', duration(seconds_per_point), ratio(seconds / reference)]


if __name__ == '__main__':
    print(run().markdown())
