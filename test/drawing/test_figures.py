# SPDX-License-Identifier: Apache-2.0
"""The pictures: what they show, that no two words collide, and what they leave behind."""

from __future__ import annotations

import builtins
import gc
import itertools
import sys
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_monitor import Coulomb, FrictionLaw, Monitor, Stream, Stribeck, Tabulated
from stickslip_monitor.drawing.calibration import draw_calibration
from stickslip_monitor.drawing.canvas import save_figure
from stickslip_monitor.drawing.diagram import draw_diagram
from stickslip_monitor.drawing.friction_fit import draw_friction_fit
from stickslip_monitor.drawing.map import draw_map
from stickslip_monitor.drawing.palette import (
    CONDITION_COLOUR,
    CONDITION_NAMES,
    FOLD,
    HOPF,
    REGIME_COLOUR,
    REGIME_FILL,
)
from stickslip_monitor.drawing.track import Track, TrackEvent, track_of_scan
from stickslip_monitor.errors import DrawingError, OutputError
from stickslip_monitor.lab.calibration.calibrate import Calibration, DipResult
from stickslip_monitor.lab.calibration.dips import Dip, VibrationReport, path_of
from stickslip_monitor.lab.calibration.posterior import prior_of, sample_posterior
from stickslip_monitor.lab.friction_fit.curve_file import FrictionCurve
from stickslip_monitor.lab.friction_fit.fit import fit_stribeck
from stickslip_monitor.lab.friction_fit.spread import boundary_spread
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.physics.cycle.cycles import exact_cycle

pytest.importorskip('matplotlib')
CONFIG = load_config(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')
REFERENCE = CONFIG.bearings[0]
LAWS: dict[str, FrictionLaw] = {
    'stribeck': Stribeck(0.3, 0.1, 10.0),
    'viscous': Stribeck(0.3, 0.02, 6.0, 0.05),
    'coulomb': Coulomb(0.3, 0.1),
    'table': Tabulated([0.0, 0.05, 0.1, 0.2, 0.3, 0.4], [0.3, 0.25, 0.18, 0.12, 0.1, 0.1]),
}


def with_law(law: FrictionLaw) -> BearingConfig:
    return replace(REFERENCE, bearing=replace(REFERENCE.bearing, friction=law))


def words(figure: Any) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts if text.get_text()]


def round_trip() -> Track:
    time = np.linspace(0.0, 100.0, 400)
    speed = np.interp(time, [0, 50, 100], [0.3, 0.1, 0.28])
    load = np.interp(time, [0, 50, 100], [900.0, 1100.0, 700.0])
    speed[200] = np.nan
    events = [TrackEvent(0.25 - 0.01 * i, 950.0, c) for i, c in enumerate(Condition)]
    return Track(time, speed, load, events)


def named(figure: Any) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


@pytest.mark.parametrize('law', LAWS.values(), ids=LAWS)
@pytest.mark.parametrize('kind', ['diagram', 'track'])
def test_no_two_labels_overlap(law: FrictionLaw, kind: str) -> None:
    config = with_law(law)
    if kind == 'diagram':
        figure = draw_diagram(config, 1000.0, points=60)
    else:
        figure = draw_map(config, track=round_trip())
    figure.canvas.draw()
    # Those beside points; lines of one amplitude have theirs on the line, turned with it.
    texts = [t for t in figure.axes[0].texts if t.get_text() and not t.get_rotation()]
    boxes = [text.get_window_extent() for text in texts]
    assert boxes
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_the_diagram_names_its_curves_and_says_where_hopf_and_fold_are() -> None:
    figure = draw_diagram(REFERENCE, 1000.0, points=100)
    # The exact fold of this bearing lies 8e-6 off that of averaging.
    assert {'Hopf 30.74 rpm', 'fold 40.72 rpm\n(exact 40.72 rpm)'} <= set(words(figure))
    assert {'unstable', 'bistable', 'stable'} <= set(words(figure))
    assert named(figure) == [
        'stick-slip, exact',
        'stick-slip, averaging',
        'threshold (unstable), averaging',
        'steady sliding, unstable',
        'steady sliding',
        'sliding limit a = V',
    ]
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        'shaft speed [rpm]', 'displacement amplitude [mm]',
    )  # fmt: skip
    assert axes.child_axes[0].get_xlabel() == 'surface speed [m/s]'
    dashed = [line for line in axes.lines if line.is_dashed() and line.get_linestyle() == '--']
    assert [min(line.get_xdata()) for line in dashed if 'sliding' in line.get_label()] == [
        pytest.approx(0.0, abs=1e-3)
    ]


