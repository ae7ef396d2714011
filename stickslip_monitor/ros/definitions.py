# SPDX-License-Identifier: Apache-2.0
"""The definition of a message type as text, from what rclpy knows of it.

The ``.msg`` files of a type are not part of every installation; its Python class always is. What
it does not tell, constants and default values, has no part in how a message is encoded.
"""

from __future__ import annotations

import re
from typing import Any

from stickslip_monitor.ros.messages import message_type

_RULE = '=' * 80
_PLAIN = {
    'boolean': 'bool',
    'octet': 'byte',
    'float': 'float32',
    'double': 'float64',
}
_SEQUENCE = re.compile(r'sequence<(?P<item>.+?)(?:, *(?P<most>\d+))?>')
_ARRAY = re.compile(r'(?P<item>.+)\[(?P<size>\d+)\]')
_BOUNDED = re.compile(r'(?P<kind>w?string)<(?P<most>\d+)>')


def definition(name: str) -> str:
    """The concatenated ``ros2msg`` definition of a type such as ``sensor_msgs/msg/JointState``.

    Raises:
        RosError: It is not installed.
    """
    parts: dict[str, str] = {}
    waiting = [name.replace('/msg/', '/')]
    while waiting:
        current = waiting.pop(0)
        if current not in parts:
            fields = _fields(current)
            parts[current] = ''.join(f'{kind} {field}\n' for field, kind in fields.items())
            waiting += [kind.split('[')[0] for kind in fields.values() if '/' in kind]
    own, *others = parts.items()
    return own[1] + ''.join(f'{_RULE}\nMSG: {kind}\n{text}' for kind, text in others)


def _fields(short_name: str) -> dict[str, str]:
    package, _, kind = short_name.partition('/')
    message: Any = message_type(f'{package}/msg/{kind}')
    return {name: _type(text) for name, text in message.get_fields_and_field_types().items()}


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
