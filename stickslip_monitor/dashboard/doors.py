# SPDX-License-Identifier: Apache-2.0
"""Connections: how many there may be, and how long one may do nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from aiohttp import web
from aiohttp.typedefs import Handler

MOST_CONNECTIONS = 400
"""More than pages, and less than the files that a process may have open."""
IDLE = 30.0
"""A connection without a request, or with half of one, is closed after so long [s]."""


class Doors:
    """Makes the protocol of each connection; when there are too many the idlest goes.

    Args:
        make: Makes the server's own protocol.
        most: See :data:`MOST_CONNECTIONS`.
        idle: See :data:`IDLE` [s].
    """

    def __init__(
        self,
        make: Callable[[], asyncio.BaseProtocol],
        most: int = MOST_CONNECTIONS,
        idle: float = IDLE,
    ) -> None:
        self._make, self._most, self.idle = make, most, idle
        self._open: dict[_Door, None] = {}

    def __call__(self) -> asyncio.Protocol:
        """The protocol of a new connection."""
        return _Door(self, self._make())

    def enter(self, door: _Door) -> bool:
        """Let a connection in; whether there was room for it."""
        if len(self._open) >= self._most:
            # They are in the order in which they last did something.
            idlest = next((each for each in self._open if not each.busy), None)
            if idlest is None:
                return False
            idlest.close()
        self._open[door] = None
        return True

    def moved(self, door: _Door) -> None:
        """A connection has done something."""
        if self._open.pop(door, self) is None:
            self._open[door] = None

    def leave(self, door: _Door) -> None:
        """A connection has gone."""
        self._open.pop(door, None)

    def __len__(self) -> int:
        return len(self._open)


class _Door(asyncio.Protocol):
    """Stands before the server's protocol, and knows when no request is being answered."""

    def __init__(self, doors: Doors, inner: Any) -> None:
        self._doors, self._inner = doors, inner
        self._transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._refused = False
        self.busy = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._refused = not self._doors.enter(self)
        if self._refused:
            transport.abort()
            return
        self._wait()
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop()
        self._doors.leave(self)
        if not self._refused:
            self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        return bool(self._inner.eof_received())

    def pause_writing(self) -> None:
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._inner.resume_writing()

    def begin(self) -> None:
        """A whole request has come."""
        self.busy += 1
        self._stop()
        self._doors.moved(self)

    def end(self) -> None:
        """It has been answered."""
        self.busy -= 1
        self._doors.moved(self)
        self._wait()

    def close(self) -> None:
        """End the connection, whatever is under way."""
        self._doors.leave(self)
        if self._transport is not None:
            self._transport.abort()

    def _wait(self) -> None:
        self._stop()
        if self._transport is not None and not self._transport.is_closing():
            self._timer = asyncio.get_running_loop().call_later(self._doors.idle, self.close)

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


@web.middleware
async def watch(request: web.Request, handler: Handler) -> web.StreamResponse:
    """The middleware that tells a connection when a request is being answered."""
    transport = request.transport
    door = None if transport is None else transport.get_protocol()
    if not isinstance(door, _Door):
        return await handler(request)
    door.begin()
    try:
        return await handler(request)
    finally:
        door.end()


async def listen(
    runner: web.AppRunner,
    address: str,
    port: int,
    most: int = MOST_CONNECTIONS,
    idle: float = IDLE,
) -> asyncio.Server:
    """Listen at an address, with limits.

    Raises:
        OSError: It cannot be listened at.
        OverflowError: The port is none.
    """
    assert runner.server is not None
    doors = Doors(runner.server, most, idle)
    return await asyncio.get_running_loop().create_server(doors, address, port, backlog=128)
