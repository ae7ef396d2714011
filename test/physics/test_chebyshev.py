# SPDX-License-Identifier: Apache-2.0
"""Polynomials on panels, against the functions they stand for."""

from __future__ import annotations

import numpy as np

from stickslip_monitor.physics import chebyshev
from stickslip_monitor.physics.chebyshev import NODES, NOWHERE

RNG = np.random.default_rng(7)


def _points(units, count=2000):
    corners = np.array([[0, 0], [units[0], 0], [0, units[1]], units], dtype=float)
    inside = RNG.uniform(0.0, 1.0, (count, 2)) * units
    return np.concatenate([corners, inside]).T


def _value(approximation, x, y):
    panel = approximation.locate(x, y)
    assert (panel != NOWHERE).all()
    return approximation.value(panel, x, y)


def test_polynomials_come_back_to_rounding():
    # Degrees up to the last but two in either direction are resolved on the first level.
    def f(x, y):
        return 1.0 + x**5 - 2.0 * x * y**4 + y**5

    fit = chebyshev.build(f, (2, 3), 1e-9, 10**6)
    x, y = _points((2, 3))
    assert fit.powers.shape == (6, NODES, NODES)
    np.testing.assert_allclose(_value(fit, x, y), f(x, y), atol=1e-10)


def test_a_smooth_function_is_as_close_as_asked():
    def f(x, y):
        return np.exp(-x) * np.sin(1.5 * x + y)

    x, y = _points((2, 2))
    errors = {}
    for tolerance in (1e-3, 1e-5, 1e-7):
        fit = chebyshev.build(f, (2, 2), tolerance, 10**6)
        errors[tolerance] = np.abs(_value(fit, x, y) - f(x, y)).max()
        assert errors[tolerance] < tolerance
    assert errors[1e-7] < errors[1e-3]


def test_only_the_direction_that_needs_it_is_halved():
    fit = chebyshev.build(lambda x, y: np.sin(9.0 * x) + y, (1, 1), 1e-4, 10**6)
    assert fit.powers.shape[0] > 1
    assert (fit.half[:, 1] == 0.5).all()
    assert (fit.half[:, 0] < 0.5).all()


def test_a_crease_is_left_out_and_nothing_else():
    def f(x, y):
        return np.abs(x - 0.3) + 0.0 * y

    fit = chebyshev.build(f, (1, 1), 1e-9, 10**6)
    x, y = _points((1, 1))
    panel = fit.locate(x, y)
    # The only cells of the deepest level with the crease inside are those from 0.25 to 0.5.
    np.testing.assert_array_equal(panel == NOWHERE, (x >= 0.25) & (x < 0.5))
    good = panel != NOWHERE
    np.testing.assert_allclose(
        fit.value(panel[good], x[good], y[good]), f(x[good], y[good]), atol=1e-12
    )


def test_where_there_is_no_function_there_is_no_panel():
    fit = chebyshev.build(lambda x, y: np.where(x < 1.0, y, np.nan), (2, 1), 1e-9, 10**6)
    panel = fit.locate(np.array([0.5, 1.5]), np.array([0.5, 0.5]))
    assert panel[0] != NOWHERE
    assert panel[1] == NOWHERE


def test_the_budget_bounds_the_values_asked_for():
    asked = []

    def f(x, y):
        asked.append(x.size)
        return np.sin(40.0 * x) * np.sin(40.0 * y)

    budget = 5 * NODES * NODES
    fit = chebyshev.build(f, (1, 1), 1e-12, budget)
    assert sum(asked) <= budget
    assert (fit.cell == NOWHERE).all()


def test_no_point_sees_its_neighbours():
    fit = chebyshev.build(lambda x, y: np.sin(3.0 * x) * np.exp(y), (2, 1), 1e-5, 10**6)
    x, y = _points((2, 1), 300)
    together = _value(fit, x, y)
    alone = [_value(fit, x[i : i + 1], y[i : i + 1])[0] for i in range(x.size)]
    np.testing.assert_array_equal(together, alone)


def _pieces(function, units, tolerance):
    pieces = chebyshev.no_pieces(units)
    for unit in range(units):
        pieces = pieces.with_unit(unit, function, tolerance)
    return lambda y: pieces.value(pieces.cell[(y * chebyshev.FINE).astype(int)], y)


def test_pieces_follow_a_function_of_one_variable_whatever_was_built_before():
    y = np.append(RNG.uniform(0.0, 3.0, 500), 0.0)
    fit = _pieces(lambda y: 2.0 + np.sin(y), 3, 1e-8)
    np.testing.assert_allclose(fit(y), 2.0 + np.sin(y), rtol=1e-9)
    alone = chebyshev.no_pieces(3).with_unit(1, lambda y: 2.0 + np.sin(y), 1e-8)
    second = y[(y >= 1.0) & (y < 2.0)]
    part = alone.cell[(second * chebyshev.FINE).astype(int)]
    np.testing.assert_array_equal(alone.value(part, second), fit(second))


def test_pieces_are_halved_at_a_crease_and_keep_the_larger_value_at_a_jump():
    y = RNG.uniform(0.0, 2.0, 500)
    crease = _pieces(lambda y: 1.0 + np.abs(y - 1.7), 2, 1e-8)
    np.testing.assert_allclose(crease(y), 1.0 + np.abs(y - 1.7), atol=0.3 / chebyshev.FINE)
    for top in (0.0, np.inf):
        jump = _pieces(lambda y, top=top: np.where(y < 0.7, 2.0, top), 2, 1e-8)
        near = np.abs(y - 0.7) < 1.0 / chebyshev.FINE
        np.testing.assert_array_equal(jump(y)[~near], np.where(y < 0.7, 2.0, top)[~near])
        assert (jump(y)[near] >= np.where(y < 0.7, 2.0, top)[near]).all()
