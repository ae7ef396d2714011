# SPDX-License-Identifier: Apache-2.0
"""The bearing: one mass on a spring and a damper, rubbed by the journal surface passing below it.

``m x'' + c x' + k x = N mu(V - x')`` with the journal's surface speed ``V`` and the load ``N``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from stickslip_logs.units import names_of, turning_factor
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.errors import PhysicsError, require_not_negative, require_positive
from stickslip_monitor.physics.friction import FrictionLaw
from stickslip_monitor.physics.lubrication import Lubrication, reference_point

TURNING_UNITS = names_of('turning')
SPEED_UNITS = (*TURNING_UNITS, 'm/s')
"""The units of a shaft's speed; in the last it is the speed of the journal's surface."""


@dataclass(frozen=True, slots=True)
class BearingSpeed:
    """Conversions between a shaft's rate of turning and its journal's surface speed.

    Args:
        journal_diameter: Diameter of the journal in the bearing, > 0 [m].

    Raises:
        PhysicsError: The diameter breaks its rule.

    >>> float(BearingSpeed(0.1).to_surface(60.0, 'rpm').round(6))  # pi D n
    0.314159
    """

    journal_diameter: float

    def __post_init__(self) -> None:
        require_positive('journal_diameter', self.journal_diameter, 'm')

    def factor(self, unit: str) -> float:
        """Return the surface speed [m/s] of one unit of shaft speed.

        Args:
            unit: ``'rpm'``, ``'rad/s'``, ``'Hz'`` (revolutions a second) or ``'m/s'``.

        Raises:
            PhysicsError: The unit is none of these.
        """
        if unit not in SPEED_UNITS:
            raise PhysicsError(f"speed unit '{unit}' is not one of {', '.join(SPEED_UNITS)}")
        return turning_factor(unit, self.journal_diameter) if unit in TURNING_UNITS else 1.0

    def to_surface(self, value: ArrayLike, unit: str) -> FloatArray:
        """Return the surface speeds [m/s] of shaft speeds in a unit, of their shape.

        Raises:
            PhysicsError: The unit is unknown.
        """
        return np.multiply(value, self.factor(unit))

    def from_surface(self, speed: ArrayLike, unit: str) -> FloatArray:
        """Convert surface speeds [m/s] to shaft speeds in ``unit``, of their shape.

        Raises:
            PhysicsError: The unit is unknown.
        """
        return np.divide(speed, self.factor(unit))


@dataclass(frozen=True, slots=True)
class Bearing:
    """A water-lubricated bearing as the mass-spring-belt model sees it.

    ``m x'' + c x' + k x = N mu(V - x')`` with the surface speed ``V`` and the load ``N``.

    Args:
        mass: Moving mass of the lining ``m`` > 0 [kg].
        damping: ``c`` >= 0 [N s/m].
        stiffness: ``k`` > 0 [N/m].
        friction: The friction law between lining and journal.
        journal_diameter: ``D`` > 0 [m].
        lubrication: The load and the water at which friction was measured; ``None`` where it depends on
            speed alone.

    Raises:
        PhysicsError: A quantity breaks its rule, or ``friction`` is not a friction law.

    >>> law = Stribeck(static=0.30, kinetic=0.10, decay=10.0)
    >>> own = Bearing(mass=50.0, damping=400.0, stiffness=2.0e6, friction=law, journal_diameter=0.1)
    >>> own.natural_frequency, own.damping_ratio  # rad/s and 1
    (200.0, 0.02)
    """

    mass: float
    damping: float
    stiffness: float
    friction: FrictionLaw
    journal_diameter: float
    lubrication: Lubrication | None = None

    def __post_init__(self) -> None:
        require_positive('mass', self.mass, 'kg')
        require_not_negative('damping', self.damping, 'N s/m')
        require_positive('stiffness', self.stiffness, 'N/m')
        require_positive('journal_diameter', self.journal_diameter, 'm')
        require_positive('sqrt(stiffness / mass)', self.natural_frequency, 'rad/s')
        if not isinstance(self.friction, FrictionLaw):
            raise PhysicsError(
                f'friction = {self.friction!r} must be a friction law: Stribeck, Coulomb or Tabulated'
            )

    @classmethod
    def from_torsional(
        cls,
        inertia: float,
        torsional_damping: float,
        torsional_stiffness: float,
        friction: FrictionLaw,
        journal_radius: float,
    ) -> Bearing:
        """Make a bearing without lubrication from the lining's torsional quantities about the shaft's axis.

        With ``x = R phi`` the moment balance ``J phi'' + c_t phi' + k_t phi = N mu R`` becomes
        the translational one with ``m = J/R^2``, ``c = c_t/R^2``, ``k = k_t/R^2``.

        Args:
            inertia: ``J`` > 0 [kg m^2].
            torsional_damping: ``c_t`` >= 0 [N m s/rad].
            torsional_stiffness: ``k_t`` > 0 [N m/rad].
            friction: The friction law between lining and journal.
            journal_radius: ``R`` > 0 [m].

        Raises:
            PhysicsError: A quantity breaks its rule, or ``friction`` is not a friction law.
        """
        require_positive('inertia', inertia, 'kg m^2')
        require_not_negative('torsional_damping', torsional_damping, 'N m s/rad')
        require_positive('torsional_stiffness', torsional_stiffness, 'N m/rad')
        require_positive('journal_radius', journal_radius, 'm')
        square = journal_radius * journal_radius
        return cls(
            mass=inertia / square,
            damping=torsional_damping / square,
            stiffness=torsional_stiffness / square,
            friction=friction,
            journal_diameter=2.0 * journal_radius,
        )

    @property
    def natural_frequency(self) -> float:
        """``omega = sqrt(k/m)`` [rad/s]."""
        return math.sqrt(self.stiffness / self.mass)

    @property
    def damping_ratio(self) -> float:
        """``zeta = c / (2 sqrt(k m))`` [-]."""
        # The product of two tiny numbers is 0.
        root = math.sqrt(self.stiffness * self.mass)
        return self.damping / (2.0 * (root or math.sqrt(self.stiffness) * math.sqrt(self.mass)))

    @property
    def momentum(self) -> float:
        """``m omega`` [kg/s]: the inertial force for each unit of velocity amplitude."""
        return self.mass * self.natural_frequency

    @property
    def speed(self) -> BearingSpeed:
        """Conversions between shaft speed and this bearing's surface speed."""
        return BearingSpeed(self.journal_diameter)

    def equilibrium(self, speed: ArrayLike, load: ArrayLike) -> FloatArray:
        """Return the deflection of steady sliding ``x_e = N mu(V) / k`` [m], of the broadcast shape.

        Args:
            speed: Journal surface speed ``V`` [m/s]; the deflection has its sign. At 0 it is the largest of
                sticking ahead.
            load: Bearing load ``N`` [N].
        """
        coefficient = self.friction.coefficient(reference_point(self, speed, load)[0])
        return np.asarray(load, dtype=float) * coefficient / self.stiffness

    def at_temperature(self, temperature: float) -> Bearing:
        """Return the bearing in water of a temperature [C]; itself where friction depends on speed alone.

        Raises:
            PhysicsError: The water temperature at which friction was measured is not known, or water of this
                one has no viscosity above 0.
        """
        lubrication = self.lubrication
        return self if lubrication is None else replace(self, lubrication=lubrication.in_water(temperature))


def damping_per_load(damping: float, load: FloatArray) -> FloatArray:
    """Return ``q = c/N`` [s/m], shape of ``load`` [N]; ``inf`` where the load is not positive, or ``nan``.

    numpy warns of a division by zero for a load of 0; the caller silences it.
    """
    return np.where(load > 0.0, damping / load, np.inf)


def balancing_load(fall: FloatArray, damping: float) -> FloatArray:
    """Return the load at which a fall of friction outweighs the damping [N], of the shape of ``fall``.

    Args:
        fall: Fall of friction with the speed, ``-mu'`` or a mean of it [s/m].
        damping: ``c`` >= 0 [N s/m].

    Returns:
        ``c/fall``, 0 without damping; ``nan`` where friction does not fall.
    """
    falling = fall > 0.0
    return np.where(falling, damping / np.where(falling, fall, 1.0), np.nan)
