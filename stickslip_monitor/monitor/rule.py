# SPDX-License-Identifier: Apache-2.0
"""The rule of the decision: what one sample changes in the memory of a bearing.

:func:`receive_sample` judges a sample and lets time pass, :func:`take_value` takes a valid
speed or load, in the order of docs/rule.md: is the sample valid, has an input been lost, how has a
disturbance grown since the last operating point, what does the new point ask for, which rungs of the
alarm change. What a measured level says is in :mod:`.vibration_rule`. It is plain scalar Python: live it
runs as it stands, over a recording the loop of :mod:`.rule_over_arrays` is compiled.

Everywhere ``s`` is the memory (:mod:`.rule_state`) and ``c`` the numbers of the configuration
(:mod:`.rule_settings`); ``model`` are the numbers of the friction law, those of the boundaries over the load
(:mod:`stickslip_monitor.physics.boundary_table`) and those of a belief, of no matter without one.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import TypeAlias, TypeVar

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.parameters import MAX_LOAD_POINTS
from stickslip_monitor.monitor.rule_settings import RuleNumbers
from stickslip_monitor.monitor.rule_state import LEVEL, LOAD, NEVER, SPEED, WATER, State
from stickslip_monitor.monitor.sample_types import LEAST_NO_VALUE, NO_VALUES, Status
from stickslip_monitor.monitor.vibration_rule import (
    QUIET,
    SHORT,
    UNKNOWN,
    VIBRATING,
    doubt_foreign,
    has_begun,
    is_above_threshold,
    lagged,
    take_level,
    usable_state,
)
from stickslip_monitor.physics.boundary_table import boundary_at, place_at
from stickslip_monitor.physics.lubrication import scale_at, viscosity
from stickslip_monitor.physics.probability import stick_slip_probabilities, update_running_probability
from stickslip_monitor.physics.scalar_law import friction_slope

Numbers: TypeAlias = Sequence[float]
Model: TypeAlias = tuple[Numbers, Sequence[Sequence[Numbers]], Numbers]
Rows: TypeAlias = Sequence[MutableSequence[float]]
_Number = TypeVar('_Number', float, FloatArray)

ACCEPTED, NOT_FINITE, NO_VALUE, IMPLAUSIBLE, BELOW_MINIMUM, REPEATED, OUT_OF_ORDER = Status
WITHIN, BEYOND, IDLE = 0, 1, 2
"""A stick-slip cycle exists, none exists, or nothing slides or moves."""
VIBRATION, CAUTION, BISTABLE, STICK_SLIP, AMPLITUDE = range(5)
"""The rungs of the alarm, in the order of the ladder without normal."""
RUNGS = AMPLITUDE + 1

# Each with the measurement that chose it: docs/rule.md, "Why these numbers".
LATE = 2.5
"""Gaps after which an input that is slower than its time-out is lost."""
PAIRED = 10
"""A gap that is shorter than the one before by more than this factor is within a pair of values."""
NEAR = SECOND_NS
"""A stamp is the time of its sample if it is older than the arrival by no more than this; an
arrival that is before the input's last one by more shows that the clock was set back [ns]."""
FAST_LAG, SLOW_LAG = 1.0, 4.0
"""Lags of the two means of the speed whose difference is its slope [s]."""
LOAD_LAG = 4.0
"""Lag of the mean of the load by which probabilities go [s]."""
HOLD = 6
"""What returns within so many off-delays of being cleared is held for as long."""
BORNE = 1.0
"""Share of ``alarm.onset_growth`` at which stick-slip is predicted; trials of the alarm raise it."""
MEMORY = 300 * SECOND_NS
"""No value stands for longer [ns]."""
SIZED = SECOND_NS
"""Time after which the amplitude of the cycle is computed again [ns]."""


def si_value(c: RuleNumbers, place: int, number: _Number) -> _Number:
    """Convert a message's number, or an array of them, to SI units; within the deadband it becomes 0.

    A level stays in its own unit. ``place`` is the index of the input.
    """
    si = (number * c.scale[place] + c.offset[place]) * c.factor[place]
    return si * (abs(si) >= c.deadband[place]) + 0.0  # no -0.0


