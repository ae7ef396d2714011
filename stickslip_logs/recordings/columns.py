# SPDX-License-Identifier: Apache-2.0
"""Describes the columns of a log to deliver, their names and units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_logs.arrays import FloatArray
from stickslip_logs.tables.dialect import parse_heading

FLOAT64 = 'std_msgs/msg/Float64'


@dataclass(frozen=True, slots=True)
class LogColumn:
    """A column of a table, or the rows of a name in a table of one value a line.

    Attributes:
        heading: Its heading.
        place: The number of the column that holds its numbers.
        name: The name whose rows count; None where all do.
        unit: As the configuration calls it; None where its heading has none of these.
        is_other: Whether another sender of a bus was the first to send a number of this name.
        where: The rows that count, where several things share the column: those with that text at each of
            these places.
    """

    heading: str
    place: int
    name: str | None = None
    unit: str | None = None
    is_other: bool = False
    where: tuple[tuple[int, str], ...] = ()

    @property
    def has_unit(self) -> bool:
        """Whether its heading names a unit, known or not."""
        return self.unit is not None or bool(parse_heading(self.heading).unit)


@dataclass(frozen=True, slots=True)
class SourceColumn:
    """A column as the sensor of an input would have sent it: ``(ratio x - offset) / scale``.

    ``no_values`` are numbers that mean "no value", and have no unit. ``status`` is the place of the column
    that says whether its numbers count, if there is one. With a ``timeout`` [s] of its input other senders of
    the same number count while the first one is silent.
    """

    column: LogColumn
    ratio: float = 1.0
    scale: float = 1.0
    offset: float = 0.0
    no_values: tuple[float, ...] = ()
    status: int | None = None
    timeout: float | None = None

    def sent(self, values: FloatArray) -> FloatArray:
        """Return numbers of the column as the sensor would have sent them; those in ``no_values`` unchanged.

        Numbers that become too large are infinite. Without a conversion the array itself is returned.
        """
        if (self.ratio, self.scale, self.offset) == (1.0, 1.0, 0.0):
            return values
        with np.errstate(over='ignore'):  # infinite is no value either
            sent = (values * self.ratio - self.offset) / self.scale
        return np.where(np.isin(values, self.no_values), values, sent)
