# SPDX-License-Identifier: Apache-2.0
"""The one feed of the alarm machine: live in the node, beside a ship's buses, and in a replay.

Clock, log, store and publisher are passed in, so that it knows neither ROS nor a file system.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from stickslip_monitor.errors import AlarmStateError, cause
from stickslip_monitor.monitor.alarms.alarm_records import (
    Note,
    alarms_record,
    recall_state,
    state_record,
)
from stickslip_monitor.monitor.alarms.annunciator import MONITOR, Action, AlarmChange, Annunciator
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.monitor import Update
from stickslip_monitor.monitor.signals import Status
from stickslip_monitor.monitor.verdict import Event

HEARTBEAT_NS = 60 * 10**9
"""The list is published at least this often, as IEC 62923 asks of any source of alerts."""
NOTES_KEPT = 50
"""The latest of more notes than this are published with the next list."""
_FAULTS = (Status.NOT_FINITE, Status.IMPLAUSIBLE)


class Log(Protocol):
    """Where people read what happened; a logger of :mod:`logging` or of rclpy."""

    def info(self, text: str, /) -> object:
        """Something that is as it should be."""

    def warning(self, text: str, /) -> object:
        """What people should look at."""

    def error(self, text: str, /) -> object:
        """Something that does not work."""


class Store(Protocol):
    """Keeps one document over a restart."""

    path: Any

    def read(self) -> Any:
        """The document; ``None`` where there is none yet.

        Raises:
            AlarmStateError: It cannot be read.
        """

    def write(self, document: Any) -> None:
        """Put a new document in the place of the old one.

        Raises:
            OSError: It cannot be written; the old one is untouched.
        """

    def set_aside(self) -> Any:
        """Rename a damaged document and return its new name.

        Raises:
            OSError: It cannot be renamed.
        """


class LiveAlarms:
    """The alarms as they live: feeds the annunciator, publishes and keeps what changes.

    Args:
        config: The configuration.
        clock: The time for stamps [ns].
        publish: Called with every new :func:`.alarm_records.alarms_record`.
        log: Where people's actions, and what cannot be kept, are told.
        store: What keeps the alarms over a restart; ``None`` for nothing.
        text_of: What there is to say of a bearing now.
        states_of: What the monitor remembers, to be kept with the alarms.

    Attributes:
        annunciator: The alarms; to be changed through this object only.
        states: What the monitor remembered when it was kept last; empty where nothing is known.
    """

    def __init__(
        self,
        config: MonitorConfig,
        clock: Callable[[], int],
        publish: Callable[[dict[str, Any]], None],
        log: Log,
        store: Store | None = None,
        text_of: Callable[[str], str] = str,
        states_of: Callable[[], dict[str, Any]] = dict,
    ) -> None:
        self._config, self._clock, self._publish = config, clock, publish
        self._log, self._store = log, store
        self._text_of, self._states_of = text_of, states_of
        self.annunciator = Annunciator(config)
        self.states: dict[str, Any] = {}
        self._begun_ns = self._published_ns = 0
        self._sequence = 0
        self._unkept = ''
        self._monitoring = False
        self._notes: deque[Note] = deque(maxlen=NOTES_KEPT)
        if store is not None:
            self._recall(store)

    def retune(self, config: MonitorConfig) -> None:
        """Take over new delays, limits and times; no state is lost."""
        self.annunciator.retune(config)

    def inherit(self, old: LiveAlarms) -> None:
        """The monitor starts afresh with other inputs; the alarms of before go on."""
        self.annunciator, self._sequence = old.annunciator, old._sequence
        self._notes = old._notes
        self.annunciator.retune(self._config)
        self.annunciator.restart()

    def begin(self) -> None:
        """Publish the list; the time of :meth:`advance` counts from here."""
        self._begun_ns = self.annunciator.now_ns
        self._monitoring = True
        self._announce([])

    def end(self) -> None:
        """Publish the list for the last time: from now on nobody watches the bearings."""
        self._monitoring = False
        self._announce([])
        self.keep()

    def note(self, what: str, text: str) -> None:
        """Put something on record, with the next list; see :class:`.alarm_records.Note`."""
        self._notes.append(Note(self._clock(), what, text))

    def advance(self, elapsed_ns: int) -> None:
        """Let time pass, given the running time since :meth:`begin` [ns]."""
        now_ns = self._begun_ns + elapsed_ns
        changes = self.annunciator.advance(now_ns, self._clock())
        if changes or self._notes or now_ns - self._published_ns >= HEARTBEAT_NS:
            self._announce(changes)
            if not changes:
                self.keep()

    def feed(self, bearing: str, place: int, time_ns: int, update: Update) -> None:
        """Take what one sample of an input brought to the monitor."""
        changes = []
        if update.status in _FAULTS:
            changes += self.annunciator.take_fault(bearing, place, update.status, time_ns)
        if update.verdict is not None:
            changes += self.annunciator.take_verdict(update.verdict)
        for event in update.events:
            changes += self.annunciator.take_event(event)
        if changes:
            self._announce(changes)

    def feed_events(self, events: list[Event]) -> None:
        """Take the changes of condition that passing time brought to the monitor."""
        changes = [c for event in events for c in self.annunciator.take_event(event)]
        if changes:
            self._announce(changes)

    def act(
        self,
        action: Action,
        by: str,
        bearing: str | None = None,
        kind: AlarmKind | None = None,
        reason: str = '',
    ) -> list[AlarmChange]:
        """Do what a person asks for, and put on record why; see :meth:`Annunciator.act`."""
        changes = self.annunciator.act(action, self._clock(), by, bearing, kind)
        if changes and reason:
            what = f'{bearing or "all bearings"}/{kind or "all alarms"}'
            self.note('action', f'{what}: {action} by {by}: {reason}')
        if changes:
            self._announce(changes)
        return changes

    def _announce(self, changes: list[AlarmChange]) -> None:
        alarms, notes = self.annunciator, list(self._notes)
        self._published_ns = alarms.now_ns
        self._sequence += 1
        self._notes.clear()
        told = self._clock(), self._sequence, self._monitoring, notes, self._text_of
        self._publish(alarms_record(alarms, changes, *told))
        for change in changes:
            # What the monitor itself does is in the log as a warning already.
            if change.by != MONITOR:
                self._log.info(
                    f'{change.bearing}/{change.kind}: {change.what} by {change.by},'
                    f' {change.before} -> {change.after}'
                )
        if changes:
            self.keep()

    def keep(self) -> None:
        """Write what is kept; a full disk must not stop the monitor, and is told once."""
        if self._store is None:
            return
        document = state_record(self.annunciator, self._clock()) | {'states': self._states_of()}
        try:
            self._store.write(document)
            self._unkept = ''
        except OSError as error:
            if str(error) != self._unkept:
                self._unkept = str(error)
                self._log.error(f'the alarms are not kept: {cause(error)}')

    def _recall(self, store: Store) -> None:
        """Take over what was kept, or set it aside where it is damaged."""
        try:
            document = store.read()
            if document is not None:
                recall_state(self.annunciator, document, self._clock())
                # The file of the last version has none.
                states = document.get('states')
                self.states = states if isinstance(states, dict) else {}
            return
        except AlarmStateError as error:
            reason = error
        try:
            end = f'it is now {store.set_aside()}, and the alarms start fresh'
        except OSError as error:
            end = f'the alarms start fresh; it cannot be set aside: {cause(error)}'
        self._log.error(f'state_file {store.path} cannot be used: {reason}; {end}')
