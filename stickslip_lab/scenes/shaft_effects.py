# SPDX-License-Identifier: Apache-2.0
"""Declares effects on speed and load: courses, steps, manoeuvres, the sea and the blades.

The sea has the JONSWAP spectrum (Hasselmann et al. 1973; DNV-RP-C205, 3.5.5): with
``x = omega / omega_p``,

    S ~ x^-5 exp(-1.25 x^-4) gamma^exp(-(x - 1)^2 / (2 s^2)),   s = 0.07 for x <= 1, else 0.09

scaled to the variance ``Hs^2/16``. It is a sum of cosines of equal amplitude, each for an equal
part of that variance, at a random frequency within its part and with a random phase. So most of
them are where the sea has most energy, and the record does not repeat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_lab.scenes.effects import SceneRun, channel_effect, read_unit
from stickslip_lab.scenes.portable_math import cos_turns, exp
from stickslip_lab.scenes.settings import Profile, Settings, check_times, read_profile, read_steps, suggestion
from stickslip_lab.scenes.telemetry import Channel
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.value_check import refused


def _add_course(channel: Channel, run: SceneRun, course: Profile | Response, factor: float) -> None:
    """Add a course to the shaft of the run, on a channel; of a speed add its integral, which turns the shaft.

    Args:
        channel: The channel.
        run: The run of the scene, whose shaft changes.
        course: Values over the time.
        factor: SI value of one of them.
    """

    def way(time: FloatArray) -> FloatArray:
        return course.integral(time) * factor

    turns = way if channel.quantity == 'speed' else None
    run.shaft.add(channel.topic, lambda time: course.at(time) * factor, turns)


def _add_profile(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the ``points`` or the ``table`` of an effect to the shaft on a channel.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    _add_course(channel, run, read_profile(settings, unit, run.duration, run.folder), factor)


def _add_steps(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the ``steps`` of an effect to the shaft on a channel.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    _add_course(channel, run, read_steps(settings, unit, run.duration), factor)


@channel_effect('shaft', ['speed'], 'unit', 'points', 'table')
def speed_profile(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add a profile over time to the speed in ``run.shaft``, and its integral to the turns of the shaft.

    It has ``points`` or a ``table``, in ``unit``: see :func:`.read_profile`.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_profile(settings, channel, run)


@channel_effect('shaft', ['speed'], 'unit', 'steps', 'rise')
def speed_steps(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add steps over time to the speed in ``run.shaft``, and their integral to the turns of the shaft.

    It has ``steps``, in ``unit``, and a ``rise``: see :func:`.read_steps`.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_steps(settings, channel, run)


STEPS = ('dead slow', 'slow', 'half', 'full')
"""Steps of the engine telegraph, ahead or astern, by rising speed."""


@channel_effect('shaft', ['speed'], 'unit', 'ahead', 'astern', 'orders', 'time_constant')
def manoeuvre(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the response to telegraph orders to the shaft's speed in ``run.shaft``, and turn the shaft by it.

    The ``orders`` have speeds in ``ahead`` and ``astern``, in ``unit``, each of which may be missing; the
    speed follows with the ``time_constant`` > 0 [s].

    Raises:
        SceneError: A setting is missing or breaks its rule, or an order has no speed.
    """
    unit, factor = read_unit(settings, channel)
    time_constant = settings.number('time_constant', 's', above=0.0)
    times, targets = _read_orders(settings, _telegraph_speeds(settings, unit), run.duration)
    _add_course(channel, run, Response.to(times, targets * factor, time_constant), 1.0)


def _telegraph_speeds(settings: Settings, unit: str) -> dict[str, float]:
    """Return the speed of each order of the scene by name, as 'slow ahead': negative astern, 0 for 'stop'.

    Args:
        settings: Settings with the sections ``ahead`` and ``astern``, each of which may be missing.
        unit: Unit of the numbers, also of the result.

    Raises:
        SceneError: A speed does not exceed that of the step below it.
    """
    speeds = {'stop': 0.0}
    for way, sign in (('ahead', 1.0), ('astern', -1.0)):
        if way in settings:
            table = settings.section(way, STEPS, 'the speed of each step of the telegraph')
            previous = 0.0
            for step in (step for step in STEPS if step in table):
                previous = table.number(step, unit, above=previous)
                speeds[f'{step} {way}'] = sign * previous
    return speeds


