# SPDX-License-Identifier: Apache-2.0
"""Channels of telemetry, and the samples of a stretch of time on each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.bags.cdr import STAMP_END, STAMPED_FIELDS
from stickslip_monitor.errors import SceneError
from stickslip_monitor.monitor.config import BearingConfig, InputConfig

from . import sampling

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Channel:
    """One sensor: a topic, and the bearings that read it.

    Several bearings of one shaft read one speed topic; SI values are then those of the first.

    Attributes:
        quantity: ``'speed'`` or ``'load'``.
        bearings: The bearings that read it, at least one.
        rate: Samples per second [Hz].
    """

    quantity: str
    bearings: tuple[BearingConfig, ...]
    rate: float

    @property
    def input(self) -> InputConfig:
        """Topic, scale and offset."""
        bearing = self.bearings[0]
        return bearing.speed if self.quantity == 'speed' else bearing.load

    @property
    def topic(self) -> str:
        """Its topic."""
        return self.input.topic

    @property
    def is_stamped(self) -> bool:
        """Whether its messages have a header with a time stamp."""
        return self.input.type in STAMPED_FIELDS

    @property
    def stamps_end_ns(self) -> int:
        """Where its time stamps end: in 2038 in a header, in 2262 by the recorder [ns]."""
        return STAMP_END if self.is_stamped else 1 << 63

    def factor(self, unit: str) -> float:
        """SI value (surface speed [m/s] or load [N]) of one unit.

        Raises:
            SceneError: The unit is m/s, and the topic serves bearings of different diameters.
        """
        if self.quantity == 'load':
            return 1000.0 if unit == 'kN' else 1.0
        if unit == 'm/s' and len({b.bearing.journal_diameter for b in self.bearings}) > 1:
            names = ', '.join(b.name for b in self.bearings)
            raise SceneError(
                f'unit m/s says nothing about topic {self.topic}: it serves {names}, whose'
                ' journals differ in diameter; use rpm, rad/s or Hz'
            )
        return self.bearings[0].bearing.speed.factor(unit)

    def ratio(self, bearing: str) -> float:
        """A bearing's own SI value of one of the channel's: journals may differ in diameter."""
        if self.quantity == 'load':
            return 1.0
        diameter = {b.name: b.bearing.journal_diameter for b in self.bearings}
        return diameter[bearing] / self.bearings[0].bearing.journal_diameter

    def raw(self, si: FloatArray) -> FloatArray:
        """The numbers the sensor sends for SI values: the inverse of what the monitor does."""
        return (si / self.input.factor - self.input.offset) / self.input.scale

    def count(self, duration: float) -> int:
        """Samples in a scene of some duration [s], from 0 to its end inclusive."""
        return sampling.count(self.rate, duration)


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """The samples of one channel over a stretch of time.

    Attributes:
        channel: The channel.
        time: True instants of measurement since the scene's start, shape (n,) [s].
        stamp_ns: Time stamps by the sensor's clock, shape (n,) [ns].
        value: Surface speed [m/s] or load [N], shape (n,).
        arrival_ns: When the recorder gets each message, by its own clock, shape (n,) [ns]; None
            where messages have no stamp of their own, and the recorder's is all there is.
        copies: How often each is recorded, shape (n,); None: once.
    """

    channel: Channel
    time: FloatArray
    stamp_ns: IntArray
    value: FloatArray
    arrival_ns: IntArray | None = None
    copies: IntArray | None = None

    @property
    def raw(self) -> FloatArray:
        """The numbers the sensor sends, shape (n,)."""
        return self.channel.raw(self.value)

    def lost(self, which: BoolArray) -> Signal:
        """The signal without some messages, shape (n,)."""
        return replace(self, copies=np.where(which, 0, self._counted()))

    def repeated(self, which: BoolArray) -> Signal:
        """The signal with some messages twice, shape (n,)."""
        return replace(self, copies=np.where(which, 2, 1) * self._counted())

    def _counted(self) -> IntArray:
        return np.ones(self.time.size, np.int64) if self.copies is None else self.copies

    def messages(self) -> Messages:
        """What the recorder writes."""
        log_time = self.stamp_ns if self.arrival_ns is None else self.arrival_ns
        stamp = None if self.arrival_ns is None else self.stamp_ns
        if self.copies is None:
            return Messages(log_time, stamp, self.raw)
        log_time, raw = np.repeat(log_time, self.copies), np.repeat(self.raw, self.copies)
        return Messages(log_time, None if stamp is None else np.repeat(stamp, self.copies), raw)


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """The messages of one channel over a stretch of time.

    Attributes:
        log_time_ns: When each was recorded, shape (n,) [ns].
        stamp_ns: The stamps in their headers, shape (n,) [ns]; None: they have none.
        raw: The numbers in them, shape (n,).
    """

    log_time_ns: IntArray
    stamp_ns: IntArray | None
    raw: FloatArray
