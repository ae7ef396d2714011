# SPDX-License-Identifier: Apache-2.0
"""Paths to one number inside a message: ``data``, ``velocity[0]``, ``wrench.force.z``."""

from __future__ import annotations

import re
from typing import Any

from stickslip_monitor.errors import ConfigurationError

FieldPath = tuple[str | int, ...]

_STEP = re.compile(r'([A-Za-z][A-Za-z0-9_]*)((?:\[\d+\])*)')


def parse_field(text: str) -> FieldPath:
    """Split a field path such as ``'wrench.force.z'`` or ``'velocity[0]'`` into its steps.

    Returns:
        Attribute names and array indices in order, e.g. ``('velocity', 0)``.

    Raises:
        ConfigurationError: The text is not a path.
    """
    steps: list[str | int] = []
    for part in text.split('.'):
        match = _STEP.fullmatch(part)
        if match is None:
            raise ConfigurationError(
                f"field '{text}' is not a path to a number: write names joined by dots, an array"
                " index in brackets, e.g. 'data', 'velocity[0]' or 'wrench.force.z'"
            )
        steps.append(match.group(1))
        steps.extend(int(index) for index in re.findall(r'\d+', match.group(2)))
    return tuple(steps)


def read_field(message: Any, path: FieldPath) -> float:
    """Follow the steps of a path through any decoded ROS message to the number at its end.

    Raises:
        LookupError: An array is shorter than the index asks for (a fault of this one message).
        AttributeError, TypeError, ValueError: The path does not lead to a number.
    """
    value = message
    for step in path:
        value = value[step] if isinstance(step, int) else getattr(value, step)
    # rclpy gives an octet as bytes.
    return float(value[0] if isinstance(value, bytes) else value)
