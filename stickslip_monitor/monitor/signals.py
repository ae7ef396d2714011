# SPDX-License-Identifier: Apache-2.0
"""What comes in and what is said of it: samples, streams, severities, conditions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from inspect import get_annotations
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import InputConfig

_SentenceEnum = TypeVar('_SentenceEnum', bound='SentenceEnum')


class SentenceEnum(str, Enum):
    """A name; each member carries what its class declares, and then its sentence."""

    sentence: str

    def __new__(cls: type[_SentenceEnum], name: str, *facts: Any) -> _SentenceEnum:
        """Make a member from its name and its facts, the sentence last."""
        member = str.__new__(cls, name)
        member._value_ = name
        for fact, value in zip([*get_annotations(cls), 'sentence'], facts, strict=True):
            setattr(member, fact, value)
        return member

    def __str__(self) -> str:
        return str(self.value)


class Level(IntEnum):
    """Severity, with the values of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


class Condition(SentenceEnum):
    """What the alarm of a bearing says."""

    level: Level

    NORMAL = 'normal', Level.OK, 'No stick-slip predicted.'
    VIBRATION = (
        'vibration',
        Level.WARN,
        'Vibration is measured where no stick-slip is possible: the model does not explain it.',
    )
    CAUTION = 'caution', Level.WARN, 'Close to the stick-slip region.'
    BISTABLE = (
        'bistable',
        Level.WARN,
        'Inside the bistable range: a disturbance can start stick-slip.',
    )
    STICK_SLIP = 'stick_slip', Level.ERROR, 'Stick-slip predicted.'
    AMPLITUDE = 'amplitude_limit', Level.ERROR, 'Stick-slip predicted above the amplitude limit.'
    INPUT_STALE = 'input_stale', Level.ERROR, 'An input is lost: nothing can be predicted.'


CONDITIONS = tuple(Condition)
"""The conditions as the rule numbers them."""
# Vibration that the model does not explain hides nothing that the model says.
LADDER = CONDITIONS[:-1]
"""Those of the operating point, in rising order of trouble."""


class Measured(SentenceEnum):
    """What the level says of the lining."""

    UNKNOWN = 'unknown', 'Whether the lining vibrates is not known.'
    QUIET = 'quiet', 'No vibration is measured.'
    VIBRATING = 'vibrating', 'Vibration is measured.'


MEASURED = tuple(Measured)


class Unknown(SentenceEnum):
    """Why the level says nothing; each member carries its clause."""

    NOTHING = 'nothing', 'no level has come'
    LOST = 'lost', 'the level is lost'
    STUCK = 'stuck', 'the level never changes: its sensor is stuck'
    LOUD = 'loud', 'the level is high where no stick-slip can exist: it tells something else'
    ONE_MODE = 'one_mode', 'no threshold is configured, and none has been learned yet'
    SHORT = 'short', 'the level has not been above or below its threshold for long enough'


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
    """

    time_ns: NDArray[np.int64]
    inputs: NDArray[np.int8]
    value: NDArray[np.float64]
    level: Levels | None = None

    def __post_init__(self) -> None:
        _require_columns('stream', self.time_ns, self.inputs, self.value)
        columns: dict[str, Any] = {
            'time_ns': np.asarray(self.time_ns, np.int64),
            'inputs': np.asarray(self.inputs).astype(np.int8),
            'value': np.asarray(self.value, float),
        }
        if self.level is not None:
            own: Any = self.level.time_ns, Input.LEVEL, self.level.value
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
    CLOCK_JUMP = 1
    NOT_FINITE = 2
    IMPLAUSIBLE = 3
    REPEATED = 4
    OUT_OF_ORDER = 5
    ODD_STAMP = 6

    @property
    def believed(self) -> bool:
        """Whether the sample is used."""
        return self <= Status.CLOCK_JUMP


STATUS_SENTENCES = {
    Status.CLOCK_JUMP: 'the clock jumped back',
    Status.NOT_FINITE: 'not a finite number',
    Status.IMPLAUSIBLE: 'beyond the largest plausible magnitude',
    Status.REPEATED: 'same time stamp as the one before',
    Status.OUT_OF_ORDER: 'older than the one before',
    Status.ODD_STAMP: 'time stamp far from those before, and not followed by the next',
}


def to_si(config: InputConfig, value: Any) -> Any:
    """Numbers in messages as SI values, deadband applied; of one number or of an array.

    A surface speed is in m/s, a load in N, a level in its own unit.
    """
    with np.errstate(over='ignore', invalid='ignore'):
        si = (value * config.scale + config.offset) * config.factor
        return si * (abs(si) >= config.deadband)