def _read_orders(
    settings: Settings, speeds: dict[str, float], duration: float
) -> tuple[FloatArray, FloatArray]:
    """Return the times of the orders [s] and the speeds ordered, both of shape (n,).

    Args:
        settings: Settings with the list ``orders``.
        speeds: Speed of each order by name; the result has its unit.
        duration: Duration of the scene [s].

    Raises:
        SceneError: An order is unknown, or the times do not rise within the scene.
    """
    rows = settings.rows('orders', 'order', 'a list of orders [time in s, order]')
    for name, order in rows:
        if not isinstance(order, list) or len(order) != 2:
            raise refused(name, order, "a pair, [time in s, 'slow ahead']", SceneError)
        if not isinstance(order[1], str) or order[1] not in speeds:
            hint = suggestion(order[1], list(speeds))
            raise SceneError(f'{name} is {order[1]!r}, which has no speed in this scene; {hint}')
    check_times([(name, time) for name, (time, _) in rows], duration)
    times, orders = zip(*(order for _, order in rows), strict=True)
    return np.array(times, float), np.array([speeds[order] for order in orders])


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Response to targets: ``dV/dt = (target - V) / time_constant``."""

    times: FloatArray  # when each target is set, rising, shape (n,) [s]
    targets: FloatArray  # the targets; the first is held before it is set, shape (n,)
    values: FloatArray  # the value when each is set, shape (n,)
    integrals: FloatArray  # the integral from 0 until then, shape (n,)
    time_constant: float  # the lag [s]

    @classmethod
    def to(cls, times: FloatArray, targets: FloatArray, time_constant: float) -> Response:
        """Make the response to targets, which begins settled on the first of them.

        Args:
            times: When each target is set, rising, shape (n,) [s].
            targets: Shape (n,).
            time_constant: The lag, > 0 [s].
        """
        values, integrals = targets.copy(), times * targets
        response = cls(times, targets, values, integrals, time_constant)
        for k in range(1, times.size):
            before = response._evaluate_piece(times[k : k + 1], k - 1)
            values[k], integrals[k] = before[0][0], before[1][0]
        return response

    def at(self, time: FloatArray) -> FloatArray:
        """Return the values at times [s], of their shape (n,); the first target before it is set."""
        return self._evaluate_piece(time, self._last_change(time))[0]

    def integral(self, time: FloatArray) -> FloatArray:
        """Return the integral of the values from 0 to times [s], of their shape (n,)."""
        return self._evaluate_piece(time, self._last_change(time))[1]

    def _last_change(self, time: FloatArray) -> Any:
        """Return the index of the last target set by times [s], of their shape; 0 before the first."""
        return np.maximum(np.searchsorted(self.times, time, side='right') - 1, 0)

    def _evaluate_piece(self, time: FloatArray, k: Any) -> tuple[FloatArray, FloatArray]:
        """Return value and integral from 0 at times [s], each of their shape, after the k-th target was set.

        Args:
            time: Times [s].
            k: Index of the last target that was set, a number or one for each time.
        """
        since, off = time - self.times[k], self.values[k] - self.targets[k]
        # Before the first target there is nothing off.
        left = exp(-np.maximum(since, 0.0) / self.time_constant)
        integral = self.targets[k] * since + off * (self.time_constant * (1.0 - left))
        return self.targets[k] + off * left, self.integrals[k] + integral


@channel_effect('shaft', ['load'], 'unit', 'points', 'table')
def load_profile(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add a profile over time to the load in ``run.shaft``, as :func:`speed_profile`.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_profile(settings, channel, run)


@channel_effect('shaft', ['load'], 'unit', 'steps', 'rise')
def load_steps(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add steps over time to the load in ``run.shaft``, as :func:`speed_steps`.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    _add_steps(settings, channel, run)


COMPONENTS = 200
"""Number of cosines of a sea."""
# Frequencies over that of the peak: beyond five of them lies 0.2 % of the variance.
_RANGE = np.linspace(0.25, 5.0, 20_000)


@channel_effect('shaft', ['load'], 'unit', 'significant_height', 'peak_period', 'gamma', 'load_per_metre')
def load_in_waves(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add the load of a sea to ``run.shaft`` on a channel; all bearings have the same waves.

    All settings are required: ``significant_height`` >= 0 [m], ``peak_period`` >= 0.1 [s], ``gamma`` from 1
    to 10, and ``load_per_metre``, in ``unit`` per metre of elevation.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    per_metre = settings.number('load_per_metre', f'{unit}/m') * factor
    sea = Sea.of(
        settings.number('significant_height', 'm', minimum=0.0),
        settings.number('peak_period', 's', minimum=0.1),  # shorter waves are ripples
        settings.number('gamma', '-', minimum=1.0, maximum=10.0),
        run.make_random_stream(settings),
    )
    run.shaft.add(channel.topic, lambda time: sea.elevation(time) * per_metre)


@dataclass(frozen=True, slots=True, eq=False)
class Sea:
    """Elevation of a sea's surface over the time, a sum of cosines."""

    amplitude: float  # amplitude of each [m]
    frequency: FloatArray  # frequencies, shape (n,) [Hz]
    phase: FloatArray  # phases at the scene's start, shape (n,) [turns]

    @classmethod
    def of(cls, height: float, period: float, gamma: float, random: np.random.Generator) -> Sea:
        """Draw a sea of :data:`COMPONENTS` cosines by the JONSWAP spectrum; the random stream advances.

        Args:
            height: Significant height [m].
            period: Period of the peak [s].
            gamma: Peakedness, from 1 [-].
            random: The stream.
        """
        part = (np.arange(COMPONENTS) + random.random(COMPONENTS)) / COMPONENTS
        frequency = np.interp(part, _energy_below(gamma), _RANGE) / period
        phase = random.random(COMPONENTS)
        return cls(height / 4.0 * math.sqrt(2.0 / COMPONENTS), frequency, phase)

    def elevation(self, time: FloatArray) -> FloatArray:
        """Return the elevation at some times [s], shape (n,) [m]; waves are added in one order."""
        total = np.zeros_like(time)
        for frequency, phase in zip(self.frequency, self.phase, strict=True):
            total += cos_turns(frequency * time + phase)
        return total * self.amplitude


