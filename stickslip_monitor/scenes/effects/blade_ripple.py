# SPDX-License-Identifier: Apache-2.0
"""Ripple of the shaft's speed at the propeller's blade rate: ``{blades, amplitude, bearing}``.

``V = V_mean (1 + amplitude cos(blades * angle))``, where the angle is the integral of ``V_mean``.
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.scenes.portable import cos_turns
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.shaft import Shaft
from stickslip_monitor.scenes.signals import Channel, FloatArray

from .effect import Frame

KEYS = ('bearing', 'blades', 'amplitude')


@dataclass(frozen=True, slots=True)
class BladeRipple:
    """The ripple of one channel; ``amplitude`` is a share of the speed."""

    shaft: Shaft
    channel: Channel
    blades: int
    amplitude: float

    def at(self, time: FloatArray) -> FloatArray:
        """Its values at some times, shape (n,) [m/s]."""
        turns = self.shaft.turns(self.channel.bearings[0].name, time)
        mean = self.shaft.mean(self.channel.topic, time)
        return mean * (self.amplitude * cos_turns(self.blades * turns))


def build(settings: Settings, frame: Frame) -> None:
    """Add the ripple to the speed."""
    blades = settings.value('blades', 'the number of blades')
    if isinstance(blades, bool) or not isinstance(blades, int) or not 1 <= blades <= 20:
        raise settings.broken('blades', 'must be a whole number from 1 to 20')
    amplitude = settings.number('amplitude', '-', least=0.0, most=1.0)
    for channel in frame.pick(settings, 'speed'):
        ripple = BladeRipple(frame.shaft, channel, blades, amplitude)
        frame.add_ripple(channel, ripple)
