# SPDX-License-Identifier: Apache-2.0
"""The last speed at which a lining sticks at a load, and the least load at which it does at a speed.

At a load the speeds are scanned from the highest that friction can give downward, until slip meets the
belt again; a root in that bracket is the exact fold. At a speed the loads are tried upward. Averaging is
neither a guess nor a bound.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.physics import averaging
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.contact import Contact
from stickslip_monitor.physics.friction import speed_scales
from stickslip_monitor.physics.numerics import root_on_bracket
from stickslip_monitor.physics.scalar_law import law_bounds

# Slowest speed of a scan in units of the first scale of a law: below it friction is straight.
SLOWEST = 1e-3


def last_sticking_speed(contact: Contact, load: float) -> float:
    """Return the last speed, up to 1e140, at which the lining sticks at a load > 0 [N]; or ``nan`` [m/s]."""
    # The squares of larger speeds, and of their orbits, would be no numbers.
    top = min(contact.highest_speed(load), 1e140)
    slowest = SLOWEST * min(contact.scales[0], top)
    if not top > 0.0:
        return math.nan
    # A law in pieces may stick over 2 % of its last speeds only. Up to 1000 are tried, twelve at a time.
    ratio = max(1.06 if contact.is_smooth else 1.02, (top / slowest) ** 1e-3)
    speed = top * ratio ** np.arange(1.0, -13.0, -1.0)
    while speed[1] > slowest:
        speed, margin = _try_speeds(contact, load, speed)
        sticks = np.flatnonzero(margin > 0.0)
        if sticks.size and sticks[0] == 0:
            return top  # a bound that only the range of floats set
        if sticks.size:
            return _solve_fold(contact, load, speed[sticks[0] - 1 :][:2], margin[sticks[0] - 1 :][:2])
        speed = speed * (speed[-2] / speed[0])
    return math.nan


def _try_speeds(contact: Contact, load: float, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the margins at falling speeds, or at closer ones where the last that sticks lies between them.

    A range of speeds narrower than their distance shows in negative margins that rise towards it on both
    sides by more than what is missing to 0: there 15 speeds between are tried.

    Args:
        contact: The bearing's contact.
        load: Load [N].
        speed: Falling speeds, shape (n,) [m/s].

    Returns:
        Speeds, falling, and the margins there.
    """
    margin = contact.grazing_margin(speed, np.full(speed.size, load), contact.coarse)
    left, middle, right = margin[:-2], margin[1:-1], margin[2:]
    near = (middle < 0.0) & (middle >= left) & (middle >= right) & np.logical_and.accumulate(left <= 0.0)
    near &= -middle < np.maximum(middle - left, middle - right)
    for k in np.flatnonzero(near):
        closer = np.geomspace(speed[k], speed[k + 2], 17)
        inner = contact.grazing_margin(closer, np.full(closer.size, load), contact.coarse)
        if np.any(inner > 0.0):
            return closer, inner
    return speed, margin


def _solve_fold(contact: Contact, load: float, speed: FloatArray, margin: FloatArray) -> float:
    """Return the speed at which slip grazes the belt, between two at which it misses and meets it [m/s].

    Args:
        contact: The bearing's contact.
        load: Load [N].
        speed: The two speeds, shape (2,) [m/s].
        margin: The margins there, shape (2,).
    """

    def fine_margin(x: FloatArray) -> FloatArray:
        """Return the margins at ``ln V``; steps of 1e-13 give a fold to 1e-12."""
        return contact.grazing_margin(np.exp(x), np.full(x.size, load), 1e-13)

    (high, low), (missing, excess) = np.log(speed)[:, None], margin[:, None]
    return float(np.exp(root_on_bracket(fine_margin, low, high, (excess, missing))[0]))


class Grazing(NamedTuple):
    """Least loads at which slip grazes the belt at speeds, solved or guessed, shape (n,) each.

    Attributes:
        load: The loads [N]; of a guess ``nan`` for unknown.
        slope: The slope of the margin there in ``ln N``.
    """

    load: FloatArray
    slope: FloatArray


