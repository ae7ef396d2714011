# SPDX-License-Identifier: Apache-2.0
"""What tests of several rooms share: programs, waiting, a ship's bus, recordings, pictures."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from stickslip_monitor.links.nmea import format_sentence, parse_sentence
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'launch_configs' / 'reference_bearing.yaml'
REFERENCE: dict[str, Any] = {
    'mass': 50.0,
    'damping': 400.0,
    'stiffness': 2.0e6,
    'journal_diameter': 0.1,
    'friction.law': 'stribeck',
    'friction.static': 0.3,
    'friction.kinetic': 0.1,
    'friction.decay': 10.0,
    'speed.topic': '/shaft/speed',
    'speed.unit': 'rpm',
    'load.topic': '/bearing/aft/load',
    'load.unit': 'N',
}
# Laws of each kind: some fall nowhere, one falls twice.
LAWS = {
    'stribeck': Stribeck(0.30, 0.10, 10.0),
    'viscous': Stribeck(0.30, 0.10, 10.0, 0.05),
    'rising': Stribeck(0.10, 0.30, 10.0),
    'level': Stribeck(0.2, 0.2, 10.0),
    'coulomb': Coulomb(0.3, 0.1),
    'table': Tabulated([0.0, 0.1, 0.2, 0.5], [0.3, 0.2, 0.15, 0.1]),
    'two falls': Tabulated([0.0, 0.02, 0.06, 0.2, 0.22, 0.3, 0.9], [0.4, 0.2, 0.2, 0.26, 0.16, 0.15, 0.15]),
}
UNIT_LAW = Stribeck(0.3, 0.1, 1.0)
RPM = math.pi * 0.1 / 60.0  # surface speed of the reference journal at one turn a minute [m/s]
SCHEMAS = resources.files('stickslip_monitor') / 'schemas'
KINDS: dict[str, tuple[type, ...]] = {
    'string': (str,),
    'integer': (int,),
    'number': (int, float),
    'boolean': (bool,),
    'object': (dict,),
    'array': (list,),
    'null': (type(None),),
}
# Only a test that fails waits so long; a busy machine may need some of it.
DEADLINE = 60.0


def bearing_of(law: FrictionLaw, damping: float = 400.0) -> Bearing:
    """Return the reference bearing with a law and a damping [N s/m]."""
    return Bearing(50.0, damping, 2.0e6, law, 0.1)


def unit_bearing(zeta: float, law: FrictionLaw = UNIT_LAW) -> Bearing:
    """Return a bearing with omega = m = k = 1; by :data:`UNIT_LAW` the speed is ``beta V``, ``eta`` 0.2 N."""
    return Bearing(1.0, 2.0 * zeta, 1.0, law, 0.1)


REFERENCE_BEARING = bearing_of(LAWS['stribeck'])


class Done(NamedTuple):
    """The result of a command: its exit code, and what it printed."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Stickslip = Callable[..., Done]
"""Runs a command in this process: the fixture of this name."""


def until(
    condition: Callable[[], Any], description: str | Callable[[], str] = '', deadline: float = DEADLINE
) -> Any:
    """Wait until a condition holds; fail at the deadline."""
    end = time.monotonic() + deadline
    while not (value := condition()):
        if time.monotonic() > end:
            text = description() if callable(description) else description
            pytest.fail(f'{text}: not within {deadline:g} s')
        time.sleep(0.01)
    return value


async def wait_until(
    condition: Callable[[], Any], description: Callable[[], Any] = lambda: '', deadline: float = DEADLINE
) -> None:
    """Wait until a condition holds, on a loop that goes on meanwhile."""
    end = time.monotonic() + deadline
    while not condition():
        assert time.monotonic() < end, description()
        await asyncio.sleep(0.01)


class Program:
    """A program in a process of its own, and what it printed."""

    def __init__(self, command: list[str], log: Path, **options: Any) -> None:
        self._log = log
        with log.open('wb') as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, **options)

    @property
    def output(self) -> str:
        return self._log.read_text(errors='replace')

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def until(self, condition: Callable[[], Any]) -> Any:
        """Wait while it runs."""
        return until(lambda: condition() or (not self.alive and self._fail_as_dead()), lambda: self.output)

    def _fail_as_dead(self) -> None:
        pytest.fail(f'it has ended: {self.output}')

    def wait(self) -> int:
        return self.process.wait(DEADLINE)

    def stop(self, number: int = signal.SIGINT) -> int:
        if self.alive:
            self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(number)
        return self.wait()

    def end(self) -> None:
        """Stop it whatever it takes; a killed program leaves shared memory behind."""
        try:
            self.stop()
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.wait()


