# SPDX-License-Identifier: Apache-2.0
"""The monitor over a recording in the recording's time, for a dashboard; no ROS is needed."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge

from stickslip_monitor.bags.reader import Request, Series, open_bag
from stickslip_monitor.dashboard.state import DashboardState
from stickslip_monitor.errors import BagError, ConfigurationError
from stickslip_monitor.monitor.alarms.live_alarms import LiveAlarms
from stickslip_monitor.monitor.alarms.requests import ActionRequest
from stickslip_monitor.monitor.config import InputConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import NODE_NAME
from stickslip_monitor.monitor.messages import diagnostic_record, state_of
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.surface_store import prepare_surfaces

_SHOWN_EVERY = 0.2
_TURN = 0.01


@dataclass(frozen=True, slots=True)
class _Sample:
    """A number of the recording: when it was recorded, when it was measured [ns], its place."""

    log_ns: int
    stamp_ns: int
    place: int
    bearing: str
    is_load: int
    value: float


class Replay:
    """Plays a recording to a monitor and its alarms, and shows both on a board.

    Args:
        path: The recording.
        config: The configuration.
        rate: How much faster than recorded.
        board: What is fed.

    Raises:
        BagError: It cannot be read, or lacks a topic.
        ConfigurationError: The rate is none.
    """

    def __init__(
        self, path: str, config: MonitorConfig, rate: float, board: DashboardState
    ) -> None:
        if not (math.isfinite(rate) and rate > 0.0):
            raise ConfigurationError(f'--rate {rate:g} must be a number above 0')
        self._rate, self._board = rate, board
        self._samples = list(_samples(path, config))
        if not self._samples:
            raise BagError(f"bag '{path}' has no sample of the configured inputs")
        prepare_surfaces(item.bearing for item in config.bearings)
        self._monitor = Monitor(config)
        self._alarms = LiveAlarms(
            config, lambda: self._log_ns, board.take_alarms, logging.getLogger(NODE_NAME)
        )
        self._log_ns = self._start_ns = self._samples[0].log_ns
        # How far the clock of the samples is from the recorder's, bearing by bearing [ns].
        self._ahead_ns = dict.fromkeys(
            self._monitor.bearings, self._samples[0].stamp_ns - self._start_ns
        )

    def act(self, request: ActionRequest) -> None:
        """Do what a person asks for."""
        self._alarms.act(request.action, request.by, request.bearing, request.kind)

    async def play(self) -> None:
        """Play it to its end."""
        self._alarms.begin()
        begin, shown, slept = time.monotonic(), -math.inf, time.monotonic()
        for sample in self._samples:
            while True:
                left = begin + (sample.log_ns - self._start_ns) * 1e-9 / self._rate
                left -= time.monotonic()
                self._pass_time(sample.log_ns - round(max(left, 0.0) * self._rate * 1e9))
                if time.monotonic() - shown >= _SHOWN_EVERY:
                    shown = time.monotonic()
                    self._show()
                # However fast it is to go, the readers of the page get their turn.
                if left > 0.0 or time.monotonic() - slept > _TURN:
                    await asyncio.sleep(min(max(left, 0.0), _SHOWN_EVERY))
                    slept = time.monotonic()
                if left <= 0.0:
                    break
            self._take(sample)
        self._show()
        self._board.finish()

    def _pass_time(self, log_ns: int) -> None:
        """Let the recorder's time pass without a sample."""
        self._log_ns = max(self._log_ns, log_ns)
        for name, bearing in self._monitor.bearings.items():
            self._alarms.feed_events(bearing.advance(self._time_ns(name)))
        self._alarms.advance(self._log_ns - self._start_ns)

    def _time_ns(self, bearing: str) -> int:
        return self._log_ns + self._ahead_ns[bearing]

    def _take(self, sample: _Sample) -> None:
        name, is_load, time_ns = sample.bearing, sample.is_load, sample.stamp_ns
        update = self._monitor.bearings[name].update(is_load, time_ns, sample.value)
        if update.status.believed:
            self._ahead_ns[name] = time_ns - sample.log_ns
        self._alarms.feed(name, is_load, time_ns, update)

    def _show(self) -> None:
        for name, bearing in self._monitor.bearings.items():
            record = diagnostic_record(NODE_NAME, state_of(bearing))
            self._board.take_status(name, self._time_ns(name), record.message, record.values)


def _samples(path: str, config: MonitorConfig) -> Iterator[_Sample]:
    """The numbers of a recording in its order."""
    bag = open_bag(path)
    sources = [
        (b.name, is_load, _request(source))
        for b in config.bearings
        for is_load, source in enumerate((b.speed, b.load))
    ]
    series = bag.read({request for *_, request in sources})
    own = [_column(name, is_load, series[request]) for name, is_load, request in sources]
    return merge(*own, key=lambda sample: sample.place)


def _request(source: InputConfig) -> Request:
    return Request(source.topic, source.field_text, source.type)


def _column(name: str, is_load: int, series: Series) -> Iterator[_Sample]:
    columns = (series.log_time_ns, series.stamp_ns, series.sequence, series.value)
    for log_ns, stamp_ns, place, value in zip(*(c.tolist() for c in columns), strict=True):
        yield _Sample(log_ns, stamp_ns, place, name, is_load, value)
