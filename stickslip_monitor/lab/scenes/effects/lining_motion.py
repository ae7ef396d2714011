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

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.lab.scenes.effects.effect import UNITS, BuildContext, EffectKind
from stickslip_monitor.lab.scenes.friction_course import (
    STEP,
    FrictionCourse,
    parameters_of,
    with_parameters,
)
from stickslip_monitor.lab.scenes.lining import (
    PERIODS,
    AmplitudeWindows,
    EpisodeEvent,
    Episodes,
    Impulse,
    Lining,
    Regular,
    Walk,
)
from stickslip_monitor.lab.scenes.profile import Profile, check_points, read_values
from stickslip_monitor.lab.scenes.settings import Settings
from stickslip_monitor.lab.scenes.shaft import TimeBlock
from stickslip_monitor.lab.scenes.telemetry import Channel, nominal_load
from stickslip_monitor.lab.scenes.windows import random_stream
from stickslip_monitor.monitor.assessment import margin
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.offline.truth import BOOL, FLOAT64, STRING, Column, event_text, topic
from stickslip_monitor.physics.averaging.boundaries import fold_speed, hopf_speed
from stickslip_monitor.physics.oscillator import Bearing

FRICTION_DRIFT_KEYS = ('bearing', 'parameter', 'points', 'table')


def build_friction_drift(settings: Settings, context: BuildContext) -> None:
    """Let the parameter drift."""
    drift = read_values(settings, 'value', context.duration, context.folder)
    for config in context.bearings(settings, settings.text('parameter', 'what moves')):
        law = config.bearing.friction
        name = settings.choice('parameter', parameters_of(law))
        _check(settings, config, name, drift)
        course = context.courses.setdefault(config.name, FrictionCourse(law))
        course.drifts[name] = drift


def _check(settings: Settings, config: BearingConfig, name: str, drift: Profile) -> None:
    """What holds at the points holds between them: every rule of a law is a bound."""
    for time, value in zip(drift.times.tolist(), drift.values.tolist(), strict=True):
        if value < 0.0:
            raise SceneError(
                f'{settings.name}: {name} = {value:g} at {time:g} s must not be negative'
            )
        try:
            with_parameters(config.bearing.friction, {name: value})
        except PhysicsError as error:
            raise SceneError(f'{settings.name} at {time:g} s: {error}') from error


OPERATING_POINT_KEYS = ('bearing', 'rate')
_HIGHEST_POINT_RATE = 1000.0
# The last digits of an exponential differ between processors, and recordings must not.
_DIGITS = 9


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """Records the operating points of some bearings, each with its friction over time."""

    rate: float
    bearings: list[tuple[BearingConfig, FrictionCourse]]

    def apply(self, block: TimeBlock) -> None:
        """Record those of a block."""
        time = block.instants(self.rate)
        for config, course in self.bearings:
            speed, load = block.shaft.speed(config.name, time), block.shaft.load(config.name, time)
            hopf, fold = _margins(config, course, time, speed, load)
            values = {'speed': speed, 'load': load, 'hopf_margin': hopf, 'fold_margin': fold}
            block.truth.extend(
                Column(topic(config.name, name), FLOAT64, time, value)
                for name, value in values.items()
            )


