# SPDX-License-Identifier: Apache-2.0
"""All alarms of all bearings, and what people do with them.

It reads no clock. ``now_ns`` is a running time that never goes back, whatever clocks do: shelves,
silences and delays are measured on it. ``time_ns`` is the stamp that a change is given.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum

from stickslip_monitor.monitor.alarms.causes import LATCHING, RUNG_OF, AlarmKind, Causes, kinds_of
from stickslip_monitor.monitor.alarms.flood import WINDOW_NS, Flood, FloodFigures
from stickslip_monitor.monitor.alarms.lifecycle import AlarmState, Facts, Trigger, follow
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.signals import Status
from stickslip_monitor.monitor.verdict import Event, Verdict

MONITOR, TIMER = 'monitor', 'timer'
"""Who did it, where it was not a person."""
UNSILENCE = 'unsilence'
ON_SHOW = (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED)
WAITING = (AlarmState.UNACKNOWLEDGED, AlarmState.RETURNED)
STANDING = (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED, AlarmState.RETURNED)
MOST_GIVEN = 6
"""So many alarms of a bearing are given in ten minutes; further ones wait without a sound."""
BACK_NS = WINDOW_NS
"""What comes again within such a time has come back [ns]; later it is a new matter."""
_TRIGGERS = {trigger.value: trigger for trigger in Trigger}


class Action(str, Enum):
    """What a person can do; ``suppress`` says that the shaft is locked."""

    ACKNOWLEDGE = 'acknowledge'
    SILENCE = 'silence'
    RESET = 'reset'
    SHELVE = 'shelve'
    UNSHELVE = 'unshelve'
    SUPPRESS = 'suppress'
    UNSUPPRESS = 'unsuppress'
    REMOVE = 'remove'
    RESTORE = 'restore'

    def __str__(self) -> str:
        return self.value


@dataclass(slots=True)
class LiveAlarm:
    """One alarm of one bearing, as it stands.

    Attributes:
        bearing: Name of the bearing.
        kind: What it is about.
        state: Where it is in its life.
        active: Whether its cause is there.
        occurred: Whether that has been so since the alarm was last normal, or reset.
        silenced: Whether its sound is off; a flag beside the state.
        suppressed_by: Why its cause means nothing now; empty where it counts.
        since_ns: Stamp of the cause's coming [ns]; ``None`` before the first.
        changed_ns: Stamp of the last change of state [ns].
        by: Who made that change.
        shelved_until_ns: Stamp at which the shelf ends [ns], while shelved.
        count: How often it was given to people since the start.
        text: What was last said of its cause.
        came_back: How often its cause has come again since it came first.
        first_ns, first_text: Stamp of that first time [ns], and what was said then.
        came_ns: When its cause came last, on the running time [ns].
        shelf_end_ns, silence_end_ns: When these end, on the running time [ns].
    """

    bearing: str
    kind: AlarmKind
    state: AlarmState = AlarmState.NORMAL
    active: bool = False
    occurred: bool = False
    silenced: bool = False
    suppressed_by: tuple[str, ...] = ()
    since_ns: int | None = None
    changed_ns: int | None = None
    by: str = ''
    shelved_until_ns: int | None = None
    count: int = 0
    text: str = ''
    came_back: int = 0
    first_ns: int | None = None
    first_text: str = ''
    came_ns: int | None = None
    shelf_end_ns: int = 0
    silence_end_ns: int = 0

    @property
    def sounding(self) -> bool:
        """Whether it calls for attention aloud."""
        return self.state is AlarmState.UNACKNOWLEDGED and not self.silenced

    def come(self, now_ns: int, time_ns: int) -> None:
        """Its cause has come: again, unless the last time is long ago."""
        if self.came_ns is None or now_ns - self.came_ns > BACK_NS:
            self.came_back, self.first_ns, self.first_text = 0, time_ns, self.text
        else:
            self.came_back += 1
        self.came_ns = now_ns


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """Something that happened to an alarm.

    Attributes:
        time_ns: When [ns].
        bearing: Name of the bearing.
        kind: Which alarm.
        what: The :class:`Trigger` or :class:`Action`; ``unsilence`` where a silence ran out.
        before: The state before.
        after: The state from then on.
        by: Who did it: a person's name, ``ros service``, ``monitor`` or ``timer``.
        text: What was last said of the alarm's cause.
        quiet: Whether it is given without a sound, because too many were given lately.
    """

    time_ns: int
    bearing: str
    kind: AlarmKind
    what: str
    before: AlarmState
    after: AlarmState
    by: str
    text: str
    quiet: bool = False

    @property
    def raised(self) -> bool:
        """Whether people are given an alarm that they were not given before."""
        given = self.after is AlarmState.UNACKNOWLEDGED and self.before not in WAITING
        return given and not self.quiet


class Annunciator:
    """The alarms of a configuration.

    Args:
        config: The validated configuration.

    Attributes:
        alarms: Of each bearing its alarms by kind, worst first.
    """

    def __init__(self, config: MonitorConfig) -> None:
        self.config = config
        self.now_ns = 0
        self.causes = {b.name: Causes(b) for b in config.bearings}
        self.alarms = {
            b.name: {kind: LiveAlarm(b.name, kind) for kind in kinds_of(b)}
            for b in config.bearings
        }
        self._flood = Flood()
        self._given: dict[str, deque[int]] = {
            b.name: deque(maxlen=MOST_GIVEN) for b in config.bearings
        }

    def __iter__(self) -> Iterator[LiveAlarm]:
        """Every alarm."""
        return (alarm for own in self.alarms.values() for alarm in own.values())

    @property
    def sounding(self) -> bool:
        """Whether any alarm calls for attention aloud."""
        return any(alarm.sounding for alarm in self)

    @property
    def flood(self) -> FloodFigures:
        """How many alarms people were given lately."""
        return self._flood.figures(self.now_ns)

    def retune(self, config: MonitorConfig) -> None:
        """Take over new delays, limits and times; no state is lost."""
        self.config = config
        for bearing in config.bearings:
            self.causes[bearing.name].config = bearing
            for kind in kinds_of(bearing):
                self.alarms[bearing.name].setdefault(kind, LiveAlarm(bearing.name, kind))

    def restart(self) -> None:
        """The monitor starts afresh: what it knew is believed until it knows again."""
        for name, old in self.causes.items():
            own = self.alarms[name].values()
            self.causes[name] = Causes(old.config, {alarm.kind for alarm in own if alarm.active})
            self.causes[name].shaft_locked = old.shaft_locked

    def advance(self, now_ns: int, time_ns: int) -> list[AlarmChange]:
        """Let running time pass; a time before the latest one counts as the latest."""
        self.now_ns = max(now_ns, self.now_ns)
        changes = []
        for name, causes in self.causes.items():
            causes.advance(self.now_ns)
            changes += self._sync(name, time_ns)
            changes += self._run_out(self.alarms[name].values(), time_ns)
        return changes

    def take_event(self, event: Event) -> list[AlarmChange]:
        """The condition of a bearing has changed."""
        name, time_ns = event.bearing, event.time_ns
        self.causes[name].take_event(event, self.now_ns)
        changes = self._sync(name, time_ns)
        standing = (
            alarm
            for alarm in self.alarms[name].values()
            if alarm.kind in RUNG_OF and alarm.active and alarm.state in ON_SHOW
        )
        worst = next(standing, None)
        if event.onset and worst is not None and worst.kind not in {c.kind for c in changes}:
            worst.come(self.now_ns, time_ns)
            changes += self._fire(worst, Trigger.RECUR, time_ns, MONITOR)
        return changes

    def take_fault(
        self, bearing: str, place: int, status: Status, time_ns: int
    ) -> list[AlarmChange]:
        """A sample of one input  was refused for its value."""
        self.causes[bearing].take_fault(place, status, self.now_ns)
        return self._sync(bearing, time_ns)

    def take_verdict(self, verdict: Verdict) -> list[AlarmChange]:
        """An operating point was measured."""
        if self.causes[verdict.bearing].take_point(verdict.speed == 0.0, self.now_ns):
            return self._sync(verdict.bearing, verdict.time_ns)
        return []

    def act(
        self,
        action: Action,
        time_ns: int,
        by: str,
        bearing: str | None = None,
        kind: AlarmKind | None = None,
    ) -> list[AlarmChange]:
        """Do what a person asks for.

        Args:
            action: What. To shelve without a kind is to shelve what stands now, so that whatever
                comes later is still given.
            time_ns: When [ns].
            by: Who.
            bearing: The bearing; all of them without.
            kind: The alarm; all of them without. The shaft is locked for all.

        Returns:
            What came of it; empty where there was nothing to do.

        Raises:
            ConfigurationError: There is no such bearing.
        """
        if bearing is not None:
            self.config.bearing(bearing)
        names = self.alarms if bearing is None else [bearing]
        if action in (Action.SUPPRESS, Action.UNSUPPRESS):
            return [c for n in names for c in self._lock(action, n, time_ns, by)]
        chosen = [
            alarm for name in names for alarm in self._chosen(self.alarms[name], action, kind)
        ]
        if action is Action.SILENCE:
            return [self._silence(alarm, time_ns, by) for alarm in chosen if alarm.sounding]
        trigger = _TRIGGERS[action.value]
        return [c for alarm in chosen for c in self._fire(alarm, trigger, time_ns, by)]

    def _chosen(
        self, own: dict[AlarmKind, LiveAlarm], action: Action, kind: AlarmKind | None
    ) -> list[LiveAlarm]:
        if kind is not None:
            below = action in (Action.ACKNOWLEDGE, Action.SILENCE)
            chosen = [own[kind]] if kind in own else []
            # One matter: who knows of the worst knows of what it covers.
            return chosen + [a for a in own.values() if below and self.covering(a) is kind]
        if action is Action.SHELVE:
            return [alarm for alarm in own.values() if alarm.state in STANDING]
        return list(own.values())

    def _lock(self, action: Action, name: str, time_ns: int, by: str) -> list[AlarmChange]:
        locked = action is Action.SUPPRESS
        if self.causes[name].shaft_locked == locked:
            return []
        self.causes[name].shaft_locked = locked
        changes = self._sync(name, time_ns, by)
        # An alarm that waits for somebody stays as it is; that it was asked is told all the same.
        told = {change.kind for change in changes}
        return changes + [
            _change(alarm, time_ns, action.value, alarm.state, by)
            for alarm in self.alarms[name].values()
            if alarm.kind not in told
        ]

    def _silence(self, alarm: LiveAlarm, time_ns: int, by: str) -> AlarmChange:
        alarm.silenced = True
        alarm.silence_end_ns = self.now_ns + self.config.silence_time_ns
        return _change(alarm, time_ns, Action.SILENCE.value, alarm.state, by)

    def _run_out(self, alarms: Iterable[LiveAlarm], time_ns: int) -> list[AlarmChange]:
        changes = []
        for alarm in alarms:
            if alarm.state is AlarmState.SHELVED and self.now_ns >= alarm.shelf_end_ns:
                changes += self._fire(alarm, Trigger.UNSHELVE, time_ns, TIMER)
            if alarm.silenced and self.now_ns >= alarm.silence_end_ns:
                alarm.silenced = False
                changes.append(_change(alarm, time_ns, UNSILENCE, alarm.state, TIMER))
        return changes

    def _sync(self, name: str, time_ns: int, by: str = MONITOR) -> list[AlarmChange]:
        """Bring the alarms of a bearing up to their causes, worst first."""
        causes, changes = self.causes[name], []
        for alarm in self.alarms[name].values():
            active = causes.holds(alarm.kind)
            reasons = tuple(causes.suppression(alarm.kind, self.now_ns))
            alarm.text = causes.texts.get(alarm.kind, alarm.text)
            triggers = []
            if bool(reasons) != bool(alarm.suppressed_by):
                triggers.append(Trigger.SUPPRESS if reasons else Trigger.UNSUPPRESS)
            if active != alarm.active:
                triggers.append(Trigger.RAISE if active else Trigger.CLEAR)
                alarm.since_ns = time_ns if active else alarm.since_ns
                if active:
                    alarm.come(self.now_ns, time_ns)
            alarm.active, alarm.suppressed_by = active, reasons
            for trigger in triggers:
                changes += self._fire(alarm, trigger, time_ns, by)
        return changes

    def _facts(self, alarm: LiveAlarm) -> Facts:
        return Facts(
            suppressed=bool(alarm.suppressed_by),
            covered=self.covering(alarm) is not None,
            active=alarm.active,
            held=alarm.occurred and self.latching(alarm),
        )

    def covering(self, alarm: LiveAlarm) -> AlarmKind | None:
        """The worse alarm of the ladder that stands for one, if there is any."""
        worse = (
            other.kind
            for other in self.alarms[alarm.bearing].values()
            if RUNG_OF.get(other.kind, 0) > RUNG_OF.get(alarm.kind, len(AlarmKind))
            and other.active
            and other.state in ON_SHOW
        )
        return next(worse, None) if alarm.active else None

    def latching(self, alarm: LiveAlarm) -> bool:
        """Whether an alarm stays until it is reset."""
        return alarm.kind in LATCHING and self.causes[alarm.bearing].config.alarm.latch

    def _fire(
        self, alarm: LiveAlarm, trigger: Trigger, time_ns: int, by: str
    ) -> list[AlarmChange]:
        before = alarm.state
        after = follow(before, trigger, self._facts(alarm))
        if alarm.suppressed_by:
            # Suppression goes on acting for as long as its reason holds.
            after = follow(after, Trigger.SUPPRESS, self._facts(alarm))
        alarm.state = after
        _remember(alarm)
        if after is before:
            return []
        alarm.changed_ns, alarm.by, alarm.shelved_until_ns = time_ns, by, None
        # An alarm that flickers keeps its silence.
        alarm.silenced = alarm.silenced and after in WAITING
        if after is AlarmState.SHELVED:
            alarm.shelf_end_ns = self.now_ns + self.config.shelve_time_ns
            alarm.shelved_until_ns = time_ns + self.config.shelve_time_ns
        change = _change(alarm, time_ns, trigger.value, before, by)
        if change.raised:
            alarm.count += 1
            change = self._give(alarm, change)
        return [change]

    def _give(self, alarm: LiveAlarm, change: AlarmChange) -> AlarmChange:
        """Give an alarm to people: aloud, unless too many were given lately."""
        given = self._given[alarm.bearing]
        if len(given) == MOST_GIVEN and self.now_ns - given[0] < WINDOW_NS:
            alarm.silenced, alarm.silence_end_ns = True, given[0] + WINDOW_NS
            return replace(change, quiet=True)
        given.append(self.now_ns)
        self._flood.add(self.now_ns)
        return change


def _remember(alarm: LiveAlarm) -> None:
    if alarm.state in ON_SHOW or (alarm.state is AlarmState.SHELVED and alarm.active):
        alarm.occurred = True
    elif alarm.state in (AlarmState.NORMAL, AlarmState.SUPPRESSED, AlarmState.OUT_OF_SERVICE):
        alarm.occurred = False


def _change(alarm: LiveAlarm, time_ns: int, what: str, before: AlarmState, by: str) -> AlarmChange:
    return AlarmChange(
        time_ns, alarm.bearing, alarm.kind, what, before, alarm.state, by, alarm.text
    )
