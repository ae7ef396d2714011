# SPDX-License-Identifier: Apache-2.0
"""The import path of ``open_bag`` in 0.3."""

import warnings

from stickslip_logs.recordings.reader import open_bag

__all__ = ['open_bag']

warnings.warn(
    'stickslip_monitor.bags.reader is deprecated: import open_bag from stickslip_logs.recordings.reader',
    DeprecationWarning,
    stacklevel=2,
)
