# SPDX-License-Identifier: Apache-2.0
"""PathSim on the oscillator: two phases, switched by its own events."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pathsim import Simulation
from pathsim.blocks import ODE
from pathsim.events import ZeroCrossing, ZeroCrossingUp
from pathsim.solvers import RKCK54

from stickslip_lab.accuracy.methods import breakaway
from stickslip_monitor.physics.bearing import Bearing
from stickslip_monitor.physics.friction import Stribeck

_TOLERANCES = {'tolerance_lte_abs': 1e-9, 'tolerance_lte_rel': 1e-6}
_STEP, _NUDGE, _WATCHED = 1e-4, 1e-9, 0.6


class Oscillator:
    """The lining as a block with a flag that says whether it sticks.

    Args:
        bearing: The bearing, with the Stribeck law.
        speed: Surface speed [m/s].
        load: Load [N].
    """

    def __init__(self, bearing: Bearing, speed: float, load: float) -> None:
        assert isinstance(bearing.friction, Stribeck)
        self.bearing, self.law, self.speed, self.load = bearing, bearing.friction, speed, load
        self.start = breakaway(bearing, speed, load)
        self.sticks = False
        self.turns: list[tuple[float, float]] = []
        self.block = ODE(self._state_rate, np.array([self.start, speed]))

    def amplitude(self, duration: float) -> float:
        """Return half the peak-to-peak of the late part of a run [m]."""
        events = [
            ZeroCrossingUp(self._speed_excess, self._start_sticking, tolerance=1e-12),
            ZeroCrossingUp(self._force_excess, self._start_slipping, tolerance=1e-9),
            ZeroCrossing(lambda _: self._state[1], self._note_turn, tolerance=1e-10),
        ]
        simulation = Simulation([self.block], [], events, dt=_STEP, Solver=RKCK54, log=False, **_TOLERANCES)
        simulation.run(duration, adaptive=True)
        late_turns = [x for time, x in self.turns if time > _WATCHED * duration]
        return 0.5 * float(np.ptp(late_turns))

    @property
    def _state(self) -> NDArray[np.float64]:
        return self.block.engine.state

    def _state_rate(self, state: NDArray[np.float64], _: object, __: float) -> NDArray[np.float64]:
        x, v = state
        if self.sticks:
            return np.array([self.speed, 0.0])
        law, bearing = self.law, self.bearing
        drop = (law.static - law.kinetic) * math.exp(-law.decay * (self.speed - v))
        force = self.load * (law.kinetic + drop) - bearing.damping * v - bearing.stiffness * x
        return np.array([v, force / bearing.mass])

    def _speed_excess(self, _: float) -> float:
        return -1.0 if self.sticks else self._state[1] - self.speed

    def _force_excess(self, _: float) -> float:
        return self._state[0] - self.start if self.sticks else -1.0

    def _start_sticking(self, _: float) -> None:
        self.sticks = True
        self.block.engine.set(np.array([self._state[0], self.speed]))

    def _start_slipping(self, _: float) -> None:
        self.sticks = False
        self.block.engine.set(np.array([self.start, self.speed - _NUDGE]))

    def _note_turn(self, time: float) -> None:
        self.turns.append((time, float(self._state[0])))
