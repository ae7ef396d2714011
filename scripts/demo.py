# SPDX-License-Identifier: Apache-2.0
"""Plays a recorded coast-down to the real node and shows that it warns as the offline check does.

Three processes over DDS on this machine: the node, a player, and this one, which listens.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

# Before ROS 2 loads: nothing leaves this machine, and no other demo is overheard.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ.setdefault('ROS_DOMAIN_ID', str(random.randint(1, 101)))

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rich.console import Console
from rich.table import Table
from std_msgs.msg import String

ROOT = Path(__file__).resolve().parent.parent
BAG = ROOT / 'bags' / 'coast_down'
CONFIG = ROOT / 'launch_configs' / 'reference_bearing.yaml'
RATE = 15
# The clock of a replay reaches the node in steps; at this rate a step is so much recorded time.
TOLERANCE = 0.05 * RATE
# A timeout counts recorded time: 5 s of it are over while a busy machine does something else.
TIMEOUT = 5.0 * RATE
COLOURS = {'OK': 'green', 'WARN': 'yellow', 'ERROR': 'red'}

console = Console()


def stickslip(*arguments: str) -> list[str]:
    """The command line of a stickslip command in this environment."""
    return [sys.executable, '-m', 'stickslip_monitor.cli', *arguments]


def start_node() -> subprocess.Popen[bytes]:
    """Start the monitor node as a process of its own."""
    command = [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args']
    command += ['--params-file', str(CONFIG), '-p', 'use_sim_time:=true', '--log-level', 'error']
    for quantity in ('speed', 'load'):
        command += ['-p', f'aft_stern.{quantity}.timeout:={TIMEOUT}']
    console.print('[bold]1. The node[/], on its own:  ros2 run stickslip_monitor monitor')
    return subprocess.Popen(command)


def listen() -> list[dict[str, Any]]:
    """Play the bag and collect the warnings that the node publishes."""
    events: list[dict[str, Any]] = []
    node = Node('demo_listener')
    latched = QoSProfile(
        depth=100,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    topic = '/stickslip_monitor/warnings'
    node.create_subscription(String, topic, lambda message: hear(events, message.data), latched)
    console.print(
        f'[bold]2. A player[/], {RATE} times faster than it happened:'
        f'  stickslip play {BAG.relative_to(ROOT)} --rate {RATE}'
    )
    console.print(f'[bold]3. Warnings as they come[/] on {topic}:')
    player = subprocess.Popen(
        stickslip('play', str(BAG), '--rate', str(RATE), '--wait', '20'),
        stderr=subprocess.DEVNULL,
    )
    end = None
    while end is None or time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
        if end is None and player.poll() is not None:
            end = time.monotonic() + 1.0
    node.destroy_node()
    if player.returncode:
        raise SystemExit(f'the player failed with code {player.returncode}')
    return events


def hear(events: list[dict[str, Any]], text: str) -> None:
    """Show one warning."""
    event = json.loads(text)
    events.append(event)
    colour = COLOURS[event['level']]
    console.print(f'   [{colour}]{event["level"]:5}[/] {event["text"]}')


def check_offline() -> list[dict[str, Any]]:
    """Check the same bag without ROS."""
    console.print(f'[bold]4. The same bag offline:[/]  stickslip check {BAG.relative_to(ROOT)}')
    command = stickslip('check', str(BAG), '--config', str(CONFIG), '--json')
    begin = time.monotonic()
    answer = subprocess.run(command, capture_output=True, check=False, text=True)
    if answer.returncode == 2:
        raise SystemExit(answer.stderr)
    took = time.monotonic() - begin
    report = json.loads(answer.stdout)
    console.print(f'   {report["duration"]:.0f} s of telemetry in {took:.1f} s')
    return [event for item in report['bearings'].values() for event in item['events']]


def compare(live: list[dict[str, Any]], offline: list[dict[str, Any]], start: int) -> bool:
    """Show both lists side by side and say whether they agree."""
    table = Table('from', 'to', 'live [s]', 'offline [s]', 'difference [s]')
    pairs = list(zip(live, offline, strict=False))
    for a, b in pairs:
        times = [(event['time'] - start) * 1e-9 for event in (a, b)]
        difference = f'{times[0] - times[1]:+.3f}'
        table.add_row(b['from'], b['to'], *(f'{t:.3f}' for t in times), difference)
    console.print('[bold]5. Do they agree?[/]')
    console.print(table)
    same = [(e['from'], e['to']) for e in live] == [(e['from'], e['to']) for e in offline]
    worst = max((abs(a['time'] - b['time']) * 1e-9 for a, b in pairs), default=0.0)
    agree = same and bool(offline) and worst <= TOLERANCE
    console.print(
        f'   {len(live)} events live, {len(offline)} offline,'
        f' the same changes: {"yes" if same else "NO"};'
        f' largest difference {worst:.3f} s of recorded time'
    )
    return agree


def main() -> int:
    """Run the demonstration."""
    rclpy.init()
    node = start_node()
    try:
        live = listen()
    finally:
        node.send_signal(signal.SIGINT)
        code = node.wait(timeout=20)
        rclpy.try_shutdown()
    console.print(f'   the node stopped on Ctrl-C with exit code {code}')
    offline = check_offline()
    from stickslip_monitor.bags.reader import open_bag

    agree = compare(live, offline, open_bag(BAG).start_ns or 0) and code == 0
    console.print('[bold green]PASS[/]' if agree else '[bold red]FAIL[/]')
    return 0 if agree else 1


if __name__ == '__main__':
    sys.exit(main())
