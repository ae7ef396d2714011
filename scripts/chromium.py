# SPDX-License-Identifier: Apache-2.0
"""A page in a real Chromium, by its DevTools protocol: for pictures, benchmarks and tests."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import aiohttp

COMMAND = [
    *('chromium', '--headless=new', '--no-sandbox', '--disable-gpu', '--no-first-run'),
    *('--disable-dev-shm-usage', '--disable-background-networking', '--hide-scrollbars'),
    *('--remote-debugging-port=0', 'about:blank'),
]
PATIENCE = 120.0


@contextmanager
def run_program(command: list[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a program that ends with the block."""
    started = subprocess.Popen(command, text=True, **options)
    try:
        yield started
    finally:
        started.terminate()
        started.wait(20.0)


@contextmanager
def run_chromium() -> Iterator[int]:
    """Run a browser until the block ends and yield the port of its protocol."""
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        run_program([*COMMAND, f'--user-data-dir={folder}'], stderr=subprocess.PIPE) as browser,
    ):
        assert browser.stderr is not None
        ready = (re.search(r'DevTools listening on ws://[^:]+:(\d+)', line) for line in browser.stderr)
        yield next(int(match[1]) for match in ready if match)


class Page:
    """A page, asked one thing after the other.

    Attributes:
        events: What the browser reported meanwhile.
    """

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._number = socket, 0
        self.events: list[dict[str, Any]] = []

    async def call(self, method: str, **parameters: Any) -> Any:
        """Ask for something, and return the answer."""
        self._number += 1
        await self._socket.send_json({'id': self._number, 'method': method, 'params': parameters})
        while True:
            answer = await self._socket.receive_json(timeout=PATIENCE)
            if answer.get('id') == self._number:
                assert 'error' not in answer, (method, answer)
                return answer['result']
            self.events.append(answer)

    async def js(self, expression: str) -> Any:
        """Return the value of an expression after waiting for its promise."""
        request = {'expression': expression, 'returnByValue': True, 'awaitPromise': True}
        answer = await self.call('Runtime.evaluate', **request)
        assert 'exceptionDetails' not in answer, answer
        return answer['result'].get('value')

    async def show_as(self, width: int, height: int, *, dark: bool = False, mobile: bool = False) -> None:
        """Take on the size of a device, and its choice of colours."""
        size = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': mobile}
        await self.call('Emulation.setDeviceMetricsOverride', **size)
        colours = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        await self.call('Emulation.setEmulatedMedia', features=[colours])

    async def choose(self, name: str, value: str) -> None:
        """Choose a value of one of the page's settings, by a selector."""
        await self.js(
            f'{{ const choice = document.querySelector({name!r}); choice.value = {value!r};'
            " choice.dispatchEvent(new Event('change')); }"
        )


@asynccontextmanager
async def first_page(port: int) -> AsyncIterator[Page]:
    """Return the only page of a browser that has just started."""
    async with aiohttp.ClientSession() as session:
        async with session.get(f'http://127.0.0.1:{port}/json') as answer:
            (tab,) = [tab for tab in await answer.json() if tab['type'] == 'page']
        async with session.ws_connect(tab['webSocketDebuggerUrl'], max_msg_size=0) as socket:
            yield Page(socket)
