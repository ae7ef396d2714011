# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
import shared
from scipy.interpolate import pchip_interpolate

from stickslip_monitor.errors import PhysicsError, StickslipError
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated

TABLE = ((0.0, 0.05, 0.12, 0.3, 0.8), (0.31, 0.22, 0.24, 0.10, 0.13))
LAWS = shared.LAWS | {'table from above rest': Tabulated((0.1, 0.2, 0.5), (0.3, 0.2, 0.1))}
each_law = pytest.mark.parametrize('law', LAWS.values(), ids=LAWS)


@each_law
def test_friction_opposes_sliding_and_is_odd(law: FrictionLaw) -> None:
    """Require a passive law: ``v mu(v) >= 0`` and ``mu(-v) = -mu(v)`` (PHYSICS.md, the sgn)."""
    v = np.concatenate([np.geomspace(1e-300, 1e3, 400), TABLE[0][1:]])
    assert np.all(v * law.coefficient(v) >= 0.0)
    assert np.all(law.coefficient(v) > 0.0)
    np.testing.assert_array_equal(law.coefficient(-v), -law.coefficient(v))
    np.testing.assert_array_equal(law.slope(-v), law.slope(v))


@each_law
def test_slope_is_the_derivative(law: FrictionLaw) -> None:
    """Central difference of the coefficient, away from the points where a table bends."""
    v = np.linspace(0.0131, 0.9131, 91)
    h = 1e-6
    difference = (law.coefficient(v + h) - law.coefficient(v - h)) / (2.0 * h)
    np.testing.assert_allclose(law.slope(v), difference, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize('v', [1e-9, 0.01, 0.5, 3.0, 70.0])
def test_stribeck_is_the_law_of_the_specification(v: float) -> None:
    """PHYSICS.md's formula and its derivative at 40 digits, viscous rise added."""
    law = Stribeck(0.37, 0.11, 12.5, 0.03)
    s, k, beta, nu = (mp.mpf(x) for x in (law.static, law.kinetic, law.decay, law.viscous))
    value = k + (s - k) * mp.exp(-beta * mp.mpf(v)) + nu * mp.mpf(v)
    slope = nu - (s - k) * beta * mp.exp(-beta * mp.mpf(v))
    assert float(law.coefficient(v)) == pytest.approx(float(value), rel=4e-16)
    assert float(law.coefficient(-v)) == pytest.approx(-float(value), rel=4e-16)
    assert float(law.slope(v)) == pytest.approx(float(slope), rel=1e-13, abs=1e-16)


def test_coulomb_has_two_values_and_no_slope() -> None:
    """PHYSICS.md: mu_s for v = 0, mu_k for v != 0."""
    law = Coulomb(0.3, 0.1)
    np.testing.assert_array_equal(law.coefficient([0.0, 5e-324, -5e-324, 9.0]), [0.3, 0.1, -0.1, 0.1])
    np.testing.assert_array_equal(law.slope([0.0, 1.0]), [0.0, 0.0])


def test_table_is_scipys_monotone_cubic() -> None:
    """SciPy's own one-call interpolant, value and first derivative."""
    law, v = Tabulated(*TABLE), np.linspace(0.0, 0.8, 333)
    np.testing.assert_allclose(law.coefficient(v), pchip_interpolate(*TABLE, v), rtol=1e-14)
    np.testing.assert_allclose(law.slope(v), pchip_interpolate(*TABLE, v, der=1), atol=1e-12)


def test_table_claims_nothing_beyond_its_ends() -> None:
    law = Tabulated((0.1, 0.2, 0.5), (0.3, 0.2, 0.1))
    np.testing.assert_array_equal(law.coefficient([0.0, 0.05, 0.6, 1e300]), [0.3, 0.3, 0.1, 0.1])
    np.testing.assert_array_equal(law.slope([0.0, 0.05, 0.6, 1e300]), np.zeros(4))


@pytest.mark.parametrize('seed', range(5))
def test_slope_of_a_table_has_the_sign_of_its_rise(seed: int) -> None:
    """Fritsch and Carlson's property, and never a rounding's; a level stretch is level."""
    random = np.random.default_rng(seed)
    values = np.repeat(random.random(6), [1, 2, 1, 1, 3, 1])
    speed = np.cumsum(10.0 ** random.uniform(-3.0, 0.0, values.size))
    law = Tabulated(speed, values)
    for a, b, rise in zip(speed, speed[1:], np.sign(np.diff(values)), strict=False):
        slope = law.slope(np.linspace(a, b, 33)[1:-1])
        assert np.all(slope * rise >= 0.0)
        assert rise != 0.0 or not slope.any()


@pytest.mark.parametrize(
    ('name', 'value', 'rule'),
    [
        ('static', -0.1, 'static = -0.1 must not be negative'),
        ('kinetic', float('inf'), 'kinetic = inf must be a finite number'),
        ('decay', 0.0, 'decay = 0 must be greater than 0'),
        ('viscous', -0.5, 'viscous = -0.5 must not be negative'),
    ],
)
def test_stribeck_refuses_by_name_value_and_rule(name: str, value: float, rule: str) -> None:
    good = {'static': 0.3, 'kinetic': 0.1, 'decay': 10.0, 'viscous': 0.0}
    with pytest.raises(PhysicsError) as caught:
        Stribeck(**(good | {name: value}))
    assert str(caught.value) == rule
    assert isinstance(caught.value, StickslipError)
    assert isinstance(caught.value, ValueError)


def test_stribeck_refuses_a_slope_beyond_floats() -> None:
    with pytest.raises(PhysicsError, match=r'\(static - kinetic\) \* decay = inf s/m must be a fin'):
        Stribeck(1e200, 0.0, 1e200)


@pytest.mark.parametrize(
    ('speed', 'coefficient', 'words'),
    [
        ((0.0, 0.1), (0.3,), ('2 speeds', '1 coefficients', 'one coefficient for each speed')),
        ((0.1,), (0.3,), ('1 point', 'at least two')),
        ((0.0, 0.1, 0.1), (0.3, 0.2, 0.1), ('speed[2] = 0.1 m/s', 'rise strictly')),
        ((-0.1, 0.1), (0.3, 0.2), ('speed[0] = -0.1', 'must not be negative')),
        ((0.0, np.nan), (0.3, 0.2), ('speed[1] = nan', 'must be a finite number')),
        ((0.0, 0.1), (0.3, -0.2), ('coefficient[1] = -0.2', 'must not be negative')),
        ((0.0, 5e-324), (0.3, 0.2), ('too steep',)),
    ],
)
def test_table_refuses_by_name_value_and_rule(
    speed: tuple[float, ...], coefficient: tuple[float, ...], words: tuple[str, ...]
) -> None:
    with pytest.raises(PhysicsError) as caught:
        Tabulated(speed, coefficient)
    assert all(word in str(caught.value) for word in ('friction table', *words)), caught.value


def test_laws_are_values() -> None:
    """Equal laws compare and hash alike, so a table's boundaries can be remembered."""
    assert Tabulated(*TABLE) == Tabulated(list(TABLE[0]), np.array(TABLE[1]))
    assert hash(Tabulated(*TABLE)) == hash(Tabulated(*TABLE))
    assert Tabulated(*TABLE) != Tabulated(TABLE[0], TABLE[1][::-1])
    with pytest.raises(AttributeError):
        LAWS['stribeck'].static = 1.0  # type: ignore[misc]
