# SPDX-License-Identifier: Apache-2.0
"""What a calibration would change, in one sentence: advice, which changes nothing by itself."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stickslip_monitor.errors import CalibrationError, plural
from stickslip_monitor.lab.calibration.calibrate import FLOOR, Calibration, calibrate
from stickslip_monitor.lab.calibration.posterior import Progress, prior_of
from stickslip_monitor.lab.calibration.recordings import Evidence, EvidenceSource
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import fold_speed
from stickslip_monitor.physics.belief import QUANTILES


def learned(
    config: BearingConfig,
    source: EvidenceSource,
    found: Sequence[Evidence | str],
    command: str,
    progress: Progress | None = None,
) -> list[str]:
    """What the recordings teach of a bearing, a sentence each.

    Args:
        config: The bearing.
        source: Who tells when it vibrated.
        found: What each recording tells, or why it tells nothing.
        command: What would calibrate it.
        progress: Told the work done and the work to do at the most.
    """
    known = [one for one in found if isinstance(one, Evidence)]
    try:
        if not known:
            raise CalibrationError(next(str(one) for one in found))
        prior = prior_of(config.bearing, config.tolerance)
        floor = config.tolerance.model_error or FLOOR
        dips = source.dips(config, prior, known)
        result = calibrate(dips, prior, floor, progress=progress)
    except CalibrationError as error:
        return [f'{config.name}: nothing is learned: {error}']
    return [
        f'{config.name}: {text}' for text in (_proposal(config, result, command), *result.warnings)
    ]


def _proposal(config: BearingConfig, result: Calibration, command: str) -> str:
    """How the fold that the evidence tells lies to the one that is predicted."""
    load = math.sqrt(result.loads[0] * result.loads[1])
    rpm = config.bearing.speed.factor('rpm')
    low, middle, high = (result.belief().fold_speed(load, p) / rpm for p in QUANTILES)
    predicted = fold_speed(config.bearing, load) / rpm
    count = result.episodes
    which = plural(count, 'episode')
    seen = f'{low:.1f} to {high:.1f} rpm at {load:.4g} N'
    if not count or low <= predicted <= high:
        does = 'agrees' if count == 1 else 'agree'
        return f'{which} {does} with the predicted fold of {predicted:.1f} rpm ({seen})'
    if math.isnan(predicted):
        return f'{which} where no fold was predicted ({seen}): calibrate with `{command}`'
    side, does = 'above' if middle > predicted else 'below', 'ends' if count == 1 else 'end'
    return (
        f'{which} {does} {abs(middle / predicted - 1.0):.0%} {side} the predicted fold ({seen},'
        f' predicted {predicted:.1f} rpm): calibrate with `{command}`'
    )
