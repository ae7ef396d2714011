# SPDX-License-Identifier: Apache-2.0
"""When a scene's alarms are due, from the truth about its operating points and closed forms.

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
from itertools import groupby, pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ive

from stickslip_monitor.bags.bag import Bag
from stickslip_monitor.bags.values import Request
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.scenes.scene import Scene

# Noise of this many standard deviations, on both signals at once, is allowed for.
SIGMAS = 4.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_LADDER = ('normal', 'caution', 'bistable', 'stick_slip', 'amplitude_limit')

FloatArray = NDArray[np.float64]
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


def expected_events(scene: Scene, bag: Bag) -> list[ExpectedEvent]:
    """The alarms due in a scene, in order of time.

    Args:
        scene: The scene.
        bag: Its recording, with the truth about every operating point.

    Raises:
        ValueError: Noise decides which alarms are due, or there is no closed form.
    """
    found = [
        event
        for config in scene.config.bearings
        for event in _of_bearing(scene, config, read_track(bag, config.name, scene.start_ns))
    ]
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

    def turning(inside: Inside) -> Inside:
        """A shaft at rest is inside nothing."""
        still = config.speed.deadband
        return lambda speed, load: inside(speed, load) if speed > still else -1.0

    found = {
        'hopf': hopf,
        'fold': fold(0.0),
        'caution': fold(alarm.caution_margin),
        'caution_clear': fold(alarm.caution_margin + alarm.hysteresis),
    }
    if math.isfinite(alarm.amplitude_limit):
        found['amplitude'] = amplitude(alarm.amplitude_limit)
        found['amplitude_clear'] = amplitude(alarm.amplitude_limit * (1.0 - alarm.hysteresis))
    return {name: turning(inside) for name, inside in found.items()}


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


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The true operating point of a bearing, linear between the samples of its truth topics.

    Attributes:
        time: Since the scene's start, shape (n,) [s].
        speed: Magnitude of the surface speed, shape (n,) [m/s].
        load: Shape (n,) [N].
    """

    time: FloatArray
    speed: FloatArray
    load: FloatArray

    def at(self, time: float) -> tuple[float, float]:
        """Speed [m/s] and load [N] at a time [s]."""
        speed, load = (np.interp(time, self.time, own) for own in (self.speed, self.load))
        return float(speed), float(load)


def read_track(bag: Bag, bearing: str, start_ns: int) -> Track:
    """The true operating point of a bearing in a recording."""
    asked = [Request(f'/truth/{bearing}/{name}', 'data') for name in ('speed', 'load')]
    series = bag.read(asked)
    speed, load = (series[request] for request in asked)
    time: FloatArray = (speed.log_time_ns - start_ns) / 1e9
    return Track(time, np.abs(speed.value), load.value)


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


def _crossings(scene: Scene, config: BearingConfig, track: Track) -> Iterator[_Crossing]:
    """Every crossing of every boundary, with the spread that noise can give it."""
    spread = noise(scene, config)
    for name, inside in boundaries(config).items():
        nominal = _roots(inside, track)
        shifted = [
            _roots(_shifted(inside, up * spread[0], more * spread[1]), track)
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


def _roots(inside: Inside, track: Track) -> list[tuple[float, bool]]:
    """Where a track crosses a boundary, and whether it is inside from there on."""
    points = zip(track.time.tolist(), track.speed.tolist(), track.load.tolist(), strict=True)
    values = [(time, inside(speed, load)) for time, speed, load in points]
    return [
        (float(brentq(lambda t: inside(*track.at(t)), first, second, xtol=1e-9)), after > 0.0)
        for (first, before), (second, after) in pairwise(values)
        if (before > 0.0) != (after > 0.0)
    ]


def _of_bearing(scene: Scene, config: BearingConfig, track: Track) -> Iterator[ExpectedEvent]:
    """Walk from crossing to crossing; a track that starts inside a boundary crosses it there."""
    alarm = config.alarm
    start = track.at(0.0)
    period = sum(1.0 / c.rate for c in scene.channels if config in c.bearings)
    inside = dict.fromkeys(boundaries(config), False)
    memory = _Memory()
    rung = 0
    crossings = [
        _Crossing(name, True, 0.0, 0.0, 0.0)
        for name, is_inside in boundaries(config).items()
        if is_inside(*start) > 0.0
    ]
    crossings += sorted(_crossings(scene, config, track), key=lambda c: c.time)
    for time, group in groupby(crossings, key=lambda c: c.time):
        together = list(group)
        inside |= {crossing.name: crossing.inside for crossing in together}
        before, rung = rung, memory.rung(inside)
        if rung != before:
            delay = (alarm.on_delay_ns if rung > before else alarm.off_delay_ns) * 1e-9
            yield ExpectedEvent(
                bearing=config.name,
                before=_LADDER[before],
                after=_LADDER[rung],
                boundary=together[-1].name,
                crossing=time,
                time=time + delay,
                earliest=min(c.earliest for c in together) + delay,
                latest=max(c.latest for c in together) + delay + period,
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
