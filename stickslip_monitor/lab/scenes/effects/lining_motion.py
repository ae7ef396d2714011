# SPDX-License-Identifier: Apache-2.0
"""Effects on the lining: friction that drifts, and the truth about its motion.

Friction drift changes a parameter of the law (``static``, ``kinetic``, ``decay``, ``viscous``) or
a ``factor`` on the whole coefficient. Only the lining follows it; the monitor keeps its
configuration.

The motion comes from the event-driven integrator. The disturbance is a fluctuation of the contact
force, white on the grid of the integrator's drive, that no sensor sees: without any, steady
sliding would go on for ever below the Hopf speed. Intervals of sticking and events are always
recorded; amplitude and motion, sampled at their own rates, on request.

A level that the scene sends is the effective value of the motion: of a harmonic one with the
amplitude of the last four periods, as displacement, velocity or acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.lab.scenes.effects.effect import UNITS, SceneRun, effect
from stickslip_monitor.lab.scenes.lining import (
    PERIODS,
    STEP,
    AmplitudeWindows,
    Episodes,
    FrictionCourse,
    Instants,
    Lining,
    Walk,
    parameters_of,
    with_parameters,
)
from stickslip_monitor.lab.scenes.profile import Profile, check_points, read_profile
from stickslip_monitor.lab.scenes.settings import Settings, random_stream
from stickslip_monitor.lab.scenes.telemetry import Channel, TimeBlock, nominal_load
from stickslip_monitor.lab.truth import BOOL, FLOAT64, STRING, Column, event_text, topic
from stickslip_monitor.monitor.assessment import margin
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import fold_speed, hopf_speed

# Decimals of margins, of durations [s], as fine as a time stamp, and of amplitudes [m]: beyond
# them digits may differ between processors, and recordings must not.
_DIGITS, _INSTANTS, _PLACES = 9, 9, 12


@effect('lining', 'bearing', 'parameter', 'points', 'table')
def friction_drift(settings: Settings, run: SceneRun) -> None:
    """Lets a parameter of the friction law drift."""
    drift = read_profile(settings, 'value', run.duration, run.folder)
    for config in run.bearings(settings, settings.text('parameter', 'what moves')):
        law = config.bearing.friction
        name = settings.choice('parameter', parameters_of(law))
        _check_drift(settings, config, name, drift)
        run.courses.setdefault(config.name, FrictionCourse(law)).drifts[name] = drift


def _check_drift(settings: Settings, config: BearingConfig, name: str, drift: Profile) -> None:
    """What holds at the points holds between them: every rule of a law is a bound."""
    for time, value in zip(drift.times.tolist(), drift.values.tolist(), strict=True):
        if value < 0.0:
            what = f'{settings.name}: {name} = {value:g} at {time:g} s'
            raise SceneError(f'{what} must not be negative')
        try:
            with_parameters(config.bearing.friction, {name: value})
        except PhysicsError as error:
            raise SceneError(f'{settings.name} at {time:g} s: {error}') from error


_HIGHEST_POINT_RATE = 1000.0


@effect('lining', 'bearing', 'rate')
def operating_point(settings: Settings, run: SceneRun) -> None:
    """Records the operating points, each with its friction over time."""
    rate = settings.number('rate', 'Hz', above=0.0, most=_HIGHEST_POINT_RATE)
    bearings = [(config, run.course(config)) for config in run.bearings(settings)]

    def record(block: TimeBlock) -> None:
        time = block.instants(rate)
        for config, course in bearings:
            values = _operating_point(config, course, block, time)
            block.truth.extend(
                Column(topic(config.name, name), FLOAT64, time, value)
                for name, value in values.items()
            )

    run.effects.append(record)


def _operating_point(
    config: BearingConfig, course: FrictionCourse, block: TimeBlock, time: FloatArray
) -> dict[str, FloatArray]:
    """Speed, load, and the margins with the true friction, each shape (n,)."""
    speed, load = block.shaft.speed(config.name, time), block.shaft.load(config.name, time)
    step = time // STEP if course.drifts else np.zeros(time.size)
    hopf, fold = np.empty(time.size), np.empty(time.size)
    for own in np.split(np.arange(time.size), np.flatnonzero(np.diff(step)) + 1):
        if own.size:
            bearing = replace(config.bearing, friction=course.at(float(time[own[0]])))
            hopf[own] = hopf_speed(bearing, load[own])
            fold[own] = fold_speed(bearing, load[own])
    margins = {'hopf_margin': hopf, 'fold_margin': fold}
    return {'speed': speed, 'load': load} | {
        name: np.round(margin(np.abs(speed), boundary), _DIGITS)
        for name, boundary in margins.items()
    }


_HIGHEST_MOTION_RATE = 100_000.0
# Natural periods without a stick after which an episode is over: longer than a ring-down, and than
# the ripple of the blades takes to stop sticking and to let it begin again.
_GAP = 50.0
_DTYPES = {FLOAT64: np.float64, BOOL: np.bool_, STRING: np.object_}
_MOTION = ('displacement', 'velocity', 'acceleration', 'sticking')
LEVEL_FACTORS = {'um': (0, 1e6), 'mm/s': (1, 1e3), 'm/s^2': (2, 1.0), 'g': (2, 1.0 / 9.80665)}
"""Of each unit of a level the power of the frequency, and how many make an SI unit."""


@effect('lining', 'bearing', 'disturbance', 'knocks', 'knock_unit', 'amplitude', 'motion')
def lining_motion(settings: Settings, run: SceneRun) -> None:
    """Follows the lining: records when it sticks and what is asked for, and makes the level."""
    what = 'the fluctuation of the load that the lining feels, {standard_deviation, unit}'
    disturbance = settings.section('disturbance', ['standard_deviation', 'unit'], what)
    unit = disturbance.choice('unit', UNITS['load'])
    deviation = disturbance.number('standard_deviation', unit, least=0.0)
    knocks = _knocks(settings, run.duration)
    for config in run.bearings(settings):
        factor = run.shaft.channel(config.name, 'load').factor(unit)
        blow = _blow(settings, config)
        own = [(time, impulse * blow) for time, impulse in knocks]
        random = random_stream(run.seed, settings.name, config.name)
        course = run.course(config)
        lining = Lining(config, run.shaft, course, factor * deviation, own, random, run.duration)
        followed = FollowedLining(lining, run)
        # Windows of a higher rate would overlap.
        most = 1.0 / (PERIODS * followed.period)
        if rate := _rate(settings, 'amplitude', most):
            followed.ask_amplitude(rate)
        if rate := _rate(settings, 'motion', _HIGHEST_MOTION_RATE):
            followed.ask_motion(rate)
        if channel := _level_channel(run, config, most):
            followed.ask_level(channel)
        run.effects.append(followed.apply)


def _knocks(settings: Settings, duration: float) -> list[tuple[float, float]]:
    """Time [s] and impulse of each blow."""
    if 'knocks' not in settings:
        return []
    rows = settings.rows('knocks', 'blow', 'a list of blows [time in s, impulse in N s]')
    knocks = check_points(rows, duration)
    if knocks[-1][0] == duration:
        label = settings.label('knocks')
        raise SceneError(f'{label}: no blow can follow at {duration:g} s, where the scene ends')
    return knocks


def _blow(settings: Settings, config: BearingConfig) -> float:
    """One unit of a blow [N s]; of ``fold``, what gives the lining the nominal fold speed."""
    if 'knock_unit' not in settings or settings.choice('knock_unit', ('N s', 'fold')) == 'N s':
        return 1.0
    return config.bearing.mass * float(fold_speed(config.bearing, nominal_load(config)))


def _rate(settings: Settings, key: str, most: float) -> float:
    """The rate of what is asked for [Hz], 0 where it is not."""
    if key not in settings:
        return 0.0
    own = settings.section(key, ['rate'], 'its sampling, {rate: Hz}')
    return own.number('rate', 'Hz', above=0.0, most=most)


def _level_channel(run: SceneRun, config: BearingConfig, most: float) -> Channel | None:
    """The channel of a bearing's level, if the scene sends it, at a rate up to the most [Hz]."""
    try:
        channel = run.shaft.channel(config.name, 'level')
    except KeyError:
        return None
    if channel.input.unit not in LEVEL_FACTORS:
        raise SceneError(
            f'{config.name}.level.unit = {channel.input.unit} in the configuration: a scene can'
            f' send a level in {", ".join(LEVEL_FACTORS)} only'
        )
    if channel.rate > most:
        raise SceneError(
            f'telemetry.level.rate = {channel.rate:g} Hz must not be above {most:.3g} Hz for'
            f' bearing {config.name}: a value takes {PERIODS} natural periods'
        )
    return channel


