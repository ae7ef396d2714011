# SPDX-License-Identifier: Apache-2.0
"""The managed node ``stickslip_monitor``: a session between ROS topics, and its life cycle.

Its ROS parameters are those of the parameter table: declared with descriptors, read as a whole.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import traceback
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime, timezone
from itertools import chain
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from stickslip_monitor.errors import ConfigurationError, RosError, StickslipError, did_you_mean, plural
from stickslip_monitor.monitor.bearing_records import NodeHealth
from stickslip_monitor.monitor.clip_recorder import ClipStore
from stickslip_monitor.monitor.config_questions import question_sentences
from stickslip_monitor.monitor.configuration import QOS_OVERRIDES, bearing_names, build_config
from stickslip_monitor.monitor.parameter_file import NODE_NAME, is_ros_parameter
from stickslip_monitor.monitor.parameters import ClipConfig, MonitorConfig, parameters_of
from stickslip_monitor.monitor.value_check import REQUIRED, Parameter, require_rule
from stickslip_monitor.ros.inputs import OVERRIDES, ROS_FAULTS, check_inputs, resolve_topics
from stickslip_monitor.ros.node_loop import NodeLoop, node_clock
from stickslip_monitor.ros.outputs import Configured, output_names
from stickslip_monitor.state_file import StateFile

USE_SIM_TIME = 'use_sim_time'
_FIXED = 'cannot be set: a running node keeps it; restart it with another parameter file'
_READ_ONLY = 'cannot be set: it is read-only while the node is active; deactivate it first'


def make_descriptor(row: Parameter) -> ParameterDescriptor:
    """Make the ROS descriptor of a parameter; its rule is enforced by the configuration too."""
    ranges = []
    if row.kind == 'float' and (row.minimum > -math.inf or row.maximum < math.inf):
        ranges = [FloatingPointRange(from_value=row.minimum, to_value=row.maximum, step=0.0)]
    unit = f' [{row.unit}]' if row.unit else ''
    while_active = '' if row.live else ' Read-only while the node is active.'
    changes = ' Read-only.' if row.fixed else while_active
    return ParameterDescriptor(
        description=f'{row.text}{unit}{changes}',
        additional_constraints=f'must be {row.rule()}',
        floating_point_range=ranges,
        # A number may be written 50 or 50.0: the configuration takes both.
        dynamic_typing=True,
    )


def declare_parameters(node: Node) -> None:
    """Declare every parameter of the table anew: with its descriptor, and its default where it has no value.

    The node has declared what the parameter file and the command line gave.

    Raises:
        ConfigurationError: The list of bearings breaks its rule.
    """
    for name, row in parameters_of(bearing_names(parameter_values(node))).items():
        value = None if row.default is REQUIRED or row.is_optional else row.default
        if node.has_parameter(name):
            given = _as_written(name, node.get_parameter(name).value)
            value = value if given is None else given
            node.undeclare_parameter(name)
        node.declare_parameter(name, value, make_descriptor(row), ignore_override=True)


def _as_written(name: str, value: Any) -> Any:
    """Return the value of a parameter as its file has it; ``None`` for null, a list for an array.

    Of a unit of a load ``False`` is ``'N'``: what ROS makes of the bare word.
    """
    # rcl takes a null, as 'ros2 param dump' writes it, for a word.
    if value is None or value in ('null', 'None', 'Null', 'NULL', '~'):
        return None
    # ROS reads the bare word N of a parameter file as the YAML 1.1 boolean 'no'.
    if value is False and name.endswith('load.unit'):
        return 'N'
    # Arrays of numbers are no lists, those of texts are.
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def parameter_values(node: Node) -> dict[str, Any]:
    """Return the values by name of the node's own parameters that are set, without those of ROS itself."""
    written = {
        name: _as_written(name, parameter.value)
        for name, parameter in node.get_parameters_by_prefix('').items()
        if not is_ros_parameter(name)
    }
    return {name: value for name, value in written.items() if value is not None}


Changed = dict[str, tuple[Any, Any]]
"""Value before and after, by parameter."""


