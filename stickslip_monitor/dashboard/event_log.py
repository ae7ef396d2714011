# SPDX-License-Identifier: Apache-2.0
"""What happened, as the page and its table have it, over restarts of the dashboard."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from datetime import datetime, timezone
from typing import Any

from stickslip_monitor.state_file import StateWriter

KEPT = 5000
"""Entries of the log that are kept; the page shows the latest, a file of CSV has all."""
SHOWN = 60
LOG_SCHEMA = 'stickslip_monitor/log/1'
LOG_TEXTS = ('node', 'bearing', 'alarm', 'priority', 'what', 'from', 'to', 'by', 'text')
_LONGEST = 300
# What a spreadsheet would compute.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


class EventLog:
    """The newest entries, oldest first; each is there once, however often it comes.

    A latched topic sends a dashboard that starts again what the file has already.

    Args:
        store: What keeps the entries over a restart; ``None`` for nothing.
    """

    def __init__(self, store: StateWriter | None = None) -> None:
        self._entries: dict[tuple[Any, ...], dict[str, Any]] = {}
        self._store = store
        document = None if store is None else store.read()
        known = document.get('entries') if isinstance(document, dict) else None
        self._add(known if isinstance(known, list) else ())

    @property
    def fault(self) -> str:
        """Why the newest entries are not on disk; empty where they are, or need not be."""
        return self._store.fault if self._store is not None else ''

    def extend(self, entries: Iterable[Any]) -> None:
        """Add entries; what is none, or is there already, is passed over."""
        if self._add(entries) and self._store is not None:
            self._store.write({'schema': LOG_SCHEMA, 'entries': list(self._entries.values())})

    def _add(self, entries: Iterable[Any]) -> bool:
        """Add entries; whether any was new."""
        before = len(self._entries)
        for entry in entries:
            if isinstance(entry, dict):
                time = entry.get('time')
                texts = {key: str(entry.get(key, ''))[:_LONGEST] for key in LOG_TEXTS}
                own = {'time': time if isinstance(time, int) else None, **texts}
                self._entries.setdefault(tuple(own.values()), own)
        new = len(self._entries) > before
        while len(self._entries) > KEPT:
            del self._entries[next(iter(self._entries))]
        return new

    def clear(self) -> None:
        """Forget everything: a recording begins anew."""
        self._entries.clear()

    def latest(self) -> list[dict[str, Any]]:
        """What the page shows."""
        return list(self._entries.values())[-SHOWN:]

    def csv(self) -> str:
        """All that is kept as a table, times in UTC by ISO 8601."""
        text = io.StringIO()
        table = csv.writer(text)
        table.writerow(('time', *LOG_TEXTS))
        for time_ms, *texts in self._entries:
            cells = [f"'{each}" if each.startswith(_FORMULA) else each for each in texts]
            table.writerow((_iso(time_ms), *cells))
        return text.getvalue()


def _iso(time_ms: int | None) -> str:
    if time_ms is None:
        return ''
    try:
        when = datetime.fromtimestamp(time_ms / 1000.0, timezone.utc)
    except (OverflowError, ValueError, OSError):
        return ''
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')
