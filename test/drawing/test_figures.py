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
from scipy.optimize import brentq

from stickslip_monitor import Coulomb, FrictionLaw, Monitor, Stream, Stribeck, Tabulated
from stickslip_monitor.drawing.calibration import CalibrationPicture, DipTrack, draw_calibration
from stickslip_monitor.drawing.canvas import save_figure
from stickslip_monitor.drawing.diagram import draw_diagram, load_text
from stickslip_monitor.drawing.friction_fit import Boundary, FrictionFitPicture, draw_friction_fit
from stickslip_monitor.drawing.labels import Box, Labeller
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
from stickslip_monitor.monitor.assessment import Regime
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.ladder import Condition

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
    events = [TrackEvent(float(5 * i), c) for i, c in enumerate(Condition)]
    return Track(time, speed, load, events)


@pytest.mark.parametrize('law', LAWS.values(), ids=LAWS)
@pytest.mark.parametrize('kind', ['diagram', 'map', 'track'])
def test_no_two_words_overlap(law: FrictionLaw, kind: str, placed: list[Labeller]) -> None:
    config = with_law(law)
    if kind == 'diagram':
        draw_diagram(config, 1000.0)
    else:
        draw_map(config, track=round_trip() if kind == 'track' else None)
    (labels,) = placed
    marks = 9.0 * 100.0 / 72.0
    texts = [box for box in labels.boxes if not np.allclose(2.0 * box.half, marks)]
    assert texts
    assert not any(one.overlaps(other) for one, other in itertools.combinations(texts, 2))


def test_the_diagram_says_where_hopf_and_fold_are() -> None:
    figure = draw_diagram(REFERENCE, 1000.0)
    assert {'Hopf 30.74 rpm', 'fold 40.72 rpm', 'stick-slip', 'threshold (unstable)'} <= set(
        words(figure)
    )
    assert {'unstable', 'bistable', 'stable'} <= set(words(figure))
    assert figure.axes[0].get_xlabel() == 'shaft speed [rpm]'
    assert figure.axes[0].get_ylabel() == 'displacement amplitude [mm]'
    assert figure.axes[0].child_axes[0].get_xlabel() == 'surface speed [m/s]'


def test_the_diagram_draws_unstable_things_dashed() -> None:
    lines = draw_diagram(REFERENCE, 1000.0).axes[0].lines
    dashed = [line for line in lines if line.is_dashed() and line.get_linestyle() == '--']
    solid = [line for line in lines if line.get_linestyle() == '-' and len(line.get_xdata()) > 1]
    # The threshold, and steady sliding below the Hopf speed.
    assert len(dashed) == 2
    assert min(np.nanmax(line.get_xdata()) for line in dashed) == pytest.approx(30.738, abs=1e-3)
    assert len(solid) == 2


def test_an_empty_diagram_says_why() -> None:
    text = ' '.join(words(draw_diagram(with_law(Coulomb(0.1, 0.1)), 1000.0)))
    assert 'no speed has stick-slip.' in text.replace('\n', ' ')


def test_a_diagram_without_an_averaged_cycle_tells_of_the_exact_one() -> None:
    text = ' '.join(words(draw_diagram(with_law(Coulomb(0.3, 0.1)), 1000.0))).replace('\n', ' ')
    mass, damping, stiffness, drop = 50.0, 400.0, 2.0e6, 0.2 * 1000.0
    a = 0.5 * damping / mass
    w = np.sqrt(stiffness / mass - a * a)
    t = np.linspace(0.5, 1.0, 200_001) * 2.0 * np.pi / w

    def falls_short(speed: float) -> float:
        # From the end of sticking, y' = V and k y = N (mu_s - mu_k) - c V, a damped oscillation.
        y = (drop - damping * speed) / stiffness
        b = -(stiffness / mass * y + a * speed) / w
        return speed - float(np.max(np.exp(-a * t) * (speed * np.cos(w * t) + b * np.sin(w * t))))

    fold = brentq(falls_short, 0.005, 0.2)
    rpm = fold / REFERENCE.bearing.speed.factor('rpm')
    assert f'the exact model has one up to {rpm:.4g} rpm.' in text


def test_an_empty_map_says_so() -> None:
    assert 'no stick-slip in this range' in words(draw_map(with_law(Coulomb(0.3, 0.1))))


def test_the_map_names_its_curves_and_regions() -> None:
    said = set(words(draw_map(REFERENCE)))
    assert {'Hopf', 'fold', 'margin low: fold margin below 0.1'} <= said
    assert {'unstable', 'bistable', 'stable', '0.5 mm', '1 mm', '1.5 mm'} <= said


