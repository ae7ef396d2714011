# SPDX-License-Identifier: Apache-2.0
"""Messages of any type as numbers in order of time, and the definitions of their types."""

from __future__ import annotations

import math
import struct
from collections import deque
from contextlib import nullcontext
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import kit
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_logs.field_paths import parse_field
from stickslip_monitor import build_config
from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.bearing_monitor import Monitor
from stickslip_monitor.monitor.bearing_records import event_record
from stickslip_monitor.monitor.session import Moment

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from geometry_msgs.msg import Vector3Stamped
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, MagneticField
from std_msgs.msg import Byte, Float64, Float64MultiArray, Header

from stickslip_monitor.ros.inputs import (
    MAX_WAITING,
    TURN_NS,
    Inputs,
    Lane,
    _msg_type_text,
    check_inputs,
    compose_definition,
    number_reader,
)
from stickslip_monitor.ros.other_nodes import RosGraph, node_name

BEGIN = 1_700_000_000 * 10**9
STAMPED = 'geometry_msgs/msg/Vector3Stamped'


class _Node:
    """Topics without ROS: messages wait until they are taken.

    Attributes:
        now: ROS time and that of the middleware [ns].
    """

    def __init__(self) -> None:
        self.now, self.sent = 0, 0
        self.queues: dict[str, deque[Any]] = {}

    def resolve_topic_name(self, topic: str) -> str:
        return topic

    def create_subscription(self, kind: Any, topic: str, *_: Any, **__: Any) -> SimpleNamespace:
        waiting = self.queues[topic] = deque[Any]()
        handle = nullcontext()
        handle.take_message = lambda *_: waiting.popleft() if waiting else None  # type: ignore[attr-defined]
        return SimpleNamespace(handle=handle)

    def put(self, topic: str, message: Any, number: int | None = None, sender: bytes = b'sender') -> None:
        """Queue a message; encoded ones as they are."""
        data = message if isinstance(message, bytes) else serialize_message(message)
        self.sent += 1
        info = {'received_timestamp': self.now, 'publisher_gid': {'data': sender}}
        info['publication_sequence_number'] = self.sent if number is None else number
        self.queues[topic].append((data, info))


class _Clocks:
    """ROS time, and a steady clock that goes on by some nanoseconds whenever it is read."""

    def __init__(self, node: _Node, step_ns: int = 0) -> None:
        self.node, self.step_ns, self.steady_ns = node, step_ns, 0

    def __call__(self) -> Moment:
        self.steady_ns += self.step_ns
        return Moment(self.steady_ns, self.node.now)


def two_bearings_inputs(node: Any, kind: str, field: str, step_ns: int = 0, simulated: bool = False) -> Any:
    """Subscribe the inputs of two bearings on one shaft, each with a load of its own."""
    values: dict[str, Any] = {'bearings': ['fore', 'aft']}
    for name in values['bearings']:
        parameters = {'alarm.on_delay': 0.5, 'alarm.off_delay': 0.5, 'alarm.amplitude_limit': 0.5e-3}
        for quantity, topic in (('speed', 'speed'), ('load', f'load/{name}')):
            source = {'topic': topic, 'type': kind, 'field': field, 'timeout': 2.0}
            parameters |= {f'{quantity}.{key}': value for key, value in source.items()}
        bearing = kit.node_parameters(parameters)
        del bearing['bearings']
        values |= {key.replace('aft', name, 1): value for key, value in bearing.items()}
    config = build_config(values)
    inputs = Inputs(node, config, _Clocks(node, step_ns), simulated)
    inputs.subscribe()
    return config, inputs


def fetch_numbers(inputs: Any) -> list[Any]:
    """Return the numbers that a turn brings for the aft bearing."""
    inputs.fetch(False)
    return [number for number in inputs.take_numbers() if number.bearing == 'aft']


def lane_of(inputs: Any, topic: str) -> Any:
    (lane,) = (lane for lane in inputs.lanes if lane.name == topic)
    return lane


