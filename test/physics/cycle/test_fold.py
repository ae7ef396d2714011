# SPDX-License-Identifier: Apache-2.0
"""The exact fold: the table of docs/physics.md, the curve over the load, the coarse search."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stickslip_monitor.physics.averaging.boundaries import fold_speed
from stickslip_monitor.physics.cycle import fold
from stickslip_monitor.physics.cycle.cycles import CycleKind, exact_cycle, exact_fold_speed
from stickslip_monitor.physics.cycle.fold import FoldCurve
from stickslip_monitor.physics.friction import Coulomb, FrictionLaw, Stribeck, Tabulated
from stickslip_monitor.physics.oscillator import Bearing

DOCS = Path(__file__).parents[3] / 'docs'


def _bearing(law: FrictionLaw, damping: float = 400.0) -> Bearing:
    return Bearing(50.0, damping, 2.0e6, law, 0.1)


def _table() -> list[tuple[float, float, str]]:
    """``eta``, ``zeta`` and the cell of each place in the table of docs/physics.md."""
    lines = (DOCS / 'physics.md').read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith('| eta | zeta'))
    head, _, *rows = [
        [cell.strip() for cell in line.strip('|').split('|')]
        for line in lines[start : lines.index('', start)]
    ]
    zeta = [float(cell.removeprefix('zeta ')) for cell in head[1:]]
    return [
        (float(row[0]), z, cell) for row in rows for z, cell in zip(zeta, row[1:], strict=True)
    ]


def test_the_table_of_exact_over_averaged_fold() -> None:
    """By bearings of unit mass and stiffness; two digits are printed."""
    table = _table()
    assert len(table) == 35
    for zeta in sorted({zeta for _, zeta, _ in table}):
        bearing = Bearing(1.0, 2.0 * zeta, 1.0, Stribeck(0.3, 0.1, 10.0), 0.1)
        eta, cells = zip(*((eta, cell) for eta, z, cell in table if z == zeta), strict=True)
        load = np.array(eta) / (0.2 * 10.0)
        averaged = np.asarray(fold_speed(bearing, load))
        guess = fold.guessed_fold(bearing, load, averaged)
        ratio = fold.coarse_fold(bearing, load, guess) / averaged - 1.0
        printed = np.array([np.nan if cell == '-' else float(cell) for cell in cells])
        np.testing.assert_allclose(ratio, printed, rtol=0.06, atol=2e-6)
        np.testing.assert_array_equal(np.isnan(printed), np.array(eta) <= 2.0 * zeta)


CURVES = {
    'reference': (Stribeck(0.30, 0.10, 10.0), 1e-9),
    'viscous': (Stribeck(0.30, 0.10, 10.0, 0.05), 1e-9),
    'coulomb': (Coulomb(0.30, 0.10), 1e-9),
    'table': (
        Tabulated(
            [0.0, 0.30, 0.316, 0.406, 0.423, 0.49], [0.3, 0.108, 0.1094, 0.1037, 0.1031, 0.1029]
        ),
        1e-4,
    ),
}


@pytest.mark.parametrize('name', CURVES)
def test_the_curve_over_the_load_is_the_exact_fold(name: str) -> None:
    law, tolerance = CURVES[name]
    bearing = _bearing(law)
    # Below the least load with a cycle of every law but Coulomb's, and through four octaves.
    load = np.array([1.0, 100.0, 300.0, 777.0, 1000.0, 1600.0, 2500.0, 3999.0])
    averaged = np.asarray(fold_speed(bearing, load))
    curve = FoldCurve(bearing).speed(load, averaged)
    np.testing.assert_allclose(curve, exact_fold_speed(bearing, load), rtol=tolerance)
    assert np.isnan(curve[0]) is np.bool_(name != 'coulomb')


def test_a_value_of_the_curve_does_not_depend_on_what_was_asked_before() -> None:
    bearing = _bearing(Stribeck(0.30, 0.10, 10.0))
    load = np.geomspace(250.0, 6000.0, 40)
    averaged = np.asarray(fold_speed(bearing, load))
    together = FoldCurve(bearing).speed(load, averaged)
    backwards = FoldCurve(bearing)
    alone = [backwards.speed(load[i : i + 1], averaged[i : i + 1])[0] for i in range(39, -1, -1)]
    np.testing.assert_array_equal(together, alone[::-1])


@pytest.mark.parametrize('law', [Stribeck(0.3, 0.1, 10.0), Coulomb(0.3, 0.1)])
def test_far_above_every_octave_the_fold_grows_with_the_load(law: FrictionLaw) -> None:
    """Coulomb's law is the limit for large loads, and has no scale of speed of its own."""
    bearing = _bearing(law)
    fold = FoldCurve(bearing).speed(np.array([1e12, 3e12]), np.array([np.nan, np.nan]))
    assert fold[1] / fold[0] == pytest.approx(3.0, rel=1e-12)
    assert fold[0] == pytest.approx(exact_fold_speed(_bearing(Coulomb(0.3, 0.1)), 1e12), rel=0.02)


def test_an_odd_bearing_takes_few_slip_phases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hardly damped, eta = 2000: near grazing orbits part like a logarithm (20 s by bisection)."""
    calls: list[int] = []
    follow = fold.follow

    def counting(*arguments):
        calls.append(arguments[2].size)
        return follow(*arguments)

    monkeypatch.setattr(fold, 'follow', counting)
    bearing = Bearing(1.0, 2.0 * 5e-5 * 100.0, 1e4, Stribeck(0.3, 0.1, 10.0), 0.1)
    load = 2000.0 * 100.0 / 2.0
    exact = exact_fold_speed(bearing, load)
    assert len(calls) < 16
    inside, outside = exact_cycle(bearing, exact * np.array([1.0 - 1e-9, 1.0 + 1e-9]), load).kind
    assert inside == CycleKind.STICK_SLIP
    assert outside == CycleKind.NONE
