# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip_monitor.errors import PhysicsError
from stickslip_monitor.physics.bearing import Bearing, BearingSpeed
from stickslip_monitor.physics.friction import Stribeck

LAW = Stribeck(0.30, 0.10, 10.0)
BODY = {'mass': 50.0, 'damping': 400.0, 'stiffness': 2.0e6, 'journal_diameter': 0.1}
GOOD: dict[str, Any] = BODY | {'friction': LAW}


def test_equilibrium_balances_the_forces(reference: Bearing) -> None:
    """PHYSICS.md: ``x_e = N mu(V)/k``; the spring carries the friction, odd in the speed."""
    speed, load = np.array([[0.05], [0.2], [-0.2]]), np.array([300.0, 2000.0])
    x = reference.equilibrium(speed, load)
    assert x.shape == (3, 2)
    mu = np.sign(speed) * (0.1 + 0.2 * np.exp(-10.0 * np.abs(speed)))
    np.testing.assert_allclose(reference.stiffness * x, load * mu, rtol=1e-15)


@pytest.mark.parametrize(
    ('unit', 'value'), [('rpm', 60.0), ('Hz', 1.0), ('rad/s', 2.0 * np.pi), ('m/s', np.pi * 0.25)]
)
def test_one_turn_a_second_in_every_unit(unit: str, value: float) -> None:
    """PHYSICS.md: ``V = pi D n`` with n in revolutions per second."""
    speed = BearingSpeed(0.25)
    assert float(speed.to_surface(value, unit)) == pytest.approx(np.pi * 0.25, rel=1e-15)
    assert float(speed.from_surface(np.pi * 0.25, unit)) == pytest.approx(value, rel=1e-15)


def test_torsional_bearing_is_the_translational_one_at_the_surface() -> None:
    """``J phi'' + c_t phi' + k_t phi = N mu(V - R phi') R``, divided by R, with x = R phi."""
    bearing = Bearing.from_torsional(0.8, 1.5, 3000.0, LAW, 0.2)
    assert bearing.journal_diameter == pytest.approx(0.4)
    values = (bearing.mass, bearing.damping, bearing.stiffness)
    assert values == pytest.approx((0.8 / 0.04, 1.5 / 0.04, 3000.0 / 0.04))


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'mass': np.nan}, 'mass = nan kg must be a finite number'),
        ({'damping': -1.0}, 'damping = -1 N s/m must not be negative'),
        ({'stiffness': 0.0}, 'stiffness = 0 N/m must be greater than 0'),
        ({'journal_diameter': -0.1}, 'journal_diameter = -0.1 m must be greater than 0'),
        ({'mass': 1e300, 'stiffness': 1e-300}, 'sqrt(stiffness / mass) = 0 rad/s must be '),
        ({'mass': 1e-300, 'stiffness': 1e300}, 'sqrt(stiffness / mass) = inf rad/s must be '),
        ({'friction': 0.3}, 'friction = 0.3 must be a friction law: Stribeck, C'),
    ],
)
def test_bearing_refuses_by_name_value_and_rule(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(PhysicsError) as caught:
        Bearing(**(GOOD | changes))
    assert str(caught.value).startswith(sentence)
