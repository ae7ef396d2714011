# SPDX-License-Identifier: Apache-2.0
"""The map against closed forms and the assessment on both of its sides; tracks, and thinning."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sending
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.axes import Axes
from own_law import OwnLaw
from scipy.special import i1e
from shared import CONFIG as REFERENCE_FILE
from shared import RPM

from stickslip_monitor import Bearing, Coulomb, FrictionLaw, Monitor, Stribeck, Tabulated, assess
from stickslip_monitor.drawing.canvas import CONDITION_NAMES, envelope
from stickslip_monitor.drawing.map import (
    Track,
    TrackEvent,
    boundaries,
    caution_load,
    corners,
    draw_map,
    law_speed,
    map_ranges,
    onset_load,
    track_of_scan,
)
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.physics.averaging import fold_load
from stickslip_monitor.physics.cycles import end_of_vibration, exact_cycle
from stickslip_monitor.physics.lubrication import Lubrication

pytest.importorskip('matplotlib')
CONFIG = load_config(REFERENCE_FILE)
BEARING = CONFIG.bearings[0]
REFERENCE = BEARING.bearing
TABLE = replace(
    REFERENCE,
    friction=Tabulated([0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4], [0.3, 0.2, 0.19, 0.19, 0.15, 0.1, 0.11]),
)
CLIFF = Tabulated([0.0, 0.002, 0.004, 1.0], [0.4, 0.3, 0.1, 0.09])
DRY = replace(REFERENCE, friction=Coulomb(0.3, 0.1))


def test_corners_are_the_break_points_of_the_law_between_two_speeds() -> None:
    points = corners(TABLE, (0.06, 0.19)).reshape(-1, 3)
    np.testing.assert_allclose(points[:, 1], [0.1, 0.15], rtol=1e-15)
    np.testing.assert_allclose(points[:, ::2] / points[:, 1:2] - 1.0, [[-1e-9, 1e-9]] * 2, rtol=1e-6)


@pytest.mark.parametrize(('law', 'factor'), [(None, 1.01), (TABLE.friction, 1.01), (CLIFF, 2.0)])
def test_the_least_load_with_stick_slip_is_found(law: FrictionLaw | None, factor: float) -> None:
    """Among 20,000 speeds to 1 %; that of a fall at creeping speeds to a factor, as a picture needs it."""
    bearing = replace(REFERENCE, friction=law or REFERENCE.friction)
    min_load = float(np.nanmin(fold_load(bearing, np.geomspace(1e-4, 1.0, 20_001))))
    assert min_load / 1.01 < onset_load(bearing) < min_load * factor


def test_speeds_of_the_law_grow_with_the_load_that_the_water_carries() -> None:
    """``s = (N/N0)^g``, Hersey's number at g = 1: the film carries twice the load at twice the speed."""
    bearing = replace(REFERENCE, lubrication=Lubrication(load=1000.0, load_exponent=1.0))
    assert law_speed(bearing) == pytest.approx(0.4)  # 4 / decay, at which the film was measured
    assert law_speed(bearing, 2000.0) == pytest.approx(0.8)


def test_boundaries_are_the_closed_forms() -> None:
    curves = boundaries(REFERENCE, (0.01, 0.4), 0.1, 60)
    v = 10.0 * curves.speed
    np.testing.assert_allclose(curves.hopf_load, 400.0 * np.exp(v) / (0.2 * 10.0), rtol=1e-12)
    for load, x in ((curves.fold_load, v), (curves.caution_load, v / 1.1)):
        # The fold that decides lies up to 2e-4 off the closed form of averaging in speed.
        np.testing.assert_allclose(load, 400.0 / (2.0 * 2.0 * i1e(x) / x), rtol=1e-3)
        np.testing.assert_allclose(10.0 * end_of_vibration(REFERENCE, load), x, rtol=1e-7)
    # The published load at which the cycle dies at 20 rpm.
    assert float(np.interp(20.0 * RPM, curves.speed, curves.fold_load)) == pytest.approx(498, abs=1)


@pytest.mark.parametrize('bearing', [REFERENCE, TABLE], ids=['stribeck', 'table'])
def test_the_assessment_changes_across_each_curve(bearing: Bearing) -> None:
    curves = boundaries(bearing, (0.02, 0.3), 0.1, 12)

    for line, crossed in (
        (curves.fold_load, lambda point: point.regime != 'stable'),
        (curves.hopf_load, lambda point: point.growth_rate > 0.0),
    ):
        finite = np.isfinite(line)
        speed, load = curves.speed[finite][::5], line[finite][::5]
        assert crossed(assess(bearing, speed, load * (1.0 + 1e-3))).all()
        assert not crossed(assess(bearing, speed, load * (1.0 - 1e-3))).any()
    speed = np.linspace(0.005, 0.3, 300)
    load = caution_load(bearing, speed, 0.1)
    finite = np.isfinite(load)
    # Where the fold jumps the table has it between two loads a percent apart.
    speed, load = speed[finite][::12], load[finite][::12]
    assert np.all(speed < 1.1 * end_of_vibration(bearing, load * 1.01))
    assert not np.any(speed < 1.1 * end_of_vibration(bearing, load * 0.99))


