# SPDX-License-Identifier: Apache-2.0
"""Measured vibration: what a level says, and what it adds to the verdict on speed and load.

The reference bearing at 1 kN: Hopf speed 30.74 rpm, fold speed 40.72 rpm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip_monitor import Monitor, MonitorConfig, Sample, Stream
from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.alarms.annunciator import Annunciator
from stickslip_monitor.monitor.alarms.causes import AlarmKind
from stickslip_monitor.monitor.config import LevelConfig
from stickslip_monitor.monitor.level_modes import LearnedThreshold
from stickslip_monitor.monitor.measured import MEASURED, LevelTracker, Unknown
from stickslip_monitor.monitor.scan import Scan
from stickslip_monitor.monitor.signals import Levels, Status
from stickslip_monitor.physics.averaging.boundaries import growth_rate

Configure = Callable[..., MonitorConfig]
SECOND = 10**9
QUIET, LOUD, THRESHOLD = 0.1, 10.0, 1.0
LEVEL = {'level__topic': '/v', 'level__threshold': THRESHOLD}


def _noisy(value: Any, seed: int = 1) -> Any:
    """A level that scatters by a tenth, as every live one does."""
    value = np.asarray(value, float)
    return value * (1.0 + 0.1 * np.random.default_rng(seed).standard_normal(value.shape))


def _tracker(configure: Configure, **changes: Any) -> LevelTracker:
    level = configure(**(LEVEL | changes)).bearings[0].level
    assert isinstance(level, LevelConfig)
    return LevelTracker(level)


def _said(tracker: LevelTracker, time: Any, value: Any, now: Any = None) -> list[str]:
    """What it says after each value, at its own time or at another."""
    now = time if now is None else now
    found = []
    for t, v, n in zip(*map(np.ravel, np.broadcast_arrays(time, value, now)), strict=True):
        tracker.add(round(t * SECOND), float(v))
        found.append(str(MEASURED[tracker.at(round(n * SECOND))]))
    return found


@pytest.mark.parametrize('rate', [0.1, 1.0, 10.0, 1000.0])
def test_it_takes_three_seconds_and_two_values(configure: Configure, rate: float) -> None:
    time = np.arange(0.0, max(20.0, 8.0 / rate), 1.0 / rate)
    half = time[-1] / 2.0
    level = _noisy(np.where(time < half, QUIET, LOUD))
    said = _said(_tracker(configure, level__timeout=15.0), time, level)
    for state, since in (('quiet', 0.0), ('vibrating', half)):
        first = time[said.index(state)]
        assert since + 3.0 - 1e-9 <= max(first, since + 3.0) <= since + 3.0 + 2.1 / rate
    assert said[-1] == 'vibrating'


def test_what_rings_down_is_no_vibration(configure: Configure) -> None:
    time = np.arange(0.0, 30.0, 0.1)
    after = np.maximum(time - 10.0, 0.0)
    blow = np.where(time < 10.0, QUIET, LOUD * np.exp(-after / 2.0))
    assert np.count_nonzero(blow > THRESHOLD) > 40
    assert 'vibrating' not in _said(_tracker(configure), time, _noisy(blow) + QUIET)


def _last(configure: Configure, kind: str) -> tuple[str, Unknown | None]:
    time = np.arange(0.0, 60.0, 0.5)
    now, value = time, _noisy(np.full(time.size, LOUD))
    if kind == 'dies at full scale':
        value = np.where(time < 20.0, _noisy(np.full(time.size, QUIET)), 1e6)
    elif kind == 'never changes':
        value = np.full(time.size, LOUD)
    elif kind == 'not a number':
        value = np.full(time.size, math.nan)
    elif kind == 'ten seconds late':
        now = time + 10.0
    elif kind == 'ten seconds ahead':
        now = time - 10.0
    elif kind == 'two publishers':
        value = np.where(np.arange(time.size) % 2, value, value / 100.0)
    tracker = _tracker(configure)
    said = _said(tracker, time, value, now)
    assert 'vibrating' not in said, kind
    return said[-1], tracker.why_unknown(round(now[-1] * SECOND))


@pytest.mark.parametrize(
    ('kind', 'why'),
    [
        ('dies at full scale', Unknown.STUCK),
        ('never changes', Unknown.STUCK),
        ('not a number', Unknown.NOTHING),
        ('ten seconds late', Unknown.LOST),
        ('ten seconds ahead', Unknown.LOST),
        ('two publishers', Unknown.SHORT),
    ],
)
def test_a_faulty_level_says_nothing_and_why(configure: Configure, kind: str, why: str) -> None:
    assert _last(configure, kind) == ('unknown', why)


def test_a_threshold_is_learned_from_both_modes() -> None:
    random = np.random.default_rng(5)
    learned = LearnedThreshold()
    for second in range(4000):
        learned.add(second * SECOND, float(random.normal(-20.0, 1.5)))
    assert math.isnan(learned.threshold)
    for second in range(4000, 4040):
        learned.add(second * SECOND, float(random.normal(20.0, 1.5)))
    # The least of 4000 exp(-(x + 20)^2/2s^2) + 40 exp(-(x - 20)^2/2s^2) is s^2 ln(4000/40)/40 off
    # the middle, and 20 (s - s')/(s + s') more where 40 values give the spread s' in place of s.
    assert learned.threshold == pytest.approx(1.5**2 * math.log(100.0) / 40.0, abs=4.0)


def _scan(config: MonitorConfig, rpm: Any, level: Any, end: float = 300.0) -> Scan:
    """Speed, load and level of the same instants, 5 times a second."""
    time = np.arange(0.0, end, 0.2)
    speed = np.broadcast_to(rpm(time) if callable(rpm) else rpm, time.shape)
    stream = Stream(
        np.repeat(np.round(time * SECOND).astype(np.int64), 2),
        np.arange(2 * time.size) % 2 == 1,
        np.stack([speed, np.full(time.size, 1000.0)], axis=1).reshape(-1),
    )
    if level is not None:
        own = np.round(time * SECOND).astype(np.int64)
        levels = Levels(own, np.asarray(level(time), float), 2 * np.arange(time.size))
        stream = Stream(stream.time_ns, stream.is_load, stream.value, levels)
    return Monitor(config).scan({'aft': stream}, 0)['aft']


def _events(scan: Scan) -> list[tuple[float, str]]:
    return [(event.time_ns / SECOND, str(event.after)) for event in scan.events]


def _between(start: float, end: float) -> Callable[[Any], Any]:
    return lambda time: _noisy(np.where((time >= start) & (time < end), LOUD, QUIET))


def test_a_knock_in_the_bistable_range_is_detected_and_over(configure: Configure) -> None:
    blind, seeing = configure(), configure(**LEVEL)
    assert 'stick_slip' not in [after for _, after in _events(_scan(blind, 36.0, None))]
    events = _events(_scan(seeing, 36.0, _between(100.0, 200.0)))
    (begin,) = (time for time, after in events if after == 'stick_slip')
    (over,) = (time for time, after in events if time > begin and after == 'bistable')
    assert 102.7 <= begin <= 104.0
    # Three seconds of quiet, and the delay of ten.
    assert 212.5 <= over <= 214.0


def test_a_level_that_is_lost_leaves_stick_slip_that_it_has_shown(configure: Configure) -> None:
    def level(time: Any) -> Any:
        return np.where(time < 120.0, _between(100.0, 200.0)(time), math.nan)

    events = _events(_scan(configure(**LEVEL), 36.0, level))
    assert events[-1][1] == 'stick_slip'
    assert 102.7 <= events[-1][0] <= 104.0


def test_vibration_just_outside_the_fold_is_taken_for_stick_slip(configure: Configure) -> None:
    scan = _scan(configure(**LEVEL), 44.0, _between(100.0, 200.0))
    (event,) = (event for event in scan.events if str(event.after) == 'stick_slip')
    assert 'are the parameters right?' in event.text


def test_the_engine_at_full_speed_is_no_stick_slip(configure: Configure) -> None:
    config = configure(**LEVEL)
    scan = _scan(
        config,
        lambda t: np.interp(t, [0, 100, 200, 300], [60, 60, 90, 60]),
        lambda t: _noisy(2.0 * (np.interp(t, [0, 100, 200, 300], [60, 60, 90, 60]) / 90) ** 4),
    )
    assert [after for _, after in _events(scan)] == ['vibration', 'normal']
    text = scan.events[0].text
    assert 'Vibration is measured where no stick-slip is possible' in text
    alarms = Annunciator(config)
    given = [c.kind for c in alarms.take_event(scan.events[0]) if c.raised]
    assert given == [AlarmKind.VIBRATION]
    assert AlarmKind.VIBRATION not in Annunciator(configure()).alarms['aft']


def _passage(time: Any) -> Any:
    return np.interp(time, [0, 20, 40, 240, 250], [60, 60, 20, 20, 60])


def test_a_prediction_that_is_not_seen_stays_and_is_doubted(configure: Configure) -> None:
    config = configure(**LEVEL)
    scan = _scan(
        config,
        _passage,
        _between(0.0, 0.0),
    )
    begin, end = np.flatnonzero(np.diff(scan.sticking))
    # Not after three e-folds, as without a level, but when it should stick, after six.
    points = scan.assessment
    rates = growth_rate(config.bearings[0].bearing, points.speed, points.load)
    grown = np.cumsum(np.maximum(rates[:-1], 0.0) * np.diff(scan.time_ns) * 1e-9)
    due = scan.time_ns[1:][np.searchsorted(grown, 6.0)] * 1e-9
    assert scan.time_ns[begin + 1] * 1e-9 == pytest.approx(due, abs=0.25)
    plain = _scan(configure(), _passage, None)
    assert np.flatnonzero(np.diff(plain.sticking))[0] < begin
    # It is over when steady sliding has been stable again, from 30.74 rpm on, for 4.8 times
    # 2m/c, 1.2 s, and not before.
    assert scan.time_ns[end] * 1e-9 == pytest.approx(240.0 + 10.74 / 4.0 + 1.2, abs=0.25)
    unseen = max(scan.course.at(k).unseen for k in range(scan.time_ns.size))
    assert 200.0 < unseen < 220.0
    live = Monitor(config)
    for time in np.arange(0.0, 100.0, 0.2):
        for quantity, value in (
            ('level', _noisy(QUIET, int(time * 10))),
            ('speed', 20.0),
            ('load', 1e3),
        ):
            live.update(Sample('aft', quantity, round(time * SECOND), float(value)))
    text = live.bearings['aft'].text()
    assert 'No vibration has been measured for' in text
    assert str(live.condition('aft')) == 'stick_slip'


def test_one_odd_value_does_not_let_quiet_end_a_prediction(configure: Configure) -> None:
    def odd(time: Any) -> Any:
        return np.where((time > 60.0) & (np.abs(time % 20.0 - 10.0) < 0.01), 36.0, _passage(time))

    scan = _scan(configure(**LEVEL), odd, _between(0.0, 0.0))
    # At 20 rpm, far below the Hopf speed of 30.74 rpm, with a value of 36 rpm every 20 s.
    begin, end = np.flatnonzero(np.diff(scan.sticking))
    assert scan.time_ns[begin] < 40 * 10**9
    assert scan.time_ns[end] > 240 * 10**9


@pytest.mark.parametrize(
    'level',
    [
        lambda t: np.full(t.size, math.nan),
        lambda t: np.full(t.size, LOUD),
        lambda t: np.full(t.size, math.inf),
        lambda t: np.where(np.arange(t.size) % 2, LOUD, QUIET),
        lambda t: np.full(t.size, -1.0),
    ],
)
@pytest.mark.parametrize('learns', [False, True])
def test_a_level_that_says_nothing_takes_nothing_away(
    configure: Configure, level: Any, learns: bool
) -> None:
    def rpm(time: Any) -> Any:
        return np.interp(time, [0, 60, 100, 150, 200, 240], [36, 36, 20, 20, 34, 60])

    plain = _scan(configure(), rpm, None)
    own = {'level__topic': '/v'} if learns else LEVEL
    seeing = _scan(configure(**own), rpm, level)
    assert _events(seeing) == _events(plain)
    assert seeing.sticking.tolist() == plain.sticking.tolist()
    assert seeing.rung.tolist() == plain.rung.tolist()


def test_an_absurd_level_is_an_alarm_on_the_input(configure: Configure) -> None:
    alarms = Annunciator(configure(**LEVEL, alarm__on_delay=0.0))
    (change,) = alarms.take_fault('aft', 2, Status.NOT_FINITE, SECOND)
    assert change.kind is AlarmKind.INPUT_IMPLAUSIBLE
    assert 'Input level implausible: values on /v are not a finite number' in change.text


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'level__threshold': 0.0}, 'level.threshold = 0 m/s\\^2 must be above 0'),
        ({'level__threshold': -1.0, 'level__unit': 'g'}, 'must be above 0'),
        ({'level__maximum': 0.5}, 'must not be above aft.level.maximum'),
        ({'level__hysteresis': -3.0}, 'level.hysteresis = -3.0 must be .* not below 0'),
        ({'level__topic': '/shaft/speed'}, 'same field as the speed, /shaft/speed data'),
        (
            {'level__topic': '/shaft/speed', 'level__field': 'b', 'level__type': 'a/msg/B'},
            "must be that of aft.speed, 'std_msgs/msg/Float64'",
        ),
        ({'level__topic': 'no topic'}, 'must be a ROS topic name'),
        ({'level__type': 'Float64'}, 'must be written package/msg/Type'),
        ({'level__field': 'a..b'}, 'aft.level.field'),
        ({'level__unit': 'furlong'}, 'must be one of'),
        ({'level__topic': ''}, "'aft.level.topic' is missing"),
        ({'level__timeout': 0.0}, 'above 0'),
    ],
)
def test_bad_configuration_is_named(
    configure: Configure, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        configure(**(LEVEL | changes))


def test_a_level_that_is_not_configured_is_refused(configure: Configure) -> None:
    with pytest.raises(ConfigurationError, match='no level is configured'):
        Monitor(configure()).update(Sample('aft', 'level', 0, 1.0))
