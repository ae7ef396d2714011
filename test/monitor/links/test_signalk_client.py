# SPDX-License-Identifier: Apache-2.0
"""The client against a small server with every fault that was met at a real one."""

from __future__ import annotations

import asyncio
import logging
import ssl
import subprocess
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from shared import wait_until

pytest.importorskip('aiohttp', reason="the extra 'links' is not installed")

from benchmarks.signalk_servers import SmallServer
from stickslip_monitor.errors import ConfigurationError, LinkError
from stickslip_monitor.links import signalk_client
from stickslip_monitor.links.links_config import BusInput, SignalKLink
from stickslip_monitor.links.live_monitor import MonitorSide
from stickslip_monitor.links.signalk import SignalKInputs
from stickslip_monitor.links.signalk_client import SignalKClient
from stickslip_monitor.links.signalk_token import read_signalk_token, request_token
from stickslip_monitor.monitor.alarm_states import AlarmKind
from stickslip_monitor.monitor.sample_types import Input

PATH = 'propulsion.port.revolutions'
STICK = 'notifications.p.shaft.aft.stickSlip'
MARGIN = 'p.shaft.aft.foldMargin'


def alarm_list_in(state: str) -> dict[str, Any]:
    """Return a list in which one alarm is in a state."""
    alarm = {
        'bearing': 'aft',
        'alarm': AlarmKind.STICK_SLIP.value,
        'state': state,
        'sounding': state == 'unacknowledged',
        'silenced': False,
        'text': 'aft: Stick-slip predicted.',
    }
    return {'alarms': [alarm]}


class Ship:
    """One client, and what it brought."""

    def __init__(self, server: SmallServer, scheme: str = 'http', **options: Any) -> None:
        settings = {'token_file': '', 'ca_file': '', 'prefix': 'p.shaft', 'accept_actions': True}
        token = options.pop('token', '')
        link = SignalKLink(f'{scheme}://127.0.0.1:{server.port}', **settings | options)
        self.server = server
        self.values: list[float] = []
        self.requests: list[str] = []
        self.links: list[tuple[str, bool]] = []
        self.reasons: list[str] = []
        self.client = SignalKClient(
            link,
            token,
            SignalKInputs(
                [BusInput(bus='signalk', bearing='aft', place=Input.SPEED, path=PATH)], lambda text: None
            ),
            [],
            MonitorSide(
                ['aft'],
                lambda bearing, place, value, stamp: self.values.append(value),
                lambda request: self.requests.append(str(request.action)),
                self.report_link,
                logging.getLogger('test'),
            ),
        )
        self.client.take_alarms(alarm_list_in('normal'))

    def report_link(self, name: str, up: bool, reason: str) -> None:
        if (name, up) not in self.links[-2:]:
            self.links.append((name, up))
        self.reasons.append(reason)

    def up(self, name: str) -> bool:
        return next((up for link, up in reversed(self.links) if link == name), False)

    async def until(self, condition: Callable[[], Any], is_monitoring: bool = True) -> None:
        """Wait, while time passes for the client, with a monitor that is there or not."""

        def tick_and_check() -> Any:
            self.client.tick(is_monitoring)
            return condition()

        await wait_until(tick_and_check, lambda: (self.links, self.reasons[-1:]))

    def latest(self, path: str) -> Any:
        """Return the newest value that the monitor sent to the server."""
        values = [v for (s, p), (v, _) in self.server.values.items() if p == path and s != 'shaft.1']
        return values[-1] if values else None


@asynccontextmanager
async def connected_client(ship: Ship) -> AsyncIterator[Ship]:
    """Yield the client at work, connected."""
    task = asyncio.create_task(ship.client.run())
    try:
        await ship.until(lambda: ship.up('signalk_in') or task.done())
        if task.done():
            task.result()
        yield ship
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


RECORD = {
    'bearing': 'aft',
    'reason': 'stick_slip',
    'regime': 'unstable',
    'fold_margin': -0.5,
    'amplitude_exact': 1e-4,
}


async def test_a_server_that_forgets_gets_everything_back(server: SmallServer) -> None:
    async with connected_client(Ship(server)) as ship:
        ship.client.take_alarms(alarm_list_in('unacknowledged'))
        ship.client.take_record(RECORD)
        await ship.until(lambda: ship.latest(MARGIN) == -0.5 and ship.up('signalk_out'))
        assert ship.latest(STICK)['state'] == 'alarm'
        await server.stop()
        await ship.until(lambda: not ship.up('signalk_in') and not ship.up('signalk_out'))
        server.values.clear()
        server.received.clear()
        server.status.clear()
        await server.start()
        await ship.until(lambda: ship.up('signalk_out') and ship.latest(MARGIN) == -0.5)
        assert ship.latest(STICK)['state'] == 'alarm'
        assert ship.latest('notifications.p.shaft.monitor')['state'] == 'normal'
        assert any('meta' in update for update in server.received)
        await server.publish(PATH, 3.0)
        await ship.until(lambda: ship.values == [3.0])
        assert ship.requests == []
        # No name that only Python has for a part of the connection.
        assert not [reason for reason in ship.reasons if '<' in reason or 'ssl' in reason]


