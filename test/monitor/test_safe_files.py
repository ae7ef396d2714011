# SPDX-License-Identifier: Apache-2.0
"""A file is there as a whole or not at all, and drafts go with the processes that wrote them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stickslip_monitor.safe_files import write_whole


def test_a_full_disk_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, target: Path) -> None:
        raise OSError(28, 'No space left on device')

    path = tmp_path / 'a.txt'
    write_whole(path, b'ours: old', b'ours')
    monkeypatch.setattr(Path, 'replace', full)
    with pytest.raises(OSError, match='No space'):
        write_whole(path, b'ours: new', b'ours')
    assert path.read_bytes() == b'ours: old'
    assert [p.name for p in tmp_path.iterdir()] == ['a.txt']


def test_the_draft_of_a_killed_process_is_swept_and_that_of_a_living_one_kept(tmp_path: Path) -> None:
    code = (
        'import sys; from stickslip_monitor.safe_files import lock_draft\n'
        'file = open(sys.argv[1], "wb"); assert lock_draft(file.fileno())\n'
        'print(flush=True); sys.stdin.read()'
    )
    dead, living = tmp_path / '.a.txt.1.draft', tmp_path / '.a.txt.2.draft'
    with subprocess.Popen(
        [sys.executable, '-c', code, living], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        holder.stdout.readline()
        dead.touch()
        for draft in (dead, living):
            os.utime(draft, (time.time() - 60.0,) * 2)
        write_whole(tmp_path / 'a.txt', b'ours', b'ours')
        assert sorted(path.name for path in tmp_path.iterdir()) == ['.a.txt.2.draft', 'a.txt']
        holder.communicate()