def test_without_stick_slip_there_are_no_curves() -> None:
    bearing = replace(REFERENCE, friction=Coulomb(0.1, 0.1))
    curves = boundaries(bearing, map_ranges(bearing)[0], 0.1, 20)
    assert math.isnan(onset_load(bearing))
    for line in (curves.fold_load, curves.hopf_load, curves.caution_load):
        assert np.isnan(line).all()
    figure = draw_map(replace(BEARING, bearing=bearing))
    assert 'no stick-slip in this range' in [text.get_text() for text in figure.axes[0].texts]


def test_dry_friction_has_the_fold_that_averaging_does_not_know() -> None:
    curves = boundaries(DRY, (0.0, 0.08), 0.1, 20)
    # The damped oscillation from break-away just meets the belt's speed again, by brentq; in proportion.
    expected = 1000.0 * curves.speed[1:] / (7.193599 * RPM)
    np.testing.assert_allclose(curves.fold_load[1:], expected, rtol=1e-5)
    np.testing.assert_allclose(curves.caution_load[1:], expected / 1.1, rtol=1e-5)


@pytest.mark.parametrize(
    ('law', 'end'),
    # The exact fold, by another program in C; and dry friction, of which only the exact model has one:
    # the damped oscillation from break-away just meets the belt's speed again, by brentq.
    [(Stribeck(0.3, 0.1, 10.0), 40.7179), (Coulomb(0.3, 0.1), 7.193599)],
    ids=['stribeck', 'coulomb'],
)
def test_a_map_shows_the_way_out_of_stick_slip(law: FrictionLaw, end: float) -> None:
    bearing = replace(REFERENCE, friction=law)
    low, high = map_ranges(bearing, loads=(0.0, 1000.0))[0]
    assert (low, high / RPM) == (0.0, pytest.approx(1.25 * end, rel=1e-4))


def test_a_map_is_of_the_speeds_and_loads_that_are_asked_for() -> None:
    axes = draw_map(BEARING, (0.05, 0.2), (100.0, 900.0)).axes[0]
    assert axes.get_xlim() == pytest.approx((0.05 / RPM, 0.2 / RPM))
    assert axes.get_ylim() == pytest.approx((0.1, 0.9))


def test_a_map_shows_the_onset_and_the_whole_track() -> None:
    assert onset_load(REFERENCE) == pytest.approx(200.0, rel=1e-9)
    assert map_ranges(REFERENCE)[1] == (0.0, pytest.approx(2000.0, rel=1e-9))
    column = np.array([-2.0, 1.0])
    speeds, loads = map_ranges(REFERENCE, track=Track(column, 550.0 * abs(column)))
    assert (speeds, loads) == ((0.0, pytest.approx(2.1)), (0.0, 1375.0))


class Unnamed(OwnLaw):
    breakpoints = ()


def test_a_law_that_names_no_breakpoints_has_the_ranges_of_the_same_law_that_does() -> None:
    config = replace(BEARING, bearing=replace(REFERENCE, friction=Unnamed(0.3, 0.1, 10.0)))
    assert onset_load(config.bearing) == pytest.approx(200.0, rel=1e-9)
    for actual, expected in zip(map_ranges(config.bearing), map_ranges(REFERENCE), strict=True):
        assert actual == pytest.approx(expected, rel=1e-6)


def legend_texts(legend: Any) -> list[str]:
    return [text.get_text() for text in legend.get_texts()]


def test_the_map_names_regions_and_lines_of_one_amplitude(monkeypatch: pytest.MonkeyPatch) -> None:
    contours, contour = [], Axes.contour

    def record_contour(*args: Any, **look: Any) -> Any:
        contours.append(contour(*args, **look))
        return contours[-1]

    # Before matplotlib 3.8 the axes do not know the lines of a level as such.
    monkeypatch.setattr(Axes, 'contour', record_contour)
    figure = draw_map(BEARING)
    assert legend_texts(figure.legends[0]) == [
        'stable',
        'margin low',
        'bistable',
        'unstable',
        'caution margin',
        'Hopf',
        'fold',
        'amplitude',
    ]
    axes = figure.axes[0]
    assert len([text for text in axes.texts if text.get_text().endswith(' mm')]) >= 3
    (lines,) = contours
    checked = 0
    for level, parts in zip(lines.levels, lines.allsegs, strict=True):
        for x, y in np.concatenate([np.empty((0, 2)), *parts])[::9]:
            exact = exact_cycle(REFERENCE, x * RPM, y * 1e3).amplitude * 1e3
            assert float(exact) == pytest.approx(level, rel=5e-3)
            checked += 1
    assert checked > 10


