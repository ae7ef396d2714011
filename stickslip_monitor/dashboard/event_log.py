# SPDX-License-Identifier: Apache-2.0
"""What happened: changes of alarms and notes of the monitors, kept over a restart."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from datetime import datetime, timezone
from itertools import islice
from typing import Any, Protocol

KEPT = 5000
"""Entries that are kept; the page shows the latest, a file of CSV has all."""
SHOWN = 60
LOG_SCHEMA = 'stickslip_monitor/log/1'
TEXTS = ('node', 'bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
_LONGEST = 300
# What a spreadsheet would compute.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


class LogStore(Protocol):
    """Keeps one document over a restart, and tries again where it cannot."""

    fault: str

    def read(self) -> Any:
        """The document; ``None`` where there is none yet."""

    def write(self, document: Any) -> None:
        """Have a new document written in the place of the old one."""


class EventLog:
    """The newest entries, oldest first; each is there once, however often it is told.

    A latched topic tells a dashboard that starts again what the file knows already.

    Args:
        store: What keeps the entries over a restart; ``None`` for nothing.
    """

    def __init__(self, store: LogStore | None = None) -> None:
        self._entries: dict[tuple[Any, ...], dict[str, Any]] = {}
        self._store: LogStore | None = None
        if store is not None:
            document = store.read()
            known = document.get('entries') if isinstance(document, dict) else None
            self.extend(known if isinstance(known, list) else ())
            self._store = store

    @property
    def fault(self) -> str:
        """Why the newest entries are not on disk; empty where they are, or need not be."""
        return self._store.fault if self._store is not None else ''

    def extend(self, entries: Iterable[Any]) -> None:
        """Add entries; what is none, or is there already, is passed over."""
        before = len(self._entries)
        checked = [entry for entry in map(_checked, entries) if entry is not None]
        for entry in checked:
            self._entries.setdefault(_key(entry), entry)
        new = len(self._entries) > before
        while len(self._entries) > KEPT:
            del self._entries[next(iter(self._entries))]
        if new and self._store is not None:
            self._store.write({'schema': LOG_SCHEMA, 'entries': list(self._entries.values())})

    def clear(self) -> None:
        """Forget everything: a recording begins anew."""
        self._entries.clear()

    def latest(self) -> list[dict[str, Any]]:
        """What the page shows."""
        return list(islice(reversed(self._entries.values()), SHOWN))[::-1]

    def csv(self) -> str:
        """All that is kept as a table, times in UTC by ISO 8601."""
        text = io.StringIO()
        table = csv.writer(text)
        table.writerow(('time', *TEXTS))
        table.writerows(
            (_iso(entry['time']), *(_cell(entry[key]) for key in TEXTS))
            for entry in self._entries.values()
        )
        return text.getvalue()


def _key(entry: dict[str, Any]) -> tuple[Any, ...]:
    return entry['time'], *(entry[key] for key in TEXTS)


def _checked(entry: Any) -> dict[str, Any] | None:
    """An entry with a time [ms] or ``None``, and texts that are not too long."""
    if not isinstance(entry, dict):
        return None
    time = entry.get('time')
    texts = {key: str(entry.get(key, ''))[:_LONGEST] for key in TEXTS}
    return {'time': time if isinstance(time, int) else None, **texts}


def _iso(time_ms: int | None) -> str:
    if time_ms is None:
        return ''
    try:
        when = datetime.fromtimestamp(time_ms / 1000.0, timezone.utc)
    except (OverflowError, ValueError, OSError):
        return ''
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


def _cell(text: str) -> str:
    return f"'{text}" if text.startswith(_FORMULA) else text