def build_changed_config(
    node: Node, changes: Iterable[RosParameter[Any]], active: bool
) -> tuple[MonitorConfig, bool, Changed]:
    """Build the configuration that a set of changes would make; the node is not changed.

    Returns:
        The configuration, whether more than live parameters changed, and what changed.

    Raises:
        ConfigurationError: A value breaks its rule or may not change now; a parameter is unknown or deleted.
    """
    parameters, rebuilt, changed = parameter_values(node), False, Changed()
    rows = parameters_of(bearing_names(parameters))
    for change in changes:
        name, value = change.name, _as_written(change.name, change.value)
        if not node.has_parameter(name):  # rclpy sees to it, but for one without a name
            raise ConfigurationError(f'there is no parameter {name!r}')
        before = _as_written(name, node.get_parameter(name).value)
        # What is deleted is not declared any more, whether it had a value or not.
        if change.type_ == RosParameter.Type.NOT_SET or (value is None and before is not None):
            raise ConfigurationError(f'{name} cannot be deleted: set it to a value')
        if value == before:
            continue
        row = rows.get(name)
        live = name != USE_SIM_TIME if row is None else row.live
        if row is not None and row.fixed:
            raise ConfigurationError(f'{name} = {value!r} {_FIXED}')
        if active and not live:
            raise ConfigurationError(f'{name} = {value!r} {_READ_ONLY}')
        rebuilt |= row is not None and not live
        changed[name] = before, value
    parameters |= {name: after for name, (_, after) in changed.items() if not is_ros_parameter(name)}
    return build_config(parameters, is_live=True), rebuilt, changed


_POLICY_WORDS: dict[str, Any] = {
    'durability': DurabilityPolicy,
    'history': HistoryPolicy,
    'reliability': ReliabilityPolicy,
}


def check_overrides(node: Node, config: MonitorConfig) -> list[str]:
    """Check the overrides of quality of service, of which rclpy names neither the parameter nor the rule.

    Returns:
        A clause on each that nothing of the node reads; an empty list if all are read.

    Raises:
        ConfigurationError: A policy does not have that value.
    """
    outputs = ('~/warnings', '~/alarms', '~/bearings', '/diagnostics')
    topics = (source.topic for bearing in config.bearings for source in bearing.inputs.values())
    policy_kinds = QoSOverridingOptions.with_default_policies().policy_kinds
    readable: dict[str, tuple[QoSPolicyKind, ...]]
    readable = {f'{node.resolve_topic_name(topic)}.subscription': OVERRIDES for topic in topics}
    readable |= {f'{node.resolve_topic_name(topic)}.publisher': tuple(policy_kinds) for topic in outputs}
    notes = []
    for name, parameter in node.get_parameters_by_prefix(QOS_OVERRIDES).items():
        end, _, policy = name.rpartition('.')
        shown, policies = f'{QOS_OVERRIDES}.{name}', [kind.name.lower() for kind in readable.get(end, ())]
        if end not in readable:
            near = did_you_mean(end, readable)
            known_ends = ', '.join(readable)
            notes.append(
                f'{shown} has no effect: the node has no such input or output, but {known_ends}{near}'
            )
        elif policy not in policies:
            near = did_you_mean(policy, policies)
            notes.append(f'{shown} has no effect: of {end} it reads {", ".join(policies)}{near}')
        else:
            _check_policy(shown, policy, parameter.value)
    return notes


def _check_policy(shown: str, policy: str, value: object) -> None:
    """Check an override of a policy: one of its words, for the depth a whole number from 0.

    Args:
        shown: Name of the parameter, for the error.
        policy: The policy in lower case, e.g. ``reliability``.
        value: The value given.

    Raises:
        ConfigurationError: The policy does not have that value.
    """
    words = [word.lower() for word in getattr(_POLICY_WORDS.get(policy), '__members__', ())]
    rule = f'one of {", ".join(words)}' if words else 'a whole number, not below 0'
    fits = str(value).lower() in words if words else type(value) is int and value >= 0
    require_rule(fits, shown, value, f'{rule}{did_you_mean(value, words)}')


