# SPDX-License-Identifier: Apache-2.0
"""When a scene's alarms are due, from the truth about its operating points and closed forms.

This is independent of the package's physics and of its monitor, so that bags can judge both. It
knows the Stribeck law without viscous rise. With ``K = N Delta beta / c``, ``w = beta V`` and
``I1e(x) = exp(-x) I1(x)``:

    growth rate                   g = (c/2m) (K exp(-w) - 1)
    within (1 + m) times the fold K 2 I1e(x)/x > 1,  x = w/(1 + m)
    amplitude above A             N S(a; V) > c a/2,  a = omega A; for a <= V always, since
                                  a cycle, where there is one, is larger than V
    S(a; V) = (1/pi) integral_0^pi mu(V - a cos t) cos t dt, in two pieces about arccos(V/a)

The rule of the decision is followed from sample to sample in the plainest way: the growth of a
disturbance, the time since the fold, and a counter for each condition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ive

from stickslip_monitor.bags.reader import Bag
from stickslip_monitor.bags.values import Request
from stickslip_monitor.lab.scenes.scene import Scene
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.friction import Stribeck

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
    """Follow the rule without noise, and with it at its worst on both signals."""
    rates = [channel.rate for channel in scene.channels if config in channel.bearings]
    spread = noise(scene, config)
    nominal = _follow(config, track, rates, 0.0, 0.0)
    shifted = [
        _follow(config, track, rates, up * spread[0], more * spread[1])
        for up, more in product((-SIGMAS, SIGMAS), repeat=2)
    ]
    if any([row[1:] for row in other] != [row[1:] for row in nominal] for other in shifted):
        raise ValueError(f'{config.name}: noise decides which alarms are due')
    for k, (time, before, after) in enumerate(nominal):
        times = [time, *(other[k][0] for other in shifted)]
        boundary, crossing = _crossing(config, track, time, before, after)
        yield ExpectedEvent(
            bearing=config.name,
            before=_LADDER[before],
            after=_LADDER[after],
            boundary=boundary,
            crossing=crossing,
            time=time,
            earliest=min(times) - 1.0 / max(rates),
            latest=max(times) + sum(1.0 / rate for rate in rates),
        )


def _crossing(
    config: BearingConfig, track: Track, time: float, before: int, after: int
) -> tuple[str, float]:
    """The boundary that a change is about, and where the track crosses it nearest in time."""
    raised = after > before
    name = (None, 'caution', 'fold', 'hopf', 'amplitude')[after] if raised else 'fold'
    name = 'caution_clear' if not raised and after == 0 else name
    assert name is not None
    roots = [at for at, is_in in _roots(boundaries(config)[name], track) if is_in is raised]
    return name, min(roots, key=lambda at: abs(at - time), default=0.0)


def _follow(
    config: BearingConfig, track: Track, rates: list[float], speed_error: float, load_error: float
) -> list[tuple[float, int, int]]:
    """The changes of rung of a track sampled at two rates [Hz]: time [s], before, after."""
    rate = max(rates)
    rule = _Rule(config, 1.0 / rate, 1.0 / min(rates), speed_error, load_error)
    found, rung = [], 0
    for k in range(math.floor(float(track.time[-1]) * rate + 1e-9) + 1):
        before, rung = rung, rule.take(*track.at(k / rate))
        if rung != before:
            found.append((k / rate, before, rung))
    return found


class _Counter:
    """A condition with an integrating delay, which keeps longer when it keeps returning."""

    def __init__(self, on_delay: float, off_delay: float, holds: tuple[int, ...]) -> None:
        self.on_delay, self.off_delay, self.holds = on_delay, off_delay, holds
        self.on = False
        self.seconds = 0.0
        self.times = 0
        self.cleared = -math.inf

    def due(self) -> float:
        """The delay that runs [s]."""
        if not self.on:
            return self.on_delay
        return self.off_delay * self.holds[min(self.times, len(self.holds)) - 1]

    def count(self, up: bool, seconds: float, rhythm: float) -> None:
        """Time passes after a point that asks for a change, or not."""
        share = min(1.0, self.due() / 3.0 / rhythm)
        self.seconds = max(0.0, self.seconds + (1.0 if up else -1.0) * share * seconds)

    def look(self, asks: bool, now: float) -> None:
        """Change where a point asks for it and the delay is over."""
        if not asks or self.seconds < self.due() - 1e-9:
            return
        self.on, self.seconds = not self.on, 0.0
        if self.on:
            self.times = self.times + 1 if now - self.cleared < 60 * self.off_delay else 1
        else:
            self.cleared = now


class _Rule:
    """The rule of the decision on the samples of one bearing.

    Args:
        config: The bearing.
        period: Of the input that comes more often [s].
        rhythm: Period of the other one [s].
        speed_error: Added to each speed [m/s].
        load_error: Added to each load [N].
    """

    def __init__(
        self,
        config: BearingConfig,
        period: float,
        rhythm: float,
        speed_error: float,
        load_error: float,
    ) -> None:
        alarm, bearing = config.alarm, config.bearing
        self.alarm, self.period, self.rhythm = alarm, period, rhythm
        self.half = bearing.damping / (2.0 * bearing.mass)
        self.inside = {
            name: _shifted(own, speed_error, load_error)
            for name, own in boundaries(config).items()
        }
        self.speed_error = speed_error
        on, off = alarm.on_delay_ns * 1e-9, alarm.off_delay_ns * 1e-9
        delays = [on, on, 0.0 if alarm.onset_growth else on, on]
        holds = [(1, 60), (1, 60), (1, 6, 30), (1, 60)]
        self.counters = [_Counter(own, off, hold) for own, hold in zip(delays, holds, strict=True)]
        self.sticking = False
        self.grown = self.gone = 0.0
        self.speeds: list[float] = []
        self.before: tuple[dict[str, float], list[tuple[bool, bool]]] | None = None
        self.now = -period

    def take(self, speed: float, load: float) -> int:
        """Take a point; return the rung."""
        self.now += self.period
        # The first value of an input does not count: nothing is known of its rhythm.
        if self.before is not None and self.now > self.rhythm + 0.5 * self.period:
            self._pass(*self.before)
        self.speeds.append(speed + self.speed_error)
        depths = {name: inside(speed, load) for name, inside in self.inside.items()}
        self._latch(depths)
        asks = self._asks(depths, load)
        for counter, own in zip(self.counters, asks, strict=True):
            counter.look(own[counter.on], self.now)
        self.before = depths, asks
        on = [counter.on for counter in self.counters]
        on[3] = on[3] and on[2]
        return max((k for k, own in enumerate(on, 1) if own), default=0)

    def _pass(self, depths: dict[str, float], asks: list[tuple[bool, bool]]) -> None:
        """The period after the point before has passed."""
        most = self.alarm.onset_growth / 2.0 / (1.5 * self.rhythm)
        rate = min(max(self.half * depths['hopf'], -most), most)
        self.grown = 0.0 if self.sticking else max(0.0, self.grown + rate * self.period)
        share = min(1.0, 4.8 / self.half / 3.0 / self.rhythm) * self.period
        self.gone = max(0.0, self.gone + (-share if depths['fold'] > 0.0 else share))
        for counter, own in zip(self.counters, asks, strict=True):
            counter.count(own[counter.on], self.period, self.rhythm)

    def _latch(self, depths: dict[str, float]) -> None:
        if self.sticking:
            over = self.gone >= (4.8 / self.half if self.alarm.onset_growth else 0.0) - 1e-9
            self.sticking = depths['fold'] > 0.0 or not over
        elif depths['hopf'] > 0.0 and self.grown >= self.alarm.onset_growth:
            self.sticking, self.gone = True, 0.0

    def _asks(self, depths: dict[str, float], load: float) -> list[tuple[bool, bool]]:
        """For each condition whether it holds, and whether it is clear of it."""
        sticking = self.sticking
        coming = sticking or self._coming(load)
        inside = sticking or depths['fold'] > 0.0
        over = sticking and depths.get('amplitude', -1.0) > 0.0
        small = not sticking or depths.get('amplitude_clear', -1.0) <= 0.0
        near, wide = (coming or depths[n] > 0.0 for n in ('caution', 'caution_clear'))
        return [(near, not wide), (inside, not inside), (sticking, not sticking), (over, small)]

    def _coming(self, load: float) -> bool:
        """Whether the trend of the last seconds takes the speed below the fold."""
        late, early = self._mean(0.0, 1.75), self._mean(5.0, 10.0)
        ahead = self.alarm.look_ahead_ns * 1e-9
        if early is None or late is None or not ahead:
            return False
        slope = (late[1] - early[1]) / (early[0] - late[0])
        future = late[1] + slope * (late[0] + ahead)
        # The errors are in the speeds already.
        return self.inside['fold'](max(future, 1e-9) - self.speed_error, load) > 0.0

    def _mean(self, first: float, last: float) -> tuple[float, float] | None:
        """Mean age [s] and mean of the speeds between two ages [s]."""
        ages = range(round(first / self.period), round(last / self.period) + 1)
        ages = range(ages.start, min(ages.stop, len(self.speeds)))
        if not ages:
            return None
        known = self.speeds
        values = [sorted(known[max(0, len(known) - k - 3) : len(known) - k]) for k in ages]
        middle = [v[len(v) // 2] for v in values]
        return sum(ages) / len(ages) * self.period, sum(middle) / len(middle)
