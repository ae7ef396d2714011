# SPDX-License-Identifier: Apache-2.0
"""Where the energy of a motion came from and where it went."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Energy:
    """The energy accounts of a motion, each from its own integral over the motion.

    With the friction force ``F`` on the lining, ``d/dt (m x'^2 + k x^2)/2 = F x' - c x'^2``, and
    the belt's work ``F V`` is that on the lining and the heat ``F v``.

    Attributes:
        belt_work: ``integral F V dt``: work of the journal surface [J].
        friction_work: ``integral F x' dt``: work of friction on the lining [J].
        damping_loss: ``integral c x'^2 dt`` >= 0 [J].
        stored_before: Kinetic and spring energy at the begin [J].
        stored_after: The same at the end [J].
    """

    belt_work: float
    friction_work: float
    damping_loss: float
    stored_before: float
    stored_after: float

    @property
    def friction_heat(self) -> float:
        """``integral F v dt`` >= 0: heat in the contact [J]."""
        return self.belt_work - self.friction_work

    @property
    def stored_change(self) -> float:
        """Change of kinetic and spring energy [J]."""
        return self.stored_after - self.stored_before

    @property
    def closure(self) -> float:
        """What the balance misses, relative to what was exchanged and stored [-].

        It says nothing where that is rounding, as for a lining at rest without load.
        """
        missing = abs(self.friction_work - self.damping_loss - self.stored_change)
        turned = abs(self.friction_work) + self.damping_loss
        scale = turned + self.stored_before + self.stored_after
        if not scale < math.inf:
            return math.inf
        return missing / scale if scale > 0.0 else 0.0


def stored_energy(mass: float, stiffness: float, displacement: float, velocity: float) -> float:
    """``(m x'^2 + k x^2)/2`` [J] of displacement [m] and velocity [m/s]."""
    return 0.5 * (mass * velocity * velocity + stiffness * displacement * displacement)
