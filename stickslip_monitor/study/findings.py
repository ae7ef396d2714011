# SPDX-License-Identifier: Apache-2.0
"""What was published on the stick-slip of a water-lubricated rubber bearing, computed again.

The published study averages the mass-spring-belt model (KBM) and sets the result beside numerical
integration. Here the numerical side is the exact non-smooth cycle, so each finding comes with the
error of averaging. The unstable branch is found twice: by the return map of the exact cycle, and
as published by integration in reverse time, in which a pure-slip unstable cycle attracts.

Here: what the findings are about, and the friction curves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.bifurcation import fold_speed, hopf_speed
from stickslip_monitor.physics.friction import Array, Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

REFERENCE = Bearing(
    mass=50.0,
    damping=400.0,
    stiffness=2.0e6,
    friction=Stribeck(static=0.30, kinetic=0.10, decay=10.0),
    journal_diameter=0.100,
)
"""The test-bench bearing of the docs, for which the findings hold."""
REFERENCE_RPM, REFERENCE_LOAD = 20.0, 1000.0

_CURVE_POINTS, _CURVE_ROOM = 400, 1.3


@dataclass(frozen=True, slots=True, eq=False)
class FrictionCurves:
    """Coulomb's law and the Stribeck law with the same static and kinetic coefficient.

    Attributes:
        speed: Relative speeds, rising, without 0, shape (n,) [m/s].
        stribeck: Coefficient, shape (n,) [-].
        coulomb: Coefficient, shape (n,) [-].
        static: Largest coefficient at rest [-].
        kinetic: Coefficient of Coulomb's law in motion [-].
        hopf_speed: Where damping just balances the fall of friction [m/s].
        hopf_coefficient: Coefficient there [-].
        hopf_slope: Slope of the Stribeck law there, ``-c/N`` [s/m].
    """

    speed: Array
    stribeck: Array
    coulomb: Array
    static: float
    kinetic: float
    hopf_speed: float
    hopf_coefficient: float
    hopf_slope: float

    def columns(self) -> dict[str, Array]:
        """The curves as the columns of a table, SI units."""
        return {
            'relative_speed [m/s]': self.speed,
            'stribeck_coefficient [-]': self.stribeck,
            'coulomb_coefficient [-]': self.coulomb,
        }


def stribeck_of(bearing: Bearing) -> Stribeck:
    """The Stribeck law of a bearing.

    Raises:
        PhysicsError: It has another law, for which the findings do not speak.
    """
    if not isinstance(bearing.friction, Stribeck):
        name = type(bearing.friction).__name__.lower()
        raise PhysicsError(f'friction law = {name} must be stribeck: the findings are about it')
    return bearing.friction


def check_point(bearing: Bearing, speed: float, load: float) -> None:
    """Check that stick-slip starts by itself at a point and ends at a higher speed.

    Args:
        bearing: The bearing.
        speed: Surface speed [m/s].
        load: Load [N].

    Raises:
        PhysicsError: The friction law or the point is none that the findings are about.
    """
    stribeck_of(bearing)
    fold, hopf = float(fold_speed(bearing, load)), float(hopf_speed(bearing, load))
    if not (math.isfinite(fold) and fold > 0.0):
        raise PhysicsError(
            f'load = {load:g} N has no fold: choose a bearing with damping and a load at which'
            ' friction falls faster than it damps'
        )
    if not 0.0 < speed < hopf:
        rpm = bearing.speed.factor('rpm')
        raise PhysicsError(
            f'speed = {speed / rpm:g} rpm must lie between 0 and the Hopf speed,'
            f' {hopf / rpm:.6g} rpm at {load:g} N: there stick-slip starts by itself'
        )


def friction_curves(bearing: Bearing, load: float) -> FrictionCurves:
    """The Coulomb and the Stribeck friction curve about zero relative speed.

    Args:
        bearing: The bearing; its Stribeck law gives both curves their coefficients.
        load: Load for the Hopf speed [N].
    """
    law = stribeck_of(bearing)
    hopf, fold = float(hopf_speed(bearing, load)), float(fold_speed(bearing, load))
    ahead = np.geomspace(1e-3, 1.0, _CURVE_POINTS // 2) * _CURVE_ROOM * fold
    speed = np.concatenate([-ahead[::-1], ahead])
    return FrictionCurves(
        speed=speed,
        stribeck=law.coefficient(speed),
        coulomb=Coulomb(law.static, law.kinetic).coefficient(speed),
        static=law.static,
        kinetic=law.kinetic,
        hopf_speed=hopf,
        hopf_coefficient=float(law.coefficient(hopf)),
        hopf_slope=float(law.slope(hopf)),
    )
