# SPDX-License-Identifier: Apache-2.0
"""When a scene's alarms are due, from its noise-free signals and closed forms.

This is independent of the package's physics and of its monitor, so that bags can judge both. It
knows the Stribeck law without viscous rise. With ``K = N Delta beta / c``, ``w = beta V`` and
``I1e(x) = exp(-x) I1(x)``:

    unstable                      K exp(-w) > 1
    within (1 + m) times the fold K 2 I1e(x)/x > 1,  x = w/(1 + m)
    amplitude above A             N S(a; V) > c a/2,  a = omega A; for a <= V always, since
                                  a cycle, where there is one, is larger than V
    S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt, in two pieces about arccos(V/a)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ive

from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.scenes.scene import Scene

# Noise of this many standard deviations, on both signals at once, is allowed for.
SIGMAS = 4.0
_STEP = 2.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_LADDER = ('normal', 'caution', 'bistable', 'stick_slip', 'amplitude_limit')

Point = Callable[[float], tuple[float, float]]
Inside = Callable[[float, float], float]


@dataclass(frozen=True, slots=True)
class ExpectedEvent:
    """One change of alarm; all times are in seconds since the scene's start.

    Attributes:
        bearing: The bearing.
        before: The condition before.
        after: The condition after.
        boundary: The boundary that is crossed.
        crossing: When the noise-free signals cross it.
        time: When the alarm is due: the crossing and the alarm's delay.
        earliest: When it may be due at the earliest, by noise.
        latest: When it may be due at the latest, by noise and sampling.
    """

    bearing: str
    before: str
    after: str
    boundary: str
    crossing: float
    time: float
    earliest: float
    latest: float

    def record(self) -> dict[str, Any]:
        """The event for JSON, to the millisecond."""
        return {k: round(v, 3) if isinstance(v, float) else v for k, v in asdict(self).items()}


def expected_events(scene: Scene) -> list[ExpectedEvent]:
    """The alarms due in a scene, in order of time."""
    found = [event for bearing in scene.config.bearings for event in _of_bearing(scene, bearing)]
    return sorted(found, key=lambda event: event.time)


def boundaries(config: BearingConfig) -> dict[str, Inside]:
    """By name, functions of speed [m/s] and load [N] that are above 0 inside a boundary."""
    bearing, alarm, law = config.bearing, config.alarm, config.bearing.friction
    if not isinstance(law, Stribeck) or law.viscous:
        raise ValueError(f'{config.name}: closed forms need a Stribeck law without viscous rise')
    drop, decay = law.static - law.kinetic, law.decay

    def hopf(speed: float, load: float) -> float:
        return load * drop * decay / bearing.damping * math.exp(-decay * speed) - 1.0

    def fold(margin: float) -> Inside:
        def inside(speed: float, load: float) -> float:
            x = decay * speed / (1.0 + margin)
            return float(load * drop * decay / bearing.damping * 2.0 * ive(1, x) / x - 1.0)

        return inside

    def amplitude(limit: float) -> Inside:
        def inside(speed: float, load: float) -> float:
            a = bearing.natural_frequency * limit
            if a <= speed:
                return 1.0
            return load * _work(law, a, speed) - bearing.damping * a / 2.0

        return inside

    found = {
        'hopf': hopf,
        'fold': fold(0.0),
        'caution': fold(alarm.caution_margin),
        'caution_clear': fold(alarm.caution_margin + alarm.hysteresis),
    }
    if math.isfinite(alarm.amplitude_limit):
        found['amplitude'] = amplitude(alarm.amplitude_limit)
        found['amplitude_clear'] = amplitude(alarm.amplitude_limit * (1.0 - alarm.hysteresis))
    return found


def _work(law: Stribeck, a: float, speed: float) -> float:
    """``S(a; V)`` for ``a > V > 0``."""
    turn = math.acos(speed / a)
    total = 0.0
    for low, high, sign in ((0.0, turn, -1.0), (turn, math.pi, 1.0)):
        t = 0.5 * (high - low) * _NODES + 0.5 * (high + low)
        slip = np.abs(speed - a * np.cos(t))
        friction = law.kinetic + (law.static - law.kinetic) * np.exp(-law.decay * slip)
        total += sign * 0.5 * (high - low) * float(_WEIGHTS @ (friction * np.cos(t)))
    return total / math.pi


def noise_free(scene: Scene, bearing: str) -> Point:
    """Speed [m/s] and load [N] of a bearing as a function of time [s], before any sensor."""
    shaft = scene.build().shaft

    def at(time: float) -> tuple[float, float]:
        instant = np.array([time])
        return float(shaft.speed(bearing, instant)[0]), float(shaft.load(bearing, instant)[0])

    return at


def noise(scene: Scene, config: BearingConfig) -> tuple[float, float]:
    """Standard deviations of a bearing's speed [m/s] and load [N]."""
    deviation = {'speed': 0.0, 'load': 0.0}
    factors = {'kN': 1000.0, 'N': 1.0}
    for settings in scene.effects:
        own = settings.name == 'sensor_noise' and (
            'bearing' not in settings or settings.value('bearing', '') == config.name
        )
        for quantity in deviation if own else ():
            if quantity in settings:
                section = settings.value(quantity, '')
                unit, size = section['unit'], section['standard_deviation']
                is_load = quantity == 'load'
                factor = factors[unit] if is_load else config.bearing.speed.factor(unit)
                deviation[quantity] = size * factor
    return deviation['speed'], deviation['load']


