# SPDX-License-Identifier: Apache-2.0
"""What the node must not blame on its inputs, must count, and must say as gravely as it is."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from stickslip_monitor.errors import BagError, RosError
from stickslip_monitor.monitor.clip_recorder import Clip
from stickslip_monitor.monitor.configure import build_config
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.session import tell_event
from stickslip_monitor.monitor.verdict import Event

pytest.importorskip('rclpy', reason='ROS 2 is not installed')


@pytest.mark.slow
def test_a_node_that_was_held_up_blames_no_input(start: Any, kit: Any) -> None:
    from std_msgs.msg import Float64

    monitor = start(kit.parameters({'speed.timeout': 2.0, 'load.timeout': 2.0}))
    peer, warnings, diagnostics = monitor.peer, monitor.warnings(), monitor.diagnostics()
    sensors = [
        (peer.talk(Float64, monitor.input(topic)), value)
        for topic, value in (('shaft/speed', 60.0), ('aft/load', 1000.0))
    ]

    def send(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for publisher, value in sensors:
                publisher.publish(Float64(data=value))
            peer.spin(0.1)

    send(2.0)
    peer.until(lambda: kit.status(diagnostics).get('reason') == 'normal', 'a quiet bearing')
    warnings.clear()
    for _ in range(2):
        monitor.process.send_signal(signal.SIGSTOP)
        send(5.0)
        monitor.process.send_signal(signal.SIGCONT)
        send(2.0)
    assert monitor.output.count('the node was held up for') >= 2
    assert [event['to'] for event in kit.events(warnings)] == []


def test_its_own_output_is_no_input() -> None:
    from stickslip_monitor.ros.inputs import check_inputs

    values = {
        'bearings': ['aft'],
        'aft.mass': 50.0,
        'aft.damping': 400.0,
        'aft.stiffness': 2.0e6,
        'aft.journal_diameter': 0.1,
        'aft.friction.static': 0.3,
        'aft.friction.kinetic': 0.1,
        'aft.friction.decay': 10.0,
        'aft.speed.topic': '/speed',
        'aft.speed.unit': 'rpm',
        'aft.load.unit': 'N',
        'aft.load.topic': '/stickslip_monitor/aft/amplitude',
    }
    config = build_config(values)
    check_inputs(config, set())
    with pytest.raises(RosError, match=r"^aft\.load\.topic = '.*' is published by this node its"):
        check_inputs(config, {'/stickslip_monitor/aft/amplitude'})


def test_a_flood_is_thinned_and_counted() -> None:
    from stickslip_monitor.ros.inputs import MOST_AT_ONCE, Lane

    def next_message() -> Any:
        return next(messages, None)

    node: Any = SimpleNamespace(now_ns=lambda: 10**9, resolve_topic_name=str)
    lane = Lane(node, '/speed', 'std_msgs/msg/Float64', [], 10**9, 0)
    lane._next = next_message  # type: ignore[method-assign]
    messages: Iterator[int] = iter(range(1, 1001))
    taken = [message for _, _, message in lane.waiting()]
    assert len(taken) <= MOST_AT_ONCE
    assert taken[-1] == 1000
    assert taken == sorted(taken)
    assert lane.thinned == 1000 - len(taken)
    messages = iter(range(MOST_AT_ONCE))
    # What is no flood is taken whole (None ends it, so 0 counts).
    assert len(lane.waiting()) == MOST_AT_ONCE


@pytest.mark.parametrize(
    ('before', 'after', 'grave'),
    [
        ('normal', 'caution', 'warning'),
        ('caution', 'stick_slip', 'error'),
        ('normal', 'input_stale', 'error'),
        ('stick_slip', 'bistable', 'info'),
    ],
)
def test_conditions_are_logged_as_gravely_as_they_are(before: str, after: str, grave: str) -> None:
    told: list[str] = []
    levels = ('info', 'warning', 'error')
    log: Any = SimpleNamespace(**{name: lambda _, n=name: told.append(n) for name in levels})
    tell_event(log, Event('aft', 1, Condition(before), Condition(after), None, False, {}, 'x'))
    assert told == [grave]


def test_a_double_of_the_node_is_noticed() -> None:
    from stickslip_monitor.monitor.health import NodeHealth
    from stickslip_monitor.ros.graph import has_double

    names = [('monitor', '/port'), ('monitor', '/starboard'), ('other', '/port')]
    node: Any = SimpleNamespace(
        get_name=lambda: 'monitor',
        get_namespace=lambda: '/port',
        get_node_names_and_namespaces=lambda: names,
    )
    assert not has_double(node)
    names.append(('monitor', '/port'))
    assert has_double(node)
    health = NodeHealth(monitoring=True, double=True)
    assert (health.level, health.message.split(':')[0]) == (
        1,
        'Another node has the same full name',
    )


def test_a_lost_clip_is_written_when_there_is_room_again(monkeypatch: pytest.MonkeyPatch) -> None:
    from stickslip_monitor.ros import event_clips

    monkeypatch.setattr(event_clips, 'RETRY_PERIOD', 0.02)
    full, written = threading.Event(), threading.Event()
    full.set()

    class Store:
        def write(self, clip: Clip) -> Iterator[None]:
            if full.is_set():
                raise BagError('No space left on device')
            written.set()
            yield

    log = SimpleNamespace(error=lambda text, **_: None)
    node: Any = SimpleNamespace(get_logger=lambda: log)
    clips = event_clips.Clips(node, SimpleNamespace(), Store())  # type: ignore[arg-type]
    clips._recorder = SimpleNamespace(  # type: ignore[assignment]
        clips=iter([[Clip('aft', Condition.STICK_SLIP, 1, ())], []]).__next__,
        finish=lambda: None,
    )
    clips._collect()
    end = time.monotonic() + 10.0
    while not clips.fault and time.monotonic() < end:
        time.sleep(0.01)
    assert clips.fault == 'an event clip is lost: No space left on device'
    full.clear()
    assert written.wait(10.0)
    clips.close()
    assert clips.fault == ''


@pytest.mark.parametrize(('name', 'kind'), [('single', 'SingleThreadedExecutor'), ('odd', '')])
def test_the_executor_can_be_chosen(name: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from stickslip_monitor.ros import run

    monkeypatch.setenv(run.EXECUTOR, name)
    if kind:
        monkeypatch.setattr(run, 'SingleThreadedExecutor', lambda: kind)
        assert run.make_executor() == kind
        return
    with pytest.raises(RosError, match="= 'odd' must be events or single"):
        run._check_environment([])
