# SPDX-License-Identifier: Apache-2.0
"""Tells the service manager that the node is up, and again and again that it is not stuck.

The protocol is that of sd_notify(3): datagrams to the socket that ``NOTIFY_SOCKET`` names. Without
a service manager nothing is told.
"""

from __future__ import annotations

import math
import os
import socket
import time
from collections.abc import Mapping


class ServiceManager:
    """What started the node, as far as it wants to be told.

    Args:
        environment: What it has put into the environment.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get('NOTIFY_SOCKET', '')
        if self._address.startswith('@'):
            self._address = f'\0{self._address[1:]}'
        limit = environment.get('WATCHDOG_USEC', '')
        # Half the limit, as sd_watchdog_enabled(3) recommends.
        self._period = 0.5e-6 * int(limit) if limit.isdecimal() else math.inf
        self._told = -math.inf

    def tell(self, state: str) -> None:
        """Send a state, such as ``READY=1``; a manager that is gone is nothing to stop for."""
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as own:
                own.sendto(state.encode(), self._address)
        except OSError:
            pass

    def beat(self) -> None:
        """Say that the node is alive, as often as the watchdog wants to hear it."""
        now = time.monotonic()
        if now - self._told >= self._period:
            self._told = now
            self.tell('WATCHDOG=1')