@dataclass(frozen=True, slots=True)
class _Crossing:
    name: str
    inside: bool
    time: float
    earliest: float
    latest: float


def _crossings(scene: Scene, config: BearingConfig) -> Iterator[_Crossing]:
    """Every crossing of every boundary, with the spread that noise can give it."""
    at, spread = noise_free(scene, config.name), noise(scene, config)
    times = np.linspace(0.0, scene.duration, math.ceil(scene.duration / _STEP) + 1).tolist()
    track = [(time, at(time)) for time in times]
    for name, inside in boundaries(config).items():
        nominal = _roots(inside, at, track)
        shifted = [
            _roots(_shifted(inside, up * spread[0], more * spread[1]), at, track)
            for up, more in product((-SIGMAS, SIGMAS), repeat=2)
        ]
        if any(len(other) != len(nominal) for other in shifted):
            raise ValueError(
                f'{config.name}: noise decides whether the boundary {name} is crossed'
            )
        for k, (time, is_in) in enumerate(nominal):
            ends = [other[k][0] for other in shifted]
            yield _Crossing(name, is_in, time, min(ends), max(ends))


def _shifted(inside: Inside, speed_error: float, load_error: float) -> Inside:
    return lambda speed, load: inside(speed + speed_error, load + load_error)


def _roots(
    inside: Inside, at: Point, track: list[tuple[float, tuple[float, float]]]
) -> list[tuple[float, bool]]:
    """Where a signal crosses a boundary, and whether it is inside from there on."""
    values = [(time, inside(*point)) for time, point in track]
    return [
        (float(brentq(lambda t: inside(*at(t)), first, second, xtol=1e-9)), after > 0.0)
        for (first, before), (second, after) in pairwise(values)
        if (before > 0.0) != (after > 0.0)
    ]


def _of_bearing(scene: Scene, config: BearingConfig) -> Iterator[ExpectedEvent]:
    """Walk from crossing to crossing; starting inside a boundary is not provided for."""
    start = noise_free(scene, config.name)(0.0)
    if boundaries(config)['caution_clear'](*start) > 0.0:
        raise ValueError(f'{config.name}: the scene must start clear of every boundary')
    period = sum(1.0 / c.rate for c in scene.channels)
    inside = dict.fromkeys(boundaries(config), False)
    memory = _Memory()
    rung = 0
    for crossing in sorted(_crossings(scene, config), key=lambda c: c.time):
        inside[crossing.name] = crossing.inside
        before, rung = rung, memory.rung(inside)
        if rung != before:
            rises = rung > before
            delay = (config.alarm.on_delay_ns if rises else config.alarm.off_delay_ns) * 1e-9
            yield ExpectedEvent(
                bearing=config.name,
                before=_LADDER[before],
                after=_LADDER[rung],
                boundary=crossing.name,
                crossing=crossing.time,
                time=crossing.time + delay,
                earliest=crossing.earliest + delay,
                latest=crossing.latest + delay + period,
            )


class _Memory:
    """What the past adds: stick-slip lasts to the fold, deadbands delay the clearing."""

    def __init__(self) -> None:
        self.sticking = self.near = self.over = False

    def rung(self, inside: dict[str, bool]) -> int:
        """The rung of the alarm's ladder."""
        self.sticking = inside['hopf'] or (self.sticking and inside['fold'])
        self.near = inside['caution'] or (self.near and inside['caution_clear'])
        above = inside.get('amplitude', False)
        clear = not inside.get('amplitude_clear', False)
        self.over = self.sticking and (above or (self.over and not clear))
        holds = (self.near, inside['fold'], self.sticking, self.over)
        return max((k for k, held in enumerate(holds, 1) if held), default=0)
