# SPDX-License-Identifier: Apache-2.0
"""The page, its stream of events, its one way to act, and the figures for Prometheus."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.typedefs import Handler

from stickslip_monitor.dashboard.access import (
    MAX_CONNECTIONS,
    MAX_IDLE,
    Access,
    Connections,
    add_headers,
    cookie_name,
)
from stickslip_monitor.dashboard.metrics import Metrics
from stickslip_monitor.dashboard.page_records import OFFERED
from stickslip_monitor.dashboard.seen_monitors import SILENT, DashboardState
from stickslip_monitor.errors import ConfigurationError, DashboardError, StickslipError, cause
from stickslip_monitor.host import end_signals
from stickslip_monitor.monitor.alarm_records import ActionRequest, parse_request
from stickslip_monitor.monitor.value_check import Parameter

if TYPE_CHECKING:
    from stickslip_monitor.dashboard.replay import Replay

T = TypeVar('T')

HEARTBEAT = 5.0
"""A stream is never silent for longer [s], so that both ends notice when the other has gone."""
MAX_STALL = MAX_IDLE
"""A reader that takes nothing for so long is let go [s]."""
SWEEP = 0.1
"""Time between two checks for connections on which nothing is asked [s]."""
ACTION_TIMEOUT = SILENT
"""How long an action may take [s]."""
MAX_REQUEST_BYTES = 4096
"""Content of a request [bytes]: an action with its reason has some hundred."""
SESSION = timedelta(days=30)
"""A browser keeps a session for so long [s]."""
_JSON = 'application/json'
REQUEST_TIMEOUT = 10.0
"""How long the content of a request may take to come [s]."""
_PAGE = Path(__file__).parent / 'page'
MAX_READERS = 200
"""Streams of events that are open at once."""
RESERVED_READERS = 12
"""Of these so many are reserved for people who have signed in, however many programs listen."""


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
        """Queue an event for this reader; it replaces a waiting one with the same key."""
        self._waiting.pop(key, None)
        self._waiting[key] = event
        self._something.set()

    def close(self) -> None:
        """End the stream."""
        self.closed = True
        self._something.set()

    async def take(self) -> bytes:
        """Wait for an event or the end; remove and return all waiting events as one piece of the stream.

        The piece is empty where the stream was closed with none waiting.
        """
        await self._something.wait()
        self._something.clear()
        events, self._waiting = self._waiting, {}
        return b''.join(events.values())


class Hub:
    """Hands events to every reader."""

    def __init__(self) -> None:
        self.readers: set[Reader] = set()

    def join(self, signed_in: bool = True) -> Reader:
        """Add a reader to those there are, up to :data:`MAX_READERS`; some places are for the signed in.

        ``signed_in`` says whether it has signed in at the page.

        Raises:
            DashboardError: There is no place left for this reader.
        """
        max_readers = MAX_READERS if signed_in else MAX_READERS - RESERVED_READERS
        if len(self.readers) >= max_readers:
            raise DashboardError(f'{max_readers} pages are open already; close one')
        reader = Reader()
        self.readers.add(reader)
        return reader

    def leave(self, reader: Reader) -> None:
        """Remove a reader that has gone."""
        self.readers.discard(reader)

    async def close(self, _: web.Application) -> None:
        """End all streams; called as the application shuts down."""
        for reader in self.readers:
            reader.close()

    def send(self, kind: str, document: dict[str, Any], key: str = '') -> None:
        """Queue an event for every reader.

        Args:
            kind: Name of the event.
            document: Its content.
            key: Tells it from others of its kind; a later one with the same key replaces it.
        """
        event = encode_event(kind, document)
        for reader in self.readers:
            reader.put(f'{kind} {key}', event)


def encode_event(kind: str, document: dict[str, Any]) -> bytes:
    """Encode an event of a kind, with a document of finite numbers as its JSON, as a server-sent event."""
    data = json.dumps(document, allow_nan=False, separators=(',', ':'))
    return f'event: {kind}\ndata: {data}\n\n'.encode()


class Server:
    """The dashboard's handlers.

    Args:
        board: What is shown; its ``send`` becomes that of the hub.
        access: Who may see and do what.
        player: What plays the recording; ``None`` but for a replay.
    """

    def __init__(self, board: DashboardState, access: Access, player: Replay | None = None) -> None:
        self._board, self._access, self._player = board, access, player
        self.hub = Hub()
        board.send = self.hub.send
        self._metrics = Metrics(board, self.hub.readers)
        self._connections = Connections(MAX_CONNECTIONS, MAX_IDLE)
        self._listening: asyncio.Server | None = None

    def application(self) -> web.Application:
        """Return a new web application with the pages, all handlers, and the rules of access.

        Its shutdown ends all streams.
        """
        app = web.Application(
            middlewares=[self._connections.count, self._access.guard], client_max_size=MAX_REQUEST_BYTES
        )
        app.add_routes(
            [
                web.get('/', _serve_file('page.html')),
                web.get('/login', _serve_file('login.html')),
                web.post('/login', self._log_in),
                web.post('/logout', self._log_out),
                web.get('/events', self._stream_events, allow_head=False),
                web.post('/act', self._carry_out),
                web.get('/metrics', self._send_metrics),
                web.get('/history', self._send_history),
                web.get('/log.csv', self._send_log),
                *([web.post('/replay', self._steer_replay)] if self._player is not None else []),
                web.static('/', _PAGE),
            ]
        )
        app.on_response_prepare.append(add_headers)
        app.on_shutdown.append(self.hub.close)
        return app

    async def listen(self, address: str, port: int) -> asyncio.Server:
        """Listen at an address, and end idle connections, until :meth:`close`; return what listens.

        Port 0 stands for any that is free. There is no access log, which would fill up with a line for every
        scrape and says who reads what; what is not HTTP, as a port scan sends it, is not logged either.

        Raises:
            DashboardError: The address cannot be listened at.
        """
        log, loop = logging.getLogger(f'{__name__}.http'), asyncio.get_running_loop()
        log.addFilter(lambda r: not (r.exc_info and isinstance(r.exc_info[1], HttpProcessingError)))
        self._runner = web.AppRunner(self.application(), access_log=None, shutdown_timeout=2.0, logger=log)
        await self._runner.setup()
        protocols = self._runner.server
        assert protocols is not None
        try:
            listening = await loop.create_server(protocols, address, port, backlog=128)
        except (OSError, OverflowError) as error:
            raise DashboardError(f'cannot listen at {address} port {port}: {cause(error)}') from error

        def sweep() -> None:
            """End idle connections, and call this again while the server listens."""
            self._connections.sweep(protocols.connections)
            if listening.is_serving():
                loop.call_later(SWEEP, sweep)

        sweep()
        self._listening = listening
        return listening

    async def close(self) -> None:
        """Stop listening, end all streams, and wait up to two seconds for answers that are on their way.

        Call :meth:`listen` first.
        """
        if self._listening is not None:
            self._listening.close()
        await self._runner.cleanup()

    async def serve(self, address: str, port: int, started: Callable[[str], None]) -> None:
        """Listen, and serve until a signal comes, with a tick of the board each half second; then close.

        ``started`` is called with the page's address.

        Raises:
            DashboardError: The address cannot be listened at.
        """
        stop = asyncio.Event()
        for number in end_signals():
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        try:
            listening = await self.listen(address, port)
            host, bound_port = listening.sockets[0].getsockname()[:2]
            started(f'http://[{host}]:{bound_port}/' if ':' in host else f'http://{host}:{bound_port}/')
            while not stop.is_set():
                self._board.tick()
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(stop.wait(), 0.5)
        finally:
            await self.close()

    async def _log_in(self, request: web.Request) -> web.Response:
        """Redirect the right token, with the cookie of a session, to the page, a wrong one back to the form.

        The answer is 303, or 408 where the form does not come whole in time.
        """
        try:
            form = await asyncio.wait_for(request.post(), REQUEST_TIMEOUT)
        except asyncio.TimeoutError:
            return web.Response(status=408, text='The form did not come whole in time.\n')
        if not self._access.is_token(str(form.get('token', ''))):
            return web.Response(status=303, headers={'Location': 'login?wrong'})
        response = web.Response(status=303, headers={'Location': './'})
        rules: dict[str, Any] = {'httponly': True, 'samesite': 'Strict', 'secure': request.secure}
        response.set_cookie(
            cookie_name(request), self._access.make_cookie(), max_age=round(SESSION.total_seconds()), **rules
        )
        return response

    async def _log_out(self, request: web.Request) -> web.Response:
        """End the session of a request; answer 204, and have the browser delete its cookie."""
        self._access.end_session(request)
        response = web.Response(status=204)
        response.del_cookie(cookie_name(request))
        return response

    async def _stream_events(self, request: web.Request) -> web.StreamResponse:
        """Stream the state of the page, and then its changes, until the reader leaves, stalls or is closed.

        A heartbeat fills pauses. The answer is 503 where there are too many readers.
        """
        try:
            reader = self.hub.join(not self._access.token or self._access.is_signed_in(request))
        except DashboardError as error:
            return web.Response(status=503, text=f'{error}\n')
        # nginx would keep events until its buffer is full.
        headers = {'Cache-Control': 'no-store', 'X-Accel-Buffering': 'no'}
        response = web.StreamResponse(headers={'Content-Type': 'text/event-stream', **headers})
        try:
            await response.prepare(request)
            # One that comes back needs no history: it gets all that is shown, which is bounded.
            state = self._board.state() | {'signed_in': self._access.is_signed_in(request)}
            event = b'retry: 1000\n\n' + encode_event('state', state)
            while not reader.closed:
                await asyncio.wait_for(response.write(event), MAX_STALL)
                try:
                    event = await asyncio.wait_for(reader.take(), HEARTBEAT)
                except asyncio.TimeoutError:
                    event = encode_event('beat', self._board.presence())
        except (ConnectionError, asyncio.TimeoutError):
            if request.transport is not None:
                request.transport.abort()
        finally:
            self.hub.leave(reader)
        return response

    async def _carry_out(self, request: web.Request) -> web.Response:
        """Carry out an action; answer 200 with the number of alarms that it changed.

        The answer is 409 where there was nothing to do or no answer came within :data:`ACTION_TIMEOUT`, 503
        where the monitor cannot be reached; 400, 408, 413 or 415 to an invalid request
        (:func:`_read_request`).
        """
        action_request = await _read_request(request, self._parse_action)
        try:
            count = await self._board.ask(action_request, ACTION_TIMEOUT)
        except DashboardError as error:
            return _make_answer(409, str(error))
        except StickslipError as error:
            return _make_answer(503, str(error))
        return _make_answer(200, f'{action_request.action}: {count} alarm{"s" if count != 1 else ""}')

    def _parse_action(self, document: Any) -> ActionRequest:
        """Return the request to act in a JSON document.

        Raises:
            ConfigurationError: It is invalid, names an unknown bearing, or its action is not offered here.
        """
        action_request = parse_request(document, self._board.bearings)
        if action_request.action not in OFFERED:
            raise ConfigurationError(f'{action_request.action} is not for a dashboard')
        return action_request

    async def _steer_replay(self, request: web.Request) -> web.Response:
        """Pause, resume or move the replay as a request asks; answer 200.

        To an invalid request it is 400, 408, 413 or 415 (:func:`_read_request`).
        """
        assert self._player is not None
        paused, place = await _read_request(request, _parse_course)
        if paused is not None:
            self._player.set_paused(paused)
        if place is not None:
            self._player.seek(place)
        return _make_answer(200, '')

    async def _send_history(self, request: web.Request) -> web.Response:
        """Answer with the history of the bearing in the query as JSON; 404 for an unknown one."""
        history = self._board.history(request.query.get('bearing', ''))
        if history is None:
            return web.Response(status=404, text='There is no such bearing.\n')
        return web.json_response(history)

    async def _send_log(self, _: web.Request) -> web.Response:
        """Answer with the whole log of events as a file of CSV."""
        headers = {'Content-Disposition': 'attachment; filename="stickslip_alarms.csv"'}
        text, kind = self._board.log.to_csv(), 'text/csv'
        return web.Response(text=text, content_type=kind, charset='utf-8', headers=headers)

    async def _send_metrics(self, request: web.Request) -> web.Response:
        """Answer with the figures for Prometheus, in the form that the request accepts."""
        body, kind = self._metrics.text(request.headers.get('Accept', ''))
        return web.Response(body=body, headers={'Content-Type': kind})


def _serve_file(name: str) -> Handler:
    """Make a handler that answers with a file of the page."""

    async def serve(_: web.Request) -> web.StreamResponse:
        """Answer with the file."""
        return web.FileResponse(_PAGE / name)

    return serve


async def _read_request(request: web.Request, read: Callable[[Any], T]) -> T:
    """Return the JSON document of a request as ``read`` parses it.

    Raises:
        web.HTTPException: The answer to a request that is not JSON (415 by its type, else 400), that ``read``
            refuses with a ``ValueError`` (400), that is too large (413), or that does not come whole within
            :data:`REQUEST_TIMEOUT` (408).
    """
    if request.content_type != 'application/json':
        raise web.HTTPUnsupportedMediaType(text='a request must be application/json\n')
    try:
        return read(json.loads(await asyncio.wait_for(request.read(), REQUEST_TIMEOUT)))
    except asyncio.TimeoutError as error:
        why = 'the request did not come whole in time: nothing was done'
        raise web.HTTPRequestTimeout(text=_answer_text(False, why), content_type=_JSON) from error
    except (ValueError, RecursionError) as error:
        raise web.HTTPBadRequest(text=_answer_text(False, str(error)), content_type=_JSON) from error


def _parse_course(document: Any) -> tuple[bool | None, float | None]:
    """Parse a request to steer a replay.

    Returns:
        Whether to pause it, and the time since the beginning to go to [s]; ``None`` to leave it as it is.

    Raises:
        ConfigurationError: The request is invalid.
    """
    if not isinstance(document, dict):
        raise ConfigurationError('a request must be a JSON object')
    given = {name: value for name, value in document.items() if value is not None}
    rows = Parameter('paused', 'bool', None, ''), Parameter('at', 'float', None, '', 's')
    paused, place = (row.checked(row.name, given) for row in rows)
    return paused, place


def _answer_text(done: bool, text: str) -> str:
    """Return the JSON of an answer: whether the request was carried out, and a sentence."""
    return json.dumps({'ok': done, 'text': text})


def _make_answer(code: int, text: str) -> web.Response:
    """Return an answer of JSON with an HTTP status; only 200 says that the request was carried out."""
    return web.Response(text=_answer_text(code == 200, text), status=code, content_type=_JSON)
