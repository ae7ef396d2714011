# SPDX-License-Identifier: Apache-2.0
"""Serve a page that shows the bearings and their alarms, and takes actions on them.

Without --bag it listens to a running monitor over ROS 2; with --bag it runs the monitor over a
recording, in the recording's time. It listens on this machine only; to open it to others give
--host and a token file. /metrics is for Prometheus.
"""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import math
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from stickslip_monitor.commands.output import add_config
from stickslip_monitor.drawing.map import map_ranges
from stickslip_monitor.drawing.map_curves import boundaries
from stickslip_monitor.errors import ConfigurationError, DashboardError, RosError
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import NODE_NAME, load_config

if TYPE_CHECKING:
    from stickslip_monitor.dashboard.access import Access
    from stickslip_monitor.dashboard.state import BearingView, DashboardState, Desk
    from stickslip_monitor.ros.watcher import TakeStatus, Watcher

DEFAULT_PORT = 8370
_SPEEDS_DRAWN = 120
_LOCALHOST = 'localhost'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_config(parser)
    add_page(parser)
    parser.add_argument(
        '--port', type=int, default=DEFAULT_PORT, help=f'0 for any (default {DEFAULT_PORT})'
    )
    parser.add_argument('--bag', metavar='BAG', help='replay this recording instead of ROS 2')
    parser.add_argument(
        '--rate', type=float, default=1.0, help='replay so many times faster (default 1)'
    )
    parser.add_argument(
        '--node', default=f'/{NODE_NAME}', help=f"the monitor's full name (default /{NODE_NAME})"
    )


def add_page(parser: argparse.ArgumentParser) -> None:
    """Declare what a page needs beside its port, and where a node's diagnostics are."""
    parser.add_argument(
        '--host', default='127.0.0.1', metavar='ADDRESS', help='listen here (default 127.0.0.1)'
    )
    parser.add_argument(
        '--token-file', metavar='FILE', help='file with the token that opens the page'
    )
    parser.add_argument(
        '--name', action='append', default=[], help='host name by which people reach this machine'
    )
    parser.add_argument(
        '--diagnostics', default='/diagnostics', metavar='TOPIC', help='(default /diagnostics)'
    )


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    try:
        from stickslip_monitor.dashboard.state import DashboardState
    except ImportError as error:
        raise missing_extra(error) from error
    config = load_config(args.config)
    access = page_access(args)
    source = args.bag or args.node
    board = DashboardState(
        [bearing_view(b) for b in config.bearings], source, replay=args.bag is not None
    )
    asyncio.run(_serve(args, config, board, access))
    return 0


def missing_extra(error: ImportError) -> DashboardError:
    """What to install for a page."""
    return DashboardError(
        f"a dashboard needs the extra 'dashboard' ({error}):"
        " pip install 'stickslip_monitor[dashboard]'"
    )


def page_access(args: argparse.Namespace) -> Access:
    """Who may see the page.

    Raises:
        ConfigurationError: The port is none.
        DashboardError: The page would be open to others without a token.
    """
    try:
        from stickslip_monitor.dashboard.access import Access, read_token
    except ImportError as error:
        raise missing_extra(error) from error
    if not 0 <= args.port <= 65535:
        raise ConfigurationError(f'--port {args.port} must be from 0 to 65535')
    token = '' if args.token_file is None else read_token(args.token_file)
    if not token and not _is_loopback(args.host):
        raise DashboardError(
            f'--host {args.host} lets others in: give --token-file, with a token that they know'
        )
    names = {name.lower() for name in (*args.name, args.host, socket.gethostname())}
    return Access(token, frozenset(names))


def _is_loopback(host: str) -> bool:
    if host == _LOCALHOST:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


async def _serve(
    args: argparse.Namespace, config: MonitorConfig, board: DashboardState, access: Access
) -> None:
    try:
        from stickslip_monitor.dashboard.server import Server, serve
    except ImportError as error:
        raise missing_extra(error) from error
    open_desk = _replay if args.bag is not None else _live
    with open_desk(args, config, board) as desk:
        application = Server(board, desk, access).application()
        await serve(application, board, args.host, args.port, say_address)


def say_address(url: str) -> None:
    """Say where the page is."""
    Console(markup=False, highlight=False, soft_wrap=True).print(f'Dashboard on {url}')
    sys.stdout.flush()


@contextmanager
def _live(args: argparse.Namespace, _: MonitorConfig, board: DashboardState) -> Iterator[Desk]:
    """Feed the board by a monitor that runs beside."""
    with listen_to_node(args, board.take_status, board.take_alarms, board.take_other) as watcher:
        yield watcher


@contextmanager
def listen_to_node(
    args: argparse.Namespace,
    take_status: TakeStatus,
    take_alarms: Callable[[Any], None],
    take_other: Callable[[str], None],
) -> Iterator[Watcher]:
    """Listen to a node from a thread of its own, and take what it says on the running loop.

    Raises:
        RosError: ROS 2 is not there.
    """
    try:
        from stickslip_monitor.ros.watcher import open_watcher
    except ImportError as error:
        raise RosError(
            f'ROS 2 is not available ({error}): source its setup file, or install this package'
            " with the extra 'ros'"
        ) from error
    loop = asyncio.get_running_loop()

    def on_loop(take: Callable[..., None]) -> Callable[..., None]:
        def hand_over(*values: Any) -> None:
            loop.call_soon_threadsafe(take, *values)

        return hand_over

    with open_watcher(
        args.node,
        args.diagnostics,
        on_loop(take_status),
        on_loop(take_alarms),
        on_loop(take_other),
    ) as watcher:
        yield watcher


@contextmanager
def _replay(
    args: argparse.Namespace, config: MonitorConfig, board: DashboardState
) -> Iterator[Desk]:
    """Feed the board by a recording."""
    from stickslip_monitor.dashboard.replay import Replay

    replay = Replay(args.bag, config, args.rate, board)
    task = asyncio.get_running_loop().create_task(replay.play())
    try:
        yield replay
    finally:
        task.cancel()


def bearing_view(config: BearingConfig) -> BearingView:
    """The bearing with its stability map."""
    from stickslip_monitor.dashboard.state import BearingView, Curves

    bearing, alarm = config.bearing, config.alarm
    speeds, loads = map_ranges(bearing)
    curves = boundaries(bearing, speeds, loads, alarm.caution_margin, _SPEEDS_DRAWN)
    limit = alarm.amplitude_limit
    return BearingView(
        name=config.name,
        rpm=float(bearing.speed.from_surface(1.0, 'rpm')),
        speeds=speeds,
        loads=loads,
        curves=Curves(
            [float(f'{v:.6g}') for v in curves.speed],
            *(_column(c) for c in (curves.caution_load, curves.fold_load, curves.hopf_load)),
        ),
        caution_margin=alarm.caution_margin,
        amplitude_limit=limit if math.isfinite(limit) else None,
        topics={'speed': config.speed.topic, 'load': config.load.topic},
    )


def _column(loads: Any) -> list[float | None]:
    return [float(f'{load:.6g}') if np.isfinite(load) else None for load in loads]
