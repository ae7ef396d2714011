# SPDX-License-Identifier: Apache-2.0
"""The rule of the decision: what one sample changes in the memory of a bearing.

:func:`step` is the whole of it, in the order of docs/alarms.md: is the stamp valid, has
an input been lost, how has a disturbance grown since the last operating point, what does the new
point ask for, which rungs of the alarm change. It is plain scalar Python: live it runs as it
stands, over a recording :func:`run` is compiled (:mod:`stickslip_monitor.jit`).

Everywhere ``s`` is the memory and ``c`` the settings (:mod:`.rule_state`),
``law`` the numbers of the friction law and ``table`` those of the boundaries over the load
(:mod:`stickslip_monitor.physics.boundary_table`).
"""

from __future__ import annotations

import math
from typing import Any

from stickslip_monitor.monitor.rule_state import NEVER
from stickslip_monitor.physics.boundary_table import boundary_at
from stickslip_monitor.physics.chances import chances, runs_after
from stickslip_monitor.physics.law_numbers import friction_slope

SPEED, LOAD, LEVEL = 0, 1, 2
ACCEPTED, CLOCK_JUMP, NOT_FINITE, IMPLAUSIBLE, REPEATED, OUT_OF_ORDER, ODD_STAMP = range(7)
UNKNOWN, QUIET, VIBRATING = 0, 1, 2
WITHIN, BEYOND, IDLE = 0, 1, 2
"""A stick-slip cycle exists, none exists, or nothing slides or moves."""
VIBRATION, CAUTION, BISTABLE, STICK_SLIP, AMPLITUDE = range(5)
"""The rungs of the alarm, in the order of the ladder without normal."""
RUNGS = 5

# Each with the measurement that chose it: docs/alarms.md, "Why these numbers".
LATE = 2.5
"""Gaps after which an input that is slower than its time-out is lost."""
STEP = 10**9
"""The least distance of a stamp from the one before that makes it wait [ns]."""
FAST_LAG, SLOW_LAG = 1.0, 4.0
"""Lags of the two means of the speed whose difference is its slope [s]."""
LOAD_LAG = 4.0
"""Lag of the mean of the load by which probabilities go [s]."""
HOLD = 6
"""What returns within so many off-delays of being cleared is held for as long."""
SLOW_ON, SLOW_OFF, SLOW = 4, 30, 10**9
"""The delays last at least so many gaps of a slow speed, none taken for longer than this [ns]."""
LEFT_BELOW = 0.5
"""Share of its threshold below which a probability no longer holds a condition."""
MEMORY = 300 * 10**9
"""No value stands for longer; after a longer gap nobody knows whether stick-slip runs [ns]."""
SIZED = 10**9
"""Time after which the amplitude of the cycle is worked out again [ns]."""
DUE = 3 * 10**9
"""Net time of a level above its threshold, or below the deadband, that decides its state [ns]."""
LEVEL_LAG = 0.5
"""Lag of the mean of a level [s]."""
FALL = 3.0
"""A level this far below its highest since it rose is that of something that rings down [dB]."""
LOUD_LAG, LOUD = 600.0, 0.02
"""A level high for more than this share of the time outside is not used, lag [s]."""
APART = 1200 * 10**9
"""A level that was high outside so shortly before is not used inside [ns]."""
SHORT = 15 * 10**9
"""A vibration that ends sooner than this, and does not ring down, was something else [ns]."""
REST = 2 * DUE
"""A vibration that returns sooner than this has not ended [ns]."""
DEAF = 60 * 10**9
"""A level that is quiet for so long where stick-slip is predicted may be blind [ns]."""
LEARNED = 60 * 10**9
"""For how long a level is watched outside before anything is learned from it [ns]."""
STUCK = 300 * 10**9
"""A level that has not moved for so long is stuck [ns]."""


def si_value(c: Any, place: int, number: float) -> float:
    """A number as it stands in a message in SI units (a level in its own), deadband applied."""
    si = (number * c.scale[place] + c.offset[place]) * c.factor[place]
    return 0.0 if abs(si) < c.deadband[place] else si


