# SPDX-License-Identifier: Apache-2.0
"""The course in time: what it shows, and that thinning loses nothing of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from made_logs import START
from matplotlib.colors import to_rgb
from sending import SECOND, change, points
from shared import CONFIG as REFERENCE_FILE

from stickslip_monitor import Monitor
from stickslip_monitor.arrays import FloatArray, IntArray
from stickslip_monitor.drawing.canvas import CONDITION_COLOUR, CONDITION_NAMES, FOLD
from stickslip_monitor.drawing.timeline import _TRUTH, Timeline, draw_timeline, marked_events
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.monitor.severity import Condition
from stickslip_monitor.offline.extremes import condition_intervals

pytest.importorskip('matplotlib')
CONFIG = load_config(REFERENCE_FILE)


def draw_course(
    speeds: Sequence[float] | np.ndarray,
    start: int = START,
    step: int = 10**9,
    config: MonitorConfig = CONFIG,
) -> Timeline:
    """Draw the course of shaft speeds [rpm] at 1000 N, one sample a step [ns]."""
    stream = points(speeds, 1000.0, step / SECOND, start)
    end = start + len(speeds) * step
    scan = Monitor(config).scan({'aft_stern': stream}, start, end)['aft_stern']
    return Timeline(config.bearings[0], scan, condition_intervals(scan.events, start, end))


def panels_by_name(figure: Any) -> dict[str, Any]:
    return {axes.get_ylabel().split(' ')[0].rstrip('.'): axes for axes in figure.axes}


def legend_of(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def lowest_value(axes: Any) -> float:
    named = [line for line in axes.lines if not line.get_label().startswith('_')]
    return min(float(np.nanmin(line.get_ydata())) for line in named)


def test_one_bad_second_of_a_day_is_seen() -> None:
    speeds = np.full(86_400, 60.0)
    speeds[50_000:50_003] = [44.0, 20.0, 44.0]
    axes = panels_by_name(draw_timeline(draw_course(speeds)))['margin']
    # 20 / 40.7231 - 1 = -0.50888, as a percentage
    assert lowest_value(axes) == pytest.approx(-50.888, abs=0.01)
    assert {line.get_label(): line.get_color() for line in axes.lines}['fold margin'] == FOLD
    points = [len(line.get_xdata()) for line in axes.lines]
    assert max(points) < 2_000


def test_margins_amplitude_and_limit_are_drawn_in_their_units() -> None:
    figure = draw_timeline(draw_course([60.0] * 20 + [20.0] * 20))
    panels = panels_by_name(figure)
    assert list(panels) == ['speed', 'load', 'margin', 'ampl', 'alarm']
    lines = {line.get_label(): line for line in panels['ampl'].lines}
    # The exact cycle at 20 rpm: 0.556755 mm.
    assert np.nanmax(lines['predicted'].get_ydata()) == pytest.approx(0.556755, abs=1e-5)
    # At 60 rpm nothing is predicted.
    assert np.all(np.asarray(lines['predicted'].get_ydata())[:10] == 0.0)
    assert np.nanmax(panels['load'].lines[0].get_ydata()) == pytest.approx(1.0)
    assert 'limit' in lines
    assert legend_of(panels['speed']) == ['Hopf', 'fold', 'measured']


def test_events_are_numbered_as_in_the_table() -> None:
    from matplotlib.colors import to_rgba

    course = draw_course([60.0] * 20 + [20.0] * 60 + [60.0] * 60)
    figure = draw_timeline(course)
    speed = panels_by_name(figure)['speed']
    numbers = [text.get_text() for text in speed.texts if text.get_text().isdigit()]
    assert numbers == [str(i + 1) for i in range(len(course.scan.events))]
    days = course.scan.events[-1].time_ns / 86_400e9
    lines = [line.get_xdata()[0] for line in speed.lines if len(line.get_xdata()) == 2]
    assert any(abs(x - days) * 86_400 < 0.5 for x in lines)
    colours = {tuple(patch.get_facecolor()) for patch in panels_by_name(figure)['alarm'].patches}
    for condition in (Condition.NORMAL, Condition.STICK_SLIP):
        assert to_rgba(CONDITION_COLOUR[condition]) in colours


def test_a_titled_picture_names_its_conditions_beside_the_title_and_above_the_numbers() -> None:
    course = replace(draw_course(([60.0] * 20 + [20.0] * 60) * 6 + [60.0] * 60), title='a voyage: aft_stern')
    figure = draw_timeline(course)
    figure.draw_without_rendering()
    (title,), (legend,) = figure.texts, figure.legends
    conditions = {CONDITION_NAMES[event.after] for event in course.scan.events}
    assert {text.get_text() for text in legend.get_texts()} == conditions
    assert legend.get_window_extent().x0 > title.get_window_extent().x1
    numbers = [text for text in panels_by_name(figure)['speed'].texts if text.get_text().isdigit()]
    # The first of three rows, which lie 10 points apart.
    lowest = min(text.get_window_extent().y1 for text in numbers)
    assert lowest + 2 * 10 / 72 * figure.dpi < title.get_window_extent().y0
    assert draw_timeline(replace(course, title='')).legends == []


def test_without_a_cycle_there_is_no_amplitude_panel() -> None:
    panels = panels_by_name(draw_timeline(draw_course([60.0] * 20)))
    assert list(panels) == ['speed', 'load', 'margin', 'alarm']


@pytest.mark.parametrize('later', [60, -1000], ids=['an input was lost', 'the clock jumps back'])
def test_a_line_is_interrupted_where(later: int) -> None:
    at = np.concatenate([np.arange(10), np.arange(10) + later])
    stream = points(np.full(20, 60.0), 1000.0, at, START)
    times = stream.time_ns
    scan = Monitor(CONFIG).scan({'aft_stern': stream}, START, int(times[-1]))['aft_stern']
    first, last = int(times.min()), int(times.max())
    course = Timeline(CONFIG.bearings[0], scan, condition_intervals(scan.events, first, last))
    line = panels_by_name(draw_timeline(course))['load'].lines[0]
    assert np.isnan(line.get_ydata()).sum() == 1


@pytest.mark.parametrize('count', [1, 2])
def test_next_to_nothing_is_drawn(count: int) -> None:
    draw_timeline(draw_course([20.0] * count), 4.4)


@pytest.mark.parametrize(('start', 'name'), [(START, 'time [UTC]'), (0, 'time from the start [s]')])
def test_times_of_a_date_are_told_from_those_of_a_start(start: int, name: str) -> None:
    assert draw_timeline(draw_course([60.0] * 20, start)).axes[-1].get_xlabel() == name


def test_a_narrow_picture_has_fewer_times_below_it() -> None:
    """Ten names of a time of day are wider than a phone."""
    course = draw_course([60.0] * 100)
    narrow, wide = (len(draw_timeline(course, width).axes[-1].get_xticks()) for width in (4.4, 9.0))
    assert narrow <= 6 < wide <= 10


def test_of_very_many_events_only_the_alarms_are_marked() -> None:
    changes = [(Condition.NORMAL, Condition.CAUTION), (Condition.CAUTION, Condition.NORMAL)] * 60
    changes[50] = (Condition.NORMAL, Condition.STICK_SLIP)
    events = [change(START + i * 10**9, old, new) for i, (old, new) in enumerate(changes)]
    assert [number for number, _ in marked_events(events)] == [51]
    assert [number for number, _ in marked_events(events[:30])] == list(range(1, 31))


def test_astern_is_drawn_by_its_size_and_as_what_it_is() -> None:
    rpm = np.linspace(60.0, -60.0, 121)
    axes = panels_by_name(draw_timeline(draw_course(rpm, start=0)))['speed']
    lines = {line.get_label(): np.array(line.get_data()) for line in axes.lines}
    for name, sign in (('measured', 1.0), ('astern', -1.0)):
        time, speed = lines[name][:, np.isfinite(lines[name][1])]
        np.testing.assert_allclose(speed, sign * rpm[time.astype(int)], atol=1e-9)
    # Sixty of the 121 seconds; at rest it goes neither way.
    astern = lines['astern']
    assert np.unique(astern[0][np.isfinite(astern[1])]).size == 60
    # Boundaries of the reference bearing at 1000 N.
    np.testing.assert_allclose(lines['Hopf'][1], 30.7380, atol=1e-4)
    np.testing.assert_allclose(lines['fold'][1], 40.7179, atol=1e-4)


@dataclass(frozen=True)
class FollowedNumbers:
    time_ns: IntArray
    value: FloatArray


@dataclass(frozen=True)
class FollowedLining:
    episodes: tuple[tuple[int, int], ...]
    hopf_margin: FollowedNumbers
    fold_margin: FollowedNumbers
    amplitude: FollowedNumbers


def test_true_episodes_are_drawn_beside_the_verdicts() -> None:
    course = draw_course([60.0] * 20 + [20.0] * 20, start=0)
    when = np.arange(40) * 10**9
    numbers = (when * 1e-11, when * 2e-11, np.full(40, 5e-4))
    episodes = ((25 * 10**9, 39 * 10**9),)
    lining = FollowedLining(episodes, *(FollowedNumbers(when, values) for values in numbers))
    panels = panels_by_name(draw_timeline(replace(course, lining=lining)))
    assert legend_of(panels['speed'])[0] == 'lining sticks'
    # Above the band of the alarm, and over the whole height of the others, which show through.
    for name, axes in panels.items():
        (span,) = (
            patch
            for patch in axes.patches
            if patch.get_extents().transformed(axes.transData.inverted()).intervalx.tolist() == [25.0, 39.0]
            and patch.get_facecolor()[:3] == to_rgb(_TRUTH)
        )
        low, high = span.get_extents().transformed(axes.transAxes.inverted()).intervaly
        opaque = name == 'alarm'
        expected = (0.7 if opaque else 0.0, 1.0, 1.0 if opaque else 0.15)
        assert (low, high, span.get_alpha()) == pytest.approx(expected)
    lines = {line.get_label(): np.array(line.get_data()) for line in panels['margin'].lines}
    assert lines['Hopf, true'][1].tolist() == pytest.approx(list(range(40)))
    lines = {line.get_label(): np.array(line.get_data()) for line in panels['ampl'].lines}
    assert lines['true'][1].tolist() == pytest.approx([0.5] * 40)
