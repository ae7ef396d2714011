# SPDX-License-Identifier: Apache-2.0
"""The operator's actions over ROS: the services of the node, and its topic of requests."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.alarm_list import Action, AlarmChange
from stickslip_monitor.monitor.alarm_records import ROS_SERVICE, ActionRequest, parse_request
from stickslip_monitor.ros.other_nodes import node_name

TRIGGERS = (Action.ACKNOWLEDGE, Action.SILENCE, Action.RESET, Action.SHELVE, Action.UNSHELVE)
"""Services of type std_srvs/Trigger."""
SWITCHES = {'out_of_service': (Action.REMOVE, Action.RESTORE)}
"""Services of type std_srvs/SetBool, with what true and false do."""


class Actions:
    """The operator's actions: services for all bearings, and a topic for one.

    A service of std_srvs names neither the caller nor the alarm; a request on the topic
    ``~/actions`` does.

    Args:
        bearings: Names that a request may have.
        act: Carries out a request, and returns what it changed.
    """

    def __init__(
        self, node: LifecycleNode, bearings: list[str], act: Callable[[ActionRequest], list[AlarmChange]]
    ) -> None:
        self._node, self._bearings, self._carry_out = node, bearings, act
        self._services: list[Any] = []
        for action in TRIGGERS:
            self._offer_service(Trigger, action, action, action)
        for name, (on, off) in SWITCHES.items():
            self._offer_service(SetBool, name, on, off)
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._requests: Any = node.create_subscription(String, '~/actions', self._on_request, qos)

    def destroy(self) -> None:
        """Destroy the services and the subscription."""
        self._node.destroy_subscription(self._requests)
        for service in self._services:
            self._node.destroy_service(service)

    def _on_request(self, message: Any) -> None:
        """Carry out a request of the topic, after a line in the log on who asked.

        An invalid one is not carried out: the reason is logged.
        """
        log = self._node.get_logger()
        try:
            request = parse_request(json.loads(message.data), self._bearings)
        except (ConfigurationError, ValueError, RecursionError) as error:
            log.warning(f'a request on ~/actions is refused: {error}', throttle_duration_sec=1.0)
            return
        infos = self._node.get_publishers_info_by_topic(self._requests.topic_name)
        who = ', '.join(sorted(set(map(node_name, infos)))) or 'a node that has gone'
        subject = '/'.join(part for part in (request.bearing, request.kind) if part) or 'all alarms'
        log.info(f'{request.action} of {subject} asked for by {request.by} over {who}')
        self._carry_out(request)

    def _offer_service(self, kind: Any, name: str, on: Action, off: Action) -> None:
        """Create a service that carries out ``on`` or ``off`` (alike for a Trigger) for all bearings."""

        def serve(request: Any, response: Any) -> Any:
            """Log and carry out the action for all bearings; return the response with the alarms changed.

            ``success`` is false for a Trigger that changed none, never for a SetBool.
            """
            action = on if getattr(request, 'data', True) else off
            self._node.get_logger().info(f'{action} of all bearings asked for by a {ROS_SERVICE} call')
            changes = self._carry_out(ActionRequest(action, ROS_SERVICE))
            names = ', '.join(f'{change.bearing}/{change.kind}' for change in changes)
            nothing = f'there is nothing to {action}' if on is off else 'no change: it is so already'
            response.success = bool(changes) or on is not off
            response.message = f'{action}: {names}' if names else nothing
            return response

        self._services.append(self._node.create_service(kind, f'~/{name}', serve))
