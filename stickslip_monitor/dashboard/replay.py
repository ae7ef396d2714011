# SPDX-License-Identifier: Apache-2.0
"""The monitor over a recording in the recording's time, for a dashboard; no ROS is needed."""

from __future__ import annotations

import asyncio
import math
import time
from typing import Any, NamedTuple

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Recording
from stickslip_monitor.dashboard.seen_monitors import DashboardState
from stickslip_monitor.errors import BagError
from stickslip_monitor.monitor.input_faults import Graph
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import Moment, NoLog, Session
from stickslip_monitor.offline.check import requests_of
from stickslip_monitor.offline.input_binding import bind_at_least_one

# Time between two updates of the page [s], and for which samples are played before the page has its turn [s].
_SHOWN_EVERY, _TURN = 0.2, 0.01


class _Sample(NamedTuple):
    """A number of the recording, when it was recorded, and when it was measured [ns]."""

    sequence: int
    log_time_ns: int
    stamp_ns: int
    value: float
    bearing: str
    place: Input


class Replay:
    """Plays a recording to a monitor and its alarms, and shows both on a board.

    It can be paused, and go to any place: backwards by playing it again up to there, as fast as the
    monitor can.

    Args:
        path: The recording.
        config: The configuration; its topics must be in the recording.
        rate: How much faster than recorded, > 0.
        board: What is fed; its one monitor is that of the recording.

    Raises:
        BagError: It cannot be read, lacks an input, or has no sample of any.
    """

    def __init__(self, path: str, config: MonitorConfig, rate: float, board: DashboardState) -> None:
        recording = open_bag(path)
        bound = bind_at_least_one(recording, config)
        for text in bound.absent.values():
            raise BagError(text)
        self._config, self._rate, self._board = bound.config, rate, board
        (self._shown,) = board.monitors
        self._samples = _read_samples(recording, bound.config)
        if not self._samples:
            raise BagError(f"bag '{path}' has no sample of the configured inputs")
        self._start_ns = self._samples[0].log_time_ns
        # They are in the order of the recording, which need not be that of its clock.
        self._length_ns = max(sample.log_time_ns for sample in self._samples) - self._start_ns
        self._changed = asyncio.Event()
        self._paused = False
        self._restart_session()

    def _restart_session(self) -> None:
        """Go to the first sample, with a new session that begins there and takes the page's actions."""
        self._session = Session(self._config, self._shown, NoLog(), lambda: self._log_ns, None, Graph())
        self._shown.act = self._session.act
        self._next = 0
        self._log_ns = self._start_ns
        self._go_from(self._start_ns)
        self._session.begin()

    def _go_from(self, log_ns: int) -> None:
        """Set the log time [ns] from which the playing time counts, from now on."""
        self._from_ns, self._since = log_ns, time.monotonic()

    def _wanted_ns(self) -> int:
        """Return the log time that should be reached by now [ns], at most that of the end."""
        passed = 0.0 if self._paused else (time.monotonic() - self._since) * self._rate
        return min(self._from_ns + round(passed * 1e9), self._start_ns + self._length_ns)

    def set_paused(self, paused: bool) -> None:
        """Pause or resume the replay at the place it should have reached; wake :meth:`run` if it waits."""
        self._go_from(self._wanted_ns())
        self._paused = paused
        self._changed.set()

    def seek(self, seconds: float) -> None:
        """Go to a time since the beginning [s], limited to the recording; a pause stays one.

        A step back, and any step after the end, clears all results and the log, and plays from the beginning
        up to there with a new session. :meth:`play` does the playing.
        """
        place = self._start_ns + round(min(max(seconds, 0.0), self._length_ns * 1e-9) * 1e9)
        if place < self._log_ns or self._board.finished:
            self._log_ns = self._start_ns
            self._board.restart(self._replay_place())
            self._restart_session()
        self._go_from(place)
        self._changed.set()

    async def run(self) -> None:
        """Play the recording until cancelled: to its end, and again after each step back."""
        while True:
            await self.play()
            self._changed.clear()
            await self._changed.wait()

    async def play(self) -> None:
        """Play the recording from its present place to its end, showing its state; then finish the board.

        A pause holds it up; it returns at the end only.
        """
        shown = -math.inf
        while self._next < len(self._samples):
            behind = self._play_until(self._wanted_ns())
            if time.monotonic() - shown >= _SHOWN_EVERY:
                shown = time.monotonic()
                self._show_state()
            # However fast it is to go, the readers of the page get their turn.
            await asyncio.sleep(0.0 if behind else _SHOWN_EVERY)
        self._show_state()
        self._board.finish()

    def _play_until(self, wanted_ns: int) -> bool:
        """Take the samples up to a log time [ns], for up to ``_TURN``; return whether some up to it are left.

        Bearings and alarms are advanced to each sample, and to the log time where a later sample exists.
        """
        end = time.monotonic() + _TURN
        while self._next < len(self._samples):
            sample = self._samples[self._next]
            if sample.log_time_ns > wanted_ns:
                self._advance_to(wanted_ns)
                return False
            if time.monotonic() > end:
                return True
            self._advance_to(sample.log_time_ns)
            self._session.take(
                sample.bearing, sample.place, sample.stamp_ns, sample.value, self._moment_now()
            )
            self._next += 1
        return False

    def _advance_to(self, log_ns: int) -> None:
        """Advance all bearings and alarms to a log time [ns]; to one that has passed, not at all."""
        self._log_ns = max(self._log_ns, log_ns)
        now = self._moment_now()
        for name in self._session.monitor.bearings:
            self._session.advance(name, self._log_ns, now)
        self._session.tick(now, self._log_ns - self._start_ns)

    def _moment_now(self) -> Moment:
        """Return the present place of the recording as the time now."""
        return Moment(self._log_ns, self._log_ns)

    def _show_state(self) -> None:
        """Show all bearings and the place in the recording on the board, which sends what is new."""
        self._session.show(self._moment_now())
        self._board.show_place(self._replay_place())

    def _replay_place(self) -> dict[str, Any]:
        """Return the place in the recording for the page: ``at`` and ``length`` [s], and ``paused``."""
        return {
            'at': round((self._log_ns - self._start_ns) * 1e-9, 1),
            'length': round(self._length_ns * 1e-9, 1),
            'paused': self._paused,
        }


def _read_samples(recording: Recording, config: MonitorConfig) -> list[_Sample]:
    """Return the numbers of a recording in its order, one for each bearing and input that reads it.

    Raises:
        BagError: It cannot be read.
    """
    sources = [
        (request, bearing.name, place)
        for bearing in config.bearings
        for place, request in zip(Input, requests_of(bearing), strict=False)
    ]
    series, samples = recording.read({request for request, *_ in sources}), list[_Sample]()
    for request, *source in sources:
        numbers = series[request]
        columns = (numbers.sequence, numbers.log_time_ns, numbers.stamp_ns, numbers.value)
        samples += (_Sample(*row, *source) for row in zip(*(c.tolist() for c in columns), strict=True))
    return sorted(samples, key=lambda sample: sample.sequence)
