# SPDX-License-Identifier: Apache-2.0
"""The monitor: samples and the passing of time in, verdicts and events out.

It reads no clock. Time is that of the samples; :meth:`Monitor.advance` tells it that time has
passed without any. :meth:`Monitor.update` takes one sample, :meth:`Monitor.scan` a recording; both
give the same verdicts, bit for bit.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.assessment import assess
from stickslip_monitor.monitor.config import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.decision import QUIET, ConditionClassifier, Standing
from stickslip_monitor.monitor.freshness import Rhythm
from stickslip_monitor.monitor.ladder import AlarmTrack, Condition, ConditionChange, LastSample
from stickslip_monitor.monitor.lookahead import SpeedTrend
from stickslip_monitor.monitor.measured import MEASURED, UNKNOWN, LevelTracker, Measured
from stickslip_monitor.monitor.scan import Scan, scan_bearing
from stickslip_monitor.monitor.signals import (
    INPUTS,
    LEVEL,
    Sample,
    SampleValidator,
    Status,
    Stream,
    number_to_si,
)
from stickslip_monitor.monitor.trend import Trend, TrendWindow
from stickslip_monitor.monitor.verdict import Event, Verdict, describe, event_of


@dataclass(frozen=True, slots=True)
class Update:
    """What one sample brought.

    Attributes:
        status: What became of the sample.
        verdict: The verdict, where the sample completed an operating point.
        events: Changes of the alarm up to and at the sample's time.
    """

    status: Status
    verdict: Verdict | None = None
    events: list[Event] = field(default_factory=list)


class BearingMonitor:
    """One bearing: gate, pairing of speed and load, memories and alarm."""

    def __init__(self, config: BearingConfig) -> None:
        self.config = config
        self.gate = SampleValidator(config)
        self.bands = ConditionClassifier(config)
        self.level = None if config.level is None else LevelTracker(config.level)
        self.track = AlarmTrack(config)
        self.now_ns: int | None = None
        self.verdict: Verdict | None = None
        self._window = TrendWindow(config.alarm.trend_window_ns)
        self._inputs = (config.speed, config.load)
        self._values = [math.nan, math.nan]
        self._runs = 0.0
        self._heard: list[LastSample | None] = [None, None]
        self._rhythms = (Rhythm(), Rhythm())
        self._speeds = SpeedTrend()
        # Time of the last point, until when it counts, and its rhythm.
        self._last: tuple[int, int, int] | None = None
        # Builds the tables of the friction law now, not when the first sample waits for them.
        assess(config.bearing, 1.0, 1.0)

    def retune(self, config: BearingConfig) -> None:
        """Take over new thresholds, delays, scales and timeouts without losing any state."""
        self.config = config
        self._inputs = (config.speed, config.load)
        self.gate.timeouts = (config.speed.timeout_ns, config.load.timeout_ns)
        self.bands.retune(config)
        if self.level is not None and config.level is not None:
            self.level.retune(config.level)
            self.bands.level = config.level
        self.track.retune(config)
        # Points of another scale, or slots of another width.
        self._window = TrendWindow(config.alarm.trend_window_ns)
        self._heard = [
            None if heard is None else self._counting(heard.time_ns, settings)
            for heard, settings in zip(self._heard, self._inputs, strict=True)
        ]

    def _counting(self, time_ns: int, config: InputConfig) -> LastSample:
        """A sample believed: it counts for its input's timeout, and at least until now."""
        assert self.now_ns is not None
        return LastSample(time_ns, max(time_ns + config.timeout_ns, self.now_ns))

    def lost(self) -> dict[str, float]:
        """The inputs that do not count at the latest time, with their ages [s]."""
        return {} if self.now_ns is None else self.track.lost(self.now_ns, self._heard)

    def trend(self) -> Trend | None:
        """When stick-slip begins at the present rate; ``None`` if unknown."""
        if self.verdict is None or self.track.stale or self.verdict.sticking:
            return None
        return self._window.trend(self.config)

    @property
    def standing(self) -> Standing:
        """What the alarm rests on."""
        return self.verdict.standing if self.verdict else QUIET

    def text(self, trend: Trend | None = None) -> str:
        """What the alarm says now, for a person."""
        lost = self.lost() if self.track.stale else {}
        point = self.verdict.assessment if self.verdict else None
        condition = self.track.condition
        return describe(self.config, condition, point, self.standing, lost, trend=trend)

    def copy(self) -> BearingMonitor:
        """The same bearing once more: what happens to one does not happen to the other."""
        return copy.deepcopy(self, {id(self.config): self.config})

    def excuse(self, held_ns: int) -> None:
        """Whoever feeds us was held up for so long [ns]: no input is lost for that time."""
        self.track.excuse(held_ns)
        self._heard = [
            None if heard is None else LastSample(heard.time_ns, heard.until_ns + held_ns)
            for heard in self._heard
        ]

    def advance(self, time_ns: int) -> list[Event]:
        """Let time pass without a sample; a time before the latest one changes nothing."""
        if self.now_ns is not None and time_ns < self.now_ns:
            return []
        self.now_ns = time_ns
        return self._events(self.track.advance(time_ns, self._heard))

    def update(self, is_load: int, time_ns: int, value: float) -> Update:
        """Take one sample of one input (0 speed, 1 load, 2 level)."""
        if is_load == LEVEL:
            return Update(self._tracker().add(time_ns, value))
        config = self._inputs[is_load]
        si, fault = number_to_si(config, value)
        status = self.gate.admit(is_load, time_ns, fault)
        if not status.believed:
            return Update(status)
        events = self._move_to(time_ns, status is Status.CLOCK_JUMP)
        assert self.now_ns is not None
        self._heard[is_load] = self._counting(time_ns, config)
        self._values[is_load] = si
        self._rhythms[is_load].add(time_ns, self.now_ns)
        if not is_load:
            self._speeds.add(self.now_ns, si, self.config.alarm.look_ahead_ns)
        if not self._paired(self.now_ns):
            return Update(status, None, events)
        return Update(status, *self._evaluate(self.now_ns, events))

    def _tracker(self) -> LevelTracker:
        if self.level is None:
            raise ConfigurationError(
                f"parameter '{self.config.name}.level.topic' is missing: no level is configured"
            )
        return self.level

    @property
    def measured(self) -> Measured | None:
        """What the measured vibration says now; ``None`` where none is configured."""
        if self.level is None:
            return None
        return MEASURED[UNKNOWN if self.now_ns is None else self.level.at(self.now_ns)]

    def last_ns(self, place: int) -> int | None:
        """Stamp of the last sample believed of an input, a place in :data:`INPUTS` [ns]."""
        return self._tracker().last_ns if place == LEVEL else self.gate.last_ns[place]

    def counted(self, place: int) -> NDArray[np.int64]:
        """Samples of an input by :class:`Status`, shape (6,)."""
        return self._tracker().counts if place == LEVEL else self.gate.counts[place]

    def is_lost(self, place: int) -> bool:
        """Whether an input does not count at the latest time."""
        if place != LEVEL:
            return INPUTS[place] in self.lost()
        return self.now_ns is not None and self._tracker().is_lost(self.now_ns)

    def _move_to(self, time_ns: int, jumped: bool) -> list[Event]:
        """Go to the time of a believed sample; a first one before the start moves the start."""
        first = self._heard == [None, None]
        if self.now_ns is not None and (jumped or (first and time_ns < self.now_ns)):
            self.now_ns = time_ns
            self._heard = [None, None]
            if jumped and self.level is not None:
                self.level.restart()
            self._restart(time_ns)
            return []
        self.now_ns = time_ns if self.now_ns is None else max(self.now_ns, time_ns)
        return self._events(self.track.advance(self.now_ns, self._heard))

    def _restart(self, time_ns: int) -> None:
        self._window.clear()
        self._speeds.restart()
        for rhythm in self._rhythms:
            rhythm.restart()
        self._last = None
        self.bands.restart()
        self.track.restart(time_ns)

    def _paired(self, now_ns: int) -> bool:
        """Whether both inputs are young enough to make an operating point."""
        speed, load = self._heard
        if speed is None or load is None:
            return False
        timeouts = self.gate.timeouts
        return now_ns - speed.time_ns <= timeouts[0] and now_ns - load.time_ns <= timeouts[1]

    def _evaluate(self, now_ns: int, events: list[Event]) -> tuple[Verdict, list[Event]]:
        speed, load = self._values
        point = assess(self.config.bearing, speed, load, self.config.belief)
        self._runs = point.remember_runs(self._runs)
        measured = UNKNOWN if self.level is None else self.level.at(now_ns)
        future, since = self._speeds.future, self._since(now_ns)
        standing = self.bands.take(point, now_ns, future, *since, measured)
        changes = self.track.apply(standing.rung, now_ns)
        self.verdict = Verdict(self.config.name, now_ns, point, standing)
        self._window.add(now_ns, speed, load)
        return self.verdict, events + self._events(changes)

    def _since(self, now_ns: int) -> tuple[int, int]:
        """How much of the time since the last point counted, and that point's rhythm [ns]."""
        last = self._last
        speed, load = self._rhythms
        until = min(speed.until_ns, load.until_ns)
        self._last = now_ns, until, max(speed.gap_ns, load.gap_ns)
        if last is None:
            return 0, 0
        begin, until, rhythm_ns = last
        return max(0, min(now_ns, until) - begin), rhythm_ns

    def _events(self, changes: list[ConditionChange]) -> list[Event]:
        if not changes:
            return []
        point, standing = self.verdict.assessment if self.verdict else None, self.standing
        trend = None if standing.sticking else self._window.trend(self.config)
        return [event_of(self.config, change, point, standing, trend) for change in changes]


