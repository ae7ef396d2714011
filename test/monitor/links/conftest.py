# SPDX-License-Identifier: Apache-2.0
"""The small Signal K server, on the loop of a test."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture
def server(loop: asyncio.AbstractEventLoop) -> Iterator[Any]:
    """Yield a server at work."""
    pytest.importorskip('aiohttp', reason="the extra 'links' is not installed")
    from benchmarks.signalk_servers import SmallServer

    server = SmallServer()
    loop.run_until_complete(server.start())
    yield server
    loop.run_until_complete(server.stop())
