# SPDX-License-Identifier: Apache-2.0
"""The command: a recording on the page, and what it refuses."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from stickslip_monitor.cli import main
from stickslip_monitor.commands.dashboard import watched
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.messages import event_record
from stickslip_monitor.offline.check import check_bag

pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")

from stickslip_monitor.dashboard import replay
from stickslip_monitor.dashboard.state import DashboardState

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / 'launch_configs' / 'reference_bearing.yaml'
BAG = ROOT / 'bags' / 'history_above'
COMMAND = (sys.executable, '-m', 'stickslip_monitor.cli', 'dashboard', '--config', str(CONFIG))


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Starts a dashboard and returns its address; it is stopped when the test ends."""
    started: list[subprocess.Popen[bytes]] = []
    log = tmp_path / 'log'

    def start(*arguments: str) -> str:
        with log.open('wb') as file:
            started.append(
                subprocess.Popen(
                    [*COMMAND, '--port', '0', *arguments],
                    cwd=ROOT,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                )
            )
        end = time.monotonic() + 60.0
        while not (found := re.search(r'Dashboard on (http\S+)\n', log.read_text())):
            assert time.monotonic() < end, log.read_text()
            time.sleep(0.02)
        return found[1]

    yield start
    for process in started:
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
        assert log.read_text().count('\n') == 1, log.read_text()


