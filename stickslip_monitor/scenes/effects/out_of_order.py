# SPDX-License-Identifier: Apache-2.0
"""Messages that arrive late, behind younger ones.

``{speed: {delay in s, share, windows}, load: {..}, bearing}``; the stamp stays that of the
measurement, so the message must have one.
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.windows import KEYS as OCCASIONS
from stickslip_monitor.scenes.windows import Occasions, read_occasions

from .effect import Effect, Frame, require_header

KEYS = ('bearing', *QUANTITIES)


@dataclass(frozen=True, slots=True)
class OutOfOrder:
    """Delays messages; ``delays`` holds for each topic delay [ns] and which are delayed."""

    delays: dict[str, tuple[int, Occasions]]

    def apply(self, block: Block) -> None:
        """Delay those of the next messages that are hit."""
        for topic, (delay_ns, occasions) in self.delays.items():
            signal = block.signals[topic]
            if signal.arrival_ns is not None:  # always so: see build
                signal.arrival_ns[occasions.hit(signal.time)] += delay_ns


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    delays = {}
    keys = ['delay', *OCCASIONS]
    for channel, own in frame.sensors_of(settings, keys, 'which messages arrive late'):
        require_header(channel, 'none of its messages can be out of order')
        # A shorter delay overtakes nothing.
        delay = own.number('delay', 's', above=1.0 / channel.rate, most=60.0)
        occasions = read_occasions(own, frame.duration, frame.random(settings, channel))
        delays[channel.topic] = round(delay * 1e9), occasions
    return OutOfOrder(delays)