def load_at(c: RuleNumbers, speed: float) -> float:
    """Return the configured load [N] at a surface speed [m/s], linear between the points of its table.

    The speed is a magnitude. Beyond the ends it is the load there; without a table it is ``nan``.
    """
    above = 1
    while above < MAX_LOAD_POINTS - 1 and c.load_speed[above] < speed:
        above += 1
    low, high = c.load_speed[above - 1], c.load_speed[above]
    load = c.load_there[above - 1]
    if not high < math.inf:
        return load
    share = min(max((speed - low) / (high - low), 0.0), 1.0)
    return load + share * (c.load_there[above] - load)


def receive_sample(
    s: State, c: RuleNumbers, place: int, stamp: int, arrival: int, number: float
) -> tuple[int, int, float]:
    """Judge a sample, and where it is accepted let time pass up to it.

    A valid level or temperature is stored at once, and no time passes; a valid speed or load is left to
    :func:`take_value`. Time also passes up to a repeat that counts (:func:`has_repeats`).

    Args:
        s: The memory, which changes.
        c: The numbers of the configuration.
        place: Index of the input.
        stamp: Time stamp of the message [ns].
        arrival: When it came [ns].
        number: The number in the message; of a load from a table that of the speed.

    Returns:
        The :class:`Status` as a number; the time of the sample on the monitor's own clock [ns], 0 where it
        is not accepted; and its value in SI units, a level in its own.
    """
    # A load from a table is that at the speed of the message, and as valid as that.
    judged = SPEED if place == LOAD and c.has_load_table else place
    si = si_value(c, judged, number)
    status = judge_value(c, judged, number, si)
    if status != ACCEPTED:
        return status, 0, si
    if judged != place:
        si = load_at(c, abs(si))
    time, came = sample_time(s, place, stamp, arrival), s.came[place]
    # Without a stamp of its own a message is new, in the order in which it came.
    stamped = came != NEVER and stamp != arrival
    if stamped and stamp == s.stamp[place]:
        if judged == place and si == latest_value(s, place):
            if has_repeats(c, place):
                advance(s, c, max(s.now, arrival + s.shift))
            return REPEATED, 0, si
        time = max(arrival + s.shift, came)
    elif stamped and stamp < s.stamp[place] and time - came < clock_step_delay(s, c, place):
        return OUT_OF_ORDER, 0, si
    s.stamp[place] = stamp
    if place >= LEVEL:
        take_level_or_water(s, c, place, time, si)
        return ACCEPTED, time, si
    if s.came[SPEED] == NEVER and s.came[LOAD] == NEVER:
        # The first value may come before the time from which inputs are waited for.
        s.began = time if s.began == NEVER else min(s.began, time)
        s.now = min(s.now, time)
    advance(s, c, max(s.now, time))
    return ACCEPTED, time, si


def latest_value(s: State, place: int) -> float:
    """Return the latest value of an input: m/s, N or C, a level in its own unit; ``nan`` before the first.

    Before its first value the water has its configured temperature, if any.
    """
    if place == WATER:
        return s.water
    return s.level if place == LEVEL else s.value[place]


def take_level_or_water(s: State, c: RuleNumbers, place: int, time: int, si: float) -> None:
    """Store a valid level or water temperature that came at a time [ns], and update the pace of its input.

    ``si`` is a level in its own unit, or a temperature in C, by which the viscosity ratio is set, too.
    """
    gap = time - s.came[place] if s.came[place] != NEVER else -1
    s.came[place] = time
    if gap > 0:
        update_pace(s, c, place, gap)
    if place == LEVEL:
        take_level(s, c, si, gap if gap <= age_limit(s, c, LEVEL) else -1)
    else:
        s.water, s.viscosity_ratio = si, viscosity(si, c.salinity) / c.viscosity_then


