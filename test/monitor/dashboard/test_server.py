# SPDX-License-Identifier: Apache-2.0
"""The server: streams that bound what waits, and doors that keep strangers out."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from shared import DEADLINE, until

from stickslip_monitor.errors import DashboardError, RosError

pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")

import aiohttp

ACTION = {
    'schema': 'stickslip_monitor/action/1',
    'action': 'acknowledge',
    'by': 'Ada',
    'bearing': 'aft_stern',
    'alarm': 'stick_slip',
}
TOKEN = 'correct-horse-battery'


def with_client(work: Callable[[Any], Awaitable[Any]]) -> Any:
    """Do something with a client's session."""

    async def go() -> Any:
        jar = aiohttp.CookieJar(unsafe=True)
        limit = aiohttp.TCPConnector(limit=0)
        async with aiohttp.ClientSession(cookie_jar=jar, connector=limit) as session:
            return await asyncio.wait_for(work(session), DEADLINE)

    return asyncio.run(go())


async def next_event(stream: Any, kind: str) -> dict[str, Any]:
    """Return the data of the next event of a kind."""
    fields: dict[str, str] = {}
    while True:
        line = (await stream.content.readline()).decode()
        assert line, 'the stream has ended'
        if line == '\n':
            if fields.get('event') == kind:
                return dict(json.loads(fields['data']))
            fields = {}
        else:
            name, _, value = line.rstrip('\n').partition(': ')
            fields[name] = value


def post_action(
    dashboard: Any, document: Any = ACTION, path: str = 'act', **headers: str
) -> tuple[int, dict[str, Any]]:
    """Post an action; return status and answer."""

    async def work(session: Any) -> tuple[int, Any]:
        async with session.post(f'{dashboard.url}{path}', json=document, headers=headers) as answer:
            return answer.status, await answer.text()

    code, text = with_client(work)
    return code, json.loads(text) if text.startswith('{') else {'text': text}


def get_page(dashboard: Any, path: str = '', **headers: str) -> tuple[int, Any, str]:
    """Status, headers and text of a page."""

    async def work(session: Any) -> tuple[int, Any, str]:
        async with session.get(f'{dashboard.url}{path}', headers=headers, allow_redirects=False) as answer:
            return answer.status, answer.headers, await answer.text()

    return with_client(work)


# --- streams -----------------------------------------------------------------------------------


def join_deaf_reader(dashboard: Any) -> tuple[socket.socket, Any]:
    """Open a stream whose reader never reads; return the socket, and the reader at the server."""
    # What the system takes on its behalf is some hundred kB, whatever the machine is tuned for.
    dashboard.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    deaf = socket.create_connection(('127.0.0.1', dashboard.port))
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.sendall(b'GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n')
    until(lambda: len(dashboard.server.hub.readers) == 1, 'the one')
    (reader,) = dashboard.server.hub.readers
    # From here on whatever comes must wait.
    for _ in range(20):
        dashboard.do(lambda: reader.put('', b':' + bytes(10**6)))
    return deaf, reader


def test_a_reader_that_takes_nothing_for_long_is_let_go(dashboards: Any) -> None:
    dashboard = dashboards(MAX_STALL=0.1)
    deaf, _ = join_deaf_reader(dashboard)
    until(lambda: not dashboard.server.hub.readers, 'the end of the one')
    deaf.close()


def test_fifty_readers_and_one_that_never_reads(dashboard: Any) -> None:
    """Send many events to fifty readers; nothing piles up for one that never reads."""
    deaf, deaf_reader = join_deaf_reader(dashboard)

    def storm() -> None:
        for k in range(20):
            dashboard.ship.sail(60.0 + k / 100.0, 1000.0)

    async def read(session: Any, ready: list[int]) -> float:
        async with session.get(f'{dashboard.url}events') as stream:
            await next_event(stream, 'state')
            ready.append(1)
            while True:
                status = await next_event(stream, 'status')
                if status['load'] == 500.0:
                    return float(status['rpm'])

    async def work(session: Any) -> list[float]:
        ready: list[int] = []
        tasks = [asyncio.create_task(read(session, ready)) for _ in range(50)]
        while len(ready) < 50:
            await asyncio.sleep(0.01)
        for _ in range(10):
            await asyncio.to_thread(dashboard.do, storm)
        assert (
            {'', 'status aft_stern'}
            <= set(deaf_reader._waiting)
            <= {'', 'status aft_stern', 'monitor ', 'alarms '}
        )
        await asyncio.to_thread(dashboard.sail, 70.0, 500.0)
        return await asyncio.gather(*tasks)

    speeds = with_client(work)
    assert speeds == pytest.approx([70.0] * 50, rel=1e-8)
    deaf.close()
    until(lambda: not dashboard.server.hub.readers, 'the end of all')


