# SPDX-License-Identifier: Apache-2.0
"""Paths to one number inside a message: ``data``, ``velocity[shaft]``, ``wrench.force.z``.

An element of a list is chosen by its place, ``velocity[0]``, or in messages of parallel lists, as
``sensor_msgs/JointState``, by what the list ``name`` calls it: ``velocity[shaft]``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stickslip_logs.errors import FieldError

NAMES = 'name'
"""The list that names the elements of those beside it."""


@dataclass(frozen=True, slots=True)
class ByName:
    """A step to the element of a list that has a name in the list beside it."""

    name: str

    def __str__(self) -> str:
        return self.name


class NoSuchElementError(LookupError):
    """A message does not name the element: it is about others, as one of several publishers of joints sends.

    Attributes:
        names: What it names instead.
    """

    def __init__(self, name: str, names: Sequence[str]) -> None:
        super().__init__(f'no element is called {name}')
        self.names = tuple(names)


FieldPath = tuple[str | int | ByName, ...]

_STEP = re.compile(r'([A-Za-z][A-Za-z0-9_]*)((?:\[(?:\d+|[A-Za-z_/][^\[\]\n]*)\])*)')
_INDEX = re.compile(r'\[([^\[\]]+)\]')


def parse_field(text: str) -> FieldPath:
    """Split a field path such as ``'wrench.force.z'`` or ``'velocity[0]'`` into its steps.

    Returns:
        Attribute names, array indices and names of elements in order, e.g. ``('velocity', 0)``.

    Raises:
        FieldError: The text is not a path.
    """
    steps: list[str | int | ByName] = []
    # A name in brackets may have dots.
    for part in re.split(r'\.(?![^\[]*\])', text):
        match = _STEP.fullmatch(part)
        if match is None:
            raise FieldError(
                f"field '{text}' is not a path to a number: write names joined by dots, an array"
                " index or the name of an element in brackets, e.g. 'data', 'velocity[0]',"
                " 'velocity[shaft]' or 'wrench.force.z'"
            )
        steps.append(match.group(1))
        chosen = _INDEX.findall(match.group(2))
        steps += [int(c) if c.isdecimal() else ByName(c.strip()) for c in chosen]
    return tuple(steps)


class NumberField:
    """Reads the number at a path in decoded messages, one after the other."""

    def __init__(self, path: FieldPath) -> None:
        self._path = path
        # What the message that came first called each place that is chosen by its index. In a recording
        # that is the one written first, whatever its log time: a recorder writes in the order of arrival.
        self._called: dict[int, str] = {}

    def read(self, message: Any) -> float:
        """Return the number at the path in a decoded ROS message; remember names of indexed elements.

        A bool, an octet or the text of a number counts as one.

        Raises:
            NoSuchElementError: The message is not for this number, as it names other elements only.
            LookupError: An array is shorter than the index asks for, or has another name at the
                place than the first message (a fault of this message).
            AttributeError, TypeError, ValueError: The path does not lead to a number.
        """
        value = message
        parent: Any = None
        for number, step in enumerate(self._path):
            if isinstance(step, str):
                parent, value = value, getattr(value, step)
                continue
            place = step if isinstance(step, int) else _find_named_index(parent, step)
            if isinstance(step, int):
                self._check_name(number, parent, place)
            value = value[place]
        # rclpy gives an octet as bytes.
        return float(value[0] if isinstance(value, bytes) else value)

    def _check_name(self, number: int, parent: Any, place: int) -> None:
        """Check that an indexed element has its name of the first message; store that by the step's number.

        ``parent`` has the list of names, ``place`` is the index. A message without such a list, or with a
        shorter one, passes.

        Raises:
            LookupError: The name is another one.
        """
        names = getattr(parent, NAMES, None)
        if not isinstance(names, list) or place >= len(names):
            return
        if self._called.setdefault(number, names[place]) != names[place]:
            raise LookupError(f'element {place} has another name than in the first message')


def _find_named_index(parent: Any, step: ByName) -> int:
    """Return the index of a named element in the lists of ``parent``, by its list of names.

    Raises:
        NoSuchElementError: The message names others only.
        AttributeError: It has no list of names.
    """
    names = getattr(parent, NAMES)
    if step.name not in names:
        raise NoSuchElementError(step.name, names)
    return int(list(names).index(step.name))


def signalk_source(update: Mapping[str, Any]) -> str:
    """Return the sender of an update of Signal K: ``$source``, or the label that servers make of ``source``.

    '' where there is neither.

    >>> signalk_source({'source': {'label': 'N2K', 'type': 'NMEA2000', 'src': '17', 'pgn': 127488}})
    'N2K.17'
    """
    if '$source' in update:
        return str(update['$source'])
    source = update.get('source')
    if not isinstance(source, dict):
        return '' if source is None else str(source)
    begin = source.get('label') or source.get('type')
    end = source.get('src') if source.get('src') or source.get('pgn') else source.get('talker') or 'XX'
    return f'{begin}.{end}' if begin and end else str(begin or end or '')
