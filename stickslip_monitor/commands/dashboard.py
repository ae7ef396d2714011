# SPDX-License-Identifier: Apache-2.0
"""Serve a page that shows the bearings and their alarms, and takes actions on them.

Without --bag it shows running monitors over ROS 2; with --bag it replays a recording through the
monitor. It listens on this machine only; to open it to others give --host and a token file.
/metrics is for Prometheus.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import socket
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from stickslip_monitor import jit
from stickslip_monitor.commands import options
from stickslip_monitor.drawing.map import boundaries, map_ranges
from stickslip_monitor.errors import ConfigurationError, DashboardError, missing_ros_error
from stickslip_monitor.links.links_config import is_loopback
from stickslip_monitor.monitor.parameter_file import NODE_NAME, load_config
from stickslip_monitor.monitor.parameters import BearingConfig, MonitorConfig
from stickslip_monitor.safe_files import read_token

if TYPE_CHECKING:
    from stickslip_monitor.dashboard.access import Access
    from stickslip_monitor.dashboard.event_log import EventLog
    from stickslip_monitor.dashboard.replay import Replay
    from stickslip_monitor.dashboard.seen_monitors import BearingView, DashboardState, WatchedMonitor
    from stickslip_monitor.monitor.session import Sink
    from stickslip_monitor.ros.other_nodes import Watcher

DEFAULT_PORT = 8370
"""Port of the page, if no other is asked for."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = 'ROS 2 parameter file; with several nodes, one for all or one for each in order'
    parser.add_argument('--config', '-c', required=True, action='append', metavar='FILE', help=text)
    add_page(parser)
    add_port(parser, f'port of the page, 0 for any that is free (default {DEFAULT_PORT})', DEFAULT_PORT)
    options.add_file(parser, '--bag', metavar='BAG', help='replay this recording instead of ROS 2')
    text = 'speed of the replay (default 1)'
    options.add_number(parser, '--rate', 0, above=True, kind=float, default=1.0, help=text)
    text = f"the monitor's full name (default /{NODE_NAME}); again for each further monitor"
    parser.add_argument('--node', action='append', help=text)


def add_port(parser: argparse.ArgumentParser, text: str, default: int | None = None) -> None:
    """Declare ``--port``, 0 to 65535, which is ``default`` unless given; ``text`` is for ``--help``."""
    options.add_number(parser, '--port', 0, 65535, default=default, help=text)


def add_page(parser: argparse.ArgumentParser) -> None:
    """Declare ``--host``, ``--token-file``, ``--name``, ``--log`` and ``--diagnostics``."""
    text = 'address of this machine to listen at (default 127.0.0.1)'
    parser.add_argument('--host', default='127.0.0.1', metavar='ADDRESS', help=text)
    text = 'file with the token that opens the page, needed if --host lets others in'
    parser.add_argument('--token-file', metavar='FILE', help=text)
    text = 'a further name by which people reach this machine, as in their browsers'
    parser.add_argument('--name', action='append', default=[], help=text)
    text = 'keep the event log in this file, over restarts of the page'
    parser.add_argument('--log', metavar='FILE', help=text)
    options.add_shared(parser, '--diagnostics')


def run(args: argparse.Namespace) -> int:
    """Serve the page of running monitors or of a replay until a signal ends it; return 0.

    Raises:
        ConfigurationError: Options do not go together, or a configuration is refused.
        DashboardError: A needed package is missing, or the page cannot be served as asked.
        RosError: Running monitors are to be shown, and ROS 2 is not there; or ``--log`` cannot be used.
        BagError: The recording to replay cannot be read.
    """
    require_extra()
    from stickslip_monitor.dashboard.seen_monitors import DashboardState

    if args.bag is not None and args.log is not None:
        raise ConfigurationError('--log is for a running monitor: a replay is not kept')
    if args.bag is not None and len(args.node or ()) > 1:
        raise ConfigurationError('--bag replays for one monitor: give --node once at most')
    nodes = _node_names(args)
    if len(args.config) not in (1, len(nodes)):
        raise ConfigurationError(
            f'--config is given {len(args.config)} times for {len(nodes)} nodes: give one for all,'
            ' or one for each'
        )
    paths = args.config if len(args.config) > 1 else args.config * len(nodes)
    configs = [
        load_config(path, args.node and node, is_live=args.bag is None)
        for path, node in zip(paths, nodes, strict=True)
    ]
    if args.bag is not None:
        monitors = [make_watched_monitor(configs[0], args.bag, replay=True)]
    else:
        pairs = zip(configs, nodes, strict=True)
        monitors = [make_watched_monitor(config, node, node) for config, node in pairs]
    access = read_page_access(args)
    with open_event_log(args) as log, jit.interpreted():
        board = DashboardState(monitors, args.bag is not None, log)
        asyncio.run(_serve_page(args, configs[0], board, access))
    return 0


