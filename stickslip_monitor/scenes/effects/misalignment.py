# SPDX-License-Identifier: Apache-2.0
"""Ripple of a bearing's load once per turn, as of a bent or misaligned shaft.

``{amplitude, unit, bearing}``: ``amplitude * cos(angle)`` of the shaft.
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.scenes.portable import cos_turns
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.shaft import Shaft
from stickslip_monitor.scenes.signals import FloatArray

from .effect import UNITS, Frame

KEYS = ('bearing', 'amplitude', 'unit')


@dataclass(frozen=True, slots=True)
class OncePerTurn:
    """The ripple of one bearing's load; ``amplitude`` in N."""

    shaft: Shaft
    bearing: str
    amplitude: float

    def at(self, time: FloatArray) -> FloatArray:
        """Its values at some times, shape (n,) [N]."""
        return self.amplitude * cos_turns(self.shaft.turns(self.bearing, time))


def build(settings: Settings, frame: Frame) -> None:
    """Add the ripple to the load."""
    unit = settings.choice('unit', UNITS['load'])
    amplitude = settings.number('amplitude', unit, least=0.0)
    for channel in frame.pick(settings, 'load'):
        ripple = OncePerTurn(
            frame.shaft, channel.bearings[0].name, amplitude * channel.factor(unit)
        )
        frame.add_ripple(channel, ripple)
