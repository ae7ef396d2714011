# SPDX-License-Identifier: Apache-2.0
"""Instants and windows of a motion, against motions known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip_monitor.lab.scenes.lining import (
    PERIODS,
    AmplitudeWindows,
    Regular,
    half_peak_to_peak,
)

PERIOD = 0.03


@pytest.mark.parametrize(
    'ends', [[10.0], [0.0, 0.1, 3.3, 3.3, 9.99, 10.0], [0.05 * k for k in range(201)]]
)
def test_regular_instants_do_not_depend_on_the_cuts(ends: list[float]) -> None:
    regular = Regular(30.0, 10.0)
    parts = [regular.until(end) for end in ends]
    assert np.array_equal(np.concatenate(parts), np.arange(301) / 30.0)
    for end, part in zip(ends, parts, strict=True):
        assert np.all(part <= end)


@pytest.mark.parametrize('ends', [[10.0], [0.07, 0.61, 3.3, 3.3, 9.99, 10.0]])
def test_windows_give_the_amplitude_of_a_motion_that_grows(ends: list[float]) -> None:
    """``x = e t + A exp(t/5) sin(omega t)``: half the peak to peak over the last four periods."""
    omega, rate = 2.0 * np.pi / PERIOD, 2.0
    windows = AmplitudeWindows(rate, PERIOD, 10.0)
    times, found = [], []
    for end in ends:
        t = windows.until(end)
        grown = 1e-3 * np.exp(t / 5.0)
        x = 1e-6 * t + grown * np.sin(omega * t)
        v = 1e-6 + grown * (np.sin(omega * t) / 5.0 + omega * np.cos(omega * t))
        at, amplitude = windows.amplitudes(x, v)
        assert np.all(at <= end)
        times.append(at)
        found.append(amplitude)
    time = np.concatenate(times)
    assert np.array_equal(time, np.arange(1, 21) / rate)
    # The last maximum and minimum lie within the last period.
    expected = 1e-3 * np.exp((time - 0.5 * PERIOD) / 5.0)
    assert np.concatenate(found) == pytest.approx(expected, rel=4e-3)


def test_peaks_between_samples_are_found_to_the_order_of_the_cubic() -> None:
    """A sine at 16 samples a period, at every phase: 6e-5 by the cubic, 2e-2 without it."""
    step = 1.0 / 16.0
    t = np.arange(65) * step
    phase = np.linspace(0.0, 1.0, 50)[:, None]
    x, v = np.sin(2 * np.pi * (t + phase)), 2 * np.pi * np.cos(2 * np.pi * (t + phase))
    assert half_peak_to_peak(x, v, step) == pytest.approx(1.0, abs=7e-5)
    # It is exact for a cubic: x = s^3 - s has its turning points at 1/sqrt(3).
    s = np.linspace(-1.1, 1.1, 8)
    found = half_peak_to_peak((s**3 - s)[None], (3 * s * s - 1)[None], float(s[1] - s[0]))
    assert found == pytest.approx(2.0 / 3.0 / np.sqrt(3.0), rel=1e-12)


def test_windows_may_not_overlap() -> None:
    assert AmplitudeWindows.highest_rate(PERIOD) == pytest.approx(1.0 / (PERIODS * PERIOD))


def test_a_motion_at_rest_has_no_amplitude() -> None:
    zero = np.zeros((2, 65))
    assert np.array_equal(half_peak_to_peak(zero + 3.0, zero, 0.1), [0.0, 0.0])
