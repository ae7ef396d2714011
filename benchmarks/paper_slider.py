# SPDX-License-Identifier: Apache-2.0
"""The model beside measured stick-slip: a paper slider of known mass, spring and pulling speed.

    python -m benchmarks.paper_slider FOLDER

FOLDER holds files ``*_k<stiffness in N/m>_v<speed in um/s>*.npz`` with ``t`` [s] and
``force_over_weight``, the spring's force over ``m g``, at 2 kHz: the data of J. Colas and others,
Phys. Rev. E 100, 2019, published as github.com/npusteln/stickslip, converted from their text.
Stiffness, speed and mass are known. Static friction is the mean peak of every other event, kinetic
friction the mean of peaks and troughs (without damping slip swings as far beyond it as it began
short of it), and the rest of the events judges.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.signal import find_peaks, medfilt

from benchmarks.table import Table
from stickslip_monitor import Bearing, Coulomb, exact_cycle
from stickslip_monitor.arrays import FloatArray

MASS, GRAVITY = 0.0307, 9.81
# Samples of the median that takes out the sensor's spikes, by how much the force falls in a slip,
# over a noise of 0.005 that is left, and the least number of events.
_SPIKES, _STANDS_OUT, _FEWEST = 9, 0.03, 12
# Shares of a rise between which its slope is fitted: away from the ends of slip and stick.
_FITTED, _LEAST_FIT = (0.25, 0.75), 4


@dataclass(frozen=True, slots=True)
class Slider:
    """One recording.

    Attributes:
        stiffness: ``k`` [N/m].
        speed: Of the pulled end of the spring [m/s].
        time: Of the samples, shape (n,) [s].
        force: Of the spring over the weight, shape (n,) [-].
    """

    stiffness: float
    speed: float
    time: FloatArray
    force: FloatArray


@dataclass(frozen=True, slots=True)
class Events:
    """Stick-slip events: peak, the trough after it, the slope of the next rise, the period."""

    peak: FloatArray
    trough: FloatArray
    slope: FloatArray
    period: FloatArray

    def half(self, which: int) -> Events:
        """Return every other event, from the first or from the second on."""
        columns = (self.peak, self.trough, self.slope, self.period)
        return Events(*(column[which::2] for column in columns))


def load(path: Path) -> Slider:
    """Read a recording, whose name gives stiffness and speed."""
    named = re.search(r'_k(\d+)_v(\d+)', path.stem)
    assert named, path
    data = np.load(path)
    force = medfilt(np.asarray(data['force_over_weight'], float), _SPIKES)
    return Slider(float(named[1]), float(named[2]) * 1e-6, np.asarray(data['t'], float), force)


def events_of(slider: Slider) -> Events:
    """Return the events of a recording: where the force falls most within half a natural period."""
    force, time = slider.force, slider.time
    period = 2.0 * np.pi * np.sqrt(MASS / slider.stiffness)
    half = max(2, round(0.5 * period / float(time[1] - time[0])))
    falls, _ = find_peaks(force[:-half] - force[half:], height=_STANDS_OUT, distance=half)
    begins = [max(i - half, 0) for i in falls.tolist()]
    tops = {begin + int(np.argmax(force[begin : begin + 2 * half])) for begin in begins}
    rows = []
    for a, b in pairwise(sorted(tops)):
        bottom = a + int(np.argmin(force[a : min(a + 2 * half, b)]))
        part = slice(bottom, b + 1)
        rise = (force[part] - force[bottom]) / (force[b] - force[bottom])
        inside = (rise > _FITTED[0]) & (rise < _FITTED[1])
        fits = np.count_nonzero(inside) > _LEAST_FIT
        line = np.polyfit(time[part][inside], force[part][inside], 1) if fits else [np.nan]
        rows.append((force[a], force[bottom], line[0], time[b] - time[a]))
    return Events(*np.array(rows).reshape(-1, 4).T)


def compare_recording(path: Path) -> list[str]:
    """Return a row of the table."""
    slider = load(path)
    events = events_of(slider)
    name = f'{slider.stiffness:g} N/m, {slider.speed * 1e3:g} mm/s'
    if events.peak.size < _FEWEST:
        return [name, str(events.peak.size), 'too few', *['-'] * 6]
    fitted, judged, weight = events.half(0), events.half(1), MASS * GRAVITY
    static = float(np.mean(fitted.peak))
    kinetic = 0.5 * (static + float(np.mean(fitted.trough)))
    law = Coulomb(static, max(kinetic, 0.0))
    cycle = exact_cycle(Bearing(MASS, 0.0, slider.stiffness, law, 1.0), slider.speed, weight)
    amplitude = 0.5 * (judged.peak - judged.trough) * weight / slider.stiffness * 1e6
    slope = float(np.nanmedian(judged.slope)) / (slider.stiffness * slider.speed / weight)
    return [
        name,
        str(events.peak.size),
        f'{static:.2f} / {kinetic:.2f}',
        f'{np.std(events.peak) / static:.0%}',
        f'{slope:.3f}',
        f'{np.mean(amplitude):.1f} ± {np.std(amplitude):.1f}',
        f'{float(cycle.amplitude) * 1e6:.1f}',
        f'{np.mean(judged.period) * 1e3:.1f} ± {np.std(judged.period) * 1e3:.1f}',
        f'{float(cycle.period) * 1e3:.1f}',
    ]


def table_of(folder: Path) -> Table:
    """Return the table of every recording in a folder."""
    return Table(
        title='Measured stick-slip: a paper slider',
        text=__doc__.split('\n\n')[0] if __doc__ else '',
        columns=(
            'spring and speed',
            'events',
            'static / kinetic',
            'scatter of static',
            'loading slope over k V',
            'amplitude [um]',
            'model',
            'period [ms]',
            'model',
        ),
        rows=[compare_recording(path) for path in sorted(folder.glob('*_k*_v*.npz'))],
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=Path, help='folder with the recordings')
    for row in table_of(parser.parse_args().folder).rows:
        print(' | '.join(row))


if __name__ == '__main__':
    main()