def _node_names(args: argparse.Namespace) -> list[str]:
    """Return the full names of the monitors that ``--node`` gives, else that of the default node.

    Raises:
        ConfigurationError: Two of them are in the same namespace.
    """
    nodes: list[str] = args.node or [f'/{NODE_NAME}']
    spaces = [_namespace_of(node) for node in nodes]
    for k, space in enumerate(spaces):
        if space in spaces[:k]:
            raise ConfigurationError(
                f"--node '{nodes[k]}' is in the same namespace as '{nodes[spaces.index(space)]}':"
                ' bearings are distinguished by the namespace; use a dashboard for each'
            )
    return nodes


def _namespace_of(node: str) -> str:
    """Return the namespace of a node's full name, without slashes around it."""
    return node.strip('/').rpartition('/')[0]


def make_watched_monitor(
    config: MonitorConfig, source: str, node: str = '', *, replay: bool = False
) -> WatchedMonitor:
    """Return a monitor as the page shows it, with the maps of its bearings and without data yet.

    Args:
        config: The configuration of the monitor.
        source: Its title on the page.
        node: The full name of its node, whose namespace goes before its bearings; '' for none.
        replay: Whether its data come from a recording.
    """
    from stickslip_monitor.dashboard.seen_monitors import WatchedMonitor

    views = [make_bearing_view(bearing) for bearing in config.bearings]
    shelve_time = config.shelve_time_ns * 1e-9
    return WatchedMonitor(source, views, _namespace_of(node), replay, shelve_time)


@contextmanager
def open_event_log(args: argparse.Namespace) -> Iterator[EventLog]:
    """Yield the event log, kept in the file of ``--log`` if that is given, and close the file at the end.

    A damaged file is warned of in the log of the program.

    Raises:
        RosError: The file is somebody else's, or another dashboard uses it.
    """
    from stickslip_monitor.dashboard.event_log import LOG_FAMILY, EventLog

    if args.log is None:
        yield EventLog()
        return
    from stickslip_monitor.state_file import StateWriter

    writer = StateWriter(args.log, '--log', 'dashboard', LOG_FAMILY)
    try:
        log = EventLog(writer)
        if log.damage:
            logging.getLogger(NODE_NAME).warning(log.damage)
        yield log
    finally:
        writer.close()


def require_extra() -> None:
    """Check that the packages are installed which a page needs.

    Raises:
        DashboardError: One is missing; the text says how to install it.
    """
    for name in ('aiohttp', 'prometheus_client'):
        if find_spec(name) is None:
            raise DashboardError(
                f"a dashboard needs the extra 'dashboard' (there is no {name}):"
                " pip install 'stickslip_monitor[dashboard]'"
            )


def read_page_access(args: argparse.Namespace) -> Access:
    """Read the token of the page from its file; return it with the host names that the page answers to.

    Without ``--token-file`` it is '', which opens the page to this machine. Names are in lower case.

    Raises:
        DashboardError: The page would be open to others without a token.
        ConfigurationError: The token's file cannot be read, is open to others, or the token is too short.
    """
    from stickslip_monitor.dashboard.access import Access

    token = '' if args.token_file is None else read_token(args.token_file)
    if not token and not is_loopback(args.host):
        raise DashboardError(
            f'--host {args.host} lets others in: give --token-file, with a token that they know'
        )
    names = {name.lower() for name in (*args.name, args.host, socket.gethostname())}
    return Access(token, frozenset(names))


