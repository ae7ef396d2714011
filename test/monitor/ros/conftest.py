# SPDX-License-Identifier: Apache-2.0
"""Real nodes over real DDS, kept to this machine."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from kit import Hosted, Monitor, Peer, claim_domain
from shared import Program


@pytest.fixture(scope='session')
def _ros_context(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    import rclpy

    domain, claim = claim_domain()
    with claim, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros_log')))
        rclpy.init(args=[])
        yield
        rclpy.try_shutdown()


_numbers = itertools.count(1)


@pytest.fixture
def peer(_ros_context: None) -> Iterator[Peer]:
    """Yield the test's own node."""
    peer = Peer(f'peer{next(_numbers)}')
    yield peer
    for program in peer.watched:
        program.end()
    peer.close()


@pytest.fixture
def run(peer: Peer, tmp_path: Path) -> Callable[..., Program]:
    """Starts a program; it is stopped when the test ends."""

    def start(*command: str) -> Program:
        program = Program(list(command), tmp_path / f'program{next(_numbers)}.log')
        peer.watched.append(program)
        return program

    return start


@pytest.fixture
def start(peer: Peer, tmp_path: Path) -> Callable[..., Monitor]:
    """Starts a monitor in a process from its parameters; it is stopped when the test ends."""

    def start(values: dict[str, Any], *arguments: str) -> Monitor:
        monitor = Monitor(peer, f't{next(_numbers)}', tmp_path, values, *arguments)
        peer.watched.append(monitor)
        return monitor

    return start


@pytest.fixture
def host(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Hosted]:
    """Starts a monitor in this process, which answers fast; it ends with the test."""
    for name, period in (('ros.node_loop.TURN_PERIOD', 0.01), ('ros.node_loop.SHOW_NS', 10**8)):
        monkeypatch.setattr(f'stickslip_monitor.{name}', period)
    monkeypatch.setattr('stickslip_monitor.monitor.session.LOOK_NS', 10**8)

    def start(values: dict[str, Any]) -> Hosted:
        hosted = Hosted(peer, f't{next(_numbers)}', values)
        peer.watched.append(hosted)
        return hosted

    return start
