# SPDX-License-Identifier: Apache-2.0
"""When steady sliding turns unstable at the present rate: closed forms, and silence elsewhere.

Reference bearing, Stribeck: N (mu_s - mu_k) beta exp(-beta V) = c at the Hopf boundary, so
V_H = ln(N / 200 N) / 10 s/m, 0.160944 m/s at 1000 N.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import theilslopes

from stickslip_monitor import Monitor, MonitorConfig, Sample, Stream
from stickslip_monitor.monitor.config import BearingConfig
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.trend import Trend, TrendWindow, _line, may_cross

CONFIG = Path(__file__).parents[2] / 'launch_configs' / 'reference_bearing.yaml'
SECOND = 10**9
T0 = 1_700_000_000 * SECOND
HOPF = math.log(5.0) / 10.0
RPM = math.pi * 0.1 / 60.0
Configure = Callable[..., MonitorConfig]
Floats = Any


@pytest.fixture
def aft(configure: Configure) -> BearingConfig:
    return configure().bearing('aft')


def _trend(config: BearingConfig, time: Floats, speed: Floats, load: Floats) -> Trend | None:
    stamps = T0 + np.round(np.asarray(time) * SECOND).astype(np.int64)
    speed, load = np.broadcast_to(speed, stamps.shape), np.broadcast_to(load, stamps.shape)
    window = TrendWindow(config.alarm.trend_window_ns)
    window.fill(stamps, speed, load)
    return window.trend(config)


TIME = np.arange(0.0, 60.0, 0.1)
NOW = TIME[-1]


def test_slowing_down_to_the_hopf_speed(aft: BearingConfig) -> None:
    rate = (0.21 - HOPF) / 20.0
    trend = _trend(aft, TIME, 0.21 - rate * (TIME - NOW), 1000.0)
    assert trend is not None
    assert trend.seconds == pytest.approx(20.0, abs=0.5)
    # The boundary may lie a tenth higher or lower, and the interval is a quarter wider yet.
    assert trend.earliest == pytest.approx((0.21 - HOPF / 0.9) / rate / 1.25, abs=0.5)
    assert trend.latest == pytest.approx((0.21 - HOPF / 1.1) / rate * 1.25, abs=0.5)
    assert trend.span == pytest.approx(29.5, abs=1.0)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_growing_load(aft: BearingConfig, sign: float) -> None:
    # At 0.3 m/s steady sliding turns unstable above 200 N exp(3) = 4017 N; the fold is at 1524 N.
    rate = (200.0 * math.exp(3.0) - 1600.0) / 12.0
    trend = _trend(aft, TIME, 0.3 * sign, 1600.0 + rate * (TIME - NOW))
    assert trend is not None
    assert trend.seconds == pytest.approx(12.0, abs=0.5)


def test_both_at_once(aft: BearingConfig) -> None:
    speed, load = 0.21 - 0.002 * (TIME - NOW), 1000.0 + 5.0 * (TIME - NOW)
    expected = brentq(
        lambda t: 0.21 - 0.002 * t - math.log((1000.0 + 5.0 * t) / 200.0) / 10.0, 0.0, 70.0
    )
    trend = _trend(aft, TIME, speed, load)
    assert trend is not None
    assert trend.seconds == pytest.approx(expected, abs=0.5)


@pytest.mark.parametrize(
    'speed',
    [
        0.2,  # steady
        0.2 + 1e-3 * (TIME - NOW),  # going away
        0.2 - 1e-3 * (TIME - NOW),  # 40 s off: no forecast
        0.22 - 4e-3 * (TIME - NOW),  # above the fold
        0.15 - 1e-3 * (TIME - NOW),  # there already
        0.0,  # at rest
        0.17 + 0.07 * np.exp((NOW - 30.0 - TIME) / 8.0),  # levels off
    ],
)
def test_silence(aft: BearingConfig, speed: Floats) -> None:
    assert _trend(aft, TIME, speed, 1000.0) is None


def test_silence_until_there_is_enough(aft: BearingConfig) -> None:
    def after(seconds: float, rate: float, step: float = 0.1) -> Trend | None:
        time = np.arange(0.0, seconds, step)
        return _trend(aft, time, 0.27 - rate * time, 1000.0)

    assert after(14.0, rate=0.004) is None  # half a window of 30 s
    assert after(17.0, rate=0.004) is not None
    assert after(30.0, rate=0.0025, step=5.0) is None  # 6 points
    assert after(30.0, rate=0.0025, step=2.0) is not None


def test_a_window_of_zero_is_silent(configure: Configure) -> None:
    aft = configure(alarm__trend_window=0.0).bearing('aft')
    assert _trend(aft, TIME, 0.25 - 0.002 * TIME, 1000.0) is None


def test_swell_and_noise_without_a_trend_are_mostly_silent(aft: BearingConfig) -> None:
    random = np.random.default_rng(1)
    time = np.arange(0.0, 20_000.0, 0.1)
    swell = 0.8 * np.sin(2.0 * math.pi * time / 9.0)
    speed = (50.0 + swell + random.normal(0.0, 0.8, time.size)) * RPM
    load = 1000.0 + 30.0 * np.sin(time) + random.normal(0.0, 20.0, time.size)
    spoken = [
        _trend(aft, time[k - 400 : k], speed[k - 400 : k], load[k - 400 : k]) is not None
        for k in range(400, time.size, 400)
    ]
    assert len(spoken) == 499
    assert sum(spoken) <= 25  # as often as a 95 % interval may err


def test_true_in_noise(aft: BearingConfig) -> None:
    random = np.random.default_rng(2)
    rate = (0.21 - HOPF) / 20.0
    found = []
    for _ in range(200):
        speed = 0.21 - rate * (TIME - NOW) + random.normal(0.0, 0.8 * RPM, TIME.size)
        load = 1000.0 + random.normal(0.0, 20.0, TIME.size)
        found.append(_trend(aft, TIME, speed, load))
    told = [trend for trend in found if trend is not None]
    assert len(told) >= 190
    inside = sum(t.earliest <= 20.0 <= t.latest for t in told)
    assert inside >= 0.95 * len(told)
    assert np.median([t.seconds for t in told]) == pytest.approx(20.0, abs=1.5)


def test_what_is_too_uncertain_is_not_told(aft: BearingConfig) -> None:
    random = np.random.default_rng(3)
    rate = (0.21 - HOPF) / 20.0
    found = []
    for _ in range(100):
        speed = 0.21 - rate * (TIME - NOW) + random.normal(0.0, 3.0 * RPM, TIME.size)
        found.append(_trend(aft, TIME, speed, 1000.0))
    told = [trend for trend in found if trend is not None]
    assert 10 < len(told) < 90
    assert all(trend.latest <= 3.0 * 1.25**2 * trend.earliest for trend in told)


def test_one_slot_in_five_that_is_wrong_changes_little(aft: BearingConfig) -> None:
    rate = (0.21 - HOPF) / 20.0
    speed = 0.21 - rate * (TIME - NOW)
    speed[(TIME.astype(int) % 5) == 2] += 5.0
    trend = _trend(aft, TIME, speed, 1000.0)
    assert trend is not None
    assert trend.seconds == pytest.approx(20.0, rel=0.1)


@pytest.mark.parametrize('seed', range(5))
def test_the_slope_and_its_interval_are_those_of_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    time = np.sort(random.uniform(-30.0, 0.0, 26 + seed))
    value = 0.3 * time + random.normal(0.0, 2.0, time.size)
    line = _line(time, value)
    slope, _, low, high = theilslopes(value, time, alpha=0.95)
    assert (line.slope, line.low, line.high) == pytest.approx((slope, low, high), rel=1e-12)
    assert line.now == pytest.approx(np.median(value - slope * time))


@pytest.mark.parametrize('seed', range(20))
def test_a_window_filled_at_once_is_one_filled_point_by_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Slots with many points, with one and with none; stamps before and after zero, some equal.
    steps = rng.choice([0, 1_000_000, 300_000_000, 5_000_000_000], 500, p=[0.1, 0.5, 0.38, 0.02])
    stamps = np.cumsum(steps) + int(rng.integers(-(10**11), 10**18))
    speed, load = rng.normal(0.2, 1.0, 500), rng.normal(1e3, 1e2, 500)
    singly = TrendWindow(30_000_000_007)
    for row in zip(stamps.tolist(), speed.tolist(), load.tolist(), strict=True):
        singly.add(*row)
    together = TrendWindow(30_000_000_007)
    cut = int(rng.integers(0, 500))
    for part in (slice(cut), slice(cut, None)):
        together.fill(stamps[part], speed[part], load[part])
    # To the last bit: a batch and a stream say the same.
    assert list(together._slots) == list(singly._slots)
    assert together._last_ns == singly._last_ns


def test_memory_is_bounded_whatever_the_rate() -> None:
    window = TrendWindow(30 * SECOND)
    for millisecond in range(100_000):
        window.add(T0 + millisecond * 10**6, 0.2, 1000.0)
    assert len(window._slots) == 30


def test_the_rate_of_the_telemetry_does_not_matter(aft: BearingConfig) -> None:
    times = [
        _trend(aft, time, 0.21 - 0.0025 * (time - time[-1]), 1000.0)
        for time in (np.arange(0.0, 60.0, step) for step in (0.01, 0.1, 1.0, 2.5))
    ]
    expected = (0.21 - HOPF) / 0.0025
    assert [t.seconds for t in times if t] == [pytest.approx(expected, rel=0.01)] * 4


# --- in the monitor ----------------------------------------------------------------------------


def _monitor_config(configure: Configure, **changes: Any) -> MonitorConfig:
    return configure(alarm__on_delay=2.0, alarm__off_delay=5.0, **changes)


def test_the_text_of_a_warning(configure: Configure) -> None:
    monitor = Monitor(_monitor_config(configure))
    texts, trends = {}, {}
    for half in range(500):
        time, now = half / 2.0, T0 + half * SECOND // 2
        # 65 rpm down to 25 rpm at 0.5 rpm/s, and up again.
        rpm = max(65.0 - 0.5 * time, 25.0) if time < 200.0 else 25.0 + 0.4 * (time - 200.0)
        events = monitor.update(Sample('aft', 'load', now, 1000.0)).events
        for event in events + monitor.update(Sample('aft', 'speed', now, rpm)).events:
            texts.setdefault(str(event.after), event.text)
            trends.setdefault(str(event.after), (HOPF / RPM - rpm) / -0.5)
    # Nothing above the fold. 2 s after 40.723 rpm it is 39.7 rpm, and 30.738 rpm is 17.9 s away.
    assert 'rate' not in texts['caution']
    assert trends['bistable'] == pytest.approx(17.9, abs=1.1)
    seconds = round(trends['bistable'])
    assert f'Steady sliding turns unstable in about {seconds} s at this' in texts['bistable']
    # Where it sticks and the speed still falls, there is nothing to say.
    assert 'rate' not in texts['stick_slip']


def test_nothing_is_said_while_it_sticks_or_an_input_is_lost(configure: Configure) -> None:
    monitor = Monitor(_monitor_config(configure))
    bearing = monitor.bearings['aft']
    trends = []
    for tenth in range(900):
        now = T0 + tenth * SECOND // 10
        monitor.update(Sample('aft', 'load', now, 1000.0))
        monitor.update(Sample('aft', 'speed', now, 60.0 - 0.05 * tenth))
        trends.append(bearing.trend())
    assert trends[420] is not None
    assert bearing.standing.sticking
    assert trends[-1] is None
    monitor.advance(now + 100 * SECOND)
    assert bearing.trend() is None


def test_a_jump_of_the_clock_starts_anew(configure: Configure) -> None:
    monitor = Monitor(_monitor_config(configure))
    for tenth in range(330):
        monitor.update(Sample('aft', 'load', T0 + tenth * SECOND // 10, 1000.0))
        monitor.update(Sample('aft', 'speed', T0 + tenth * SECOND // 10, 60.0 - 0.06 * tenth))
    assert monitor.bearings['aft'].trend() is not None
    monitor.update(Sample('aft', 'speed', T0 - 60 * SECOND, 54.0))
    monitor.update(Sample('aft', 'load', T0 - 60 * SECOND, 1000.0))
    assert monitor.bearings['aft'].trend() is None


def _voyage(seed: int) -> Stream:
    """Ramps of speed and load with noise, gaps, jumps of the clock and uneven sampling."""
    random = np.random.default_rng(seed)
    times, loads, values, now = [], [], [], 0
    rpm, force = 60.0, 1000.0
    for _ in range(4):
        end_rpm = random.choice([60.0, 44.0, 36.0, 25.0, -25.0, -44.0, -60.0, 0.0])
        end_force = random.choice([1000.0, 1000.0, 700.0, 1500.0])
        now += int(random.choice([0, 0, 3, -20, -6])) * SECOND
        n = int(random.integers(10, 160))
        for part in np.linspace(0.0, 1.0, n):
            now += int(random.choice([0, 1, SECOND // 7, SECOND // 10]))
            is_load = bool(random.integers(2))
            value = force + part * (end_force - force) if is_load else rpm + part * (end_rpm - rpm)
            times.append(now)
            loads.append(is_load)
            values.append(value + random.normal(0.0, 0.05))
        rpm, force = end_rpm, end_force
    return Stream(np.array(times, np.int64), np.array(loads), np.array(values))


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(0.05, 0.5),
    st.floats(-0.004, 0.004),
    st.sampled_from([1e-4, 3e-3, 0.02]),
    st.sampled_from([0.1, 1.0, 2.5]),
)
def test_no_trend_is_missed_by_looking_only_where_there_may_be_one(
    seed: int, speed: float, rate: float, noise: float, step: float
) -> None:
    config = load_config(CONFIG).bearings[0]
    rng = np.random.default_rng(seed)
    time = np.cumsum(step * rng.choice([1.0, 1.0, 1.0, 12.0], 200))
    stamps = T0 + np.round(time * SECOND).astype(np.int64)
    speeds = speed + rate * (time - time[100]) + noise * rng.standard_normal(200)
    loads = 900.0 + 10.0 * rng.standard_normal(200)
    last = np.arange(200)
    may = may_cross(config, stamps, speeds, loads, np.zeros(200, np.intp), last)
    for k in np.flatnonzero(~may).tolist()[::5]:
        window = TrendWindow(config.alarm.trend_window_ns)
        window.fill(stamps[: k + 1], speeds[: k + 1], loads[: k + 1])
        assert window.trend(config) is None
