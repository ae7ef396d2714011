# SPDX-License-Identifier: Apache-2.0
"""``python -m stickslip_monitor`` is the command ``stickslip``."""

import sys

from stickslip_monitor.cli import main

if __name__ == '__main__':
    sys.exit(main())
