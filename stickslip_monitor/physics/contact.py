# SPDX-License-Identifier: Apache-2.0
"""Contact of the slip phase with the belt: whether slip from breakaway meets it again, and by how much.

The orbit from breakaway is followed to its turning point against the belt, and the orbit that grazes
the belt is followed back in time to its own. The logarithm of the ratio of the two amplitudes, the
*margin*, vanishes where slip only grazes, and is almost straight in ``ln N``, with the slope
``2 pi zeta``, however steep the law: neither orbit passes through the layer in which neighbours part.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import ALMOST_REST, speed_scales
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    TURNED,
    Route,
    follow,
    slip_field,
    start_on_manifold,
)
from stickslip_monitor.physics.scalar_law import law_bounds


def meets_belt(bearing: Bearing, speed: FloatArray, load: FloatArray, error: float) -> BoolArray:
    """Return where slip from breakaway meets the belt again, whether it then sticks or overtakes.

    Args:
        bearing: The bearing, with friction as measured.
        speed: ``V`` > 0, shape (n,) [m/s].
        load: ``N`` > 0, shape (n,) [N].
        error: Error of a step, relative to the speeds [-].
    """
    with np.errstate(all='ignore'):
        field = slip_field(bearing, speed, load)
        slip = follow(field, *start_on_manifold(field), Route(3, error, contact=True))
    return np.asarray(slip.end == LANDED)


class Contact:
    """Speeds and loads at which a lining can stick; of a bearing with lubrication, for friction as measured.

    Attributes:
        bearing: The bearing.
        law: Its friction law.
        bounds: The bounds and kinks of the law.
        scales: The speeds at which the law changes; 1 m/s for one that is the same at all [m/s].
        decrement: What a turn of the free vibration takes of the logarithm of its amplitude, ``2 pi zeta``.
        fine: Error of a step, relative to the speeds, for a margin to all digits that matter.
        coarse: Error of a step for a scan.
    """

    def __init__(self, bearing: Bearing) -> None:
        self.bearing, self.law, self.bounds = bearing, bearing.friction, law_bounds(bearing.friction)
        self.scales = list(speed_scales(self.law)) or [1.0]
        # A damping ratio of 1e-12 stands for none: a vibration loses 1e-11 of its energy in a turn.
        self.decrement = 2.0 * math.pi * max(bearing.damping_ratio, 1e-12)
        # A margin is the decrement times the excess of the load, and its error has to be a share of that.
        # With 1e-7 alone the fold at ``kappa`` 0.97 and a damping ratio of 1.5e-6 was 8 % low.
        self.fine = min(max(1e-10 * self.decrement, 1e-13), 1e-11)
        # Kinks make steps short: of a table those of 1e-6 leave 8e-5 of a fold in place of 3e-5, for half.
        self.coarse = min(max(1e-4 * self.decrement, self.fine), 1e-7 if self.is_smooth else 1e-6)

    def grazing_margin(self, speed: FloatArray, load: FloatArray, error: float) -> FloatArray:
        """Return the logarithm of the slip amplitude over the amplitude that grazes the belt.

        Positive where the lining sticks again after its slip, negative where it does not, 0 at the fold.

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].
            load: ``N`` > 0, shape (n,) [N].
            error: Error of a step, relative to the speeds [-].

        Returns:
            Shape (n,); 9 or -9 where only the sign is known: beyond critical damping, and where an orbit
            comes to rest before it turns.
        """
        if self.bearing.damping_ratio >= 1.0:
            return np.where(meets_belt(self.bearing, speed, load, error), 9.0, -9.0)
        # Orbits that turn take 640 steps of 1e-11 at most, up to 0.9 of critical damping, and those of kinks.
        begin, max_steps = np.zeros(speed.size), 640
        with np.errstate(all='ignore'):
            field = slip_field(self.bearing, speed, load)
            slip = follow(field, begin, begin, Route(2, error, max_steps=max_steps))
            graze = follow(field, -field.offset, begin, Route(1, error, -1.0, max_steps=max_steps))
            rest = field.steady_displacement()
            margin = np.log((rest - slip.place) / (rest - graze.place))
        is_known = np.isfinite(margin)
        rows = np.flatnonzero(~is_known & ((slip.end == TURNED) | (slip.end == EXHAUSTED)))
        margin[~is_known] = -9.0
        margin[rows[meets_belt(self.bearing, speed[rows], load[rows], error)]] = 9.0
        return margin

    @property
    def is_smooth(self) -> bool:
        """Whether the law has no kinks; else it is in pieces, as a measured table."""
        return not self.bounds.kinks

    @property
    def falls_most_at_rest(self) -> bool:
        """Whether friction falls most at rest, up to the rounding of its bound."""
        return -float(self.law.slope(ALMOST_REST)) >= self.bounds.fall * (1.0 - 1e-9)

    @property
    def rises_beyond_scale(self) -> bool:
        """Whether friction rises beyond the last speed of its scale: large loads stick less then."""
        return float(self.law.slope(4.0 * self.scales[-1])) > 0.0

    @cached_property
    def friction_gains(self) -> tuple[FloatArray, FloatArray]:
        """Speeds ``V`` [m/s], and the largest friction below the next one less the least above each [-].

        The second is what friction can feed a vibration with between a speed and the next; shape (m,) each.
        """
        v = np.geomspace(1e-4 * self.scales[0], 1e3 * self.scales[-1], 700)
        v = np.sort(np.append(v, self.scales))
        mu = np.asarray(self.law.coefficient(v))
        below = np.maximum.accumulate(np.maximum(mu, self.bounds.hold))
        above = np.minimum.accumulate(mu[::-1])[::-1]
        return v, np.append(below[1:], below[-1]) - above

    @cached_property
    def _max_swing(self) -> float:
        """Upper bound of a vibration's speed for each newton of load and unit of friction gain [m/(s N)].

        Friction feeds a vibration most if it is highest wherever the lining moves with the belt and
        lowest wherever it moves against it. The lining then swings by ``N gain/(2 k) coth(pi zeta'/2)``
        to both sides, ``exp(-pi zeta')`` being left of the free one after half a turn.
        """
        # Without damping rising friction ends vibrations before a damping ratio of 1e-4 would.
        zeta = self.bearing.damping_ratio or 1e-4
        half_turn = math.pi * zeta / math.sqrt(1.0 - zeta * zeta) if zeta < 1.0 else math.inf
        return 0.5 / (self.bearing.momentum * math.tanh(0.5 * half_turn))

    def highest_speed(self, load: float) -> float:
        """Return an upper bound of the speeds [m/s] at which the lining can stick at a load > 0 [N].

        It is 0 where friction gains nothing, and may be ``inf``.
        """
        v, gains = self.friction_gains
        with np.errstate(over='ignore'):
            swing = self._max_swing * load * gains
        reached = np.flatnonzero(swing >= v)
        last = int(reached[-1]) if reached.size else 0
        # Between two speeds, or beyond the last, the gain is the same.
        return float(min(swing[last], np.append(v, np.inf)[last + 1]))

    def least_loads(self, speed: FloatArray) -> FloatArray:
        """Return lower bounds of the loads at which the lining can stick [N]; friction must fall somewhere.

        Args:
            speed: ``V`` > 0, shape (n,) [m/s].

        Returns:
            Shape (n,); ``inf`` where friction falls nowhere about a speed.
        """
        v, gains = self.friction_gains
        gain = gains[np.clip(np.searchsorted(v, speed, side='right') - 1, 0, v.size - 1)]
        with np.errstate(divide='ignore'):
            return np.maximum(speed / (self._max_swing * gain), self.bearing.damping / self.bounds.fall)
