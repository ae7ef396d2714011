# SPDX-License-Identifier: Apache-2.0
"""Thinning keeps the outline: properties that hold for every recording."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stickslip_monitor.drawing.track import envelope

VALUES = arrays(
    np.float64,
    st.integers(1, 400),
    elements=st.one_of(st.floats(-1e3, 1e3), st.just(float('nan'))),
)


@given(VALUES, st.integers(6, 60))
def test_least_greatest_and_ends_stay_for_any_recording(column: np.ndarray, most: int) -> None:
    kept = envelope(most, column)
    assert np.all(np.diff(kept) > 0)
    assert {0, column.size - 1} <= set(kept.tolist())
    if np.isfinite(column).any():
        assert np.nanmin(column[kept]) == np.nanmin(column)
        assert np.nanmax(column[kept]) == np.nanmax(column)
    assert kept.size <= max(most, 3) + 2


@given(VALUES, st.integers(6, 60), st.data())
def test_every_stretch_of_two_blocks_keeps_its_extremes(
    column: np.ndarray, most: int, data: st.DataObject
) -> None:
    # A stretch of at least two blocks contains a whole block, so its greatest value is no
    # greater than what is kept of the blocks it touches: the drawn outline covers the recording.
    kept = envelope(most, column)
    length = 1 if column.size <= most else -(-column.size // (most // 3))
    i = data.draw(st.integers(0, column.size - 1))
    if np.isfinite(column[i]):
        block = i // length * length
        near = kept[(kept >= block) & (kept < block + length)]
        assert np.nanmin(column[near]) <= column[i] <= np.nanmax(column[near])


def test_one_sample_of_a_day_stays() -> None:
    column = np.full(864_000, 1.0)
    column[500_001] = -3.0
    kept = envelope(900, column)
    assert 500_001 in kept
    assert kept.size < 905


def test_an_interruption_stays() -> None:
    column = np.linspace(0.0, 1.0, 10_000)
    column[7_777] = np.nan
    assert np.isnan(column[envelope(300, column)]).sum() == 1


def test_extremes_of_every_column_stay() -> None:
    speed, load = np.zeros(50_000), np.zeros(50_000)
    speed[1_234], load[4_321] = 1.0, -1.0
    assert {1_234, 4_321} <= set(envelope(600, speed, load).tolist())


@pytest.mark.parametrize('size', [0, 1, 10])
def test_a_short_recording_stays_as_it_is(size: int) -> None:
    assert envelope(10, np.arange(float(size))).tolist() == list(range(size))
