# SPDX-License-Identifier: Apache-2.0
"""The truth about a bearing whose shaft is steered: closed forms only, none of the package's physics.

Stick-slip begins where a disturbance has grown by :data:`ONSET_GROWTH` e-folds below the Hopf speed,
goes on in the bistable range, and ends beyond the fold or at rest.
"""

from __future__ import annotations

import math

from sequences import BEARINGS

ONSET_GROWTH = 3.0
"""Growth of a disturbance that stick-slip needs, the default of ``alarm.onset_growth`` [e-folds]."""
DECAY = 4.8
"""Time beyond the fold in which stick-slip dies out, in shares of ``2m/c`` (docs/rule.md)."""


class TrueBearing:
    """A bearing of :data:`.sequences.BEARINGS` with a Stribeck law, under its nominal load.

    Args:
        name: The bearing.
        share: Its first speed, as a share of the fold speed.

    Attributes:
        time: The time up to which the truth is known [s].
        settled_at: When the speed reaches the latest one steered for [s].
        sticks: Whether it sticks and slips.
        began: When that began last [s].
        passed_fold: When the speed fell below the fold last [s].
    """

    def __init__(self, name: str, share: float) -> None:
        bearing, self.fold_rpm, self.load = BEARINGS[name]
        per_rpm = math.pi * bearing['journal_diameter'] / 60.0
        self._fold = self.fold_rpm * per_rpm
        self._mass, self._damping = bearing['mass'], bearing['damping']
        self._decay, self._viscous = bearing['friction.decay'], bearing['friction.viscous']
        self._steepest = (bearing['friction.static'] - bearing['friction.kinetic']) * self._decay
        # N (steepest exp(-decay V) - viscous) = c, in closed form.
        needed = (self._damping / self.load + self._viscous) / self._steepest
        self.hopf = -math.log(needed) / self._decay / self._fold
        self.time = self.settled_at = 0.0
        self._from = self._to = share
        self._left_at = 0.0
        self._growth = self._beyond = 0.0
        self.sticks, self.began, self.passed_fold = False, -math.inf, -math.inf

    @property
    def share(self) -> float:
        """The speed now, as a share of the fold speed."""
        if self.time >= self.settled_at:
            return self._to
        part = (self.time - self._left_at) / (self.settled_at - self._left_at)
        return self._from + part * (self._to - self._from)

    @property
    def middle(self) -> float:
        """The middle of the bistable range, as a share of the fold speed."""
        return 0.5 * (self.hopf + 1.0)

    def steer(self, share: float, seconds: float) -> None:
        """Change the speed evenly from now on, to another share of the fold speed."""
        self._from, self._left_at = self.share, self.time
        self._to, self.settled_at = share, self.time + seconds

    def growth_rate(self, share: float) -> float:
        """Return the growth rate of a small disturbance, ``-(N mu'(V) + c)/2m`` [1/s]."""
        if share == 0.0:
            return -0.5 * self._damping / self._mass
        slope = self._viscous - self._steepest * math.exp(-self._decay * abs(share) * self._fold)
        return -0.5 * (self.load * slope + self._damping) / self._mass

    def pass_time(self, seconds: float) -> None:
        """Let time pass."""
        size_before = abs(self.share)
        self.time += seconds
        size = abs(self.share)
        if size < 1.0 <= size_before:
            self.passed_fold = self.time - seconds * (1.0 - size) / (size_before - size)
        rate = 0.5 * (self.growth_rate(size_before) + self.growth_rate(size))
        self._growth = max(0.0, self._growth + rate * seconds)
        self._beyond = self._beyond + seconds if size > 1.0 else 0.0
        if self.sticks:
            if size == 0.0 or self._beyond >= DECAY * 2.0 * self._mass / self._damping:
                self.sticks, self._growth = False, 0.0
        elif self._growth >= ONSET_GROWTH and size < self.hopf:
            self.sticks, self.began = True, self.time

    def condition(self) -> str:
        """Return the condition that should be reported, outside the range of caution."""
        if self.sticks:
            return 'stick_slip'
        return 'bistable' if 0.0 < abs(self.share) < 1.0 else 'normal'