def _margins(
    config: BearingConfig,
    course: FrictionCourse,
    time: FloatArray,
    speed: FloatArray,
    load: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Hopf and fold margin with the true friction, each shape (n,)."""
    step = time // STEP if course.moves else np.zeros(time.size)
    felt = load * course.factor_at(time)
    edges = [0, *(np.flatnonzero(np.diff(step)) + 1).tolist(), time.size]
    hopf, fold = np.empty(time.size), np.empty(time.size)
    for low, high in pairwise(edges):
        if low < high:
            bearing = replace(config.bearing, friction=course.shape_at(float(time[low])))
            hopf[low:high] = hopf_speed(bearing, felt[low:high])
            fold[low:high] = fold_speed(bearing, felt[low:high])
    return _rounded(margin(np.abs(speed), hopf)), _rounded(margin(np.abs(speed), fold))


def _rounded(margins: FloatArray) -> FloatArray:
    return np.asarray(np.round(margins, _DIGITS))


def build_operating_point(settings: Settings, context: BuildContext) -> OperatingPoint:
    """Build the effect."""
    rate = settings.number('rate', 'Hz', above=0.0, most=_HIGHEST_POINT_RATE)
    bearings = context.bearings(settings)
    return OperatingPoint(rate, [(config, context.course(config)) for config in bearings])


LINING_MOTION_KEYS = ('bearing', 'disturbance', 'knocks', 'knock_unit', 'amplitude', 'motion')
_KNOCK_UNITS = ('N s', 'fold')
_HIGHEST_MOTION_RATE = 100_000.0
# Natural periods without a stick after which an episode is over: longer than a ring-down, and than
# the ripple of the blades takes to stop sticking and to let it begin again.
_GAP = 50.0
# Decimals of durations [s], as fine as a time stamp, and of amplitudes [m]: beyond them digits may
# differ between processors, and recordings must not.
_INSTANTS, _PLACES = 9, 12
_MOTION = ('displacement', 'velocity', 'acceleration')
LEVEL_FACTORS = {'um': (0, 1e6), 'mm/s': (1, 1e3), 'm/s^2': (2, 1.0), 'g': (2, 1.0 / 9.80665)}
"""Of each unit of a level the power of the frequency, and how many make an SI unit."""


class _Pending:
    """Messages of one topic that were found and are not yet due; times do not fall."""

    def __init__(self, name: str, kind: str) -> None:
        self._name, self._kind = name, kind
        self._time: FloatArray = np.empty(0)
        self._values: Any = np.empty(0) if kind == FLOAT64 else []

    def add(self, time: Any, values: Any) -> None:
        self._time = np.append(self._time, time)
        if self._kind == FLOAT64:
            self._values = np.append(self._values, values)
        else:
            self._values = [*self._values, *values]

    def due(self, end: float, last: bool) -> Column:
        """Take what falls before ``end``, or all that there is."""
        count = self._time.size if last else int(np.searchsorted(self._time, end, 'left'))
        column = Column(self._name, self._kind, self._time[:count], self._values[:count])
        self._time, self._values = self._time[count:], self._values[count:]
        return column


class _Watch:
    """Turns what the lining does into intervals and events."""

    def __init__(self, period: float) -> None:
        self.episodes = Episodes(_GAP * period)
        self.resting = False
        self.since: float | None = None

    def see(self, walk: Walk) -> tuple[list[tuple[float, float]], list[EpisodeEvent]]:
        """Ends and durations of the sticks that ended in a stretch, and its events."""
        ended: list[tuple[float, float]] = []
        events: list[EpisodeEvent] = []
        rests = ((time, 0, now) for time, now in walk.rests)
        sticks = ((time, 1, now) for time, now in walk.sticks)
        for time, is_stick, now in heapq.merge(rests, sticks):
            if is_stick and now:
                self.since = time
                events += [] if self.resting else self.episodes.stick(time)
            elif is_stick:
                start = time if self.since is None else self.since
                ended.append((time, round(time - start, _INSTANTS)))
                self.since = None
                self.episodes.release(time)
            else:
                self.resting = now
                if now:
                    self.episodes.release(time)
        return ended, events + self.episodes.passed(walk.end)


@dataclass(slots=True)
class _Told:
    """One bearing: its lining and what is told of it."""

    lining: Lining
    watch: _Watch
    start_ns: int
    duration: float
    amplitude: AmplitudeWindows | None
    motion: Regular | None
    level: tuple[Channel, AmplitudeWindows] | None
    pending: dict[str, _Pending] = field(default_factory=dict)
    levels: _Pending = field(default_factory=lambda: _Pending('level', FLOAT64))

    def __post_init__(self) -> None:
        kinds = {'stick': FLOAT64, 'events': STRING}
        if self.amplitude is not None:
            kinds['amplitude'] = FLOAT64
        if self.motion is not None:
            kinds |= dict.fromkeys(_MOTION, FLOAT64) | {'sticking': BOOL}
        name = self.lining.config.name
        self.pending = {k: _Pending(topic(name, k), kind) for k, kind in kinds.items()}
        self._event(0.0, 'start', 0.0)

    def columns(self, end: float) -> Iterator[Column]:
        """What is to be told before ``end`` [s], and at the scene's end all."""
        last = end == self.duration
        if self.lining.reached < end:
            self._follow(self.lining.next_end(end))
        if last:
            self._finish(end)
        return (pending.due(end, last) for pending in self.pending.values())

    def send_level(self, block: TimeBlock) -> None:
        """Add the lining's motion to the level of a block that has been followed."""
        if self.level is None:
            return
        found = self.levels.due(block.end, block.end == self.duration)
        signal = block.signals[self.level[0].topic]
        own = np.zeros(signal.time.size)
        # There is no window before the scene's start.
        own[np.searchsorted(signal.time, found.time)] = found.values
        signal.value[:] = np.hypot(signal.value, own)

    def _follow(self, end: float) -> None:
        none = np.empty(0)
        windows = [self.amplitude, None if self.level is None else self.level[1]]
        asked = [none if each is None else each.until(end) for each in windows]
        asked.append(none if self.motion is None else self.motion.until(end))
        times = np.concatenate(asked)
        order = np.argsort(times, kind='stable')
        walk = self.lining.follow(end, times[order])
        place = np.argsort(order, kind='stable')
        of_amplitude, of_level, of_motion = np.split(
            place, np.cumsum([part.size for part in asked])[:-1]
        )
        if self.amplitude is not None:
            at, found = _amplitudes(self.amplitude, walk, of_amplitude)
            self.pending['amplitude'].add(at, np.round(found, _PLACES))
        if self.level is not None:
            channel, own = self.level
            at, found = _amplitudes(own, walk, of_level)
            bearing = self.lining.config.bearing
            self.levels.add(at, effective_value(channel.input.unit, bearing, found))
        if self.motion is not None:
            self._tell_motion(walk, of_motion)
        ended, events = self.watch.see(walk)
        if ended:
            self.pending['stick'].add(*zip(*ended, strict=True))
        for event in events:
            more = {'sticks': event.sticks, 'sticking': round(event.sticking, _INSTANTS)}
            only = more if event.name == 'last_stick' else {}
            self._event(event.known, event.name, event.time, **only)

    def _tell_motion(self, walk: Walk, own: Any) -> None:
        for name in _MOTION:
            self.pending[name].add(walk.time[own], getattr(walk, name)[own])
        self.pending['sticking'].add(walk.time[own], walk.sticking[own].tolist())

    def _finish(self, end: float) -> None:
        if self.watch.since is not None:
            self.pending['stick'].add([end], [round(end - self.watch.since, _INSTANTS)])
        self._event(end, 'end', end)

    def _event(self, known: float, name: str, time: float, **more: float) -> None:
        stamp = self.start_ns + round(time * 1e9)
        text = event_text(self.lining.config.name, name, stamp, **more)
        self.pending['events'].add([known], [text])


def _amplitudes(
    windows: AmplitudeWindows, walk: Walk, own: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    return windows.amplitudes(walk.displacement[own], walk.velocity[own])


def effective_value(unit: str, bearing: Bearing, amplitude: FloatArray) -> FloatArray:
    """The RMS value in a unit of a harmonic motion with some amplitudes [m]."""
    power, factor = LEVEL_FACTORS[unit]
    scale = bearing.natural_frequency**power * factor * math.sqrt(0.5)
    return np.asarray(np.round(amplitude, _PLACES) * scale)


@dataclass(frozen=True, slots=True)
class LiningMotion:
    """Follows the linings of some bearings."""

    told: list[_Told]

    def apply(self, block: TimeBlock) -> None:
        """Follow them through a block."""
        for told in self.told:
            block.truth.extend(told.columns(block.end))
            told.send_level(block)


def build_lining_motion(settings: Settings, context: BuildContext) -> LiningMotion:
    """Build the effect."""
    own = settings.section(
        'disturbance',
        ['standard_deviation', 'unit'],
        'the fluctuation of the load that the lining feels, {standard_deviation, unit}',
    )
    unit = own.choice('unit', UNITS['load'])
    deviation = own.number('standard_deviation', unit, least=0.0)
    knocks = _knocks(settings, context.duration)
    told = []
    for config in context.bearings(settings):
        factor = context.shaft.channel(config.name, 'load').factor(unit)
        blows = [replace(k, impulse=k.impulse * _knock(settings, config)) for k in knocks]
        told.append(_told(settings, context, config, factor * deviation, blows))
    return LiningMotion(told)


def _knock(settings: Settings, config: BearingConfig) -> float:
    """One unit of a blow [N s]; of ``fold``, what gives the lining the nominal fold speed."""
    if 'knock_unit' not in settings or settings.choice('knock_unit', _KNOCK_UNITS) == 'N s':
        return 1.0
    return config.bearing.mass * float(fold_speed(config.bearing, nominal_load(config)))


def _told(
    settings: Settings,
    context: BuildContext,
    config: BearingConfig,
    deviation: float,
    knocks: list[Impulse],
) -> _Told:
    period = 2.0 * math.pi / config.bearing.natural_frequency
    random = random_stream(context.seed, settings.name, config.name)
    course = context.course(config)
    return _Told(
        lining=Lining(config, context.shaft, course, deviation, knocks, random, context.duration),
        watch=_Watch(period),
        start_ns=context.start_ns,
        duration=context.duration,
        amplitude=_amplitude(settings, period, context.duration),
        motion=_motion(settings, context.duration),
        level=_level(context, config, period),
    )


def _level(
    context: BuildContext, config: BearingConfig, period: float
) -> tuple[Channel, AmplitudeWindows] | None:
    """The channel of a bearing's level, and the windows that it is taken from."""
    channel = next(
        (
            c
            for c in context.channels
            if c.quantity == 'level' and config.name in [b.name for b in c.bearings]
        ),
        None,
    )
    if channel is None:
        return None
    if channel.input.unit not in LEVEL_FACTORS:
        raise SceneError(
            f'{config.name}.level.unit = {channel.input.unit} in the configuration: a scene can'
            f' send a level in {", ".join(LEVEL_FACTORS)} only'
        )
    most = AmplitudeWindows.highest_rate(period)
    if channel.rate > most:
        raise SceneError(
            f'telemetry.level.rate = {channel.rate:g} Hz must not be above {most:.3g} Hz for'
            f' bearing {config.name}: a value takes {PERIODS} natural periods'
        )
    return channel, AmplitudeWindows(channel.rate, period, context.duration)


def _rate(settings: Settings, key: str, most: float) -> float | None:
    if key not in settings:
        return None
    return settings.section(key, ['rate'], 'its sampling, {rate: Hz}').number(
        'rate', 'Hz', above=0.0, most=most
    )


def _amplitude(settings: Settings, period: float, duration: float) -> AmplitudeWindows | None:
    rate = _rate(settings, 'amplitude', AmplitudeWindows.highest_rate(period))
    return None if rate is None else AmplitudeWindows(rate, period, duration)


def _motion(settings: Settings, duration: float) -> Regular | None:
    rate = _rate(settings, 'motion', _HIGHEST_MOTION_RATE)
    return None if rate is None else Regular(rate, duration)


def _knocks(settings: Settings, duration: float) -> list[Impulse]:
    if 'knocks' not in settings:
        return []
    what = 'a list of blows [time in s, impulse in N s]'
    listed = settings.value('knocks', what)
    if not isinstance(listed, list) or not listed:
        raise settings.broken('knocks', f'must be {what}')
    label = settings.label('knocks')
    rows = [(f'{label}: blow {number}', blow) for number, blow in enumerate(listed, 1)]
    knocks = [Impulse(*point) for point in check_points(rows, duration)]
    if any(knock.time == duration for knock in knocks):
        raise SceneError(f'{label}: no blow can follow at {duration:g} s, where the scene ends')
    return knocks


EFFECTS = {
    'friction_drift': EffectKind(FRICTION_DRIFT_KEYS, build_friction_drift),
    'operating_point': EffectKind(OPERATING_POINT_KEYS, build_operating_point),
    'lining_motion': EffectKind(LINING_MOTION_KEYS, build_lining_motion),
}
