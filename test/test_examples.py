# SPDX-License-Identifier: Apache-2.0
"""The examples in docstrings are true, as `pytest --doctest-modules stickslip_monitor` finds them."""

from __future__ import annotations

import doctest
from typing import Any

import pytest
from shared import ROOT

import stickslip_monitor

MODULES = sorted(
    '.'.join(path.relative_to(ROOT).with_suffix('').parts)
    for path in (ROOT / 'stickslip_monitor').rglob('*.py')
    if '>>> ' in path.read_text('utf-8')
)


@pytest.mark.parametrize('name', MODULES)
def test_examples_are_true(name: str, doctest_namespace: dict[str, Any]) -> None:
    module = pytest.importorskip(name)
    result = doctest.testmod(module, extraglobs=doctest_namespace, optionflags=doctest.ELLIPSIS)
    assert result.failed == 0


def test_every_public_name_has_an_example() -> None:
    # Shown with the function that gives it.
    results = {'Assessment', 'Assessments', 'Cycle', 'CycleKind', 'Outcome', 'Regime', 'StationaryAmplitudes'}
    public = {name: getattr(stickslip_monitor, name) for name in stickslip_monitor.__all__}
    missing = {name for name, value in public.items() if '>>> ' not in (value.__doc__ or '')}
    assert missing - results == {'StickslipError', 'MonitorConfig'}
