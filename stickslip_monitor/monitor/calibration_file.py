# SPDX-License-Identifier: Apache-2.0
"""Reads the file of a calibration: the bearing and the belief that it gives.

It is refused where the sensors have changed since, or where it is of another bearing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip_logs.units import MIB
from stickslip_monitor.errors import ConfigurationError, cause
from stickslip_monitor.monitor import parameters
from stickslip_monitor.monitor.parameters import InputConfig, LoadConfig, SpeedConfig
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import LAWS
from stickslip_monitor.physics.probability import Belief, Tolerance
from stickslip_monitor.safe_files import read_json

CALIBRATION_SCHEMA = 'stickslip_monitor/calibration/2'
_PREVIOUS_SCHEMA = 'stickslip_monitor/calibration/1'
_MAX_BYTES = 64 * MIB
"""The largest file of a result that is read [bytes]; a year of dips is a tenth of it."""
_MAX_VARIANCE = 100.0
# Of the file of a calibration, beside parameters of the bearing.
_LOADS = Parameter('loads', 'float[]', REQUIRED, 'Least and largest load.', 'N', 0.0, above_minimum=True)
_FLOOR = Parameter('floor', 'float', REQUIRED, 'Deviation that no evidence takes away.', '', 0.0, 1.0)


def sensor_record(source: InputConfig) -> dict[str, Any]:
    """Return topic, field and conversion of an input as a calibration's file records them.

    A calibration holds as long as these stay as they are. A gear of 1 and a load without a table have no
    entry.
    """
    record: dict[str, Any] = {'topic': source.topic, 'field': source.field_text}
    record |= {'scale': source.scale, 'offset': source.offset, 'unit': source.unit}
    if isinstance(source, SpeedConfig) and source.gear != 1.0:
        record['gear'] = source.gear
    if isinstance(source, LoadConfig) and source.over_speed:
        record['over_speed'] = list(source.over_speed)
    return record


class UnusableCalibration(ConfigurationError):
    """A calibration that is missing, damaged or of another version, without which a ship is monitored too."""


def read_calibration(
    path: str, name: str, inputs: Mapping[str, InputConfig], bearing: Bearing, tolerance: Tolerance
) -> tuple[Bearing, Belief]:
    """Read the file of a bearing's calibration, and check that it was made with the same sensors.

    Args:
        path: The file.
        name: Name of the bearing.
        inputs: Its inputs as they are configured now, by name.
        bearing: The configured bearing: its mass, stiffness and diameter stay.
        tolerance: Its tolerances: those of speed, load and scatter count beside the calibration.

    Returns:
        The bearing by which alarms go, and the belief about it.

    Raises:
        UnusableCalibration: The file is missing, damaged or of another version.
        ConfigurationError: It is of another bearing, or made with other sensors.
    """
    try:
        document = read_json(path, _MAX_BYTES)
    except OSError as error:
        raise UnusableCalibration(f'{path}: {cause(error)}') from error
    except ValueError as error:
        raise UnusableCalibration(f'{path} is not JSON: {error}') from error
    content: dict[str, Any] = document if isinstance(document, dict) else {}
    schema = content.get('schema')
    if schema == _PREVIOUS_SCHEMA:
        raise UnusableCalibration(
            f'{path} was made by an earlier version, which weighed its evidence by another model:'
            " take out the parameter 'calibration', and make it anew from the same recordings"
            f' with `stickslip calibrate BAG... --config FILE --output {path}`'
        )
    if schema != CALIBRATION_SCHEMA:
        raise UnusableCalibration(
            f'{path} has the schema {schema!r} and must have {CALIBRATION_SCHEMA!r}: make it with'
            ' stickslip calibrate'
        )
    if content.get('bearing') != name:
        raise ConfigurationError(f"{path} is a calibration of '{content.get('bearing')}' and not of '{name}'")
    past = content.get('inputs')
    for quantity, source in inputs.items():
        now = sensor_record(source)
        then = past.get(quantity) if isinstance(past, dict) else None
        if not isinstance(then, dict):
            raise UnusableCalibration(f'{path} is damaged: it does not name its sensors')
        for key in dict.fromkeys([*now, *then]):
            if then.get(key) != now.get(key):
                before, after = then.get(key), now.get(key)
                raise ConfigurationError(
                    f'{path} was made with {quantity}.{key} = {before!r}, and it is {after!r} now:'
                    ' a calibration holds for its own sensors only, so calibrate anew'
                )
    return _parse_calibration(path, content, bearing, tolerance)


def _parse_calibration(
    path: str, document: Mapping[str, Any], bearing: Bearing, tolerance: Tolerance
) -> tuple[Bearing, Belief]:
    """Return the bearing by which alarms go after a calibration, and the belief about it.

    Mass, stiffness and diameter are those of ``bearing``. ``path`` is for the text of the error.

    Raises:
        UnusableCalibration: The document is damaged.
    """
    try:
        calibrated = _replace_law(bearing, document['parameters'])
        # Files of 0.3.0 have one bearing for both.
        believed = _replace_law(bearing, document.get('believed', document['parameters']))
        covariance = np.array(document['covariance'], dtype=float)
        np.linalg.cholesky(covariance)
        low, high = _LOADS.checked('loads', document)
        floor = _FLOOR.checked('floor', document)
    except ConfigurationError as error:
        raise UnusableCalibration(f'{path} is damaged: {error}') from error
    except (LookupError, TypeError, ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise UnusableCalibration(f'{path} is damaged: {error!r}') from error
    sound = covariance.shape == (2, 2) and bool((np.abs(covariance) < _MAX_VARIANCE).all())
    if not (sound and low <= high):
        raise UnusableCalibration(f'{path} is damaged: its covariance must be finite, and its loads rise')
    speed = math.hypot(floor, tolerance.speed, tolerance.scatter)
    return calibrated, Belief(believed, covariance, speed, tolerance.load, (low, high), calibrated=True)


def _replace_law(bearing: Bearing, values: Mapping[str, Any]) -> Bearing:
    """Return a bearing with damping and friction law of a calibration, by parameter name.

    Raises:
        ConfigurationError: Damping or the law is missing, or a parameter breaks its rule.
        TypeError: A parameter of the law is missing.
        PhysicsError: The law or the bearing refuses the values.
    """
    every = (*parameters.LINING_PARAMETERS, *parameters.FRICTION_PARAMETERS)
    rows = {row.name: replace(row, default=REQUIRED) for row in every}
    make, names = LAWS[rows['friction.law'].checked('friction.law', values)]
    given = {
        key: rows[key].checked(key, values) for key in (f'friction.{name}' for name in names) if key in values
    }
    law = make(**{key.removeprefix('friction.'): value for key, value in given.items()})
    return replace(bearing, damping=rows['damping'].checked('damping', values), friction=law)
