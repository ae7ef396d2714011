# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from typing import Any

import pytest

from stickslip_monitor import assess, build_config

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

# Reference bearing, 1000 N: Hopf speed 30.738 rpm, fold speed 40.7231 rpm (PHYSICS: closed forms);
# caution below 1.1 * 40.7231 = 44.795 rpm, until above 1.12 * 40.7231 = 45.610 rpm.
COAST = [(60.0 - 2.0 * t, float(t)) for t in range(20)] + [
    (20.0 + 2.0 * t, 20.0 + t) for t in range(20)
]
# The first speed beyond each boundary (44, 40 and 30 rpm down, 42 and 46 rpm up), and three s:
# at the inputs' rhythm a value counts for no more than a third of a delay.
EXPECTED = [
    (11.0, 'normal', 'caution', 'WARN', 38.0),
    (13.0, 'caution', 'bistable', 'WARN', 34.0),
    (18.0, 'bistable', 'stick_slip', 'ERROR', 24.0),
    (34.0, 'stick_slip', 'caution', 'WARN', 48.0),
    (36.0, 'caution', 'normal', 'OK', 52.0),
]


def test_warnings_arrive_clear_and_are_kept_for_late_joiners(start: Any, kit: Any) -> None:
    own = {'alarm.caution_margin': 0.1, 'alarm.look_ahead': 0.0}
    monitor = start(kit.parameters(kit.STAMPED, own))
    warnings = monitor.warnings()
    telemetry = kit.Telemetry(monitor)
    for rpm, seconds in COAST:
        telemetry.step(rpm, 1000.0, seconds)
    monitor.peer.until(lambda: len(warnings) >= len(EXPECTED), 'all events')
    heard = kit.events(warnings)
    assert [
        ((e['time'] - kit.T0) / kit.SECOND, e['from'], e['to'], e['level']) for e in heard
    ] == [expected[:4] for expected in EXPECTED]
    for event, (_, _, to, _, rpm) in zip(heard, EXPECTED, strict=True):
        assert event['schema'] == 'stickslip_monitor/warning/1'
        assert event['bearing'] == 'aft'
        assert event['reason'] == to
        assert event['speed'] == pytest.approx(math.pi * 0.1 * rpm / 60.0, rel=1e-12)
        assert event['load'] == 1000.0
        assert event['input_age'] == {}
        assert event['sticking'] is (to == 'stick_slip')
        assert event['fold_margin'] == pytest.approx(rpm / 40.7231 - 1.0, abs=2e-6)
        assert event['text'].startswith('aft: ')

    late = monitor.warnings()
    monitor.peer.until(lambda: len(late) >= len(warnings), 'latched warnings')
    assert [message.data for message in late] == [message.data for message in warnings]


def test_published_numbers_equal_the_assessment(start: Any, kit: Any) -> None:
    values = kit.parameters(kit.STAMPED)
    bearing = build_config(values).bearing('aft').bearing
    monitor = start(values)
    telemetry = kit.Telemetry(monitor)
    points = [(60, 1000), (35, 1000), (20, 1000), (20, 100), (0, 1000), (-20, 1000), (20, 0)]
    answers = {}
    for second, (rpm, load) in enumerate(points):
        answer = answers[rpm, load] = telemetry.step(rpm, load, second)
        expected = assess(bearing, bearing.speed.to_surface(float(rpm), 'rpm'), float(load))
        amplitude = 0.0 if math.isnan(expected.amplitude) else expected.amplitude
        assert answer == {
            'amplitude': amplitude,
            'amplitude_exact': pytest.approx(
                0.0 if math.isnan(expected.amplitude_exact) else expected.amplitude_exact,
                rel=1e-6,
            ),
            'hopf_margin': expected.hopf_margin,
            'fold_margin': expected.fold_margin,
            'regime': expected.regime.value,
        }
    assert answers[20, 1000]['amplitude'] == pytest.approx(0.52688e-3, abs=5e-9)
    # The exact column of PHYSICS.md.
    assert answers[20, 1000]['amplitude_exact'] == pytest.approx(0.556755e-3, abs=1e-9)
    assert answers[60, 1000]['amplitude'] == 0.0
    assert answers[20, 100] == {
        'amplitude': 0.0,
        'amplitude_exact': 0.0,
        'hopf_margin': math.inf,
        'fold_margin': math.inf,
        'regime': 'stable',
    }
    assert [answers[key]['regime'] for key in ((60, 1000), (35, 1000), (0, 1000))] == [
        'stable',
        'bistable',
        'undetermined',
    ]
    assert answers[-20, 1000] == answers[20, 1000]
