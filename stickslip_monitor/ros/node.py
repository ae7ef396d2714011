# SPDX-License-Identifier: Apache-2.0
"""The managed node ``stickslip_monitor``: it converts, hands over and publishes."""

from __future__ import annotations

import functools
import math
import os
import re
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from stickslip_monitor.errors import RosError, StickslipError, plural
from stickslip_monitor.monitor.clip_recorder import ClipStore
from stickslip_monitor.monitor.config import ClipConfig, MonitorConfig
from stickslip_monitor.monitor.config_file import NODE_NAME
from stickslip_monitor.monitor.configure import build_config
from stickslip_monitor.monitor.ladder import Condition
from stickslip_monitor.monitor.messages import NodeHealth, state_of
from stickslip_monitor.monitor.monitor import BearingMonitor, Monitor
from stickslip_monitor.monitor.signals import LEVEL
from stickslip_monitor.monitor.verdict import Event, Verdict
from stickslip_monitor.ros import parameters
from stickslip_monitor.ros.actions import Actions
from stickslip_monitor.ros.desk import AlarmDesk, ElapsedTime
from stickslip_monitor.ros.event_clips import Clips
from stickslip_monitor.ros.input_watch import InputWatch
from stickslip_monitor.ros.inputs import Inputs, check_inputs
from stickslip_monitor.ros.message_types import ROS_FAULTS
from stickslip_monitor.ros.outputs import Outputs
from stickslip_monitor.ros.service import ServiceManager
from stickslip_monitor.ros.state_file import StateFile, StateWriter
from stickslip_monitor.surface_store import SurfaceBuilder, prepare_surfaces