def test_a_track_has_its_ends_and_the_alarm_marked() -> None:
    speed = np.interp(np.linspace(0.0, 1.0, 400), [0, 0.5, 1], [0.3, 0.1, 0.3])
    load = np.full(400, 900.0)
    speed[200], speed[-1] = np.nan, speed[0] + 1e-3
    events = [TrackEvent(0.25 - 0.01 * i, 950.0, c) for i, c in enumerate(Condition)]
    axes = draw_map(BEARING, track=Track(speed, load, events)).axes[0]
    expected = [f'to: {CONDITION_NAMES[condition]}' for condition in Condition]
    # Start and end are within a ring of each other, and one mark.
    assert legend_texts(axes.get_legend()) == ['measured', 'smoothed', 'start and end', *expected]
    # Each at the operating point that it was told at, wherever a thinned track goes.
    marks = [line for line in axes.lines if line.get_zorder() == 10]
    for k, mark in enumerate(marks):
        assert mark.get_xdata() == pytest.approx([(0.25 - 0.01 * k) / RPM])
        assert mark.get_ydata() == pytest.approx([0.95])
    assert [line.get_marker() for line in axes.lines if line.get_zorder() == 11] == ['o']


def test_a_track_shows_which_way_it_goes() -> None:
    speed = np.linspace(0.3, 0.1, 400)
    axes = draw_map(BEARING, track=Track(speed, np.full(400, 900.0))).axes[0]
    assert legend_texts(axes.get_legend()) == ['measured', 'smoothed', 'start', 'end']
    arrows = [text for text in axes.texts if getattr(text, 'arrow_patch', None) is not None]
    assert len(arrows) == 3
    assert all(arrow.xy[0] < arrow.xyann[0] for arrow in arrows)


def test_the_hopf_line_goes_as_far_as_its_region() -> None:
    # Where the law stops falling there is no Hopf load: the line rises out of the map there.
    axes = draw_map(replace(BEARING, bearing=TABLE), loads=(0.0, 5e4)).axes[0]
    (line,) = [artist for artist in axes.lines if artist.get_label() == 'Hopf']
    assert np.isfinite(line.get_ydata()).all()
    (region,) = [artist for artist in axes.collections if artist.get_label() == 'unstable']
    corners = {(round(x, 6), round(y, 6)) for x, y in region.get_paths()[0].vertices}
    line_points = {(round(x, 6), round(y, 6)) for x, y in zip(*line.get_data(), strict=True)}
    assert line_points <= corners


@pytest.mark.parametrize('points', [0, 1])
def test_a_track_of_next_to_nothing_is_drawn(points: int) -> None:
    column = np.full(points, 0.2)
    draw_map(BEARING, track=Track(column, 1e3 * column))


def test_a_track_of_a_scan_is_interrupted_where_an_input_was_lost() -> None:
    stream = sending.points(np.full(20, 60.0), 900.0, np.r_[0:10, 60:70])
    scan = Monitor(CONFIG).scan({'aft_stern': stream}, 0, 90 * sending.SECOND)['aft_stern']
    track = track_of_scan(scan)
    # The first ten seconds, and from the sixtieth on.
    assert np.flatnonzero(np.isnan(track.speed)).tolist() == [
        np.searchsorted(scan.time_ns, 30 * sending.SECOND)
    ]
    assert track.events[0].condition is Condition.INPUT_STALE


VALUES = arrays(
    np.float64, st.integers(1, 400), elements=st.one_of(st.floats(-1e3, 1e3), st.just(float('nan')))
)


@given(VALUES, st.integers(6, 60))
def test_thinning_keeps_the_extremes_of_every_stretch(column: np.ndarray, max_count: int) -> None:
    rows = envelope(max_count, column)
    assert np.all(np.diff(rows) > 0)
    assert {0, column.size - 1} <= set(rows.tolist())
    assert rows.size <= max(max_count, 3) + 2
    # What is kept of a block is as great and as small as anything in it.
    length = 1 if column.size <= max_count else -(-column.size // (max_count // 3))
    for i in np.flatnonzero(np.isfinite(column)):
        block = i // length * length
        near = column[rows[(rows >= block) & (rows < block + length)]]
        assert np.nanmin(near) <= column[i] <= np.nanmax(near)


def test_one_sample_of_a_day_and_every_interruption_stay() -> None:
    speed, load = np.full(864_000, 1.0), np.zeros(864_000)
    speed[500_001], load[4_321], load[7_777] = -3.0, -1.0, np.nan
    rows = envelope(900, speed, load)
    assert {500_001, 4_321, 7_777} <= set(rows.tolist())
    assert rows.size < 910
    for size in (0, 1, 10):
        assert envelope(10, np.arange(float(size))).tolist() == list(range(size))


@pytest.mark.parametrize('size', [(3.6, 4.0), (3.6, 5.4), (9.0, 5.6)])
def test_no_label_of_an_amplitude_is_cut(size: tuple[float, float]) -> None:
    figure = draw_map(BEARING, size=size)
    (axes,) = figure.axes
    figure.canvas.draw()
    labels = [text for text in axes.texts if text.get_text().endswith(' mm')]
    assert labels
    frame = axes.get_window_extent()
    for label in labels:
        box = label.get_window_extent()
        assert frame.y0 <= box.y0 < box.y1 <= frame.y1
        assert frame.x0 <= box.x0 < box.x1 <= frame.x1
