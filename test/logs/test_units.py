# SPDX-License-Identifier: Apache-2.0
"""Units: factors by published values, and no spelling of two."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from stickslip_logs.units import (
    UNITS,
    affine_conversion,
    conversion,
    factors_of,
    find_unit,
    names_of,
    turning_factor,
)


def test_factors_are_those_of_the_si_brochure() -> None:
    # The SI brochure (9th edition) and NIST SP 811 give them exactly.
    assert factors_of(*names_of('force')) == {
        'N': 1.0,
        'kN': 1e3,
        'MN': 1e6,
        'tf': 9806.65,
        't': 9806.65,
        'lbf': 4.4482216152605,
    }
    assert factors_of('g', 'um', 'cm2', 'MPa') == {'g': 9.80665, 'um': 1e-6, 'cm2': 1e-4, 'MPa': 1e6}


@pytest.mark.parametrize(('name', 'per_turn'), [('rpm', 60.0), ('Hz', 1.0), ('rad/s', math.tau)])
def test_one_turn_a_second_moves_the_surface_by_the_circumference(name: str, per_turn: float) -> None:
    """Turn a journal of 0.3 m."""
    assert turning_factor(name, 0.3) * per_turn == pytest.approx(math.pi * 0.3, rel=1e-15)


def test_a_spelling_is_of_one_unit() -> None:
    """Count spellings and names."""
    names = Counter(unit.name for unit in UNITS)
    spellings = Counter(text for unit in UNITS for text in {*unit.spellings.split()})
    assert {*names.values(), *spellings.values()} == {1}


@pytest.mark.parametrize(
    ('text', 'name'),
    [('[kN]', 'kN'), ('KN', 'kN'), ('R / min', 'rpm'), ('(m s-1)', 'm/s'), ('knots', None), ('', None)],
)
def test_units_are_found_as_they_are_written(text: str, name: str | None) -> None:
    """Find a unit in brackets, in any case, with blanks."""
    unit = find_unit(text)
    assert (unit.name if unit else None) == name


def test_a_letter_is_a_force_only_beside_one() -> None:
    # A bare t is a time, mN are millinewtons, and tonnes are a mass.
    assert [find_unit(text) for text in ('t', 'mN', '[tonnes]')] == [None, None, None]
    unit = find_unit('[t]', 'force')
    assert unit is not None
    assert unit.name == 't'


@pytest.mark.parametrize(
    ('text', 'quantity', 'name'),
    [
        ('[T]', 'force', 't'),
        ('°f', 'temperature', 'F'),
        ('DegC', 'temperature', 'C'),
        ('PERCENT', 'coefficient', '%'),
    ],
)
def test_a_unit_beside_its_quantity_is_found_in_any_case(text: str, quantity: str, name: str) -> None:
    unit = find_unit(text, quantity)
    assert unit is not None
    assert unit.name == name
    assert find_unit(text) is None


def test_units_are_converted_within_a_quantity_only() -> None:
    """1 Hz is 60 rpm; a unit that is none measures nothing."""
    assert conversion('Hz', 'rpm') == pytest.approx(60.0, rel=1e-15)
    assert conversion('rpm', 'rad/s') == pytest.approx(math.tau / 60.0, rel=1e-15)
    assert conversion('N', 'kN') == 1e-3
    assert [conversion('N', 'rpm'), conversion('', 'N'), conversion('stone', 'N')] == [None, None, None]


@pytest.mark.parametrize(('celsius', 'fahrenheit', 'kelvin'), [(0.0, 32.0, 273.15), (100.0, 212.0, 373.15)])
def test_water_freezes_and_boils_on_every_scale(celsius: float, fahrenheit: float, kelvin: float) -> None:
    # A factor alone converts none of them to another.
    scales = {'C': celsius, 'F': fahrenheit, 'K': kelvin}
    for name, value in scales.items():
        for target, expected in scales.items():
            ratio, shift = affine_conversion(name, target) or (math.nan, math.nan)
            assert value * ratio + shift == pytest.approx(expected, abs=1e-10)
            assert (conversion(name, target) is None) == (name != target)


def test_a_letter_is_a_temperature_only_beside_one() -> None:
    """C may be coulombs, K a thousand, F farads."""
    assert [find_unit(text) for text in ('[C]', 'K', 'F')] == [None, None, None]
    assert [getattr(find_unit(text, 'temperature'), 'name', None) for text in ('[C]', '°C', 'K', 'degF')] == [
        'C',
        'C',
        'K',
        'F',
    ]
