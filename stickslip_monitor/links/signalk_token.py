# SPDX-License-Identifier: Apache-2.0
"""The token of a Signal K server in ``signalk.token_file``: read, or asked for and written."""

from __future__ import annotations

import asyncio
import os
import re
import socket
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp

from stickslip_monitor.errors import LinkError
from stickslip_monitor.links.links_config import SignalKLink
from stickslip_monitor.links.signalk_client import failure_reason, make_ssl_context
from stickslip_monitor.safe_files import MAX_TOKEN_BYTES, read_token

ASK_PERIOD = 2.0
"""Time between two questions whether the request is approved [s]: an officer needs minutes."""


def read_signalk_token(path: str) -> str:
    """Return the token of the server in ``signalk.token_file``; '' where the path is empty.

    Raises:
        ConfigurationError: The file cannot be read, or holds no token.
        LinkError: Others can read the file.
    """
    if not path:
        return ''
    token = read_token(path)
    if Path(path).stat().st_mode & 0o077:
        raise LinkError(f"signalk.token_file = '{path}' can be read by others: chmod 600 it")
    return token


async def save_requested_token(link: SignalKLink | None, log: Callable[[str], object]) -> None:
    """Ask the server for a token, and write it to ``signalk.token_file``, readable by the owner only.

    It waits without limit until an officer decides in the server's pages.

    Args:
        link: The Signal K link, ``None`` where none is configured.
        log: Given the instruction for the officer, and then the place of the token.

    Raises:
        LinkError: No server or file is configured, the file holds something else, or the request fails.
        OSError: The file cannot be written.
    """
    if link is None or not link.token_file:
        raise LinkError('--request-token needs signalk.url and signalk.token_file')
    path = Path(link.token_file).absolute()
    if not path.parent.is_dir():
        raise LinkError(f"signalk.token_file = '{path}': there is no folder {path.parent}")
    if path.exists() and not _is_replaceable(path):
        raise LinkError(f"signalk.token_file = '{path}' exists and holds no token: name another file")
    # The same for the same machine and file, so that the officer sees one device, not many.
    client_id = str(uuid.uuid5(uuid.NAMESPACE_URL, f'{socket.gethostname()}{path}'))
    token = await request_token(link, client_id, log)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, 'w', encoding='ascii') as file:
        os.fchmod(descriptor, 0o600)
        file.write(f'{token}\n')
    log(f'The token is in {path}')


def _is_replaceable(path: Path) -> bool:
    """Return whether a path is a regular file, no link, that is empty or holds a JSON Web Token."""
    if not path.is_file() or path.is_symlink() or path.stat().st_size > MAX_TOKEN_BYTES:
        return False
    return re.fullmatch(rb'([\w-]+(\.[\w-]+){2,})?\n?', path.read_bytes()) is not None


async def request_token(
    link: SignalKLink, client_id: str, started: Callable[[str], object], every: float = ASK_PERIOD
) -> str:
    """Ask a server for a token, and wait until an officer decides in the server's pages; return the token.

    Args:
        link: The configuration, with the address of the server.
        client_id: A UUID that stays the same, so that the officer sees one device.
        started: Called once with the instruction for the officer, before the wait.
        every: Time between two questions whether it is decided [s].

    Raises:
        LinkError: The server cannot be asked, the request is denied, or the file of certificates has none.
    """
    url, context = link.url, make_ssl_context(link.ca_file)
    body = {'clientId': client_id, 'description': 'stickslip_monitor', 'permissions': 'readwrite'}
    try:
        async with aiohttp.ClientSession() as session:
            answer = await _await_answer(
                session.post(f'{url}/signalk/v1/access/requests', json=body, ssl=context)
            )
            started(f'Approve stickslip_monitor in the pages of {url} (Security, Access Requests)')
            while answer.get('state') == 'PENDING':
                await asyncio.sleep(every)
                answer = await _await_answer(session.get(f'{url}/{answer["href"].lstrip("/")}', ssl=context))
    except (aiohttp.ClientError, OSError, asyncio.TimeoutError, ValueError, KeyError) as error:
        raise LinkError(
            f"signalk.url = '{url}' cannot be asked for a token: {failure_reason(error)}"
        ) from error
    token = (answer.get('accessRequest') or {}).get('token')
    if not isinstance(token, str):
        raise LinkError(f"signalk.url = '{url}': the request for a token was denied")
    return token


async def _await_answer(request: Any) -> dict[str, Any]:
    """Await an HTTP request and return the JSON object of its answer.

    Raises:
        aiohttp.ClientError: The answer is an error or not an object; a connection fails.
        ValueError: The answer is not JSON.
    """
    async with request as response:
        answer = await response.json(content_type=None)
        if response.status >= 400 or not isinstance(answer, dict):
            raise aiohttp.ClientError(f'it answers {response.status}: {answer}')
        return answer