WATCHDOG_PERIOD = 0.1
LONGEST_WAIT = 0.2
DIAGNOSTICS_PERIOD_NS = 1_000_000_000
LOSS_PERIOD = 60.0
# Of UDP ports, of which DDS takes 250 for each domain.
HIGHEST_DOMAIN = 232
KEYSTORE = 'ROS_SECURITY_KEYSTORE'
FAILURE_PERIOD = 5.0
HELD_UP = 1.0
"""A watchdog that comes so late [s] says that the node was held up, not its inputs."""
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
    _active = False
    _clips: Clips | None = None
    _state_file: StateWriter | None = None
    _outputs: Outputs | None = None
    _surfaces: SurfaceBuilder | None = None

    def __init__(
        self, store: Callable[[ClipConfig], ClipStore] | None = None, **options: Any
    ) -> None:
        super().__init__(
            NODE_NAME, automatically_declare_parameters_from_overrides=True, **options
        )
        parameters.check_time_source(self.get_parameter(parameters.USE_SIM_TIME).value)
        self._config = build_config(parameters.values(self))
        for note in self._config.notes:
            self.get_logger().warning(note)
        _check(self._config)
        self._store = store
        self._clips = self._clips_of(self._config)
        parameters.declare(self)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._active = False
        self._failure = ''
        self._health = NodeHealth()
        self._monitor = Monitor(self._config)
        self._desk: AlarmDesk | None = None
        self._inputs: Inputs | None = None
        self._actions: Actions | None = None
        self._ticker: Any = None
        self._simulated = False
        self._surfaces = SurfaceBuilder()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._begin_watching()

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

    def now_ns(self) -> int:
        """ROS time [ns]; 0 while it is simulated and /clock has said nothing."""
        return self.get_clock().now().nanoseconds if self._simulated else time.time_ns()

    def survived(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The callback, whose exceptions are told and survived: the monitor goes on."""

        # rclpy looks at the signature of what it calls.
        @functools.wraps(callback)
        def call(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except Exception as error:
                self.survive(error)

        return call

    def survive(self, error: Exception) -> None:
        """Tell of an exception that nobody expected, in the log and in diagnostics."""
        frames = traceback.extract_tb(error.__traceback__)
        place = f' ({Path(frames[-1].filename).name}:{frames[-1].lineno})' if frames else ''
        text = f'{type(error).__name__}: {_sentence(error)}{place}'
        self._health.failures += 1
        self._health.last_failure = text
        self.get_logger().error(
            f'a callback failed and is survived: {text}', throttle_duration_sec=FAILURE_PERIOD
        )
        if self._health.failures == 1:
            self._note('node', f'a callback failed: {text}')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the monitor from the parameters and create the publishers."""
        try:
            self._build()
            self._outputs = Outputs(self, self._config, self._tap)
            self._keep_state()
        except (*ROS_FAULTS, StickslipError) as error:
            self._take_down()
            return self._failed(f'it cannot be set up: {_sentence(error)}')
        self._health = NodeHealth()
        self._desk = AlarmDesk(self, self._config, self._outputs.publish_alarms, self._state_file)
        self._transition('configured, inactive')
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start listening; inputs are waited for from now on."""
        assert self._desk is not None
        self._simulated = self.get_parameter(parameters.USE_SIM_TIME).value is True
        receive = self.survived(self._receive)
        try:
            self._inputs = Inputs(
                self, self._config, receive, self._flush, self._health, self._tap
            )
            self._actions = Actions(self, list(self._monitor.bearings), self._desk.act)
        except ROS_FAULTS as error:
            self._stop_listening()
            return self._failed(f'its inputs cannot be subscribed to: {_sentence(error)}')
        result = super().on_activate(state)
        self._active = self._health.monitoring = True
        self._transition('active')
        for line in _inputs_lines(self, self._config):
            self.get_logger().info(line)
        self._begin_watching()
        self._desk.start(ElapsedTime(self._simulated, *self._clocks()))
        self._tick()
        # A timer of the steady clock: those of ROS time stall when a replay steps back.
        self._ticker = self.create_timer(
            WATCHDOG_PERIOD, self.survived(self._tick), clock=self._steady
        )
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening; what was learned is kept."""
        self._stop_listening()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the publishers down and forget what was learned."""
        self._take_down()
        self._transition('unconfigured')
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take everything down, from whatever state."""
        self._stop_listening()
        self._take_down()
        self._transition('finalized')
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Say the last word, write what is left of clips and alarms, and go."""
        if self._active:
            self._stop_listening()
            assert self._outputs is not None
            self._outputs.flush()
        if self._clips is not None:
            self._clips.close()
        if self._state_file is not None:
            self._state_file.close()
        if self._surfaces is not None:
            self._surfaces.close()
        super().destroy_node()

    def _failed(self, text: str) -> TransitionCallbackReturn:
        # Told here because rclpy says nothing of an exception in a transition.
        self._failure = text
        self.get_logger().error(text)
        return TransitionCallbackReturn.FAILURE

    def _transition(self, state: str) -> None:
        text = f'the monitor is {state}'
        self.get_logger().info(text)
        self._note('lifecycle', text)

    def _note(self, what: str, text: str) -> None:
        if self._desk is not None:
            self._desk.note(what, text)

    def _stop_listening(self) -> None:
        was_active, self._active = self._active, False
        if self._inputs is not None:
            self._inputs.destroy()
            self._inputs = None
        if self._actions is not None:
            self._actions.destroy()
            self._actions = None
        if self._ticker is not None:
            self.destroy_timer(self._ticker)
            self._ticker = None
        if was_active:
            self._say_the_last_word()
        if self._clips is not None:
            self._clips.close()

    def _say_the_last_word(self) -> None:
        """What readers keep must not be the last state of bearings that nobody watches."""
        assert self._desk is not None
        self._health.monitoring = False
        self._transition('inactive: the bearings are not monitored')
        self._desk.end()
        self._diagnose(self._monitor.bearings)

    def _take_down(self) -> None:
        if self._outputs is not None:
            self._outputs.destroy()
            self._outputs = None
        self._desk = None
        if self._state_file is not None:
            self._state_file.close()
            self._state_file = None

    def _receive(self, name: str, is_load: int, time_ns: int, value: float, latest: bool) -> None:
        bearing = self._monitor.bearings[name]
        update = bearing.update(is_load, time_ns, value)
        if update.status.believed and is_load != LEVEL:
            self._heard.add(name)
        self._watch_inputs.take(name, is_load, time_ns, value, update.status.believed)
        if update.events:
            update = replace(update, events=self._explained(update.events))
        if update.verdict is not None:
            self._unsaid[name] = update.verdict
        # What a message that waits already will outdate is said only where it changes something.
        if (latest or update.events) and (verdict := self._unsaid.pop(name, None)):
            self._publish(verdict, bool(update.events))
        self._announce(update.events)
        assert self._desk is not None
        self._desk.feed(name, is_load, time_ns, update)

    def _publish(self, verdict: Verdict, changed: bool) -> None:
        assert self._outputs is not None
        now, period = time.monotonic(), self._config.publish_period
        if not changed and now - self._published.get(verdict.bearing, -math.inf) < period:
            return
        self._published[verdict.bearing] = now
        self._outputs.publish_verdict(verdict)

    def _announce(self, events: list[Event]) -> None:
        assert self._outputs is not None
        for event in events:
            self._outputs.publish_event(event)
            self._changed.add(event.bearing)
            if self._clips is not None:
                self._clips.note(event)

    def _flush(self) -> None:
        """The callback is over: tell of all that has changed in one message."""
        if self._changed:
            self._diagnose(self._changed)
            self._changed.clear()

    def _clocks(self) -> tuple[int, int]:
        return time.monotonic_ns(), self.now_ns()

    def _begin_watching(self) -> None:
        """Nothing is known of the time that has passed without samples."""
        names = list(self._monitor.bearings)
        self._flows = {name: ElapsedTime(self._simulated, *self._clocks()) for name in names}
        self._bases = dict.fromkeys(names, 0)
        self._heard: set[str] = set()
        self._changed: set[str] = set()
        self._published: dict[str, float] = {}
        self._unsaid: dict[str, Verdict] = {}
        self._watch_inputs = InputWatch(self, self._monitor.bearings)
        self._ticked_ns = time.monotonic_ns()
        self._diagnosed_ns = 0
        self._lost_told, self._lost_told_at = 0, -math.inf

    def _tick(self) -> None:
        """Look after everything that time brings."""
        steady, now = self._clocks()
        late, self._ticked_ns = (steady - self._ticked_ns) * 1e-9, steady
        if late > HELD_UP:
            self._take_late(late)
        self._watch(steady, now)
        assert self._desk is not None
        self._desk.tick(steady, now)
        if self._clips is not None:
            times = [b.now_ns for b in self._monitor.bearings.values() if b.now_ns is not None]
            self._clips.tick(max(times, default=0))
        if steady - self._diagnosed_ns >= DIAGNOSTICS_PERIOD_NS:
            self._diagnosed_ns = steady
            self._look(steady * 1e-9, now)
            self._diagnose(self._monitor.bearings)
        self._flush()

    def _take_late(self, late: float) -> None:
        """The node was held up: what waits comes first, and no input is to blame for the time."""
        self._health.delays += 1
        self._health.longest_delay = max(self._health.longest_delay, late)
        text = f'the node was held up for {late:.3g} s: answers were late, inputs are not to blame'
        self.get_logger().warning(text)
        self._note('node', text)
        assert self._inputs is not None
        self._inputs.take_waiting()
        clocks = self._clocks()
        for flow in self._flows.values():
            flow.skip(*clocks)
        for verdict in self._unsaid.values():
            self._publish(verdict, True)
        self._unsaid.clear()

    def _watch(self, steady: int, now: int) -> None:
        """Tell the monitor of the time that passes without samples."""
        events = []
        for name, bearing in self._monitor.bearings.items():
            flow = self._flows[name]
            if name in self._heard:
                flow.restart(steady, now)
                assert bearing.now_ns is not None
                self._bases[name] = bearing.now_ns
                continue
            elapsed = max(flow.tick(steady, now) - WATCHDOG_LAG_NS, 0)
            base = self._bases[name] = self._base(name, bearing, now, elapsed)
            if base:
                events += bearing.advance(base + elapsed)
        self._heard.clear()
        events = self._explained(events)
        self._announce(events)
        assert self._desk is not None
        self._desk.feed_events(events)

    def _base(self, name: str, bearing: BearingMonitor, now: int, elapsed: int) -> int:
        """The time from which a bearing waits for samples [ns]; 0 for not yet.

        Inputs are waited for from the first instant that ROS time knows. Where it knows none for
        longer than a timeout, they are lost all the same.
        """
        base = self._bases[name]
        if base > 1:
            return base
        if base == 0 and bearing.now_ns is not None:
            return bearing.now_ns
        if now:
            return now - elapsed
        return 1 if elapsed > min(bearing.gate.timeouts) else base

    def _explained(self, events: list[Event]) -> list[Event]:
        """The events; where an input is lost, with why."""
        return [
            replace(event, text=' '.join(filter(None, (event.text, self._why(event.bearing)))))
            if event.after is Condition.INPUT_STALE
            else event
            for event in events
        ]

    def _why(self, bearing: str) -> str:
        steady, now = self._clocks()
        return self._watch_inputs.explain(bearing, steady * 1e-9, now == 0)

    def _look(self, steady: float, now: int) -> None:
        """Look after inputs and the node's own health, once a second."""
        logger = self.get_logger()
        for bearing, text in self._watch_inputs.look(steady, now == 0):
            logger.warning(f'{bearing}: {text}')
            self._note('input', f'{bearing}: {text}')
        assert self._inputs is not None
        self._inputs.count_missing()
        for watched in self._monitor.bearings.values():
            if watched.verdict is not None and self._surfaces is not None:
                self._surfaces.need(watched.config.bearing, watched.verdict.assessment.load)
        health = self._health
        if self._clips is not None:
            health.clip_fault = self._clips.fault
        if self._state_file is not None:
            before, health.state_file_fault = health.state_file_fault, self._state_file.fault
            if health.state_file_fault and not before:
                logger.error(health.state_file_fault)
        lost = health.lost + health.missing
        if lost > self._lost_told and steady - self._lost_told_at >= LOSS_PERIOD:
            logger.warning(
                f'{plural(lost - self._lost_told, "message")} lost on the way to the node,'
                f' {lost} since it was configured'
            )
            self._lost_told, self._lost_told_at = lost, steady

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

    def _diagnose(self, names: Iterable[str]) -> None:
        """Publish the state of these bearings, and of the node with all of them."""
        assert self._outputs is not None
        bearings, active = self._monitor.bearings, self._health.monitoring
        states = (state_of(bearings[n], self._watch_inputs.faults(n), active) for n in names)
        self._outputs.publish_diagnostics(states, self._health if names is bearings else None)

    def _on_parameters(self, changes: list[Parameter[Any]]) -> SetParametersResult:
        try:
            config, rebuilt = parameters.changed_config(self, changes, self._active)
            _check(config)
            clips = self._clips_of(config) if rebuilt else self._clips
            told = parameters.told_changes(self, changes)
            self._config = config
            if rebuilt:
                self._clips = clips
                self._rebuild()
            else:
                self._monitor.retune(config)
                if self._desk is not None:
                    self._desk.retune(config)
        except StickslipError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            self.survive(error)
            return SetParametersResult(successful=False, reason=f'it failed: {error}')
        for text in told:
            self.get_logger().info(text)
            self._note('parameter', text)
        return SetParametersResult(successful=True)

    def _build(self) -> None:
        self._monitor = Monitor(self._config)
        self._begin_watching()
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
            self._keep_state()
            self._desk.rebuild(self._config, self._outputs.publish_alarms, self._state_file)

    def _keep_state(self) -> None:
        """Keep the alarms where the configuration says."""
        if self._state_file is not None:
            self._state_file.close()
            self._state_file = None
        if self._config.state_file:
            self._state_file = StateWriter(StateFile(self._config.state_file))


def _inputs_lines(node: MonitorNode, config: MonitorConfig) -> Iterator[str]:
    """What an active node does, for the log."""
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    count = len(config.bearings)
    yield (
        f'{node.get_fully_qualified_name()} monitors {count} bearing{"s" * (count != 1)} in ROS'
        f' domain {domain}'
    )
    units = parameters.values(node)
    for bearing in config.bearings:
        inputs = (
            f'{name} in {units.get(f"{bearing.name}.{name}.unit", default)} from'
            f' {node.resolve_topic_name(source.topic)} ({source.type}, {source.field_text})'
            for (name, source), default in zip(
                bearing.inputs.items(), ('rpm', 'N', 'm/s^2'), strict=False
            )
        )
        yield f'{bearing.name}: {", ".join(inputs)}'


def _check(config: MonitorConfig) -> None:
    """Check what only this machine can tell: message types, fields and folders."""
    check_inputs(config)
    if config.state_file:
        StateFile(config.state_file)


def make_executor() -> Executor:
    """The executor that wakes for work only, where this ROS 2 has it (from Kilted on)."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def _spin(node: MonitorNode, told: Sequence[int]) -> None:
    """Spin until a signal has been noted, or somebody shuts ROS down."""
    executor, manager = make_executor(), ServiceManager()
    executor.add_node(node)
    manager.tell('READY=1')
    try:
        while rclpy.ok() and not told:
            manager.beat()
            try:
                # Python runs its signal handlers between waits: none may last.
                executor.spin_once(LONGEST_WAIT)
            except ExternalShutdownException:
                return
            except Exception as error:
                # Up to ROS 2 Jazzy an invalid lifecycle request raises out of spin.
                if not rclpy.ok():
                    return
                node.survive(error)
    finally:
        manager.tell('STOPPING=1')
        executor.shutdown()


def _sentence(error: Exception) -> str:
    """What ROS says, without the places in its sources."""
    return ' '.join(re.sub(r',? at /\S+', '', str(error)).split())


def _check_environment(args: Sequence[str]) -> None:
    """Check what ROS 2 itself would ignore, or die of without a reason.

    Raises:
        RosError: An environment variable breaks its rule.
    """
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not domain.isdecimal() or int(domain) > HIGHEST_DOMAIN:
        raise RosError(f"ROS_DOMAIN_ID = '{domain}' must be 0 to {HIGHEST_DOMAIN}")
    if os.environ.get('ROS_SECURITY_ENABLE') == 'true':
        _check_enclave(os.environ.get(KEYSTORE, ''), args)


def _check_enclave(keystore: str, args: Sequence[str]) -> None:
    """Check that the keys are there: without them ROS 2 goes on without any security."""
    if not keystore:
        raise RosError('ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no keystore')
    given = [value for name, value in pairwise(args) if name in ('-e', '--enclave')]
    enclave = os.environ.get('ROS_SECURITY_ENCLAVE_OVERRIDE') or (given or ['/'])[-1]
    folder = Path(keystore) / 'enclaves' / enclave.strip('/')
    if not (folder / 'cert.pem').is_file():
        raise RosError(
            f"ROS_SECURITY_ENABLE is true, but the keystore '{keystore}' has no enclave"
            f" '{enclave}'"
        )


def _initialise(args: Sequence[str] | None) -> None:
    _check_environment(sys.argv if args is None else args)
    try:
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError) as error:
        raise RosError(f'the ROS arguments cannot be used: {_sentence(error)}') from error


def _create(store: Callable[[ClipConfig], ClipStore] | None) -> MonitorNode:
    try:
        with warnings.catch_warnings():
            # What cannot be created is half created, and rclpy warns of the other half.
            warnings.simplefilter('ignore', RuntimeWarning)
            return MonitorNode(store)
    except (*ROS_FAULTS, rclpy_implementation.RCLError) as error:
        if isinstance(error, StickslipError):
            raise
        raise RosError(f'the node cannot be created: {_sentence(error)}') from error


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
        node = _create(store)
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
