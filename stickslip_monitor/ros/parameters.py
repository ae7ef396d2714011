# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from the parameter table: declared with descriptors, read back as a whole."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.config import MonitorConfig, parameters_of
from stickslip_monitor.monitor.config_file import is_ros_parameter
from stickslip_monitor.monitor.configure import bearing_names, build_config
from stickslip_monitor.monitor.parameter import REQUIRED, Parameter

USE_SIM_TIME = 'use_sim_time'


def descriptor(row: Parameter) -> ParameterDescriptor:
    """The ROS descriptor of a row of the table; its rule is enforced by the configuration too."""
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


def check_time_source(value: Any) -> None:
    """Check use_sim_time, of which ROS itself only logs that it is wrong.

    Raises:
        ConfigurationError: It is not a boolean.
    """
    if not isinstance(value, bool):
        raise ConfigurationError(f'{USE_SIM_TIME} = {value!r} must be true or false')


def declare(node: Node) -> None:
    """Give every parameter its descriptor, and those without a value their default.

    The node has declared what the parameter file and the command line gave.

    Raises:
        ConfigurationError: The list of bearings breaks its rule.
    """
    for name, row in parameters_of(bearing_names(values(node))).items():
        if node.has_parameter(name):
            value = _as_written(name, node.get_parameter(name).value)
            node.undeclare_parameter(name)
            if value is not None:
                node.declare_parameter(name, value, descriptor(row), ignore_override=True)
                continue
        missing = row.default is REQUIRED or row.optional
        node.declare_parameter(
            name, None if missing else row.default, descriptor(row), ignore_override=True
        )


def _as_written(name: str, value: Any) -> Any:
    # 'ros2 param dump' writes what has no value as null, which comes back as a word.
    if value in ('null', 'None'):
        return None
    # ROS reads the bare word N of a parameter file as the YAML 1.1 boolean 'no'.
    return 'N' if name.endswith('load.unit') and value is False else value


def values(node: Node) -> dict[str, Any]:
    """The values of the node's own parameters, without those not set and those of ROS itself."""
    written = {
        name: _as_written(name, parameter.value)
        for name, parameter in node.get_parameters_by_prefix('').items()
        if not is_ros_parameter(name)
    }
    return {name: value for name, value in written.items() if value is not None}


def changed_config(
    node: Node, changes: Iterable[RosParameter[Any]], active: bool
) -> tuple[MonitorConfig, bool]:
    """The configuration that a set of changes would make.

    Returns:
        The configuration, and whether more than live parameters changed.

    Raises:
        ConfigurationError: A value breaks its rule, or may not change while the node is active.
    """
    proposed = values(node)
    rows = parameters_of(bearing_names(proposed))
    rebuilt = False
    for change in changes:
        name, value = change.name, _as_written(change.name, change.value)
        if name == USE_SIM_TIME and active and value != node.get_parameter(name).value:
            raise _read_only(name, value)
        if is_ros_parameter(name):
            continue
        if value is None:
            if proposed.get(name) is None:
                continue
            raise ConfigurationError(f'{name} cannot be deleted: set it to a value')
        row = rows.get(name)
        if row is not None and not row.live and _plain(value) != _plain(proposed.get(name)):
            if row.fixed:
                shown = list(value) if isinstance(_plain(value), tuple) else value
                raise ConfigurationError(
                    f'{name} = {shown!r} cannot be set: a running node keeps it; restart it'
                    ' with another parameter file'
                )
            if active:
                raise _read_only(name, value)
            rebuilt = True
        proposed[name] = value
    return build_config(proposed), rebuilt


def told_changes(node: Node, changes: Iterable[RosParameter[Any]]) -> list[str]:
    """A line for each parameter that a set of changes gives another value."""
    return [
        f'parameter {change.name}: {node.get_parameter(change.name).value!r} -> {change.value!r}'
        for change in changes
        if _plain(change.value) != _plain(node.get_parameter(change.name).value)
    ]


def _plain(value: Any) -> Any:
    return tuple(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def _read_only(name: str, value: Any) -> ConfigurationError:
    return ConfigurationError(
        f'{name} = {value!r} cannot be set: it is read-only while the node is active;'
        ' deactivate it first'
    )