def test_the_exact_cycle_is_drawn_beside_averaging() -> None:
    """At 20 rpm and 1000 N: 0.556755 mm, and by averaging 0.52688 mm (physics.md)."""
    lines = {line.get_label(): line for line in draw_diagram(REFERENCE, 1000.0).axes[0].lines}
    for name, expected in (('exact', 0.556755), ('averaging', 0.52688)):
        line = lines[f'stick-slip, {name}']
        x, y = (np.asarray(column, float) for column in line.get_data())
        known = np.isfinite(y)
        assert np.interp(20.0, x[known], y[known]) == pytest.approx(expected, rel=1e-4)


def test_a_fold_that_averaging_does_not_have_is_marked() -> None:
    (text,) = [t for t in words(draw_diagram(with_law(Coulomb(0.3, 0.1)), 1e3)) if 'fold' in t]
    assert text == 'fold 7.194 rpm\n(averaging has none)'


def test_an_empty_diagram_says_why() -> None:
    text = ' '.join(words(draw_diagram(with_law(Coulomb(0.1, 0.1)), 1000.0)))
    assert 'no speed has stick-slip.' in text.replace('\n', ' ')


def test_an_empty_map_says_so() -> None:
    assert 'no stick-slip in this range' in words(draw_map(with_law(Coulomb(0.3, 0.1))))


def test_the_map_names_regions_and_lines() -> None:
    figure = draw_map(REFERENCE)
    assert named(figure) == ['stable', 'margin low', 'bistable', 'unstable', 'Hopf', 'fold']
    assert figure.axes[0].get_ylabel() == 'bearing load [kN]'
    assert len([word for word in words(figure) if word.endswith(' mm')]) >= 3


def test_on_a_line_of_the_map_the_exact_amplitude_is_its_own() -> None:
    axes = draw_map(REFERENCE).axes[0]
    (lines,) = [each for each in axes.collections if hasattr(each, 'levels')]
    rpm = REFERENCE.bearing.speed.factor('rpm')
    checked = 0
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        for x, y in path.vertices[::9]:
            found = exact_cycle(REFERENCE.bearing, x * rpm, y * 1e3).amplitude * 1e3
            assert float(found) == pytest.approx(level, rel=5e-3)
            checked += 1
    assert checked > 10


def test_a_track_has_its_ends_and_the_alarm_marked() -> None:
    axes = draw_map(REFERENCE, track=round_trip()).axes[0]
    assert {'start', 'end'} <= {text.get_text() for text in axes.texts}
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == [CONDITION_NAMES[condition] for condition in Condition]
    arrows = [text for text in axes.texts if not text.get_text()]
    assert 3 <= len(arrows) <= 6
    rpm = REFERENCE.bearing.speed.factor('rpm')
    marks = [line for line in axes.lines if line.get_zorder() == 10]
    # Each at the operating point that it was told at, wherever a thinned track goes.
    for k, mark in enumerate(marks):
        assert mark.get_xdata() == pytest.approx([(0.25 - 0.01 * k) / rpm])
        assert mark.get_ydata() == pytest.approx([0.95])


@pytest.mark.parametrize('points', [0, 1])
def test_a_track_of_next_to_nothing_is_drawn(points: int) -> None:
    column = np.full(points, 0.2)
    draw_map(REFERENCE, track=Track(column, column, 1e3 * column))