def arrive(s: Any, c: Any, place: int, stamp: int, si: float) -> int:
    """Judge a sample and let time pass up to it.

    Args:
        s: The memory; it is changed.
        c: The settings.
        place: Which input: :data:`SPEED`, :data:`LOAD` or :data:`LEVEL`.
        stamp: Its time stamp [ns].
        si: Its value.

    Returns:
        What became of it: ``ACCEPTED``, ``CLOCK_JUMP``, or why it is refused.
    """
    if not abs(si) <= c.maximum[place] or si < c.minimum[place]:
        return IMPLAUSIBLE if math.isfinite(si) else NOT_FINITE
    last = s.stamp[place]
    status = judge_stamp(s, c, place, stamp)
    if status > CLOCK_JUMP:
        return status
    if place == LEVEL:
        take_level(s, c, si, stamp, last)
        return status
    if status == CLOCK_JUMP:
        move_clock(s, stamp - s.now)
    elif s.came[SPEED] == NEVER and s.came[LOAD] == NEVER:
        if stamp < s.point:  # the clock was set back while nobody listened
            move_clock(s, stamp - s.point)
            s.began = s.now = stamp
        # The first value may come before the time from which inputs are waited for.
        s.began = stamp if s.began == NEVER else min(s.began, stamp)
        s.now = min(s.now, stamp)
    pass_time(s, c, max(s.now, stamp))
    return status


def take(
    s: Any, c: Any, law: Any, table: Any, belief: Any, place: int, stamp: int, si: float
) -> bool:
    """Take a valid speed or load, after :func:`arrive`.

    Returns:
        Whether it made an operating point.
    """
    until = standing_until(s, c)
    take_value(s, c, place, stamp, si)
    whole = s.came[SPEED] != NEVER and s.came[LOAD] != NEVER
    if not whole or s.now > standing_until(s, c):
        return False
    take_point(s, c, law, table, belief, until)
    return True


def judge_stamp(s: Any, c: Any, place: int, stamp: int) -> int:
    """Whether a stamp is valid, of which the input's latest stamp is then made.

    It is expected within some gaps after the input's last one, or about the monitor's time. Any
    other waits: it was right if two of the input's next samples follow it within some of its gaps,
    and the clock has moved.
    """
    last, waiting = s.stamp[place], s.odd[place]
    if stamp == last:
        return REPEATED
    limit = age_limit(s, c, place)
    step = min(limit, max(STEP, int(LATE * s.gap[place]))) if s.pace[place] > 0 else limit
    first = last == NEVER if place == LEVEL else s.came[SPEED] + s.came[LOAD] == 2 * NEVER
    back = last != NEVER and last - limit <= stamp < last
    follows = last != NEVER and last < stamp <= last + step
    if first or follows or (not back and abs(stamp - s.now) <= step):
        s.stamp[place], s.odd[place] = stamp, NEVER
        return ACCEPTED
    rise = stamp - waiting if waiting != NEVER else 0
    agrees = rise != 0 and abs(rise) <= max(limit, min(int(LATE * s.gap[place]), MEMORY))
    if agrees and rise > 0 and s.agreed[place]:
        s.stamp[place], s.odd[place] = stamp, NEVER
        jumped = place != LEVEL and last != NEVER and stamp < s.now - step
        return CLOCK_JUMP if jumped else ACCEPTED
    if 0 < rise <= MEMORY:
        # Slow values are known by their gaps alone.
        keep_pace(s, c, place, rise)
    if stamp != waiting:
        s.odd[place], s.agreed[place] = stamp, int(agrees and (rise > 0 or s.agreed[place]))
    return OUT_OF_ORDER if last != NEVER and stamp < last else ODD_STAMP


def age_limit(s: Any, c: Any, place: int) -> int:
    """How old a value may be before its input is lost [ns]: older where values come slowly."""
    limit: int = max(c.timeout[place], min(int(LATE * s.pace[place]), MEMORY))
    return limit


def standing_until(s: Any, c: Any) -> int:
    """Until when both values stand [ns]; one not yet received is waited for from the start."""
    speed = s.came[SPEED] if s.came[SPEED] != NEVER else s.began
    load = s.came[LOAD] if s.came[LOAD] != NEVER else s.began
    until: int = min(speed + age_limit(s, c, SPEED), load + age_limit(s, c, LOAD))
    return until


