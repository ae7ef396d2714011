# SPDX-License-Identifier: Apache-2.0
"""The methods compared, and the operating points on which they are, from easy to hard.

The reference amplitudes are those of ``test/lab/accuracy/accuracy_reference.py``: Taylor series
in 40 digits by mpmath, in the lab frame and in SI units, which shares no code with any method. A
test computes some of them again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from stickslip_monitor.lab.accuracy.harmonic_balance import harmonic_balance, has_resolvent
from stickslip_monitor.lab.accuracy.method import Method, MethodResult, found, not_converged
from stickslip_monitor.lab.accuracy.perturbation import (
    Cubic,
    is_falling_cubic,
    polynomial_averaging,
    slip_perturbation,
    thomsen_fidlin,
)
from stickslip_monitor.lab.accuracy.time_stepping import (
    event_driven,
    smoothed,
    switching,
)
from stickslip_monitor.physics.averaging.boundaries import stationary_amplitudes
from stickslip_monitor.physics.cycle.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.friction import Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing


def averaging(points: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """Averaging as the monitor does it, of first order: closed forms for the Stribeck law."""
    speeds = speed if points == 1 else np.full(points, speed)
    cycles = stationary_amplitudes(bearing, speeds, load)
    first = (0,) * (cycles.amplitude.ndim - 1)
    stable = cycles.amplitude[first][cycles.stable[first]]
    closed = isinstance(bearing.friction, Stribeck)
    return found(float(stable[-1]) if stable.size else math.nan, 0 if closed else None)


def exact(points: int, bearing: Bearing, speed: float, load: float) -> MethodResult:
    """One slip phase from breakaway, the law set-valued (Filippov 1988); stick is a line."""
    cycle = exact_cycle(bearing, speed if points == 1 else np.full(points, speed), load)
    if np.ravel(cycle.kind)[0] == CycleKind.UNRESOLVED:
        return not_converged(None)
    return found(float(np.ravel(cycle.amplitude)[0]), None)


def has_law(*laws: type) -> Callable[[Bearing], bool]:
    """Whether a bearing has one of some friction laws."""
    return lambda bearing: isinstance(bearing.friction, laws)


AT_ONCE = 1000
ORDERS = (3, 5, 9, 15)
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
            f'KBM, polynomial of order {order}', 'KBM, polynomial',
            partial(polynomial_averaging, order), has_law(Stribeck),
        )
        for order in ORDERS
    ),
    Method('Thomsen and Fidlin', 'Thomsen and Fidlin', thomsen_fidlin, is_falling_cubic),
    *_single_and_bulk('slip perturbation', slip_perturbation),
    *(
        Method(
            f'harmonic balance, H = {harmonics}', 'harmonic balance',
            partial(harmonic_balance, harmonics), has_resolvent, slow=harmonics > 31,
        )
        for harmonics in HARMONICS
    ),
    *(_smoothed(width, tight) for tight in (False, True) for width in WIDTHS),
    _switching('default', False),
    _switching('tight', True),
    _switching('tight, bounded step', True, 0.1),
    Method(
        'event-driven integrator', 'event-driven integrator', event_driven,
        # It expands the laws that it knows.
        has_law(Stribeck, Coulomb, Tabulated),
    ),
    *_single_and_bulk('exact cycle', exact),
)  # fmt: skip
"""All methods, in the order of the tables."""

REFERENCE_LAW = Stribeck(0.30, 0.10, 10.0)
REFERENCE_BEARING = Bearing(50.0, 400.0, 2.0e6, REFERENCE_LAW, 0.100)
_RPM = math.pi * 0.100 / 60.0


@dataclass(frozen=True, slots=True)
class Case:
    """An operating point with the amplitude of its stable cycle."""

    name: str  # short and unique
    what: str  # what makes it easy or hard
    bearing: Bearing
    speed: float  # surface speed ``V`` [m/s]
    load: float  # load ``N`` [N]
    reference: float  # amplitude to 15 digits or more [m]
    quick: bool = False  # whether a quick look has it


def _bench(rpm: float, what: str, reference: float, quick: bool = False) -> Case:
    speed = rpm * _RPM
    return Case(f'{rpm:g} rpm', what, REFERENCE_BEARING, speed, 1000.0, reference, quick)


def _bearing(damping: float, law: Stribeck | Cubic = REFERENCE_LAW) -> Bearing:
    return Bearing(50.0, damping, 2.0e6, law, 0.100)


CASES = (
    Case(
        'weak friction', 'eta = 0.002, 30 rpm: almost harmonic, overtakes the belt',
        _bearing(4.0), 30.0 * _RPM, 10.0, 0.0007870856429556819,
    ),
    _bench(38.0, 'near the fold at 40.7 rpm', 0.001000211996591925, quick=True),
    _bench(30.0, 'just below the Hopf speed', 0.0008048004753024688),
    _bench(20.0, 'in the middle of the unstable range', 0.0005567552520338237, quick=True),
    _bench(10.0, 'sticks for an eighth of the cycle', 0.0002969526471492934, quick=True),
    _bench(2.0, 'crawls: far from harmonic', 6.520669876360655e-05),
    _bench(40.0, 'grazes the belt: event location misses it', 0.001048880117242072, quick=True),
    Case(
        'viscous', 'nu = 0.05 s/m, 20 rpm: friction rises again',
        _bearing(400.0, Stribeck(0.30, 0.10, 10.0, 0.05)), 20.0 * _RPM, 1000.0,
        0.0005525388009365229,
    ),
    Case(
        'zeta = 0.3', 'eta = 3, 20 rpm: strongly damped, strongly driven',
        _bearing(6000.0), 20.0 * _RPM, 15000.0, 0.000978449202489445,
    ),
    Case(
        'eta = 5', 'zeta = 0.02, 20 rpm: a relaxation oscillation, sticks for 70 % of the cycle',
        _bearing(400.0), 20.0 * _RPM, 25000.0, 0.0026514206849174407,
    ),
    Case(
        'cubic law', "Thomsen and Fidlin's law: mu_s 0.30, least 0.28 at 0.3 m/s",
        _bearing(40.0, Cubic(0.30, 0.28, 0.30)), 0.12, 1000.0, 0.0006037724617986298,
    ),
)  # fmt: skip
"""Easy ones first; the last is there for the one method that has its own law."""

TYPICAL = '20 rpm'
"""The case that stands for common use."""
