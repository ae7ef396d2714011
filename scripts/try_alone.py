#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the tests of a package in a copy of the tree that lacks the packages above it.

They are not installed there either: what an editable installation would find is taken away.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ABSENT = {'logs': ('stickslip_monitor', 'stickslip_lab'), 'monitor': ('stickslip_lab',)}
"""By the folder of the tests of a package those above it."""
# Python runs it before anything else, in the programs that tests start, too.
_SITE = """import sys
is_editable = lambda finder: getattr(finder, '__module__', '').startswith('__editable__')
sys.meta_path[:] = [finder for finder in sys.meta_path if not is_editable(finder)]
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the tests of each package alone; return the exit code of the first that fail."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('pytest_args', nargs='*', help='handed to pytest, behind --')
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix='stickslip-alone-') as folder:
        for tests, absent in ABSENT.items():
            tree = Path(folder) / tests
            copy_without(tree, absent)
            if code := run_alone(tree, absent, [f'test/{tests}', *args.pytest_args]):
                return code
    return 0


def copy_without(tree: Path, absent: Sequence[str]) -> None:
    """Copy what git knows of this tree, but for some packages and their tests."""
    left_out = {*absent, *(f'test/{name.removeprefix("stickslip_")}' for name in absent)}
    listed = subprocess.check_output(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'], cwd=ROOT, text=True
    )
    for name in filter(None, listed.split('\0')):
        parents = {str(parent) for parent in Path(name).parents}
        if not parents & left_out and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
    (tree / 'sitecustomize.py').write_text(_SITE)


def run_alone(tree: Path, absent: Sequence[str], pytest_args: Sequence[str]) -> int:
    """Run tests in a tree; return the exit code, after a proof that packages are absent."""
    environment = os.environ | {'PYTHONPATH': str(tree)}
    probe = f'import importlib.util as u; print([n for n in {absent!r} if u.find_spec(n)])'
    importable = subprocess.check_output([sys.executable, '-c', probe], cwd=tree, env=environment, text=True)
    if importable.strip() != '[]':
        print(f'{importable.strip()} can be imported, and should be absent', file=sys.stderr)
        return 1
    line = [sys.executable, '-m', 'pytest', '-q', '-m', 'not slow', *pytest_args]
    return subprocess.run(line, cwd=tree, env=environment, check=False).returncode


if __name__ == '__main__':
    sys.exit(main())
