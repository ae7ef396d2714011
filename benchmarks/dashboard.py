# SPDX-License-Identifier: Apache-2.0
"""How busy a browser is with the page of fifty bearings, and the dashboard with its readers."""

from __future__ import annotations

import asyncio
import itertools
import math
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from benchmarks.table import NOT_INSTALLED, Table, absent
from scripts.chromium import Page, first_page, run_chromium
from stickslip_monitor.commands.dashboard import make_watched_monitor
from stickslip_monitor.dashboard.access import Access
from stickslip_monitor.dashboard.seen_monitors import DashboardState
from stickslip_monitor.dashboard.server import Server
from stickslip_monitor.monitor.bearing_monitor import Monitor
from stickslip_monitor.monitor.bearing_records import BearingState, bearing_record
from stickslip_monitor.monitor.parameter_file import NODE_NAME, load_config
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.sample_types import Input

REFERENCE = Path(__file__).parents[1] / 'launch_configs' / 'reference_bearing.yaml'
COLUMNS = ('bearings, each published', 'tabs', 'main thread of a tab', 'dashboard')
_SETTLE = 3.0


def run(quick: bool) -> Table:
    """Measure; return the table of the section."""
    seconds = 5.0 if quick else 20.0
    rows = []
    for bearings, rate, tabs in ((1, 10, 1), (50, 1, 1), (50, 10, 1), (50, 10, 8)):
        label = f'{bearings} at {rate}/s'
        try:
            busy, server = asyncio.run(_measure_load(bearings, rate, tabs, seconds))
            rows.append([label, str(tabs), f'{100 * busy:.1f} %', f'{100 * server:.1f} %'])
        except FileNotFoundError:
            rows.append(absent(label, len(COLUMNS), f'Chromium is {NOT_INSTALLED}'))
    return Table(
        'The page in a browser',
        'The share of a core of a tab in Chromium without a graphics processor, and of the dashboard,'
        ' which runs the monitor.',
        COLUMNS,
        rows,
    )


def _make_fleet(bearings: int) -> MonitorConfig:
    config = load_config(REFERENCE)
    (reference,) = config.bearings
    bearing_configs = (replace(reference, name=f'bearing_{k:02}') for k in range(bearings))
    return replace(config, bearings=tuple(bearing_configs))


async def _measure_load(bearings: int, rate: float, tabs: int, seconds: float) -> tuple[float, float]:
    """Return the busy shares of the first tab's main thread and of this process."""
    config = _make_fleet(bearings)
    board = DashboardState([make_watched_monitor(config, f'/{NODE_NAME}')])
    server = Server(board, Access())
    listening = await server.listen('127.0.0.1', 0)
    url = f'http://127.0.0.1:{listening.sockets[0].getsockname()[1]}/'
    feed = asyncio.create_task(_feed_monitors(config, board, rate))
    try:
        return await _watch_page(url, tabs, seconds)
    finally:
        feed.cancel()
        await server.close()


async def _feed_monitors(config: MonitorConfig, board: DashboardState, rate: float) -> None:
    """Swing the speeds of all bearings through their conditions."""
    monitor, (watched,) = Monitor(config), board.monitors
    begin = asyncio.get_running_loop().time()
    for step in itertools.count():
        now_ns = time.time_ns()
        for k, bearing in enumerate(monitor.bearings.values()):
            rpm = 40.0 + 20.0 * math.sin(0.1 * step / rate + k)
            bearing.update(Input.SPEED, now_ns, rpm)
            bearing.update(Input.LOAD, now_ns, 1000.0)
            watched.take_record(bearing_record(BearingState(bearing)))
        elapsed = asyncio.get_running_loop().time() - begin
        await asyncio.sleep(max((step + 1) / rate - elapsed, 0.0))


async def _watch_page(url: str, tabs: int, seconds: float) -> tuple[float, float]:
    with ExitStack() as stack:
        port = await asyncio.to_thread(stack.enter_context, run_chromium())
        async with first_page(port) as page:
            await page.call('Performance.enable')
            for _ in range(tabs - 1):
                await page.call('Target.createTarget', url=url, background=True)
            await page.call('Page.navigate', url=url)
            await asyncio.sleep(_SETTLE)
            start = await _main_thread_seconds(page), time.process_time(), time.monotonic()
            await asyncio.sleep(seconds)
            end = await _main_thread_seconds(page), time.process_time(), time.monotonic()
    thread, process, passed = (b - a for a, b in zip(start, end, strict=True))
    return thread / passed, process / passed


async def _main_thread_seconds(page: Page) -> float:
    """Return for how long the main thread has worked [s]."""
    metrics = (await page.call('Performance.getMetrics'))['metrics']
    return next(float(m['value']) for m in metrics if m['name'] == 'TaskDuration')
