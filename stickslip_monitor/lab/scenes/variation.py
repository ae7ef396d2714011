# SPDX-License-Identifier: Apache-2.0
"""What varies from seed to seed: random streams, numbers of a scene, and errors of parameters."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip_monitor.errors import PhysicsError, SceneError
from stickslip_monitor.lab.scenes.settings import Settings, is_number
from stickslip_monitor.monitor.config import BearingConfig

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
        return [
            drawn(value, seed, f'{place}.{name}')
            for name, value in zip(names, document, strict=True)
        ]
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


def as_believed(config: BearingConfig, errors: Mapping[str, float], seed: int) -> BearingConfig:
    """The configuration of a bearing as the monitor gets it, with errors drawn for a seed.

    Errors are given by parameter; each is drawn evenly up to it, either way.
    """
    factor = {
        name: 1.0
        + error * float(random_stream(seed, 'parameter_error', config.name, name).uniform(-1, 1))
        for name, error in errors.items()
    }
    law: Any = config.bearing.friction  # a dataclass, as every law
    try:
        friction = replace(law, **_scaled(law, 'friction.', factor))
        bearing = replace(config.bearing, friction=friction, **_scaled(config.bearing, '', factor))
    except (AttributeError, PhysicsError) as error:
        raise SceneError(f'parameter_error of bearing {config.name}: {error}') from error
    return replace(
        config,
        bearing=bearing,
        speed=replace(config.speed, **_scaled(config.speed, 'speed.', factor)),
        load=replace(config.load, **_scaled(config.load, 'load.', factor)),
    )


def _scaled(thing: object, prefix: str, factor: Mapping[str, float]) -> dict[str, Any]:
    """The attributes of a thing that are off, e.g. ``static`` for ``friction.static``."""
    names = {n: n.removeprefix(prefix) for n in factor if n.startswith(prefix)}
    own = {n: name for n, name in names.items() if '.' not in name}
    return {name: getattr(thing, name) * factor[n] for n, name in own.items()}
