# SPDX-License-Identifier: Apache-2.0
"""The page of the benchmarks: whose numbers it keeps, and that every part can be run."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import page, rule_speed
from benchmarks.parts import PARTS, SOAK

FOLDER = Path(page.__file__).parent


@pytest.mark.parametrize('name', [*PARTS, SOAK])
def test_every_part_is_a_module_with_run(name: str) -> None:
    tree = ast.parse((FOLDER / f'{name}.py').read_text('utf-8'))
    (run,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == 'run')
    assert [argument.arg for argument in run.args.args] == ['quick']


def test_the_rule_is_timed_beside_itself() -> None:
    names = ['update', 'bulk, interpreted']
    times = rule_speed.compare_checkouts([rule_speed.ROOT, rule_speed.ROOT], 0.0, names)
    assert list(times) == names
    assert all(np.isfinite(pair).all() and min(pair) > 0.0 for pair in times.values())


def test_another_package_is_not_timed_as_a_checkout(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=re.escape(f'was imported for {tmp_path}')):
        rule_speed.compare_checkouts([tmp_path], 0.0, [])


def test_the_page_is_written_by_the_benchmarks_alone() -> None:
    """Write the stored sections again; what a person adds between them would be lost."""
    stored = page.PAGE.read_text('utf-8')
    sections = page.split_sections(stored)
    written = page.render(sections, (*PARTS, SOAK))
    assert [*sections] == [name for name in (*PARTS, SOAK) if name in sections]
    assert written.replace(page.describe_machine(), '') == stored.replace(_machine_lines(stored), '')


def _machine_lines(text: str) -> str:
    (lines,) = re.findall(r'^Machine: .*\nVersions: .*$', text, re.MULTILINE)
    return str(lines)
