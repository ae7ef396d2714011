# SPDX-License-Identifier: Apache-2.0
"""What a measured level says: is the lining quiet or vibrating, and is the level to be used?

A level vibrates where it is above its threshold and has risen above its own background, so a
wrong gain, or an engine that is heard all the time, is no vibration. It is used at once where it
has been quiet for long enough; after a start, and after a vibration that was short, only one that
goes on is. All that is remembered are levels and net times: no clock is read.
"""

from __future__ import annotations

import math

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.monitor.rule_settings import RuleNumbers
from stickslip_monitor.monitor.rule_state import DOUBT, SPEED, State

UNKNOWN, QUIET, VIBRATING = 0, 1, 2
# Each with the measurement that chose it: docs/rule.md, "Why these numbers".
DUE = 3 * SECOND_NS
"""Net time of a level above its threshold, or below the deadband, that decides its state [ns]."""
RISE, BACKGROUND = 10.0, 60.0
"""A vibration is so far above its background [dB], a mean behind such a lag [s]."""
SHORT = 15 * SECOND_NS
"""A vibration that ends sooner than this was something else [ns]."""
LASTING = 75 * SECOND_NS
"""A vibration that lasts for so long is stick-slip anywhere inside the fold [ns]."""
BEGUN = 0.5
"""A vibration that rises after so much growth of a disturbance is stick-slip at once [e-folds]."""
LEAD_LAG = 1.0
"""Lag of the mean by which another bearing's level leads [s]."""


