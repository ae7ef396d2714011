# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of telemetry at 1 kHz: is a message lost?"""

from __future__ import annotations

import os

import numpy as np

from benchmarks.live import subjects
from benchmarks.table import Table, duration

RATE, SECONDS, SHORT = 1000.0, 600.0, 10.0


def run(quick: bool) -> Table:
    """Feed the monitor alone; a short run lasts ten seconds."""
    seconds = SHORT if quick else SECONDS
    with subjects(150 + os.getpid() % 50) as nodes:
        nodes.pop('bare').stop()
        found = nodes['monitor'].stretch(RATE, seconds)
    p50, p99 = np.percentile(found.latency, [50.0, 99.0]).tolist()
    row = [
        f'{seconds:g} s',
        f'{2 * found.sent}',
        f'{found.lost}',
        f'{found.answered:.1%}',
        duration(p50),
        duration(p99),
        duration(float(found.latency.max())),
        f'{found.cpu:.0%}',
    ]
    return Table(
        title='Ten minutes at 1 kHz',
        text=(
            'Speed and load, a thousand of each a second. Lost is what the node has not counted as'
            ' a sample; where it was late, the last of the samples that waited has the answer.'
        ),
        columns=('time', 'sent', 'lost', 'answered', 'p50', 'p99', 'most', 'CPU'),
        rows=[row],
    )
