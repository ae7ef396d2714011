# SPDX-License-Identifier: Apache-2.0
"""Telemetry in: one subscription for each topic and type, feeding every bearing that reads it."""

from __future__ import annotations

import importlib
import math
import re
import time
from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any, NamedTuple

from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.serialization import deserialize_message

from stickslip_logs.field_paths import ByName, FieldPath, NoSuchElementError, NumberField
from stickslip_logs.units import SECOND_NS
from stickslip_monitor.errors import RosError
from stickslip_monitor.monitor.parameters import BearingConfig, InputConfig, MonitorConfig
from stickslip_monitor.monitor.session import Moment
from stickslip_monitor.monitor.value_check import refused

ROS_FAULTS = (
    *(NameValidationException, ParameterException, InvalidQosOverridesError),
    *(RuntimeError, ValueError),
)
"""What rclpy raises where a publisher or subscription cannot be made."""
_RULE = '=' * 80  # between the definitions of a type and its members
_PLAIN = {'boolean': 'bool', 'octet': 'byte', 'float': 'float32', 'double': 'float64'}
_SEQUENCE = re.compile(r'sequence<(?P<item>.+?)(?:, *(?P<most>\d+))?>')
_ARRAY = re.compile(r'(?P<item>.+)\[(?P<size>\d+)\]')
_BOUNDED = re.compile(r'(?P<kind>w?string)<(?P<most>\d+)>')
_NUMBERS = re.compile(r'(boolean|octet|byte|char|float|double|long double|u?int(8|16|32|64))')
# Two seconds at 1 kHz while the machine is busy.
_QUEUE_DEPTH = 2000
TURN_NS = 50_000_000
"""Time for messages in one turn [ns], before services, parameters and alarms have theirs."""
MAX_WAITING = 1000
"""Number of waiting messages, over all topics, beyond which some are skipped: 0.1 s on a fast core."""
MAX_ANSWERED = 20
"""Messages of a topic in one turn beyond which only the last is answered: 400 Hz."""
OVERRIDES = (QoSPolicyKind.DEPTH, QoSPolicyKind.DURABILITY, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY)
"""What a parameter ``qos_overrides...`` may change; a sender that latches needs durability."""
# Publishers, and names of elements, that are remembered for each topic; a robot has some dozen joints.
_MAX_REMEMBERED = 100

Tap = Callable[[str, str, bytes, int], None]
"""Takes topic, type, encoded message and its time [ns]."""


