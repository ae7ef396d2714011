# SPDX-License-Identifier: Apache-2.0
"""Finds from an input's samples that they come from a wrong source, or from two at once.

Three faults can be seen in the samples themselves:

- **two levels**: values jump between two levels and back, as with two publishers on one topic;
- **stamps to and fro**: stamps step back again and again, as with two clocks on one topic;
- **in bursts**: several stamps are close together or alike, then none come, again and again.

One instance of :class:`SourceWatch` follows one input, one sample at a time at constant cost and
memory; :meth:`SourceWatch.see_many` gives the same for many at once, bit for bit::

    watch = SourceWatch(least_gap(bearing_config, place))
    for fault in watch.see(arrival_ns, stamp_ns, si):  # every sample, refused ones too
        log(fault_text(fault, input_config))           # raised by this sample
    watch.standing(now_ns)                             # the faults that stand now

Time is that of arrival, because the stamps themselves may be at fault.

A *jump* is a step between two successive values by at least a fifth of the larger one. It
*returns* if it ends within an eighth of its height from where the previous jump began. Each
return counts one, each other jump takes two away; twelve raise the fault, at the earliest three
seconds after the first. White noise of a fifth of the load reaches that less than once in a
thousand hours at 10 Hz; a steady second publisher, with a tenth of the other's rate too, within
a few seconds. For stamps, each step back within eight samples of the last one counts one, and a
longer pause starts anew: single late messages are no fault. A *burst* is a step that is more than
twenty times the one before it, and within 32 samples of the last one. A minute without evidence
clears.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.config import BearingConfig, InputConfig
from stickslip_monitor.monitor.ladder import SentenceEnum

ENOUGH = 12
"""Pieces of evidence that raise a fault."""
LEAST_NS = 3 * 10**9
"""Least time between the first piece of evidence and the fault [ns]."""
HOLD_NS = 60 * 10**9
"""Time without evidence after which a fault is cleared [ns]."""
_GAP = 0.2
_TOLERANCE = 0.125
_PENALTY = 2
_MOST = 2 * ENOUGH
_NEAR = 8
_BURST, _BURST_NEAR = 20, 32
_LEAST_RPM = 3.0


class SourceFaultKind(SentenceEnum):
    """What is wrong with the source of an input; each member carries its sentence."""

    STAMPS_TO_AND_FRO = (
        'stamps_to_and_fro',
        'time stamps jump to and fro: two publishers or clocks on one topic, or messages that'
        ' overtake each other',
    )
    IN_BURSTS = (
        'in_bursts',
        'messages come in bursts or as copies: a sender or gateway that stalls, or sends twice',
    )
    TWO_LEVELS = (
        'two_levels',
        'values jump between two levels: two publishers on one topic, or a loose contact',
    )


@dataclass(frozen=True, slots=True)
class SourceFault:
    """A fault of an input's source, by the arrivals of samples."""

    kind: SourceFaultKind
    since_ns: int  # of the first sample that showed it
    raised_ns: int  # of that with which there was enough evidence
    levels: tuple[float, float] = (math.nan, math.nan)  # the two, rising, SI; nan for stamps


def least_gap(config: BearingConfig, place: int) -> float:
    """The least distance between two levels of an input that is no resolution of a sensor [SI].

    A pulse counter at dead slow toggles between two neighbouring numbers; three revolutions a
    minute are beyond that.
    """
    return 0.0 if place else _LEAST_RPM * float(config.bearing.speed.factor('rpm'))


def fault_text(fault: SourceFault, config: InputConfig) -> str:
    """The fault as a clause, with levels as they stand in the messages."""
    if fault.kind is not SourceFaultKind.TWO_LEVELS:
        return fault.kind.sentence
    low, high = (
        (level / config.factor - config.offset) / config.scale if config.scale else level
        for level in fault.levels
    )
    return f'{fault.kind.sentence} (here {low:.4g} and {high:.4g})'


@dataclass(slots=True)
class _Evidence:
    """Evidence of one kind of fault, counted up and down."""

    kind: SourceFaultKind
    count: int = 0
    since_ns: int = 0
    last_ns: int = 0
    last_number: int = 0
    fault: SourceFault | None = None

    def against(self, penalty: int) -> None:
        """Evidence that it is no such fault."""
        self.count = max(0, self.count - penalty)
        if not self.count:
            self.fault = None

    def expire(self, now_ns: int) -> None:
        """Forget all where there has been no evidence for long enough."""
        if now_ns - self.last_ns > HOLD_NS:
            self.against(self.count)

    def add(
        self, now_ns: int, levels: tuple[float, float] = (math.nan, math.nan)
    ) -> list[SourceFault]:
        """One more piece; the fault, where it raises one."""
        self.expire(now_ns)
        if not self.count:
            self.since_ns = now_ns
        self.count, self.last_ns = min(self.count + 1, _MOST), now_ns
        if self.fault or self.count < ENOUGH or now_ns - self.since_ns < LEAST_NS:
            return []
        self.fault = SourceFault(self.kind, self.since_ns, now_ns, levels)
        return [self.fault]

    def again(self, number: int, now_ns: int, near: int) -> list[SourceFault]:
        """One more piece, with the sample of this number; the first where the last is not near."""
        if number - self.last_number > near:
            self.against(_MOST)
        self.last_number = number
        return self.add(now_ns)


