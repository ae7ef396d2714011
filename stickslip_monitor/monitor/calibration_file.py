# SPDX-License-Identifier: Apache-2.0
"""Reads the result of a calibration, and refuses it where the sensors have changed since."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.files import read_json
from stickslip_monitor.physics.belief import Belief, Tolerance

CALIBRATION_SCHEMA = 'stickslip_monitor/calibration/1'
LARGEST_JSON = 64 << 20
"""The largest file of a result that is read [bytes]; a year of dips is a tenth of it."""
INPUT_KEYS = ('topic', 'field', 'scale', 'offset', 'unit')
_DRAW_COLUMNS = ('ln_beta', 'ln_n0', 'ln_s')
_LARGEST_LOG, _MOST_DRAWS = 100.0, 100_000


def load_calibration(path: str | Path) -> dict[str, Any]:
    """The JSON object of a calibration.

    Raises:
        ConfigurationError: The file cannot be read or is none; the text names it.
    """
    try:
        document = read_json(path, LARGEST_JSON)
    except OSError as error:
        raise ConfigurationError(f'{path}: {error.strerror or error}') from error
    except ValueError as error:
        raise ConfigurationError(f'{path} is not JSON: {error}') from error
    schema = document.get('schema') if isinstance(document, dict) else None
    if schema != CALIBRATION_SCHEMA:
        raise ConfigurationError(
            f'{path} has the schema {schema!r} and must have {CALIBRATION_SCHEMA!r}: make it with'
            ' stickslip calibrate'
        )
    assert isinstance(document, dict)
    return document


def require_same_sensors(
    path: str | Path, document: Mapping[str, Any], bearing: str, inputs: Mapping[str, Any]
) -> None:
    """Refuse a calibration of another bearing, or one with other sensors.

    Args:
        path: The file, for the sentence.
        document: From :func:`load_calibration`.
        bearing: Name of the bearing.
        inputs: What :data:`INPUT_KEYS` are now, by quantity.

    Raises:
        ConfigurationError: Something differs; the text says what.
    """
    if document.get('bearing') != bearing:
        raise ConfigurationError(
            f"{path} is a calibration of '{document.get('bearing')}' and not of '{bearing}'"
        )
    past = document.get('inputs')
    for quantity, now in inputs.items():
        then = past.get(quantity) if isinstance(past, dict) else None
        if not isinstance(then, dict):
            raise ConfigurationError(f'{path} is damaged: it does not name its sensors')
        for key in INPUT_KEYS:
            if then.get(key) != now[key]:
                raise ConfigurationError(
                    f'{path} was made with {quantity}.{key} = {then.get(key)!r}, and it is'
                    f' {now[key]!r} now: a calibration holds for its own sensors only, so'
                    ' calibrate anew'
                )


def belief_of(path: str | Path, document: Mapping[str, Any], tolerance: Tolerance) -> Belief:
    """The belief that a calibration has left.

    Args:
        path: The file, for the sentence.
        document: From :func:`load_calibration`.
        tolerance: What is uncertain of the sensors besides.

    Raises:
        ConfigurationError: The object is incomplete.
    """
    try:
        names = list(document['parameters'])
        columns = [names.index(name) for name in _DRAW_COLUMNS]
        draws = np.array(document['draws'], dtype=float)[:, columns]
        low, high = (float(load) for load in document['loads'])
        floor, viscous = float(document['floor']), float(document['viscous'])
    except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
        raise ConfigurationError(f'{path} is damaged: {error!r}') from error
    sound = 0 < draws.shape[0] <= _MOST_DRAWS and bool((np.abs(draws) < _LARGEST_LOG).all())
    sound = sound and 0.0 < low <= high < math.inf
    if not (sound and 0.0 <= floor <= 1.0 and 0.0 <= viscous < math.inf):
        raise ConfigurationError(
            f'{path} is damaged: its draws, loads, floor and viscous must be finite numbers, loads'
            ' above 0 and rising'
        )
    return Belief.from_draws(draws, floor, viscous, (low, high), tolerance)
