# SPDX-License-Identifier: Apache-2.0
"""The course in time: what it shows, and that thinning loses nothing of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip_monitor import Monitor, Stream
from stickslip_monitor.drawing.palette import CONDITION_COLOUR, FOLD, HOPF
from stickslip_monitor.drawing.timeline import Timeline, draw_timeline, marked_events
from stickslip_monitor.monitor.config import MonitorConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.offline.intervals import condition_intervals

pytest.importorskip('matplotlib')
CONFIG = load_config(Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml')
START = 1_777_874_400 * 10**9  # 2026-05-04 06:00:00 UTC


def timeline(
    speeds: Sequence[float] | np.ndarray,
    start: int = START,
    step: int = 10**9,
    config: MonitorConfig = CONFIG,
) -> Timeline:
    """The course of shaft speeds [rpm] at 1000 N, one sample a step [ns]."""
    times = start + np.repeat(np.arange(len(speeds)), 2).astype(np.int64) * step
    values = np.column_stack([speeds, np.full(len(speeds), 1000.0)]).ravel()
    stream = Stream(times, np.tile([False, True], len(speeds)), values)
    end = start + len(speeds) * step
    scan = Monitor(config).scan({'aft_stern': stream}, start, end)['aft_stern']
    return Timeline(config.bearings[0], scan, condition_intervals(scan.events, start, end))


def panels(figure: Any) -> dict[str, Any]:
    return {axes.get_ylabel().split(' ')[0].rstrip('.'): axes for axes in figure.axes}


def lowest(axes: Any) -> float:
    named = [line for line in axes.lines if not line.get_label().startswith('_')]
    return min(float(np.nanmin(line.get_ydata())) for line in named)


def test_one_bad_second_of_a_day_is_seen() -> None:
    speeds = np.full(86_400, 60.0)
    speeds[50_000:50_003] = [44.0, 20.0, 44.0]
    axes = panels(draw_timeline(timeline(speeds)))['margin']
    # 20 / 40.7231 - 1 = -0.50888, as a percentage
    assert lowest(axes) == pytest.approx(-50.888, abs=0.01)
    points = [len(line.get_xdata()) for line in axes.lines]
    assert max(points) < 2_000


def test_margins_amplitude_and_limit_are_drawn_in_their_units() -> None:
    figure = draw_timeline(timeline([60.0] * 20 + [20.0] * 20))
    found = panels(figure)
    assert list(found) == ['speed', 'load', 'margin', 'ampl', 'alarm']
    lines = {line.get_label(): line for line in found['ampl'].lines}
    # First-order KBM at 20 rpm: 0.52688 mm.
    assert np.nanmax(lines['predicted'].get_ydata()) == pytest.approx(0.52688, abs=1e-4)
    # The exact cycle there: 0.556755 mm; drawn only where stick-slip is predicted.
    assert np.nanmax(lines['exact'].get_ydata()) == pytest.approx(0.556755, abs=1e-4)
    assert np.isfinite(lines['exact'].get_ydata()).sum() < 41
    assert 'limit' in lines
    shown = [text.get_text() for text in found['speed'].texts]
    assert {'Hopf', 'fold'} <= set(shown)


def test_the_fold_has_its_colour_of_the_judged_course() -> None:
    margins = panels(draw_timeline(timeline([60.0, 45.0, 36.0])))['margin']
    colours = {line.get_label(): line.get_color() for line in margins.lines}
    assert colours['fold margin'] == FOLD
    assert colours['Hopf margin'] == HOPF


def test_events_are_numbered_as_in_the_table() -> None:
    course = timeline([60.0] * 20 + [20.0] * 60 + [60.0] * 60)
    figure = draw_timeline(course)
    speed = panels(figure)['speed']
    numbers = [text.get_text() for text in speed.texts if text.get_text().isdigit()]
    assert numbers == [str(i + 1) for i in range(len(course.scan.events))]
    # With a value a second growth counts for 1 per second at most, and 3 are due: 3 s after 20 s.
    days = (START + 23 * 10**9) / 86_400e9
    lines = [line.get_xdata()[0] for line in speed.lines if len(line.get_xdata()) == 2]
    assert any(abs(x - days) * 86_400 < 0.5 for x in lines)


def test_the_band_has_the_colours_of_the_alarm() -> None:
    from matplotlib.colors import to_rgba

    band = panels(draw_timeline(timeline([60.0] * 20 + [20.0] * 20)))['alarm']
    colours = {tuple(patch.get_facecolor()) for patch in band.patches}
    for condition in (Condition.NORMAL, Condition.STICK_SLIP):
        assert to_rgba(CONDITION_COLOUR[condition]) in colours


def test_without_a_cycle_there_is_no_amplitude_panel() -> None:
    found = panels(draw_timeline(timeline([60.0] * 20)))
    assert list(found) == ['speed', 'load', 'margin', 'alarm']


def test_a_line_is_interrupted_where_an_input_was_lost() -> None:
    speeds = [60.0] * 10
    course = timeline(speeds, step=20 * 10**9)
    line = panels(draw_timeline(course))['load'].lines[0]
    assert np.isnan(line.get_ydata()).sum() == len(speeds) - 1


def test_clocks_without_dates_and_clocks_with_one() -> None:
    dated = panels(draw_timeline(timeline([60.0] * 20)))['alarm']
    counted = panels(draw_timeline(timeline([60.0] * 20, start=0)))['alarm']
    assert dated.get_xlabel() == 'time [UTC]'
    assert counted.get_xlabel() == 'time from the start [s]'
    assert counted.get_xlim() == (0.0, 20.0)
    assert dated.get_xlim()[0] == pytest.approx(START / 86_400e9)


@pytest.mark.parametrize('count', [1, 2])
def test_next_to_nothing_is_drawn(count: int) -> None:
    draw_timeline(timeline([20.0] * count), 4.4)


def test_a_clock_that_jumps_back_is_drawn() -> None:
    times = START + np.array([0, 0, 1, 1, 2, 2, -100, -100, -99, -99], np.int64) * 10**9
    stream = Stream(times, np.tile([False, True], 5), np.tile([60.0, 1000.0], 5))
    scan = Monitor(CONFIG).scan({'aft_stern': stream}, START, START + 3 * 10**9)['aft_stern']
    course = Timeline(
        CONFIG.bearings[0],
        scan,
        condition_intervals(scan.events, START - 100 * 10**9, START + 3 * 10**9),
    )
    line = panels(draw_timeline(course))['load'].lines[0]
    assert np.isnan(line.get_ydata()).sum() == 1


def test_of_very_many_events_only_the_alarms_are_marked() -> None:
    # Sixty times from clear into the caution band and back, and one stick-slip.
    chatter = [43.0] * 10 + [60.0] * 10
    # Without an off-delay nothing is held.
    own = CONFIG.bearings[0]
    hasty = replace(own, alarm=replace(own.alarm, off_delay_ns=0))
    config = replace(CONFIG, bearings=(hasty,))
    course = timeline([*chatter * 30, *[20.0] * 20, *[60.0] * 20, *chatter * 30], config=config)
    events = course.scan.events
    assert len(events) > 100
    alarms = [i for i, e in enumerate(events, 1) if e.after is Condition.STICK_SLIP]
    assert [number for number, _ in marked_events(events)] == alarms
    band = panels(draw_timeline(course, 4.4))['alarm']
    assert len(band.patches) < 135
