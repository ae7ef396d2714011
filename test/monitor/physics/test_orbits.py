# SPDX-License-Identifier: Apache-2.0
"""Orbits that are not followed, against the same followed."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip_monitor import Bearing, Stribeck, Tabulated
from stickslip_monitor.physics import orbits
from stickslip_monitor.physics.friction import Stretched
from stickslip_monitor.physics.orbits import (
    EXHAUSTED,
    LANDED,
    RESTED,
    Route,
    follow,
    slip_field,
    start_on_manifold,
)

SPEEDS = np.append(0.0, np.geomspace(0.005, 1.5, 18))
NOISE = 0.004 * np.random.default_rng(7).standard_normal(19)
NOISY = Tabulated(SPEEDS, 0.1 + 0.2 * np.exp(-10.0 * SPEEDS) + NOISE)


@pytest.mark.parametrize('law', [Stribeck(0.3, 0.1, 10.0, 0.02), NOISY], ids=['viscous', 'noisy'])
@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_an_orbit_that_creeps_to_rest_needs_no_steps(law, direction, monkeypatch):
    """Slip from breakaway, and back in time what grazes the belt."""
    bearing = Bearing(50.0, 4e4, 2.0e6, law, 0.1)  # twice critical
    speed, load = (part.ravel() for part in np.meshgrid(np.geomspace(1e-3, 1.4, 7), [5e4, 1e6]))
    field = slip_field(bearing, speed, load)
    begin = np.zeros(speed.size) if direction > 0.0 else -field.offset
    arguments = field, begin, np.zeros(speed.size), Route(2, 1e-9, direction, max_steps=600)
    before = orbits._Effort.steps
    follow(*arguments)
    steps = orbits._Effort.steps - before
    creeping = orbits._creep_to_rest(*arguments[:3], np.full(speed.size, direction))
    monkeypatch.setattr(orbits, '_creep_to_rest', lambda *_: np.zeros(speed.size, bool))
    monkeypatch.setattr(orbits, 'PATIENCE', 10**7)
    ends = follow(*arguments).end
    assert creeping.any()
    assert np.isin(ends[creeping], (RESTED, EXHAUSTED)).all()
    assert (ends[~creeping] != RESTED).any()
    assert steps < orbits._Effort.steps - before - steps


def ends_of_slip(law, damping_ratio, speeds, loads):
    """Return whether slip begins on its manifold, and whether it then, and from breakaway, meets the belt."""
    bearing = Bearing(50.0, 2e4 * damping_ratio, 2.0e6, law, 0.1)
    speed, load = (part.ravel() for part in np.meshgrid(speeds, loads))
    field, nothing, route = slip_field(bearing, speed, load), 0.0 * speed, Route(3, 1e-11, contact=True)
    begin = start_on_manifold(field)
    ends = (follow(field, *start, route).end for start in (begin, (nothing, nothing)))
    return begin[1] > 0.0, *(end == LANDED for end in ends)


@pytest.mark.parametrize('law', [Stribeck(0.3, 0.1, 10.0), NOISY], ids=['Stribeck', 'noisy'])
def test_slip_that_begins_on_the_slow_manifold_meets_the_belt_as_slip_from_breakaway(law):
    begins, meets, whole = ends_of_slip(law, 4.0, np.geomspace(0.02, 0.5, 8), [8e4, 3e5])
    np.testing.assert_array_equal(meets, whole)
    assert np.count_nonzero(begins) > 3
    assert whole.any()
    assert not whole.all()


def test_slip_that_breaks_away_slowly_begins_on_the_slow_manifold():
    law = Stretched(0.3, 0.1, 10.0, 0.0, 1.5)
    begins, meets, whole = ends_of_slip(law, 4.0, np.geomspace(1e-3, 0.5, 8), [1e6])
    assert begins.all()
    np.testing.assert_array_equal(meets, whole)
    assert whole.any()


def test_slip_that_turns_farther_out_passes_below_a_manifold():
    """Between scattered points friction rises steeply; below critical damping slip swings past them."""
    speeds = np.append(0.0, np.geomspace(0.005, 1.5, 59))
    noise = 0.002 * np.random.default_rng(7).standard_normal(60)
    law = Tabulated(speeds, 0.1 + 0.2 * np.exp(-10.0 * speeds) + noise)
    _, meets, whole = ends_of_slip(law, 0.6, np.linspace(0.3, 0.8, 20), [4e5, 1.5e6])
    np.testing.assert_array_equal(meets, whole)
    assert whole.any()


def test_slip_that_turns_back_before_the_belt_has_missed_it():
    # A vibration that fades by a sixth in a turn: it was followed to its rest, in 643 steps.
    bearing = Bearing(1e-3, 400.0, 2.0e6, Stribeck(0.3, 0.1, 10.0), 0.1)
    field, nothing = slip_field(bearing, np.array([0.06479]), np.array([379.88])), np.zeros(1)
    before = orbits._Effort.steps
    assert follow(field, nothing, nothing, Route(3, 1e-11, contact=True)).end != LANDED
    assert orbits._Effort.steps - before < 100
