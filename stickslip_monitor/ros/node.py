# SPDX-License-Identifier: Apache-2.0
"""The managed node ``stickslip_monitor``: it converts, hands over and publishes."""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from stickslip_monitor.errors import RosError, StickslipError
from stickslip_monitor.monitor.clip_recorder import ClipStore
from stickslip_monitor.monitor.config import ClipConfig, MonitorConfig, build_config
from stickslip_monitor.monitor.config_file import NODE_NAME
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.monitor.verdict import Event, Verdict
from stickslip_monitor.ros import parameters
from stickslip_monitor.ros.actions import Actions
from stickslip_monitor.ros.desk import AlarmDesk, ElapsedTime
from stickslip_monitor.ros.event_clips import Clips
from stickslip_monitor.ros.inputs import Inputs, check_inputs
from stickslip_monitor.ros.message_types import ROS_FAULTS
from stickslip_monitor.ros.outputs import Outputs
from stickslip_monitor.ros.state_file import StateFile
from stickslip_monitor.surface_store import prepare_surfaces

WATCHDOG_PERIOD = 0.1
SIGNAL_PERIOD = 0.2
DIAGNOSTICS_PERIOD = 1.0
# The watchdog stays so far behind that a sample delivered late keeps the time of its own stamp.
WATCHDOG_LAG_NS = 500_000_000


