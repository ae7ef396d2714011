# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of the physics."""

from __future__ import annotations

import doctest
from importlib import import_module
from pathlib import Path

import pytest

import stickslip_monitor
from stickslip_monitor.physics.scalar_law import scalar_law

_ROOT = Path(stickslip_monitor.__file__).parent
_MODULES = sorted(
    '.'.join(path.relative_to(_ROOT.parent).with_suffix('').parts)
    for path in (_ROOT / 'physics').rglob('*.py')
    if path.stem != '__init__'
)
# What the examples take for granted: the public names, and the law of a loop.
_NAMES = {name: getattr(stickslip_monitor, name) for name in stickslip_monitor.__all__}


@pytest.mark.parametrize('name', _MODULES)
def test_examples_are_true(name: str) -> None:
    module = import_module(name)
    assert doctest.testmod(module, extraglobs={'scalar_law': scalar_law} | _NAMES).failed == 0
