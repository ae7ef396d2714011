# SPDX-License-Identifier: Apache-2.0
"""What lives only while the node is active: its ears, its services and its sense of time."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from stickslip_monitor.errors import ConfigurationError, plural
from stickslip_monitor.monitor.alarms.alarm_records import (
    ROS_SERVICE,
    ActionRequest,
    parse_request,
)
from stickslip_monitor.monitor.alarms.annunciator import Action, AlarmChange
from stickslip_monitor.monitor.monitor import BearingMonitor
from stickslip_monitor.monitor.session import Moment, Session
from stickslip_monitor.monitor.signals import LEVEL
from stickslip_monitor.ros.inputs import Guard, Inputs, Number, node_name
from stickslip_monitor.ros.message_types import ROS_FAULTS
from stickslip_monitor.ros.outputs import Configured

WATCHDOG_PERIOD = 0.1
LAG_NS = 500_000_000
"""The watchdog stays so far behind that a sample delivered late keeps the time of its stamp."""
SHOW_NS = 10**9
"""The state of all bearings is published so often [ns]."""
LOSS_PERIOD = 60.0
HELD_UP_NS = 10**9
"""A watchdog that comes so late [ns] says that the node was held up, not its inputs."""
_OVERDUE_NS = 2 * 10**8
"""After so long [ns] the watchdog comes before further messages, and takes all that wait."""
_DOUBLE_LOOKS = 5
TRIGGERS = (
    Action.ACKNOWLEDGE,
    Action.SILENCE,
    Action.RESET,
    Action.SHELVE,
    Action.UNSHELVE,
)
"""Services of type std_srvs/Trigger."""
SWITCHES = {
    'suppress': (Action.SUPPRESS, Action.UNSUPPRESS),
    'out_of_service': (Action.REMOVE, Action.RESTORE),
}
"""Services of type std_srvs/SetBool, with what true and false do."""


class Active:
    """The ears of a node, and its sense of time.

    Args:
        configured: What it has: session, publishers, clips.

    Raises:
        Exception: One of :data:`.message_types.ROS_FAULTS`: an input or service cannot be made.
    """

    def __init__(
        self, node: LifecycleNode, configured: Configured, survived: Guard, simulated: bool
    ) -> None:
        self._node, self._own, self._simulated = node, configured, simulated
        self._session, self._health = configured.session, configured.health
        self._log, self._take = node.get_logger(), survived(self._receive)
        tap = None if configured.clips is None else configured.clips.take
        self._inputs = Inputs(
            node, configured.config, self._deliver, self._now_ns, survived, self._health, tap
        )
        self._actions = Actions(node, list(self._session.monitor.bearings), self._session.act)
        self._ticker: Any = None
        try:
            self._inputs.subscribe()
            self._actions.serve()
        except ROS_FAULTS:
            self.destroy()
            raise
        now = self._now()
        self._watchdog, self._clock = Watchdog(self._session), PassingTime(simulated, now)
        self._running_ns = 0
        self._ticked_ns, self._shown_ns = now.steady_ns, -SHOW_NS
        self._looks = self._lost_told = self._lost_seen = 0
        self._lost_told_at = self._lost_at = -math.inf
        # A timer of the steady clock: those of ROS time stall when a replay steps back.
        self._ticker = node.create_timer(
            WATCHDOG_PERIOD, survived(self.tick), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def begin(self) -> None:
        """Watch from now on."""
        self._health.monitoring = True
        self._session.begin()
        self.tick()

    def end(self) -> None:
        """Nobody watches any more: this is published, and what is left of the clips is written."""
        self._health.monitoring = False
        self._session.end()
        self._own.end_clips()

    def destroy(self) -> None:
        """Take subscriptions, services and timer down."""
        self._inputs.destroy()
        self._actions.destroy()
        if self._ticker is not None:
            self._node.destroy_timer(self._ticker)

    def _now_ns(self) -> int:
        """ROS time [ns]; 0 while it is simulated and /clock is silent."""
        return self._node.get_clock().now().nanoseconds if self._simulated else time.time_ns()

    def _now(self) -> Moment:
        return Moment(time.monotonic_ns(), self._now_ns())

    def _deliver(self, numbers: Iterator[Number]) -> None:
        """Take what has come; publish what changed, and look at the time."""
        self._excuse(self._now())
        for number in numbers:
            self._take(number)
        now = self._now()
        if now.steady_ns - self._ticked_ns > _OVERDUE_NS:
            self.tick()
        else:
            self._session.flush(now)

    def _receive(self, number: Number) -> None:
        name, place, time_ns, value, latest = number
        update = self._session.take(name, place, time_ns, value, self._now(), latest)
        if update.status.valid and place != LEVEL:
            self._watchdog.note(name)

    def tick(self) -> None:
        """Look after everything that time brings."""
        now = self._now()
        late = now.steady_ns - self._ticked_ns > _OVERDUE_NS
        self._excuse(now)
        if late:
            # What waits comes first: no input is lost whose messages are there.
            # They have the time of now: while they are worked off, we are held up.
            for number in self._inputs.waiting():
                self._take(number)
        self._ticked_ns, now = now.steady_ns, self._now()
        if late:
            self._session.catch_up(now)
        passed_ns = self._clock.passed(now)
        self._running_ns += passed_ns
        self._watchdog.tick(now, passed_ns)
        self._session.tick(now, self._running_ns)
        self._own.tick_clips()
        if now.steady_ns - self._shown_ns >= SHOW_NS:
            self._shown_ns = now.steady_ns
            self._look(now)
            self._session.show(now)
        self._session.flush(now)

    def _excuse(self, now: Moment) -> None:
        """If we were held up, no input is to blame for that time."""
        held_ns = now.steady_ns - self._ticked_ns
        if held_ns <= HELD_UP_NS:
            return
        self._ticked_ns, held = now.steady_ns, held_ns * 1e-9
        self._health.delays += 1
        self._health.longest_delay = max(self._health.longest_delay, held)
        text = f'the node was held up for {held:.3g} s: answers were late, inputs are not to blame'
        self._log.warning(text)
        self._session.note('node', text)
        self._session.excuse(held_ns)
        # The alarms' time has passed, that of the inputs has not.
        self._running_ns += self._clock.passed(now)

    def _look(self, now: Moment) -> None:
        """Look after the node's own health, once a second."""
        self._inputs.count_missing()
        if self._looks % _DOUBLE_LOOKS == 0:
            self._look_for_double()
        self._looks += 1
        self._own.look_at_files()
        steady, lost = now.steady_ns * 1e-9, self._health.gone
        if lost > self._lost_seen:
            self._lost_seen, self._lost_at = lost, steady
        self._health.losing = steady - self._lost_at < LOSS_PERIOD
        if lost > self._lost_told and steady - self._lost_told_at >= LOSS_PERIOD:
            self._log.warning(
                f'{plural(lost - self._lost_told, "message")} lost on the way to the node,'
                f' {lost} since it was configured'
            )
            self._lost_told, self._lost_told_at = lost, steady

    def _look_for_double(self) -> None:
        own = (self._node.get_name(), self._node.get_namespace())
        before = self._health.double
        self._health.double = self._node.get_node_names_and_namespaces().count(own) > 1
        if self._health.double and not before:
            text = f'another node is called {self._node.get_fully_qualified_name()}, too'
            self._log.error(text)
            self._session.note('node', text)


