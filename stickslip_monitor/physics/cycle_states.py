# SPDX-License-Identifier: Apache-2.0
"""What the orbits of the slip phase start from, move in and leave behind."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stickslip_monitor.physics.cycle_laws import Index
from stickslip_monitor.physics.friction import Array
from stickslip_monitor.physics.slip import Motion

Flags = NDArray[np.bool_]


class End(IntEnum):
    """How an orbit ended."""

    EXHAUSTED = 0  # the steps became too short or too many
    CONTACT = 1  # the lining met the belt
    MISSED = 2  # it turned back before
    RETURNED = 3  # it came back to the kind of turning point it started from
    SETTLED = 4  # it ran into steady sliding without turning
    ESCAPED = 5  # going back in time, it has left for good


@dataclass(frozen=True, slots=True)
class Frame:
    """What an orbit starts from and what ends it.

    Turning points are counted by stages: in even stages the lining moves with the belt
    (``w < 1``), in odd ones against it.

    Attributes:
        drift: Of :class:`Motion`.
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


FORWARD = Frame(1.0, 0, 3, 2, 1.0, End.MISSED)
REVERSE = Frame(-1.0, 0, 9, 0, 1.0, End.MISSED)
# Back in time an unstable cycle attracts, however fast it repels on the way forward.
AROUND = Frame(0.0, 1, 3, -1, -1.0, End.RETURNED)
BACKWARD = Frame(1.0, 0, 1, -1, -1.0, End.RETURNED)


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

    def take(self, index: Index | slice) -> Setting:
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
    energy: Array
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