def test_simulated_time_of_arrival_is_between_turns() -> None:
    """At ``ros2 bag play --rate 20`` a turn is a second long."""
    node = _Node()
    _, inputs = two_bearings_inputs(node, 'std_msgs/msg/Float64', 'data', simulated=True)
    # Before the first /clock there is no time, and nothing is used.
    node.put('speed', Float64(data=1.0))
    assert fetch_numbers(inputs) == []
    node.now = BEGIN
    inputs.fetch(False)
    # The middleware has this machine's clock: after a tenth of a second a second has passed.
    wall = inputs._turned[0]
    inputs._turned = wall - 10**8, BEGIN
    for number in range(10):
        node.now = wall - 10**8 + 10**7 * number
        node.put('speed', Float64(data=float(number)))
    node.now = BEGIN + 10**9
    times = np.array([number.arrival_ns for number in fetch_numbers(inputs)])
    assert len(times) == 10
    assert (np.diff(times) > 0).all()
    assert BEGIN <= times[0] < times[-1] <= BEGIN + 10**9


def test_a_stamp_before_1970_is_none() -> None:
    node = _Node()
    _, inputs = two_bearings_inputs(node, STAMPED, 'vector.x')
    node.now = BEGIN
    for second in (-5, 0, BEGIN // 10**9 - 1):
        message = Vector3Stamped()
        message.header.stamp.sec = second
        node.put('speed', message)
    assert [n.time_ns for n in fetch_numbers(inputs)] == [BEGIN, BEGIN, BEGIN - 10**9]


@pytest.mark.parametrize(('held', 'counts'), [(False, (3, 0)), (True, (0, 3))])
def test_messages_missing_between_two_numbers_are_counted(held: bool, counts: tuple[int, int]) -> None:
    # Messages that are missing while the node stalled may not have been lost on the way.
    node = _Node()
    _, inputs = two_bearings_inputs(node, 'std_msgs/msg/Float64', 'data')
    node.now = BEGIN
    # The first number of a sender says nothing; one that begins anew has lost nothing.
    for number in (1, 2, 7, 8):
        node.put('speed', Float64(data=1.0), number)
    inputs.fetch(False)
    lane = lane_of(inputs, 'speed')
    assert (lane.lost, lane.left_out) == (4, 0)
    # Nothing waits yet at the turn that is late.
    inputs.fetch(held)
    for number in (12, 13, 2, 3):
        node.put('speed', Float64(data=1.0), number)
    inputs.fetch(False)
    assert (lane.lost - 4, lane.left_out) == counts
    node.put('speed', Float64(data=1.0), 5)
    inputs.fetch(False)
    assert lane.lost == 4 + counts[0] + 1


def test_without_a_name_or_number_nothing_is_counted() -> None:
    # Which facts ROS 2 gives with a message has grown from version to version.
    node = _Node()
    _, inputs = two_bearings_inputs(node, 'std_msgs/msg/Float64', 'data')
    for number in (1, 7):
        for missing in ('publisher_gid', 'publication_sequence_number'):
            node.put('speed', Float64(data=1.0), number)
            node.queues['speed'][-1][1][missing] = None
    inputs.fetch(False)
    assert (lane_of(inputs, 'speed').lost, lane_of(inputs, 'speed').senders) == (0, {})


def test_of_a_flood_every_so_many_are_left_out_and_the_last_is_not() -> None:
    node = _Node()
    _, inputs = two_bearings_inputs(node, 'std_msgs/msg/Float64', 'data')
    for number in range(1500):
        node.now = BEGIN + number
        node.put('speed', Float64(data=float(number)))
    values = [number.value for number in fetch_numbers(inputs)]
    lane = lane_of(inputs, 'speed')
    assert lane.left_out == 1500 - len(values)
    assert lane.lost == 0
    assert values[-1] == 1499.0
    assert len(values) <= MAX_WAITING
    assert len({b - a for a, b in pairwise(values)}) == 1
    # What waits from the turn before is thinned with the rest, and counted.
    for _ in range(2):
        for number in range(600):
            node.put('speed', Float64(data=float(number)))
        inputs.fetch(False)
    assert len(fetch_numbers(inputs)) + len(values) + lane.left_out == 2700


def test_a_turn_ends_by_time_and_the_next_goes_on() -> None:
    node = _Node()
    _, inputs = two_bearings_inputs(node, 'std_msgs/msg/Float64', 'data', step_ns=TURN_NS // 10)
    node.now = BEGIN
    for number in range(15):
        node.put('speed', Float64(data=float(number)))
    turns = [[n.value for n in fetch_numbers(inputs)] for _ in range(3)]
    assert [value for turn in turns for value in turn] == [float(k) for k in range(15)]
    assert all(0 < len(turn) <= 10 for turn in turns[:2])


def test_messages_that_cannot_be_decoded_are_known() -> None:
    graph = RosGraph(_Node(), [])  # type: ignore[arg-type]
    lane = Lane(_Node(), 'load', 'std_msgs/msg/Float64MultiArray')  # type: ignore[arg-type]
    graph.lanes['load'] = lane
    # By CDR: an empty layout, an offset of 0, and fifty numbers of which one is there.
    wrong = b'\0\1\0\0' + struct.pack('<IIId', 0, 0, 50, 1.0)
    assert lane.decode(wrong) is None
    assert graph.is_undecodable('load')
    assert lane.decode(serialize_message(Float64MultiArray(data=[2.0]))).data[0] == 2.0
    assert not graph.is_undecodable('load')


@pytest.mark.parametrize(
    ('sent_by', 'sends'),
    [((b'a', b'b'), [False, True]), ((b'a', b'b', b'a'), [True, True]), ((b'x', b'y'), [True, True])],
    ids=['came back', 'two', 'named otherwise'],
)
def test_senders_are_told_apart_by_the_order_of_messages(
    sent_by: tuple[bytes, ...], sends: list[bool]
) -> None:
    """Report two publishers as mixed though the clock was set back, or names do not match."""
    node: Any = _Node()
    infos = [
        SimpleNamespace(
            endpoint_gid=[*name],
            node_name='plc',
            node_namespace='/',
            topic_type='',
            qos_profile=QoSProfile(depth=1),
        )
        for name in (b'a', b'b')
    ]
    node.get_publishers_info_by_topic = lambda topic: infos
    node.get_subscriptions_info_by_topic = lambda topic: []
    node.get_name, node.get_namespace = (lambda: 'monitor'), (lambda: '/')
    graph, lane = RosGraph(node, []), Lane(node, 'speed', 'std_msgs/msg/Float64')
    graph.lanes['speed'] = lane
    lane.subscribe()
    for k, name in enumerate(sent_by):
        node.now = BEGIN - k * 10**12
        node.put('speed', Float64(data=1.0), sender=name)
    assert len([*lane.fetch(None, False)]) == len(sent_by)
    for name in sent_by:
        lane.note_reading('aft', 0, name)
    assert [publisher.sends for publisher in graph.publishers('speed', 'aft', 0)] == sends


TOPICS = ('speed', 'load/fore', 'load/aft')
ARRIVALS = st.lists(
    st.tuples(
        st.sampled_from(TOPICS),
        st.sampled_from([1, 40, 400, 3000]),  # since the message before [ms]
        st.sampled_from([20.0, 32.0, 45.0, 90.0]),
    ),
    min_size=20,
    max_size=80,
)


def events_of_bearings(arrivals: list[tuple[str, int, float]], piles: list[int]) -> dict[str, list[Any]]:
    """Return the events of each bearing, whose messages pile up before each turn.

    Args:
        arrivals: Topic, time since the message before [ms] and speed [rpm] of each message.
        piles: How many pile up.
    """
    events: dict[str, list[Any]] = {'fore': [], 'aft': []}
    node = _Node()
    config, inputs = two_bearings_inputs(node, STAMPED, 'vector.x')
    monitor = Monitor(config)
    node.now, todo = BEGIN, deque(arrivals)
    for size in piles:
        for topic, step, rpm in [todo.popleft() for _ in range(min(size, len(todo)))]:
            node.now += step * 10**6
            message = Vector3Stamped()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(node.now, 10**9)
            message.vector.x = rpm if topic == 'speed' else 1000.0
            node.put(topic, message)
        inputs.fetch(False)
        for name, place, time_ns, arrival_ns, value in inputs.take_numbers():
            update = monitor.bearings[name].update(place, time_ns, value, arrival_ns)
            events[name].extend(map(event_record, update.events))
    return events


@settings(max_examples=15, deadline=None)
@given(arrivals=ARRIVALS, piles=st.lists(st.integers(1, 12), max_size=30))
def test_messages_that_wait_give_the_same_events_as_one_by_one(
    arrivals: list[tuple[str, int, float]], piles: list[int]
) -> None:
    single = [1] * len(arrivals)
    assert events_of_bearings(arrivals, [*piles, *single]) == events_of_bearings(arrivals, single)


JOINT = 'sensor_msgs/msg/JointState'
COVARIANCE = 'magnetic_field_covariance'
VECTOR = 'geometry_msgs/msg/Vector3'


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
        ({'speed.field': 'data[0]'}, "aft.speed.field 'data[0]': [0] needs an array, but there is a double"),
        (
            {'load.field': 'data.value'},
            "aft.load.field 'data.value': double has no field 'value'; it has: none, it is a double",
        ),
        (
            {'speed.type': 'sensor_msgs/msg/MagneticField', 'speed.field': f'{COVARIANCE}[9]'},
            f"aft.speed.field '{COVARIANCE}[9]': index 9 is outside double[9]",
        ),
        (
            {'load.topic': 'shaft/speed', 'load.type': VECTOR, 'load.field': 'x'},
            f"aft.load.type = '{VECTOR}' must be the same as aft.speed.type ="
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
    check_inputs(build_config(kit.node_parameters()), outputs)
    with pytest.raises(RosError) as error:
        check_inputs(build_config(kit.node_parameters(change)), outputs)
    assert str(error.value) == text


@pytest.mark.parametrize(
    ('message', 'path', 'number'),
    [
        (Float64(data=1.5), 'data', 1.5),
        (Byte(data=b'\xfa'), 'data', 250.0),
        (JointState(velocity=[1.0, 2.0]), 'velocity[1]', 2.0),
        (JointState(velocity=[1.0, 2.0]), 'velocity[2]', math.nan),  # an array too short
        (MagneticField(magnetic_field_covariance=[float(k) for k in range(9)]), f'{COVARIANCE}[8]', 8.0),
        (JointState(header=Header()), 'header.stamp.sec', 0.0),
    ],
)
def test_the_number_at_a_path(message: Any, path: str, number: float) -> None:
    assert number_reader(parse_field(path), print)(message) == pytest.approx(number, nan_ok=True)


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
    written: dict[str, Any] = get_types_from_msg(compose_definition(kind), kind)
    published = get_types_from_msg(store.generate_msgdef(kind, ros_version=2)[0], kind)
    assert set(written) == set(published)
    for name, (_, fields) in written.items():
        assert fields == store.fielddefs[name][1], name


def test_bounds_of_texts_and_arrays() -> None:
    assert _msg_type_text('sequence<double, 5>') == 'float64[<=5]'
    assert _msg_type_text('sequence<string<10>>') == 'string<=10[]'


def test_the_name_of_a_publisher_without_a_node() -> None:
    # So rmw names a sender that is no ROS 2 node.
    ghost = SimpleNamespace(node_name='_NODE_NAME_UNKNOWN_', node_namespace='_NODE_NAMESPACE_UNKNOWN_')
    assert node_name(ghost) == 'a program that names no node'
    assert node_name(SimpleNamespace(node_name='meter', node_namespace='/')) == '/meter'
