# SPDX-License-Identifier: Apache-2.0
"""Speed and load given by the scene: profiles, steps, and telegraph orders with a lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import SceneError
from stickslip_monitor.lab.scenes.effects.effect import UNITS, BuildContext, EffectKind
from stickslip_monitor.lab.scenes.profile import (
    PROFILE_KEYS,
    STEP_KEYS,
    Profile,
    check_times,
    read_profile,
    read_steps,
)
from stickslip_monitor.lab.scenes.reproducible_math import exp
from stickslip_monitor.lab.scenes.settings import Settings, suggestion


@dataclass(frozen=True, slots=True)
class ProfileTerm:
    """A profile in SI units.

    Attributes:
        profile: The profile.
        factor: The SI value of one of its units.
    """

    profile: Profile
    factor: float

    def at(self, time: FloatArray) -> FloatArray:
        """Values at some times, shape (n,)."""
        return self.profile.at(time) * self.factor

    def integral(self, time: FloatArray) -> FloatArray:
        """Integral from 0 to some times, shape (n,)."""
        return self.profile.integral(time) * self.factor


def add_profile(
    settings: Settings, context: BuildContext, quantity: str, profile: Profile
) -> None:
    """Add a profile to the channels of a quantity that an effect is for."""
    for channel in context.pick(settings, quantity):
        term = ProfileTerm(profile, channel.factor(profile.unit))
        if quantity == 'speed':
            context.add_speed(channel, term)
        else:
            context.add_load(channel, term)


def build_speed_profile(settings: Settings, context: BuildContext) -> None:
    """Add the profile to the speed."""
    profile = read_profile(settings, UNITS['speed'], context.duration, context.folder)
    add_profile(settings, context, 'speed', profile)


def build_speed_steps(settings: Settings, context: BuildContext) -> None:
    """Add the steps to the speed."""
    steps = read_steps(settings, UNITS['speed'], context.duration)
    add_profile(settings, context, 'speed', steps)


def build_load_profile(settings: Settings, context: BuildContext) -> None:
    """Add the profile to the load."""
    profile = read_profile(settings, UNITS['load'], context.duration, context.folder)
    add_profile(settings, context, 'load', profile)


def build_load_steps(settings: Settings, context: BuildContext) -> None:
    """Add the steps to the load."""
    steps = read_steps(settings, UNITS['load'], context.duration)
    add_profile(settings, context, 'load', steps)


MANOEUVRE_KEYS = ('bearing', 'unit', 'ahead', 'astern', 'orders', 'time_constant')
STEPS = ('dead slow', 'slow', 'half', 'full')
_WAYS = {'ahead': 1.0, 'astern': -1.0}


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Follows targets: ``dV/dt = (target - V) / time_constant``.

    Attributes:
        times: When each target is set, rising, shape (n,) [s].
        targets: The targets; the first is held before it is set, shape (n,).
        values: The value when each is set, shape (n,).
        ways: The integral from 0 until then, shape (n,).
        time_constant: The lag [s].
    """

    times: FloatArray
    targets: FloatArray
    values: FloatArray
    ways: FloatArray
    time_constant: float

    @classmethod
    def to(cls, times: FloatArray, targets: FloatArray, time_constant: float) -> Response:
        """The response to targets, from rest at the first of them."""
        values, ways = targets.copy(), times * targets
        response = cls(times, targets, values, ways, time_constant)
        for k in range(1, times.size):
            before = response._piece(times[k : k + 1], k - 1)
            values[k], ways[k] = before[0][0], before[1][0]
        return response

    def at(self, time: FloatArray) -> FloatArray:
        """Values at some times, shape (n,)."""
        return self._piece(time, self._last(time))[0]

    def integral(self, time: FloatArray) -> FloatArray:
        """Integral from 0 to some times, shape (n,)."""
        return self._piece(time, self._last(time))[1]

    def _last(self, time: FloatArray) -> Any:
        return np.maximum(np.searchsorted(self.times, time, side='right') - 1, 0)

    def _piece(self, time: FloatArray, k: Any) -> tuple[FloatArray, FloatArray]:
        """Value and integral where target ``k`` is the last."""
        since, off = time - self.times[k], self.values[k] - self.targets[k]
        # Before the first target there is nothing off.
        left = exp(-np.maximum(since, 0.0) / self.time_constant)
        way = self.targets[k] * since + off * (self.time_constant * (1.0 - left))
        return self.targets[k] + off * left, self.ways[k] + way


def build_manoeuvre(settings: Settings, context: BuildContext) -> None:
    """Add the response to the speed."""
    unit = settings.choice('unit', UNITS['speed'])
    time_constant = settings.number('time_constant', 's', above=0.0)
    times, targets = _orders(settings, _speeds(settings, unit), context.duration)
    for channel in context.pick(settings, 'speed'):
        response = Response.to(times, targets * channel.factor(unit), time_constant)
        context.add_speed(channel, response)


def _speeds(settings: Settings, unit: str) -> dict[str, float]:
    """The speed of each order the telegraph has."""
    speeds = {'stop': 0.0}
    for way, sign in _WAYS.items():
        if way in settings:
            table = settings.section(way, STEPS, 'the speed of each step of the telegraph')
            given = [step for step in STEPS if step in table]
            least = 0.0
            for step in given:
                speed = table.number(step, unit, above=least)
                speeds[f'{step} {way}'] = sign * speed
                least = speed
    return speeds


def _orders(
    settings: Settings, speeds: dict[str, float], duration: float
) -> tuple[FloatArray, FloatArray]:
    """When each order is given, and the speed it asks for."""
    what = 'a list of orders [time in s, order]'
    listed = settings.value('orders', what)
    if not isinstance(listed, list) or not listed:
        raise settings.broken('orders', f'must be {what}')
    label = settings.label('orders')
    for number, order in enumerate(listed, 1):
        name = f'{label}: order {number}'
        if not isinstance(order, list) or len(order) != 2:
            raise SceneError(f"{name} = {order!r} must be a pair, [time in s, 'slow ahead']")
        if not isinstance(order[1], str) or order[1] not in speeds:
            hint = suggestion(order[1], list(speeds))
            raise SceneError(f'{name} is {order[1]!r}, which has no speed in this scene; {hint}')
    check_times([(f'{label}: order {k}', order[0]) for k, order in enumerate(listed, 1)], duration)
    times, orders = zip(*listed, strict=True)
    return np.array(times, float), np.array([speeds[order] for order in orders])


EFFECTS = {
    'speed_profile': EffectKind(PROFILE_KEYS, build_speed_profile),
    'speed_steps': EffectKind(STEP_KEYS, build_speed_steps),
    'manoeuvre': EffectKind(MANOEUVRE_KEYS, build_manoeuvre),
    'load_profile': EffectKind(PROFILE_KEYS, build_load_profile),
    'load_steps': EffectKind(STEP_KEYS, build_load_steps),
}
