# SPDX-License-Identifier: Apache-2.0
"""Message types by name: the number in a message, the time it carries, and its definition."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import NameValidationException

from stickslip_monitor.errors import RosError
from stickslip_monitor.fields import ByName, FieldPath, NumberField
from stickslip_monitor.monitor.config import InputConfig

ROS_FAULTS = (NameValidationException, RuntimeError, ValueError)
"""What rclpy raises where a publisher or subscription cannot be made."""
_RULE = '=' * 80
_PLAIN = {'boolean': 'bool', 'octet': 'byte', 'float': 'float32', 'double': 'float64'}
_SEQUENCE = re.compile(r'sequence<(?P<item>.+?)(?:, *(?P<most>\d+))?>')
_ARRAY = re.compile(r'(?P<item>.+)\[(?P<size>\d+)\]')
_BOUNDED = re.compile(r'(?P<kind>w?string)<(?P<most>\d+)>')
_NUMBERS = re.compile(r'(boolean|octet|byte|char|float|double|long double|u?int(8|16|32|64))')


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


def _fields(name: str) -> dict[str, str]:
    """The fields of a type such as ``std_msgs/Header``, their types as rclpy names them."""
    package, message = name.split('/')[0], name.split('/')[-1]
    return dict(message_type(f'{package}/msg/{message}').get_fields_and_field_types())


def definition(name: str) -> str:
    """The concatenated ``ros2msg`` definition of a type such as ``sensor_msgs/msg/JointState``.

    It comes from the Python class, as not every installation has the ``.msg`` files; constants and
    default values, which that leaves out, have no part in how a message is encoded.

    Raises:
        RosError: It is not installed.
    """
    parts: dict[str, str] = {}
    waiting = [name.replace('/msg/', '/')]
    while waiting:
        current = waiting.pop(0)
        if current not in parts:
            fields = {field: _type(text) for field, text in _fields(current).items()}
            parts[current] = ''.join(f'{kind} {field}\n' for field, kind in fields.items())
            waiting += [kind.split('[')[0] for kind in fields.values() if '/' in kind]
    own, *others = parts.items()
    return own[1] + ''.join(f'{_RULE}\nMSG: {kind}\n{text}' for kind, text in others)


def _type(text: str) -> str:
    """A field's type as rclpy names it, in the words of a ``.msg`` file."""
    if match := _SEQUENCE.fullmatch(text):
        most = f'<={match["most"]}' if match['most'] else ''
        return f'{_type(match["item"])}[{most}]'
    if match := _ARRAY.fullmatch(text):
        return f'{_type(match["item"])}[{match["size"]}]'
    if match := _BOUNDED.fullmatch(text):
        return f'{match["kind"]}<={match["most"]}'
    return _PLAIN.get(text, text)


def check_field(name: str, config: InputConfig) -> None:
    """Check that a field path leads to a number.

    Args:
        name: What the input is called in the error, e.g. ``aft_stern.speed``.
        config: The input.

    Raises:
        RosError: It does not; the text names the step and the fields there are.
    """
    current, what = config.type, f"{name}.field '{config.field_text}'"
    for step in config.field:
        current = _follow(what, current, step)
    if not _NUMBERS.fullmatch(current):
        raise RosError(f'{what} of {config.type} is a {current}, not a number')


def _follow(what: str, current: str, step: str | int | ByName) -> str:
    """The type to which a step leads from another."""
    if not isinstance(step, str):
        match = _SEQUENCE.fullmatch(current) or _ARRAY.fullmatch(current)
        if match is None:
            raise RosError(f'{what}: [{step}] needs an array, but there is a {current}')
        if isinstance(step, int) and step >= int(match.groupdict().get('size') or step + 1):
            raise RosError(f'{what}: index {step} is outside {current}')
        return match['item']
    fields = _fields(current) if '/' in current else {}
    if step not in fields:
        there = ', '.join(fields) or f'none, it is a {current}'
        raise RosError(f"{what}: {current} has no field '{step}'; it has: {there}")
    return fields[step]


def stamp_reader(type_name: str) -> Callable[[Any], int]:
    """A function that reads ``header.stamp`` [ns]; 0 where there is none, or one before 1970."""
    stamped = next(iter(_fields(type_name).items()), None) == ('header', 'std_msgs/Header')

    def read(message: Any) -> int:
        stamp = message.header.stamp
        return max(0, int(stamp.sec) * 10**9 + int(stamp.nanosec))

    return read if stamped else lambda _: 0


def number_reader(path: FieldPath) -> Callable[[Any], float]:
    """A function that reads the number at a path.

    It is ``nan`` where an array is too short, or its element is not the one that is meant.
    """
    field = NumberField(path)

    def read(message: Any) -> float:
        try:
            return field.read(message)
        except LookupError:
            return math.nan

    return read
