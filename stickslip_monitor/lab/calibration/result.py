# SPDX-License-Identifier: Apache-2.0
"""A calibration as the documented JSON object, and the prior that an earlier one makes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from stickslip_monitor.errors import CalibrationError
from stickslip_monitor.lab.calibration.calibrate import Calibration, DipResult
from stickslip_monitor.lab.calibration.likelihood import PARAMETERS
from stickslip_monitor.lab.calibration.posterior import Prior
from stickslip_monitor.monitor.calibration_file import CALIBRATION_SCHEMA, INPUT_KEYS
from stickslip_monitor.monitor.config import BearingConfig, InputConfig
from stickslip_monitor.physics.friction import Stribeck

FRAGMENT_MARK = b'Made by stickslip calibrate'
"""Tells a fragment from the files of others."""
_DIGITS = 6
_SIZE = len(PARAMETERS)


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
    """The calibration as the documented JSON object.

    Args:
        config: The bearing.
        found: The calibration.
        earlier: The object that it was added to.
        created: When, ISO 8601.
        version: Of the package.
    """
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


def prior_from(path: str, document: Mapping[str, Any]) -> Prior:
    """The posterior of an earlier calibration as a prior.

    Raises:
        CalibrationError: The object is damaged.
    """
    try:
        mean = np.array(document['mean'], dtype=float)
        covariance = np.array(document['covariance'], dtype=float)
        viscous = float(document['viscous'])
        np.linalg.cholesky(covariance)
        if mean.shape != (_SIZE,) or covariance.shape != (_SIZE, _SIZE):
            raise ValueError(f'mean and covariance must be of {_SIZE} parameters')
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f'{path} is damaged: {error}') from error
    return Prior(mean, covariance, viscous)


def prior_with_bench(prior: Prior, path: str, document: Mapping[str, Any]) -> Prior:
    """The prior with the law that was fitted on a test bench.

    Args:
        prior: That of the configuration; its damping stays.
        path: The file of the fit, for a sentence.
        document: What ``stickslip fit --json`` printed.

    Raises:
        CalibrationError: The object is none.
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
        (of_beta, both), (_, of_fall) = rows @ covariance @ rows.T
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f'{path} must be what stickslip fit --json printed of a Stribeck law: {error}'
        ) from error
    # ln N0 = ln c - ln Delta - ln beta, with the damping of the prior.
    of_damping = prior.damping_variance
    mean, total = prior.mean.copy(), prior.covariance.copy()
    mean[0] = math.log(fitted.decay)
    mean[1] = prior.log_damping - math.log(fall) - mean[0]
    total[0, 0] = of_beta
    total[1, 1] = of_damping + of_fall + of_beta + 2.0 * both
    total[0, 1] = total[1, 0] = -of_beta - both
    return Prior(mean, total, prior.viscous, prior.log_damping, of_damping)


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
