# SPDX-License-Identifier: Apache-2.0
"""The events of an orbit of the slip phase, found on the polynomials of its steps.

An orbit turns where the lining's own velocity vanishes (relative speed ``w = 1``) and ends where
it meets the belt (``w = 0``) or is known to miss it. The contact is looked for only after the
turning point before it, on the polynomial of the step, so no step can jump over it. Whether there
is one is decided where the displacement passes the level at which the belt could just hold the
lining: there the kinetic energy, integrated along the orbit, tells hit from miss without the
cancellation of two nearly equal velocities.
"""

from __future__ import annotations

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.setting import End, OrbitFrame, Orbits, Setting, Stretch
from stickslip_monitor.physics.cycle.slip_step import SAMPLES, at_samples, value
from stickslip_monitor.physics.roots import root_on_bracket

# Share of the energy at the start below which an orbit that does not turn has come to rest.
_SETTLED = 1e-12
# Growth of energy, back in time, from which no orbit comes back; way beyond the belt, likewise.
_ESCAPED, _THROUGH = 1e12, 1e-3
# Displacement about steady sliding, in units of V/omega, to which energies count as well known.
_SMALL = 2.0
# Margin below which a parabola describes a grazing contact better than the step's polynomial.
_GRAZING = 1e-11
# Relative overshoot of an edge between smooth pieces that is rounding.
_ROUNDING = 1e-13


def pass_events(
    frame: OrbitFrame, setting: Setting, orbits: Orbits, stretch: Stretch
) -> BoolArray:
    """Cut the stretch at its events, move the orbits to its end, return which still run."""
    edge = np.full(stretch.index.size, np.nan)
    if setting.edges is not None:
        edge = _leave_piece(frame, setting, orbits, stretch)
    start = np.full(stretch.index.size, -1.0)
    if frame.drift >= 0.0:
        start = _turn(frame, orbits, stretch)
        _settle(frame, setting, orbits, stretch)
    _land(frame, setting, orbits, stretch, start)
    _move(frame, orbits, stretch, edge)
    running: BoolArray = stretch.end == 0
    return running


