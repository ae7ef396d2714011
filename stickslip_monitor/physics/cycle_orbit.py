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
    at_samples,
    integral,
    solve_step,
    value,
)

_STEPS = 4000
_LONGEST, _SHORTEST = 1.0, 1e-14
_SETTLED = 1e-12

Flags = NDArray[np.bool_]


class End(IntEnum):
    """How an orbit ended."""

    EXHAUSTED = 0, 'The step or their number reached its limit.'
    CONTACT = 1, 'The lining met the belt.'
    MISSED = 2, 'The lining turned back before it met the belt.'
    RETURNED = 3, 'The orbit came back to the turning point it started from.'
    SETTLED = 4, 'The orbit ran into steady sliding without turning.'

    sentence: str

    def __new__(cls, number: int, sentence: str) -> End:
        """Make a member from its number and its sentence."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.sentence = sentence
        return member


@dataclass(frozen=True, slots=True)
class Frame:
    """What an orbit starts from and what ends it.

    Turning points are counted by stages: in even stages the lining moves with the belt
    (``w < 1``), in odd ones against it.

    Attributes:
        drift: Of :class:`Motion`.
        first: Stage at the start.
        last: Stage whose beginning ends the orbit.
        landing: First stage in which the lining can meet the belt.
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
    def floor(self) -> float:
        """``z`` of the belt's speed."""
        return min(self.drift - 1.0, 0.0) if self.drift >= 0.0 else 0.0


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
        edges: Edges between the pieces, as speeds [m/s]; ``None`` for a smooth law.
        speed: ``V`` [m/s].
        pull: Friction lost at steady sliding, ``rise`` at ``w = 1``.
        rest: Displacement of steady sliding.
        stable: Whether a small disturbance of steady sliding dies out.
        hold: Displacement above which the belt cannot catch the lining.
        excess: ``y^2 - 1`` at ``hold`` of an orbit without friction and damping.
    """

    motion: Motion
    piece: Index
    edges: Array | None
    speed: Array
    pull: Array
    rest: Array
    stable: Flags
    hold: Array
    excess: Array


@dataclass(slots=True)
class Orbits:
    """The orbits as far as they were followed; every array has shape (n,) unless said.

    Attributes:
        end: :class:`End`.
        time: Duration, negative backwards.
        e: Displacement at the end.
        z: Relative speed at the end.
        work: Energy gained about steady sliding.
        divergence: Integral of the divergence of the flow (``AROUND`` only).
        crest: Displacement at the last turning point where it was greatest.
        trough: The same where it was least.
        margin: Signed distance from grazing: ``> 0`` where the lining met the belt.
        evaluations: Evaluations of the friction law, at all nodes of a step together.
    """

    e: Array
    z: Array
    h: Array
    stage: Index
    piece: Index
    end: Index
    time: Array
    work: Array
    divergence: Array
    crest: Array
    trough: Array
    margin: Array
    evaluations: Index


@dataclass(slots=True)
class Stretch:
    """One accepted step of some orbits, as polynomials on [-1, 1] cut off at ``stop``."""

    index: Index
    start: Array
    h: Array
    e: Array
    z: Array
    work: Array
    divergence: Array
    stop: Array = field(init=False)

    def __post_init__(self) -> None:
        self.stop = np.ones(self.index.size)


def _series(value_: Array) -> Array:
    return value_


def begin(frame: Frame, setting: Setting, e: Array, z: Array) -> Orbits:
    """Orbits at their start."""
    n = e.size
    column = z[:, None]
    slope = setting.motion.take(np.arange(n), setting.piece).law.slope(column)[:, 0]
    first = 0.1 * frame.direction / (1.0 + np.abs(slope) + 2.0 * setting.motion.damping)
    zeros = [np.zeros(n) for _ in range(4)]
    missing = [np.full(n, np.nan) for _ in range(2)]
    counts = [np.zeros(n, dtype=np.intp) for _ in range(2)]
    stage = np.full(n, frame.first, dtype=np.intp)
    return Orbits(
        e.copy(), z.copy(), first, stage, setting.piece.copy(), counts[0], *zeros[:3],
        *missing, zeros[3], counts[1],
    )  # fmt: skip
