# SPDX-License-Identifier: Apache-2.0
"""The links against the real signalk-server: an alarm again and again, and the right to write."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest
from shared import CONFIG, DEADLINE, wait_until

pytest.importorskip('aiohttp', reason="the extra 'links' is not installed")

import aiohttp

from benchmarks.signalk_servers import RealServer, missing_program, officer_token
from stickslip_monitor import build_config
from stickslip_monitor.errors import LinkError
from stickslip_monitor.links.links_config import BusInput, SignalKLink
from stickslip_monitor.links.live_monitor import LiveMonitor, MonitorSide
from stickslip_monitor.links.signalk import SignalKInputs
from stickslip_monitor.links.signalk_client import SignalKClient
from stickslip_monitor.links.signalk_token import request_token
from stickslip_monitor.monitor import alarm_list
from stickslip_monitor.monitor.parameter_file import load_parameters
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.session import Sink

pytestmark = pytest.mark.slow

SPEED, LOAD = 'propulsion.port.revolutions', 'propulsion.port.shaft.aft.load'
PREFIX = 'propulsion.port.shaft'
BEARING = 'aft_stern'
STICK = f'notifications.{PREFIX}.aftStern.stickSlip'
AHEAD, STUCK = 1.0, 20.0 / 60.0  # revolutions a second
INPUTS = {'speed.unit': 'Hz', 'speed.timeout': 2.0, 'load.timeout': 2.0}
AT_ONCE = ('onset_growth', 'on_delay', 'off_delay', 'input_off_delay')
CHANGES = INPUTS | {f'alarm.{name}': 0.0 for name in AT_ONCE}


@pytest.fixture(scope='module')
def installed() -> None:
    """Skip what needs the real server where it is not installed."""
    if reason := missing_program():
        pytest.skip(reason)


@pytest.fixture(scope='module')
def server(installed: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealServer]:
    """Yield the real server, at the loopback address."""
    server = RealServer(tmp_path_factory.mktemp('signalk'))
    yield server
    server.stop()


class Ship(Sink):
    """The monitor without ROS at a real server, with a shaft meter and somebody who looks on."""

    def __init__(self, server: RealServer, token: str = '') -> None:
        self.server, self.rpm = server, AHEAD
        changes = {f'{BEARING}.{name}': value for name, value in CHANGES.items()}
        config = build_config(load_parameters(CONFIG) | changes)
        self.record: dict[str, Any] = {'alarms': []}
        self.changes: list[dict[str, Any]] = []
        self.seen: dict[str, Any] = {}
        self.links: dict[str, bool] = {}
        log = logging.getLogger('ship')
        self.live = LiveMonitor(config, self, log)
        paths = {Input.SPEED: SPEED, Input.LOAD: LOAD}
        inputs = [
            BusInput(bus='signalk', bearing=BEARING, place=place, path=path, timeout=2.0)
            for place, path in paths.items()
        ]
        self.client = SignalKClient(
            SignalKLink(server.url, '', '', PREFIX, True),
            token,
            SignalKInputs(inputs, log.warning),
            [],
            MonitorSide([BEARING], self.live.take, self.live.act, self.report_link, log),
        )

    def report_link(self, name: str, up: bool, reason: str) -> None:
        self.links[name] = up

    def take_record(self, record: dict[str, Any]) -> None:
        self.client.take_record(record)

    def take_alarms(self, record: dict[str, Any]) -> None:
        self.client.take_alarms(record)
        self.record = record
        self.changes += record['changes']

    @property
    def states(self) -> dict[str, str]:
        alarms = self.record['alarms']
        return {a['alarm']: a['state'] for a in alarms if a['state'] != 'normal'}

    async def as_another(self, use: Callable[[Any], Coroutine[Any, Any, None]]) -> None:
        """Be another client of the server, again and again."""
        while True:
            with suppress(aiohttp.ClientError, OSError):
                async with aiohttp.ClientSession() as session:
                    address = f'{self.server.url}/signalk/v1/stream?subscribe=none'
                    async with session.ws_connect(address) as ws:
                        await use(ws)
            await asyncio.sleep(0.2)

    async def run_meter(self, ws: Any) -> None:
        """Publish speed and load ten times a second."""
        while not ws.closed:
            values = [{'path': SPEED, 'value': self.rpm}, {'path': LOAD, 'value': 1000.0}]
            await ws.send_json({'updates': [{'$source': 'meter.1', 'values': values}]})
            await asyncio.sleep(0.1)

    async def run_display(self, ws: Any) -> None:
        """Read the notifications as another display does, the newest of each occurrence."""
        await ws.send_json({'context': 'vessels.self', 'subscribe': [{'path': STICK}]})
        async for message in ws:
            self.take_frame(message.json())

    def take_frame(self, frame: Any) -> None:
        for update in frame.get('updates', ()):
            for item in update.get('values', ()):
                token = item['value'].get('data', {}).get('occurrence')
                self.seen[token] = item['value']

    async def run_ticks(self) -> None:
        while True:
            self.client.tick(True)
            await asyncio.sleep(0.1)

    async def until(self, condition: Callable[[], Any], event: str) -> None:
        await wait_until(condition, lambda: (event, self.states, self.links, self.seen))

    def sounds(self) -> dict[str, Any] | None:
        """Return the notification that calls for attention aloud and is not acknowledged, if any."""
        for value in self.seen.values():
            if 'sound' in value['method'] and not value['status']['acknowledged']:
                return dict(value)
        return None

    async def act_on(self, verb: str, token: str) -> None:
        """Acknowledge or silence an occurrence by the server's own interface."""
        api = f'{self.server.url}/signalk/v2/api/notifications'
        async with aiohttp.ClientSession() as session:
            async with session.get(api) as answer:
                notifications = await answer.json()
            (number,) = [
                key
                for key, item in notifications.items()
                if item['value'].get('data', {}).get('occurrence') == token
            ]
            async with session.post(f'{api}/{number}/{verb}') as answer:
                assert answer.status == 200, await answer.text()


