# SPDX-License-Identifier: Apache-2.0
"""A calibration as the documented JSON object, and the prior that an earlier one makes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from stickslip_monitor.errors import CalibrationError, PhysicsError
from stickslip_monitor.lab.calibration.calibrate import DAMPING, Calibration
from stickslip_monitor.lab.calibration.posterior import Prior
from stickslip_monitor.monitor.config import BearingConfig, InputConfig
from stickslip_monitor.monitor.configure import CALIBRATION_SCHEMA, INPUT_KEYS
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stretched, Stribeck, Tabulated
from stickslip_monitor.physics.probability import Tolerance

FRAGMENT_MARK = b'Made by stickslip calibrate'
"""Marks a fragment among the files of others."""
_DIGITS = 6
_LARGEST = 100.0


def inputs_of(config: BearingConfig) -> dict[str, dict[str, Any]]:
    """What a calibration remembers of the sensors: it holds in their own readings only."""
    return {'speed': _input(config.speed), 'load': _input(config.load)}


def _input(source: InputConfig) -> dict[str, Any]:
    values = (source.topic, source.field_text, source.scale, source.offset, source.unit)
    return dict(zip(INPUT_KEYS, values, strict=True))


def parameters_of_law(bearing: Bearing) -> dict[str, Any]:
    """The damping and the law of a bearing as parameters of a configuration."""
    law = bearing.friction
    own: dict[str, Any] = {'damping': _rounded(bearing.damping)}
    if isinstance(law, Tabulated):
        return own | {
            'friction.law': 'tabulated',
            'friction.speed': _rounded(law.speed),
            'friction.coefficient': _rounded(law.values),
        }
    names = ['static', 'kinetic']
    if isinstance(law, Stribeck | Stretched):
        names += ['decay', 'viscous'] + ['exponent'] * isinstance(law, Stretched)
    kind = 'stribeck' if len(names) > 2 else 'coulomb'
    return own | {
        'friction.law': kind,
        **{f'friction.{name}': _rounded(getattr(law, name)) for name in names},
    }


def to_document(
    config: BearingConfig, found: Calibration, earlier: Mapping[str, Any] | None, created: str, version: str
) -> dict[str, Any]:
    """The calibration as the documented JSON object, added to an earlier one if any."""
    past, (low, high) = earlier or {}, found.loads
    before = past.get('loads', (low, high))
    log_r, log_q = found.factors
    marks = [track.course.fingerprint for track in found.edges.tracks]
    return {
        'schema': CALIBRATION_SCHEMA,
        'bearing': config.name,
        'inputs': inputs_of(config),
        'parameters': parameters_of_law(found.bearing),
        'covariance': _rounded(found.covariance),
        'loads': _rounded([min(low, before[0]), max(high, before[1])]),
        'floor': found.floor,
        'factors': {'speeds': _rounded(math.exp(log_r)), 'loads': _rounded(math.exp(log_q))},
        'configured': parameters_of_law(found.reference.bearing),
        'boundaries': _rounded(found.boundaries()),
        'recordings': [*past.get('recordings', []), *dict.fromkeys(marks)],
        'ends': _ends(found),
        'warnings': found.warnings,
        'remarks': found.remarks,
        'created': created,
        'version': version,
    }


def _rounded(values: Any) -> Any:
    return np.vectorize(lambda x: float(f'{x:.{_DIGITS}g}'))(np.asarray(values, float)).tolist()


def _ends(found: Calibration) -> list[dict[str, Any]]:
    doubtful = {id(end): p for end, p in found.doubts}
    return [
        {
            'recording': end.recording,
            'source': end.report.source,
            'time': round(end.time * 1e9),
            'speed': _rounded(end.middle[0]),
            'load': _rounded(end.middle[1]),
            'bound': end.is_bound,
            'worthless': _rounded(doubtful.get(id(end), 0.0)),
        }
        for end in found.edges.ends
    ]


def prior_from(path: str, document: Mapping[str, Any], bearing: Bearing) -> Prior:
    """The result of an earlier calibration as a prior for the bearing that is configured.

    Raises:
        CalibrationError: It was made with another bearing's parameters, or is damaged.
    """
    if document.get('configured') != parameters_of_law(bearing):
        raise CalibrationError(
            f'{path} was made with other damping or friction than are configured now, so nothing'
            ' can be added to it: calibrate with all recordings together'
        )
    try:
        factors = [float(document['factors'][name]) for name in ('speeds', 'loads')]
        covariance = np.array(document['covariance'], dtype=float)
        np.linalg.cholesky(covariance)
        if not all(1.0 / _LARGEST < factor < _LARGEST for factor in factors):
            raise ValueError(f'factors must be between {1.0 / _LARGEST:g} and {_LARGEST:g}')
        return Prior(np.log(factors), covariance)
    except (KeyError, TypeError, ValueError, OverflowError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f'{path} is damaged: {error}') from error


def known_recordings(path: str, document: Mapping[str, Any]) -> list[str]:
    """Fingerprints of what an earlier result rests on.

    Raises:
        CalibrationError: The object is damaged.
    """
    marks = document.get('recordings', [])
    if not isinstance(marks, list) or not all(isinstance(mark, str) for mark in marks):
        raise CalibrationError(f'{path} is damaged: its recordings must be texts')
    return marks


def prior_with_bench(bearing: Bearing, tolerance: Tolerance, path: str, document: Mapping[str, Any]) -> Prior:
    """A bearing's prior with the law of ``stickslip fit --json``; the damping stays.

    Raises:
        CalibrationError: The document is none of these, or the bearing's law is another.
    """
    law = bearing.friction
    if not isinstance(law, Stribeck):
        raise CalibrationError('--bench needs the friction law stribeck without an exponent')
    try:
        if document['schema'] != 'stickslip_monitor/fit/1':
            raise ValueError(f"its schema is '{document['schema']}'")
        told = document['friction']
        fitted = Stribeck(*(float(told[name]) for name in ('static', 'kinetic', 'decay')))
        names = list(document['estimated'])
        covariance = np.array(document['covariance'], dtype=float)
        rows = np.zeros((2, len(names)))
        fall = fitted.static - fitted.kinetic
        rows[0, names.index('decay')] = 1.0 / fitted.decay
        rows[1, names.index('static')], rows[1, names.index('kinetic')] = 1.0 / fall, -1.0 / fall
        if not np.isfinite(covariance).all():
            raise ValueError('its covariance must be finite')
        (of_beta, both), (_, of_fall) = rows @ covariance @ rows.T
        if not (of_beta > 0.0 and of_fall > 0.0):
            raise ValueError('its covariance must be positive')
    except (LookupError, TypeError, ValueError, ArithmeticError, PhysicsError) as error:
        raise CalibrationError(
            f'{path} must be what stickslip fit --json printed of a Stribeck law: {error}'
        ) from error
    # ln r = -ln beta, ln q = ln(mu_s - mu_k) + ln beta, against those configured.
    of_damping = (tolerance.damping or DAMPING) ** 2
    log_beta = math.log(fitted.decay / law.decay)
    log_fall = math.log(fall / (law.static - law.kinetic))
    return Prior(
        np.array([-log_beta, log_fall + log_beta]),
        np.array(
            [[of_beta, -of_beta - both], [-of_beta - both, of_damping + of_fall + of_beta + 2.0 * both]]
        ),
    )


def fragment(config: BearingConfig, found: Calibration) -> str:
    """The law and the damping that have the calibrated boundaries, as configuration."""
    rows = parameters_of_law(found.bearing)
    damping = rows.pop('damping')
    law = ', '.join(f'{key.removeprefix("friction.")}: {value}' for key, value in rows.items())
    return (
        f'# {FRAGMENT_MARK.decode()}: {config.name} has these boundaries; no measurement of'
        ' friction.\n'
        f'damping: {damping:.6g}\n'
        f'friction: {{{law}}}\n'
    )