def move_clock(s: Any, by: int) -> None:
    """Move every time along with the clock, so that no memory of the lining is lost."""
    s.now += by
    s.began += by
    s.point = shifted(s.point, by)
    s.lost_since = shifted(s.lost_since, by)
    s.unseen = shifted(s.unseen, by)
    s.sized = shifted(s.sized, by)
    for place in range(LEVEL):
        s.came[place] = shifted(s.came[place], by)
    for rung in range(RUNGS):
        s.cleared[rung] = shifted(s.cleared[rung], by)


def shifted(time: int, by: int) -> int:
    """A time on a clock that was set [ns]; one that has not been stays so."""
    return time if time == NEVER else time + by


def pass_time(s: Any, c: Any, now: int) -> None:
    """Let time pass; an input whose value no longer stands is lost from then on."""
    if s.began == NEVER:
        s.began = now
    before, s.now = s.now, now
    if now > before and not s.lost:
        until = standing_until(s, c)
        if until < now:
            # A time-out that was made shorter may have ended before the latest time seen.
            s.lost, s.lost_since = 1, max(until, before)


def take_value(s: Any, c: Any, place: int, stamp: int, si: float) -> None:
    """Take a valid value: it stands from now on, or from its stamp if that is older."""
    came = min(s.now, stamp)
    if s.came[place] != NEVER:
        gap = max(0, came - s.came[place])
        seconds, median = gap * 1e-9, middle(si, s.value[place], s.before[place])
        if place == SPEED:
            s.fast = lagged(s.fast, median, seconds, FAST_LAG)
            s.slow = lagged(s.slow, median, seconds, SLOW_LAG)
        else:
            s.load_mean = lagged(s.load_mean, median, seconds, LOAD_LAG)
        keep_pace(s, c, place, gap)
    elif place == SPEED:
        s.fast = s.slow = si
    else:
        s.load_mean = si
    s.came[place] = came
    s.earlier[place] = s.before[place]
    s.before[place] = s.value[place]
    s.value[place] = si


