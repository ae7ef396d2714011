# SPDX-License-Identifier: Apache-2.0
"""The page of the benchmarks: whose numbers it keeps, and that every part can be run."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from benchmarks import page
from benchmarks.parts import PARTS, SOAK

FOLDER = Path(page.__file__).parent


@pytest.mark.parametrize('name', [*PARTS, SOAK])
def test_every_part_is_a_module_with_run(name: str) -> None:
    tree = ast.parse((FOLDER / f'{name}.py').read_text('utf-8'))
    (run,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == 'run')
    assert [argument.arg for argument in run.args.args] == ['quick']
