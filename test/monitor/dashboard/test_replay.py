# SPDX-License-Identifier: Apache-2.0
"""A recording in its own time: never ahead of it, held, sent back, and the same end again; its picture."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shared import CONFIG, ROOT

from stickslip_monitor.cli import main
from stickslip_monitor.commands.dashboard import make_watched_monitor
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.offline.check import check_recording

pytest.importorskip('aiohttp', reason="the extra 'dashboard' is not installed")

from stickslip_monitor.dashboard import replay
from stickslip_monitor.dashboard.seen_monitors import DashboardState

BAG = ROOT / 'bags' / 'history_above'


class Board(DashboardState):
    """Notes when what is shown."""

    def __init__(self, now: Callable[[], float]) -> None:
        self.shown_times: list[tuple[float, int]] = []
        self._now = now
        super().__init__([make_watched_monitor(load_config(CONFIG), 'bag', replay=True)], replay=True)

    def show_place(self, place: dict[str, Any]) -> None:
        bearing = self.bearings['aft_stern']
        self.shown_times.append((self._now(), bearing.record['time'] * 10**6))
        super().show_place(place)


@pytest.fixture
def hundredfold(monkeypatch: pytest.MonkeyPatch) -> tuple[list[float], Board, replay.Replay]:
    """Return a recording played a hundred times as fast, on a clock that runs as it is slept."""
    now = [0.0]
    sleep = asyncio.sleep

    async def pass_time(seconds: float) -> None:
        now[0] += seconds
        await sleep(0.0)

    monkeypatch.setattr(replay.time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(replay.asyncio, 'sleep', pass_time)
    board = Board(lambda: now[0])
    return now, board, replay.Replay(str(BAG), load_config(CONFIG), 100.0, board)


def test_a_replay_takes_the_time_of_the_recording(hundredfold: Any) -> None:
    now, board, player = hundredfold
    asyncio.run(player.play())
    bag = check_recording(BAG, load_config(CONFIG)).bag
    assert now[0] == pytest.approx((bag.end_ns - bag.start_ns) * 1e-11, abs=0.2)
    # What is shown is never ahead of its time, nor more than one step behind.
    for at, time_ns in board.shown_times[:-2]:
        assert at == pytest.approx((time_ns - bag.start_ns) * 1e-11, abs=0.21)


def test_a_replay_stands_still_goes_back_and_comes_to_the_same(hundredfold: Any) -> None:
    """Held, it stays where it is; sent back, it ends as one that was played through."""
    now, board, player = hundredfold

    async def reach(condition: Callable[[], bool]) -> None:
        for _ in range(10_000):
            if condition():
                return
            await asyncio.sleep(0.01)
        pytest.fail('it does not come to that')

    async def work() -> tuple[Any, Any]:
        task = asyncio.create_task(player.run())
        await reach(lambda: board.playing is not None and board.playing['at'] > 60.0)
        player.set_paused(True)
        await reach(lambda: board.playing['paused'])
        at, since = board.playing['at'], now[0]
        await reach(lambda: now[0] > since + 5.0)
        assert board.playing['at'] == at
        # Forwards while it stands, then on to the end.
        player.seek(90.0)
        await reach(lambda: board.playing['at'] == 90.0)
        assert board.playing['paused']
        player.set_paused(False)
        await reach(lambda: board.finished)
        ends = [(board.alarms, board.log.to_csv())]
        # Backwards forgets what came later, and plays to the same end.
        player.seek(30.0)
        assert not board.finished
        await reach(lambda: board.playing['at'] >= 30.0)
        assert board.playing['at'] < 60.0
        assert len(board.log.to_csv()) < len(ends[0][1])
        await reach(lambda: board.finished)
        task.cancel()
        return ends[0], (board.alarms, board.log.to_csv())

    first, second = asyncio.run(work())
    assert first == second


def test_a_log_of_columns_is_replayed_as_a_recording(tmp_path: Path) -> None:
    # From 60 rpm to 20, where the reference bearing is in stick-slip below 30.7 rpm.
    rows = [f'{k},{60 - k},1000' for k in range(41)]
    (tmp_path / 'voyage.csv').write_text('\n'.join(['time [s],shaft speed [rpm],load [N]', *rows]))
    board = Board(lambda: 0.0)
    player = replay.Replay(str(tmp_path / 'voyage.csv'), load_config(CONFIG), 1e4, board)
    asyncio.run(player.play())
    assert board.finished
    assert board.bearings['aft_stern'].record['reason'] == 'stick_slip'
    raised = [entry['alarm'] for entry in board.log.latest() if entry['what'] == 'raise']
    assert raised == ['margin_low', 'bistable', 'stick_slip']


def test_the_picture_says_what_the_program_says(capsys: pytest.CaptureFixture[str]) -> None:
    """Compare the texts in the picture; `python scripts/make_pictures.py` takes it again."""
    image: Any = pytest.importorskip('PIL.Image')
    with image.open(ROOT / 'docs/images/dashboard.png') as picture:
        pictured = json.loads(picture.text['Description'])
    main(['check', str(ROOT / 'bags/coast_down'), '-c', str(CONFIG), '--json'])
    (bearing,) = json.loads(capsys.readouterr().out)['bearings'].values()
    texts = [event['text'] for event in bearing['events']]
    assert len(pictured) == 3
    for text in pictured:
        assert any(event_text.endswith(text) for event_text in texts), (text, texts)
