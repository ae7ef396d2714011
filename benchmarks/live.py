# SPDX-License-Identifier: Apache-2.0
"""A node under test in a process of its own, and the telemetry that it is fed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Float64, String

from benchmarks.reference import CONFIG, LOAD, bearing
from stickslip_monitor import hopf_speed

FIRST_RPM, STEP_RPM, CODES = 20.0, 1e-4, 50_000
"""The speed of each message carries its number; all of them stick and slip."""
_OUT = 'stickslip_monitor/aft_stern'
_DEPTH = 5000
_POLL = 50e-6
_DRAIN, _DIAGNOSED = 1.0, 1.5


@dataclass(frozen=True, slots=True)
class Measurement:
    """Answers of a node to some seconds of telemetry at one rate.

    Attributes:
        latency: From a speed's publication until its answer is there, of those answered [s].
        sent: Speeds that were sent, and as many loads.
        lost: Speeds and loads that the node has not counted.
        cpu: Share of a core that the node took.
    """

    latency: NDArray[np.float64]
    sent: int
    lost: int
    cpu: float

    @property
    def answered(self) -> float:
        """Share of the speeds that have an answer of their own."""
        return self.latency.size / self.sent


class Subject:
    """A node under test.

    Args:
        command: Starts it.
        space: Its namespace.
        answer: The topic that answers a speed.
        code: Gives back the speed [rpm] of an answer.
        others: Its other topics, which are listened to so that it has to send them.
        diagnosed: Whether it counts its samples in diagnostics.
        driver: The driver's own node.
    """

    def __init__(
        self,
        command: Sequence[str],
        space: str,
        answer: str,
        code: Callable[[float], float],
        driver: Node,
        other_topics: Sequence[str] = (),
        diagnosed: bool = False,
    ) -> None:
        self._code = code
        self._counts = None
        arguments = ['--ros-args', '-r', f'__ns:=/{space}', '--log-level', 'error']
        self.process = subprocess.Popen([sys.executable, '-m', *command, *arguments])
        self._speed = driver.create_publisher(Float64, f'/{space}/speed', _DEPTH)
        self._load = driver.create_publisher(Float64, f'/{space}/load', _DEPTH)
        self._answers = driver.create_subscription(Float64, f'/{space}/{answer}', lambda _: None, _DEPTH)
        for topic in other_topics:
            kind = String if topic.endswith('regime') else Float64
            driver.create_subscription(kind, f'/{space}/{topic}', lambda _: None, 1)
        if diagnosed:
            self._counts = driver.create_subscription(DiagnosticArray, '/diagnostics', lambda _: None, 1)
        self._wait_for_answer()

    def _wait_for_answer(self) -> None:
        """Send until the node answers."""
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            self._publish_number(self._load, LOAD)
            self._publish_number(self._speed, FIRST_RPM)
            time.sleep(0.1)
            if any(True for _ in take_messages(self._answers)):
                time.sleep(_DRAIN)
                for _ in take_messages(self._answers):
                    pass
                return
        raise RuntimeError(f'no answer on {self._answers.topic_name}')

    def measure(self, rate: float, seconds: float) -> Measurement:
        """Feed speed and load, each at a rate [Hz], a load half-way between two speeds."""
        count = round(rate * seconds)
        sent, answered_at = np.zeros(count), np.full(count, np.nan)
        count_before = self._accepted_count()
        cpu, begin = processor_time(self.process.pid), time.monotonic()
        for half in range(2 * count):
            self._note_answers(answered_at, begin + half / (2.0 * rate))
            if half % 2:
                self._publish_number(self._load, LOAD)
            else:
                code = half // 2 % CODES
                sent[half // 2] = time.monotonic()
                self._publish_number(self._speed, FIRST_RPM + STEP_RPM * code)
        cpu, spent = processor_time(self.process.pid) - cpu, time.monotonic() - begin
        self._note_answers(answered_at, time.monotonic() + _DRAIN)
        latency = answered_at - sent
        latency = latency[np.isfinite(latency)]
        accepted_count = 2 * latency.size if self._counts is None else self._accepted_count() - count_before
        return Measurement(latency, count, 2 * count - accepted_count, cpu / spent)

    def _accepted_count(self) -> int:
        """Return the number of samples that the node has counted by its last diagnostics."""
        if self._counts is None:
            return 0
        end, count = time.monotonic() + _DIAGNOSED, 0
        while time.monotonic() < end:
            for _, message in take_messages(self._counts):
                pairs = {pair.key: pair.value for pair in message.status[0].values}
                count = sum(int(pairs[f'{name} samples accepted']) for name in ('speed', 'load'))
            time.sleep(_POLL)
        return count

    def _note_answers(self, answered_at: NDArray[np.float64], until: float) -> None:
        """Note answers until a time."""
        while True:
            for now, message in take_messages(self._answers):
                code = round((self._code(message.data) - FIRST_RPM) / STEP_RPM)
                self._note_answer(answered_at, code, now)
            remaining = until - time.monotonic()
            if remaining <= 0.0:
                return
            time.sleep(min(remaining, _POLL))

    def _note_answer(self, answered_at: NDArray[np.float64], code: int, now: float) -> None:
        """Give an answer to the first speed of that code that has none; a load answers again."""
        same = answered_at[code::CODES]
        open_ = np.flatnonzero(np.isnan(same))
        if open_.size:
            same[open_[0]] = now

    def _publish_number(self, publisher: Any, value: float) -> None:
        publisher.publish(Float64(data=value))

    def stop(self) -> None:
        """End the process as Ctrl-C does."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(20.0)


def processor_time(pid: int) -> float:
    """Processor time that a process has taken [s]."""
    stat = Path(f'/proc/{pid}/stat').read_text('utf-8')
    fields = stat.rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def take_messages(subscription: Any) -> Iterator[tuple[float, Any]]:
    """Yield the waiting messages, with the times at which they were taken."""
    while True:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        yield time.monotonic(), taken[0]


@contextmanager
def start_subjects(domain: int) -> Iterator[dict[str, Subject]]:
    """Start the bare node and the monitor and wait until both are ready.

    Args:
        domain: The DDS domain to keep to.
    """
    os.environ |= {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    rclpy.init()
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        driver = rclpy.create_node('driver')
        nodes = {}
        for name, make in (('bare', start_bare), ('monitor', start_monitor)):
            nodes[name] = make(folder, driver)
            stack.callback(nodes[name].stop)
        yield nodes


def start_bare(folder: Path, driver: Node) -> Subject:
    """Start the node that only echoes."""
    return Subject(['benchmarks.echo_node'], 'bare', 'echo/speed', lambda value: value, driver)


def start_monitor(folder: Path, driver: Node) -> Subject:
    """Start the monitor with the reference bearing."""
    reference = bearing()
    hopf = float(reference.speed.from_surface(hopf_speed(reference, LOAD), 'rpm'))
    document = yaml.safe_load(CONFIG.read_text('utf-8'))
    settings = document['/**']['ros__parameters']['aft_stern']
    settings['speed']['topic'], settings['load']['topic'] = 'speed', 'load'
    file = folder / 'monitor.yaml'
    file.write_text(yaml.safe_dump(document), 'utf-8')
    command = ['stickslip_monitor.live', '--ros-args', '--params-file', str(file)]
    return Subject(
        command,
        'watch',
        f'{_OUT}/hopf_margin',
        lambda margin: (margin + 1.0) * hopf,
        driver,
        [f'{_OUT}/{name}' for name in ('amplitude', 'amplitude_exact', 'fold_margin', 'regime')],
        diagnosed=True,
    )
