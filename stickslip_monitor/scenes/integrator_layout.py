# SPDX-License-Identifier: Apache-2.0
"""Where the inner loops of the integrator keep what: places in their arrays, and their codes."""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import TypeAlias

from .integrator_roots import Vector

Counts: TypeAlias = MutableSequence[int]
Rows: TypeAlias = MutableSequence[Vector]

# body: the oscillator and the accuracy asked for
MASS, DAMPING, STIFFNESS, OMEGA, HOLD, TOLERANCE, LONGEST = range(7)
BODY = 7
# law: an exponential, or (CUBIC) cubics; both on the pieces between `edges`
KINETIC, GAP, DECAY, VISCOUS = range(4)
LAW = 4
# state: relative speed, and the time since the piece began in two parts
X, V, TIME, TIME_REST = range(4)
STATE = 4
# where: what is counted
PIECE, PHASE, LAW_PIECE, CURSOR, EVENTS, STEPS, EXPANSIONS, STALLED = range(8)
WHERE = 8
# options
ORDER, STEP_LIMIT, EVENT_LIMIT, WITH_ENERGY, CUBIC = range(5)
OPTIONS = 5
# sums of energy, and what rounding took from each
BELT, FRICTION, LOSS = 0, 2, 4
SUMS = 6
# rows of `work`, each of which holds one series
XS, VS, FS, MU, AUX, SQUARE, BELT_SPEED, LOAD, SCALED, SCRATCH = range(10)
WORK = 10

DONE, EVENTS_FULL, EXHAUSTED, NOT_FINITE = 0, 1, 2, 3
NOTHING, RELEASE_FORWARD, RELEASE_BACKWARD, CONTACT, UPPER_EDGE, LOWER_EDGE = 0, 1, 2, 3, 4, 5

STICK_DEGREE = 8
