# SPDX-License-Identifier: Apache-2.0
"""The operator's actions as services, for all bearings and for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode
from std_srvs.srv import SetBool, Trigger

from stickslip_monitor.monitor.annunciator import Action, AlarmChange
from stickslip_monitor.ros.messages import ROS_FAULTS

BY = 'ros service'
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
Act = Callable[[Action, str, str | None], list[AlarmChange]]


class Actions:
    """The services of an active node.

    Args:
        node: The node.
        bearings: Names of the bearings.
        act: Called with the action, who asks, and the bearing (``None`` for all).
    """

    def __init__(self, node: LifecycleNode, bearings: list[str], act: Act) -> None:
        self._node = node
        self._act = act
        self._services: list[Any] = []
        try:
            for bearing in (None, *bearings):
                self._offer(bearing)
        except ROS_FAULTS:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Take the services down."""
        for service in self._services:
            self._node.destroy_service(service)
        self._services = []

    def _offer(self, bearing: str | None) -> None:
        prefix = '~' if bearing is None else f'~/{bearing}'
        for name, action in TRIGGERS.items():
            callback = self._trigger(action, bearing)
            self._services.append(self._node.create_service(Trigger, f'{prefix}/{name}', callback))
        for name, (on, off) in SWITCHES.items():
            callback = self._switch(on, off, bearing)
            self._services.append(self._node.create_service(SetBool, f'{prefix}/{name}', callback))

    def _trigger(self, action: Action, bearing: str | None) -> Callable[[Any, Any], Any]:
        def serve(_: Any, response: Any) -> Any:
            changes = self._act(action, BY, bearing)
            response.success = bool(changes)
            response.message = _answer(action, changes) or f'there is nothing to {action}'
            return response

        return serve

    def _switch(self, on: Action, off: Action, bearing: str | None) -> Callable[[Any, Any], Any]:
        def serve(request: Any, response: Any) -> Any:
            action = on if request.data else off
            changes = self._act(action, BY, bearing)
            response.success = True
            response.message = _answer(action, changes) or 'it is so already'
            return response

        return serve


def _answer(action: Action, changes: list[AlarmChange]) -> str:
    names = ', '.join(f'{change.bearing}/{change.kind}' for change in changes)
    return f'{action}: {names}' if names else ''