class Monitor:
    """All bearings of a configuration.

    Args:
        config: The validated configuration.
    """

    def __init__(self, config: MonitorConfig) -> None:
        self.config = config
        self.bearings = {b.name: BearingMonitor(b) for b in config.bearings}

    def _bearing(self, name: str) -> BearingMonitor:
        found = self.bearings.get(name)
        if found is None:
            self.config.bearing(name)  # says which there are
            raise AssertionError
        return found

    def update(self, sample: Sample) -> Update:
        """Take one sample.

        Raises:
            ConfigurationError: The sample's bearing or quantity is not configured.
        """
        if sample.quantity not in INPUTS:
            raise ConfigurationError(
                f"quantity '{sample.quantity}' is not one of {', '.join(INPUTS)}"
            )
        is_load = INPUTS.index(sample.quantity)
        return self._bearing(sample.bearing).update(is_load, sample.time_ns, sample.value)

    def advance(self, time_ns: int) -> list[Event]:
        """Let time pass for every bearing; the first call of all starts the waiting for inputs."""
        return [event for b in self.bearings.values() for event in b.advance(time_ns)]

    def condition(self, name: str) -> Condition:
        """What the alarm of a bearing says now."""
        return self._bearing(name).track.condition

    def retune(self, config: MonitorConfig) -> None:
        """Take over new thresholds, delays, scales and timeouts without losing any state.

        Raises:
            ConfigurationError: The new configuration has other bearings.
        """
        names = [new.name for new in config.bearings]
        if sorted(names) != sorted(self.bearings):
            raise ConfigurationError(
                f'bearings = [{", ".join(names)}] must stay [{", ".join(self.bearings)}]:'
                ' another set of bearings needs a new monitor'
            )
        for new in config.bearings:
            self._bearing(new.name).retune(new)
        self.config = config

    def scan(
        self, streams: Mapping[str, Stream], start_ns: int | None = None, end_ns: int | None = None
    ) -> dict[str, Scan]:
        """Evaluate whole recordings from a fresh start, leaving this monitor's state alone.

        Args:
            streams: The samples of each bearing, by name.
            start_ns: When the recording begins: inputs are waited for from then on [ns].
            end_ns: When it ends: inputs may go stale until then [ns].

        Returns:
            The verdicts and events of each bearing.

        Raises:
            ConfigurationError: A bearing is not configured.
        """
        return {
            name: scan_bearing(self._bearing(name).config, stream, start_ns, end_ns)
            for name, stream in streams.items()
        }
