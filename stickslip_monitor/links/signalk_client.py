# SPDX-License-Identifier: Apache-2.0
"""The Signal K side of the ship: one websocket, opened again for ever, and all that it carries."""

from __future__ import annotations

import asyncio
import json
import random
import re
import ssl
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import aiohttp

from stickslip_logs.units import MIB, SECOND_NS
from stickslip_monitor.errors import LinkError, cause
from stickslip_monitor.host import SHOW_NS
from stickslip_monitor.links.links_config import UNHEARD, BusInput, SignalKLink, is_loopback
from stickslip_monitor.links.live_monitor import MonitorSide
from stickslip_monitor.links.signalk import (
    SAFE_ACTIONS,
    Notifications,
    SignalKInputs,
    SignalKValues,
    Update,
    is_hello,
    version_of,
)
from stickslip_monitor.monitor.session import Sink

IN, OUT = 'signalk_in', 'signalk_out'
HEARTBEAT = 10.0
"""A server that answers no ping for half as long again is gone [s]."""
REPEAT = 60.0
"""All alarms are sent again after so long [s]: a server forgets, and others overwrite."""
BACK_OFF = (0.5, 5.0)
"""First and longest wait before another connection [s], shortened by chance: ships must not call at once."""
_WAIT_FOR = (HTTPStatus.REQUEST_TIMEOUT, HTTPStatus.TOO_EARLY, HTTPStatus.TOO_MANY_REQUESTS)
"""Answers of a server that is busy: these are waited for, as those from 500 on."""
_OUTBOX = 1000  # updates that wait for the server; the oldest are dropped
_MAX_FRAME_BYTES = 4 * MIB  # of a frame [bytes]: a server's whole state has some 100 kB
_NEEDS_TOKEN = (
    'gives nothing without a token: name a file as signalk.token_file and run'
    ' `stickslip watch --request-token`'
)


class _Unusable(LinkError):
    """The server answers, and waiting does not mend what is wrong."""


def make_ssl_context(ca_file: str) -> ssl.SSLContext:
    """Make the context that checks a server's certificate; there is no way not to.

    Args:
        ca_file: Certificate of its CA; '' for the CAs of the system.

    Raises:
        LinkError: The file cannot be read, or has no certificate.
    """
    try:
        return ssl.create_default_context(cafile=ca_file or None)
    except OSError as error:
        raise LinkError(f"signalk.ca_file = '{ca_file}' has no certificate: {cause(error)}") from error


