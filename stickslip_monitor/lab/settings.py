# SPDX-License-Identifier: Apache-2.0
"""One mapping of a scene file, read key by key, and what of it varies from seed to seed.

Whatever breaks a rule is a SceneError, here and in all of this room, that names key, value and
rule.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from stickslip_monitor.errors import SceneError, did_you_mean

# Far beyond every sensor and sea; products of a few such numbers are still finite.
LARGEST = 1e15


class Settings:
    """The keys and values of one mapping, of which any other key than the known ones is an error.

    The name is what it is called in sentences; empty for the scene itself.
    """

    def __init__(self, name: str, content: Any, keys: Iterable[str]) -> None:
        self.name = name
        if not isinstance(content, Mapping):
            raise SceneError(f'{name or "the scene"} = {content!r} must be a mapping of keys')
        self._content = content
        known = list(keys)
        for key, value in content.items():
            if key not in known:
                where = f' in {self.name}' if self.name else ''
                hint = suggestion(key, known)
                raise SceneError(f"unknown key '{key}' = {_short(value)}{where}; {hint}")

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def label(self, key: str) -> str:
        """The key's full name."""
        return f'{self.name}.{key}' if self.name else key

    def value(self, key: str, what: str) -> Any:
        """The value as it stands in the file; ``what`` says what is missing where it is."""
        if key not in self._content:
            raise SceneError(f"key '{self.label(key)}' is missing: {what}")
        return self._content[key]

    def text(self, key: str, what: str) -> str:
        """A text that is not empty."""
        value = self.value(key, what)
        if not isinstance(value, str) or not value.strip():
            raise self.broken(key, f'must be a text: {what}')
        return value

    def choice(self, key: str, options: Sequence[str]) -> str:
        """One of some texts."""
        value = self.value(key, f'one of {", ".join(options)}')
        if not isinstance(value, str) or value not in options:
            raise self.broken(key, f'must be one of {", ".join(options)}{did_you_mean(value, options)}')
        return value

    def number(
        self, key: str, unit: str, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
    ) -> float:
        """A finite number above one bound, or not below another, and not above a third."""
        rule = f'a number [{unit}]'
        rule += f' above {above:g}' if above > -math.inf else ''
        rule += f' not below {least:g}' if least > -math.inf else ''
        rule += f' and not above {most:g}' if most < math.inf else ''
        value = self.value(key, rule)
        if not is_number(value) or not (value > above and least <= value <= most):
            raise self.broken(key, f'must be {rule}{too_large(value)}')
        return float(value)

    def rows(self, key: str, name: str, what: str) -> list[tuple[str, Any]]:
        """The entries of a list that is not empty, each with its name for sentences."""
        listed = self.value(key, what)
        if not isinstance(listed, list) or not listed:
            raise self.broken(key, f'must be {what}')
        return [(f'{self.label(key)}: {name} {k}', row) for k, row in enumerate(listed, 1)]

    def section(self, key: str, keys: Iterable[str], what: str) -> Settings:
        """The mapping under a key."""
        return Settings(self.label(key), self.value(key, what), keys)

    def broken(self, key: str, rule: str) -> SceneError:
        """The error that says that a key's value breaks a rule."""
        return SceneError(f'{self.label(key)} = {_short(self._content[key])} {rule}')


def suggestion(key: Any, known: Sequence[str]) -> str:
    """What to say about a name that is not among the known ones."""
    return did_you_mean(key, known).removeprefix('; ') or f'there are: {", ".join(known)}'


def is_number(value: Any) -> bool:
    """Whether a value of a YAML file is a number of usable size."""
    return _is_numeric(value) and -LARGEST <= value <= LARGEST


def too_large(*values: Any) -> str:
    """What to add to the rule that a value breaks where the rule is :data:`LARGEST`."""
    beyond = any(_is_numeric(value) and abs(value) > LARGEST for value in values)
    return f', of a size up to {LARGEST:g}' if beyond else ''


def _is_numeric(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _short(value: Any) -> str:
    text = value.isoformat() if isinstance(value, dt.date) else repr(value)
    return text if len(text) <= 60 else f'{text[:57]}...'


BETWEEN = 'between'
_OWN = ('mass', 'damping', 'stiffness')
_LAW = tuple(f'friction.{name}' for name in ('static', 'kinetic', 'decay', 'viscous'))
_SCALES = ('speed.scale', 'load.scale')
PARAMETERS = (*_OWN, *_LAW, *_SCALES)


def random_stream(seed: int, *names: str) -> np.random.Generator:
    """The random stream of a name: of the effect, and within it the topic.

    It depends on the scene's seed and the names alone, on every machine.
    """
    digest = hashlib.sha256('\0'.join(names).encode()).digest()
    key = tuple(int.from_bytes(digest[k : k + 4], 'little') for k in range(0, 16, 4))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def drawn(document: Any, seed: int, place: str = '') -> Any:
    """A parsed scene with a number in place of each ``{between: [low, high]}``.

    Each is drawn evenly from a random stream of its own, named after its place in the file.
    """
    if isinstance(document, Mapping):
        if list(document) == [BETWEEN]:
            return _draw(document[BETWEEN], seed, place)
        return {key: drawn(value, seed, f'{place}.{key}') for key, value in document.items()}
    if isinstance(document, list):
        names = _names(document)
        return [drawn(value, seed, f'{place}.{name}') for name, value in zip(names, document, strict=True)]
    return document


def _draw(limits: Any, seed: int, place: str) -> float:
    if (
        not isinstance(limits, list)
        or len(limits) != 2
        or not all(map(is_number, limits))
        or limits[0] > limits[1]
    ):
        raise SceneError(
            f'{place.lstrip(".")} = {{{BETWEEN}: {limits!r}}} must be two numbers, the lower first'
        )
    low, high = map(float, limits)
    share = float(random_stream(seed, BETWEEN, place).random())
    return low + (high - low) * share


def _names(entries: list[Any]) -> list[str]:
    """What the entries of a list are called: effects by name, so that others change nothing."""
    seen: Counter[str] = Counter()
    found = []
    for number, entry in enumerate(entries):
        is_effect = isinstance(entry, Mapping) and ('effect' in entry or len(entry) == 1)
        name = str(entry.get('effect', next(iter(entry)))) if is_effect else ''
        found.append(f'{name}{seen[name]}' if name else str(number))
        seen[name] += 1
    return found


def read_parameter_error(settings: Settings) -> dict[str, float]:
    """The ``parameter_error``: by parameter the largest relative error."""
    if 'parameter_error' not in settings:
        return {}
    own = settings.section('parameter_error', PARAMETERS, 'the largest relative errors')
    return {name: own.number(name, '-', least=0.0, most=0.9) for name in PARAMETERS if name in own}