@asynccontextmanager
async def connected_ship(
    server: RealServer, token: str = '', link: str = 'signalk_out'
) -> AsyncIterator[Ship]:
    ship = Ship(server, token)
    works = [ship.client.run(), ship.live.run(), ship.run_ticks()]
    works += [ship.as_another(ship.run_meter), ship.as_another(ship.run_display)]
    tasks = [asyncio.create_task(work) for work in works]
    try:
        await ship.until(lambda: ship.links.get(link), link)
        yield ship
    finally:
        for task in tasks:
            task.cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
        assert all(isinstance(result, asyncio.CancelledError) for result in results), results


async def test_rounds_with_none_invented_and_none_lost(
    server: RealServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    # However many there are in a short time, each is given aloud.
    monkeypatch.setattr(alarm_list, 'WINDOW_NS', 0)

    async with connected_ship(server) as ship:
        for number in range(8):
            ship.seen.clear()
            ship.rpm = STUCK
            await ship.until(ship.sounds, f'alarm {number} with its sound')
            assert ship.states['stick_slip'] == 'unacknowledged'
            if number % 4 == 3:
                await ship.act_on('silence', ship.sounds()['data']['occurrence'])
                await ship.until(lambda: ship.sounds() is None, f'silence {number}')
                assert ship.states['stick_slip'] == 'unacknowledged'
            token = next(iter(t for t, v in ship.seen.items() if v['state'] == 'alarm'))
            await ship.act_on('acknowledge', token)
            await ship.until(lambda: ship.states.get('stick_slip') == 'acknowledged', f'its end {number}')
            ship.rpm = AHEAD
            await ship.until(lambda: 'stick_slip' not in ship.states, f'the end {number}')
            await ship.until(lambda: all(v['state'] == 'normal' for v in ship.seen.values()), 'normal')
        actions = [(c['alarm'], c['what']) for c in ship.changes if c['by'] == 'signal k']
        # Who knows of the worst alarm knows of what it covers.
        assert {alarm for alarm, _ in actions} <= {'stick_slip', 'bistable', 'margin_low'}
        assert actions.count(('stick_slip', 'acknowledge')) == 8
        assert actions.count(('stick_slip', 'silence')) == 2
        raised = [c['alarm'] for c in ship.changes if c['to'] == 'unacknowledged' != c['from']]
        assert raised.count('stick_slip') == 8


async def test_a_token_by_request_and_the_right_to_write(
    installed: None, tmp_path_factory: pytest.TempPathFactory
) -> None:
    server = RealServer(tmp_path_factory.mktemp('secure'), secure=True)
    access = f'{server.url}/skServer/security/access/requests'

    async def approve() -> None:
        officer = {'Authorization': f'Bearer {officer_token()}'}
        waiting: list[dict[str, str]] = []
        async with aiohttp.ClientSession(headers=officer) as session:
            while not waiting:
                await asyncio.sleep(0.1)
                async with session.get(access) as answer:
                    waiting = await answer.json()
            body = {'expiration': '1y', 'permissions': 'readwrite'}
            number = waiting[0]['accessIdentifier']
            async with session.put(f'{access}/{number}/approved', json=body) as answer:
                assert answer.status == 200, await answer.text()

    try:
        wrong = Ship(server, 'eyJ.a-wrong-token.x')
        with pytest.raises(LinkError, match='the token is refused'):
            await asyncio.wait_for(wrong.client.run(), DEADLINE)
        approving = asyncio.create_task(approve())
        link = SignalKLink(server.url, 'token', '', PREFIX, False)
        token = await request_token(link, 'a7b2b1f6-5f0e-4d0b-9a51-0c4c4b1d3f11', print, 0.1)
        await approving
        # Without the right to write everything is dropped without a word: only silence tells.
        async with connected_ship(server, link='signalk_in') as ship:
            await ship.until(lambda: ship.links.get('signalk_out') is False, 'the missing echo')
        async with connected_ship(server, token) as ship:
            assert ship.links['signalk_out']
    finally:
        server.stop()
