# SPDX-License-Identifier: Apache-2.0
"""The import path of ``BagWriter`` in 0.3."""

import warnings

from stickslip_logs.recordings.writer import BagWriter

__all__ = ['BagWriter']

warnings.warn(
    'stickslip_monitor.bags.writer is deprecated: import BagWriter from stickslip_logs.recordings.writer',
    DeprecationWarning,
    stacklevel=2,
)
