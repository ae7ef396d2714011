# SPDX-License-Identifier: Apache-2.0
"""A calibration as the documented JSON object, and the prior that an earlier one makes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stickslip_monitor.errors import CalibrationError, PhysicsError
from stickslip_monitor.lab.calibration.calibrate import Calibration, DipResult
from stickslip_monitor.lab.calibration.evidence import Dip
from stickslip_monitor.lab.calibration.posterior import DAMPING, PARAMETERS, Prior, prior_of
from stickslip_monitor.monitor.config import BearingConfig, InputConfig
from stickslip_monitor.monitor.configure import CALIBRATION_SCHEMA, INPUT_KEYS
from stickslip_monitor.physics.belief import Tolerance
from stickslip_monitor.physics.friction import Stribeck
from stickslip_monitor.physics.oscillator import Bearing

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


def to_document(
    config: BearingConfig,
    found: Calibration,
    earlier: Mapping[str, Any] | None,
    created: str,
    version: str,
) -> dict[str, Any]:
    """The calibration as the documented JSON object, added to an earlier one if any."""
    posterior, past = found.posterior, earlier or {}
    low, high = found.loads
    before = past.get('loads', (low, high))
    return {
        'schema': CALIBRATION_SCHEMA,
        'bearing': config.name,
        'inputs': inputs_of(config),
        'parameters': list(PARAMETERS),
        'mean': _rounded(posterior.mean),
        'covariance': _rounded(posterior.covariance),
        'draws': _rounded(posterior.draws()),
        'viscous': found.prior.viscous,
        'loads': _rounded([min(low, before[0]), max(high, before[1])]),
        'boundaries': _rounded(found.boundaries()),
        'dips': [*past.get('dips', []), *(_dip(one) for one in found.dips)],
        'effective': round(posterior.effective),
        'log_evidence': float(posterior.log_evidence.sum()),
        'floor': found.floor,
        'seed': found.seed,
        'warnings': found.warnings,
        'remarks': found.remarks,
        'created': created,
        'version': version,
    }


def _rounded(values: Any) -> Any:
    return np.vectorize(lambda x: float(f'{x:.{_DIGITS}g}'))(np.asarray(values, float)).tolist()


def _dip(one: DipResult) -> dict[str, Any]:
    dip = one.dip
    return {
        'bag': dip.recording,
        'fingerprint': dip.fingerprint,
        'start': dip.start_ns,
        'end': dip.end_ns,
        'episode': dip.episode,
        'log_predictive': one.log_predictive,
        'reports': [
            {
                'start': report.start_ns,
                'end': report.end_ns,
                'state': 'squeal' if report.squeal else 'quiet',
                'source': report.source,
                'worthless': p,
            }
            for report, p in zip(dip.reports, one.worthless, strict=False)
        ],
        'ends': [
            {'time': e.time_ns, 'speed': e.speed, 'predicted': e.predicted, 'late': e.late}
            for e in one.ends
        ],
    }


def prior_from(path: str, document: Mapping[str, Any], own: Prior) -> Prior:
    """The posterior of an earlier calibration as a prior.

    What the earlier one did not infer yet is that of the bearing's own.

    Raises:
        CalibrationError: The object is damaged.
    """
    try:
        places = [PARAMETERS.index(name) for name in document['parameters']]
        mean, covariance = own.mean.copy(), own.covariance.copy()
        covariance[places, :] = covariance[:, places] = 0.0
        mean[places] = np.array(document['mean'], dtype=float)
        covariance[np.ix_(places, places)] = np.array(document['covariance'], dtype=float)
        np.linalg.cholesky(covariance)
        numbers = np.concatenate([mean, covariance.ravel()])
        if len(places) < 2 or not (np.abs(numbers) < _LARGEST).all():
            raise ValueError(f'mean and covariance must be numbers below {_LARGEST:g}')
        return Prior(mean, covariance, float(document['viscous']))
    except (KeyError, TypeError, ValueError, OverflowError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f'{path} is damaged: {error}') from error


def known_dips(document: Mapping[str, Any], dips: Sequence[Dip]) -> list[tuple[str, int, int]]:
    """Fingerprint, begin and end of the dips of an earlier result.

    A result of an earlier version has no fingerprints: there a recording of the same name and
    time is the same one.

    Raises:
        CalibrationError: The object is damaged.
    """
    by_name = {dip.recording: dip.fingerprint for dip in dips}
    try:
        return [
            (
                one.get('fingerprint') or by_name.get(one['bag'], ''),
                int(one['start']),
                int(one['end']),
            )
            for one in document.get('dips', [])
        ]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f'the earlier result is damaged: {error!r}') from error


def prior_with_bench(
    bearing: Bearing, tolerance: Tolerance, path: str, document: Mapping[str, Any]
) -> Prior:
    """A bearing's prior with the law of ``stickslip fit --json``; the damping stays.

    Raises:
        CalibrationError: The document is none of these.
    """
    try:
        if document['schema'] != 'stickslip_monitor/fit/1':
            raise ValueError(f"its schema is '{document['schema']}'")
        law = document['friction']
        fitted = Stribeck(*(float(law[name]) for name in ('static', 'kinetic', 'decay')))
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
    # ln N0 = ln c - ln Delta - ln beta.
    prior = prior_of(bearing, tolerance)
    of_damping = (tolerance.damping or DAMPING) ** 2
    mean, total = prior.mean.copy(), prior.covariance.copy()
    mean[0] = math.log(fitted.decay)
    mean[1] = math.log(bearing.damping) - math.log(fall) - mean[0]
    total[0, 0] = of_beta
    total[1, 1] = of_damping + of_fall + of_beta + 2.0 * both
    total[0, 1] = total[1, 0] = -of_beta - both
    return Prior(mean, total, prior.viscous)


def fragment(config: BearingConfig, found: Calibration) -> str:
    """The law and the damping that have the calibrated median boundaries, as configuration."""
    law = config.bearing.friction
    assert isinstance(law, Stribeck)
    log_beta, log_load = found.posterior.mean[:2]
    decay = math.exp(log_beta)
    damping = math.exp(log_load) * (law.static - law.kinetic) * decay
    viscous = f', viscous: {found.prior.viscous * damping:.4g}' if found.prior.viscous else ''
    return (
        f'# {FRAGMENT_MARK.decode()}: {config.name} has these boundaries; no measurement of'
        ' friction.\n'
        f'damping: {damping:.4g}\n'
        f'friction: {{law: stribeck, static: {law.static:g}, kinetic: {law.kinetic:g},'
        f' decay: {decay:.4g}{viscous}}}\n'
    )
