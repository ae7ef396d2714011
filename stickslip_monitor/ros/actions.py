# SPDX-License-Identifier: Apache-2.0
"""The operator's actions: services for all bearings and for each, and a topic for dashboards.

A service of std_srvs tells neither who calls it nor of which alarm; a request on the topic does.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from stickslip_monitor.errors import ConfigurationError
from stickslip_monitor.monitor.alarms.annunciator import Action, AlarmChange
from stickslip_monitor.monitor.alarms.requests import ROS_SERVICE, ActionRequest, parse_request
from stickslip_monitor.ros.inputs import publishers_on
from stickslip_monitor.ros.message_types import ROS_FAULTS

TRIGGERS = {
    'acknowledge': Action.ACKNOWLEDGE,
    'silence': Action.SILENCE,
    'reset': Action.RESET,
    'shelve': Action.SHELVE,
    'unshelve': Action.UNSHELVE,
}
"""Services of type std_srvs/Trigger."""
SWITCHES = {
    'suppress': (Action.SUPPRESS, Action.UNSUPPRESS),
    'out_of_service': (Action.REMOVE, Action.RESTORE),
}
"""Services of type std_srvs/SetBool, with what true and false do."""
_REQUESTS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


class Actions:
    """The services of an active node, and its topic ``~/actions``.

    Args:
        node: The node.
        bearings: Names of the bearings.
        act: Does what a person asks for, and returns the changes.
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
        try:
            for bearing in (None, *bearings):
                prefix = '~' if bearing is None else f'~/{bearing}'
                for name, action in TRIGGERS.items():
                    self._serve(Trigger, f'{prefix}/{name}', bearing, action, action)
                for name, (on, off) in SWITCHES.items():
                    self._serve(SetBool, f'{prefix}/{name}', bearing, on, off)
            self._requests = node.create_subscription(
                String, '~/actions', self._on_request, _REQUESTS
            )
        except ROS_FAULTS:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Take services and topic down."""
        if self._requests is not None:
            self._node.destroy_subscription(self._requests)
            self._requests = None
        for service in self._services:
            self._node.destroy_service(service)
        self._services = []

    def _on_request(self, message: Any) -> None:
        try:
            request = parse_request(json.loads(message.data), self._bearings)
        except (ConfigurationError, ValueError, RecursionError) as error:
            self._node.get_logger().warning(
                f'a request on ~/actions is refused: {error}', throttle_duration_sec=1.0
            )
            return
        senders = ', '.join(publishers_on(self._node, '~/actions')) or 'a node that has gone'
        what = '/'.join(part for part in (request.bearing, request.kind) if part) or 'all alarms'
        self._log(f'{request.action} of {what} asked for by {request.by} over {senders}')
        self._act(request)

    def _log(self, text: str) -> None:
        self._node.get_logger().info(text)

    def _serve(self, kind: Any, name: str, bearing: str | None, on: Action, off: Action) -> None:
        """Offer a service; of a Trigger both actions are one."""

        def serve(request: Any, response: Any) -> Any:
            action = on if getattr(request, 'data', True) else off
            self._log(f'{action} of {bearing or "all bearings"} asked for by a {ROS_SERVICE} call')
            changes = self._act(ActionRequest(action, ROS_SERVICE, bearing))
            names = ', '.join(f'{change.bearing}/{change.kind}' for change in changes)
            nothing = f'there is nothing to {action}' if on is off else 'it is so already'
            response.success = bool(changes) or on is not off
            response.message = f'{action}: {names}' if names else nothing
            return response

        self._services.append(self._node.create_service(kind, name, serve))
