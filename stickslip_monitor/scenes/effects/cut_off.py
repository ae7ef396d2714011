# SPDX-License-Identifier: Apache-2.0
"""A recorder that stops in mid-write: ``{time in s}``.

Nothing is written from then on; the file ends in the middle of its last chunk, without its index,
and a folder has no metadata.
"""

from __future__ import annotations

from stickslip_monitor.scenes.settings import Settings

from .effect import Cut, Frame

KEYS = ('time',)


def build(settings: Settings, frame: Frame) -> Cut:
    """Build the cut."""
    frame.once(settings)
    return Cut(settings.number('time', 's', above=0.0, most=frame.duration))