def _root(series: FloatArray, level: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Where series pass a level between two points; the nearer end where they do not."""
    below, above = value(low, series) - level, value(high, series) - level
    root = np.where(np.abs(above) < np.abs(below), high, low)
    change = below * above < 0.0
    if change.any():
        # Shifted away from zero, where a relative tolerance would ask for digits nobody needs.
        shifted = root_on_bracket(
            lambda x, rows, aim: value(x - 2.0, rows) - aim,
            low[change] + 2.0,
            high[change] + 2.0,
            (below[change], above[change]),
            (series[change], level[change]),
        ).value
        root[change] = shifted - 2.0
    return root


def _leave_piece(
    frame: OrbitFrame, setting: Setting, orbits: Orbits, stretch: Stretch
) -> FloatArray:
    """Stop where an orbit leaves its smooth piece; return ``z`` of that edge, or ``nan``."""
    assert setting.edges is not None
    piece, n = orbits.piece[stretch.index], stretch.index.size
    edges = np.concatenate([[-np.inf], setting.edges, [np.inf]])
    speed = setting.speed[stretch.index]
    low = edges[piece] / speed - frame.reference
    high = edges[piece + 1] / speed - frame.reference
    z = at_samples(stretch.z)
    slack = _ROUNDING * np.max(np.abs(z), axis=1)
    above = z > (high + slack)[:, None]
    outside = above | (z < (low - slack)[:, None])
    left: BoolArray = outside.any(axis=1)
    first = np.argmax(outside, axis=1)
    upward = above[np.arange(n), first]
    edge = np.where(left, np.where(upward, high, low), np.nan)
    before = np.where(first > 0, SAMPLES[first - 1], -1.0)
    where = np.flatnonzero(left)
    stretch.stop[where] = _root(
        stretch.z[where], edge[where], before[where], SAMPLES[first[where]]
    )
    orbits.piece[stretch.index[where]] += np.where(upward[where], 1, -1)
    return edge


def _turn(frame: OrbitFrame, orbits: Orbits, stretch: Stretch) -> FloatArray:
    """Note turning points; return where the stage at the end of the stretch begins."""
    start, index = np.full(stretch.index.size, -1.0), stretch.index
    beyond = value(stretch.stop, stretch.z) - frame.drift
    odd = orbits.stage[index] % 2 == 1
    turned = np.where(odd, beyond <= 0.0, beyond >= 0.0) & (stretch.stop > -1.0)
    where = np.flatnonzero(turned)
    if not where.size:
        return start
    level = np.full(where.size, frame.drift)
    start[where] = _root(stretch.z[where], level, start[where], stretch.stop[where])
    e = value(start[where], stretch.e[where])
    top = odd[where] == (frame.direction < 0.0)
    orbits.crest[index[where[top]]] = e[top]
    orbits.trough[index[where[~top]]] = e[~top]
    orbits.stage[index[where]] += 1
    last = where[orbits.stage[index[where]] >= frame.last]
    stretch.stop[last], stretch.end[last] = start[last], frame.finish
    return start


def _settle(frame: OrbitFrame, setting: Setting, orbits: Orbits, stretch: Stretch) -> None:
    """End orbits that will not turn any more."""
    index, running = stretch.index, stretch.end == 0
    u = value(stretch.stop, stretch.e) - setting.rest[index]
    z = value(stretch.stop, stretch.z)
    energy = u * u + (frame.drift - z) ** 2
    if frame.direction > 0.0:
        quiet = (energy <= _SETTLED * orbits.energy[index]) & setting.stable[index]
        stretch.end[running & quiet] = End.SETTLED
        return
    # A little beyond the belt the law's smooth continuation still tells the sign of the gain.
    through = z + frame.reference < -_THROUGH
    far = energy > _ESCAPED * (1.0 + orbits.energy[index])
    stretch.end[running & (through | far)] = End.ESCAPED


def _land(
    frame: OrbitFrame, setting: Setting, orbits: Orbits, stretch: Stretch, start: FloatArray
) -> None:
    """Look for the contact in the part of the stretch where there can be one."""
    landing = (orbits.stage[stretch.index] == frame.landing) & (stretch.end == 0)
    if frame.drift < 0.0:
        _land_behind(orbits, stretch, landing)
        return
    if not landing.any():
        return
    hold = setting.hold[stretch.index]
    late = landing & (value(stretch.stop, stretch.e) > hold)
    if late.any():
        _decide(setting, orbits, stretch, np.flatnonzero(late), start, hold)
    below = value(stretch.stop, stretch.z) < 0.0
    where = np.flatnonzero(landing & ~late & below)
    _touch(orbits, stretch, where, start, hold, np.zeros(where.size))


def _decide(
    setting: Setting,
    orbits: Orbits,
    stretch: Stretch,
    where: IndexArray,
    start: FloatArray,
    hold: FloatArray,
) -> None:
    """Hit or miss, where an orbit passes the level at which the belt could just hold it."""
    index = stretch.index
    rising = value(start[where], stretch.e[where]) <= hold[where]
    stretch.end[where[~rising]] = End.MISSED
    where = where[rising]
    if not where.size:
        return
    level = _root(stretch.e[where], hold[where], start[where], stretch.stop[where])
    z = value(level, stretch.z[where])
    gained = orbits.excess[index[where]] + 2.0 * value(level, stretch.work[where])
    # The energy of a motion far larger than the belt's is not known to the belt's digits.
    small = np.abs(orbits.trough[index[where]] - setting.rest[index[where]]) < _SMALL
    margin = np.where(small, gained, z * (z - 2.0))
    exact = -margin / (1.0 + np.sqrt(np.maximum(1.0 + margin, 0.0)))
    hit = np.where(small, exact, z) < 0.0
    stretch.stop[where] = level
    orbits.margin[index[where]] = np.maximum(margin, -1.0)
    stretch.end[where[~hit]] = End.MISSED
    # Beyond the contact a steep law magnifies rounding, which says nothing about the contact.
    shift = np.where(small & (np.abs(exact - z) < _GRAZING), exact - z, 0.0)
    graze = hit & small & ((margin < _GRAZING) | (z >= 0.0))
    _touch(orbits, stretch, where[hit & ~graze], start, hold, shift[hit & ~graze])
    # So close to grazing the time since the contact is known better than its place.
    where, margin = where[graze], margin[graze]
    stretch.stop[where] -= 2.0 * np.sqrt(margin) / stretch.h[where]
    stretch.end[where] = End.CONTACT


def _touch(
    orbits: Orbits,
    stretch: Stretch,
    where: IndexArray,
    start: FloatArray,
    hold: FloatArray,
    shift: FloatArray,
) -> None:
    """End orbits at the contact; ``shift`` corrects the relative speed by the energy."""
    if not where.size:
        return
    contact = _root(stretch.z[where], -shift, start[where], stretch.stop[where])
    stretch.stop[where] = contact
    stretch.end[where] = End.CONTACT
    e = value(contact, stretch.e[where])
    orbits.margin[stretch.index[where]] = (e - hold[where]) ** 2


def _land_behind(orbits: Orbits, stretch: Stretch, landing: BoolArray) -> None:
    """The contact of a lining that overtook the belt: always there, and never grazing."""
    where = np.flatnonzero(landing & (value(stretch.stop, stretch.z) < 0.0))
    if not where.size:
        return
    z = at_samples(stretch.z[where])
    # The orbit starts in contact: look beyond the sample where it is farthest from it.
    z = np.where(stretch.stop[where][:, None] >= SAMPLES, z, -np.inf)
    farthest = SAMPLES[np.argmax(z, axis=1)]
    # A later step may begin just before the contact, and the first one may see it at once.
    early = np.where(stretch.time[where] == 0.0, _early_top(stretch.z[where]), -1.0)
    start = np.where(value(early, stretch.z[where]) >= np.max(z, axis=1), early, farthest)
    stretch.stop[where] = _root(stretch.z[where], np.zeros(where.size), start, stretch.stop[where])
    stretch.end[where] = End.CONTACT
    orbits.margin[stretch.index[where]] = 1.0


def _early_top(series: FloatArray) -> FloatArray:
    """Where Legendre series have their maximum if that is next to -1: by the parabola there."""
    n = np.arange(series.shape[1])
    slope = series @ (-((-1.0) ** n) * n * (n + 1) / 2.0)
    bend = series @ ((-1.0) ** n * (n - 1) * n * (n + 1) * (n + 2) / 8.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        top = -1.0 - slope / bend
    return np.where((top > -1.0) & (top < SAMPLES[0]), top, -1.0)


def _move(frame: OrbitFrame, orbits: Orbits, stretch: Stretch, edge: FloatArray) -> None:
    index, stop = stretch.index, stretch.stop
    orbits.time[index] += 0.5 * stretch.h * (stop + 1.0)
    orbits.e[index] = value(stop, stretch.e)
    orbits.work[index] = value(stop, stretch.work)
    orbits.divergence[index] = value(stop, stretch.divergence)
    crossing = (stretch.end == 0) & np.isfinite(edge)
    z = np.where(crossing, edge, value(stop, stretch.z))
    orbits.z[index] = np.where(stretch.end == End.CONTACT, 0.0, z)
    orbits.end[index] = stretch.end
