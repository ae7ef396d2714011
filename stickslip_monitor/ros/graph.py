# SPDX-License-Identifier: Apache-2.0
"""What the ROS graph tells: who publishes the inputs, and whether a node has a double."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from stickslip_monitor.monitor.input_faults import Publisher
from stickslip_monitor.monitor.input_watch import Graph
from stickslip_monitor.ros.inputs import telemetry


class RosGraph(Graph):
    """The graph as a node sees it.

    Args:
        node: The node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    def publishers(self, topic: str) -> tuple[Publisher, ...]:
        """Who publishes on a topic, with what speaks against its quality of service."""
        infos = self._node.get_publishers_info_by_topic(topic)
        return tuple(_publisher(info) for info in infos)


def publishers_on(node: Node, topic: str) -> list[str]:
    """The full names of the nodes that publish on a topic."""
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return sorted({_node_name(info) for info in infos})


def has_double(node: Node) -> bool:
    """Whether another node has the full name of this one."""
    own = (node.get_name(), node.get_namespace())
    return node.get_node_names_and_namespaces().count(own) > 1


def _node_name(info: Any) -> str:
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _publisher(info: Any) -> Publisher:
    match, reason = qos_check_compatible(info.qos_profile, telemetry())
    fits = match is not QoSCompatibility.ERROR
    return Publisher(_node_name(info), info.topic_type, '' if fits else str(reason).strip(' ;.'))
