# SPDX-License-Identifier: Apache-2.0
"""The methods compared, and the operating points on which they are, from easy to hard.

The reference amplitudes are Taylor series in 40 digits by mpmath, which share no code with any
method; a test computes some of them again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from stickslip_monitor.lab.accuracy.harmonic_balance import harmonic_balance, has_resolvent
from stickslip_monitor.lab.accuracy.measurement import Case, Method, MethodResult, found, not_converged
from stickslip_monitor.lab.accuracy.time_stepping import event_driven, smoothed, switching
from stickslip_monitor.lab.findings import REFERENCE
from stickslip_monitor.physics.averaging import stationary_amplitudes
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.cycles import CycleKind, exact_cycle
from stickslip_monitor.physics.friction import Stribeck


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
