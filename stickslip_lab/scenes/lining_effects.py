# SPDX-License-Identifier: Apache-2.0
"""Declares effects on the lining: friction that drifts, and the truth about its motion.

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

import bisect
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_lab.scenes.effects import UNITS, SceneRun, effect
from stickslip_lab.scenes.lining import (
    FACTOR,
    LENGTH_DECIMALS,
    PER_PERIOD,
    PERIODS,
    STEP,
    TIME_DECIMALS,
    Episodes,
    FrictionCourse,
    Lining,
    Samples,
    drifting_parameters,
    half_peak_to_peak,
    replace_parameters,
)
from stickslip_lab.scenes.settings import Profile, Settings, check_points, random_stream, read_profile
from stickslip_lab.scenes.telemetry import MAX_RATE, Channel, TimeBlock, nominal_fold
from stickslip_lab.scenes.truth_topics import BOOL, FLOAT64, STRING, Column, event_text, topic
from stickslip_logs.units import factors_of, names_of
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.monitor.parameters import LEVEL_UNITS, BearingConfig
from stickslip_monitor.monitor.sample_types import INPUTS, WATER
from stickslip_monitor.physics.lubrication import MAX_TEMPERATURE, MIN_TEMPERATURE


@effect('lining', 'bearing', 'parameter', 'points', 'table')
def friction_drift(settings: Settings, run: SceneRun) -> None:
    """Let a ``parameter`` of the lining's friction law drift; the monitor keeps its configuration.

    The drift, as ``points`` or a ``table`` in the parameter's unit, goes into ``run.courses``.

    Raises:
        SceneError: A setting is missing or breaks its rule, or a value of the drift breaks one of the law.
    """
    drift = read_profile(settings, 'value', run.duration, run.folder)
    for config in run.claim_bearings(settings, settings.text('parameter', 'what moves')):
        law = config.bearing.friction
        name = settings.choice('parameter', drifting_parameters(law))
        _check_drift(settings, config, name, drift)
        run.courses.setdefault(config.name, FrictionCourse(law)).drifts[name] = drift


@effect('lining', 'bearing', 'points', 'table')
def water_temperature(settings: Settings, run: SceneRun) -> None:
    """Let the water at a bearing warm up or cool down [C]: in the lining, and on the topic that measures it.

    It goes into ``run.courses`` and ``run.shaft``. Bearings are claimed. Without such a topic the monitor
    keeps the temperature that it is configured with.

    Raises:
        SceneError: A setting breaks its rule, a temperature is out of range, friction does not depend on the
            water, or the topic serves a bearing that the effect is not for.
    """
    water = read_profile(settings, 'C', run.duration, run.folder)
    for time, value in zip(water.times.tolist(), water.values.tolist(), strict=True):
        if not MIN_TEMPERATURE <= value <= MAX_TEMPERATURE:
            raise SceneError(
                f'{settings.name}: {value:g} C at {time:g} s must be from {MIN_TEMPERATURE:g} to'
                f' {MAX_TEMPERATURE:g} C'
            )
    bearings = run.claim_bearings(settings)
    for config in bearings:
        lubrication = config.bearing.lubrication
        if lubrication is None or math.isnan(lubrication.temperature):
            raise SceneError(
                f'{settings.name}: {config.name} has no friction.at_temperature with a'
                ' water_temperature.constant: its friction does not depend on the water'
            )
        run.courses.setdefault(config.name, FrictionCourse(config.bearing.friction)).water = water
    for channel in run.channels:
        served = [config for config in channel.bearings if config in bearings]
        if channel.quantity != INPUTS[WATER] or not served:
            continue
        if len(served) < len(channel.bearings):
            names = ' and '.join(config.name for config in channel.bearings)
            raise SceneError(
                f'{settings.name}: topic {channel.topic} serves {names}: let the effect be for both'
            )
        run.shaft.set_water(channel.topic, water.at)


def _check_drift(settings: Settings, config: BearingConfig, name: str, drift: Profile) -> None:
    """Check that a drift keeps the rules of the law at each of its points, and so between them.

    Raises:
        SceneError: A value is negative, or the law refuses it.
    """
    for time, value in zip(drift.times.tolist(), drift.values.tolist(), strict=True):
        if value < 0.0:
            subject = f'{settings.name}: {name} = {value:g} at {time:g} s'
            raise SceneError(f'{subject} must not be negative')
        try:
            replace_parameters(config.bearing.friction, {name: value})
        except PhysicsError as error:
            raise SceneError(f'{settings.name} at {time:g} s: {error}') from error


@effect('lining', 'bearing', 'rate')
def operating_point(settings: Settings, run: SceneRun) -> None:
    """Add an effect to the run that records speed, load and true margins of each bearing at ``rate``.

    Raises:
        SceneError: The rate is missing, or not above 0 and up to 1 kHz.
    """
    rate = settings.number('rate', 'Hz', above=0.0, maximum=MAX_RATE)
    bearings = [(config, run.course(config)) for config in run.claim_bearings(settings)]

    def record(block: TimeBlock) -> None:
        """Append the columns of every bearing to the truth of a block."""
        time = block.instants(rate)
        for config, course in bearings:
            values = _operating_point(config, course, block, time)
            block.truth.extend(
                Column(topic(config.name, name), FLOAT64, time, value) for name, value in values.items()
            )

    run.effects.append(record)


def _operating_point(
    config: BearingConfig, course: FrictionCourse, block: TimeBlock, time: FloatArray
) -> dict[str, FloatArray]:
    """Return speed [m/s], load [N] and the margins with the true friction by topic name, shape (n,) each.

    The names are ``speed``, ``load``, ``hopf_margin`` and ``fold_margin``.

    Args:
        config: The bearing.
        course: Its friction over time.
        block: Block of the scene.
        time: Times within it, ascending, shape (n,) [s].
    """
    speed, load = block.shaft.speed(config.name, time), block.shaft.load(config.name, time)
    # Where friction does not depend on the load, a factor on it is one on the load: a law is one of its
    # own for each step only if its shape moves, as each one is solved.
    lubrication = config.bearing.lubrication
    scaled = lubrication is not None and lubrication.load_exponent > 0.0
    changes = course.water is not None or course.drifts.keys() - (set() if scaled else {FACTOR})
    step = time // STEP if changes else np.zeros(time.size)
    margins = {name: np.empty(time.size) for name in ('hopf_margin', 'fold_margin')}
    carried = load if scaled else load * course.factor(time)
    for rows in np.split(np.arange(time.size), np.flatnonzero(np.diff(step)) + 1):
        if rows.size:
            bearing = course.bearing_at(config.bearing, float(time[rows[0]]), scaled=scaled)
            point = assess(bearing, speed[rows], carried[rows])
            for name, values in margins.items():
                values[rows] = np.round(getattr(point, name), 9)  # the same on every processor
    return {'speed': speed, 'load': load} | margins


_MOTION = ('displacement', 'velocity', 'acceleration')
Take = Callable[[TimeBlock, FloatArray, FloatArray], None]
"""Function of a block, the instants [s] and the motion that are due in it, as :meth:`.Samples.pop_due`
returns them."""
LEVEL_FACTORS = {
    name: (power, 1.0 / factor)
    for power, quantity in enumerate(('length', 'speed', 'acceleration'))
    for name, factor in factors_of(*names_of(quantity)).items()
    if name in LEVEL_UNITS
}
"""By unit of a level: the power of the frequency by which an amplitude becomes it, and how many make an SI
unit."""


@effect('lining', 'bearing', 'disturbance', 'knocks', 'knock_unit', 'amplitude', 'motion')
def lining_motion(settings: Settings, run: SceneRun) -> None:
    """Add an effect to the run, for each bearing, that follows its lining from block to block.

    Every block gets its sticks and events as truth; its amplitude and motion on request; and where the
    scene sends a level, that level is raised by the lining's vibration. Bearings are claimed.

    Required is the ``disturbance`` of the load, with a ``standard_deviation`` >= 0 in its ``unit``. There may
    be ``knocks`` [time in s, impulse in ``knock_unit``], and the ``amplitude`` and the ``motion``, each at a
    ``rate`` [Hz].

    Raises:
        SceneError: A setting is missing or breaks its rule, or a level is sent in a unit or at a rate that
            this effect cannot make.
    """
    meaning = 'the fluctuation of the load that the lining feels, {standard_deviation, unit}'
    disturbance = settings.section('disturbance', ['standard_deviation', 'unit'], meaning)
    unit = disturbance.choice('unit', UNITS['load'])
    deviation = disturbance.number('standard_deviation', unit, minimum=0.0)
    knocks = _read_knocks(settings, run.duration)
    for config in run.claim_bearings(settings):
        factor = run.shaft.channel(config.name, 'load').factor(unit)
        blow = _unit_blow(settings, config)
        blows = [(time, impulse * blow) for time, impulse in knocks]
        random = random_stream(run.seed, settings.name, config.name)
        course = run.course(config)
        lining = Lining(config, run.shaft, course, factor * deviation, blows, random, run.duration)
        followed = FollowedLining(lining, run)
        # Windows of a higher rate would overlap.
        max_rate = 1.0 / (PERIODS * followed.period)
        if rate := _read_rate(settings, 'amplitude', max_rate):
            followed.request_motion(rate, followed.record_amplitude, followed.period)
        if rate := _read_rate(settings, 'motion', 100_000.0):
            followed.request_motion(rate, followed.record_motion)
        if channel := _level_channel(run, config, max_rate):
            followed.request_motion(channel.rate, partial(followed.send_level, channel), followed.period)
        run.effects.append(followed.apply)


def _read_knocks(settings: Settings, duration: float) -> list[tuple[float, float]]:
    """Return rising times [s] and impulses [``knock_unit``] of blows; an empty list without ``knocks``.

    Raises:
        SceneError: A blow breaks a rule, or stands at the scene's end.
    """
    if 'knocks' not in settings:
        return []
    rows = settings.rows('knocks', 'blow', 'a list of blows [time in s, impulse in N s]')
    knocks = check_points(rows, duration)
    if knocks[-1][0] == duration:
        label = settings.label('knocks')
        raise SceneError(f'{label}: no blow can follow at {duration:g} s, where the scene ends')
    return knocks


def _unit_blow(settings: Settings, config: BearingConfig) -> float:
    """Return the impulse of one ``knock_unit`` [N s]; 1 without the key.

    That of ``fold`` gives the lining the velocity of the averaged fold at the nominal load.

    Raises:
        SceneError: The unit is neither ``N s`` nor ``fold``, or the bearing has no fold at its nominal load.
    """
    if 'knock_unit' not in settings or settings.choice('knock_unit', ('N s', 'fold')) == 'N s':
        return 1.0
    return config.bearing.mass * nominal_fold(config)


def _read_rate(settings: Settings, key: str, max_rate: float) -> float:
    """Return the ``rate`` of an optional section [Hz]; 0 if the section is missing.

    Raises:
        SceneError: The rate is not above 0 and up to ``max_rate`` [Hz].
    """
    if key not in settings:
        return 0.0
    sampled = settings.section(key, ['rate'], 'its sampling, {rate: Hz}')
    return sampled.number('rate', 'Hz', above=0.0, maximum=max_rate)


def _level_channel(run: SceneRun, config: BearingConfig, max_rate: float) -> Channel | None:
    """Return the channel of a bearing's level; ``None`` if the scene sends none.

    Raises:
        SceneError: A scene cannot make its unit, or its rate is above ``max_rate`` [Hz].
    """
    try:
        channel = run.shaft.channel(config.name, 'level')
    except KeyError:
        return None
    if channel.input.unit not in LEVEL_FACTORS:
        raise SceneError(
            f'{config.name}.level.unit = {channel.input.unit} in the configuration: a scene can'
            f' send a level in {", ".join(LEVEL_FACTORS)} only'
        )
    if channel.rate > max_rate:
        raise SceneError(
            f'telemetry.level.rate = {channel.rate:g} Hz must not be above {max_rate:.3g} Hz for'
            f' bearing {config.name}: a value takes {PERIODS} natural periods'
        )
    return channel


class FollowedLining:
    """The lining of one bearing, followed block by block, and the records of its motion.

    Args:
        lining: The lining at the scene's start.
        run: The run of the scene.
    """

    def __init__(self, lining: Lining, run: SceneRun) -> None:
        self.lining, self._run = lining, run
        self.period = 2.0 * math.pi / lining.config.bearing.natural_frequency
        # 50 periods without a stick end an episode: longer than a ring-down, and than the ripple of the
        # blades takes to stop sticking and to let it begin again.
        self._episodes = Episodes(50.0 * self.period)
        # The samples requested, and the function that takes them in the block in which they are due.
        self._requests: list[tuple[Samples, Take]] = []
        # Sticks and events that are not yet due, by the time from which on they are [s].
        self._sticks: list[tuple[float, float]] = []
        self._events: list[tuple[float, str]] = []
        self._add_event(0.0, 'start', 0.0)

    def request_motion(self, rate: float, take: Take, period: float = 0.0) -> None:
        """Request the motion at a rate in every block; call it before the first block.

        Args:
            rate: Rate of the instants [Hz].
            take: Called in each block with the block, the instants [s], shape (m,), and the motion at each,
                shape (4, m, samples), as :meth:`.Samples.pop_due` returns them.
            period: Natural period [s], for a window of :data:`.lining.PERIODS` of them up to each instant; 0
                for one sample at it.
        """
        self._requests.append((Samples(rate, self._run.duration, period), take))

    def record_amplitude(self, block: TimeBlock, time: FloatArray, motion: FloatArray) -> None:
        """Append the amplitude in windows that end at times [s] to the truth of a block: a :data:`Take`."""
        block.truth.append(self._make_column('amplitude', FLOAT64, time, self._vibration_amplitude(motion)))

    def record_motion(self, block: TimeBlock, time: FloatArray, motion: FloatArray) -> None:
        """Append displacement, velocity, acceleration and sticking to a block's truth: a :data:`Take`."""
        for name, values in zip(_MOTION, motion[:3, :, 0], strict=True):
            block.truth.append(self._make_column(name, FLOAT64, time, values))
        block.truth.append(self._make_column('sticking', BOOL, time, motion[3, :, 0].astype(np.bool_)))

    def send_level(self, channel: Channel, block: TimeBlock, time: FloatArray, motion: FloatArray) -> None:
        """Add the lining's vibration to the values of a level, as a root of the sum of squares.

        Args:
            channel: The level's channel, whose signal in the block changes in place.
            block: The block.
            time: Instants of the windows, each one of the signal's times, shape (n,) [s].
            motion: The motion in each window, rows as of :meth:`.Lining.follow`, shape (4, n, samples).
        """
        power, factor = LEVEL_FACTORS[channel.input.unit]
        frequency = self.lining.config.bearing.natural_frequency
        signal = block.signals[channel.topic]
        values = np.zeros(signal.time.size)
        # There is no window before the scene's start.
        scale = frequency**power * factor * math.sqrt(0.5)
        values[np.searchsorted(signal.time, time)] = self._vibration_amplitude(motion) * scale
        signal.value[:] = np.hypot(signal.value, values)

    def _vibration_amplitude(self, motion: FloatArray) -> FloatArray:
        """Return the amplitude in each window [m], shape (m,), rounded so that processors agree.

        ``motion`` has rows as of :meth:`.Lining.follow`, shape (4, m, samples in a window).
        """
        step = self.period / PER_PERIOD
        return np.round(half_peak_to_peak(motion[0], motion[1], step), LENGTH_DECIMALS)

    def apply(self, block: TimeBlock) -> None:
        """Follow the lining through a block; append its sticks and events by then to the block's truth.

        The functions of :meth:`request_motion` get the samples by then; the last block gets all that are
        left, and an event ``end``.

        Raises:
            SceneError: The integrator gave up.
        """
        last = block.end == block.duration
        if self.lining.reached < block.end:
            self._follow_until(self.lining.next_end(block.end))
        if last:
            if (since := self._episodes.since) is not None:  # a stick that goes on
                self._sticks.append((block.end, round(block.end - since, TIME_DECIMALS)))
            self._add_event(block.end, 'end', block.end)
        due = math.inf if last else block.end
        block.truth.append(self._make_column('stick', FLOAT64, *_take_due(self._sticks, due)))
        block.truth.append(self._make_column('events', STRING, *_take_due(self._events, due)))
        for samples, take in self._requests:
            take(block, *samples.pop_due(due))

    def _follow_until(self, end: float) -> None:
        """Follow the lining to ``end`` [s]; store samples, sticks and events until they are due.

        ``end`` is one that :meth:`.Lining.next_end` returned.

        Raises:
            SceneError: The integrator gave up.
        """
        requested = [samples.take_next_times(end) for samples, _ in self._requests]
        times = np.unique(np.concatenate([np.empty(0), *requested]))
        motion, changes = self.lining.follow(end, times)
        for (samples, _), instants in zip(self._requests, requested, strict=True):
            samples.add(motion[:, np.searchsorted(times, instants)])
        ended, events = self._episodes.take_changes(changes, end)
        self._sticks += [
            (round(time, TIME_DECIMALS), round(duration, TIME_DECIMALS)) for time, duration in ended
        ]
        for event in events:
            self._add_event(*event)

    def _add_event(self, known_at: float, name: str, time: float, more: Mapping[str, float] = {}) -> None:
        """Store an event until the block in which it is due; times are rounded so that processors agree.

        Args:
            known_at: When it can be known [s]; from then on it is due.
            name: Its name.
            time: When it happens [s].
            more: More numbers of its record.
        """
        known_at, time = round(known_at, TIME_DECIMALS), round(time, TIME_DECIMALS)
        stamp = self._run.start_ns + round(time * 1e9)
        text = event_text(self.lining.config.name, name, stamp, **more)
        self._events.append((known_at, text))

    def _make_column(self, name: str, kind: str, time: FloatArray, values: Any) -> Column:
        """Return the column of the truth topic ``name`` of this bearing, of the message type ``kind``."""
        return Column(topic(self.lining.config.name, name), kind, time, values)


def _take_due(pending: list[tuple[float, Any]], end: float) -> tuple[FloatArray, NDArray[Any]]:
    """Remove the items before ``end`` [s] from ``pending``, and return them.

    Args:
        pending: Times [s], which do not fall, with values; changed in place.
        end: The time [s].

    Returns:
        The removed times and values, shape (n,) each; n may be 0.
    """
    count = bisect.bisect_left(pending, end, key=lambda item: item[0])
    taken, pending[:count] = pending[:count], []
    return np.array([time for time, _ in taken]), np.array([value for _, value in taken])
