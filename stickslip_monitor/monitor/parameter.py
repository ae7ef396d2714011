# SPDX-License-Identifier: Apache-2.0
"""A configuration parameter, declared once as a field of the dataclass that holds its value.

Validation, the ROS parameter descriptors and the reference page are made from the declaration.
Plain dataclass fields do it: the sentences of refusal are our own, so what pydantic, msgspec or
cattrs would add is another set of sentences to translate and a dependency of the node.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from numbers import Integral, Real
from typing import Any, TypeVar

from stickslip_monitor.errors import ConfigurationError

REQUIRED = object()
"""The default of a parameter that must be given."""
WEEK = 604800.0
"""The longest duration that is allowed where nothing else sets a limit [s]."""
_WORDS = {
    'float': 'a finite number',
    'int': 'a whole number',
    'bool': 'true or false',
    'str': 'a text',
    'float[]': 'a list of finite numbers',
    'str[]': 'a list of texts',
}
_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')
Section = TypeVar('Section')


def nanoseconds(seconds: float) -> int:
    """A duration of the configuration [s] as whole nanoseconds."""
    return round(seconds * 1e9)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One configuration parameter."""

    name: str  # dotted; for a bearing's parameter without the bearing's name
    kind: str  # float, int, bool or str, with [] for a list of these
    default: Any  # used where the file gives none; REQUIRED where it must
    text: str  # what it is, for descriptors and docs
    unit: str = ''
    minimum: float = -math.inf
    maximum: float = math.inf
    above_minimum: bool = False  # the minimum itself is not allowed
    not_zero: bool = False  # zero is not allowed
    choices: tuple[str, ...] = ()  # the values allowed, empty for any
    live: bool = False  # may be changed while the node is active
    fixed: bool = False  # may not be changed at all once the node has started

    @property
    def optional(self) -> bool:
        """Whether it may be left without a value: its default is none."""
        return self.default == () or (isinstance(self.default, float) and math.isnan(self.default))

    def rule(self) -> str:
        """The rule a value must keep, in words that follow 'must be'."""
        if self.choices:
            return f'one of {", ".join(self.choices)}'
        words = ['a number' if self.default == math.inf else _WORDS[self.kind]]
        if self.minimum > -math.inf:
            words.append(f'{"above" if self.above_minimum else "not below"} {self.minimum:g}')
        if self.maximum < math.inf:
            words.append(f'not above {self.maximum:g}')
        if self.not_zero:
            words.append('other than 0')
        return ' and '.join([' '.join(words[:2]), *words[2:]]) + f' {self.unit}'.rstrip()

    def checked(self, name: str, values: Mapping[str, Any]) -> Any:
        """The value of that full name, or the default.

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
        items = [_converted(kind, item) for item in items]
        if not all(item is not None and self._allows(item) for item in items):
            raise ConfigurationError(f'{name} = {value!r} must be {self.rule()}{_remedy(value)}')
        return tuple(items) if is_list else items[0]

    def _allows(self, value: Any) -> bool:
        if isinstance(value, str):
            return not self.choices or value in self.choices
        if isinstance(value, bool):
            return True
        above = value > self.minimum if self.above_minimum else value >= self.minimum
        finite = isinstance(value, int) or math.isfinite(value) or self.default == math.inf
        return above and value <= self.maximum and finite and not (self.not_zero and value == 0)


def _remedy(value: Any) -> str:
    """How to write a number that was read as a text, as the end of a sentence."""
    if not isinstance(value, str):
        return ''
    plain = value.replace('_', '').replace(',', '.').strip()
    return f': write {plain}, without quotes' if _NUMBER.fullmatch(plain) else ''


def _converted(kind: str, value: Any) -> Any:
    """A value as the plain Python type of its kind; ``None`` if it is of another."""
    if kind in ('bool', 'str'):
        return value if isinstance(value, bool if kind == 'bool' else str) else None
    if isinstance(value, bool) or not isinstance(value, Integral if kind == 'int' else Real):
        return None
    try:
        return int(value) if isinstance(value, Integral) and kind == 'int' else float(value)
    except OverflowError:
        return None


def parameter(default: Any, text: str, unit: str = '', **rules: Any) -> Any:
    """A field of a dataclass that is a configuration parameter.

    Args:
        default: As of :class:`Parameter`.
        text: What it is; ``{input}`` stands for the name of the section.
        unit: Unit of the value.
        rules: Further attributes of :class:`Parameter`, where they are not as the field's name
            and annotation say, and ``convert``: makes the field's value of the parameter's.
    """
    rules = {'convert': lambda value: value, 'text': text, 'unit': unit, 'default': default} | rules
    if default is REQUIRED:
        return field(metadata=rules, kw_only=True)
    return field(default=rules['convert'](default), metadata=rules)


def duration(default: float, text: str, **rules: Any) -> Any:
    """A field ``*_ns`` [ns] of a parameter in seconds that goes without the ``_ns``."""
    bounds = {'minimum': 0.0, 'maximum': WEEK, 'convert': nanoseconds, 'kind': 'float'}
    return parameter(default, text, 's', **(bounds | rules))


def rows(section: type[Any], prefix: str = '', **changes: dict[str, Any]) -> tuple[Parameter, ...]:
    """The parameters that a dataclass declares.

    Args:
        section: The dataclass.
        prefix: What goes before the names, with its dot.
        changes: Attributes that differ in this section, by the parameter's name.
    """
    found = []
    for item in fields(section):
        if item.metadata:
            name, text = _name(item), item.metadata['text'].replace('{input}', prefix.rstrip('.'))
            own = {'kind': str(item.type)} | dict(item.metadata) | changes.get(name, {})
            own |= {'name': prefix + name, 'text': changes.get(name, {}).get('text', text)}
            del own['convert']
            found.append(Parameter(**own))
    return tuple(found)


def _name(item: Field[Any]) -> str:
    return str(item.metadata.get('name', item.name.removesuffix('_ns')))


def filled(section: type[Section], prefix: str, values: Mapping[str, Any], **derived: Any) -> Section:
    """The dataclass with the checked values of its parameters.

    Args:
        section: The dataclass.
        prefix: What goes before the names, with its dot.
        values: Checked values by parameter name.
        derived: Values of the fields that are no parameters.
    """
    own = {
        item.name: item.metadata['convert'](values[prefix + _name(item)])
        for item in fields(section)  # type: ignore[arg-type]
        if item.metadata and item.name not in derived
    }
    return section(**own, **derived)