def keep_pace(s: Any, c: Any, place: int, gap: int) -> None:
    """Note the time between the last two stamps of an input [ns].

    Beyond its time-out a pace slows down by and by: two drop-outs are no slow sensor.
    """
    pace = min(gap, s.gap[place])
    slower = max(int(LATE * s.pace[place]), c.timeout[place])
    s.pace[place] = min(pace, slower) if s.pace[place] > 0 else pace
    s.gap[place] = max(gap, s.gap[place] // 2)


def lagged(mean: float, value: float, seconds: float, lag: float) -> float:
    """A mean that follows a value by a first-order lag [s]."""
    return mean + (value - mean) * (1.0 - math.exp(-seconds / lag))


def middle(first: float, second: float, third: float) -> float:
    """The median of three values; the first where the others have not come yet."""
    if third != third:
        return first
    return max(min(first, second), min(max(first, second), third))


def take_point(s: Any, c: Any, law: Any, table: Any, belief: Any, until: int) -> None:
    """Take the operating point that the values standing now make.

    Args:
        s: The memory.
        c: The settings.
        law: The friction law.
        table: The boundaries.
        belief: The table of probabilities; of no matter without a belief.
        until: Until when the values before stood [ns].
    """
    if s.point != NEVER:
        passed = max(0, min(s.now, until) - s.point)
        if s.now - s.point > MEMORY:
            forget(s)
            passed = 0
        elif s.point < s.began:  # before a restart nobody knows what passed
            passed = 0
        grow(s, c, passed)
        wait(s, passed)
    s.point, s.lost = s.now, 0
    speed, load = median_point(s)
    s.rate = growth_rate(c, law, s.value[SPEED], s.value[LOAD])
    s.median_rate = growth_rate(c, law, speed, load)
    if s.earlier[SPEED] != s.earlier[SPEED] and c.onset_growth > 0.0:
        # Of fewer than three speeds there is no median that could bear a growth out.
        s.median_rate = min(s.median_rate, 0.0)
    averaged = boundary_at(table[0], c.table_first, c.table_step, load)
    limit = max(averaged, boundary_at(table[1], c.table_first, c.table_step, load))
    sliding = speed != 0.0 and load > 0.0
    size = abs(speed)
    near, wide = size < limit * c.caution_on, size <= limit * c.caution_off
    inside = held = exists = size < limit
    if c.has_belief:
        # What is known of the averaged fold is known of the one that decides.
        share = averaged / limit if 0.0 < averaged < limit else 1.0
        can, will = chances(belief, size, s.load_mean, share)
        near, wide = can > c.caution_chance, can >= LEFT_BELOW * c.caution_chance
        inside, held = can > c.can_chance, can >= LEFT_BELOW * c.can_chance
        exists = can >= LEFT_BELOW * c.runs_chance
        s.can, s.will, s.runs = can, will, runs_after(s.runs, can, will)
    # The probability follows the load by a lag; where sliding is unstable a cycle exists.
    exists = exists or s.median_rate > 0.0
    s.course = IDLE if not sliding else WITHIN if exists else BEYOND
    measured = measured_now(s, c)
    judge_lining(s, c, measured, sliding and wide)
    running = s.sticking == 1
    coming = running or (sliding and comes(s, c, speed, limit))
    near, wide = coming or (sliding and near), coming or (sliding and wide)
    inside, held = running or (sliding and inside), running or (sliding and held)
    other = measured == VIBRATING and is_high(s) and c.tells_other and not running
    asks = asked(s, VIBRATION, other and not near, not other or wide)
    asks |= asked(s, CAUTION, near, not wide)
    asks |= asked(s, BISTABLE, inside, not held)
    asks |= asked(s, STICK_SLIP, running, not running)
    if not running:
        s.amplitude, s.sized = 0.0, NEVER
    high, low = s.amplitude > c.amplitude_limit, not s.amplitude >= c.amplitude_off
    asks |= asked(s, AMPLITUDE, high, low)
    s.asks = asks
    climb(s, c)


def amplitude_due(s: Any, c: Any) -> bool:
    """Whether the amplitude of the cycle is to be worked out, which is done once a second.

    Whoever takes samples does it, by the exact cycle at the medians (:func:`median_point`): that
    costs a hundred times what all the rest does, and only a limit needs it. Where no cycle exists
    any more the last amplitude stands until stick-slip has ended.
    """
    needed = s.sticking == 1 and c.amplitude_limit < math.inf
    return needed and (s.sized == NEVER or s.now - s.sized >= SIZED)


def median_point(s: Any) -> tuple[float, float]:
    """Speed [m/s] and load [N] by which the alarm is decided: medians of three values."""
    speed = middle(s.value[SPEED], s.before[SPEED], s.earlier[SPEED])
    return speed, middle(s.value[LOAD], s.before[LOAD], s.earlier[LOAD])


def forget(s: Any) -> None:
    """After a long gap it is not known whether stick-slip runs."""
    s.sticking = s.known = 0
    s.growth = s.unsure = 0.0
    s.dying = s.idle = 0
    for place in range(LEVEL):
        s.before[place] = s.earlier[place] = math.nan
    s.fast = s.slow = s.value[SPEED]
    s.load_mean = s.value[LOAD]


def growth_rate(c: Any, law: Any, speed: float, load: float) -> float:
    """Growth rate of a small disturbance, ``(-N mu'(V) - c)/2m`` [1/s]; at rest it dies out."""
    drive = 0.0
    if speed != 0.0 and load > 0.0:
        drive = -load * friction_slope(law, speed) * c.lean
    return (drive - c.damping) * c.per_mass


def comes(s: Any, c: Any, speed: float, limit: float) -> bool:
    """Whether the slope of the speed leads below the fold within the time looked ahead."""
    slope = (s.fast - s.slow) / (SLOW_LAG - FAST_LAG)
    future = speed + slope * c.look_ahead
    return limit > 0.0 and (future if speed > 0.0 else -future) < limit


def grow(s: Any, c: Any, passed: int) -> None:
    """Let a disturbance grow or die out over the time that the latest point stood [ns].

    What the median of three values does not bear out counts for half of an onset at most, in sum.
    """
    if s.sticking:
        # Only where a cycle exists does it grow again: an input that drops out keeps none alive.
        again = passed if s.course == WITHIN else 0
        s.dying = max(0, s.dying + (passed if s.course == BEYOND else -again))
        s.idle = max(0, s.idle + (passed if s.course == IDLE else -again))
        return
    seconds = passed * 1e-9
    grown, sure = s.rate * seconds, s.median_rate * seconds
    borne = min(grown, max(sure, 0.0)) if grown > 0.0 else max(grown, min(sure, 0.0))
    half = 0.5 * c.onset_growth
    alone = min(max(grown - borne, -half - s.unsure), half - s.unsure)
    s.growth = max(0.0, s.growth + borne + alone)
    s.unsure = s.unsure + alone if s.growth > 0.0 else 0.0


def judge_lining(s: Any, c: Any, measured: int, near: bool) -> None:
    """Decide whether stick-slip runs.

    Args:
        s: The memory.
        c: The settings.
        measured: What the level says.
        near: Whether the point is within the range of caution.
    """
    # Without a growth that is asked for, one value by itself must not start what it cannot keep.
    starts = s.median_rate > 0.0 or (s.rate > 0.0 and c.onset_growth > 0.0)
    if near and measured == VIBRATING and s.raised & (1 << CAUTION) and not was_apart(s):
        if s.course == WITHIN:
            s.responds = 1
        s.course, starts = WITHIN, True
        s.growth = max(s.growth, c.onset_growth)
    elif measured == QUIET and s.responds and s.median_rate <= 0.0 and s.course == WITHIN:
        s.course = IDLE
    if not s.sticking:
        if s.course == BEYOND:
            s.known = 1
        if starts and s.growth >= c.onset_growth:
            s.sticking = s.known = 1
            s.dying = s.idle = 0
    elif (s.course == BEYOND and s.dying >= c.decay) or (
        s.course == IDLE and s.idle >= off_delay(s, c)
    ):
        s.sticking, s.growth, s.unsure = 0, 0.0, 0.0
    follow_unseen(s, measured)


def follow_unseen(s: Any, measured: int) -> None:
    """Follow since when stick-slip is predicted and not measured: a level may be blind."""
    if not s.sticking or measured == VIBRATING:
        s.unseen = NEVER
    elif measured == QUIET and s.unseen == NEVER:
        s.unseen = s.now
    elif measured == QUIET and s.now - s.unseen > DEAF and s.course == WITHIN:
        s.responds = 0


def was_apart(s: Any) -> bool:
    """Whether the level was high outside shortly before, so that it is not used inside yet."""
    recent = s.outside != NEVER and abs(s.now - s.outside) < APART
    goes_on = s.spell != NEVER and s.stamp[LEVEL] - max(s.spell, s.outside) >= SHORT
    is_new = s.spell > s.outside or s.watched >= LEARNED
    return recent and not (goes_on and is_new)


def asked(s: Any, rung: int, holds: bool, clear: bool) -> int:
    """The bit of a rung if it should change: a lower one holds, or a raised one is clear."""
    change = clear if s.raised & (1 << rung) else holds
    return 1 << rung if change else 0


def wait(s: Any, passed: int) -> None:
    """Count the net time for which each rung has been asked to change [ns]."""
    for rung in range(RUNGS):
        s.count[rung] = max(0, s.count[rung] + (passed if s.asks & (1 << rung) else -passed))


def climb(s: Any, c: Any) -> None:
    """Change the rungs that have been asked for long enough."""
    for rung in range(RUNGS):
        bit = 1 << rung
        if s.asks & bit and s.count[rung] >= due(s, c, rung):
            s.raised ^= bit
            s.asks ^= bit
            s.count[rung] = 0
            if not s.raised & bit:
                s.cleared[rung] = s.now
            elif s.cleared[rung] != NEVER and s.now - s.cleared[rung] >= hold(s, c):
                s.cleared[rung] = NEVER


def due(s: Any, c: Any, rung: int) -> int:
    """The net time that changes a rung [ns]: growth is a delay of its own."""
    if s.raised & (1 << rung):
        return hold(s, c) if s.cleared[rung] != NEVER else off_delay(s, c)
    if rung == STICK_SLIP and c.onset_growth > 0.0:
        return 0
    return max(int(c.on_delay), SLOW_ON * min(s.pace[SPEED], SLOW))


def off_delay(s: Any, c: Any) -> int:
    """The net time after which something is over [ns]; longer where values come slowly."""
    return max(int(c.off_delay), SLOW_OFF * min(s.pace[SPEED], SLOW))


def hold(s: Any, c: Any) -> int:
    """What returns within so long of being cleared is held for as long [ns]."""
    return max(HOLD * int(c.off_delay), off_delay(s, c))


def rung_of(s: Any) -> int:
    """The place in the ladder on which the alarm stands, 0 for normal."""
    top = 0
    for rung in range(RUNGS):
        if s.raised & (1 << rung) and (rung != AMPLITUDE or top == STICK_SLIP + 1):
            top = rung + 1
    return top


def condition(s: Any) -> int:
    """:func:`rung_of`, or one above the end of the ladder while an input is lost."""
    return RUNGS + 1 if s.lost else rung_of(s)


def take_level(s: Any, c: Any, si: float, stamp: int, last: int) -> None:
    """Take a valid level: is the lining quiet or vibrating, and is the level to be trusted?

    Args:
        s: The memory.
        c: The settings.
        si: The level, in its unit.
        stamp: Its stamp [ns].
        last: The stamp before; :data:`NEVER` for none.
    """
    level = si if c.in_db else 20.0 * math.log10(max(si, 1e-20))
    gap = stamp - last
    if last != NEVER and gap < 0:
        # Its clock was set back.
        s.moved += gap
        s.outside = shifted(s.outside, gap)
    if si != s.level:
        s.moved = stamp
    s.level = si
    limit = age_limit(s, c, LEVEL)
    if last != NEVER and gap > 0:
        keep_pace(s, c, LEVEL, gap)
    if last == NEVER or not 0 <= gap <= limit:
        s.vibrating, s.level_count, s.spell = UNKNOWN, 0, NEVER
        s.level_mean = s.level_peak = level
        return
    rings_down = s.level_mean < s.level_peak - FALL
    s.level_mean = lagged(s.level_mean, level, gap * 1e-9, LEVEL_LAG)
    threshold = level_threshold(s, c)
    if not s.raised & (1 << CAUTION):
        watch_outside(s, c, level >= threshold, gap, stamp)
    # Where no threshold is known yet the level is neither.
    high, low = level >= threshold, level < threshold - c.hysteresis < math.inf
    count_level(s, level, high, low, min(gap, DUE // 2))
    if high or s.spell != NEVER:
        follow_spell(s, low, rings_down, stamp, last)


def follow_spell(s: Any, low: bool, rings_down: bool, stamp: int, last: int) -> None:
    """Follow since when a level has been high, but for short rests, and judge what has ended.

    Stick-slip goes on, and the ring of a blow falls by and by: what is over sooner, is not.
    """
    if s.spell == NEVER:
        s.spell = stamp
    if not low:
        s.high = stamp
        return
    falls = s.high == last and s.vibrating == VIBRATING and not rings_down
    if falls and stamp - s.spell < SHORT:
        s.outside = stamp
    if stamp - s.high >= REST:
        s.spell = NEVER


def level_threshold(s: Any, c: Any) -> float:
    """The level that is vibration [dB]: configured, or 3 dB above the loudest level outside."""
    if c.threshold == c.threshold:
        return c.threshold
    return s.loudest + FALL if s.watched >= LEARNED else math.inf


def watch_outside(s: Any, c: Any, high: bool, gap: int, stamp: int) -> None:
    """Follow how loud a level is where no stick-slip is near."""
    seconds = gap * 1e-9
    s.loud = lagged(s.loud, 1.0 if high else 0.0, seconds, LOUD_LAG)
    s.watched += gap
    if high:
        s.outside = stamp
    if s.loudest != s.loudest:
        s.loudest = s.level_mean
    elif s.level_mean > s.loudest:
        s.loudest = lagged(s.loudest, s.level_mean, seconds, FAST_LAG)


def count_level(s: Any, level: float, high: bool, low: bool, gap: int) -> None:
    """Count the net time of a level on either side; one that rings down counts for quiet."""
    if high:
        if s.level_count <= 0:
            s.level_peak = s.level_mean
        s.level_peak = max(s.level_peak, s.level_mean)
        if s.vibrating != VIBRATING and max(level, s.level_mean) < s.level_peak - FALL:
            gap = -min(gap, max(s.level_count, 0))
        s.level_count += gap
    elif low:
        s.level_count -= gap
    if s.vibrating == VIBRATING:
        s.level_count = min(s.level_count, 0)
    elif s.vibrating == QUIET:
        s.level_count = max(s.level_count, 0)
    if s.level_count >= DUE:
        s.vibrating, s.level_count = VIBRATING, 0
    elif s.level_count <= -DUE:
        s.vibrating, s.level_count = QUIET, 0


def measured_now(s: Any, c: Any) -> int:
    """What the level says at the latest point; unknown where it is not to be trusted."""
    if (
        not c.has_level
        or s.stamp[LEVEL] == NEVER
        or abs(s.now - s.stamp[LEVEL]) > age_limit(s, c, LEVEL)
    ):
        return UNKNOWN
    if s.stamp[LEVEL] - s.moved > STUCK or s.loud > LOUD:
        return UNKNOWN
    if s.vibrating == QUIET and is_high(s) and s.stamp[LEVEL] - s.spell >= DUE:
        return UNKNOWN
    return int(s.vibrating)


def is_high(s: Any) -> bool:
    """Whether the latest level is above its threshold, or within the hysteresis below it."""
    return s.spell != NEVER and s.high == s.stamp[LEVEL]


STATUS, NOW, POINT, UNTIL, CONDITION, STICKING, MEASURED = range(7)
"""What is noted of each sample: the columns of the table that :func:`run` fills."""
SAMPLE, TIME, BEFORE, AFTER, ONSET = range(5)
"""What is noted of each change of the alarm."""


def run(
    states: Any,
    c: Any,
    law: Any,
    table: Any,
    belief: Any,
    samples: tuple[Any, Any, Any],
    begin: int,
    end: int,
    notes: Any,
    points: Any,
    changes: Any,
    kept: Any,
) -> tuple[int, int]:
    """Take samples of a recording until there is no more room, or an amplitude is due.

    Args:
        states: The memory, of one row.
        c: The settings, of one row.
        law: The friction law.
        table: The boundaries.
        belief: The table of probabilities; of no matter without a belief.
        samples: Which input each is of, its stamp [ns], and its number, each shape (n,).
        begin: The first sample to take.
        end: The one after the last.
        notes: What is noted of each sample, shape (n, 7).
        points: Speed and load at each point, shape (n, 2); with a belief the three probabilities,
            too, shape (n, 5).
        changes: What is noted of each change, shape (m, 5).
        kept: The memory at each change, shape (m,).

    Returns:
        The sample after the last one taken, and how many changes there were.
    """
    places, stamps, numbers = samples
    s, settings = states[0], c[0]
    count = 0
    for k in range(begin, end):
        if count + 2 > len(kept) or (k > begin and amplitude_due(s, settings)):
            return k, count
        place, stamp = places[k], stamps[k]
        si = si_value(settings, place, numbers[k])
        before, lost, sticking, point = condition(s), s.lost, s.sticking, False
        status = arrive(s, settings, place, stamp, si)
        if s.lost != lost:
            keep(changes, kept, states, count, k, s.lost_since, before, 0)
            count += 1
            before = condition(s)
        if status <= CLOCK_JUMP and place != LEVEL:
            point = take(s, settings, law, table, belief, place, stamp, si)
            onset = int(s.sticking > sticking)
            if onset or condition(s) != before:
                keep(changes, kept, states, count, k, s.now, before, onset)
                count += 1
        row = notes[k]
        row[STATUS], row[NOW], row[POINT] = status, s.now, int(point)
        row[CONDITION], row[STICKING] = condition(s), s.sticking
        if point:
            row[UNTIL], row[MEASURED] = standing_until(s, settings), measured_now(s, settings)
            points[k][0], points[k][1] = s.value[SPEED], s.value[LOAD]
            if settings.has_belief:
                points[k][2], points[k][3], points[k][4] = s.can, s.will, s.runs
    return end, count


def keep(
    changes: Any, kept: Any, states: Any, at: int, sample: int, time: int, before: int, onset: int
) -> None:
    """Note a change of the alarm, with the memory as it is then."""
    row = changes[at]
    row[SAMPLE], row[TIME], row[BEFORE], row[ONSET] = sample, time, before, onset
    row[AFTER] = condition(states[0])
    kept[at] = states[0]