class MonitorNode(LifecycleNode):
    """Subscribes to shaft speed and bearing load, publishes predictions and warnings.

    Raises:
        ConfigurationError: A parameter breaks its rule.
        RosError: An input's message type or field does not exist, or the state file's folder.
        StickslipError: The store cannot take clips.

    Args:
        store: Makes what takes event clips; without it the node takes none.
        options: As for any lifecycle node.
    """

    # A node that could not be made is destroyed all the same.
    _clips: Clips | None = None

    def __init__(
        self, store: Callable[[ClipConfig], ClipStore] | None = None, **options: Any
    ) -> None:
        super().__init__(
            NODE_NAME, automatically_declare_parameters_from_overrides=True, **options
        )
        parameters.check_time_source(self.get_parameter(parameters.USE_SIM_TIME).value)
        self._config = build_config(parameters.values(self))
        _check(self._config)
        self._store = store
        self._clips = self._clips_of(self._config)
        parameters.declare(self)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        # Python runs its signal handlers between waits: none may last, however little happens.
        self._pulse = self.create_timer(SIGNAL_PERIOD, lambda: None, clock=self._steady)
        self._active = False
        self._failure = ''
        self._monitor = Monitor(self._config)
        self._outputs: Outputs | None = None
        self._desk: AlarmDesk | None = None
        self._inputs: Inputs | None = None
        self._actions: Actions | None = None
        self._tickers: list[Any] = []
        self._flows: dict[str, ElapsedTime] = {}
        self._bases: dict[str, int] = {}
        self._published_ns: dict[str, int] = {}
        self._unsaid: dict[str, Verdict] = {}

    @property
    def config(self) -> MonitorConfig:
        """The configuration in force."""
        return self._config

    def start(self) -> None:
        """Configure and activate the node.

        Raises:
            RosError: A transition failed.
        """
        for name, trigger in (
            ('configure', self.trigger_configure),
            ('activate', self.trigger_activate),
        ):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise RosError(f'the node cannot {name}: {self._failure}')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the monitor from the parameters and create the publishers."""
        self._build()
        try:
            self._outputs = Outputs(self, self._config, self._tap)
        except ROS_FAULTS as error:
            return self._failed(f'its topics cannot be published: {_sentence(error)}')
        self._desk = AlarmDesk(self, self._config, self._outputs.publish_alarms)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start listening; inputs are waited for from now on."""
        assert self._desk is not None
        try:
            self._inputs = Inputs(self, self._config, self._receive, self._tap)
            self._actions = Actions(self, list(self._monitor.bearings), self._desk.act)
        except ROS_FAULTS as error:
            self._stop_listening()
            return self._failed(f'its inputs cannot be subscribed to: {_sentence(error)}')
        result = super().on_activate(state)
        simulated = self.get_parameter(parameters.USE_SIM_TIME).value is True
        self._desk.start(ElapsedTime(simulated, *self._clocks()))
        self._flows = {
            name: ElapsedTime(simulated, *self._clocks()) for name in self._monitor.bearings
        }
        self._bases = dict.fromkeys(self._monitor.bearings, 0)
        self._watch()
        # Timers of the steady clock: those of ROS time stall when a replay steps back.
        self._tickers = [
            self.create_timer(WATCHDOG_PERIOD, self._watch, clock=self._steady),
            self.create_timer(DIAGNOSTICS_PERIOD, self._diagnose, clock=self._steady),
        ]
        self._active = True
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening; what was learned is kept."""
        self._stop_listening()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the publishers down and forget what was learned."""
        self._take_down()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take everything down, from whatever state."""
        self._stop_listening()
        self._take_down()
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Write what is left of clips, and go."""
        if self._clips is not None:
            self._clips.close()
        super().destroy_node()

    def _failed(self, text: str) -> TransitionCallbackReturn:
        # Told here because rclpy says nothing of an exception in a transition.
        self._failure = text
        self.get_logger().error(text)
        return TransitionCallbackReturn.FAILURE

    def _stop_listening(self) -> None:
        self._active = False
        if self._inputs is not None:
            self._inputs.destroy()
            self._inputs = None
        if self._actions is not None:
            self._actions.destroy()
            self._actions = None
        for timer in self._tickers:
            self.destroy_timer(timer)
        self._tickers = []
        if self._clips is not None:
            self._clips.close()

    def _take_down(self) -> None:
        if self._outputs is not None:
            self._outputs.destroy()
            self._outputs = None
        self._desk = None

    def _receive(self, name: str, is_load: int, time_ns: int, value: float, latest: bool) -> None:
        bearing = self._monitor.bearings[name]
        update = bearing.update(is_load, time_ns, value)
        if update.status.believed:
            self._flows[name].restart(*self._clocks())
            assert bearing.now_ns is not None
            self._bases[name] = bearing.now_ns
        if update.verdict is not None:
            self._unsaid[name] = update.verdict
        # What a message that waits already will outdate is said only where it changes something.
        if (latest or update.events) and (verdict := self._unsaid.pop(name, None)):
            self._publish(verdict, bool(update.events))
        self._announce(update.events)
        assert self._desk is not None
        self._desk.feed(name, is_load, time_ns, update)

    def _publish(self, verdict: Verdict, changed: bool) -> None:
        now = self._steady.now().nanoseconds
        period = self._config.publish_period * 1e9
        if changed or now - self._published_ns.get(verdict.bearing, -(10**18)) >= period:
            self._published_ns[verdict.bearing] = now
            assert self._outputs is not None
            self._outputs.publish_verdict(verdict)

    def _announce(self, events: list[Event]) -> None:
        assert self._outputs is not None
        for event in events:
            self._outputs.publish_event(event)
        if events:
            self._diagnose()
        if self._clips is not None:
            for event in events:
                self._clips.note(event)

    def _clocks(self) -> tuple[int, int]:
        return self._steady.now().nanoseconds, self.get_clock().now().nanoseconds

    def _watch(self) -> None:
        """Tell the monitor of the time that passes without samples."""
        steady, now = self._clocks()
        events = []
        for name, bearing in self._monitor.bearings.items():
            elapsed = max(self._flows[name].tick(steady, now) - WATCHDOG_LAG_NS, 0)
            if self._bases[name] == 0 and now != 0:
                # Inputs are waited for from the first instant that ROS time knows.
                self._bases[name] = now - elapsed if bearing.now_ns is None else bearing.now_ns
            if self._bases[name]:
                events += bearing.advance(self._bases[name] + elapsed)
        self._announce(events)
        assert self._desk is not None
        self._desk.feed_events(events)
        self._desk.tick(steady, now)
        if self._clips is not None:
            times = [b.now_ns for b in self._monitor.bearings.values() if b.now_ns is not None]
            self._clips.tick(max(times, default=0))

    @property
    def _tap(self) -> Callable[[str, Any, int | None], None] | None:
        return None if self._clips is None else self._clips.take

    def _clips_of(self, whole: MonitorConfig) -> Clips | None:
        config = whole.clips
        if not config.directory:
            return None
        if self._store is None:
            raise RosError(
                f"clips.directory = '{config.directory}': this node was started without anything"
                " that writes clips; run the executable 'monitor'"
            )
        return Clips(self, config, self._store(config))

    def _diagnose(self) -> None:
        assert self._outputs is not None
        self._outputs.publish_diagnostics(list(self._monitor.bearings.values()))

    def _on_parameters(self, changes: list[Parameter[Any]]) -> SetParametersResult:
        try:
            config, rebuilt = parameters.changed_config(self, changes, self._active)
            _check(config)
            clips = self._clips_of(config) if rebuilt else self._clips
        except StickslipError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._config = config
        if rebuilt:
            self._clips = clips
            self._rebuild()
        else:
            self._monitor.retune(config)
            if self._desk is not None:
                self._desk.retune(config)
        return SetParametersResult(successful=True)

    def _build(self) -> None:
        self._monitor = Monitor(self._config)
        for complaint in prepare_surfaces(item.bearing for item in self._config.bearings):
            self.get_logger().warning(complaint)

    def _rebuild(self) -> None:
        """Other bearings or inputs: only ever between activations."""
        self._build()
        if self._outputs is not None:
            self._outputs.destroy()
            self._outputs = Outputs(self, self._config, self._tap)
        if self._desk is not None:
            assert self._outputs is not None
            self._desk.rebuild(self._config, self._outputs.publish_alarms)