def _energy_below(gamma: float) -> FloatArray:
    """Return the share of a sea's variance below each frequency of ``_RANGE``, from 0 to 1, shape (n,).

    ``gamma`` is the peakedness, from 1 [-].
    """
    x = _RANGE
    width = np.where(x <= 1.0, 0.07, 0.09)
    peak = exp(math.log(gamma) * exp(-(((x - 1.0) / width) ** 2) / 2.0))
    square = x * x
    density = exp(-1.25 / (square * square)) * peak / (square * square * x)
    below = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return below / below[-1]


@channel_effect('turning', ['speed'], 'blades', 'amplitude')
def blade_ripple(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add ripple at the rate of the blades to the speed in ``run.shaft``; its amplitude is a share of that.

    It follows from the turning of the shaft, and does not turn it. There may be 1 to 20 ``blades``; the
    ``amplitude`` is from 0 to 1.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    blades = settings.whole('blades', 'the number of blades', 1, 20)
    amplitude = settings.number('amplitude', '-', minimum=0.0, maximum=1.0)
    shaft, bearing = run.shaft, channel.bearings[0].name

    def ripple(time: FloatArray) -> FloatArray:
        """Return the ripple [m/s] at times [s], of their shape (n,)."""
        turns = shaft.turns(bearing, time)
        return shaft.mean(channel.topic, time) * (amplitude * cos_turns(blades * turns))

    shaft.add_ripple(channel.topic, ripple)


@channel_effect('turning', ['load'], 'amplitude', 'unit')
def misalignment(settings: Settings, channel: Channel, run: SceneRun) -> None:
    """Add ripple to the load, of the channel in ``run.shaft``, with one period in each turn of the shaft.

    Its ``amplitude`` >= 0 is in ``unit``.

    Raises:
        SceneError: A setting is missing or breaks its rule.
    """
    unit, factor = read_unit(settings, channel)
    amplitude = settings.number('amplitude', unit, minimum=0.0) * factor
    shaft, bearing = run.shaft, channel.bearings[0].name
    shaft.add_ripple(channel.topic, lambda time: amplitude * cos_turns(shaft.turns(bearing, time)))
