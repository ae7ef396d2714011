# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types that a recording does not carry.

Those of numbers are built in; others are looked for where ROS 2 is sourced.
"""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path

from stickslip_monitor.bags.cdr import NUMBERS, TEXTS, short_name
from stickslip_monitor.files import read_file

_BUILT_IN = Path(__file__).with_name('definitions.txt')
_FIELD = re.compile(r'^\s*([A-Za-z]\w*(?:/\w+)*)(?:<=\d+)?(?:\[.*?\])?\s+\w+', re.MULTILINE)
_RULE = '=' * 80
# Of a definition [bytes].
_LARGEST = 1 << 18


def definition_of(kind: str) -> str | None:
    """The ``ros2msg`` text of a type with all that it uses; None where it is not known."""
    parts: dict[str, str] = {}
    if not _collect(short_name(kind), parts):
        return None
    first, *others = parts.items()
    return '\n'.join((first[1], *(f'{_RULE}\nMSG: {name}\n{text}' for name, text in others)))


def _collect(name: str, parts: dict[str, str]) -> bool:
    """Take up a type and those that it uses; whether all are known."""
    text = _built_in().get(name) or _sourced(name)
    if text is None:
        return False
    parts[name] = text
    package = name.partition('/')[0]
    for base in _FIELD.findall(re.sub('#.*', '', text)):
        own = short_name(base) if '/' in base else f'{package}/{base}'
        known = base in NUMBERS or base in TEXTS or own in parts
        if not known and not _collect(own, parts):
            return False
    return True


@cache
def _built_in() -> dict[str, str]:
    _, *parts = re.split(r'^MSG: (.*)\n', _BUILT_IN.read_text('utf-8'), flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _sourced(name: str) -> str | None:
    """The definition among the packages of ROS 2."""
    package, _, own = name.partition('/')
    if not re.fullmatch(r'\w+/\w+', name):
        return None
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        try:
            path = Path(prefix) / 'share' / package / 'msg' / f'{own}.msg'
            return read_file(path, _LARGEST).decode('utf-8', 'replace')
        except OSError:
            continue
    return None
