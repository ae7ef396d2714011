# SPDX-License-Identifier: Apache-2.0
"""Takes the pictures of docs/images again that show what the commands make of recordings.

Page and report stand beside themselves on a phone at night; map and timeline are files that the
commands write. Needs Chromium, and the extras dashboard and report (Pillow comes with matplotlib).
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import aiohttp
from PIL import Image
from PIL.PngImagePlugin import PngInfo

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / 'docs' / 'images'
STICKSLIP = 'stickslip_monitor.cli'
CONFIG = ('--config', 'launch_configs/reference_bearing.yaml')
BAG = 'bags/coast_down'
PACE = ('--rate', '10', '--port', '0')
CHROMIUM = [
    *('chromium', '--headless=new', '--no-sandbox', '--disable-gpu', '--hide-scrollbars'),
    *('--remote-debugging-port=0', 'about:blank'),
]
DESK, PHONE, GAP = 1270, 390, 30
REPORT_DESK, REPORT_PHONE, REPORT_HEIGHT = 740, 340, 1406
# A little after stick-slip is predicted, the trail is long enough to see.
LOOK = "document.body.innerText.includes('ALARM')"
AFTERWARDS = 2.5
SAID = "[...document.querySelectorAll('#log small')].map((e) => e.textContent)"
CHOOSE = (
    '{{ const choice = document.querySelector({!r}); choice.value = {!r};'
    " choice.dispatchEvent(new Event('change')); }}"
)


@contextmanager
def program(command: list[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A program that ends with the block."""
    started = subprocess.Popen(command, text=True, cwd=ROOT, **options)
    try:
        yield started
    finally:
        started.terminate()
        started.wait(20.0)


class Page:
    """A page in Chromium, by its debugging protocol."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._number = socket, 0

    async def call(self, method: str, **parameters: Any) -> Any:
        """Ask for something, and return the answer."""
        self._number += 1
        request = {'id': self._number, 'method': method, 'params': parameters}
        await self._socket.send_json(request)
        while True:
            answer = await self._socket.receive_json(timeout=30.0)
            if answer.get('id') == self._number:
                return answer['result']

    async def js(self, expression: str) -> Any:
        """The value of an expression."""
        answer = await self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        return answer['result'].get('value')

    async def choose(self, selector: str, value: str) -> None:
        """Choose a value of one of the page's settings."""
        await self.js(CHOOSE.format(selector, value))

    async def picture(self, width: int, height: int = 0, dark: bool = False) -> Image.Image:
        """The page at a size, from its top; height 0 for all of it."""
        size = {'width': width, 'height': height or 900, 'deviceScaleFactor': 1, 'mobile': False}
        await self.call('Emulation.setDeviceMetricsOverride', **size)
        colours = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        await self.call('Emulation.setEmulatedMedia', features=[colours])
        await asyncio.sleep(0.5)
        tall = height or await self.js('document.documentElement.scrollHeight')
        clip = {'x': 0, 'y': 0, 'width': width, 'height': tall, 'scale': 1}
        shot = await self.call('Page.captureScreenshot', clip=clip, captureBeyondViewport=True)
        return Image.open(io.BytesIO(base64.b64decode(shot['data']))).convert('RGB')


async def take(port: int, page_url: str, report_url: str) -> None:
    """Take page and report in the browser at a port."""
    async with aiohttp.ClientSession() as session:
        async with session.get(f'http://127.0.0.1:{port}/json') as answer:
            (tab,) = [tab for tab in await answer.json() if tab['type'] == 'page']
        async with session.ws_connect(tab['webSocketDebuggerUrl'], max_msg_size=0) as socket:
            page = Page(socket)
            await page.call('Page.navigate', url=page_url)
            while not await page.js(LOOK):
                await asyncio.sleep(0.1)
            await asyncio.sleep(AFTERWARDS)
            await page.js("document.getElementById('hold').click()")
            # What a test compares with what the program says now.
            said = json.dumps(await page.js(SAID))
            await page.choose('.charts select', '180')
            await page.choose('#theme', 'day')
            desk = await page.picture(DESK)
            await page.choose('#theme', 'night')
            save(desk, await page.picture(PHONE, desk.height), 'dashboard.png', said)
            await page.call('Page.navigate', url=report_url)
            desk = await page.picture(REPORT_DESK, REPORT_HEIGHT)
            save(desk, await page.picture(REPORT_PHONE, REPORT_HEIGHT, dark=True), 'report.png')


def save(desk: Image.Image, phone: Image.Image, name: str, said: str = '') -> None:
    """Save two views side by side, with what is said on them."""
    both = Image.new('RGB', (desk.width + GAP + phone.width, desk.height), 'white')
    both.paste(desk, (0, 0))
    both.paste(phone, (desk.width + GAP, 0))
    told = PngInfo()
    told.add_text('Description', said)
    both.save(IMAGES / name, optimize=True, pnginfo=told)
    print(f'docs/images/{name} is new')


def run(*command: str) -> None:
    """Run a command that ends; it may find what warns, which is what is shown."""
    done = subprocess.run([sys.executable, '-m', *command], cwd=ROOT, stdout=subprocess.DEVNULL)
    if done.returncode not in (0, 1):
        raise SystemExit(f'{" ".join(command)} ended with {done.returncode}')


def main() -> int:
    """Run the commands, start the dashboard and the browser, and take the pictures."""
    run(STICKSLIP, 'map', *CONFIG, '--track', BAG, '--output', str(IMAGES / 'coast_down_map.png'))
    run('benchmarks.score', 'bags/manoeuvring', *CONFIG, '--picture', str(IMAGES / 'manoeuvring.png'))
    page = [sys.executable, '-m', STICKSLIP, 'dashboard', *CONFIG, '--bag', BAG, *PACE]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, ExitStack() as programs:
        report = Path(folder) / 'report.html'
        run(STICKSLIP, 'check', BAG, *CONFIG, '--report', str(report))
        chromium = [*CHROMIUM, f'--user-data-dir={folder}']
        browser = programs.enter_context(program(chromium, stderr=subprocess.PIPE))
        dashboard = programs.enter_context(program(page, stdout=subprocess.PIPE))
        assert browser.stderr is not None
        ready = (re.search(r'DevTools listening on ws://[^:]+:(\d+)', s) for s in browser.stderr)
        port = next(int(found[1]) for found in ready if found)
        assert dashboard.stdout is not None
        url = dashboard.stdout.readline().split()[-1]
        asyncio.run(take(port, url, report.as_uri()))
    return 0


if __name__ == '__main__':
    sys.exit(main())
