# SPDX-License-Identifier: Apache-2.0
"""The node's latency and processor time, beside a node that only echoes."""

from __future__ import annotations

import os

import numpy as np

from benchmarks.live import Measurement, start_subjects
from benchmarks.table import Table, duration

RATES = (10.0, 100.0, 1000.0)
"""Messages a second of the speed, and as many of the load."""


def run(quick: bool) -> Table:
    """Compare both nodes at all rates, in turns."""
    turns, seconds = (1, 3.0) if quick else (3, 6.0)
    measurements: dict[tuple[str, float], list[Measurement]] = {}
    with start_subjects(150 + os.getpid() % 50) as nodes:
        for _ in range(turns):
            for rate in RATES:
                for name, node in nodes.items():
                    measurements.setdefault((name, rate), []).append(node.measure(rate, seconds))
    rows = []
    for rate in RATES:
        monitor_row, bare_row = (
            _summarise_stretches(measurements['monitor', rate]),
            _summarise_stretches(measurements['bare', rate]),
        )
        rows.append(
            [
                f'{rate:g} Hz',
                *(duration(value) for value in bare_row[:2]),
                *(duration(value) for value in monitor_row[:2]),
                f'{bare_row[2]:.1%}',
                f'{monitor_row[2]:.1%}',
                f'{monitor_row[3]:.0f} of {monitor_row[4]:.0f}',
                f'{monitor_row[5]:.0%}',
            ]
        )
    return Table(
        title='The node',
        text=_TEXT,
        columns=(
            'rate',
            'bare p50',
            'bare p99',
            'monitor p50',
            'monitor p99',
            'bare CPU',
            'monitor CPU',
            'lost',
            'answered',
        ),
        rows=rows,
    )


# A load comes half-way between two speeds. Latency is from the publication of a speed to the arrival of its
# answer (of the monitor, the Hopf margin). Lost is what the node has not counted as a sample; where it was
# late, the last of the samples that waited has the answer.
_TEXT = (
    'Latency of speed and load from one process to a node in another and back. The bare node publishes each'
    ' number again, the monitor all of its topics. CPU is the share of a core with all threads of DDS.'
)


def _summarise_stretches(stretches: list[Measurement]) -> tuple[float, ...]:
    """Return latency p50 and p99 [s], share of a core, messages lost and sent, and share answered."""
    latency = np.concatenate([stretch.latency for stretch in stretches])
    p50, p99 = np.percentile(latency, [50.0, 99.0]).tolist()
    cpu = float(np.mean([stretch.cpu for stretch in stretches]))
    lost, sent = sum(s.lost for s in stretches), sum(s.sent for s in stretches)
    return p50, p99, cpu, lost, 2 * sent, latency.size / sent
