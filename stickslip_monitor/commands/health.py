# SPDX-License-Identifier: Apache-2.0
"""Ask a running monitor whether it works: for a container, a cron job or a script.

Over ROS 2, or with --page the page of `stickslip watch` or `stickslip dashboard`. Exits 0 if it
monitors, 1 if it runs but reports a fault, 2 if there is no message from it. An active alarm is no
fault of the monitor.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from typing import Any

from stickslip_monitor.commands import options
from stickslip_monitor.errors import DashboardError, RosError, cause, missing_ros_error
from stickslip_monitor.monitor.severity import NOT_MONITORING, Severity
from stickslip_monitor.monitor.value_check import refused
from stickslip_monitor.safe_files import printable, read_token

ALONE = 1.5
"""Every monitor publishes once a second: after so long [s] there is no other."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "the monitor's full name (default: the only one that runs)"
    parser.add_argument('--node', help=text)
    settings: dict[str, Any] = {
        'default': 5.0,
        'metavar': 'S',
        'help': 'wait up to S seconds for an answer (default 5)',
    }
    options.add_number(parser, '--timeout', 0, 600, above=True, kind=float, **settings)
    options.add_shared(parser, '--diagnostics')
    text = 'ask this page, such as http://127.0.0.1:8370; ROS is not needed'
    parser.add_argument('--page', metavar='URL', help=text)
    parser.add_argument('--token-file', metavar='FILE', help='file with the token that opens the page')


def run(args: argparse.Namespace) -> int:
    """Print the health of a monitor; return 0 if it monitors, 1 if it reports an error or is idle.

    Raises:
        RosError: Without ``--page``: ROS 2 is not there, no message came, or several monitors run.
        ConfigurationError, DashboardError: With it: the page cannot be asked; see :func:`_ask_page`.
    """
    if args.page is not None:
        return _ask_page(args)
    try:
        from stickslip_monitor.ros.other_nodes import receive_health
    except ImportError as error:
        raise RosError(
            f'{missing_ros_error(error)}; without ROS ask the page: stickslip health --page URL'
        ) from error
    node = None if args.node is None else f'/{args.node.strip("/")}'
    results: dict[str, tuple[int, str]] = {}

    def take(name: str, level: int, text: str) -> None:
        results[name] = level, text

    with receive_health(args.diagnostics, take):
        _wait_for_message(results, node, args.timeout)
    names = ', '.join(sorted(results))
    if node is None and len(results) > 1:
        raise RosError(f'several monitors run: choose one of {names} by --node')
    name = node or names
    if name not in results:
        remedy = '; does one run here, with this ROS_DOMAIN_ID? Without ROS ask its page: --page URL'
        hint = f'; running: {names}' if names else remedy
        raise RosError(f'no message from {node or "a monitor"} within {args.timeout:g} s{hint}')
    level, text = results[name]
    sys.stdout.write(f'{name}: {printable(text)}\n')
    return int(level >= Severity.ERROR or NOT_MONITORING in text)


def _ask_page(args: argparse.Namespace) -> int:
    """Read the metrics of a page, print whether all works, and return the exit code.

    It is 0 if there are monitors, and each of them and each link to a bus works; else 1, as for a page
    that is no dashboard.

    Raises:
        ConfigurationError: The address does not begin with ``http://`` or ``https://``, or the token cannot
            be read.
        DashboardError: The page cannot be read.
    """
    from urllib.request import Request, urlopen

    if not args.page.startswith(('http://', 'https://')):
        raise refused('--page', args.page, 'an address such as http://127.0.0.1:8370/')
    token = None if args.token_file is None else read_token(args.token_file)
    try:
        request = Request(f'{args.page.rstrip("/")}/metrics')
        if token is not None:
            request.add_header('Authorization', f'Bearer {token}')
        with urlopen(request, timeout=args.timeout) as answer:
            figures = answer.read().decode()
    except (OSError, ValueError) as error:
        # What urllib wraps says more to a person than its wrapping.
        reason = getattr(error, 'reason', error)
        why = cause(reason) if isinstance(reason, BaseException) else str(error)
        raise DashboardError(f"--page '{args.page}' gives no figures: {why}") from error
    ups = re.findall(r'^stickslip_(monitor|link)_up\{\w+="([^"]*)"\} (\S+)$', figures, re.MULTILINE)
    down = [f'{part} {name}' for part, name, value in ups if float(value) != 1.0]
    works = bool(ups) and not down
    text = 'Monitoring.' if works else f'not working: {", ".join(down) or "no monitor is on the page"}'
    sys.stdout.write(f'{printable(text)}\n')
    return int(not works)


def _wait_for_message(results: dict[str, tuple[int, str]], node: str | None, seconds: float) -> None:
    """Wait until another thread has put a node into ``results``; return silently after ``seconds`` [s].

    For a ``node`` of ``None`` any will do; then wait ``ALONE`` longer for a second one.
    """
    end = time.monotonic() + seconds
    while time.monotonic() < end and not (node in results if node else results):
        time.sleep(0.02)
    if node is None and results:
        time.sleep(ALONE)
