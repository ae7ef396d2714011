# SPDX-License-Identifier: Apache-2.0
"""What comes in: samples, streams of them, and what became of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import ConfigurationError


class Input(IntEnum):
    """What is measured of a bearing."""

    SPEED = 0
    LOAD = 1
    LEVEL = 2


INPUTS = tuple(each.name.lower() for each in Input)
"""The names of the inputs, in order."""
QUANTITIES = INPUTS[: Input.LEVEL]
"""What makes an operating point."""
LEVEL = Input.LEVEL


@dataclass(frozen=True, slots=True)
class Sample:
    """One measured number of one bearing, as it arrived.

    Attributes:
        bearing: Name of the bearing.
        quantity: One of :data:`INPUTS`.
        time_ns: Time stamp of the measurement [ns].
        value: The number in the message, in the input's own scale.
        arrival_ns: When it came [ns]; ``None``: at the time of its stamp.
    """

    bearing: str
    quantity: str
    time_ns: int
    value: float
    arrival_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Levels:
    """The values of a level, in order of arrival among those of speed and load.

    Attributes:
        time_ns: Times of measurement, shape (m,) [ns].
        value: Numbers in the input's own scale, shape (m,).
        place: How many values of speed and load came before each, not falling, shape (m,).
    """

    time_ns: NDArray[np.int64]
    value: NDArray[np.float64]
    place: NDArray[np.int64]

    def __post_init__(self) -> None:
        _require_columns('level', self.time_ns, self.value, self.place)


@dataclass(frozen=True, slots=True)
class Stream:
    """The samples of one bearing in order of arrival, for bulk evaluation.

    Attributes:
        time_ns: Times of measurement, shape (n,) int64 [ns].
        inputs: The :class:`Input` that each is of, shape (n,) int8.
        value: Numbers in the inputs' own scales, shape (n,).
        level: Values of a level that came among them, where they are given apart; they are merged
            into the other columns.
        arrival_ns: When each came, shape (n,) int64 [ns]; left out: at the times of measurement.
    """

    time_ns: NDArray[np.int64]
    inputs: NDArray[np.int8]
    value: NDArray[np.float64]
    level: Levels | None = None
    arrival_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        _require_columns('stream', self.time_ns, self.inputs, self.value)
        columns: dict[str, Any] = {
            'time_ns': np.asarray(self.time_ns, np.int64),
            'inputs': np.asarray(self.inputs).astype(np.int8),
            'value': np.asarray(self.value, float),
        }
        arrival = self.arrival_ns if self.arrival_ns.size else columns['time_ns']
        _require_columns('stream', arrival, self.inputs, self.value)
        columns['arrival_ns'] = np.asarray(arrival, np.int64)
        if self.level is not None:
            own: Any = self.level.time_ns, Input.LEVEL, self.level.value, self.level.time_ns
            for (name, column), part in zip(columns.items(), own, strict=True):
                columns[name] = np.insert(column, self.level.place, part)
        for name, column in columns.items():
            object.__setattr__(self, name, column)
        object.__setattr__(self, 'level', None)


def _require_columns(what: str, first: Any, second: Any, third: Any) -> None:
    if not (first.shape == second.shape == third.shape and first.ndim == 1):
        raise ConfigurationError(
            f'{what} columns have shapes {first.shape}, {second.shape} and {third.shape}:'
            ' they must be one-dimensional and of one length'
        )


class Status(IntEnum):
    """What became of a sample."""

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
VALUE_FAULTS = (Status.NOT_FINITE, Status.NO_VALUE, Status.IMPLAUSIBLE, Status.BELOW_MINIMUM)
"""What is wrong with a number, whenever it comes."""
NO_VALUES = (
    1e20,  # and any of greater magnitude: fill values of netCDF and others
    -999.25,  # LAS
    -9999.25,
    -999.0,
    -9999.0,
    -99999.0,
    32767.0,  # 16 bits with a sign, whole or in tenths; 3276.7 in single precision, too
    -32767.0,
    -32768.0,
    3276.7,
    -3276.7,
    -3276.8,
    3276.699951171875,
    -3276.699951171875,
    -3276.800048828125,
    65535.0,  # 16 bits without one, whole, in tenths or in quarters, and the error of NMEA 2000
    65534.0,
    6553.5,
    16383.75,
    16383.5,
)
"""Numbers by which senders say that there is no value, as they stand in messages."""
LEAST_NO_VALUE = min(map(abs, NO_VALUES))