class _Sleeps:
    """asyncio, with sleeps that are noted and take no time, until there were enough."""

    def __init__(self) -> None:
        self.waits: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(asyncio, name)

    async def sleep(self, seconds: float) -> None:
        self.waits.append(seconds)
        if len(self.waits) == 6:
            raise asyncio.CancelledError


async def test_waits_grow_unless_a_connection_has_lived(
    server: SmallServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    ship, sleeps = Ship(server), _Sleeps()
    await server.stop()
    monkeypatch.setattr(signalk_client, 'asyncio', sleeps)
    monkeypatch.setattr(signalk_client.random, 'uniform', lambda low, high: high)
    with pytest.raises(asyncio.CancelledError):
        await ship.client.run()
    assert sleeps.waits == [0.5, 1.0, 2.0, 4.0, 5.0, 5.0]


async def test_a_frozen_server_is_noticed_by_its_silence(
    server: SmallServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signalk_client, 'HEARTBEAT', 0.2)
    server.frozen = True
    async with connected_client(Ship(server)) as ship:
        await ship.until(lambda: not ship.up('signalk_in'))
        server.frozen = False
        await ship.until(lambda: ship.up('signalk_in'))


async def test_a_server_without_echo_is_reported(
    server: SmallServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signalk_client, 'UNHEARD', 0.2)
    server.deaf = True
    async with connected_client(Ship(server)) as ship:
        await ship.until(lambda: ('signalk_out', False) in ship.links)
        assert ship.reasons[-1] == 'no echo from the server for 0.2 s'
        assert ship.up('signalk_in')
        server.deaf = False
        ship.client.take_alarms(alarm_list_in('unacknowledged'))
        await ship.until(lambda: ship.up('signalk_out'))


@pytest.mark.parametrize(
    ('status', 'value', 'token', 'reason'),
    [
        (401, 'no', False, 'the server gives nothing without a token: name a file as'),
        (403, 'no', True, 'the token may not read'),
        (404, 'no', True, 'the server has no such path'),
        (
            200,
            '{"value": 3, "timestamp": "2026-11-25T10:00:00Z"}',
            False,
            'its source is silent; the last value is of 2026-11-25T10:00:00Z',
        ),
        (200, '[]', False, 'asked for it the server answers 200'),
        (0, 'Connection refused', False, 'asked for it the server answers Connection refused'),
    ],
)
def test_the_reason_of_a_path_without_values(status: int, value: str, token: bool, reason: str) -> None:
    assert signalk_client._explain_silence(status, value, token).startswith(reason)


@pytest.mark.parametrize('accepts', [False, True])
async def test_people_act_at_the_server(server: SmallServer, accepts: bool) -> None:
    async with connected_client(Ship(server, accept_actions=accepts)) as ship:
        for state in ('unacknowledged', 'acknowledged', 'normal', 'unacknowledged'):
            ship.client.take_alarms(alarm_list_in(state))
            await ship.until(lambda state=state: ship.latest(STICK)['data']['lifecycle'] == state)
        assert ship.requests == []
        await server.act(STICK, silenced=True)
        await server.act(STICK, acknowledged=True)
        await server.publish(PATH, 1.0)
        await ship.until(lambda: ship.values)
        assert ship.requests == (['silence', 'acknowledge'] if accepts else [])


async def test_the_end_takes_values_back_and_leaves_alarms(server: SmallServer) -> None:
    async with connected_client(Ship(server)) as ship:
        ship.client.take_alarms(alarm_list_in('unacknowledged'))
        ship.client.take_record(RECORD)
        await ship.until(lambda: ship.latest(MARGIN) == -0.5)
        words = ['No data from the monitor.', 'The monitor was stopped.']

        def said() -> str:
            return str(ship.latest('notifications.p.shaft.monitor')['message'])

        await ship.until(lambda: said() == words[0], is_monitoring=False)
        await ship.client.finish()
        await wait_until(lambda: (ship.latest(MARGIN), said()) == (None, words[1]))
        assert ship.latest(STICK)['state'] == 'alarm'
        assert ship.latest('notifications.p.shaft.monitor')['state'] == 'warn'


@pytest.mark.parametrize(
    ('mode', 'is_taken'), [(0o600, True), (0o400, True), (0o640, False), (0o620, False), (0o604, False)]
)
def test_a_token_that_others_can_read_is_refused(tmp_path: Path, mode: int, is_taken: bool) -> None:
    path = tmp_path / 'token'
    path.write_text('0123456789abcdef\n')
    path.chmod(mode)
    with nullcontext() if is_taken else pytest.raises((LinkError, ConfigurationError), match='chmod 600'):
        assert read_signalk_token(str(path)) == '0123456789abcdef'


async def test_a_wrong_token_at_the_start_is_an_error_and_later_a_fault(server: SmallServer) -> None:
    server.token = 'the-right-one'
    ship = Ship(server, token='a-wrong-one', token_file='token')
    with pytest.raises(LinkError, match=r"token_file = 'token': the token is refused.* \(401\)"):
        await ship.client.run()
    async with connected_client(Ship(server, token='the-right-one', token_file='token')) as ship:
        server.token = 'another'
        await server.restart()
        await ship.until(lambda: any('the token is refused' in reason for reason in ship.reasons))
        assert not ship.up('signalk_in')
        server.token = 'the-right-one'
        await ship.until(lambda: ship.up('signalk_in'))


@pytest.mark.parametrize('greeting', ['no JSON {', '3', '{"name": "another"}'])
async def test_another_program_is_no_signal_k_server(server: SmallServer, greeting: str) -> None:
    server.greeting = greeting
    with pytest.raises(LinkError, match='is not a Signal K server'):
        await Ship(server).client.run()


@pytest.mark.parametrize(('version', 'works'), [('2.23.0', False), ('2.24.0', True)])
async def test_a_server_that_takes_an_acknowledgement_from_anybody(
    server: SmallServer, version: str, works: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signalk_client, 'is_loopback', lambda host: False)
    server.version = version
    if not works:
        with pytest.raises(LinkError, match=r'accept_actions must be false .* 2\.23\.0'):
            await Ship(server).client.run()
    async with connected_client(Ship(server, accept_actions=works)) as ship:
        assert ship.up('signalk_in')


@pytest.fixture(scope='module')
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a server's certificate, signed by itself, and its key."""
    folder = tmp_path_factory.mktemp('tls')
    request = ['-x509', '-newkey', 'rsa:2048', '-nodes', '-days', '2', '-subj', '/CN=ship']
    files = ['-addext', 'subjectAltName=IP:127.0.0.1', '-keyout', 'key.pem', '-out', 'cert.pem']
    command = ['openssl', 'req', *request, *files]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder


async def test_a_certificate_must_fit(server: SmallServer, certificate: Path, tmp_path: Path) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate / 'cert.pem', certificate / 'key.pem')
    await server.stop()
    await server.start(context)
    with pytest.raises(LinkError, match=r'TLS certificate not trusted .* signalk\.ca_file'):
        await Ship(server, 'https').client.run()
    ca_file = str(certificate / 'cert.pem')
    async with connected_client(Ship(server, 'https', ca_file=ca_file)) as ship:
        assert ship.up('signalk_in')
    for text in ('', 'no certificate'):
        (tmp_path / 'ca.pem').write_text(text)
        with pytest.raises(LinkError, match=r"ca_file = '.*ca\.pem' has no certificate"):
            signalk_client.make_ssl_context(str(tmp_path / 'ca.pem'))


@pytest.mark.parametrize(
    ('states', 'permission', 'expected'),
    [
        (['PENDING', 'PENDING', 'COMPLETED'], 'APPROVED', 'eyJ.a.token.of.the.server'),
        (['PENDING', 'COMPLETED'], 'DENIED', None),
    ],
)
async def test_a_token_is_requested(
    server: SmallServer, states: list[str], permission: str, expected: str | None
) -> None:
    server.requests, server.permission = states, permission
    link = SignalKLink(f'http://127.0.0.1:{server.port}', 'token', '', '', False)
    lines: list[str] = []
    request = request_token(link, 'id', lines.append, every=0.01)
    if expected is None:
        with pytest.raises(LinkError, match='was denied'):
            await request
    else:
        assert await request == expected
    assert lines == [f'Approve stickslip_monitor in the pages of {link.url} (Security, Access Requests)']
    await server.stop()
    with pytest.raises(LinkError, match=r'cannot be asked for a token: [^<]+$'):
        await request_token(link, 'id', lines.append)
