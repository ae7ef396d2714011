# SPDX-License-Identifier: Apache-2.0
"""A dashboard whose monitor is the test's own, and a real browser to look at it with."""

from __future__ import annotations

import asyncio
import json
import shutil
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from sending import SECOND, Ship
from shared import CONFIG, DEADLINE, until

BEARING = 'aft_stern'


class PageShip(Ship):
    """A ship that a page shows; it takes what people ask for there."""

    def __init__(self, watched: Any) -> None:
        from stickslip_monitor.monitor.parameter_file import load_config

        self.watched, self.deaf = watched, False
        self.requests: list[Any] = []
        super().__init__(load_config(CONFIG), display=watched)
        # However long the machine is held up, the monitor is heard.
        watched.act, watched._clock = self.act, lambda: self.steady_ns / SECOND

    def sail(self, rpm: float, load: float, seconds: float = 1.0) -> None:  # type: ignore[override]
        """Sail for some seconds at an operating point, with a sample of each input a second."""
        super().sail(max(round(seconds), 1), rpm, load, rate=1.0)

    def wait(self, seconds: float) -> None:
        """Let some seconds pass without a sample."""
        self.steady_ns += round(seconds * SECOND)
        self.tick()
        self.look()

    def fall_silent(self, seconds: float) -> None:
        """Let some seconds pass without a record."""
        self.steady_ns += round(seconds * SECOND)

    def act(self, request: Any) -> None:
        """Do what is asked for."""
        self.requests.append(request)
        if not self.deaf:
            self.session.act(request)


class Dashboard:
    """The real server in a thread of its own; what touches the board is done there."""

    def __init__(
        self,
        token: str = '',
        port: int = 0,
        nodes: tuple[str, ...] = ('/stickslip_monitor',),
        player: Any = None,
    ) -> None:
        from stickslip_monitor.commands.dashboard import make_watched_monitor
        from stickslip_monitor.dashboard.access import Access
        from stickslip_monitor.dashboard.seen_monitors import DashboardState
        from stickslip_monitor.dashboard.server import Server
        from stickslip_monitor.monitor.parameter_file import load_config

        self._loop = asyncio.new_event_loop()
        config = load_config(CONFIG)
        self.board = DashboardState([make_watched_monitor(config, node, node) for node in nodes])
        self.ships = [PageShip(monitor) for monitor in self.board.monitors]
        self.ship = self.ships[0]
        access = Access(token, frozenset({'ship.test'}))
        self.server = Server(self.board, access, player)
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        listening = self.run(self.server.listen('127.0.0.1', port))
        self.socket = listening.sockets[0]
        self.port = self.socket.getsockname()[1]
        self.url = f'http://127.0.0.1:{self.port}/'

    def run(self, work: Any) -> Any:
        """Run a coroutine on the server's loop."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(DEADLINE)

    def do(self, action: Callable[[], Any]) -> Any:
        """Call something on the server's loop."""

        async def call() -> Any:
            return action()

        return self.run(call())

    def sail(self, rpm: float, load: float, seconds: float = 1.0) -> None:
        self.do(lambda: self.ship.sail(rpm, load, seconds))

    def stop(self) -> None:
        if self._loop.is_running():
            self.run(self.server.close())
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()


@pytest.fixture
def dashboards(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Dashboard]]:
    """Starts dashboards; they are stopped when the test ends."""
    pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")
    pytest.importorskip('prometheus_client', reason="the extra 'dashboard' is not installed")
    started: list[Dashboard] = []
    server = 'stickslip_monitor.dashboard.server'
    monkeypatch.setattr(f'{server}.HEARTBEAT', 0.3)

    def start(**options: Any) -> Dashboard:
        for name in options.keys() & {'MAX_IDLE', 'MAX_CONNECTIONS', 'MAX_STALL'}:
            monkeypatch.setattr(f'{server}.{name}', options.pop(name))
        started.append(Dashboard(**options))
        return started[-1]

    yield start
    for dashboard in started:
        dashboard.stop()


@pytest.fixture
def dashboard(dashboards: Callable[..., Dashboard]) -> Dashboard:
    """Return a dashboard at work, without a token."""
    return dashboards()


