# SPDX-License-Identifier: Apache-2.0
"""`stickslip check` says why an input brings nothing, in the words of the running monitor."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from shared import CONFIG, START

from stickslip_monitor.bags.encode import encode_float64s, encode_stamped
from stickslip_monitor.bags.writer import BagWriter
from stickslip_monitor.cli import main
from stickslip_monitor.monitor.input_watch import InputFacts, Publisher, input_fault
from stickslip_monitor.monitor.signals import Status

FLOAT, STAMPED = 'std_msgs/msg/Float64', 'geometry_msgs/msg/WrenchStamped'
SPEED, LOAD = '/shaft/speed', '/bearing/aft_stern/load'


def facts(**known: object) -> str:
    """The running monitor's sentence on the load."""
    return input_fault(InputFacts(LOAD, FLOAT, 2.0, True, **known))  # type: ignore[arg-type]


CASES = {
    'missing': (None, None, facts()[:-1] + f": the recording has no topic '{LOAD}': it has {SPEED}"),
    'silent': (FLOAT, (), facts()),
    'type': (
        'std_msgs/msg/Bool',
        (),
        facts(publishers=[Publisher("Bag 'bag.mcap'", 'std_msgs/msg/Bool')])[:-1],
    ),
    'refused': (
        FLOAT,
        np.full(100, np.nan),
        facts(publishers=[Publisher('x', FLOAT)], refused=Status.NOT_FINITE),
    ),
}


@pytest.mark.parametrize(('kind', 'values', 'sentence'), CASES.values(), ids=CASES)
def test_why_an_input_brings_nothing(
    kind: str | None,
    values: np.ndarray | None,
    sentence: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    time = START + np.arange(100) * 10**8
    with BagWriter(tmp_path / 'bag.mcap') as bag:
        bag.add_topic(SPEED, FLOAT)
        bag.write_float64s({SPEED: (time, np.full(100, 30.0))})
        if kind is not None and values is not None:
            bag.add_topic(LOAD, kind)
            if len(values):
                bag.write_columns([(LOAD, time, encode_float64s(values))])
    assert main(['check', str(tmp_path / 'bag.mcap'), '--config', str(CONFIG)]) == 2
    said = ''.join(capsys.readouterr())
    assert sentence in said


def test_clocks_that_differ_lose_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Stamps of the load are 100 s behind when they are recorded: then the arrival counts."""
    time = START + np.arange(100) * 10**8
    with BagWriter(tmp_path / 'bag.mcap') as bag:
        bag.add_topic(SPEED, FLOAT)
        bag.add_topic(LOAD, STAMPED)
        stamped = encode_stamped(STAMPED, 'wrench.force.z', time - 100 * 10**9, np.full(100, 1e3))
        bag.write_columns([(SPEED, time, encode_float64s(np.full(100, 30.0))), (LOAD, time, stamped)])
    config = tmp_path / 'config.yaml'
    text = CONFIG.read_text('utf-8')
    old = text[text.index('load: {') :].splitlines()[0]
    new = f'load: {{topic: {LOAD}, type: {STAMPED}, field: wrench.force.z, unit: N}}'
    config.write_text(text.replace(old, new))
    assert main(['check', str(tmp_path / 'bag.mcap'), '--config', str(config), '--json']) == 1
    (bearing,) = json.loads(capsys.readouterr().out)['bearings'].values()
    assert [own['used'] for own in bearing['inputs'].values()] == [100, 100]
    assert [event['to'] for event in bearing['events']] == ['bistable']
