# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import pytest


@pytest.fixture
def stickslip(capsys: pytest.CaptureFixture[str]) -> Any:
    """Return what runs a command in this process."""

    from shared import Done

    from stickslip_monitor.cli import main

    def run(*words: object) -> Done:
        capsys.readouterr()
        return Done(main([str(word) for word in words]), *capsys.readouterr())

    return run