class Actions:
    """The operator's actions: services for all bearings and for each, and a topic.

    A service of std_srvs names neither the caller nor the alarm; a request on the topic
    ``~/actions`` does.
    """

    def __init__(
        self,
        node: LifecycleNode,
        bearings: list[str],
        act: Callable[[ActionRequest], list[AlarmChange]],
    ) -> None:
        self._node, self._bearings, self._act = node, bearings, act
        self._services: list[Any] = []
        self._requests: Any = None

    def serve(self) -> None:
        """Offer all services, and listen to the topic."""
        for bearing in (None, *self._bearings):
            prefix = '~' if bearing is None else f'~/{bearing}'
            for action in TRIGGERS:
                self._serve(Trigger, f'{prefix}/{action}', bearing, action, action)
            for name, (on, off) in SWITCHES.items():
                self._serve(SetBool, f'{prefix}/{name}', bearing, on, off)
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._requests = self._node.create_subscription(String, '~/actions', self._on_request, qos)

    def destroy(self) -> None:
        """Take services and topic down."""
        if self._requests is not None:
            self._node.destroy_subscription(self._requests)
        for service in self._services:
            self._node.destroy_service(service)

    def _on_request(self, message: Any) -> None:
        log = self._node.get_logger()
        try:
            request = parse_request(json.loads(message.data), self._bearings)
        except (ConfigurationError, ValueError, RecursionError) as error:
            text = f'a request on ~/actions is refused: {error}'
            log.warning(text, throttle_duration_sec=1.0)
            return
        topic = self._node.resolve_topic_name('~/actions')
        senders = {node_name(info) for info in self._node.get_publishers_info_by_topic(topic)}
        who = ', '.join(sorted(senders)) or 'a node that has gone'
        what = '/'.join(part for part in (request.bearing, request.kind) if part) or 'all alarms'
        log.info(f'{request.action} of {what} asked for by {request.by} over {who}')
        self._act(request)

    def _serve(self, kind: Any, name: str, bearing: str | None, on: Action, off: Action) -> None:
        """Offer a service; of a Trigger both actions are one."""

        def serve(request: Any, response: Any) -> Any:
            action = on if getattr(request, 'data', True) else off
            what = bearing or 'all bearings'
            self._node.get_logger().info(f'{action} of {what} asked for by a {ROS_SERVICE} call')
            changes = self._act(ActionRequest(action, ROS_SERVICE, bearing))
            names = ', '.join(f'{change.bearing}/{change.kind}' for change in changes)
            nothing = f'there is nothing to {action}' if on is off else 'it is so already'
            response.success = bool(changes) or on is not off
            response.message = f'{action}: {names}' if names else nothing
            return response

        self._services.append(self._node.create_service(kind, name, serve))


