# SPDX-License-Identifier: Apache-2.0
"""Defines the inputs: samples, streams of them, and the status of each sample."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import ConfigurationError


class Input(IntEnum):
    """Measured quantities of a bearing."""

    SPEED = 0
    LOAD = 1
    LEVEL = 2
    WATER_TEMPERATURE = 3


INPUTS = tuple(quantity.name.lower() for quantity in Input)
"""The names of the inputs, in order."""
QUANTITIES = INPUTS[: Input.LEVEL]
"""What makes an operating point."""
LEVEL, WATER = Input.LEVEL, Input.WATER_TEMPERATURE
"""What may be measured beside: from the level on."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One measured number of one bearing, as it arrived.

    Attributes:
        bearing: Name of the bearing.
        quantity: One of :data:`INPUTS`.
        time_ns: Time stamp of the measurement [ns].
        value: The number in the message, in the input's own scale.
        arrival_ns: When it came [ns]; ``None``: at the time of its stamp.

    >>> Sample('aft', 'speed', 10**9, 60.0).quantity
    'speed'
    """

    bearing: str
    quantity: str
    time_ns: int
    value: float
    arrival_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Stream:
    """The samples of one bearing in order of arrival, for bulk evaluation.

    Attributes:
        time_ns: Times of measurement, shape (n,) int64 [ns].
        inputs: The :class:`Input` that each is of, shape (n,) int8.
        value: Numbers in the inputs' own scales, shape (n,).
        arrival_ns: When each came, shape (n,) int64 [ns]; left out: at the times of measurement.
        rival: Where it is a level, how far the loudest level of another bearing was above its threshold,
            shape (n,) [dB]; left out, or ``nan``: there was none.

    Raises:
        ConfigurationError: The columns are not of one length.

    >>> stream = Stream(np.array([0, 0, 10**9]), np.array([0, 1, 0]), np.array([60.0, 1e3, 59.0]))
    >>> stream.inputs.dtype, stream.arrival_ns.tolist()
    (dtype('int8'), [0, 0, 1000000000])
    """

    time_ns: NDArray[np.int64]
    inputs: NDArray[np.int8]
    value: NDArray[np.float64]
    arrival_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    rival: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        arrival = self.arrival_ns if self.arrival_ns.size else self.time_ns
        shapes = {column.shape for column in (self.time_ns, self.inputs, self.value, arrival)}
        if self.rival.size:
            shapes.add(self.rival.shape)
        if len(shapes) > 1 or self.time_ns.ndim != 1:
            raise ConfigurationError(
                f'stream columns have shapes {" and ".join(map(str, sorted(shapes)))}:'
                ' they must be one-dimensional and of one length'
            )
        for name, column, kind in (
            ('time_ns', self.time_ns, np.int64),
            ('inputs', self.inputs, np.int8),
            ('value', self.value, np.float64),
            ('arrival_ns', arrival, np.int64),
            ('rival', self.rival, np.float64),
        ):
            object.__setattr__(self, name, np.asarray(column).astype(kind, copy=False))


class Status(IntEnum):
    """Outcomes of a sample."""

    ACCEPTED = 0
    NOT_FINITE = 1
    NO_VALUE = 2
    IMPLAUSIBLE = 3
    BELOW_MINIMUM = 4
    REPEATED = 5
    OUT_OF_ORDER = 6

    @property
    def valid(self) -> bool:
        """Whether the sample is used."""
        return self is Status.ACCEPTED


STATUS_SENTENCES = {
    Status.NOT_FINITE: 'not a finite number',
    Status.NO_VALUE: 'a number that means "no value"',
    Status.IMPLAUSIBLE: 'beyond the largest plausible magnitude',
    Status.BELOW_MINIMUM: 'below the smallest plausible value (is the sign of its scale right?)',
    Status.REPEATED: 'same time stamp and value as the one before',
    Status.OUT_OF_ORDER: 'older than the one before',
}
VALUE_FAULTS = {
    status: f'values are {STATUS_SENTENCES[status]}'
    for status in (Status.NOT_FINITE, Status.NO_VALUE, Status.IMPLAUSIBLE, Status.BELOW_MINIMUM)
}
"""What is wrong with a number, whenever it comes."""
_INT16, _INT32 = np.iinfo(np.int16), np.iinfo(np.int32)
_UINT16, _UINT32 = np.iinfo(np.uint16), np.iinfo(np.uint32)
_SIGNED = np.array([_INT16.max, -_INT16.max, _INT16.min])
_TENTHS = _SIGNED / 10.0
NO_VALUES = (
    1e20,  # and any of greater magnitude: fill values of netCDF and others
    *(-999.25, -9999.25, -999.0, -9999.0, -99999.0),  # the first is that of LAS
    # 16 bits with a sign, whole or in tenths, these in single precision, too.
    *(*_SIGNED.astype(float).tolist(), *_TENTHS.tolist(), *_TENTHS.astype(np.float32).tolist()),
    # 16 bits without one, whole, in tenths or in quarters, and the error of NMEA 2000.
    *map(float, (_UINT16.max, _UINT16.max - 1, _UINT16.max / 10, _UINT16.max / 4, (_UINT16.max - 1) / 4)),
    # 32 bits with and without a sign, and what single precision makes of their limits.
    *map(float, (_INT32.max, -_INT32.min, _INT32.min, _UINT32.max, _UINT32.max + 1)),
)
"""Numbers by which senders say that there is no value, as they stand in messages."""
LEAST_NO_VALUE = min(map(abs, NO_VALUES))
