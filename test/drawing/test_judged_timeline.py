# SPDX-License-Identifier: Apache-2.0
"""The picture of a judgement: its lines hold the speeds that went in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_monitor.drawing.judged_timeline import LiningTruth, draw_score
from stickslip_monitor.monitor.config_file import load_config
from stickslip_monitor.monitor.monitor import Monitor
from stickslip_monitor.monitor.signals import Stream

CONFIG = load_config(
    Path(__file__).resolve().parents[2] / 'launch_configs' / 'reference_bearing.yaml'
)
S = 1_000_000_000
NOTHING = np.empty(0)


def speed_lines(rpm: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Label and (time [s], speed [rpm]) of each line of the panel; a speed each second."""
    bearing = CONFIG.bearings[0]
    time = np.repeat(np.arange(rpm.size) * S, 2)
    place = np.tile([0, 1], rpm.size)
    stream = Stream(time, place, np.where(place, 1000.0, np.repeat(rpm, 2)))
    scan = Monitor(CONFIG).scan({bearing.name: stream}, 0, None)[bearing.name]
    end = int(time[-1])
    none = NOTHING.astype(np.int64)
    lining = LiningTruth(0, end, (), none, NOTHING, NOTHING, none, NOTHING)
    figure = draw_score('a_voyage', bearing, scan, lining)
    panel = figure.axes[0]
    assert panel.get_title('left') == f'a_voyage: {bearing.name}'
    return {str(line.get_label()): np.array(line.get_data()) for line in panel.get_lines()}


def test_astern_is_drawn_by_its_size_and_as_what_it_is() -> None:
    rpm = np.linspace(60.0, -60.0, 121)
    lines = speed_lines(rpm)
    for label, sign in (('measured', 1.0), ('astern', -1.0)):
        time, speed = lines[label][:, np.isfinite(lines[label][1])]
        np.testing.assert_allclose(speed, sign * rpm[time.astype(int)], atol=1e-9)
        # Sixty of the 121 seconds lie on either side; at rest it goes neither way.
        assert np.unique(time[speed > 0.0]).size == 60


def test_ahead_alone_needs_no_word_for_astern() -> None:
    assert set(speed_lines(np.linspace(60.0, 20.0, 41))) == {'measured', 'fold', 'Hopf'}


@pytest.mark.parametrize('rpm', [60.0, 20.0])
def test_boundaries_are_those_of_the_reference_bearing(rpm: float) -> None:
    lines = speed_lines(np.full(5, rpm))
    np.testing.assert_allclose(lines['Hopf'][1], 30.7380, atol=1e-4)
    np.testing.assert_allclose(lines['fold'][1], 40.7231, atol=1e-4)
