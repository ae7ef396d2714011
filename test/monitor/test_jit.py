# SPDX-License-Identifier: Apache-2.0
"""Compiling plain functions: told once, at a terminal, and kept for later processes."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numba
import pytest

from stickslip_monitor import jit


def test_compiling_is_reported_at_a_terminal_until_it_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / 'arithmetic.py'
    source.write_text('def twice(x):\n    return x + x\n')
    spec = importlib.util.spec_from_file_location('arithmetic', source)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, 'arithmetic', module)
    monkeypatch.setattr(numba.config, 'CACHE_DIR', str(tmp_path / 'cache'))
    notes = []
    for terminal in (False, True, True):
        monkeypatch.setattr(sys.stderr, 'isatty', lambda terminal=terminal: terminal)
        function = jit.compiled.__wrapped__('twice', module)
        notes.append(capsys.readouterr().err)
        if terminal:
            assert function(2.0) == 4.0
    assert notes == ['', 'compiling for long work: seconds, once for this version\n', '']


def test_the_live_monitor_never_compiles() -> None:
    assert jit.has_compiler()
    with jit.interpreted():
        assert not jit.has_compiler()
        with jit.interpreted():
            pass
        assert not jit.has_compiler()
    assert jit.has_compiler()