class Pending:
    """Messages of one topic that are known and not yet due; times do not fall."""

    def __init__(self, name: str, kind: str) -> None:
        self._name, self._kind = name, kind
        self._time: FloatArray = np.empty(0)
        self._values: NDArray[Any] = np.empty(0, _DTYPES[kind])

    def add(self, time: ArrayLike, values: Any) -> None:
        """Add messages: times [s] and values, shape (n,)."""
        self._time = np.append(self._time, time)
        self._values = np.append(self._values, np.asarray(values, self._values.dtype))

    def due(self, end: float, last: bool) -> Column:
        """Take what falls before ``end`` [s], or all that there is."""
        count = self._time.size if last else int(np.searchsorted(self._time, end, 'left'))
        column = Column(self._name, self._kind, self._time[:count], self._values[:count])
        self._time, self._values = self._time[count:], self._values[count:]
        return column


class FollowedLining:
    """One bearing: its lining, followed block by block, and what is recorded of it."""

    def __init__(self, lining: Lining, run: SceneRun) -> None:
        self.lining, self._run = lining, run
        self.period = 2.0 * math.pi / lining.config.bearing.natural_frequency
        self._episodes = Episodes(_GAP * self.period)
        self._asked: list[tuple[Instants, Callable[[Walk], None]]] = []
        self._pending: dict[str, Pending] = {}
        self._send_level: Callable[[TimeBlock], None] | None = None
        self._record('stick', FLOAT64)
        self._record('events', STRING)
        self._event(0.0, 'start', 0.0)

    def _record(self, name: str, kind: str) -> Pending:
        self._pending[name] = Pending(topic(self.lining.config.name, name), kind)
        return self._pending[name]

    def ask_amplitude(self, rate: float) -> None:
        """Record the amplitude at a rate [Hz]."""
        self._take_amplitudes(rate, self._record('amplitude', FLOAT64), 1.0)

    def _take_amplitudes(self, rate: float, pending: Pending, scale: float) -> None:
        windows = AmplitudeWindows(rate, self.period, self._run.duration)

        def take(walk: Walk) -> None:
            at, found = windows.amplitudes(walk.displacement, walk.velocity)
            pending.add(at, np.round(found, _PLACES) * scale)

        self._asked.append((windows.instants, take))

    def ask_motion(self, rate: float) -> None:
        """Record the motion at a rate [Hz]."""
        kinds = {name: BOOL if name == 'sticking' else FLOAT64 for name in _MOTION}
        pending = {name: self._record(name, kind) for name, kind in kinds.items()}

        def take(walk: Walk) -> None:
            for name, own in pending.items():
                own.add(walk.time, getattr(walk, name))

        self._asked.append((Instants(rate, self._run.duration), take))

    def ask_level(self, channel: Channel) -> None:
        """Add to the level that is sent the RMS value of a harmonic motion of the amplitude."""
        pending, bearing = Pending('level', FLOAT64), self.lining.config.bearing
        power, factor = LEVEL_FACTORS[channel.input.unit]
        scale = bearing.natural_frequency**power * factor * math.sqrt(0.5)
        self._take_amplitudes(channel.rate, pending, scale)

        def send(block: TimeBlock) -> None:
            found = pending.due(block.end, block.end == block.duration)
            signal = block.signals[channel.topic]
            own = np.zeros(signal.time.size)
            # There is no window before the scene's start.
            own[np.searchsorted(signal.time, found.time)] = found.values
            signal.value[:] = np.hypot(signal.value, own)

        self._send_level = send

    def apply(self, block: TimeBlock) -> None:
        """Follow the lining through a block."""
        last = block.end == block.duration
        if self.lining.reached < block.end:
            self._follow(self.lining.next_end(block.end))
        if last:
            self._finish(block.end)
        block.truth.extend(pending.due(block.end, last) for pending in self._pending.values())
        if self._send_level:
            self._send_level(block)

    def _follow(self, end: float) -> None:
        asked = [instants.until(end) for instants, _ in self._asked]
        walk = self.lining.follow(end, np.unique(np.concatenate([np.empty(0), *asked])))
        for (_, take), own in zip(self._asked, asked, strict=True):
            take(walk.at(np.searchsorted(walk.time, own)))
        ended, events = self._episodes.see(walk)
        for time, duration in ended:
            self._pending['stick'].add(time, round(duration, _INSTANTS))
        for event in events:
            more = {'sticks': event.sticks, 'sticking': round(event.sticking, _INSTANTS)}
            only = more if event.name == 'last_stick' else {}
            self._event(event.known, event.name, event.time, **only)

    def _finish(self, end: float) -> None:
        if (since := self._episodes.since) is not None:
            self._pending['stick'].add(end, round(end - since, _INSTANTS))
        self._event(end, 'end', end)

    def _event(self, known: float, name: str, time: float, **more: float) -> None:
        stamp = self._run.start_ns + round(time * 1e9)
        text = event_text(self.lining.config.name, name, stamp, **more)
        self._pending['events'].add(known, text)
