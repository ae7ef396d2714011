# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stickslip_monitor.monitor.session import Moment
from stickslip_monitor.ros.active import ElapsedTime

ROS = 10**18


def test_on_system_time_the_steady_clock_counts() -> None:
    flow = ElapsedTime(False, Moment(100, ROS))
    assert flow.tick(Moment(130, ROS + 10**12)) == 30
    assert flow.tick(Moment(150, 0)) == 50


def test_on_simulated_time_the_simulated_clock_counts() -> None:
    flow = ElapsedTime(True, Moment(100, ROS))
    assert flow.tick(Moment(130, ROS + 600)) == 600
    assert flow.tick(Moment(140, ROS + 650)) == 650


def test_a_step_back_counts_as_no_time() -> None:
    flow = ElapsedTime(True, Moment(0, ROS))
    assert flow.tick(Moment(10, ROS + 500)) == 500
    assert flow.tick(Moment(20, ROS - 10**9)) == 500
    assert flow.tick(Moment(30, ROS - 10**9 + 7)) == 507


def test_while_the_simulated_clock_is_unknown_the_steady_clock_counts() -> None:
    flow = ElapsedTime(True, Moment(0, 0))
    assert flow.tick(Moment(10, 0)) == 10
    assert flow.tick(Moment(20, ROS)) == 20
    assert flow.tick(Moment(30, ROS + 3)) == 23


def test_while_the_simulated_clock_stands_still_the_steady_clock_counts() -> None:
    flow = ElapsedTime(True, Moment(0, ROS))
    assert flow.tick(Moment(10, ROS)) == 10
    assert flow.tick(Moment(20, ROS + 5)) == 15


def test_a_sample_starts_the_count_anew() -> None:
    flow = ElapsedTime(True, Moment(0, ROS))
    flow.tick(Moment(10, ROS + 500))
    flow.restart(Moment(20, ROS + 600))
    assert flow.tick(Moment(30, ROS + 650)) == 50