def _check(config: MonitorConfig) -> None:
    """Check what only this machine can tell: message types, fields and folders."""
    check_inputs(config)
    if config.state_file:
        StateFile(config.state_file)


def _spin(node: MonitorNode, told: Sequence[int]) -> None:
    """Spin until a signal has been noted, or somebody shuts ROS down."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok() and not told:
            try:
                executor.spin_once()
            except rclpy_implementation.RCLError as error:
                # Up to ROS 2 Jazzy an invalid lifecycle request raises out of spin.
                if not rclpy.ok():
                    return
                node.get_logger().error(f'request refused: {error}')
    finally:
        executor.shutdown()


def _sentence(error: Exception) -> str:
    """What ROS says, without the places in its sources."""
    return re.sub(r', at /\S+', '', str(error))


def _initialise(args: Sequence[str] | None) -> None:
    try:
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError) as error:
        raise RosError(f'the ROS arguments cannot be used: {_sentence(error)}') from error


def _run(args: Sequence[str] | None, store: Callable[[ClipConfig], ClipStore] | None) -> None:
    """Run the node until it is told to stop."""
    # Noted, not raised: an interrupt in the middle of an import prints a traceback of its own.
    # ROS's own handlers stay out: they take ROS down in a thread, under the node's feet.
    told: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: told.append(number))
    _initialise(args)
    node = None
    try:
        node = MonitorNode(store)
        # Python runs its handlers between waits, so a wait must end however little happens.
        node.create_timer(
            SIGNAL_PERIOD, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        if node.config.autostart and not told:
            node.start()
        _spin(node, told)
    finally:
        # A second Ctrl-C (a launch system sends one too) must not break the way out.
        _ignore_signals()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def main(
    args: Sequence[str] | None = None,
    store: Callable[[ClipConfig], ClipStore] | None = None,
) -> int:
    """Run the node until it is told to stop.

    Args:
        args: Arguments without the program's name; those of the process if ``None``.
        store: Makes what takes event clips.

    Returns:
        0 after Ctrl-C or a termination signal, 2 for a bad configuration.
    """
    try:
        _run(args, store)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except StickslipError as error:
        print(f'ERROR: {error}', file=sys.stderr)  # noqa: T201
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
