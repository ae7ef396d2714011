# SPDX-License-Identifier: Apache-2.0
"""How every program of the package starts ROS."""

from __future__ import annotations

from collections.abc import Sequence


def without_log_files(arguments: Sequence[str]) -> list[str]:
    """The arguments for ``rclpy.init``, with rcl's own log files off unless they are asked for.

    Standard error has all that they would have. A health check every 30 s left a million files a
    year, and without a folder that can be written nothing started.
    """
    return ['--ros-args', '--disable-external-lib-logs', '--', *arguments]
