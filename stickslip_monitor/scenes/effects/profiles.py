# SPDX-License-Identifier: Apache-2.0
"""Adds a profile to the signals of one quantity: what speed and load profile have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stickslip_monitor.scenes.profile import Profile, read_profile
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import Block

from .effect import Frame

KEYS = ('bearing', 'unit', 'points')


@dataclass(frozen=True, slots=True)
class ProfileEffect:
    """Adds a profile to some signals.

    Attributes:
        profile: The profile.
        factors: By topic, the SI value of one of the profile's units.
    """

    profile: Profile
    factors: dict[str, float]

    def apply(self, block: Block) -> None:
        """Add the profile's values."""
        for topic, factor in self.factors.items():
            signal = block.signals[topic]
            signal.value[:] += self.profile.at(signal.time) * factor


def build_profile(
    settings: Settings, frame: Frame, quantity: str, units: Sequence[str]
) -> ProfileEffect:
    """Build the profile of a quantity from an effect's settings."""
    profile = read_profile(settings, units, frame.duration)
    channels = frame.pick(settings, quantity)
    return ProfileEffect(profile, {c.topic: c.factor(profile.unit) for c in channels})
