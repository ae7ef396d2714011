# SPDX-License-Identifier: Apache-2.0
"""The rule of the decision, against closed forms of the reference bearing at 1 kN.

``c/2m`` is 4 /s; the growth rate is ``4 (5 exp(-10 V) - 1)`` per second, 0 at the Hopf speed
``V_H = ln(5)/10``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from stickslip_monitor import Monitor, MonitorConfig, Stream
from stickslip_monitor.monitor.ladder import LADDER, Condition
from stickslip_monitor.monitor.scan import Scan

Configure = Callable[..., MonitorConfig]
SECOND = 10**9
RPM = math.pi * 0.1 / 60.0
HOPF = math.log(5.0) / 10.0 / RPM
FOLD = 0.2132256 / RPM
CAUTION, BISTABLE, STICK = (
    LADDER.index(c) for c in (Condition.CAUTION, Condition.BISTABLE, Condition.STICK_SLIP)
)


def _scan(
    config: MonitorConfig, time: Any, rpm: Any, load: Any = 1000.0, load_every: int = 1
) -> Scan:
    """Speed and load of the same instants; the load only at every so many."""
    time = np.asarray(time, float)
    rpm, load = np.broadcast_to(rpm, time.shape), np.broadcast_to(load, time.shape)
    own = np.arange(time.size) % load_every == 0
    times = np.concatenate([time, time[own]])
    order = np.argsort(times, kind='stable')
    stream = Stream(
        np.round(times * SECOND).astype(np.int64)[order],
        np.repeat([False, True], [time.size, own.sum()])[order],
        np.concatenate([rpm, load[own]])[order],
    )
    return Monitor(config).scan({'aft': stream}, 0)['aft']


def _events(scan: Scan) -> list[tuple[float, str]]:
    return [(event.time_ns / SECOND, str(event.after)) for event in scan.events]


def _growth(rpm: Any, load: Any = 1000.0) -> Any:
    return 4.0 * (load / 200.0 * np.exp(-10.0 * np.asarray(rpm) * RPM) - 1.0)


FAST = np.arange(0.0, 20.0, 0.01)


@pytest.mark.parametrize(
    ('rpm', 'rate', 'after'), [(20.0, 3.0183961, 0.6626035), (25.0, 1.4018168, 1.4267200)]
)
def test_it_is_predicted_to_run_when_a_disturbance_has_grown(
    configure: Configure, rpm: float, rate: float, after: float
) -> None:
    assert _growth(rpm) == pytest.approx(rate, rel=1e-7)
    scan = _scan(configure(alarm__onset_growth=2.0), FAST, rpm)
    predicted = scan.time_ns[scan.sticking.argmax()] / SECOND
    # The first value of an input does not count, and a point comes every 10 ms.
    assert after + 0.01 <= predicted <= after + 0.02 + 1e-9
    assert _events(scan)[0] == (predicted, 'stick_slip')


@pytest.mark.parametrize(('onset', 'after'), [(2.0, 6.3522110), (6.0, 10.8051758)])
def test_a_ramp_grows_beyond_the_hopf_speed(
    configure: Configure, onset: float, after: float
) -> None:
    time = np.arange(0.0, 60.0, 0.01)
    scan = _scan(configure(alarm__onset_growth=onset), time, 40.0 - 0.45 * time)
    hopf = (40.0 - HOPF) / 0.45
    predicted = scan.time_ns[scan.sticking.argmax()] / SECOND
    assert predicted - hopf == pytest.approx(after, abs=0.02)


@pytest.mark.parametrize(
    ('rpm', 'largest'),
    [(34.5, 0.0920919), (33.0, 0.7676147), (32.0, 1.4501232), (31.5, 1.8535806), (31, 2.2976251)],
)
def test_a_swell_that_does_not_grow_enough_raises_no_stick_slip(
    configure: Configure, rpm: float, largest: float
) -> None:
    """It was one alarm of 3596 s in an hour, at 34.5 rpm."""
    time = np.arange(0.0, 80.0, 0.02)
    load = 1000.0 * (1.0 + 0.25 * np.sin(2.0 * np.pi * time / 8.0))
    scan = _scan(configure(), time, rpm, load)
    grown = max(scan.course.at(k).growth for k in range(scan.time_ns.size))
    assert grown == pytest.approx(largest, rel=0.02)
    assert not scan.sticking.any()
    # Bistable all the time, or fluctuating across its boundary: told once.
    assert [after for _, after in _events(scan)] == ['bistable']


def test_noise_above_the_hopf_speed_raises_no_stick_slip(configure: Configure) -> None:
    """It was one alarm of 3597 s in an hour."""
    time = np.arange(0.0, 3600.0, 0.1)
    noise = np.random.default_rng(5).standard_normal(time.size)
    scan = _scan(configure(), time, 33.0, 1000.0 * (1.0 + 0.05 * noise))
    assert [after for _, after in _events(scan)] == ['bistable']


def test_a_cycle_outlives_the_fold_by_its_decay(configure: Configure) -> None:
    time = np.arange(0.0, 40.0, 0.01)
    rpm = np.where(time < 20.0, 20.0, 1.01 * FOLD)
    # For a moment back inside takes off as much: both ways.
    rpm[(time >= 20.5) & (time < 20.7)] = 0.95 * FOLD
    scan = _scan(configure(), time, rpm)
    end = scan.time_ns[np.flatnonzero(scan.sticking)[-1]] / SECOND
    assert end - 20.0 == pytest.approx(4.8 / 4.0 + 2 * 0.2, abs=0.03)


def test_without_a_memory_the_first_sample_below_the_hopf_speed_latches_to_the_fold(
    configure: Configure,
) -> None:
    config = configure(alarm__onset_growth=0.0, alarm__on_delay=0.0)
    rpm = [60.0, HOPF + 0.01, HOPF - 0.01, FOLD - 0.01, FOLD + 0.01, HOPF + 0.01]
    scan = _scan(config, np.arange(6.0), rpm)
    assert scan.sticking[0::2].tolist() == [False, False, True, True, False, False]


# Every 1.5 s, in thirty values of 20 Hz.
ODD = np.arange(1200) % 30 == 29


@pytest.mark.parametrize(
    ('rpm', 'load'),
    [
        (np.where(ODD, 60.0, 20.0), 1000.0),
        (np.where(ODD, 0.0, 20.0), 1000.0),
        (np.where(ODD, np.nan, 20.0), 1000.0),
        (20.0, np.where(ODD, 0.0, 1000.0)),
        (20.0, np.where(ODD, np.nan, 1000.0)),
    ],
)
def test_one_odd_sample_in_thirty_hides_nothing(configure: Configure, rpm: Any, load: Any) -> None:
    scan = _scan(configure(), np.arange(1200) * 0.05, rpm, load)
    ((time, after),) = _events(scan)
    assert after == 'stick_slip'
    assert time < 4.0


@pytest.mark.parametrize('every', [1, 20, 80])
def test_one_odd_sample_in_thirty_raises_nothing(configure: Configure, every: int) -> None:
    """A load of every 4 s, one value times 2.5 at 60 rpm: it was an ERROR."""
    time = np.arange(0.0, 600.0, 0.05)
    load = np.full(time.size, 1000.0)
    load[(np.arange(time.size) // every) % 30 == 29] = 3500.0
    rpm = np.where(np.arange(time.size) % 31 == 30, 20.0, 60.0)
    assert _events(_scan(configure(), time, rpm, load, every)) == []
    # Held for 4 s, times 3.5, where the point would be far inside.
    assert _growth(60.0, 3500.0) < 0.0 < _growth(46.0, 3500.0)
    held = _scan(configure(alarm__caution_margin=0.1), time, 46.0, load, every)
    assert not held.sticking.any()


@pytest.mark.parametrize('lag', [0.0, 2.5])
def test_inputs_of_one_value_in_five_seconds(configure: Configure, lag: float) -> None:
    """Stick-slip is told; one odd value in ten neither hides it nor raises it."""
    config = configure(speed__timeout=12.0, load__timeout=12.0)
    for usual, odd, raised in ((20.0, 60.0, True), (60.0, 20.0, False)):
        times = np.arange(0, 200)
        rpm = np.where(times % 10 == 7, odd, usual)
        stamps = np.stack([times * 5.0, times * 5.0 + lag], axis=1).reshape(-1)
        values = np.stack([rpm, np.full(200, 1000.0)], axis=1).reshape(-1)
        stream = Stream((stamps * SECOND).astype(np.int64), np.arange(400) % 2 == 1, values)
        scan = Monitor(config).scan({'aft': stream}, 0)['aft']
        assert [e.after for e in scan.events] == ([Condition.STICK_SLIP] if raised else [])
        assert not raised or scan.events[0].time_ns <= 30 * SECOND


def test_half_of_the_samples_garbage_does_not_raise_stick_slip(configure: Configure) -> None:
    time = np.arange(0.0, 300.0, 0.1)
    far = np.where(np.arange(time.size) % 2 == 0, 60.0, 30.0)
    assert _growth(60.0) + _growth(30.0) < 0.0
    assert not _scan(configure(), time, far).sticking.any()
    # Two of three inside hide nothing.
    most = np.where(np.arange(time.size) % 3 == 0, 60.0, 20.0)
    assert _scan(configure(), time, most).condition[-1] is Condition.STICK_SLIP


def test_a_stop_is_seen_before_the_fold(configure: Configure) -> None:
    """It was warned of 2.2 s before the onset, which is where the growth reaches 6."""
    time = np.arange(0.0, 40.0, 0.1)
    rpm = np.clip(70.0 - 70.0 / 12.0 * (time - 20.0), 0.0, 70.0)
    events = _events(_scan(configure(), time, rpm))
    grown = cumulative_trapezoid(np.maximum(_growth(rpm), 0.0), time, initial=0.0)
    onset = time[(grown >= 6.0).argmax()] - 20.0
    assert onset == pytest.approx(9.4350, abs=0.1)
    assert events[0][1] == 'caution'
    assert events[0][0] - 20.0 < 5.0189 - 0.5  # the fold
    assert onset - (events[0][0] - 20.0) > 5.0
    (alarm,) = (t for t, after in events if after == 'stick_slip')
    assert alarm - 20.0 < 9.4350
    plain = _events(_scan(configure(alarm__look_ahead=0.0), time, rpm))
    assert events[0][0] < plain[0][0] - 1.0


def test_it_does_not_look_ahead_without_a_trend(configure: Configure) -> None:
    """Between 1.4 and 3 times the fold, with noise and swell."""
    time = np.arange(0.0, 7200.0, 0.1)
    random = np.random.default_rng(8)
    speed = np.linspace(1.4, 3.0, time.size) * FOLD
    speed *= (
        1.0 + 0.02 * np.sin(2.0 * np.pi * time / 9.0) + 0.01 * random.standard_normal(time.size)
    )
    load = 1000.0 * (1.0 + 0.05 * random.standard_normal(time.size))
    assert _events(_scan(configure(), time, speed, load)) == []


@pytest.mark.parametrize('period', [20.0, 40.0, 90.0, 200.0, 400.0])
def test_what_crosses_the_boundary_again_and_again_is_no_burst_of_alarms(
    configure: Configure, period: float
) -> None:
    time = np.arange(0.0, 3600.0, 0.1)
    rpm = 45.0 + 25.0 * np.cos(2.0 * np.pi * time / period)
    scan = _scan(configure(), time, rpm)
    raised = np.array([event.time_ns for event in scan.events if event.raised])
    assert 0 < max(np.sum((raised >= t) & (raised < t + 600 * SECOND)) for t in raised) <= 10
    if period < 100.0:
        assert 'Fluctuating across the boundary' in scan.events[-1].text


def test_astern_is_the_same_picture(configure: Configure) -> None:
    time = np.arange(0.0, 120.0, 0.1)
    rpm = 60.0 - 50.0 * np.sin(np.pi * time / 120.0)
    ahead, astern = (_scan(configure(), time, sign * rpm) for sign in (1.0, -1.0))
    assert _events(ahead) == _events(astern) != []


@pytest.mark.parametrize('pause', [(0.0, 1000.0), (20.0, 0.0), (20.0, -5.0)])
def test_at_rest_or_unloaded_it_dies_out(configure: Configure, pause: tuple[float, float]) -> None:
    time = np.arange(0.0, 40.0, 0.1)
    rpm, load = (
        np.where(time < 10.0, usual, p) for usual, p in zip((20.0, 1e3), pause, strict=True)
    )
    scan = _scan(configure(), time, rpm, load)
    end = scan.time_ns[np.flatnonzero(scan.sticking)[-1]] / SECOND
    assert end == pytest.approx(11.2, abs=0.15)
    assert _events(scan)[-1][1] == 'normal'


def test_deadband_of_the_caution(configure: Configure) -> None:
    config = configure(
        alarm__caution_margin=0.1,
        alarm__hysteresis=0.02,
        alarm__on_delay=0.0,
        alarm__off_delay=0.0,
        alarm__look_ahead=0.0,
    )
    margins = [0.13, 0.11, 0.101, 0.099, 0.101, 0.119, 0.121, 0.11, 0.099]
    scan = _scan(config, np.arange(9.0), [FOLD * (1.0 + m) for m in margins])
    normal, caution = Condition.NORMAL, Condition.CAUTION
    assert scan.condition[0::2] == [normal] * 3 + [caution] * 3 + [normal] * 2 + [caution]


def test_deadband_of_the_amplitude(configure: Configure) -> None:
    # 0.26352, 0.52688 and 0.78708 mm at 10, 20 and 30 rpm; limit and clear in between.
    config = configure(
        alarm__amplitude_limit=0.6e-3,
        alarm__hysteresis=0.5,
        alarm__on_delay=0.0,
        alarm__off_delay=0.0,
    )
    time = np.arange(0.0, 50.0, 0.1)
    rpm = np.repeat([20.0, 30.0, 20.0, 10.0, 20.0], 100)
    stick, over = Condition.STICK_SLIP, Condition.AMPLITUDE
    conditions = _scan(config, time, rpm).condition
    assert [conditions[200 * k + 150] for k in range(5)] == [stick, over, over, stick, stick]
