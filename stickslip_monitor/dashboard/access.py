# SPDX-License-Identifier: Apache-2.0
"""Who may see the page and act on it, and how many connections there may be.

The Host must be one of ours (a name that an attacker rebinds to this machine is not), what changes
anything must come from a page of ours, and where there is a token, whoever comes must know it.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import math
import secrets
import time
from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler

# Ended sessions that are remembered; of more the oldest would count again.
_MAX_ENDED = 1000
OPEN_PATHS = ('/login', '/page.css', '/icon.svg')
"""What is given without a token: it says nothing of the ship."""
MAX_CONNECTIONS = 400
"""More than pages, and less than the files that a process may have open."""
MAX_IDLE = 30.0
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

    A session is a random number with its keyed hash: it outlives a restart and does not show the
    token. Those that were ended are remembered until a restart; another token ends all.
    """

    token: str = ''  # what to know; empty where nothing is asked
    # Host names, in lower case, under which this machine is known beside its addresses.
    names: Collection[str] = ()
    # The sessions that were ended, the oldest first.
    ended: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_ENDED))

    def is_token(self, token: str) -> bool:
        """Return whether a text is the token, in a time that does not depend on how much of it is right."""
        return hmac.compare_digest(token.encode('utf-8', 'replace'), self.token.encode())

    def make_cookie(self, number: str = '') -> str:
        """Return the content of the cookie of a session by its number; of a new, random one for ``''``."""
        number = number or secrets.token_urlsafe(16)
        text = f'stickslip dashboard {number}'.encode('utf-8', 'replace')
        return f'{number}.{hmac.new(self.token.encode(), text, hashlib.sha256).hexdigest()}'

    def end_session(self, request: web.Request) -> None:
        """End the session of a request: its cookie is not accepted any more, until a restart."""
        self.ended.append(request.cookies.get(cookie_name(request), ''))

    def is_signed_in(self, request: web.Request) -> bool:
        """Return whether a request has the cookie of a session that was not ended.

        Where there is no token, the page needs no session: see :meth:`admits`.
        """
        cookie = request.cookies.get(cookie_name(request), '')
        session = self.make_cookie(cookie.partition('.')[0] or '-')
        same = hmac.compare_digest(cookie.encode('utf-8', 'replace'), session.encode('utf-8', 'replace'))
        return same and cookie not in self.ended

    def admits(self, request: web.Request) -> bool:
        """Return whether a request has the token or a session; always true where there is no token."""
        if not self.token:
            return True
        kind, _, token = request.headers.get('Authorization', '').partition(' ')
        bearer = kind.lower() == 'bearer' and self.is_token(token.strip())
        return bearer or self.is_signed_in(request)

    def is_ours(self, host: str) -> bool:
        """Return whether a Host header names this machine: any IP address, or a name it is known by."""
        try:
            name = (urlsplit(f'//{host}').hostname or '').rstrip('.')
            return name in ('localhost', *self.names) or bool(ipaddress.ip_address(name))
        except ValueError:
            return False

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request by its handler, as a middleware, or refuse it by the rules.

        The answer is 421 for a foreign Host, 403 for a change that another page asks for, 401 without token
        (for the page itself a redirect to the login).
        """
        if not self.is_ours(request.host):
            text = 'This machine is not known by that name: start the page with --name NAME.\n'
            return web.Response(status=421, text=text)
        if request.method not in ('GET', 'HEAD') and not is_same_origin(request):
            return web.Response(status=403, text='Changes must come from the page itself.\n')
        if request.path in OPEN_PATHS or self.admits(request):
            return await handler(request)
        if request.path == '/' and request.method == 'GET':
            return web.Response(status=303, headers={'Location': 'login'})
        headers = {'WWW-Authenticate': 'Bearer'}
        return web.Response(status=401, text='The token is missing or wrong.\n', headers=headers)


def cookie_name(request: web.Request) -> str:
    """Return the name of the page's cookie, which ends in our port: browsers share cookies among ports.

    On a connection that has gone it has no port.
    """
    address = request.transport and request.transport.get_extra_info('sockname')
    return f'stickslip_session_{address[1]}' if address else 'stickslip_session'


def is_same_origin(request: web.Request) -> bool:
    """Return whether a request comes from a page of ours, or from no page at all.

    By ``Sec-Fetch-Site``, which no page can forge; without it by Origin and Host, which a proxy may replace.
    """
    site = request.headers.get('Sec-Fetch-Site')
    if site is not None and site != 'none':
        return site == 'same-origin'
    origin = request.headers.get('Origin')
    return origin is None or urlsplit(origin).netloc == request.host


async def add_headers(_: web.Request, response: web.StreamResponse) -> None:
    """Add the headers to an answer, in place, that keep other pages out of its page; those it has stay."""
    for name, value in _HEADERS.items():
        response.headers.setdefault(name, value)


class Connections:
    """Ends connections on which nothing is asked: idle for too long, or the idlest of too many.

    Args:
        max_connections: How many may be open.
        max_idle: How long one may be idle [s].
    """

    def __init__(self, max_connections: int, max_idle: float) -> None:
        self._max_connections, self._max_idle = max_connections, max_idle
        # Since when nothing is asked on each; infinite while a request is being answered.
        self._since: dict[Any, float] = {}

    @web.middleware
    async def count(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request by its handler, as a middleware; its connection is idle only after it."""
        self._since[request.protocol] = math.inf
        try:
            return await handler(request)
        finally:
            self._since[request.protocol] = time.monotonic()

    def sweep(self, connections: Iterable[Any]) -> None:
        """Abort the connections of a server that are idle for too long, and the idlest of too many.

        One on which a request is being answered is never idle; a new one is idle from this call on.
        """
        now = time.monotonic()
        open_since = {
            connection: self._since.get(connection, now) for connection in connections if connection.transport
        }
        self._since = open_since
        too_many = len(open_since) - self._max_connections
        for number, (connection, since) in enumerate(sorted(open_since.items(), key=lambda item: item[1])):
            if now - since > self._max_idle or (number < too_many and since < math.inf):
                connection.transport.abort()
