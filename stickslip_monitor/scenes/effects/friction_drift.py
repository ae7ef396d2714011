# SPDX-License-Identifier: Apache-2.0
"""A parameter of the friction law that moves in time, by temperature, wear or running-in.

``{parameter, points: [[time in s, value], ...], bearing}`` or ``table`` for ``points``. The
parameter is one of the law's own (``static``, ``kinetic``, ``decay``, ``viscous``), or ``factor``,
which multiplies the whole coefficient. Only the lining feels it; the monitor goes on believing
its configuration.
"""

from __future__ import annotations

from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.scenes.friction_course import FrictionCourse, parameters_of, with_parameters
from stickslip_monitor.scenes.profile import Profile, read_values
from stickslip_monitor.scenes.settings import Settings

from .effect import Frame

KEYS = ('bearing', 'parameter', 'points', 'table')


def build(settings: Settings, frame: Frame) -> None:
    """Let the parameter move."""
    drift = read_values(settings, 'value', frame.duration, frame.folder)
    for config in frame.bearings(settings, settings.text('parameter', 'what moves')):
        law = config.bearing.friction
        name = settings.choice('parameter', parameters_of(law))
        _check(settings, config, name, drift)
        course = frame.courses.setdefault(config.name, FrictionCourse(law))
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
