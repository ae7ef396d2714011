# SPDX-License-Identifier: Apache-2.0
"""When a scene's alarms are due, from the truth about its operating points and closed forms.

This is independent of the package's physics and of its monitor, so that bags can judge both. It
knows the Stribeck law without viscous rise. With ``K = N Delta beta / c``, ``w = beta V`` and
``I1e(x) = exp(-x) I1(x)``:

    growth rate                   g = (c/2m) (K exp(-w) - 1)
    within (1 + m) times the fold K 2 I1e(x)/x > 1,  x = w/(1 + m)

and the amplitude of a stick-slip cycle is half the stroke of its slip phase, integrated by scipy
from break-away to its end. The rule of the decision (docs/rule.md) is
followed from sample to sample in the plainest way: two means of the speed, the growth of a
disturbance, the time since the fold, and a counter for each condition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ive

from stickslip_lab.scenes.scene import Scene
from stickslip_logs.recordings.recording import Recording, Request
from stickslip_monitor.monitor.parameters import BearingConfig
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck

# Noise of this many standard deviations, on both signals at once, is allowed for.
SIGMAS = 4.0
# The decision's constants: docs/rule.md, "Why these numbers".
_DECAY, _HOLD, _FAST, _SLOW = 4.8, 6, 1.0, 4.0
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
        """Return the event for JSON, to the millisecond."""
        return {k: round(v, 3) if isinstance(v, float) else v for k, v in asdict(self).items()}


def expected_events(scene: Scene, bag: Recording) -> list[ExpectedEvent]:
    """Return the alarms due in a scene, in order of time.

    Args:
        scene: The scene.
        bag: Its recording, with the truth about every operating point.

    Raises:
        ValueError: Noise decides which alarms are due, or there is no closed form.
    """
    events = [
        event
        for config in scene.config.bearings
        for event in _of_bearing(scene, config, read_track(bag, config.name, scene.start_ns))
    ]
    return sorted(events, key=lambda event: event.time)


def boundaries(config: BearingConfig) -> dict[str, Inside]:
    """Return functions of speed [m/s] and load [N] that are above 0 inside a boundary, by its name."""
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
            if fold(0.0)(speed, load) <= 0.0:
                return -1.0
            return _cycle_amplitude(bearing, speed, load) / limit - 1.0

        return inside

    def turning(inside: Inside) -> Inside:
        """Leave everything where the shaft is at rest."""
        still = config.speed.deadband
        return lambda speed, load: inside(speed, load) if speed > still else -1.0

    boundary = {
        'hopf': hopf,
        'fold': fold(0.0),
        'caution': fold(alarm.caution_margin),
        'caution_clear': fold(alarm.caution_margin + alarm.hysteresis),
    }
    if math.isfinite(alarm.amplitude_limit):
        boundary['amplitude'] = amplitude(alarm.amplitude_limit)
        boundary['amplitude_clear'] = amplitude(alarm.amplitude_limit * (1.0 - alarm.hysteresis))
    return {name: turning(inside) for name, inside in boundary.items()}


@lru_cache(4096)
def _cycle_amplitude(bearing: Bearing, speed: float, load: float) -> float:
    """Return half the stroke of the slip phase of a stick-slip cycle [m]."""
    law, m, c, k = bearing.friction, bearing.mass, bearing.damping, bearing.stiffness

    def motion(_: float, state: FloatArray) -> list[float]:
        x, v = state
        slip = abs(speed - v)
        friction = law.kinetic + (law.static - law.kinetic) * math.exp(-law.decay * slip)
        return [v, (load * friction - c * v - k * x) / m]

    def turns(_: float, state: FloatArray) -> float:
        return float(state[1])

    # The lining turns at its crest, which the slip begins before, and at its trough. solve_ivp
    # takes from the function after how many it ends; mypy knows no such attribute.
    turns.terminal = 2  # type: ignore[attr-defined]
    start = [(load * law.static - c * speed) / k, speed]
    span = 20.0 * math.sqrt(m / k) + 10.0 * abs(start[0]) / speed
    slip = solve_ivp(motion, (0.0, span), start, 'DOP853', events=turns, rtol=1e-9, atol=1e-12)
    high, low = slip.y_events[0]
    return float(high[0] - low[0]) / 2.0


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
        speed, load = (np.interp(time, self.time, quantity) for quantity in (self.speed, self.load))
        return float(speed), float(load)


def read_track(bag: Recording, bearing: str, start_ns: int) -> Track:
    """Return the true operating point of a bearing in a recording."""
    requests = [Request(f'/truth/{bearing}/{name}', 'data') for name in ('speed', 'load')]
    series = bag.read(requests)
    speed, load = (series[request] for request in requests)
    time: FloatArray = (speed.log_time_ns - start_ns) / 1e9
    return Track(time, np.abs(speed.value), load.value)


def noise_of(scene: Scene, config: BearingConfig) -> tuple[float, float]:
    """Return the standard deviations of a bearing's speed [m/s] and load [N]."""
    deviation = {'speed': 0.0, 'load': 0.0}
    factors = {'kN': 1000.0, 'N': 1.0}
    for settings in scene.effects:
        is_noise = settings.name == 'sensor_noise' and (
            'bearing' not in settings or settings.value('bearing', '') == config.name
        )
        for quantity in deviation if is_noise else ():
            if quantity in settings:
                section = settings.value(quantity, '')
                unit, size = section['unit'], section['standard_deviation']
                speed = config.bearing.speed
                factor = factors[unit] if quantity == 'load' else speed.factor(unit)
                deviation[quantity] = size * factor
    return deviation['speed'], deviation['load']


