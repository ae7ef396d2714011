# SPDX-License-Identifier: Apache-2.0
"""Pictures of the laboratory: each mark of a calibration where its evidence is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shared import CONFIG as REFERENCE_FILE
from shared import REFERENCE_BEARING
from slow_passages import FOLD, ONSET, slow_passage

from stickslip_lab.calibration.calibration import Evidence, calibrate, read_levels
from stickslip_lab.drawing.studies import draw_calibration
from stickslip_monitor.monitor.parameter_file import load_config
from stickslip_monitor.physics.probability import EXACT

pytest.importorskip('matplotlib')
CONFIG = replace(load_config(REFERENCE_FILE).bearings[0], bearing=REFERENCE_BEARING)


def lines_of(evidence: list[Evidence]) -> dict[str, Any]:
    """Return the lines of the picture's left panel, by name: x and y of each."""
    figure = draw_calibration(CONFIG, calibrate(evidence, REFERENCE_BEARING, EXACT))
    return {line.get_label(): np.array(line.get_data()) for line in figure.axes[0].lines}


def test_a_level_is_coloured_by_what_it_was_taken_for_and_its_ends_are_marked() -> None:
    lines = lines_of(read_levels('aft', [slow_passage(k) for k in range(3)]))
    # In vibration the level is the surface speed, 0 dB over it; quiet is 26 dB below that at the fold.
    assert np.median(lines['vibration'][1]) == pytest.approx(0.0, abs=0.3)
    assert np.median(lines['quiet'][1]) < -20.0
    # It vibrates below the onset on the way down, below the fold on the way up.
    assert np.percentile(lines['vibration'][0], 99) < 1.02
    assert lines['quiet'][0].min() > 0.97 * ONSET / FOLD
    np.testing.assert_allclose(lines['end at the fold'][0], 1.0, atol=0.02)
    assert 'fold is not below' not in lines


def test_reports_are_drawn_as_passages_and_a_bound_as_what_it_is() -> None:
    passage = slow_passage(level=False)
    # The list ends in the middle of the vibration.
    evidence = [
        passage,
        replace(slow_passage(1, level=False), reports=slow_passage(1, level=False).reports[:2]),
    ]
    lines = lines_of(evidence)
    assert lines['vibration reported'][1].tolist() == [1.0] * lines['vibration reported'].shape[1]
    assert lines['end at the fold'][1].tolist() == [1.0]
    (over,), (height,) = lines['fold is not below']
    assert (over < 1.02, height) == (True, 2.0)


def test_an_end_before_a_step_of_the_clock_is_drawn_at_its_own_part() -> None:
    first, second = (slow_passage(number, level=False) for number in range(2))
    parts = tuple(replace(passage.courses[0], name='bag') for passage in (first, second))
    lines = lines_of([Evidence('bag', parts, first.reports + second.reports)])
    np.testing.assert_allclose(lines['end at the fold'][0], 1.0, atol=0.05)
    assert lines['end at the fold'][1].tolist() == [1.0, 2.0]