def test_a_look_at_the_head_opens_no_stream(dashboard: Any) -> None:
    async def work(session: Any) -> int:
        async with session.head(f'{dashboard.url}events') as answer:
            return int(answer.status)

    assert with_client(work) == 404


def test_more_readers_than_there_is_room_for(dashboard: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('stickslip_monitor.dashboard.server.MAX_READERS', 1)
    # The last ones are kept for people who have signed in.
    with pytest.raises(DashboardError, match='are open already'):
        dashboard.server.hub.join(signed_in=False)

    async def work(session: Any) -> None:
        async with session.get(f'{dashboard.url}events') as stream:
            await next_event(stream, 'state')
            async with session.get(f'{dashboard.url}events') as second:
                assert second.status == 503
                assert 'close one' in await second.text()

    with_client(work)


def idle_connection(port: int, start: bytes = b'') -> socket.socket:
    connection = socket.create_connection(('127.0.0.1', port), timeout=DEADLINE)
    connection.sendall(start)
    return connection


def is_closed_by_peer(connection: socket.socket) -> bool:
    """Return whether the other end closes a connection, in the time it waits."""
    try:
        return connection.recv(1) == b''
    except ConnectionError:
        return True


@pytest.mark.parametrize('start', [b'', b'GET / HTTP/1.1\r\nHost: loc'])
def test_a_connection_that_asks_for_nothing_is_closed(dashboards: Any, start: bytes) -> None:
    connection = idle_connection(dashboards(MAX_IDLE=0.2).port, start)
    assert is_closed_by_peer(connection)
    connection.close()


def test_idle_connections_lock_nobody_out(dashboards: Any, caplog: Any) -> None:
    """Open thirty times as many connections as there is room for: the page still opens."""
    crowded = dashboards(MAX_CONNECTIONS=10)
    crowded.sail(60.0, 1000.0)

    async def work(session: Any) -> int:
        async with session.get(f'{crowded.url}events') as stream:
            await next_event(stream, 'state')
            idle = [idle_connection(crowded.port) for _ in range(300)]
            await next_event(stream, 'beat')
            async with session.get(crowded.url) as answer:
                code = int(answer.status)
            assert await asyncio.to_thread(is_closed_by_peer, idle[0])
            for connection in idle:
                connection.close()
            return code

    assert with_client(work) == 200
    assert caplog.text == ''


@pytest.mark.parametrize(
    'start', [b'\x16\x03\x01\x00\xa5\r\n\r\n', b'GET / HTTP/9.9\r\n\r\n', b'GET / HTTP/1.1\r\nA : b\r\n\r\n']
)
def test_a_port_scan_leaves_no_traceback(dashboard: Any, caplog: Any, start: bytes) -> None:
    connection = idle_connection(dashboard.port, start)
    assert connection.recv(1000).startswith(b'HTTP/1.0 400')
    connection.close()
    assert caplog.text == ''


def test_one_connection_more_than_the_limit_is_closed(dashboards: Any) -> None:
    crowded = dashboards(MAX_CONNECTIONS=2)

    async def work(session: Any) -> None:
        for _ in range(2):
            stream = await session.get(f'{crowded.url}events')
            await next_event(stream, 'state')
        third = idle_connection(crowded.port)
        assert await asyncio.to_thread(is_closed_by_peer, third)
        third.close()
        await next_event(stream, 'beat')

    with_client(work)


# --- actions -----------------------------------------------------------------------------------


NO_REQUESTS: list[tuple[dict[str, Any], str]] = [
    ({'action': 'explode'}, "action = 'explode' must be one of acknowledge"),
    ({'action': None}, 'action = None must be one of'),
    ({'action': 'suppress'}, "action = 'suppress' no longer exists: use 'shelve'"),
    ({'action': 'remove'}, 'remove is not for a dashboard'),
    ({'bearing': 'fore'}, "bearing = 'fore' must be one of aft_stern"),
    ({'alarm': ['stick_slip']}, "alarm = ['stick_slip'] must be one of"),
    ({'by': '  '}, "by = '  ' must be a name of 1 to 40"),
    ({'by': 'a\nb'}, 'printable'),
    ({'by': 'Monitor'}, "'Monitor' must be the name of a person"),
    ({'by': 7}, 'by = 7 must be a name'),
    ({'reason': 'x' * 201}, 'must be at most 200 printable'),
    ({'schema': 'other/1'}, "schema = 'other/1' must be 'stickslip_monitor/action/1'"),
]


def test_an_invalid_request_is_refused(dashboard: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    for change, words in NO_REQUESTS:
        code, answer = post_action(dashboard, ACTION | change)
        assert (code, answer['ok'], words in answer['text']) == (400, False, True), answer
    assert dashboard.ship.requests == []


def test_invalid_courses_of_a_replay_are_refused(dashboards: Any) -> None:
    dashboard = dashboards(player=object())
    for document, words in (
        ({'paused': 'yes'}, "paused = 'yes' must be true or false"),
        ({'at': '3'}, "at = '3' must be a finite number s"),
        ({'at': True}, 'at = True must be a finite number'),
        ([], 'must be a JSON object'),
    ):
        code, answer = post_action(dashboard, document, 'replay')
        assert (code, answer['ok'], words in answer['text']) == (400, False, True), answer


def test_an_action_without_answer_of_the_monitor_is_not_confirmed(
    dashboard: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('stickslip_monitor.dashboard.server.ACTION_TIMEOUT', 0.1)
    dashboard.sail(20.0, 1000.0, 5.0)
    dashboard.ship.deaf = True
    code, answer = post_action(dashboard)
    assert (code, answer['ok']) == (409, False)
    assert 'it may not have been done' in answer['text']

    def refuse(_: Any) -> None:
        raise RosError('the monitor is not there')

    monkeypatch.setattr(dashboard.ship.watched, 'act', refuse)
    assert post_action(dashboard) == (503, {'ok': False, 'text': 'the monitor is not there'})


def test_nothing_can_be_changed_but_alarms(dashboard: Any) -> None:
    # There is one way to act, and it is for alarms.
    routes = {
        (route.method, route.resource.canonical)
        for route in dashboard.server.application().router.routes()
        if route.method not in ('GET', 'HEAD')
    }
    assert routes == {('POST', '/act'), ('POST', '/login'), ('POST', '/logout')}


# --- doors -------------------------------------------------------------------------------------


def test_another_page_cannot_act(dashboard: Any) -> None:
    dashboard.sail(20.0, 1000.0, 5.0)
    origin = dashboard.url.rstrip('/')
    assert post_action(dashboard, Origin='http://evil.test')[0] == 403
    assert post_action(dashboard, Origin='null')[0] == 403
    assert post_action(dashboard, Origin='http://127.0.0.1:1')[0] == 403
    assert post_action(dashboard, **{'Sec-Fetch-Site': 'cross-site'})[0] == 403
    # What a form of another page can send without asking is no JSON.
    assert post_action(dashboard, **{'Content-Type': 'text/plain'})[0] == 415
    assert post_action(dashboard, ACTION | {'by': 'x' * 10_000})[0] == 413
    assert dashboard.ship.requests == []
    assert post_action(dashboard, Origin=origin, **{'Sec-Fetch-Site': 'same-origin'})[0] == 200
    # Behind a proxy with a name of its own only the browser can vouch for the page.
    proxied = {'Origin': 'https://ship.example', 'Sec-Fetch-Site': 'same-origin'}
    assert post_action(dashboard, **proxied)[0] == 409  # admitted: it is acknowledged already
    assert post_action(dashboard, **{**proxied, 'Sec-Fetch-Site': 'same-site'})[0] == 403


def test_a_name_that_is_not_ours_is_refused(dashboard: Any) -> None:
    """Refuse a foreign name that points at this machine (DNS rebinding)."""
    ours = ('ship.test', 'SHIP.test:8370', 'localhost', '[::1]:8370', '10.1.2.3')
    foreign = ('evil.test', '127.0.0.1.evil.test', 'localhost.evil.test:8370', '', '[')
    for path in ('', 'metrics'):
        assert [get_page(dashboard, path, Host=host)[0] for host in ours] == [200] * len(ours)
        assert [get_page(dashboard, path, Host=host)[0] for host in foreign] == [421] * len(foreign)


def test_two_pages_of_one_host_have_two_sessions(dashboards: Any) -> None:
    # A browser sends the cookies of all ports of a host to each of them.
    first, second = dashboards(token=TOKEN), dashboards(token=f'another {TOKEN}')

    async def work(session: Any) -> None:
        for page, token in ((first, TOKEN), (second, f'another {TOKEN}')):
            await session.post(f'{page.url}login', data={'token': token})
        for page in (first, second):
            assert (await session.get(f'{page.url}metrics')).status == 200
        assert (await session.post(f'{second.url}logout')).status == 204
        assert (await session.get(f'{first.url}metrics')).status == 200
        assert (await session.get(f'{second.url}metrics')).status == 401

    with_client(work)


def test_without_the_token_nothing_of_the_ship_is_seen(dashboards: Any) -> None:
    locked = dashboards(token=TOKEN)
    locked.sail(20.0, 1000.0, 5.0)
    for path in ('events', 'metrics', 'page.js', 'nothing'):
        code, headers, text = get_page(locked, path)
        assert (code, text) == (401, 'The token is missing or wrong.\n')
        assert headers['WWW-Authenticate'] == 'Bearer'
    assert post_action(locked)[0] == 401
    code, headers, _ = get_page(locked)
    assert (code, headers['Location']) == (303, 'login')
    for wrong in ('', TOKEN[:-1], TOKEN + 'x', 'ünïcode'):
        assert get_page(locked, 'metrics', Authorization=f'Bearer {wrong}')[0] == 401
        assert get_page(locked, 'metrics', Cookie=f'stickslip_session={TOKEN}')[0] == 401
    assert get_page(locked, 'metrics', Authorization=f'Basic {TOKEN}')[0] == 401
    # Not in an address either: those end up in logs.
    assert get_page(locked, f'metrics?token={TOKEN}')[0] == 401
    assert locked.ship.requests == []
    assert get_page(locked, 'metrics', Authorization=f'Bearer {TOKEN}')[0] == 200
    assert post_action(locked, Authorization=f'Bearer {TOKEN}')[0] == 200


def test_a_session_begins_with_the_token_and_can_be_ended(dashboards: Any) -> None:
    locked = dashboards(token=TOKEN)

    async def work(session: Any) -> None:
        async def login(**headers: str) -> Any:
            return await session.post(
                f'{locked.url}login', data={'token': TOKEN}, headers=headers, allow_redirects=False
            )

        assert (await login(Origin='http://evil.test')).status == 403
        cookie = (await login()).headers['Set-Cookie']
        assert TOKEN not in cookie
        assert 'HttpOnly' in cookie
        assert 'SameSite=Strict' in cookie
        copied = {'Cookie': cookie.partition(';')[0]}
        assert (await session.get(f'{locked.url}metrics')).status == 200
        async with session.get(f'{locked.url}events') as stream:
            state = await next_event(stream, 'state')
            assert state['signed_in']
        assert (await session.post(f'{locked.url}logout')).status == 204
        # Neither the browser nor a copy of its cookie gets in again.
        for headers in ({}, copied):
            assert (await session.get(f'{locked.url}metrics', headers=headers)).status == 401
        # Somebody else's session goes on.
        await login()
        assert (await session.get(f'{locked.url}metrics')).status == 200

    with_client(work)


@pytest.mark.parametrize(('token', 'code'), [(TOKEN, 200), (TOKEN + '2', 303)])
def test_a_new_token_logs_everybody_out_and_a_restart_nobody(dashboards: Any, token: str, code: int) -> None:
    async def work(session: Any) -> int:
        first = dashboards(token=TOKEN)
        await session.post(f'{first.url}login', data={'token': TOKEN})
        await asyncio.to_thread(first.stop)
        second = await asyncio.to_thread(lambda: dashboards(token=token, port=first.port))
        async with session.get(second.url, allow_redirects=False) as answer:
            return int(answer.status)

    assert with_client(work) == code


def test_no_page_of_another_may_hold_or_feed_this_one(dashboard: Any) -> None:
    for path in ('', 'page.js', 'page.css', 'login', 'nothing'):
        _, headers, _ = get_page(dashboard, path)
        policy = dict(part.split(' ', 1) for part in headers['Content-Security-Policy'].split('; '))
        assert policy['default-src'] == policy['frame-ancestors'] == "'none'"
        assert set(policy.values()) == {"'none'", "'self'"}
        assert headers['X-Content-Type-Options'] == 'nosniff'
        assert headers['Cross-Origin-Resource-Policy'] == 'same-origin'
