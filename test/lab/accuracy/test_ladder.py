# SPDX-License-Identifier: Apache-2.0
"""The ladder as a whole: one interface, everything told, nothing that raises or warns."""

from __future__ import annotations

import math

import pytest

from stickslip_monitor.commands.accuracy import follow
from stickslip_monitor.lab.accuracy.cases import BASE, CASES, REFERENCE_BEARING, ladder
from stickslip_monitor.lab.accuracy.method import MethodOutcome, solve
from stickslip_monitor.physics.friction import Coulomb, Stribeck
from stickslip_monitor.physics.oscillator import Bearing

pytestmark = pytest.mark.filterwarnings('error')
METHODS = ladder(follow)
LIGHT = [method for method in METHODS if not method.slow]


def test_every_method_says_what_it_is():
    for method in METHODS:
        assert method.name
        assert method.practice.endswith('.')
        assert len(method.source) > 10
        assert method.points >= 1


def test_names_are_unique_and_the_base_is_among_them():
    names = [method.name for method in METHODS]
    assert len(set(names)) == len(names)
    assert BASE.name in names


@pytest.mark.slow
@pytest.mark.parametrize('method', LIGHT, ids=lambda m: m.name)
def test_where_there_is_no_cycle_no_method_invents_one(method):
    # Twice the fold speed: steady sliding only.
    result = solve(method, REFERENCE_BEARING, 0.43, 1000.0)
    assert not result.amplitude > 0.0
    assert result.outcome is not MethodOutcome.CYCLE
    assert result.sentence.strip()


def test_points_without_meaning_are_refused_with_a_sentence():
    for method in LIGHT:
        for speed, load in [(0.0, 1e3), (-0.1, 1e3), (0.1, 0.0), (math.inf, 1e3)]:
            result = solve(method, REFERENCE_BEARING, speed, load)
            assert result.outcome is MethodOutcome.REFUSED
            assert math.isnan(result.amplitude)
            assert 'above 0' in result.sentence or 'law' in result.sentence


def test_who_refuses_which_law():
    cubic = CASES[-1].bearing
    coulomb = Bearing(50.0, 400.0, 2.0e6, Coulomb(0.3, 0.1), 0.1)

    def refusing(bearing: Bearing) -> set[str]:
        return {m.family for m in METHODS if m.refusal(bearing, 0.1, 1000.0)}

    assert refusing(REFERENCE_BEARING) == {'Thomsen and Fidlin'}
    assert refusing(cubic) == {'KBM, polynomial', 'event-driven integrator', 'surface'}
    assert refusing(coulomb) == {'KBM, polynomial', 'Thomsen and Fidlin', 'harmonic balance'}


def test_friction_that_only_rises_drives_no_cycle():
    rising = Bearing(50.0, 400.0, 2.0e6, Stribeck(0.1, 0.3, 10.0), 0.1)
    for method in METHODS:
        if method.family in (
            'KBM',
            'slip perturbation',
            'harmonic balance',
            'exact cycle',
            'surface',
        ):
            assert solve(method, rising, 0.1, 1000.0).outcome is MethodOutcome.NO_CYCLE
