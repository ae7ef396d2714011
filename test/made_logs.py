# SPDX-License-Identifier: Apache-2.0
"""Recordings that tests make."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stickslip_logs.recordings.writer import BagWriter

START = 1_777_874_400 * 10**9  # 2026-05-04 06:00:00 UTC, when most recordings of bags/ begin

HEADER_DEFINITION = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""What a definition of messages with a header ends with."""


def write_recording(path: Path, columns: Mapping[str, tuple[Any, Any]]) -> Path:
    """Write a recording of Float64s: log times [ns] and values of each topic."""
    with BagWriter(path) as writer:
        for topic in columns:
            writer.add_topic(topic, 'std_msgs/msg/Float64')
        writer.write_float64s(columns)
    return path
