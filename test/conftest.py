# SPDX-License-Identifier: Apache-2.0
"""What holds for every test."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings

# How long drawing takes is the machine's affair.
settings.register_profile(
    'any machine', deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile('any machine')


@pytest.fixture(autouse=True, scope='session')
def caches(tmp_path_factory: pytest.TempPathFactory):
    """Keep what the tests, and the programs they start, put into caches away from the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('caches')))
        yield
