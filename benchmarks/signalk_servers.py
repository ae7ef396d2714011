# SPDX-License-Identifier: Apache-2.0
"""Signal K servers for tests, demo and benchmark: the real one, and a small one."""

from __future__ import annotations

import base64
import hmac
import json
import os
import shutil
import signal
import socket
import ssl
import subprocess
import time
import urllib.request
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

FOLDER = Path(__file__).resolve().parents[1] / 'test' / 'monitor' / 'links' / 'signalk_server'
SHIP = 'vessels.urn:mrn:imo:mmsi:230099999'
_SETTINGS = {
    'vessel': {'name': 'Test', 'mmsi': '230099999'},
    'interfaces': dict.fromkeys(('appstore', 'nmea-tcp', 'tcp', 'applicationData'), False),
    'mdns': False,
    'ssl': False,
    'pipedProviders': [],
}
_KEY = 'of-a-server-that-lives-for-one-test'
_QUIET = {'SKIP_ADMINUI_VERSION_CHECK': '1', 'SIGNALK_DISABLE_SERVER_UPDATES': '1'}


def missing_program() -> str:
    """Return why the real server cannot be started; empty if it can."""
    if shutil.which('node') is None:
        return 'node is not installed (version 20 or later)'
    if not (FOLDER / 'node_modules' / 'signalk-server').is_dir():
        return 'signalk-server is not installed: make signalk-server'
    return ''


def free_port() -> int:
    """Return a port of this machine that is free now."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


def officer_token() -> str:
    """Return the JSON web token of who may approve requests at a secured server with our key."""
    parts = ({'alg': 'HS256', 'typ': 'JWT'}, {'id': 'officer', 'exp': round(time.time()) + 3600})
    head = '.'.join(_encode_base64(json.dumps(part).encode()) for part in parts)
    return f'{head}.{_encode_base64(hmac.digest(_KEY.encode(), head.encode(), "sha256"))}'


def _encode_base64(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).rstrip(b'=').decode()


class RealServer:
    """The real signalk-server, at the loopback address alone.

    Args:
        folder: An empty folder for its configuration.
        secure: Whether whoever writes needs a token.
    """

    def __init__(self, folder: Path, secure: bool = False) -> None:
        self.folder, self.port = folder, free_port()
        self.url = f'http://127.0.0.1:{self.port}'
        settings: dict[str, Any] = dict(_SETTINGS)
        if secure:
            settings['security'] = {'strategy': './tokensecurity'}
            users = [{'username': 'officer', 'type': 'admin', 'password': ''}]
            content = {'users': users, 'secretKey': _KEY, 'allow_readonly': True}
            (folder / 'security.json').write_text(json.dumps(content))
            (folder / 'security.json').chmod(0o600)
        (folder / 'settings.json').write_text(json.dumps(settings))
        self.start()

    def start(self) -> None:
        """Start it, or start it again, and wait until it answers."""
        program = FOLDER / 'node_modules' / 'signalk-server' / 'bin' / 'signalk-server'
        self._process = subprocess.Popen(
            ['node', '--require', str(FOLDER / 'loopback.cjs'), str(program), '-c', self.folder],
            env={**os.environ, **_QUIET, 'PORT': str(self.port)},
            stdout=(self.folder / 'log').open('ab'),
            stderr=subprocess.STDOUT,
        )
        end = time.monotonic() + 60.0
        while not self._is_answering():
            if time.monotonic() > end or self._process.poll() is not None:
                raise RuntimeError((self.folder / 'log').read_text())
            time.sleep(0.1)

    def _is_answering(self) -> bool:
        try:
            urllib.request.urlopen(f'{self.url}/signalk', timeout=5.0).close()
        except OSError:
            return False
        return True

    def signal(self, number: int) -> None:
        """Freeze it (SIGSTOP) or let it go on (SIGCONT)."""
        self._process.send_signal(number)

    def kill(self) -> None:
        """Take it away without a word."""
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        """Stop it."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGCONT)
            self._process.terminate()
            try:
                self._process.wait(10.0)
            except subprocess.TimeoutExpired:
                self.kill()