class PassingTime:
    """The time that passes, on clocks that may stop or step.

    While ROS time follows a simulated clock that moves, that clock is the measure. One that
    stands still (the player has gone) cannot say that an input is lost, so then the steady clock
    is. A step back, and the first step from zero, count as no time.
    """

    def __init__(self, simulated: bool, now: Moment) -> None:
        self._simulated, self._last = simulated, now

    def passed(self, now: Moment) -> int:
        """The time since the last call [ns]."""
        last, self._last = self._last, now
        steady, simulated = now.steady_ns - last.steady_ns, now.time_ns - last.time_ns
        moving = self._simulated and simulated != 0 and last.time_ns != 0
        return max(simulated, 0) if moving else steady


class Watchdog:
    """Gives a session the time that passes without samples, bearing by bearing."""

    def __init__(self, session: Session) -> None:
        self._session = session
        # For how long each has had none, and from when it waits for them, on their clock [ns]; 0
        # for not yet.
        self._silent = dict.fromkeys(session.monitor.bearings, 0)
        self._bases = dict(self._silent)
        self._heard: set[str] = set()

    def note(self, name: str) -> None:
        """A valid sample of a bearing has come."""
        self._heard.add(name)

    def tick(self, now: Moment, passed_ns: int) -> None:
        """Pass on the time that has passed without samples, so much since the last call [ns]."""
        for name, bearing in self._session.monitor.bearings.items():
            if name in self._heard:
                self._silent[name], self._bases[name] = 0, bearing.now_ns or 0
                continue
            self._silent[name] += passed_ns
            elapsed = max(self._silent[name] - LAG_NS, 0)
            base = self._bases[name] = self._base(name, bearing, now, elapsed)
            if base:
                self._session.pass_time(name, base + elapsed, now)
        self._heard.clear()

    def _base(self, name: str, bearing: BearingMonitor, now: Moment, elapsed: int) -> int:
        """The time from which a bearing waits for samples [ns]; 0 for not yet.

        Inputs are waited for from the first instant that ROS time knows. Where it knows none for
        longer than a timeout, they are lost all the same.
        """
        base = self._bases[name]
        if base > 1:
            return base
        if now.time_ns:
            return now.time_ns - elapsed
        timeouts = (bearing.config.speed.timeout_ns, bearing.config.load.timeout_ns)
        return 1 if elapsed > min(timeouts) else base
