# SPDX-License-Identifier: Apache-2.0
"""Orbits of the slip phase, followed from event to event, many at once.

An orbit turns where the lining's own velocity vanishes (relative speed ``w = 1``) and ends where
it meets the belt (``w = 0``) or is known to miss it. The contact is looked for only after the
turning point before it, on the polynomial of the step, so no step can jump over it. Whether there
is one is decided where the displacement passes the level at which the belt could just hold the
lining: there the kinetic energy, integrated along the orbit, tells hit from miss without the
cancellation of two nearly equal velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.cycle_laws import Index
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.rootfinding import secant_on_bracket
from stickslip_monitor.physics.slip import (
    NODES,
    SAMPLES,
    TOLERANCE,
    Motion,
    Step,
    at_samples,
    integral,
    solve_step,
    value,
)

Flags = NDArray[np.bool_]

_STEPS = 4000
_LONGEST, _SHORTEST = 1.0, 1e-13
_GROWTH, _SHRINK = 2.5, 0.2
# Share of the energy at the start below which an orbit that does not turn has come to rest.
_SETTLED = 1e-12
# Relative overshoot of an edge between smooth pieces that is rounding.
_ROUNDING = 1e-13


class End(IntEnum):
    """How an orbit ended."""

    EXHAUSTED = 0
    CONTACT = 1
    MISSED = 2
    RETURNED = 3
    SETTLED = 4


@dataclass(frozen=True, slots=True)
class Frame:
    """What an orbit starts from and what ends it.

    Turning points are counted by stages: in even stages the lining moves with the belt
    (``w < 1``), in odd ones against it.

    Attributes:
        drift: Of :class:`Motion`.
        first: Stage at the start.
        last: Stage whose beginning ends the orbit, as ``finish``.
        landing: Stage in which the lining can meet the belt.
        direction: 1, or -1 to go back in time.
        finish: How the orbit ended when the last stage began.
    """

    drift: float
    first: int
    last: int
    landing: int
    direction: float
    finish: End

    @property
    def reference(self) -> float:
        """Relative speed ``w`` at ``z = 0``."""
        return 1.0 if self.drift == 0.0 else 0.0


FORWARD = Frame(1.0, 0, 3, 2, 1.0, End.MISSED)
REVERSE = Frame(-1.0, 0, 9, 0, 1.0, End.MISSED)
AROUND = Frame(0.0, 2, 4, 2, 1.0, End.RETURNED)
BACKWARD = Frame(1.0, 0, 1, 9, -1.0, End.RETURNED)


@dataclass(frozen=True, slots=True)
class Setting:
    """What the orbits move in; every array has shape (n,).

    Attributes:
        motion: Their equations.
        piece: Smooth piece of the law at the start.
        edges: Speeds between the smooth pieces [m/s], ascending; ``None`` for a smooth law.
        speed: ``V`` [m/s].
        pull: Friction lost at steady sliding, ``rise`` at ``w = 1``.
        rest: Displacement of steady sliding.
        stable: Whether a small disturbance of steady sliding dies out.
        hold: Displacement above which the belt cannot catch the lining.
    """

    motion: Motion
    piece: Index
    edges: Array | None
    speed: Array
    pull: Array
    rest: Array
    stable: Flags
    hold: Array


@dataclass(slots=True)
class Orbits:
    """The orbits as far as they were followed; every array has shape (n,).

    Attributes:
        e: Displacement at the end.
        z: Relative speed at the end.
        h: Next step.
        piece: Smooth piece of the law.
        stage: Turning points passed.
        end: :class:`End`.
        time: Duration, negative backwards.
        work: Energy gained about steady sliding.
        divergence: Integral of the divergence of the flow (``AROUND`` only).
        crest: Displacement at the last turning point from above.
        trough: Displacement at the last turning point from below.
        margin: Signed distance from grazing: ``> 0`` where the lining met the belt.
        excess: Twice the kinetic energy at ``hold`` beyond the belt's, but for the work.
        quiet: Energy below which the orbit has settled.
        evaluations: Evaluations of the friction law, one for all nodes of a step together.
    """

    e: Array
    z: Array
    h: Array
    piece: Index
    stage: Index
    end: Index
    time: Array
    work: Array
    divergence: Array
    crest: Array
    trough: Array
    margin: Array
    excess: Array
    quiet: Array
    evaluations: Index


@dataclass(slots=True)
class Stretch:
    """An accepted step of some orbits, as Legendre series on [-1, 1], used up to ``stop``."""

    index: Index
    time: Array
    h: Array
    e: Array
    z: Array
    work: Array
    divergence: Array
    stop: Array = field(init=False)
    end: Index = field(init=False)

    def __post_init__(self) -> None:
        self.stop = np.ones(self.index.size)
        self.end = np.zeros(self.index.size, dtype=np.intp)


def follow(
    frame: Frame, setting: Setting, e: Array, z: Array, record: list[Stretch] | None = None
) -> Orbits:
    """Follow orbits until each has ended.

    Args:
        frame: What they start from and what ends them.
        setting: What they move in.
        e: Displacement at the start, shape (n,).
        z: Relative speed at the start, shape (n,).
        record: Takes every accepted step.
    """
    with np.errstate(over='ignore', invalid='ignore', under='ignore'):
        orbits = _begin(frame, setting, e, z)
        running = np.arange(e.size)
        for _ in range(_STEPS):
            if not running.size:
                break
            running = _advance(frame, setting, orbits, running, record)
    return orbits


def _begin(frame: Frame, setting: Setting, e: Array, z: Array) -> Orbits:
    n = e.size
    law = setting.motion.take(np.arange(n), setting.piece).law
    rate = np.abs(law.slope(z[:, None])[:, 0]) + 2.0 * setting.motion.damping
    y = frame.drift - z
    return Orbits(
        e=e.copy(),
        z=z.copy(),
        h=0.1 * frame.direction / (1.0 + rate),
        piece=setting.piece.copy(),
        stage=np.full(n, frame.first, dtype=np.intp),
        end=np.zeros(n, dtype=np.intp),
        time=np.zeros(n),
        work=np.zeros(n),
        divergence=np.zeros(n),
        crest=np.full(n, np.nan),
        trough=np.full(n, np.nan),
        margin=np.full(n, -1.0),
        excess=(e - setting.hold) * (e + setting.hold - 2.0 * setting.rest) + (y * y - 1.0),
        quiet=_SETTLED * ((e - setting.rest) ** 2 + y * y),
        evaluations=np.zeros(n, dtype=np.intp),
    )


def _advance(
    frame: Frame,
    setting: Setting,
    orbits: Orbits,
    running: Index,
    record: list[Stretch] | None,
) -> Index:
    """Try one step of every running orbit and return those that still run."""
    piece, h = orbits.piece[running], orbits.h[running]
    motion = setting.motion.take(running, piece)
    step = solve_step(motion, piece, orbits.e[running], orbits.z[running], h)
    orbits.evaluations[running] += step.iterations
    good = step.error <= TOLERANCE
    with np.errstate(divide='ignore'):
        factor = 0.9 * (TOLERANCE / step.error) ** (1.0 / NODES)
    factor = np.clip(factor, _SHRINK, np.where(good, _GROWTH, 0.6))
    orbits.h[running] = np.clip(h * factor, -_LONGEST, _LONGEST)
    keep = np.abs(orbits.h[running]) > _SHORTEST
    if good.any():
        stretch = _stretch(frame, setting, orbits, motion, step, running, good)
        keep[good] &= _pass_events(frame, setting, orbits, stretch)
        if record is not None:
            record.append(stretch)
    return running[keep]


def _stretch(
    frame: Frame,
    setting: Setting,
    orbits: Orbits,
    motion: Motion,
    step: Step,
    running: Index,
    good: Flags,
) -> Stretch:
    index, z = running[good], step.z[good]
    h, y = orbits_h = orbits.h[index], frame.drift - z
    del orbits_h
    damping = motion.damping[good][:, None]
    power = y * (setting.pull[index][:, None] - step.rise[good] - 2.0 * damping * y)
    return Stretch(
        index=index,
        time=orbits.time[index],
        h=h,
        e=integral(orbits.e[index], y, h),
        z=integral(orbits.z[index], step.rate[good], h),
        work=integral(orbits.work[index], power, h),
        divergence=power,
    )
