# SPDX-License-Identifier: Apache-2.0
"""The node without inputs, and with fifty bearings: its processor time."""

from __future__ import annotations

import copy
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import Float64

from benchmarks.live import processor_time, take_messages
from benchmarks.reference import CONFIG, LOAD
from benchmarks.table import Table

BEARINGS, RATE = 50, 10.0
_SETTLED = 8.0


def run(quick: bool) -> Table:
    """Measure both."""
    seconds = 5.0 if quick else 30.0
    os.environ |= {'ROS_DOMAIN_ID': str(150 + os.getpid() % 50), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    rclpy.init()
    driver = rclpy.create_node('driver')
    try:
        rows = [_measure_idle(seconds), _measure_fleet(driver, seconds)]
    finally:
        rclpy.try_shutdown()
    return Table(
        title='Idle, and a fleet',
        text=(
            'The node with one bearing whose inputs nobody publishes, and with fifty bearings,'
            ' each with a speed and a load of its own at 10 Hz, whose diagnostics are listened to.'
            ' Per message is the processor time of the node with all threads of DDS; losses are'
            ' events of lost inputs.'
        ),
        columns=('case', 'sent', 'heard', 'CPU', 'per message', 'losses'),
        rows=rows,
    )


def _measure_idle(seconds: float) -> list[str]:
    with _start_monitor(1) as (process, _):
        time.sleep(_SETTLED)
        cpu = processor_time(process.pid)
        time.sleep(seconds)
        share = (processor_time(process.pid) - cpu) / seconds
    return ['no inputs', '0', '0', f'{share:.1%}', '', '']


def _measure_fleet(driver: Node, seconds: float) -> list[str]:
    with _start_monitor(BEARINGS) as (process, log):
        topics = [f'{name}{i}' for i in range(BEARINGS) for name in ('/speed', '/load')]
        publishers = [driver.create_publisher(Float64, topic, 10) for topic in topics]
        diagnostics = driver.create_subscription(DiagnosticArray, '/diagnostics', lambda _: None, 100)
        while not all(publisher.get_subscription_count() for publisher in publishers):
            if process.poll() is not None:
                raise RuntimeError(log.read_text('utf-8'))
            time.sleep(0.1)
        _feed_publishers(publishers, 3.0)
        time.sleep(1.5)
        count_before, cpu, begin = _count_accepted(diagnostics), processor_time(process.pid), time.monotonic()
        sent = _feed_publishers(publishers, seconds)
        spent = time.monotonic() - begin
        used = processor_time(process.pid) - cpu
        time.sleep(1.5)
        count = _count_accepted(diagnostics) - count_before
        losses = log.read_text('utf-8').count(' lost: ')
    return [
        f'{BEARINGS} bearings',
        str(sent),
        str(count),
        f'{used / spent:.0%}',
        f'{1e6 * used / max(count, 1):.0f} µs',
        str(losses),
    ]


def _feed_publishers(publishers: list[rclpy.publisher.Publisher[Float64]], seconds: float) -> int:
    """Publish on each topic in turn, at an even pace; return the number of messages."""
    begin, step = time.monotonic(), 1.0 / (RATE * len(publishers))
    count = round(seconds / step)
    for number in range(count):
        kind = number % 2
        rpm = 60.0 + 1e-3 * (number % 1000)
        publishers[number % len(publishers)].publish(Float64(data=LOAD if kind else rpm))
        time.sleep(max(begin + number * step - time.monotonic(), 0.0))
    return count


def _count_accepted(subscription: rclpy.subscription.Subscription[DiagnosticArray]) -> int:
    """Return the number of samples accepted by all bearings, by their last diagnostics."""
    count = 0
    for _, message in take_messages(subscription):
        if len(message.status) > BEARINGS:
            pairs = [pair for status in message.status for pair in status.values]
            count = sum(int(p.value) for p in pairs if p.key.endswith(' samples accepted'))
    return count


@contextmanager
def _start_monitor(count: int) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """Start a node with so many bearings and yield it with its log."""
    document = yaml.safe_load(CONFIG.read_text('utf-8'))
    parameters = document['/**']['ros__parameters']
    reference = parameters.pop('aft_stern')
    parameters['bearings'] = [f'bearing_{i}' for i in range(count)]
    for i in range(count):
        # ROS 2 reads no aliases, so nothing may be shared.
        parameters_of_bearing = copy.deepcopy(reference)
        for quantity in ('speed', 'load'):
            parameters_of_bearing[quantity]['topic'] = f'/{quantity}{i}'
        parameters[f'bearing_{i}'] = parameters_of_bearing
    with tempfile.TemporaryDirectory() as folder:
        file, log = Path(folder) / 'fleet.yaml', Path(folder) / 'log'
        file.write_text(yaml.safe_dump(document), 'utf-8')
        command = [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args']
        with log.open('wb') as output:
            process = subprocess.Popen([*command, '--params-file', str(file)], stdout=output, stderr=output)
        try:
            yield process, log
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(20.0)
