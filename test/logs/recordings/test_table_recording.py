# SPDX-License-Identifier: Apache-2.0
"""A table is read once, in bounded memory, though the order of its lines is known at its end only."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from stickslip_logs.errors import BagError
from stickslip_logs.recordings import table_reading
from stickslip_logs.recordings.recording import Request
from stickslip_logs.recordings.table_recording import TableRecording
from stickslip_logs.tables.table_file import BLOCK, TextTable

COUNT = 3 * BLOCK + 5
SPEED, LOAD = Request('speed', 'data'), Request('load', 'data')


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Write a line a second, after half of which the clock was set back by an hour."""
    path = tmp_path / 'a.csv'
    times = (1_780_000_000 + k - 3600 * (k >= COUNT // 2) for k in range(COUNT))
    path.write_text('time,speed,load\n' + ''.join(f'{t},{k},{2 * k}\n' for k, t in enumerate(times)))
    return path


def test_a_table_is_parsed_once(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passes, blocks = [], TextTable.blocks

    def counted(table: TextTable, *columns: Any) -> Iterator[Any]:
        passes.append(columns)
        return blocks(table, *columns)

    monkeypatch.setattr(TextTable, 'blocks', counted)
    TableRecording(log).read([SPEED, LOAD])
    assert len(passes) == 1


@pytest.mark.parametrize('kept_bytes', [1, 1 << 20, 1 << 30])
def test_rows_kept_in_a_file_come_back(log: Path, kept_bytes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    files, make = list[IO[bytes]](), tempfile.TemporaryFile
    monkeypatch.setattr(tempfile, 'TemporaryFile', lambda **kinds: files.append(make(**kinds)) or files[-1])
    monkeypatch.setattr(table_reading, '_MAX_KEPT_BYTES', kept_bytes)
    recording = TableRecording(log)
    reading = recording.reading([SPEED, LOAD])
    assert bool(files) == (kept_bytes < 1 << 30)
    parts = list(reading)
    for request, factor in ((SPEED, 1), (LOAD, 2)):
        value = np.concatenate([part[request].value for part in parts])
        np.testing.assert_array_equal(value, factor * np.arange(COUNT))
        time_ns = np.concatenate([part[request].log_time_ns for part in parts])
        np.testing.assert_array_equal(np.diff(time_ns), 10**9)
    del reading, parts
    assert all(file.closed for file in files)


def test_a_full_disk_is_reported_with_what_to_do(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'none'))
    monkeypatch.setattr(table_reading, '_MAX_KEPT_BYTES', 1)
    with pytest.raises(BagError, match=r"a\.csv' cannot be read: .* '.*none': free some there, or .*TMPDIR"):
        TableRecording(log).reading([SPEED])


@pytest.mark.parametrize('common', [20, 4])
def test_exports_that_overlap_in_one_file_are_sorted(common: int, tmp_path: Path) -> None:
    """Begin a second export before the end of the first; with other numbers the clock was set back."""
    rng = np.random.default_rng(3)
    speeds, engine_speeds = rng.normal(60.0, 1.0, 100).round(3), rng.normal(60.0, 1.0, 100).round(3)

    def span(behind: np.ndarray, count: int = 60) -> tuple[float, str]:
        """Return how long the log lasts [s], and its warnings."""
        lines = [f'{1_780_000_000 + k},{speeds[k]},1000' for k in range(count)]
        lines += [f'{1_780_000_000 + k},{behind[k]},1000' for k in range(count - common, 100)]
        path = tmp_path / 'a.csv'
        path.write_text('\n'.join(['time [s],shaft speed [rpm],bearing load [N]', *lines, '']))
        recording = TableRecording(path)
        series = recording.read([Request('shaft speed [rpm]', 'data')])
        times = series[Request('shaft speed [rpm]', 'data')].log_time_ns
        assert recording.end_ns is not None
        assert (np.diff(times) >= 0).all()
        return (recording.end_ns - times[0]) / 1e9, ' '.join(recording.warnings)

    seconds, text = span(speeds)
    assert seconds == 99.0
    assert text.endswith('the lines are in no order of time: sorted by time')
    seconds, text = span(engine_speeds)
    assert seconds == 99.0 + common
    assert f'set back once, by {common} s' in text
    # A shaft at rest has the same numbers again, whatever its clock.
    speeds[:], engine_speeds[:] = 0.0, 0.0
    assert span(engine_speeds)[0] == 99.0 + common
