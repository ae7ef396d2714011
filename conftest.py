# SPDX-License-Identifier: Apache-2.0
"""What holds for every test, and what the examples of docstrings take for granted."""

from __future__ import annotations

import asyncio
import importlib.util
import inspect
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

# How long drawing takes is the machine's affair.
settings.register_profile('any machine', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('any machine')


@pytest.fixture(autouse=True, scope='session')
def caches(tmp_path_factory: pytest.TempPathFactory):
    """Keep what the tests, and the programs they start, put into caches away from the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('caches')))
        yield


@pytest.fixture(autouse=True, scope='session')
def signals() -> Iterator[None]:
    """Let signals end what the tests start, also where nohup or a shell's background has them ignored."""
    ignored = [n for n in (signal.SIGINT, signal.SIGHUP) if signal.getsignal(n) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(autouse=importlib.util.find_spec('stickslip_monitor') is not None, scope='session')
def examples(doctest_namespace: dict[str, Any]) -> None:
    """Return the names that docs/api.md says its examples begin with."""
    import stickslip_monitor
    from stickslip_monitor.physics.scalar_law import scalar_law

    public = {name: getattr(stickslip_monitor, name) for name in stickslip_monitor.__all__}
    law = stickslip_monitor.Stribeck(static=0.30, kinetic=0.10, decay=10.0)
    reference = stickslip_monitor.Bearing(50.0, 400.0, 2.0e6, law, journal_diameter=0.100)
    doctest_namespace |= public | {'np': np, 'bearing': reference, 'scalar_law': scalar_law}


@pytest.fixture
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    """Yield the event loop of a test that is a coroutine; its tasks end with it."""
    loop = asyncio.new_event_loop()
    yield loop
    loop.run_until_complete(_end_all())
    loop.close()


async def _end_all() -> None:
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: Any) -> bool | None:
    """Run a test that is a coroutine."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    arguments = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    loop = pyfuncitem._request.getfixturevalue('loop')
    loop.run_until_complete(asyncio.wait_for(pyfuncitem.obj(**arguments), 300.0))
    return True
