# SPDX-License-Identifier: Apache-2.0
"""Messages of any type as numbers in order of time, and the definitions of their types."""

from __future__ import annotations

import math
from collections import deque
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import kit
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_monitor import build_config
from stickslip_monitor.errors import RosError
from stickslip_monitor.fields import parse_field
from stickslip_monitor.monitor.health import NodeHealth
from stickslip_monitor.monitor.monitor import Monitor

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from sensor_msgs.msg import JointState, MagneticField
from std_msgs.msg import Byte, Float64, Header

from stickslip_monitor.ros.inputs import check_inputs
from stickslip_monitor.ros.message_types import _type, definition, number_reader

TICK_NS = 250_000_000


class _Node:
    """Topics without ROS: messages wait until the test wakes their subscription."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now = now_ns
        self.queues: dict[str, deque[Any]] = {}
        self._callbacks: dict[str, Any] = {}

    def resolve_topic_name(self, topic: str) -> str:
        return topic

    def create_subscription(
        self, kind: Any, topic: str, callback: Any, *_: Any, **__: Any
    ) -> SimpleNamespace:
        waiting = self.queues[topic] = deque[Any]()
        self._callbacks[topic] = callback

        def take(*_: Any) -> Any:
            return (waiting.popleft(), {}) if waiting else None

        handle = nullcontext()
        handle.take_message = take  # type: ignore[attr-defined]
        return SimpleNamespace(handle=handle, msg_type=kind, raw=False)

    def wake(self, topic: str) -> None:
        """What the executor does with the first message that waits, if one still does."""
        if self.queues[topic]:
            self._callbacks[topic](self.queues[topic].popleft())


def _inputs(node: Any, kind: str, field: str, receive: Any) -> Any:
    """Two bearings on one shaft, each with a load of its own."""
    from stickslip_monitor.ros.inputs import Inputs

    values: dict[str, Any] = {'bearings': ['fore', 'aft']}
    for name in values['bearings']:
        own = {'alarm.on_delay': 0.5, 'alarm.off_delay': 0.5, 'alarm.amplitude_limit': 0.5e-3}
        for quantity, topic in (('speed', 'speed'), ('load', f'load/{name}')):
            source = {'topic': topic, 'type': kind, 'field': field, 'timeout': 2.0}
            own |= {f'{quantity}.{key}': value for key, value in source.items()}
        bearing = kit.parameters(own)
        del bearing['bearings']
        values |= {key.replace('aft', name, 1): value for key, value in bearing.items()}
    config = build_config(values)

    def deliver(numbers: Any) -> None:
        for number in numbers:
            receive(*number)

    inputs = Inputs(node, config, deliver, lambda: node.now, lambda each: each, NodeHealth())
    inputs.subscribe()
    return config, inputs


def test_messages_that_share_a_tick_of_the_clock_keep_their_order() -> None:
    """As at ``ros2 bag play --rate 10 --clock 40``: ten messages of 10 Hz to every four ticks."""
    from std_msgs.msg import Float64

    heard: list[tuple[int, float]] = []

    def receive(bearing: str, place: int, time_ns: int, value: float, latest: bool) -> None:
        if bearing == 'aft':
            heard.append((time_ns, value))

    node = _Node()
    _inputs(node, 'std_msgs/msg/Float64', 'data', receive)
    # Before the first /clock there is no time, and nothing is used.
    ticks = [0, 10**9, 10**9, 10**9, 10**9 + TICK_NS, 10**9 + TICK_NS, 5 * 10**8]
    for number, node.now in enumerate(ticks):
        node.queues['speed'].append(Float64(data=float(number)))
        node.wake('speed')
    assert heard == [
        (10**9, 1.0),
        (10**9 + 1, 2.0),
        (10**9 + 2, 3.0),
        (10**9 + TICK_NS, 4.0),
        (10**9 + TICK_NS + 1, 5.0),
        (5 * 10**8, 6.0),
    ]


TOPICS = ('speed', 'load/fore', 'load/aft')
ARRIVALS = st.lists(
    st.tuples(
        st.sampled_from(TOPICS),
        st.sampled_from([1, 40, 400, 3000]),  # since the message before [ms]
        st.sampled_from([20.0, 32.0, 45.0, 90.0]),
    ),
    min_size=20,
    max_size=120,
)


def _events(
    arrivals: list[tuple[str, int, float]], piles: list[tuple[int, int]]
) -> dict[str, list[Any]]:
    """What is told of each bearing; messages pile up before all topics are woken in turn.

    Args:
        arrivals: Topic, time since the message before [ms] and speed [rpm] of each message.
        piles: How many pile up, and which topic is woken first.
    """
    from geometry_msgs.msg import Vector3Stamped

    said: dict[str, list[Any]] = {'fore': [], 'aft': []}

    def receive(bearing: str, place: int, time_ns: int, value: float, latest: bool) -> None:
        said[bearing].extend(monitor.bearings[bearing].update(place, time_ns, value).events)

    node = _Node()
    config, _ = _inputs(node, 'geometry_msgs/msg/Vector3Stamped', 'vector.x', receive)
    monitor = Monitor(config)
    time_ms, todo = 10_000, deque(arrivals)
    for size, turn in piles:
        for topic, step, rpm in [todo.popleft() for _ in range(min(size, len(todo)))]:
            message, time_ms = Vector3Stamped(), time_ms + step
            message.header.stamp.sec, rest = divmod(time_ms, 1000)
            message.header.stamp.nanosec = rest * 10**6
            message.vector.x = rpm if topic == 'speed' else 1000.0
            node.queues[topic].append(message)
        for k in range(len(TOPICS)):
            node.wake(TOPICS[(k + turn) % len(TOPICS)])
    return said


@settings(max_examples=60, deadline=None)
@given(
    arrivals=ARRIVALS,
    piles=st.lists(st.tuples(st.integers(1, 12), st.integers(0, 2)), max_size=30),
)
def test_messages_that_wait_tell_what_they_tell_one_by_one(
    arrivals: list[tuple[str, int, float]], piles: list[tuple[int, int]]
) -> None:
    rest = [(1, 0)] * len(arrivals)
    assert _events(arrivals, [*piles, *rest]) == _events(arrivals, rest)


JOINT = 'sensor_msgs/msg/JointState'
COVARIANCE = 'magnetic_field_covariance'


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ({'speed.type': 'std_msgs/msg/Speed'}, "package std_msgs has no message type 'Speed'"),
        (
            {'speed.type': 'no_msgs/msg/Thing'},
            "message type 'no_msgs/msg/Thing' is not available: package no_msgs is not installed",
        ),
        (
            {'speed.type': 'std_msgs/msg/String'},
            "aft.speed.field 'data' of std_msgs/msg/String is a string, not a number",
        ),
        (
            {'speed.type': JOINT, 'speed.field': 'velocity'},
            f"aft.speed.field 'velocity' of {JOINT} is a sequence<double>, not a number",
        ),
        (
            {'speed.field': 'data[0]'},
            "aft.speed.field 'data[0]': [0] needs an array, but there is a double",
        ),
        (
            {'load.field': 'data.value'},
            "aft.load.field 'data.value': double has no field 'value'; it has: none, it is a"
            ' double',
        ),
        (
            {'speed.type': 'sensor_msgs/msg/MagneticField', 'speed.field': f'{COVARIANCE}[9]'},
            f"aft.speed.field '{COVARIANCE}[9]': index 9 is outside double[9]",
        ),
        (
            {'load.topic': 'shaft/speed', 'load.type': 'std_msgs/msg/Float32'},
            "aft.load.type = 'std_msgs/msg/Float32' must be the same as aft.speed.type ="
            " 'std_msgs/msg/Float64': both are read from shaft/speed",
        ),
        (
            {'load.topic': '/monitor/aft/amplitude'},
            "aft.load.topic = '/monitor/aft/amplitude' is published by this node itself",
        ),
    ],
)
def test_an_input_that_leads_to_no_number_is_refused(change: dict[str, Any], text: str) -> None:
    outputs = {'/monitor/aft/amplitude'}
    check_inputs(build_config(kit.parameters()), outputs)
    with pytest.raises(RosError) as error:
        check_inputs(build_config(kit.parameters(change)), outputs)
    assert str(error.value) == text


@pytest.mark.parametrize(
    ('message', 'path', 'number'),
    [
        (Float64(data=1.5), 'data', 1.5),
        (Byte(data=b'\xfa'), 'data', 250.0),
        (JointState(velocity=[1.0, 2.0]), 'velocity[1]', 2.0),
        (JointState(velocity=[1.0, 2.0]), 'velocity[2]', math.nan),  # an array too short
        (
            MagneticField(magnetic_field_covariance=[float(k) for k in range(9)]),
            f'{COVARIANCE}[8]',
            8.0,
        ),
        (JointState(header=Header()), 'header.stamp.sec', 0.0),
    ],
)
def test_the_number_at_a_path(message: Any, path: str, number: float) -> None:
    assert number_reader(parse_field(path))(message) == pytest.approx(number, nan_ok=True)


@pytest.mark.parametrize(
    'kind',
    [
        'std_msgs/msg/ByteMultiArray',
        'sensor_msgs/msg/JointState',
        'geometry_msgs/msg/PoseWithCovarianceStamped',
        'diagnostic_msgs/msg/DiagnosticArray',
    ],
)
def test_a_definition_has_the_fields_of_the_published_one(kind: str) -> None:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    made: dict[str, Any] = get_types_from_msg(definition(kind), kind)
    published = get_types_from_msg(store.generate_msgdef(kind, ros_version=2)[0], kind)
    assert set(made) == set(published)
    for name, (_, fields) in made.items():
        assert fields == store.fielddefs[name][1], name


def test_bounds_of_texts_and_arrays() -> None:
    assert _type('sequence<double, 5>') == 'float64[<=5]'
    assert _type('sequence<string<10>>') == 'string<=10[]'
