# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


def test_messages_that_share_a_tick_of_the_clock_keep_their_order() -> None:
    """As at ``ros2 bag play --rate 10 --clock 40``: ten messages of 10 Hz to every four ticks."""
    from std_msgs.msg import Float64

    from stickslip_monitor.ros.inputs import InputReader, Lane

    clock = SimpleNamespace(now=0)
    node: Any = SimpleNamespace(now_ns=lambda: clock.now, resolve_topic_name=lambda topic: topic)
    heard: list[tuple[int, float]] = []

    def receive(bearing: str, is_load: int, time_ns: int, value: float, latest: bool) -> None:
        heard.append((time_ns, value))

    reading = InputReader('aft', 0, lambda message: float(message.data))
    lane = Lane(node, 'speed', 'std_msgs/msg/Float64', [reading], 10**9, receive, None)
    # Before the first /clock there is no time, and nothing is used.
    lane._take(Float64(data=-1.0), True)
    ticks = [10**9, 10**9, 10**9, 10**9 + 250_000_000, 10**9 + 250_000_000, 5 * 10**8]
    for number, clock.now in enumerate(ticks):
        lane._take(Float64(data=float(number)), True)
    assert [value for _, value in heard] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    times = [time_ns for time_ns, _ in heard]
    assert times == [
        10**9,
        10**9 + 1,
        10**9 + 2,
        10**9 + 250_000_000,
        10**9 + 250_000_001,
        5 * 10**8,
    ]