@pytest.mark.parametrize(('top', 'unit', 'shown'), [(2e3, 'N', 2e3), (2e4, 'kN', 20.0)])
def test_the_map_chooses_newtons_or_kilonewtons(top: float, unit: str, shown: float) -> None:
    axes = draw_map(REFERENCE, None, (0.0, top)).axes[0]
    assert axes.get_ylabel() == f'bearing load [{unit}]'
    assert axes.get_ylim() == (0.0, shown)


def test_a_track_has_its_ends_and_the_alarm_marked() -> None:
    axes = draw_map(REFERENCE, track=round_trip()).axes[0]
    assert {'start', 'end'} <= {text.get_text() for text in axes.texts}
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == [CONDITION_NAMES[condition] for condition in Condition]
    arrows = [text for text in axes.texts if text.arrow_patch and not text.get_text()]
    assert len(arrows) == 5


def test_an_event_stands_on_the_last_point_up_to_it() -> None:
    track = Track(
        np.array([0.0, 1.0, 2.0]),
        np.array([0.3, 0.2, 0.1]),
        np.array([900.0, 950.0, 990.0]),
        [TrackEvent(1.7, Condition.STICK_SLIP)],
    )
    axes = draw_map(REFERENCE, track=track).axes[0]
    (mark,) = [line for line in axes.lines if line.get_label() == 'Stick-slip predicted']
    rpm = REFERENCE.bearing.speed.factor('rpm')
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (pytest.approx(0.2 / rpm), 950.0)


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
        pytest.approx(300.0, abs=1.0)
    )


def test_start_and_end_are_told_apart_where_they_are_one_place() -> None:
    column = np.array([0.3, 0.2, 0.3])
    axes = draw_map(REFERENCE, track=Track(np.arange(3.0), column, 3e3 * column)).axes[0]
    ends = [line for line in axes.lines if line.get_zorder() == 11]
    assert [line.get_marker() for line in ends] == ['o', 's']
    assert ends[0].get_markersize() > 1.5 * ends[1].get_markersize()


def test_each_boundary_has_one_colour_in_all_pictures() -> None:
    band = np.array([[[30.0] * 2, [31.0] * 2, [32.0] * 2]] * 2)
    dip = DipTrack(np.ones(2), np.ones(2), np.zeros(2, bool), np.zeros(2, bool))
    calibration = CalibrationPicture('', np.array([500.0, 900.0]), band, band, [dip])
    curve = np.linspace(0.0, 0.5, 9)
    marks = (
        Boundary('Hopf speed', 0.1, 0.09, 0.11, Regime.UNSTABLE),
        Boundary('fold speed', 0.2, 0.19, 0.21, Regime.BISTABLE),
    )
    law = Stribeck(0.3, 0.1, 10.0).coefficient(curve)
    fit = FrictionFitPicture(
        '', curve, law, None, np.ones(9, bool), np.arange(9), curve, law, 0.01 * law, marks, ''
    )
    for figure in (
        draw_map(REFERENCE),
        draw_diagram(REFERENCE, 1000.0, points=50),
        draw_calibration(calibration),
        draw_friction_fit(fit),
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
    assert track.time[gap - 1] < 10.0 < track.time[gap + 1] == pytest.approx(60.0)
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


def test_styles_of_others_are_neither_used_nor_touched() -> None:
    import matplotlib as mpl

    with mpl.rc_context({'font.size': 30.0}):
        figure = draw_diagram(REFERENCE, 1000.0, points=20)
        assert mpl.rcParams['font.size'] == 30.0
    assert figure.axes[0].xaxis.label.get_size() == 11.0


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


def test_turned_boxes_know_when_they_overlap() -> None:
    flat = Box.upright(np.zeros(2), 4.0, 2.0)
    turned = np.array([(1.0, 1.0), (-1.0, 1.0)]) / np.sqrt(2.0)
    assert flat.overlaps(Box(np.array([2.5, 1.0]), np.array([1.0, 1.0]), turned))
    # Their upright bounds overlap here, they themselves do not.
    assert not flat.overlaps(Box(np.array([3.0, 2.0]), np.array([1.0, 1.0]), turned))
    assert flat.covers(np.array([[1.9, 0.9], [2.1, 0.0]])).tolist() == [True, False]


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


def test_loads_are_said_in_the_unit_that_suits_them() -> None:
    assert [load_text(n) for n in (1000.0, 25000.0)] == ['1000 N', '25 kN']
