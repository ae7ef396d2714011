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
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.lab.scenes.effects.effect import UNITS, SceneRun, effect
from stickslip_monitor.lab.scenes.lining import (
    FACTOR,
    PER_PERIOD,
    PERIODS,
    STEP,
    FrictionCourse,
    Lining,
    episodes_of,
    half_peak_to_peak,
    parameters_of,
    window_times,
    with_parameters,
)
from stickslip_monitor.lab.scenes.profile import Profile, check_points, read_profile
from stickslip_monitor.lab.scenes.settings import Settings, random_stream
from stickslip_monitor.lab.scenes.telemetry import Channel, Shaft, nominal_load
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

    def record() -> None:
        time = run.instants(rate)
        for config, course in bearings:
            values = _operating_point(config, course, run.shaft, time)
            run.truth.extend(
                Column(topic(config.name, name), FLOAT64, time, value)
                for name, value in values.items()
            )

    run.effects.append(record)


def _operating_point(
    config: BearingConfig, course: FrictionCourse, shaft: Shaft, time: FloatArray
) -> dict[str, FloatArray]:
    """Speed, load, and the margins with the true friction, each shape (n,)."""
    speed, load = shaft.speed(config.name, time), shaft.load(config.name, time)
    # A law is one of its own for each step only if its shape moves: slow where it is solved.
    step = time // STEP if course.drifts.keys() - {FACTOR} else np.zeros(time.size)
    hopf, fold = np.empty(time.size), np.empty(time.size)
    carried = load * course.factor(time)
    for own in np.split(np.arange(time.size), np.flatnonzero(np.diff(step)) + 1):
        if own.size:
            law = course.at(float(time[own[0]]), scaled=False)
            bearing = replace(config.bearing, friction=law)
            hopf[own] = hopf_speed(bearing, carried[own])
            fold[own] = fold_speed(bearing, carried[own])
    margins = {'hopf_margin': hopf, 'fold_margin': fold}
    return {'speed': speed, 'load': load} | {
        name: np.round(margin(np.abs(speed), boundary), _DIGITS)
        for name, boundary in margins.items()
    }


_HIGHEST_MOTION_RATE = 100_000.0
# Natural periods without a stick after which an episode is over: longer than a ring-down, and than
# the ripple of the blades takes to stop sticking and to let it begin again.
_GAP = 50.0
_MOTION = ('displacement', 'velocity', 'acceleration')
Take = Callable[[FloatArray, FloatArray], None]
"""Takes m instants [s] and the motion at each, shape (4, m, samples in a window)."""
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
        lining = Lining(config, run.shaft, course, factor * deviation, own, random)
        followed = FollowedLining(lining, run)
        # Windows of a higher rate would overlap.
        most = 1.0 / (PERIODS * followed.period)
        if rate := _rate(settings, 'amplitude', most):
            followed.asked.append((rate, followed.period, followed.record_amplitude))
        if rate := _rate(settings, 'motion', _HIGHEST_MOTION_RATE):
            followed.asked.append((rate, 0.0, followed.record_motion))
        if channel := _level_channel(run, config, most):
            send = partial(followed.send_level, channel)
            followed.asked.append((channel.rate, followed.period, send))
        run.effects.append(followed.record)


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


class FollowedLining:
    """One bearing: its lining, and what is recorded of it."""

    def __init__(self, lining: Lining, run: SceneRun) -> None:
        self.lining, self._run = lining, run
        self.period = 2.0 * math.pi / lining.config.bearing.natural_frequency
        # What is sampled: its rate [Hz], the natural period [s] if it takes windows, and who
        # takes it.
        self.asked: list[tuple[float, float, Take]] = []

    def record(self) -> None:
        """Follow the lining; record its sticks, its events and what is asked for."""
        run = self._run
        windows = [self._windows(rate, period) for rate, period, _ in self.asked]
        times = np.unique(np.concatenate([np.empty(0), *(own.ravel() for own in windows)]))
        end = min(math.ceil(run.end * self.lining.rate) / self.lining.rate, run.duration)
        motion, changes = self.lining.follow(end, times)
        sticks, events = episodes_of(changes, _GAP * self.period, end)
        told = [(0.0, self._event('start', 0.0))]
        for event in events:
            more = {'sticks': event.sticks, 'sticking': round(event.sticking, _INSTANTS)}
            only = more if event.name == 'last_stick' else {}
            told.append((event.known, self._event(event.name, event.time, **only)))
        told.append((end, self._event('end', end)))
        self._add('stick', FLOAT64, *self._due([(t, round(d, _INSTANTS)) for t, d in sticks]))
        self._add('events', STRING, *self._due(told))
        for own, (_, _, take) in zip(windows, self.asked, strict=True):
            take(own[:, -1], motion[:, np.searchsorted(times, own)])

    def record_amplitude(self, time: FloatArray, motion: FloatArray) -> None:
        """Record the amplitude in windows."""
        self._add('amplitude', FLOAT64, time, self._amplitude(motion))

    def record_motion(self, time: FloatArray, motion: FloatArray) -> None:
        """Record the motion at some times."""
        for name, values in zip(_MOTION, motion[:3, :, 0], strict=True):
            self._add(name, FLOAT64, time, values)
        self._add('sticking', BOOL, time, motion[3, :, 0].astype(np.bool_))

    def send_level(self, channel: Channel, time: FloatArray, motion: FloatArray) -> None:
        """Add to the level that is sent the RMS value of a harmonic motion of the amplitude."""
        power, factor = LEVEL_FACTORS[channel.input.unit]
        frequency = self.lining.config.bearing.natural_frequency
        scale = frequency**power * factor * math.sqrt(0.5)
        signal = self._run.signals[channel.topic]
        own = np.zeros(signal.time.size)
        own[np.searchsorted(signal.time, time)] = self._amplitude(motion) * scale
        signal.value[:] = np.hypot(signal.value, own)

    def _windows(self, rate: float, period: float) -> FloatArray:
        """The times to sample at; a window before the scene's start is not there."""
        instants = self._run.instants(rate)
        return window_times(instants[1:] if period else instants, period)

    def _amplitude(self, motion: FloatArray) -> FloatArray:
        step = self.period / PER_PERIOD
        return np.round(half_peak_to_peak(motion[0], motion[1], step), _PLACES)

    def _due(self, pending: Sequence[tuple[float, Any]]) -> tuple[FloatArray, NDArray[Any]]:
        """The times [s] and values of what is known before the recording ends."""
        run = self._run
        due = [own for own in pending if own[0] < run.end or run.end == run.duration]
        return np.array([time for time, _ in due]), np.array([value for _, value in due])

    def _event(self, name: str, time: float, **more: float) -> str:
        stamp = self._run.start_ns + round(time * 1e9)
        return event_text(self.lining.config.name, name, stamp, **more)

    def _add(self, name: str, kind: str, time: FloatArray, values: Any) -> None:
        own = topic(self.lining.config.name, name)
        self._run.truth.append(Column(own, kind, time, values))
