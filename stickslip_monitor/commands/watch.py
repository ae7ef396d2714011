# SPDX-License-Identifier: Apache-2.0
"""Watch bearings on the ship's own buses, Signal K and NMEA 0183, and give the alarms to them.

Without --node the monitor runs in this process and ROS is not needed. With --node the command
connects a running monitor: values from the buses are published on its topics, and its alarms go to
the buses. The section /stickslip_links of the parameter file assigns inputs and alarms to buses.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from itertools import chain
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from stickslip_monitor import jit
from stickslip_monitor.commands import dashboard, options
from stickslip_monitor.dashboard.seen_monitors import SILENT
from stickslip_monitor.errors import ConfigurationError, LinkError
from stickslip_monitor.host import ServiceManager, end_signals, unblocked_log
from stickslip_monitor.links.links_config import NMEA, SIGNALK, LinksConfig, build_links, is_loopback
from stickslip_monitor.links.live_monitor import LiveMonitor, MonitorSide
from stickslip_monitor.monitor.alarm_records import ALARM_SCHEMA, ActionRequest
from stickslip_monitor.monitor.config_questions import question_sentences
from stickslip_monitor.monitor.configuration import bearing_names, build_config
from stickslip_monitor.monitor.parameter_file import LINKS, NODE_NAME, load_links, load_parameters
from stickslip_monitor.monitor.parameters import ASSUMED_LOADS, MonitorConfig
from stickslip_monitor.monitor.sample_types import QUANTITIES, Input
from stickslip_monitor.monitor.session import Log, Sink
from stickslip_monitor.monitor.severity import Severity
from stickslip_monitor.state_file import StateWriter

if TYPE_CHECKING:
    from stickslip_monitor.dashboard.seen_monitors import DashboardState, WatchedMonitor
    from stickslip_monitor.links.nmea_client import NmeaClient
    from stickslip_monitor.links.signalk_client import SignalKClient

    Client = NmeaClient | SignalKClient

Take = Callable[..., None]
Works = bool | None
"""Whether a link works; None where nobody can know."""
LOGGED_AGAIN = 300.0
"""The same state of a link is logged again after so long [s]."""
# Time between two ticks of the clients, and of the watchdog [s].
_TICK = 0.5
# Time that clients have to finish, and tasks to end [s].
_MAX_END = 2.0
_log = logging.getLogger(NODE_NAME)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_config(parser, node=False)
    parser.add_argument(
        '--node',
        nargs='?',
        const=f'/{NODE_NAME}',
        help=f'connect the monitor with this full name (default /{NODE_NAME})',
    )
    dashboard.add_port(parser, 'serve the page of `stickslip dashboard` at this port, too')
    dashboard.add_page(parser)
    parser.add_argument(
        '--request-token',
        action='store_true',
        help='ask the Signal K server for a token, write it to signalk.token_file, and end',
    )


def run(args: argparse.Namespace) -> int:
    """Monitor the bearings until a signal ends it, or with ``--request-token`` ask for a token; return 0.

    Sets up the log of the program.

    Raises:
        ConfigurationError: The configuration is refused.
        LinkError: A needed package is missing, or a link cannot be used.
        OSError: The file of the requested token cannot be written.
        DashboardError: The page cannot be served.
        RosError: ``--node`` is given, and ROS 2 is not there; or a state file cannot be used.
    """
    if find_spec('aiohttp') is None:
        raise LinkError("watch needs the extra 'links': pip install 'stickslip_monitor[links]'")
    with unblocked_log(), jit.interpreted():
        logging.basicConfig(level=logging.INFO, format='%(asctime)s %(levelname)s %(message)s')
        config, links = load_watch(args.config, args.node)
        if args.request_token:
            from stickslip_monitor.links.signalk_token import save_requested_token

            asyncio.run(save_requested_token(links.signalk, _log.info))
            return 0
        with _open_page(args, config) as board:
            asyncio.run(_watch_ship(args, config, links, board))
    return 0


def load_watch(path: str, node: str | None) -> tuple[MonitorConfig, LinksConfig]:
    """Read and validate a parameter file with its section of links.

    Args:
        path: The file.
        node: The node whose parameters count; ``None`` for monitoring without ROS, where inputs need no
            topics and are named after their buses.

    Raises:
        ConfigurationError: It cannot be read or breaks a rule; the text names the file.
    """
    with_node, section = node is not None, load_links(path)
    parameters = load_parameters(path, node)
    try:
        if not with_node:
            # Without ROS an input needs no topic.
            for name in bearing_names(parameters):
                for quantity in QUANTITIES:
                    if quantity == 'load' and any(f'{name}.{key}' in parameters for key in ASSUMED_LOADS):
                        continue
                    parameters.setdefault(f'{name}.{quantity}.topic', f'{name}/{quantity}')
                if f'{name}.water_temperature.from' in section:
                    parameters.setdefault(f'{name}.water_temperature.topic', f'{name}/water_temperature')
        config = build_config(parameters, is_live=True)
        links = build_links(section, config)
        return (config if with_node else _name_inputs(config, links)), links
    except ConfigurationError as error:
        raise ConfigurationError(f'{path}: {error}') from error


def _name_inputs(config: MonitorConfig, links: LinksConfig) -> MonitorConfig:
    """Return the configuration with bus labels as topics of the inputs, for texts to people.

    Raises:
        ConfigurationError: An input has no bus, or a level is configured.
    """
    labels, bearings = links.labels, []
    for bearing in config.bearings:
        if bearing.level is not None:
            raise ConfigurationError(
                f'{bearing.name}.level.topic = {bearing.level.topic!r}: without --node only speed'
                ' and load come from a bus, and no level; leave it out'
            )
        # A constant load comes with the speed.
        places = {Input.SPEED, Input.SPEED if bearing.load.is_assumed else Input.LOAD}
        if bearing.water_temperature is not None:
            places.add(Input.WATER_TEMPERATURE)
        for place in sorted(places):
            if (bearing.name, place) not in labels:
                raise ConfigurationError(
                    f"{LINKS}: '{bearing.name}.{place.name.lower()}' is missing: without --node"
                    ' every input comes from a bus'
                )
        inputs: dict[str, Any] = {'speed': replace(bearing.speed, topic=labels[bearing.name, Input.SPEED])}
        inputs['load'] = replace(bearing.load, topic=labels[bearing.name, Input(max(places & {0, 1}))])
        if bearing.water_temperature is not None:
            topic = labels[bearing.name, Input.WATER_TEMPERATURE]
            inputs['water_temperature'] = replace(bearing.water_temperature, topic=topic)
        bearings.append(replace(bearing, **inputs))
    return replace(config, bearings=tuple(bearings))


class Feed(Sink):
    """Passes what the monitor publishes to every sink.

    ``monitors`` is the monitor as the page knows it, where there is a page; ``sinks`` are these at first, and
    others may be appended; ``act`` takes what people ask of the monitor.
    """

    act: Callable[[ActionRequest], None]

    def __init__(self, monitors: Sequence[WatchedMonitor]) -> None:
        self.monitors = monitors
        self.sinks: list[Sink] = [*monitors]
        self._received_at = -SILENT
        self._is_monitoring = False

    @property
    def is_receiving(self) -> bool:
        """Whether an active monitor sent a record less than :data:`.SILENT` ago."""
        return self._is_monitoring and time.monotonic() - self._received_at < SILENT

    def take_record(self, record: dict[str, Any]) -> None:
        """Pass the record of a bearing to every sink; store the time, and whether its monitor is active."""
        self._received_at = time.monotonic()
        self._is_monitoring = record.get('monitoring') is not False
        for sink in self.sinks:
            sink.take_record(record)

    def take_health(self, level: int, text: str) -> None:
        """Pass the status of the node to the page, which alone shows it."""
        for monitor in self.monitors:
            monitor.take_health(level, text)

    def take_other(self, node: str) -> None:
        """Pass the name of another monitor that sends to the page."""
        for monitor in self.monitors:
            monitor.take_other(node)

    def take_alarms(self, record: Any) -> None:
        """Pass the list of alarms to every sink; ignore a record of another schema."""
        if isinstance(record, dict) and record.get('schema') == ALARM_SCHEMA:
            for sink in self.sinks:
                sink.take_alarms(record)


class LinkStates:
    """States of the links; a change is logged, but no state of a link twice within :data:`LOGGED_AGAIN`.

    Args:
        links: Takes whether each link works; one of which nobody can know has no entry.
        clock: A steady clock [s].
    """

    def __init__(self, links: dict[str, bool], clock: Callable[[], float] = time.monotonic) -> None:
        self._links, self._clock = links, clock
        self._states: dict[str, tuple[Works, str]] = {}
        self._logged: dict[tuple[str, Works, str], float] = {}

    def report(self, name: str, works: Works, why: str) -> None:
        """Store a changed state of a link, for the page too; log it, an error if the link does not work.

        ``why`` says why it does not work, or why nobody can know; '' where it works.
        """
        if self._states.get(name) == (works, why):
            return
        self._states[name] = works, why
        if works is None:
            self._links.pop(name, None)
        else:
            self._links[name] = works
        now = self._clock()
        if now - self._logged.get((name, works, why), -math.inf) >= LOGGED_AGAIN:
            self._logged[name, works, why] = now
            (_log.error if works is False else _log.info)(f'{name}: {why or "works"}')


async def _watch_ship(
    args: argparse.Namespace, config: MonitorConfig, links: LinksConfig, board: DashboardState | None
) -> None:
    """Run monitor, clients and page until one of them ends, then let the clients finish and cancel the rest.

    The page, unless ``board`` is ``None``, gets states, actions and link states.

    Raises:
        LinkError, ConfigurationError: A token, certificate or port cannot be used; see :func:`_make_clients`.
        RosError: ROS 2 is not there for ``--node``, or a state file cannot be used.
        Exception: Any error of the part that ended; the clients are then cancelled at once.
    """
    feed = Feed(() if board is None else board.monitors)
    report = LinkStates({} if board is None else board.links).report
    with _make_monitor(args, config, links, feed) as (take, run_monitor):
        names = [bearing.name for bearing in config.bearings]
        clients = _make_clients(links, MonitorSide(names, take, feed.act, report, _log))
        feed.sinks += clients
        for client in clients:
            await client.open_ports()
        tasks = [
            asyncio.create_task(work)
            for work in (
                _serve_until_signal(args, board, feed),
                run_monitor(),
                _tick_clients(clients, feed),
                *(client.run() for client in clients),
            )
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
            # A server that is frozen must not keep us here.
            await asyncio.wait([asyncio.create_task(c.finish()) for c in clients], timeout=_MAX_END)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks, timeout=_MAX_END)


@contextmanager
def _open_page(args: argparse.Namespace, config: MonitorConfig) -> Iterator[DashboardState | None]:
    """Yield the state of the page with its event log; None without ``--port``.

    Raises:
        DashboardError: The extra 'dashboard' is not installed.
        RosError: The event log cannot be used; see :func:`.dashboard.open_event_log`.
    """
    if args.port is None:
        yield None
        return
    dashboard.require_extra()
    from stickslip_monitor.dashboard.seen_monitors import DashboardState

    with dashboard.open_event_log(args) as log:
        monitor = dashboard.make_watched_monitor(config, args.node or args.config, args.node or '')
        yield DashboardState([monitor], log=log)


async def _serve_until_signal(args: argparse.Namespace, board: DashboardState | None, feed: Feed) -> None:
    """Serve the page until a signal ends it; without a page (board None) wait for the signal.

    Actions on the page go to ``feed``.

    Raises:
        DashboardError: The address or port cannot be used, or the page would be open to others.
        ConfigurationError: The token of the page cannot be used.
    """
    if board is not None:
        from stickslip_monitor.dashboard.server import Server

        for monitor in board.monitors:
            monitor.act = feed.act
        server = Server(board, dashboard.read_page_access(args))
        await server.serve(args.host, args.port, dashboard.print_address)
        return
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in end_signals():
        loop.add_signal_handler(number, stop.set)
    await stop.wait()


async def _tick_clients(clients: Sequence[Client], feed: Feed) -> None:
    """Report readiness to the service manager, then feed its watchdog and tick all clients forever."""
    manager = ServiceManager()
    manager.notify('READY=1')
    while True:
        manager.beat()
        for client in clients:
            client.tick(feed.is_receiving)
        await asyncio.sleep(_TICK)


@contextmanager
def _make_monitor(
    args: argparse.Namespace, config: MonitorConfig, links: LinksConfig, feed: Feed
) -> Iterator[tuple[Take, Callable[[], Coroutine[Any, Any, Any]]]]:
    """Yield the handler of samples, and the coroutine that runs the monitor, here or (``--node``) in ROS.

    Sets ``feed.act``, and logs warnings on the configuration; at the end the state file is closed, or the
    node's watcher.

    Raises:
        RosError: A node is asked for, and ROS 2 is not there; or the state file cannot be used.
    """
    if args.node is not None:
        with dashboard.listen_to_nodes({args.node: feed}, args.diagnostics) as watcher:
            from stickslip_monitor.ros.other_nodes import Bridge

            feed.act = partial(watcher.act, args.node)
            bridge = Bridge(watcher.node, args.node, config, links.labels)
            yield without_copies(bridge.take, _log), asyncio.Event().wait
        return
    if config.clips.directory:
        _log.warning('clips.directory is not used: event clips are taken by the ROS 2 node')
    for question in (*config.faults, *chain.from_iterable(map(question_sentences, config.bearings))):
        _log.warning(question)
    store = StateWriter(config.state_file, user='monitor') if config.state_file else None
    live = LiveMonitor(config, feed, _log, store)
    feed.act = live.act

    async def run() -> None:
        await asyncio.gather(live.run(), _report_files(config, store, live, feed))

    try:
        yield live.take, run
    finally:
        if store is not None:
            store.close()


async def _report_files(
    config: MonitorConfig, store: StateWriter | None, live: LiveMonitor, feed: Feed
) -> None:
    """Poll the faults of state file, restored state and configuration forever; report changes to the page.

    A new fault of the state file, if there is one (``store``), is logged, too.
    """
    reported = ''
    while True:
        fault = '' if store is None else store.fault
        text = ' '.join(f'{text_part}.' for text_part in (fault, live.damage, *config.faults) if text_part)
        if text != reported:
            level = Severity.ERROR if fault else Severity.WARN if text else Severity.OK
            feed.take_health(level, text)
            if fault and fault not in reported:
                _log.error(fault)
            reported = text
        await asyncio.sleep(_TICK)


def without_copies(take: Callable[[str, Input, float], None], log: Log) -> Take:
    """Return a handler that passes samples to ``take`` without stamps, and drops copies.

    A copy has the stamp [ns] and the value of the sample before; a sample without a stamp is never one. The
    first copy of each input is warned of. A server that repeats the last value of a dead source would keep it
    alive for a node, which sees no stamp.
    """
    latest: dict[tuple[str, Input], tuple[int | None, float]] = {}
    reported: set[tuple[str, Input]] = set()

    def pass_sample(bearing: str, place: Input, value: float, stamp_ns: int | None = None) -> None:
        """Pass a sample on, or warn of the first copy of an input and drop copies; store the sample."""
        key, sample = (bearing, place), (stamp_ns, value)
        copied = stamp_ns is not None and latest.get(key) == sample
        latest[key] = sample
        if not copied:
            take(bearing, place, value)
        elif key not in reported:
            reported.add(key)
            log.warning(
                f'{place.name.lower()} of {bearing}: the sender repeats stamp and value; copies'
                ' are not published'
            )

    return pass_sample


def _make_clients(links: LinksConfig, side: MonitorSide) -> list[Client]:
    """Return the clients of the configured buses; warn of one that takes datagrams from anybody.

    Raises:
        LinkError: Others can read the file of the token, or the file of certificates has none.
        ConfigurationError: The token cannot be read, or two bearings have one Signal K path.
    """
    from stickslip_monitor.links.nmea_client import NmeaClient
    from stickslip_monitor.links.signalk import SignalKInputs
    from stickslip_monitor.links.signalk_client import SignalKClient
    from stickslip_monitor.links.signalk_token import read_signalk_token

    clients: list[Client] = []
    if links.signalk is not None:
        token = read_signalk_token(links.signalk.token_file)
        inputs = links.of(SIGNALK)
        theirs = {item.bearing for item in inputs if item.place is Input.LOAD}
        own_load = [name for name in side.bearings if name not in theirs]
        clients.append(
            SignalKClient(links.signalk, token, SignalKInputs(inputs, _log.warning), own_load, side)
        )
    if links.nmea is not None:
        url = urlsplit(links.nmea.listen)
        if url.scheme == 'udp' and not is_loopback(url.hostname):
            _log.warning(
                "nmea.listen: anybody on this network can send datagrams: use one with the ship's"
                ' instruments only'
            )
        clients.append(NmeaClient(links.nmea, links.of(NMEA), side))
    return clients
