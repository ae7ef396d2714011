# SPDX-License-Identifier: Apache-2.0
"""The examples in docstrings are true, as `pytest --doctest-modules stickslip_monitor` finds them."""

from __future__ import annotations

import doctest
from typing import Any

import pytest
from shared import ROOT

MODULES = sorted(
    '.'.join(path.relative_to(ROOT).with_suffix('').parts)
    for path in (ROOT / 'stickslip_monitor').rglob('*.py')
    if '>>> ' in path.read_text('utf-8')
)


@pytest.mark.parametrize('name', MODULES)
def test_examples_are_true(name: str, doctest_namespace: dict[str, Any]) -> None:
    module = pytest.importorskip(name)
    assert doctest.testmod(module, extraglobs=doctest_namespace).failed == 0
