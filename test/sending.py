# SPDX-License-Identifier: Apache-2.0
"""How tests send samples: as messages to a monitor, as one stream, or to a session of a ship.

Time is the test's own. A number may be a function of the time [s].
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial
from types import CodeType
from typing import Any, NamedTuple

import numpy as np
from shared import REFERENCE

from stickslip_monitor import Monitor, MonitorConfig, Sample, Stream, assess, build_config
from stickslip_monitor.errors import AlarmStateError
from stickslip_monitor.host import HostClock
from stickslip_monitor.monitor import rule
from stickslip_monitor.monitor.alarm_list import Action, AlarmChange
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.alarm_states import AlarmKind
from stickslip_monitor.monitor.bearing_monitor import Update
from stickslip_monitor.monitor.bearing_records import BearingState, bearing_record
from stickslip_monitor.monitor.input_faults import Graph
from stickslip_monitor.monitor.rule_settings import settings_of
from stickslip_monitor.monitor.rule_state import State
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import Moment, Session, Sink
from stickslip_monitor.monitor.severity import CONDITIONS, Condition
from stickslip_monitor.monitor.statements import Event, Standing, Verdict

SECOND = 10**9
T0 = 1_700_000_000 * SECOND
BEHIND_NS = SECOND // 2
"""Time is passed on so late [ns] that a sample delivered late keeps the time of its stamp."""
Number = float | Callable[[float], float]


class Message(NamedTuple):
    """A number on its way: when it arrives [s], of what, its stamp [s], and itself."""

    arrival: float
    place: Input
    stamp: float
    value: float


def number_at(number: Number, time: float) -> float:
    """Return a number at a time [s]."""
    return number(time) if callable(number) else number


def every(place: Input, period: float, end: float, number: Number, begin: float = 0.0) -> list[Message]:
    """Return the messages of one sender, each stamped as it is sent."""
    times = np.arange(begin, end, period).tolist()
    return [Message(t, place, t, number_at(number, t)) for t in times]


def ramps(times: Sequence[float], values: Sequence[float]) -> Callable[[float], float]:
    """Return a number that is linear between some times [s], constant before and after."""
    return lambda t: float(np.interp(t, times, values))


def stream_of(messages: Iterable[Message], start_ns: int = 0) -> Stream:
    """Messages as one stream, in the order in which they are given."""
    arrival, place, stamp, value = (np.array(c) for c in zip(*messages, strict=True))
    at = [np.rint(column * SECOND).astype(np.int64) + start_ns for column in (stamp, arrival)]
    return Stream(at[0], place.astype(np.int8), value, arrival_ns=at[1])


def feed(
    monitor: Monitor,
    time: float,
    quantity: str,
    value: float,
    bearing: str = 'aft',
    arrival: float | None = None,
) -> Update:
    """Feed one number of one input, stamped at a time [s]; it arrives then, or at another."""
    at = round(time * SECOND), value, None if arrival is None else round(arrival * SECOND)
    return monitor.update(Sample(bearing, quantity, *at))


def brief(event: Event) -> tuple[float, str, str]:
    """Return when the condition changed [s], from what, and to what."""
    return event.time_ns / SECOND, str(event.before), str(event.after)


def points(rpm: Any, load: Any, at: Any = 1.0, start_ns: int = 0) -> Stream:
    """Return operating points of shape (n,), speed before load, at some times or with a period [s]."""
    rpm = np.asarray(rpm, float)
    seconds = np.arange(rpm.size) * at if np.ndim(at) == 0 else np.asarray(at)
    time = start_ns + np.rint(seconds * SECOND).astype(np.int64)
    samples = np.stack([rpm, np.broadcast_to(np.asarray(load, float), rpm.shape)], axis=1)
    return Stream(np.repeat(time, 2), np.tile([Input.SPEED, Input.LOAD], rpm.size), samples.ravel())


def configured(
    name: str = 'aft', base: Any = None, *, is_live: bool = False, **changes: Any
) -> MonitorConfig:
    """Build the reference bearing, or another, with some parameters (a double underscore is a dot)."""
    settings = {key.replace('__', '.'): value for key, value in changes.items()}
    values = REFERENCE | (base or {}) | settings
    named = {f'{name}.{k}': v for k, v in values.items()}
    return build_config({'bearings': [name]} | named, is_live=is_live)


@cache
def _make_standing(bearing: str, condition: Condition) -> Standing:
    config, rung = configured(bearing).bearings[0], CONDITIONS.index(condition)
    below = 1 << rule.STICK_SLIP if condition is Condition.AMPLITUDE else 0
    lost = condition is Condition.INPUT_STALE
    state = State(lost=int(lost), raised=0 if lost or not rung else below | 1 << (rung - 1))
    return Standing(config, settings_of(config), state)


def change(
    time_ns: int, before: Condition, after: Condition, *, onset: bool = False, bearing: str = 'aft'
) -> Event:
    """Make a change of condition of a bearing without an operating point."""
    return Event(time_ns, before, _make_standing(bearing, after), {}, f'{bearing}: {after.sentence}', onset)


def verdict_at(time_ns: int, speed: float, bearing: str = 'aft', *, sticking: bool = False) -> Verdict:
    """Return a verdict on a speed [m/s], for whom it turns or not, and whether stick-slip is predicted."""
    judge = partial(assess, configured().bearings[0].bearing, speed, 1e3)
    return Verdict(bearing, time_ns, judge, speed, 1e3, sticking=sticking)


class Ship(Sink):
    """A session on clocks of the test's own; what it publishes, logs and keeps is held here.

    Args:
        config: The configuration.
        kept: What is in the store: text that is not JSON is a damaged file.
        display: What shows it as well.

    Attributes:
        session: The session; :meth:`boot` puts another in its place.
        steady_ns: The clock that never steps.
        ahead_ns: How far the clock on the wall is ahead of it.
        full: Why the store takes nothing; empty where it does.
    """

    path = 'state.json'

    def __init__(self, config: MonitorConfig, stored: str = 'null', display: Sink | None = None) -> None:
        self.config, self.kept, self.full, self._display = config, stored, '', display
        self.steady_ns, self.ahead_ns = 0, T0
        self.verdicts: list[Verdict] = []
        self.events: list[Event] = []
        self.published: list[dict[str, Any]] = []
        self.standing: list[BearingState] = []
        self.lines: list[str] = []
        self._severities: dict[tuple[CodeType, int], str] = {}
        self.info, self.warning, self.error = (partial(self._take_line, s) for s in ('INFO', 'WARN', 'ERROR'))
        self.boot()

    def _take_line(self, severity: str, text: str) -> None:
        """Take a line; as ROS 2's logger it raises where one place of the source changes its severity."""
        caller = sys._getframe(1)
        place = caller.f_code, caller.f_lasti
        if self._severities.setdefault(place, severity) != severity:
            raise ValueError('Logger severity cannot be changed between calls.')
        self.lines.append(text)

    def boot(self) -> None:
        """Start the session, or start it again after a kill."""
        host = HostClock(lambda: self.steady_ns, lambda: self.steady_ns + self.ahead_ns)
        self._now, clock = host.now, lambda: self.now.time_ns
        self.session = Session(self.config, self, self, clock, self, Graph())
        self._begun_ns = self.steady_ns
        self.session.begin()

    @property
    def now(self) -> Moment:
        return self._now()

    def take_verdict(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    def take_event(self, event: Event) -> None:
        self.events.append(event)

    def take_alarms(self, record: dict[str, Any]) -> None:
        self.published.append(record)
        if self._display is not None:
            self._display.take_alarms(record)

    def take_states(self, states: list[BearingState], *, whole: bool) -> None:
        self.standing = states
        if self._display is not None:
            self._display.take_states(states, whole=whole)

    def read(self) -> Any:
        try:
            return json.loads(self.kept)
        except ValueError as error:
            raise AlarmStateError('it is not JSON') from error

    def write(self, document: Any) -> None:
        if self.full:
            raise OSError(self.full)
        self.kept = json.dumps(document, allow_nan=False)

    def set_aside(self) -> str:
        self.kept = 'null'
        return f'it is now {self.path}.damaged'

    def take(self, name: str, place: int, value: float, stamp_ns: int | None = None) -> Any:
        """Give the session a number, stamped now or at another time [ns]."""
        now = self.now
        at_ns = now.time_ns if stamp_ns is None else stamp_ns
        return self.session.take(name, place, at_ns, value, now)

    def tick(self) -> None:
        """Let time pass, as a shell does ten times a second."""
        now = self.now
        for name in self.session.monitor.bearings:
            self.session.advance(name, now.time_ns - BEHIND_NS, now)
        self.session.tick(now, self.steady_ns - self._begun_ns)
        self.session.flush(now)

    def sail(self, seconds: float, rpm: Any = 60.0, load: Any = 1000.0, rate: float = 5.0) -> dict[str, Any]:
        """Sail for some seconds with samples of the first bearing (``None`` for none); return its record."""
        name = next(iter(self.session.monitor.bearings))
        for number in range(round(rate * seconds)):
            self.steady_ns += round(SECOND / rate)
            for place, value in enumerate((rpm, load)):
                sample = value(number) if callable(value) else value
                if sample is not None:
                    self.take(name, place, sample)
            self.tick()
        return self.look()

    def look(self) -> dict[str, Any]:
        """Return the record of the first bearing."""
        self.session.show(self.now)
        return bearing_record(self.standing[0])

    def does(self, action: Action, kind: AlarmKind | None = None) -> list[AlarmChange]:
        """Take an action of a person on one alarm of the first bearing, or on all."""
        name = next(iter(self.session.monitor.bearings))
        return self.session.act(ActionRequest(action, 'Ada', name if kind else None, kind))

    def states(self) -> dict[str, str]:
        """Return the states of the alarms that are not normal."""
        alarms = self.published[-1]['alarms']
        return {a['alarm']: a['state'] for a in alarms if a['state'] != 'normal'}