@pytest.mark.parametrize('n', [3000, 90_000])
def test_a_track_is_a_course_without_zigzag_over_all_the_places_it_has_been_to(n: int) -> None:
    """There and back through noise: one turn; and no place, and no gap, is lost."""
    time, noise = np.arange(float(n)), np.random.default_rng(1)
    speed = np.interp(time, [0, n / 2, n], [0.3, 0.1, 0.3]) + noise.normal(0.0, 5e-4, n)
    load = noise.normal(900.0, 20.0, n)
    load[n // 3], speed[7 * n // 9] = 300.0, np.nan
    rpm = REFERENCE.bearing.speed.factor('rpm')
    lines = draw_map(REFERENCE, track=Track(time, speed, load)).axes[0].lines
    ages = [line for line in lines if line.get_zorder() == 8]
    assert [line.get_linewidth() for line in ages] == sorted(
        (line.get_linewidth() for line in ages), reverse=True
    )
    steps = np.concatenate([np.diff(np.asarray(line.get_xdata())) for line in ages])
    assert steps.size < 200
    # Where it turns back, a single small step may go either way.
    signs = np.sign(steps[np.abs(steps) > 0.02])
    assert np.count_nonzero(np.diff(signs)) == 1
    assert max(line.get_xdata().size for line in lines) < 25_000
    hidden = speed[7 * n // 9 - 1] / rpm, speed[7 * n // 9 + 1] / rpm
    assert not any(
        {*hidden} <= {*np.asarray(line.get_xdata()).tolist()} and line in ages for line in lines
    )
    assert min(float(np.nanmin(line.get_ydata())) for line in lines if line.get_alpha()) == (
        pytest.approx(0.3, abs=2e-3)
    )


def test_start_and_end_are_told_apart_where_they_are_one_place() -> None:
    column = np.array([0.3, 0.2, 0.3])
    axes = draw_map(REFERENCE, track=Track(np.arange(3.0), column, 3e3 * column)).axes[0]
    ends = [line for line in axes.lines if line.get_zorder() == 11]
    assert [line.get_marker() for line in ends] == ['o', 's']
    assert ends[0].get_markersize() > 1.5 * ends[1].get_markersize()


def test_each_boundary_has_one_colour_in_all_pictures() -> None:
    second, prior = np.array([0, 10**9]), prior_of(REFERENCE.bearing)
    squeal = VibrationReport('', 0, 10**9, True, 0.0, 0.9, '')
    path = path_of(second, np.full(2, 0.2), np.full(2, 1000.0), [squeal], (0, 10**9))
    dip = DipResult(Dip('', 0, 10**9, (squeal,), second, path), 0.0, (0.5,), ())
    calibration = Calibration(prior, sample_posterior(prior, []), (dip,))
    curve = np.linspace(0.0, 0.5, 9)
    fit = fit_stribeck(FrictionCurve.of(curve, Stribeck(0.3, 0.1, 10.0).coefficient(curve)))
    spread = boundary_spread(fit, 400.0, 1000.0, draws=100)
    for figure in (
        draw_map(REFERENCE),
        draw_diagram(REFERENCE, 1000.0, points=50),
        draw_calibration(REFERENCE, calibration),
        draw_friction_fit(fit, '', spread),
    ):
        lines = [line for axes in figure.axes for line in axes.lines]
        colours = {line.get_color() for line in lines} | {
            line.get_markeredgecolor() for line in lines if line.get_marker() not in ('', 'None')
        }
        assert {FOLD, HOPF} <= colours
        strong = {REGIME_COLOUR[Regime.BISTABLE]}
        assert not strong & colours


def test_a_track_of_a_scan_is_interrupted_where_an_input_was_lost() -> None:
    second = 10**9
    times = np.array([0, 0, 1, 1, 60, 60, 61, 61], np.int64) * second
    values = np.array([60.0, 900.0] * 4)
    stream = Stream(times, np.tile([False, True], 4), values)
    scan = Monitor(CONFIG).scan({'aft_stern': stream}, 0, 70 * second)['aft_stern']
    track = track_of_scan(scan)
    (gap,) = np.flatnonzero(np.isnan(track.speed))
    assert track.time[gap - 1] < 10.0 < 59.9 < track.time[gap + 1]
    assert track.events[0].condition is Condition.INPUT_STALE


def test_figures_leave_nothing_behind(tmp_path: Path) -> None:
    figure = draw_diagram(REFERENCE, 1000.0, points=20)
    save_figure(figure, tmp_path / 'a.png')
    gone = weakref.ref(figure)
    del figure
    gc.collect()
    assert gone() is None
    pyplot = sys.modules.get('matplotlib.pyplot')
    assert pyplot is None or not pyplot.get_fignums()


def test_the_same_picture_gives_the_same_bytes(tmp_path: Path) -> None:
    for suffix in ('png', 'svg'):
        for name in ('a', 'b'):
            save_figure(draw_map(REFERENCE), tmp_path / f'{name}.{suffix}')
        assert (tmp_path / f'a.{suffix}').read_bytes() == (tmp_path / f'b.{suffix}').read_bytes()


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith('matplotlib'):
            raise ImportError(f"No module named '{name}'")
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, '__import__', refuse)
    with pytest.raises(DrawingError, match=r"extra 'report'.*stickslip_monitor\[report\]"):
        draw_diagram(REFERENCE, 1000.0)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    figure = draw_diagram(REFERENCE, 1000.0, points=20)
    with pytest.raises(OutputError, match=r"/a\.png' cannot be written: there is no folder '"):
        save_figure(figure, tmp_path / 'nowhere' / 'a.png')


def luminance(colour: str) -> float:
    parts = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_every_regime_and_condition_has_a_colour() -> None:
    assert set(REGIME_COLOUR) == set(REGIME_FILL) == set(Regime)
    assert set(CONDITION_COLOUR) == set(Condition)
    assert len(set(CONDITION_COLOUR.values())) == len(Condition)


def test_fills_keep_their_order_in_grey_and_carry_dark_text() -> None:
    order = [luminance(REGIME_FILL[r]) for r in (Regime.STABLE, Regime.BISTABLE, Regime.UNSTABLE)]
    assert order == sorted(order, reverse=True)
    ink = luminance('#595959')
    assert all((fill + 0.05) / (ink + 0.05) > 4.5 for fill in order)
