# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest
from shared import Done, Stickslip

from stickslip_monitor.cli import main


@pytest.fixture
def stickslip(capsys: pytest.CaptureFixture[str]) -> Stickslip:
    """Runs a command in this process."""

    def run(*words: object) -> Done:
        capsys.readouterr()
        return Done(main([str(word) for word in words]), *capsys.readouterr())

    return run