def events(url: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Kind and content of every event of a stream."""
    with urllib.request.urlopen(f'{url}events', timeout=30.0) as stream:
        kind = ''
        for line in stream:
            if line.startswith(b'event: '):
                kind = line[7:].decode().strip()
            elif line.startswith(b'data: '):
                yield kind, json.loads(line[6:])


def test_a_recording_is_played_to_its_end(start: Callable[..., str]) -> None:
    url = start('--bag', str(BAG), '--rate', '600')
    for kind, document in events(url):
        if kind == 'monitor' and document['finished']:
            break
    _, state = next(events(url))
    assert state['source'] == {'name': str(BAG), 'replay': True}
    status = state['bearings'][0]['status']
    # The check reads the same recording in bulk.
    checked = check_bag(BAG, load_config(CONFIG)).bearings['aft_stern']
    assert status['inputs']['load']['counts']['accepted'] == checked.inputs[1].used
    assert status['reason'] == checked.events[-1].after.value == 'bistable'
    raised = [c['time'] for c in state['log'] if c['what'] == 'raise']
    expected = [event_record(event)['time'] // 10**6 for event in checked.events if event.raised]
    assert raised == expected
    # Nobody was there: what came and went waits.
    assert state['alarms']['unacknowledged'] == len(expected) > 0


class Board(DashboardState):
    """Notes when what is shown."""

    def __init__(self, now: Callable[[], float]) -> None:
        self.shown: list[tuple[float, int]] = []
        self._now = now
        super().__init__([watched(load_config(CONFIG), 'bag', replay=True)], replay=True)

    def play(self, place: dict[str, Any]) -> None:
        bearing = self.bearings['aft_stern']
        assert bearing.record is not None
        self.shown.append((self._now(), bearing.record['time'] * 10**6))
        super().play(place)


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> tuple[list[float], Board, replay.Replay]:
    """A recording played a hundred times as fast, on a clock that runs as it is slept."""
    now = [0.0]
    sleep = asyncio.sleep

    async def pass_time(seconds: float) -> None:
        now[0] += seconds
        await sleep(0.0)

    monkeypatch.setattr(replay.time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(replay.asyncio, 'sleep', pass_time)
    board = Board(lambda: now[0])
    return now, board, replay.Replay(str(BAG), load_config(CONFIG), 100.0, board)


def test_a_replay_takes_the_time_of_the_recording(played: Any) -> None:
    now, board, player = played
    asyncio.run(player.play())
    bag = check_bag(BAG, load_config(CONFIG)).bag
    assert bag.start_ns is not None
    assert bag.end_ns is not None
    assert now[0] == pytest.approx((bag.end_ns - bag.start_ns) * 1e-11, abs=0.2)
    # What is shown is never ahead of its time, nor more than one step behind.
    for at, time_ns in board.shown[:-2]:
        assert at == pytest.approx((time_ns - bag.start_ns) * 1e-11, abs=0.21)


def test_a_replay_stands_still_goes_back_and_comes_to_the_same(played: Any) -> None:
    """Held, it stays where it is; sent back, it ends as one that was played through."""
    now, board, player = played

    async def reach(condition: Callable[[], bool]) -> None:
        for _ in range(10_000):
            if condition():
                return
            await asyncio.sleep(0.01)
        pytest.fail('it does not come to that')

    async def work() -> tuple[Any, Any]:
        task = asyncio.create_task(player.run())
        await reach(lambda: board.playing is not None and board.playing['at'] > 60.0)
        player.hold(True)
        await reach(lambda: board.playing['paused'])
        at, since = board.playing['at'], now[0]
        await reach(lambda: now[0] > since + 5.0)
        assert board.playing['at'] == at
        # Forwards while it stands, then on to the end.
        player.seek(90.0)
        await reach(lambda: board.playing['at'] == 90.0)
        assert board.playing['paused']
        player.hold(False)
        await reach(lambda: board.finished)
        ends = [(board.alarms, board.log.csv())]
        # Backwards forgets what came later, and plays to the same end.
        player.seek(30.0)
        assert not board.finished
        await reach(lambda: board.playing['at'] >= 30.0)
        assert board.playing['at'] < 60.0
        assert len(board.log.csv()) < len(ends[0][1])
        await reach(lambda: board.finished)
        task.cancel()
        return ends[0], (board.alarms, board.log.csv())

    first, second = asyncio.run(work())
    assert first == second


REFUSED = {
    'one namespace': (
        ('--node', '/port/a', '--node', '/port/b'),
        "--node '/port/b' is in the same namespace as '/port/a'",
    ),
    'configurations': (
        ('--config', str(CONFIG), '--node', '/a/m', '--node', '/b/m', '--node', '/c/m'),
        '--config is given 2 times for 3 nodes',
    ),
    'a replay is not kept': (('--bag', str(BAG), '--log', 'x.json'), 'a replay is not kept'),
    'log': (('--log', 'nowhere/x.json'), "--log = 'nowhere/x.json': there is no folder"),
    'not a log': (('--log', str(CONFIG)), 'cannot be used: it is not JSON'),
    'rate': (('--bag', str(BAG), '--rate', '0'), '--rate 0 must be a number above 0'),
    'bag': (('--bag', 'nowhere'), "bag 'nowhere' does not exist"),
    'open to all': (
        ('--bag', str(BAG), '--host', '0.0.0.0'),
        '--host 0.0.0.0 lets others in: give --token-file',
    ),
    'a name is no loopback': (
        ('--bag', str(BAG), '--host', 'localhost.evil.test'),
        'lets others in: give --token-file',
    ),
    'port': (('--bag', str(BAG), '--port', '70000'), '--port 70000 must be from 0 to 65535'),
    'no token': (('--token-file', 'nowhere'), "token file 'nowhere' cannot be read: No such"),
}


@pytest.mark.parametrize('name', REFUSED)
def test_what_is_wrong_is_said(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, words = REFUSED[name]
    assert main(['dashboard', '--config', str(CONFIG), *arguments]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith('ERROR: ')
    assert words in printed
    assert printed.count('\n') == 1


def test_a_short_token_is_refused_and_not_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'token'
    file.touch(0o600)
    file.write_text('hunter2\n')
    assert main(['dashboard', '--config', str(CONFIG), '--token-file', str(file)]) == 2
    printed = capsys.readouterr().err
    assert 'must hold at least 16 printable ASCII characters' in printed
    assert 'hunter2' not in printed


def test_with_a_token_others_may_come(start: Callable[..., str], tmp_path: Path) -> None:
    file = tmp_path / 'token'
    file.touch(0o600)
    file.write_text('correct-horse-battery\n')
    url = start('--bag', str(BAG), '--host', '0.0.0.0', '--token-file', str(file))
    assert url.startswith('http://0.0.0.0:')
    request = urllib.request.Request(
        f'{url}metrics', headers={'Authorization': 'Bearer correct-horse-battery'}
    )
    with urllib.request.urlopen(request, timeout=10.0) as answer:
        assert b'stickslip_monitor_up' in answer.read()
    with pytest.raises(urllib.error.HTTPError, match='401'):
        urllib.request.urlopen(f'{url}metrics', timeout=10.0)
