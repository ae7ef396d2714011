# SPDX-License-Identifier: Apache-2.0
"""Log times in another unit, and those that pass at another pace than the stamps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stickslip_logs.recordings.recording import Request, Series

# The years 2001 to 2099 [ns].
_DATES = 978_307_200 * 10**9, 4_102_444_800 * 10**9
# Messages of a topic a second that no telemetry has.
_TOO_MANY = 1000.0


def question_of_unit(start_ns: int | None, end_ns: int | None, max_count: int) -> str:
    """Return whether log times look like dates in another unit, where a topic has so many messages."""
    if start_ns is None or end_ns is None or end_ns <= start_ns:
        return ''
    rate = max_count / ((end_ns - start_ns) * 1e-9)
    for factor, unit in ((10**3, 'microseconds'), (10**6, 'milliseconds'), (10**9, 'seconds')):
        if rate > _TOO_MANY and _DATES[0] <= start_ns * factor and end_ns * factor <= _DATES[1]:
            return (
                f'log times are of January 1970, and one topic has {rate:.4g} messages a second:'
                f' are they in {unit}, not in nanoseconds?'
            )
    return ''


MOST = 1.5
"""Between clocks that were not rewritten no pace differs by this factor."""
Part = Mapping[Request, Series]
_LEAST_NS, _LONGEST_NS = 5 * 10**9, 60 * 10**9


class LogTimes:
    """The log times of a recording, as its first stretch with messages shows them.

    Attributes:
        text: What is wrong with them, as a sentence; empty where nothing is.
        replaced: Whether stamps count in their place.
    """

    def __init__(self) -> None:
        self.text, self.replaced, self._begun = '', False, False

    def of(self, reading: Iterable[Part]) -> Iterator[Part]:
        """Yield stretches with stamps in place of log times that pass at another pace; else unchanged.

        The first stretch with values decides. Stamps are made to rise; ``text`` and ``replaced`` are set.
        """
        for part in reading:
            if not self._begun:
                self._judge_paces(list(part.values()))
            yield (
                part
                if not self.replaced
                else {
                    request: replace(series, log_time_ns=np.maximum.accumulate(series.stamp_ns))
                    for request, series in part.items()
                }
            )

    def _judge_paces(self, series: Sequence[Series]) -> None:
        paces = [_measure_pace(item) for item in series if item.value.size]
        self._begun = bool(paces)
        unusual = [pace for pace in paces if pace is not None and not 1 / MOST <= pace <= MOST]
        if unusual:
            self.replaced = None not in paces
            by = 'stamps' if self.replaced else 'log times, because an input has no stamps'
            self.text = (
                f'Log times pass {unusual[0]:.3g} times as fast as the stamps, so they were rewritten:'
                f' judged by the {by}.'
            )


def _measure_pace(series: Series) -> float | None:
    """Return how fast the log times pass by the stamps; ``None`` where no stamp differs from them.

    Pauses and steps of either clock are left out; what is short says nothing, which is 1.
    """
    if np.array_equal(series.log_time_ns, series.stamp_ns):
        return None
    log, stamp = np.diff(series.log_time_ns), np.diff(series.stamp_ns)
    usual = (log >= 0) & (log < _LONGEST_NS) & (stamp >= 0) & (stamp < _LONGEST_NS)
    passed = int(stamp[usual].sum())
    return 1.0 if passed < _LEAST_NS else int(log[usual].sum()) / passed
