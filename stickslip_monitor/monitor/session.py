# SPDX-License-Identifier: Apache-2.0
"""One monitored ship: the monitor, its alarms, the faults of its inputs, and what is published.

The node, ``stickslip watch``, the dashboard's replay and ``stickslip check --mcap`` are shells around a
:class:`Session`: they differ in their clocks, in where samples come from, and in the :class:`Sink` that takes
what is to be published. A session reads no clock: every call is given a :class:`Moment`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.errors import AlarmStateError, cause
from stickslip_monitor.monitor import alarm_records
from stickslip_monitor.monitor.alarm_list import MONITOR, Action, AlarmChange, Annunciator
from stickslip_monitor.monitor.bearing_monitor import Monitor, Update
from stickslip_monitor.monitor.bearing_records import UNRELIABLE, BearingState, bearing_record
from stickslip_monitor.monitor.input_faults import Graph, InputWatch
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.rule_state import State
from stickslip_monitor.monitor.sample_types import VALUE_FAULTS
from stickslip_monitor.monitor.severity import Condition, Severity
from stickslip_monitor.monitor.statements import Event, Verdict, duration_text

LOOK_NS = SECOND_NS
"""Time between two checks of the inputs [ns]."""
HEARTBEAT_NS = 60 * SECOND_NS
"""The list of alarms is published at least this often [ns], as IEC 62923 asks of any source of them."""
MAX_NOTES = 50
"""Notes that wait for the next list of alarms; of more the latest stay."""


class Log(Protocol):
    """Log for people: a logger of :mod:`logging` or of rclpy."""

    def info(self, text: str, /) -> object:
        """Log what is as it should be."""

    def warning(self, text: str, /) -> object:
        """Log what people should look at."""

    def error(self, text: str, /) -> object:
        """Log what does not work."""


class Store(Protocol):
    """Keeps one document over a restart."""

    @property
    def path(self) -> str | Path:
        """Path of the file."""

    def read(self) -> object:
        """Read the document; ``None`` if there is none yet.

        Raises:
            AlarmStateError: It is damaged.
        """

    def write(self, document: dict[str, Any]) -> None:
        """Put a new document in the place of the old one.

        Raises:
            OSError: It cannot be written; the old one is untouched.
        """

    def set_aside(self) -> str:
        """Rename a damaged document; return where it is now, or why it is not renamed."""


class Moment(NamedTuple):
    """Now, on both clocks [ns]."""

    steady_ns: int  # it never steps: periods, delays and ages are measured on it
    time_ns: int  # of the samples; 0 while it is simulated and /clock is silent
    set_ns: int = 0  # sum of the steps by which that clock was set since it was first read


class Sink:
    """Takes what is published of bearings and alarms: by a session here, or by a monitor elsewhere.

    Topics, buses and the dashboard's page are sinks; each leaves out what it does not show. A monitor
    elsewhere sends records, alarms and its health alone.
    """

    def take_verdict(self, verdict: Verdict) -> None:
        """Take a verdict on an operating point."""

    def take_event(self, event: Event) -> None:
        """Take a change of a bearing's condition."""

    def take_alarms(self, record: dict[str, Any]) -> None:
        """Take the list of alarms; see :func:`.alarm_records.alarms_record`."""

    def take_states(self, states: list[BearingState], *, whole: bool) -> None:
        """Take the state of some bearings, or of the whole ship; by default take the record of each."""
        for state in states:
            self.take_record(bearing_record(state))

    def take_record(self, record: dict[str, Any]) -> None:
        """Take the state of a bearing as a record; see :func:`.bearing_records.bearing_record`."""

    def take_health(self, level: int, text: str) -> None:
        """Take the diagnostic status of a node itself: a :class:`.Severity` and its text."""

    def take_other(self, node: str) -> None:
        """Take the name of another monitor whose messages come."""


