# SPDX-License-Identifier: Apache-2.0
"""How the node ends: bad configuration, Ctrl-C, termination."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

BAD = [
    ({'mass': -5.0}, 'aft.mass = -5.0 must be'),
    (
        {'speed.type': 'nowhere_msgs/msg/Speed'},
        "message type 'nowhere_msgs/msg/Speed' is not available: package nowhere_msgs is not"
        ' installed',
    ),
    (
        {'speed.field': 'value'},
        "aft.speed.field 'value': std_msgs/msg/Float64 has no field 'value'; it has: data",
    ),
]


def refused(program: Any, text: str) -> None:
    assert program.wait() == 2
    assert 'Traceback' not in program.output
    errors = [line for line in program.output.splitlines() if line.startswith('ERROR: ')]
    assert len(errors) == 1
    assert text in errors[0]


@pytest.mark.slow
@pytest.mark.parametrize(('change', 'text'), BAD)
def test_a_bad_configuration_is_refused(
    start: Any, kit: Any, change: dict[str, Any], text: str
) -> None:
    monitor = start(kit.parameters(change))
    refused(monitor, text)
    assert monitor.output.strip().count('\n') == 0


def node(*arguments: str) -> list[str]:
    return [sys.executable, '-m', 'stickslip_monitor.live', '--ros-args', *arguments]


@pytest.mark.slow
def test_what_ros_cannot_read_is_refused(run: Any, tmp_path: Path) -> None:
    missing, broken = tmp_path / 'missing.yaml', tmp_path / 'broken.yaml'
    broken.write_text('/**:\n  ros__parameters:\n    bearings: [aft, 1]\n')
    programs = [run(*node('--params-file', str(file))) for file in (missing, broken)]
    programs += [run(*node('--no-such-option')), run(*node())]
    refused(programs[0], 'the ROS arguments cannot be used: failed to initialize rcl')
    refused(programs[0], str(missing))
    refused(programs[1], str(broken))
    refused(programs[2], '--no-such-option')
    refused(programs[3], "parameter 'bearings' is missing")


@pytest.mark.slow
def test_a_start_that_fails(start: Any, kit: Any) -> None:
    # The node publishes this topic itself, with another type.
    monitor = start(kit.parameters({'speed.topic': '/parameter_events'}))
    refused(monitor, 'the node cannot activate: its inputs cannot be subscribed to: ')


def test_time_source_that_is_no_boolean(start: Any, kit: Any) -> None:
    monitor = start(kit.parameters(), '-p', 'use_sim_time:=banana')
    refused(monitor, "use_sim_time = 'banana' must be true or false")


@pytest.mark.slow
@pytest.mark.parametrize(
    'signals',
    [
        [signal.SIGINT],
        [signal.SIGTERM],
        [signal.SIGINT, 0.0, signal.SIGINT],
        [signal.SIGINT, 0.15, signal.SIGINT],
        [signal.SIGTERM, 0.02, signal.SIGINT, 0.1, signal.SIGTERM],
    ],
)
def test_signals_end_the_node_cleanly(start: Any, kit: Any, signals: list[Any]) -> None:
    monitor = start(kit.parameters(kit.STAMPED))
    telemetry = kit.Telemetry(monitor)
    for second in range(5):
        telemetry.send(20.0, 1000.0, second)
    for item in signals:
        if isinstance(item, signal.Signals):
            monitor.process.send_signal(item)
        else:
            time.sleep(item)
    assert monitor.wait() == 0
    assert 'Traceback' not in monitor.output
    assert 'Exception' not in monitor.output


# Before main() has its handlers, while Python imports, a signal is Python's own affair.
STARTING = """
import signal, sys
from stickslip_monitor.ros import run as node
install = signal.signal
def noted(number, handler):
    install(number, handler)
    if number == signal.SIGTERM:
        print('starting', flush=True)
signal.signal = noted
sys.exit(node.main(sys.argv))
"""


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_during_start_up(run: Any, kit: Any, tmp_path: Path, number: int) -> None:
    import yaml

    file = tmp_path / 'parameters.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': kit.parameters()}}))
    command = [sys.executable, '-c', STARTING, '--ros-args', '--params-file', str(file)]
    for delay in (0.0, 0.02, 0.1, 0.25):
        program = run(*command)
        end = time.monotonic() + kit.DEADLINE
        while 'starting' not in program.output and time.monotonic() < end:
            time.sleep(0.002)
        time.sleep(delay)
        program.process.send_signal(number)
        assert program.wait() == 0, (delay, program.output)
        assert 'Traceback' not in program.output