def _shift_inputs(inside: Inside, speed_error: float, load_error: float) -> Inside:
    return lambda speed, load: inside(speed + speed_error, load + load_error)


def _find_crossings(inside: Inside, track: Track) -> list[tuple[float, bool]]:
    """Return where a track crosses a boundary, and whether it is inside from there on."""
    points = zip(track.time.tolist(), track.speed.tolist(), track.load.tolist(), strict=True)
    values = [(time, inside(speed, load)) for time, speed, load in points]
    return [
        (float(brentq(lambda t: inside(*track.at(t)), first, second, xtol=1e-9)), new_value > 0.0)
        for (first, old_value), (second, new_value) in pairwise(values)
        if (old_value > 0.0) != (new_value > 0.0)
    ]


def _of_bearing(scene: Scene, config: BearingConfig, track: Track) -> Iterator[ExpectedEvent]:
    """Follow the rule without noise, and with it at its worst on both signals."""
    rates = [channel.rate for channel in scene.channels if config in channel.bearings]
    spread = noise_of(scene, config)
    nominal = _follow_track(config, track, rates, 0.0, 0.0)
    shifted = [
        _follow_track(config, track, rates, up * spread[0], more * spread[1])
        for up, more in product((-SIGMAS, SIGMAS), repeat=2)
    ]
    if any([row[1:] for row in variant] != [row[1:] for row in nominal] for variant in shifted):
        raise ValueError(f'{config.name}: noise decides which alarms are due')
    for k, (time, old_rung, new_rung) in enumerate(nominal):
        times = [time, *(variant[k][0] for variant in shifted)]
        boundary, crossing = _nearest_crossing(config, track, time, old_rung, new_rung)
        yield ExpectedEvent(
            bearing=config.name,
            before=_LADDER[old_rung],
            after=_LADDER[new_rung],
            boundary=boundary,
            crossing=crossing,
            time=time,
            earliest=min(times) - 1.0 / max(rates),
            latest=max(times) + sum(1.0 / rate for rate in rates),
        )


def _nearest_crossing(
    config: BearingConfig, track: Track, time: float, old_rung: int, new_rung: int
) -> tuple[str, float]:
    """Return the boundary that a change is about, and where the track crosses it nearest in time."""
    raised = new_rung > old_rung
    name = (None, 'caution', 'fold', 'hopf', 'amplitude')[new_rung] if raised else 'fold'
    name = 'caution_clear' if not raised and new_rung == 0 else name
    assert name is not None
    near = np.abs(track.time - time) < 60.0
    track = Track(track.time[near], track.speed[near], track.load[near])
    roots = [at for at, is_in in _find_crossings(boundaries(config)[name], track) if is_in is raised]
    return name, min(roots, key=lambda at: abs(at - time), default=0.0)


def _follow_track(
    config: BearingConfig, track: Track, rates: list[float], speed_error: float, load_error: float
) -> list[tuple[float, int, int]]:
    """Return the changes of rung of a track sampled at two rates [Hz]: time [s], before, after."""
    rate = max(rates)
    rule = _Rule(config, 1.0 / rate, 1.0 / min(rates), speed_error, load_error)
    changes, rung = [], 0
    for k in range(math.floor(float(track.time[-1]) * rate + 1e-9) + 1):
        old_rung, rung = rung, rule.take(*track.at(k / rate))
        if rung != old_rung:
            changes.append((k / rate, old_rung, rung))
    return changes