class Browser:
    """A page in a real Chromium, asked from a test that waits for each answer."""

    def __init__(self, page: Any, run: Callable[[Any], Any]) -> None:
        self._page, self._run = page, run
        for domain in ('Page', 'Runtime', 'Log', 'Accessibility'):
            self.call(f'{domain}.enable')

    @property
    def complaints(self) -> list[str]:
        """Complaints of the console, the page's policy and its code."""
        return [text for event in self._page.events if (text := complaint_of(event))]

    def forget(self) -> None:
        """Clear the complaints."""
        self._page.events.clear()

    def call(self, method: str, **parameters: Any) -> Any:
        """Ask the browser for something."""
        return self._run(self._page.call(method, **parameters))

    def open(self, url: str) -> None:
        self.call('Page.navigate', url=url)

    def js(self, expression: str) -> Any:
        """Return the value of an expression; a promise is waited for."""
        return self._run(self._page.js(expression))

    def until(self, expression: str, deadline: float = DEADLINE) -> Any:
        """Wait until an expression is true."""
        # A page that is just being opened has nothing yet to look at.
        look = f'(() => {{ try {{ return !!({expression}); }} catch {{ return false; }} }})()'
        return until(lambda: self.js(look), expression, deadline)

    def choose(self, name: str, value: str) -> None:
        """Choose a value of one of the page's settings."""
        self._run(self._page.choose(f'#{name}', value))

    def text(self, selector: str) -> str:
        return str(self.js(f'document.querySelector({json.dumps(selector)})?.textContent ?? ""'))

    def click(self, selector: str) -> None:
        self.js(f'document.querySelector({json.dumps(selector)}).click()')

    def press(self, *keys: str) -> None:
        """Press keys one after the other."""
        codes = {'Tab': 9, 'Enter': 13, ' ': 32, 'Escape': 27, 'ArrowLeft': 37, 'Home': 36}
        for key in keys:
            stroke = {'key': key, 'code': 'Space' if key == ' ' else key}
            stroke |= {'windowsVirtualKeyCode': codes[key]}
            text = {'Enter': '\r', ' ': ' '}.get(key)
            down = stroke if text is None else stroke | {'text': text}
            self.call('Input.dispatchKeyEvent', type='keyDown', **down)
            self.call('Input.dispatchKeyEvent', type='keyUp', **stroke)

    def type(self, text: str) -> None:
        self.call('Input.insertText', text=text)

    def show_as(self, width: int, height: int, dark: bool = False, mobile: bool = False) -> None:
        """Take on the size of a device, and its choice of colours."""
        self._run(self._page.show_as(width, height, dark=dark, mobile=mobile))


def complaint_of(event: dict[str, Any]) -> str:
    kind, parameters = event.get('method'), event.get('params', {})
    if kind == 'Runtime.exceptionThrown':
        return json.dumps(parameters['exceptionDetails'])
    if kind == 'Log.entryAdded' and parameters['entry']['level'] in ('error', 'warning'):
        return f'{parameters["entry"]["text"]} {parameters["entry"].get("url", "")}'
    if kind == 'Runtime.consoleAPICalled' and parameters['type'] in ('error', 'warning', 'assert'):
        return json.dumps(parameters['args'])
    return ''


@pytest.fixture(scope='session')
def _shared_browser() -> Iterator[Browser]:
    if shutil.which('chromium') is None:
        pytest.skip('Chromium is not installed (apt install chromium)')
    pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")
    from scripts.chromium import first_page, run_chromium

    loop = asyncio.new_event_loop()
    with run_chromium() as port:
        opened = first_page(port)
        yield Browser(loop.run_until_complete(opened.__aenter__()), loop.run_until_complete)
        loop.run_until_complete(opened.__aexit__(None, None, None))
    loop.close()


@pytest.fixture
def browser(_shared_browser: Browser) -> Iterator[Browser]:
    """Yield the browser, with a page for the test and no complaints."""
    _shared_browser.forget()
    _shared_browser.show_as(1280, 900)
    yield _shared_browser
    _shared_browser.open('about:blank')