async def _serve_page(
    args: argparse.Namespace, config: MonitorConfig, board: DashboardState, access: Access
) -> None:
    """Serve the page of live monitors or of a replay until a signal ends it; print its address.

    Actions on the page go to the monitors. An error that ended a replay is raised when the page ends.

    Raises:
        BagError: The recording cannot be replayed.
        DashboardError: The address or the port cannot be used.
        RosError: Live monitors are to be shown, and ROS 2 is not there.
    """
    from stickslip_monitor.dashboard.server import Server

    async def show(player: Replay | None) -> None:
        await Server(board, access, player).serve(args.host, args.port, print_address)

    if args.bag is None:
        monitors = {monitor.source: monitor for monitor in board.monitors}
        with listen_to_nodes(monitors, args.diagnostics) as watcher:
            for name, monitor in monitors.items():
                monitor.act = partial(watcher.act, name)
            await show(None)
        return
    from stickslip_monitor.dashboard.replay import Replay

    replay = Replay(args.bag, config, args.rate, board)
    task = asyncio.create_task(replay.run())
    try:
        await show(replay)
    finally:
        if task.done():
            task.result()
        task.cancel()


def print_address(url: str) -> None:
    """Print the address of the page at once."""
    Console(markup=False, highlight=False, soft_wrap=True).print(f'Dashboard on {url}')
    sys.stdout.flush()


@contextmanager
def listen_to_nodes(listeners: Mapping[str, Sink], diagnostics: str) -> Iterator[Watcher]:
    """Yield a watcher that receives from nodes in its own thread, and passes that on in the running loop.

    Args:
        listeners: The sink of each node, by the node's full name.
        diagnostics: The topic of their diagnostics.

    Raises:
        RosError: ROS 2 is not there or cannot be started, or a name is not valid.
    """
    try:
        from stickslip_monitor.ros.other_nodes import open_watcher
    except ImportError as error:
        raise missing_ros_error(error) from error
    hand_over = asyncio.get_running_loop().call_soon_threadsafe
    with open_watcher(listeners, diagnostics, hand_over) as watcher:
        yield watcher


def make_bearing_view(config: BearingConfig, speed: float = 0.0, load: float = 0.0) -> BearingView:
    """Return the bearing as the page shows it, with the curves of its stability map.

    Args:
        config: The bearing.
        speed: The least speed that the map goes to [m/s]; it goes past the fold in any case.
        load: The load that the map goes to [N], at least a tenth of the usual one; 0 for the usual one.
    """
    from stickslip_monitor.dashboard.seen_monitors import BearingView

    bearing, alarm = config.bearing, config.alarm
    highest = map_ranges(bearing)[1][1]
    loads = (0.0, max(load, 0.1 * highest) if load else highest)
    speeds = (0.0, max(speed, map_ranges(bearing, loads=loads)[0][1]))
    curves = boundaries(bearing, speeds, alarm.caution_margin, points=120)
    limit = alarm.amplitude_limit
    return BearingView(
        name=config.name,
        rpm=float(bearing.speed.from_surface(1.0, 'rpm')),
        speeds=speeds,
        loads=loads,
        curves={
            'speed': _round_column(curves.speed),
            'caution': _round_column(curves.caution_load),
            'fold': _round_column(curves.fold_load),
            'hopf': _round_column(curves.hopf_load),
        },
        caution_margin=alarm.caution_margin,
        amplitude_limit=limit if math.isfinite(limit) else None,
        topics={name: source.topic for name, source in config.inputs.items()},
        wider=partial(make_bearing_view, config),
    )


def _round_column(values: Any) -> list[float | None]:
    """Return the numbers rounded to six significant digits; ``None`` for one that is not finite."""
    return [float(f'{value:.6g}') if np.isfinite(value) else None for value in values]
