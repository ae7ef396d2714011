# SPDX-License-Identifier: Apache-2.0
"""Takes docs/images/dashboard.png again: the dashboard by day, and on a phone at night.

Needs Chromium, and the extras dashboard and report (Pillow comes with matplotlib).
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
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp
from PIL import Image
from PIL.PngImagePlugin import PngInfo

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / 'docs' / 'images' / 'dashboard.png'
COMMAND = [
    *(sys.executable, '-m', 'stickslip_monitor.cli', 'dashboard', '--port', '0', '--rate', '10'),
    *('--config', str(ROOT / 'launch_configs' / 'reference_bearing.yaml')),
    *('--bag', 'bags/coast_down'),
]
CHROMIUM = [
    *('chromium', '--headless=new', '--no-sandbox', '--disable-gpu', '--hide-scrollbars'),
    *('--remote-debugging-port=0', 'about:blank'),
]
DESK, PHONE, GAP = 1270, 390, 30
# A little after stick-slip is predicted, the trail is long enough to see.
LOOK = "document.body.innerText.includes('ALARM')"
AFTERWARDS = 2.5
SAID = "[...document.querySelectorAll('#log small')].map((e) => e.textContent)"


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

    async def picture(self, width: int, height: int, theme: str) -> Image.Image:
        """The page at a size, in a light, from its top; height 0 for all of it."""
        await self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height or 900,
            deviceScaleFactor=1,
            mobile=False,
        )
        await self.js(
            f"{{ const t = document.getElementById('theme'); t.value = {json.dumps(theme)};"
            " t.dispatchEvent(new Event('change')); }"
        )
        await asyncio.sleep(0.5)
        tall = height or await self.js('document.documentElement.scrollHeight')
        clip = {'x': 0, 'y': 0, 'width': width, 'height': tall, 'scale': 1}
        shot = await self.call('Page.captureScreenshot', clip=clip, captureBeyondViewport=True)
        return Image.open(io.BytesIO(base64.b64decode(shot['data']))).convert('RGB')


async def take(url: str, port: int) -> tuple[Image.Image, list[str]]:
    """Both views of the page, side by side, and the sentences of its log."""
    async with aiohttp.ClientSession() as session:
        async with session.get(f'http://127.0.0.1:{port}/json') as answer:
            (tab,) = [tab for tab in await answer.json() if tab['type'] == 'page']
        async with session.ws_connect(tab['webSocketDebuggerUrl'], max_msg_size=0) as socket:
            page = Page(socket)
            await page.call('Page.navigate', url=url)
            while not await page.js(LOOK):
                await asyncio.sleep(0.1)
            await asyncio.sleep(AFTERWARDS)
            said = await page.js(SAID)
            desk = await page.picture(DESK, 0, 'day')
            phone = await page.picture(PHONE, desk.height, 'night')
    both = Image.new('RGB', (DESK + GAP + PHONE, desk.height), 'white')
    both.paste(desk, (0, 0))
    both.paste(phone, (DESK + GAP, 0))
    return both, said


def main() -> int:
    """Start the dashboard and the browser, and take the picture."""
    with (
        program(COMMAND, stdout=subprocess.PIPE) as dashboard,
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        program([*CHROMIUM, f'--user-data-dir={folder}'], stderr=subprocess.PIPE) as browser,
    ):
        assert dashboard.stdout is not None
        assert browser.stderr is not None
        url = dashboard.stdout.readline().split()[-1]
        ready = (re.search(r'DevTools listening on ws://[^:]+:(\d+)', s) for s in browser.stderr)
        port = next(int(found[1]) for found in ready if found)
        picture, said = asyncio.run(take(url, port))
        # What a test compares with what the program says now.
        told = PngInfo()
        told.add_text('Description', json.dumps(said))
        picture.quantize(256).save(PICTURE, optimize=True, pnginfo=told)
    print(f'{PICTURE.relative_to(ROOT)} is new')
    return 0


if __name__ == '__main__':
    sys.exit(main())