class Bus:
    """A talker and a display on NMEA.

    Attributes:
        alarms: The newest state of each alert, by its identifier.
        beats: The states of the heartbeats.
    """

    def __init__(self) -> None:
        self.display, probe = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for sink in (self.display, probe):
            sink.bind(('127.0.0.1', 0))
        self.display.setblocking(False)
        self.port = probe.getsockname()[1]
        probe.close()
        self.alarms: dict[str, str] = {}
        self.beats: list[str] = []

    def links(self, bearing: str) -> dict[str, Any]:
        """Return the section of the configuration for it."""
        return {
            'nmea.listen': f'udp://127.0.0.1:{self.port}',
            'nmea.alerts': f'udp://127.0.0.1:{self.display.getsockname()[1]}',
            'nmea.accept_actions': True,
            'nmea.heartbeat': 1.0,
            f'{bearing}.speed': {'from': 'nmea', 'sentence': 'RPM', 'kind': 'S'},
            f'{bearing}.load': {'from': 'nmea', 'sentence': 'XDR', 'kind': 'N', 'name': 'AFT'},
        }

    def say(self, *bodies: str) -> None:
        for body in bodies:
            self.display.sendto(format_sentence(body).encode(), ('127.0.0.1', self.port))

    def listen(self) -> None:
        while True:
            try:
                parsed = parse_sentence(self.display.recv(1000).decode())
            except BlockingIOError:
                return
            _, formatter, fields = parsed or ('', '', [])
            if formatter == 'ALF' and fields[6]:
                self.alarms[fields[8]] = fields[6]
            elif formatter == 'HBT':
                self.beats.append(fields[1])

    def sails(self, rpm: str, condition: Callable[[], Any]) -> Callable[[], Any]:
        """Return a condition to wait for that sends speed and load whenever it is asked."""

        def look() -> Any:
            self.say(f'RCRPM,S,1,{rpm},30.0,A', 'IIXDR,N,1000,N,AFT')
            self.listen()
            return condition()

        return look


def png_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture, by its header."""
    data = path.read_bytes()
    assert data[:8] == b'\x89PNG\r\n\x1a\n'
    width, height = struct.unpack('>II', data[16:24])
    return width, height


def contrast_ratio(foreground: str, background: str) -> float:
    """Return the ratio of WCAG 2 between two colours: 4.5 for text, 3 for graphics."""
    high, low = sorted((relative_luminance(foreground), relative_luminance(background)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def relative_luminance(colour: str) -> float:
    """Return the relative luminance of WCAG 2 of a colour written #rrggbb."""
    parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def schema_errors(schema: dict[str, Any], value: Any, path: str = '') -> Iterator[str]:
    """Yield where a document breaks a schema, or has a field that the schema lacks."""
    if 'const' in schema and value != schema['const']:
        yield f'{path} = {value!r}'
    if 'enum' in schema and value not in schema['enum']:
        yield f'{path} = {value!r}'
    kinds = schema.get('type', [])
    allowed = [k for kind in ([kinds] if isinstance(kinds, str) else kinds) for k in KINDS[kind]]
    if allowed and (type(value) not in allowed):
        yield f'{path} is a {type(value).__name__}'
    if isinstance(value, list):
        for item in value:
            yield from schema_errors(schema.get('items', {}), item, f'{path}[]')
    if isinstance(value, dict):
        properties, more = schema.get('properties'), schema.get('additionalProperties', {})
        yield from (f'{path} lacks {name}' for name in schema.get('required', ()) if name not in value)
        for name, item in value.items():
            if properties is not None and name not in properties:
                yield f'{path} has {name}'
            yield from schema_errors((properties or {}).get(name, more), item, f'{path}.{name}')


def schema_complaints(name: str, document: Any) -> list[str]:
    """Return what an installed schema finds wrong with a document."""
    schema = json.loads((SCHEMAS / f'{name}.json').read_text('utf-8'))
    return list(schema_errors(schema, json.loads(json.dumps(document, allow_nan=False))))