class SmallServer:
    """Signal K server as far as a client meets it, with every fault it may have.

    Attributes:
        values: The last value of each source and path: value and time stamp.
        status: What people did with each notification, by source and path.
        token: The token that is asked for; empty for none.
        deaf: What is written is dropped in silence, as without the right to write.
        received: Every update that a client sent.
        version: The version that it tells.
        frozen: Pings are not answered.
        greeting: What is sent first in place of the usual greeting.
    """

    def __init__(self) -> None:
        self.values: dict[tuple[str, str], tuple[Any, str]] = {}
        self.status: dict[tuple[str, str], dict[str, bool]] = {}
        self.token, self.deaf, self.version = '', False, '2.27.0'
        self.greeting: str | None = None
        self.frozen = False
        self.received: list[dict[str, Any]] = []
        self.subscriptions: list[Any] = []
        self.requests = ['PENDING', 'COMPLETED']
        self.permission = 'APPROVED'
        self._sockets: list[tuple[web.WebSocketResponse, list[str]]] = []
        self._runner: web.AppRunner | None = None
        self.port = free_port()

    async def start(self, context: ssl.SSLContext | None = None) -> None:
        """Listen, at the same port as before."""
        app = web.Application()
        app.router.add_get('/signalk/v1/stream', self._handle_stream)
        app.router.add_post('/signalk/v1/access/requests', self._handle_request)
        app.router.add_get('/signalk/v1/requests/1', self._handle_request)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        await self._runner.setup()
        await web.TCPSite(self._runner, '127.0.0.1', self.port, ssl_context=context).start()

    async def stop(self) -> None:
        """Close every connection and stop listening."""
        for socket_, _ in list(self._sockets):
            await socket_.close()
        self._sockets.clear()
        if self._runner is not None:
            await self._runner.cleanup()
            self._runner = None

    async def restart(self) -> None:
        """Stop, forget all, and start again."""
        await self.stop()
        self.values.clear()
        self.status.clear()
        await self.start()

    async def _handle_request(self, _: web.Request) -> web.Response:
        state = self.requests.pop(0)
        answer: dict[str, Any] = {'state': state, 'href': '/signalk/v1/requests/1'}
        if state == 'COMPLETED':
            token = {'token': 'eyJ.a.token.of.the.server'} if self.permission == 'APPROVED' else {}
            answer['accessRequest'] = {'permission': self.permission, **token}
        return web.json_response(answer, status=202)

    async def _handle_stream(self, request: web.Request) -> web.WebSocketResponse:
        if self.token and request.headers.get('Authorization') != f'Bearer {self.token}':
            raise web.HTTPUnauthorized
        socket_ = web.WebSocketResponse(autoping=not self.frozen)
        await socket_.prepare(request)
        hello = {'name': 'small', 'version': self.version, 'self': SHIP, 'timestamp': _format_now()}
        await socket_.send_str(json.dumps(hello) if self.greeting is None else self.greeting)
        patterns: list[str] = []
        self._sockets.append((socket_, patterns))
        async for message in socket_:
            if message.type is WSMsgType.TEXT:
                await self._take_frame(socket_, patterns, json.loads(message.data))
        return socket_

    async def _take_frame(
        self, socket_: web.WebSocketResponse, patterns: list[str], frame: dict[str, Any]
    ) -> None:
        for item in frame.get('subscribe', ()):
            self.subscriptions.append(frame)
            patterns.append(item['path'])
        if 'subscribe' in frame:
            for (source, path), (value, stamp) in list(self.values.items()):
                if _is_subscribed(path, patterns):
                    await socket_.send_str(_make_delta(source, path, value, stamp))
        for update in frame.get('updates', ()):
            self.received.append(update)
            for item in () if self.deaf else update.get('values', ()):
                await self.publish(item['path'], item['value'], update['$source'])

    async def publish(
        self, path: str, value: Any, source: str = 'shaft.1', stamp: str = '', context: str = SHIP
    ) -> None:
        """Take a value and tell everybody who asked for its path."""
        if path.startswith('notifications.') and isinstance(value, dict):
            status = self.status.setdefault((source, path), {})
            if value.get('acknowledgeStatus') == 'Yes':
                status['acknowledged'] = True
            if value['state'] == 'normal':
                status.clear()
            value = {**value, 'status': dict(status)}
        stamp = stamp or _format_now()
        if context == SHIP:
            self.values[source, path] = (value, stamp)
        await self.say(_make_delta(source, path, value, stamp, context), path)

    async def act(self, path: str, source: str = 'stickslip_monitor', **status: bool) -> None:
        """Acknowledge or silence a notification, as a person does."""
        self.status[source, path].update(status)
        await self.publish(path, self.values[source, path][0], source)

    async def say(self, text: str, path: str = '') -> None:
        """Send a frame to everybody who asked for a path."""
        for socket_, patterns in list(self._sockets):
            if not socket_.closed and (not path or _is_subscribed(path, patterns)):
                await socket_.send_str(text)


def _is_subscribed(path: str, patterns: list[str]) -> bool:
    return any(path == p or (p.endswith('*') and path.startswith(p[:-1])) for p in patterns)


def _make_delta(source: str, path: str, value: Any, stamp: str, context: str = SHIP) -> str:
    values = [{'path': path, 'value': value}]
    return json.dumps(
        {'context': context, 'updates': [{'$source': source, 'timestamp': stamp, 'values': values}]}
    )


def _format_now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec='milliseconds').replace('+00:00', 'Z')
