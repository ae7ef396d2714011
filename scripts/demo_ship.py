# SPDX-License-Identifier: Apache-2.0
"""Shows the monitor on a ship without ROS: a shaft slows down, a display sees the alarm, acts.

Against the real signalk-server where node and the locked packages are, else against a small one.
"""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import aiohttp
import yaml
from rich.console import Console

from benchmarks.signalk_servers import RealServer, SmallServer, missing_program

ROOT = Path(__file__).resolve().parents[1]
SHIP = ROOT / 'launch_configs' / 'examples' / 'ship.yaml'
PREFIX = 'propulsion.port.shaft'
STICK = f'notifications.{PREFIX}.aftStern.stickSlip'
PATIENCE = 60.0
console = Console(highlight=False)


class Ship:
    """Server, shaft meter, display, and the monitor beside them."""

    def __init__(self, url: str) -> None:
        self.url, self.rpm, self.begin = url, 60.0, time.monotonic()
        self.seen: dict[str, Any] = {}

    def say(self, text: str) -> None:
        """Print a line with the time."""
        console.print(f'[dim]{time.monotonic() - self.begin:5.1f} s[/]  {text}')

    async def meter(self, stream: aiohttp.ClientWebSocketResponse) -> None:
        """Tell speed and load five times a second."""
        while True:
            readings = {'revolutions': self.rpm / 60.0, 'shaft.aftStern.load': 1000.0}
            values = [{'path': f'propulsion.port.{k}', 'value': v} for k, v in readings.items()]
            await stream.send_json({'updates': [{'$source': 'shaft meter', 'values': values}]})
            await asyncio.sleep(0.2)

    async def display(self, stream: aiohttp.ClientWebSocketResponse) -> None:
        """Show a notification whenever it changes."""
        await stream.send_json({'context': 'vessels.self', 'subscribe': [{'path': STICK}]})
        async for message in stream:
            for update in message.json().get('updates', ()):
                value = update['values'][0]['value']
                sign = (value['state'], value['method'])
                if sign != (self.seen.get('state'), self.seen.get('method')):
                    signals = ' and '.join(value['method']) or 'quiet'
                    text = value['message'].partition('.')[0]
                    self.say(f'[bold]display:[/] {value["state"]}, {signals}  {text}')
                self.seen = value

    async def until(self, state: str, sound: bool | None = None) -> None:
        """Wait for what the display should show.

        Raises:
            TimeoutError: It does not.
        """
        end = time.monotonic() + PATIENCE
        while self.seen.get('state') != state or sound not in (None, 'sound' in self.seen['method']):
            if time.monotonic() > end:
                raise TimeoutError(f'the display shows {self.seen}, not {state}')
            await asyncio.sleep(0.05)


async def acknowledge_alarm(session: aiohttp.ClientSession, url: str, token: str) -> None:
    """Acknowledge as a person does at a display of the real server."""
    api = f'{url}/signalk/v2/api/notifications'
    async with session.get(api) as answer:
        alarms = (await answer.json()).items()
    number = next(key for key, item in alarms if item['value'].get('data', {}).get('occurrence') == token)
    async with session.post(f'{api}/{number}/acknowledge') as answer:
        answer.raise_for_status()


async def sail_voyage(url: str, small: SmallServer | None) -> None:
    """Sail the voyage."""
    ship = Ship(url)
    async with AsyncExitStack() as stack:
        session = await stack.enter_async_context(aiohttp.ClientSession())
        stream = f'{url}/signalk/v1/stream?subscribe=none'
        ends = [await stack.enter_async_context(session.ws_connect(stream)) for _ in range(2)]
        work = [asyncio.create_task(ship.meter(ends[0])), asyncio.create_task(ship.display(ends[1]))]
        try:
            await ship.until('normal')
            ship.say('The shaft turns at 60 rpm. Now it slows down to 20 rpm.')
            ship.rpm = 20.0
            await ship.until('alarm', sound=True)
            ship.say('Somebody acknowledges at the display.')
            if small is None:
                await acknowledge_alarm(session, url, ship.seen['data']['occurrence'])
            else:
                await small.act(STICK, acknowledged=True)
            await ship.until('alarm', sound=False)
            ship.say('Back to 60 rpm.')
            ship.rpm = 60.0
            await ship.until('normal')
        finally:
            for task in work:
                task.cancel()
            await asyncio.gather(*work, return_exceptions=True)


def write_configuration(folder: Path, url: str) -> Path:
    """Return the example of the docs for this server; it accepts actions, being on this machine."""
    document = yaml.safe_load(SHIP.read_text(encoding='utf-8'))
    links = document['/stickslip_links']['ros__parameters']
    links['signalk'] |= {'url': url, 'accept_actions': True}
    del links['nmea']
    path = folder / 'ship.yaml'
    path.write_text(yaml.safe_dump(document), encoding='utf-8')
    return path


async def demo(folder: Path) -> None:
    """Start everything, show it, and stop everything."""
    reason, small, real = missing_program(), None, None
    if reason:
        console.print(f"[bold]1. The tests' own Signal K server[/] ({reason})")
        small = SmallServer()
        await small.start()
    else:
        console.print('[bold]1. The real signalk-server[/], 2.23, at this machine alone')
        real = await asyncio.to_thread(RealServer, folder)
    url = real.url if real else f'http://127.0.0.1:{small.port}'
    console.print('[bold]2. The monitor[/], without ROS:  stickslip watch --config ship.yaml --port 0')
    command = [sys.executable, '-m', 'stickslip_monitor.cli', 'watch', '--port', '0']
    command += ['--config', str(write_configuration(folder, url))]
    log = folder / 'watch.log'
    with log.open('wb') as file:
        watch = subprocess.Popen(command, stderr=file)
    try:
        await sail_voyage(url, small)
    except TimeoutError:
        console.print(log.read_text(encoding='utf-8'))
        raise
    finally:
        watch.send_signal(signal.SIGINT)
        await asyncio.to_thread(watch.wait, 20.0)
        if real:
            real.stop()
        else:
            await small.stop()


def main() -> int:
    """Run the demo; return 1 where the display did not show what it should."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            asyncio.run(demo(Path(folder)))
        except (TimeoutError, RuntimeError, aiohttp.ClientError) as error:
            console.print(f'[red]FAILED:[/] {error}')
            return 1
    console.print('[green]Raised, acknowledged at the display, and over.[/]')
    return 0


if __name__ == '__main__':
    sys.exit(main())