class _Counter:
    """A condition with its delays, held longer where it comes back soon."""

    def __init__(self, on_delay: float, off_delay: float) -> None:
        self.on_delay, self.off_delay = on_delay, off_delay
        self.on = self.held = False
        self.seconds = 0.0
        self.cleared = -math.inf

    def count(self, up: bool, seconds: float) -> None:
        """Time passes after a point that asks for a change, or not."""
        self.seconds = max(0.0, self.seconds + (seconds if up else -seconds))

    def look(self, asks: bool, now: float) -> None:
        """Change where a point asks for it and the delay is over."""
        hold = _HOLD * self.off_delay
        due = self.on_delay if not self.on else hold if self.held else self.off_delay
        if asks and self.seconds >= due - 1e-9:
            self.on, self.seconds = not self.on, 0.0
            self.held = self.on and now - self.cleared < hold
            self.cleared = self.cleared if self.on else now


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
        self, config: BearingConfig, period: float, rhythm: float, speed_error: float, load_error: float
    ) -> None:
        alarm, bearing = config.alarm, config.bearing
        self.alarm, self.period, self.rhythm = alarm, period, rhythm
        self.half = bearing.damping / (2.0 * bearing.mass)
        self.inside = {
            name: _shift_inputs(boundary, speed_error, load_error)
            for name, boundary in boundaries(config).items()
        }
        self.speed_error = speed_error
        on, off = alarm.on_delay_ns * 1e-9, alarm.off_delay_ns * 1e-9
        self.counters = [_Counter(0.0 if rung == 2 else on, off) for rung in range(4)]
        self.sticking = False
        self.grown = self.gone = self.rate = 0.0
        self.speeds: list[float] = []
        self.loads: list[float] = []
        self.fast = self.slow = 0.0
        self.depths: dict[str, float] = {}
        self.asks = [False] * 4
        self.sizes: dict[str, float] = {}
        self.sized = -math.inf
        self.now = -period

    def take(self, speed: float, load: float) -> int:
        """Take a sample of each input; return the rung."""
        self.now += self.period
        self.speeds = [*self.speeds[-2:], speed + self.speed_error]
        self.loads = [*self.loads[-2:], load]
        median_speed, median_load = (
            sorted(values)[1] if len(values) > 2 else values[-1] for values in (self.speeds, self.loads)
        )
        self._follow_speed(median_speed)
        if self.now < self.rhythm - 0.5 * self.period:
            return 0  # the slower input has not come yet
        self._pass_period()
        # Errors are in the boundaries already.
        self.depths = {
            name: inside(median_speed - self.speed_error, median_load)
            for name, inside in self.inside.items()
            if not name.startswith('amplitude')
        }
        running = self.sticking and self.depths['fold'] > 0.0
        if running and self.now - self.sized >= 1.0 - 1e-9:
            self.sized = self.now
            self.sizes = {
                name: self.inside[name](median_speed - self.speed_error, median_load)
                for name in ('amplitude', 'amplitude_clear')
                if name in self.inside
            }
        self.depths |= self.sizes
        self.rate = self.half * self.inside['hopf'](median_speed - self.speed_error, median_load)
        self._update_sticking()
        requests = self._requested_changes(median_load)
        self.asks = [by_state[counter.on] for counter, by_state in zip(self.counters, requests, strict=True)]
        for counter, asks in zip(self.counters, self.asks, strict=True):
            counter.look(asks, self.now)
        self.asks = [
            by_state[counter.on] and asks
            for counter, by_state, asks in zip(self.counters, requests, self.asks, strict=True)
        ]
        on = [counter.on for counter in self.counters]
        on[3] = on[3] and on[2]
        return max((k for k, is_on in enumerate(on, 1) if is_on), default=0)

    def _follow_speed(self, speed: float) -> None:
        if len(self.speeds) == 1:
            self.fast = self.slow = speed
        self.fast += (speed - self.fast) * -math.expm1(-self.period / _FAST)
        self.slow += (speed - self.slow) * -math.expm1(-self.period / _SLOW)

    def _pass_period(self) -> None:
        """End the period after the previous point."""
        if not self.depths:
            return
        grown = self.grown + self.rate * self.period
        self.grown = 0.0 if self.sticking else max(0.0, grown)
        inside = self.depths['fold'] > 0.0
        self.gone = max(0.0, self.gone + (-self.period if inside else self.period))
        for counter, asks in zip(self.counters, self.asks, strict=True):
            counter.count(asks, self.period)

    def _update_sticking(self) -> None:
        if self.sticking:
            over = self.gone >= _DECAY / self.half - 1e-9
            self.sticking = self.depths['fold'] > 0.0 or not over
            if not self.sticking:
                self.sizes, self.sized = {}, -math.inf
        elif self.rate > 0.0 and self.grown >= self.alarm.onset_growth:
            self.sticking, self.gone = True, 0.0

    def _requested_changes(self, load: float) -> list[tuple[bool, bool]]:
        """Return for each condition whether it holds, and whether it is clear of it."""
        sticking, depths = self.sticking, self.depths
        coming = sticking or self._is_approaching_fold(load)
        inside = sticking or depths['fold'] > 0.0
        over = sticking and depths.get('amplitude', -1.0) > 0.0
        small = not sticking or depths.get('amplitude_clear', -1.0) <= 0.0
        near, wide = (coming or depths[n] > 0.0 for n in ('caution', 'caution_clear'))
        return [(near, not wide), (inside, not inside), (sticking, not sticking), (over, small)]

    def _is_approaching_fold(self, load: float) -> bool:
        """Return whether the slope of the speed leads below the fold within the time looked ahead."""
        slope = (self.fast - self.slow) / (_SLOW - _FAST)
        future = self._median_speed() + slope * self.alarm.look_ahead_ns * 1e-9
        return self.inside['fold'](max(future, 1e-9) - self.speed_error, load) > 0.0

    def _median_speed(self) -> float:
        return sorted(self.speeds)[1] if len(self.speeds) > 2 else self.speeds[-1]
