# SPDX-License-Identifier: Apache-2.0
"""Server-sent events to many readers, none of which can hold up another or fill the memory."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from stickslip_monitor.errors import DashboardError

MOST_READERS = 200
KEPT = 12
"""Of these so many are kept for people who have signed in, however many programs listen."""


class Reader:
    """One open stream: of each kind of event the newest that it has not been sent yet.

    So what waits for a reader that does not read is bounded by the number of kinds, and one that
    is slow skips what is out of date.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._something = asyncio.Event()
        self.closed = False

    def put(self, key: str, event: bytes) -> None:
        """Let an event wait, in place of an older one of its kind."""
        self._waiting.pop(key, None)
        self._waiting[key] = event
        self._something.set()

    def close(self) -> None:
        """End the stream."""
        self.closed = True
        self._something.set()

    async def take(self) -> bytes:
        """All that waits, as soon as there is something."""
        await self._something.wait()
        self._something.clear()
        events, self._waiting = self._waiting, {}
        return b''.join(events.values())


class Hub:
    """Hands events to every reader.

    Args:
        run: What tells the events of this process from those of another.
    """

    def __init__(self, run: str) -> None:
        self._run = run
        self._number = 0
        self.readers: set[Reader] = set()

    def join(self, signed_in: bool = True) -> Reader:
        """A new reader.

        Args:
            signed_in: Whether it is somebody who has signed in at the page.

        Raises:
            DashboardError: There are too many.
        """
        most = MOST_READERS if signed_in else MOST_READERS - KEPT
        if len(self.readers) >= most:
            raise DashboardError(f'{most} pages are open already; close one')
        reader = Reader()
        self.readers.add(reader)
        return reader

    def leave(self, reader: Reader) -> None:
        """A reader has gone."""
        self.readers.discard(reader)

    def close(self) -> None:
        """End all streams."""
        for reader in self.readers:
            reader.close()

    def send(self, kind: str, document: dict[str, Any], key: str = '') -> None:
        """Give an event to every reader.

        Args:
            kind: Its name.
            document: What it says.
            key: What tells it from others of that name that do not replace it.
        """
        event = self.event(kind, document)
        for reader in self.readers:
            reader.put(f'{kind} {key}', event)

    def event(self, kind: str, document: dict[str, Any]) -> bytes:
        """An event as it goes over the wire, under a number of its own."""
        self._number += 1
        data = json.dumps(document, allow_nan=False, separators=(',', ':'))
        return f'id: {self._run}-{self._number}\nevent: {kind}\ndata: {data}\n\n'.encode()
