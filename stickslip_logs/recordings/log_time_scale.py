# SPDX-License-Identifier: Apache-2.0
"""Detects log times in another unit, and those that pass at another pace than the stamps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stickslip_logs.recordings.recording import Request, Series
from stickslip_logs.time_order import DATES_FROM_NS, MAX_TIME_NS
from stickslip_logs.units import SECOND_NS


def ask_for_time_unit(start_ns: int | None, end_ns: int | None, max_count: int) -> str:
    """Return a question to the owner where log times look like dates in another unit than ns; else empty.

    They do where a topic has more than 1000 messages a second, and in another unit are dates of 1973 to 2116.

    Args:
        start_ns: The first log time [ns]; None without messages.
        end_ns: The last log time [ns]; None without messages.
        max_count: How many messages the topic with the most of them has.
    """
    if start_ns is None or end_ns is None or end_ns <= start_ns:
        return ''
    rate = max_count / ((end_ns - start_ns) * 1e-9)
    for factor, unit in ((10**3, 'microseconds'), (10**6, 'milliseconds'), (10**9, 'seconds')):
        if rate > 1000.0 and start_ns * factor >= DATES_FROM_NS and end_ns * factor <= MAX_TIME_NS:
            return (
                f'log times are of January 1970, and one topic has {rate:.4g} messages a second:'
                f' are they in {unit}, not in nanoseconds?'
            )
    return ''


MAX_PACE = 1.5
"""Clocks that were not rewritten never differ by this factor."""
Part = Mapping[Request, Series]
# Longer intervals are pauses; longer steps back are a clock that was set, and shorter ones messages in
# disorder, for which the steps ahead beside them make up [ns].
_MAX_INTERVAL_NS, _MAX_DISORDER_NS = 60 * SECOND_NS, 10 * SECOND_NS


class LogTimes:
    """The log times of a recording, as its first stretch with messages shows them.

    Attributes:
        text: What is wrong with them, as a sentence; empty where nothing is.
        are_replaced: Whether stamps count in their place.
    """

    def __init__(self) -> None:
        self.text, self.are_replaced, self._is_judged = '', False, False

    def correct_parts(self, reading: Iterable[Part]) -> Iterator[Part]:
        """Yield the parts of a reading, with stamps as log times where the log times were rewritten.

        The first part with values decides for all parts, and sets ``text`` and ``are_replaced``. A stamp that
        steps back is raised to the highest one before it in its part.
        """
        for part in reading:
            if not self._is_judged:
                self._compare_paces(list(part.values()))
            if self.are_replaced:
                part = {r: replace(s, log_time_ns=np.maximum.accumulate(s.stamp_ns)) for r, s in part.items()}
            yield part

    def _compare_paces(self, series: Sequence[Series]) -> None:
        """Set ``text`` where log times pass at an odd pace; then ``are_replaced`` if all series have stamps.

        Where all series are empty the next part is compared too.
        """
        paces = [_measure_pace(item) for item in series if item.value.size]
        self._is_judged = bool(paces)
        unusual = [pace for pace in paces if pace is not None and not 1 / MAX_PACE <= pace <= MAX_PACE]
        if unusual:
            self.are_replaced = None not in paces
            by = 'stamps' if self.are_replaced else 'log times, because an input has no stamps'
            self.text = (
                f'Log times pass {unusual[0]:.3g} times as fast as the stamps, so they were rewritten:'
                f' judged by the {by}.'
            )


def _measure_pace(series: Series) -> float | None:
    """Return the seconds of log time that pass in a second of stamps; None for a series without own stamps.

    A series has none where its stamps equal its log times. Pauses of a minute and clocks that were set back
    are skipped. A series of less than five seconds is too short to tell a pace and has the pace 1.
    """
    if np.array_equal(series.log_time_ns, series.stamp_ns):
        return None
    log, stamp = steps = np.diff([series.log_time_ns, series.stamp_ns])
    usual = ((steps > -_MAX_DISORDER_NS) & (steps < _MAX_INTERVAL_NS)).all(axis=0)
    passed = int(stamp[usual].sum())
    return 1.0 if passed < 5 * 10**9 else int(log[usual].sum()) / passed
