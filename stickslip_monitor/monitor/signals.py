# SPDX-License-Identifier: Apache-2.0
"""What comes in: samples, the rules by which they are believed, and counts of those that are not.

A sample is rejected, counted and named when its number is not finite or not plausible, or when
its time stamp repeats or precedes the input's last one. A stamp that steps back by more than the
input's timeout is a jump of the clock (a replay that starts over, a corrected system clock): the
sample is believed and everything that was waiting on time starts anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import BearingConfig, InputConfig

QUANTITIES = ('speed', 'load')
"""What makes an operating point."""
INPUTS = (*QUANTITIES, 'level')
"""What may be measured of a bearing; the places are those in the monitor's calls."""
LEVEL = 2


@dataclass(frozen=True, slots=True)
class Sample:
    """One measured number of one bearing, as it arrived.

    Attributes:
        bearing: Name of the bearing.
        quantity: One of :data:`INPUTS`.
        time_ns: Time of the measurement [ns].
        value: The number in the message, in the input's own scale.
    """

    bearing: str
    quantity: str
    time_ns: int
    value: float


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
        shapes = {self.time_ns.shape, self.value.shape, self.place.shape}
        if len(shapes) != 1 or self.time_ns.ndim != 1:
            raise ConfigurationError(
                f'level columns have shapes {self.time_ns.shape}, {self.value.shape} and'
                f' {self.place.shape}: they must be one-dimensional and of one length'
            )


NO_LEVELS = Levels(np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64))


@dataclass(frozen=True, slots=True)
class Stream:
    """The samples of one bearing in order of arrival, for bulk evaluation.

    Attributes:
        time_ns: Times of measurement, shape (n,) int64 [ns].
        is_load: Whether the sample is a load (else a speed), shape (n,) bool.
        value: Numbers in the inputs' own scales, shape (n,).
        level: The values of measured vibration that came among them; ``None`` for none.
    """

    time_ns: NDArray[np.int64]
    is_load: NDArray[np.bool_]
    value: NDArray[np.float64]
    level: Levels | None = None

    def __post_init__(self) -> None:
        shapes = {self.time_ns.shape, self.is_load.shape, self.value.shape}
        if len(shapes) != 1 or self.time_ns.ndim != 1:
            raise ConfigurationError(
                f'stream columns have shapes {self.time_ns.shape}, {self.is_load.shape} and'
                f' {self.value.shape}: they must be one-dimensional and of one length'
            )

    def until(self, size: int) -> Stream:
        """The first values of speed and load, and what came of the level among them."""
        level, rows = self.level, slice(size)
        if level is not None:
            own = slice(int(np.searchsorted(level.place, size)))
            level = Levels(level.time_ns[own], level.value[own], level.place[own])
        return Stream(self.time_ns[rows], self.is_load[rows], self.value[rows], level)


class Status(IntEnum):
    """What became of a sample."""

    ACCEPTED = 0
    CLOCK_JUMP = 1
    NOT_FINITE = 2
    IMPLAUSIBLE = 3
    REPEATED = 4
    OUT_OF_ORDER = 5

    @property
    def believed(self) -> bool:
        """Whether the sample is used."""
        return self <= Status.CLOCK_JUMP


STATUS_SENTENCES = {
    Status.CLOCK_JUMP: 'the clock jumped back; delays started anew',
    Status.NOT_FINITE: 'not a finite number',
    Status.IMPLAUSIBLE: 'beyond the largest plausible magnitude',
    Status.REPEATED: 'same time stamp as the one before',
    Status.OUT_OF_ORDER: 'older than the one before',
}


def to_si(config: InputConfig, value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measured numbers as SI values (surface speed [m/s] or load [N]), deadband applied."""
    with np.errstate(over='ignore', invalid='ignore'):
        si = (value * config.scale + config.offset) * config.factor
    return np.where(np.abs(si) < config.deadband, 0.0, si)


def value_faults(config: InputConfig, si: NDArray[np.float64]) -> NDArray[np.int8]:
    """Status of each SI value by itself: accepted, not finite or implausible."""
    plausible = np.abs(si) <= config.maximum
    if plausible.all():
        return np.zeros(si.shape, np.int8)
    status = np.where(plausible, Status.ACCEPTED, Status.IMPLAUSIBLE)
    return np.where(np.isfinite(si), status, Status.NOT_FINITE).astype(np.int8)


def number_to_si(config: InputConfig, number: float) -> tuple[float, Status]:
    """:func:`to_si` and :func:`value_faults` of one number: the same operations in Python."""
    si = (number * config.scale + config.offset) * config.factor
    size = abs(si)
    if size < config.deadband:
        return 0.0, Status.ACCEPTED
    if size <= config.maximum:
        return si, Status.ACCEPTED
    return si, Status.IMPLAUSIBLE if math.isfinite(si) else Status.NOT_FINITE


def judge_stamp(time_ns: int, last_ns: int | None, timeout_ns: int) -> Status:
    """Status of a stamp after the last one believed of its input, ``None`` where there is none."""
    if last_ns is None or time_ns > last_ns:
        return Status.ACCEPTED
    if time_ns == last_ns:
        return Status.REPEATED
    return Status.CLOCK_JUMP if last_ns - time_ns > timeout_ns else Status.OUT_OF_ORDER


class SampleValidator:
    """Decides sample by sample what is believed, from the stamps of a bearing's two inputs."""

    def __init__(self, config: BearingConfig) -> None:
        self.timeouts = (config.speed.timeout_ns, config.load.timeout_ns)
        self.last_ns: list[int | None] = [None, None]
        self.counts = np.zeros((len(QUANTITIES), len(Status)), dtype=np.int64)

    def admit(self, is_load: int, time_ns: int, fault: Status) -> Status:
        """Judge one sample, given the fault of its value, and remember its stamp if believed."""
        status = fault or judge_stamp(time_ns, self.last_ns[is_load], self.timeouts[is_load])
        if status is Status.CLOCK_JUMP:
            self.last_ns[1 - is_load] = None
        if status.believed:
            self.last_ns[is_load] = time_ns
        self.counts[is_load, status] += 1
        return status
