# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


@pytest.fixture
def nmea_reader() -> Callable[[str], Any]:
    """Reads a sentence, strictly, as another program does."""
    reader = pytest.importorskip('pynmeagps', reason='pynmeagps is not installed').NMEAReader
    return lambda line: reader.parse(f'{line}\r\n', validate=1)
