# SPDX-License-Identifier: Apache-2.0
"""Message types by name, the number in a message, and the time it carries."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import NameValidationException

from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.config import InputConfig
from stickslip_monitor.monitor.fields import FieldPath

# What rclpy raises where a publisher or subscription cannot be made.
ROS_FAULTS = (NameValidationException, RuntimeError, ValueError)
_NUMBERS = re.compile(r'(boolean|octet|byte|char|float|double|long double|u?int(8|16|32|64))')
_ARRAY = re.compile(r'sequence<(?P<seq>[^,>]+)(,\s*\d+)?>|(?P<arr>[^\[<]+)\[(?P<size>\d+)\]')


def message_type(name: str) -> Any:
    """The Python class of a message type such as ``std_msgs/msg/Float64``.

    Raises:
        RosError: Its package is not installed or has no such message.
    """
    package, _, message = name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), message)
    except ImportError as error:
        raise RosError(
            f"message type '{name}' is not available: package {package} is not installed"
        ) from error
    except AttributeError as error:
        raise RosError(f"package {package} has no message type '{message}'") from error


def check_field(name: str, config: InputConfig) -> None:
    """Check that a field path leads to a number.

    Args:
        name: What the input is called in the error, e.g. ``aft_stern.speed``.
        config: The input.

    Raises:
        RosError: It does not; the text names the step and the fields there are.
    """
    current = config.type
    for step in config.field:
        current = _follow(name, config, current, step)
    if not _NUMBERS.fullmatch(current):
        raise RosError(
            f"{name}.field '{config.field_text}' of {config.type} is a {current}, not a number"
        )


def _follow(name: str, config: InputConfig, current: str, step: str | int) -> str:
    if isinstance(step, int):
        match = _ARRAY.fullmatch(current)
        if match is None:
            raise RosError(
                f"{name}.field '{config.field_text}': [{step}] needs an array, but there is a"
                f' {current}'
            )
        if match['size'] and step >= int(match['size']):
            raise RosError(
                f"{name}.field '{config.field_text}': index {step} is outside {current}"
            )
        return match['seq'] or match['arr']
    fields = {}
    if '/' in current:
        fields = message_type(_full_name(current)).get_fields_and_field_types()
    if step not in fields:
        there = ', '.join(fields) or f'none, it is a {current}'
        raise RosError(
            f"{name}.field '{config.field_text}': {current} has no field '{step}'; it has: {there}"
        )
    return str(fields[step])


def _full_name(name: str) -> str:
    package, message = name.split('/')[0], name.split('/')[-1]
    return f'{package}/msg/{message}'


def stamp_reader(type_name: str) -> Callable[[Any], int] | None:
    """A function that reads ``header.stamp`` [ns], or ``None`` where the type has no header."""
    fields = message_type(type_name).get_fields_and_field_types()
    if next(iter(fields.items()), None) != ('header', 'std_msgs/Header'):
        return None

    def read(message: Any) -> int:
        stamp = message.header.stamp
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)

    return read


def number_reader(path: FieldPath) -> Callable[[Any], float]:
    """A function that reads the number at a path; ``nan`` where an array is too short."""

    def read(message: Any) -> float:
        value = message
        try:
            for step in path:
                value = value[step] if isinstance(step, int) else getattr(value, step)
        except IndexError:
            return float('nan')
        if isinstance(value, bytes):
            value = value[0]
        return float(value)

    return read
