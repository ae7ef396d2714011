# SPDX-License-Identifier: Apache-2.0
"""Log times that were rewritten do not hide an episode: the stamps say when a sample came."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import CONFIG, START

from stickslip_monitor.bags.encode import encode_stamped
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.offline.check import CheckReport, check_recording

SECOND = 10**9
STAMPED = 'geometry_msgs/msg/WrenchStamped'


def _checked(folder: Path, log_times: Any) -> CheckReport:
    """60 rpm for a minute, 20 rpm for three, 60 rpm for one, stamped ten times a second."""
    stamp = START + np.arange(3000) * (SECOND // 10)
    rpm = np.where((np.arange(3000) >= 600) & (np.arange(3000) < 2400), 20.0, 60.0)
    log = np.asarray(log_times(stamp), np.int64)
    config = folder / 'config.yaml'
    text = CONFIG.read_text('utf-8')
    for name, unit in (('speed', 'rpm'), ('load', 'N')):
        old = next(line for line in text.splitlines() if f'{name}: {{' in line)
        fields = f'topic: /{name}, type: {STAMPED}, field: wrench.force.z, unit: {unit}'
        text = text.replace(old, f'{old[: old.index(name)]}{name}: {{{fields}}}')
    config.write_text(text)
    with BagWriter(folder / 'bag.mcap') as bag:
        for name in ('/speed', '/load'):
            bag.add_topic(name, STAMPED)
        columns = [
            (name, log, encode_stamped(STAMPED, 'wrench.force.z', stamp, values))
            for name, values in (('/speed', rpm), ('/load', np.full(3000, 1e3)))
        ]
        bag.write_columns(columns)
    return check_recording(folder / 'bag.mcap', load_config(config))


def _stick_slip(report: CheckReport) -> tuple[float, list[str]]:
    """For how long stick-slip stood [s], and what is said of the inputs' clocks."""
    (bearing,) = report.bearings.values()
    own = [(e.time_ns, str(e.after) == 'stick_slip') for e in bearing.events]
    ends = [time for time, _ in own[1:]] + [report.end_ns or 0]
    lasting = sum(end - time for (time, there), end in zip(own, ends, strict=True) if there)
    return lasting / SECOND, [item.fault for item in bearing.inputs]


def test_what_is_played_at_its_own_pace_is_no_fault(tmp_path: Path) -> None:
    seconds, faults = _stick_slip(_checked(tmp_path, lambda stamp: stamp + SECOND // 100))
    assert seconds == pytest.approx(180.0, abs=15.0)
    assert faults == ['', '']


@pytest.mark.parametrize('pace', [0.1, 0.002, 20.0])
def test_rewritten_log_times_are_told_and_hide_nothing(tmp_path: Path, pace: float) -> None:
    later = START + 86_400 * SECOND
    seconds, faults = _stick_slip(_checked(tmp_path, lambda stamp: later + (stamp - START) * pace))
    assert seconds == pytest.approx(180.0, abs=15.0)
    assert set(faults) == {
        f'Log times pass {pace:g} times as fast as the stamps, so they were rewritten: judged by the stamps.'
    }