def least_sticking_loads(
    contact: Contact, speed: FloatArray, max_load: Any, guess: Grazing | None = None, error: float = 1e-5
) -> Grazing:
    """Return the least loads at which slip grazes the belt at speeds; friction must fall somewhere.

    By secants, until a bracket is halved instead.

    Args:
        contact: The bearing's contact.
        speed: ``V`` > 0, shape (n,) [m/s].
        max_load: Where the search ends, one for all speeds or of their shape [N].
        guess: Where to begin at each speed; ``None`` for the least loads at which the lining can stick.
        error: Error allowed in ``ln N``; below 1e-5 the orbits take finer steps.

    Returns:
        Loads, ``nan`` where none up to ``max_load`` grazes, or 60 rounds do not find it: there the slope has
        no meaning.
    """
    step_error = contact.coarse if error >= 1e-5 else contact.fine
    n, out = speed.size, np.full(speed.size, np.nan)
    with np.errstate(divide='ignore'):
        low, max_x = np.log(contact.least_loads(speed)), np.log(np.broadcast_to(max_load, n))
    x, slope = low.copy(), np.full(n, contact.decrement)
    # The slope of a first margin is known to a tenth: to 5 % as a rule, to 40 % far out. Between others it is
    # to 1 %, of a table of 1,000 points that scatters to 8 %.
    last_move = np.full(n, 0.1)
    if guess is not None:
        is_guessed = np.isfinite(guess.load)
        x = np.where(is_guessed, np.fmax(np.log(guess.load), low), low)
        slope, last_move = np.where(is_guessed, guess.slope, slope), np.where(is_guessed, 0.01, last_move)
    high, before, value_before = np.full((3, n), [[np.inf], [np.nan], [np.nan]])
    live = np.flatnonzero(x <= max_x)
    for _ in range(60):  # secants end within 12 rounds, halvings within 40
        if not live.size:
            break
        at, v = x[live], speed[live]
        value = contact.grazing_margin(v, np.exp(at), step_error)
        is_above = value > 0.0
        high[live] = np.where(is_above, np.minimum(high[live], at), high[live])
        low[live] = np.where(is_above, low[live], np.maximum(low[live], at))
        with np.errstate(all='ignore'):
            secant = (value - value_before[live]) / (at - before[live]) / contact.decrement
        # One that is not straight jumps: halve.
        is_straight = ((secant > 0.2) & (secant < 5.0)) | np.isnan(before[live])
        slope[live] = np.where(is_straight & np.isfinite(secant), secant * contact.decrement, slope[live])
        new = np.minimum(at + np.clip(-value / slope[live], -0.4, 0.4), max_x[live])
        halves = np.isfinite(high[live]) & ~(is_straight & (new > low[live]) & (new < high[live]))
        new = np.where(halves, 0.5 * (low[live] + high[live]), new)
        move = np.abs(new - at)
        # A secant leaves about the product of its step with the one before.
        is_done = (~halves & (move * last_move[live] < error)) | (high[live] - low[live] < error)
        is_beyond = ~is_above & (at >= max_x[live])
        before[live], value_before[live], last_move[live], x[live] = at, value, move, new
        solved = is_done & ~is_beyond
        out[live[solved]] = np.exp(new[solved])
        live = live[~(is_done | is_beyond)]
    return Grazing(out, slope)


def exact_fold(bearing: Bearing, load: FloatArray) -> FloatArray:
    """Return the last speed at which the lining sticks [m/s].

    Args:
        bearing: The bearing, with friction as measured.
        load: ``N`` > 0 and finite [N], shape (n,).

    Returns:
        ``nan`` where it sticks at no speed; ``inf`` where it sticks at every high speed; shape (n,).
    """
    use = law_bounds(bearing.friction)
    loads, back = np.unique(load, return_inverse=True)
    out = np.full(loads.size, np.nan)
    # Without a gain at any speed the flow contracts everywhere (Bendixson's criterion).
    falls = loads * use.fall > bearing.damping
    if bearing.damping == 0.0:  # whatever gains energy gains it at every load
        endless = np.asarray(averaging.fold_speed(bearing, loads)) == np.inf
        out[falls & (endless | (not speed_scales(bearing.friction)))] = np.inf
    rows = np.flatnonzero(falls & ~(out == np.inf))
    out[rows] = last_sticking_speeds(bearing, loads[rows])
    return out[back]


def last_sticking_speeds(bearing: Bearing, load: FloatArray) -> FloatArray:
    """Return the last speeds at which the lining sticks at loads [N], of a bearing with damping > 0 [m/s].

    The averaged fold where it is exact to 1e-10 (loads barely above the onset, slight forces), else solved.

    Returns:
        Shape of ``load``; ``nan`` where it sticks at none.
    """
    contact = Contact(bearing)
    slight, averaged = np.zeros(load.size, bool), np.full(load.size, np.nan)
    if contact.is_smooth and contact.falls_most_at_rest:
        averaged = np.asarray(averaging.fold_speed(bearing, load))
        # Orbits gain too little there to improve it.
        slight = load * contact.bounds.fall < 1.003 * bearing.damping
        gain = contact.decrement * (load * contact.bounds.fall / bearing.damping - 1.0)
        with np.errstate(all='ignore'):
            # Orbits have ``ln V`` to the rounding of a margin over the gain of a turn. Averaging, right to
            # the square of the force, is better where that is less. Measured for ``kappa`` 0.001 to 0.99:
            # 3e-15 of rounding; errors of averaging of up to 0.06 of the square, 1.0 for 0.001.
            force = contact.friction_gains[1][0] * load / (bearing.momentum * averaged)
            slight |= force * force * gain < 1e-14
    solved = [
        math.nan if skip else last_sticking_speed(contact, n)
        for skip, n in zip(slight, load.tolist(), strict=True)
    ]
    return np.where(slight, averaged, np.array(solved))


def deciding_fold(exact: FloatArray, averaged: FloatArray, sticking_end: FloatArray) -> FloatArray:
    """Return the fold that decides: the last speeds at which the lining sticks, or vibrates without.

    Where the averaged slope is highest below the sliding limit, a cycle lives on without sticking, up to the
    averaged fold. Close to the end of sticking it does by the same share as under averaging, whose errors
    in both ends are about the same. Ends 2 % apart are those of different cycles: there averaging has the end
    of the vibration. Of 900 loads of random tables it decides at 456: at 50 of these it is over 3 % above the
    last of 40 exact cycles, at none 3 % below. Those take 16 ms of a load, compiled; a table over the load
    has some 1,000.

    Args:
        exact: The last speeds at which the lining sticks at n loads, ``nan`` for none, shape (n,) [m/s].
        averaged: The averaged folds there, ``nan`` for none, shape (n,) [m/s].
        sticking_end: The last speeds at which it sticks under averaging, by :func:`.averaging.sticking_end`,
            ``nan`` for none, shape (n,) [m/s].

    Returns:
        Shape (n,) [m/s]; the averaged fold where the lining sticks at no speed.
    """
    with np.errstate(all='ignore'):
        factor = np.fmax(averaged / sticking_end, 1.0)
        factor = np.where(factor > 1.02, np.fmax(averaged / exact, 1.0), factor)
    return np.where(np.isnan(exact), averaged, exact * factor)