@dataclass(slots=True)
class SourceWatch:
    """Follows the samples of one input; see the module.

    Args:
        least_gap: The least distance between two levels [SI], see :func:`least_gap`.
    """

    least_gap: float = 0.0
    _stamps: _Evidence = field(
        default_factory=lambda: _Evidence(SourceFaultKind.STAMPS_TO_AND_FRO)
    )
    _bursts: _Evidence = field(default_factory=lambda: _Evidence(SourceFaultKind.IN_BURSTS))
    _levels: _Evidence = field(default_factory=lambda: _Evidence(SourceFaultKind.TWO_LEVELS))
    _number: int = -1
    _stamp_ns: int | None = None
    _step_ns: int = -1
    _value: float = math.nan
    _origin: float = math.nan

    def see(self, arrival_ns: int, stamp_ns: int, si: float) -> tuple[SourceFault, ...]:
        """Take one sample; nothing is refused.

        Args:
            arrival_ns: When it came, not falling [ns].
            stamp_ns: Its time stamp, the arrival where it has none [ns].
            si: Its value [SI]; one that is not finite says nothing about levels.

        Returns:
            The faults that it raises.
        """
        self._number += 1
        raised = []
        if self._stamp_ns is not None:
            before, self._step_ns = self._step_ns, stamp_ns - self._stamp_ns
            if self._step_ns < 0:
                raised += self._stamps.again(self._number, arrival_ns, _NEAR)
            elif before >= 0 and self._step_ns > _BURST * before:  # a pause ends a burst
                raised += self._bursts.again(self._number, arrival_ns, _BURST_NEAR)
        self._stamp_ns = stamp_ns
        if math.isfinite(si):
            raised += self._jump(arrival_ns, self._value, si)
            self._value = si
        return tuple(raised)

    def see_many(
        self, arrival_ns: NDArray[np.int64], stamp_ns: NDArray[np.int64], si: NDArray[np.float64]
    ) -> list[SourceFault]:
        """:meth:`see` of several samples.

        Args:
            arrival_ns: When each came, not falling, shape (n,) [ns].
            stamp_ns: Their stamps, shape (n,) [ns].
            si: Their values, shape (n,) [SI].

        Returns:
            The faults in the order in which they were raised.
        """
        if not stamp_ns.size:
            return []
        before_ns, fresh = self._stamp_ns, self._stamp_ns is None
        stamps = np.append(stamp_ns[:1] if before_ns is None else before_ns, stamp_ns)
        steps = np.append(self._step_ns, np.diff(stamps))
        if fresh:
            steps[1] = -1
        # A value that is not finite leaves the one before it.
        known = np.append(True, np.isfinite(si))
        places = np.maximum.accumulate(np.where(known, np.arange(known.size), 0))
        values = np.append(self._value, si)[places]
        with np.errstate(over='ignore'):
            height = np.abs(np.diff(values))
            seen = (height > 0.0) & (height >= _GAP * np.abs(values[1:]))
            seen |= (steps[1:] < 0) | (steps[1:] > _BURST * steps[:-1])
        # What no part of the evidence can be in needs no look.
        found: list[SourceFault] = []
        taken = self._number + 1
        for k in np.flatnonzero(seen).tolist():
            self._number, self._value = taken + k - 1, float(values[k])
            self._stamp_ns = None if fresh and k == 0 else int(stamps[k])
            self._step_ns = int(steps[k])
            found += self.see(int(arrival_ns[k]), int(stamp_ns[k]), float(si[k]))
        self._number, self._value = taken + stamp_ns.size - 1, float(values[-1])
        self._stamp_ns, self._step_ns = int(stamps[-1]), int(steps[-1])
        return found

    def standing(self, now_ns: int) -> tuple[SourceFault, ...]:
        """The faults that stand at a time of arrival [ns]."""
        kinds = (self._stamps, self._bursts, self._levels)
        for evidence in kinds:
            evidence.expire(now_ns)
        return tuple(evidence.fault for evidence in kinds if evidence.fault)

    def _jump(self, arrival_ns: int, before: float, after: float) -> list[SourceFault]:
        height = abs(after - before)
        least = max(self.least_gap, _GAP * abs(before), _GAP * abs(after))
        if not (height > 0.0 and height >= least):
            return []
        origin, self._origin = self._origin, before
        if not abs(after - origin) <= _TOLERANCE * height:
            self._levels.against(_PENALTY)
            return []
        return self._levels.add(arrival_ns, (min(before, after), max(before, after)))
