# SPDX-License-Identifier: Apache-2.0
"""A friction law whose parameters move in time."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.lab.scenes.profile import Profile
from stickslip_monitor.physics.friction import FrictionLaw, Tabulated

FACTOR = 'factor'
# Of the parameters of all laws, those that a common factor multiplies.
_COEFFICIENTS = ('static', 'kinetic', 'viscous')
STEP = 1.0


def parameters_of(law: FrictionLaw) -> tuple[str, ...]:
    """What may move: the law's own numbers, and a factor on the whole coefficient."""
    # The protocol does not say that a law is a dataclass; those a configuration can name are.
    own = () if isinstance(law, Tabulated) else tuple(f.name for f in fields(law))  # type: ignore[arg-type]
    return (*own, FACTOR)


def with_parameters(law: FrictionLaw, values: dict[str, float]) -> FrictionLaw:
    """A law with some parameters replaced, and then multiplied by the factor."""
    own = {name: value for name, value in values.items() if name != FACTOR}
    # A dataclass, as above.
    changed: Any = replace(law, **own) if own else law  # type: ignore[type-var]
    factor = values.get(FACTOR, 1.0)
    if isinstance(changed, Tabulated):
        return Tabulated(changed.speed, [factor * value for value in changed.values])
    names = [f.name for f in fields(changed) if f.name in _COEFFICIENTS]
    scaled: FrictionLaw = replace(changed, **{n: factor * getattr(changed, n) for n in names})
    return scaled


@dataclass(slots=True)
class FrictionCourse:
    """The friction law of one bearing over time.

    It moves in steps of one second, each with the values at its start, so that the integrator has
    one law at a time; the steps are too small to affect the motion.
    """

    law: FrictionLaw  # the law of the configuration
    drifts: dict[str, Profile] = field(default_factory=dict)  # by parameter, how it moves

    def at(self, time: float) -> FrictionLaw:
        """The law at a time since the scene's start [s]."""
        return with_parameters(self.law, self._values(time)) if self.drifts else self.law

    @property
    def moves(self) -> bool:
        """Whether anything but the factor moves."""
        return any(name != FACTOR for name in self.drifts)

    def shape_at(self, time: float) -> FrictionLaw:
        """The law at a time without the factor."""
        values = {name: value for name, value in self._values(time).items() if name != FACTOR}
        return with_parameters(self.law, values) if values else self.law

    def factor_at(self, time: FloatArray) -> FloatArray:
        """The factor at some times, shape (n,) [-]; friction is scaled by it as by the load."""
        if FACTOR not in self.drifts:
            return np.ones_like(time)
        return self.drifts[FACTOR].at(time // STEP * STEP)

    def _values(self, time: float) -> dict[str, float]:
        step = np.array([time // STEP * STEP])
        return {name: float(drift.at(step)[0]) for name, drift in self.drifts.items()}
