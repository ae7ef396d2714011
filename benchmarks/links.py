# SPDX-License-Identifier: Apache-2.0
"""From a shaft's speed at a Signal K server to the alarm at another client of it."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import yaml

from benchmarks.reference import CONFIG
from benchmarks.signalk_servers import RealServer, missing
from benchmarks.table import Table, absent, duration

RATES = (10, 100, 500)
"""Deltas a second of speed, and as many of load."""
_PREFIX = 'propulsion.port.shaft'
_SPEED, _LOAD = 'propulsion.port.revolutions', f'{_PREFIX}.aftStern.load'
_AHEAD, _STUCK = 1.0, 1.0 / 3.0  # revolutions a second: 60 and 20 rpm, above and below Hopf
_COLUMNS = ('client', 'deltas/s', 'alarm, median', '99 %', 'most', 'of a core', 'memory')


@dataclass(frozen=True, slots=True)
class Stretch:
    """What a client did: latencies [s] of alarms and their ends, share of a core, memory."""

    latency: Sequence[float]
    cpu: float
    memory: int


def _watch(folder: Path, url: str) -> list[str]:
    document = yaml.safe_load(CONFIG.read_text('utf-8'))
    own = document['/**']['ros__parameters']['aft_stern']
    own['speed']['unit'] = 'Hz'
    own['alarm'] |= {'onset_growth': 0.0, 'on_delay': 0.0, 'off_delay': 0.0}
    document['/stickslip_links'] = {
        'ros__parameters': {
            'signalk': {'url': url, 'prefix': _PREFIX},
            'aft_stern': {
                'speed': {'from': 'signalk', 'path': _SPEED},
                'load': {'from': 'signalk', 'path': _LOAD},
            },
        }
    }
    path = folder / 'ship.yaml'
    path.write_text(yaml.safe_dump(document), 'utf-8')
    return [sys.executable, '-m', 'stickslip_monitor.cli', 'watch', '--config', str(path)]


class Subject:
    """A client under test, between a shaft meter and somebody who looks on."""

    def __init__(self, command: Sequence[str], url: str, notification: str) -> None:
        self._url, self._notification = url, notification
        self.process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        self._revolutions = _AHEAD
        self._changed = 0.0

    async def stretch(self, rate: float, rounds: int) -> Stretch:
        """Let the shaft slow down and speed up so often, at a rate of telemetry."""
        self._crossed: asyncio.Queue[tuple[str, float]] = asyncio.Queue()
        async with aiohttp.ClientSession() as session:
            stream = f'{self._url}/signalk/v1/stream?subscribe=none'
            async with session.ws_connect(stream) as talks, session.ws_connect(stream) as looks:
                await looks.send_json(
                    {'context': 'vessels.self', 'subscribe': [{'path': self._notification}]}
                )
                tasks = [
                    asyncio.create_task(self._meter(talks, rate)),
                    asyncio.create_task(self._look(looks)),
                ]
                await self._until('alarm', _STUCK)
                await self._until('normal', _AHEAD)
                cpu, begin, latency = self._cpu(), time.monotonic(), []
                for _ in range(rounds):
                    for state, revolutions in (('alarm', _STUCK), ('normal', _AHEAD)):
                        await asyncio.sleep(0.15)
                        latency.append(await self._until(state, revolutions))
                cpu = (self._cpu() - cpu) / (time.monotonic() - begin)
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
        return Stretch(latency, cpu, self._memory())

    async def _until(self, state: str, revolutions: float) -> float:
        """Change the speed; return how long its notification took after it was sent."""
        self._revolutions, self._changed = revolutions, 0.0
        while True:
            heard, at = await asyncio.wait_for(self._crossed.get(), 60.0)
            if heard == state and self._changed:
                return at - self._changed

    async def _meter(self, socket: aiohttp.ClientWebSocketResponse, rate: float) -> None:
        due, number = time.monotonic(), 0
        while True:
            for path, value in ((_LOAD, 1000.0), (_SPEED, self._revolutions + 1e-9 * number)):
                if path == _SPEED and not self._changed:
                    self._changed = time.monotonic()
                values = [{'path': path, 'value': value}]
                await socket.send_json({'updates': [{'$source': 'meter', 'values': values}]})
            due, number = due + 1.0 / rate, number + 1
            await asyncio.sleep(max(due - time.monotonic(), 0.0))

    async def _look(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        async for message in socket:
            now, frame = time.monotonic(), message.json()
            for update in frame.get('updates', ()):
                for item in update['values']:
                    self._crossed.put_nowait((_lifecycle(item['value']), now))

    def _cpu(self) -> float:
        fields = self._proc('stat').rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def _memory(self) -> int:
        return int(self._proc('statm').split()[1]) * os.sysconf('SC_PAGE_SIZE')

    def _proc(self, name: str) -> str:
        return Path(f'/proc/{self.process.pid}/{name}').read_text('utf-8')

    def stop(self) -> None:
        """End the process as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(20.0)


def _lifecycle(value: Any) -> str:
    """The state of a notification; one that nobody has acknowledged yet is over all the same."""
    over = value.get('data', {}).get('lifecycle') == 'returned_unacknowledged'
    return 'normal' if over else str(value['state'])


def run(quick: bool = False) -> Table:
    """Measure the bare client and ours in turns."""
    rounds = 5 if quick else 60
    if why := missing():
        rows = [absent('stickslip watch', len(_COLUMNS) - 1)]
        return Table('Ship links', f'{why}.', _COLUMNS, rows)
    with tempfile.TemporaryDirectory() as folder:
        server = RealServer(Path(folder))
        try:
            rows = _rows(Path(folder), server.url, rounds)
        finally:
            server.stop()
    return Table(
        'Ship links',
        'A shaft meter sends speed and load to signalk-server 2.23; its speed falls below the Hopf'
        ' speed and rises again, and another client waits for the notification of it:'
        f' {2 * rounds} changes for each row. The bare client compares the speed with a number.'
        ' All of them, and the server, share the machine. Delays of the alarm are 0.',
        _COLUMNS,
        rows,
    )


def _rows(folder: Path, url: str, rounds: int) -> list[list[str]]:
    bare = [sys.executable, '-m', 'benchmarks.signalk_echo', url, _SPEED, _LOAD]
    bare += ['notifications.echo.stickSlip', '0.5']
    clients = {
        'bare client': (bare, 'notifications.echo.stickSlip'),
        'stickslip watch': (_watch(folder, url), f'notifications.{_PREFIX}.aftStern.stickSlip'),
    }
    rows = []
    subjects = {name: Subject(command, url, path) for name, (command, path) in clients.items()}
    try:
        time.sleep(5.0)
        for rate in RATES:
            for name, subject in subjects.items():
                found = asyncio.run(subject.stretch(rate, rounds))
                rows.append(_row(name, rate, found))
    finally:
        for subject in subjects.values():
            subject.stop()
    return rows


def _row(name: str, rate: int, found: Stretch) -> list[str]:
    median, high = np.percentile(found.latency, [50.0, 99.0])
    times = [duration(float(seconds)) for seconds in (median, high, max(found.latency))]
    return [name, f'2 × {rate}', *times, f'{found.cpu:.1%}', f'{found.memory / 1e6:.0f} MB']
