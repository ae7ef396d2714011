# SPDX-License-Identifier: Apache-2.0
"""Questions about a configuration whose values look like another unit, or a slip.

They are asked by `assess`, and by `check` at the largest load that it met. A question is a clause
that follows the name of an input: "speed on /shaft/speed turns a journal of 400 m: ...?".
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.physics.averaging import fold_speed
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Tabulated
from stickslip_monitor.physics.scalar_law import scalar_law

THICKEST = 1.0
"""Journal diameter from which on it may be in another unit [m]."""
REST_SHARE = 0.1
"""Share of the fold speed that a shaft at rest may reach; the default is below a fiftieth."""
LARGEST_MOTION = 0.1
"""Share of the journal's diameter that no lining moves."""
LOWEST_TONE, HIGHEST_TONE = 1.0, 20_000.0
"""Natural frequencies of linings: chatter from some hertz on, squeal up to some kilohertz [Hz]."""
FACTOR = 5.0
"""Of the load: a bearing whose law is at fault has no boundary at so many times it either."""
ENDS_EARLY = 0.2
"""Share of a curve's steepest fall above which it ends in the midst of it."""
BREAKAWAY = 0.5
"""A breakaway coefficient below this share of the next value is no measured one."""


def questions(config: BearingConfig, load: float) -> dict[str, list[str]]:
    """What should be asked about a bearing at a load.

    Args:
        config: The bearing.
        load: Its load [N]; at 0 or below only what needs none is asked.

    Returns:
        Clauses by the quantity that they follow: ``speed`` and ``load``.
    """
    return {'speed': list(_of_speed(config, load)), 'load': list(_of_load(config, load))}


def _of_speed(config: BearingConfig, load: float) -> Iterator[str]:
    diameter, rest = config.bearing.journal_diameter, config.alarm.minimum_speed
    if diameter >= THICKEST:
        yield f'turns a journal of {diameter:g} m: is journal_diameter in metres?'
    fold = _fold(config, load)
    if rest > REST_SHARE * fold:
        rpm = float(config.bearing.speed.from_surface(rest, 'rpm'))
        yield (
            f'counts as rest up to {rest:g} m/s ({rpm:.3g} rpm), {rest / fold:.2g} times the fold'
            ' speed: is alarm.minimum_speed in m/s?'
        )
    yield from _of_friction(config, load)


def _of_load(config: BearingConfig, load: float) -> Iterator[str]:
    bearing = config.bearing
    tone = bearing.natural_frequency / math.tau
    if not LOWEST_TONE <= tone <= HIGHEST_TONE:
        yield (
            f'is on a lining of {bearing.mass:g} kg and {bearing.stiffness:g} N/m, which vibrates'
            f' at {tone:.3g} Hz: are mass and stiffness in kg and N/m?'
        )
    # A cycle sticks as long as the surface is not outrun: its amplitude is about V/omega.
    amplitude = _fold(config, load) / bearing.natural_frequency
    limit = LARGEST_MOTION * bearing.journal_diameter
    if limit < amplitude < math.inf:
        yield (
            f'would move the lining by {amplitude:.3g} m in a journal of'
            f' {bearing.journal_diameter:g} m: are mass and stiffness in kg and N/m?'
        )
    if limit < config.alarm.amplitude_limit < math.inf:
        yield (
            f'may move the lining by {config.alarm.amplitude_limit:g} m: is alarm.amplitude_limit in metres?'
        )


def _of_friction(config: BearingConfig, load: float) -> Iterator[str]:
    law = config.bearing.friction
    if isinstance(law, Tabulated) and law.values[0] < BREAKAWAY * law.values[1]:
        yield (
            f'has a law that begins with {law.values[0]:g}, far below its next value'
            f' {law.values[1]:g}: is the first of friction.coefficient a measured breakaway?'
        )
    yield from end_of_table(config.bearing, load)
    at_rest = float(np.asarray(law.coefficient(np.zeros(1)))[0])
    sliding = float(np.min(np.asarray(law.coefficient(np.linspace(1e-3, 2.0, 200)))))
    if load > 0.0 and at_rest <= sliding and _fold(config, FACTOR * load) == math.inf:
        yield (
            f'can never bring stick-slip: friction at rest, {at_rest:.4g}, is not above the least'
            f' of sliding friction, {sliding:.4g}: are static and kinetic swapped?'
        )


def end_of_table(bearing: Bearing, load: float) -> Iterator[str]:
    """What of a verdict at a load rests on speeds at which friction was not measured."""
    law = bearing.friction
    if not isinstance(law, Tabulated) or not load > 0.0:
        return
    last, enough, fall = law.speed[-1], bearing.damping / load, _last_fall(law)
    rpm = float(bearing.speed.from_surface(last, 'rpm'))
    if fall > enough:
        yield (
            f'has a law that still falls at its highest measured speed, {last:g} m/s'
            f' ({rpm:.3g} rpm), by {fall:.3g} s/m, and {enough:.3g} s/m are enough for stick-slip'
            ' at this load: can friction be measured at higher speeds?'
        )
        return
    # The relative speed in a cycle reaches twice the shaft's, and the end has to be still falling.
    reach = 2.0 * float(fold_speed(bearing, load))
    if last < reach < math.inf and fall > 0.0:
        yield (
            f'has a law whose highest measured speed is {last:g} m/s ({rpm:.3g} rpm), and cycles'
            f' at the fold slide at up to {reach:.3g} m/s: can friction be measured there?'
        )


def note_on_table(bearing: Bearing) -> str:
    """A clause on a measured curve that ends in the midst of its fall; '' of any other."""
    law = bearing.friction
    if not isinstance(law, Tabulated) or bearing.damping == 0.0:
        return ''
    fall = _last_fall(law)
    if not fall > ENDS_EARLY * scalar_law(law).plain.fall:
        return ''
    return (
        f'friction still falls by {fall:.3g} s/m at its highest measured speed, {law.speed[-1]:g}'
        f' m/s: above {bearing.damping / fall:.3g} N verdicts at higher speeds rest on nothing'
        ' measured'
    )


def _last_fall(law: Tabulated) -> float:
    """How fast a measured curve falls at its end, by its last two points or its slope [s/m]."""
    chord = (law.values[-2] - law.values[-1]) / (law.speed[-1] - law.speed[-2])
    return max(chord, -float(np.asarray(law.slope(np.array([law.speed[-1]])))[0]))


def _fold(config: BearingConfig, load: float) -> float:
    """Fold speed [m/s]; inf where there is none, which asks nothing."""
    fold = float(fold_speed(config.bearing, load)) if load > 0.0 else math.nan
    return fold if math.isfinite(fold) else math.inf