class MonitorNode(LifecycleNode):
    """Subscribes to shaft speed and bearing load, publishes predictions and warnings.

    Questions about the configuration are logged as warnings when it is made.

    Raises:
        ConfigurationError: A parameter breaks its rule.
        RosError: An input's message type or field does not exist, or the state file's folder.
        StickslipError: The store cannot take clips.

    Args:
        store: Makes what takes event clips; without it the node takes none.
        options: As for any lifecycle node.

    Attributes:
        config: The configuration in force, with names of topics as given.
        health: The node's own health; a new one from each configuring on.
    """

    # A node that could not be made is destroyed all the same.
    _configured: Configured | None = None
    _loop: NodeLoop | None = None

    def __init__(self, store: Callable[[ClipConfig], ClipStore] | None = None, **options: Any) -> None:
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True, **options)
        self._store, self._failure = store, ''
        self.health = NodeHealth()
        simulated = self.get_parameter(USE_SIM_TIME).value
        # ROS itself only logs that it is wrong.
        require_rule(isinstance(simulated, bool), USE_SIM_TIME, simulated, 'true or false')
        self.config = build_config(parameter_values(self), is_live=True)
        questions = chain.from_iterable(map(question_sentences, self.config.bearings))
        for note in (*self.config.notes, *self.config.faults, *questions):
            self.get_logger().warning(note)
        for note in check_overrides(self, self.config):
            self.get_logger().warning(note)
        self._check_machine(self.config)
        self.make_store(self.config.clips)
        declare_parameters(self)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._refuse_unknown_types()

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        """Subscriptions that executors serve: all but the inputs, which :class:`.Inputs` reads."""
        lanes = () if self._loop is None else self._loop.inputs.lanes
        input_ids = {id(lane.subscription) for lane in lanes}
        return (one for one in super().subscriptions if id(one) not in input_ids)

    def start(self) -> None:
        """Configure and activate the node.

        Raises:
            RosError: A transition failed; the text says why.
        """
        for name in ('configure', 'activate'):
            if getattr(self, f'trigger_{name}')() != TransitionCallbackReturn.SUCCESS:
                raise RosError(f'the node cannot {name}: {self._failure or "see its log"}')

    def guard_callback(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a callback: an exception in it goes to :meth:`report_exception`, and ``None`` is returned."""

        def call(*arguments: Any) -> Any:
            """Return the result of the callback; ``None`` where it raised, which is reported."""
            try:
                return callback(*arguments)
            except Exception as error:
                self.report_exception(error)

        # rclpy looks at it before each call: to work it out takes longer than the call itself.
        call.__signature__ = inspect.signature(callback)  # type: ignore[attr-defined]
        return call

    def report_exception(self, error: Exception) -> None:
        """Log an unexpected exception, at most every 5 s; count it in the health; put the first on record."""
        frames = traceback.extract_tb(error.__traceback__)
        place = f' ({Path(frames[-1].filename).name}:{frames[-1].lineno})' if frames else ''
        text = f'{type(error).__name__}: {ros_error_text(error)}{place}'
        self.health.failures += 1
        at = datetime.now(timezone.utc)
        self.health.last_failure, self.health.failing = f'at {at:%H:%M:%S} UTC: {text}', True
        self.get_logger().error(f'a callback failed, the node continues: {text}', throttle_duration_sec=5.0)
        if self.health.failures == 1:
            self._put_on_record('node', f'a callback failed: {text}')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the session from the parameters and create the publishers, with a new health.

        Only the changed parameters stay in the health. The saved alarms are restored, and the state file is
        locked. Returns ``FAILURE``, and logs why, where that is impossible.
        """
        self.health = NodeHealth(changed=self.health.changed, calibration_faults=self.config.faults)
        bearings = plural(len(self.config.bearings), 'bearing')
        self.get_logger().info(f'computing the boundaries of {bearings}')
        try:
            self._configured = Configured(self, self.config, self.health, self.make_store)
        except (*ROS_FAULTS, StickslipError) as error:
            return self._fail_transition(f'it cannot be set up: {ros_error_text(error)}')
        self._record_state('configured, inactive')
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe to the inputs, offer the services, and start the loop; log it, and put it on record.

        Returns ``FAILURE``, and logs why, where an input or a service cannot be made.
        """
        assert self._configured is not None
        simulated = self.get_parameter(USE_SIM_TIME).value is True
        try:
            clock = node_clock(self, simulated)
            loop = NodeLoop(self, self._configured, self.guard_callback, clock, simulated)
        except ROS_FAULTS as error:
            return self._fail_transition(f'its inputs cannot be subscribed to: {ros_error_text(error)}')
        result = super().on_activate(state)
        self._record_state('active')
        self._log_inputs(self._configured.session.config)
        self._loop = loop
        loop.begin()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the loop, if there is one, and log that; session, alarms and publishers stay."""
        self._stop_listening()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Write clips and alarms, and destroy the publishers and the session; log the new state."""
        self._take_down()
        self._record_state('unconfigured')
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the loop, write clips and alarms, and destroy publishers and session, from any state.

        The new state is logged.
        """
        self._stop_listening()
        self._take_down()
        self._record_state('finalized')
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Publish that nobody monitors, write unfinished clips and alarms, and destroy the node."""
        was_active = self._loop is not None
        self._stop_listening()
        if self._configured is not None:
            if was_active:
                self._configured.outputs.flush()
            self._configured.close()
        super().destroy_node()

    def make_store(self, config: ClipConfig) -> ClipStore | None:
        """Make the store for the clips of a configuration; ``None`` where it wants no clips.

        Raises:
            StickslipError: The node was started without what takes clips, or their folder cannot be made.
        """
        if not config.directory:
            return None
        if self._store is None:
            raise RosError(
                f"clips.directory = '{config.directory}': this node was started without anything"
                " that writes clips; run the executable 'monitor'"
            )
        return self._store(config)

    def _put_on_record(self, topic: str, text: str) -> None:
        """Add a text about ``topic`` to the notes of ``~/alarms``; do nothing while not configured."""
        if self._configured is not None:
            self._configured.session.note(topic, text)

    def _fail_transition(self, text: str) -> TransitionCallbackReturn:
        """Log why a transition fails, store that for :meth:`start`, and return ``FAILURE``."""
        # Logged here because rclpy says nothing of an exception in a transition.
        self._failure = text
        self.get_logger().error(text)
        return TransitionCallbackReturn.FAILURE

    def _record_state(self, state: str) -> None:
        """Log the state of the node, and add it to the notes of ``~/alarms``."""
        text = f'the monitor is {state}'
        self.get_logger().info(text)
        self._put_on_record('lifecycle', text)

    def _log_inputs(self, config: MonitorConfig) -> None:
        """Log which inputs of which bearings an active node monitors, and in which ROS domain."""
        log, domain = self.get_logger().info, os.environ.get('ROS_DOMAIN_ID') or '0'
        bearings = plural(len(config.bearings), 'bearing')
        log(f'{self.get_fully_qualified_name()} monitors {bearings} in ROS domain {domain}')
        for bearing in config.bearings:
            geared = f' {bearing.speed.gear_text}'.rstrip()
            inputs = [
                f'{name} in {source.unit}{geared if name == "speed" else ""} from {source.topic}'
                f' ({source.type}, {source.field_text})'
                for name, source in bearing.inputs.items()
                if not source.is_assumed
            ]
            inputs += [f'load {bearing.load.origin}'] * bearing.load.is_assumed
            log(f'{bearing.name}: {", ".join(inputs)}')

    def _stop_listening(self) -> None:
        """End and destroy the loop, and put on record that nobody monitors; do nothing without a loop."""
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.destroy()
            self._record_state('inactive: the bearings are not monitored')
            loop.end()

    def _take_down(self) -> None:
        """Destroy publishers and session, and write clips and alarms; do nothing where there are none."""
        if self._configured is not None:
            self._configured.destroy()
            self._configured = None

    def _check_machine(self, config: MonitorConfig) -> None:
        """Check what only this machine knows: message types, fields, and the state file.

        Raises:
            RosError: One of them cannot be used.
        """
        check_inputs(resolve_topics(self, config), output_names(self, config))
        if config.state_file:
            StateFile(config.state_file).check()

    def _on_parameters(self, changes: list[RosParameter[Any]]) -> SetParametersResult:
        """Apply changes of parameters, all or none, and return whether, and why not.

        A configured node takes changes of live parameters into its session, and replaces session and
        publishers for others. What changed is logged, put on record and, of a bearing, reported in
        diagnostics until acknowledged.
        """
        # Those of publishers and subscriptions are declared, and read-only, as these are made.
        changes = [change for change in changes if not change.name.startswith('qos_overrides.')]
        try:
            config, rebuilt, changed = build_changed_config(self, changes, self._loop is not None)
            self._check_machine(config)
            if self._configured is not None:
                take = self._configured.rebuild if rebuilt else self._configured.retune
                take(config)
            self.config = config
        except StickslipError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            self.report_exception(error)
            return SetParametersResult(successful=False, reason=f'a fault of the node, see its log: {error}')
        for name, (before, after) in changed.items():
            text = f'parameter {name}: {before!r} -> {after!r}'
            self.get_logger().info(text)
            self._put_on_record('parameter', text)
            if name.partition('.')[0] in bearing_names(parameter_values(self)):
                self.health.record_change(name, before, after)
        return SetParametersResult(successful=True)

    def _refuse_unknown_types(self) -> None:
        """Replace the callbacks of the services that set parameters: requests of unknown types are refused.

        rclpy raises, and never answers them.
        """
        known_types = {kind.value for kind in RosParameter.Type}

        def refusing(serve: Callable[..., Any], request: Any, response: Any) -> Any:
            """Serve a request of known types; put the reason into the response to any other."""
            unknown = [one for one in request.parameters if one.value.type not in known_types]
            if not unknown:
                return serve(request, response)
            kind = unknown[0].value.type
            reason = f'{unknown[0].name}: there is no type of parameter {kind}; nothing is set'
            refusal = SetParametersResult(successful=False, reason=reason)
            if isinstance(response, SetParametersAtomically.Response):
                response.result = refusal
            else:
                response.results = [refusal] * len(request.parameters)
            return response

        for service in self.services:
            if service.srv_type in (SetParameters, SetParametersAtomically):
                service.callback = functools.partial(refusing, service.callback)


def ros_error_text(error: Exception) -> str:
    """Return the message of an exception of ROS on one line, without places in ROS's sources."""
    return ' '.join(re.sub(r',? at /\S+', '', str(error)).split())
