# SPDX-License-Identifier: Apache-2.0
"""Who may see the page and act on it, and how many connections there may be.

The Host must be one of ours (a name that an attacker rebinds to this machine is not), what changes
anything must come from a page of ours, and where there is a token, whoever comes must know it.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import secrets
import stat
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from stickslip_monitor.errors import DashboardError
from stickslip_monitor.files import read_file

_LARGEST_TOKEN = 4096
COOKIE = 'stickslip_session'
SHORTEST_TOKEN = 16
_MOST_ENDED = 1000
OPEN_PATHS = ('/login', '/page.css', '/icon.svg')
"""What is given without a token: it says nothing of the ship."""
MOST_CONNECTIONS = 400
"""More than pages, and less than the files that a process may have open."""
IDLE = 30.0
"""A connection without a request, or with half of one, is closed after so long [s]."""
_HEADERS = {
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self';"
        " connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    ),
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Referrer-Policy': 'same-origin',
    'X-Content-Type-Options': 'nosniff',
    'Cache-Control': 'no-cache',
}


@dataclass(frozen=True, slots=True)
class Access:
    """The rules.

    A session is a random number with its keyed hash: it outlives a restart and does not tell the
    token. Those that were ended are remembered until a restart; another token ends all.

    Attributes:
        token: What to know; empty where nothing is asked.
        names: Host names, in lower case, under which this machine is known beside its addresses.
        ended: The sessions that were ended, the oldest first.
    """

    token: str = ''
    names: Collection[str] = ()
    ended: deque[str] = field(default_factory=lambda: deque(maxlen=_MOST_ENDED))

    def knows(self, token: str) -> bool:
        """Whether somebody knows the token; takes as long whatever is wrong with it."""
        return hmac.compare_digest(token.encode('utf-8', 'replace'), self.token.encode())

    def session(self, number: str = '') -> str:
        """The content of a cookie, of a new session if no number is given."""
        number = number or secrets.token_urlsafe(16)
        text = f'stickslip dashboard {number}'.encode('utf-8', 'replace')
        return f'{number}.{hmac.new(self.token.encode(), text, hashlib.sha256).hexdigest()}'

    def end(self, request: web.Request) -> None:
        """End the session of a request."""
        if self.signed_in(request):
            self.ended.append(request.cookies[COOKIE])

    def signed_in(self, request: web.Request) -> bool:
        """Whether a request belongs to a session."""
        cookie = request.cookies.get(COOKIE, '')
        number = cookie.partition('.')[0]
        known = hmac.compare_digest(
            cookie.encode('utf-8', 'replace'),
            self.session(number or '-').encode('utf-8', 'replace'),
        )
        return known and cookie not in self.ended

    def admits(self, request: web.Request) -> bool:
        """Whether a request may see what is shown."""
        if not self.token:
            return True
        kind, _, token = request.headers.get('Authorization', '').partition(' ')
        bearer = kind.lower() == 'bearer' and self.knows(token.strip())
        return bearer or self.signed_in(request)

    def is_ours(self, host: str) -> bool:
        """Whether a Host header names this machine: an address, or a name it is known by."""
        try:
            name = (urlsplit(f'//{host}').hostname or '').rstrip('.')
            return name in ('localhost', *self.names) or bool(ipaddress.ip_address(name))
        except ValueError:
            return False


def same_origin(request: web.Request) -> bool:
    """Whether a request comes from a page of ours, or from no page at all."""
    if request.headers.get('Sec-Fetch-Site', 'same-origin') not in ('same-origin', 'none'):
        return False
    origin = request.headers.get('Origin')
    return origin is None or urlsplit(origin).netloc == request.host


def read_token(path: str) -> str:
    """The token of a file that holds nothing else.

    Raises:
        DashboardError: It cannot be read, is too short to keep anybody out, or is open to others.
    """
    try:
        mode = Path(path).stat().st_mode
        token = read_file(path, _LARGEST_TOKEN).decode().strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is not a text file'
        raise DashboardError(f"token file '{path}' cannot be read: {reason}") from error
    if mode & (stat.S_IROTH | stat.S_IWOTH):
        raise DashboardError(f"token file '{path}' is open to every user: chmod 600 '{path}'")
    if len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable():
        raise DashboardError(
            f"token file '{path}' must hold at least {SHORTEST_TOKEN} printable ASCII characters,"
            " e.g. those of: python3 -c 'import secrets; print(secrets.token_urlsafe())'"
        )
    return token


def guard(access: Access) -> Middleware:
    """The middleware that keeps the rules, and gives every answer its headers."""

    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        refused = _refusal(access, request)
        if refused is not None:
            return refused
        try:
            return await handler(request)
        except web.HTTPException as error:
            error.headers.update(_HEADERS)
            raise

    return middleware


def _refusal(access: Access, request: web.Request) -> web.Response | None:
    if not access.is_ours(request.host):
        return web.Response(status=421, text='This machine is not known by that name.\n')
    if request.method not in ('GET', 'HEAD') and not same_origin(request):
        return web.Response(status=403, text='This must come from the page itself.\n')
    if request.path in OPEN_PATHS or access.admits(request):
        return None
    if request.path == '/' and request.method == 'GET':
        return web.Response(status=303, headers={'Location': '/login'})
    return web.Response(
        status=401, text='The token is missing.\n', headers={'WWW-Authenticate': 'Bearer'}
    )


async def add_headers(_: web.Request, response: web.StreamResponse) -> None:
    """Give an answer the headers that keep its page by itself."""
    for name, value in _HEADERS.items():
        response.headers.setdefault(name, value)


class _Door(asyncio.Protocol):
    """Stands before the server's protocol, and knows when no request is being answered.

    Args:
        inner: The server's own protocol of the connection.
        others: All that are open, in the order in which they last did something.
        most, idle: See :func:`listen`.
    """

    def __init__(self, inner: Any, others: dict[_Door, None], most: int, idle: float) -> None:
        self._inner, self._others, self._most, self._idle = inner, others, most, idle
        self._transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._busy = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        if len(self._others) >= self._most:
            idlest = next((each for each in self._others if not each._busy), None)
            if idlest is None:
                transport.abort()
                return
            idlest.close()
        self._transport = transport
        self._others[self] = None
        self._wait()
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        self._others.pop(self, None)
        self._wait()
        if self._transport is not None:
            self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        return bool(self._inner.eof_received())

    def pause_writing(self) -> None:
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._inner.resume_writing()

    def count(self, change: int) -> None:
        """One more request has come whole, or has been answered."""
        self._busy += change
        if self._others.pop(self, self) is None:
            self._others[self] = None
        self._wait()

    def close(self) -> None:
        """End the connection, whatever is under way."""
        self._others.pop(self, None)
        if self._transport is not None:
            self._transport.abort()

    def _wait(self) -> None:
        """Close it when it has been idle for too long from now on."""
        if self._timer is not None:
            self._timer.cancel()
        if not self._busy and self in self._others:
            self._timer = asyncio.get_running_loop().call_later(self._idle, self.close)


@web.middleware
async def count_requests(request: web.Request, handler: Handler) -> web.StreamResponse:
    """The middleware that tells a connection when a request is being answered."""
    transport = request.transport
    door = None if transport is None else transport.get_protocol()
    if not isinstance(door, _Door):
        return await handler(request)
    door.count(1)
    try:
        return await handler(request)
    finally:
        door.count(-1)


async def listen(
    runner: web.AppRunner,
    address: str,
    port: int,
    most: int = MOST_CONNECTIONS,
    idle: float = IDLE,
) -> asyncio.Server:
    """Listen at an address; when there are too many connections the idlest goes.

    Args:
        runner: The server.
        address: The address.
        port: The port; 0 for any.
        most: See :data:`MOST_CONNECTIONS`.
        idle: See :data:`IDLE` [s].

    Raises:
        OSError: It cannot be listened at.
        OverflowError: The port is none.
    """
    make, others = runner.server, dict[_Door, None]()
    assert make is not None
    return await asyncio.get_running_loop().create_server(
        lambda: _Door(make(), others, most, idle), address, port, backlog=128
    )