def make_input_qos() -> QoSProfile:
    """Make the quality of service of an input, best effort and volatile, which match every sender.

    Each subscription needs its own, as rclpy changes it.
    """
    return QoSProfile(
        depth=_QUEUE_DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


class Number(NamedTuple):
    """One number of one input."""

    bearing: str
    place: int  # the input, a place in :data:`.sample_types.INPUTS`
    time_ns: int  # when it was measured, or came [ns]
    arrival_ns: int  # when it came [ns]
    value: float  # the number, in the input's own scale


class Waiting(NamedTuple):
    """A received message that is not yet processed."""

    came_ns: int  # on the middleware's clock [ns]
    arrival_ns: int  # in ROS time [ns]; 0 where that is unknown
    lane: Lane
    data: bytes  # still encoded
    sender: bytes  # as the middleware calls it; empty where it does not


def resolve_topics(node: LifecycleNode, config: MonitorConfig) -> MonitorConfig:
    """Return a copy of the configuration with the full, remapped names of its topics."""

    def resolve_inputs(bearing: BearingConfig) -> BearingConfig:
        """Return a copy of a bearing with the full names of the topics of its inputs."""
        inputs: dict[str, Any] = {
            name: replace(source, topic=node.resolve_topic_name(source.topic))
            for name, source in bearing.inputs.items()
        }
        return replace(bearing, **inputs)

    return replace(config, bearings=tuple(map(resolve_inputs, config.bearings)))


def check_inputs(config: MonitorConfig, outputs: Container[str]) -> None:
    """Check that every input's message type exists and its field leads to a number.

    Args:
        config: The configuration with the full names of its topics.
        outputs: Full names of the topics that the node itself publishes.

    Raises:
        RosError: An input has no topic, or that of an output; its type or field cannot be used; or two
            inputs give one topic different types. The text names the parameter.
    """
    users: dict[str, tuple[str, str]] = {}
    for bearing in config.bearings:
        for quantity, source in bearing.inputs.items():
            name = f'{bearing.name}.{quantity}'
            if not source.topic:
                raise RosError(f'{name}.topic is missing: a node reads topics, a column is for logs')
            if source.topic in outputs:
                raise RosError(f"{name}.topic = '{source.topic}' is published by this node itself")
            check_field(name, source)
            user, kind = users.setdefault(source.topic, (name, source.type))
            if kind != source.type:
                rule = f"the same as {user}.type = '{kind}': both are read from {source.topic}"
                raise refused(f'{name}.type', source.type, rule, RosError)


class Inputs:
    """The subscriptions of an active node, and what waits on them.

    No executor takes these messages (:attr:`.MonitorNode.subscriptions`): the one that wakes for
    work only gives no message its number (its call with two arguments fails in ROS 2 Kilted), so
    that best-effort losses would be silent, and a turn of an executor for each message costs more
    than all that is done with it.

    Args:
        config: The configuration as given: names of topics are resolved once.
        clock: Reads the steady clock and the time by which the node measures.
        simulated: Whether a message came when ROS time says so, not the middleware.
        tap: Called with topic, type, encoded message and time before the numbers of it, if given.

    Raises:
        RosError: A message type is not installed.

    Attributes:
        piled: Whether a topic has more than :data:`MAX_ANSWERED` messages waiting.
    """

    def __init__(
        self,
        node: LifecycleNode,
        config: MonitorConfig,
        clock: Callable[[], Moment],
        simulated: bool,
        tap: Tap | None = None,
    ) -> None:
        self._clock, self._simulated, self._tap = clock, simulated, tap
        lanes: dict[tuple[str, str], Lane] = {}
        for bearing in config.bearings:
            for place, source in zip(bearing.places, bearing.inputs.values(), strict=True):
                key = source.topic, source.type
                lane = lanes[key] = lanes.get(key) or Lane(node, *key)
                lane.readings.append((bearing.name, place, number_reader(source.field, lane.note_names)))
        self.lanes = list(lanes.values())
        self.piled = False
        self._waiting: deque[Waiting] = deque()
        self._turned = 0, 0  # of the middleware, and ROS time

    def subscribe(self) -> None:
        """Create the subscriptions of all topics.

        Raises:
            Exception: One of :data:`ROS_FAULTS`: a subscription cannot be made; those before it stay.
        """
        for lane in self.lanes:
            lane.subscribe()

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        for lane in self.lanes:
            lane.destroy()

    def fetch(self, late: bool) -> None:
        """Move the messages of all topics from the middleware into the queue, sorted by arrival.

        If more than :data:`MAX_WAITING` wait then, only every n-th of each topic is kept. :attr:`piled` and
        the counts of the lanes are updated.

        Args:
            late: Whether the node was stalled, so that missing messages are not counted as lost.
        """
        now = self._clock()
        arrival = self._arrival_clock(now.time_ns) if self._simulated else None
        new = [one for lane in self.lanes for one in lane.fetch(arrival, late)]
        if len(self._waiting) + len(new) > MAX_WAITING:
            new = [one for lane in self.lanes for one in self._thin_out(lane, [*self._waiting, *new])]
            self._waiting.clear()
        # Across topics the middleware's clock says what was first.
        self._waiting = deque(sorted([*self._waiting, *new], key=itemgetter(0)))
        self.piled = max(Counter(one.lane for one in self._waiting).values(), default=0) > MAX_ANSWERED

    def take_numbers(self) -> Iterator[Number]:
        """Remove messages from the queue and yield their numbers, in the order of arrival.

        The tap is called with each message, and its sender is noted. After :data:`TURN_NS` the rest waits for
        the next call.
        """
        begun = self._clock().steady_ns
        while self._waiting and self._clock().steady_ns - begun < TURN_NS:
            yield from self._read_numbers(self._waiting.popleft())

    def _thin_out(self, lane: Lane, waiting: list[Waiting]) -> list[Waiting]:
        """Return every n-th of the messages of one topic, the last included; count the others as left out.

        ``n`` leaves the topic at most an equal share of :data:`MAX_WAITING`.

        Args:
            lane: The topic.
            waiting: Messages of all topics.
        """
        lane_messages = [one for one in waiting if one.lane is lane]
        step = len(lane_messages) * len(self.lanes) // MAX_WAITING + 1
        sampled = lane_messages[::-1][::step][::-1]
        lane.left_out += len(lane_messages) - len(sampled)
        return sampled

    def _arrival_clock(self, ros_ns: int) -> Callable[[int], int]:
        """Return a function that converts a time of the middleware in this turn to simulated time [ns].

        It interpolates between this turn, whose times are stored, and the one before: a fast replay moves
        by seconds in a turn. In the first turn, and after a step back, it always returns ``ros_ns``.
        """
        (begin, before), end = self._turned, time.time_ns()
        self._turned = end, ros_ns
        if not before or ros_ns < before or end <= begin:
            return lambda _: ros_ns
        pace = (ros_ns - before) / (end - begin)
        return lambda came: before + round(pace * (min(max(came, begin), end) - begin))

    def _read_numbers(self, waiting: Waiting) -> Iterator[Number]:
        """Yield the numbers of one message; none if it cannot be decoded or came before the first /clock.

        The tap takes it, and each number is noted as one of its sender.
        """
        _, arrival_ns, lane, data, sender = waiting
        # What comes before the first /clock has no time and is not used.
        message = lane.decode(data) if arrival_ns else None
        if message is None:
            return
        time_ns = lane.stamp(message) or arrival_ns
        if self._tap is not None:
            self._tap(lane.name, lane.type, data, time_ns)
        for bearing, place, read in lane.readings:
            if (value := read(message)) is not None:
                lane.note_reading(bearing, place, sender)
                yield Number(bearing, place, time_ns, arrival_ns, value)


@dataclass(slots=True)
class Sender:
    """Publisher of a topic, as its messages show it."""

    number: int  # of its latest message
    first: int  # its first among the messages of the topic
    last: int  # its latest among them
    readings: set[tuple[str, int]] = field(default_factory=set)  # bearing and input that it gave a number


class Lane:
    """One topic: its subscription, and the numbers that its messages bring.

    Attributes:
        name: The full name of the topic.
        type: The message type.
        readings: Bearing, place of the input and reader of each number that a message brings.
        stamp: Reads the time of measurement from a message [ns]; 0 for none.
        lost: Messages that never came, by the numbers of their publishers.
        left_out: Messages that were skipped because too many waited, or the node had stalled.
        senders: Who sends, by what the middleware calls it; up to :data:`_MAX_REMEMBERED`.
        undecodable: Whether the latest message could not be decoded.
        names: Elements that messages named which were not for an input.
        subscription: The subscription; ``None`` while there is none.

    Args:
        topic: The topic as configured.
        kind: The message type, as ``std_msgs/msg/Float64``.

    Raises:
        RosError: The message type is not installed.
    """

    def __init__(self, node: LifecycleNode, topic: str, kind: str) -> None:
        self._node, self._topic, self.type = node, topic, kind
        self.name = node.resolve_topic_name(topic)
        self.readings: list[tuple[str, int, Callable[[Any], float | None]]] = []
        self.names: set[str] = set()
        self.stamp = stamp_reader(kind)
        self.lost = self.left_out = 0
        self.subscription: Any = None
        self._class = import_message_type(kind)
        self.senders: dict[bytes, Sender] = {}
        self.undecodable = False
        self._came = 0
        # Senders that have sent nothing since the node was stalled.
        self._excused: set[bytes] = set()

    def subscribe(self) -> None:
        """Create and store the subscription.

        Raises:
            Exception: One of :data:`ROS_FAULTS`: it cannot be made.
        """
        self.subscription = self._node.create_subscription(
            self._class,
            self._topic,
            lambda _: None,
            make_input_qos(),
            raw=True,
            qos_overriding_options=QoSOverridingOptions(policy_kinds=OVERRIDES),
        )

    def destroy(self) -> None:
        """Destroy the subscription, if there is one."""
        if self.subscription is not None:
            self._node.destroy_subscription(self.subscription)

    def fetch(self, arrival: Callable[[int], int] | None, late: bool) -> Iterator[Waiting]:
        """Take and yield the messages that wait in the middleware, still encoded; count the missing ones.

        At most :data:`_QUEUE_DEPTH` are taken. Call :meth:`subscribe` first.

        Args:
            arrival: Converts a time of the middleware to ROS time [ns]; ``None`` where both are the same.
            late: Whether the node was stalled, so that missing messages are left out, not lost.
        """
        handle = self.subscription.handle
        if late:
            self._excused = set(self.senders)
        with handle:
            for _ in range(_QUEUE_DEPTH):
                taken = handle.take_message(self._class, True)
                if taken is None:
                    return
                data, info = taken
                came_ns = info.get('received_timestamp') or time.time_ns()
                self._count_missing(info, late)
                sender = (info.get('publisher_gid') or {}).get('data', b'')
                arrival_ns = came_ns if arrival is None else arrival(came_ns)
                yield Waiting(came_ns, arrival_ns, self, data, sender)

    def decode(self, data: bytes) -> Any:
        """Decode a message and set :attr:`undecodable`; return ``None`` where it cannot be decoded."""
        try:
            message = deserialize_message(data, self._class)
        except ROS_FAULTS:
            message = None
        self.undecodable = message is None
        return message

    def note_names(self, names: Iterable[str]) -> None:
        """Add the names of elements of a message to :attr:`names`, unless it is full already."""
        if len(self.names) < _MAX_REMEMBERED:
            self.names.update(names)

    def note_reading(self, bearing: str, place: int, sender: bytes) -> None:
        """Note that a sender, if it is known, gave an input a number."""
        if sender in self.senders:
            self.senders[sender].readings.add((bearing, place))

    def is_sending(self, publisher: bytes, bearing: str, place: int) -> bool:
        """Return whether a publisher has sent since the newest sender of an input began.

        A publisher that was restarted has two names for a while, of which the older sends no more. True
        also where the middleware does not say who sends.
        """
        senders = {name: one for name, one in self.senders.items() if (bearing, place) in one.readings}
        begun = max((one.first for one in senders.values()), default=0)
        sender = senders.get(publisher)
        return not begun or (sender is not None and sender.last >= begun)

    def _count_missing(self, info: Any, late: bool) -> None:
        """Note the sender and number of a message, and count those missing since its last one.

        They count as lost, but as left out up to a sender's first message in time after a stall. Of too many
        senders the oldest is forgotten. Without numbers, as in some ROS 2, nothing is noted. (The event of a
        lost message leaves out those for which the queue had no room.)

        Args:
            info: What the middleware says of the message.
            late: Whether the message came during a stall of the node.
        """
        publisher, number = info.get('publisher_gid'), info.get('publication_sequence_number')
        if publisher is None or number is None:
            return
        name = publisher['data']
        # Counted, as a clock that is set back would hide who sends.
        self._came += 1
        sender = self.senders.get(name) or Sender(number, self._came, self._came)
        missing = max(0, number - sender.number - 1)
        sender.number, sender.last = number, self._came
        self.senders[name] = sender
        if len(self.senders) > _MAX_REMEMBERED:
            del self.senders[next(iter(self.senders))]
        if name in self._excused:
            self.left_out += missing
        else:
            self.lost += missing
        if not late:
            self._excused.discard(name)


def import_message_type(name: str) -> Any:
    """Import the Python class of a message type such as ``std_msgs/msg/Float64``.

    Raises:
        RosError: Its package is not installed or has no such message.
    """
    package, _, message = name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), message)
    except ImportError as error:
        raise RosError(
            f"message type '{name}' is not available: package {package} is not installed"
        ) from error
    except AttributeError as error:
        raise RosError(f"package {package} has no message type '{message}'") from error


