# SPDX-License-Identifier: Apache-2.0
"""Ten minutes of telemetry at 1 kHz: is a message lost?"""

from __future__ import annotations

import os

from benchmarks.live import subjects
from benchmarks.table import Table

RATE, SECONDS, SHORT = 1000.0, 600.0, 10.0


def run(quick: bool) -> Table:
    """Feed the monitor alone; a short run lasts ten seconds."""
    seconds = SHORT if quick else SECONDS
    with subjects(150 + os.getpid() % 50) as nodes:
        nodes.pop('bare').stop()
        found = nodes['monitor'].stretch(RATE, seconds)
    row = [
        f'{seconds:g} s',
        f'{2 * found.sent}',
        f'{found.lost}',
        f'{found.cpu:.0%}',
    ]
    return Table(
        title='Ten minutes at 1 kHz',
        text=(
            'Speed and load, a thousand of each a second. Lost is what the node has not counted as'
            ' a sample.'
        ),
        columns=('time', 'sent', 'lost', 'CPU'),
        rows=[row],
    )
