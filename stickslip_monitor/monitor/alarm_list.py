# SPDX-License-Identifier: Apache-2.0
"""Keeps all alarms of all bearings, and carries out the actions of people on them.

It reads no clock. ``now_ns`` is a running time that never goes back, whatever clocks do: shelves,
silences and delays are measured on it. ``time_ns`` is the stamp that a change is given.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.monitor.alarm_causes import Causes
from stickslip_monitor.monitor.alarm_states import (
    LATCHING,
    RUNG_OF,
    AlarmKind,
    AlarmState,
    Facts,
    Priority,
    Trigger,
    next_state,
)
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.severity import WordEnum
from stickslip_monitor.monitor.statements import Event, Verdict

MONITOR, TIMER = 'monitor', 'timer'
"""Who made a change, where it was not a person."""
UNSILENCE = 'unsilence'
ON_SHOW = (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED)
WAITING = (AlarmState.UNACKNOWLEDGED, AlarmState.RETURNED)
STANDING = (*ON_SHOW, AlarmState.RETURNED)
WINDOW_NS = 600 * SECOND_NS
"""The time of a matter [ns]. A cause that comes again within it has come back; what is no worse
than what people were given within it makes no sound; floods are counted over it."""
FLOOD_ABOVE, FLOOD_ENDS_BELOW = 10, 5
"""The flood of ISA-18.2: it begins and ends with so many alarms raised in that time."""


class Action(WordEnum):
    """Actions of a person on an alarm."""

    ACKNOWLEDGE = 'acknowledge'
    SILENCE = 'silence'
    RESET = 'reset'
    SHELVE = 'shelve'
    UNSHELVE = 'unshelve'
    REMOVE = 'remove'
    RESTORE = 'restore'


class Flood:
    """Counts the alarms that are raised: in the last ten minutes, 1000 at most, and whether that is a flood.

    ``now_ns`` is a running time that never goes back [ns].

    Attributes:
        most: The most alarms in any ten minutes so far.
    """

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=1000)
        self.most = 0
        self._flooding = False

    def add(self, now_ns: int) -> None:
        """Count an alarm raised at a running time [ns]; more than ten within ten minutes begin a flood."""
        self._count_recent(now_ns)
        self._times.append(now_ns)
        self._flooding |= len(self._times) > FLOOD_ABOVE
        self.most = max(self.most, len(self._times))

    def figures(self, now_ns: int) -> dict[str, Any]:
        """Return ``alarms_10min``, ``most_10min`` and ``flooding`` at a running time [ns].

        A flood may end by it.
        """
        self._count_recent(now_ns)
        return {'alarms_10min': len(self._times), 'most_10min': self.most, 'flooding': self._flooding}

    def _count_recent(self, now_ns: int) -> None:
        """Forget alarms older than ten minutes; fewer than five end a flood."""
        while self._times and now_ns - self._times[0] >= WINDOW_NS:
            self._times.popleft()
        self._flooding &= len(self._times) >= FLOOD_ENDS_BELOW


@dataclass(slots=True)
class LiveAlarm:
    """One alarm of one bearing, as it stands; stamps are ``None`` before the first change."""

    bearing: str
    kind: AlarmKind
    state: AlarmState = AlarmState.NORMAL
    active: bool = False  # its cause is there
    occurred: bool = False  # it was so since the alarm was last normal, or reset
    silenced: bool = False
    recurring: bool = False  # silenced because it has come again, until it lasts
    is_seen: bool = False  # somebody has acknowledged it since it sounded last
    sounded_ns: int | None = None  # when it began to sound last, on the running time
    suppressed_by: tuple[str, ...] = ()  # why its cause means nothing now
    since_ns: int | None = None  # stamp of the cause's coming
    changed_ns: int | None = None  # stamp of the last change of state
    by: str = ''  # who made that change
    shelved_until_ns: int | None = None  # stamp, while shelved
    count: int = 0  # how often it was raised since the start
    text: str = ''  # the latest text of its condition
    came_back: int = 0  # how often its cause has come again since it came first
    first_ns: int | None = None  # stamp of that first time
    first_text: str = ''  # the text then
    came_ns: int | None = None  # when its cause came last, on the running time
    shelf_end_ns: int = 0  # on the running time
    silence_end_ns: int = 0  # on the running time

    @property
    def sounding(self) -> bool:
        """Whether it calls for attention aloud, as no caution does."""
        waits = self.state is AlarmState.UNACKNOWLEDGED and not self.silenced
        return waits and self.kind.priority > Priority.CAUTION

    def record_cause(self, now_ns: int, time_ns: int) -> None:
        """Record that the cause has come now, also while the alarm is active.

        Within ten minutes of the last time it counts in ``came_back``; otherwise that, the first time and its
        text start anew.

        Args:
            now_ns: The running time [ns].
            time_ns: The stamp [ns].
        """
        if self.came_ns is None or now_ns - self.came_ns > WINDOW_NS:
            self.came_back, self.first_ns, self.first_text = 0, time_ns, self.text
        else:
            self.came_back += 1
        self.came_ns = now_ns


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """Something that happened to an alarm."""

    time_ns: int
    bearing: str
    kind: AlarmKind
    what: str  # the trigger or action; 'unsilence' where a silence ran out
    before: AlarmState
    after: AlarmState
    by: str  # a person's name, 'ros service', 'monitor' or 'timer'
    text: str  # the latest text of the alarm's condition
    aloud: bool = False  # whether it begins to sound, or sounds anew

    @property
    def raised(self) -> bool:
        """Whether people are given an alarm that they were not given before, aloud or not."""
        return self.after is AlarmState.UNACKNOWLEDGED and self.before not in WAITING


class Annunciator:
    """All alarms: of each bearing by kind, worst first.

    Changes are returned in their order; ``time_ns`` is their stamp [ns].

    Attributes:
        now_ns: The latest running time [ns].
        flood: Counts the alarms that were raised.
        causes: The causes of each bearing's alarms, by its name.
        alarms: Each alarm, by bearing and kind.
    """

    def __init__(self, config: MonitorConfig) -> None:
        self.now_ns = 0
        self.flood = Flood()
        self.causes = {b.name: Causes(b) for b in config.bearings}
        self.alarms: dict[str, dict[AlarmKind, LiveAlarm]] = {b.name: {} for b in config.bearings}
        # When people were given each kind last, aloud or not, on the running time.
        self._given: dict[str, dict[AlarmKind, int]] = {name: {} for name in self.alarms}
        self.retune(config)

    def __iter__(self) -> Iterator[LiveAlarm]:
        """Yield every alarm."""
        return (alarm for alarms in self.alarms.values() for alarm in alarms.values())

    @property
    def sounding(self) -> bool:
        """Whether any alarm calls for attention aloud."""
        return any(alarm.sounding for alarm in self)

    def retune(self, config: MonitorConfig) -> None:
        """Replace the configuration of the same bearings; the alarms keep their states.

        A kind of alarm that the configuration newly allows, as vibration with a level, is added; one that it
        no longer allows stays.
        """
        self.config = config
        for bearing in config.bearings:
            self.causes[bearing.name].config = bearing
            for kind in AlarmKind:
                # That of vibration takes a level.
                if bearing.level or kind is not AlarmKind.VIBRATION:
                    self.alarms[bearing.name].setdefault(kind, LiveAlarm(bearing.name, kind))

    def restart(self) -> None:
        """Reset all causes; hold active alarms until the bearing has been watched for long enough."""
        for name, old in self.causes.items():
            active = {alarm.kind for alarm in self.alarms[name].values() if alarm.active}
            self.causes[name] = Causes(old.config, active)

    def shift_stamps(self, step_ns: int) -> None:
        """Add a step of the stamps' clock [ns] to the stamps at which shelves end; shelves last as long."""
        for alarm in self:
            if alarm.shelved_until_ns is not None:
                alarm.shelved_until_ns += step_ns

    def advance(self, now_ns: int, time_ns: int) -> list[AlarmChange]:
        """Let running time pass, update all alarms, and end the shelves and silences whose time is up.

        Args:
            now_ns: The running time [ns]; one before the latest counts as the latest.
            time_ns: The stamp of the changes [ns].

        Returns:
            The changes, in order.
        """
        self.now_ns = max(now_ns, self.now_ns)
        changes = []
        for name, causes in self.causes.items():
            causes.advance(self.now_ns)
            changes += self._update_alarms(name, time_ns)
            changes += self._expire_timers(self.alarms[name].values(), time_ns)
        return changes

    def take_event(self, event: Event) -> list[AlarmChange]:
        """Apply a change of a bearing's condition, or an onset, to its alarms; return their changes."""
        name, time_ns = event.bearing, event.time_ns
        self.causes[name].take_event(event, self.now_ns)
        changes = self._update_alarms(name, time_ns)
        return changes + (self._note_recurrence(name, changes, time_ns) if event.onset else [])

    def _note_recurrence(self, name: str, changes: list[AlarmChange], time_ns: int) -> list[AlarmChange]:
        """Count a new onset under an active alarm of stick-slip, and sound again after ten minutes.

        Nothing happens where ``changes``, those of the same event, raise that alarm already. An alarm that is
        shelved, or out of service, makes no sound; the other alarm of stick-slip sounds in its place.

        Returns:
            The changes that make the alarm sound again; empty where it does not.
        """
        active = [alarm for alarm in self._sticking_alarms(name) if alarm.active]
        active.sort(key=lambda alarm: alarm.state not in ON_SHOW)
        if not active or active[0].kind in {change.kind for change in changes}:
            return []
        worst = active[0]
        worst.record_cause(self.now_ns, time_ns)
        if self._has_sounded(worst):
            return []
        if worst.recurring and not worst.suppressed_by:
            return [self._end_silence(worst, time_ns)]
        return self._fire_trigger(worst, Trigger.RECUR, time_ns, MONITOR)

    def _sticking_alarms(self, name: str) -> list[LiveAlarm]:
        """Return a bearing's amplitude limit and stick-slip alarms, the worse one first."""
        return [self.alarms[name][kind] for kind in LATCHING]

    def take_fault(
        self, bearing: str, place: int, fault: str, time_ns: int, *, mixed: bool = False
    ) -> list[AlarmChange]:
        """Take a refused sample of one input, or a sample of an input whose values come from two sources.

        Args:
            bearing: Name of the bearing.
            place: Index of the input in :data:`.sample_types.INPUTS`.
            fault: What is wrong, as a clause.
            time_ns: Stamp of the sample [ns].
            mixed: Whether two sources are mixed: then the alarms of the ladder that are active are held.

        Returns:
            How the alarms changed; an empty list where none did.
        """
        causes = self.causes[bearing]
        causes.take_fault(place, fault, self.now_ns)
        if mixed:
            alarms = self.alarms[bearing]
            causes.recall({kind for kind in RUNG_OF if alarms[kind].active}, self.now_ns)
        return self._update_alarms(bearing, time_ns)

    def take_verdict(self, verdict: Verdict) -> list[AlarmChange]:
        """Take the verdict on an operating point, and sound again where stick-slip has lasted long enough.

        Returns:
            How the alarms changed; an empty list where none did.
        """
        name, causes = verdict.bearing, self.causes[verdict.bearing]
        resting, changes = verdict.speed == 0.0, list[AlarmChange]()
        if causes.take_point(self.now_ns, resting=resting, sticking=verdict.sticking):
            changes = self._update_alarms(name, verdict.time_ns)
        return changes + (self._call_again(name, verdict.time_ns) if causes.is_lasting else [])

    def _call_again(self, name: str, time_ns: int) -> list[AlarmChange]:
        """Sound a bearing's alarms of stick-slip that are silent: acknowledged, or because they came back.

        Returns:
            Their changes; an empty list where none of them is silent.
        """
        alarms = self._sticking_alarms(name)
        worst = next((alarm for alarm in alarms if alarm.state in ON_SHOW), None)
        changes = []
        if worst is not None and worst.state is AlarmState.ACKNOWLEDGED:
            changes = self._fire_trigger(worst, Trigger.RECUR, time_ns, MONITOR)
        return changes + [self._end_silence(alarm, time_ns) for alarm in alarms if alarm.recurring]

    def act(
        self, action: Action, time_ns: int, by: str, bearing: str | None = None, kind: AlarmKind | None = None
    ) -> list[AlarmChange]:
        """Carry out a person's request: change the state, silence or shelf of some alarms.

        To shelve without a kind is to shelve what stands now, so that whatever comes later is still given. To
        acknowledge or silence a kind includes the milder alarms that it covers.

        Args:
            action: What to do.
            time_ns: Stamp of the changes [ns].
            by: Name of the person.
            bearing: Name of a bearing; ``None`` for all.
            kind: Kind of alarm; ``None`` for all.

        Returns:
            The changes; an empty list where there was nothing to do.

        Raises:
            ConfigurationError: There is no such bearing.
        """
        names = self.alarms if bearing is None else [self.config.bearing(bearing).name]
        chosen = [a for name in names for a in self._choose_alarms(self.alarms[name], action, kind)]
        if action is Action.SILENCE:
            return [self._silence_alarm(alarm, time_ns, by) for alarm in chosen if alarm.sounding]
        trigger = Trigger(action.value)
        return [c for alarm in chosen for c in self._fire_trigger(alarm, trigger, time_ns, by)]

    def _choose_alarms(
        self, alarms: dict[AlarmKind, LiveAlarm], action: Action, kind: AlarmKind | None
    ) -> list[LiveAlarm]:
        """Return the alarms of one bearing that an action is about, whatever their state.

        To acknowledge or silence one kind includes the milder alarms that it covers. Without a kind these are
        all alarms, or, to shelve, those that stand.
        """
        if kind is not None:
            below = action in (Action.ACKNOWLEDGE, Action.SILENCE)
            # One matter: who knows of the worst knows of what it covers.
            return [a for a in alarms.values() if a.kind is kind or (below and self.covering_kind(a) is kind)]
        return [a for a in alarms.values() if action is not Action.SHELVE or a.state in STANDING]

    def _silence_alarm(self, alarm: LiveAlarm, time_ns: int, by: str) -> AlarmChange:
        """Silence an alarm for the configured time, and return that change; its state stays.

        One that was silent because it came back counts as silenced by a person from now on.
        """
        alarm.silenced, alarm.recurring = True, False
        alarm.silence_end_ns = self.now_ns + self.config.silence_time_ns
        return _make_change(alarm, time_ns, Action.SILENCE.value, alarm.state, by)

    def _expire_timers(self, alarms: Iterable[LiveAlarm], time_ns: int) -> list[AlarmChange]:
        """Unshelve and unsilence those of some alarms whose time is up; return the changes, in order.

        The running time ``now_ns`` decides; ``time_ns`` only stamps the changes.
        """
        changes = []
        for alarm in alarms:
            if alarm.state is AlarmState.SHELVED and self.now_ns >= alarm.shelf_end_ns:
                changes += self._fire_trigger(alarm, Trigger.UNSHELVE, time_ns, TIMER)
            if alarm.silenced and self.now_ns >= alarm.silence_end_ns:
                changes.append(self._end_silence(alarm, time_ns))
        return changes

    def _end_silence(self, alarm: LiveAlarm, time_ns: int) -> AlarmChange:
        """End the silence of an alarm; return that change, aloud where one that came back begins to sound."""
        recurring, ringing = alarm.recurring, self._is_ringing(alarm.bearing)
        alarm.silenced = alarm.recurring = False
        if alarm.sounding:
            alarm.sounded_ns, alarm.is_seen = self.now_ns, False
        change = _make_change(alarm, time_ns, UNSILENCE, alarm.state, TIMER)
        return replace(change, aloud=recurring and alarm.sounding and not ringing)

    def _is_ringing(self, name: str) -> bool:
        """Return whether any alarm of a bearing sounds."""
        return any(alarm.sounding for alarm in self.alarms[name].values())

    def _update_alarms(self, name: str, time_ns: int) -> list[AlarmChange]:
        """Raise, clear, suppress and cover the alarms of a bearing as its causes say; return the changes.

        Takes over their texts, and acknowledges those that a worse one covers. Time is counted by
        the running time ``now_ns``; ``time_ns`` only stamps the alarms and the changes.
        """
        causes, changes = self.causes[name], []
        for alarm in self.alarms[name].values():
            active = causes.is_present(alarm.kind)
            reasons = tuple(causes.suppression_reasons(alarm.kind, self.now_ns))
            alarm.text = causes.texts.get(alarm.kind, alarm.text)
            triggers = []
            if bool(reasons) != bool(alarm.suppressed_by):
                triggers.append(Trigger.SUPPRESS if reasons else Trigger.UNSUPPRESS)
            if active != alarm.active:
                triggers.append(Trigger.RAISE if active else Trigger.CLEAR)
                if active:
                    alarm.since_ns = time_ns
                    alarm.record_cause(self.now_ns, time_ns)
            if alarm.active and not active and alarm.state in ON_SHOW:
                self._given[name][alarm.kind] = self.now_ns
            alarm.active, alarm.suppressed_by = active, reasons
            for trigger in triggers:
                changes += self._fire_trigger(alarm, trigger, time_ns, MONITOR)
        for alarm in self.alarms[name].values():
            # One matter: who is given the worst need not acknowledge what it covers.
            if alarm.state is AlarmState.UNACKNOWLEDGED and self.covering_kind(alarm) is not None:
                changes += self._fire_trigger(alarm, Trigger.ACKNOWLEDGE, time_ns, MONITOR)
        return changes

    def covering_kind(self, alarm: LiveAlarm) -> AlarmKind | None:
        """Return the kind of the worst alarm that stands for a milder active one of its ladder, or None."""
        if not alarm.active or alarm.kind not in RUNG_OF:
            return None
        for kind, alarm_beside in self.alarms[alarm.bearing].items():  # worst first
            if kind is alarm.kind:
                return None
            if alarm_beside.active and alarm_beside.state in ON_SHOW:
                return kind
        return None

    def _is_acknowledged(self, alarm: LiveAlarm) -> bool:
        """Return whether a person has acknowledged this alarm, or a worse one, in the same manoeuvre.

        Only of stick-slip and the amplitude limit, and within ten minutes of their last sound.
        """
        is_known = alarm.kind in LATCHING and self.causes[alarm.bearing].is_acknowledged_before(self.now_ns)
        if not is_known or not self._has_sounded(alarm):
            return False
        alarms = self.alarms[alarm.bearing]
        return any(alarms[kind].is_seen for kind in _kinds_no_milder(alarm.kind))

    def is_latching(self, alarm: LiveAlarm) -> bool:
        """Return whether an alarm stays until it is reset: one of stick-slip, where that is configured."""
        return alarm.kind in LATCHING and self.causes[alarm.bearing].config.alarm.latch

    def _fire_trigger(self, alarm: LiveAlarm, trigger: Trigger, time_ns: int, by: str) -> list[AlarmChange]:
        """Change the state of an alarm by a trigger, with its silence, shelf, count, sound and the flood.

        That a person acknowledges stick-slip is recorded in its causes, too.

        Args:
            alarm: The alarm, which changes.
            trigger: What happened.
            time_ns: Stamp of the change [ns].
            by: Name of the person, :data:`.MONITOR` or :data:`.TIMER`.

        Returns:
            The change as a list of one; an empty list where the state stays.
        """
        # What a person put away is given anew when it is back, however well it was known before.
        is_back = trigger in (Trigger.UNSHELVE, Trigger.RESTORE)
        facts = Facts(
            suppressed=bool(alarm.suppressed_by),
            covered=self.covering_kind(alarm) is not None or (self._is_acknowledged(alarm) and not is_back),
            active=alarm.active,
            latching=alarm.occurred and self.is_latching(alarm),
        )
        before, after = alarm.state, next_state(alarm.state, trigger, facts)
        if alarm.suppressed_by:
            # Suppression goes on acting for as long as its reason holds.
            after = next_state(after, Trigger.SUPPRESS, facts)
        alarm.state = after
        if after in ON_SHOW or (after is AlarmState.SHELVED and alarm.active):
            alarm.occurred = True
        elif after in (AlarmState.NORMAL, AlarmState.SUPPRESSED, AlarmState.OUT_OF_SERVICE):
            alarm.occurred = False
        if after is before:
            return []
        alarm.changed_ns, alarm.by, alarm.shelved_until_ns = time_ns, by, None
        if trigger is Trigger.ACKNOWLEDGE and by != MONITOR:
            alarm.is_seen = True
            if alarm.kind in LATCHING:
                self.causes[alarm.bearing].acknowledge(is_active=alarm.active)
        # An alarm that flickers keeps its silence.
        alarm.silenced = alarm.silenced and after in WAITING
        alarm.recurring = alarm.recurring and alarm.silenced
        if after is AlarmState.SHELVED:
            alarm.shelf_end_ns = self.now_ns + self.config.shelve_time_ns
            alarm.shelved_until_ns = time_ns + self.config.shelve_time_ns
        change = _make_change(alarm, time_ns, trigger.value, before, by)
        if change.raised:
            alarm.count += 1
            self.flood.add(self.now_ns)
        return [self._give_to_people(alarm, change) if after is AlarmState.UNACKNOWLEDGED else change]

    def _give_to_people(self, alarm: LiveAlarm, change: AlarmChange) -> AlarmChange:
        """Give an unacknowledged alarm to people, silent for ten minutes if one no milder was given lately.

        The alarms of the ladder count together, and ten minutes are lately. Alarms that latch, stick-slip and
        the amplitude limit, are silenced only where one sounded lately, and marked as ``recurring`` then. A
        caution never sounds. When the alarm was given, and sounded, is stored.

        Returns:
            ``change``, with ``aloud`` set where the alarm sounds and no other of its bearing did already.
        """
        given, alarms = self._given[alarm.bearing], self.alarms[alarm.bearing]
        ringing = any(alarm_beside.sounding for alarm_beside in alarms.values() if alarm_beside is not alarm)
        if alarm.kind in LATCHING:
            has_sounded = self._has_sounded(alarm)
            # What was silent because it came back is not so for longer than the last sound counts.
            alarm.silenced &= has_sounded or not alarm.recurring
            alarm.recurring = has_sounded
        else:
            since_ns = self.now_ns - WINDOW_NS
            has_sounded = any(given.get(kind, since_ns) > since_ns for kind in _kinds_no_milder(alarm.kind))
        given[alarm.kind] = self.now_ns
        if has_sounded and alarm.sounding:
            alarm.silenced, alarm.silence_end_ns = True, self.now_ns + WINDOW_NS
        if alarm.sounding:
            alarm.sounded_ns, alarm.is_seen = self.now_ns, False
        return replace(change, aloud=alarm.sounding and not ringing)

    def _has_sounded(self, alarm: LiveAlarm) -> bool:
        """Return whether an alarm, or a worse one of its ladder, has sounded within ten minutes."""
        alarms, since_ns = self.alarms[alarm.bearing], self.now_ns - WINDOW_NS
        times = (alarms[kind].sounded_ns for kind in _kinds_no_milder(alarm.kind))
        return any(time is not None and time > since_ns for time in times)


def _kinds_no_milder(kind: AlarmKind) -> list[AlarmKind]:
    """Return the kinds of one matter that are as bad as a kind or worse, itself included, worst first."""
    rung = RUNG_OF.get(kind)
    return [kind] if rung is None else [k for k in RUNG_OF if RUNG_OF[k] >= rung]


def _make_change(alarm: LiveAlarm, time_ns: int, cause: str, before: AlarmState, by: str) -> AlarmChange:
    """Return the change to the state that an alarm has now; it is silent."""
    return AlarmChange(time_ns, alarm.bearing, alarm.kind, cause, before, alarm.state, by, alarm.text)
