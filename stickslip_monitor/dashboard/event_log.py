# SPDX-License-Identifier: Apache-2.0
"""The log of what happened, for the page, for a file over a restart, and as CSV."""

from __future__ import annotations

import csv
import heapq
import io
import time
from collections.abc import Iterable
from datetime import datetime, timezone
from typing import Any

from stickslip_monitor.errors import AlarmStateError
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.state_file import StateWriter

MAX_ENTRIES = 5000
"""Entries of the log that are kept; the page shows the latest, a file of CSV has all."""
MAX_SHOWN = 60
"""Entries of the log that the page shows: the latest."""
LOG_FAMILY = 'stickslip_monitor/log/'
"""How the schema of a log begins, whatever its version."""
LOG_SCHEMA = f'{LOG_FAMILY}1'
LOG_TEXTS = ('node', 'bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
# Characters of a text in the log; the rest of a longer one is cut off.
_MAX_TEXT = 300
# What a spreadsheet would compute.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


class EventLog:
    """The newest entries, oldest first; each is there once, however often it comes.

    A latched topic sends a dashboard that starts again what the file has already.

    Args:
        store: What keeps the entries over a restart; ``None`` for nothing.

    Attributes:
        damage: Why the entries of before are lost; empty where they are not.
    """

    def __init__(self, store: StateWriter | None = None) -> None:
        self._entries: dict[tuple[Any, ...], dict[str, Any]] = {}
        self._store, self.damage = store, ''
        if store is not None:
            self._restore_entries(store)

    def _restore_entries(self, store: StateWriter) -> None:
        """Take the entries of the file; set a damaged file aside, with an entry and :attr:`damage` on it."""
        try:
            self._add_entries(_kept_entries(store.read()))
        except AlarmStateError as error:
            end = 'what happened before is not shown'
            self.damage = f'the log {store.path} is damaged: {error}; {store.set_aside()}, and {end}'
            self.extend([{'time': time.time_ns() // 1_000_000, 'what': 'log', 'text': self.damage}])

    @property
    def fault(self) -> str:
        """Reason why the newest entries are not on disk; empty where they are, or need not be."""
        return self._store.fault if self._store is not None else ''

    def extend(self, entries: Iterable[Any]) -> None:
        """Add entries, see :meth:`_add_entries`; if any was new, have the log saved, where it is kept.

        An entry has ``time`` [ms since 1970] and the texts of :data:`LOG_TEXTS`, all optional.
        """
        if self._add_entries(entries) and self._store is not None:
            self._store.write({'schema': LOG_SCHEMA, 'entries': list(self._entries.values())})

    def _add_entries(self, entries: Iterable[Any]) -> bool:
        """Add entries, texts cut to :data:`_MAX_TEXT` characters; return whether any was new.

        What is no dictionary, or is there already, is left out; a time that is no integer becomes ``None``.
        Beyond :data:`MAX_ENTRIES` the oldest are dropped.
        """
        before = len(self._entries)
        for entry in entries:
            if isinstance(entry, dict):
                when = entry.get('time')
                texts = {key: str(entry.get(key, ''))[:_MAX_TEXT] for key in LOG_TEXTS}
                full_entry = {'time': when if isinstance(when, int) else None, **texts}
                self._entries.setdefault(tuple(full_entry.values()), full_entry)
        new = len(self._entries) > before
        while len(self._entries) > MAX_ENTRIES:
            del self._entries[next(iter(self._entries))]
        return new

    def clear(self) -> None:
        """Remove all entries; a saved log stays as it is."""
        self._entries.clear()

    def latest(self) -> list[dict[str, Any]]:
        """Return the :data:`MAX_SHOWN` entries that came last, in order of time, for the page."""
        return _in_order(list(self._entries.values())[-MAX_SHOWN:])

    def to_csv(self) -> str:
        """Return all entries, in order of time, as a text of CSV with a head line; times are ISO 8601 in UTC.

        An apostrophe is put before a cell that a spreadsheet would compute.
        """
        text = io.StringIO()
        table = csv.writer(text)
        table.writerow(('time', *LOG_TEXTS))
        for entry in _in_order(self._entries.values()):
            texts = [entry[key] for key in LOG_TEXTS]
            cells = [f"'{cell}" if cell.startswith(_FORMULA) else cell for cell in texts]
            table.writerow((_format_iso(entry['time']), *cells))
        return text.getvalue()


def _kept_entries(document: Any) -> list[Any]:
    """Return the entries of a saved log, empty where there is no file yet (``None``).

    Raises:
        AlarmStateError: It is not a log of this version.
    """
    if document is None:
        return []
    log: dict[str, Any] = document if isinstance(document, dict) else {}
    if log.get('schema') != LOG_SCHEMA:
        raise refused('schema', log.get('schema'), repr(LOG_SCHEMA), AlarmStateError)
    if not isinstance(entries := log.get('entries'), list):
        raise AlarmStateError("it has no list of 'entries'")
    return entries


def _in_order(entries: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Merge entries of nodes by time into a list; those of one node keep their order, at any times.

    A time of ``None`` counts as 0.
    """
    nodes: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        nodes.setdefault(entry['node'], []).append(entry)
    return list(heapq.merge(*nodes.values(), key=lambda entry: entry['time'] or 0))


def _format_iso(time_ms: int | None) -> str:
    """Format a time [ms since 1970] by ISO 8601 in UTC; empty for ``None`` or a time out of range."""
    if time_ms is None:
        return ''
    try:
        when = datetime.fromtimestamp(time_ms / 1000.0, timezone.utc)
    except (OverflowError, ValueError, OSError):
        return ''
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')
