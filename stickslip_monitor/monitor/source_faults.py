# SPDX-License-Identifier: Apache-2.0
"""Finds from an input's values that they come from a wrong source, or from two at once.

Values that jump between two levels and back come from two publishers on one topic, a loose
contact, or a counter of few pulses a turn. One instance of :class:`SourceWatch` follows one input
at constant cost and memory. Time is that of arrival.

A *jump* is a step between two successive values by at least a fifth of the larger one. It
*returns* if it ends within an eighth of its height from where the previous jump began. Each
return counts one, each other jump takes two away; twelve raise the fault, at the earliest three
seconds after the first. White noise of a fifth of the load reaches that less than once in a
thousand hours at 10 Hz; a steady second publisher, with a tenth of the other's rate too, within
a few seconds. A minute without evidence clears.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.monitor.config import BearingConfig, InputConfig
from stickslip_monitor.monitor.ladder import SentenceEnum

ENOUGH = 12
"""Returns that raise the fault."""
LEAST_NS = 3 * 10**9
"""Least time between the first of them and the fault [ns]."""
HOLD_NS = 60 * 10**9
"""Time without one after which the fault is cleared [ns]."""
_GAP = 0.2
_TOLERANCE = 0.125
_PENALTY = 2
_LEAST_RPM = 3.0


class SourceFaultKind(SentenceEnum):
    """What is wrong with the source of an input; each member carries its sentence."""

    TWO_LEVELS = (
        'two_levels',
        'values jump between two levels: two publishers on one topic, or a loose contact',
    )
    FEW_PULSES = (
        'few_pulses',
        'values jump between 0 and one level: a counter of few pulses a turn, or a loose contact;'
        ' the speed is in between',
    )


@dataclass(frozen=True, slots=True)
class SourceFault:
    """A fault of an input's source, by the arrivals of samples."""

    kind: SourceFaultKind
    since_ns: int  # of the first sample that showed it
    raised_ns: int  # of that with which there was enough evidence
    levels: tuple[float, float]  # the two, rising, SI


def least_gap(config: BearingConfig, place: int) -> float:
    """The least distance between two levels of an input that is no resolution of a sensor [SI].

    A pulse counter at dead slow toggles between two neighbouring numbers; three revolutions a
    minute are beyond that.
    """
    return 0.0 if place else _LEAST_RPM * float(config.bearing.speed.factor('rpm'))


def fault_text(fault: SourceFault, config: InputConfig) -> str:
    """The fault as a clause, with levels as they stand in the messages."""
    low, high = (
        (level / config.factor - config.offset) / config.scale if config.scale else level
        for level in fault.levels
    )
    return f'{fault.kind.sentence} (here {low:.4g} and {high:.4g})'


@dataclass(slots=True)
class SourceWatch:
    """Follows the values of one input; see the module.

    Args:
        least_gap: The least distance between two levels [SI], see :func:`least_gap`.
    """

    least_gap: float = 0.0
    _count: int = 0
    _since_ns: int = 0
    _last_ns: int = 0
    _value: float = math.nan
    _origin: float = math.nan
    _fault: SourceFault | None = None

    def see(self, arrival_ns: int, si: float) -> SourceFault | None:
        """Take one value [SI], finite or not, at its arrival, not falling; the fault it raises."""
        if not math.isfinite(si):
            return None
        before, self._value = self._value, si
        height = abs(si - before)
        if not (height > 0.0 and height >= max(_GAP * max(abs(si), abs(before)), self.least_gap)):
            return None
        origin, self._origin = self._origin, before
        returns = abs(si - origin) <= _TOLERANCE * height
        late = self._count > 0 and arrival_ns - self._last_ns > HOLD_NS
        self._weaken(self._count if late else 0 if returns else _PENALTY)
        return self._returned(arrival_ns, (min(before, si), max(before, si))) if returns else None

    def see_column(self, arrival_ns: IntArray, si: FloatArray) -> list[SourceFault]:
        """:meth:`see` of values of shape (n,); what cannot be a jump costs nothing."""
        known = np.flatnonzero(np.isfinite(si))
        values = np.append(self._value, si[known])
        with np.errstate(over='ignore'):
            height = np.abs(np.diff(values))
            seen = (height > 0.0) & (height >= _GAP * np.abs(values[1:]))
        found = []
        for k in np.flatnonzero(seen).tolist():
            self._value = float(values[k])
            found.append(self.see(int(arrival_ns[known[k]]), float(values[k + 1])))
        self._value = float(values[-1])
        return [fault for fault in found if fault is not None]

    def standing(self, now_ns: int) -> SourceFault | None:
        """The fault that stands at a time of arrival [ns]."""
        if now_ns - self._last_ns > HOLD_NS:
            self._weaken(self._count)
        return self._fault

    def _weaken(self, by: int) -> None:
        """Take evidence away."""
        self._count = max(0, self._count - by)
        if not self._count:
            self._fault = None

    def _returned(self, now_ns: int, levels: tuple[float, float]) -> SourceFault | None:
        """One more piece of evidence; the fault, where it raises it."""
        if not self._count:
            self._since_ns = now_ns
        self._count, self._last_ns = min(self._count + 1, 2 * ENOUGH), now_ns
        if self._fault or self._count < ENOUGH or now_ns - self._since_ns < LEAST_NS:
            return None
        # Only a speed has a least distance: a load may well come and go.
        pulses = self.least_gap > 0.0 and 0.0 in levels
        kind = SourceFaultKind.FEW_PULSES if pulses else SourceFaultKind.TWO_LEVELS
        self._fault = SourceFault(kind, self._since_ns, now_ns, levels)
        return self._fault
