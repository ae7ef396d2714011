# SPDX-License-Identifier: Apache-2.0
"""The parts of the benchmarks, in the order of the page."""

PARTS: tuple[str, ...] = (
    'reading',
    'physics',
    'diagram',
    'integration',
    'check_day',
    'node',
    'fleet_node',
    'dashboard',
)
"""Modules of this package with ``run(quick: bool) -> Table``."""
SOAK = 'soak'
"""The part that takes ten minutes and is run by itself."""
