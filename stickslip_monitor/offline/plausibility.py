# SPDX-License-Identifier: Apache-2.0
"""Whether all samples of a recording together are what a stern bearing can be.

A speed in Hz that is read as revolutions a minute, or a torque that is read as a load, is no
fault of any sample, and the verdict that follows from it is a quiet one.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_monitor.monitor.assessment import Assessment
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging.boundaries import fold_speed

FASTEST = 30.0
"""Surface speed above which no water-lubricated bearing runs [m/s]."""
THICKEST = 1.0
"""Journal diameter from which on it may be in another unit [m]."""
FACTOR = 5.0
"""Least distance from the boundary, as a factor, that is asked about if it is never smaller."""


class Plausibility:
    """What all operating points of a recording say about the inputs of a bearing."""

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._count = self._negative = 0
        self._fastest = self._heaviest = 0.0
        # Of the points of a turning shaft: whether all have a fold, and speeds relative to it.
        self._turning = False
        self._bounded = True
        self._least, self._most = math.inf, -math.inf

    def take(self, points: Assessment) -> None:
        """Take some points, of arrays."""
        speed, load, fold = np.abs(points.speed), points.load, points.fold_speed
        self._count += speed.size
        self._fastest = float(speed.max(initial=self._fastest))
        self._negative += int(np.count_nonzero(load < 0.0))
        turning = (speed > 0.0) & (load > 0.0)
        bounded = turning & np.isfinite(fold)
        self._turning |= bool(turning.any())
        self._bounded &= bool((bounded == turning).all())
        self._heaviest = float(load[turning].max(initial=self._heaviest))
        ratio = speed[bounded] / fold[bounded]
        self._least = float(ratio.min(initial=self._least))
        self._most = float(ratio.max(initial=self._most))

    def questions(self) -> dict[str, list[str]]:
        """Questions by quantity, each a clause that follows the name of the input."""
        config, diameter = self._config, self._config.bearing.journal_diameter
        found: dict[str, list[str]] = {'speed': [], 'load': []}
        if config.speed.topic == config.load.topic and config.speed.field == config.load.field:
            found['load'].append(
                'is read from the same field as the speed: is it the right topic?'
            )
        if diameter >= THICKEST:
            found['speed'].append(
                f'turns a journal of {diameter:g} m: is journal_diameter in metres?'
            )
        if self._fastest > FASTEST:
            found['speed'].append(
                f'reaches {self._fastest:.4g} m/s at the surface of the journal, more than'
                f' {FASTEST:g} m/s: are its unit and scale right?'
            )
        if self._negative > 0.5 * self._count:
            found['load'].append(
                'is negative for most of the time: is the sign of its scale right?'
            )
        if self._turning:
            found['speed'] += self._distance()
        return found

    def _distance(self) -> list[str]:
        """Whether the points of a turning shaft are all far from the boundary."""
        asked = 'are units, scales and topics of speed and load right?'
        if self._least == math.inf:
            return self._without_boundary(asked)
        if self._least > FACTOR:
            return [f'is never below {self._least:.3g} times the fold speed: {asked}']
        if self._most < 1.0 / FACTOR and self._bounded:
            return [f'is never above {self._most:.2g} times the fold speed: {asked}']
        return []

    def _without_boundary(self, asked: str) -> list[str]:
        law = self._config.bearing.friction
        at_rest = float(np.asarray(law.coefficient(np.zeros(1)))[0])
        sliding = float(np.min(np.asarray(law.coefficient(np.linspace(1e-3, 2.0, 200)))))
        if at_rest <= sliding:
            return [
                f'can never bring stick-slip: friction at rest, {at_rest:.4g}, is not above the'
                f' least of sliding friction, {sliding:.4g}: are static and kinetic swapped?'
            ]
        if np.isfinite(fold_speed(self._config.bearing, FACTOR * self._heaviest)):
            return []
        return [
            f'has no boundary at any load up to {FACTOR:g} times the largest seen,'
            f' {self._heaviest:.4g} N: {asked}'
        ]
