# SPDX-License-Identifier: Apache-2.0
"""Orbits that are not followed, against the same followed."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip_monitor import Bearing, Stribeck, Tabulated
from stickslip_monitor.physics import orbits
from stickslip_monitor.physics.orbits import EXHAUSTED, RESTED, Route, follow, slip_field

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
