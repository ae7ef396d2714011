# SPDX-License-Identifier: Apache-2.0
"""The monitor: samples and the passing of time in, verdicts and events out.

It reads no clock. Time is that of the samples; :meth:`Monitor.advance` lets time pass without any.
:meth:`Monitor.update` takes one sample, :meth:`Monitor.scan` a recording; both run the rule of :mod:`.rule`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.level_comparison import LevelComparison, compare_streams
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.rule_over_arrays import BearingScan, Scan
from stickslip_monitor.monitor.rule_settings import RuleNumbers, settings_of
from stickslip_monitor.monitor.rule_state import NEVER, State
from stickslip_monitor.monitor.sample_types import INPUTS, VALUE_FAULTS, Input, Sample, Status, Stream
from stickslip_monitor.monitor.severity import Condition, Unknown
from stickslip_monitor.monitor.statements import Event, Standing, Verdict, size_cycle
from stickslip_monitor.monitor.vibration_rule import UNKNOWN


@dataclass(frozen=True, slots=True)
class Update:
    """Result of one sample."""

    status: Status  # why it is used or not
    verdict: Verdict | None = None  # where it completed an operating point
    events: list[Event] = field(default_factory=list)  # changes of the alarm up to its time


_STATUS = tuple(Status)
_FIRST_REPEAT_NS, _REPEAT_SHARE = SECOND_NS, 8
"""A value that stands is repeated each second, and from 8 s on at each eighth of its age [ns]: a delay
runs on by an eighth of it at most, and an hour takes 57 points."""


def repeat_step(age_ns: int) -> int:
    """Return the time [ns] until a value of that age that still stands is repeated again."""
    return max(_FIRST_REPEAT_NS, age_ns // _REPEAT_SHARE)


class BearingMonitor(Standing):
    """One bearing, sample by sample: its standing now.

    Attributes:
        counts: Samples by :class:`Input` and :class:`Status`, shape (4, 7).

    Args:
        config: The bearing.
        state: Its memory from before, which goes on changing: at once its times are set back, as by
            :meth:`await_inputs`. ``None`` for a new one.
        rival_of: Takes the arrival [ns] and the number of a level that came, and returns how far the loudest
            level of another bearing is above its threshold [dB]; ``None`` where there is no other.
    """

    def __init__(
        self,
        config: BearingConfig,
        state: State | None = None,
        rival_of: Callable[[int, float], float] | None = None,
    ) -> None:
        super().__init__(config, settings_of(config), state or State())
        self._rival_of = rival_of
        # Of inputs that may stand the latest number, when it came and when it is repeated: on the memory's
        # own time [ns].
        self._held: dict[int, tuple[float, int, int]] = {}
        self.await_inputs()
        self.counts = np.zeros((len(Input), len(Status)), dtype=np.int64)

    def await_inputs(self) -> None:
        """Set the latest time, and those of all inputs, to none, so that each is waited for; the rest stays.

        The water has its configured temperature again, and no value is repeated.
        """
        self.state.now = self.state.began = NEVER
        self.state.came = [NEVER] * len(Input)
        rule.use_configured_water(self.state, self.settings.live)
        self._held.clear()

    def retune(self, config: BearingConfig) -> None:
        """Replace configuration and settings by new thresholds, delays, scales and timeouts.

        Where a scale or an offset changes, speed and load in the memory are converted, and a level is learned
        anew.
        """
        old, self.config = self.settings.live, config
        self.settings = settings_of(config)
        new = self.settings.live
        rule.use_configured_water(self.state, new)
        for place in config.places:
            if (old.scale[place], old.offset[place]) != (new.scale[place], new.offset[place]):
                self._rescale_memory(place, old)

    def _rescale_memory(self, place: int, old: RuleNumbers) -> None:
        """Convert speeds or loads in the memory from the old settings; a level is learned anew.

        Nothing is done for the water: its next value has the new scale. ``place`` is the index of the input.
        """
        state, new = self.state, self.settings.live
        if place == Input.WATER_TEMPERATURE:
            return  # the next value has the new scale
        if place == Input.LEVEL:
            # Decibels of a number that has an offset cannot be converted: learn them anew.
            state.background, state.vibrating = math.nan, UNKNOWN
            return

        def converted(si: float) -> float:
            """Return a value by the old settings as its number has it by the new ones [SI]."""
            number = (si / old.factor[place] - old.offset[place]) / old.scale[place]
            return rule.si_value(new, place, number)

        for values in (state.value, state.before, state.earlier):
            values[place] = converted(values[place])
        if place == Input.SPEED:
            state.fast, state.slow = converted(state.fast), converted(state.slow)
        else:
            state.load_mean = converted(state.load_mean)

    @property
    def now_ns(self) -> int | None:
        """The latest time, on the clock of the arrivals [ns]; ``None`` before the first."""
        return None if self.state.now == NEVER else self.state.now - self.state.shift

    def is_lost(self, place: int) -> bool:
        """Return whether an input is lost at the latest time, or has not been received yet.

        A level or temperature that is not configured is never lost. ``place`` is the index of the input.
        """
        if place == Input.LEVEL:
            return self.unknown in (Unknown.NOTHING, Unknown.LOST)
        if place == Input.WATER_TEMPERATURE:
            return bool(self.water_doubt)
        return self.state.came[place] == NEVER or INPUTS[place] in self.lost_ages()

    def discount_stall(self, held_ns: int) -> None:
        """Subtract a stall of this process [ns] from the age of speed and load, or from the wait for them."""
        state = self.state
        for place in (Input.SPEED, Input.LOAD):
            if state.came[place] != NEVER:
                state.came[place] += held_ns
        if state.began != NEVER:
            state.began += held_ns

    def follow_step(self, step_ns: int) -> None:
        """Follow a step of the arrivals' clock [ns], negative back; the memory's own time goes on."""
        self.state.shift -= step_ns

    def update(self, place: int, time_ns: int, number: float, arrival_ns: int | None = None) -> Update:
        """Take one sample of an :class:`Input` and count it in ``counts``.

        A valid value of a source that sends changes only is kept for :meth:`take_repeats`; an invalid one
        ends that.

        Args:
            place: Index of the input.
            time_ns: Time stamp of the measurement [ns].
            number: The number in the message.
            arrival_ns: When it came [ns]; ``None``: at the time of its stamp.

        Returns:
            Its status; the verdict if it made an operating point; and the events up to its time.

        Raises:
            ConfigurationError: The input is not configured.
        """
        if place >= Input.LEVEL and place not in self.config.places:
            name = INPUTS[place]
            raise ConfigurationError(
                f"parameter '{self.config.name}.{name}.topic' is missing: no {name} is configured"
            )
        arrival_ns = time_ns if arrival_ns is None else arrival_ns
        update = self._take_sample(place, time_ns, float(number), arrival_ns)
        status = update.status
        self.counts[place, status] += 1
        if rule.has_repeats(self.settings.live, place) and not self.config.inputs[INPUTS[place]].is_assumed:
            if status.valid:
                came = arrival_ns + self.state.shift
                self._held[place] = number, came, came + repeat_step(0)
            elif status in VALUE_FAULTS:
                self._held.pop(place, None)
        return update

    def take_repeats(self, before_ns: int) -> Iterator[Update]:
        """Take once more, each at its time, the values that stand and are due, and yield the result of each.

        Only inputs whose source sends changes only are repeated, for as long as their values stand. The
        memory changes as results are drawn from the iterator, so draw all; ``counts`` stays.

        Args:
            before_ns: The time before which they are due, on the clock of arrivals [ns].
        """
        state = self.state
        while due := [
            (due_ns, place)
            for place, (_, _, due_ns) in self._held.items()
            if due_ns < before_ns + state.shift and state.stamp[place] != NEVER
        ]:
            due_ns, place = min(due)
            number, came, _ = self._held[place]
            if due_ns - came > self.settings.live.hold[place]:
                del self._held[place]
                continue
            self._held[place] = number, came, due_ns + repeat_step(due_ns - came)
            yield self._take_sample(place, state.stamp[place], number, due_ns - state.shift)

    def _take_sample(self, place: int, time_ns: int, number: float, arrival_ns: int) -> Update:
        """Run the rule on one sample, which changes the memory; first compute the cycle's amplitude if due.

        Args:
            place: Index of the input.
            time_ns: Its stamp [ns].
            number: The number in the message.
            arrival_ns: When it came [ns].

        Returns:
            Its status, and the verdict and events that it made. Level and temperature make none.
        """
        state, settings = self.state, self.settings
        c = settings.live
        if rule.is_amplitude_due(state, c):
            size_cycle(self.config, state)
        if place == Input.LEVEL and self._rival_of is not None:
            state.rival = self._rival_of(arrival_ns, number)
        before, lost, onsets = rule.condition_index(state), state.lost, state.onsets
        code, time, si = rule.receive_sample(state, c, place, time_ns, arrival_ns, number)
        status = _STATUS[code]
        stands = code == rule.REPEATED and rule.has_repeats(c, place)
        if place >= Input.LEVEL or not (status.valid or stands):
            return Update(status)
        events = []
        if state.lost > lost:
            events.append(self.event(before, state.lost_since))
            before = rule.condition_index(state)
        if stands:
            until = rule.repeat_value(state, c, settings.model, place)
        else:
            until = rule.take_value(state, c, settings.model, place, time, si)
        if until == NEVER:
            return Update(status, None, events)
        chances = state.can, state.will, state.runs
        verdict = self.judge([*state.value, state.water, *chances], self.measured)
        onset = state.onsets > onsets
        if onset or rule.condition_index(state) != before:
            events.append(self.event(before, state.now, onset=onset))
        return Update(status, verdict, events)


class Monitor:
    """All bearings of a configuration; to make one takes the time to tabulate their boundaries, once.

    Args:
        config: The validated configuration.
        states: What is remembered of bearings from before, by name, which goes on changing; ``None`` for
            nothing.

    Attributes:
        bearings: Each bearing, by name.

    >>> from stickslip_monitor.monitor.parameter_file import load_config
    >>> monitor = Monitor(load_config('launch_configs/reference_bearing.yaml'))
    >>> for second in range(20):
    ...     for quantity, value in (('load', 1000.0), ('speed', 20.0)):
    ...         update = monitor.update(Sample('aft_stern', quantity, second * 10**9, value))
    ...         for event in update.events:
    ...             print(second, event.before, '->', event.after)
    2 normal -> bistable
    3 bistable -> stick_slip
    """

    def __init__(self, config: MonitorConfig, states: Mapping[str, State] | None = None) -> None:
        self.config = config
        self._comparison = LevelComparison(config.bearings)
        saved = states or {}
        self.bearings = {
            b.name: BearingMonitor(b, saved.get(b.name), partial(self._comparison.take, b.name))
            for b in config.bearings
        }

    def _require_bearing(self, name: str) -> BearingMonitor:
        """Return the bearing of that name.

        Raises:
            ConfigurationError: It is not configured.
        """
        bearing = self.bearings.get(name)
        if bearing is None:
            self.config.bearing(name)  # says which there are
            raise AssertionError
        return bearing

    def update(self, sample: Sample) -> Update:
        """Take one sample; return its status, and the verdict and events that it made.

        Raises:
            ConfigurationError: The sample's bearing or quantity is not configured.
        """
        if sample.quantity not in INPUTS:
            raise ConfigurationError(f"quantity '{sample.quantity}' is not one of {', '.join(INPUTS)}")
        place = INPUTS.index(sample.quantity)
        bearing = self._require_bearing(sample.bearing)
        return bearing.update(place, sample.time_ns, sample.value, sample.arrival_ns)

    def advance(self, time_ns: int) -> list[Event]:
        """Let time pass for every bearing up to a time [ns]; the first call starts the wait for inputs.

        A time before the latest of a bearing changes nothing there. One far ahead of the samples leaves their
        inputs lost until these come near it.

        Returns:
            The events of inputs that are lost by then; an empty list for none.
        """
        return [event for b in self.bearings.values() for event in b.advance(time_ns)]

    def condition(self, name: str) -> Condition:
        """Return the present condition of a bearing.

        Raises:
            ConfigurationError: It is not configured.
        """
        return self._require_bearing(name).condition

    def retune(self, config: MonitorConfig) -> None:
        """Take over new thresholds, delays, scales and timeouts.

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
            self._require_bearing(new.name).retune(new)
        self._comparison.retune(config.bearings)
        self.config = config

    def scan(
        self, streams: Mapping[str, Stream], start_ns: int | None = None, end_ns: int | None = None
    ) -> dict[str, Scan]:
        """Evaluate whole recordings from a fresh start, leaving this monitor's state alone.

        Args:
            streams: The samples of each bearing, by name.
            start_ns: When the recording begins: inputs are waited for from then on [ns]; ``None`` for the
                first sample.
            end_ns: When it ends: inputs may go stale until then [ns]; ``None`` where that is unknown.

        Returns:
            The verdicts and events of each bearing.

        Raises:
            ConfigurationError: A bearing is not configured.
        """
        configs = [self._require_bearing(name).config for name in streams]
        streams = compare_streams(configs, streams)
        return {
            config.name: BearingScan(config, start_ns).finish(streams[config.name], end_ns)
            for config in configs
        }
