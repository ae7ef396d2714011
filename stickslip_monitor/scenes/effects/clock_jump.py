# SPDX-License-Identifier: Apache-2.0
"""Clocks of the sensors that jump: ``{jumps: [[time in s, by s], ...], bearing}``.

A jump shifts all later stamps; several add up. Without a header a message's stamp is the
recorder's own time, by which every reader sorts: such a topic can jump forward only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.signals import QUANTITIES
from stickslip_monitor.scenes.block import Block
from stickslip_monitor.scenes.profile import read_rows
from stickslip_monitor.scenes.settings import Settings
from stickslip_monitor.scenes.signals import FloatArray, IntArray

from .effect import Effect, Frame, require_header

KEYS = ('bearing', 'jumps')
# Ten years.
_LONGEST = 3.2e8


@dataclass(frozen=True, slots=True, eq=False)
class ClockJump:
    """Shifts stamps.

    Attributes:
        topics: The topics whose clock jumps.
        times: When, rising, shape (n,) [s].
        shifts_ns: The shift before the first and from each on, shape (n + 1,) [ns].
    """

    topics: tuple[str, ...]
    times: FloatArray
    shifts_ns: IntArray

    def apply(self, block: Block) -> None:
        """Shift the stamps of the next samples."""
        for topic in self.topics:
            signal = block.signals[topic]
            past = np.searchsorted(self.times, signal.time, side='right')
            signal.stamp_ns[:] += self.shifts_ns[past]


def build(settings: Settings, frame: Frame) -> Effect:
    """Build the effect."""
    rows = read_rows(settings, 'jumps', 'jump', 's', frame.duration)
    for number, (_, by) in enumerate(rows, 1):
        if not 0.0 < abs(by) <= _LONGEST:
            raise SceneError(
                f'{settings.label("jumps")}: jump {number} is by {by:g} s, which must not be 0 nor'
                f' beyond {_LONGEST:g} s'
            )
    channels = [c for quantity in QUANTITIES for c in frame.pick(settings, quantity)]
    if any(by < 0.0 for _, by in rows):
        for channel in channels:
            require_header(channel, 'its clock can only jump forward')
    times = np.array([time for time, _ in rows])
    shifts = np.cumsum([0, *(round(by * 1e9) for _, by in rows)])
    edges = [*times.tolist(), frame.duration]
    for number, shift in enumerate(shifts[1:].tolist()):
        first, last = (frame.start_ns + shift + round(t * 1e9) for t in edges[number : number + 2])
        if first < 0 or any(last >= channel.stamps_end_ns for channel in channels):
            raise SceneError(
                f'{settings.label("jumps")}: jump {number + 1} takes the clock out of the range of'
                ' time stamps: from 1970, in headers to 2038, else to 2262'
            )
    return ClockJump(tuple(c.topic for c in channels), times, shifts)