def use_configured_water(s: State, c: RuleNumbers) -> None:
    """Set the water's temperature and viscosity ratio as configured, unless a measured one has come."""
    if s.came[WATER] == NEVER:
        s.water, s.viscosity_ratio = c.water, c.viscosity_ratio


def clock_step_delay(s: State, c: RuleNumbers, place: int) -> int:
    """Return the time without a newer stamp after which older stamps mean a clock that was set back [ns].

    It is 2.5 of the latest gap, a second at least, and half of :func:`age_limit` at most.
    """
    return min(age_limit(s, c, place) // 2, max(NEAR, int(LATE * s.gap[place])))


def judge_value(c: RuleNumbers, place: int, number: float, si: float) -> int:
    """Return the :class:`Status` of an input's number by its value alone; ``si`` is the same in SI units."""
    size = abs(si)
    if not size < math.inf:
        return NOT_FINITE
    if abs(number) >= LEAST_NO_VALUE and (number in NO_VALUES or abs(number) >= NO_VALUES[0]):
        return NO_VALUE
    if size > c.maximum[place]:
        return IMPLAUSIBLE
    return ACCEPTED if si >= c.minimum[place] else BELOW_MINIMUM


def sample_time(s: State, place: int, stamp: int, arrival: int) -> int:
    """Return a sample's time on the monitor's own clock [ns], and follow a clock that was set back.

    It is the stamp where that is at most a second before the arrival, else the arrival, and never before
    the input's last sample. Where the arrivals step back by more, ``s.shift`` makes up for it, all stamps are
    forgotten, ``s.now`` moves on to the time that is returned, and ``s.began`` by as much.
    """
    last = s.came[place] if s.came[place] != NEVER else s.point
    time = arrival + s.shift
    if last != NEVER and time < last - NEAR:
        # The clock was set back: the monitor's own goes on, and no memory of the lining is lost.
        time = max(last, s.now)
        s.shift = time - arrival
        if s.now != NEVER:
            # Set between two runs: the wait for inputs is as long as it was.
            s.began += time - s.now
            s.now = time
        for place_of_input in range(WATER + 1):
            s.stamp[place_of_input] = NEVER
    elif 0 <= arrival - stamp <= NEAR:
        time = stamp + s.shift
    return max(time, s.came[place])


def take_value(s: State, c: RuleNumbers, model: Model, place: int, time: int, si: float) -> int:
    """Store a valid speed or load, after :func:`receive_sample`, and decide where both inputs stand.

    ``time`` [ns] and ``si`` are what that returned.

    Returns:
        The time until which the values of the operating point that it made stand [ns]; ``NEVER`` where it
        made none: an input is missing or lost, or it is a speed whose load by the table is still to come.
    """
    stood_until = standing_until(s, c)
    store_value(s, c, place, min(s.now, time), si)
    if place == SPEED and c.has_load_table:
        return NEVER  # the load at this speed follows, of the same message
    until = standing_until(s, c)
    if s.came[SPEED] == NEVER or s.came[LOAD] == NEVER or s.now > until:
        return NEVER
    take_point(s, c, model, stood_until)
    return until


def has_repeats(c: RuleNumbers, place: int) -> bool:
    """Return whether a repeated value of an input counts, as its source sends changes only."""
    return bool(place < LEVEL and c.hold[place] > 0)


def repeat_value(s: State, c: RuleNumbers, model: Model, place: int) -> int:
    """Take the latest value of an input once more, after :func:`receive_sample` of a repeat.

    The age of the value is not renewed.

    Returns:
        The time until which the values of the operating point that it made stand [ns]; ``NEVER`` where it
        made none: an input is missing or lost.
    """
    until = standing_until(s, c)
    if s.came[SPEED] == NEVER or s.came[LOAD] == NEVER or s.now > until:
        return NEVER
    update_means(s, place, (s.now - max(s.point, s.came[place])) * 1e-9, s.value[place])
    s.earlier[place], s.before[place] = s.before[place], s.value[place]
    if place == SPEED and c.has_load_table:
        s.earlier[LOAD], s.before[LOAD] = s.before[LOAD], s.value[LOAD]
    take_point(s, c, model, until)
    return until


def age_limit(s: State, c: RuleNumbers, place: int) -> int:
    """Return the age at which an input is lost [ns]: its time-out, or 2.5 of its usual gaps if longer.

    The gaps count up to five minutes.
    """
    limit, slow = c.timeout[place], LATE * s.pace[place]
    return limit if slow <= limit else max(limit, min(int(slow), MEMORY))


def standing_until(s: State, c: RuleNumbers) -> int:
    """Return the time until which neither speed nor load is lost [ns].

    One that has not come yet is waited for from the start.
    """
    speed = s.came[SPEED] if s.came[SPEED] != NEVER else s.began
    load = s.came[LOAD] if s.came[LOAD] != NEVER else s.began
    until: int = min(speed + age_limit(s, c, SPEED), load + age_limit(s, c, LOAD))
    return until


def advance(s: State, c: RuleNumbers, now: int) -> None:
    """Set the latest time ``s.now`` [ns]; mark an input as lost, since its value was too old, in ``s.lost``.

    ``s.lost_since`` is then the time until which the value held, of a clock that does not go back. The first
    call starts the wait for inputs. An earlier ``now`` sets the time back, and marks nothing; a
    loss ends by :func:`take_point` only.
    """
    if s.began == NEVER:
        s.began = now
    before, s.now = s.now, now
    if now > before and not s.lost:
        until = standing_until(s, c)
        if until < now:
            # A time-out that was made shorter may have ended before the latest time seen.
            s.lost, s.lost_since = 1, max(until, before)


def store_value(s: State, c: RuleNumbers, place: int, came: int, si: float) -> None:
    """Store a valid speed or load as the latest, and update the means and the pace of its input.

    The two values before move along for the median of three.

    Args:
        s: The memory, changed.
        c: The numbers of the configuration.
        place: Index of the input, speed or load.
        came: The time from which it stands [ns]; not before that of the input's latest value.
        si: The value [m/s or N].
    """
    if s.came[place] != NEVER:
        gap = came - s.came[place]
        update_means(s, place, gap * 1e-9, si)
        update_pace(s, c, place, gap)
    elif place == SPEED:
        s.fast = s.slow = si
    else:
        s.load_mean = si
    s.came[place] = came
    s.earlier[place] = s.before[place]
    s.before[place] = s.value[place]
    s.value[place] = si


def update_means(s: State, place: int, seconds: float, si: float) -> None:
    """Let the lagged means of speed or load follow the median of a new value and the two before.

    Args:
        s: The memory, changed; it must not have the value yet.
        place: Index of the input, speed or load.
        seconds: The time since the value before [s].
        si: The new value [m/s or N].
    """
    median = median_of_three(si, s.value[place], s.before[place])
    if place == SPEED:
        s.fast = lagged(s.fast, median, seconds, FAST_LAG)
        s.slow = lagged(s.slow, median, seconds, SLOW_LAG)
    else:
        s.load_mean = lagged(s.load_mean, median, seconds, LOAD_LAG)


def update_pace(s: State, c: RuleNumbers, place: int, gap: int) -> None:
    """Set the usual gap (``s.pace``) and the latest gap (``s.gap``) of an input by a new gap [ns].

    The usual gap is the shorter of the last two, the longer where the new one is below a tenth of the one
    before: values in pairs. Beyond the time-out it grows by a factor of 2.5 at most each time: two drop-outs
    make no slow sensor. A long latest gap fades by half each time.
    """
    pace = s.gap[place] if PAIRED * gap < s.gap[place] else min(gap, s.gap[place])
    slower = max(int(LATE * s.pace[place]), c.timeout[place])
    s.pace[place] = min(pace, slower) if s.pace[place] > 0 else pace
    s.gap[place] = max(gap, s.gap[place] // 2)


def median_of_three(latest: float, before: float, earlier: float) -> float:
    """Return the median of the last three values; the latest one while ``earlier`` is ``nan``, for none."""
    if earlier != earlier:
        return latest
    return max(min(latest, before), min(max(latest, before), earlier))


def take_point(s: State, c: RuleNumbers, model: Model, until: int) -> None:
    """Decide at the operating point of the latest values: stick-slip, and which rungs are to change.

    Changes in the memory the rates, the state of stick-slip, the probabilities and the rungs; the loss of an
    input ends. ``until`` is the time until which the values before stood [ns].
    """
    fresh = count_elapsed(s, c, until)
    s.point, s.lost = s.now, 0
    speed, load = median_point(s)
    scale = scale_of(s, c, load)
    s.rate = growth_rate(c, model[0], speed, load, scale)
    if s.earlier[SPEED] != s.earlier[SPEED] and c.onset_growth > 0.0:
        # Fewer than three speeds have no median.
        s.rate = min(s.rate, 0.0)
    sliding = speed != 0.0 and load > 0.0
    lower, limit, near, wide, inside = judge_point(s, c, model, speed, load, scale)
    if c.has_level:
        doubt_foreign(s, may_be_foreign(s, c))
    # A level starts stick-slip inside the fold only, and keeps it within the range of caution.
    may_tell = wide if s.sticking else inside
    update_stick_slip(s, c, measured_now(s, c) if may_tell else UNKNOWN, fresh)
    if s.sticking or (sliding and comes(s, c, speed, (lower, limit))):
        near = wide = True
    request_rungs(s, c, near, wide, inside)
    update_rungs(s, c, fresh)


def judge_point(
    s: State, c: RuleNumbers, model: Model, speed: float, load: float, scale: float
) -> tuple[float, float, bool, bool, bool]:
    """Judge a point by :func:`reach`, or below the range of cycles by its lower end; set ``s.course``.

    Args:
        s: The memory, of which the probabilities change too.
        c: The numbers of the configuration.
        model: The law, the tables of the boundaries and of the belief.
        speed: The median speed [m/s].
        load: The median load [N].
        scale: :func:`scale_of` that load.

    Returns:
        Lower end of the range of cycles and the fold [m/s], 0 for none; then whether the point is so near
        that caution is asked for, is within the range in which it is kept, and is in the bistable range:
        never where nothing slides.
    """
    size = abs(speed)
    place = place_at(c.table_first, c.table_step, load / scale)
    lower = scale * boundary_at(model[1][2], c.table_growth[2], place)
    limit, near, wide, inside, exists = reach(s, c, model, size, place, scale)
    if speed == 0.0 or not load > 0.0:
        s.course = IDLE
        return lower, limit, False, False, False
    if size < lower:  # friction still rises with the speed: no cycle exists
        # Where sliding is unstable one exists all the same.
        s.course = WITHIN if s.rate > 0.0 else IDLE
        return lower, limit, size * c.caution_on > lower, size * c.caution_off > lower, False
    # The probability follows the load by a lag; where sliding is unstable a cycle exists.
    s.course = WITHIN if exists or s.rate > 0.0 else BEYOND
    return lower, limit, near, wide, inside


def request_rungs(s: State, c: RuleNumbers, near: bool, wide: bool, inside: bool) -> None:
    """Set in ``s.asks`` the bits of the rungs to change: raised ones that are clear, and others that hold.

    Where stick-slip is not predicted the amplitude of its cycle is forgotten.

    Args:
        s: The memory, changed.
        c: The numbers of the configuration.
        near: Whether caution is asked for.
        wide: Whether caution that stands is kept.
        inside: Whether the point is in the bistable range.
    """
    running = s.sticking == 1
    holds, keeps = 0, 0
    # A rise of the level raises it, and it stays for as long as the level is high.
    is_raised = s.raised & (1 << VIBRATION) > 0
    if has_valid_level(s, c) and not running and is_above_threshold(s, c, is_raised):
        keeps = 1 << VIBRATION
        holds = keeps if s.vibrating == VIBRATING else 0
    if near:
        holds |= 1 << CAUTION
    if wide:
        keeps |= 1 << CAUTION
    if inside or running:
        holds |= 1 << BISTABLE
        keeps |= 1 << BISTABLE
    if running:
        holds |= 1 << STICK_SLIP
        keeps |= 1 << STICK_SLIP
    else:
        s.amplitude, s.sized = 0.0, NEVER
    if s.amplitude > c.amplitude_limit:
        holds |= 1 << AMPLITUDE
    if s.amplitude >= c.amplitude_off:
        keeps |= 1 << AMPLITUDE
    s.asks = (s.raised & ~keeps) | (holds & ~s.raised)


def count_elapsed(s: State, c: RuleNumbers, until: int) -> bool:
    """Count the time since the latest point, while its values stood, for growth and for every rung.

    ``until`` is the time until which they stood [ns]. After a loss longer than the off-delay, medians and
    means start again from the latest values, and of a bistable bearing only stick-slip that stands is known.

    Returns:
        Whether there was such a loss: then this point decides at once.
    """
    if s.point == NEVER:
        return False
    # Before a restart nobody knows what passed.
    passed = max(0, min(s.now, until) - s.point) if s.point >= s.began else 0
    integrate_growth(s, passed)
    for rung in range(RUNGS):
        s.count[rung] = max(0, s.count[rung] + (passed if s.asks & (1 << rung) else -passed))
    if s.now - s.point - passed <= c.off_delay:
        return False
    s.known = s.sticking
    for place in range(LEVEL):
        s.before[place] = s.earlier[place] = math.nan
    s.fast = s.slow = s.value[SPEED]
    s.load_mean = s.value[LOAD]
    return True


def scale_of(s: State, c: RuleNumbers, load: float) -> float:
    """Return ``s`` of :mod:`stickslip_monitor.physics.lubrication` at a load [N] in the latest water.

    The model is known for friction as measured, at the speed and the load over ``s``.
    """
    return scale_at(c.at_load, c.load_exponent, s.viscosity_ratio, load)


def reach(
    s: State, c: RuleNumbers, model: Model, size: float, place: float, scale: float
) -> tuple[float, bool, bool, bool, bool]:
    """Judge a point by the boundaries, or by the probabilities where these decide, and update these.

    Args:
        s: The memory, whose probabilities change where there is a belief.
        c: The numbers of the configuration.
        model: The law, the tables of the boundaries and of the belief.
        size: Magnitude of the speed [m/s].
        place: Where the load over the scale lies in the table of the boundaries.
        scale: That of :func:`scale_of`.

    Returns:
        The fold [m/s], 0 for none; then whether the point is so near that caution is asked for, is within
        the range in which it is kept, is in the bistable range, and whether a cycle exists.
    """
    _, table, belief = model
    limit = scale * boundary_at(table[0], c.table_growth[0], place)
    if c.has_belief:
        # What is known of the averaged fold is known of the one that decides.
        kbm = scale * boundary_at(table[1], c.table_growth[1], place)
        share = kbm / limit if 0.0 < kbm < math.inf and 0.0 < limit < math.inf else 1.0
        lagging = scale_of(s, c, s.load_mean) if c.load_exponent else scale
        s.can, s.will = stick_slip_probabilities(belief, size / lagging, s.load_mean / lagging, share)
        s.runs = update_running_probability(s.runs, s.can, s.will)
    if not c.by_chance:
        inside = size < limit
        return limit, size < limit * c.caution_on, size <= limit * c.caution_off, inside, inside
    near = s.can > c.caution_chance
    return limit, near, near, s.can > c.can_chance, s.can >= c.runs_chance


def is_amplitude_due(s: State, c: RuleNumbers) -> bool:
    """Return whether the amplitude of the cycle is due: each second of stick-slip, where it has a limit.

    Whoever takes samples computes it, by the exact cycle at :func:`median_point`: that costs a hundred times
    what the rest does. Where no cycle exists any more the last amplitude stands until stick-slip has ended.
    """
    needed = s.sticking == 1 and c.amplitude_limit < math.inf
    return needed and (s.sized == NEVER or s.now - s.sized >= SIZED)


def is_turning(s: State) -> bool:
    """Return whether the shaft turns under load, by the latest values and not by medians."""
    return s.value[SPEED] != 0.0 and s.value[LOAD] > 0.0


def median_point(s: State) -> tuple[float, float]:
    """Return the speed [m/s] and the load [N] that decide: medians of the latest three values."""
    speed = median_of_three(s.value[SPEED], s.before[SPEED], s.earlier[SPEED])
    return speed, median_of_three(s.value[LOAD], s.before[LOAD], s.earlier[LOAD])


def growth_rate(c: RuleNumbers, law: Numbers, speed: float, load: float, scale: float) -> float:
    """Return the growth rate of a small disturbance, ``(-N mu'(V) - c)/2m`` [1/s].

    It is for a surface speed of either sign [m/s] and a load [N], of which ``scale`` is :func:`scale_of`. At
    rest or without load it is that of damping alone. The load counts ``c.lean`` times, 1 where margins
    decide.
    """
    drive = 0.0
    if speed != 0.0 and load > 0.0:
        drive = -load / scale * friction_slope(law, speed / scale) * c.lean
    return (drive - c.damping) * c.per_mass


def comes(s: State, c: RuleNumbers, speed: float, ends: tuple[float, float]) -> bool:
    """Return whether the speed, on its slope, comes into the range with a cycle within the look-ahead.

    From above, a speed that leads through the range to its other side counts too; from below it must
    end within the range.

    Args:
        s: The memory, with the means of the speed.
        c: The numbers of the configuration.
        speed: The present speed, negative astern [m/s].
        ends: Lower and upper end of the range in which a cycle exists [m/s]; an upper one of 0: none.
    """
    slope = (s.fast - s.slow) / (SLOW_LAG - FAST_LAG)
    future = speed + slope * c.look_ahead
    future = future if speed > 0.0 else -future
    lower, limit = ends
    return limit > 0.0 and max(future, abs(speed)) >= lower and future < limit


def integrate_growth(s: State, passed: int) -> None:
    """Add the growth of a disturbance over a time [ns], or while sticking count the time towards its end."""
    if s.sticking:
        # Only where a cycle exists does it grow again: an input that drops out keeps none alive.
        again = passed if s.course == WITHIN else 0
        s.dying = max(0, s.dying + (passed if s.course == BEYOND else -again))
        s.idle = max(0, s.idle + (passed if s.course == IDLE else -again))
        return
    s.growth = max(0.0, s.growth + s.rate * passed * 1e-9)


def update_stick_slip(s: State, c: RuleNumbers, verdict: int, fresh: bool) -> None:
    """Begin or end stick-slip at this point.

    Changes in the memory whether it stands, its course, its growth, the number of onsets, the times towards
    its end, what the level has said while it stood, and that its course is known.

    Args:
        s: The memory, changed.
        c: The numbers of the configuration.
        verdict: State of the level; ``UNKNOWN`` where it does not count at this point.
        fresh: Whether this is the first point after a gap, which ends it at once unless a cycle exists here.
    """
    if verdict == VIBRATING:
        s.course = WITHIN
    elif verdict == QUIET and s.heard and s.rate <= 0.0 and s.course == WITHIN:
        s.course = IDLE
    if s.sticking:
        net, delay = (s.dying, c.decay) if s.course == BEYOND else (s.idle, c.off_delay)
        if s.course != WITHIN and (fresh or net >= delay):
            s.sticking, s.growth = 0, 0.0
    else:
        if s.course == BEYOND:
            s.known = 1
        if is_turning(s) and (has_grown(s, c) or (verdict == VIBRATING and has_begun(s))):
            begin_stick_slip(s, c)
    note_level(s, verdict)


def has_grown(s: State, c: RuleNumbers) -> bool:
    """Return whether a disturbance has grown enough for stick-slip, and grows still."""
    return s.rate > 0.0 and s.growth >= BORNE * c.onset_growth


def begin_stick_slip(s: State, c: RuleNumbers) -> None:
    """Begin stick-slip, and count it as an onset unless it is back before its alarm could clear.

    The times towards its end, and whether the level has risen, start anew.
    """
    raised = s.raised & (1 << STICK_SLIP)
    s.onsets += int(not raised or s.count[STICK_SLIP] >= c.off_delay)
    s.sticking = s.known = 1
    s.dying = s.idle = s.heard = 0


def note_level(s: State, verdict: int) -> None:
    """Note what a level says of stick-slip that is predicted: that it vibrates, or since when it is quiet.

    Where none is predicted that time is forgotten.

    Args:
        s: The memory, of which ``heard`` and ``unseen`` change.
        verdict: State of the level at this point.
    """
    if not s.sticking:
        s.unseen = NEVER
    elif verdict == VIBRATING:
        s.heard, s.unseen = 1, NEVER
    elif verdict == QUIET and s.unseen == NEVER:
        s.unseen = s.now


def update_rungs(s: State, c: RuleNumbers, fresh: bool) -> None:
    """Raise or clear the rungs that have been asked to change for long enough.

    Changes their bits in ``s.raised`` and ``s.asks``, ``s.count`` and ``s.cleared``. If ``fresh``, after a
    gap, rungs are cleared at once. At rest or without load none is raised but vibration.
    """
    if not s.asks:
        return
    resting = not is_turning(s)
    for rung in range(RUNGS):
        bit = 1 << rung
        if not s.asks & bit or (resting and rung > VIBRATION and not s.raised & bit):
            continue
        if s.count[rung] >= change_delay(s, c, rung) or (fresh and s.raised & bit):
            s.raised ^= bit
            s.asks ^= bit
            s.count[rung] = 0
            if not s.raised & bit:
                s.cleared[rung] = s.now
            elif s.cleared[rung] != NEVER and s.now - s.cleared[rung] >= HOLD * c.off_delay:
                s.cleared[rung] = NEVER


def change_delay(s: State, c: RuleNumbers, rung: int) -> int:
    """Return for how long a rung has to be asked for until it changes [ns].

    It is the on-delay to be raised, but nothing for stick-slip where growth is a delay of its own; to be
    cleared the off-delay, six of them for a rung that is held because it came back.
    """
    if s.raised & (1 << rung):
        return c.off_delay if s.cleared[rung] == NEVER else HOLD * c.off_delay
    return 0 if rung == STICK_SLIP and c.onset_growth > 0.0 else c.on_delay


def rung_of(s: State) -> int:
    """Return the index in ``LADDER`` of the worst raised rung, 0 for normal.

    The amplitude limit counts only above stick-slip.
    """
    top = 0
    if not s.raised:
        return top
    for rung in range(RUNGS):
        if s.raised & (1 << rung) and (rung != AMPLITUDE or top == STICK_SLIP + 1):
            top = rung + 1
    return top


def condition_index(s: State) -> int:
    """Return the index in ``CONDITIONS``: :func:`rung_of`, or that of a lost input."""
    return RUNGS + 1 if s.lost else rung_of(s)


def has_valid_level(s: State, c: RuleNumbers) -> bool:
    """Return whether a level is configured, has come and is not too old."""
    last = s.came[LEVEL]
    return bool(c.has_level and last != NEVER and s.now - last <= age_limit(s, c, LEVEL))


def may_be_foreign(s: State, c: RuleNumbers) -> bool:
    """Return whether what vibrates now can be neither stick-slip nor the end of one.

    The point is beyond the fold, stick-slip was cleared at least 15 s ago, and the level is not lost.
    """
    since = s.cleared[STICK_SLIP]
    ended = not s.raised & (1 << STICK_SLIP) and (since == NEVER or s.now - since >= SHORT)
    return s.course == BEYOND and not s.sticking and ended and has_valid_level(s, c)


def measured_now(s: State, c: RuleNumbers) -> int:
    """Return the state of the level at the latest point; ``UNKNOWN`` where it is lost or doubted."""
    return usable_state(s) if has_valid_level(s, c) else UNKNOWN
