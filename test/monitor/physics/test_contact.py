# SPDX-License-Identifier: Apache-2.0
"""The margin by which slip meets the belt again, against slip that is followed to the belt."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_monitor import Bearing, Coulomb, Stribeck, Tabulated
from stickslip_monitor.physics.contact import Contact, meets_belt
from stickslip_monitor.physics.folds import least_sticking_loads
from stickslip_monitor.physics.friction import Stretched

SPEEDS = np.append(0.0, np.geomspace(0.01, 1.0, 12))
LAWS = {
    'Stribeck': Stribeck(0.3, 0.1, 10.0),
    'viscous': Stribeck(0.3, 0.1, 10.0, 0.05),
    'Gaussian': Stretched(0.3, 0.1, 10.0, 0.0, 2.0),
    'Coulomb': Coulomb(0.3, 0.1),
    'table': Tabulated(SPEEDS, 0.1 + 0.2 * np.exp(-10.0 * SPEEDS)),
}


@pytest.mark.parametrize('damping_ratio', [0.02, 0.4, 2.0])
@pytest.mark.parametrize('name', LAWS)
def test_a_margin_is_positive_where_slip_meets_the_belt(name, damping_ratio):
    bearing = Bearing(50.0, 2e4 * damping_ratio, 2.0e6, LAWS[name], 0.1)
    speed, load = (
        grid.ravel() for grid in np.meshgrid(np.geomspace(1e-3, 5.0, 9), np.geomspace(300, 2e5, 7))
    )
    margin = Contact(bearing).grazing_margin(speed, load, 1e-11)
    np.testing.assert_array_equal(margin > 0.0, meets_belt(bearing, speed, load, 1e-13))


@pytest.mark.parametrize('decay', [10.0, 1000.0])
def test_a_margin_rises_by_a_turns_loss_of_amplitude_with_the_logarithm_of_the_load(decay):
    # By 2 pi zeta: there friction gives what damping takes in a turn, in proportion to the load.
    contact = Contact(Bearing(50.0, 400.0, 2.0e6, Stribeck(0.3, 0.1, decay), 0.1))
    speed = np.array([1.0, 2.0]) / decay
    load, slope = least_sticking_loads(contact, speed, 1e6, error=1e-10)
    margin = contact.grazing_margin(speed, load * 1.001, 1e-13) / math.log(1.001)
    np.testing.assert_allclose(margin, 2.0 * math.pi * 0.02, rtol=0.1)
    np.testing.assert_allclose(slope, margin, rtol=1e-2)


@pytest.mark.parametrize('name', LAWS)
def test_no_lining_sticks_beyond_its_bounds_of_speed_and_load(name):
    contact = Contact(Bearing(50.0, 400.0, 2.0e6, LAWS[name], 0.1))
    load = np.geomspace(1e3, 1e5, 5)
    highest = np.array([contact.highest_speed(n) for n in load])
    speed = np.linspace(1.0, 4.0, 30)[:, None] * highest
    assert not meets_belt(contact.bearing, speed.ravel(), np.tile(load, 30), 1e-11).any()
    speed = np.geomspace(1e-3, 1.0, 12)
    share = np.linspace(0.1, 1.0, 20)[:, None]
    least_load = np.minimum(contact.least_loads(speed), 1e6)
    assert not meets_belt(contact.bearing, np.tile(speed, 20), (share * least_load).ravel(), 1e-11).any()


def test_the_margin_of_slip_that_comes_to_rest_before_it_turns_is_negative():
    law = Tabulated([0.0, 0.1, 1.0], [0.1, 0.2, 0.3])
    contact = Contact(Bearing(50.0, 1.8e4, 2.0e6, law, 0.1))
    np.testing.assert_array_equal(contact.grazing_margin(np.array([0.01, 0.1]), np.full(2, 1e5), 1e-11), -9.0)


@pytest.mark.parametrize(('name', 'rises'), [('Stribeck', False), ('viscous', True), ('table', False)])
def test_friction_rises_where_it_does_beyond_its_last_scale(name, rises):
    assert Contact(Bearing(50.0, 400.0, 2.0e6, LAWS[name], 0.1)).rises_beyond_scale == rises
