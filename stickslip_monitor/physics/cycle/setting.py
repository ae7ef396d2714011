# SPDX-License-Identifier: Apache-2.0
"""What the orbits of the slip phase start from, move in and leave behind.

The setting of the orbits at a point of a bearing, in units of ``V`` and ``1/omega``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from stickslip_monitor.arrays import BoolArray, FloatArray, IndexArray
from stickslip_monitor.physics.cycle.law import scaled, starting_piece, steepest_fall
from stickslip_monitor.physics.cycle.slip_step import SlipMotion
from stickslip_monitor.physics.oscillator import Bearing


class End(IntEnum):
    """How an orbit ended."""

    EXHAUSTED = 0  # the steps became too short or too many
    CONTACT = 1  # the lining met the belt
    MISSED = 2  # it turned back before
    RETURNED = 3  # it came back to the kind of turning point it started from
    SETTLED = 4  # it ran into steady sliding without turning
    ESCAPED = 5  # going back in time, it has left for good


@dataclass(frozen=True, slots=True)
class OrbitFrame:
    """What an orbit starts from and what ends it.

    Turning points are counted by stages: in even stages the lining moves with the belt
    (``w < 1``), in odd ones against it.

    Attributes:
        drift: Of :class:`SlipMotion`.
        first: Stage at the start.
        last: Stage whose beginning ends the orbit, as ``finish``.
        landing: Stage in which the lining can meet the belt; -1 if that is not looked for.
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


FORWARD = OrbitFrame(1.0, 0, 3, 2, 1.0, End.MISSED)
REVERSE = OrbitFrame(-1.0, 0, 9, 0, 1.0, End.MISSED)
# Back in time an unstable cycle attracts, however fast it repels on the way forward.
AROUND = OrbitFrame(0.0, 1, 3, -1, -1.0, End.RETURNED)
BACKWARD = OrbitFrame(1.0, 0, 1, -1, -1.0, End.RETURNED)


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

    motion: SlipMotion
    piece: IndexArray
    edges: FloatArray | None
    speed: FloatArray
    pull: FloatArray
    rest: FloatArray
    stable: BoolArray
    hold: FloatArray

    def take(self, index: IndexArray | slice) -> Setting:
        """The setting of some of the orbits."""
        every = np.arange(self.speed.size)[index]
        return Setting(
            motion=self.motion.take(every, self.piece[every]),
            piece=self.piece[every],
            edges=self.edges,
            speed=self.speed[every],
            pull=self.pull[every],
            rest=self.rest[every],
            stable=self.stable[every],
            hold=self.hold[every],
        )


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
        divergence: Integral of the divergence of the flow.
        crest: Displacement at the last turning point from above.
        trough: Displacement at the last turning point from below.
        margin: Signed distance from grazing: ``> 0`` where the lining met the belt.
        excess: Twice the kinetic energy at ``hold`` beyond the belt's, but for the work.
        energy: Energy about steady sliding at the start, twice.
        evaluations: Evaluations of the friction law, one for all nodes of a step together.
    """

    e: FloatArray
    z: FloatArray
    h: FloatArray
    piece: IndexArray
    stage: IndexArray
    end: IndexArray
    time: FloatArray
    work: FloatArray
    divergence: FloatArray
    crest: FloatArray
    trough: FloatArray
    margin: FloatArray
    excess: FloatArray
    energy: FloatArray
    evaluations: IndexArray


@dataclass(slots=True)
class Stretch:
    """An accepted step of some orbits, as Legendre series on [-1, 1], used up to ``stop``."""

    index: IndexArray
    time: FloatArray
    h: FloatArray
    e: FloatArray
    z: FloatArray
    work: FloatArray
    divergence: FloatArray
    stop: FloatArray = field(init=False)
    end: IndexArray = field(init=False)

    def __post_init__(self) -> None:
        self.stop = np.ones(self.index.size)
        self.end = np.zeros(self.index.size, dtype=np.intp)


# Beyond this friction force, in units of m omega V, the numbers run out.
_GREATEST = 1e150


def setting(bearing: Bearing, speed: FloatArray, load: FloatArray, frame: OrbitFrame) -> Setting:
    """What the orbits of a frame move in.

    Args:
        bearing: The bearing.
        speed: ``V`` > 0 [m/s], shape (n,).
        load: ``N`` > 0 [N], shape (n,).
        frame: Of the orbits.
    """
    every = np.arange(speed.size)
    force = friction_force(bearing, speed, load)
    damping = np.full(speed.size, bearing.damping_ratio)
    breakaway = scaled(bearing.friction, force, speed, 0.0)
    steady = breakaway.take(every, starting_piece(breakaway, speed, 1.0))
    one = np.ones((speed.size, 1))
    pull, slope = steady.rise(one)[:, 0], steady.slope(one)[:, 0]
    rest, hold = 2.0 * damping - pull, -breakaway.jump
    around = frame.drift == 0.0
    law = scaled(bearing.friction, force, speed, 1.0) if around else breakaway
    return Setting(
        motion=SlipMotion(law, damping, frame.drift),
        piece=starting_piece(breakaway, speed, frame.reference),
        edges=law.pieces,
        speed=speed,
        pull=np.zeros_like(pull) if around else pull,
        rest=np.zeros_like(rest) if around else rest,
        stable=slope < 2.0 * damping,
        hold=hold - rest if around else hold,
    )


def friction_force(bearing: Bearing, speed: FloatArray, load: FloatArray) -> FloatArray:
    """``N / (m omega V)``; ``inf`` where that is beyond the numbers, shape (n,)."""
    with np.errstate(over='ignore'):
        return load / (bearing.mass * bearing.natural_frequency * speed)


def can_gain(bearing: Bearing, load: FloatArray) -> BoolArray:
    """Whether friction falls faster than damping rises at any speed, shape (n,).

    Where it does not, the flow contracts everywhere and has no cycle (Bendixson's criterion).
    """
    drive = np.asarray(steepest_fall(bearing.friction))
    gains: BoolArray = np.where(load > 0.0, load * drive, 0.0) > bearing.damping
    return gains


def runnable(bearing: Bearing, speed: FloatArray, load: FloatArray) -> IndexArray:
    """The points at which there can be a cycle, and numbers to compute it with."""
    small = friction_force(bearing, speed, load) < _GREATEST
    return np.flatnonzero(can_gain(bearing, load) & small)
