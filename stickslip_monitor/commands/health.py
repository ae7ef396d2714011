# SPDX-License-Identifier: Apache-2.0
"""Ask a running monitor over ROS 2 whether it monitors: for a container, a cron job, a script.

The exit code is 0 where it monitors, 1 where it is there and says what is wrong, and 2 where
nothing is heard of it. An alarm is nothing wrong with the monitor.
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable
from typing import Any

from stickslip_monitor.errors import ConfigurationError, RosError
from stickslip_monitor.files import printable
from stickslip_monitor.monitor.config_file import NODE_NAME
from stickslip_monitor.monitor.health import NOT_MONITORING
from stickslip_monitor.monitor.ladder import Level

_LONGEST = 600.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        '--node', default=f'/{NODE_NAME}', help=f"the monitor's full name (default /{NODE_NAME})"
    )
    parser.add_argument(
        '--timeout', type=float, default=5.0, metavar='S', help='wait so long (default 5 s)'
    )
    parser.add_argument(
        '--diagnostics', default='/diagnostics', metavar='TOPIC', help='(default /diagnostics)'
    )


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    if not 0.0 < args.timeout <= _LONGEST:
        raise ConfigurationError(
            f'--timeout {args.timeout:g} must be above 0 and at most {_LONGEST:g}'
        )
    try:
        from stickslip_monitor.ros.watcher import open_watcher
    except ImportError as error:
        raise RosError(f'ROS 2 is not available ({error}): source its setup file') from error
    node = f'/{args.node.strip("/")}'
    heard = _Heard()
    with open_watcher({node: heard}, args.diagnostics, _at_once):
        heard.came.wait(args.timeout)
    if heard.text is None:
        others = ', '.join(sorted(f'/{name.strip("/")}' for name in heard.others))
        hint = f'; heard of: {others}' if others else ''
        raise RosError(f'nothing is heard of {node} for {args.timeout:g} s{hint}')
    sys.stdout.write(f'{node}: {printable(heard.text)}\n')
    return int(heard.level >= Level.ERROR or NOT_MONITORING in heard.text)


def _at_once(call: Callable[..., object], *arguments: Any) -> None:
    call(*arguments)


class _Heard:
    """What a monitor says of itself."""

    def __init__(self) -> None:
        self.came = threading.Event()
        self.level = 0
        self.text: str | None = None
        self.others: set[str] = set()

    def take_health(self, level: int, text: str) -> None:
        """The diagnostic status of the node itself."""
        self.level, self.text = level, text
        self.came.set()

    def take_other(self, node: str) -> None:
        """The name of another monitor whose diagnostics come."""
        self.others.add(node)

    def take_record(self, record: dict[str, Any], /) -> None:
        """The record of a bearing."""

    def take_alarms(self, document: Any, /) -> None:
        """The list of alarms."""
