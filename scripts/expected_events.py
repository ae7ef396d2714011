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

The rule of docs/alarms.md is followed from sample to sample in the plainest way: the growth of a
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
# Averaging gives amplitudes that are up to 2 % too small from 30 rpm on (docs/findings.md).
_AVERAGED = 0.98
# A cycle outlives the fold by so many 2 m/c; what returns within so many off-delays is held for as
# many; lags of the speed's two means [s].
_DECAY, _HOLD, _FAST, _SLOW = 4.8, 6.0, 1.0, 4.0
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


def boundaries(config: BearingConfig, small: float = 1.0) -> dict[str, Inside]:
    """By name, functions of speed [m/s] and load [N] that are above 0 inside a boundary.

    Averaging takes amplitudes for ``small`` times what they are.
    """
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
        found['amplitude'] = amplitude(small * alarm.amplitude_limit)
        found['amplitude_clear'] = amplitude(
            small * alarm.amplitude_limit * (1.0 - alarm.hysteresis)
        )
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
    rates = {
        channel.quantity: channel.rate
        for channel in scene.channels
        if config in channel.bearings and channel.quantity != 'level'
    }
    spread = noise(scene, config)
    nominal = _follow(config, track, rates, 0.0, 0.0)
    shifted = [
        _follow(config, track, rates, up * spread[0], more * spread[1], small)
        for up, more, small in product((-SIGMAS, SIGMAS), (-SIGMAS, SIGMAS), (1.0, _AVERAGED))
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
            earliest=min(times) - 1.0 / max(rates.values()),
            # An amplitude is worked out once a second.
            latest=max(times)
            + sum(1.0 / rate for rate in rates.values())
            + (1.0 if 'amplitude_limit' in (_LADDER[before], _LADDER[after]) else 0.0),
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
    config: BearingConfig,
    track: Track,
    rates: dict[str, float],
    speed_error: float,
    load_error: float,
    small: float = 1.0,
) -> list[tuple[float, int, int]]:
    """The changes of rung of a track sampled at some rates [Hz]: time [s], before, after."""
    period = 1.0 / max(rates.values())
    rule = _Rule(config, period, 1.0 / rates['speed'], speed_error, small)
    speeds: list[float] = []
    loads: list[float] = []
    found, rung = [], 0
    for k in range(math.floor(float(track.time[-1]) / period + 1e-9) + 1):
        # Each value holds until the next of its input.
        at_speed, at_load = (
            math.floor(k * period * rate + 1e-9) / rate for rate in (rates['speed'], rates['load'])
        )
        if at_speed > k * period - 1e-9:
            speeds = [*speeds[-2:], track.at(at_speed)[0] + speed_error]
        if at_load > k * period - 1e-9:
            loads = [*loads[-2:], track.at(at_load)[1] + load_error]
        before, rung = rung, rule.take(speeds, loads)
        if rung != before:
            found.append((k * period, before, rung))
    return found


class _Counter:
    """A condition that changes after a net time; what returns soon is held for longer."""

    def __init__(self, on_delay: float, off_delay: float) -> None:
        self.on_delay, self.off_delay = on_delay, off_delay
        self.on = False
        self.seconds = 0.0
        self.cleared = -math.inf
        self.hold = 1.0

    def count(self, up: bool, seconds: float) -> None:
        """Time passes after a point that asks for a change, or not."""
        self.seconds = max(0.0, self.seconds + (seconds if up else -seconds))

    def look(self, asks: bool, now: float) -> None:
        """Change where a point asks for it and the delay is over."""
        if not asks or self.seconds < self.hold * (self.off_delay if self.on else self.on_delay):
            return
        self.on, self.seconds, self.hold = not self.on, 0.0, 1.0
        if not self.on:
            self.cleared = now
        elif now - self.cleared < _HOLD * self.off_delay:
            self.hold = _HOLD


