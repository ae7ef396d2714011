# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from typing import Any

import kit
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stickslip_monitor.errors import RosError
from stickslip_monitor.ros import outputs


def test_descriptors_have_ranges_units_and_rules(host: Any) -> None:
    names = ['aft.mass', 'aft.alarm.hysteresis', 'aft.alarm.on_delay', 'aft.speed.unit']
    answer = host(kit.stamped_parameters()).node.describe_parameters(names)
    mass, hysteresis, on_delay, unit = answer
    assert mass.description.startswith('Moving mass of the lining.')
    assert '[kg]' in mass.description
    assert 'Read-only while the node is active.' in mass.description
    (limits,) = mass.floating_point_range
    assert (limits.from_value, limits.to_value) == (1e-6, 1e7)
    (limits,) = hysteresis.floating_point_range
    assert (limits.from_value, limits.to_value, limits.step) == (0.0, 0.9, 0.0)
    assert 'Read-only' not in on_delay.description
    assert '[s]' in on_delay.description
    assert on_delay.additional_constraints.startswith('must be a')
    assert unit.additional_constraints == 'must be one of rpm, rad/s, Hz, m/s'
    assert not any(item.read_only for item in answer)


def test_thresholds_are_tuned_while_active(host: Any) -> None:
    monitor = host(kit.stamped_parameters())
    peer, warnings = monitor.peer, monitor.warnings()
    telemetry = kit.Telemetry(monitor)

    telemetry.hold(46.0, 1000.0, 1.0)  # fold margin 0.13
    assert not warnings
    assert monitor.set(aft__alarm__caution_margin=0.2) == [(True, '')]
    assert monitor.get('aft.alarm.caution_margin') == [0.2]
    telemetry.hold(46.0, 1000.0, 1.0)
    peer.until(lambda: [e['to'] for e in kit.decode_warnings(warnings)] == ['caution'], 'caution')

    # Two together, where each rests on the other; an integer for a number; the amplitude alarm.
    assert monitor.set(atomically=True, aft__alarm__minimum_speed=9, aft__speed__maximum=200) == [(True, '')]
    at_rest = telemetry.hold(20.0, 1000.0, 1.0)
    assert at_rest['regime'] == 'undetermined'
    assert monitor.set(atomically=True, aft__alarm__minimum_speed=0, aft__speed__maximum=0.15) == [(True, '')]
    assert telemetry.hold(20.0, 1000.0, 1.0)['regime'] == 'unstable'
    # The load that stands is converted: the same number is twice the load from now on.
    assert monitor.set(aft__alarm__amplitude_limit=0.5e-3, aft__load__scale=2) == [(True, '')] * 2
    answer = telemetry.hold(20.0, 500.0, 1.0)
    assert answer['amplitude'] == pytest.approx(0.52688e-3, abs=5e-9)
    peer.until(lambda: kit.decode_warnings(warnings)[-1]['to'] == 'amplitude_limit', 'the amplitude alarm')


def test_bad_values_are_refused_with_name_value_and_rule(host: Any) -> None:
    monitor = host(kit.node_parameters())

    def refusal_of(**changes: Any) -> str:
        values = monitor.get(*changes)
        ((successful, reason),) = monitor.set(atomically=True, **changes)
        assert not successful
        assert monitor.get(*changes) == values
        return reason

    # Outside the descriptor's range it is rclpy that refuses, in its own words.
    text = refusal_of(aft__alarm__hysteresis=0.95)
    assert all(word in text for word in ('aft.alarm.hysteresis', '0.95', '0.9'))
    assert 'aft.alarm.on_delay = -1 must be a' in refusal_of(aft__alarm__on_delay=-1)
    assert 'aft.alarm.caution_margin' in refusal_of(aft__alarm__caution_margin=math.nan)
    assert refusal_of(use_sim_time='later')
    assert refusal_of(use_sim_time=True, aft__alarm__on_delay=9.0) == (
        'use_sim_time = True cannot be set: it is read-only while the node is active; deactivate it first'
    )
    assert monitor.set(**{'': 1.0}) == [(False, "there is no parameter ''")]
    assert monitor.node.health.failures == 0
    # What rclpy deletes cannot be set again, whether it had a value or not.
    for name in ('aft.alarm.on_delay', 'aft.friction.speed'):
        text = f'{name} cannot be deleted: set it to a value'
        assert refusal_of(**{name.replace('.', '__'): None}) == text
    for changes in (
        {'aft__mass': 60.0},
        {'aft__speed__topic': 'elsewhere'},
        {'aft__alarm__on_delay': 1.0, 'aft__stiffness': 1e6},
    ):
        assert 'read-only while the node is active' in refusal_of(**changes)
    for fixed in ({'bearings': ['aft', 'fwd']}, {'state_file': '/tmp/x'}, {'aft__calibration': 'x'}):
        assert 'a running node keeps it' in refusal_of(**fixed)
    # The same value again is no change.
    assert monitor.set(aft__mass=50.0, bearings=['aft']) == [(True, '')] * 2
    # 'ros2 param load' of what 'ros2 param dump' wrote sets what has no value to this word.
    unset = {'aft__friction__speed': 'None', 'aft__level__threshold': 'None'}
    assert monitor.set(**unset) == [(True, '')] * 2
    assert monitor.set(**unset) == [(True, '')] * 2
    assert monitor.set(aft__alarm__on_delay=2.5) == [(True, '')]


def test_geometry_and_topics_change_between_activations(host: Any) -> None:
    from sensor_msgs.msg import JointState

    monitor = host(kit.stamped_parameters())
    telemetry = kit.Telemetry(monitor)
    first_answer = telemetry.step(20.0, 1000.0)
    assert monitor.go('deactivate')
    refusals = monitor.set(aft__mass=-1.0, aft__speed__field='velocity')
    assert [ok for ok, _ in refusals] == [False, False]
    assert "field 'velocity'" in refusals[1][1]
    assert monitor.set(
        atomically=True,
        aft__journal_diameter=0.2,
        aft__speed__topic='elsewhere',
        aft__load__topic='elsewhere',
    ) == [(True, '')]
    assert monitor.go('activate')
    margins, diagnostics = telemetry.received['fold_margin'], monitor.diagnostics()
    publisher = monitor.peer.talk(JointState, monitor.input('elsewhere'))
    margins.clear()
    publisher.publish(JointState(velocity=[20.0], effort=[1000.0]))
    monitor.peer.until(lambda: margins, 'an answer')
    assert margins[-1].data == pytest.approx(2.0 * (1.0 + first_answer['fold_margin']) - 1.0, rel=1e-12)
    # Nothing is left of the inputs of before.
    counts = {f'{name} samples accepted': '1' for name in ('speed', 'load')}
    monitor.peer.until(lambda: counts.items() <= kit.latest_status(diagnostics).items(), 'a fresh start')


@pytest.mark.parametrize('part', ['Outputs', 'Session'])
def test_a_change_that_cannot_be_made_leaves_the_node_as_it_was(
    host: Any, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    """Let the new publishers, and the new session, fail once each."""
    monitor = host(kit.stamped_parameters())
    telemetry = kit.Telemetry(monitor)
    first_answer = telemetry.step(20.0, 1000.0)
    assert monitor.go('deactivate')

    def fail(*_: object) -> None:
        raise RosError('no more handles')

    with monkeypatch.context() as patched:
        patched.setattr(outputs, part, fail)
        assert monitor.set(aft__journal_diameter=0.2) == [(False, 'no more handles')]
    assert monitor.go('activate')
    assert telemetry.step(20.0, 1000.0)['fold_margin'] == first_answer['fold_margin']