def take_level(s: State, c: RuleNumbers, si: float, gap: int) -> None:
    """Store a valid level, and update its background, whether it vibrates, and what is doubted of it.

    The times for which it has stood still, or been high, are counted too. A level after too long a gap adds
    nothing to them, and makes unknown whether it vibrates.

    Args:
        s: The memory, changed.
        c: The numbers of the configuration.
        si: The level in its own unit.
        gap: Time since the level before [ns]; negative where that is too old, or there is none.
    """
    level = decibels(c, si)
    s.still = s.still + max(gap, 0) if si == s.level else 0
    s.level = si
    # At rest a sensor shows its own floor, and 0 is no level: under way neither is what is usual.
    is_background = s.value[SPEED] != 0.0 and (c.in_db or si > 0.0) and not s.sticking
    follow_rival(s, c, gap)
    # What may be stick-slip yet, here or elsewhere, raises no threshold before it is known.
    is_background = is_background and not (is_outdone(s, c) or 0 < s.high_for < LASTING)
    if s.background != s.background and is_background:
        s.background = level
    if gap < 0:
        s.vibrating, s.level_count = UNKNOWN, 0
        return
    if is_background:
        s.background = lagged(s.background, level, gap * 1e-9, BACKGROUND)
    if s.vibrating == QUIET:
        s.doubt = max(0, s.doubt - gap)
    threshold = s.background + RISE
    if c.threshold > threshold or threshold != threshold:
        threshold = c.threshold
    high, low = level >= threshold, level < threshold - c.hysteresis
    if is_outdone(s, c) and not low:
        s.vibrating, s.level_count, s.high_for = UNKNOWN, 0, 0
        return
    if high or s.high_for > 0:
        if s.high_for == 0:
            s.grown_before = s.growth
        s.high_for += gap
        s.beyond_for += gap
    count_level(s, high, low, min(gap, DUE // 2))


def count_level(s: State, high: bool, low: bool, step: int) -> None:
    """Add up the net time of a level above or below its thresholds, and set ``s.vibrating`` after 3 s.

    A vibration that ends within 15 s makes the next ten minutes doubtful. Changes ``s.level_count`` and
    ``s.doubt``, too, and sets ``s.high_for`` to 0 where the level is quiet.

    Args:
        s: The memory, changed.
        high: Whether the level is above the threshold.
        low: Whether it is below it by the hysteresis.
        step: The time that counts [ns].
    """
    s.level_count += step if high else -step if low else 0
    if s.vibrating == VIBRATING:
        s.level_count = min(s.level_count, 0)
    elif s.vibrating == QUIET:
        s.level_count = max(s.level_count, 0)
    if s.level_count >= DUE:
        s.vibrating, s.level_count = VIBRATING, 0
    elif s.level_count <= (0 if s.vibrating == QUIET else -DUE):
        # The end of a vibration is known with a delay.
        if 0 < s.high_for < SHORT + (DUE if s.vibrating == VIBRATING else 0):
            s.doubt = max(s.doubt, DOUBT)
        s.vibrating, s.level_count, s.high_for = QUIET, 0, 0


def usable_state(s: State) -> int:
    """Return the state of a level that is not lost: quiet, vibrating, or unknown where stuck or doubted."""
    if (
        s.still > DOUBT
        or s.doubt > DOUBT
        or (s.vibrating == VIBRATING and s.doubt > 0 and s.high_for < SHORT)
    ):
        return UNKNOWN
    return int(s.vibrating)


def has_begun(s: State) -> bool:
    """Return whether a vibration inside the fold is stick-slip: it rose after growth, or has lasted.

    Without growth only a shock can have begun it, and it then goes on to the fold; a pump stops.
    """
    return s.high_for >= LASTING or (s.rate > 0.0 and s.grown_before > BEGUN)


def doubt_foreign(s: State, can_be_foreign: bool) -> None:
    """Doubt a level that has vibrated for 15 s where no stick-slip can be: it hears something else.

    Until ten minutes of quiet it then counts for nothing, as :func:`usable_state` says.

    Args:
        s: The memory. ``s.beyond_for``, which :func:`take_level` counts, restarts at another point, and while
            the level does not vibrate; ``s.doubt`` is set.
        can_be_foreign: Whether the point is one at which stick-slip cannot be.
    """
    if not can_be_foreign or s.vibrating != VIBRATING:
        s.beyond_for = 0
    elif s.beyond_for >= SHORT:
        s.doubt = 2 * DOUBT


def is_above_threshold(s: State, c: RuleNumbers, raised: bool) -> bool:
    """Return whether the latest level is above the configured threshold, whatever its background is.

    ``raised``: the condition stands already, so the hysteresis counts. False where the level is stuck.
    """
    limit = c.threshold - c.hysteresis if raised else c.threshold
    return bool(s.still <= DOUBT and decibels(c, s.level) >= limit)


def follow_rival(s: State, c: RuleNumbers, gap: int) -> None:
    """Let ``s.lead`` follow how much further above its threshold the loudest other level is than this one.

    It follows 0 where no other is above its threshold, and is ``nan`` where this one has none. ``gap`` is as
    of :func:`take_level`.
    """
    lead = s.rival - excess_over_threshold(c, s.level) if s.rival >= 0.0 else 0.0
    s.lead = lagged(s.lead, lead, gap * 1e-9, LEAD_LAG) if gap >= 0 and s.lead == s.lead else lead


def is_outdone(s: State, c: RuleNumbers) -> bool:
    """Return whether another bearing vibrates, and leads by the hysteresis: then it is what is heard."""
    return bool(s.lead > c.hysteresis)


def excess_over_threshold(c: RuleNumbers, si: float) -> float:
    """Return how far a level is above the configured threshold [dB]; ``nan`` without one."""
    return decibels(c, si) - c.threshold


def decibels(c: RuleNumbers, si: float) -> float:
    """Return a level in decibels of its own unit, -400 for 1e-20 or less; one that is ``in_db`` as it is."""
    return si if c.in_db else 20.0 * math.log10(max(si, 1e-20))


def lagged(mean: float, value: float, seconds: float, lag: float) -> float:
    """Return a mean that follows a value over some seconds by a first-order lag [s]."""
    return mean + (value - mean) * (1.0 - math.exp(-seconds / lag))