def _fields_of_type(name: str) -> dict[str, str]:
    """Return the fields of a type such as ``std_msgs/Header``, with their types as rclpy names them.

    Raises:
        RosError: It is not installed.
    """
    package, message = name.split('/')[0], name.split('/')[-1]
    return dict(import_message_type(f'{package}/msg/{message}').get_fields_and_field_types())


def compose_definition(name: str) -> str:
    """Return the concatenated ``ros2msg`` definition of a type such as ``sensor_msgs/msg/JointState``.

    It comes from the Python class, as not every installation has the ``.msg`` files; constants and
    default values, which that leaves out, have no part in how a message is encoded.

    Raises:
        RosError: It is not installed.
    """
    parts: dict[str, str] = {}
    waiting = [name.replace('/msg/', '/')]
    while waiting:
        current = waiting.pop(0)
        if current not in parts:
            fields = {field: _msg_type_text(text) for field, text in _fields_of_type(current).items()}
            parts[current] = ''.join(f'{kind} {field}\n' for field, kind in fields.items())
            waiting += [kind.split('[')[0] for kind in fields.values() if '/' in kind]
    root, *members = parts.items()
    return root[1] + ''.join(f'{_RULE}\nMSG: {kind}\n{text}' for kind, text in members)


def _msg_type_text(text: str) -> str:
    """Translate a field's type from rclpy's words into those of a ``.msg`` file, as double into float64."""
    if match := _SEQUENCE.fullmatch(text):
        bound = f'<={match["most"]}' if match['most'] else ''
        return f'{_msg_type_text(match["item"])}[{bound}]'
    if match := _ARRAY.fullmatch(text):
        return f'{_msg_type_text(match["item"])}[{match["size"]}]'
    if match := _BOUNDED.fullmatch(text):
        return f'{match["kind"]}<={match["most"]}'
    return _PLAIN.get(text, text)


