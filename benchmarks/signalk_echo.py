# SPDX-License-Identifier: Apache-2.0
"""A client of a Signal K server that does no more than compare: what any alarm must cost."""

from __future__ import annotations

import asyncio
import json
import sys

import aiohttp


async def echo(url: str, speed: str, load: str, notification: str, limit: float) -> None:
    """Send a notification whenever the speed crosses a limit."""
    state = ''
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f'{url}/signalk/v1/stream?subscribe=none', heartbeat=10.0) as socket,
    ):
        paths = [{'path': speed}, {'path': load}]
        await socket.send_json({'context': 'vessels.self', 'subscribe': paths})
        async for message in socket:
            for update in json.loads(message.data).get('updates', ()):
                for item in update['values']:
                    new = 'alarm' if item['value'] < limit else 'normal'
                    if item['path'] == speed and new != state:
                        state = new
                        value = {'state': state, 'method': [], 'message': ''}
                        values = [{'path': notification, 'value': value}]
                        await socket.send_json(
                            {'updates': [{'$source': 'echo', 'values': values}]}
                        )


if __name__ == '__main__':
    *texts, last = sys.argv[1:]
    asyncio.run(echo(*texts, float(last)))