class _Rule:
    """The rule of the decision on the samples of one bearing, without a level or a belief.

    Args:
        config: The bearing.
        period: Of the input that comes more often [s].
        pace: Period of the speed [s].
        speed_error: Contained in each speed [m/s].
        small: See :func:`boundaries`.
    """

    def __init__(
        self, config: BearingConfig, period: float, pace: float, speed_error: float, small: float
    ) -> None:
        alarm, bearing = config.alarm, config.bearing
        self.alarm, self.period, self.pace = alarm, period, pace
        self.still = config.speed.deadband
        self.half = bearing.damping / (2.0 * bearing.mass)
        self.inside = boundaries(config, small)
        # To half a rounding of the sum of periods.
        on = max(alarm.on_delay_ns * 1e-9, 4.0 * pace) - 1e-6
        self.off = max(alarm.off_delay_ns * 1e-9, 30.0 * pace) - 1e-6
        delays = [on, on, 0.0 if alarm.onset_growth else on, on]
        self.counters = [_Counter(own, self.off) for own in delays]
        self.decay = _DECAY / self.half if alarm.onset_growth else 0.0
        self.sticking = False
        self.growth = self.dying = self.idle = self.now = 0.0
        self.fast = self.slow = math.nan
        self.before: tuple[float, bool, bool, list[tuple[bool, bool]]] | None = None
        self.speed_error = speed_error

    def take(self, speeds: list[float], loads: list[float]) -> int:
        """Take the last three values of each input, at the next instant; return the rung."""
        if self.before is not None:
            self._pass(*self.before)
        speed, load = (sorted(values)[len(values) // 2] for values in (speeds, loads))
        still = speeds[-1] - self.speed_error <= self.still
        depths = {
            name: -1.0 if still else inside(speed, load) for name, inside in self.inside.items()
        }
        rate = -self.half if still else self.half * self.inside['hopf'](speeds[-1], loads[-1])
        self._follow(speed)
        beyond = not still and depths['fold'] <= 0.0
        self._judge(rate, beyond, still)
        asks = self._asks(depths, speed, load, still)
        for counter, own in zip(self.counters, asks, strict=True):
            counter.look(own[counter.on], self.now)
        self.before = rate, beyond, still, asks
        on = [counter.on for counter in self.counters]
        on[3] = on[3] and on[2]
        return max((k for k, own in enumerate(on, 1) if own), default=0)

    def _pass(self, rate: float, beyond: bool, still: bool, asks: list[tuple[bool, bool]]) -> None:
        """The period after the point before has passed."""
        self.now += self.period
        if self.sticking:
            self.dying = max(0.0, self.dying + (self.period if beyond else -self.period))
            self.idle = max(0.0, self.idle + (self.period if still else -self.period))
        else:
            self.growth = max(0.0, self.growth + rate * self.period)
        for counter, own in zip(self.counters, asks, strict=True):
            counter.count(own[counter.on], self.period)

    def _follow(self, speed: float) -> None:
        """Two lags of the speed [1 s and 4 s], whose difference is its slope."""
        if math.isnan(self.fast):
            self.fast = self.slow = speed
        self.fast += (speed - self.fast) * (1.0 - math.exp(-self.period / _FAST))
        self.slow += (speed - self.slow) * (1.0 - math.exp(-self.period / _SLOW))

    def _judge(self, rate: float, beyond: bool, still: bool) -> None:
        """Whether stick-slip runs."""
        if not self.sticking:
            if rate > 0.0 and self.growth >= self.alarm.onset_growth:
                self.sticking, self.dying, self.idle = True, 0.0, 0.0
        elif (beyond and self.dying >= self.decay - 1e-6) or (still and self.idle >= self.off):
            self.sticking, self.growth = False, 0.0

    def _asks(
        self, depths: dict[str, float], speed: float, load: float, still: bool
    ) -> list[tuple[bool, bool]]:
        """For each condition whether it holds, and whether it is clear of it."""
        sticking = self.sticking
        slope = (self.fast - self.slow) / (_SLOW - _FAST)
        future = speed + slope * self.alarm.look_ahead_ns * 1e-9
        comes = not still and self.inside['fold'](max(future, 1e-9), load) > 0.0
        coming = sticking or comes
        inside = sticking or depths['fold'] > 0.0
        over = sticking and depths.get('amplitude', -1.0) > 0.0
        small = not sticking or depths.get('amplitude_clear', -1.0) <= 0.0
        near, wide = (coming or depths[n] > 0.0 for n in ('caution', 'caution_clear'))
        return [(near, not wide), (inside, not inside), (sticking, not sticking), (over, small)]
