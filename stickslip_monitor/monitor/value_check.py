# SPDX-License-Identifier: Apache-2.0
"""Checks values from outside: those of a configuration, a scene, an option or a file of results.

One declaration, one check, and one sentence for what breaks its rule.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from stickslip_logs.errors import MAX_SHOWN
from stickslip_monitor.errors import ConfigurationError, StickslipError, did_you_mean

REQUIRED = object()
"""The default of a parameter that must be given."""
_WORDS = {
    'float': 'a finite number',
    'int': 'a whole number',
    'bool': 'true or false',
    'str': 'a text, in quotation marks if need be',
    'float[]': 'a list of finite numbers',
    'str[]': 'a list of texts',
}
_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value from outside: its type, unit, default and bounds."""

    name: str  # dotted; for a bearing's parameter without the bearing's name
    kind: str  # float, int, bool or str, with [] for a list of these
    default: Any  # used where the file gives none; REQUIRED where it must
    text: str  # what it is, for descriptors and docs
    unit: str = ''
    minimum: float = -math.inf
    maximum: float = math.inf
    above_minimum: bool = False  # the minimum itself is not allowed
    not_zero: bool = False  # zero is not allowed
    in_pairs: bool = False  # a list of pairs, also written as one list, which is all that ROS 2 reads
    choices: tuple[str, ...] = ()  # the values allowed, empty for any
    live: bool = False  # may be changed while the node is active
    fixed: bool = False  # may not be changed at all once the node has started

    @property
    def is_optional(self) -> bool:
        """Whether it may be left without a value: its default is none."""
        return self.default == () or (isinstance(self.default, float) and math.isnan(self.default))

    def is_default(self, value: Any) -> bool:
        """Return whether a checked value is the default; ``nan``, which stands for no value, always is."""
        return bool(value == self.default or value != value)

    def rule(self) -> str:
        """Return the rule a value must keep, in words that follow 'must be'."""
        if self.choices:
            return f'one of {", ".join(self.choices)}'
        words = ['a number' if self.default == math.inf else _WORDS[self.kind]]
        if self.in_pairs:
            words = ['a list of pairs of finite numbers']
        if self.minimum > -math.inf and self.maximum < math.inf and not self.above_minimum:
            words.append(f'between {self.minimum:g} and {self.maximum:g}')
        else:
            if self.minimum > -math.inf:
                words.append(f'{"above" if self.above_minimum else "not below"} {self.minimum:g}')
            if self.maximum < math.inf:
                words.append(f'not above {self.maximum:g}')
        if self.not_zero:
            words.append('other than 0')
        return ' and '.join([' '.join(words[:2]), *words[2:]]) + f' {self.unit}'.rstrip()

    def checked(self, name: str, values: Mapping[str, Any]) -> Any:
        """Return the value of that full name, checked and converted; the default where it is left out.

        Lists become tuples, and pairs one flat tuple.

        Raises:
            ConfigurationError: It is missing, of the wrong type, or breaks its rule; the text
                names parameter, value and rule.
        """
        if name not in values:
            if self.default is REQUIRED:
                unit = f' [{self.unit}]' if self.unit else ''
                raise ConfigurationError(f"parameter '{name}'{unit} is missing: {self.text}")
            return self.default
        value, kind, items = values[name], self.kind.removesuffix('[]'), [values[name]]
        if is_list := kind != self.kind:
            listed = hasattr(value, '__iter__') and not isinstance(value, str | bytes)
            items = list(value) if listed else [None]
            items = _flat_pairs(items) if self.in_pairs else items
        items = [_convert_value(kind, item) for item in items]
        if not all(item is not None and self._is_allowed(item) for item in items):
            hint = did_you_mean(value, self.choices) if isinstance(value, str) else ''
            raise refused(name, value, f'{self.rule()}{hint or _remedy_for_text(value)}')
        return tuple(items) if is_list else items[0]

    def _is_allowed(self, value: Any) -> bool:
        """Return whether one value, or one item of a list, of the right type keeps the rule."""
        if isinstance(value, str):
            return not self.choices or value in self.choices
        if isinstance(value, bool):
            return True
        above = value > self.minimum if self.above_minimum else value >= self.minimum
        finite = isinstance(value, int) or math.isfinite(value) or self.default == math.inf
        return above and value <= self.maximum and finite and not (self.not_zero and value == 0)


def _flat_pairs(items: list[Any]) -> list[Any]:
    """Return pairs as one list of numbers; ``[None]`` where an item is no pair or a number is left over."""
    if items and all(isinstance(item, list | tuple) for item in items):
        return [number for pair in items for number in pair] if {*map(len, items)} == {2} else [None]
    return items if len(items) % 2 == 0 else [None]


def _remedy_for_text(value: Any) -> str:
    """Return how to write a number that was read as a text, as the end of a sentence beginning with ': '.

    '' if the value is no text, or a text that is not a number.
    """
    if not isinstance(value, str):
        return ''
    plain = value.replace('_', '').replace(',', '.').strip()
    return f': write {plain}, without quotes' if _NUMBER.fullmatch(plain) else ''


def _convert_value(kind: str, value: Any) -> Any:
    """Convert a value to the plain Python type of its kind; ``None`` if it is of another, or too large.

    ``kind`` is float, int, bool or str: of a list, that of its items.
    """
    if kind in ('bool', 'str'):
        return value if isinstance(value, bool if kind == 'bool' else str) else None
    if isinstance(value, bool) or not isinstance(value, Integral if kind == 'int' else Real):
        return None
    try:
        return int(value) if isinstance(value, Integral) and kind == 'int' else float(value)
    except OverflowError:
        return None


def refused(
    name: str, value: Any, rule: str, kind: type[StickslipError] = ConfigurationError
) -> StickslipError:
    """Return the error of that kind, to be raised, for a value that breaks its rule.

    Its text is ``NAME = VALUE must be RULE``.
    """
    return kind(f'{name} = {shown(value)} must be {rule}')


def require_rule(is_kept: object, name: str, value: Any, rule: str) -> None:
    """Check that a value keeps its rule.

    Raises:
        ConfigurationError: ``is_kept`` is false; the text is that of :func:`refused`.
    """
    if not is_kept:
        raise refused(name, value, rule)


def shown(value: Any) -> str:
    """Return a value as sentences show it, in up to 60 characters: a date in ISO 8601, others by ``repr``."""
    text = value.isoformat() if hasattr(value, 'isoformat') else repr(value)
    return text if len(text) <= MAX_SHOWN else f'{text[: MAX_SHOWN - 3]}...'
