# SPDX-License-Identifier: Apache-2.0
"""A quantity that goes from level to level: a profile that is told in steps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from stickslip_monitor.errors import SceneError

from .profile import Profile, read_rows
from .settings import Settings

KEYS = ('bearing', 'unit', 'steps', 'rise')


def read_steps(settings: Settings, units: Sequence[str], duration: float) -> Profile:
    """Read ``unit``, ``steps`` and ``rise`` of an effect.

    Each step [time in s, level] begins at its time and takes ``rise`` [s]: neither a shaft nor
    the load on a bearing jumps. The first level holds from the scene's start.

    Args:
        settings: The effect's settings.
        units: The units allowed.
        duration: The scene's duration [s].

    Raises:
        SceneError: A step is no pair of numbers, its time breaks a rule, or it begins before the
            one before it has ended.
    """
    unit = settings.choice('unit', units)
    rise = settings.number('rise', 's', above=0.0)
    steps = read_rows(settings, 'steps', 'step', unit, duration)
    points, label = [steps[0]], settings.label('steps')
    for number, ((_, before), (time, level)) in enumerate(pairwise(steps), 2):
        if time < points[-1][0]:
            raise SceneError(
                f'{label}: step {number} is at {time:g} s, but the one before takes'
                f' until {points[-1][0]:g} s'
            )
        points += [(time, before)] if time > points[-1][0] else []
        points.append((time + rise, level))
    return Profile.of(points, unit)