class SignalKClient(Sink):
    """Samples in, values and notifications out, people's acts back.

    Args:
        link: The server, and what is sent to it.
        token: Opens the server; empty for none.
        inputs: The inputs that come from it.
        own_load: Bearings whose load comes from elsewhere.
        side: The monitor; it is given the links ``signalk_in`` and ``signalk_out``.

    Raises:
        LinkError: The file of certificates has none.
        ConfigurationError: Two bearings have one path.
    """

    def __init__(
        self, link: SignalKLink, token: str, inputs: SignalKInputs, own_load: Sequence[str], side: MonitorSide
    ) -> None:
        self._link, self._inputs, self._side = link, inputs, side
        self._headers = {'Authorization': f'Bearer {token}'} if token else {}
        self._ssl = make_ssl_context(link.ca_file)
        self._values = SignalKValues(link.prefix, own_load)
        self._alarms = Notifications(side.bearings, link.prefix, f'{time.time_ns() // 10**6:x}')
        self._records: dict[str, dict[str, Any]] = {}
        self._outbox: deque[Update] = deque(maxlen=_OUTBOX)
        self._wake = asyncio.Event()
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._own = ''
        self._known_once = False
        self._repeated = self._sent_values = 0.0
        self._waiting_since: float | None = None
        self._silence_tasks: set[asyncio.Task[None]] = set()
        self._session: aiohttp.ClientSession | None = None

    async def open_ports(self) -> None:
        """Do nothing: :meth:`run` connects."""

    async def run(self) -> None:
        """Connect, and reconnect after each loss with growing waits, until cancelled.

        Connections and losses are reported as states of the links.

        Raises:
            LinkError: The first server that answers cannot be used as configured.
        """
        wait = BACK_OFF[0]
        async with aiohttp.ClientSession() as session:
            self._session = session
            while True:
                begun = time.monotonic()
                try:
                    reason = await self._use_connection(session)
                except _Unusable as error:
                    if not self._known_once:
                        raise
                    reason = str(error)
                except (aiohttp.ClientError, OSError, asyncio.TimeoutError) as error:
                    reason = failure_reason(error)
                self._socket, self._waiting_since = None, None
                self._side.report_link(IN, False, reason)
                if self._link.prefix:
                    self._side.report_link(OUT, False, reason)
                # A connection that ended before its first ping was none: the waits go on growing.
                wait = BACK_OFF[0] if time.monotonic() - begun > HEARTBEAT else wait
                await asyncio.sleep(wait * random.uniform(0.5, 1.0))
                wait = min(2.0 * wait, BACK_OFF[1])

    async def _use_connection(self, session: aiohttp.ClientSession) -> str:
        """Connect, subscribe, and exchange frames until the connection ends; return the reason.

        The incoming link is reported as working once the server has greeted. The outbox is emptied; with a
        prefix meta data and all notifications are queued.

        Raises:
            LinkError: The server cannot be used as configured.
            aiohttp.ClientError: The connection fails; so also OSError, asyncio.TimeoutError.
        """
        async with await self._open_stream(session) as socket:
            hello = await self._receive_hello(socket)
            now = time.monotonic()
            self._own, self._known_once = hello['self'], True
            self._inputs.greet(hello, now)
            extra = [self._alarms.pattern] if self._link.prefix else []
            await socket.send_str(json.dumps(self._inputs.subscription(extra)))
            self._socket = socket
            self._side.report_link(IN, True, '')
            self._outbox.clear()
            if self._link.prefix:
                self._outbox += [self._values.make_meta(name) for name in self._side.bearings]
                self._repeat_alarms(now)
            sender = asyncio.create_task(self._send_outbox(socket))
            try:
                async for message in socket:
                    if message.type is aiohttp.WSMsgType.TEXT:
                        self._on_text(message.data)
            finally:
                sender.cancel()
                self._socket = None
            if socket.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG:
                return f'a frame of more than {_MAX_FRAME_BYTES >> 20} MB was refused here'
            return 'the server closed the connection'

    async def _open_stream(self, session: aiohttp.ClientSession) -> aiohttp.ClientWebSocketResponse:
        """Connect to the stream of the server.

        Raises:
            LinkError: The server refuses, and waiting does not mend it.
            aiohttp.ClientError: The server cannot be reached, or refuses for now; so also OSError.
            asyncio.TimeoutError: It does not answer.
        """
        url = f'{self._link.url}/signalk/v1/stream?subscribe=none&sendMeta=all'
        try:
            return await asyncio.wait_for(
                session.ws_connect(
                    url,
                    headers=self._headers,
                    heartbeat=HEARTBEAT,
                    ssl=self._ssl,
                    max_msg_size=_MAX_FRAME_BYTES,
                ),
                2.0 * HEARTBEAT,
            )
        except aiohttp.ClientConnectorCertificateError as error:
            inner = error.certificate_error
            why = getattr(inner, 'verify_message', '') or str(inner)
            raise _Unusable(
                f"signalk.url = '{self._link.url}': TLS certificate not trusted ({why}): set"
                ' signalk.ca_file to the certificate of its signer'
            ) from error
        except aiohttp.WSServerHandshakeError as error:
            if error.status >= 500 or error.status in _WAIT_FOR:
                raise
            raise _Unusable(self._refusal_text(error.status)) from error

    def _refusal_text(self, status: int) -> str:
        """Return the error text on why the server refuses the stream, by its HTTP status, and what to do."""
        if status in (401, 403) and not self._headers:
            return f"signalk.url = '{self._link.url}' {_NEEDS_TOKEN} ({status})"
        if status in (401, 403):
            problem = 'the token is refused: it is wrong, revoked or expired'
            return f"signalk.token_file = '{self._link.token_file}': {problem} ({status})"
        return f"signalk.url = '{self._link.url}' is not a Signal K server: it answers {status}"

    async def _receive_hello(self, socket: aiohttp.ClientWebSocketResponse) -> dict[str, Any]:
        """Receive the greeting of the server.

        Raises:
            LinkError: It is not a Signal K server, or one that is not safe for actions.
            aiohttp.ClientError: The server closed the connection.
            asyncio.TimeoutError: None came within two :data:`HEARTBEAT`.
        """
        message = await asyncio.wait_for(socket.receive(), 2.0 * HEARTBEAT)
        if message.type is not aiohttp.WSMsgType.TEXT:
            raise aiohttp.ClientError('the server closed the connection without a greeting')
        hello: Any = None
        with suppress(ValueError):
            hello = json.loads(message.data)
        if not is_hello(hello):
            raise _Unusable(
                f"signalk.url = '{self._link.url}' is not a Signal K server: it does not greet as one"
            )
        local = is_loopback(urlsplit(self._link.url).hostname)
        if self._link.accept_actions and version_of(hello) < SAFE_ACTIONS and not local:
            raise _Unusable(
                f'signalk.accept_actions must be false with Signal K server'
                f' {hello["version"]}: before 2.24 it takes an acknowledgement from anybody'
            )
        return hello

    def _repeat_alarms(self, now: float) -> None:
        """Queue all notifications, and note when (``now``, of the steady clock [s])."""
        self._repeated = now
        self._queue_updates(self._alarms.all_updates())

    def _queue_updates(self, updates: Sequence[Update]) -> None:
        """Queue notifications and expect their echo; without a connection they are dropped.

        Of more than 1000 updates that wait the oldest are dropped.
        """
        if self._socket is None or not updates:
            return
        self._outbox.extend(updates)
        self._waiting_since = self._waiting_since or time.monotonic()
        self._wake.set()

    async def _send_outbox(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        """Send updates as they come into the outbox, until cancelled; return when the connection fails."""
        # The reader of the connection reports its loss.
        with suppress(aiohttp.ClientError, OSError):
            while True:
                while self._outbox:
                    await _send_update(socket, self._outbox.popleft())
                self._wake.clear()
                await self._wake.wait()

    def _on_text(self, text: str) -> None:
        """Pass the samples of a frame to the monitor, and with a prefix its echoes to :meth:`_on_echo`.

        What is not JSON is ignored.
        """
        try:
            frame = json.loads(text)
        except (ValueError, RecursionError):
            return
        for sample in self._inputs.take(frame, time.monotonic()):
            self._side.take(*sample)
        if self._link.prefix:
            self._on_echo(frame)

    def _on_echo(self, frame: object) -> None:
        """Handle our alarms in a frame: queue the updates that they require, and pass on people's requests.

        An echo of ours reports the outgoing link as working. Requests are passed on only if the configuration
        accepts actions.
        """
        if self._alarms.is_echoed(frame, self._own):
            self._waiting_since = None
            self._side.report_link(OUT, True, '')
        updates, requests = self._alarms.take_echo(frame, self._own)
        self._queue_updates(updates)
        for request in requests if self._link.accept_actions else ():
            self._side.pass_request(request)

    def take_record(self, record: dict[str, Any]) -> None:
        """Keep the latest record of a bearing; :meth:`tick` sends it once a second."""
        self._records[record['bearing']] = record

    def take_alarms(self, record: dict[str, Any]) -> None:
        """Queue the notifications of the alarms that changed; none without a connection or a prefix."""
        if self._link.prefix:
            self._queue_updates(self._alarms.take_alarms(record))

    def tick(self, is_present: bool) -> None:
        """Have silent paths explained; queue values and repeated alarms when due; report a missing echo.

        Without a connection or a prefix nothing is queued.

        Args:
            is_present: Whether the monitor gives data; that it gives none is sent as a notification.
        """
        now = time.monotonic()
        if self._socket is not None:
            self._explain_silent_paths(now)
        if not self._link.prefix or self._socket is None:
            return
        self._queue_updates(self._alarms.set_monitor_fault('' if is_present else 'No data from the monitor.'))
        if is_present and now - self._sent_values >= SHOW_NS / SECOND_NS:
            self._sent_values = now
            self._outbox += [self._values.make_update(n, self._records.get(n)) for n in self._side.bearings]
            self._wake.set()
        if now - self._repeated >= REPEAT:
            self._repeat_alarms(now)
        if self._waiting_since is not None and now - self._waiting_since >= UNHEARD:
            why = 'is it hung, or does the token lack write permission?'
            text = f'no echo from the server for {UNHEARD:g} s'
            self._side.report_link(OUT, False, f'{text}: {why}' if self._headers else text)

    def _explain_silent_paths(self, now: float) -> None:
        """Start a task for each path that has become silent, which logs the reason.

        ``now`` is of the steady clock [s].
        """
        for item in self._inputs.take_silent(now):
            task = asyncio.create_task(self._log_silence(item))
            self._silence_tasks.add(task)
            task.add_done_callback(self._silence_tasks.discard)

    async def _log_silence(self, item: BusInput) -> None:
        """Ask the server for its present value of an input; log why its path is silent, as a warning.

        A server that does not answer is a reason, too, and raises nothing.
        """
        assert self._session is not None
        url = f'{self._link.url}/signalk/v1/api/vessels/self/{item.path.replace(".", "/")}'
        try:
            limit = aiohttp.ClientTimeout(total=UNHEARD)
            async with self._session.get(url, headers=self._headers, ssl=self._ssl, timeout=limit) as answer:
                status, value = answer.status, await answer.text()
        except (aiohttp.ClientError, OSError, asyncio.TimeoutError) as error:
            status, value = 0, failure_reason(error)
        why = _explain_silence(status, value, bool(self._headers))
        self._side.log.warning(f'{item.label}: no value for {item.max_silence:g} s: {why}')

    async def finish(self) -> None:
        """Send null values and that the monitor was stopped; the alarms stay at the server.

        Without a connection or a prefix nothing is sent; a connection that fails meanwhile is ignored.
        """
        socket = self._socket
        if socket is None or not self._link.prefix:
            return
        updates = [self._values.make_update(name, None) for name in self._side.bearings]
        updates += self._alarms.set_monitor_fault('The monitor was stopped.')
        with suppress(aiohttp.ClientError, OSError):
            for update in updates:
                await _send_update(socket, update)


def _explain_silence(status: int, value: str, has_token: bool) -> str:
    """Return why a path is silent, as a clause, by a server's answer to a request for its value.

    Args:
        status: HTTP status; 0 where there was no answer.
        value: Body of the answer, or the reason why there was none.
        has_token: Whether the request carried a token.
    """
    if status in (401, 403):
        return 'the token may not read' if has_token else f'the server {_NEEDS_TOKEN}'
    if status == 404:
        return 'the server has no such path: nothing sends it'
    document: Any = None
    with suppress(ValueError):
        document = json.loads(value)
    if status == 200 and isinstance(document, dict) and 'timestamp' in document:
        return f'its source is silent; the last value is of {str(document["timestamp"])[:40]}'
    return f'asked for it the server answers {status or value}'


async def _send_update(socket: aiohttp.ClientWebSocketResponse, update: Update) -> None:
    """Send one update, of finite numbers, as a delta; what aiohttp raises passes."""
    await socket.send_str(json.dumps({'updates': [update]}, allow_nan=False))


def failure_reason(error: BaseException) -> str:
    """Return why a connection failed, in the words of the system; 'no answer' where it has none."""
    inner = getattr(error, 'os_error', None) or error
    text = getattr(inner, 'strerror', None) or re.sub(r'ssl:(<[^>]*>|\S+) ?', '', str(inner))
    return text or 'no answer'
