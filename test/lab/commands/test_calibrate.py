# SPDX-License-Identifier: Apache-2.0
"""``stickslip calibrate`` on the library's coast-down: Hopf 30.74, fold 40.72 rpm at 1 kN."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import CONFIG, ROOT, RPM, Stickslip

from stickslip_lab.scenes.truth_topics import read_truth
from stickslip_logs.recordings.reader import open_bag
from stickslip_logs.recordings.writer import BagWriter
from stickslip_monitor.arrays import FloatArray
from stickslip_monitor.monitor.parameter_file import load_config

COAST_DOWN = ROOT / 'bags' / 'coast_down'


@pytest.fixture
def wrong_config(tmp_path: Path) -> Path:
    """Return a wrong configuration: damping +40 %, mu_s - mu_k -20 %, decay +25 %: fold at 24 rpm."""
    text = CONFIG.read_text()
    for original, replacement in (
        ('damping: 400.0 ', 'damping: 560.0 '),
        ('static: 0.30, kinetic: 0.10, decay: 10.0', 'static: 0.26, kinetic: 0.10, decay: 12.5'),
    ):
        assert original in text
        text = text.replace(original, replacement)
    path = tmp_path / 'wrong.yaml'
    path.write_text(text)
    return path


def middle_boundaries(document: dict[str, Any]) -> dict[str, float]:
    """Hopf and fold speed in the middle of the loads: 5, 50, 95 % [rpm]."""
    _, *speeds = document['boundaries'][len(document['boundaries']) // 2]
    names = [f'{name}_{p}' for name in ('hopf', 'fold') for p in (5, 50, 95)]
    return dict(zip(names, (v / RPM for v in speeds), strict=True))


def test_one_recording_corrects_a_wrong_drawing(
    wrong_config: Path, tmp_path: Path, stickslip: Stickslip
) -> None:
    result, law = tmp_path / 'aft.calibration.json', tmp_path / 'law.yaml'
    picture = tmp_path / 'map.svg'
    arguments = ['calibrate', COAST_DOWN, '-c', wrong_config, '-o', result]
    # One end alone is a warning.
    done = stickslip(*arguments, '--fragment', law, '--picture', picture)
    assert done.code == 1
    text = done.out
    assert '1 passage, 1 episode' in text
    assert 'all rests on one end of vibration' in text
    assert 'no measurement of friction' in text
    assert picture.stat().st_size > 10_000
    document = json.loads(result.read_text())
    boundaries = middle_boundaries(document)
    assert boundaries['fold_50'] == pytest.approx(40.72, rel=0.05)
    assert boundaries['fold_5'] < 40.72 < boundaries['fold_95']
    assert boundaries['hopf_5'] < 30.74 < boundaries['hopf_95']
    # The result is what the configuration names, beside it, and beats what it says itself.
    configured = wrong_config.with_name('calibrated.yaml')
    configured.write_text(
        wrong_config.read_text().replace(
            '      speed: {', '      calibration: aft.calibration.json\n      speed: {'
        )
    )
    belief = load_config(configured).bearings[0].belief
    assert belief.fold_speed(1000.0, 0.5) / RPM == pytest.approx(40.72, rel=0.05)
    # A check without either recommends tolerances, in one short line.
    for path, advised in ((wrong_config, True), (configured, False)):
        last = stickslip('check', COAST_DOWN, '-c', path).out.splitlines()[-1]
        assert last.startswith('aft_stern: add a tolerance') == advised
        assert not advised or len(last) < 80
    done = stickslip('assess', '-c', configured, '--speed', '35rpm', '--load', '1kN')
    assert done.code == 1
    assert 'probability that stick-slip can happen' in done.out
    assert 'damping: ' in law.read_text()


def test_an_operator_and_a_level_are_evidence_too(
    wrong_config: Path, tmp_path: Path, stickslip: Stickslip
) -> None:
    bag = open_bag(COAST_DOWN)
    ((begin, end),) = read_truth(bag, 'aft_stern').episodes
    times = [f'{np.datetime64(t, "ns")}Z' for t in (bag.start_ns, begin, end, bag.end_ns)]
    reports = tmp_path / 'squeals.csv'
    lines = [
        f'aft_stern,{a},{b},{state}'
        for a, b, state in zip(times, times[1:], ('quiet', 'squeal', 'quiet'), strict=False)
    ]
    reports.write_text('\n'.join(['bearing,start,end,state', *lines]))
    copy, level_ns = tmp_path / 'with_level.mcap', np.arange(bag.start_ns, bag.end_ns, 10**8)
    loud = (level_ns > begin) & (level_ns < end)
    noise = np.random.default_rng(3).standard_normal(level_ns.size)
    without_truth(copy, np.where(loud, 2.0, 0.1) * np.exp(0.1 * noise))
    configured = wrong_config.with_name('level.yaml')
    configured.write_text(
        wrong_config.read_text().replace('      speed: {', '      level: {topic: /level}\n      speed: {')
    )
    for arguments in ([COAST_DOWN, '--reports', reports, '-c', wrong_config], [copy, '-c', configured]):
        boundaries = middle_boundaries(stickslip('calibrate', *arguments, '--json').json)
        assert boundaries['fold_50'] == pytest.approx(40.72, rel=0.06)


def without_truth(copy: Path, level: FloatArray | None = None) -> None:
    """Speed and load of the coast-down, as a ship would record them, and perhaps a level."""
    bag, topics = open_bag(COAST_DOWN), ('/shaft/speed', '/bearing/aft_stern/load')
    with BagWriter(copy) as writer:
        for topic in topics:
            writer.add_topic(topic, 'std_msgs/msg/Float64')
        for message in bag.messages(topics):
            writer.write(message.topic, message.log_time_ns, message.data)
        if level is not None:
            writer.add_topic('/level', 'std_msgs/msg/Float64')
            time_ns = bag.start_ns + np.arange(level.size) * 10**8
            writer.write_float64s({'/level': (time_ns, level)})
