# SPDX-License-Identifier: Apache-2.0
"""Adds a profile to a speed or a load: what the effects that follow a table have in common."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.scenes.profile import Profile
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import FloatArray

from .effect import Frame


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


def add_profile(settings: Settings, frame: Frame, quantity: str, profile: Profile) -> None:
    """Add a profile to the channels of a quantity that an effect is for."""
    for channel in frame.pick(settings, quantity):
        term = ProfileTerm(profile, channel.factor(profile.unit))
        if quantity == 'speed':
            frame.add_speed(channel, term)
        else:
            frame.add_load(channel, term)