class Session:
    """The monitor with everything around it.

    Events, input faults, people's actions and failures to save are logged. Saved alarms are restored; those
    that cannot be read raise nothing. Samples, time, states and :meth:`end` are for the time from
    :meth:`begin` on; a bearing's name has to be one of the configuration.

    Args:
        config: The configuration, with the full names of topics.
        sink: Takes what is published.
        log: Log for people.
        clock: Gives the stamps of what people do, and of records [ns since 1970].
        store: Keeps alarms and memories over a restart; without one nothing is saved.
        graph: Knows the publishers of inputs; without one faults of inputs are not looked for.

    Attributes:
        config: The configuration.
        monitor: The bearings.
        annunciator: The alarms, which are to be changed through this object only.
        monitoring: Whether the bearings are watched: between :meth:`begin` and :meth:`end`.
        damage: Why the saved alarms are lost; empty once a person has acknowledged all alarms.
    """

    def __init__(
        self,
        config: MonitorConfig,
        sink: Sink,
        log: Log,
        clock: Callable[[], int],
        store: Store | None = None,
        graph: Graph | None = None,
    ) -> None:
        self.config, self._sink, self._log, self._graph = config, sink, log, graph
        self._clock, self._store = clock, store
        self.annunciator = Annunciator(config)
        self._begun_ns = self._listed_ns = self._sequence = 0
        self._save_fault = self.damage = ''
        self._notes: deque[dict[str, Any]] = deque(maxlen=MAX_NOTES)
        saved = {} if store is None else self._restore_alarms(store)
        self.monitor = Monitor(config, saved)
        for name in self.monitor.bearings.keys() & saved.keys():
            self.annunciator.causes[name].restore_condition(self.monitor.condition(name))
        self.monitoring = False
        self._inputs: InputWatch | None = None
        self._set_ns: int | None = None

    def _restore_alarms(self, store: Store) -> dict[str, State]:
        """Restore the saved alarms of a store into the annunciator.

        A damaged file is set aside; that is logged, noted and stored in ``damage``. A bearing's memory that
        cannot be read is logged and skipped.

        Returns:
            The saved memory of each bearing by name; empty without a file or where it is damaged.
        """
        try:
            document = store.read()
            if document is None:
                return {}
            saved = alarm_records.recall_state(self.annunciator, document, self._clock())
        except AlarmStateError as error:
            end = f'{store.set_aside()}, and the alarms start fresh'
            self.damage = f'state_file {store.path} is damaged: {error}; {end}'
            self._log.warning(self.damage)
            self.note('node', self.damage)
            return {}
        states = {}
        for name, record in saved.items():
            try:
                states[name] = State.of_record(record)
            except ValueError as error:
                self._log.warning(f'{name}: its saved memory is ignored, and it starts afresh: {error}')
        return states

    def inherit(self, old: Session) -> None:
        """Take over alarms, notes, damage and count of lists of the session before, which had other inputs.

        The alarms get this configuration; active ones are held until their bearings have been watched for
        long enough. Both sessions share them from then on.
        """
        self.annunciator, self._sequence = old.annunciator, old._sequence
        self._notes, self.damage = old._notes, old.damage
        self.annunciator.retune(self.config)
        self.annunciator.restart()

    def begin(self) -> None:
        """Start to watch the bearings: wait for every input anew, watch for faults if there is a graph.

        The list of alarms is published.
        """
        self.monitoring = True
        for bearing in self.monitor.bearings.values():
            bearing.await_inputs()
        if self._graph is not None:
            self._inputs = InputWatch(self.monitor.bearings, self._graph)
        self._looked_ns: int | None = None
        self._changed: set[str] = set()
        self._published: dict[str, int] = {}
        self._unpublished: dict[str, Verdict] = {}
        self._begun_ns, self._set_ns = self.annunciator.now_ns, None
        self._publish_alarms([])

    def end(self) -> None:
        """Stop watching: publish the alarms and every bearing as not watched, and save the alarms."""
        self.monitoring = False
        self._publish_alarms([])
        self.save()
        self.show(Moment(0, 0))

    def retune(self, config: MonitorConfig) -> None:
        """Take over new thresholds, delays, scales and timeouts of the same bearings; their states stay.

        Raises:
            ConfigurationError: The new configuration has other bearings.
        """
        self.monitor.retune(config)
        self.annunciator.retune(config)
        self.config = config

    def take(
        self, name: str, place: int, time_ns: int, value: float, now: Moment, *, latest: bool = True
    ) -> Update:
        """Take one number of one input; publish, log and save what follows from it.

        A step of the clock is followed, and values that stand and were due before it are repeated first.

        Args:
            name: Name of the bearing.
            place: Index of the input in :data:`.sample_types.INPUTS`.
            time_ns: Time stamp of the measurement [ns].
            value: The number in the message.
            now: The present moment.
            latest: No later number of this bearing waits already. A verdict that one will outdate is
                published only where the condition changes; it waits for :meth:`catch_up` otherwise.

        Returns:
            Status, verdict and events of this number, not of values that are repeated before it.

        Raises:
            ConfigurationError: It is a level or temperature, which is not configured.
        """
        self.follow_clock(now)
        # While simulated time is silent nobody knows when it came.
        arrival = now.time_ns or None
        self._repeat_values(name, time_ns if arrival is None else arrival, now)
        update = self.monitor.bearings[name].update(place, time_ns, value, arrival)
        value_fault, source = VALUE_FAULTS.get(update.status), None
        if self._inputs is not None:
            behind_ns = 0 if arrival is None else arrival - time_ns
            valid = update.status.valid
            source = self._inputs.take(name, place, value, now.steady_ns, behind_ns, valid=valid)
            if value_fault is None and source is not None:
                mixed = f'. {UNRELIABLE[:-1]}' if source.is_mixed else ''
                value_fault = f'{source.kind.sentence}{mixed}'
        changes = []
        if value_fault:
            changes += self.annunciator.take_fault(
                name, place, value_fault, time_ns, mixed=source is not None and source.is_mixed
            )
        return self._take_update(name, update, changes, now, latest=latest)

    def _take_update(
        self, name: str, update: Update, changes: list[AlarmChange], now: Moment, *, latest: bool
    ) -> Update:
        """Publish the result of a sample and the alarms that it changes.

        Args:
            name: Name of the bearing.
            update: Result of the sample.
            changes: Changes of alarms so far; those of the sample are added in place.
            now: The present moment.
            latest: As in :meth:`take`.

        Returns:
            The result, its events with the reason why an input is lost or mixed.
        """
        if update.events:
            update = replace(update, events=self._explain_events(update.events, now))
        if update.verdict is not None:
            self._unpublished[name] = update.verdict
        if latest or update.events:
            self._publish_verdict(name, now, changed=bool(update.events))
        self._publish_events(update.events)
        if update.verdict is not None:
            changes += self.annunciator.take_verdict(update.verdict)
        self._publish_changes(changes, update.events)
        return update

    def _repeat_values(self, name: str, before_ns: int, now: Moment) -> None:
        """Repeat the values of a bearing that stand and are due before a time [ns]; publish what follows."""
        for update in self.monitor.bearings[name].take_repeats(before_ns):
            self._take_update(name, update, [], now, latest=True)

    def follow_clock(self, now: Moment) -> None:
        """Follow a step of the clock: shift stamps, log and note it; delays stay as long as they are.

        The first moment after :meth:`begin` is the reference. Without a step nothing happens.
        """
        step_ns = now.set_ns - (now.set_ns if self._set_ns is None else self._set_ns)
        self._set_ns = now.set_ns
        if not step_ns:
            return
        for bearing in self.monitor.bearings.values():
            bearing.follow_step(step_ns)
        self.annunciator.shift_stamps(step_ns)
        way = 'forward' if step_ns > 0 else 'back'
        text = f'the clock was set {way} by {duration_text(abs(step_ns) * 1e-9)}: delays go on'
        self._log.warning(text)
        self.note('node', text)

    def advance(self, name: str, time_ns: int, now: Moment) -> None:
        """Let time pass for a bearing without a sample, up to a time [ns]; publish and save what follows.

        That time is on the clock of the samples, as ``now.time_ns``.
        Values that still stand and are due are repeated, and a step of the clock is followed.
        """
        self.follow_clock(now)
        self._repeat_values(name, time_ns, now)
        events = self._explain_events(self.monitor.bearings[name].advance(time_ns), now)
        self._publish_events(events)
        self._publish_changes([], events)

    def discount_stall(self, held_ns: int) -> None:
        """Leave a stall of this process [ns] out of the age of every input."""
        for bearing in self.monitor.bearings.values():
            bearing.discount_stall(held_ns)

    def catch_up(self, now: Moment) -> None:
        """Publish the verdicts that were held back, as no message waits any more."""
        for name in list(self._unpublished):
            self._publish_verdict(name, now, changed=True)

    def tick(self, now: Moment, elapsed_ns: int) -> None:
        """Let the alarms' running time pass, and once a second check the inputs.

        Publishes and saves the alarms where one changed, a note waits, or a minute has passed since the last
        list. Faults of inputs that are new or over are logged, and noted for the next list.

        Args:
            now: The present moment.
            elapsed_ns: Time since :meth:`begin`.
        """
        self.follow_clock(now)
        now_ns = self._begun_ns + elapsed_ns
        changes = self.annunciator.advance(now_ns, self._clock())
        if changes or self._notes or now_ns - self._listed_ns >= HEARTBEAT_NS:
            self._publish_alarms(changes)
            self.save()
        if self._looked_ns is not None and now.steady_ns - self._looked_ns < LOOK_NS:
            return
        self._looked_ns = now.steady_ns
        if self._inputs is None:
            return
        faults = self._inputs.check_inputs(now.steady_ns, without_clock=now.time_ns == 0)
        for bearing, fault, is_over in faults:
            text = f'{bearing}: no longer: {fault}' if is_over else f'{bearing}: {fault}'
            if is_over:
                self._log.info(text)
            else:
                self._log.warning(text)
            self.note('input', text)

    def note(self, matter: str, text: str) -> None:
        """Add a note, with the present stamp, to the next list of alarms; of more than 50 the latest stay.

        ``matter`` is lifecycle, parameter, input, node or action.
        """
        self._notes.append({'time': self._clock(), 'what': matter, 'text': text})

    def act(self, request: alarm_records.ActionRequest) -> list[AlarmChange]:
        """Carry out a person's request; where it changed an alarm note its reason, publish and save.

        To acknowledge the alarms of all bearings clears ``damage`` in any case.

        Returns:
            The changes of alarms; an empty list where there was nothing to do.

        Raises:
            ConfigurationError: The bearing is not configured.
        """
        action, by, bearing, kind = request.action, request.by, request.bearing, request.kind
        if action is Action.ACKNOWLEDGE and bearing is None:
            self.damage = ''
        changes = self.annunciator.act(action, self._clock(), by, bearing, kind)
        if changes and request.reason:
            subject = f'{bearing or "all bearings"}/{kind or "all alarms"}'
            self.note('action', f'{subject}: {action} by {by}: {request.reason}')
        self._publish_changes(changes, [])
        return changes

    def show(self, now: Moment) -> None:
        """Publish the state of every bearing; nothing is left for :meth:`flush`."""
        self._changed.clear()
        self._sink.take_states(self.states(self.monitor.bearings, now), whole=True)

    def flush(self, now: Moment) -> None:
        """Publish the state of each bearing with an event since the last time, if any; forget which."""
        if self._changed:
            states = self.states(sorted(self._changed), now)
            self._changed.clear()
            self._sink.take_states(states, whole=False)

    def states(self, names: Iterable[str], now: Moment) -> list[BearingState]:
        """Return the state of some bearings, in their order.

        Only while they are watched, and with a graph, it has their inputs and a mix of sources.
        """
        watch = self._inputs if self.monitoring else None
        return [
            BearingState(
                self.monitor.bearings[name],
                watch.states(name, now.steady_ns) if watch else {},
                self.monitoring,
                watch.mixed_text(name, now.steady_ns) if watch else '',
            )
            for name in names
        ]

    def _publish_verdict(self, name: str, now: Moment, *, changed: bool) -> None:
        """Publish the latest verdict of a bearing that waits, if any, and forget it.

        Unless ``changed`` it is dropped if ``publish_period`` has not passed since the last one.
        """
        verdict = self._unpublished.pop(name, None)
        if verdict is None:
            return
        before, period_ns = self._published.get(name), self.config.publish_period * 1e9
        if changed or before is None or not 0 <= now.steady_ns - before < period_ns:
            self._published[name] = now.steady_ns
            self._sink.take_verdict(verdict)

    def _publish_events(self, events: list[Event]) -> None:
        """Publish and log some events, and mark their bearings for :meth:`flush`."""
        for event in events:
            self._sink.take_event(event)
            self._changed.add(event.bearing)
            # The logger of ROS 2 takes one severity from one place of the source.
            if not event.raised:
                self._log.info(event.text)
            elif event.after.severity is Severity.ERROR:
                self._log.error(event.text)
            else:
                self._log.warning(event.text)

    def _publish_changes(self, changes: list[AlarmChange], events: list[Event]) -> None:
        """Apply events to the alarms; publish and save the alarms if one changed or an input came back.

        ``changes`` are those so far; those by the events are added to the list in place.
        """
        changes += [c for event in events for c in self.annunciator.take_event(event)]
        # An input that is back changes no alarm yet, but its row says when it clears.
        if changes or any(event.before is Condition.INPUT_STALE for event in events):
            self._publish_alarms(changes)
            self.save()

    def _publish_alarms(self, changes: list[AlarmChange]) -> None:
        """Publish every alarm with the changes and notes since the last list; forget the notes.

        What people and timers changed is logged; changes by the monitor itself are not.
        """
        self._listed_ns = self.annunciator.now_ns
        self._sequence += 1
        notes, self._notes = self._notes, deque(maxlen=MAX_NOTES)
        record = alarm_records.alarms_record(
            self.annunciator,
            changes,
            self._clock(),
            self._sequence,
            monitoring=self.monitoring,
            notes=notes,
            text_of=lambda name: self.monitor.bearings[name].text(),
        )
        self._sink.take_alarms(record)
        for change in changes:
            # What the monitor itself does is in the log as a warning already.
            if change.by != MONITOR:
                self._log.info(
                    f'{change.bearing}/{change.kind}: {change.what} by {change.by},'
                    f' {change.before} -> {change.after}'
                )

    def save(self) -> None:
        """Save alarms and memories, if there is a store; log a failure, once while it lasts, and go on."""
        if self._store is None:
            return
        states = {name: b.state.record() for name, b in self.monitor.bearings.items()}
        document = alarm_records.state_record(self.annunciator, self._clock(), states)
        try:
            self._store.write(document)
            self._save_fault = ''
        except OSError as error:
            if str(error) != self._save_fault:
                self._save_fault = str(error)
                self._log.error(f'the alarms are not kept: {cause(error)}')

    def _explain_events(self, events: list[Event], now: Moment) -> list[Event]:
        """Return the events, their texts with why an input is lost or from which two sources it comes.

        Without a graph they come back as they are.
        """
        if self._inputs is None:
            return events
        explained = []
        for event in events:
            if event.after is Condition.INPUT_STALE:
                why = self._inputs.explain(event.bearing, now.steady_ns, without_clock=now.time_ns == 0)
            elif why := self._inputs.mixed_text(event.bearing, now.steady_ns):
                why = f'{UNRELIABLE} {why}'
            explained.append(replace(event, text=f'{event.text} {why}'.rstrip()))
        return explained


class NoLog:
    """Log that drops everything."""

    def info(self, text: str, /) -> None:
        """Drop the text."""

    warning = error = info
