# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stickslip_lab.calibration.evidence import BIN_NS, bin_telemetry, read_reports
from stickslip_monitor.errors import CalibrationError

HEAD = 'bearing,start,end,state,tolerance [s],trust\n'


def test_reports_are_read_as_spreadsheets_write_them(tmp_path: Path) -> None:
    path = tmp_path / 'squeals.csv'
    path.write_text(
        '# watch of the second engineer\n'
        'bearing; start; end; state; tolerance [s]\n'
        'aft; 2026-05-04T08:03:40+02:00; 2026-05-04T08:00:00.5Z; quiet;\n'
        'aft; 2026-05-04T06:01:10Z; 2026-05-04T06:03:40Z; Squeal; 5\n'
    )
    squeal, quiet = read_reports(path, ['aft'])
    assert (squeal.squeal, quiet.squeal) == (True, False)
    assert squeal.end_ns == quiet.start_ns == 1777874620 * 10**9
    assert quiet.end_ns % 10**9 == 500_000_000
    assert (squeal.tolerance, squeal.trust) == (5.0, 0.9)
    assert (quiet.tolerance, quiet.source) == (10.0, f'{path}, line 3')


@pytest.mark.parametrize(
    ('rows', 'words'),
    [
        ('bow,2026-05-04T06:01:10Z,2026-05-04T06:03:40Z,quiet,,', "line 2: bearing 'bow' is not"),
        ('aft,2026-05-04T06:01:10,2026-05-04T06:03:40Z,quiet,,', 'a time with a zone'),
        ('aft,2026-05-04T06:03:40Z,2026-05-04T06:01:10Z,quiet,,', 'must be after start'),
        ('aft,2026-05-04T06:01:10Z,2026-05-04T06:01:10Z,quiet,,', 'must be after start'),
        (
            'aft,2026-05-04T06:01:10Z,2026-05-04T06:03:40Z,quiet,-1,',
            "tolerance = '-1' must be a finite number not below 0 s",
        ),
        (
            'aft,2026-05-04T06:01:10Z,2026-05-04T06:03:40Z,quiet,,1.5',
            "trust = '1.5' must be a finite number between 0 and 1",
        ),
        ('aft,2026-05-04T06:01:10Z', 'it has 2 cells and there are 6 headings'),
        (
            'aft,2026-05-04T06:01:10Z,2026-05-04T06:03:40Z,quiet,,\n'
            'aft,2026-05-04T06:02:10Z,2026-05-04T06:04:40Z,squeal,,',
            'line 3 contradicts .*line 2',
        ),
        ('', 'has no reports'),
    ],
)
def test_a_bad_report_is_named(tmp_path: Path, rows: str, words: str) -> None:
    path = tmp_path / 'squeals.csv'
    path.write_text(HEAD + rows)
    with pytest.raises(CalibrationError, match=words):
        read_reports(path, ['aft'])


@pytest.mark.parametrize('heading', ['tolerance [min]', 'tolerance (ms)'])
def test_a_tolerance_in_another_unit_is_refused(heading: str, tmp_path: Path) -> None:
    path = tmp_path / 'squeals.csv'
    row = 'aft,2026-05-04T06:01:10Z,2026-05-04T06:03:40Z,quiet,2,'
    path.write_text(HEAD.replace('tolerance [s]', heading) + row)
    with pytest.raises(CalibrationError, match=r"line 1: the tolerance is in 'm.*': write it in s"):
        read_reports(path, ['aft'])


def test_bins_are_averages_and_rest_stays_rest() -> None:
    time = (np.arange(40) * 10**8).astype(np.int64)
    speed = np.linspace(0.1, 0.4, 40) * -1.0
    speed[25] = 0.0
    course = bin_telemetry('bag', time, speed, np.full(40, 5.0))
    assert course.time_ns.tolist() == [BIN_NS // 2 + k * BIN_NS for k in range(4)]
    assert course.speed[0] == pytest.approx(-speed[:10].mean())
    assert course.speed[2] == 0.0
