# SPDX-License-Identifier: Apache-2.0
"""Asks where the numbers of an input look like another unit, another scale or another topic.

A speed in Hz that is read as revolutions a minute, or a torque that is read as a load, is no
fault of any sample, and the verdict that follows from it is a quiet one. So what all samples
together say is held against what a stern bearing can be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.monitor.assessment import Assessments
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import fold_speed

FASTEST = 30.0
"""Surface speed above which no water-lubricated bearing runs [m/s]."""
THICKEST = 1.0
"""Journal diameter from which on it may be in another unit [m]."""
FACTOR = 5.0
"""Least distance from the boundary, as a factor, that is asked about if it is never smaller."""


def questions(config: BearingConfig, points: Assessments) -> dict[str, list[str]]:
    """What to ask about the inputs of a bearing.

    Args:
        config: The bearing.
        points: All operating points of a recording, of arrays; none ask nothing.

    Returns:
        Questions by quantity, each a clause that follows the name of the input.
    """
    speed, load = np.abs(points.speed), np.asarray(points.load)
    found: dict[str, list[str]] = {'speed': [], 'load': []}
    if config.speed.topic == config.load.topic and config.speed.field == config.load.field:
        found['load'].append('is read from the same field as the speed: is it the right topic?')
    if config.bearing.journal_diameter >= THICKEST:
        found['speed'].append(
            f'turns a journal of {config.bearing.journal_diameter:g} m: is journal_diameter in'
            ' metres?'
        )
    if not speed.size:
        return found
    if speed.max() > FASTEST:
        found['speed'].append(
            f'reaches {speed.max():.4g} m/s at the surface of the journal, more than'
            f' {FASTEST:g} m/s: are its unit and scale right?'
        )
    if np.count_nonzero(load < 0.0) > 0.5 * load.size:
        found['load'].append('is negative for most of the time: is the sign of its scale right?')
    turning = (speed > 0.0) & (load > 0.0)
    found['speed'] += _distance(config, speed[turning], load[turning], points.fold_speed[turning])
    return found


def _distance(
    config: BearingConfig,
    speed: NDArray[np.float64],
    load: NDArray[np.float64],
    fold: NDArray[np.float64],
) -> list[str]:
    """Whether the points of a turning shaft are all far from the boundary."""
    if not speed.size:
        return []
    asked = 'are units, scales and topics of speed and load right?'
    bounded = np.isfinite(fold)
    if not bounded.any():
        if np.isfinite(fold_speed(config.bearing, FACTOR * float(load.max()))):
            return []
        return [
            f'has no boundary at any load up to {FACTOR:g} times the largest seen,'
            f' {load.max():.4g} N: {asked}'
        ]
    ratio = speed[bounded] / fold[bounded]
    if ratio.min() > FACTOR:
        return [f'is never below {ratio.min():.3g} times the fold speed: {asked}']
    if ratio.max() < 1.0 / FACTOR and bounded.all():
        return [f'is never above {ratio.max():.2g} times the fold speed: {asked}']
    return []
