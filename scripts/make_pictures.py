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
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.chromium import Page, first_page, run_chromium, run_program

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / 'docs' / 'images'
STICKSLIP = 'stickslip_monitor.cli'
CONFIG = ('--config', 'launch_configs/reference_bearing.yaml')
BAG = 'bags/coast_down'
PACE = ('--rate', '10', '--port', '0')
DESK, PHONE, GAP = 1270, 390, 30
REPORT_DESK, REPORT_PHONE, REPORT_HEIGHT = 740, 340, 1406
# A little after stick-slip is predicted, the trail is long enough to see.
LOOK = "document.body?.innerText.includes('ALARM')"
AFTERWARDS = 2.5
SAID = "[...document.querySelectorAll('#log small')].map((e) => e.textContent)"


async def take_picture(page: Page, width: int, height: int = 0, dark: bool = False) -> Image.Image:
    """Return the page at a size, from its top; height 0 for all of it."""
    await page.show_as(width, height or 900, dark=dark)
    await asyncio.sleep(0.5)
    tall = height or await page.js('document.documentElement.scrollHeight')
    clip = {'x': 0, 'y': 0, 'width': width, 'height': tall, 'scale': 1}
    shot = await page.call('Page.captureScreenshot', clip=clip, captureBeyondViewport=True)
    return Image.open(io.BytesIO(base64.b64decode(shot['data']))).convert('RGB')


async def take_all(port: int, page_url: str, report_url: str) -> None:
    """Take page and report in the browser at a port."""
    async with first_page(port) as page:
        await page.call('Page.navigate', url=page_url)
        while not await page.js(LOOK):
            await asyncio.sleep(0.1)
        await asyncio.sleep(AFTERWARDS)
        await page.js("document.getElementById('hold').click()")
        # What a test compares with what the program says now.
        texts = json.dumps(await page.js(SAID))
        await page.choose('.charts select', '180')
        await page.choose('#theme', 'day')
        desk = await take_picture(page, DESK)
        await page.choose('#theme', 'night')
        save_pair(desk, await take_picture(page, PHONE, desk.height), 'dashboard.png', texts)
        await page.call('Page.navigate', url=report_url)
        desk = await take_picture(page, REPORT_DESK, REPORT_HEIGHT)
        save_pair(desk, await take_picture(page, REPORT_PHONE, REPORT_HEIGHT, dark=True), 'report.png')


def save_pair(desk: Image.Image, phone: Image.Image, name: str, texts: str = '') -> None:
    """Save two views side by side, with the texts on them."""
    combined = Image.new('RGB', (desk.width + GAP + phone.width, desk.height), 'white')
    combined.paste(desk, (0, 0))
    combined.paste(phone, (desk.width + GAP, 0))
    metadata = PngInfo()
    metadata.add_text('Description', texts)
    combined.save(IMAGES / name, optimize=True, pnginfo=metadata)
    print(f'docs/images/{name} is new')


def run_command(*command: str) -> None:
    """Run a command that ends; it may find what warns, which is what is shown."""
    done = subprocess.run([sys.executable, '-m', *command], cwd=ROOT, stdout=subprocess.DEVNULL)
    if done.returncode not in (0, 1):
        raise SystemExit(f'{" ".join(command)} ended with {done.returncode}')


def main() -> int:
    """Run the commands, start the dashboard and the browser, and take the pictures."""
    run_command(STICKSLIP, 'map', *CONFIG, '--track', BAG, '--output', str(IMAGES / 'coast_down_map.png'))
    for bag, name in (('manoeuvring', 'manoeuvring'), ('bistable_knock', 'score')):
        run_command('benchmarks.score', f'bags/{bag}', *CONFIG, '--picture', str(IMAGES / f'{name}.png'))
    page = [sys.executable, '-m', STICKSLIP, 'dashboard', *CONFIG, '--bag', BAG, *PACE]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / 'report.html'
        run_command(STICKSLIP, 'check', BAG, *CONFIG, '--report', str(report))
        with run_chromium() as port, run_program(page, stdout=subprocess.PIPE, cwd=ROOT) as dashboard:
            assert dashboard.stdout is not None
            url = dashboard.stdout.readline().split()[-1]
            asyncio.run(take_all(port, url, report.as_uri()))
    return 0


if __name__ == '__main__':
    sys.exit(main())
