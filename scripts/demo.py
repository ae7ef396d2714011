# SPDX-License-Identifier: Apache-2.0
"""Plays a recorded coast-down to the real node and shows that it warns as the offline check does.

Three processes over DDS on this machine: the node, a player, and this one, which listens.

The recorded numbers are first put into messages that carry both, with the time of measurement in
their header. The node then takes time from the stamps and not from their arrival, so its events
must equal those of the offline check, to the nanosecond, however busy the machine is.
"""

from __future__ import annotations

import json
import math
import os
import random
import shutil
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
import yaml
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.writer import BagWriter
from stickslip_monitor.ros.inputs import compose_definition

ROOT = Path(__file__).resolve().parent.parent
RECORDING = ROOT / 'bags' / 'coast_down'
BEARING = ROOT / 'launch_configs' / 'reference_bearing.yaml'
FOLDER = ROOT / 'build' / 'demo'
BAG, CONFIG = FOLDER / 'coast_down', FOLDER / 'bearing.yaml'
TOPIC, TYPE = '/shaft', 'sensor_msgs/msg/JointState'
RATE = 15
# A stamp counts where it is at most a second older than its arrival: half of that is left for a
# player or node that is late [ns].
DELIVERED_NS = 500_000_000
# Longer than any wait below: a slow end of the demonstration is not a lost input.
TIMEOUT = 300.0
# Seconds for programs to start, and for the last warning to arrive, on a very busy machine.
PATIENCE = 60.0
COLOURS = {'OK': 'green', 'WARN': 'yellow', 'ERROR': 'red'}

console = Console()


def write_inputs() -> None:
    """Write the recording as stamped messages, and the configuration that reads them."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    inputs = (Request('/shaft/speed', 'data'), Request('/bearing/aft_stern/load', 'data'))
    series = open_bag(RECORDING).read(set(inputs))
    speed, load = (series[request] for request in inputs)
    rows = zip(speed.stamp_ns.tolist(), speed.value.tolist(), load.value.tolist(), strict=True)
    with BagWriter(BAG) as writer:
        writer.add_topic(TOPIC, TYPE, compose_definition(TYPE))
        for stamp_ns, rpm, newtons in rows:
            message = JointState(velocity=[rpm * math.pi / 30.0], effort=[newtons])
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            writer.write(TOPIC, stamp_ns + DELIVERED_NS, serialize_message(message))
    config = yaml.safe_load(BEARING.read_text('utf-8'))
    bearing = config['/**']['ros__parameters']['aft_stern']
    common = {'topic': TOPIC, 'type': TYPE, 'timeout': TIMEOUT}
    bearing['speed'] = {**common, 'field': 'velocity[0]', 'unit': 'rad/s'}
    bearing['load'] = {**common, 'field': 'effort[0]', 'unit': 'N'}
    CONFIG.write_text(yaml.safe_dump(config), 'utf-8')


def stickslip_command(*arguments: str) -> list[str]:
    """Return the command line of a stickslip command in this environment."""
    return [sys.executable, '-m', 'stickslip_monitor.cli', *arguments]


def check_offline() -> tuple[list[dict[str, Any]], str]:
    """Check the bag without ROS: its events, and how long that took."""
    begin = time.monotonic()
    answer = subprocess.run(
        stickslip_command('check', str(BAG), '--config', str(CONFIG), '--json'),
        capture_output=True,
        check=False,
        text=True,
    )
    if answer.returncode == 2:
        raise SystemExit(answer.stderr)
    took = time.monotonic() - begin
    report = json.loads(answer.stdout)
    events = [event for item in report['bearings'].values() for event in item['events']]
    return events, f'{report["duration"]:.0f} s of telemetry in {took:.1f} s'


def start_node() -> subprocess.Popen[bytes]:
    """Start the monitor node as a process of its own."""
    command = [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args']
    command += ['--params-file', str(CONFIG), '-p', 'use_sim_time:=true', '--log-level', 'error']
    console.print('[bold]1. The node[/], on its own:  .venv/bin/monitor --ros-args --params-file ...')
    return subprocess.Popen(command)


def listen(count: int) -> list[dict[str, Any]]:
    """Play the bag and collect the node's warnings until it has ended and there are `count`."""
    events: list[dict[str, Any]] = []
    node = Node('demo_listener')
    latched = QoSProfile(
        depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )
    topic = '/stickslip_monitor/warnings'
    node.create_subscription(String, topic, lambda message: take_warning(events, message.data), latched)
    console.print(
        f'[bold]2. A player[/], {RATE} times faster than it happened:'
        f'  stickslip play {BAG.relative_to(ROOT)} --rate {RATE}'
    )
    console.print(f'[bold]3. Warnings as they come[/] on {topic}:')
    player = subprocess.Popen(
        stickslip_command('play', str(BAG), '--rate', str(RATE), '--wait', str(PATIENCE)),
        stderr=subprocess.DEVNULL,
    )
    end = math.inf
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
        if player.poll() is not None:
            # One warning too many must be heard as well.
            patience = PATIENCE if len(events) < count else 1.0
            end = min(end, time.monotonic() + patience)
    node.destroy_node()
    if player.returncode:
        raise SystemExit(f'the player failed with code {player.returncode}')
    return events


def take_warning(events: list[dict[str, Any]], text: str) -> None:
    """Show one warning."""
    event = json.loads(text)
    events.append(event)
    colour = COLOURS[event['severity']]
    console.print(f'   [{colour}]{event["severity"]:5}[/] {event["text"]}')


def compare_events(live: list[dict[str, Any]], offline: list[dict[str, Any]]) -> bool:
    """Show both lists side by side and say whether they are equal, every field of every event."""
    table = Table('from', 'to', 'live [s]', 'offline [s]', 'difference [s]')
    start = open_bag(BAG).start_ns or 0
    for a, b in zip(live, offline, strict=False):
        times = [f'{(event["time"] - start) * 1e-9:.3f}' for event in (a, b)]
        table.add_row(b['from'], b['to'], *times, f'{(a["time"] - b["time"]) * 1e-9:g}')
    console.print('[bold]5. Do they agree?[/]')
    console.print(table)
    equal = live == offline and bool(offline)
    console.print(
        f'   {len(live)} events live, {len(offline)} offline; every field the same:'
        f' {"yes" if equal else "NO"}. The messages carry the time of measurement,'
        ' so a busy machine makes no difference.',
        soft_wrap=True,
    )
    return equal


def main() -> int:
    """Run the demonstration."""
    rclpy.init()
    write_inputs()
    offline, took = check_offline()
    node = start_node()
    try:
        live = listen(len(offline))
    finally:
        node.send_signal(signal.SIGINT)
        code = node.wait(timeout=PATIENCE)
        rclpy.try_shutdown()
    console.print(f'   the node stopped on Ctrl-C with exit code {code}')
    config = CONFIG.relative_to(ROOT)
    console.print(
        f'[bold]4. The same bag offline:[/]  stickslip check {BAG.relative_to(ROOT)}'
        f' --config {config}\n   {took}',
        soft_wrap=True,
    )
    agree = compare_events(live, offline) and code == 0
    console.print('[bold green]PASS[/]' if agree else '[bold red]FAIL[/]')
    console.print(
        'Next: [bold]make dashboard[/] shows the recording in a browser;'
        ' [bold]source .venv/bin/activate[/] lets you call stickslip.'
    )
    return 0 if agree else 1


if __name__ == '__main__':
    sys.exit(main())