def check_field(name: str, config: InputConfig) -> None:
    """Check that a field path leads to a number.

    Args:
        name: What the input is called in the error, e.g. ``aft_stern.speed``.
        config: The input.

    Raises:
        RosError: It leads elsewhere or nowhere, or a type on its way is not installed. The text names the
            step and the fields that exist.
    """
    current, label = config.type, f"{name}.field '{config.field_text}'"
    for step in config.field:
        current = _follow_step(label, current, step)
    if not _NUMBERS.fullmatch(current):
        raise RosError(f'{label} of {config.type} is a {current}, not a number')


def _follow_step(label: str, current: str, step: str | int | ByName) -> str:
    """Return the type to which a step of a field path leads from the type ``current``.

    An element that is chosen by name is taken to exist.

    Raises:
        RosError: It leads nowhere (the text begins with ``label``), or ``current`` is not installed.
    """
    if not isinstance(step, str):
        match = _SEQUENCE.fullmatch(current) or _ARRAY.fullmatch(current)
        if match is None:
            raise RosError(f'{label}: [{step}] needs an array, but there is a {current}')
        if isinstance(step, int) and step >= int(match.groupdict().get('size') or step + 1):
            raise RosError(f'{label}: index {step} is outside {current}')
        return match['item']
    fields = _fields_of_type(current) if '/' in current else {}
    if step not in fields:
        names = ', '.join(fields) or f'none, it is a {current}'
        raise RosError(f"{label}: {current} has no field '{step}'; it has: {names}")
    return fields[step]


def stamp_reader(type_name: str) -> Callable[[Any], int]:
    """Make a function that reads ``header.stamp`` [ns] of a type; 0 where it has none, or one before 1970.

    Raises:
        RosError: The type is not installed.
    """
    stamped = next(iter(_fields_of_type(type_name).items()), None) == ('header', 'std_msgs/Header')

    def read(message: Any) -> int:
        """Return the stamp [ns], 0 for one before 1970."""
        stamp = message.header.stamp
        return max(0, int(stamp.sec) * SECOND_NS + int(stamp.nanosec))

    return read if stamped else lambda _: 0


def number_reader(
    path: FieldPath, note_names: Callable[[Iterable[str]], None]
) -> Callable[[Any], float | None]:
    """Make a function that reads the number at a path from a message.

    The function returns ``nan`` where an array is too short, or has another element at that place, and
    ``None`` where a message names other elements only: ``note_names`` takes their names.
    """
    number = NumberField(path)

    def read(message: Any) -> float | None:
        """Return the number, ``nan`` where it is missing, ``None`` where only other elements are named."""
        try:
            return number.read(message)
        except NoSuchElementError as error:
            note_names(error.names)
            return None
        except LookupError:
            return math.nan

    return read
