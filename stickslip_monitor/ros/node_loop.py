# SPDX-License-Identifier: Apache-2.0
"""The loop of an active node: messages in, time passing, stalls."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode

from stickslip_logs.units import SECOND_NS
from stickslip_monitor.host import BEHIND_NS, SHOW_NS, HostClock
from stickslip_monitor.monitor.alarm_list import Action, AlarmChange
from stickslip_monitor.monitor.alarm_records import ActionRequest
from stickslip_monitor.monitor.bearing_monitor import BearingMonitor
from stickslip_monitor.monitor.bearing_records import CLOCKS, LATELY_NS
from stickslip_monitor.monitor.sample_types import LEVEL
from stickslip_monitor.monitor.session import Moment, Session
from stickslip_monitor.ros.actions import Actions
from stickslip_monitor.ros.inputs import ROS_FAULTS, TURN_NS, Inputs, Number
from stickslip_monitor.ros.other_nodes import node_name
from stickslip_monitor.ros.outputs import Configured

TURN_PERIOD = TURN_NS / SECOND_NS
"""Time between two turns of the node [s]: half the period of telemetry of 10 Hz."""
WATCHDOG_NS = 2 * TURN_NS
"""Time between two checks for lost inputs [ns]."""
LATE_NS = 4 * TURN_NS
"""Time between two turns beyond which the node was stalled, and its inputs are not to blame [ns]."""
LONG_STALL_NS = SECOND_NS
"""Length of a stall from which it is reported [ns]."""
STILL_NS = SECOND_NS
"""Time without a step after which a simulated clock counts as stopped, not slow [ns]."""
_DOUBLE_LOOKS = 5
"""Seconds between two checks of the ROS graph for another node of this name."""
Guard = Callable[[Callable[..., Any]], Callable[..., Any]]
"""Makes a callback whose exceptions are reported, and do not end the node."""
ReadClock = Callable[[], Moment]


def node_clock(node: LifecycleNode, simulated: bool) -> ReadClock:
    """Make a function that reads the steady clock, and the time by which a node measures.

    That is ROS time where it is simulated (0 before the first /clock), else the clock of this machine.
    """
    if simulated:
        ros = node.get_clock()
        return lambda: Moment(time.monotonic_ns(), ros.now().nanoseconds)
    return HostClock().now


class NodeLoop:
    """Receives samples and drives the timers of an active node.

    Args:
        configured: What it has: session, publishers, clips; its graph is given the lanes.
        guard: Makes the callback of the timer, and that of a number.
        clock: Reads the steady clock and the time by which the node measures.
        simulated: Whether ROS time follows /clock.

    Raises:
        Exception: One of :data:`.inputs.ROS_FAULTS`: an input or service cannot be made. Where a
            subscription cannot, what was made is destroyed.
    """

    def __init__(
        self, node: LifecycleNode, configured: Configured, guard: Guard, clock: ReadClock, simulated: bool
    ) -> None:
        self._node, self._own, self._simulated = node, configured, simulated
        self._session, self._health = configured.session, configured.health
        self._log, self._take, self._now = node.get_logger(), guard(self._take_number), clock
        tap = None if configured.clips is None else configured.clips.tap
        self.inputs = Inputs(node, configured.config, clock, simulated, tap)
        configured.graph.lanes = {lane.name: lane for lane in self.inputs.lanes}
        self._actions = Actions(node, list(self._session.monitor.bearings), self._carry_out)
        self._ticker: Any = None
        try:
            self.inputs.subscribe()
        except ROS_FAULTS:
            self.destroy()
            raise
        now = clock()
        self._watchdog, self._passing = Watchdog(self._session), PassingTime(simulated, now)
        self._running_ns = self._looks = 0
        self._turned, self._ticked_ns = now, now.steady_ns
        self._late, self._latest, self._awaits_clock = False, True, False
        self._set_ns, self._shown_ns = now.set_ns, -SHOW_NS
        # A timer of the steady clock: those of ROS time stall when a replay steps back.
        self._ticker = node.create_timer(
            TURN_PERIOD, guard(self.turn), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def begin(self) -> None:
        """Mark the node as monitoring, publish the list of alarms, and wait for the inputs from now on."""
        self._health.monitoring = True
        self._session.begin()
        self._let_time_pass(self._now())

    def end(self) -> None:
        """Mark the node as not monitoring, publish that, and write the unfinished clips."""
        self._health.monitoring = False
        self._session.end()
        self._own.end_clips()

    def destroy(self) -> None:
        """Destroy subscriptions, services, the topic of requests and the timer; end all turns."""
        self.inputs.destroy()
        self._actions.destroy()
        ticker, self._ticker = self._ticker, None
        if ticker is not None:
            self._node.destroy_timer(ticker)

    def turn(self) -> None:
        """Take the waiting messages, let time pass, and publish what changes; nothing after :meth:`destroy`.

        Called every :data:`TURN_PERIOD`. A stall of the node, a time beyond :data:`LATE_NS`, is left out of
        the age of every input; after one amid a turn, time passes in the next turn only. On a
        simulated clock a late turn is left to the next one: the executor takes /clock behind its timers.
        """
        if self._ticker is None:
            return  # a call that waited while the node was deactivated
        now = self._now()
        begun_ns, before = now.steady_ns, self._turned
        self._late = late = begun_ns - before.steady_ns > LATE_NS
        self._awaits_clock = late and self._simulated and not self._awaits_clock
        if self._awaits_clock:
            return
        self._turned = now
        if late:
            self._discount_stall(before, now)
        # What waits comes first: no input is lost whose messages are there.
        self.inputs.fetch(late)
        self._latest = not (late or self.inputs.piled)
        for number in self.inputs.take_numbers():
            self._take(number)
        now = self._now()
        if not late and now.steady_ns - begun_ns > LATE_NS:
            return  # stalled amid the turn: the next one discounts it, before time passes
        if not self._latest:
            self._session.catch_up(now)
        if late or now.steady_ns - self._ticked_ns >= WATCHDOG_NS:
            self._let_time_pass(now)
        self._session.flush(now)
        # A turn that was long itself is no stall.
        self._turned, self._set_ns = now, now.set_ns

    def _take_number(self, number: Number) -> None:
        """Give a number to the session, and note it for the watchdog if it is a valid speed or load.

        Its age counts from its arrival; after a stall, or once the clock was set, from now on. One without a
        stamp that came before the clock was set gets the present time.
        """
        name, place, time_ns, arrival_ns, value = number
        now = self._now()
        # Arrivals before the clock was set are on another time. Of the messages that waited during a stall
        # some were left out, so that the arrivals of the rest have gaps that are ours.
        if now.set_ns != self._set_ns:
            time_ns = now.time_ns if time_ns == arrival_ns else time_ns
        elif not self._late:
            now = now._replace(time_ns=arrival_ns)
        update = self._session.take(name, place, time_ns, value, now, latest=self._latest)
        if update.status.valid and place < LEVEL:
            self._watchdog.note(name)

    def _let_time_pass(self, now: Moment) -> None:
        """Let time pass for watchdog, session and clips; publish changes, and once a second all bearings.

        The node's own health is updated once a second, before it is published.
        """
        self._ticked_ns = now.steady_ns
        passed_ns = self._passing.measure_elapsed(now)
        if self._passing.stands:
            now = now._replace(time_ns=0)  # as before the first /clock
        self._running_ns += passed_ns
        self._watchdog.tick(now, passed_ns)
        self._session.tick(now, self._running_ns)
        self._own.tick_clips()
        if now.steady_ns - self._shown_ns >= SHOW_NS:
            self._shown_ns = now.steady_ns
            self._update_health(now.steady_ns)
            self._session.show(now)
        self._session.flush(now)

    def _discount_stall(self, before: Moment, now: Moment) -> None:
        """Leave a stall out of the age of every input; report a long one: health, log, alarm notes.

        Ages are on a simulated clock that moves, if any: then the stall is as long as it is there. A long one
        has more than :data:`LONG_STALL_NS` of the steady clock.

        For the alarms the time until ``now`` has passed all the same.
        """
        held_ns = now.steady_ns - before.steady_ns
        is_replay = self._simulated and before.time_ns
        # The alarms' time has passed, that of the inputs has not.
        self._running_ns += self._passing.measure_elapsed(now)
        if now.time_ns and not self._passing.stands:  # else no stall counts in their age anyway
            self._session.discount_stall(max(now.time_ns - before.time_ns, 0) if is_replay else held_ns)
        if held_ns <= LONG_STALL_NS:
            return
        held = held_ns * 1e-9
        self._health.delays += 1
        self._health.longest_delay = max(self._health.longest_delay, held)
        text = f'the node was stalled for {held:.3g} s (overload, suspend?): inputs are not blamed for it'
        self._log.warning(text)
        self._session.note('node', text)

    def _carry_out(self, request: ActionRequest) -> list[AlarmChange]:
        """Carry out a request, and return what it changed.

        To acknowledge all alarms clears the health of changed parameters, too.
        """
        if request.action is Action.ACKNOWLEDGE and request.bearing is None:
            self._health.changed.clear()
        return self._session.act(request)

    def _update_health(self, steady_ns: int) -> None:
        """Update the node's own health: files, lost messages, doubles; log new faults. Called once a second.

        Args:
            steady_ns: Time of the steady clock [ns].
        """
        health = self._health
        self._own.check_files()
        lanes = self.inputs.lanes
        health.lost = sum(lane.lost for lane in lanes)
        health.left_out = sum(lane.left_out for lane in lanes)
        if health.update(steady_ns):
            text = f'since the node was configured: {health.losses}'
            self._log.warning(text, throttle_duration_sec=LATELY_NS * 1e-9)
        if self._looks % _DOUBLE_LOOKS == 0:
            self._check_doubles()
        self._looks += 1

    def _check_doubles(self) -> None:
        """Update the health on nodes of the same name and publishers of /clock; report new doubles as errors.

        On the system's time nothing reads /clock, so its publishers are not looked for.
        """
        node, health = self._node, self._health
        node_key, clocks = (node.get_name(), node.get_namespace()), ''
        double = node.get_node_names_and_namespaces().count(node_key) > 1
        if double and not health.double:
            name = node.get_fully_qualified_name()
            self._report_error(f'another node is called {name} too: stop one of them')
        infos = node.get_publishers_info_by_topic('/clock') if self._simulated else ()
        if len(infos) > 1:
            clocks = ', '.join(sorted(map(node_name, infos)))
        if clocks and clocks != health.clocks:
            self._report_error(f'{CLOCKS} {clocks}')
        health.double, health.clocks = double, clocks

    def _report_error(self, text: str) -> None:
        """Log an error, and add it to the notes of ``~/alarms``."""
        self._log.error(text)
        self._session.note('node', text)


class PassingTime:
    """The time that passes, on clocks that may stop or step.

    While ROS time follows a simulated clock that moves, that clock is the measure. One that has
    stood still for a second (the player has gone, or waits) cannot say that an input is lost, so then
    the steady clock does; what that has counted is not counted again. A step back counts as no time. While
    the simulated clock is at zero, and for its first step from there, the steady clock is the measure.

    Attributes:
        stands: Whether a simulated clock has stood still for more than :data:`STILL_NS`.
    """

    stands = False

    def __init__(self, simulated: bool, now: Moment) -> None:
        self._simulated, self._last, self._moved_ns, self._counted_ns = simulated, now, now.steady_ns, 0

    def measure_elapsed(self, now: Moment) -> int:
        """Return the time that counts as passed since the last call [ns]; update :attr:`stands`."""
        last, self._last = self._last, now
        if not self._simulated or not now.time_ns:
            return now.steady_ns - last.steady_ns
        counted, step = self._counted_ns, now.time_ns - last.time_ns
        if step:
            self._moved_ns, self._counted_ns, self.stands = now.steady_ns, 0, False
            return max(step - counted, 0) if last.time_ns else now.steady_ns - last.steady_ns
        stood = now.steady_ns - self._moved_ns
        self.stands = stood > STILL_NS
        if not self.stands:
            return 0
        self._counted_ns = stood
        return stood - counted


class Watchdog:
    """Gives a session the time that passes without samples, bearing by bearing."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._silent = dict.fromkeys(session.monitor.bearings, 0)  # for how long [ns]
        self._sampled: set[str] = set()  # bearings with a valid sample since the last tick
        # Those whose time went on while ROS time was unknown.
        self._timeless: set[str] = set()

    def note(self, name: str) -> None:
        """Note that a bearing had a valid sample: it counts at the next tick."""
        self._sampled.add(name)

    def tick(self, now: Moment, passed_ns: int) -> None:
        """Follow the clock if it was set, and advance each bearing that had no sample since the last tick.

        Args:
            now: The time; ROS time is 0 while a simulated clock stands, and samples count for nothing.
            passed_ns: Time since the last call [ns].
        """
        self._session.follow_clock(now)
        for name, bearing in self._session.monitor.bearings.items():
            before, has_sample = self._silent[name], now.time_ns and name in self._sampled
            silent = self._silent[name] = 0 if has_sample else before + passed_ns
            elapsed = max(silent - BEHIND_NS, 0)
            time_ns = self._time_without_sample(bearing, now, elapsed, elapsed - max(before - BEHIND_NS, 0))
            if silent and time_ns:
                self._session.advance(name, time_ns, now)
        self._sampled.clear()

    def _time_without_sample(self, bearing: BearingMonitor, now: Moment, elapsed: int, more: int) -> int:
        """Return the time that a bearing without a sample has reached [ns]; 0 while it has none.

        Inputs are waited for from the first instant that ROS time knows. Where it knows none, or stands,
        for longer than a timeout, they are lost all the same: a bearing without a time is then started
        at 1 ns, and shifted into ROS time once that is known.

        Args:
            bearing: Started, or shifted in time, in these two cases.
            now: ROS time is 0 where it is unknown or stands.
            elapsed: Time without a sample, less the lag of the watchdog [ns].
            more: Part of it that has passed since the last call [ns].
        """
        config = bearing.config
        if bearing.now_ns is None:
            if now.time_ns:
                return now.time_ns - elapsed
            if elapsed > min(config.speed.stands_ns, config.load.stands_ns):
                self._timeless.add(config.name)
                self._session.advance(config.name, 1, now)  # the wait began before
                return 1 + elapsed
            return 0
        if not now.time_ns:
            self._timeless.add(config.name)
        elif config.name in self._timeless:
            self._timeless.discard(config.name)
            bearing.follow_step(now.time_ns - bearing.now_ns)  # the step into ROS time is no wait
            return now.time_ns
        return bearing.now_ns + more
