# SPDX-License-Identifier: Apache-2.0
"""Run the comparisons, each in a process of its own, and write benchmarks/results.md."""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import PAGE, render
from benchmarks.parts import PARTS, SOAK
from benchmarks.table import Table


def main(argv: Sequence[str] | None = None) -> int:
    """Run and write; return 1 where a part failed."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks', description=__doc__)
    names = ', '.join((*PARTS, SOAK))
    parser.add_argument('--only', metavar='PART,...', help=f'some parts only: {names}')
    parser.add_argument('--soak', action='store_true', help=f'run {SOAK} only: ten minutes')
    parser.add_argument('--quick', action='store_true', help='short runs; print, write nothing')
    parser.add_argument('--record', type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    chosen = [SOAK] if args.soak else args.only.split(',') if args.only else list(PARTS)
    for name in chosen:
        if name not in (*PARTS, SOAK):
            parser.error(f"part '{name}' is not one of {names}")
    if args.record:
        table = importlib.import_module(f'benchmarks.{chosen[0]}').run(args.quick)
        args.record.write_text(json.dumps(table.record()), 'utf-8')
        return 0
    return _run_parts(chosen, args.quick)


def _run_parts(chosen: Sequence[str], quick: bool) -> int:
    sections: dict[str, str] = {}
    failed = []
    for name in chosen:
        begin = time.monotonic()
        print(f'{name} ...', flush=True)
        section = _measure_section(name, quick)
        if section is None:
            failed.append(name)
        else:
            print(f'\n{section}\n({time.monotonic() - begin:.0f} s)\n', flush=True)
            sections[name] = section
    if sections and not quick:
        old = PAGE.read_text('utf-8') if PAGE.exists() else ''
        PAGE.write_text(render(sections, (*PARTS, SOAK), old), 'utf-8')
        print(f'written: {PAGE}')
    if failed:
        print(f'ERROR: failed: {", ".join(failed)}', file=sys.stderr)
    return int(bool(failed))


def _measure_section(name: str, quick: bool) -> str | None:
    """Run a part in a process of its own, apart from the memory and threads of others; return its section."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / 'table.json'
        command = [sys.executable, '-m', 'benchmarks', '--only', name, '--record', str(record)]
        if subprocess.run([*command, *(['--quick'] if quick else [])], check=False).returncode:
            return None
        return Table.of(json.loads(record.read_text('utf-8'))).markdown()


if __name__ == '__main__':
    sys.exit(main())
